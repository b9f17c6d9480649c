"""Jones matrices of connections: what a path does to the polarisation of light, beside its scalar amplitude.

    J = S(w_(B-1) -> v) M S(i -> w_1),    J = S(i -> v) of single scattering,    |S1|^2 + |S2|^2 = 2

from the field of the light to that of the view, M from the walk (:mod:`specklegen.kernels.jones`). The field of a path
is its scalar amplitude times J. Fields stand along x and y of the laboratory, turned the shortest way until they are
across the direction of light or view: an analyser that is turned against the axis sees them so. A path walked backwards
has the transposed matrices.
"""

from typing import NamedTuple

import numpy as np

from specklegen.core.values import remembered
from specklegen.kernels import lobes
from specklegen.paths.bank import PathBank, walk_frame
from specklegen.paths.phase_tables import walk_lobes
from specklegen.scene.media import Slab
from specklegen.scene.polarisation import Polarisation
from specklegen.scene.scatterers import Scatterer

_STRAIGHT = 1e-12
"""Squared sine of a scattering angle below which no plane matters."""


class Ends(NamedTuple):
    """What the ends of connections do to polarisation: the particle, and the model of it."""

    scatterer: Scatterer
    polarisation: Polarisation

    def matrices(self, cos: np.ndarray) -> np.ndarray:
        """S1 and S2 beside the scalar amplitude, complex128[2, ...]: |S1|^2 + |S2|^2 = 2, its phase taken off."""
        if self.polarisation == "projector":
            across = np.sqrt(2 / (1 + np.square(cos)))
            return np.stack([across, across * cos]).astype(np.complex128)
        found = self.scatterer.amplitude_matrix(cos)
        scalar = self.scatterer.amplitude(cos)
        found = found * np.exp(-1j * np.angle(scalar))
        return found * np.sqrt(2 / np.square(np.abs(found)).sum(axis=0))

    def parts(self, cos: np.ndarray) -> tuple[np.ndarray, np.ndarray | None]:
        """S1 and (S2 - cos S1) / sin^2, complex128[...]; with them a scattering from i to v needs no plane.

        a . S b = S1 (a . b) - (S2 - cos S1) / sin^2 (a . i) (v . b)    for a across v, b across i.

        The latter is None of the projector: it is 0.
        """
        cos = np.clip(cos, -1, 1)
        if self.polarisation == "projector":
            return np.sqrt(2 / (1 + np.square(cos))), None
        theta, across, along = _end_table(self)
        angle, square = np.arccos(cos), (1 - cos) * (1 + cos)
        across, along = (np.interp(angle, theta, each) for each in (across, along))
        return across, np.divide(along - cos * across, square, out=np.zeros_like(across), where=square > _STRAIGHT)


@remembered(16)
def _end_table(ends: Ends) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Angles, S1 and S2 for the ends: at the nodes of the walk's lobe, and evenly between."""
    lobe = np.arccos(1 - walk_lobes(ends.scatterer)[0].rows[:, lobes.NODE])
    theta = np.unique(np.concatenate([lobe, np.linspace(0, np.pi, 4097)]))
    return theta, *ends.matrices(np.cos(theta))


def ends_of(medium: Slab) -> Ends | None:
    """What the ends of connections of a slab do; None where light is a scalar."""
    return None if medium.polarisation == "scalar" else Ends(medium.scatterer, medium.polarisation)


@remembered(32)
def walk_matrices(ends: Ends) -> np.ndarray:
    """S1 and S2 for the walk, float64[n, 4] at the nodes of its lobe; no rows of the projector."""
    if ends.polarisation == "projector":
        return np.empty((0, 4))
    one, two = ends.scatterer.amplitude_matrix(1 - walk_lobes(ends.scatterer)[0].rows[:, lobes.NODE])
    scale = np.sqrt(2 / (np.square(np.abs(one)) + np.square(np.abs(two))))
    found = np.stack([one.real, one.imag, two.real, two.imag], axis=-1) * scale[:, None]
    found.flags.writeable = False
    return found


