"""Camera frames beside simulated ones: :func:`twin` names the differences, and what could cause them.

Numbers of every image (:mod:`specklegen.models.calibration.image_statistics`) are compared group by group: the squared
distance of the two means, in units of the scatter of all images. How large it is by chance is stated by permuting which
images are the camera frames (Good, *Permutation, Parametric, and Bootstrap Tests of Hypotheses* (2005), chapter 3):
exact where the setup is given. The smallest of the groups' p-values is judged by the same permutations (Westfall and
Young, *Resampling-Based Multiple Testing* (1993), chapter 2), so that ``p_value`` is uniform on ``[0, 1]`` if nothing
differs.

Where the setup was fitted to the camera frames, they lie nearer to it than new ones would. Each image's own share in
the fit is then taken off its numbers (Neyman's C(alpha), in *Probability and Statistics* (1959), 213): to first order
what remains knows nothing of the fitted numbers.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from specklegen.core.arguments import whole_number
from specklegen.core.display.plot import Pictured
from specklegen.core.errors import counted, reject
from specklegen.measured.files import Source
from specklegen.measured.measurement import Measurement, read_measurement
from specklegen.models.calibration.image_statistics import movements, statistics
from specklegen.models.calibration.point_speckle import MOST_PATTERNS, PointSpeckle
from specklegen.models.calibration.setup_fit import SetupFit, fit_setup, influence

if TYPE_CHECKING:
    from specklegen.datasets.recipes.recipe import Recipe

_OWNER = "twin"
_LEVEL = 0.01
_PERMUTATIONS = 4999
_FOUND = 1e-8  # of the largest scatter: directions in which nothing varies are left out
_SHOWN = 10
_MOVES = 12  # images by which the slopes of their numbers are found
_CAUSES = {
    "contrast": (
        "a second polarisation (a missing analyser), a wider bandwidth, motion within the exposure, stray "
        "light or a black level set too low",
        "an analyser or narrower light than the setup has, or a black level set too high",
    ),
    "grain": (
        "smaller speckle: a wider aperture or one of another shape, a shorter distance to the camera, or noise",
        "larger speckle: a narrower aperture or one of another shape, a longer distance to the camera, or blur",
    ),
    "spectrum": ("another shape of the aperture, a lens out of focus, or filtered or compressed images",) * 2,
    "histogram": ("saturation, a black level, a gain that is not linear, or a sum of patterns in other shares",) * 2,
    "third order": ("fields that are not Gaussian: few scatterers, a direct beam, a fixed pattern of the camera",) * 2,
    "envelope": ("another profile of the light across the frame: shading, a beam off centre, stray light",) * 2,
    "C_I": (
        "a shorter memory-effect range, larger steps between frames, or motion",
        "a longer memory-effect range, smaller steps between frames, or a static pattern",
    ),
    "displacement": (
        "a shift of the pattern from frame to frame: a lens out of focus, another plane, a drift",
    )
    * 2,
}


class Compared(NamedTuple):
    """One group of numbers.

    Attributes
    ----------
    p_value : float
        Chance that any group differs as much, if nothing does.
    measured, simulated : float
        Its first number, averaged over the images (of contrast and 1 - C_I the logarithm is).
    excess : float
        How many standard deviations of its chance values the distance is above their mean.
    cause : str
        What could make such a difference.
    """

    name: str
    p_value: float
    measured: float
    simulated: float
    excess: float
    cause: str


@dataclass(frozen=True, eq=False, repr=False)
class Twin(Pictured):
    """Results of two-sample tests of camera frames and of images that were simulated for them.

    Attributes
    ----------
    p_value : float
        Chance of a difference as large as the largest that was seen, if there is none.
    compared : tuple of Compared
        Every group, the one that differs most first.
    images, simulated : int
        How many camera frames, or stacks of them, and how many simulated ones.
    setup : SetupFit or None
        What was fitted to the camera frames, where no recipe was given.
    recipe : str
        TOML of what was simulated, with the intervals of what was fitted.
    assumed, doubts : tuple of str
    pictures : ndarray
        float64[11, h, w]: a camera frame, and ten simulated ones.

    Examples
    --------
    >>> import numpy as np
    >>> import specklegen as sg
    >>> from specklegen.datasets import load_recipe
    >>> recipe = load_recipe("tilt-stack", {"material": {"g": 0.9, "optical_depth": 8.0, "thickness": 800.0}})
    >>> seen = recipe.batch(1, "train", range(4))["stack"]
    >>> found = sg.fit.twin(np.concatenate(list(seen)), recipe, images=16)
    >>> found.p_value > 0.01, found.images
    (True, 4)
    """

    p_value: float
    compared: tuple[Compared, ...]
    images: int
    simulated: int
    setup: SetupFit | None
    recipe: str
    assumed: tuple[str, ...]
    doubts: tuple[str, ...]
    pictures: np.ndarray = field(repr=False)

    _named = {"verdict": "verdict"}

    @property
    def differs(self) -> tuple[Compared, ...]:
        """Groups that differ, each with a chance below one in a hundred; empty if no difference is found."""
        return tuple(each for each in self.compared if each.p_value < _LEVEL)

    @property
    def verdict(self) -> str:
        """One sentence."""
        if not self.differs:
            return f"indistinguishable in {counted(self.images, 'image')} (p = {self.p_value:.2g})"
        names = ", ".join(each.name for each in self.differs)
        return f"the images differ in {names} (p = {self.p_value:.1g})"

    def _facts(self) -> Mapping[str, object]:
        facts = dict(super()._facts())
        for each in self.compared:
            text = f"p = {each.p_value:.2g}, {each.measured:.3g} measured, {each.simulated:.3g} simulated"
            facts[each.name] = text + (f"; could be {each.cause}" if each in self.differs else "")
        return facts | {"assumed": self.assumed, "doubts": self.doubts}

    def _draw(self, axes: Any, label: str | None = None) -> None:
        """Your image, and ten simulated ones, to one scale of grey."""
        count, height, width = self.pictures.shape
        gap = max(1, width // 30)
        strip = np.full((2 * (height + gap) - gap, 6 * (width + gap) - gap), np.nan)
        for n, image in enumerate(self.pictures):
            down, across = divmod(n, 6)
            top, left = down * (height + gap), across * (width + gap)
            strip[top : top + height, left : left + width] = image
        axes.imshow(strip, cmap="gray", vmin=0, vmax=float(np.nanpercentile(strip, 99.5)), interpolation="nearest")
        axes.set_frame_on(False)
        axes.set_yticks([])
        axes.set_xticks([(width - 1) / 2, (width + gap) * 3.5], ["yours", f"{count - 1} simulated"])
        axes.tick_params(length=0)
        axes.set_title(self.verdict, fontsize="small")


def twin(
    photographs: Source | Measurement, recipe: Recipe | str | None = None, *, images: int = 64,
    envelope: Source | None = None, dark: Source | float | None = None, pixel_integration: bool = True,
    profile: str | None = None, seed: int = 0,
) -> Twin:  # fmt: skip
    """Compare camera frames with simulated ones, and name what differs.

    Parameters
    ----------
    photographs
        What :func:`specklegen.measured.read_measurement` reads, or what it returned, each of a new realization of the
        medium. Where the recipe makes stacks of T frames, every T frames after another are one stack.
    recipe
        The setup. Without one the camera frames are taken for speckle of one point of light, to which
        :func:`fit_setup` is fitted first.
    images
        How many images, or stacks, to simulate.
    envelope
        An image [h, w] of the light's envelope, by which camera frames are divided, or "fit". By default it is fitted
        and taken off without a recipe, and stays beside one.
    dark
        Frames without light, or the black level in counts; by default nothing is taken off.
    pixel_integration
        Without a recipe: whether pixels average over their area, as those of cameras do.
    profile
        Without a recipe: shape of the aperture, "square", "disc" or "gaussian"; by default all are tried.
    seed
        Of the simulated images, a whole number.

    Raises
    ------
    RuleError
        If camera frames are smaller than the recipe's, frames make no whole stacks, or the setup cannot be drawn.

    Examples
    --------
    >>> import numpy as np
    >>> import specklegen as sg
    >>> rng = np.random.default_rng(0)
    >>> iris = np.hypot(*np.meshgrid(*[np.arange(-128, 128)] * 2)) < 32
    >>> fields = np.fft.ifft2(iris * (rng.normal(size=(4, 256, 256)) + 1j * rng.normal(size=(4, 256, 256))))
    >>> found = sg.fit.twin(np.abs(fields[:, :128, :128]) ** 2, images=16, pixel_integration=False)
    >>> found.p_value > 0.01, found.setup.profile
    (True, 'disc')
    """
    images = whole_number(f"{_OWNER} images", images, 8, 4096)
    seed = whole_number(f"{_OWNER} seed", seed, 0, 2**63 - 1)
    if isinstance(photographs, Measurement):
        seen = photographs
    else:
        fitted = "fit" if envelope is None and recipe is None else envelope
        seen = read_measurement(photographs, envelope=fitted, dark=dark)
    seen.require_speckle(f"{_OWNER} photographs")
    order = seen.envelope_order or 0
    if recipe is None:
        setup = fit_setup(seen, pixel_integration=pixel_integration, profile=profile)
        light = seen.images
        if any("one pattern" in doubt for doubt in setup.doubts):
            light = light.mean(axis=0, keepdims=True)
        drawn = _checked(setup.drawn)
        synthetic = drawn.draw(light.shape[1:], images, seed)
        moved = _slopes_of(drawn, light.shape[1:], order, seed + 1)
        measured, simulated = (
            _freed(statistics(each[:, None], drawn.grain, order), influence(each, drawn), moved)
            for each in (light, synthetic)
        )
        toml, assumed, doubts = _written(setup, light.shape[1:]), list(seen.assumed), list(setup.doubts)
        assumed.append("the noise grows with the light, like photon noise")
        shown = light[:1], synthetic
        count = len(light)
    else:
        setup = None
        used = _loaded(recipe)
        key, frames = _observed(used)
        stacks, notes = _stacked(seen.images, frames, used.camera_shape)
        black = 0.0 if used.exposure is None else float(getattr(used.exposure, "offset", 0.0))
        batches = [range(first, min(first + 16, images)) for first in range(0, images, 16)]
        synthetic = np.concatenate([np.asarray(used.batch(seed, "train", list(batch))[key]) for batch in batches])
        synthetic = synthetic.reshape(images, frames, *used.camera_shape).astype(np.float64) - black
        both = np.concatenate([stacks, synthetic])
        grain, moves = _grain_of(both), movements(both) if frames > 1 else None
        measured, simulated = (statistics(each, grain, order, moves) for each in (stacks, synthetic))
        toml, assumed, doubts = used.to_toml(), [*seen.assumed, *notes], list(seen.doubts)
        shown = stacks[:1, 0], synthetic[:, 0]
        count = len(stacks)
    p_value, compared = _judged(measured, simulated, seed)
    pictures = np.concatenate([shown[0], shown[1][:_SHOWN]])
    pictures = pictures / pictures.mean(axis=(1, 2), keepdims=True)
    return Twin(p_value, compared, count, images, setup, toml, tuple(assumed), tuple(doubts), pictures)


def _checked(drawn: PointSpeckle) -> PointSpeckle:
    if drawn.lit < 1 / MOST_PATTERNS:
        reject(f"{_OWNER} photographs", f"of a contrast of at least {MOST_PATTERNS ** -0.5:.1g}", drawn.lit**0.5,
               "Give a recipe of the setup with its bandwidth.")  # fmt: skip
    return drawn


def _slopes_of(drawn: PointSpeckle, shape: tuple[int, int], order: int, seed: int) -> dict[str, np.ndarray]:
    """Derivatives float64[d, 3] of the means of all numbers by ln(grain), contrast^2 and noise^2: common numbers."""
    steps = (0.02, -0.05 * drawn.lit, max(0.2 * drawn.noise, 1e-3 * drawn.lit))
    moved = (
        drawn._replace(grain=drawn.grain * np.exp(steps[0])), drawn._replace(lit=drawn.lit + steps[1]),
        drawn._replace(noise=drawn.noise + steps[2]),
    )  # fmt: skip

    def means(setup: PointSpeckle) -> dict[str, np.ndarray]:
        numbers = statistics(setup.draw(shape, _MOVES, seed)[:, None], drawn.grain, order)
        return {name: each.mean(axis=0) for name, each in numbers.items()}

    here = means(drawn)
    there = [means(each) for each in moved]
    return {
        name: np.stack([(each[name] - at) / step for each, step in zip(there, steps, strict=True)], axis=1)
        for name, at in here.items()
    }


def _freed(numbers: dict[str, np.ndarray], shares: np.ndarray, slopes: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Numbers of images less what each image moves the fit by."""
    return {name: each - shares @ slopes[name].T for name, each in numbers.items()}


