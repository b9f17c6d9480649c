"""A camera's gain, read noise, offset, full well and bits from pairs of its own frames: the photon transfer curve.

Two frames a, b of one light differ by their noise alone, whatever the light's pattern: speckle is welcome. With the
second scaled to the first's mean by s (the lamp may drift), over the *whole* frame,

    <(a - s b)^2> / 2 = (m / gain) (1 + s) / 2 + f (1 + s^2) / 2,       f = (read_noise / gain)^2 + 1/12

m the mean of a above the offset; dark frames give the offset, and f once more. A line through all levels, each weighted
by its error, which the line and the pattern's second moment say: of N pixels the variance of the left side is
``<2 sigma^4 + m / (2 gain^3)> / N``; ``sigma^2 = m / gain + f`` of each pixel (squares of the differences themselves
would weigh a level by its noise). Not by bins of a pixel's own mean, and not with bright pixels left out of a frame:
both choose pixels by their noise, and regress to the mean (gain 0.6 % and read noise 3.5 % too large). Levels with a
saturated pixel are left out whole. Sources: Janesick, *Photon Transfer* (2007), chapter 5; EMVA Standard
1288: sections 2 and 6.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import tomli_w
from numpy.typing import ArrayLike
from scipy.stats import chi2

from specklegen.core.arguments import whole_number
from specklegen.core.display.plot import Pictured, draw_curve
from specklegen.core.errors import counted, reject
from specklegen.instrument.camera import Camera
from specklegen.instrument.full_well import Knee, knee_of
from specklegen.instrument.hot_pixels import hot_in_dark

_FEWEST_LEVELS = 3
_DRIFT, _MOST_DRIFT = 3e-3, 0.2  # of the light between the frames of a pair: told, refused
_MOST_HOT = 0.01  # share of the pixels
_CLIPPED = 1e-3  # share of dark pixels at 0
_LINKED = 0.02  # correlation of neighbouring pixels' noise: of one pattern none
_SURE = 6.0  # standard errors
_ROUNDED = 0.25  # dark variance from which rounding adds 1/12
_DOUBTFUL = 1e-4
_DEPTHS = (8, 10, 12, 14, 16)


class Level(NamedTuple):
    """Estimates from one pair of frames.

    Attributes
    ----------
    mean : float
        Counts above the offset, of the first frame.
    variance, standard_error : float
        Half the mean squared difference, in counts squared.
    ratio : float
        Light of the first frame over that of the second.
    power : float
        Mean square of the pattern without its noise, in counts squared.
    used : bool
        Whether no pixel is saturated.
    """

    mean: float
    variance: float
    standard_error: float
    ratio: float
    power: float
    used: bool


@dataclass(frozen=True, repr=False)
class CameraFit(Pictured):
    """A fitted camera.

    Attributes
    ----------
    gain, read_noise, offset : float
        Electrons a count, electrons, counts.
    gain_error, read_noise_error, offset_error : float
        Standard errors of these.
    full_well : float or None
        Electrons; None where no level shows one below the converter's end.
    full_well_error : float or None
        Standard error of that; None without one.
    bit_depth : int
        Bits of the converter, as they were given or read off the frames.
    levels : tuple of Level
        In order of their means.
    chi_squared : float
        Of the levels about the line.
    degrees : int
        Its degrees of freedom.
    doubts : tuple of str
        What is wrong with the frames, though not so much that they are refused.

    Examples
    --------
    >>> import numpy as np
    >>> import specklegen as sg
    >>> counts = lambda level, seed: np.random.default_rng(seed).poisson(level, (2, 64, 64)) + 5  # a gain of 1
    >>> dark = np.random.default_rng(9).normal(5, 1, (2, 64, 64)).round()
    >>> fit = sg.fit.fit_camera([counts(20, 1), counts(50, 2), counts(200, 3)], dark, bit_depth=10)
    >>> sorted(fit.table), fit.camera(photons=300.0).bit_depth
    (['bit_depth', 'gain', 'offset', 'read_noise'], 10)
    """

    gain: float
    gain_error: float
    read_noise: float
    read_noise_error: float
    offset: float
    offset_error: float
    full_well: float | None
    full_well_error: float | None
    bit_depth: int
    levels: tuple[Level, ...]
    chi_squared: float
    degrees: int
    doubts: tuple[str, ...]

    _named = {"gain, electrons a count": "gain", "read noise, electrons": "read_noise", "offset, counts": "offset",
              "full well, electrons": "full_well", "bits": "bit_depth", "χ² of the line": "chi_squared",
              "degrees of freedom": "degrees", "doubts": "doubts"}  # fmt: skip

    @property
    def table(self) -> dict[str, float]:
        """Fields of ``[exposure]`` that were found; ``photons`` depends on the light."""
        fields: dict[str, float] = {"gain": self.gain, "read_noise": self.read_noise, "offset": self.offset}
        if self.full_well is not None:
            fields["full_well"] = self.full_well
        return fields | {"bit_depth": self.bit_depth}

    def camera(self, photons: float, **fields: Any) -> Camera:
        """Return the camera in a light of so many photons a pixel; ``fields`` are further ones of `Camera`."""
        return Camera(photons=photons, **self.table | fields)

    def to_toml(self) -> str:
        """Write the table ``[exposure]`` with the errors, and a line that asks for the photons."""
        errors = {name: getattr(self, f"{name}_error", None) for name in self.table}
        lines = tomli_w.dumps(self.table).splitlines()
        rows = [f"{line}  # +- {error:.2g}" if (error := errors[line.split(" ")[0]]) else line for line in lines]
        doubts = [f"# doubt: {doubt}" for doubt in self.doubts]
        return "\n".join([*doubts, "[exposure]", *rows, "# photons = ...  mean electrons a pixel of your image", ""])

    def _draw(self, axes: Any, label: str | None = None) -> None:
        """Variance over mean, both logarithmic: levels that are used, those that are not, and the line."""
        for used, style in ((True, "o"), (False, "x")):
            some = [level for level in self.levels if level.used == used]
            if some:
                name = label if used else "saturated: left out"
                means, variances, errors = np.array([level[:3] for level in some]).T
                draw_curve(axes, means, variances, errors, name, fmt=style)
        x = np.geomspace(self.levels[0].mean, self.levels[-1].mean, 200)
        axes.plot(x, x / self.gain + (self.read_noise / self.gain) ** 2 + 1 / 12, lw=1, color="grey")
        axes.set(xlabel="mean, counts above the offset", ylabel="variance, counts squared", xscale="log", yscale="log")


def fit_camera(pairs: Sequence[ArrayLike], dark: ArrayLike, *, bit_depth: int | None = None) -> CameraFit:
    """Fit a camera to pairs of frames at several levels of light, and to dark frames.

    Parameters
    ----------
    pairs
        For each level two frames of one light, whole counts[2, H, W]; at least three levels without a saturated pixel.
        Speckle serves, if it does not change between the two.
    dark
        At least two frames without light, counts[n, H, W], of the same exposure time.
    bit_depth
        Of the camera, where it is known; by default from the counts at which frames saturate.

    Returns
    -------
    fit
        Numbers with errors, the curve, and doubts: drift of the lamp by more than 0.3 % within a pair, hot pixels
        (left out), bits that no level shows, a curve that is not straight.

    Raises
    ------
    RuleError
        For single frames, frames that are copies, a pattern that moved, compressed or converted pictures, dark frames
        cut off at 0, or too few levels.

    Examples
    --------
    >>> import numpy as np
    >>> import specklegen as sg
    >>> from specklegen.instrument import Camera, NoiseStreams, expose
    >>> light = np.random.default_rng(0).exponential(size=(128, 128))  # speckle
    >>> def frame(photons, seed):
    ...     camera = Camera(photons=max(photons, 1e-9), gain=2.5, read_noise=3.0, offset=20.0, bit_depth=12)
    ...     return expose(camera, light, NoiseStreams.of(seed))
    >>> pairs = [(frame(n, n), frame(n, n + 1)) for n in (50, 100, 200, 400)]
    >>> fit = sg.fit.fit_camera(pairs, dark=[frame(0, 1), frame(0, 2)])
    >>> abs(fit.gain - 2.5) < 4 * fit.gain_error < 0.1
    True
    """
    black = _checked("fit_camera dark", dark)
    if len(black) < 2:
        reject("fit_camera dark", "at least two frames", len(black), "Noise is computed from the difference of two.")
    try:
        bright = [_checked("fit_camera pairs", pair) for pair in iter(pairs)]
    except TypeError:  # numbers, and arrays without dimensions
        reject("fit_camera pairs", "a sequence of pairs of frames", pairs)
    for pair in bright:
        if len(pair) != 2:
            reject("fit_camera pairs", "of two frames each", len(pair), _SINGLE)
        if pair.shape[1:] != black.shape[1:]:
            reject("fit_camera pairs", f"of the dark frames' shape {black.shape[1:]}", pair.shape[1:])
        if np.array_equal(*pair):
            reject("fit_camera pairs", "of two frames each", "a frame and its copy", _SINGLE)
    if len(bright) < _FEWEST_LEVELS:
        reject("fit_camera pairs", f"of at least {_FEWEST_LEVELS} levels of light", len(bright))
    _require_single_steps(bright)

    doubts: list[str] = []
    dark_level = _dark(black, doubts)
    top, bits = _range(bright, bit_depth, doubts)
    for number, pair in enumerate(bright, 1):
        if not pair[:, dark_level.good].mean(axis=1).min() > dark_level.offset:
            reject("fit_camera pairs", "brighter than the dark frames", f"a mean of {pair.mean():.3g} in pair {number}")
    kept = [pair[:, dark_level.good] for pair in bright]
    knee = knee_of(kept, dark_level.offset, np.sqrt(dark_level.variance), top)
    limit = top if knee is None else min(top, knee.limit)
    levels = sorted(
        _level(number, pair, dark_level, bool((kept[number - 1] >= limit).any()), doubts)
        for number, pair in enumerate(bright, 1)
    )
    return _fitted(levels, dark_level, knee, bits, doubts)


_SINGLE = "The variance of one frame includes that of the light: take two at one light level, one after the other."


class _Dark(NamedTuple):
    """Offset and variance of dark frames with their errors, and the pixels that are not hot: bool[H, W]."""

    offset: float
    offset_error: float
    variance: float
    variance_error: float
    good: np.ndarray


def _checked(field: str, frames: ArrayLike) -> np.ndarray:
    """Whole counts, float64[n, H, W]."""
    try:
        array = np.asarray(frames)
        counts = array.astype(np.float64)
    except (TypeError, ValueError, OverflowError, RuntimeError):  # the last of torch, of what has gradients
        reject(field, "frames of numbers, all of one shape", type(frames).__name__)
    if array.ndim != 3 or min(array.shape, default=0) < 1 or min(array.shape[1:]) < 16:
        remedy = _SINGLE if array.ndim == 2 else ""
        reject(field, "of shape (frames, rows, columns), at least 16 x 16 pixels", array.shape, remedy)
    if np.iscomplexobj(array) or not np.isfinite(counts).all() or (counts < 0).any() or (counts % 1).any():
        reject(field, "raw counts: whole numbers of at least 0", array,
               "The noise of scaled pictures has no known unit.")
    return counts


def _require_single_steps(bright: list[np.ndarray]) -> None:
    values = np.unique(np.concatenate([np.unique(pair) for pair in bright]))
    step = int(np.gcd.reduce(np.diff(values).astype(np.int64))) if len(values) > 1 else 1
    if step > 1:
        reject(
            "fit_camera pairs", "counts in steps of 1", f"steps of {step}",
            f"They were scaled or shifted when saved: divide pairs and dark frames by {step}.",
        )  # fmt: skip


def _dark(black: np.ndarray, doubts: list[str]) -> _Dark:
    frames, *shape = black.shape
    cut = float((black == 0).mean())
    if cut > _CLIPPED and black.any():
        reject("fit_camera dark", "of a black level high enough that no pixel is at 0",
               f"{100 * cut:.3g} % of pixels at 0",
               "Raise the camera's offset (black level).")  # fmt: skip
    good = ~hot_in_dark(black)
    hot = int((~good).sum())
    if hot > _MOST_HOT * good.size:
        reject("fit_camera dark", "without light", f"{hot} of {good.size} pixels far from the mean", "Cover the lens.")
    if hot:
        doubts.append(f"{counted(hot, 'hot pixel')} left out, found in the dark frames")
    kept = black[:, good]
    variance = float(kept.var(axis=0, ddof=1).mean())
    free = (frames - 1) * kept.shape[1]
    offset_error = np.sqrt(max(variance, 0.0) / kept.size)
    return _Dark(float(kept.mean()), float(offset_error), variance, variance * np.sqrt(2 / free), good)


def _range(bright: list[np.ndarray], bit_depth: int | None, doubts: list[str]) -> tuple[float, int]:
    """Largest count, and bits."""
    highest = max(float(pair.max()) for pair in bright)
    if bit_depth is not None:
        bit_depth = whole_number("fit_camera bit_depth", bit_depth, 1, 16)
        if highest > 2**bit_depth - 1:
            reject("fit_camera bit_depth", f"enough for counts of {highest:g}", bit_depth)
        return 2.0**bit_depth - 1, bit_depth
    bits = int(np.ceil(np.log2(highest + 1)))
    if highest == 2**bits - 1 and sum(int((pair == highest).sum()) for pair in bright) > 1:
        return highest, bits
    bits = next((depth for depth in _DEPTHS if depth >= bits), 16)
    if highest > 2.0**16 - 1:
        reject("fit_camera pairs", "counts of at most 16 bits", highest)
    doubts.append(f"no level reaches the largest count: {bits} bits are the fewest that hold {highest:g}, not measured")
    return 2.0**bits - 1, bits


def _level(number: int, pair: np.ndarray, dark: _Dark, saturated: bool, doubts: list[str]) -> Level:
    first, second = pair - dark.offset
    good = dark.good
    means = first[good].mean(), second[good].mean()
    ratio = float(means[0] / means[1])
    if abs(np.log(ratio)) > _MOST_DRIFT:
        reject("fit_camera pairs", "of one light each", f"means {means[0]:.4g} and {means[1]:.4g} in pair {number}")
    apart = np.where(good, first - ratio * second, 0.0)
    square = np.square(apart)
    total = good.sum()
    mean_square = float(square.sum() / total)
    pattern = np.square((first + ratio * second)[good] / 2).mean() - mean_square / 4
    if not saturated:
        _require_one_pattern(number, apart, mean_square)
        if abs(ratio - 1) > max(_DRIFT, _SURE * np.sqrt(mean_square / total) / means[1]):
            doubts.append(f"the light of pair {number} changed by {100 * abs(ratio - 1):.2g} % between its frames")
    return Level(float(means[0]), mean_square / 2, np.nan, ratio, float(pattern), not saturated)


def _require_one_pattern(number: int, apart: np.ndarray, mean_square: float) -> None:
    """Noise of neighbours is independent; what moved or was compressed is not."""
    for products in (apart[1:] * apart[:-1], apart[:, 1:] * apart[:, :-1]):
        linked = products.mean() / mean_square
        error = products.std() / np.sqrt(products.size) / mean_square
        if linked < -_LINKED - _SURE * error or linked > _LINKED + _SURE * error:
            reject(
                "fit_camera pairs", "of one pattern each, with noise that differs from pixel to pixel",
                f"differences of neighbours that correlate by {linked:.2g} in pair {number}",
                "The pattern moved between the two frames, or they were compressed (JPEG), filtered or resized.",
            )  # fmt: skip


def _error(level: Level, slope: float, floor: float, pixels: int) -> float:
    """Standard error of a level's variance, given its light."""
    slope, floor, mean = max(slope, 0.0), max(floor, 0.0), level.mean
    fourth = level.power * slope**2 + 2 * floor * mean * slope + floor**2
    return float(np.sqrt((2 * fourth + mean * slope**3 / 2) / pixels))


