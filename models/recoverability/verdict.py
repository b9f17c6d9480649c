"""When phase retrieval works: a judgement on a scene before a single image is rendered, with the reasons if it fails.

The probability that an image comes back with a Pearson correlation above 0.8 is a logistic function of two logarithms,

    logit p = a + b ln sqrt(noise^2 + (w distortion)^2) + c ln complexity + d ln area + s x

noise and distortion being the errors of the autocorrelation that follow from the scene
(:mod:`~specklegen.models.recoverability.autocorrelation_error`), the complexity the object's bright grains, and the
area its grains above half of the peak. x, a standard Gaussian number that belongs to the scene, stands for all that
decides and is not among these: the probability is the mean over x, and the interval that is stated is from its 5th to
its 95th percentile. Noise starts from W / (2N), W the autocorrelation's window, N the camera's side;
distortion weighs more, since it is the same at neighbouring frequencies and no constraint averages it out. The
coefficients and s are fitted by scripts/build/fit_recoverability.py to half the cells of two tables of simulated
scenes, tests/data/recoverability.csv and recoverability_large.csv; a test derives them again.
docs/notes/recoverability.md has the judgement on the other half.

A scene that fails is repaired in thought, each time by what helps most, until it works: those repairs are the reasons.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np

from specklegen.core.arguments import flag, real_number, whole_number
from specklegen.core.errors import reject
from specklegen.datasets import load_recipe
from specklegen.datasets.recipes.hidden_object import HiddenObject
from specklegen.datasets.recipes.multi_image import DynamicSlab
from specklegen.datasets.split import Split
from specklegen.models.recoverability.autocorrelation_error import Conditions, Residual, residual, speckle_contrast

COEFFICIENTS = {
    "constant": -1.6837, "residual": -4.4565, "complexity": -3.8219, "bright_area": 2.9638, "distortion_weight": 1.9311,
    "scatter": 1.111,
}  # fmt: skip
"""a, b, c, d, w and s, from the even cells of the tables."""
FITTED = {"residual": (0.0324, 42.814), "complexity": (2.5266, 46.65), "bright_area": (1.5766, 72.1168)}
"""Smallest and largest of the even cells: beyond, a verdict extrapolates."""
STATES = 4, 16
"""Numbers of states of the medium that a judgement of a recipe also speaks of (docs/howmany.md)."""
_NINETIETH = 1.6449  # half of the interval that holds 90 % of a Gaussian number, over its spread
_ROOTS, _WEIGHTS = np.polynomial.hermite_e.hermegauss(31)
_NODES = _ROOTS, _WEIGHTS / _WEIGHTS.sum()
_EXAMPLES = 12  # objects that stand for their family
_MOST_MEDIA = 10_000  # each is made ready in turn
_LARGEST_CAMERA = 16.0  # times the camera's side: larger ones are no remedy


class Reason(NamedTuple):
    """Obstacle.

    Attributes
    ----------
    name : str
        Of the failure mode.
    numbers : str
        What the scene has.
    remedy : str
        What would help.
    """

    name: str
    numbers: str
    remedy: str


@dataclass(frozen=True)
class Verdict:
    """Feasibility of phase retrieval.

    Attributes
    ----------
    probability : float
        That an image comes back with a Pearson correlation above 0.8.
    interval : tuple of float
        Where the share of images that come back lies for nine scenes of ten of the same numbers.
    reasons : tuple of Reason
        Why it fails, the weightiest first; empty where it works.
    numbers : Mapping of str to float
        What the judgement follows from.
    by_states : Mapping of int to float
        Probability if every object is seen through that many times as many independent states of the medium.

    Examples
    --------
    >>> from specklegen.models import recoverable
    >>> verdict = recoverable("through-slab", media=1)
    >>> verdict.works
    False
    >>> {count: round(value, 1) for count, value in verdict.by_states.items()}
    {4: 0.9, 16: 1.0}
    """

    probability: float
    interval: tuple[float, float]
    reasons: tuple[Reason, ...]
    numbers: Mapping[str, float]
    by_states: Mapping[int, float] = field(default_factory=lambda: MappingProxyType({}))

    @property
    def works(self) -> bool:
        """True if success is likelier than failure."""
        return self.probability >= 0.5

    @property
    def extrapolates(self) -> tuple[str, ...]:
        """Numbers outside what the judgement was fitted on."""
        return tuple(name for name, (low, high) in FITTED.items() if not low <= self.numbers[name] <= high)

    def explain(self) -> str:
        """Judgement, numbers, reasons and remedies, as text."""
        low, high = self.interval
        outcome = "works" if self.works else "fails"
        lines = [f"{outcome}: success probability {self.probability:.2f} ({low:.2f} to {high:.2f})"]
        lines += [f"  {name.replace('_', ' '):22s} {value:.4g}" for name, value in self.numbers.items()]
        for name in self.extrapolates:
            low, high = FITTED[name]
            lines.append(f"  caution: {name} is outside {low:.3g} to {high:.3g}, the fitted range")
        for reason in self.reasons:
            lines.append(f"{reason.name}: {reason.numbers}\n  remedy: {reason.remedy}")
        if self.by_states:
            gained = ", ".join(f"{count} states {value:.2f}" for count, value in self.by_states.items())
            lines.append(f"success probability with frames through more states of the medium: {gained}")
        return "\n".join(lines)


def total(noise: np.ndarray | float, distortion: np.ndarray | float, weight: float) -> np.ndarray:
    """Noise and distortion together; of a table, arrays."""
    return np.maximum(np.hypot(noise, weight * np.asarray(distortion)), 1e-9)


def odds(of: Any, coefficients: np.ndarray) -> np.ndarray:
    """Logarithm of the odds of success of a scene like most, x = 0; of a Residual, or of a table's columns so named."""
    constant, slope, per_grain, per_area, weight, _ = coefficients
    errors = slope * np.log(total(of.noise, of.distortion, weight))
    return constant + errors + per_grain * np.log(of.complexity) + per_area * np.log(of.bright_area)


