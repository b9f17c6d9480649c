"""Fits of a setup to frames of its speckle: :func:`fit_setup`, of grain, aperture, contrast, noise, range.

A point of light behind a medium that scatters makes speckle whose periodogram has the mean

    S(f) = contrast^2 P(f; grain, aperture) + noise^2

P exactly that of a finite frame (:mod:`specklegen.models.likelihood.spectrum`). The frames are cut into tiles, and
Whittle's likelihood of all tiles' periodograms I, sum log S + I / S, is the greatest at the numbers that are stated; of
the shapes of an aperture, that one is stated whose likelihood is greatest. Intensities of speckle are no Gaussian
numbers: the likelihood's own curvature claims too much. Standard errors are those of its scores' scatter from tile to
tile (White, *Econometrica* 50, 1 (1982)); intervals are Student's; shapes are distinguished by the scatter of the
tiles' ratios of likelihoods (Vuong, *Econometrica* 57, 307 (1989)).

A target in place of the point has its autocorrelation in P, less and less of it at distances beyond the memory-effect
range (:mod:`specklegen.models.calibration.target_range`).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
import torch
from scipy.optimize import minimize_scalar
from scipy.stats import f, t

from specklegen.core.arguments import choice, flag, positive_number, real_number
from specklegen.core.display.plot import Pictured, with_interval
from specklegen.core.errors import counted, reject
from specklegen.measured.files import Source
from specklegen.measured.measurement import Measurement, read_measurement
from specklegen.models.calibration.material_fit import Interval
from specklegen.models.calibration.point_speckle import PointSpeckle
from specklegen.models.calibration.target_range import BOUNDS, Fall, RangeProfile, Target, decay, profile_of, target_of
from specklegen.models.likelihood.likelihood import Optics
from specklegen.models.likelihood.spectrum import transforms
from specklegen.scene.window import PROFILES, Profile, Window

_OWNER = "fit_setup"
_FINEST, _FEWEST = 0.8, 6  # grain in pixels; grains along a tile, of a grain up to twice the one guessed
_TILE, _TILES = 32, 9  # pixels along a tile at least; tiles of all frames at least
_NUMBERS = 3
_ALIKE = 0.5  # correlation of frames from which on they are of one pattern
_SURE = 2.0  # standard errors from which on shapes are told apart
_DOUBTFUL = 1e-4
_ABOVE = 4.0  # standard errors of the squared contrast
_RINGS = 4  # of frequencies, in two directions each
_EDGES = 1.15
"""Standard errors over those of independent tiles: neighbours share grains at their edges. Measured on 144 fits."""
_DARK = 3e-3  # of the largest power
_STEP = 1e-3  # of ln(grain)
_LEAST = 1e-6  # of the mean power: smallest contrast^2 and noise^2
_NEAR = 0.15  # of ln(grain): how far a range moves the grain that fits best
_MOVES = ((_STEP, 0.0), (0.0, _STEP))  # of ln(bend), power
_SCORINGS, _SETTLED = 12, 0.02  # steps at a range; of ln L, what is not worth another
_POINT = Target(torch.ones(1, 1, dtype=torch.float64), 1.0, (1, 1))


class _Seen(NamedTuple):
    """Tiles' periodograms float64[T, F] at frequencies ``used`` bool[m, n] of tiles of so many pixels, of a target."""

    power: np.ndarray
    used: np.ndarray
    rows: np.ndarray
    columns: np.ndarray
    shape: tuple[int, int]
    target: Target


class _Fitted(NamedTuple):
    """A shape, ln(grain), contrast^2, noise^2; the spectrum float64[F] and -ln L of a tile, less a constant."""

    profile: Profile
    grain: float
    lit: float
    noise: float
    spectrum: np.ndarray
    cost: float