def _loaded(recipe: Recipe | str) -> Recipe:
    from specklegen.datasets import load_recipe
    from specklegen.datasets.recipes.recipe import Recipe

    return recipe if isinstance(recipe, Recipe) else load_recipe(recipe)


def _observed(recipe: Recipe) -> tuple[str, int]:
    """Name of the array of camera images, and how many a sample has."""
    layout = recipe.layout()
    for name in ("stack", "image", "images"):
        if name in layout and tuple(layout[name].shape[-2:]) == tuple(recipe.camera_shape):
            return name, int(np.prod(layout[name].shape[:-2], dtype=int))
    reject(f"{_OWNER} recipe", "of a kind whose samples are camera images", type(recipe).__name__)


def _stacked(images: np.ndarray, frames: int, shape: tuple[int, int]) -> tuple[np.ndarray, list[str]]:
    """Frames as stacks float64[n, T, h, w], their middle of the recipe's size."""
    if len(images) % frames:
        rule = f"whole stacks of {counted(frames, 'frame')}, as in the recipe"
        reject(f"{_OWNER} photographs", rule, counted(len(images), "frame"))
    height, width = images.shape[1:]
    if height < shape[0] or width < shape[1]:
        reject(f"{_OWNER} photographs", f"of at least {shape[0]} x {shape[1]} pixels, as the recipe's camera",
               f"{height} x {width}", "Give the recipe a smaller camera.")  # fmt: skip
    top, left = (height - shape[0]) // 2, (width - shape[1]) // 2
    cut = images[:, top : top + shape[0], left : left + shape[1]]
    notes = [] if cut.shape == images.shape else [f"of each frame the middle {shape[0]} x {shape[1]} pixels"]
    return cut.reshape(-1, frames, *shape), notes


