"""A wide object from exposures that light a part of it each: ptychography by speckle.

Of an object many memory-effect ranges wide one image says nothing but how near points lie to each other. Lit by a spot
that is moved over it, it is seen part by part, each through its own speckle; an exposure says of its part |O(f)|, which
a shift and a turn leave as it is. But spots that overlap see the same points, and their places are known: one object
has to suit all exposures (Gardner, Divitt and Watnik, Applied Optics 58, 3564 (2019)).

Two steps. From the moduli |O_n(f)|; that of f = 0 from the light of an exposure: by relaxed averaged alternating
reflections between "every part has its modulus" and "all parts are of one object that is nowhere negative"; (Luke,
Inverse Problems 21, 37 (2005)), from several starts. Then by the gradient of the likelihood (:mod:`likelihood`) of all
exposures, which knows noise, grain, camera and C_I exactly, from the most probable of these.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from torch import Tensor

from specklegen.core.arguments import host_tensor, instance, whole_number
from specklegen.core.display.plot import Pictured, draw_images
from specklegen.core.errors import reject
from specklegen.core.random_streams import Seed, seed_words
from specklegen.core.shielded import shielded
from specklegen.models.likelihood.likelihood import Optics, SpeckleLikelihood, each_of
from specklegen.models.likelihood.periodogram import periodogram
from specklegen.models.retrieval.wiener import weights
from specklegen.scene.window import Window

COVERED = 0.3
"""Of the largest sum of the squared brightness of spots: a pixel that has less is not said to be seen."""
BETA = 0.8
"""Relaxation of the reflections."""
REFLECTIONS, AVERAGES = 600, 50
STEPS = ((150, 0.03), (50, 0.01))
"""Of Adam, and their rates, for the logarithms of pixels."""
_LIT = 20.0  # weight of the squared logarithms of the light of exposures, over that of a deviance
_TILE = 4  # sides of a spot in a tile of the camera: frequencies are few then, of many looks
_LEAST = 0.02  # of an object's mean: where the search by the gradient starts from darkness
_SMALLEST = 0.05  # of the window's transfer function: beyond, a modulus is not divided by it
_MOST = 64  # starts


@dataclass(frozen=True, eq=False, repr=False)
class WideField(Pictured):
    """A wide object as its exposures say.

    Attributes
    ----------
    image : float32[H, W]
        Brightness, 0 to 1 where it is covered, the right way up: spots have places.
    covered : bool[H, W]
        Pixels that the spots light well enough to be scored.
    deviance : float32[N]
        Of each exposure; the true object has ``expected_deviance(looks)``.
    looks : float
        Independent periodograms in an exposure.

    Examples
    --------
    >>> import torch
    >>> from specklegen.models.likelihood.wide_field import WideField
    >>> WideField(torch.rand(26, 81), torch.ones(26, 81, dtype=torch.bool), torch.full((42,), 0.03), looks=16.0)
    WideField(26 x 81 pixels, 42 exposures)
    """

    image: Tensor
    covered: Tensor
    deviance: Tensor
    looks: float

    _named = {"object": "image", "pixels covered": "covered", "deviance of exposures": "deviance", "averages": "looks"}

    def _draw(self, axes: Any, label: str | None = None) -> None:
        """The object."""
        draw_images(axes, self.image.clamp(0, 1).numpy()[None], high=1.0)


@shielded()
def scanned_object(
    images: Tensor, spot: Tensor, places: Tensor, optics: Optics, memory_effect: Tensor, *, light: Tensor | None = None,
    background: float = 0.0, electrons: float = float("inf"), starts: int = 4, seed: Seed = 0,
) -> WideField:  # fmt: skip
    """Find a wide object from exposures under a spot of light that is moved over it.

    Spots should overlap by two thirds of their side, and each be narrower than two memory-effect ranges; the camera
    should be ten or more of them wide. The medium may be another one at each exposure: nothing is taken from one
    exposure to the next but the object. Raise a `RuleError` if shapes do not agree, a spot has no light, a place is
    negative, an exposure is dark or has no contrast, or no frequency is left.

    Parameters
    ----------
    images
        real[N, H, W], an exposure for each place of the spot.
    spot
        Brightness of the spot, real[h, w], at least 0, on the object's pixels.
    places
        First (row, column) of the spot in the wide frame, int64[N, 2], at least 0.
    optics
        Steps, grains and window.
    memory_effect
        C_I between the pixels of a spot, real[2 h - 1, 2 w - 1] (:func:`memory_effect_between`).
    light
        Light of each exposure, real[N], in any unit; by default the mean of its image, less the background: right for
        counts of one exposure time.
    background
        Image value without light.
    electrons
        Photo-electrons that an image value of 1 stands for; by default infinite, no shot noise.
    starts
        Searches from other objects, at most 64; the most probable is taken.
    seed
        Of the starts. What is returned is a function of it.

    Examples
    --------
    >>> import torch
    >>> from specklegen.models import Optics
    >>> from specklegen.models.likelihood.wide_field import scanned_object
    >>> spot, places = torch.ones(8, 8), torch.tensor([[0, 0], [0, 3]])
    >>> found = scanned_object(torch.rand(2, 64, 64), spot, places, Optics(2.0, 2.0), torch.ones(15, 15), starts=1)
    >>> found.image.shape
    torch.Size([8, 11])
    """
    whole_number("scanned_object starts", starts, 1, _MOST)
    seen = Seen.of(images, spot, places, optics, memory_effect, light, background, electrons)
    words, scan = seed_words(seed), seen.scan
    best, least = None, np.inf
    for start in range(starts):
        white = np.random.default_rng([len(words), *words, start]).random(scan.wide, np.float32)
        retrieved = reflected(scan, seen.moduli, torch.from_numpy(white))
        lit = retrieved + _LEAST * retrieved.mean()
        deviance = float(seen.likelihood(scan.parts(lit), seen.memory_effect).mean())
        if best is None or deviance < least:
            best, least = lit, deviance
    assert best is not None
    image, deviance = climbed(seen, best)
    covered = scan.weight >= COVERED * scan.weight.max()
    return WideField(image / image[covered].max(), covered, deviance, seen.likelihood.looks)


@dataclass(frozen=True, eq=False)
class Scanned:
    """A spot and its places.

    Attributes
    ----------
    spot : float32[h, w]
    rows, columns : int64[N, h, w]
        Pixels of the wide frame under each spot.
    wide : (int, int)
        Shape of the frame.
    weight : float32[H, W]
        Sum of the squared brightness of the spots.
    """

    spot: Tensor
    rows: Tensor
    columns: Tensor
    wide: tuple[int, int]
    weight: Tensor

    @classmethod
    def of(cls, spot: Tensor, places: Tensor, count: int) -> "Scanned":
        """Look at a spot and its places."""
        light = host_tensor("scanned_object spot", spot).float()
        if light.ndim != 2 or not light.numel() or not ((light >= 0) & light.isfinite()).all() or not light.any():
            reject("scanned_object spot", "real[h, w], at least 0, of some light", tuple(spot.shape))
        known = instance("scanned_object places", places, Tensor)
        if known.dtype != torch.int64 or known.shape != (count, 2) or not (known >= 0).all():
            reject("scanned_object places", f"int64[{count}, 2], at least 0: a row and a column for each image", places)
        h, w = light.shape
        rows = (known[:, :1, None] + torch.arange(h)[:, None]).expand(-1, h, w)
        columns = (known[:, 1:, None] + torch.arange(w)).expand(-1, h, w)
        wide = (int(rows.max()) + 1, int(columns.max()) + 1)
        weight = torch.zeros(wide).index_put_((rows, columns), light.square().expand(count, h, w), accumulate=True)
        return cls(light, rows, columns, wide, weight)

    def parts(self, wide: Tensor) -> Tensor:
        """Cut out the parts of an object float[H, W] under the spots: float[N, h, w]."""
        return wide[self.rows, self.columns] * self.spot

    def together(self, parts: Tensor) -> Tensor:
        """The object, nowhere negative, of which parts float[N, h, w] are nearest to be parts."""
        summed = torch.zeros(self.wide).index_put_((self.rows, self.columns), parts * self.spot, accumulate=True)
        return (summed / (self.weight + 1e-3 * self.weight.max())).clamp_min(0)


@dataclass(frozen=True, eq=False)
class Seen:
    """Estimates from exposures.

    Attributes
    ----------
    likelihood : SpeckleLikelihood
        Of the part that each shows.
    memory_effect : float32[2 h - 1, 2 w - 1]
    light : float32[N]
        Of mean 1.
    moduli : float32[N, m, m // 2 + 1]
        See :func:`moduli_of`.
    """

    scan: Scanned
    likelihood: SpeckleLikelihood
    memory_effect: Tensor
    light: Tensor
    moduli: Tensor

    @classmethod
    def of(
        cls, images: Tensor, spot: Tensor, places: Tensor, optics: Optics, memory_effect: Tensor,
        light: Tensor | None = None, background: float = 0.0, electrons: float = float("inf"),
    ) -> "Seen":  # fmt: skip
        """Look at exposures; arguments and errors are those of :func:`scanned_object`."""
        owner = "scanned_object"
        instance(f"{owner} optics", optics, Optics)
        images = host_tensor(f"{owner} images", images)
        if images.ndim != 3 or not len(images):
            reject(f"{owner} images", "of shape [exposures, rows, columns]", tuple(images.shape))
        n, scan = len(images), Scanned.of(spot, places, len(images))
        h, w = scan.spot.shape
        sides = (2 * h - 1, 2 * w - 1)
        memory_effect = host_tensor(f"{owner} memory_effect", memory_effect)
        if tuple(memory_effect.shape) != sides:
            reject(f"{owner} memory_effect", f"of shape {sides}, for the spot's lags", tuple(memory_effect.shape))
        steps = each_of("Optics.step", optics.step, n, torch.float64)
        tile = max(8, int(np.ceil(_TILE * max(h, w) * float(steps.max()))))
        seen = periodogram(images[:, None], tile=tile, background=background, electrons=electrons)
        given = (images - background).mean((-2, -1)) if light is None else host_tensor(f"{owner} light", light)
        if given.shape != (n,) or not ((given > 0) & given.isfinite()).all():
            reject(f"{owner} light", f"{n} numbers above 0", given)
        single = seen._replace(power=seen.power.float(), noise=seen.noise.float())
        likelihood = SpeckleLikelihood(single, (h, w), optics)
        bright, c_i = (given / given.mean()).float(), memory_effect.float()
        return cls(scan, likelihood, c_i, bright, moduli_of(likelihood, c_i, bright, Window(optics.profile, 1.0)))


def moduli_of(likelihood: SpeckleLikelihood, memory_effect: Tensor, light: Tensor, window: Window) -> Tensor:
    """|O_n(f)| of every exposure's part, float32[N, m, m // 2 + 1] on a frame of m pixels, three spots wide.

    From the lags that an object of the spot's size has; what is found at others is their offset, since the mean of an
    image was taken off. They are divided by C_I as far as noise allows (:mod:`wiener`), and their transform by that of
    the window. The lags over the squared mean are those of an object of sum 1, up to a factor that all exposures have.
    """
    h, w = likelihood.shape
    m = 3 * max(h, w) + max(h, w) % 2
    lags = likelihood.lags(m)
    steps = torch.fft.fftfreq(m, 1 / m)
    rows, columns = (steps.abs() <= side - 1 for side in (h, w))
    inside = rows[:, None] & columns
    lags = lags - lags[:, ~inside].mean(1)[:, None, None]
    around = torch.zeros(m, m)
    at = [(torch.arange(1 - side, side)) % m for side in (h, w)]
    around[at[0][:, None], at[1]] = memory_effect.clamp(0, 1)
    grain = (likelihood.grain / likelihood.step).float()
    kept = weights(lags, around, likelihood.lag_variance(), side=float(max(h, w)), grain=grain, guess="dense")
    frequencies = torch.fft.fftfreq(m)
    share = (grain[:, None, None] * frequencies[:, None], grain[:, None, None] * frequencies)
    passed = torch.from_numpy(np.asarray(window.overlap(*(x.numpy() for x in share)))).float()
    power = torch.fft.fft2(lags * kept * inside).real.clamp_min(0)
    power = torch.where(passed >= _SMALLEST, power / passed.clamp_min(_SMALLEST), 0.0)
    moduli = power[..., : m // 2 + 1].sqrt() * light[:, None, None]
    moduli[:, 0, 0] = light * (moduli[:, 0, 0] / light).median()  # all the light of an exposure, measured by itself
    return moduli


def reflected(scan: Scanned, moduli: Tensor, start: Tensor) -> Tensor:
    """Object float32[H, W] whose parts have the moduli, by relaxed averaged alternating reflections from a start."""
    m = moduli.shape[-2]
    h, w = scan.spot.shape

    def right(parts: Tensor) -> Tensor:
        return torch.fft.irfft2(torch.fft.rfft2(parts).sgn() * moduli, s=(m, m))

    def one(parts: Tensor) -> Tensor:
        kept = torch.zeros_like(parts)
        kept[:, :h, :w] = scan.parts(scan.together(parts[:, :h, :w]))
        return kept

    parts = torch.zeros(len(moduli), m, m)
    parts[:, :h, :w] = scan.parts(start)
    parts = parts * (moduli[:, 0, 0] / parts.sum((1, 2)).clamp_min(1e-9))[:, None, None]
    for _ in range(REFLECTIONS):
        turned = right(parts)
        parts = BETA * (parts + one(2 * turned - parts) - turned) + (1 - BETA) * turned
    for _ in range(AVERAGES):
        parts = one(right(parts))
    return scan.together(right(parts)[:, :h, :w])


def climbed(seen: Seen, start: Tensor) -> tuple[Tensor, Tensor]:
    """Object float32[H, W] uphill on the likelihood of all exposures and their light, and its deviances float32[N]."""
    drawn = start.clamp_min(1e-6 * start.max()).log().requires_grad_()
    with torch.enable_grad():
        steps = torch.optim.Adam([drawn], STEPS[0][1])
        for count, rate in STEPS:
            steps.param_groups[0]["lr"] = rate
            for _ in range(count):
                parts = seen.scan.parts(drawn.exp())
                off = parts.sum((1, 2)).log() - seen.light.log()
                fit = seen.likelihood(parts, seen.memory_effect).sum()
                loss = fit + _LIT * (off - off.mean()).square().sum()
                steps.zero_grad()
                loss.backward()
                steps.step()
    with torch.no_grad():
        brightness = drawn.exp()
        return brightness.detach(), seen.likelihood(seen.scan.parts(brightness), seen.memory_effect)