@dataclass(frozen=True, eq=False, repr=False)
class SetupFit(Pictured):
    """Setup fitted to camera frames of speckle.

    Attributes
    ----------
    profile : str
        Shape of the aperture: "square", "disc" or "gaussian".
    grain : float
        Camera pixels in a grain, wavelength over the aperture's width in sines (of a Gaussian: 1/e^2 in intensity).
    contrast : float
        Of the speckle of one point on a pixel without area: 1 for coherent, polarised light.
    noise : float
        Standard deviation of what differs from pixel to pixel, over the mean light.
    grain_error, contrast_error, noise_error : float
        Standard errors; that of the noise of a noise of 0 is the square root of its square's.
    behind : dict[str, float]
        Of every shape, by how many standard errors it is less likely than ``profile``.
    p_value : float
        Chance of a spectrum as far from the fitted one.
    pixel_integration : bool
        Whether pixels were taken to average over their area.
    tiles : int
        Pieces of the frames whose spectra were fitted.
    measured : Measurement
        The frames.
    spectra : tuple of float64[F]
        Radial frequency in cycles a camera pixel, and the measured and the fitted power there, for the picture.
    doubts : tuple of str
        What speaks against the model, and which shapes the camera frames do not tell apart.
    range : float or None
        Of a target: camera pixels at which C_I has fallen to one half; infinite where no fall is seen. None of a point.
    ranges : RangeProfile or None
        How the likelihood falls with the range.

    Examples
    --------
    >>> import numpy as np
    >>> import specklegen as sg
    >>> rng = np.random.default_rng(0)
    >>> iris = np.hypot(*np.meshgrid(*[np.arange(-128, 128)] * 2)) < 32  # 256 / 64 = 4 pixels a grain
    >>> field = np.fft.ifft2(np.fft.ifftshift(iris * (rng.normal(size=(256, 256)) + 1j * rng.normal(size=(256, 256)))))
    >>> setup = sg.fit.fit_setup(np.abs(field) ** 2, pixel_integration=False)
    >>> setup.profile, abs(setup.grain - 4) < 0.15, abs(setup.contrast - 1) < 0.1
    ('disc', True, True)
    """

    profile: Profile
    grain: float
    grain_error: float
    contrast: float
    contrast_error: float
    noise: float
    noise_error: float
    behind: dict[str, float]
    p_value: float
    pixel_integration: bool
    tiles: int
    measured: Measurement
    doubts: tuple[str, ...]
    spectra: tuple[np.ndarray, np.ndarray, np.ndarray] = field(repr=False)
    range: float | None = None
    ranges: RangeProfile | None = field(default=None, repr=False)

    _named = {"pupil": "profile", "grain": "grain", "contrast": "contrast"}

    def interval(self, level: float = 0.95) -> dict[str, Interval]:
        """Intervals of grain, contrast and noise by name, and of a target the range, which may be open: 0 or infinity.

        Parameters
        ----------
        level
            Between 0 and 1, both excluded.
        """
        level = real_number("SetupFit.interval level", level)
        if not 0 < level < 1:
            reject("SetupFit.interval level", "between 0 and 1, both excluded", level)
        wide = float(t.ppf((1 + level) / 2, self.tiles - _NUMBERS))
        spread = np.exp(wide * self.grain_error / self.grain)
        intervals = {"grain": Interval(self.grain / spread, self.grain * spread)}
        for name, value, error in (("contrast", self.contrast, self.contrast_error),
                                   ("noise", self.noise, self.noise_error)):  # fmt: skip
            intervals[name] = Interval(max(value - wide * error, 0.0), value + wide * error)
        if self.ranges is not None:
            intervals["range"] = Interval(*self.ranges.interval(level))
        return intervals

    def memory_effect(self, distance: np.ndarray) -> np.ndarray:
        """C_I at distances on the camera, pixels, as it was fitted to a target; 1 without one.

        What ``reconstruct(memory_effect=)`` takes, where object pixels are camera pixels.
        """
        apart = np.abs(np.asarray(distance, np.float64))
        if self.ranges is None or self.range is None or not np.isfinite(self.range):
            return np.ones_like(apart)
        return decay(apart / self.range, self.ranges.fall)

    @property
    def drawn(self) -> PointSpeckle:
        """Sampler that draws camera frames of this setup."""
        noise = self.noise**2
        return PointSpeckle(self.profile, self.grain, min(self.contrast**2, 1.0), noise, self.pixel_integration)

    def optics(self, step: float) -> Optics:
        """Return the layout for a likelihood, with object pixels ``step`` camera pixels apart."""
        return Optics(step, self.grain, self.profile, self.pixel_integration)

    def _facts(self) -> Mapping[str, object]:
        bounds, facts = self.interval(), dict(super()._facts())
        for name, unit in (("grain", "pixels"), ("contrast", ""), ("noise", "of the mean light")):
            facts[name] = with_interval(getattr(self, name), bounds[name], unit)
        if self.ranges is not None and self.range is not None:
            facts["range"] = f"{self.range:.3g} pixels (95 %: {self.ranges.told(0.95)})"
        order = self.measured.envelope_order
        facts["envelope"] = "left in or given" if order is None else f"order {order}"
        others = [f"{name} fits worse by {far:.1f} standard errors" for name, far in self.behind.items()
                  if name != self.profile]  # fmt: skip
        spectrum = f"p = {self.p_value:.2g}, {counted(self.tiles, 'tile')}"
        return facts | {"other shapes": others, "spectrum": spectrum, "doubts": self.doubts}

    def _draw(self, axes: Any, label: str | None = None) -> None:
        """Mean power in rings of frequency, measured and fitted."""
        frequency, power, fitted = self.spectra
        axes.plot(frequency, power, "o", ms=4, label=label or "measured")
        axes.plot(frequency, fitted, lw=1, label=f"{self.profile}, grain {self.grain:.3g} pixels")
        axes.set(xlabel="frequency, cycles a pixel", ylabel="power", yscale="log")
        axes.legend()
        axes.grid(alpha=0.3)


