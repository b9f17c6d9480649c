"""The paths of rays from a source to a point, one by one: length, delay, directions, amplitudes, and what they met."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Literal

import numpy as np
from numpy.typing import ArrayLike

from specklegen.core.arguments import choice, real_array
from specklegen.core.display.repr import short
from specklegen.core.errors import reject
from specklegen.core.quantities import with_units
from specklegen.core.units import LENGTH
from specklegen.wavetracing.coherent_ray_sums import FLOOR, PathSearch
from specklegen.wavetracing.edge_graph import Surfaces
from specklegen.wavetracing.emitters import PointEmitter
from specklegen.wavetracing.geometry import Geometry
from specklegen.wavetracing.kernels import edge_paths
from specklegen.wavetracing.materials import LIGHT_SPEED


@dataclass(frozen=True, eq=False)
class RayPath:
    """One path.

    Attributes
    ----------
    amplitude : complex
        Its part of the field of `coherent_rays`, the phase of its length included.
    pair : complex128[2]
        The same for both polarisations, soft and hard.
    vectors : complex128[2, 3]
        Electric fields at the point that a unit field along theta, and one along phi, makes; of light that leaves
        along ``departure`` in spherical coordinates about the z axis, over the wave 1 m from the source.
    length : float
    departure, arrival : float64[3]
        Unit vectors of travel at the source and at the point.
    points : float64[N, 3]
        The source, where the path turns, and the point.
    met : tuple
        In order, ("reflection", number of the mesh) and ("diffraction", number of the edge in ``geometry.edges``);
        ("smooth", number of the mesh) for a smooth body, once where it reflects, twice where light creeps around it.

    Examples
    --------
    >>> from specklegen.wavetracing import Conductor, Geometry, PointEmitter, coherent_paths, perforated_screen
    >>> mirror = perforated_screen([[-50, -50], [50, -50], [50, 50], [-50, 50]], material=Conductor())
    >>> lamp = PointEmitter(position=[0, 0, 9], wavelength=0.3)
    >>> for path in coherent_paths(Geometry([mirror]), lamp, [24.0, 0, 9], diffractions=0):
    ...     print(path.length, path.met, f"{path.delay:.3g}")
    24.0 () 8.01e-08
    30.0 (('reflection', 0),) 1e-07
    """

    amplitude: complex
    pair: np.ndarray
    vectors: np.ndarray
    length: float
    departure: np.ndarray
    arrival: np.ndarray
    points: np.ndarray
    met: tuple[tuple[str, int], ...]

    __repr__ = short

    @property
    def delay(self) -> float:
        """Seconds, for lengths in metres and light in vacuum."""
        return self.length / LIGHT_SPEED


@with_units
def coherent_paths(
    geometry: Geometry,
    source: PointEmitter,
    point: Annotated[ArrayLike, LENGTH],
    reflections: int = 1,
    diffractions: int = 2,
    polarisation: Literal["soft", "hard"] = "soft",
    surfaces: Surfaces = "perfect",
    floor_db: float = FLOOR,
) -> list[RayPath]:
    """Return the paths to a point float64[3], the shortest first; their amplitudes add up to `coherent_rays`.

    A ray that ends on a boundary of light and shadow counts by half.

    Parameters
    ----------
    geometry
        The scene.
    source
        Its place, wavelength and power; the beam angle plays no part.
    point : float64[3]
        Where paths end, in the scene's unit of length.
    reflections
        Most reflections on a path, at most 4; 1 by default.
    diffractions
        Most edges on a path: 0, 1 or 2.
    polarisation
        Of ``amplitude``. "soft": u = 0 on perfect surfaces, TE on others; "hard": du/dn = 0, TM.
    surfaces
        "perfect": whatever their material; "material": by it, without what goes through walls.
    floor_db
        Paths past two edges are left out once all that are left are together this many dB below those that were found.

    Raises
    ------
    RuleError
        For arguments out of range; a point nearer to the source than 1 / k.

    Examples
    --------
    >>> from specklegen.wavetracing import Conductor, Geometry, PointEmitter, coherent_paths, perforated_screen
    >>> mirror = perforated_screen([[-50, -50], [50, -50], [50, 50], [-50, 50]], material=Conductor())
    >>> lamp = PointEmitter(position=[0, 0, 9], wavelength=0.3)
    >>> [path.departure.tolist() for path in coherent_paths(Geometry([mirror]), lamp, [24.0, 0, 9], diffractions=0)]
    [[1.0, 0.0, 0.0], [0.8, 0.0, -0.6]]
    """
    end = real_array("coherent_paths point", point).copy()
    if end.shape != (3,) or not np.isfinite(end).all():
        reject("coherent_paths point", "a finite point float64[3]", end)
    choice("coherent_paths polarisation", polarisation, ("soft", "hard"))
    search = PathSearch("coherent_paths", geometry, source, reflections, diffractions, surfaces, floor_db)
    search.check(end[None])
    start, seen = search.seen(end[None])
    place = np.array(source.position, float)
    values, met, near = edge_paths.paths_to(place, start, end, seen[0], search.graph, search.tree, search.rules)
    search.warn_near(min(near, 1))
    rows = zip(values, met, strict=True)
    paths = [_path(row, codes, search, int(polarisation == "hard")) for row, codes in rows]
    return sorted(paths, key=lambda path: path.length)


def _path(row: np.ndarray, codes: np.ndarray, search: PathSearch, chosen: int) -> RayPath:
    """One path from its row of `specklegen.wavetracing.kernels.edge_paths`."""
    count, size = int((codes != 0).sum()), np.sqrt(search.source.power / (4 * np.pi))
    points = row[edge_paths.STATIONS : edge_paths.SURFACES].reshape(-1, 3)[: count + 2].copy()
    legs = np.diff(points, axis=0)
    lengths = np.linalg.norm(legs, axis=1, keepdims=True)
    ways = np.divide(legs, lengths, out=np.roll(legs, 1, axis=0), where=lengths > 0)
    pair = size * row[: edge_paths.TOTAL].view(complex)
    numbers = search.graph.numbers
    met = tuple(
        ("diffraction", int(numbers[c - 1])) if c > 0
        else ("reflection", -1 - int(c)) if c >= -edge_paths.CURVED
        else ("smooth", -1 - edge_paths.CURVED - int(c)) for c in codes[:count]
    )  # fmt: skip
    vectors = size * _carried(row, codes[:count], ways, search)
    return RayPath(
        complex(pair[chosen]), pair, vectors, float(row[edge_paths.TOTAL]), ways[0], ways[-1], points, met
    )  # fmt: skip


def _frame(axis: np.ndarray, way: np.ndarray, plane: bool, before: np.ndarray) -> np.ndarray:
    """Unit vectors float64[2, 3] of soft and hard light along ``way``, at an edge, or at a mirror of a normal."""
    soft = np.cross(before, axis) if plane else axis - (axis @ way) * way
    if np.linalg.norm(soft) < 1e-9:  # straight onto a mirror: any direction in it
        soft = np.cross(before, np.eye(3)[np.abs(before).argmin()])
    soft = soft / np.linalg.norm(soft)
    return np.array([soft, np.cross(soft, way)])


def spherical(way: np.ndarray) -> np.ndarray:
    """Unit vectors float64[2, 3] along theta and phi at a direction; on the z axis phi = 0 is taken."""
    level = np.cross([0.0, 0.0, 1.0], way)
    phi = level / np.linalg.norm(level) if np.linalg.norm(level) > 1e-12 else np.array([0.0, 1.0, 0.0])
    return np.array([np.cross(phi, way), phi])


def _carried(row: np.ndarray, codes: np.ndarray, ways: np.ndarray, search: PathSearch) -> np.ndarray:
    """Fields complex128[2, 3] at the end of a path, of unit vectors along theta and phi at its beginning."""
    surfaces = row[edge_paths.SURFACES : edge_paths.PAIR].view(complex).reshape(-1, 2)
    pair = row[edge_paths.PAIR : edge_paths.PAIR + 8].view(complex).reshape(2, 2)
    fields = spherical(ways[0])[:, None] * np.array([1, 0])[None, :, None] + 0j  # [2, 2, 3]
    bends = np.flatnonzero(codes > 0)
    for n, code in enumerate(codes):
        edge = code > 0
        leg = ways[n + 1] - ways[n]
        axis = search.graph.edges[code - 1, 3:6] if edge else leg / max(np.linalg.norm(leg), 1e-300)
        came, goes = (_frame(axis, way, not edge, ways[n]) for way in ways[n : n + 2])
        if not edge:
            fields = np.einsum("fpc,qc,q,qd->fpd", fields, came, surfaces[n], goes)
            continue
        if n == bends[0]:  # one part for each polarisation at the first edge
            parts = np.einsum("fpc,qc->fq", fields, came)
            fields = parts[:, :, None] * (came if len(bends) == 1 else goes)[None]
        if n == bends[-1]:
            fields = np.einsum("fpc,qc,pq,qd->fd", fields, came, pair, goes)[:, None] * np.array([1, 0])[None, :, None]
    return fields.sum(axis=1) * (1 if len(bends) else pair[0, 0])
