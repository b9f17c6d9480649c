"""Camera: expected intensity to counts.

One exposure, in photoelectrons ("electrons") a pixel, I the intensity averaged over the pixel:

    charge  = Poisson(photons I) + Poisson(background) + Poisson(dark_current exposure)
    signal  = min(charge, full_well) + Normal(0, read_noise)
    counts  = signal / gain + offset, rounded and held within 0 ... 2**bit_depth - 1

Below saturation a flat field of mean charge m therefore has mean ``m / gain + offset`` counts and variance
``m / gain**2 + (read_noise / gain)**2 + 1/12``: the photon transfer curve, whose slope is ``1 / gain``. (1/12 is the
rounding's, where the noise before it is wider than about half a count.) Source: Janesick, *Photon Transfer* (2007):
chapters 2 and 5; EMVA Standard 1288, section 2.

Every number is a quantile: of the law that the pixel's mean says, at a uniform number that is a pure function of
(noise, pixel), two pixels from one block of Philox. Each noise has a substream of its own, so that switching one on or
off, or changing its strength, leaves the draws of the others as they were; and a longer exposure finds the same pixels
lucky, since a quantile rises with its mean. Light that does not interfere is added before the
exposure, by :func:`incoherent_sum`.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from math import prod
from typing import Annotated, Any, ClassVar, NamedTuple, Self

import numpy as np
from numpy.typing import ArrayLike
from pydantic import AfterValidator, Field, model_validator

from specklegen.core.arguments import instance, real_array, real_number
from specklegen.core.errors import reject
from specklegen.core.random_streams import Stream, stream_key
from specklegen.core.registered import Registered, member_of
from specklegen.core.registry import Registry
from specklegen.core.units import TIME
from specklegen.core.values import Array, NonNegative, Positive, PositiveInt
from specklegen.instrument.poisson import add_poisson_field
from specklegen.kernels import quantiles

Words = Sequence[int]

MOST_ELECTRONS = 1e15
"""Mean electrons of a pixel, at most: NumPy draws Poisson numbers of means up to 9e18; speckle has bright grains."""


def _map(array: np.ndarray) -> np.ndarray:
    if array.ndim != 2 or not array.size or (array < 0).any():
        raise ValueError("an array [H, W] of numbers of at least 0")
    return array


class NoiseStreams(NamedTuple):
    """Seeds of the noises: whole numbers of at least 0, each a sequence for `numpy.random.SeedSequence`.

    Parameters
    ----------
    shot, background, dark, read
        Of the noise of photons, of stray light, of the dark current and of reading out; :meth:`of` makes all four of
        one seed.

    Examples
    --------
    >>> from specklegen.instrument import NoiseStreams
    >>> NoiseStreams.of(7).shot, NoiseStreams.of(7).read
    ([1, 1, 7], [4, 1, 7])
    """

    shot: Words
    background: Words
    dark: Words
    read: Words

    @classmethod
    def of(cls, seed: int | Words) -> Self:
        """Four different substreams of one seed: a whole number, or a sequence of 32-bit words."""
        words = [seed] if isinstance(seed, int | np.integer) else [*seed]
        if not words or any(word < 0 or (len(words) > 1 and word >= 2**32) for word in words):
            reject("NoiseStreams.of seed", "a whole number >= 0, or a sequence of 32-bit words", seed)
        # The noise's number goes first: SeedSequence treats (1,) and (1, 0) alike.
        return cls(*([noise, len(words), *words] for noise in range(1, len(cls._fields) + 1)))


class Camera(Registered):
    """A camera and its exposure. Subclass it for an effect of your own.

    A subclass has fields of its own and says what it does to light, in :meth:`detected`, or what it records, in
    :meth:`recorded`. In a file it is ``exposure = {type = "Vignetted", photons = 200, strength = 0.3}``.

    Parameters
    ----------
    photons
        Mean detected photons (electrons) a pixel where the intensity is 1.
    oversampling
        Image points along each side of a pixel; the pixel averages over them.
    background
        Mean detected photons a pixel from light that carries no image.
    dark_current, exposure
        Electrons a pixel and second, and seconds.
    read_noise
        Standard deviation of the readout, electrons: of all pixels, or a map [H, W] of each, for frames of its shape.
    gain
        Electrons a count.
    full_well
        Largest charge of a pixel, electrons; None for no limit.
    bit_depth
        Bits a count, 1 to 16; None for float32 counts that are neither rounded nor held in a range.
    offset
        Counts at zero signal; keeps the read noise from being cut off at 0.

    Raises
    ------
    RuleError
        If a field breaks its rule, or the offset is not below the largest count.

    Examples
    --------
    >>> from specklegen.instrument import Camera
    >>> camera = Camera(photons=1000.0, read_noise=2.0, gain=4.0, bit_depth=8)
    >>> camera.largest_count, camera.saturation  # counts, electrons
    (255.0, 1020.0)
    """

    registry: ClassVar = Registry("camera")

    photons: Annotated[float, Field(gt=0, le=MOST_ELECTRONS)]
    oversampling: PositiveInt = 1
    background: Annotated[float, Field(ge=0, le=MOST_ELECTRONS)] = 0.0
    dark_current: NonNegative = 0.0
    exposure: Annotated[Positive, TIME] = 1.0
    read_noise: NonNegative | Annotated[Array, AfterValidator(_map)] = 0.0
    gain: Positive = 1.0
    full_well: Positive | None = None
    bit_depth: Annotated[int, Field(ge=1, le=16)] | None = 16
    offset: NonNegative = 0.0

    @model_validator(mode="after")
    def _check(self) -> Self:
        if self.bit_depth is not None and self.offset >= self.largest_count:
            reject("Camera.offset", f"below the largest count, {self.largest_count:g}", self.offset)
        if not self.dark_current * self.exposure <= MOST_ELECTRONS:
            reject("Camera.dark_current", f"at most {MOST_ELECTRONS:g} electrons over the exposure", self.dark_current)
        return self

    def detected(self, image: np.ndarray) -> np.ndarray:
        """Return mean detected photons float64[..., H, W] of intensities float[..., H m, W m], m the oversampling."""
        return self.photons * pixel_means(image, self.oversampling)

    def recorded(self, light: np.ndarray, keys: Sequence[tuple[int, int]]) -> np.ndarray:
        """Return counts of mean detected photons float64[..., H, W], at least 0, by the keys of the four noises."""
        draws = kernel_draws(keys, light.shape)
        counts = counted(self.electronics, light, draws, self.noise_map(light.shape[-2:]))
        return counts.astype(np.float32 if self.bit_depth is None else np.uint16)

    @property
    def electronics(self) -> list[float]:
        """Numbers behind the pixels: background, dark charge, full well, read noise, gain, offset, largest count.

        The first four are in electrons, the read noise is the root mean square of its map; limits that the camera does
        not have are infinite.
        """
        well = np.inf if self.full_well is None else self.full_well
        dark = self.dark_current * self.exposure
        read = float(np.sqrt(np.square(self.read_noise).mean())) if np.ndim(self.read_noise) else float(self.read_noise)
        return [self.background, dark, well, read, self.gain, self.offset, float(self.largest_count)]

    def noise_map(self, shape: tuple[int, ...]) -> np.ndarray | None:
        """Return the map of the read noise, float64[H, W], None where it is one number; refuse other frames."""
        if not isinstance(self.read_noise, np.ndarray):
            return None
        if self.read_noise.shape != tuple(shape):
            reject("Camera.read_noise", f"one number, or a map of the shape of the frames, {tuple(shape)}",
                   self.read_noise.shape, "Crop it to the used part of the sensor.")  # fmt: skip
        return self.read_noise

    @property
    def largest_count(self) -> float:
        """2**bit_depth - 1, or infinity."""
        return np.inf if self.bit_depth is None else 2.0**self.bit_depth - 1

    def require_light(self, pixels: int) -> None:
        """Refuse a camera that shows nothing of an image of mean intensity 1.

        Raises
        ------
        RuleError
            If an image of so many pixels has less than one photon, or its brightest pixel less than half a count.
        """
        if self.photons * pixels < 1:
            reject("Camera.photons", f"at least {1 / pixels:.2g}, one photon in an image", self.photons)
        brightest = self.photons * (1 + np.log(pixels)) / self.gain  # the largest of so many exponential numbers
        if self.bit_depth is not None and brightest < 0.5:
            remedy = f"The brightest pixel gives about {brightest:.2g} counts at {self.gain:g} electrons a count."
            reject("Camera.photons", "enough for a count", self.photons, remedy)

    def noise(self, mean: Any) -> Any:
        """Variance that noise adds to a pixel over the squared mean of an image, from its mean in counts (any array).

        The photon transfer curve at the mean; saturation is left out.
        """
        rounding = 0.0 if self.bit_depth is None else 1 / 12
        return ((mean - self.offset) / self.gain + (self.electronics[3] / self.gain) ** 2 + rounding) / mean**2

    @property
    def saturation(self) -> float:
        """Electrons at which a pixel saturates: the full well or the largest count, whichever comes first."""
        well = np.inf if self.full_well is None else self.full_well
        return min(well, (self.largest_count - self.offset) * self.gain)


AnyCamera = Annotated[Camera, *member_of(Camera)]
"""A camera of any class, written with its type unless that is the plain one."""


def expose(camera: Camera, image: ArrayLike, streams: NoiseStreams) -> np.ndarray:
    """Expose a camera to an expected intensity; a pure function.

    Parameters
    ----------
    camera
        The camera: photons a pixel at intensity 1, noises, gain, full well and bits of its converter (:class:`Camera`).
    image
        Intensity, float[..., H m, W m], m the camera's oversampling; 1 stands for ``camera.photons``.
        Its mean is not brought to 1: that of a speckle image truly varies.
    streams
        Seeds of the noises. The images of one call share them, one draw a pixel.

    Returns
    -------
    counts
        uint16[..., H, W], or float32 if ``camera.bit_depth`` is None.

    Raises
    ------
    RuleError
        If the image is negative or not finite somewhere, or its sides are no multiples of m.

    Examples
    --------
    >>> import numpy as np
    >>> from specklegen.instrument import Camera, NoiseStreams, expose
    >>> counts = expose(Camera(photons=1000.0), np.ones((64, 64)), NoiseStreams.of(7))
    >>> counts.dtype, round(float(counts.mean()), -1), round(float(counts.std()))  # the root of 1000
    (dtype('uint16'), 1000.0, 32)
    """
    instance("expose camera", camera, Camera)
    if not isinstance(instance("expose streams", streams, tuple), NoiseStreams):
        reject("expose streams", "NoiseStreams", streams, "Make them by NoiseStreams.of(seed).")
    return exposed(camera, real_array("expose image", image), [stream_key(words, Stream.CAMERA) for words in streams])


def exposed(camera: Camera, image: np.ndarray, keys: Sequence[tuple[int, int]]) -> np.ndarray:
    """Counts of an expected intensity by the keys of the four noises; see :func:`expose`."""
    light = camera.detected(image)
    if not np.isfinite(light).all() or (light < 0).any():
        reject("expose image", "finite and at least 0 everywhere", image)
    return camera.recorded(light, keys)


def counted(electronics: Sequence[float], light: Any, drawn: Callable[..., Any], noise_map: Any = None) -> Any:
    """Return counts of mean detected photons float64[...], at least 0: an array of NumPy, or a tensor on any device.

    ``drawn(noise, mean)`` makes one Poisson number a pixel, of the noise ``0`` (shot), ``1`` (background) or ``2``
    (dark current); ``drawn(3)`` makes normal numbers of variance 1 (reading out). ``noise_map`` is a read noise that is
    not one number.
    """
    background, dark, full_well, read_noise, gain, offset, largest = electronics
    charge = drawn(0, light)
    for noise, mean in ((1, background), (2, dark)):
        if mean > 0:
            charge = charge + drawn(noise, mean)
    charge = charge.clip(max=full_well)
    if read_noise > 0:
        charge = charge + (read_noise if noise_map is None else noise_map) * drawn(3)
    counts = charge / gain + offset
    return counts if largest == np.inf else counts.round().clip(0, largest)


def kernel_draws(keys: Sequence[tuple[int, int]], shape: tuple[int, ...]) -> Callable[..., np.ndarray]:
    """Return the draws of an image for :func:`counted`, by the kernels, from the keys of the four noises."""

    def drawn(noise: int, mean: Any = None) -> np.ndarray:
        numbers = np.zeros(prod(shape))
        if mean is None:
            quantiles.add_normal(*keys[noise], 1.0, numbers)
        elif isinstance(mean, np.ndarray):
            quantiles.add_poisson(*keys[noise], mean.ravel(), numbers)
        else:
            add_poisson_field(numbers, mean, keys[noise])
        return numbers.reshape(shape)

    return drawn


def pixel_means(image: ArrayLike, factor: int) -> np.ndarray:
    """Average an image float[..., H factor, W factor] over ``factor`` by ``factor`` points: float64[..., H, W]."""
    image = np.asarray(image, dtype=np.float64)
    if image.ndim < 2:
        reject("expose image", "of shape (..., rows, columns)", image.shape)
    rows, columns = image.shape[-2:]
    if rows % factor or columns % factor:
        reject("expose image", f"a multiple of the oversampling {factor} along both sides", (rows, columns))
    blocks = image.reshape(*image.shape[:-2], rows // factor, factor, columns // factor, factor)
    return blocks.mean(axis=(-3, -1))


def incoherent_sum(images: ArrayLike, weights: ArrayLike | None = None) -> np.ndarray:
    """Add images that do not interfere: wavelengths of a band, polarisations, instants of a long exposure.

    n independent images of equal weight have a contrast lower by 1 / sqrt(n), in general by sqrt(sum of squared
    weights); correlated ones less (the correlation is the engine's: it enters through the images). Raise a `RuleError`
    if there is no image, or the weights do not fit them, are negative or all 0.

    Parameters
    ----------
    images
        float[n, ..., H, W].
    weights
        Share of each image, float[n], at least 0; brought to a sum of 1. Equal shares by default.

    Returns
    -------
    image
        float64[..., H, W].

    Examples
    --------
    >>> import numpy as np
    >>> from specklegen.instrument import incoherent_sum
    >>> incoherent_sum(np.arange(8.0).reshape(2, 2, 2), weights=[3, 1]).tolist()
    [[1.0, 2.0], [3.0, 4.0]]
    """
    images = real_array("incoherent_sum images", images)
    if images.ndim < 3 or len(images) == 0:
        reject("incoherent_sum images", "of shape (n, ..., rows, columns) with n at least 1", images.shape)
    shares = np.ones(len(images)) if weights is None else real_array("incoherent_sum weights", weights)
    if shares.shape != images.shape[:1]:
        reject("incoherent_sum weights", f"of shape {images.shape[:1]}, one an image", shares.shape)
    if not np.isfinite(shares).all() or (shares < 0).any() or not shares.any():
        reject("incoherent_sum weights", "finite, at least 0 and not all 0", shares)
    return np.tensordot(shares / shares.sum(), images, axes=1)


def depolarised(image: ArrayLike, independent: ArrayLike, degree: float = 0.0) -> np.ndarray:
    """Add the two polarisations of partly polarised light, whose speckle is independent.

    One has the share ``(1 + P) / 2``, the other ``(1 - P) / 2``. The contrast of developed speckle falls to
    ``sqrt((1 + P**2) / 2)``: 0.71 where P = 0.
    Source: Goodman, *Speckle Phenomena in Optics* (2007), section 3.4.

    Parameters
    ----------
    image, independent
        Intensities of equal mean, float[..., H, W], from different media draws.
    degree
        Degree of polarisation P, 0 to 1.

    Returns
    -------
    image
        float64[..., H, W].

    Examples
    --------
    >>> import numpy as np
    >>> from specklegen.instrument import depolarised
    >>> one, other = np.random.default_rng(0).exponential(size=(2, 100, 100))
    >>> bool(abs(depolarised(one, other).std() - 0.5**0.5) < 0.02)  # over a mean of 1: the contrast
    True
    """
    degree = real_number("depolarised degree", degree)
    if not 0 <= degree <= 1:
        reject("depolarised degree", "from 0 to 1", degree)
    one, other = real_array("depolarised image", image), real_array("depolarised independent", independent)
    if one.shape != other.shape:
        reject("depolarised images", "of one shape", (one.shape, other.shape))
    return incoherent_sum(np.stack([one, other]), [0.5 * (1 + degree), 0.5 * (1 - degree)])
