"""The memory-effect curve of a slab: how speckle decorrelates under tilt, with error bars.

Along the axis, in transmission and at small tilts, from the distribution of lateral distances
(:mod:`specklegen.memory_effects.correlation`, symmetric in azimuth and so less noisy). Otherwise from the exact
amplitudes of every connection at every tilted pair (i, v), reversed paths included where they matter. Tilts that are
not small beside a narrow phase function keep their angle to it instead (:mod:`specklegen.paths.far_field`): from
lateral distances again, and from phases alone where reversed paths take part.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from typing import Annotated, Any, Literal, NamedTuple, Unpack, get_args

import numpy as np
from numpy.typing import ArrayLike

from specklegen.core.arguments import choice, instance, positive_number, real_array, real_number
from specklegen.core.budgets import Budget, BudgetFields, Reverse, budget_of, require_time
from specklegen.core.decision import Decision
from specklegen.core.display.plot import Pictured, draw_curve
from specklegen.core.errors import reject, warn_user
from specklegen.core.labelled import Labelled, Labels, recorded
from specklegen.core.memory import require_memory
from specklegen.core.nanoseconds import seconds as seconds_of
from specklegen.core.parallel import Threads, even_slices, in_turn, thread_count
from specklegen.core.quantities import with_units
from specklegen.core.random_streams import Seed, pilot_seed
from specklegen.core.shielded import shielded
from specklegen.core.statistics import BATCHES, batch_sums, jackknife
from specklegen.core.units import RADIAN, WAVELENGTH
from specklegen.memory_effects.correlation import estimate_correlation
from specklegen.memory_effects.oblique import estimate_oblique_correlation
from specklegen.memory_effects.polarised import Channel, Polariser, axial_curve, pair_curve, polariser
from specklegen.paths.analog_walk import require_walkable
from specklegen.paths.deep_absorption import require_reach
from specklegen.paths.endpoint_factors import multiple_amplitudes, single_amplitudes
from specklegen.paths.endpoints import AXIS
from specklegen.paths.far_field import SLANT, LobeLoss, lobe_loss, steepest
from specklegen.paths.rare_paths import CHANGES, changes_of, implied_by_changes, implied_by_each, warn_of_rare_paths
from specklegen.paths.reversal import reversal_decision
from specklegen.paths.slab_tracer import events_across, events_per_path
from specklegen.paths.steps import refracting_layers
from specklegen.paths.stretching import draws_across, relative_variance
from specklegen.paths.tracer import plane_tracer
from specklegen.scene.illumination import directions_of_sines
from specklegen.scene.layers import PlaneParallel
from specklegen.scene.media import Box, PlaneMedium, VoxelGrid, as_slab
from specklegen.scene.scene import Scene
from specklegen.scene.screens import GroundGlass, PhaseScreen, ScreenStack, ThinMedium, require_thin
from specklegen.scene.validity import warn_of_dependence
from specklegen.theory.phase_screens import index_correlation, lobes, tilt_ways

Mode = Literal["transmission", "reflection"]
OFF_BACKSCATTER = np.deg2rad(5.0)
_SMALL = 0.02  # tilts beside 1 - |g| up to which a path's directions stay as they are
_TILTS = "radians between -pi/2 and pi/2, of shape {}"


class Aim(NamedTuple):
    """Pairs of light and view that move together.

    Attributes
    ----------
    light : float64[T, 3]
        Tilted from the axis in the x-z plane.
    view : float64[3]
        At zero tilt.
    views : float64[T, 3]
        Moved with the light.
    side : 1.0 or -1.0
        Sign of z of the views.
    reversal : Decision
        Whether reversed paths take part.
    """

    light: np.ndarray
    view: np.ndarray
    views: np.ndarray
    side: float
    reversal: Decision


def require_angles(owner: str, tilts: np.ndarray) -> None:
    """Refuse tilts that are no row of angles between -pi/2 and pi/2."""
    if tilts.ndim != 1 or not np.isfinite(tilts).all() or (tilts.size and np.abs(tilts).max() >= np.pi / 2):
        reject(f"{owner} tilts", _TILTS.format("(T,)"), tilts, "Use np.deg2rad.")


def checked_view(owner: str, view: ArrayLike, mode: Mode, dimension: int = 3) -> np.ndarray:
    """Return a view float64[d], a unit vector on the side of a mode, or refuse it."""
    direction = real_array(f"{owner} view", view)
    side = 1.0 if mode == "transmission" else -1.0
    if direction.shape != (dimension,) or not abs(np.linalg.norm(direction) - 1) <= 1e-6 or direction[-1] * side <= 0:
        reject(f"{owner} view", f"a unit vector of shape ({dimension},) on the side of {mode}", direction)
    return direction


def aimed(
    owner: str, medium: PlaneMedium, wavelength: float, tilts: np.ndarray, mode: Mode, view: ArrayLike | None,
    reverse: Reverse, tolerance: float,
) -> Aim:  # fmt: skip
    """Pairs of light and view of a slab at tilts float64[T], refused where no curve can be had of them."""
    if isinstance(medium, Box | VoxelGrid | Scene):
        reject(
            f"{owner} medium", "a Slab or Layers, which are infinite sideways", medium,
            "For other media use covariance of a Scene for the pairs (tilt, shifted view), or render its stack.",
        )  # fmt: skip
    instance(f"{owner} medium", medium, PlaneParallel)
    if medium.thickness == 0 or medium.albedo == 0:
        reject(
            f"{owner} medium", "of a thickness and an albedo above 0", (medium.thickness, medium.albedo),
            "Without scattered light there is no speckle. In the limit of weak scattering all light is scattered "
            "once, and C_I along the axis tends to 1 at tilts well within the width of the phase function.",
        )  # fmt: skip
    require_angles(owner, tilts)
    wavelength = positive_number(f"{owner} wavelength", wavelength)
    warn_of_dependence(medium.mean_free_path, wavelength)
    choice(f"{owner} mode", mode, ("transmission", "reflection"))
    side = 1.0 if mode == "transmission" else -1.0
    if view is None:
        sine = 0.0 if mode == "transmission" else np.sin(OFF_BACKSCATTER)
        view = directions_of_sines("view", [sine, 0.0], side)
    view = checked_view(owner, view, mode)
    light = directions_of_sines(f"{owner} tilts", np.stack([np.sin(tilts), 0 * tilts], -1))
    views = directions_of_sines(f"{owner} view + tilts", view[:2] + light[:, :2], side)
    medium.require_crossing(f"{owner} tilts and view", np.concatenate([light, views, view[None]]))
    return Aim(light, view, views, side, reversal_decision(medium, wavelength, light, views, reverse, tolerance))


def small_tilts(medium: PlaneMedium, wavelength: float, tilts: np.ndarray) -> bool:
    """True if tilts only shift paths sideways: small beside the phase function, or keeping their angle to it."""
    largest = steepest(medium, tilts)
    return lobe_loss(medium, wavelength, largest).spurious or largest <= _largest_small(medium)


def _largest_small(medium: PlaneMedium) -> float:
    return _SMALL * (1 - abs(medium.scatterer.mean_cosine()))


def require_axial(
    owner: str, medium: PlaneMedium, wavelength: float, tilts: np.ndarray, mode: Mode, view: np.ndarray,
    reverse: Reverse,
) -> None:  # fmt: skip
    """Refuse what motion in layers with steps of the index does not serve: all but small tilts straight on the axis."""
    what = "for layers that refract"
    if mode != "transmission":
        reject(f"{owner} mode", f'"transmission" {what}', mode, "For reflected light use equal indices.")
    if not np.array_equal(view, AXIS):
        reject(f"{owner} view", f"left out {what}: the axis", view, "Use joint_correlation for all views together.")
    if reverse is True:
        reject(f"{owner} reverse", f'False or "auto" {what}', reverse,
               "There is no backscattering direction behind layers, so reversed paths add nothing.")  # fmt: skip
    if not small_tilts(medium, wavelength, tilts):
        most = _largest_small(medium) * min((*medium.indices, medium.faces.inside)) / medium.faces.inside
        reject(f"{owner} tilts", f"at most {most:.3g} {what}, small beside the width of the phase function",
               float(np.abs(tilts).max()), "joint_correlation takes larger ones, to first order.")  # fmt: skip


@dataclass(frozen=True, repr=False)
class MemoryEffect(Pictured, Labelled):
    """A memory-effect curve.

    Attributes
    ----------
    tilts : float64[T]
        Tilts from the axis, radians.
    q : float64[T]
        k sin(tilt) L, the tilt in units of the slab (physics.md 4).
    field : complex128[T]
        K, the field correlation with zero tilt.
    intensity : float64[T]
        C_I = |K|^2, free of the bias of a squared estimate.
    decorrelation : float64[T]
        1 - C_I; to full relative precision at tiny tilts in transmission along the axis, elsewhere to rounding.
    standard_error : float64[T]
        Of ``intensity``, from 64 independent batches; 1.96 of it hold the truth in 95 % of cases, also where rare paths
        carry it or it is near 0 (:func:`specklegen.core.statistics.jackknife`). NaN where it is undefined (no light, or
        one path). Where no estimate is right (see the warnings of :func:`memory_effect`), with what it may be off by.
    single_share : float
        Share of single scattering in the intensity; its square is the floor of ``intensity``.
    paths : int
        Paths traced.
    reverse : bool
        Whether reversed paths took part.
    near_field : bool
        Whether tilts keep their angle to the scatterers' phase function, since mean free paths are shorter than the far
        field that tells them apart (docs/physics.md 10).
    channel : "none", "co", "crossed", "circular" or "flipped"
        Analyser before the camera; of scalar light "none".
    azimuth : float
        Of the tilts from the polarisation of the light, radians.

    Examples
    --------
    >>> import specklegen as sg
    >>> slab = sg.Slab(thickness=100.0, mean_free_path=20.0, scatterer=sg.media.HenyeyGreenstein(0.9))
    >>> curve = sg.memory_effect(slab, wavelength=0.5, tilts=[0.0, 2e-3], paths=2000)
    >>> curve.intensity.round(1)
    array([1. , 0.9])
    """

    tilts: np.ndarray
    q: np.ndarray
    field: np.ndarray
    intensity: np.ndarray
    decorrelation: np.ndarray
    standard_error: np.ndarray
    single_share: float
    paths: int
    reverse: bool
    near_field: bool = False
    channel: Channel = "none"
    azimuth: float = 0.0

    _named = {"tilts, rad": "tilts", "intensity correlation": "intensity", "standard error": "standard_error",
              "share of single scattering": "single_share", "paths": "paths", "reversed paths": "reverse"}  # fmt: skip
    _single = ("single_share", "paths", "reverse", "near_field", "channel", "azimuth")

    def _arrays(self) -> Mapping[str, Labels]:
        along = ("tilts",)
        return {
            "tilts": Labels(along, self.tilts, "rad", coordinate=True), "q": Labels(along, self.q, coordinate=True),
            "field": Labels(along, self.field), "intensity": Labels(along, self.intensity),
            "decorrelation": Labels(along, self.decorrelation), "standard_error": Labels(along, self.standard_error),
        }  # fmt: skip

    def _draw(self, axes: Any, label: str | None = None) -> None:
        """C_I over the tilt in units of the slab, with bars of two standard errors."""
        draw_curve(
            axes, np.abs(self.q), self.intensity, self.standard_error, label, xlabel=r"tilt  $q = k\,\sin\theta\,L$",
            ylabel=r"intensity correlation  $C_I$", ylim=(-0.03, 1.05),
        )  # fmt: skip


@recorded
@with_units
@shielded()
def memory_effect(
    medium: PlaneMedium | ThinMedium, *, wavelength: Annotated[float, WAVELENGTH],
    tilts: Annotated[ArrayLike, RADIAN], budget: Budget | None = None,
    mode: Mode = "transmission", channel: Channel = "none", azimuth: Annotated[float, RADIAN] = 0.0,
    view: ArrayLike | None = None,
    **fields: Unpack[BudgetFields],
) -> MemoryEffect:  # fmt: skip
    """Correlation of the speckle at zero tilt with that at each tilt, views moved with the tilt.

    C(theta) = <u_0(v) u*_theta(v + theta)> over its two intensities, normal incidence, an unlimited plane
    wave (in practice: a beam much wider than the slab is thick). [Bar19] section 6.

    Parameters
    ----------
    medium
        The slab or layers. Or thin screens, of which the curve is a closed form: paths, errors and reversed paths are
        none.
    wavelength
        Inside the medium, in the slab's unit of length; of layers in the index ``faces.inside``.
    tilts
        float[T], radians, in the x-z plane; as the wavelength.
    mode
        "transmission" looks along the axis; "reflection" back through the entrance face.
    channel
        Of a medium whose ``polarisation`` is not "scalar", in linearly polarised light: what passes an analyser along
        the polarisation ("co") or across it ("crossed"), or all of it ("none"). In circular light: what passes an
        analyser of the same circular field ("circular") or of the other ("flipped"), as of ``Polarisers.circular``:
        seen against z, so that in transmission "circular" has kept its helicity, and in reflection "flipped".
    azimuth
        Of the tilts from that polarisation, radians: 0 along it, pi/2 across it. The curves differ
        (docs/polarisation.md).
    budget
        Paths, an error or a time, seed, threads and reversed paths (:class:`specklegen.results.Budget`). ``rel_error``
        is the largest standard error of ``intensity``. By default 100 000 paths.
    view
        float[3], direction of the view at zero tilt. Default: the axis in transmission, and in reflection
        5 degrees off exact backscattering, away from its enhancement.
    fields
        Fields of the budget by name, such as ``paths=10_000, seed=1``, in place of those of ``budget``.

    Raises
    ------
    RuleError
        For a field out of its range, a medium that is no slab or scatters no light (no thickness, or albedo 0), fewer
        paths than it takes for any to carry light through an absorbing one, or a month of computing.

    Warns
    -----
    DoubtWarning
        Where no path carried light, and all is NaN.
        Where the mean free path is below the wavelength: independent scattering is then doubtful. Where tilts are
        neither small beside the scatterers' phase function, nor beside 0.1 radian, and segments are in the phase
        function's near field: no estimate is right there. Where standard errors rest on next to no path, or the phase
        function lets expect that few: fewer than half a path that carries the variance.

    Examples
    --------
    >>> import specklegen as sg
    >>> slab = sg.Slab(thickness=1000.0, mean_free_path=100.0, scatterer=sg.media.HenyeyGreenstein(0.9))
    >>> curve = sg.memory_effect(slab, wavelength=0.5, tilts=[0.0, 1e-4, 2e-4], paths=10_000)
    >>> curve.intensity.round(1), curve.standard_error.shape
    (array([1. , 0.8, 0.6]), (3,))
    """
    budget = budget_of("memory_effect", budget, fields)
    seen = analysed("memory_effect", medium, channel, azimuth)
    tilts = np.atleast_1d(real_array("memory_effect tilts", tilts))
    wavelength = positive_number("memory_effect wavelength", wavelength)
    require_tilts("memory_effect", tilts.size, f"{tilts.size} tilts")
    require_angles("memory_effect", tilts)
    if isinstance(medium, PhaseScreen | GroundGlass | ScreenStack):
        return _of_screens(medium, wavelength, tilts, mode, view)
    aim = aimed("memory_effect", medium, wavelength, tilts, mode, view, budget.reverse, budget.tolerance)
    light, view, views, side, reversal = aim
    largest = steepest(medium, tilts)
    lobe = lobe_loss(medium, wavelength, largest)
    near = lobe.spurious and medium.albedo > 0
    unsure = near and largest**2 > SLANT
    if unsure:
        _warn_of_neither(lobe, largest)
    small = near or largest <= _largest_small(medium)
    symmetric = mode == "transmission" and small and not reversal.needed and np.array_equal(view, AXIS)
    lateral = near and not reversal.needed and not refracting_layers(medium)
    curve = _axial if symmetric else _lateral if lateral else partial(_exact, near=near)
    if seen is not None:
        curve = partial(_polarised, seen=seen, symmetric=symmetric, near=near)

    def run(count: int, seed: Seed) -> tuple:
        return curve(medium, wavelength, light, view, views, side, count, seed, reversal.needed, budget.threads)

    keyed = pilot_seed(medium.unitless_fingerprint())
    count = budget.count(lambda n: float(np.nan_to_num(run(n, keyed)[3]).max(initial=0.0)))
    require_traced("memory_effect", medium, aim, count, budget.threads)
    field, intensity, decorrelation, error, single, lit, carried = run(count, budget.seed)
    if np.isnan(single):
        warn_user(
            f"memory_effect: none of {count} paths carried light, so the result is unknown. Trace more paths, or use "
            "a thinner medium.",
        )  # fmt: skip
    if unsure:
        error = np.hypot(error, np.minimum(np.square(tilts), 1.0))
    warn_of_rare_paths("memory_effect", lit, carried)
    return MemoryEffect(
        tilts=tilts,
        q=2 * np.pi / wavelength * np.sin(tilts) * medium.thickness,
        field=field,
        intensity=intensity,
        decorrelation=decorrelation,
        standard_error=error,
        single_share=single,
        paths=count,
        reverse=reversal.needed,
        near_field=near,
        channel=channel,
        azimuth=float(azimuth),
    )


def require_traced(owner: str, medium: PlaneMedium, aim: Aim, count: int, threads: int | None) -> None:
    """Refuse fewer paths than it takes for any to cross an absorbing medium, and a month of computing."""
    reverse, matched = aim.reversal.needed, medium.faces.matched
    if aim.side > 0 and (reverse or not matched or as_slab(medium) is None or medium.polarisation != "scalar"):
        require_reach(owner, relative_variance(medium), count)
    if refracting_layers(medium):
        require_walkable(owner, medium, count)  # paths that are aimed take no more memory
    ends = 2.0 * (1 + len(aim.light)) * count * (2 if reverse else 1)
    drawn = aim.side > 0 and matched and not reverse and draws_across(medium)
    events = count * (events_across(medium) if drawn else events_per_path(medium))
    require_time(f"{owner} tilts", seconds_of({"path": count, "event": events, "end": ends}, thread_count(threads)),
                 f"{len(aim.light)} tilts of {count} paths, {events:.1e} scatterings",
                 "Use fewer tilts or fewer paths.")  # fmt: skip


def analysed(owner: str, medium: object, channel: str, azimuth: float) -> Polariser | None:
    """Light and analyser of a medium that knows polarisation; None of one where light is a scalar."""
    choice(f"{owner} channel", channel, get_args(Channel))
    azimuth = real_number(f"{owner} azimuth", azimuth)
    if not np.isfinite(azimuth):
        reject(f"{owner} azimuth", "finite, in radians", azimuth)
    if getattr(medium, "polarisation", "scalar") != "scalar":
        return polariser(channel, azimuth)  # type: ignore[arg-type]
    remedy = 'Give the Slab or Layers polarisation = "projector" or "vector".'
    if channel != "none":
        reject(f"{owner} channel", '"none" for scalar light', channel, remedy)
    if azimuth:
        reject(f"{owner} azimuth", "0 for scalar light, for which all azimuths are equal", azimuth, remedy)
    return None


def require_tilts(owner: str, tilts: int, what: str, other: float = 0.0) -> None:
    """Refuse more tilts, with ``other`` bytes beside, than the batches of their estimates fit into memory."""
    require_memory(f"{owner} tilts", "held", _TILT_BYTES * tilts + other, what, "Use fewer at a time.")


_TILT_BYTES = 32 * 2**10
"""Of sums of 64 batches, with their jackknife, for one tilt: 31 kB as measured, whatever the number of paths."""
_SCREEN_TILT = 3e5
"""Nanoseconds of one tilt behind screens, as measured."""


def _warn_of_neither(lobe: LobeLoss, tilt: float) -> None:
    warn_user(
        f"memory_effect: tilts of {tilt:.2g} rad are too large to keep their angle to the lobe (within {SLANT:g} of "
        f"C_I below {SLANT**0.5:g} rad), and mean free paths, {lobe.far_field:.2g} times the lobe's far field, too "
        f"short to tell them apart: the curve may be off by the tilts' squares, up to {min(tilt**2, 1.0):.2g}, which "
        "its standard errors hold. Ask for smaller tilts.",
    )  # fmt: skip


def _of_screens(medium: ThinMedium, wavelength: float, tilts: np.ndarray, mode: Mode, view: ArrayLike | None):
    """Curve of thin screens at a fixed view, in closed form (:mod:`specklegen.theory.phase_screens`, Eq. 2)."""
    require_time("memory_effect tilts", 1e-9 * _SCREEN_TILT * tilts.size, f"{tilts.size} tilts", "Use fewer tilts.")
    if mode != "transmission":
        reject("memory_effect mode", '"transmission" behind thin screens', mode)
    stack, sines = require_thin(medium, wavelength), np.sin(tilts)
    terms = lobes(stack, wavelength)
    seen = np.zeros(2) if view is None else checked_view("memory_effect", view, mode)[:2]
    lateral = np.stack([sines, 0 * sines], axis=-1)
    walks = [terms.correlation(seen, tilt_ways(stack, each)) for each in lateral]
    kept = index_correlation(stack, wavelength, np.zeros(1), np.abs(sines))[0]
    field = np.array(walks, np.complex128).conj() * kept
    intensity = np.square(np.abs(field))
    weight = terms.densities(float(np.hypot(seen[0], seen[1])))
    walk, _ = terms.spreads(tilt_ways(stack, np.array([1.0, 0.0])))
    still = walk <= 1e-12 * walk.max(initial=0.0)
    return MemoryEffect(
        tilts=tilts, q=2 * np.pi / wavelength * sines * stack.thickness, field=field, intensity=intensity,
        decorrelation=1 - intensity, standard_error=0 * intensity,
        single_share=float(weight[still].sum() / weight.sum()) if weight.any() else 1.0, paths=0, reverse=False,
    )  # fmt: skip


_FAINTEST = 1e-290
"""Light below which its products have lost their digits: as good as none."""


def _axial(medium, wavelength, light, view, views, side, paths, seed, reverse, threads):
    correlation = estimate_correlation(medium, paths, seed, threads=threads)
    if not correlation.weights.sum() > _FAINTEST:
        return _dark(len(light))
    q = 2 * np.pi / wavelength * light[:, 0]
    intensity, decorrelation, error = correlation.intensity(q)
    field, implied = correlation(q), correlation.implied_error(medium, q)
    error = implied.at_least(error, 2 * np.abs(field))
    lit, carried = correlation.weights.sum(axis=1), float(implied.paths.min(initial=np.inf))
    return field.astype(np.complex128), intensity, decorrelation, error, correlation.single_share, lit, carried


def _polarised(
    medium, wavelength, light, view, views, side, paths, seed, reverse, threads, *, seen, symmetric, near
):  # fmt: skip
    if symmetric:
        curve = axial_curve(medium, wavelength, light[:, 0], seen, paths, seed, threads)
    else:
        lights, views = np.concatenate([AXIS[None], light]), np.concatenate([view[None], views])
        options = {"reverse": reverse, "near": near}
        curve = pair_curve(medium, wavelength, lights, views, seen, paths, seed, threads, **options)
    found = curve.field, curve.intensity, 1 - curve.intensity, curve.standard_error
    return *found, curve.single_share, curve.lit, curve.carried


def _lateral(medium, wavelength, light, view, views, side, paths, seed, reverse, threads):
    """K_t = E[w e^(ik t . R)] / E[w], R the lateral way from face to face about the first pair."""
    correlation = estimate_oblique_correlation(medium, AXIS, view, paths, seed, threads=threads)
    if not correlation.weights.sum() > _FAINTEST:
        return _dark(len(light))
    k, weights = 2 * np.pi / wavelength, correlation.weights
    waves = [np.exp(1j * k * (correlation.displacement @ tilt)) for tilt in light[:, :2]]
    sums = [weights * wave for wave in waves]
    batches = np.array([batch_sums(each, correlation.owners, paths) for each in (*sums, weights)]).T
    intensity, error = jackknife(batches, lambda total: np.square(np.abs(total[:-1] / total[-1])))
    whole = batches.sum(axis=0)
    field = whole[:-1] / whole[-1]
    # The deviation of each connection along K: the rest of it turns K, and leaves |K|.
    along = np.exp(-1j * np.angle(field))
    off = ((w * turn).real - abs(k) for w, turn, k in zip(waves, along, field, strict=True))
    batch = correlation.owners * len(batches) // paths
    implied = implied_by_each(medium, weights, batch, len(batches), off).seen(medium, side)
    error, carried = implied.at_least(error, 2 * np.abs(field)), float(implied.paths.min(initial=np.inf))
    return field, intensity, 1 - intensity, error, correlation.single_share, batches[:, -1].real, carried


def _exact(medium, wavelength, light, view, views, side, paths, seed, reverse, threads, near=False):
    """Amplitudes a_t of every connection at the pairs (i_t, v_t); K_t = E[W a_0 a_t*] over its intensities.

    ``near`` leaves all but the phases as they are at the first pair.
    """
    lights, views = np.concatenate([AXIS[None], light]), np.concatenate([view[None], views])
    tracer, n = plane_tracer(medium, wavelength, lights, views, reverse), len(light)
    pairs = [slice(t, t + 1) for t in range(1 + n)]
    first = tracer.layout.of_ends(pairs[0], pairs[0])

    def batch(part: slice, threads: Threads) -> tuple[np.ndarray, float, np.ndarray]:
        """Sums of products with zero tilt, powers, and that at zero tilt; the last by single scattering; changes."""
        bank = tracer.trace(seed, part.stop - part.start, first=part.start, threads=threads)
        ones, many = bank.single, bank.multiple
        alone, still = np.empty(0), np.empty(0)
        sums, changes = np.empty(2 * n + 1, np.complex128), np.zeros((n, CHANGES), np.complex128)
        for t, pair in enumerate(pairs):  # one after the other: all amplitudes at once would not fit
            layout = tracer.layout.of_ends(pair, pair)
            layout = first.tilting(layout) if near else layout
            once = single_amplitudes(layout, ones)[0]
            both = np.concatenate([once, multiple_amplitudes(layout, many, bidirectional=reverse, reverse=reverse)[0]])
            if t == 0:
                alone, still = once, both
            else:
                sums[t - 1] = (still * both.conj()).sum()
                changes[t - 1] = changes_of(np.square(np.abs(still)), still * both.conj())
            sums[n + t - 1 if t else 2 * n] = np.square(np.abs(both)).sum()
        return sums, np.square(np.abs(alone)).sum(), changes

    batches = list(in_turn(batch, even_slices(paths, BATCHES), thread_count(threads)))
    sums, changes = (np.array([each[m] for each in batches]) for m in (0, 2))
    single = sum(alone for _, alone, _ in batches)
    total = sums[:, 2 * n].real.sum()
    if not total > _FAINTEST:
        return _dark(n)

    def normalised(part: np.ndarray) -> np.ndarray:
        # By one root after the other: the product of two faint intensities underflows.
        return part[:n] / np.sqrt(part[n : 2 * n].real) / np.sqrt(part[2 * n].real)

    def correlation(part: np.ndarray) -> np.ndarray:
        return np.square(np.abs(normalised(part)))

    intensity, error = jackknife(sums, correlation)
    field, lit = normalised(sums.sum(axis=0)), sums[:, 2 * n].real
    implied = implied_by_changes(medium, lit, changes).seen(medium, side)
    error, carried = implied.at_least(error, 2 * np.abs(field)), float(implied.paths.min(initial=np.inf))
    return field, intensity, 1 - intensity, error, float(single / total), lit, carried


def _dark(n: int):
    nan = np.full(n, np.nan)
    return nan.astype(np.complex128), nan, nan, nan, float("nan"), np.zeros(BATCHES), np.inf
