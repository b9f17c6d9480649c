"""Likelihood of a camera image, given the object and the slab.

The periodogram I of an image has nearly independent values, exponentially distributed about their mean S
(:mod:`spectrum`); of several looks it has a gamma distribution. Their likelihood is Whittle's (1953),

    -log L = looks * sum_f ( log S + I / S ) + constant,      S = a S_object + noise

over half of the frequencies (the image is real), without f = 0, which the image's mean has taken, and inside the band
that the window passes. The brightness a, which a bandwidth or a missing polariser lowers, is profiled out. The
*deviance* is the mean of I / S - 1 - log(I / S); for the true object it is Euler's constant, 0.577 (one look), with
nothing fitted, and that is how the whole chain is tested.

C(d) multiplies and never divides: noise is not amplified, however far beyond the memory-effect range the object is.
"""

import copy
import math
from typing import NamedTuple, Self

import numpy as np
import torch
from torch import Tensor, nn

from specklegen.core.arguments import choice, flag, instance, positive_number, real_array, real_tensor, whole_numbers
from specklegen.core.display.repr import short
from specklegen.core.errors import reject
from specklegen.core.random_streams import Seed
from specklegen.memory_effects.correlation import MemoryEffectCorrelation
from specklegen.models.likelihood.periodogram import Periodogram
from specklegen.models.likelihood.spectrum import Transforms, autocorrelation_of, transforms, waves
from specklegen.models.retrieval.autocorrelation import at_distances, memory_effect_of
from specklegen.models.retrieval.edges import independent, lag_weights, lowest_frequency, shares_of
from specklegen.scene.window import PROFILES, Profile, Window

BAND = 0.92
"""Frequencies used, over the highest that the window passes along an axis."""
PASSED = 0.005
"""Smallest transfer function of the window at a frequency that is used."""
LEAST = 1e-9  # of the peak of an object's own spectrum: below is rounding
_STEPS = 6  # of Fisher's scoring for the brightness


class Optics(NamedTuple):
    """Geometry of camera and object; each number for all objects, or one for each.

    Attributes
    ----------
    step : float or float[B]
        Camera pixels between object pixels.
    grain : float or float[B]
        Camera pixels in a speckle grain, wavelength / window width.
    profile : str
        Shape of the window.
    pixel_integration : bool
        Whether pixels collect light over their area, as those of a camera do.

    Examples
    --------
    >>> from specklegen.models import Optics
    >>> optics = Optics(step=2.5, grain=3.0)  # camera pixels between object pixels, and in a speckle grain
    >>> optics.profile
    'square'
    """

    step: float | Tensor
    grain: float | Tensor
    profile: Profile = "square"
    pixel_integration: bool = False

    __repr__ = short


def memory_effect_between(
    correlation: MemoryEffectCorrelation, wavelength: float, pitch: float, shape: tuple[int, int]
) -> Tensor:
    """C_I at every lag between the pixels of an object, float64[2 h - 1, 2 w - 1], lag 0 in the middle.

    Parameters
    ----------
    correlation
        Of the material.
    wavelength
        Inside the medium.
    pitch
        Direction sine between object pixels.
    shape
        (h, w) of the object.

    Examples
    --------
    >>> from specklegen.datasets import load_recipe
    >>> from specklegen.models import memory_effect_between
    >>> recipe = load_recipe("through-slab", {"material": {"kernel_paths": 1000}})
    >>> correlation = recipe.material_of(0, "test", 0).correlation
    >>> memory_effect_between(correlation, recipe.wavelength, pitch=1e-5, shape=(4, 4)).shape
    torch.Size([7, 7])
    """
    rows, columns = (np.arange(1 - n, n) for n in shape)
    return at_distances(memory_effect_of(correlation, wavelength, pitch), np.hypot(rows[:, None], columns))


def expected_deviance(looks: float) -> float:
    """Deviance of the true object: log n - psi(n) for n looks, Euler's constant for one.

    Parameters
    ----------
    looks
        Independent periodograms of which each value is the mean, more than 0.

    Examples
    --------
    >>> from specklegen.models import expected_deviance
    >>> round(expected_deviance(1.0), 3)  # of one look: Euler's constant
    0.577
    """
    looks = positive_number("expected_deviance looks", looks)
    return math.log(looks) - float(torch.digamma(torch.tensor(looks, dtype=torch.float64)))