def fit_setup(
    photographs: Source | Measurement, *, envelope: Source | None = "fit", dark: Source | float | None = None,
    pixel_integration: bool = True, profile: str | None = None, target: np.ndarray | None = None,
    target_step: float = 1.0,
) -> SetupFit:  # fmt: skip
    """Fit speckle size, aperture, contrast and noise to frames of one point source, or of a known target.

    Parameters
    ----------
    photographs
        What :func:`specklegen.measured.read_measurement` reads, or what it returned. Frames that correlate by 0.5 or
        more are of one pattern, and are averaged; others are taken for independent patterns.
    envelope, dark
        As there; the envelope is fitted and taken off unless given. Of a measurement that was read its own counts.
    pixel_integration
        Whether pixels collect light over their whole area.
    profile
        Shape of the aperture, where it is known: "square", "disc" or "gaussian".
    target
        What shines in place of the point, incoherent brightness real[h, w]: two slits, a letter, a test chart. Then the
        memory-effect range is fitted too, and its interval is open above where the target ends before the range does.
    target_step
        Camera pixels between cells of the target.

    Raises
    ------
    RuleError
        For frames that are too small: nine tiles in all, of 32 pixels, 12 grains and two targets a side, are needed.
        For a target of more than 128 cells a side, or without light.

    Examples
    --------
    >>> import numpy as np
    >>> import specklegen as sg
    >>> rng = np.random.default_rng(1)
    >>> fields = rng.normal(size=(2, 128, 128, 2)) @ [1, 1j]
    >>> smooth = np.exp(-(np.fft.fftfreq(128)[:, None] ** 2 + np.fft.fftfreq(128) ** 2) * 64)
    >>> light = np.abs(np.fft.ifft2(np.fft.fft2(fields) * smooth)) ** 2
    >>> setup = sg.fit.fit_setup(light, envelope=None, pixel_integration=False)
    >>> setup.profile, setup.measured.light.shape
    ('gaussian', (2, 128, 128))
    """
    flag(f"{_OWNER} pixel_integration", pixel_integration)
    if profile is not None:
        choice(f"{_OWNER} profile", profile, PROFILES)
    step = positive_number(f"{_OWNER} target_step", target_step)
    shown = _POINT if target is None else target_of(_OWNER, target, step)
    if isinstance(photographs, Measurement):
        seen = photographs
    else:
        seen = read_measurement(photographs, envelope=envelope, dark=dark)
    seen.require_speckle(f"{_OWNER} photographs")
    doubts = list(seen.doubts)
    images = seen.images
    if len(images) > 1 and (alike := _correlation(images)) >= _ALIKE:
        doubts.append(f"frames correlate by {alike:.2f}: taken for one pattern, and averaged")
        images = images.mean(axis=0, keepdims=True)
    light = images / images.mean(axis=(1, 2), keepdims=True) - 1
    shapes = PROFILES if profile is None else (profile,)
    guess = float(np.sqrt(max(_width(light) ** 2 - shown.half_width**2, 1.0)))
    tiles = _tiles(light, guess, shown)

    def fitted(tiles: _Seen) -> dict[str, _Fitted]:
        return {shape: _fitted(tiles, shape, guess, pixel_integration) for shape in shapes}  # type: ignore[arg-type]

    fits = fitted(tiles)
    ranges = None
    for _ in range(0 if target is None else 2):  # the iris first without a range, then behind the one found
        near = min(fits.values(), key=lambda each: each.cost)
        ranges = _ranges(tiles._replace(target=shown), near, pixel_integration)
        tiles = tiles._replace(target=shown.behind(ranges.best, ranges.fall))
        fits = fitted(tiles)
    best = min(fits.values(), key=lambda each: each.cost)
    behind = {name: _behind(tiles, best, each) for name, each in fits.items()}
    like = [name for name, far in behind.items() if name != best.profile and far < _SURE]
    if like:
        doubts.append(f"the aperture may also be a {' or a '.join(like)}: take more frames, or give the profile")
    slopes = _slopes(tiles, best, pixel_integration)
    covariance = _covariance(tiles, best, slopes)
    chance, rings = _misfit(tiles, best, slopes)
    if chance < _DOUBTFUL and target is not None:
        doubts.append(f"speckle of this target behind a round or square aperture does not have this spectrum (p = "
                      f"{chance:.1g})")
    elif chance < _DOUBTFUL:
        doubts.append(
            f"speckle of one point behind a round or square aperture does not have this spectrum (p = {chance:.1g}). "
            "Possible causes: an object larger than a speckle grain, another shape of the aperture, a filtered or "
            "compressed image"
        )
    if best.grain > np.log(min(tiles.shape) / _FEWEST) - 1e-3 or best.grain < np.log(_FINEST) + 1e-3:
        doubts.append("the speckle size lies at the end of the range that these frames resolve")
    contrast, noise = np.sqrt(best.lit), np.sqrt(best.noise)
    errors = np.sqrt(np.maximum(np.diag(covariance)[:_NUMBERS], 0.0))
    if best.lit - 1 > _ABOVE * errors[1]:
        doubts.append(
            f"the contrast is {contrast:.2f}, but speckle of one point has at most 1. Possible causes: another "
            "target, or "
            "an aperture in front of the medium instead of behind it"
        )
    return SetupFit(best.profile, float(np.exp(best.grain)), float(np.exp(best.grain) * errors[0]), float(contrast),
                    float(errors[1] / (2 * contrast)), float(noise),
                    float(min(errors[2] / (2 * noise) if noise else np.inf, np.sqrt(errors[2]))), behind, chance,
                    pixel_integration, len(tiles.power), seen, tuple(doubts), rings,
                    None if ranges is None else ranges.best, ranges)  # fmt: skip


