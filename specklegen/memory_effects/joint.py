"""The generalised memory effect: how far speckle moves, and how much of it stays, under a tilt and a shift together.

    C(delta, x) = E[ w e^(ik v . x - ik delta . R) ] / E[w]

(a while later, where scatterers move, with e^(i k tau D - 2 x Y) in the mean, :mod:`specklegen.paths.momentum`) over
the light that leaves a medium at any view: v its lateral direction, R how far it has come sideways on the exit
face, w its weight. A tilt by delta moves the pattern there by delta times the slope of R with v, the distance of the
optimum plane; Osnabrugge, Horstmeyer, Papadopoulos, Judkewitz, Vellekoop, Optica 4, 886 (2017). Behind thin screens it
is Eq. 1 of :mod:`specklegen.theory.phase_screens`; behind a slab the paths are walked here, from the axis on and one
collision after the other, to first order in the tilt.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Annotated, Any, Unpack

import numpy as np
from numpy.typing import ArrayLike

from specklegen.core.arguments import positive_number, real_array
from specklegen.core.budgets import Budget, BudgetFields, budget_of, require_time
from specklegen.core.display.plot import Pictured, draw_curve
from specklegen.core.errors import reject
from specklegen.core.labelled import Labelled, Labels, recorded
from specklegen.core.memory import require_memory
from specklegen.core.nanoseconds import NANOSECONDS
from specklegen.core.quantities import with_units
from specklegen.core.random_streams import Seed, pilot_seed
from specklegen.core.shielded import shielded
from specklegen.core.statistics import BATCHES, jackknife
from specklegen.core.units import LENGTH, RADIAN, TIME, WAVELENGTH
from specklegen.memory_effects.temporal import require_even_flow, require_motion
from specklegen.paths.analog_walk import require_walkable, walked
from specklegen.paths.deep_absorption import require_reach
from specklegen.paths.stretching import relative_variance
from specklegen.scene.layers import PlaneParallel
from specklegen.scene.media import PlaneMedium, Slab
from specklegen.scene.motion import law_of, reduced_time
from specklegen.scene.polarisation import require_scalar
from specklegen.scene.screens import ScreenStack, ThinMedium, require_thin
from specklegen.theory.phase_screens import coherence, spread, tilt_ways


@dataclass(frozen=True, repr=False)
class JointCorrelation(Pictured, Labelled):
    """Correlation of the scattered field with itself, tilted and shifted along x.

    Attributes
    ----------
    tilts, shifts : float64[T], float64[S]
        Differences of the beams' sines; shifts on the exit plane.
    magnitude : float64[T, S]
        |C|, of the field.
    standard_error : float64[T, S]
        Of it; 0 where it is a closed form.
    plane : float
        How far before the exit plane the pattern stands still under a tilt: the best shift is the tilt times it.
    lags : float64[] or float64[L]
        Times between; ``magnitude`` and its error are [T, S, L] where there are several.

    Examples
    --------
    >>> import specklegen as sg
    >>> screen = sg.media.PhaseScreen(correlation_length=10.0, rms_phase=3.0)
    >>> found = sg.statistics.joint_correlation(screen, wavelength=0.5, tilts=[0.0, 0.01], shifts=[0.0, 5.0])
    >>> found.magnitude.shape
    (2, 2)
    """

    tilts: np.ndarray
    shifts: np.ndarray
    magnitude: np.ndarray
    standard_error: np.ndarray
    plane: float
    lags: np.ndarray = field(default_factory=lambda: np.zeros(()))

    _named = {"tilts (sine)": "tilts", "shifts": "shifts", "|C|": "magnitude", "standard error": "standard_error",
              "plane": "plane"}  # fmt: skip
    _single = ("plane",)

    def _arrays(self) -> Mapping[str, Labels]:
        axes = ("tilts", "shifts", "lags")[: self.magnitude.ndim]
        return {
            "tilts": Labels(("tilts",), self.tilts, coordinate=True),
            "shifts": Labels(("shifts",), self.shifts, "length of the scene", coordinate=True),
            "lags": Labels(axes[2:], self.lags, "time of the motion", coordinate=True),
            "magnitude": Labels(axes, self.magnitude), "standard_error": Labels(axes, self.standard_error),
        }  # fmt: skip

    def _draw(self, axes: Any, label: str | None = None) -> None:
        """|C| with the best shift of each tilt as a dashed line; a curve where there is one tilt, or one shift.

        Of several lags, at the first.
        """
        if self.lags.ndim:
            of_lag = {"magnitude": self.magnitude[..., 0], "standard_error": self.standard_error[..., 0]}
            replace(self, **of_lag, lags=self.lags[0])._draw(axes, label)
            return
        if 1 in self.magnitude.shape:
            over, name = (self.shifts, "shift") if len(self.tilts) == 1 else (self.tilts, "tilt (sine)")
            magnitude, error = self.magnitude.ravel(), self.standard_error.ravel()
            draw_curve(axes, over, magnitude, error, label, xlabel=name, ylabel="|C|", ylim=(-0.03, 1.05))
            return
        rows, columns = np.argsort(self.tilts), np.argsort(self.shifts)
        tilts, shifts = self.tilts[rows], self.shifts[columns]
        shown = axes.pcolormesh(shifts, tilts, self.magnitude[np.ix_(rows, columns)], cmap="magma", vmin=0, vmax=1)
        axes.figure.colorbar(shown, ax=axes, label="|C|")
        across = axes.get_xlim()
        axes.plot(self.plane * tilts, tilts, "--", color="white", lw=1)
        axes.set(xlabel="shift", ylabel="tilt (sine)", xlim=across)


@recorded
@with_units
@shielded()
def joint_correlation(
    medium: PlaneMedium | ThinMedium, *, wavelength: Annotated[float, WAVELENGTH],
    tilts: Annotated[ArrayLike, RADIAN], shifts: Annotated[ArrayLike, LENGTH],
    budget: Budget | None = None, lags: Annotated[ArrayLike, TIME] = 0.0, **fields: Unpack[BudgetFields],
) -> JointCorrelation:  # fmt: skip
    """Joint tilt and shift correlation of transmitted light over all views.

    Parameters
    ----------
    medium
        A slab, or thin screens.
    wavelength
        Inside the medium, in its unit of length.
    tilts, shifts
        float[T] differences of direction sines, float[S] lengths on the exit plane, both along x.
    lags
        Time between, or float[L] times, which add an axis to the result: of a slab with a ``motion``.
    budget
        Paths through a slab, an error or a time, seed and threads (:class:`specklegen.results.Budget`); at least one
        path a batch of 64, and none through screens. ``rel_error`` is the largest standard error of
        ``magnitude``. By default 100 000 paths.
    fields
        Fields of the budget by name, such as ``paths=10_000, seed=1``, in place of those of ``budget``.

    Raises
    ------
    RuleError
        For arguments out of range, fewer paths than it takes for any to carry light through an absorbing slab, or a
        slab through which no scattered light comes.

    Examples
    --------
    >>> import specklegen as sg
    >>> screen = sg.media.PhaseScreen(correlation_length=10.0, rms_phase=3.0)
    >>> found = sg.statistics.joint_correlation(screen, wavelength=0.5, tilts=[0.0, 0.01], shifts=[0.0, 5.0])
    >>> found.magnitude.round(3)
    array([[1.   , 0.136],
           [1.   , 0.136]])
    """
    tilts = np.atleast_1d(real_array("joint_correlation tilts", tilts))
    shifts = np.atleast_1d(real_array("joint_correlation shifts", shifts))
    for name, numbers in (("tilts", tilts), ("shifts", shifts)):
        if numbers.ndim > 1:
            reject(f"joint_correlation {name}", "of one dimension", numbers.shape)
    wavelength = positive_number("joint_correlation wavelength", wavelength)
    owner = "joint_correlation"
    budget = budget_of(owner, budget, fields, unused=("reverse", "tolerance"))
    lags = real_array(f"{owner} lags", lags)
    if lags.ndim > 1 or not (np.isfinite(lags).all() and (lags >= 0).all()):
        reject(f"{owner} lags", "at least 0, of shape () or (L,)", np.atleast_1d(lags))
    slab = isinstance(medium, PlaneParallel)
    require_scalar(f"{owner} medium", medium)
    if not slab:
        require_thin(medium, wavelength)  # before anything else is asked of it
    pairs = tilts.size * shifts.size * lags.size
    require_memory(
        f"{owner} tilts", "held", (_PAIR_BYTES if slab else _SCREEN_BYTES) * pairs,
        f"{tilts.size} tilts, {shifts.size} shifts, {lags.size} lags", "Use fewer at a time.",
    )  # fmt: skip
    if not slab:
        if lags.any() or lags.ndim:
            reject(f"{owner} lags", "left out behind thin screens", lags, "Render a film: ScreenStack(velocities=).")
        amount = f"{tilts.size} tilts, {shifts.size} shifts"
        require_time(f"{owner} tilts", 1e-9 * _SCREEN_PAIR * pairs, amount, "Use fewer.")
        return _of_screens(require_thin(medium, wavelength), wavelength, tilts, shifts)

    x = 0 * lags
    if lags.any():
        require_motion(owner, medium)
        require_even_flow(owner, medium)
        law = law_of(medium.motions)
        x = x if law is None else reduced_time(f"{owner} lags", law, wavelength, lags)

    def run(count: int, seed: Seed) -> JointCorrelation:
        return replace(_of_slab(medium, wavelength, tilts, shifts, x, lags, count, seed, budget.threads), lags=lags)

    keyed = pilot_seed(medium.unitless_fingerprint())
    count = budget.count(lambda n: float(np.nan_to_num(run(n, keyed).standard_error).max(initial=0.0)), BATCHES)
    require_reach(owner, relative_variance(medium), count)
    phasors = 2.0 * len(tilts) * len(shifts) * x.size * count
    require_walkable(owner, medium, count, 1e-9 * NANOSECONDS["phasor"] * phasors)
    return run(count, budget.seed)


_PAIR_BYTES, _SCREEN_BYTES = 8 * 2**10, 64
"""Of one tilt, shift and lag: sums of 64 batches with their jackknife (7 kB as measured), and a closed form (42)."""
_SCREEN_PAIR = 400
"""Nanoseconds of one tilt and shift behind screens, as measured."""


def _of_slab(
    medium: PlaneMedium, wavelength: float, tilts: np.ndarray, shifts: np.ndarray, x: np.ndarray, lags: np.ndarray,
    paths: int, seed: Seed, threads: int | None,
) -> JointCorrelation:
    walks, ways, weights, turned, doppler = walked(medium, paths, seed, threads)
    k, batch = 2 * np.pi / wavelength, np.arange(len(weights)) * BATCHES // len(weights)
    if not weights.any():
        reject("joint_correlation paths", "enough that some scattered light is transmitted", paths)
    sums = [np.bincount(batch, weights, BATCHES)]
    for tilt in tilts:
        for shift in shifts:
            # Over both axes alike: x stands for y as well, where no flow has a direction.
            axes = slice(0, 1) if doppler.any() else slice(None)
            waves = np.exp(1j * k * (ways * shift - tilt * walks)[:, axes]).mean(axis=1) * weights
            for one, lag in zip(x.ravel(), lags.ravel(), strict=True):
                kept = waves * np.exp(-2 * one * turned) if one else waves
                kept = kept * np.exp(1j * k * lag * doppler) if doppler.any() else kept
                sums += [np.bincount(batch, part, BATCHES) for part in (kept.real, kept.imag)]
    value, error = jackknife(np.array(sums).T, lambda s: np.hypot(s[1::2], s[2::2]) / s[0])
    shape = (len(tilts), len(shifts), *x.shape)
    slope = (weights @ (walks * ways)).sum() / (weights @ ways**2).sum()
    return JointCorrelation(tilts, shifts, value.reshape(shape), error.reshape(shape), float(slope))


def forward_correlation(slab: Slab, wavelength: float, tilt: ArrayLike, shift: ArrayLike) -> np.ndarray:
    """|C| of a forward slab with Gaussian phase functions: exp{-(k^2 L / 2 l*) [x^2 - L delta x + L^2 delta^2 / 3]}.

    Its best shift is ``L delta / 2``, its best tilt ``3 x / (2 L)``; for thicknesses far below the transport length l*.
    """
    tilt, shift, thickness = np.asarray(tilt), np.asarray(shift), slab.thickness
    quadratic = shift**2 - thickness * tilt * shift + (thickness * tilt) ** 2 / 3
    return np.exp(-np.square(2 * np.pi / wavelength) * thickness / (2 * slab.transport_length) * quadratic)


def _of_screens(stack: ScreenStack, wavelength: float, tilts: np.ndarray, shifts: np.ndarray) -> JointCorrelation:
    ways = tilt_ways(stack, np.stack([tilts, 0 * tilts], axis=-1))[:, None]
    apart = np.stack([shifts, 0 * shifts], axis=-1)
    unscattered = np.exp(-stack.optical_depth(wavelength))
    correlation = (coherence(stack, wavelength, apart, ways) - unscattered) / max(1 - unscattered, 1e-300)
    return JointCorrelation(tilts, shifts, correlation, 0 * correlation, spread(stack, wavelength)[2])