def share(logits: np.ndarray, scatter: float) -> np.ndarray:
    """Probability of success, the mean over the scenes' scatter, by Gauss-Hermite quadrature; of the logits' shape."""
    nodes, weights = _NODES
    return (weights / (1 + np.exp(-(np.asarray(logits)[..., None] + scatter * nodes)))).sum(-1)


def chances(logit: float) -> tuple[float, float, float]:
    """Probability of success at a logarithm of the odds, and the ends of the interval of :class:`Verdict`."""
    scatter = COEFFICIENTS["scatter"]
    low, high = (float(1 / (1 + np.exp(-logit - side * _NINETIETH * scatter))) for side in (-1, 1))
    return float(share(np.array(logit), scatter)), low, high


def logit(found: Residual) -> float:
    """Logarithm of the odds of success of a scene like most."""
    return float(odds(found, np.array(list(COEFFICIENTS.values()))))


def judge(conditions: Conditions, states: tuple[int, ...] = ()) -> Verdict:
    """Predict success from the conditions alone, and with so many times as many states of the medium."""
    errors = residual(conditions)
    value = logit(errors)
    numbers = {
        "residual": float(total(errors.noise, errors.distortion, COEFFICIENTS["distortion_weight"])),
        "noise": errors.noise,
        "distortion": errors.distortion,
        "complexity": errors.complexity,
        "bright_area": errors.bright_area,
        "window_over_2_cameras": errors.window_over_camera,
        "camera_grains": conditions.camera,
        "object_grains": conditions.side,
        "C_I_across_object": _across(conditions),
        "contrast": conditions.contrast,
        "electrons_a_grain": conditions.electrons,
        "saturation_over_mean": conditions.saturation,
    }
    reasons = () if value >= 0 else _reasons(conditions, errors)
    probability, low, high = chances(value)
    more = {n: conditions.replace(frames=n * conditions.frames) for n in states}
    gained = {n: chances(logit(residual(seen)))[0] for n, seen in more.items()}
    return Verdict(probability, (low, high), reasons, MappingProxyType(numbers), MappingProxyType(gained))


def recoverable(
    recipe: HiddenObject | str | Path, *, compensation: bool = True, beam: float = float("inf"), removal: float = 0.0,
    media: int = 4, seed: int = 0,
) -> Verdict:  # fmt: skip
    """Predict whether phase retrieval recovers the objects of a recipe.

    Parameters
    ----------
    recipe
        A recipe with hidden objects, the name of a packaged one, or a TOML file.
    compensation
        Divide the autocorrelation by the material's C_I.
    beam
        Sigma of a Gaussian envelope of the light on the camera, in camera sides; recipes have none.
    removal
        Sigma of the mean that the envelope is divided out with, in camera sides; 0 leaves it in.
    media
        Media drawn from the recipe; the judgement is on their mean.
    seed
        Of those media and of the example objects.

    Raises
    ------
    RuleError
        If the recipe has no hidden objects, or there are no media.

    Examples
    --------
    >>> from specklegen.models import recoverable
    >>> verdict = recoverable("through-slab", media=1)
    >>> print(verdict.explain().splitlines()[0])
    fails: success probability 0.36 (0.07 to 0.76)
    """
    loaded = load_recipe(recipe) if isinstance(recipe, str | Path) else recipe
    if not isinstance(loaded, HiddenObject):
        reject("recoverable recipe", "a recipe with hidden objects", getattr(loaded, "name", loaded))
    media = whole_number("recoverable media", media, 1, _MOST_MEDIA)
    whole_number("recoverable seed", seed)
    flag("recoverable compensation", compensation)
    if not real_number("recoverable beam", beam) > 0:
        reject("recoverable beam", "greater than 0", beam)
    if not 0 <= real_number("recoverable removal", removal) < float("inf"):
        reject("recoverable removal", "finite and at least 0", removal)
    loaded.warn_of_implausible()
    count = 1 if loaded.media_alike else media
    each = [
        judge(conditions_of(loaded, seed=seed, medium=n, compensation=compensation, beam=beam, removal=removal), STATES)
        for n in range(count)
    ]
    return _together(each)


