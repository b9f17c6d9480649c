"""Correlation of speckle in time, for moving scatterers: the field correlation g1 of one view, and g2 - 1 = |g1|^2.

    K(q, tau) = E[u_0 u_tau*] = E[w e^(i q . R) e^(-i k tau D) e^(-2 x Y)] / E[w],    x = k^2 <Dr^2(tau)> / 6

and g1 = K(0, tau); Y the momentum that a path gives to what moves at random, k D its Doppler shift by what flows
(:mod:`specklegen.paths.momentum`). A tilt beside the lag goes into the same mean: K(q, x) is not K(q) g1(x), for paths
that wander far also scatter often. Where reversed paths interfere, both ways have the same interior and their own ends:
E[(f_0 + r_0)(f_t e^(-2 x Y_f) + r_t e^(-2 x Y_r))*].
Maret and Wolf, Z. Phys. B 65, 409 (1987); Pine, Weitz, Zhu, Herbolzheimer, J. Phys. France 51, 2101 (1990).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from typing import Annotated, Any, NamedTuple, Unpack

import numpy as np
from numpy.typing import ArrayLike

from specklegen.core.arguments import array_from_zero, positive_number, real_array
from specklegen.core.budgets import Budget, BudgetFields, budget_of, require_time
from specklegen.core.display.plot import Pictured, draw_curve
from specklegen.core.errors import reject, warn_user
from specklegen.core.labelled import ASKED, Labelled, Labels, recorded
from specklegen.core.memory import require_memory
from specklegen.core.nanoseconds import seconds as seconds_of
from specklegen.core.parallel import thread_count
from specklegen.core.quantities import with_units
from specklegen.core.random_streams import Seed, pilot_seed
from specklegen.core.shielded import shielded
from specklegen.core.units import RADIAN, TIME, WAVELENGTH
from specklegen.memory_effects.curve import Aim, Mode, aimed, analysed, require_axial, require_tilts
from specklegen.memory_effects.exposure import ExposureContrast, LightClasses, LightPaths
from specklegen.memory_effects.polarised import Channel
from specklegen.memory_effects.temporal_light import Asked, by_amplitudes, by_ways, polarised
from specklegen.memory_effects.volume_aim import volume_scene
from specklegen.paths.analog_walk import require_walkable
from specklegen.paths.deep_absorption import crossing_variances, require_reach
from specklegen.paths.endpoints import AXIS
from specklegen.paths.flows import sideways
from specklegen.paths.rare_paths import warn_of_rare_paths
from specklegen.paths.slab_tracer import events_across, events_per_path
from specklegen.paths.steps import refracting_layers
from specklegen.paths.stretching import draws_across, relative_variance
from specklegen.paths.tracer import Tracer, plane_tracer, transferring, volume_tracer
from specklegen.paths.volumes import volume_of
from specklegen.scene.media import Box, Medium, PlaneMedium, VoxelGrid, as_slab, require_medium
from specklegen.scene.motion import law_of, reduced_time


@dataclass(frozen=True, repr=False)
class TemporalCorrelation(Pictured, Labelled):
    """Correlation of a speckle with itself a while later, and a tilt apart if asked.

    Attributes
    ----------
    lags : float64[...]
        Times between, in the unit of time of the motion, of one shape with ``tilts``.
    tilts : float64[...]
        Of the later light, radians, of one shape with ``lags``.
    x : float64[...]
        k^2 <Dr^2(lag)> / 6, of the fastest particles: D k^2 lag of Brownian motion.
    field : complex128[...]
        g1 = E[u(0) u*(lag)], the field correlation; with tilts K(q, lag).
    intensity : float64[...]
        |g1|^2, free of the bias of a squared estimate. It is g2 - 1 of one polarisation, one wavelength and pixels far
        below a grain; what a camera sees is a factor below.
    standard_error : float64[...]
        Of ``intensity``, from 64 independent batches; 1.96 of it hold the truth in 95 % of cases. NaN where it is
        undefined.
    static_share : float
        Share of the intensity whose paths nothing turns: its square is the floor of ``intensity`` without a tilt.
    paths : int
        Paths traced.
    reverse : bool
        Whether reversed paths took part.
    classes : LightClasses or LightPaths
        The light without a tilt by its momentum transfer (of what flows path by path), from which :meth:`contrast`
        knows exposures.
    channel : "none", "co", "crossed", "circular" or "flipped"
        Analyser before the camera; of scalar light "none".
    azimuth : float
        Of the tilts from the polarisation of the light, radians.
    components : int
        Polarisations that are seen: 2 of polarised light without an analyser.

    Examples
    --------
    >>> import specklegen as sg
    >>> slab = sg.Slab(
    ...     thickness=100.0, mean_free_path=10.0, scatterer=sg.media.Isotropic(),
    ...     motion=sg.media.Brownian(diffusion=0.1)
    ... )
    >>> curve = sg.statistics.temporal_correlation(slab, wavelength=6.283, lags=[0.0, 0.1, 1.0], paths=5000)
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

    _named = {"lags": "lags", "k^2 <Dr^2> / 6": "x", "intensity correlation": "intensity",
              "standard error": "standard_error", "share at rest": "static_share", "paths": "paths",
              "reversed paths": "reverse"}  # fmt: skip
    _single = ("static_share", "paths", "reverse", "channel", "azimuth", "components")

    @shielded()
    @with_units
    def contrast(self, exposures: Annotated[ArrayLike, TIME]) -> ExposureContrast:
        """Squared contrast of the speckle over exposures, with errors, whatever ``lags`` and ``tilts`` were.

        ``K^2(T) = 2 int_0^1 (1 - u) |g1(uT)|^2 du``, from the paths' own momentum transfers (Bandyopadhyay et al.,
        Rev. Sci. Instrum. 76, 093110 (2005)).

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
                   "Without an analyser K^2 is the sum of both, each times its squared share "
                   "of the light.")  # fmt: skip
        result = self.classes.contrast("TemporalCorrelation.contrast", exposures)
        asked = vars(self).get(ASKED, {})
        vars(result)[ASKED] = {name: each for name, each in asked.items() if name not in ("lags", "tilts")}
        return result

    def _arrays(self) -> Mapping[str, Labels]:
        along = ("lags",) if self.lags.ndim == 1 else tuple(f"axis_{n}" for n in range(self.lags.ndim))
        return {
            "lags": Labels(along, self.lags, "time of the motion", coordinate=True),
            "tilts": Labels(along, self.tilts, "rad", coordinate=True), "x": Labels(along, self.x, coordinate=True),
            "field": Labels(along, self.field), "intensity": Labels(along, self.intensity),
            "standard_error": Labels(along, self.standard_error),
        }  # fmt: skip

    def _draw(self, axes: Any, label: str | None = None) -> None:
        """|g1|^2 over the lag, with bars of two standard errors."""
        lags, intensity, error = (a.ravel() for a in (self.lags, self.intensity, self.standard_error))
        draw_curve(axes, lags, intensity, error, label, xlabel="lag", ylabel=r"$g_2 - 1 = |g_1|^2$", ylim=(-0.03, 1.05))
        if (lags > 0).sum() > 2 and lags.max() > 30 * lags[lags > 0].min():
            axes.set_xscale("symlog", linthresh=lags[lags > 0].min())


@recorded
@with_units
@shielded()
def temporal_correlation(
    medium: Medium, *, wavelength: Annotated[float, WAVELENGTH], lags: Annotated[ArrayLike, TIME],
    budget: Budget | None = None, tilts: Annotated[ArrayLike, RADIAN] = 0.0,
    channel: Channel = "none", azimuth: Annotated[float, RADIAN] = 0.0, mode: Mode = "transmission",
    view: ArrayLike | None = None,
    **fields: Unpack[BudgetFields],
) -> TemporalCorrelation:  # fmt: skip
    """Correlation of the speckle behind (or before) a medium with itself a lag later.

    Normal incidence, an unlimited plane wave: :func:`memory_effect` in time, of boxes and voxels too, of which light
    that has been scattered is seen. Particles move independently of each other, or are carried by a flow, and stand
    still while light passes.

    Parameters
    ----------
    medium
        A slab, layers, a box or voxels with a ``motion``.
    wavelength
        Inside the medium, in its unit of length.
    lags
        float[...], at least 0, in the unit of time of the motion.
    tilts
        Of the later light, radians in the x-z plane, views moved with it; of a shape that goes with that of ``lags``
        (``tilts[:, None]`` for a table of both).
    channel
        Of a medium whose ``polarisation`` is not "scalar": what passes an analyser along the light's linear
        polarisation ("co") or across it ("crossed"), or all of it ("none", the default); of circular light what passes
        an analyser of the same circular field ("circular") or of the other ("flipped").
    azimuth
        Of the tilts from that polarisation, radians: 0 along it, pi/2 across it.
    mode
        "transmission" looks along the axis; "reflection" back through the entrance face.
    view
        float64[3], in flatland float64[2]: unit vector along which light is seen. By default the axis in transmission,
        and in reflection 5 degrees off exact backscattering, away from its enhancement.
    budget
        Paths, an error or a time, seed, threads and reversed paths (:class:`specklegen.results.Budget`). ``rel_error``
        is the largest standard error of ``intensity``. By default 100 000 paths.
    fields
        Fields of the budget by name, such as ``paths=10_000, seed=1``, in place of those of ``budget``.

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
    >>> fluid = sg.media.Brownian.of_sphere(radius=0.25, viscosity=1e-3, temperature=293.0)  # um, s
    >>> slab = sg.Slab(thickness=1000.0, mean_free_path=100.0, scatterer=sg.media.HenyeyGreenstein(0.9), motion=fluid)
    >>> curve = sg.statistics.temporal_correlation(slab, wavelength=0.4, lags=[0.0, 1e-3, 5e-3], paths=5000)
    >>> curve.intensity.round(1), curve.static_share < 0.03
    (array([1. , 0.7, 0.3]), True)
    """
    owner = "temporal_correlation"
    budget = budget_of(owner, budget, fields)
    wavelength = positive_number(f"{owner} wavelength", wavelength)
    lags, tilts = array_from_zero(f"{owner} lags", lags, finite=True), real_array(f"{owner} tilts", tilts)
    try:
        lags, tilts = np.broadcast_arrays(np.atleast_1d(lags), tilts)
    except ValueError:
        reject(f"{owner} tilts", f"one number, or an array that broadcasts with lags, {lags.shape}", tilts.shape)
    require_memory(f"{owner} lags", "held", _LAG_BYTES * lags.size, f"{lags.size} lags", "Use fewer at a time.")
    angles, number = np.unique(tilts, return_inverse=True)
    require_tilts(owner, angles.size, f"{angles.size} tilts, {lags.size} lags", _LAG_BYTES * lags.size)
    seen = analysed(owner, medium, channel, azimuth)
    require_medium(f"{owner} medium", medium, "For moving thin screens, render a film of a ScreenStack.")
    require_motion(owner, medium)
    sight: Any = _of_volume if medium.has_sides else _of_plane
    aim, tracer, events, keyed, require_enough = sight(medium, wavelength, angles, mode, view, budget, seen is not None)
    law = law_of(medium.motions)
    x = 0.0 * lags if law is None else reduced_time(f"{owner} lags", law, wavelength, lags)
    asked = Asked(medium, wavelength, aim, tracer, angles, number.ravel(), x.ravel(), lags.ravel(), budget.threads, law)
    way = by_ways if asked.keeps_directions else by_amplitudes
    if seen is not None:
        way = partial(polarised, seen=seen)

    count = budget.count(lambda n: float(np.nan_to_num(way(asked, n, keyed).error).max(initial=0.0)))
    require_enough(count)
    events = count * events
    ends = 2.0 * (1 + len(angles)) * count * (2 if aim.reversal.needed else 1)
    work = {"path": count, "event": events, "end": ends, "phasor": float(x.size * count)}
    require_time(
        f"{owner} lags", seconds_of(work, thread_count(budget.threads)),
        f"{x.size} lags of {count} paths, {events:.1e} scatterings", "Use fewer lags or fewer paths.",
    )  # fmt: skip
    result = way(asked, count, budget.seed)
    if np.isnan(result.static):
        warn_user(
            f"{owner}: none of {count} paths carried light, so the result is unknown. Trace more paths, or use a "
            "thinner medium.",
        )  # fmt: skip
    warn_of_rare_paths(owner, result.lit, result.carried)
    shape = lags.shape
    return TemporalCorrelation(
        lags=np.array(lags), tilts=np.array(tilts), x=x, field=result.field.reshape(shape),
        intensity=result.intensity.reshape(shape), standard_error=result.error.reshape(shape),
        static_share=result.static, paths=count, reverse=aim.reversal.needed, classes=result.classes,
        channel=channel, azimuth=float(azimuth), components=1 if seen is None else len(seen.components),
    )  # fmt: skip


class _Sight(NamedTuple):
    """Settings of an estimate: paths, scatterings of one, a pilot's seed, and the function that refuses too few."""

    aim: Aim
    tracer: Callable[[], Tracer]
    events: float
    pilot: Seed
    require_enough: Callable[[int], None]


