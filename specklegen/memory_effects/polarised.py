"""The memory effect of polarised light: what an analyser passes, under tilts along the polarisation and across it.

Of a path of scalar contribution w, lateral way R and Jones matrix J (:mod:`specklegen.paths.jones`), light polarised
along e is seen through an analyser along a as a^T J e:

    C_ab(q) = E[ w (a J e) (b J e)* e^(-iq . R) ],    C_I = sum_ab |C_ab(q)|^2 / sum_ab |C_ab(0)|^2

where a, b run over the directions of field that reach the camera: one behind an analyser, two without. Along the axis a
path may be turned about it by any angle, and mirrored. The field components then hold harmonics 0 and 2 of that angle,
so that K is **not round**: with phi the azimuth of the tilt from the polarisation

    K(q, phi) = E[ w (c_0 J0(qr) - c_2 cos 2 phi J2(qr) + c_4 cos 4 phi J4(qr)) ] / E[w c_0].

Of circular light a turn changes no more than the phase of either circular component: their K is round.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np
from scipy.special import j0, j1, jv

from specklegen.core.parallel import Threads, even_slices, in_turn, thread_count
from specklegen.core.random_streams import Seed
from specklegen.core.statistics import BATCHES, jackknife
from specklegen.memory_effects.correlation import axial_tracer
from specklegen.paths.bank import PathBank
from specklegen.paths.endpoint_factors import contributions, multiple_amplitudes, single_amplitudes
from specklegen.paths.endpoints import AXIS
from specklegen.paths.jones import Ends, connection_matrices, require_ends
from specklegen.paths.layout import Layout
from specklegen.paths.momentum import momentum_transfer
from specklegen.paths.rare_paths import CHANGES, Implied, changes_of, implied_by_changes, implied_by_each
from specklegen.paths.tracer import plane_tracer
from specklegen.scene.media import PlaneMedium

Channel = Literal["none", "co", "crossed", "circular", "flipped"]
"""What stands before the camera: no analyser, one along the polarisation of the light, one across it; of circular light
an analyser that passes the same circular field, or the other one, as they are seen against z."""
_ROOT = np.sqrt(0.5)
_SMALL = 2.0  # argument below which recurrences of Bessel functions lose digits
FAINTEST = 1e-290
"""Light below which its products have lost their digits: as good as none."""


class Polariser(NamedTuple):
    """Light and analyser.

    Attributes
    ----------
    azimuth : float
        Of the tilts from the polarisation of the light, radians.
    components : tuple of int
        Directions of field that are seen: 0 along the polarisation, 1 across it.
    circular : bool
        Whether light is circular: 0 is its field, 1 the other circular one.
    """

    azimuth: float
    components: tuple[int, ...]
    circular: bool = False

    @property
    def vectors(self) -> np.ndarray:
        """Polarisation of the light, and that across it, complex128 or float64[2, 2], in the frame of x and y."""
        if self.circular:
            return np.array([[_ROOT, 1j * _ROOT], [_ROOT, -1j * _ROOT]])
        cosine, sine = np.cos(self.azimuth), np.sin(self.azimuth)
        return np.array([[cosine, -sine], [sine, cosine]])


def polariser(channel: Channel, azimuth: float) -> Polariser:
    """Light and analyser of a channel."""
    seen = {"none": (0, 1), "co": (0,), "crossed": (1,), "circular": (0,), "flipped": (1,)}[channel]
    return Polariser(azimuth, seen, channel in ("circular", "flipped"))


class Way(NamedTuple):
    """Connections in one direction, and their fields complex128[M, 2, 2] as matrices from that of the light."""

    bank: PathBank
    fields: np.ndarray


class PolarisedCurve(NamedTuple):
    """K of T tilts: as :class:`specklegen.memory_effects.curve.MemoryEffect` holds it, and light by batch."""

    field: np.ndarray
    intensity: np.ndarray
    standard_error: np.ndarray
    single_share: float
    lit: np.ndarray
    carried: float = np.inf

    def at_least(self, implied: Implied) -> "PolarisedCurve":
        """Return it with errors that the phase function implies, and how many paths it lets expect."""
        error = implied.at_least(self.standard_error, 2 * np.abs(self.field))
        return self._replace(standard_error=error, carried=float(implied.paths.min(initial=np.inf)))


@dataclass(frozen=True)
class AxialLight:
    """Polarised light along the axis, by its connections.

    Attributes
    ----------
    radius : float64[M]
        |R|.
    terms : complex128[n, n, 3, M]
        Of C_ab what belongs to J0, J2 and J4.
    batch : int64[M]
        Number of the batch of each connection.
    single : float
        Light that was scattered once, through the analyser.
    transfer : float64[M] or None
        Momentum transfer, where it was asked for.
    """

    radius: np.ndarray
    terms: np.ndarray
    batch: np.ndarray
    batches: int
    single: float
    transfer: np.ndarray | None = None

    @property
    def weights(self) -> np.ndarray:
        """Light of each connection through the analyser, float64[M]."""
        return np.einsum("aam->m", self.terms[:, :, 0]).real

    def implied(self, medium: PlaneMedium, pairs: Iterable[tuple[float, float]], field: np.ndarray) -> Implied:
        """Errors that the phase function implies of K complex128[T] at pairs of q and x."""
        weights = self.weights
        left = (np.einsum("aam->m", self._waves(*pair)).real for pair in pairs)
        off = (np.divide(w, weights, out=np.full(len(w), k), where=weights > 0) - k
               for w, k in zip(left, field.real, strict=True))  # fmt: skip
        return implied_by_each(medium, weights, self.batch, self.batches, off)

    def _waves(self, q: float, x: float) -> np.ndarray:
        """Parts of each connection in C_ab(q) a time x later, complex128[n, n, M]."""
        waves = np.einsum("abjm,jm->abm", self.terms, bessel_even(q * self.radius)) if q else self.terms[:, :, 0]
        if x:
            assert self.transfer is not None, "it was asked for"
            waves = waves * np.exp(-2 * x * self.transfer)
        return waves

    def sums(self, q: float, x: float = 0.0) -> np.ndarray:
        """C_ab(q) of the batches a time x later, not divided by anything, complex128[batches, n, n]."""
        waves = self._waves(q, x)
        n = len(waves)
        sums = np.empty((self.batches, n, n), np.complex128)
        for a in range(n):
            for b in range(n):
                sums[:, a, b] = np.bincount(self.batch, waves[a, b].real, self.batches)
                sums[:, a, b] += 1j * np.bincount(self.batch, waves[a, b].imag, self.batches)
        return sums


def axial_light(
    medium: PlaneMedium, seen: Polariser, paths: int, seed: Seed, *, transfer: bool = False, threads: int | None = None
) -> AxialLight:
    """Polarised light along the axis behind a slab, from ``paths`` paths in at most 64 batches."""
    tracer = axial_tracer(medium, transfer)
    bank = tracer.trace(seed, paths, threads=threads)
    weights = contributions(tracer.layout, bank)
    matrices = connection_matrices(require_ends(medium), bank, AXIS, AXIS)
    way = bank.exit[:, :2] - bank.entry[:, :2]
    terms = _terms(matrices, np.arctan2(way[:, 1], way[:, 0]), seen) * weights
    batches = max(min(BATCHES, paths), 1)
    once = bank.orders == 1
    lit = np.einsum("aam->m", terms[:, :, 0]).real
    return AxialLight(np.hypot(*way.T), terms, bank.paths * batches // max(paths, 1), batches, float(lit[once].sum()),
                      momentum_transfer(tracer.layout, bank) if transfer else None)  # fmt: skip


def _terms(matrices: np.ndarray, azimuth: np.ndarray, seen: Polariser) -> np.ndarray:
    """Return the parts of a connection for J0, J2 and J4, complex128[n, n, 3, M], averaged over turns and mirrors."""
    (xx, xy), (yx, yy) = np.moveaxis(matrices, 0, -1)
    even, odd, c, d = (xx + yy) / 2, (yx - xy) / 2, (xx - yy) / 2, (xy + yx) / 2
    if seen.circular:  # the mean over both mirror images
        kept = (even, odd) if seen.components == (0,) else (c, d)
        round_ = sum(np.square(np.abs(each)) for each in kept)
        return np.stack([round_, np.zeros_like(round_), np.zeros_like(round_)]).astype(np.complex128)[None, None]
    p, m = (c + 1j * d) / 2, (c - 1j * d) / 2
    # Coefficients of 1, e^(2ia), e^(-2ia) of both components of a path turned by a.
    fields = (even, p, m), (odd, -1j * p, 1j * m)
    turn, phi = np.exp(-2j * azimuth), seen.azimuth
    n = len(seen.components)
    terms = np.zeros((n, n, 3, len(xx)), np.complex128)
    for i, a in enumerate(seen.components):
        for j, b in enumerate(seen.components):
            (u0, up, um), (v0, vp, vm) = fields[a], fields[b]
            v0, vp, vm = v0.conj(), vp.conj(), vm.conj()
            two, minus_two = (up * v0 + u0 * vm) * turn, (um * v0 + u0 * vp) * turn.conj()
            four, minus_four = up * vm * turn**2, um * vp * turn.conj() ** 2
            if a == b:
                terms[i, j] = u0 * v0 + up * vp + um * vm, -np.cos(2 * phi) * (two + minus_two), (
                    np.cos(4 * phi) * (four + minus_four)
                )  # fmt: skip
            else:  # a mirror changes the sign of one of the two
                terms[i, j, 1:] = -1j * np.sin(2 * phi) * (two - minus_two), 1j * np.sin(4 * phi) * (four - minus_four)
    return terms


def bessel_even(x: np.ndarray) -> np.ndarray:
    """J0, J2, J4 float64[3, ...] at x >= 0."""
    small = x < _SMALL
    y = np.where(small, _SMALL, x)
    zero, one = j0(x), j1(y)
    two = 2 * one / y - j0(y)
    three = 4 * two / y - one
    bessel = np.stack([zero, two, 6 * three / y - two])
    bessel[1][small], bessel[2][small] = jv(2, x[small]), jv(4, x[small])
    return bessel


def correlated(sums: np.ndarray) -> np.ndarray:
    """C_I float64[T] of C_ab at tilts, at each of them with itself, and at none with itself: complex128[2 T + 1, n, n].

    1 where fields are the same, whatever the light of each tilt.
    """
    tilts = len(sums) // 2
    power = np.square(np.abs(sums)).sum(axis=(-2, -1))
    return power[:tilts] / np.sqrt(power[tilts : 2 * tilts]) / np.sqrt(power[2 * tilts])


def field_of(sums: np.ndarray) -> np.ndarray:
    """K complex128[T] of the same: of both components together."""
    tilts = len(sums) // 2
    traces = np.einsum("taa->t", sums)
    return traces[:tilts] / np.sqrt(traces[tilts : 2 * tilts].real) / np.sqrt(traces[2 * tilts].real)


def axial_curve(
    medium: PlaneMedium, wavelength: float, tilts: np.ndarray, seen: Polariser, paths: int, seed: Seed,
    threads: int | None,
) -> PolarisedCurve:  # fmt: skip
    """K of small tilts float64[T] (differences of sines) of light along the axis."""
    light = axial_light(medium, seen, paths, seed, threads=threads)
    still = light.sums(0.0)
    q = 2 * np.pi / wavelength * np.abs(tilts)
    sums = np.stack([*(light.sums(each) for each in q), *[still] * (len(q) + 1)], 1)
    curve = curve_of(sums, light.single)
    return curve.at_least(light.implied(medium, ((each, 0.0) for each in q), curve.field))


def curve_of(sums: np.ndarray, single: float) -> PolarisedCurve:
    """Curve of sums complex128[batches, 2 T + 1, n, n], and of the light that was scattered once."""
    lit = np.einsum("baa->b", sums[:, -1]).real
    tilts = sums.shape[1] // 2
    if not lit.sum() > FAINTEST:
        nan = np.full(tilts, np.nan)
        return PolarisedCurve(nan.astype(np.complex128), nan, nan, float("nan"), np.zeros(BATCHES))
    intensity, error = jackknife(sums, correlated)
    return PolarisedCurve(field_of(sums.sum(axis=0)), intensity, error, float(single / lit.sum()), lit)



def pair_ways(ends: Ends, layout: Layout, kept: Layout, bank: PathBank, reverse: bool) -> list[Way]:
    """Connections at the one pair of ``layout``: of single scattering, of more, and where they interfere backwards.

    ``kept`` says which light and view their matrices belong to.
    """
    light, view = -kept.lights.vectors[0], kept.views.vectors[0]
    ones, many = bank.single, bank.multiple
    once = single_amplitudes(layout, ones)[0]
    ways = multiple_amplitudes(layout, many, bidirectional=reverse, reverse=False)[0]
    back = [(many.reversed(), ways[len(many) :])] if reverse else []
    return [
        Way(some, amplitudes[:, None, None] * connection_matrices(ends, some, light, view))
        for some, amplitudes in ((ones, once), (many, ways[: len(many)]), *back)
    ]


def interfering(fields: list[np.ndarray]) -> list[np.ndarray]:
    """Fields of each way of :func:`pair_ways`, both ways of a path together."""
    once, *many = fields
    return [once, *([np.sum(many, axis=0)] * len(many))]


class PairLight(NamedTuple):
    """Sums over pairs of light and view.

    Attributes
    ----------
    sums : complex128[batches, 2 P + 1, n, n]
        For :func:`correlated`.
    single : float
        Light that was scattered once.
    weights, transfer, batch : float64[M], float64[M], int64[M]
        Light of every way at the first pair, and its momentum transfer, where times were asked for.
    changes : complex128[batches, P, CHANGES]
        Sums of :func:`specklegen.paths.rare_paths.changes_of`.
    """

    sums: np.ndarray
    single: float
    weights: np.ndarray
    transfer: np.ndarray
    batch: np.ndarray
    changes: np.ndarray

    def curve(self, medium: PlaneMedium, side: float) -> PolarisedCurve:
        """K of the pairs, with errors that the phase function implies (:meth:`Implied.seen`)."""
        curve = curve_of(self.sums, self.single)
        if np.isnan(curve.single_share):
            return curve
        return curve.at_least(implied_by_changes(medium, curve.lit, self.changes).seen(medium, side))


def pair_light(
    medium: PlaneMedium, wavelength: float, lights: np.ndarray, views: np.ndarray, number: np.ndarray,
    x: np.ndarray | None, seen: Polariser, paths: int, seed: Seed, threads: int | None, *, reverse: bool, near: bool,
) -> PairLight:  # fmt: skip
    """Sums of P pairs of the light at rest with tilt ``number`` int64[P] (of T) a time x float64[P] later.

    lights, views : float64[T + 1, 3], the first at rest; ``near`` leaves all but the phases as they are there
    """
    tracer = plane_tracer(medium, wavelength, lights, views, reverse, transfer=x is not None)
    ends, pairs = require_ends(medium), len(number)
    first = tracer.layout.of_ends(slice(0, 1), slice(0, 1))
    directions = seen.vectors
    analysers = directions[list(seen.components)].conj()

    def batch(part: slice, crew: Threads) -> tuple[np.ndarray, float, np.ndarray, np.ndarray, np.ndarray]:
        bank = tracer.trace(seed, part.stop - part.start, first=part.start, threads=crew)
        sums = np.empty((2 * pairs + 1, *[len(analysers)] * 2), np.complex128)
        changes, light = np.zeros((pairs, CHANGES), np.complex128), np.empty(0)
        still, single, weights, turned = [], 0.0, np.empty(0), np.empty(0)
        for t in range(len(lights)):
            layout = tracer.layout.of_ends(slice(t, t + 1), slice(t, t + 1))
            kept = first if near else layout
            ways = pair_ways(ends, kept.tilting(layout) if near else layout, kept, bank, reverse)
            fields = [np.einsum("ai,mij,j->am", analysers, way.fields, directions[0]) for way in ways]
            both = interfering(fields)
            power = sum(each @ each.conj().T for each in both[:2])
            moved = [np.zeros(0)] * len(ways) if x is None else [momentum_transfer(kept, way.bank) for way in ways]
            if t == 0:
                still, sums[-1] = both, power
                whole = interfering([way.fields @ directions[0] for way in ways])[:2]
                light = np.concatenate([np.square(np.abs(each)).sum(axis=-1) for each in whole])
                single = float(np.square(np.abs(fields[0])).sum())
                if x is not None:
                    weights = np.concatenate([(a.conj() * b).real.sum(0) for a, b in zip(both, fields, strict=True)])
                    turned = np.concatenate(moved)
                continue
            for p in np.flatnonzero(number == t - 1):
                sums[pairs + p] = power
                left = fields if x is None else [f * np.exp(-2 * x[p] * y) for f, y in zip(fields, moved, strict=True)]
                sums[p] = sum(a @ b.conj().T for a, b in zip(still, left, strict=True))
                products = (np.concatenate([(a * b.conj()).sum(axis=0) for a, b in zip(still, other, strict=False)])
                            for other in (still[:2], interfering(left)[:2]))  # fmt: skip
                changes[p] = changes_of(next(products).real, next(products), light)
        return sums, single, weights, turned, changes

    batches = list(in_turn(batch, even_slices(paths, BATCHES), thread_count(threads)))
    return PairLight(np.array([each[0] for each in batches]), sum(each[1] for each in batches),
                     np.concatenate([each[2] for each in batches]), np.concatenate([each[3] for each in batches]),
                     np.repeat(np.arange(len(batches)), [len(each[2]) for each in batches]),
                     np.array([each[4] for each in batches]))  # fmt: skip


def pair_curve(
    medium: PlaneMedium, wavelength: float, lights: np.ndarray, views: np.ndarray, seen: Polariser, paths: int,
    seed: Seed, threads: int | None, *, reverse: bool, near: bool,
) -> PolarisedCurve:  # fmt: skip
    """K from the fields of every connection at every pair (i_t, v_t) float64[T + 1, 3]; the first is at rest."""
    number, options = np.arange(len(lights) - 1), {"reverse": reverse, "near": near}
    light = pair_light(medium, wavelength, lights, views, number, None, seen, paths, seed, threads, **options)
    return light.curve(medium, views[0, 2])