class SpeckleLikelihood(nn.Module):
    """Likelihood of periodograms, a function of objects that can be differentiated.

    Parameters
    ----------
    seen
        Periodograms of B objects.
    shape
        (h, w) of the objects that will be asked for.
    optics
        Steps, grains, window.

    Attributes
    ----------
    used : bool[B, F, G]
        Frequencies that count.

    Raises
    ------
    RuleError
        If steps or grains are not above 0, or not one for each object; or no frequency is left.

    Examples
    --------
    >>> import torch
    >>> from specklegen.models import Optics, SpeckleLikelihood, periodogram
    >>> images = torch.rand(2, 1, 64, 64)
    >>> likelihood = SpeckleLikelihood(periodogram(images), (8, 8), Optics(step=1.0, grain=3.0))
    >>> likelihood(torch.ones(2, 8, 8)).shape
    torch.Size([2])
    """

    step: Tensor
    grain: Tensor
    power: Tensor
    taper: Tensor
    counted: Tensor
    noise: Tensor
    used: Tensor
    rows: Tensor
    columns: Tensor

    def __init__(self, seen: Periodogram, shape: tuple[int, int], optics: Optics) -> None:
        super().__init__()
        instance("SpeckleLikelihood seen", seen, Periodogram)
        instance("SpeckleLikelihood optics", optics, Optics)
        choice("Optics.profile", optics.profile, PROFILES)
        flag("Optics.pixel_integration", optics.pixel_integration)
        size = whole_numbers("SpeckleLikelihood shape", shape, 1)
        if len(size) != 2:
            reject("SpeckleLikelihood shape", "(h, w)", shape)
        count, dtype = len(seen.power), seen.power.dtype
        step, grain = (each_of(f"Optics.{name}", getattr(optics, name), count, dtype) for name in ("step", "grain"))
        self.shape, self.looks = (size[0], size[1]), seen.looks
        window = Window(optics.profile, 1.0)
        highest = BAND / float(grain.min()) * (1.0 if window.sharp else 2.0)
        reach = [min(int(highest * n), (n - 1) // 2) for n in seen.shape]
        rows = torch.arange(-reach[0], reach[0] + 1)
        columns = torch.arange(reach[1] + 1)
        power = seen.power[:, rows % seen.shape[0]][..., : reach[1] + 1]
        across, down = (x.double() / n for x, n in ((columns, seen.shape[1]), (rows, seen.shape[0])))
        shares = shares_of(seen.taper, count)
        lowest = [max(seen.lowest, lowest_frequency(share, seen.shape)) for share in shares]
        used = _used(down, across, grain.double().cpu(), optics.profile, torch.tensor(lowest, dtype=torch.float64))
        used &= (columns > 0) | (rows > 0)[:, None]  # of two opposite frequencies one, and not f = 0
        if not used.flatten(1).any(1).all():
            reject("SpeckleLikelihood seen", "large enough for a frequency inside the band of the aperture", seen.shape,
                   "Use a larger camera or tile, or a narrower envelope.")  # fmt: skip
        matrices = transforms(
            down.numpy(), across.numpy(), seen.shape, self.shape, step, grain, optics.profile, optics.pixel_integration,
            seen.taper,
        )  # fmt: skip
        self.down, self.across, self.tile = down, across, seen.shape
        self.register_buffer("step", step)
        self.register_buffer("grain", grain)
        self.register_buffer("power", power)
        self.register_buffer("taper", torch.tensor(shares, dtype=torch.float64))
        counted = torch.tensor([independent(seen.shape, share) for share in shares]).to(power)
        self.register_buffer("counted", counted)
        self.register_buffer("noise", seen.noise.to(dtype))
        self.register_buffer("used", used.to(power.device))
        self.register_buffer("rows", matrices.rows)
        self.register_buffer("columns", matrices.columns)

    def object_spectrum(self, objects: Tensor, memory_effect: Tensor | None = None) -> Tensor:
        """S of objects without noise, float[B, ..., F, G].

        Parameters
        ----------
        objects
            Brightness real[B, ..., h, w], at least 0; of any sum.
        memory_effect
            C_I between object pixels, real[2 h - 1, 2 w - 1] or with the objects' leading axes; by default 1, as
            within the memory effect.
        """
        lags = autocorrelation_of(objects.to(self.power))
        if memory_effect is not None:
            lags = lags * memory_effect.to(self.power)
        return self.of_lags(lags)

    def of_lags(self, lags: Tensor) -> Tensor:
        """S without noise, float[B, ..., F, G], of what pairs of pixels add, R C: float[B, ..., 2 h - 1, 2 w - 1]."""
        spectrum = Transforms(self.rows, self.columns)(lags)
        return torch.maximum(spectrum, LEAST * spectrum.detach().amax((-2, -1), keepdim=True))

    def spectrum(self, objects: Tensor, memory_effect: Tensor | None = None) -> Tensor:
        """S with the brightness that fits best, and noise, float[B, ..., F, G]: what the periodogram should be."""
        alone = self.object_spectrum(objects, memory_effect)
        extra = [1] * (alone.ndim - 3)
        power, used = (x.reshape(len(x), *extra, *x.shape[1:]) for x in (self.power, self.used))
        noise = self.noise.reshape(-1, *extra, 1, 1)
        with torch.no_grad():
            brightness = _brightness(alone, power, used, noise)
        return brightness[..., None, None] * alone + noise

    def forward(self, objects: Tensor, memory_effect: Tensor | None = None) -> Tensor:
        """Deviance a frequency, float[B, ...]; least for the most probable object."""
        expected = self.spectrum(objects, memory_effect)
        extra = [1] * (expected.ndim - 3)
        power, used = (x.reshape(len(x), *extra, *x.shape[1:]) for x in (self.power, self.used))
        ratio = torch.where(used, power / expected, 1.0).clamp_min(torch.finfo(expected.dtype).tiny)
        return (ratio - 1 - ratio.log()).sum((-2, -1)) / used.sum((-2, -1))

    def select(self, which: slice) -> Self:
        """Some of the objects."""
        other = copy.copy(self)
        other._buffers = {name: None if value is None else value[which] for name, value in self._buffers.items()}
        return other

    def seeing(self, power: Tensor, noise: Tensor, looks: float) -> Self:
        """Return the same layout with another measurement: power float[B, F, G] at its frequencies, noise float[B]."""
        other = copy.copy(self)
        other._buffers = self._buffers | {"power": power, "noise": noise}
        other.looks = looks
        return other

    def thinned(self, seed: Seed = 0) -> tuple[Self, Self]:
        """Two independent measurements of half as many looks each, whose mean is this one; a function of the seed.

        A gamma variable of n looks, shared out by a beta variable of ``(n / 2, n / 2)``: this makes two independent
        ones of half as many looks (Neufeld, Dharamshi, Gao and Witten, JMLR 25, 57 (2024)). So an object that was made
        from the one may be tested on the other.
        """
        words = [seed] if isinstance(seed, int) else list(seed)
        shape = (self.tile[0], self.tile[1] // 2 + 1)
        drawn = np.random.default_rng([len(words), *words]).beta(self.looks / 2, self.looks / 2, shape)
        rows = np.arange(-(len(self.down) // 2), len(self.down) // 2 + 1)
        share = torch.from_numpy(drawn[rows[:, None], np.arange(len(self.across))]).to(self.power)
        one, other = (self.seeing(2 * each * self.power, self.noise, self.looks / 2) for each in (share, 1 - share))
        return one, other

    def lags(self, size: int) -> Tensor:
        """Measured autocorrelation, float[B, n, n], between pixels of the object, the zero lag first.

        Noise is taken off, and what is no frequency of the likelihood is left out, the background with it; every lag is
        divided by the share of pixel pairs that it has, where that is at least a tenth.
        """
        power = torch.where(self.used, self.power - self.noise[:, None, None], 0.0)
        return lag_transforms((self.down, self.across), self.tile, self.step, size, self.taper).back(power)

    def lag_variance(self) -> Tensor:
        """Variance of a lag (Bartlett), float[B]; see :func:`specklegen.models.retrieval.wiener.lag_variance`."""
        squares = torch.where(self.used, self.power, 0.0).square().sum((-2, -1))
        return 2 * squares / (self.looks + 1) / (self.tile[0] * self.tile[1]) ** 2 / self.counted[:, 0]

    @property
    def frequencies(self) -> Tensor:
        """Number of independent frequencies that count, float[B]: under a taper fewer than are used."""
        return self.used.flatten(1).sum(1) * self.counted[:, 0]

    @property
    def spread(self) -> Tensor:
        """Standard deviation of the log-likelihood of the true object, float[B].

        Of each frequency I / S - log(I / S) has the variance psi'(n) - 1 / n, of n looks; neighbours under a taper are
        correlated (:func:`~specklegen.models.retrieval.edges.independent`).
        """
        looks = torch.tensor(self.looks, dtype=torch.float64)
        each = float(torch.polygamma(1, looks) - 1 / looks)
        share, growth = self.counted.unbind(1)
        return self.looks * (each * growth * share * self.frequencies).sqrt()

    def excess(self, objects: Tensor, memory_effect: Tensor | None = None) -> Tensor:
        """-log L less what it is expected to be of the true object, float[B, ...]."""
        return -self.log_likelihood(objects, memory_effect) - self.looks * expected_deviance(self.looks) * (
            self.frequencies.reshape(-1, *[1] * (objects.ndim - 3))
        )

    def log_likelihood(self, objects: Tensor, memory_effect: Tensor | None = None) -> Tensor:
        """Logarithm of the likelihood, less that of an S equal to the periodogram; float[B, ...], at most 0."""
        deviance = self(objects, memory_effect)
        return -self.looks * self.frequencies.reshape(-1, *[1] * (deviance.ndim - 1)) * deviance


def lag_transforms(
    frequencies: tuple[Tensor, Tensor], tile: tuple[int, int], step: Tensor, size: int, taper: Tensor | float = 0.0
) -> Transforms:
    """Transforms whose ``back`` turns periodograms float[B, F, G] into lags float[B, n, n] of an object's pixels.

    Of two opposite frequencies a periodogram holds one, and 0 at the other. The zero lag is the first; lags are divided
    by the share of pixel pairs that they have, where that is at least a tenth.

    Parameters
    ----------
    frequencies
        Cycles a pixel along columns, float64[F], and along rows, float64[G].
    tile
        Pixels (M, N).
    step
        Pixels between those of the object, float[B].
    size
        n.
    taper
        Share of the tile's sides on the ramps of its taper, one number or float[B].
    """
    steps = torch.fft.fftfreq(size, 1 / size).double()
    reach = steps.to(step).abs() * step[:, None]
    sides = []
    for each, pixels, both in zip(frequencies, tile, (2.0, 1.0), strict=True):
        weights = [
            lag_weights(own, pixels, share) for own, share in zip(reach, shares_of(taper, len(reach)), strict=True)
        ]
        pairs = torch.stack(weights).clamp_min(0.1)
        sides.append(waves(each.numpy(), steps.numpy(), step) * (both / pixels / pairs)[:, None, None, None])
    return Transforms(*sides)


def each_of(field: str, value: float | Tensor, count: int, dtype: torch.dtype) -> Tensor:
    """One number for each of so many objects, above 0."""
    given = value if isinstance(value, Tensor) else torch.from_numpy(real_array(field, value).copy())
    number = real_tensor(field, given).to(dtype)
    if number.ndim > 1 or (number.ndim == 1 and len(number) != count) or not ((number > 0) & number.isfinite()).all():
        reject(field, f"finite and above 0, one number or one for each of {count} objects", value)
    return number.expand(count)


def _used(rows: Tensor, columns: Tensor, grain: Tensor, profile: Profile, lowest: Tensor) -> Tensor:
    """Frequencies inside the window's band and above an envelope's, bool[B, F, G]."""
    window = Window(profile, 1.0)
    v, u = rows[:, None] * grain[:, None, None], columns * grain[:, None, None]
    inside = torch.from_numpy(window.overlap(u.numpy(), v.numpy())) >= PASSED
    if window.sharp:
        inside &= (u.abs() <= BAND) & (v.abs() <= BAND)
    return inside & (torch.hypot(rows[:, None], columns) >= lowest[:, None, None])


def _brightness(alone: Tensor, power: Tensor, used: Tensor, noise: Tensor) -> Tensor:
    """Most probable a of S = a S_object + noise, at least 0, by Fisher's scoring; exact at once without noise."""
    rest = torch.where(used, power - noise, 0.0)
    tiny = torch.finfo(alone.dtype).tiny
    if not noise.any():
        return torch.where(used, power / alone, 0.0).sum((-2, -1)) / used.sum((-2, -1))
    lit = torch.where(used, alone, 0.0).sum((-2, -1)).clamp_min(tiny)
    brightness = (rest.sum((-2, -1)) / lit).clamp_min(1e-6)
    for _ in range(_STEPS):
        weight = torch.where(used, alone / (brightness[..., None, None] * alone + noise).square().clamp_min(tiny), 0.0)
        brightness = ((weight * rest).sum((-2, -1)) / (weight * alone).sum((-2, -1)).clamp_min(tiny)).clamp_min(1e-6)
    return brightness