def conditions_of(
    recipe: HiddenObject, *, compensation: bool = True, beam: float = float("inf"), removal: float = 0.0, seed: int = 0,
    split: Split = "train", medium: int = 0,
) -> Conditions:  # fmt: skip
    """Conditions of a recipe's images through one of its media.

    Raise a `RuleError` for recipes of polarised light, whose memory effect is not round, or with a setup.
    """
    if recipe.light.polarisation != "scalar":
        reject("recoverable recipe", "a recipe of scalar light", recipe.name,
               "Feasibility is computed for memory effects that are the same in all directions.")  # fmt: skip
    if recipe.bench is not None:
        reject("recoverable recipe", "without the table `bench`", recipe.name,
               "Feasibility is computed for one camera, aperture and focus: leave out `bench`.")  # fmt: skip
    ready = recipe.prepare(seed, split, medium)
    drawn = ready.parameters
    objects = np.stack([recipe.objects.image(seed, split, n) for n in range(_EXAMPLES)])
    pitch, pixel, grain = drawn["object_pitch"], drawn["camera_pitch"], recipe.wavelength / drawn["width"]
    correlation = recipe.material_of(seed, split, medium).correlation
    steps = np.arange(1 + int(np.ceil(np.hypot(*recipe.objects.shape))))
    c_i = np.square(correlation(2 * np.pi / recipe.wavelength * pitch * steps)).clip(0, 1)
    # Behind thin screens the light stays about its beam: a lobe of so many camera sides.
    beam = min(beam, drawn.get("rms_angle", np.inf) / (pixel * float(np.prod(recipe.camera_shape)) ** 0.5))
    electrons, saturation = _exposure(recipe, (grain / pixel) ** 2)
    frames = 1.0
    if isinstance(recipe, DynamicSlab):
        # The spread of an autocorrelation decays with the square of the intensity's correlation.
        count, between = recipe.dynamics.frames, recipe.frames_correlation(ready)[1:]
        kept = (1 - np.arange(1, count) / count) * between**4
        frames = count / (1 + 2 * float(kept.sum()))
    conditions = Conditions(objects=objects, object_pitch=pitch / grain, memory_effect=np.concatenate([[1.0], c_i[1:]]),
                            camera=pixel / grain * float(np.prod(recipe.camera_shape)) ** 0.5, frames=frames,
                            electrons=electrons, saturation=saturation, beam=beam, removal=removal,
                            compensation=compensation, profile=recipe.profile)  # fmt: skip
    ratio = np.array([ready.expected_contrast(each) for each in objects]) / speckle_contrast(conditions)
    return conditions.replace(contrast=min(1.0, float(ratio.mean())))


def _exposure(recipe: HiddenObject, pixels: float) -> tuple[float, float]:
    """Electrons a grain of equal noise, and the saturation over the mean; a grain has so many ``pixels``."""
    camera = recipe.exposure
    if camera is None:
        return float("inf"), float("inf")
    dark = camera.background + camera.dark_current * camera.exposure
    rounding = 0.0 if camera.bit_depth is None else camera.gain**2 / 12
    noise = camera.photons + dark + camera.electronics[3] ** 2 + rounding
    return pixels * camera.photons**2 / noise, max(camera.saturation - dark, 1e-6) / camera.photons


def _across(conditions: Conditions) -> float:
    """C_I between the ends of the longer side."""
    table = conditions.memory_effect
    return float(table[min(max(conditions.objects.shape[1:]) - 1, len(table) - 1)])


class Mode(NamedTuple):
    """A way to fail.

    Attributes
    ----------
    repair : function of Conditions to Conditions
        The scene without it; the same scene where there is nothing to repair.
    numbers : function of Conditions to str
        What the scene has.
    remedy : function of Conditions to str
        What would help the scene, as repaired so far.
    """

    repair: Callable[[Conditions], Conditions]
    numbers: Callable[[Conditions], str]
    remedy: Callable[[Conditions], str]


