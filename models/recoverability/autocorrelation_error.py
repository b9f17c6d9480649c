"""Error of the autocorrelation that a camera measures, before any retrieval: from the scene alone, nothing fitted.

The autocorrelation of one image comes from a camera of N x N pixels; only the lags under a window g are kept. Its
transform at frequency f averages ``N^2 / sum g^2`` independent cells of a periodogram, whose relative spread is 1 each,
so

    rms error of the power  =  S(f) sqrt(sum_l g(l)^2 / (F N^2)),       S = speckle + camera noise

for F frames. The *noise* is half of its norm over that of the power that is used: half, because the modulus is the
root of the power. For a square window of side W, g = 1 and no camera noise it is W / (2N). Division by C_I makes g
larger where C_I is small, which is its price. Without it C_I bends the autocorrelation instead, and so do an envelope
of the light that is left in or divided out with a mean over too short a distance, and saturated pixels: *distortion*
is the sine of the angle between the modulus and the object's.

Lengths are in grains (wavelength / window width); computed on a grid of three points a grain. Object pixels shine from
where they are, between the points of the grid too: their spectrum is summed, which is exact inside the window's band.
Sources: Katz et al., Nature Photonics 8, 784 (2014); Bar et al. 2019, section 6; Priestley, *Spectral Analysis and
Time Series* (1981), section 6.2 (the spread of a smoothed periodogram).
"""

from typing import Annotated, NamedTuple, Self

import numpy as np
from pydantic import Field, model_validator
from scipy import stats
from scipy.special import eval_genlaguerre, gammaln

from specklegen.core.errors import reject
from specklegen.core.values import Array, NonNegative, Positive, UnitInterval, Value
from specklegen.models.retrieval.apodisation import transfer_function
from specklegen.models.retrieval.autocorrelation import FLOOR, distances, lags, ring, taper
from specklegen.scene.window import Profile

GRID = 3
"""Points a grain."""
REACH = 1.2
"""Longest lag kept, in sides of the object's frame: between the side and the diagonal."""
_ORDERS = 12  # of Laguerre polynomials: what is left of a clipped intensity is in the first few
_NODES = 1000
_STEPS = 256  # along the camera, for its envelope
_ABOVE = Annotated[float, Field(gt=0)]  # infinity allowed


class Conditions(Value):
    """Quantities that decide whether objects can be retrieved. Lengths in grains, intensities over their mean.

    Parameters
    ----------
    objects
        Examples of the objects, brightness float[n, h, w].
    object_pitch
        Grains between object pixels.
    memory_effect
        C_I at distances of 0, 1, 2, ... object pixels, float[m]; beyond, the last value.
    camera
        Side of the camera (of a square of its area).
    frames
        Images of the object through as many independent states of the medium.
    contrast
        What polarisation and bandwidth leave of the contrast of one point's speckle.
    electrons
        Photo-electrons a grain, where the beam is brightest; background, dark and read noise reduce them to the
        electrons of equal noise.
    saturation
        Intensity at which a pixel saturates.
    beam
        Sigma of a Gaussian envelope over the camera, in camera sides.
    removal
        Sigma of the mean that the envelope is divided out with, in camera sides; 0 where it is left in.
    compensation
        Whether the autocorrelation is divided by C_I.
    profile
        Shape of the window.
    """

    objects: Array
    object_pitch: Positive
    memory_effect: Array
    camera: Positive
    frames: Annotated[float, Field(ge=1)] = 1.0
    contrast: Annotated[UnitInterval, Field(gt=0)] = 1.0
    electrons: _ABOVE = float("inf")
    saturation: _ABOVE = float("inf")
    beam: _ABOVE = float("inf")
    removal: NonNegative = 0.0
    compensation: bool = True
    profile: Profile = "square"

    @model_validator(mode="after")
    def _check(self) -> Self:
        shape = self.objects.shape
        if len(shape) != 3 or not self.objects.size or (self.objects < 0).any() or not self.objects.any((1, 2)).all():
            reject("Conditions.objects", "of shape [n, h, w], at least 0, none of them dark", shape)
        c_i = self.memory_effect
        if c_i.ndim != 1 or not c_i.size or c_i[0] != 1 or (c_i < 0).any() or (c_i > 1).any():
            reject("Conditions.memory_effect", "of shape [m], from 0 to 1, first 1", c_i)
        return self

    @property
    def side(self) -> float:
        """Longer side of the objects' frame, grains."""
        return self.object_pitch * max(self.objects.shape[1:])