def _fitted(levels: list[Level], dark: _Dark, knee: Knee | None, bits: int, doubts: list[str]) -> CameraFit:
    used = [level for level in levels if level.used]
    if len(used) < _FEWEST_LEVELS or used[-1].mean < 1.5 * used[0].mean:
        held = f"{counted(len(used), 'level')} without"
        reject("fit_camera pairs", f"{_FEWEST_LEVELS} levels without a saturated pixel, 1.5 times apart", held,
               "Add darker pairs.")  # fmt: skip
    mean, variance, _, ratio, _ = np.array([level[:5] for level in used]).T
    design = np.stack([mean * (1 + ratio) / 2, (1 + ratio**2) / 2], axis=1)
    if dark.variance > _ROUNDED:
        design, variance = np.vstack([design, [0.0, 1.0]]), np.append(variance, dark.variance)
    covariance, slope, floor, weighted, goal = np.eye(2), variance[0] / mean[0], dark.variance, design, variance
    for _ in range(4):  # errors from the line, the line from the errors
        levels = [level._replace(standard_error=_error(level, slope, floor, dark.good.sum())) for level in levels]
        error = np.append([level.standard_error for level in levels if level.used], dark.variance_error)[: len(goal)]
        weighted, goal = design / error[:, None], variance / error
        covariance = np.linalg.inv(weighted.T @ weighted)
        slope, floor = covariance @ weighted.T @ goal
    if not slope > _SURE * np.sqrt(covariance[0, 0]):
        reject("fit_camera pairs", "of noise that grows with the light", f"a slope of {slope:.3g}", _SINGLE)
    chi_squared, degrees = float(np.square(goal - weighted @ (slope, floor)).sum()), len(goal) - 2
    if chi2.sf(chi_squared, degrees) < _DOUBTFUL:
        doubts.append(
            f"the variances do not lie on one line (chi squared {chi_squared:.3g} of {degrees}): the camera is not "
            "linear, or the light flickers"
        )
    gain, gain_error = 1 / slope, np.sqrt(covariance[0, 0]) / slope**2
    noise = max(floor - 1 / 12, 0.0)
    read = gain * np.sqrt(noise)
    # read = sqrt(floor - 1/12) / slope; where there is next to none, its square is what is known.
    turn = np.array([-read / slope, gain / (2 * np.sqrt(noise))]) if noise else np.zeros(2)
    square_error = gain * np.sqrt(np.sqrt(covariance[1, 1]))
    read_error = min(float(np.sqrt(turn @ covariance @ turn)), square_error) if noise else square_error
    well = well_error = None
    if knee is not None:
        height = knee.counts - dark.offset
        well = gain * height
        well_error = float(np.hypot(height * gain_error, gain * np.hypot(knee.standard_error, dark.offset_error)))
    return CameraFit(float(gain), float(gain_error), float(read), float(read_error), dark.offset, dark.offset_error,
                     well, well_error, bits, tuple(levels), chi_squared, degrees, tuple(doubts))  # fmt: skip
