"""Jones matrices of connections: what a path does to the polarisation of light, beside its scalar amplitude.

    J = S(w_(B-1) -> v) M S(i -> w_1),    J = S(i -> v) of single scattering,    |S1|^2 + |S2|^2 = 2

from the field of the light to that of the view, M from the walk (:mod:`specklegen.kernels.jones`). The field of a path
is its scalar amplitude times J. Fields stand along x and y of the laboratory, turned the shortest way until they are
across the direction of light or view: an analyser that is turned against the axis sees them so. A path walked backwards
has the transposed matrices.

Faces multiply by what they leave of either polarisation of the light and of the view
(:func:`specklegen.paths.faces.crossing_matrices`). Legs are unfolded: a mirror z -> -z changes no scattering matrix
between fields in space, but the sign of the second axis of a walk's frame.
"""

from typing import NamedTuple

import numpy as np

from specklegen.core.values import read_only, remembered
from specklegen.kernels import lobes
from specklegen.paths.bank import PathBank, walk_frame
from specklegen.paths.faces import crossing_matrices
from specklegen.paths.phase_tables import walk_lobes
from specklegen.scene.faces import Faces
from specklegen.scene.media import Medium
from specklegen.scene.polarisation import Polarisation
from specklegen.scene.scatterers import Scatterer

_TYPE_NODES = 8193
"""Of amplitudes by type: a step is an angle of 3.5e-4 / cos(theta / 4) at most."""
_STRAIGHT = 1e-12
"""Squared sine of a scattering angle below which no plane matters."""


class Ends(NamedTuple):
    """Polarisation at the ends of connections: the particles by type, their model, and the faces."""

    scatterers: tuple[Scatterer, ...]
    polarisation: Polarisation
    faces: Faces = Faces()

    def matrices(self, cos: np.ndarray, kind: int = 0) -> np.ndarray:
        """S1 and S2 of a type beside the scalar amplitude, complex128[2, ...], phase off; ``|S1|^2 + |S2|^2 = 2``."""
        if self.polarisation == "projector":
            across = np.sqrt(2 / (1 + np.square(cos)))
            return np.stack([across, across * cos]).astype(np.complex128)
        matrices = self.scatterers[kind].amplitude_matrix(cos)
        scalar = self.scatterers[kind].amplitude(cos)
        matrices = matrices * np.exp(-1j * np.angle(scalar))
        return matrices * np.sqrt(2 / np.square(np.abs(matrices)).sum(axis=0))

    def parts(self, cos: np.ndarray, kinds: np.ndarray | int = 0) -> tuple[np.ndarray, np.ndarray | None]:
        """S1 and (S2 - cos S1) / sin^2, complex128[..., M]; with them a scattering from i to v needs no plane.

        a . S b = S1 (a . b) - (S2 - cos S1) / sin^2 (a . i) (v . b)    for a across v, b across i.

        The latter is None of the projector: it is 0. ``kinds`` int[M] are the types of particles.
        """
        cos = np.clip(cos, -1, 1)
        if self.polarisation == "projector":
            return np.sqrt(2 / (1 + np.square(cos))), None
        angle, square = np.arccos(cos), (1 - cos) * (1 + cos)
        across, along = np.empty(cos.shape, np.complex128), np.empty(cos.shape, np.complex128)
        for kind in np.unique(kinds):
            some = ... if np.ndim(kinds) == 0 else (..., kinds == kind)
            theta, *tables = _end_table(self.scatterers[kind])
            across[some], along[some] = (np.interp(angle[some], theta, each) for each in tables)
        return across, np.divide(along - cos * across, square, out=np.zeros_like(across), where=square > _STRAIGHT)


@remembered(16)
def _end_table(scatterer: Scatterer) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Angles, S1 and S2 of a particle at ends: at the nodes of its walks' phase function, and evenly between."""
    lobe = np.arccos(1 - walk_lobes(scatterer)[0].rows[:, lobes.NODE])
    theta = np.unique(np.concatenate([lobe, np.linspace(0, np.pi, 4097)]))
    return theta, *Ends((scatterer,), "vector").matrices(np.cos(theta))


def ends_of(medium: Medium) -> Ends | None:
    """Return the polarisation at the ends of connections; None for scalar light."""
    if medium.polarisation == "scalar":
        return None
    types = tuple(each for material in medium.scatterers for each, _ in material.components)
    return Ends(types, medium.polarisation, medium.faces)


