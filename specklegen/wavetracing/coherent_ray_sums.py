"""Fields by rays with phases: all paths by mirrors and past edges, added up.

    u = sum over paths of a e^{ik |path|},   |u|^2 the power flux,

``a = sqrt(P / 4 pi) / |path|`` by mirrors, times -1 for each if soft (``u = 0`` there), +1 if hard (``du/dn = 0``).
Past an edge the path carries u_i(Q) D A e^{iks}, with mirrors before and behind; past two edges, perhaps with mirrors
in between, the D of `specklegen.wavetracing.kernels.double_edges`, uniform where both edges are nearly in line. A wave
of radius r in the plane of ray and edge spreads behind it as ``A = sqrt(r / (s (r + s)))``; at a first edge r is s', at
a second one ``1/r = cos^2 psi / (s' + s) + sin^2 psi / s``, psi between the edges across the ray. Paths are reciprocal.

Surfaces are perfect, or of their material: reflection by Fresnel's coefficients, TE for "soft" and TM for "hard", and
the images' parts of D multiplied by those of the faces. These are taken at the smaller of both angles to each face, so
that source and receiver may change places. Black and diffuse surfaces have no images; light goes through thin walls.
Smooth convex bodies reflect as curved surfaces, and light creeps around them
(`specklegen.wavetracing.kernels.creeping`). Left out: corners.

Sources: J. B. Keller, J. Opt. Soc. Am. 52, 116 (1962); R. G. Kouyoumjian, P. H. Pathak, Proc. IEEE 62, 1448 (1974);
R. J. Luebbers, IEEE Trans. Antennas Propag. 32, 70 (1984); H. M. El-Sallabi, P. Vainikainen, ibid. 53, 3105 (2005);
S. Steinberg, M. Pharr, *Wave Tracing*, section on bilinear path tracing.
"""

from __future__ import annotations

from typing import Annotated, Literal

import numpy as np
from numpy.typing import ArrayLike

from specklegen.core.arguments import choice, instance, real_array, real_number, whole_number
from specklegen.core.errors import reject, warn_user
from specklegen.core.parallel import Threads, map_blocks, slices
from specklegen.core.quantities import with_units
from specklegen.core.units import LENGTH
from specklegen.wavetracing.edge_graph import Surfaces, graph_of
from specklegen.wavetracing.emitters import PointEmitter
from specklegen.wavetracing.geometry import Geometry
from specklegen.wavetracing.kernels import edge_paths
from specklegen.wavetracing.wedge import NEAREST

FLOOR = 200.0
"""dB below the paths found, of the power that may be left out."""
_BLOCK = 16  # points


