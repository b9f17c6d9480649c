"""A judgement on camera frames of a setup that nobody described: what they hold, and whether phase retrieval will work.

Everything is read off the frames: grain and camera noise from their frequencies
(:mod:`~specklegen.models.recoverability.band`), contrast, the object's extent from the autocorrelation
and its own noise (:mod:`~specklegen.models.recoverability.extent`), saturation and bits from the counts, vibration from
frames. The probability is that of :mod:`~specklegen.models.recoverability.verdict`, of the residual of the measured
power under the lags that the object needs. Two of its numbers, complexity and bright area, belong to an image that is
not there yet: their part is predicted from the contrast and from how much of the band the light fills. Its scatter over
168 objects of twelve families, and that of what no camera frame tells of a setup, blunt the probability and widen the
interval.

Speckle of any object is a sum of exponential numbers: its skewness is at least twice its contrast; it is alike all over
the frame; no frequency stands out of its power; it has no edges (:mod:`~specklegen.models.recoverability.sparseness`).
What breaks these is no speckle. Speckle of contrast near 1 is that of one field: of a coherent object, or of a point.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
import torch
from scipy.fft import next_fast_len
from scipy.ndimage import convolve
from scipy.optimize import root_scalar
from scipy.stats import gamma

from specklegen.core.arguments import instance
from specklegen.core.display.plot import Pictured, draw_images
from specklegen.core.errors import RuleError, reject
from specklegen.core.shielded import shielded
from specklegen.instrument.camera import Camera
from specklegen.measured.files import Source
from specklegen.measured.measurement import Measurement, read_measurement
from specklegen.models.recoverability.autocorrelation_error import REACH, saturated
from specklegen.models.recoverability.band import Band, fit_band, transfer
from specklegen.models.recoverability.extent import find_extent
from specklegen.models.recoverability.sparseness import sparseness
from specklegen.models.recoverability.speckle_test import smoothed_moments
from specklegen.models.recoverability.verdict import COEFFICIENTS, Reason, share
from specklegen.models.retrieval.autocorrelation import taper

Answer = Literal["works", "needs frames", "cannot", "no speckle", "coherent object"]

_SEEN = 1024  # pixels along a side that are looked at, at most
_EVEN = 1e-9  # of the mean
_ALIKE = 0.5  # correlation of frames from which on they are of one pattern
_OBJECT, _OBJECT_SCATTER = (-1.231, -2.069, -2.0), 1.067
"""c ln complexity + d ln area = k0 + k1 ln(1 / contrast^2) + k2 ln(share of the band); its scatter, of 168 objects."""
_BENCH_SCATTER = 3.14
"""Of the logarithm of the odds, by the error of the extent and by all that a bench does unseen. Of 85 photographs of
perturbed benches ln L of what became of them is -57.6 without it, -50.7 with it, and greatest, -50.2, with 4.8: the
smallest is taken from which on another half is not to be won."""
_SCATTER = float(np.sqrt(COEFFICIENTS["scatter"] ** 2 + _OBJECT_SCATTER**2 + _BENCH_SCATTER**2))
_NINETIETH = 1.6449
_MOST_FRAMES = 4096
_EDGE = 12.0  # 2 ln of likelihoods from which on the band's edge is seen
_BIAS = 0.02  # of ln grain: Hann's window widens the edge
_ONE_FIELD = 0.75  # variance over the mean squared: 1 of one field, 0.5 of two points, 0.83 if one is a tenth
_FEW_POINTS = 0.5  # from which the object is a few points, or a coherent one
_LAWFUL = 2.0  # evidence of the law up to which a frame may be of one field; pictures of two brightnesses have 2.3
_UNSMOOTH = 25.0  # evidence of edges, places and few patches: frames of coherent-digits have up to 22, drawn digits 38
_RESOLVED = 2.05  # pixels in a grain
_SIGNAL = 0.02  # of the mean: contrast below which an image is even
_ALONE = 6.0  # standard deviations of white noise, from which on neighbouring pixels are alike
_APART = 6.0  # standard deviations of far lags, which scatter by as much as few grains do
_REFUSED = 20.0  # sum of squares of the evidence against speckle
_SKEWNESS = 0.22
"""Error of the skewness over the smallest possible one, besides that of a finite photograph: of noise taken off."""
_UNEVEN = 0.15
"""Relative scatter of the variance over a frame that benches have beside a smooth trend. Of a measured frame behind
ground glass, a megapixel, it was 0.18, 10 times what its grains scatter by: it was refused for that."""
_EDGES = 2.0
"""Evidence that a spread of sparseness is worth: of 94 photographs of speckle the sparsest lay 1.7 spreads high."""
_LITTLE = 0.01  # where nothing is left of what is asked for, in its own units
LEAST = 32  # pixels along each side
_BLOCKS = 4  # along each side


@dataclass(frozen=True, eq=False, repr=False)
class PhotographVerdict(Pictured):
    """Findings of camera frames, and the fate of their object.

    Attributes
    ----------
    answer : str
        "works", "needs frames", "cannot", "no speckle", or "coherent object": the speckle of one field, as of a
        modulator in laser light or of a single point, of which phase retrieval makes nothing.
    probability : float
        That phase retrieval comes to a Pearson correlation above 0.8, of these frames, if they are speckle; 0 of
        coherent objects, and of what is seen to be none: most pictures, but not noise that was blurred. Shares that
        were right: docs/notes/measured.md.
    interval : (float, float)
        Where that share lies for nine scenes of ten that look alike.
    frames_needed : int or None
        Frames through other states of the medium with which success is as likely as not; None where none suffice.
    grain : (float, float)
        Camera pixels in a grain, down and across; infinite where no edge is seen.
    grain_error : float
        Standard error of these, relative.
    contrast, contrast_error : float
        Of the light, envelope and camera noise taken off.
    electrons : float
        A pixel, of equal noise: 1 over its relative variance; infinite where no noise is seen.
    photons : float or None
        A pixel, of the camera's own numbers; None without a camera.
    extent : float
        Of the object, grains.
    grains : float
        Along a side of the camera, of a square of its area.
    peak : float
        Of the autocorrelation above its background, over the background's standard deviation.
    envelope : float
        Brightest over darkest light of the fitted envelope; 1 where it is even or was left in.
    vibration : float or None
        Standard deviation of the movement between frames of one pattern, pixels; None of one frame, or of several
        patterns.
    evidence : dict[str, float]
        Against speckle, in standard deviations.
    reasons : tuple of Reason
    assumed : tuple of str
    measured : Measurement

    Examples
    --------
    >>> import numpy as np
    >>> from specklegen.models import judge_photograph
    >>> rng = np.random.default_rng(0)
    >>> iris = np.maximum(*np.abs(np.meshgrid(*[np.fft.fftfreq(256)] * 2))) < 0.5 / 3
    >>> light = np.abs(np.fft.ifft2(iris * (rng.normal(size=(256, 256)) + 1j * rng.normal(size=(256, 256))))) ** 2
    >>> object = np.zeros((256, 256))
    >>> object[[0, 9, 17, 20], [0, 11, 4, 22]] = 1
    >>> image = np.fft.ifft2(np.fft.fft2(light) * np.fft.fft2(object)).real[:192, :192]
    >>> found = judge_photograph(np.rint(image / image.mean() * 500))
    >>> found.answer, bool(abs(found.grain[0] - 3) < 0.15), bool(abs(found.contrast - 0.5) < 0.06)
    ('works', True, True)
    """

    answer: Answer
    probability: float
    interval: tuple[float, float]
    frames_needed: int | None
    grain: tuple[float, float]
    grain_error: float
    contrast: float
    contrast_error: float
    electrons: float
    photons: float | None
    extent: float
    grains: float
    peak: float
    envelope: float
    vibration: float | None
    evidence: dict[str, float]
    reasons: tuple[Reason, ...]
    assumed: tuple[str, ...]
    measured: Measurement

    _named = {"verdict": "headline"}

    @property
    def headline(self) -> str:
        """The judgement in one line."""
        low, high = self.interval
        sure = f"success probability {self.probability:.2f} ({low:.2f} to {high:.2f})"
        if self.answer in ("no speckle", "coherent object"):
            return f"{self.answer}: " + "; ".join(each.numbers for each in self.reasons)
        if self.answer == "works":
            return f"works: {sure}"
        if self.answer == "needs frames":
            return f"needs about {self.frames_needed} frames through other states of the medium: {sure}"
        return f"cannot, because {'; '.join(each.numbers for each in self.reasons)}: {sure}"

    @property
    def score(self) -> float:
        """Sum of the squares of the evidence: 20 or more is refused."""
        return float(np.square(list(self.evidence.values())).sum())

    @property
    def numbers(self) -> dict[str, float | None]:
        """Measured values, by name."""
        seen = self.measured
        return {
            "grain_down": self.grain[0], "grain_across": self.grain[1], "grain_error": self.grain_error,
            "contrast": self.contrast, "contrast_error": self.contrast_error, "envelope": self.envelope,
            "saturated": seen.saturated, "at_zero": seen.at_zero,
            "bits": None if seen.bit_depth is None else float(seen.bit_depth), "bits_used": self.bits_used,
            "electrons": self.electrons, "photons": self.photons, "vibration": self.vibration, "peak": self.peak,
            "extent_grains": self.extent, "camera_grains": self.grains,
        }  # fmt: skip

    @property
    def bits_used(self) -> float:
        """Bits between the black level and the brightest pixel but for one in a thousand."""
        return float(np.log2(max(np.quantile(self.measured.light, 0.999), 1.0)))

    def explain(self) -> str:
        """Judgement, numbers, reasons and what was assumed, as text."""
        lines = [self.headline]
        for name, value in self.numbers.items():
            if value is not None:
                lines.append(f"  {name.replace('_', ' '):16s} {value:.4g}")
        lines += [f"{each.name}: {each.numbers}\n  remedy: {each.remedy}" for each in self.reasons]
        lines += [f"assumed: {each}" for each in self.assumed]
        lines += [f"doubt: {each}" for each in self.measured.doubts]
        return "\n".join(lines)

    def _facts(self) -> Mapping[str, object]:
        return {**super()._facts(), **{name: x for name, x in self.numbers.items() if x is not None}}

    def _draw(self, axes: Any, label: str | None = None) -> None:
        """Draw the first frame, with the judgement above."""
        frame = self.measured.images[0]
        draw_images(axes, frame[None], high=float(np.quantile(frame, 0.999)))
        axes.set_title(self.headline, fontsize="small")


@shielded()
def judge_photograph(
    photographs: Source | Measurement, *, dark: Source | float | None = None, camera: Camera | None = None
) -> PhotographVerdict:
    """Judge camera frames of a hidden object, of a setup that is not described: in seconds, nothing is simulated.

    Parameters
    ----------
    photographs
        What :func:`specklegen.measured.read_measurement` reads, or what it returned (with ``envelope="fit"``, which
        files are read with here: light that is not even passes for no speckle). Frames that correlate by 0.5 or
        more are of one pattern, whose vibration and noise they tell; others are of independent patterns.
    dark
        Frames without light, or the black level in counts.
    camera
        That took them: its gain says how many photons there are. Without it that stays open, and the rest does not need
        it.

    Raises
    ------
    RuleError
        For files that hold no grey frames of 32 x 32 pixels or more.

    Examples
    --------
    >>> import numpy as np
    >>> from specklegen.models import judge_photograph
    >>> judge_photograph(np.random.default_rng(0).poisson(200.0, (128, 128))).answer
    'no speckle'
    """
    if camera is not None:
        instance("judge_photograph camera", camera, Camera)
    seen = photographs if isinstance(photographs, Measurement) else _read(photographs, dark)
    if min(seen.light.shape[1:]) < LEAST:
        reject("judge_photograph photographs", f"of at least {LEAST} x {LEAST} pixels", seen.light.shape[1:])
    images = _middle(seen.images)
    images = images / images.mean((1, 2), keepdims=True)
    if images.std() < _EVEN:
        return _even(seen)
    frames, pairs, vibration = independent_frames(images)
    band = fit_band(frames, len(frames))
    noise = band.noise if pairs is None else pairs
    variance = max(float(frames.var((1, 2)).mean()) - noise, 0.0)
    lags = _lags(frames, noise)
    found = find_extent(lags, frames, variance)
    grain = float(np.sqrt(band.grain[0] * band.grain[1]))
    extent, far = found.whole / grain, _far(lags, band, frames)
    beside = float(lags[0, 1] + lags[1, 0]) / 2
    alike = beside / ((variance + noise) / np.sqrt(2 * frames.size))
    evidence = _evidence(frames, band, noise, variance, seen.saturated) | _wanting(variance, alike, beside / far)
    photons = None
    if camera is not None:
        offset = camera.offset if dark is None and not isinstance(photographs, Measurement) else 0.0
        photons = float((seen.light.mean() - offset) * camera.gain)
    pixels = float(np.prod(seen.images.shape[1:]))  # all of the camera, be it larger than what was looked at
    grains = float(np.sqrt(pixels / (band.grain[0] * band.grain[1])))
    bent = _bent(lags, variance, found.whole, seen.saturated)
    value, needed, reasons = _foretold(frames, band, noise, variance, extent, grains, bent, seen)
    low, high = (float(1 / (1 + np.exp(-value - side * _NINETIETH * _SCATTER))) for side in (-1, 1))
    probability = float(share(np.array(value), _SCATTER))
    against = _against(evidence)
    answer: Answer = "works" if value >= 0 else "needs frames" if needed is not None else "cannot"
    if coherent := _is_one_field(evidence, variance):
        against = (_one_field(float(np.sqrt(variance))),)
    if against:
        answer, probability, (low, high), needed, reasons = "no speckle", 0.0, (0.0, 0.0), None, against
        answer = "coherent object" if coherent else answer
    elif min(band.grain) < _RESOLVED or (band.edge < _EDGE and min(band.grain) < 1.2 * _RESOLVED):
        small = Reason("speckle too fine for the pixels", f"speckle size about {min(band.grain):.2g} pixels",
                       "a smaller aperture, a longer distance to the camera, or smaller pixels")  # fmt: skip
        reasons = (small, *reasons)
        answer, needed = ("cannot", None) if answer != "works" else (answer, needed)
    assumed = list(seen.assumed)
    if seen is photographs and seen.envelope is None:
        assumed.append('even light: this measurement was read without an envelope (envelope="fit" fits one)')
    if not against:
        assumed.append("that it is speckle: blurred noise and some pictures pass the test")
    if not against and variance > _FEW_POINTS:
        assumed.append("that it is a few points and no coherent object, whose contrast may be as high")
    assumed.append("one wavelength, one polarisation, and an object within the memory effect: otherwise "
                   "contrast is lost")
    envelope = 1.0 if seen.envelope is None else float(seen.envelope.max() / seen.envelope.min())
    return PhotographVerdict(
        answer, probability, (low, high), needed, band.grain,
        float(np.hypot(band.error, _BIAS)) if band.edge >= _EDGE else float("inf"), float(np.sqrt(variance)),
        _contrast_error(lags, frames, variance, found.seen + grain), 1 / noise if noise > 1e-9 else float("inf"),
        photons, extent, grains, variance / far, envelope, vibration, evidence, reasons, tuple(assumed), seen,
    )  # fmt: skip


def _even(seen: Measurement) -> PhotographVerdict:
    """Judgement on frames that hold nothing at all."""
    reason = Reason("an even image", "all pixels have one value", "more light, or a longer exposure")
    none = float("inf")
    return PhotographVerdict("no speckle", 0.0, (0.0, 0.0), None, (none, none), none, 0.0, 0.0, none, None, 0.0, 0.0,
                             0.0, 1.0, None, {"light": none}, (reason,), tuple(seen.assumed), seen)  # fmt: skip


def _read(photographs: Source, dark: Source | float | None) -> Measurement:
    """Frames over their envelope; without where none can be fitted."""
    try:
        return read_measurement(photographs, dark=dark, envelope="fit")
    except RuleError as error:
        if "envelope" not in str(error):
            raise
    return read_measurement(photographs, dark=dark)


def _middle(images: np.ndarray) -> np.ndarray:
    """The middle of frames float64[n, h, w] that are large."""
    rows, columns = (min(side, _SEEN) for side in images.shape[1:])
    top, left = (images.shape[1] - rows) // 2, (images.shape[2] - columns) // 2
    return images[:, top : top + rows, left : left + columns]


def independent_frames(images: np.ndarray) -> tuple[np.ndarray, float | None, float | None]:
    """Independent frames; noise of a frame and movement, pixels, where they are of one pattern and are averaged."""
    if len(images) == 1:
        return images, None, None
    flat = images - 1
    one, other = flat[:-1], flat[1:]
    found = [_movement(flat[0], each) for each in flat[1:]]
    if np.mean([alike for _, alike in found]) < _ALIKE:
        return images, None, None
    moved = [way for way, _ in found]
    still = max(abs(part) for pair in moved for part in pair) < 0.5
    apart = np.square(one - other).mean() / 2
    mean = images.mean(0, keepdims=True) if still else images[:1]
    noise = float(apart / len(images)) if still else None  # of one frame that moved it is read off its band
    return mean, noise, float(np.std([(0.0, 0.0), *moved], axis=0).max())


def _movement(first: np.ndarray, later: np.ndarray) -> tuple[tuple[float, float], float]:
    """Pixels, down and across, by which a pattern has moved, between pixels, and the correlation that it has there."""
    peak = np.fft.irfft2(np.conj(np.fft.rfft2(first)) * np.fft.rfft2(later), s=first.shape)
    at = np.unravel_index(int(np.argmax(peak)), peak.shape)
    found = []
    for axis, place in enumerate(at):
        line = np.take(peak, at[1 - axis], axis=1 - axis)
        before, middle, after = (line[(place + d) % len(line)] for d in (-1, 0, 1))
        bend = 2 * middle - before - after
        shift = 0.5 * (after - before) / bend if bend > 0 else 0.0
        found.append(float((place + shift + len(line) / 2) % len(line) - len(line) / 2))
    norm = np.sqrt(np.square(first).sum() * np.square(later).sum())
    return (found[0], found[1]), float(peak.max() / max(norm, 1e-300))


def _lags(frames: np.ndarray, noise: float) -> np.ndarray:
    """Autocovariance float64[h, w] of frames by the pairs that each lag has, noise taken off; lag 0 first."""
    rows, columns = frames.shape[1:]
    grid = [next_fast_len(2 * side, real=True) or 0 for side in (rows, columns)]
    light = frames - frames.mean((1, 2), keepdims=True)
    power = np.square(np.abs(np.fft.rfft2(light, s=grid))).mean(0)
    along = [side - np.abs(np.fft.fftfreq(n) * n) for side, n in zip((rows, columns), grid, strict=True)]
    found = np.fft.irfft2(power, s=grid) / np.maximum(np.outer(*along), 1)
    found[0, 0] -= noise
    return found


def _far(lags: np.ndarray, band: Band, frames: np.ndarray) -> float:
    """Standard deviation of far lags: of a picture, whose parts differ, larger than the scatter of speckle alone."""
    reach = min(frames.shape[1:]) // 2
    down, across = (np.abs(np.rint(np.fft.fftfreq(side) * side)) for side in lags.shape)
    inside = (down[:, None] < reach) & (across < reach)
    ring = np.hypot(down[:, None] / band.grain[0], across / band.grain[1]).astype(int)[inside]
    square = np.bincount(ring, np.square(lags)[inside]) / np.maximum(np.bincount(ring), 1)
    last = max(2, int(reach / max(band.grain)))
    return float(np.sqrt(max(np.median(square[last // 2 : last]), 1e-30)))


def _contrast_error(lags: np.ndarray, frames: np.ndarray, variance: float, reach: float) -> float:
    """Standard error of the contrast, of the lags within so many pixels: Bartlett, of speckle and its noise."""
    down, across = (np.fft.fftfreq(side) * side for side in lags.shape)
    total = float(np.square(lags[np.hypot(down[:, None], across) < reach]).sum())
    return float(np.sqrt(2 * total / frames.size) / (2 * max(np.sqrt(variance), 1e-9)))


def _foretold(
    frames: np.ndarray, band: Band, noise: float, variance: float, extent: float, grains: float, bent: float,
    seen: Measurement,
) -> tuple[float, int | None, tuple[Reason, ...]]:  # fmt: skip
    """Logarithm of the odds; frames that would do, None where none would; what stands in the way."""
    fy, fx = band.frequencies
    v, u = np.meshgrid(fy * band.grain[0], fx * band.grain[1], indexing="ij")
    passed = transfer(band.profile, v, u)
    weight = np.where((fx == 0) | (fx == 0.5), 1.0, 2.0) * np.ones_like(v)
    weight = np.where(np.hypot(fy[:, None] * frames.shape[1], fx * frames.shape[2]) < 2, 0.0, weight)
    light = band.light
    share_kept = _kept(extent)
    power = np.square(light * passed) * weight
    rough = np.sqrt((np.square((light + noise) * passed) * weight).sum() / max(power.sum(), 1e-300))
    error = rough * share_kept / grains / 2
    pixel = np.square(np.sinc(fy))[:, None] * np.square(np.sinc(fx))
    point = float((weight * passed * pixel).sum() / max((weight * passed).sum(), 1e-300))
    contrast2 = max(variance, 1e-12) / max(point, 1e-3)
    # Of exponential numbers of mean S the mean square is 2 S^2.
    signal = max(float((weight * (band.power - noise)).sum()), 1e-300)
    square = float((weight * (np.square(band.power) / 2 - 2 * noise * np.maximum(light, 0) - noise**2)).sum())
    filled = signal**2 / max(square, 1e-3 * float((weight * np.square(band.power)).sum()))
    filled /= float(max((weight * passed).sum() ** 2 / max((weight * np.square(passed)).sum(), 1e-300), 1e-300))
    k0, k1, k2 = _OBJECT
    about = k0 + k1 * np.log(1 / min(contrast2, 1.0)) + k2 * np.log(float(np.clip(filled, 1e-3, 1.0)))
    bent = COEFFICIENTS["distortion_weight"] * bent
    constant, slope = COEFFICIENTS["constant"] + about, COEFFICIENTS["residual"]
    per_frame = error / np.sqrt(len(frames))
    value = float(constant + slope * np.log(np.hypot(per_frame, bent)))
    allowed = float(np.exp(-constant / slope))
    needed = None
    if allowed > bent:
        frames_needed = (error / np.sqrt(allowed**2 - bent**2)) ** 2
        needed = int(np.ceil(frames_needed)) if frames_needed <= _MOST_FRAMES else None
    if value >= 0:
        return value, needed, ()
    reasons = []
    clean = share_kept / grains / 2
    if bent > 0.5 * allowed:
        reasons.append(Reason("saturation", f"{100 * seen.saturated:.2g} % of the pixels are saturated",
                              "a shorter exposure"))  # fmt: skip
    if error > 1.4 * clean:
        reasons.append(Reason("too few photons", f"noise as of {1 / max(noise, 1e-12):.3g} electrons a pixel",
                              "a longer exposure, or more frames of the same pattern"))  # fmt: skip
    if clean > 0.5 * allowed or not reasons:
        few = f"{grains:.0f} grains a side for an object of about {extent:.0f}"
        remedy = "a larger camera, smaller speckle, or frames through other states of the medium"
        reasons.append(Reason("too few grains", few, remedy))
    return value, needed, tuple(reasons)


def _kept(extent: float) -> float:
    """Root of the sum of squares of the lags' weights that an object of so many grains needs, in grains."""
    fine = 4
    side = extent * fine
    window = 2 * int(np.ceil(REACH * side)) + 8
    kept = taper(window, 0.85 * REACH * side, 1.2 * REACH * side).numpy()
    return float(np.sqrt(np.square(kept).sum())) / fine