def connection_matrices(ends: Ends, bank: PathBank, light: np.ndarray, view: np.ndarray) -> np.ndarray:
    """J complex128[M, 2, 2] of connections of a polarised walk, for a light and a view float64[3] (of travel)."""
    found = np.empty((len(bank), 2, 2), np.complex128)
    once = bank.orders == 1
    here, there = laboratory_frame(light), laboratory_frame(view)
    found[once] = scattering(ends, light, here, view, there)
    many = bank.select(~once)
    assert many.jones is not None, "the walk was polarised"
    first, last = many.entry_direction, many.exit_direction
    into = scattering(ends, light, here, first, walk_frame(first))
    found[~once] = scattering(ends, last, walk_frame(last), view, there) @ many.jones @ into
    return found


def scattering(
    ends: Ends, before: np.ndarray, frame: np.ndarray, after: np.ndarray, other: np.ndarray
) -> np.ndarray:
    """Matrices complex128[..., 2, 2] between directions float64[..., 3] and their frames float64[..., 2, 3]."""
    before, after = np.broadcast_arrays(before, after)
    across, aside = ends.parts((before * after).sum(-1))
    found = across[..., None, None] * np.einsum("...ij,...kj->...ik", other, frame)
    if aside is None:
        return found.astype(np.complex128)
    leaving, arriving = np.einsum("...ij,...j->...i", other, before), np.einsum("...ij,...j->...i", frame, after)
    return found - aside[..., None, None] * leaving[..., :, None] * arriving[..., None, :]


class Analysed(NamedTuple):
    """Light and analyser of a scene, complex128[2] each, and what the ends of connections do."""

    ends: Ends
    light: np.ndarray
    analyser: np.ndarray

    def single(self, lights: np.ndarray, views: np.ndarray) -> np.ndarray:
        """Amplitude complex128[T, V] that one scattering sends through the analyser, directions of travel float64."""
        entering, passed = _vectors(self.light, lights), _vectors(self.analyser, views).conj()
        across, aside = self.ends.parts(lights @ views.T)
        found = across * (entering @ passed.T)
        return found if aside is None else found - aside * (entering @ views.T) * (lights @ passed.T)

    def arriving(self, bank: PathBank, lights: np.ndarray) -> np.ndarray:
        """Both components complex128[2, T, M] of what arrives at x_B, of connections of multiple scattering."""
        entering, first = _vectors(self.light, lights), bank.entry_direction
        across, aside = self.ends.parts(lights @ first.T)
        aside = None if aside is None else aside * (entering @ first.T)
        seen = [_sent(across, entering @ each.T, aside, lights @ each.T) for each in _axes(first)]
        assert bank.jones is not None, "the walk was polarised"
        return np.stack([row[:, 0] * seen[0] + row[:, 1] * seen[1] for row in np.moveaxis(bank.jones, 1, 0)])

    def passing(self, bank: PathBank, views: np.ndarray) -> np.ndarray:
        """What the analyser passes of either of these components, complex128[2, V, M]."""
        passed, last = _vectors(self.analyser, views).conj(), bank.exit_direction
        across, aside = self.ends.parts(views @ last.T)
        aside = None if aside is None else aside * (passed @ last.T)
        return np.stack([_sent(across, passed @ each.T, aside, views @ each.T) for each in _axes(last)])


def _sent(across: np.ndarray, along: np.ndarray, aside: np.ndarray | None, out: np.ndarray) -> np.ndarray:
    """S1 (a . b) less the rest of :meth:`Ends.parts`, where there is any."""
    return across * along if aside is None else across * along - aside * out


def _vectors(field: np.ndarray, directions: np.ndarray) -> np.ndarray:
    """Fields complex128[n, 3] in space, of one along x and y at directions float64[n, 3]."""
    frames = walk_frame(directions)
    return field[0] * frames[:, 0] + field[1] * np.copysign(1.0, directions[:, 2:]) * frames[:, 1]


def _axes(directions: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Both axes float64[M, 3] of the walk's frames."""
    frames = walk_frame(directions)
    return frames[:, 0], frames[:, 1]


def laboratory_frame(direction: np.ndarray) -> np.ndarray:
    """Return x and y float64[2, 3], turned as the axis is, the shortest way into a direction float64[3]."""
    found = walk_frame(direction)
    return found * np.array([[1.0], [np.copysign(1.0, direction[2])]])