class PathSearch:
    """Data of a search for paths: the graph of a scene, a source, and the limits; arguments of `coherent_rays`."""

    def __init__(self, name, geometry, source, reflections, diffractions, surfaces, floor_db):
        instance(f"{name} geometry", geometry, Geometry)
        instance(f"{name} source", source, PointEmitter)
        reflections = whole_number(f"{name} reflections", reflections, 0, edge_paths.MIRRORS)
        diffractions = whole_number(f"{name} diffractions", diffractions, 0, 2)
        choice(f"{name} surfaces", surfaces, ("perfect", "material"))
        floor = real_number(f"{name} floor_db", floor_db)
        if not floor >= 0:
            reject(f"{name} floor_db", "at least 0 dB below the paths found", floor_db)
        self.name, self.source, self.tree = name, source, geometry.tree
        self.graph = graph_of(geometry, source.wavelength, surfaces, reflections, diffractions)
        self.rules = edge_paths.Rules(reflections, diffractions, 2 * np.pi / source.wavelength, 10 ** (-floor / 10))
        if reflections + diffractions > 1:
            self._doubt_bodies(geometry)

    def _doubt_bodies(self, geometry: Geometry) -> None:
        """Warn of smooth bodies beside one another, or beside edges of other solids and sheets."""
        bodies = self.graph.bodies
        solid = geometry.solids.solid[bodies.places[bodies.starts[:-1, 2]]]
        place = np.argsort(geometry.order)
        faces = geometry.edges.faces[self.graph.numbers, 0]
        sharp = int((~np.isin(geometry.solids.solid[place[faces]], solid)).sum())
        if len(solid) > 1 or (len(solid) and sharp):
            warn_user(
                f"{self.name}: {len(solid)} smooth bodies stand beside one another or beside {sharp} sharp edges, and "
                "waves that meet two of these are missing: believe points that one of them shadows or lights, and use "
                "a wave solver where shadows or reflections of two overlap",
            )

    def seen(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the source and points float64[P, 3], each taken off the face that it lies on."""
        place = np.array(self.source.position, float)
        source, others = np.empty((1, 3)), np.empty((len(points), 3))
        edge_paths.raise_points(place[None], points[0] if len(points) else place, self.graph, self.tree, source)
        edge_paths.raise_points(points, place, self.graph, self.tree, others)
        return source[0], others

    def check(self, points: np.ndarray) -> None:
        """Refuse points float64[P, 3] at the source; warn where corners matter."""
        apart = np.linalg.norm(points - self.source.position, axis=1).min(initial=np.inf)
        if self.rules.k * apart < NEAREST:
            reject(
                f"{self.name} points", "1 / k away from the source at least", float(apart),
                "Nearer by there is no power flux of a ray.",
            )  # fmt: skip
        edges, short = self.graph.edges, 0
        for edge in edges if len(points) else []:
            middle = edge[:3] + edge[6] / 2 * edge[3:6]
            short += bool(edge[6] < 2 * np.sqrt(self.source.wavelength * np.linalg.norm(points - middle, axis=1).min()))
        if short:
            warn_user(
                f"{short} of {len(edges)} edges are shorter than the Fresnel zone of the nearest point: corners "
                f"matter, from which {self.name} has no rays; use field_on_plane for openings, or trace for power",
            )  # fmt: skip

    def found(
        self, points: np.ndarray, threads: Threads, middles=None, half=None, normals=None
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return fields complex128[P, 2] at points, soft and hard, and mean powers float64[P, 2] over their cells.

        Where ``normals`` float64[P, 3] are given, powers are those through surfaces.
        """
        self.check(points)
        place, (start, seen) = np.array(self.source.position, float), self.seen(points)
        middles, half = (points, np.zeros((2, 3))) if middles is None or half is None else (middles, half)
        fields, powers = np.empty((len(points), 2), complex), np.empty((len(points), 2))
        normals = np.zeros((len(points), 3)) if normals is None else normals

        def block(part: slice) -> int:
            return edge_paths.fields_at(
                place, start, points[part], seen[part], np.concatenate([middles[part], half]), normals[part],
                self.graph, self.tree, self.rules, fields[part], powers[part],
            )  # fmt: skip

        self.warn_near(sum(map_blocks(block, slices(len(points), _BLOCK), threads)))
        size = self.source.power / (4 * np.pi)
        return np.sqrt(size) * fields, size * powers

    def warn_near(self, near: int) -> None:
        """Warn of ``near`` points whose paths pass an edge within 1 / k of an end."""
        if near:
            warn_user(
                f"{self.name}: paths to {near} points pass an edge within wavelength / 2 pi of an end, where the "
                "theory of edges is only roughly right",
            )


@with_units
def coherent_rays(
    geometry: Geometry,
    source: PointEmitter,
    points: Annotated[ArrayLike, LENGTH],
    reflections: int = 1,
    diffractions: int = 2,
    polarisation: Literal["soft", "hard"] = "soft",
    surfaces: Surfaces = "perfect",
    floor_db: float = FLOOR,
    threads: Threads = None,
) -> np.ndarray:
    """Return the field of a point source at points, by all paths of a number of reflections and diffractions.

    Parameters
    ----------
    geometry
        The scene.
    source
        Its place, wavelength and power; the beam angle plays no part.
    points : float64[..., 3]
    reflections
        Most reflections on a path, at most 4.
    diffractions
        Most edges on a path: 0, 1 or 2. Light creeps around smooth bodies from 1 on.
    polarisation
        "soft": u = 0 on perfect surfaces, TE on others; "hard": du/dn = 0, TM.
    surfaces
        "perfect": whatever their material; "material": by it, without what goes through walls.
    floor_db
        Paths past two edges are computed in the order of an upper bound of their power, until all that are left are
        together this many dB below those that were found.
    threads
        Threads, by default all cores that the process may run on; the result does not depend on them.

    Returns
    -------
    complex128[...]
        |u|^2 is the power flux, P / 4 pi r^2 in free space.

    Raises
    ------
    RuleError
        For arguments out of range; points nearer to the source than 1 / k.

    A `DoubtWarning` says where edges are shorter than the Fresnel zone of the nearest point: corners matter there, from
    which there are no rays; where paths pass an edge within 1 / k of the source or a point; and where waves are missing
    that meet two smooth bodies, or a smooth body and an edge of another.

    Examples
    --------
    >>> from specklegen.wavetracing import Conductor, Geometry, PointEmitter, perforated_screen, coherent_rays
    >>> mirror = Geometry([perforated_screen([[-50, -50], [50, -50], [50, 50], [-50, 50]], material=Conductor())])
    >>> lamp = PointEmitter(position=[0, 0, 10], wavelength=1.0)
    >>> abs(coherent_rays(mirror, lamp, [[3.0, 0.0, 20.0]], diffractions=0)).round(5)
    array([0.03075])
    """
    points = real_array("coherent_rays points", points)
    if points.ndim < 1 or points.shape[-1] != 3 or not np.isfinite(points).all():
        reject("coherent_rays points", "finite, float64[..., 3]", points)
    choice("coherent_rays polarisation", polarisation, ("soft", "hard"))
    search = PathSearch("coherent_rays", geometry, source, reflections, diffractions, surfaces, floor_db)
    fields, _ = search.found(points.reshape(-1, 3).copy(), threads)
    return fields[:, int(polarisation == "hard")].reshape(points.shape[:-1])