class Residual(NamedTuple):
    """Relative errors, means over the objects, and how much there is to retrieve.

    Attributes
    ----------
    noise : float
        Of the modulus, from the few grains and the few photons.
    distortion : float
        From what bends the autocorrelation: sine of the angle between the modulus and the object's.
    complexity : float
        Bright grains of the diffraction-limited object: (sum t)^2 / sum t^2, over that of one point.
    bright_area : float
        Grains where that is brighter than half of its peak: fewer than the bright grains where points overlap, or are
        uneven; more inside solid shapes.
    window_over_camera : float
        W / (2N), W the side of a square as large as the kept lags, before any division: the noise to expect of plain
        autocorrelation with all the photons one could wish for.
    """

    noise: float
    distortion: float
    complexity: float
    bright_area: float
    window_over_camera: float


class _Light(NamedTuple):
    """Light of a scene on the grid.

    Attributes
    ----------
    side : int
        Of the objects' frame, points.
    objects : complex[n, W, W]
        Spectra of the objects.
    passed : float[W, W]
        The window's transfer function.
    c_i : float[W, W]
        C_I at every lag.
    wanted, seen : float[n, W, W]
        Power spectrum of the object through the window; autocovariance of its image over the squared mean.
    """

    side: int
    objects: np.ndarray
    passed: np.ndarray
    c_i: np.ndarray
    wanted: np.ndarray
    seen: np.ndarray


def _light(conditions: Conditions) -> _Light:
    side = int(np.rint(conditions.object_pitch * GRID * (max(conditions.objects.shape[1:]) - 1))) + 1
    window = lag_size(side)
    objects = _spectra(conditions, window)
    steps = conditions.object_pitch * GRID * np.arange(len(conditions.memory_effect))
    c_i = np.interp(distances(window), steps, conditions.memory_effect)
    passed = transfer_function(window, GRID, conditions.profile).numpy()
    spectrum = np.abs(objects / objects[:, :1, :1]) ** 2
    peak = passed.mean()  # of P at lag 0, where its transform is 1 at frequency 0
    seen = np.fft.ifft2(np.fft.fft2(np.fft.ifft2(spectrum).real * c_i) * passed).real / peak
    return _Light(side, objects, passed, c_i, spectrum * passed / peak, conditions.contrast**2 * seen)


def lag_size(side: int) -> int:
    """Side of the window of lags, in pixels, for objects of so many pixels a side at three pixels a grain."""
    return 2 * int(np.ceil(REACH * side + 2 * GRID))


def speckle_contrast(conditions: Conditions) -> np.ndarray:
    """Contrast of the image of each object, float[n]; of the light alone, without camera and envelope."""
    return np.sqrt(_light(conditions).seen[:, 0, 0])


def residual(conditions: Conditions) -> Residual:
    """Predict the error of the modulus from the scene alone: nothing is fitted here."""
    side, objects, passed, c_i, ideal, seen = _light(conditions)
    window = len(passed)
    kept = taper(window, 0.85 * REACH * side, 1.2 * REACH * side).numpy()
    measured, noise = saturated(seen, GRID**2 / conditions.electrons, conditions.saturation)
    left = _envelope(conditions)
    total = np.abs(np.fft.fft2(measured)) + noise[:, None, None] * left.noise**2
    measured = _enveloped(measured, left.light, conditions)
    weights = kept / np.maximum(c_i, FLOOR) if conditions.compensation else kept

    wanted = np.fft.fft2(np.fft.ifft2(ideal).real * kept).real.clip(0) * passed
    power = np.fft.fft2(measured * weights).real.clip(0) * passed
    in_use = np.square(np.square(left.light).mean()) / np.mean(left.light**4)
    pixels = in_use**2 * conditions.frames * (GRID * conditions.camera) ** 2
    error = total * passed * np.sqrt(np.square(weights).sum() / pixels)
    for each in (wanted, power, error):
        each[:, 0, 0] = 0.0  # an even brightness scores nothing
    noisy = np.square(error).sum((1, 2)) / np.maximum(np.square(power).sum((1, 2)), 1e-300)
    shown = np.fft.ifft2(objects * passed).real
    overlap = np.square(np.sqrt(wanted * power).sum((1, 2)))
    overlap /= np.maximum(wanted.sum((1, 2)) * power.sum((1, 2)), 1e-300)
    bright = (shown > 0.5 * shown.max((1, 2), keepdims=True)).sum((1, 2)) / GRID**2
    return Residual(
        noise=float(np.sqrt(np.minimum(noisy, 1e4)).mean() / 2),
        distortion=float(np.sqrt((1 - overlap).clip(0, 1)).mean()),
        complexity=float(np.exp(np.log(_bright_grains(shown, passed)).mean())),
        bright_area=float(np.exp(np.log(bright).mean())),
        window_over_camera=float(np.sqrt(np.square(kept).sum() / pixels) / 2),
    )