def _grain_of(samples: np.ndarray) -> float:
    """Pixels at which the autocorrelation of all samples together has fallen to a half, times 1.4: a grain, roughly."""
    light = samples / samples.mean(axis=(2, 3), keepdims=True) - 1
    power = np.square(np.abs(np.fft.fft2(light))).mean(axis=(0, 1))
    lags = np.fft.ifft2(power).real
    reach = min(lags.shape) // 2
    row = (lags[0, :reach] + lags[:reach, 0]) / (2 * max(lags[0, 0], 1e-300))
    below = np.flatnonzero(row < 0.5)
    return max(1.0, 2.0 * float(below[0])) if len(below) else float(len(row) / 4)


def _judged(
    measured: dict[str, np.ndarray], simulated: dict[str, np.ndarray], seed: int
) -> tuple[float, tuple[Compared, ...]]:
    """Chance of the largest difference, and every group, the one that differs most first."""
    names = list(measured)
    ours = len(measured[names[0]])
    rng = np.random.default_rng([seed, 1])
    total = ours + len(simulated[names[0]])
    chosen = np.zeros((_PERMUTATIONS + 1, total))
    chosen[:, :ours] = 1 / ours
    chosen[1:] = rng.permuted(chosen[1:], axis=1)
    distances = {}
    for name in names:
        away = chosen @ _whitened(np.concatenate([measured[name], simulated[name]]))
        distances[name] = np.square(away).sum(axis=1)
    # Rank of every permutation within each group, the photographs' among them: p-values of all.
    chances = np.stack([1 - np.searchsorted(np.sort(each), each) / len(each) for each in distances.values()])
    least = chances.min(axis=0)
    compared = []
    for name, own in zip(names, chances, strict=True):
        first, second = (each[name][:, 0].mean() for each in (measured, simulated))
        if name == "contrast":
            first, second = np.exp(first), np.exp(second)
        if name == "C_I":
            first, second = -np.expm1(first), -np.expm1(second)
        cause = _CAUSES[name][int(first > second)]
        spread = distances[name][1:]
        excess = float((distances[name][0] - spread.mean()) / max(spread.std(), 1e-300))
        adjusted = float((least <= own[0] + 1e-12).mean())
        compared.append(Compared(name, adjusted, float(first), float(second), excess, cause))
    order = sorted(compared, key=lambda each: -each.excess)
    return float((least <= least[0] + 1e-12).mean()), tuple(order)