def _bent(lags: np.ndarray, variance: float, extent: float, full: float) -> float:
    """Sine of the angle between modulus with and without a share of full pixels, of an object of so many pixels."""
    if full <= 1e-5:
        return 0.0
    window = min(2 * int(np.ceil(REACH * extent)) + 8, *(side - side % 2 for side in lags.shape))
    at = np.rint(np.fft.fftfreq(window) * window).astype(int)
    light = lags[np.ix_(at, at)] / max(variance, 1e-9)
    light[0, 0] = 1.0
    below = np.minimum((np.arange(1000) + 0.5) / 1000, 1 - min(full, 0.999))

    def off(log_shape: float) -> float:
        x = gamma(np.exp(log_shape), scale=np.exp(-log_shape)).ppf(below)
        return float(np.log(max(x.var(), 1e-30) / x.mean() ** 2 / max(variance, 1e-9)))

    least, most = 0.0, 9.2  # of ln shape, 1 / contrast^2 before the pixels were full
    log_shape = float(np.clip(-np.log(max(variance, 1e-9)), least, most))
    if off(least) > 0 > off(most):
        log_shape = float(root_scalar(off, bracket=(least, most)).root)
    shape = float(np.exp(log_shape))
    level = float(gamma(shape, scale=1 / shape).ppf(below[-1]))
    steps = np.linspace(0, 1, 101)  # correlation of the light, and of what full pixels leave of it
    left = saturated(np.append(1.0, steps)[None, :, None] / shape, 0.0, level)[0][0, :, 0]
    whole = np.interp(light, left[1:] / left[0], steps)
    kept = taper(window, 0.85 * REACH * extent, 1.2 * REACH * extent).numpy()
    one, other = (np.fft.fft2(each * kept).real.clip(0).ravel()[1:] for each in (whole, light.clip(0)))
    overlap = np.square(np.sqrt(one * other).sum()) / max(one.sum() * other.sum(), 1e-300)
    return float(np.sqrt(max(0.0, 1 - overlap)))