def _of_plane(
    medium: PlaneMedium, wavelength: float, tilts: np.ndarray, mode: Mode, view: ArrayLike | None, budget: Budget,
    polarised: bool,
) -> _Sight:  # fmt: skip
    owner = "temporal_correlation"
    aim = aimed(owner, medium, wavelength, tilts, mode, view, budget.reverse, budget.tolerance)
    if refracting_layers(medium):
        require_axial(owner, medium, wavelength, tilts, mode, aim.view, budget.reverse)
    require_even_flow(owner, medium)
    reverse = aim.reversal.needed
    lights, views = np.concatenate([AXIS[None], aim.light]), np.concatenate([aim.view[None], aim.views])
    undrawn = polarised or not medium.faces.matched or as_slab(medium) is None
    drawn = aim.side > 0 and medium.faces.matched and not reverse and draws_across(medium)

    def require_enough(count: int) -> None:
        if mode == "transmission" and (reverse or undrawn):
            require_reach(owner, relative_variance(medium), count)
        if refracting_layers(medium):
            require_walkable(owner, medium, count)

    return _Sight(aim, partial(plane_tracer, medium, wavelength, lights, views, reverse, transfer=True),
                  events_across(medium) if drawn else events_per_path(medium),
                  pilot_seed(medium.unitless_fingerprint()), require_enough)  # fmt: skip


