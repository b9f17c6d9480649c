"""Correlation of stationary speckle of polarised light: connections with both components of their field.

    C_ab(q, x) = E[w f_a f_b* e^(-i q . R - 2 x Y)],    f = J e,    a, b in {x, y}

of light polarised along e, R the lateral way from face to face (:mod:`specklegen.memory_effects.oblique`) and Y the
momentum transfer (:mod:`specklegen.memory_effects.film`). Behind an analyser a the field is a^T* f: both components are
drawn together, so that a seed is one medium behind all analysers.

Along the axis a path may be turned about it by any angle, and mirrored. Of what one analyser passes that leaves

    K(q, phi) = sum_r ( h0 J0(qr) - 2 Re(h2 e^(2i phi)) J2(qr) + 2 Re(h4 e^(4i phi)) J4(qr) ) / sum_r h0

with the harmonics h of |a^T* J(alpha) e|^2 over turns alpha: it is real and even, and **not round**.
"""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import ClassVar

import numpy as np

from specklegen.core.random_streams import Seed, pilot_seed
from specklegen.core.statistics import BATCHES
from specklegen.memory_effects.correlation import RADIUS_BINS, axial_tracer, radius_bins
from specklegen.memory_effects.oblique import face_to_face
from specklegen.memory_effects.polarised import bessel_even
from specklegen.paths.endpoint_factors import contributions
from specklegen.paths.endpoints import AXIS
from specklegen.paths.jones import connection_matrices, require_ends
from specklegen.paths.layout import plane_layout
from specklegen.paths.momentum import momentum_transfer
from specklegen.paths.proposal import plane_proposal
from specklegen.paths.roulette import slab_roulette
from specklegen.paths.slab_tracer import SlabTracer
from specklegen.scene.media import PlaneMedium
from specklegen.scene.motion import Motion, reduced_time
from specklegen.scene.polarisation import Polarisers

_AT_ONCE = 2**21  # phasors in memory
FAINTEST = 1e-24
"""Share of the light below which an analyser passes nothing but rounding."""
_PAULI = np.array([[[1, 0], [0, 1]], [[0, -1], [1, 0]], [[1, 0], [0, -1]], [[0, 1], [1, 0]]])