def _whitened(numbers: np.ndarray) -> np.ndarray:
    """Numbers of all images [n, d], less their mean, uncorrelated and of variance 1."""
    mean = numbers.mean(axis=0)
    scale = numbers.std(axis=0)
    varies = scale > _FOUND * np.abs(mean)  # frequencies without light are all alike
    away = (numbers - mean)[:, varies] / scale[varies]
    if not varies.any():
        return np.zeros((len(numbers), 1))
    values, vectors = np.linalg.eigh(away.T @ away / len(away))
    kept = values > _FOUND * values.max()
    return away @ vectors[:, kept] / np.sqrt(values[kept])


def _written(setup: SetupFit, shape: tuple[int, int]) -> str:
    """TOML of the fitted setup, with its intervals as comments."""
    bounds = setup.interval()
    lines = ['inherits = "ground-glass"', 'name = "twin"', "", "[pixels]"]
    low, high = bounds["grain"]
    lines.append(f"grain = {setup.grain:.5g}  # 95 %: {low:.4g} to {high:.4g}")
    lines.append("object_pixel = 1.0  # speckle of one point does not determine it")
    lines += [f"shape = [{shape[0]}, {shape[1]}]", f'profile = "{setup.profile}"']
    low, high = bounds["contrast"]
    lines += ["", "[light]", f"polarised = {'true' if setup.contrast > 0.85 else 'false'}"
              f"  # contrast {setup.contrast:.4g}, 95 %: {low:.4g} to {high:.4g}"]  # fmt: skip
    low, high = bounds["noise"]
    lines += ["", f"# noise over the mean light {setup.noise:.4g}, 95 %: {low:.4g} to {high:.4g}"]
    return "\n".join(lines) + "\n"