def _of_volume(
    medium: Box | VoxelGrid, wavelength: float, tilts: np.ndarray, mode: Mode, view: ArrayLike | None,
    budget: Budget, polarised: bool,  # noqa: ARG001 - slabs alone are
) -> _Sight:  # fmt: skip
    owner = "temporal_correlation"
    aim, scene = volume_scene(owner, medium, wavelength, tilts, mode, view, budget.reverse, budget.tolerance)
    variance = max(crossing_variances(scene), default=0.0) if mode == "transmission" else 0.0
    return _Sight(
        aim, lambda: transferring(volume_tracer(scene, aim.reversal.needed)), events_per_path(medium),
        pilot_seed(scene.unitless_fingerprint()), lambda count: require_reach(owner, variance, count),
    )  # fmt: skip


_LAG_BYTES = 8 * 2**10
"""Of sums of 64 batches, with their jackknife, for one lag: 6.4 kB as measured."""


def require_motion(owner: str, medium: Medium) -> None:
    """Refuse a medium that nobody gave a motion."""
    if all(motion is None for motion in medium.motions):
        remedy = "Give it a motion, such as Brownian(diffusion=...)."
        reject(f"{owner} medium", "a medium of moving particles", medium, remedy)


def require_even_flow(owner: str, medium: PlaneMedium) -> None:
    """Refuse a flow that changes along the faces, for light that is unlimited there."""
    if sideways(volume_of(medium, 3)):
        reject(f"{owner} medium", "of a flow that is uniform along its faces", medium.motions,
               "Render a film of a Scene, whose beams have a width.")  # fmt: skip
