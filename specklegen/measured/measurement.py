"""Camera frames with what belongs to them: black level, flat field, envelope, hot pixels, region, bits, saturation."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from specklegen.core.arguments import flag, real_number, whole_number
from specklegen.core.display.plot import Pictured, draw_images
from specklegen.core.display.repr import summary
from specklegen.core.errors import counted, reject
from specklegen.core.file_limits import MOST_PIXELS
from specklegen.instrument.hot_pixels import filled, hot_among_neighbours, hot_in_dark
from specklegen.measured.counts import found_range
from specklegen.measured.envelope import fit_envelope
from specklegen.measured.files import Source, read_raw
from specklegen.measured.region import LEAST, Region, given_region, lit_region

_FIELD = "read_measurement"
_MANY = 0.01  # share of pixels that are saturated, at 0 or not good, from which on there is a doubt
_REACH = 1e6  # spreads of the counts: beyond, differences of the light would be rounding
_EVEN = 1e-6  # contrast that is rounding, whatever the camera
_NOT_LIGHT = ("dark", "flat", "background", "bias")


@dataclass(frozen=True, eq=False, repr=False)
class Measurement(Pictured):
    """Camera frames, ready to be used, and what had to be assumed of them.

    Attributes
    ----------
    light : ndarray
        float64[n, h, w], counts above the black level, over the flat field; pixels that are not good have the mean of
        their neighbours.
    good : ndarray
        bool[h, w]; False of hot pixels, of those without light in the flat field, and of those that are not finite.
    envelope : ndarray or None
        float64[h, w] of mean 1; None where none was given or asked for.
    envelope_order : int or None
        Degree of a fitted one; None of another.
    envelope_error : float or None
        Standard error of the fitted one's root mean square, relative; None of another.
    region : Region
        Rows and columns of the file's frames that are kept.
    bit_depth : int or None
    saturation : float or None
        Raw number at which pixels saturate; None where none is known.
    saturated, at_zero : float
        Shares of all pixels in the region at ``saturation`` or above, and at 0 or below.
    hot : int
        Hot pixels in the region.
    files : tuple of str
    assumed, doubts : tuple of str
        What was taken for granted, and what looks wrong, though not so much that it is refused.

    Examples
    --------
    >>> import numpy as np
    >>> from specklegen.measured import read_measurement
    >>> counts = np.random.default_rng(0).poisson(200.0, (4, 32, 48)).astype(np.uint16)
    >>> measured = read_measurement(counts, dark=10.0, region=(0, 0, 32, 32), bit_depth=12)
    >>> measured.light.shape, measured.bit_depth, measured.saturated
    ((4, 32, 32), 12, 0.0)
    """

    light: np.ndarray
    good: np.ndarray
    envelope: np.ndarray | None
    envelope_order: int | None
    envelope_error: float | None
    region: Region
    bit_depth: int | None
    saturation: float | None
    saturated: float
    at_zero: float
    hot: int
    files: tuple[str, ...]
    assumed: tuple[str, ...]
    doubts: tuple[str, ...]

    @property
    def images(self) -> np.ndarray:
        """Light over its envelope, float64[n, h, w]; the light itself where there is none."""
        return self.light if self.envelope is None else self.light / self.envelope

    def require_speckle(self, field: str) -> None:
        """Refuse frames whose pixels are all alike: constant, saturated, or of one bright pixel that is not good."""
        images = self.images
        even = int((images.std((1, 2)) < _EVEN * np.abs(images.mean((1, 2)))).sum())
        if even:
            reject(field, "of speckle", f"{even} of {counted(len(images), 'frame')} without contrast",
                   "All pixels are equal: check that the light is on, and that the camera is "
                   "not saturated.")  # fmt: skip

    def explain(self) -> str:
        """Say what was read, found, assumed and doubted, a line each."""
        numbers = [f"{name}: {value}" for name, value in self._numbers().items()]
        lists = [
            f"{word}: {line}" for word, lines in (("assumed", self.assumed), ("doubt", self.doubts)) for line in lines
        ]
        return "\n".join(numbers + lists)

    def __repr__(self) -> str:
        return summary(self, ("light", "doubts"))

    def _numbers(self) -> dict[str, object]:
        frames, height, width = self.light.shape
        files = f" from {self.files[0]}" + (" and others" if len(self.files) > 1 else "") if self.files else ""
        envelope = "left in" if self.envelope is None else "as given"
        if self.envelope_order is not None:
            envelope = f"fitted, order {self.envelope_order}, ± {100 * (self.envelope_error or 0):.2g} % rms"
        limit = "" if self.saturation is None else f" at {self.saturation:g}"
        return {
            "frames": f"{frames} of {height} x {width} pixels{files}",
            "region": f"from row {self.region.top}, column {self.region.left}",
            "bits": "unknown" if self.bit_depth is None else self.bit_depth,
            "saturated": f"{100 * self.saturated:.3g} % of pixels{limit}",
            "at zero": f"{100 * self.at_zero:.3g} % of pixels",
            "not good": f"{counted(int((~self.good).sum()), 'pixel')}, {self.hot} of them hot",
            "envelope": envelope,
        }

    def _facts(self) -> Mapping[str, object]:
        return self._numbers() | {"assumed": self.assumed, "doubts": self.doubts}

    def _draw(self, axes: Any, label: str | None = None) -> None:
        """First frames, side by side."""
        draw_images(axes, self.images[:4], [str(n) for n in range(min(4, len(self.light)))])


def read_measurement(
    source: Source, *, dark: Source | float | None = None, flat: Source | None = None, envelope: Source | None = None,
    region: str | Sequence[int] | None = None, frames: int | slice | Sequence[int] | None = None,
    variable: str | None = None, bit_depth: int | None = None, hot_pixels: bool = True,
) -> Measurement:  # fmt: skip
    """Read what a camera saw.

    Parameters
    ----------
    source
        A folder, a file, a pattern such as ``"run1/*.tif"``, several of them, or an array [h, w] or [n, h, w]. TIFF of
        one or many pages, PNG, BMP, NPY; HDF5 (extra ``hdf5``); MATLAB, whose last axis numbers the frames.
    dark
        Frames without light, or the black level in counts.
    flat
        Frames of even light, by which the pixels' own sensitivity is divided out; by default it is taken for even.
    envelope
        ``"fit"``, or an image [h, w] of the light's envelope, by which ``images`` are divided; by default they are not.
    region
        ``(top, left, height, width)`` in pixels, or ``"find"``: the largest rectangle that is lit. By default all of
        it.
    frames
        Number, numbers or slice of the frames to keep; by default all.
    variable
        Name of the array in an HDF5 or MATLAB file that has several; of one that has one it may be left out.
    bit_depth
        Bits of the camera's converter, where they are known.
    hot_pixels
        Whether hot pixels are looked for, in the dark frames, or else among their neighbours.

    Raises
    ------
    RuleError
        If a file cannot be read, or something does not fit the frames.
    ImportError
        If a file needs a library that is not installed.

    Examples
    --------
    >>> import numpy as np
    >>> from specklegen.measured import read_measurement
    >>> beam = np.exp(-np.square(np.linspace(-1, 1, 96))) * np.ones((96, 1))
    >>> speckle = np.random.default_rng(0).exponential(size=(8, 96, 96))
    >>> measured = read_measurement(np.rint(500 * beam * speckle), envelope="fit")
    >>> measured.envelope_order, bool(abs(measured.envelope / beam * beam.mean() - 1).max() < 0.1)
    (2, True)
    """
    if variable is not None and not isinstance(variable, str):
        reject(f"{_FIELD} variable", "the name of an array in the file", variable)
    flag(f"{_FIELD} hot_pixels", hot_pixels)
    read = read_raw(f"{_FIELD} source", source, variable)
    raw = read.frames if frames is None else read.frames[_numbers(frames, len(read.frames))]
    shape = (raw.shape[1], raw.shape[2])
    if min(shape) < LEAST:
        reject(f"{_FIELD} source", f"frames of at least {LEAST} x {LEAST} pixels", shape)
    if raw.size > MOST_PIXELS:
        reject(f"{_FIELD} source", f"of at most {MOST_PIXELS} pixels in all", raw.size, "Choose some with frames=.")
    good = np.asarray(np.isfinite(raw).all(axis=0))
    if not good.any():
        reject(f"{_FIELD} source", "frames with finite numbers", "a frame without")
    assumed, doubts = list(read.notes), []
    converter = found_range(raw, bit_depth, _FIELD)
    assumed += converter.assumed
    doubts += converter.doubts
    if not good.all():
        doubts.append(f"{counted(int((~good).sum()), 'pixel')} not finite (NaN or infinite): left out")
    named = [file for file in read.files if any(word in file.lower().rpartition("/")[2] for word in _NOT_LIGHT)]
    if named:
        doubts.append(f"the name of {named[0]} suggests a dark or flat frame, but it was read as a light frame")

    light = np.where(good, raw, 0).astype(np.float64)
    level, hot = _black(dark, raw, good, assumed)
    light -= level
    if flat is not None:
        gain, good = _flat(flat, level, good, doubts)
        light /= gain
    kept = lit_region(light.mean(0), good, _FIELD) if isinstance(region, str) and region == "find" else (
        Region(0, 0, *shape) if region is None else given_region(region, shape, _FIELD)
    )  # fmt: skip
    raw, light, good = (kept.of(each) for each in (raw, light, good))
    if hot_pixels:
        if hot is None:
            hot = hot_among_neighbours(np.where(good, light.mean(0), np.median(light)))
            assumed.append("hot pixels: from their neighbours, since there are no dark frames")
        else:
            hot = kept.of(hot)
    hot = np.zeros_like(good) if hot is None or not hot_pixels else hot & good
    good = good & ~hot
    if not good.any():
        reject(f"{_FIELD} source", "frames with good pixels", "none")
    light = filled(light, good)
    if not light[:, good].mean() > 0:
        reject(f"{_FIELD} source", "brighter than the black level", float(light[:, good].mean()))
    saturated = 0.0 if converter.largest is None else float((raw[:, good] >= converter.largest).mean())
    at_zero = float((raw[:, good] <= 0).mean())
    doubts += [
        f"{100 * share:.2g} % of pixels {what}" for share, what in (
            (saturated, "saturated: bright speckle is clipped, so the contrast is too low"),
            (at_zero, "at 0: the black level may be clipped"),
            (float((~good).mean()), "are not good"),
        ) if share > _MANY
    ]  # fmt: skip
    shape_of_light, order, error = _envelope(envelope, light, good, kept, shape, assumed)
    return Measurement(light, good, shape_of_light, order, error, kept, converter.bit_depth, converter.largest,
                       saturated, at_zero, int(hot.sum()), read.files, tuple(assumed), tuple(doubts))  # fmt: skip


def _numbers(frames: int | slice | Sequence[int], total: int) -> np.ndarray:
    """Numbers of the frames that are kept."""
    if isinstance(frames, slice):
        try:
            chosen = np.arange(total)[frames]
        except (TypeError, ValueError):
            reject(f"{_FIELD} frames", "a slice of whole numbers", frames)
    else:
        several: Any = frames if isinstance(frames, list | tuple | range) or np.ndim(frames) == 1 else [frames]
        chosen = np.array([whole_number(f"{_FIELD} frames", each, 0, total - 1) for each in several], int)
    if not len(chosen):
        reject(f"{_FIELD} frames", f"some of the {total} frames", frames)
    return chosen


def _mean_of(what: str, source: Source, shape: tuple[int, ...]) -> np.ndarray:
    """Frames[n, h, w], finite, of the shape of those of the light."""
    frames = read_raw(f"{_FIELD} {what}", source).frames
    if frames.shape[1:] != shape:
        reject(f"{_FIELD} {what}", f"of {shape[0]} x {shape[1]} pixels, as the frames", frames.shape[1:])
    if not np.isfinite(frames).all():
        reject(f"{_FIELD} {what}", "finite everywhere", f"{int((~np.isfinite(frames)).sum())} pixels NaN or infinite")
    return frames.astype(np.float64)


def _black(
    dark: Source | float | None, raw: np.ndarray, good: np.ndarray, assumed: list[str]
) -> tuple[np.ndarray | float, np.ndarray | None]:
    """Black level, a number or [h, w], and hot pixels where dark frames show them."""
    least = float(raw[:, good].min())
    if dark is None:
        assumed.append(f"black level 0, since there are no dark frames; the smallest count is {least:g}")
        return 0.0, None
    mean = float(raw[:, good].mean())
    hot = None
    if isinstance(dark, int | float | np.number):
        level = real_number(f"{_FIELD} dark", dark)
        if not np.isfinite(level):
            reject(f"{_FIELD} dark", "finite", dark)
    else:
        taken = _mean_of("dark", dark, raw.shape[1:])
        level, hot = taken.mean(axis=0), hot_in_dark(taken)
    if np.mean(level) >= mean:
        reject(f"{_FIELD} dark", f"darker than the frames, of mean {mean:.4g}", float(np.mean(level)))
    spread = float(np.ptp(raw[:, good]))
    if spread and np.abs(level).max() > _REACH * spread:
        reject(f"{_FIELD} dark", f"a level near the counts, which differ by {spread:.4g}", float(np.abs(level).max()),
               "The difference would be a rounding error: give the level in counts.")  # fmt: skip
    return level, hot


def _flat(
    flat: Source, level: np.ndarray | float, good: np.ndarray, doubts: list[str]
) -> tuple[np.ndarray, np.ndarray]:
    """Sensitivity of pixels [h, w], of mean 1, and which of them are good."""
    taken = _mean_of("flat", flat, good.shape)
    top = found_range(taken, None, f"{_FIELD} flat").largest
    if top is not None and (taken >= top).mean() > _MANY:
        doubts.append(f"{100 * (taken >= top).mean():.2g} % of the flat field saturated")
    seen = taken.mean(axis=0) - level
    lit = good & (seen > 0)
    if lit.mean() < 0.5:
        reject(f"{_FIELD} flat", "brighter than the black level", float(seen.mean()),
               "Check that it is a frame under even light.")
    return np.where(lit, seen / seen[lit].mean(), 1.0), lit


def _envelope(
    given: Source | None, light: np.ndarray, good: np.ndarray, kept: Region, shape: tuple[int, int], assumed: list[str]
) -> tuple[np.ndarray | None, int | None, float | None]:
    """Envelope [h, w] of mean 1 in the region; order and error of a fitted one."""
    if given is None:
        return None, None, None
    if isinstance(given, str) and given == "fit":
        fitted = fit_envelope(light.mean(axis=0), good, _FIELD)
        assumed.append("envelope: a polynomial of its logarithm; an object as wide as the frame would be part of it")
        return fitted
    seen = kept.of(_mean_of("envelope", given, shape).mean(axis=0))
    if not (seen > 0).all():
        reject(f"{_FIELD} envelope", "greater than 0 everywhere in the region", float(seen.min()))
    return seen / seen.mean(), None, None
