"""The paths of rays from a source to a point, one by one: length, delay, directions, amplitude, and what they met."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from specklegen.core.arguments import real_array
from specklegen.core.display.repr import short
from specklegen.core.errors import reject
from specklegen.wavetracing.coherent_ray_sums import contributions
from specklegen.wavetracing.emitters import PointEmitter
from specklegen.wavetracing.geometry import Geometry
from specklegen.wavetracing.materials import LIGHT_SPEED


@dataclass(frozen=True, eq=False)
class RayPath:
    """One path.

    Attributes
    ----------
    amplitude : complex
        Its part of the field of `coherent_rays`, the phase of its length included.
    length : float
    departure, arrival : float64[3]
        Unit vectors of travel at the source and at the point.
    met : tuple
        In order, ("reflection", number of the mesh) and ("diffraction", number of the edge in ``geometry.edges``).

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
    length: float
    departure: np.ndarray
    arrival: np.ndarray
    met: tuple[tuple[str, int], ...]

    __repr__ = short

    @property
    def delay(self) -> float:
        """Seconds, for lengths in metres and light in vacuum."""
        return self.length / LIGHT_SPEED


def coherent_paths(
    geometry: Geometry,
    source: PointEmitter,
    point: ArrayLike,
    reflections: int = 1,
    diffractions: int = 2,
    polarisation: Literal["soft", "hard"] = "soft",
    surfaces: Literal["perfect", "material"] = "perfect",
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
        Most reflections on a path; 1 by default. Combinations of facets grow as their number to that power.
    diffractions
        Most edges on a path: 0, 1 or 2.
    polarisation
        "soft": u = 0 on perfect surfaces, TE on others; "hard": du/dn = 0, TM.
    surfaces
        "perfect": whatever their material; "material": by it, without what goes through walls.

    Raises
    ------
    RuleError
        For arguments out of range; a point or a source nearer to an edge on a path than 1 / k, where there is no ray
        yet; more than 50000 combinations of facets and edges.

    Examples
    --------
    >>> from specklegen.wavetracing import Conductor, Geometry, PointEmitter, coherent_paths, perforated_screen
    >>> mirror = perforated_screen([[-50, -50], [50, -50], [50, 50], [-50, 50]], material=Conductor())
    >>> lamp = PointEmitter(position=[0, 0, 9], wavelength=0.3)
    >>> [path.departure.tolist() for path in coherent_paths(Geometry([mirror]), lamp, [24.0, 0, 9], diffractions=0)]
    [[1.0, 0.0, 0.0], [0.8, 0.0, -0.6]]
    """
    end = real_array("coherent_paths point", point)
    if end.shape != (3,) or not np.isfinite(end).all():
        reject("coherent_paths point", "a finite point float64[3]", end)
    parts = contributions(
        "coherent_paths", geometry, source, end[None], reflections, diffractions, polarisation, surfaces
    )
    paths = []
    for part in parts:
        if part.field[0] != 0:
            out, back = part.towards[0] - source.position, end - part.back[0]
            out, back = out / np.linalg.norm(out), back / np.linalg.norm(back)
            paths.append(RayPath(complex(part.field[0]), float(part.length[0]), out, back, part.met))
    return sorted(paths, key=lambda path: path.length)
