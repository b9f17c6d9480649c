"""Both estimators of :mod:`specklegen.memory_effects.temporal`: ways and momentum transfers, or amplitudes.

Where lateral ways are all that a tilt turns, every connection is judged at the first pair of light and view; else
amplitudes of every pair are found, both ways of a path where they interfere. Of boxes and voxels always the latter.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from scipy.special import j0

from specklegen.core.parallel import Threads, even_slices, in_turn, thread_count
from specklegen.core.random_streams import Seed
from specklegen.core.statistics import BATCHES, jackknife
from specklegen.memory_effects.curve import Aim, small_tilts
from specklegen.memory_effects.exposure import LightClasses, LightPaths, light_classes
from specklegen.memory_effects.oblique import estimate_oblique_correlation
from specklegen.memory_effects.polarised import Polariser, axial_light, curve_of, pair_light
from specklegen.paths.endpoint_factors import multiple_amplitudes, single_amplitudes
from specklegen.paths.endpoints import AXIS
from specklegen.paths.far_field import lobe_loss, steepest
from specklegen.paths.momentum import at_rest, doppler_shift, momentum_transfer
from specklegen.paths.rare_paths import CHANGES, changes_of, implied_by_changes, implied_by_each, implied_error
from specklegen.paths.tracer import Tracer
from specklegen.scene.motion import Motion


class Found(NamedTuple):
    """Estimates at P pairs, with errors; the share at rest, light of each batch, and light by its classes."""

    field: np.ndarray
    intensity: np.ndarray
    error: np.ndarray
    static: float
    lit: np.ndarray
    classes: LightClasses | LightPaths
    carried: float = np.inf


class Asked(NamedTuple):
    """Request: P pairs (tilt ``angles[number]``, time x), and the settings of the estimate.

    Attributes
    ----------
    medium, wavelength, aim, threads, law
    tracer
        Of no tilt and all others, light and view with it.
    angles : float64[T]
    number : int64[P]
    x, lags : float64[P]
    """

    medium: Any  # between two planes, or with sides
    wavelength: float
    aim: Aim
    tracer: Callable[[], Tracer]
    angles: np.ndarray
    number: np.ndarray
    x: np.ndarray
    lags: np.ndarray
    threads: int | None
    law: Motion | None

    def classes(
        self, weights: np.ndarray, turned: np.ndarray, shifts: np.ndarray | None, batch: np.ndarray, batches: int
    ) -> LightClasses | LightPaths:
        """Light of weights float64[M] by its momentum transfer and Doppler shift float64[M], in batches int64[M]."""
        if shifts is None:
            return light_classes(weights, turned, batch, batches, self.law, self.wavelength)
        return LightPaths(weights, turned, shifts, batch, batches, self.law, self.wavelength)

    def left(self, p: int | np.integer, turned: np.ndarray, shifts: np.ndarray | None) -> np.ndarray:
        """Share that pair p leaves of the field of connections, float64[M]; in a flow complex128[M]."""
        decay = np.exp(-2 * self.x[p] * turned)
        return decay if shifts is None else decay * np.exp(2j * np.pi / self.wavelength * self.lags[p] * shifts)

    @property
    def near(self) -> bool:
        """True if tilts keep their angle to the phase function (docs/physics.md 10)."""
        if self.medium.has_sides:
            return False
        return lobe_loss(self.medium, self.wavelength, steepest(self.medium, self.angles)).spurious

    @property
    def keeps_directions(self) -> bool:
        """True if the lateral ways of paths are all that a tilt turns."""
        if self.medium.has_sides:
            return False
        small = small_tilts(self.medium, self.wavelength, self.angles)
        return not self.aim.reversal.needed and (self.near or (small and (not self.angles.any() or self.on_axis)))

    @property
    def on_axis(self) -> bool:
        """True if all looks the same from every side."""
        return self.aim.side > 0 and np.array_equal(self.aim.view, AXIS)


def by_ways(asked: Asked, paths: int, seed: Seed) -> Found:
    """K from the lateral way R and the momentum transfer of every connection at the first pair of light and view."""
    ways = estimate_oblique_correlation(
        asked.medium, AXIS, asked.aim.view, paths, seed, transfer=True, threads=asked.threads
    )
    weights, turned, shifts, total = ways.weights, ways.transfer, ways.doppler, ways.weights.sum()
    assert turned is not None, "it was asked for"
    if not total > 0:
        return dark(asked)
    batch = ways.owners * min(BATCHES, paths) // paths
    q = 2 * np.pi / asked.wavelength * np.sin(asked.angles)
    n = min(BATCHES, paths)
    # Lags without a tilt from classes of Y, and the weights alone as one more; with a tilt, or of flows, one by one.
    light = asked.classes(weights, turned, shifts, batch, n)

    def summed(values: np.ndarray) -> np.ndarray:
        real = np.bincount(batch, values.real, n)
        return real + 1j * np.bincount(batch, values.imag, n) if np.iscomplexobj(values) else real

    if isinstance(light, LightClasses):
        decays = (np.exp(-2 * x * light.transfer) for x in (*asked.x, 0.0))
        batches = np.array([np.einsum("bc,c->b", light.shares, decay) for decay in decays], np.complex128).T
    else:
        batches = np.empty((n, len(asked.x) + 1), np.complex128)
        batches[:, -1] = summed(weights)
    even = asked.on_axis and shifts is None  # a flow has a direction
    radius = np.hypot(*ways.displacement.T) if q.any() else 0.0
    for t in range(len(q)):
        if not q[t]:
            if shifts is None:
                continue
            wave = weights
        elif even:
            wave = weights * j0(q[t] * radius)
        else:
            wave = weights * np.exp(1j * q[t] * ways.displacement[:, 0])
        for p in np.flatnonzero(asked.number == t):
            batches[:, p] = summed(wave * asked.left(p, turned, shifts).conj())
    intensity, error = jackknife(batches, lambda total: np.square(np.abs(total[:-1] / total[-1])))
    whole = batches.sum(axis=0)
    field = whole[:-1] / whole[-1]

    def deviation(p: int) -> np.ndarray:
        """Deviation of each connection from |K|, along K: what is across turns K alone."""
        at = q[asked.number[p]]
        wave = 1.0 if not at else j0(at * radius) if even else np.exp(1j * at * ways.displacement[:, 0])
        left = wave * asked.left(p, turned, shifts).conj()
        return (left * np.exp(-1j * np.angle(field[p]))).real - np.abs(field[p])

    if q.any() or not isinstance(light, LightClasses):
        implied = implied_by_each(asked.medium, weights, batch, n, map(deviation, range(len(field))))
    else:
        off = np.square(np.exp(-2 * np.multiply.outer(light.transfer, asked.x)) - np.abs(field))
        squares, fourths = light.shares @ off, light.shares.sum(axis=0) @ np.square(off)
        implied = implied_error(asked.medium, float(light.shares.sum()), squares, fourths)
    implied = implied.seen(asked.medium, asked.aim.side)
    error, carried = implied.at_least(error, 2 * np.abs(field)), float(implied.paths.min(initial=np.inf))
    static = float(weights[at_rest(turned, shifts)].sum() / total)
    return Found(field, intensity, error, static, batches[:, -1].real, light, carried)


def polarised(asked: Asked, paths: int, seed: Seed, *, seen: Polariser) -> Found:
    """K of what an analyser passes: along the axis from ways turned about it, else from the fields of every pair."""
    aim, pairs = asked.aim, len(asked.x)
    if asked.keeps_directions and asked.on_axis:
        axial = axial_light(asked.medium, seen, paths, seed, transfer=True, threads=asked.threads)
        assert axial.transfer is not None, "it was asked for"
        q = np.abs(2 * np.pi / asked.wavelength * np.sin(asked.angles))[asked.number]
        still = axial.sums(0.0)
        each = list(zip(q.tolist(), asked.x.tolist(), strict=True))
        curve = curve_of(np.stack([*(axial.sums(*pair) for pair in each), *[still] * (pairs + 1)], axis=1), 0.0)
        curve = curve.at_least(axial.implied(asked.medium, each, curve.field))
        weights = axial.weights
        turned, batch, batches = axial.transfer, axial.batch, axial.batches
    else:
        lights, views = np.concatenate([AXIS[None], aim.light]), np.concatenate([aim.view[None], aim.views])
        tally = pair_light(asked.medium, asked.wavelength, lights, views, asked.number, asked.x, seen, paths, seed,
                           asked.threads, reverse=aim.reversal.needed, near=asked.near)  # fmt: skip
        curve = tally.curve(asked.medium, aim.side)
        weights, turned, batch, batches = tally.weights, tally.transfer, tally.batch, len(tally.sums)
    total = weights.sum()
    if not total > 0:
        return dark(asked)
    light = asked.classes(weights, turned, None, batch, batches)
    static = float(weights[turned == 0].sum() / total)
    return Found(curve.field, curve.intensity, curve.standard_error, static, curve.lit, light, curve.carried)


def by_amplitudes(asked: Asked, paths: int, seed: Seed) -> Found:
    """K from the amplitudes of every connection at every pair (i_t, v_t), both ways of a path where they interfere."""
    reverse, near = asked.aim.reversal.needed, asked.near
    implies = not asked.medium.has_sides
    tracer = asked.tracer()
    pairs = [slice(t, t + 1) for t in range(1 + len(asked.angles))]
    first, p, n = tracer.layout.of_ends(pairs[0], pairs[0]), len(asked.x), len(asked.angles)

    flows = asked.medium.flows

    def batch(part: slice, threads: Threads) -> tuple[np.ndarray, float, LightClasses | LightPaths, np.ndarray]:
        """Products with zero tilt, powers at every tilt and at zero; and of the latter what is at rest, and classes."""
        bank = tracer.trace(seed, part.stop - part.start, first=part.start, threads=threads)
        ones, many = bank.single, bank.multiple
        back = many.reversed() if reverse else many.select(slice(0, 0))
        sums, rest, light = np.empty(p + n + 1, np.complex128), 0.0, None
        changes = np.zeros((p, CHANGES), np.complex128)
        still: tuple[np.ndarray, ...] = ()
        for t, pair in enumerate(pairs):
            seen = tracer.layout.of_ends(pair, pair)
            banks, ends = (ones, many, back), first if near else seen
            turned = [momentum_transfer(ends, each) for each in banks]
            shifts: list[Any] = [doppler_shift(ends, each) if flows else None for each in banks]
            layout = first.tilting(seen) if near else seen
            ways = multiple_amplitudes(layout, many, bidirectional=reverse, reverse=False)[0]
            own = [single_amplitudes(layout, ones)[0], *np.split(ways, 2)] if reverse else (
                [single_amplitudes(layout, ones)[0], ways, ways[:0]])  # fmt: skip
            both = np.concatenate([own[0], own[1] + own[2] if reverse else own[1]])
            sums[p + t - 1 if t else p + n] = np.square(np.abs(both)).sum()
            if t == 0:
                still = both[: len(ones)], both[len(ones) :], both[len(ones) :] if reverse else ways[:0]
                rest = sum(
                    np.square(np.abs(each[at_rest(y, d)])).sum() for each, y, d in zip(own, turned, shifts, strict=True)
                )
                weights = np.concatenate([(a.conj() * s).real for a, s in zip(own, still, strict=True)])
                light = asked.classes(weights, np.concatenate(turned), np.concatenate(shifts) if flows else None,
                                      np.zeros(len(weights), np.int64), 1)  # fmt: skip
            for m in np.flatnonzero(asked.number == t - 1):
                kept = zip(still, own, turned, shifts, strict=True)
                later = [a * asked.left(m, y, d) for _, a, y, d in kept]
                sums[m] = sum(np.vdot(a, s) for a, s in zip(later, still, strict=True))
                if implies:
                    later = [later[0], later[1] + later[2]] if reverse else later
                    whole = np.concatenate(still[: len(later)])
                    changes[m] = changes_of(np.square(np.abs(whole)), whole * np.concatenate(later).conj())
        assert light is not None, "the first pair is that of no tilt"
        return sums, rest, light, changes

    batches = list(in_turn(batch, even_slices(paths, BATCHES), thread_count(asked.threads)))
    sums = np.array([each for each, *_ in batches])
    total = sums[:, -1].real.sum()
    if not total > 0:
        return dark(asked)

    def normalised(part: np.ndarray) -> np.ndarray:
        return part[:p] / np.sqrt(part[p : p + n].real[asked.number]) / np.sqrt(part[-1].real)

    intensity, error = jackknife(sums, lambda part: np.square(np.abs(normalised(part))))
    static = float(sum(rest for _, rest, *_ in batches) / total)
    lights = [each[2] for each in batches]
    classes = asked.classes(
        np.concatenate([each.weights for each in lights]), np.concatenate([each.transfer for each in lights]),
        np.concatenate([each.doppler for each in lights]) if flows else None,  # type: ignore[union-attr]
        np.repeat(np.arange(len(lights)), [len(each.transfer) for each in lights]), len(lights),
    )  # fmt: skip
    field, lit, carried = normalised(sums.sum(axis=0)), sums[:, -1].real, np.inf
    if implies:
        implied = implied_by_changes(asked.medium, lit, np.array([each[3] for each in batches]))
        implied = implied.seen(asked.medium, asked.aim.side)
        error, carried = implied.at_least(error, 2 * np.abs(field)), float(implied.paths.min(initial=np.inf))
    return Found(field, intensity, error, static, lit, classes, carried)


def dark(asked: Asked) -> Found:
    """Estimate for a medium of which no path carries light."""
    nan, none = np.full(len(asked.x), np.nan), np.zeros(0)
    classes = asked.classes(none, none, None, none.astype(np.int64), BATCHES)
    return Found(nan.astype(np.complex128), nan, nan, float("nan"), np.zeros(BATCHES), classes)