def require_ends(medium: Medium) -> Ends:
    """Return it for a medium of polarised light."""
    ends = ends_of(medium)
    assert ends is not None, "it was asked for polarised light"
    return ends


@remembered(16)
def type_matrices(medium: Medium) -> np.ndarray | None:
    """S1 and S2 of every type for the volume walk, float64[t, n, 4]; no rows by the projector, None of scalars."""
    ends = ends_of(medium)
    if ends is None or ends.polarisation == "projector":
        return None if ends is None else read_only(np.empty((0, 0, 4)))
    place = np.linspace(0, 1, _TYPE_NODES)
    half = np.where(place <= 0.5, 2 * np.square(place), 1 - 2 * np.square(1 - place))
    matrices = np.stack([_parts(each.amplitude_matrix(1 - 2 * half)) for each in ends.scatterers])
    return read_only(matrices)


def _parts(found: np.ndarray) -> np.ndarray:
    """S1 and S2 complex128[2, n] as real and imaginary parts float64[n, 4], ``|S1|^2 + |S2|^2 = 2``."""
    one, two = found * np.sqrt(2 / np.square(np.abs(found)).sum(axis=0))
    return np.stack([one.real, one.imag, two.real, two.imag], axis=-1)


@remembered(32)
def walk_matrices(ends: Ends) -> np.ndarray:
    """S1 and S2 for walks through a slab, float64[n, 4] at nodes of its phase function; no rows of the projector."""
    if ends.polarisation == "projector":
        return read_only(np.empty((0, 4)))
    (particle,) = ends.scatterers
    matrices = _parts(particle.amplitude_matrix(1 - walk_lobes(particle)[0].rows[:, lobes.NODE]))
    return read_only(matrices)


def unfolded_matrices(jones: np.ndarray, bounces: np.ndarray) -> np.ndarray:
    """Matrices complex128[M, 2, 2] of walks between the frames of directions as they are unfolded, int8[M, 2] times."""
    signs = np.where(bounces % 2 == 1, -1.0, 1.0)
    matrices = jones.copy()
    matrices[:, :, 1] *= signs[:, 0, None]
    matrices[:, 1, :] *= signs[:, 1, None]
    return matrices


def connection_matrices(ends: Ends, bank: PathBank, light: np.ndarray, view: np.ndarray) -> np.ndarray:
    """J complex128[M, 2, 2] of connections of a polarised walk, for a light and a view float64[3] (of travel)."""
    matrices = np.empty((len(bank), 2, 2), np.complex128)
    once = bank.orders == 1
    here, there = laboratory_frame(light), laboratory_frame(view)
    matrices[once] = scattering(ends, light, here, view, there, bank.types[once, 0])
    turned = once & (bank.bounces.sum(axis=1) % 2 == 1)
    if turned.any():
        matrices[turned] = scattering(ends, light, here, view * MIRROR, there * MIRROR, bank.types[turned, 0])
    many = bank.select(~once)
    assert many.jones is not None, "the walk was polarised"
    first, last = many.entry_direction, many.exit_direction
    into = scattering(ends, light, here, first, walk_frame(first), many.types[:, 0])
    matrices[~once] = scattering(ends, last, walk_frame(last), view, there, many.types[:, 1]) @ many.jones @ into
    if ends.faces.matched:
        return matrices
    entering, leaving = (crossing_matrices(ends.faces, each) for each in (light, view))
    return leaving[bank.bounces[:, 1]] @ matrices @ entering[bank.bounces[:, 0]]


def scattering(
    ends: Ends, before: np.ndarray, frame: np.ndarray, after: np.ndarray, other: np.ndarray,
    kinds: np.ndarray | int = 0,
) -> np.ndarray:  # fmt: skip
    """Matrices complex128[..., 2, 2] between directions float64[..., 3] and their frames float64[..., 2, 3]."""
    before, after = np.broadcast_arrays(before, after)
    cos = (before * after).sum(-1)
    if np.ndim(kinds) and not cos.ndim:  # one scattering of particles of several types
        cos = np.full(np.shape(kinds), cos)
    across, aside = ends.parts(cos, kinds)
    matrices = across[..., None, None] * np.einsum("...ij,...kj->...ik", other, frame)
    if aside is None:
        return matrices.astype(np.complex128)
    leaving, arriving = np.einsum("...ij,...j->...i", other, before), np.einsum("...ij,...j->...i", frame, after)
    return matrices - aside[..., None, None] * leaving[..., :, None] * arriving[..., None, :]


MIRROR = np.array([1.0, 1.0, -1.0])
"""What a face does to a direction."""