def _spectra(conditions: Conditions, window: int) -> np.ndarray:
    """Spectra of the objects on the grid's frequencies, complex128[n, W, W]: pixels shine as points."""
    turns = np.fft.fftfreq(window) * conditions.object_pitch * GRID
    down, across = (np.exp(-2j * np.pi * np.outer(turns, np.arange(n))) for n in conditions.objects.shape[1:])
    return down @ conditions.objects @ across.T


def _bright_grains(shown: np.ndarray, passed: np.ndarray) -> np.ndarray:
    spread = np.fft.ifft2(passed).real
    return np.square(shown.sum((1, 2))) / np.square(shown).sum((1, 2)) * np.square(spread).sum() / spread.sum() ** 2


def saturated(seen: np.ndarray, noise: float, level: float) -> tuple[np.ndarray, np.ndarray]:
    """Autocovariance over the squared mean, and the noise's, of intensities that are cut off at ``level``.

    The intensity of n uncorrelated patterns has a gamma distribution of shape n = 1 / contrast^2. In Laguerre
    polynomials a function of two such intensities of correlation rho has the covariance sum_k c_k^2 rho^k (Lancaster):
    the term k = 1 is the autocorrelation, the others are distortion.
    """
    if np.isinf(level):
        return seen, np.full(len(seen), noise)
    out, left = np.empty_like(seen), np.empty(len(seen))
    for n, each in enumerate(seen):
        shape = 1 / max(each[0, 0], 1e-9)
        law = stats.gamma(shape, scale=1 / shape)
        x = law.ppf((np.arange(_NODES) + 0.5) / _NODES)
        cut = np.minimum(x, level)
        correlation = each / each[0, 0]
        out[n] = 0
        for k in range(1, _ORDERS):
            norm = np.exp(gammaln(k + shape) - gammaln(k + 1) - gammaln(shape))
            c = (cut * eval_genlaguerre(k, shape - 1, shape * x)).mean() / np.sqrt(norm)
            out[n] += c**2 * correlation**k
        out[n] /= cut.mean() ** 2
        left[n] = noise * law.cdf(level) / cut.mean() ** 2  # a full well has no noise
    return out, left


class _Envelope(NamedTuple):
    """Remaining envelope of the beam along one axis of the camera, which is separable.

    Attributes
    ----------
    light : float[n]
        Beam over the mean that it is divided by.
    noise : float
        Variance of the shot noise over that of an even beam.
    """

    light: np.ndarray
    noise: float


def _envelope(conditions: Conditions) -> _Envelope:
    x = (np.arange(_STEPS) + 0.5) / _STEPS - 0.5
    beam = np.exp(-0.5 * np.square(x / conditions.beam))
    if conditions.removal:
        blur = np.exp(-0.5 * np.square((x[:, None] - x) / conditions.removal))
        slow = blur @ beam / blur.sum(1)
    else:
        slow = np.full(_STEPS, beam.mean())
    return _Envelope(beam / slow, float((beam / slow**2).mean()))


def _enveloped(measured: np.ndarray, light: np.ndarray, conditions: Conditions) -> np.ndarray:
    """Autocovariance float[n, W, W] under an envelope, less what its removal takes and the background of the ring."""
    if np.isinf(conditions.beam) and not conditions.removal:
        return measured
    window = measured.shape[-1]
    inner, outer = ring(window)
    steps, inside = lags(2 * window), lags(window)
    wide = np.zeros((len(measured), 2 * window, 2 * window))
    wide[:, inside[:, None], inside] = measured
    side = GRID * conditions.camera
    if conditions.removal:
        taken = np.exp(-2 * np.square(np.pi * np.fft.fftfreq(2 * window) * conditions.removal * side))
        wide = np.fft.ifft2(np.fft.fft2(wide) * np.square(1 - taken[:, None] * taken)).real
    relative = light / light.mean()
    pairs = np.array([(relative[: _STEPS - n] * relative[n:]).mean() for n in range(_STEPS)])
    paired = np.array([relative[: _STEPS - n].mean() for n in range(_STEPS)])
    both, one = (np.interp(np.abs(steps) * (_STEPS / side), np.arange(_STEPS), x) for x in (pairs, paired))
    both, one = both[:, None] * both, one[:, None] * one
    # The mean that is taken off is that of the whole camera, not of the pixels that have a partner at that lag.
    wide = both * (1 + wide) - 2 * one + 1
    reach = np.maximum(np.abs(steps)[:, None], np.abs(steps))
    wide -= wide[:, (reach >= inner) & (reach <= outer)].mean(1)[:, None, None]
    return wide[:, inside[:, None], inside]