def influence(images: np.ndarray, setup: PointSpeckle) -> np.ndarray:
    """Influence of each image on a fit, float64[n, 3]: ln(grain), contrast^2 and noise^2; their mean is the whole move.

    One step of Fisher's scoring from the setup, image by image; images float64[n, h, w] of any brightness.
    """
    light = images / images.mean(axis=(1, 2), keepdims=True) - 1
    tiles = _tiles(light, setup.grain)
    alone = _alone(tiles, setup.profile, np.log(setup.grain), setup.pixel_integration)
    spectrum = setup.lit * alone + setup.noise
    at = _Fitted(setup.profile, float(np.log(setup.grain)), setup.lit, setup.noise, spectrum, 0.0)
    slopes = _slopes(tiles, at, setup.pixel_integration)
    scores = (tiles.power / spectrum - 1) @ slopes.T
    return scores.reshape(len(images), -1, _NUMBERS).mean(axis=1) @ np.linalg.pinv(slopes @ slopes.T, hermitian=True)


def _correlation(images: np.ndarray) -> float:
    """Mean correlation of frames with the next."""
    flat = images.reshape(len(images), -1)
    flat = flat - flat.mean(axis=1, keepdims=True)
    norm = np.sqrt(np.square(flat).sum(axis=1))
    return float(((flat[1:] * flat[:-1]).sum(axis=1) / np.maximum(norm[1:] * norm[:-1], 1e-300)).mean())