def _even(conditions: Conditions) -> Conditions:
    """Without an envelope, and so without its removal."""
    return conditions.replace(beam=float("inf"), removal=0.0)


def _camera_needed(conditions: Conditions) -> str:
    """Smallest camera with which the scene would work."""
    for factor in np.geomspace(1.1, _LARGEST_CAMERA, 29):
        if logit(residual(conditions.replace(camera=conditions.camera * factor))) >= 0:
            return (
                f"a camera of {conditions.camera * factor:.0f} grains a side, or {np.ceil(factor**2):.0f} frames "
                "through other states of the medium"
            )
    return "a larger camera and many frames, with the other remedies"


COMPLEX = "too complex an object"
"""The last failure mode: named where nothing else in the scene can be repaired."""
MODES: dict[str, Mode] = {
    "beyond the memory-effect range": Mode(
        lambda c: c.replace(memory_effect=[1.0]),
        lambda c: f"C_I falls to {_across(c):.2g} across the object",
        lambda c: (
            "a smaller or more distant object" + ("" if c.compensation else "; divide the autocorrelation by C_I")
        ),
    ),
    "no envelope removal": Mode(
        lambda c: c if c.removal else _even(c),
        lambda c: f"the envelope of a beam of sigma {c.beam:.2g} camera sides is in the image",
        lambda _: "divide by a local mean over many speckle grains (removal)",
    ),
    "envelope removed over too short a distance": Mode(
        lambda c: _even(c) if c.removal else c,
        lambda c: f"a local mean over {c.removal * c.camera:.2g} grains removes the object too, which is "
                  f"{c.side:.2g} wide",
        lambda _: "a wider local mean, a larger camera, or a wider beam",
    ),
    "saturation": Mode(
        lambda c: c.replace(saturation=float("inf")),
        lambda c: f"pixels saturate at {c.saturation:.2g} times the mean",
        lambda _: "a shorter exposure",
    ),
    "too few photons": Mode(
        lambda c: c.replace(electrons=100 * c.electrons),
        lambda c: f"{c.electrons:.3g} electrons for each speckle grain, with noise and background",
        lambda _: "a longer exposure, less background, or frames of other states of the medium",
    ),
    "too low contrast": Mode(
        lambda c: c.replace(contrast=1.0),
        lambda c: f"{c.contrast:.2g} of full contrast",
        lambda _: "a narrower filter, or a polariser",
    ),
    "too few grains": Mode(
        lambda c: c.replace(camera=4 * c.camera),
        lambda c: f"{c.camera:.3g} on each side of the camera, for an object {c.side:.3g} wide",
        _camera_needed,
    ),
    COMPLEX: Mode(
        lambda c: c,
        lambda c: f"{residual(c).complexity:.3g} bright grains",
        lambda _: "fewer or smaller bright parts",
    ),
}
"""Name of a failure mode to its repair and its words."""


def _reasons(conditions: Conditions, found: Residual) -> tuple[Reason, ...]:
    """Greedy repairs: always the one that helps most, until the scene works."""
    reasons, now, left = [], conditions, dict(MODES)
    value = logit(found)

    def said(name: str) -> Reason:
        return Reason(name, MODES[name].numbers(conditions), MODES[name].remedy(now))

    while value < 0:
        tried = {name: mode.repair(now) for name, mode in left.items()}
        gains = {name: logit(residual(better)) for name, better in tried.items() if better != now}
        best = max(gains, key=lambda name: gains[name], default=COMPLEX)
        if gains.get(best, value) <= value + 1e-9:
            return (*reasons, said(COMPLEX))
        reasons.append(said(best))
        now, value = tried[best], gains[best]
        del left[best]
    return tuple(reasons)


def _together(verdicts: list[Verdict]) -> Verdict:
    """Judgement on several media: means of probability and interval, median numbers, the reasons of those that fail."""
    probability = float(np.mean([each.probability for each in verdicts]))
    numbers = {name: float(np.median([v.numbers[name] for v in verdicts])) for name in verdicts[0].numbers}
    reasons: dict[str, Reason] = {}
    if probability < 0.5:
        for each in sorted(verdicts, key=lambda v: v.probability):
            for reason in each.reasons:
                reasons.setdefault(reason.name, reason)
    low, high = np.mean([each.interval for each in verdicts], axis=0)
    gained = {n: float(np.mean([each.by_states[n] for each in verdicts])) for n in verdicts[0].by_states}
    return Verdict(
        probability, (float(low), float(high)), tuple(reasons.values()), MappingProxyType(numbers),
        MappingProxyType(gained),
    )  # fmt: skip
