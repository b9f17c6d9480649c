"""Several objects seen through one medium, from their images alone: multiframe blind deconvolution of speckle.

Within the memory effect every image is one and the same pattern, moved and added up over an object: X_n = S O_n at the
camera's frequencies, with one S for all. Speckle makes S a random number: complex, Gaussian, independent from frequency
to frequency, of a power E that is smooth. What S is need not be known, nor any object guessed, since the law of the N
images together has neither: at each frequency

    X = (X_1 .. X_N)  is complex Gaussian,   <X X^H> = E o o^H + s 1,      o = (O_1 .. O_N)
    -log L = log(E |o|^2 + s) + (N - 1) log s + (|X|^2 - E |o^H X|^2 / (E |o|^2 + s)) / s

which is Whittle's likelihood (:mod:`likelihood`) of one image where N is 1, and knows of several how their phases go
together. s is what one S does not explain: what the camera's edges cut off, what C_I falls by across an object, noise.
The objects are sought by its gradient from shapeless blobs, low frequencies first, so that the search sees an outline
before it sees strokes. E is the power that the window passes, times a smooth curve that is fitted on the way; s is a
share of E |o|^2 at the frequency, and one of its mean.

Blind deconvolution of many frames with positivity goes back to Schulz, J. Opt. Soc. Am. A 10, 1064 (1993); there one
object is seen through many unknown functions, here many objects through one.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from torch import Tensor

from specklegen.core.arguments import host_tensor, positive_number, real_number, whole_number
from specklegen.core.display.plot import Pictured, draw_stack
from specklegen.core.errors import reject
from specklegen.core.random_streams import Seed, seed_words
from specklegen.core.shielded import shielded
from specklegen.models.likelihood.common_medium import camera_spectra, same_optics
from specklegen.models.likelihood.likelihood import PASSED, Optics
from specklegen.models.likelihood.periodogram import flattened
from specklegen.models.metrics import align, pearson

STAGES = ((60, 0.2), (60, 0.35), (60, 0.55), (60, 0.75), (140, 1.0))
"""Of the search: steps, and the highest frequency used, over the highest that the window passes along an axis."""
SHARP = 0.25
"""Standard deviation, in grains, of the spots that objects are drawn with: finer detail is not in the images."""
STIFF = 0.3
"""Share of the frequencies that says that E is the power which the window passes: what an E that were free would take
from all objects alike, such as a blur in one direction, stays in them."""
_RATES = 0.05, 0.03  # of Adam, for the logarithm of a pixel and for the law's numbers
_FEW = 16  # frequencies, of which a stage needs as many or more
_MOST = 64  # starts
_FAINT = 1e-3  # of the mean brightness of a pixel: where the search starts from outside its blobs
_SHARES = -1.0, -9.0  # logarithms of s over E |o|^2: of its mean over frequencies, and at the frequency itself


@dataclass(frozen=True, eq=False, repr=False)
class Multiframe(Pictured):
    """Estimates of N objects from N images through one medium.

    Attributes
    ----------
    image : float32[N, n, n]
        Brightness 0 to 1 of each object. All are in one place of the frame that nothing says, and turned alike: the
        right way up where the search was right.
    agreement : float
        Mean correlation of what other starts found with it: near 1 if it does not hang on where the search began. NaN
        of one start.
    explained : float
        Mean share of a frequency's power, over all images, that one medium explains: near 1 where there is little
        noise. About a half is what one makes of images that have none in common, and of noisy frames that have.

    Examples
    --------
    >>> import torch
    >>> from specklegen.models import Multiframe
    >>> Multiframe(torch.rand(5, 36, 36), agreement=0.97, explained=0.91)
    Multiframe(image=float32[5, 36, 36], agreement=0.97, explained=0.91)
    """

    image: Tensor
    agreement: float
    explained: float

    _named = {"objects": "image", "agreement of starts": "agreement",
              "share of the power that one medium explains": "explained"}  # fmt: skip

    def _draw(self, axes: Any, label: str | None = None) -> None:
        """The objects, side by side."""
        draw_stack(axes, self.image.numpy())


@shielded()
def multiframe_deconvolution(
    images: Tensor, optics: Optics, size: int, *, background: float = 0.0, sigma: float | None = None, starts: int = 8,
    seed: Seed = 0,
) -> Multiframe:  # fmt: skip
    """Find several objects from one image of each through the same medium at rest: no prior, no training, no C_I.

    It needs images of different objects, two at least, five are better, that lie within the memory-effect range and
    fill at most a fifth of the camera along a side. Unlike what a single image says, they come out the right way up.

    Parameters
    ----------
    images
        real[N, H, W], of N objects through one medium.
    optics
        Steps, grains and window, the same for all images. The power spectrum need not be known: it is fitted, about
        that of the window. The camera is taken to show objects as the samples of a recipe do.
    size
        Pixels n along a side of the frame that holds every object, on the pitch of ``optics``, with some to spare: the
        objects need not be in one place.
    background
        Image value without light, taken off first.
    sigma
        Pixels over which an envelope is estimated, many grains; each image is divided by it. By default there is none.
    starts
        Searches from other blobs, at most 64; the most probable is taken. Each takes half a second or more for five
        images of 128 x 128.
    seed
        Of the blobs. What is returned is a function of it.

    Raises
    ------
    RuleError
        If there are fewer than two images, one is dark or has no contrast, numbers of the optics differ between images,
        the frame is wider than the camera, or no frequency is left.

    Examples
    --------
    >>> import torch
    >>> from specklegen.models import Optics, multiframe_deconvolution
    >>> found = multiframe_deconvolution(torch.rand(3, 64, 64), Optics(step=1.0, grain=3.0), 12, starts=1)
    >>> found.image.shape
    torch.Size([3, 12, 12])
    """
    owner = "multiframe_deconvolution"
    images = host_tensor(f"{owner} images", images)
    size, starts = whole_number(f"{owner} size", size, 2), whole_number(f"{owner} starts", starts, 1, _MOST)
    sigma = None if sigma is None else positive_number(f"{owner} sigma", sigma)
    words = seed_words(seed)
    if images.ndim != 3 or len(images) < 2 or min(images.shape[-2:]) < 8:
        reject(f"{owner} images", "[N, H, W], N at least 2, of at least 8 pixels a side", tuple(images.shape))
    step, grain = same_optics(owner, optics, len(images))
    if size * step > min(images.shape[-2:]):
        reject(f"{owner} size", f"at most {int(min(images.shape[-2:]) / step)}, the camera's side", size)
    flat, _, lowest = flattened(images.cpu().double(), real_number(f"{owner} background", background), sigma, owner)
    law = _Law(flat, lowest, size, step, grain, optics)
    solutions = law.search(words, starts)
    order = solutions.cost.argsort(stable=True)
    image, *others = (law.drawn(solutions.pixels[n]) for n in order.tolist())
    alike = [float(pearson(align(other, image), image).mean()) for other in others]
    explained = float(solutions.explained[order[0]])
    return Multiframe(image, float(np.mean(alike)) if alike else float("nan"), explained)


@dataclass(frozen=True)
class _Found:
    """Results of S searches.

    ``pixels`` float64[S, N, n, n] and ``shares`` float64[S, 2] are logarithms, of the objects and of s; ``cost`` is
    -log L of each, and ``explained`` the share of the power that one medium explains.
    """

    pixels: Tensor
    shares: Tensor
    cost: Tensor
    explained: Tensor


class _Law:
    """The likelihood of images real[N, H, W] that are flat about 0."""

    def __init__(self, flat: Tensor, lowest: float, size: int, step: float, grain: float, optics: Optics) -> None:
        spectrum, passed, down, across = camera_spectra(flat, grain, optics)
        frequency = torch.hypot(down[:, None], across)
        used = (passed > PASSED) & (frequency * grain <= STAGES[-1][1]) & (frequency >= max(lowest, 1e-9))
        used[flat.shape[-2] // 2 + 1 :, 0] = False  # of two opposite frequencies one
        if int(used.sum()) < _FEW or not float(flat.square().mean((-2, -1)).min()) > 1e-20:
            reject("multiframe_deconvolution images", "images with contrast, several speckle grains wide",
                   tuple(flat.shape))  # fmt: skip
        self.used, self.passed, self.frequency = used, passed, frequency * grain
        self.spectrum, self.down, self.across, self.size = spectrum, down * grain, across * grain, size
        self.waves = tuple(torch.exp(-2j * torch.pi * step * f[:, None] * torch.arange(size)) for f in (down, across))
        self.spot = SHARP * grain / step

    @torch.enable_grad()
    def search(self, words: tuple[int, ...], starts: int) -> _Found:
        """Search from blobs, each start's its own; starts do not see each other."""
        count, n = len(self.spectrum), self.size
        along = (np.arange(n) - (n - 1) / 2) / (n / 6)
        blob = np.exp(-0.5 * (along[:, None] ** 2 + along**2))
        draws = [np.random.default_rng([len(words), *words, m]).random((count, n, n)) for m in range(starts)]
        light = torch.from_numpy(blob * (0.5 + 0.5 * np.stack(draws)))
        pixels = (light / light.mean((-2, -1), keepdim=True) + _FAINT).log()
        shares, none = torch.tensor(_SHARES, dtype=torch.float64).expand(starts, 2), torch.zeros(starts)
        solutions = _Found(pixels, shares, none, none)
        for steps, highest in STAGES:
            if int((self.used & (self.frequency <= highest)).sum()) >= _FEW:
                solutions = self.searched(solutions.pixels, solutions.shares, steps, highest)
        return solutions

    def searched(self, pixels: Tensor, shares: Tensor, steps: int, highest: float) -> _Found:
        """Go so many steps down -log L of the frequencies up to the highest."""
        used = self.used & (self.frequency <= highest)
        rows, columns = used.any(1).nonzero()[:, 0], used.any(0).nonzero()[:, 0]
        kept = used[rows][:, columns]
        seen = self.spectrum[:, rows][:, :, columns][:, kept]
        power, count = seen.abs().square().sum(0), len(seen)
        q, passed = (x[rows][:, columns][kept] for x in (self.frequency, self.passed))
        v, u = (x.expand(kept.shape)[kept] for x in (self.down[rows][:, None], self.across[columns]))
        curves = torch.stack([torch.ones_like(q), q, q**2, q**3, q**4, u**2 - v**2, u * v])
        stiff = torch.full((len(curves),), STIFF * len(q), dtype=torch.float64)
        stiff[0] = 0.0  # the power of light is anyone's
        spot = torch.exp(-2 * (torch.pi * q * SHARP) ** 2)
        waves = self.waves[0][rows], self.waves[1][columns].mT

        def transformed(logarithms: Tensor) -> Tensor:
            """o, complex[S, N, K] of objects of unit brightness."""
            whole = logarithms.flatten(2).softmax(2).reshape(logarithms.shape).to(torch.complex128)
            return (waves[0] @ whole @ waves[1])[..., kept] * spot

        with torch.no_grad():
            own = transformed(pixels).abs().square().sum(1)
            level = torch.log(power / passed / (own + 0.05 * own.mean(1, keepdim=True)) + 1e-300)
            weights = torch.linalg.solve(curves @ curves.mT + torch.diag(stiff), curves @ level.mT).mT
        pixels, law = pixels.clone().requires_grad_(), torch.cat([weights, shares], 1).requires_grad_()
        moves = torch.optim.Adam([{"params": [pixels], "lr": _RATES[0]}, {"params": [law], "lr": _RATES[1]}])
        cost = own = fits = power
        for _ in range(steps):
            objects = transformed(pixels)
            own, fits = objects.abs().square().sum(1), (objects.conj() * seen).sum(1).abs().square()
            speckle = passed * torch.exp(law[:, :-2] @ curves)
            mean, each = law[:, -2:].exp().mT[..., None]
            rest = speckle * (mean * own.mean(1, keepdim=True) + each * own) / count
            whole = speckle * own + rest
            cost = (whole.log() + (count - 1) * rest.log() + (power - speckle * fits / whole) / rest).sum(1)
            bent = 0.5 * (law[:, :-2].square() @ stiff)
            moves.zero_grad()
            ((cost + bent).sum() / len(q)).backward()
            moves.step()
        explained = (fits / (own * power).clamp_min(1e-300)).detach().mean(1)
        return _Found(pixels.detach(), law.detach()[:, -2:], cost.detach(), explained)

    def drawn(self, pixels: Tensor) -> Tensor:
        """Objects float32[N, n, n] with their spots, brightness 0 to 1, turned as a camera turns them."""
        place = torch.arange(self.size, dtype=torch.float64)
        spot = torch.exp(-0.5 * ((place[:, None] - place) / self.spot) ** 2)
        whole = spot @ pixels.exp() @ spot
        return (whole / whole.amax((-2, -1), keepdim=True)).flip((-2, -1)).float()