def _width(light: np.ndarray) -> float:
    """Grain in pixels, roughly: the first lag at which the autocorrelation is below a half of that at lag 1."""
    power = np.square(np.abs(np.fft.fft2(light, axes=(1, 2)))).mean(axis=0)
    lags = np.fft.ifft2(power).real
    widths = []
    for row in (lags[0], lags[:, 0]):
        below = np.flatnonzero(row[1 : len(row) // 2] < row[1] / 2)
        widths.append(float(below[0] + 1) if len(below) and row[1] > 0.05 * row[0] else 1.0)
    return max(float(np.mean(widths)), 1.0)


def _tiles(light: np.ndarray, guess: float, target: Target = _POINT) -> _Seen:
    """Periodograms of the smallest tiles that are large enough, of twelve grains and two targets a side at least."""
    least = max(_TILE, int(np.ceil(2 * _FEWEST * guess)), int(np.ceil(2 * target.extent)))
    count, height, width = light.shape
    if min(height, width) < least or count * (height // least) * (width // least) < _TILES:
        rule = f"at least {_TILES} tiles of {least} x {least} pixels, each {2 * _FEWEST} speckle grains a side"
        reject(f"{_OWNER} photographs", rule,
               f"{counted(count, 'frame')} of {height} x {width}", "Take more or larger frames.")  # fmt: skip
    rows, columns = height // least, width // least
    tall, wide = height // rows, width // columns
    cut = light[:, : rows * tall, : columns * wide].reshape(count, rows, tall, columns, wide)
    power = np.square(np.abs(np.fft.rfft2(cut.swapaxes(2, 3).reshape(-1, tall, wide)))) / (tall * wide)
    down, across = np.rint(np.fft.fftfreq(tall) * tall), np.arange(wide // 2 + 1)
    used = (across > 0) | (down[:, None] > 0)
    used &= np.maximum(np.abs(down)[:, None], across) > 1  # what the mean and the envelope have taken
    return _Seen(power[:, used].astype(np.float64), used, down / tall, across / wide, (tall, wide), target)


def _alone(tiles: _Seen, profile: Profile, grain: float, pixel: bool) -> np.ndarray:
    """Mean periodogram float64[F] of contrast 1, the grain's logarithm given."""
    return _alone_behind(tiles, [tiles.target], profile, grain, pixel)[0]


def _alone_behind(tiles: _Seen, targets: list[Target], profile: Profile, grain: float, pixel: bool) -> np.ndarray:
    """Return the spectra float64[n, F] of a target behind media."""
    one, target = torch.ones(1, dtype=torch.float64), targets[0]
    transform = transforms(tiles.rows, tiles.columns, tiles.shape, target.shape, target.step * one,
                           float(np.exp(grain)) * one, profile, pixel)  # fmt: skip
    spectra = transform(torch.stack([each.lags for each in targets])[None])[0].numpy()[:, tiles.used]
    if pixel:  # the likelihood's P is 1 at lag 0 for any pixel: here it is less, as a pixel averages grains
        spectra = spectra * _kept(profile, float(np.exp(grain)))
    return np.maximum(spectra, 1e-12)


def _kept(profile: Profile, grain: float) -> float:
    """Variance on a pixel with area over that on a point."""
    window = Window(profile, 1.0)
    reach = 1.0 if window.sharp else 1.8
    nodes, weights = np.polynomial.legendre.leggauss(48)
    nodes, weights = reach * (nodes + 1) / 2, reach * weights / 2
    overlap = window.overlap(nodes, nodes[:, None]) * np.outer(weights, weights)
    passed = np.outer(np.sinc(nodes / grain), np.sinc(nodes / grain)) ** 2
    return float((overlap * passed).sum() / overlap.sum())


def _brightness(alone: np.ndarray, power: np.ndarray) -> tuple[float, float]:
    """Squared contrast and noise, at least 0, of greatest likelihood: Fisher's scoring."""
    scale = float(power.mean())
    design = np.stack([alone, np.ones_like(alone)], axis=1)
    least = _LEAST * scale
    at = np.array([0.9 * power.mean() / alone.mean(), 0.1 * np.quantile(power, 0.1)])
    for _ in range(40):
        weight = design / np.square(design @ at)[:, None]
        new = np.linalg.lstsq(design.T @ weight, weight.T @ power, rcond=None)[0]
        if new[1] < 0:
            new = np.array([(weight[:, 0] * power).sum() / (weight[:, 0] * alone).sum(), 0.0])
        new = np.maximum(new, [least, 0.0])
        done = np.abs(new - at).max() < 1e-7 * scale
        at = new
        if done:
            break
    return float(at[0]), float(max(at[1], least * 1e-3))


def _at(tiles: _Seen, profile: Profile, grain: float, pixel: bool) -> _Fitted:
    """The likeliest brightness and noise at a grain."""
    return _with_brightness(profile, grain, _alone(tiles, profile, grain, pixel), tiles.power.mean(axis=0))


def _with_brightness(profile: Profile, grain: float, alone: np.ndarray, power: np.ndarray) -> _Fitted:
    """Return that of a mean periodogram of contrast 1, from the mean over tiles."""
    lit, noise = _brightness(alone, power)
    spectrum = lit * alone + noise
    return _Fitted(profile, grain, lit, noise, spectrum, float((np.log(spectrum) + power / spectrum).sum()))


def _ranges(tiles: _Seen, near: _Fitted, pixel: bool) -> RangeProfile:
    """Profile likelihood of the range, with the grain fitted near its present estimate."""
    count, power = len(tiles.power), tiles.power.mean(axis=0)

    def quick(targets: list[Target]) -> np.ndarray:
        alone = _alone_behind(tiles, targets, near.profile, near.grain, pixel)
        return np.array([count * _with_brightness(near.profile, near.grain, each, power).cost for each in alone])

    def fitted(reach: float, fall: Fall) -> tuple[float, Fall, np.ndarray]:
        return _falling(tiles, power, near, pixel, reach, fall)

    def scatter(first: np.ndarray, second: np.ndarray) -> float:
        expected = float(np.square(first / second - 1).sum())
        ratio = (tiles.power * (1 / second - 1 / first)).sum(axis=1)
        return max(1.0, _EDGES**2 * float(ratio.var(ddof=1)) / expected) if expected else 1.0

    return profile_of(tiles.target, quick, fitted, scatter, count)


def _falling(
    tiles: _Seen, power: np.ndarray, near: _Fitted, pixel: bool, reach: float, fall: Fall
) -> tuple[float, Fall, np.ndarray]:
    """-ln L of all tiles, fall and spectrum of greatest likelihood at a range: damped scoring, within bounds."""
    low, high = np.array([(near.grain - _NEAR, near.grain + _NEAR), *BOUNDS]).T
    at = np.clip([near.grain, np.log(fall.bend), fall.power], low + 1e-3, high - 1e-3)

    def alone(values: np.ndarray, moved: Sequence[tuple[float, float]] = ()) -> np.ndarray:
        """Spectra at a grain, of the fall and of others beside it."""
        bends = [values[1:], *(values[1:] + np.array(step) for step in moved)]
        behind = [tiles.target.behind(reach, Fall(np.exp(bend), power)) for bend, power in bends]
        return _alone_behind(tiles, behind, near.profile, float(values[0]), pixel)

    def bright(values: np.ndarray, one: np.ndarray) -> _Fitted:
        return _with_brightness(near.profile, float(values[0]), one, power)

    damping = 1e-3
    here, *beside = alone(at, _MOVES)
    best = bright(at, here)
    for _ in range(_SCORINGS):
        wider = alone(at + [_STEP, 0.0, 0.0])[0]
        slopes = best.lit / best.spectrum * np.stack([wider - here, *(each - here for each in beside)]) / _STEP
        plain = np.stack([here, np.ones_like(here)]) / best.spectrum
        score = slopes @ (power / best.spectrum - 1)
        free = ~((at <= low) & (score < 0) | (at >= high) & (score > 0))
        both = np.concatenate([slopes[free], plain * [[best.lit], [1.0]]])
        square = both @ both.T
        step = np.zeros(3)
        gain = 0.0
        while damping < 1e6:
            damped = square + damping * np.diag(np.diag(square))
            step[free] = np.linalg.lstsq(damped, both @ (power / best.spectrum - 1), rcond=1e-12)[0][: free.sum()]
            new = np.clip(at + step, low, high)
            there, *beyond = alone(new, _MOVES)
            candidate = bright(new, there)
            gain = len(tiles.power) * (best.cost - candidate.cost)
            if gain > 0:
                at, here, beside, best = new, there, beyond, candidate
                damping = max(damping / 10, 1e-6)
                break
            damping *= 10
        if gain < _SETTLED:
            break
    return len(tiles.power) * best.cost, Fall(float(np.exp(at[1])), float(at[2])), best.spectrum


def _fitted(tiles: _Seen, profile: Profile, guess: float, pixel: bool) -> _Fitted:
    def at(grain: float) -> _Fitted:
        return _at(tiles, profile, grain, pixel)

    low, high = np.log(_FINEST), np.log(min(tiles.shape) / _FEWEST)
    scan = np.linspace(max(low, np.log(guess) - 1.2), min(high, np.log(guess) + 1.2), 13)
    costs = [at(grain).cost for grain in scan]
    near = int(np.argmin(costs))
    ends = (scan[max(near - 1, 0)], scan[min(near + 1, len(scan) - 1)])
    minimum = minimize_scalar(lambda grain: at(grain).cost, bounds=ends, method="bounded", options={"xatol": 1e-4})
    return at(float(minimum.x))


def _behind(tiles: _Seen, best: _Fitted, other: _Fitted) -> float:
    """Standard errors of the mean likelihood ratio by which another shape is less likely."""
    if other is best:
        return 0.0
    ratio = (np.log(other.spectrum / best.spectrum) + tiles.power * (1 / other.spectrum - 1 / best.spectrum)).sum(
        axis=1
    )
    return float(ratio.mean() / (ratio.std(ddof=1) / np.sqrt(len(ratio))))


def _slopes(tiles: _Seen, best: _Fitted, pixel: bool) -> np.ndarray:
    """Derivatives float64[3 or 6, F] of ln S by ln(grain), contrast^2, noise^2; of a target ln(range), bend, power."""
    target = tiles.target

    def by(**moved: float) -> np.ndarray:
        given = {"grain": best.grain, "reach": np.log(target.reach), **_named(target.fall)} | moved
        behind = target.behind(np.exp(given["reach"]), Fall(np.exp(given["bend"]), given["power"]))
        return _alone(tiles._replace(target=behind), best.profile, given["grain"], pixel)

    at = {"grain": best.grain}
    if np.isfinite(target.reach):
        at |= {"reach": float(np.log(target.reach)), **_named(target.fall)}
    first, *others = (
        best.lit * (by(**{name: value + _STEP}) - by(**{name: value - _STEP})) / (2 * _STEP)
        for name, value in at.items()
    )
    return np.stack([first, by(), np.ones_like(first), *others]) / best.spectrum


def _named(fall: Fall) -> dict[str, float]:
    return {"bend": float(np.log(fall.bend)), "power": fall.power}


def _covariance(tiles: _Seen, best: _Fitted, slopes: np.ndarray) -> np.ndarray:
    """Covariance float64[k, k] of what the slopes are by: ln(grain), contrast^2, noise^2 and so on."""
    scores = (tiles.power / best.spectrum - 1) @ slopes.T
    count = len(scores)
    curvature = np.linalg.pinv(count * slopes @ slopes.T, hermitian=True)
    return _EDGES**2 * curvature @ (scores.T @ scores * count / (count - len(slopes))) @ curvature


def _hotelling(left: np.ndarray) -> float:
    """Chance of means of columns float64[tiles, k] as far from 0, if tiles share no more than grains at their edges."""
    count, degrees = left.shape
    if not 0 < degrees < count:
        return 1.0
    mean = left.mean(axis=0)
    square = count * mean @ np.linalg.solve(np.cov(left.T).reshape(degrees, degrees), mean) / _EDGES**2
    return float(f.sf(square * (count - degrees) / (degrees * (count - 1)), degrees, count - degrees))


def _misfit(tiles: _Seen, best: _Fitted, slopes: np.ndarray) -> tuple[float, tuple[np.ndarray, np.ndarray, np.ndarray]]:
    """Chance of a spectrum as far from the fitted one; frequencies, power and fitted power in rings."""
    v, u = np.broadcast_arrays(tiles.rows[:, None], tiles.columns)
    frequency = np.hypot(v, u)[tiles.used]
    steep = (np.abs(v) > np.abs(u))[tiles.used]
    reach = min(1.2 / np.exp(best.grain), 0.5)
    rings = int(np.clip(len(tiles.power) // 6, 2, _RINGS))
    lit = best.spectrum > _DARK * best.spectrum.max()  # below is what the edges of tiles let through
    place = 2 * np.minimum((frequency / reach * rings).astype(int), rings) + steep
    bins = np.stack([(place == n) & lit for n in range(2 * rings + 2)], axis=1).astype(np.float64)
    bins = bins[:, bins.sum(axis=0) >= 4]
    bins /= bins.sum(axis=0)
    # Hotelling's test of what no change of the fitted numbers makes.
    moved, *_ = np.linalg.svd(bins.T @ slopes.T)
    chance = _hotelling((tiles.power / best.spectrum - 1) @ bins @ moved[:, len(slopes) :])
    ring = np.minimum((frequency / reach * _RINGS).astype(int), _RINGS)
    rings = [n for n in np.unique(ring) if (ring == n).any()]
    seen = tiles.power.mean(axis=0)
    table = np.array([[each[ring == n].mean() for n in rings] for each in (frequency, seen, best.spectrum)])
    return chance, (table[0], table[1], table[2])