class Analysed(NamedTuple):
    """Light and analyser of a scene, complex128[2] each, and what the ends of connections do."""

    ends: Ends
    light: np.ndarray
    analyser: np.ndarray

    def single(
        self, lights: np.ndarray, views: np.ndarray, bounces: tuple[int, int] = (0, 0), kind: int = 0
    ) -> np.ndarray:
        """Amplitude complex128[T, V] that one scattering sends through the analyser, directions of travel float64.

        ``bounces`` are the reflections of the leg before it and behind, ``kind`` is the type of the particle.
        """
        entering = self._seen(self.light, lights, bounces[0])
        passed = self._seen(self.analyser, views, bounces[1]).conj()
        if sum(bounces) % 2:
            views, passed = views * MIRROR, passed * MIRROR
        across, aside = self.ends.parts(lights @ views.T, kind)
        amplitude = across * (entering @ passed.T)
        return amplitude if aside is None else amplitude - aside * (entering @ views.T) * (lights @ passed.T)

    def arriving(self, bank: PathBank, lights: np.ndarray) -> np.ndarray:
        """Both components complex128[2, T, M] of what arrives at x_B, of connections of multiple scattering."""
        first, each = bank.entry_direction, bank.bounces[:, 0]
        across, aside = self.ends.parts(lights @ first.T, bank.types[:, 0])
        lying = self._along(self.light, lights, first, each)
        aside = None if aside is None else aside * lying
        seen = [_sent(across, self._along(self.light, lights, axis, each), aside, lights @ axis.T)
                for axis in _axes(first)]  # fmt: skip
        assert bank.jones is not None, "the walk was polarised"
        return np.stack([row[:, 0] * seen[0] + row[:, 1] * seen[1] for row in np.moveaxis(bank.jones, 1, 0)])

    def passing(self, bank: PathBank, views: np.ndarray) -> np.ndarray:
        """Transmission of the analyser for both components, complex128[2, V, M]."""
        last, each = bank.exit_direction, bank.bounces[:, 1]
        across, aside = self.ends.parts(views @ last.T, bank.types[:, 1])
        aside = None if aside is None else aside * self._along(self.analyser, views, last, each).conj()
        return np.stack([_sent(across, self._along(self.analyser, views, axis, each).conj(), aside, views @ axis.T)
                         for axis in _axes(last)])  # fmt: skip

    def _seen(self, field: np.ndarray, directions: np.ndarray, bounces: int) -> np.ndarray:
        """Fields complex128[n, 3] in space at directions float64[n, 3], behind the face and some reflections by it."""
        if self.ends.faces.matched:
            return _vectors(field[None], directions)
        left = np.stack([crossing_matrices(self.ends.faces, each)[bounces] for each in directions])
        return _vectors(left @ field, directions)

    def _along(self, field: np.ndarray, directions: np.ndarray, axes: np.ndarray, bounces: np.ndarray) -> np.ndarray:
        """Parts complex128[n, M] of the same along vectors float64[M, 3], by reflections int8[M]."""
        if self.ends.faces.matched:
            return _vectors(field[None], directions) @ axes.T
        parts = np.empty((len(directions), len(axes)), np.complex128)
        for m in np.unique(bounces):
            parts[:, bounces == m] = self._seen(field, directions, int(m)) @ axes[bounces == m].T
        return parts


def _sent(across: np.ndarray, along: np.ndarray, aside: np.ndarray | None, out: np.ndarray) -> np.ndarray:
    """S1 (a . b) less the rest of :meth:`Ends.parts`, where there is any."""
    return across * along if aside is None else across * along - aside * out


def _vectors(fields: np.ndarray, directions: np.ndarray) -> np.ndarray:
    """Fields complex128[n, 3] in space, of those along x and y complex128[n, 2] at directions float64[n, 3]."""
    frames = walk_frame(directions)
    return fields[:, :1] * frames[:, 0] + fields[:, 1:] * np.copysign(1.0, directions[:, 2:]) * frames[:, 1]


def _axes(directions: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Both axes float64[M, 3] of the walk's frames."""
    frames = walk_frame(directions)
    return frames[:, 0], frames[:, 1]


def laboratory_frame(direction: np.ndarray) -> np.ndarray:
    """Return x and y float64[2, 3], turned as the axis is, the shortest way into a direction float64[3]."""
    frame = walk_frame(direction)
    return frame * np.array([[1.0], [np.copysign(1.0, direction[2])]])