def _evidence(
    frames: np.ndarray, band: Band, noise: float, variance: float, saturated: float
) -> dict[str, float]:  # fmt: skip
    """Against speckle, in standard deviations: law of intensities, places, frequencies that stand out, edges."""
    grain = float(np.sqrt(band.grain[0] * band.grain[1]))
    light = torch.from_numpy(np.ascontiguousarray(frames))
    smooth, skewness = smoothed_moments(light, grain, noise)
    least = 2 * np.sqrt(smooth)
    cells = float(np.square(band.light.sum()) / max(np.square(band.light).sum(), 1e-300)) * len(frames)
    spread = float(np.hypot(_SKEWNESS, 0.5 * np.sqrt(6 / max(cells, 1.0)) / max(least, 1e-6)))
    rows, columns = (side // _BLOCKS for side in frames.shape[1:])
    cut = frames[:, : rows * _BLOCKS, : columns * _BLOCKS] - 1
    parts = np.square(cut.reshape(len(frames), _BLOCKS, rows, _BLOCKS, columns)).mean((0, 2, 4)).ravel()
    each = max(cells / _BLOCKS**2, 0.5)
    whole = variance + noise + 1e-12
    # Of gamma numbers, kurtosis 6 contrast^2, and of noise, pixel by pixel.
    expected = (2 + 6 * variance) * variance**2 / each + 2 * noise * (noise + 2 * variance) / (rows * columns)
    expected = expected / whole**2 + _UNEVEN**2
    y, x = np.indices((_BLOCKS, _BLOCKS)).reshape(2, -1) - (_BLOCKS - 1) / 2
    terms = np.stack([np.ones_like(x), x, y], 1)  # stray light makes contrast fall smoothly across a frame
    logs = np.log(np.maximum(parts / whole, 1e-9))
    left = logs - terms @ np.linalg.lstsq(terms, logs, rcond=None)[0]
    apart = float(np.square(left).sum() / (len(logs) - 3) / expected)
    ring = np.ones((9, 9))
    ring[3:6, 3:6] = 0
    near = convolve(np.concatenate([band.power, band.power[:, -2:0:-1]], 1), ring / ring.sum(), mode="wrap")
    ratio = band.power / (near[:, : band.power.shape[1]] + 1e-3 * band.power.mean() + 1e-30)
    fy, fx = band.frequencies
    away = np.hypot(fy[:, None] * frames.shape[1], fx * frames.shape[2]) > 4
    tall = float((ratio[away].max() * len(frames) ** 0.5 - np.log(away.sum())) / 4) if away.any() else 0.0
    return {
        "law": float(max(0.0, 1 - skewness / least) / spread) if least > 0 and saturated < 1e-3 else 0.0,
        "places": float(max(0.0, np.log(max(apart, 1e-9))) / np.hypot(np.sqrt(2 / 13), 0.5)),
        "frequencies": float(np.log1p(max(0.0, tall - 1)) / 0.5),
        "edges": _EDGES * max(0.0, sparseness(frames, grain, noise)),
    }


def _wanting(variance: float, alike: float, apart: float) -> dict[str, float]:
    """Evidence that is missing; 0 if there is enough, otherwise as much as refuses a camera frame.

    Of neighbouring pixels how alike they are over the scatter of white noise, and over that of far lags.
    """
    refusing = float(np.sqrt(_REFUSED))
    light = max(_SIGNAL / max(float(np.sqrt(variance)), _LITTLE), _ALONE / max(alike, _LITTLE))
    patches = _APART / max(apart, _LITTLE)
    return {"light": refusing * light if light > 1 else 0.0, "patches": refusing * patches if patches > 1 else 0.0}


def _is_one_field(evidence: Mapping[str, float], variance: float) -> bool:
    """Return whether frames are speckle of a single field, whose ballistic light may have edges and differ by place."""
    uneven = float(np.linalg.norm([evidence[name] for name in ("places", "edges", "patches")]))
    lawful = max(evidence["law"], evidence["frequencies"]) < _LAWFUL and not evidence["light"]
    return variance > _ONE_FIELD and lawful and uneven < _UNSMOOTH


def _one_field(contrast: float) -> Reason:
    """Say that fields have added and not intensities, and what can be done."""
    return Reason(
        "coherent object", f"contrast {contrast:.2g} is that of one field: either an object in laser light, whose "
        "autocorrelation is not that of its speckle, or a single point of light; the frame does not tell which",
        "for an object in laser light train a network on a `coherent-` recipe, as by `specklegen train coherent-digits "
        "--network unet --input camera --loss pearson` (docs/coherentobject.md); a single point, or one far brighter "
        "than the rest, has nothing to be reconstructed but its place",
    )  # fmt: skip


def _against(evidence: dict[str, float]) -> tuple[Reason, ...]:
    """Why it is no speckle; empty where it may be."""
    if evidence["light"] > 0:
        return (Reason("nothing but noise", "hardly any contrast beyond the camera's noise",
                       "more light; check that the object shines, and the black level"),)  # fmt: skip
    if evidence["patches"] > 0:
        return (Reason("too few patches", "shading or a picture fits as well as speckle",
                       "a larger camera, or smaller speckle"),)  # fmt: skip
    if float(np.square(list(evidence.values())).sum()) < _REFUSED:
        return ()
    words = {
        "law": "intensities are less skewed than those of speckle",
        "places": "parts of the frame differ more than those of speckle",
        "frequencies": "single frequencies stand out, as in a regular pattern or a picture",
        "edges": "edges between even areas, as in a picture",
    }
    worst = sorted(words, key=lambda name: -evidence[name])
    return tuple(
        Reason("no speckle", words[name], "record the speckle alone: no lens image of the scene, no stray light")
        for name in worst if evidence[name] >= 2 or name == worst[0]
    )  # fmt: skip
