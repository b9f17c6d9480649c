"""The two ends of every connection: what evaluators share.

Phases are relative to two reference directions, i_ref on the illumination side and v_ref on the sensor
side: a tilt contributes (i - i_ref) . x1 and a view (v - v_ref) . x_B, in turns. Differences in z come
from the lateral parts, (v_z - r_z) = -(v_xy^2 - r_xy^2)/(v_z + r_z), never from 1 - cos.
"""

from dataclasses import dataclass

import numpy as np

from specklegen.core.parallel import Threads, map_blocks, slices
from specklegen.core.random_streams import Seed, Stream, stream_key
from specklegen.kernels import sums, walk
from specklegen.paths.bank import PathBank
from specklegen.paths.layout import footprint_code
from specklegen.scene.illumination import CollimatedBeams
from specklegen.scene.media import Slab
from specklegen.scene.scene import Scene

BLOCK = 16384
"""Connections whose ends are found at a time; each end stands alone, so the size changes no bit."""

AXIS = np.array([0.0, 0.0, 1.0])


@dataclass(frozen=True)
class Optics:
    """What the ends of a connection need to know of a scene.

    Attributes
    ----------
    wavelength : float
    medium : Slab
    footprint, radius :
        Kind and half width of the beams' profile.
    tilts : float64[T, 3]
    tilt_reference, view_reference : float64[3]
    """

    wavelength: float
    medium: Slab
    footprint: int
    radius: float
    tilts: np.ndarray
    tilt_reference: np.ndarray
    view_reference: np.ndarray

    @classmethod
    def of(cls, wavelength: float, medium: Slab, beams: CollimatedBeams, side: float = 1.0) -> "Optics":
        """Optics of beams on a medium, seen from the side of the sign given; both references on the axis."""
        return cls(
            wavelength, medium, footprint_code(beams.profile), beams.width / 2, beams.directions,
            AXIS, side * AXIS,
        )  # fmt: skip

    @classmethod
    def of_scene(cls, scene: Scene) -> "Optics":
        """Optics of a scene; the reference view is the axis on the side that most views look from."""
        return cls.of(scene.wavelength, scene.slab, scene.beams, scene.side)


def offsets(directions: np.ndarray, reference: np.ndarray, wavelength: float) -> np.ndarray:
    """(directions - reference) / wavelength, float64[n, 3] turns per unit length, without cancellation in z."""
    difference = directions - reference
    lateral = np.square(directions[..., :2]).sum(-1) - np.square(reference[:2]).sum()
    along = directions[..., 2] + reference[2]
    safe = np.abs(along) > 0.5  # same side as the reference: the difference is small
    difference[..., 2] = np.where(safe, -lateral / np.where(safe, along, 1.0), difference[..., 2])
    return difference / wavelength


def random_phases(bank: PathBank, seed: Seed, sample: int = 0, *, threads: Threads = 1) -> np.ndarray:
    """complex128[M], one unit phasor z per (path, order), the same for every tilt and view."""
    z = np.empty(len(bank), np.complex128)
    key = stream_key(seed, Stream.PHASES)
    map_blocks(
        lambda part: sums.random_phases(*key, sample, bank.orders[part], bank.paths[part], z[part]),
        slices(len(bank), BLOCK), threads,
    )  # fmt: skip
    return z


def reversal_phases(bank: PathBank, optics: Optics) -> np.ndarray:
    """complex128[M], the phasors that ``bank.reversed()`` needs beside those of ``bank.multiple``.

    Both directions of a path share one random phase, but drop different reference phases: the reversed one
    must take (i_ref + v_ref) . (x_B - x1) with it.
    """
    bank = bank.multiple
    turns = (bank.exit - bank.entry) @ ((optics.tilt_reference + optics.view_reference) / optics.wavelength)
    return np.exp(2j * np.pi * (turns - np.rint(turns)))


def illumination_ends(bank: PathBank, optics: Optics, factors: np.ndarray, *, single: bool) -> np.ndarray:
    """complex128[T, M], factor_m sqrt(W_m) A_t(m); ``single`` leaves out s, for a bank of single scattering."""
    out = np.empty((len(optics.tilts), len(bank)), np.complex128)
    sums.illumination_ends(
        bank.records, int(single), optics.medium.scatterer.g, optics.medium.extinction, optics.footprint,
        optics.radius, optics.tilts, offsets(optics.tilts, optics.tilt_reference, optics.wavelength), factors, out,
    )  # fmt: skip
    return out


def sensor_ends(
    bank: PathBank, optics: Optics, views: np.ndarray, *, single: bool, turns: np.ndarray | None = None
) -> np.ndarray:
    """complex128[R, M], B_v(m) at views float64[R, 3]; phases by ``turns`` per length float64[R, 3], if given."""
    if turns is None:
        turns = offsets(views, optics.view_reference, optics.wavelength)
    out = np.empty((len(views), len(bank)), np.complex128)
    sums.sensor_ends(
        bank.records, int(single), optics.medium.scatterer.g, optics.medium.extinction,
        optics.medium.thickness, np.ascontiguousarray(views), turns, out,
    )  # fmt: skip
    return out


def single_amplitudes(optics: Optics, views: np.ndarray) -> np.ndarray:
    """float64[T, ...], s(i . v) at views float64[..., 3], the factor that single scattering leaves to the end."""
    return optics.medium.scatterer.amplitude(np.einsum("tc,...c->t...", optics.tilts, views))


def contributions(bank: PathBank, optics: Optics, tilt: np.ndarray, view: np.ndarray) -> np.ndarray:
    """float64[M], w = W |A_tilt|^2 |B_view|^2, whose mean over paths is the intensity at that view."""
    out = np.empty(len(bank))
    sums.contributions(
        bank.records, bank.orders, optics.medium.scatterer.g, optics.medium.extinction,
        optics.medium.thickness, optics.footprint, optics.radius, tilt, view, out,
    )  # fmt: skip
    return out



def plane_optics(medium: Slab, wavelength: float, tilts: np.ndarray, side: float = 1.0) -> Optics:
    """Optics of unlimited plane waves at tilts float64[T, 3]; intensities are per unit area of the face."""
    return Optics(wavelength, medium, walk.UNLIMITED, np.inf, tilts, AXIS, side * AXIS)
