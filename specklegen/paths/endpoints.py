"""Partners of the ends of a path: lights on one side, views on the other.

Both are seen from the medium: a far endpoint is a direction away from it, so a plane wave travelling along i is
the endpoint -i, and by reciprocity one function evaluates either end. Phases of directions are relative to a reference
direction where all look the same way, so that no absolute phase is formed: the phase that this leaves out belongs to a
connection alone, and is random anyway (:func:`specklegen.paths.phases.reversal_phases` where it is not).
"""

from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Self

import numpy as np

from specklegen.core.values import read_only
from specklegen.kernels import volume_walk
from specklegen.kernels.footprints import UNLIMITED
from specklegen.paths.volumes import footprint_code, spatial
from specklegen.scene.illumination import directions_of_sines
from specklegen.scene.scene import Scene
from specklegen.scene.sensors import FarFieldGrid

_PROBES = 5
AXIS = np.array([0.0, 0.0, 1.0])
"""The optical axis."""


@dataclass(frozen=True)
class Endpoints:
    """Lights or views.

    Attributes
    ----------
    near : bool
        Whether they are points; else directions away from the medium.
    given : float64[n, 3] or FarFieldGrid
        Points or unit vectors; a grid is not spread out before somebody asks for :attr:`vectors`.
    footprint, radius :
        Beam profile on the entrance plane; radius 0 is none.
    reference : float64[3]
        Unit vector that phases of directions are relative to; 0 for absolute ones.
    tilted : float64[n, 3] or None
        Directions of the phases, where all else is to stay as at :attr:`given` (:mod:`specklegen.paths.far_field`).
    """

    near: bool
    given: np.ndarray | FarFieldGrid
    wavelength: float
    footprint: int = UNLIMITED
    radius: float = 0.0
    reference: np.ndarray = field(default_factory=lambda: np.zeros(3))
    tilted: np.ndarray | None = None

    def __len__(self) -> int:
        return int(np.prod(self.given.shape)) if isinstance(self.given, FarFieldGrid) else len(self.given)

    @cached_property
    def vectors(self) -> np.ndarray:
        """float64[n, 3], in C order of a grid; always read-only, for which kernels then compile once."""
        if isinstance(self.given, FarFieldGrid):
            return self.of(slice(None)).vectors
        return read_only(np.ascontiguousarray(self.given).view())

    @property
    def turns(self) -> np.ndarray:
        """float64[n, 3], turns per unit length of each direction beside the reference."""
        vectors = self.vectors if self.tilted is None else self.tilted
        if not self.reference.any():
            return vectors / self.wavelength
        return offsets(vectors, self.reference, self.wavelength)

    def of(self, chosen: np.ndarray | slice) -> Self:
        """Return the endpoints of these numbers."""
        if not isinstance(self.given, FarFieldGrid):
            return replace(self, given=self.given[chosen])
        numbers = np.arange(*chosen.indices(len(self))) if isinstance(chosen, slice) else np.asarray(chosen)
        row, column = np.divmod(numbers, self.given.shape[1])
        x, y = self.given.sines
        return replace(self, given=directions_of_sines("view", np.stack([x[column], y[row]], -1), self.given.sign))

    def at(self, vectors: np.ndarray) -> Self:
        """Others of the kind: float64[n, 3]."""
        return replace(self, given=np.ascontiguousarray(np.atleast_2d(vectors)))

    def few(self) -> Self:
        """A few of them, which stand for all."""
        chosen = np.unique(np.linspace(0, max(len(self) - 1, 0), _PROBES).astype(int))
        return self.of(chosen) if len(self) else self

    def probed(self) -> Self:
        """A few of them without their profile: what only other beams light must be judged as if these did."""
        return replace(self.few(), footprint=UNLIMITED, radius=0.0)


def offsets(directions: np.ndarray, reference: np.ndarray, wavelength: float) -> np.ndarray:
    """(directions - reference) / wavelength, float64[n, 3] turns per unit length, without cancellation in z.

    ``(v_z - r_z) = -(v_xy^2 - r_xy^2)/(v_z + r_z)``, never from ``1 - cos``.
    """
    difference = directions - reference
    lateral = np.square(directions[..., :2]).sum(-1) - np.square(reference[:2]).sum()
    along = directions[..., 2] + reference[2]
    safe = np.abs(along) > 0.5  # same side as the reference: the difference is small
    difference[..., 2] = np.where(safe, -lateral / np.where(safe, along, 1.0), difference[..., 2])
    return difference / wavelength


def light_endpoints(scene: Scene) -> Endpoints:
    """The lights of a scene."""
    lights = spatial(scene.lights)
    if scene.illumination.near:
        return Endpoints(True, lights, scene.wavelength)
    reference = np.zeros(3) if scene.medium.has_sides else -AXIS
    if scene.illumination.limited:
        beams = scene.beams
        footprint = footprint_code(beams.profile)
        return Endpoints(False, -lights, scene.wavelength, footprint, beams.width / 2, reference)
    return Endpoints(False, -lights, scene.wavelength, reference=reference)


def view_endpoints(scene: Scene) -> Endpoints:
    """The views of a scene, in C order."""
    if scene.sensor.near:
        return Endpoints(True, spatial(scene.views), scene.wavelength)
    reference = np.zeros(3) if scene.medium.has_sides else scene.side * AXIS
    grid = scene.sensor.regular_grid
    given = spatial(scene.views) if grid is None else grid
    return Endpoints(False, given, scene.wavelength, reference=reference)


def plane_endpoints(vectors: np.ndarray, wavelength: float, radius: float = 0.0) -> Endpoints:
    """Far views of a slab, unit vectors float64[n, 3] away from it, of one side; lights of unlimited ``radius``."""
    reference = np.sign(vectors[0, 2]) * AXIS if len(vectors) else AXIS
    return Endpoints(False, vectors, wavelength, UNLIMITED, radius, reference)


def probes(endpoints: Endpoints) -> tuple[np.ndarray, np.ndarray]:
    """Kinds int64[n] and vectors float64[n, 3] of the probes, as the walk reads them."""
    few = endpoints.probed().vectors
    kind = volume_walk.NEAR if endpoints.near else volume_walk.FAR
    return np.full(len(few), kind, np.int64), np.array(few, order="C")