@dataclass(frozen=True)
class PolarisedFields:
    """Connections about a light and a view, and what of both components of the field they bring there.

    Attributes
    ----------
    displacement : float64[M, 2]
        R of each connection.
    fields : complex128[2, M]
        sqrt(w) f, along x and y.
    analyser : complex128[2]
        Of length 1.
    paths : int
        What to divide the sum of the weights by for the intensity per unit area.
    transfer : float64[M] or None
        Momentum transfer of each connection, where it was asked for.
    times, motion
        Of a film, the time of each beam float64[T], and how the particles move.
    """

    displacement: np.ndarray
    fields: np.ndarray
    analyser: np.ndarray
    paths: int
    transfer: np.ndarray | None = None
    times: np.ndarray | None = None
    motion: Motion | None = None

    @cached_property
    def weights(self) -> np.ndarray:
        """float64[M], contribution of each connection through the analyser."""
        return np.square(np.abs(self.analyser.conj() @ self.fields))

    def matrix(self, sines: np.ndarray, wavenumber: float) -> np.ndarray:
        """Matrix complex128[2 T, 2 T] between both components of beams at direction sines float64[T, 2], by beam.

        Over the intensity of both.
        """
        tilts, norm = len(sines), max(self._total, 1e-300)
        if self.times is not None:
            return self._film(sines, wavenumber) / norm
        total = np.zeros((2 * tilts, 2 * tilts), np.complex128)
        step = max(1, _AT_ONCE // max(2 * tilts, 1))
        for start in range(0, len(self.weights), step):
            part = slice(start, start + step)
            waves = np.exp(-1j * wavenumber * (sines @ self.displacement[part].T))
            waves = (waves[:, None] * self.fields[:, part]).reshape(2 * tilts, -1)
            total += waves @ waves.conj().T
        return total / norm

    def _film(self, sines: np.ndarray, wavenumber: float) -> np.ndarray:
        """Correlation of beams at their times: pairs of one tilt and one lag are computed once."""
        assert self.times is not None, "a film has times"
        assert self.motion is not None, "and a motion"
        assert self.transfer is not None, "and the momentum that paths transfer"
        tilts, wavelength = len(sines), 2 * np.pi / wavenumber
        x = reduced_time("CollimatedBeams.times", self.motion, wavelength, self.times[:, None] - self.times)
        apart = (sines[:, None] - sines).round(15)
        longest = max(float(x.max(initial=0.0)), 1e-300)
        keys = np.concatenate([apart, (x / longest).round(12)[..., None]], axis=-1).reshape(-1, 3) + 0.0
        pairs, number = np.unique(keys, axis=0, return_inverse=True)
        matrices = np.empty((len(pairs), 2, 2), np.complex128)
        for n, (dx, dy, later) in enumerate(pairs):
            turned = -1j * wavenumber * (self.displacement @ np.array([dx, dy])) - 2 * later * longest * self.transfer
            matrices[n] = (self.fields * np.exp(turned)) @ self.fields.conj().T
        blocks = matrices[number.ravel()].reshape(tilts, tilts, 2, 2)
        whole = blocks.swapaxes(1, 2).reshape(2 * tilts, 2 * tilts)
        return (whole + whole.conj().T) / 2

    def analysed(self, root: np.ndarray) -> np.ndarray:
        """Root complex128[T, R] of the beams behind the analyser over its intensity, from that of :meth:`matrix`."""
        rows, rank = root.shape
        passed = np.einsum("a,tar->tr", self.analyser.conj(), root.reshape(rows // 2, 2, rank))
        lit = float(self.weights.sum())
        return passed * np.sqrt(self._total / lit) if lit > FAINTEST * self._total else 0 * passed

    @property
    def _total(self) -> float:
        """Intensity of both components, times the paths."""
        return float(np.square(np.abs(self.fields)).sum())


def estimate_polarised_fields(
    medium: PlaneMedium, polarisers: Polarisers, light: np.ndarray, view: np.ndarray, paths: int, seed: Seed, *,
    transfer: bool = False, threads: int | None = None,
) -> PolarisedFields:  # fmt: skip
    """Fields of ``paths`` paths about a light and a view float64[3] (unit vectors of travel)."""
    layout = plane_layout(medium, 1.0, light[None], view[None])
    tracer = SlabTracer(layout, medium, replace(plane_proposal(medium, light, view), transfer=transfer))
    tracer = slab_roulette(tracer, light, pilot_seed(medium.unitless_fingerprint()))
    bank = tracer.trace(seed, paths, threads=threads)
    entering, passed = polarisers.fields
    matrices = connection_matrices(require_ends(medium), bank, light, view)
    fields = np.sqrt(contributions(layout, bank)) * (matrices @ entering).T
    turned = momentum_transfer(layout, bank) if transfer else None
    return PolarisedFields(face_to_face(bank, medium, light, view), fields, passed, paths, turned)


@dataclass(frozen=True)
class PolarisedCorrelation:
    """K(q, phi) of light along the axis behind an analyser, as a distribution of lateral distances and directions.

    Attributes
    ----------
    radius : float64[n]
        Root mean square distance of each bin; 0 for single scattering.
    weights : float64[batches, n]
        h0 that each batch found in each bin.
    second, fourth : complex128[n]
        h2 and h4 of each bin, turned back by the direction of each path.
    paths : int
        What to divide the sum of the weights by for the intensity per unit area.
    """

    isotropic: ClassVar[bool] = False
    """Whether K depends on |q| alone."""
    radius: np.ndarray
    weights: np.ndarray
    second: np.ndarray
    fourth: np.ndarray
    paths: int

    def planar(self, qx: np.ndarray, qy: np.ndarray) -> np.ndarray:
        """K at lateral wavevector differences float64 of any one shape; K(0) = 1."""
        length, turn = np.hypot(qx, qy).ravel(), np.arctan2(qy, qx).ravel()
        unique, which = np.unique(length.round(12 - _digits(length)), return_inverse=True)
        share = self.weights.sum(axis=0)
        used = share > 0
        radii = np.zeros((3, len(unique)), np.complex128)
        step = max(1, _AT_ONCE // max(int(used.sum()), 1))
        for start in range(0, len(unique), step):
            part = slice(start, start + step)
            waves = bessel_even(unique[part, None] * self.radius[used])
            for n, harmonic in enumerate((share, -2 * self.second, 2 * self.fourth)):
                radii[n, part] = waves[n] @ harmonic[used]
        even, two, four = radii[:, which]
        total = even.real + (two * np.exp(2j * turn)).real + (four * np.exp(4j * turn)).real
        return (total / share.sum()).reshape(np.shape(qx))


def _digits(values: np.ndarray) -> int:
    """Decimal digits before the point of the largest value; of none 0."""
    largest = float(values.max(initial=0.0))
    return int(np.ceil(np.log10(largest))) if largest > 0 else 0


def estimate_polarised_correlation(
    medium: PlaneMedium, polarisers: Polarisers, paths: int, seed: Seed, *, threads: int | None = None
) -> PolarisedCorrelation:
    """Estimate K of a slab along the axis behind an analyser, from ``paths`` paths in at most 64 batches."""
    tracer = axial_tracer(medium)
    bank = tracer.trace(seed, paths, threads=threads)
    weight, way = contributions(tracer.layout, bank), bank.exit[:, :2] - bank.entry[:, :2]
    matrices = connection_matrices(require_ends(medium), bank, AXIS, AXIS)
    radius, turn = np.hypot(*way.T), np.arctan2(way[:, 1], way[:, 0])
    zero, two, four = _harmonics(matrices, turn, *polarisers.fields)
    place, bins = radius_bins(medium, radius), RADIUS_BINS
    batches = max(min(BATCHES, paths), 1)
    batch = bank.paths * batches // max(paths, 1)
    rows = np.bincount(batch * bins + place, weight * zero, batches * bins).reshape(batches, bins)
    share = rows.sum(axis=0)
    squares = np.bincount(place, weight * zero * radius**2, bins)

    def gathered(values: np.ndarray) -> np.ndarray:
        return np.bincount(place, weight * values.real, bins) + 1j * np.bincount(place, weight * values.imag, bins)

    return PolarisedCorrelation(np.sqrt(np.divide(squares, share, out=np.zeros(bins), where=share > 0)), rows,
                                gathered(two), gathered(four), paths)  # fmt: skip


def _harmonics(
    matrices: np.ndarray, turn: np.ndarray, light: np.ndarray, analyser: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """h0 float64[M], h2 and h4 complex128[M] of paths and of their mirror images, turned back by ``turn``."""
    seen = np.einsum("a,nab,b->n", analyser.conj(), _PAULI, light)
    (xx, xy), (yx, yy) = np.moveaxis(matrices, 0, -1)
    harmonics = [np.zeros(len(xx)), np.zeros(len(xx), np.complex128), np.zeros(len(xx), np.complex128)]
    for mirror in (1, -1):
        even, odd, c, d = (xx + yy) / 2, mirror * (yx - xy) / 2, (xx - yy) / 2, mirror * (xy + yx) / 2
        still = even * seen[0] + odd * seen[1]
        plus, minus = (c + 1j * d) / 2 * (seen[2] - 1j * seen[3]), (c - 1j * d) / 2 * (seen[2] + 1j * seen[3])
        back = np.exp(-2j * mirror * turn)
        harmonics[0] += sum(np.square(np.abs(each)) for each in (still, plus, minus)) / 2
        harmonics[1] += (plus * still.conj() + still * minus.conj()) * back / 2
        harmonics[2] += plus * minus.conj() * back**2 / 2
    return harmonics[0], harmonics[1], harmonics[2]
