"""How speckle forgets in time, where scatterers move: the field correlation g1 of one view, and g2 - 1 = |g1|^2.

    K(q, tau) = E[u_0 u_tau*] = E[w e^(i q . R) e^(-i k tau D) e^(-2 x Y)] / E[w],    x = k^2 <Dr^2(tau)> / 6

and g1 = K(0, tau); Y the momentum that a path gives to what moves at random, k D its Doppler shift by what flows
(:mod:`specklegen.paths.momentum`). A tilt beside the lag goes into the same mean: K(q, x) is not K(q) g1(x), for paths
that wander far also scatter often. Where reversed paths interfere, both ways have the same interior and their own ends:
E[(f_0 + r_0)(f_t e^(-2 x Y_f) + r_t e^(-2 x Y_r))*].
Maret and Wolf, Z. Phys. B 65, 409 (1987); Pine, Weitz, Zhu, Herbolzheimer, J. Phys. France 51, 2101 (1990).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import j0

from specklegen.core.arguments import array_from_zero, positive_number, real_array
from specklegen.core.budgets import Budget, Reverse, require_time
from specklegen.core.display.plot import Pictured
from specklegen.core.display.repr import short
from specklegen.core.errors import reject, warn_user
from specklegen.core.labelled import Labelled, Labels
from specklegen.core.memory import require_memory
from specklegen.core.nanoseconds import seconds as seconds_of
from specklegen.core.parallel import Threads, even_slices, in_turn, thread_count
from specklegen.core.random_streams import Seed, pilot_seed
from specklegen.core.shielded import shielded
from specklegen.core.statistics import BATCHES, jackknife
from specklegen.memory_effects.curve import Aim, Mode, aimed, analysed, require_tilts, small_tilts
from specklegen.memory_effects.exposure import ExposureContrast, LightClasses, LightPaths, light_classes
from specklegen.memory_effects.oblique import estimate_oblique_correlation
from specklegen.memory_effects.polarised import Channel, Polariser, axial_light, curve_of, pair_light
from specklegen.paths.analog_walk import require_walkable
from specklegen.paths.deep_absorption import require_reach
from specklegen.paths.endpoint_factors import multiple_amplitudes, single_amplitudes
from specklegen.paths.endpoints import AXIS
from specklegen.paths.far_field import lobe_loss, steepest
from specklegen.paths.flows import sideways
from specklegen.paths.momentum import at_rest, doppler_shift, momentum_transfer
from specklegen.paths.rare_paths import warn_of_rare_paths
from specklegen.paths.slab_tracer import events_across, events_per_path
from specklegen.paths.steps import refracting_layers
from specklegen.paths.stretching import draws_across, relative_variance
from specklegen.paths.tracer import plane_tracer
from specklegen.paths.volumes import volume_of
from specklegen.scene.media import PlaneMedium, as_slab
from specklegen.scene.motion import Motion, law_of, reduced_time


@dataclass(frozen=True)
class TemporalCorrelation(Pictured, Labelled):
    """Correlation of a speckle with itself a while later, and a tilt apart if asked.

    Attributes
    ----------
    lags, tilts : float64[...]
        As asked for, of one shape together.
    x : float64[...]
        k^2 <Dr^2(lag)> / 6, of the fastest particles: D k^2 lag of Brownian motion.
    field : complex128[...]
        g1 = E[u(0) u*(lag)], the field correlation; with tilts K(q, lag).
    intensity : float64[...]
        |g1|^2, free of the bias of a squared estimate. It is g2 - 1 of one polarisation, one wavelength and pixels far
        below a grain; what a camera sees is a factor below.
    standard_error : float64[...]
        Of ``intensity``, as of a :class:`MemoryEffect`.
    static_share : float
        Share of the intensity whose paths nothing turns: its square is the floor of ``intensity`` without a tilt.
    paths : int
        Paths traced.
    reverse : bool
        Whether reversed paths took part.
    classes : LightClasses or LightPaths
        The light without a tilt by its momentum transfer (of what flows path by path), from which :meth:`contrast`
        knows exposures.
    channel : "none", "co" or "crossed"
        Analyser before the camera; of scalar light "none".
    azimuth : float
        Of the tilts from the polarisation of the light, radians.
    components : int
        Polarisations that are seen: 2 of polarised light without an analyser.

    Examples
    --------
    >>> import specklegen as sg
    >>> slab = sg.Slab(
    ...     thickness=100.0, mean_free_path=10.0, scatterer=sg.Isotropic(), motion=sg.Brownian(diffusion=0.1)
    ... )
    >>> curve = sg.temporal_correlation(slab, wavelength=6.283, lags=[0.0, 0.1, 1.0], paths=5000)
    >>> curve.intensity.round(1)
    array([1. , 0.1, 0. ])
    """

    lags: np.ndarray
    tilts: np.ndarray
    x: np.ndarray
    field: np.ndarray
    intensity: np.ndarray
    standard_error: np.ndarray
    static_share: float
    paths: int
    reverse: bool
    classes: LightClasses | LightPaths
    channel: Channel = "none"
    azimuth: float = 0.0
    components: int = 1

    __repr__ = short

    @shielded()
    def contrast(self, exposures: ArrayLike) -> ExposureContrast:
        """Squared contrast of the speckle over exposures, with errors, whatever ``lags`` and ``tilts`` were.

        K^2(T) = 2 int_0^1 (1 - u) |g1(uT)|^2 du (Bandyopadhyay et al., Rev. Sci. Instrum. 76, 093110 (2005)), from the
        paths' own momentum transfers.

        Parameters
        ----------
        exposures
            float[...], at least 0, in the unit of time of the motion.

        Raises
        ------
        RuleError
            For exposures that are no such numbers, or so long that <Dr^2> is not finite; of polarised light without an
            analyser.
        """
        if self.components > 1:
            reject("TemporalCorrelation.contrast channel", '"co" or "crossed" of polarised light', self.channel,
                   "Without an analyser K^2 is that of both, each times its squared share of the light.")  # fmt: skip
        return self.classes.contrast("TemporalCorrelation.contrast", exposures)

    def _facts(self) -> Mapping[str, object]:
        errors = self.standard_error[np.isfinite(self.standard_error)]
        return {
            "lags": f"{self.lags.size}, up to {self.lags.max(initial=0.0):.4g}",
            "x": f"up to {self.x.max(initial=0.0):.4g}",
            "largest standard error": float(errors.max(initial=0.0)) if errors.size else "undefined",
            "share at rest": self.static_share,
            "paths": self.paths,
            "reversed paths": "used" if self.reverse else "left out",
        }

    def _arrays(self) -> Mapping[str, Labels]:
        along = ("lags",) if self.lags.ndim == 1 else tuple(f"axis_{n}" for n in range(self.lags.ndim))
        return {
            "lags": Labels(along, self.lags, "time of the motion", coordinate=True),
            "tilts": Labels(along, self.tilts, "rad", coordinate=True), "x": Labels(along, self.x, coordinate=True),
            "field": Labels(along, self.field), "intensity": Labels(along, self.intensity),
            "standard_error": Labels(along, self.standard_error),
        }  # fmt: skip

    def _numbers(self) -> Mapping[str, str | int | float | bool]:
        return {"static_share": self.static_share, "paths": self.paths, "reverse": self.reverse,
                "channel": self.channel, "azimuth": self.azimuth, "components": self.components}  # fmt: skip

    def _draw(self, axes: Any, label: str | None = None) -> None:
        """|g1|^2 over the lag, with bars of two standard errors."""
        lags, found, bars = (a.ravel() for a in (self.lags, self.intensity, 2 * self.standard_error))
        axes.errorbar(lags, found, bars, fmt="o-", ms=3, lw=1, label=label)
        if (lags > 0).sum() > 2 and lags.max() > 30 * lags[lags > 0].min():
            axes.set_xscale("symlog", linthresh=lags[lags > 0].min())
        axes.set(xlabel="lag", ylabel=r"$g_2 - 1 = |g_1|^2$", ylim=(-0.03, 1.05))
        axes.grid(alpha=0.3)


class _Found(NamedTuple):
    """What is found at P pairs, with its errors; the share at rest, light of each batch, and light by its classes."""

    field: np.ndarray
    intensity: np.ndarray
    error: np.ndarray
    static: float
    lit: np.ndarray
    classes: LightClasses | LightPaths


@shielded()
def temporal_correlation(
    medium: PlaneMedium,
    *,
    wavelength: float,
    lags: ArrayLike,
    tilts: ArrayLike = 0.0,
    channel: Channel = "none",
    azimuth: float = 0.0,
    mode: Mode = "transmission",
    view: ArrayLike | None = None,
    paths: int | None = None,
    rel_error: float | None = None,
    seconds: float | None = None,
    seed: Seed = 0,
    reverse: Reverse = "auto",
    tolerance: float = 0.02,
    threads: int | None = None,
) -> TemporalCorrelation:
    """Correlation of the speckle behind (or before) a slab with itself a lag later.

    Normal incidence, an unlimited plane wave: :func:`memory_effect` in time. Particles move independently of each
    other, or are carried by a flow, and stand still while light passes.

    Parameters
    ----------
    medium
        A slab or layers with a ``motion``.
    wavelength
        Inside the medium, in its unit of length.
    lags
        float[...], at least 0, in the unit of time of the motion.
    tilts
        Of the later light, radians in the x-z plane, views moved with it; of a shape that goes with that of ``lags``
        (``tilts[:, None]`` for a table of both).
    channel, azimuth
        As for :func:`memory_effect`, of a slab whose ``polarisation`` is not "scalar".
    mode, view
        As for :func:`memory_effect`: behind the slab on the axis, or 5 degrees off exact backscattering, or a unit
        vector float64[3].
    paths, seconds, seed, reverse, tolerance, threads
        See :class:`specklegen.core.budgets.Budget`.
    rel_error
        Instead of ``paths``: the largest standard error of ``intensity``.

    Raises
    ------
    RuleError
        As :func:`memory_effect`; for a medium at rest, lags below 0, and lags so long that <Dr^2> is not finite.

    Warns
    -----
    DoubtWarning
        As :func:`memory_effect`.

    Examples
    --------
    >>> import numpy as np
    >>> import specklegen as sg
    >>> fluid = sg.Brownian.of_sphere(radius=0.25, viscosity=1e-3, temperature=293.0)  # um, s
    >>> slab = sg.Slab(thickness=1000.0, mean_free_path=100.0, scatterer=sg.HenyeyGreenstein(0.9), motion=fluid)
    >>> curve = sg.temporal_correlation(slab, wavelength=0.4, lags=[0.0, 1e-3, 5e-3], paths=5000)
    >>> curve.intensity.round(1), curve.static_share < 0.03
    (array([1. , 0.6, 0.3]), True)
    """
    owner = "temporal_correlation"
    budget = Budget(owner, paths, rel_error, seconds, seed, threads, reverse, tolerance)
    wavelength = positive_number(f"{owner} wavelength", wavelength)
    lags, tilts = array_from_zero(f"{owner} lags", lags, finite=True), real_array(f"{owner} tilts", tilts)
    try:
        lags, tilts = np.broadcast_arrays(np.atleast_1d(lags), tilts)
    except ValueError:
        reject(f"{owner} tilts", f"one number, or of a shape that goes with that of lags, {lags.shape}", tilts.shape)
    require_memory(f"{owner} lags", "held", _LAG_BYTES * lags.size, f"{lags.size} lags", "Ask for fewer at a time.")
    angles, number = np.unique(tilts, return_inverse=True)
    require_tilts(owner, angles.size, f"{angles.size} tilts, {lags.size} lags", _LAG_BYTES * lags.size)
    seen = analysed(owner, medium, channel, azimuth)
    aim = aimed(owner, medium, wavelength, angles, mode, view, budget.reverse, budget.tolerance)
    require_motion(owner, medium)
    require_even_flow(owner, medium)
    law = law_of(medium.motions)
    x = 0.0 * lags if law is None else reduced_time(f"{owner} lags", law, wavelength, lags)
    asked = _Asked(medium, wavelength, aim, angles, number.ravel(), x.ravel(), lags.ravel(), threads, law)
    way = _by_ways if asked.keeps_directions else _by_amplitudes
    if seen is not None:
        way = partial(_polarised, seen=seen)

    keyed = pilot_seed(medium.unitless_fingerprint())
    count = budget.count(lambda n: float(np.nan_to_num(way(asked, n, keyed).error).max(initial=0.0)))
    undrawn = seen is not None or not medium.faces.matched or as_slab(medium) is None
    if mode == "transmission" and (aim.reversal.needed or undrawn):
        require_reach(owner, relative_variance(medium), count)
    drawn = aim.side > 0 and medium.faces.matched and not aim.reversal.needed and draws_across(medium)
    events = count * (events_across(medium) if drawn else events_per_path(medium))
    if refracting_layers(medium):
        require_walkable(owner, medium, count)
    ends = 2.0 * (1 + len(angles)) * count * (2 if aim.reversal.needed else 1)
    work = {"path": count, "event": events, "end": ends, "phasor": float(x.size * count)}
    require_time(
        f"{owner} lags", seconds_of(work, thread_count(threads)),
        f"{x.size} lags of {count} paths, {events:.1e} scatterings", "Ask for fewer lags, or for fewer paths.",
    )  # fmt: skip
    result = way(asked, count, seed)
    if np.isnan(result.static):
        warn_user(
            f"{owner}: none of {count} paths carried light, so that nothing is known. Trace more paths, or take a "
            "thinner medium.",
        )  # fmt: skip
    warn_of_rare_paths(owner, result.lit)
    shape = lags.shape
    return TemporalCorrelation(
        lags=np.array(lags), tilts=np.array(tilts), x=x, field=result.field.reshape(shape),
        intensity=result.intensity.reshape(shape), standard_error=result.error.reshape(shape),
        static_share=result.static, paths=count, reverse=aim.reversal.needed, classes=result.classes,
        channel=channel, azimuth=float(azimuth), components=1 if seen is None else len(seen.components),
    )  # fmt: skip


_LAG_BYTES = 8 * 2**10
"""Of sums of 64 batches, with their jackknife, for one lag: 6.4 kB as measured."""


def require_motion(owner: str, medium: PlaneMedium) -> None:
    """Refuse a medium that nobody gave a motion."""
    if all(motion is None for motion in medium.motions):
        remedy = "Give it a motion, such as Brownian(diffusion=...)."
        reject(f"{owner} medium", "one whose particles move", medium, remedy)


def require_even_flow(owner: str, medium: PlaneMedium) -> None:
    """Refuse a flow that changes along the faces, for light that is unlimited there."""
    if sideways(volume_of(medium, 3)):
        reject(f"{owner} medium", "of a flow that is the same all along its faces", medium.motions,
               "Render a film of a Scene, whose beams have a width.")  # fmt: skip


class _Asked(NamedTuple):
    """What is asked: P pairs (tilt ``angles[number]``, time x), and how to look.

    Attributes
    ----------
    medium, wavelength, aim, threads, law
    angles : float64[T]
    number : int64[P]
    x, lags : float64[P]
    """

    medium: PlaneMedium
    wavelength: float
    aim: Aim
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
        """Whether tilts keep their angle to the lobe (docs/physics.md 10)."""
        return lobe_loss(self.medium, self.wavelength, steepest(self.medium, self.angles)).spurious

    @property
    def keeps_directions(self) -> bool:
        """Whether the lateral ways of paths are all that a tilt turns."""
        small = small_tilts(self.medium, self.wavelength, self.angles)
        return not self.aim.reversal.needed and (self.near or (small and (not self.angles.any() or self.on_axis)))

    @property
    def on_axis(self) -> bool:
        """Whether all looks the same from every side."""
        return self.aim.side > 0 and np.array_equal(self.aim.view, AXIS)


def _by_ways(asked: _Asked, paths: int, seed: Seed) -> _Found:
    """K from the lateral way R and the momentum transfer of every connection at the first pair of light and view."""
    ways = estimate_oblique_correlation(
        asked.medium, AXIS, asked.aim.view, paths, seed, transfer=True, threads=asked.threads
    )
    weights, turned, shifts, total = ways.weights, ways.transfer, ways.doppler, ways.weights.sum()
    assert turned is not None, "it was asked for"
    if not total > 0:
        return _dark(asked)
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
    static = float(weights[at_rest(turned, shifts)].sum() / total)
    return _Found(whole[:-1] / whole[-1], intensity, error, static, batches[:, -1].real, light)


def _polarised(asked: _Asked, paths: int, seed: Seed, *, seen: Polariser) -> _Found:
    """K of what an analyser passes: along the axis from ways turned about it, else from the fields of every pair."""
    aim, pairs, slab = asked.aim, len(asked.x), as_slab(asked.medium)
    assert slab is not None, "nothing else is polarised"
    if asked.keeps_directions and asked.on_axis:
        axial = axial_light(slab, seen, paths, seed, transfer=True, threads=asked.threads)
        assert axial.transfer is not None, "it was asked for"
        q = np.abs(2 * np.pi / asked.wavelength * np.sin(asked.angles))[asked.number]
        still = axial.sums(0.0)
        later = [axial.sums(*pair) for pair in zip(q.tolist(), asked.x.tolist(), strict=True)]
        sums = np.stack([*later, *[still] * (pairs + 1)], axis=1)
        weights = np.einsum("aam->m", axial.terms[:, :, 0]).real
        turned, batch, batches = axial.transfer, axial.batch, axial.batches
    else:
        lights, views = np.concatenate([AXIS[None], aim.light]), np.concatenate([aim.view[None], aim.views])
        found = pair_light(
            slab, asked.wavelength, lights, views, asked.number, asked.x, seen, paths, seed, asked.threads,
            reverse=aim.reversal.needed, near=asked.near,
        )  # fmt: skip
        sums, weights, turned, batch, batches = found.sums, found.weights, found.transfer, found.batch, len(found.sums)
    total = weights.sum()
    if not total > 0:
        return _dark(asked)
    curve, light = curve_of(sums, 0.0), asked.classes(weights, turned, None, batch, batches)
    static = float(weights[turned == 0].sum() / total)
    return _Found(curve.field, curve.intensity, curve.standard_error, static, curve.lit, light)


def _by_amplitudes(asked: _Asked, paths: int, seed: Seed) -> _Found:
    """K from the amplitudes of every connection at every pair (i_t, v_t), both ways of a path where they interfere."""
    aim, reverse, near = asked.aim, asked.aim.reversal.needed, asked.near
    lights, views = np.concatenate([AXIS[None], aim.light]), np.concatenate([aim.view[None], aim.views])
    tracer = plane_tracer(asked.medium, asked.wavelength, lights, views, reverse, transfer=True)
    pairs = [slice(t, t + 1) for t in range(1 + len(asked.angles))]
    first, p, n = tracer.layout.of_ends(pairs[0], pairs[0]), len(asked.x), len(asked.angles)

    flows = asked.medium.flows

    def batch(part: slice, threads: Threads) -> tuple[np.ndarray, float, LightClasses | LightPaths]:
        """Products with zero tilt, powers at every tilt and at zero; and of the latter what is at rest, and classes."""
        bank = tracer.trace(seed, part.stop - part.start, first=part.start, threads=threads)
        ones, many = bank.single, bank.multiple
        back = many.reversed() if reverse else many.select(slice(0, 0))
        sums, rest, light = np.empty(p + n + 1, np.complex128), 0.0, None
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
                light = asked.classes(
                    weights, np.concatenate(turned), np.concatenate(shifts) if flows else None,
                    np.zeros(len(weights), np.int64), 1,
                )  # fmt: skip
            for m in np.flatnonzero(asked.number == t - 1):
                kept = zip(still, own, turned, shifts, strict=True)
                sums[m] = sum(np.vdot(a * asked.left(m, y, d), s) for s, a, y, d in kept)
        assert light is not None, "the first pair is that of no tilt"
        return sums, rest, light

    found = list(in_turn(batch, even_slices(paths, BATCHES), thread_count(asked.threads)))
    sums = np.array([each for each, _, _ in found])
    total = sums[:, -1].real.sum()
    if not total > 0:
        return _dark(asked)

    def normalised(part: np.ndarray) -> np.ndarray:
        return part[:p] / np.sqrt(part[p : p + n].real[asked.number]) / np.sqrt(part[-1].real)

    intensity, error = jackknife(sums, lambda part: np.square(np.abs(normalised(part))))
    static = float(sum(rest for _, rest, _ in found) / total)
    lights = [each for _, _, each in found]
    classes = asked.classes(
        np.concatenate([each.weights for each in lights]), np.concatenate([each.transfer for each in lights]),
        np.concatenate([each.doppler for each in lights]) if flows else None,  # type: ignore[union-attr]
        np.repeat(np.arange(len(lights)), [len(each.transfer) for each in lights]), len(lights),
    )  # fmt: skip
    return _Found(normalised(sums.sum(axis=0)), intensity, error, static, sums[:, -1].real, classes)


def _dark(asked: _Asked) -> _Found:
    nan, none = np.full(len(asked.x), np.nan), np.zeros(0)
    classes = asked.classes(none, none, None, none.astype(np.int64), BATCHES)
    return _Found(nan.astype(np.complex128), nan, nan, float("nan"), np.zeros(BATCHES), classes)
