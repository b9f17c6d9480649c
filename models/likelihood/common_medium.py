"""Several objects seen through one medium at rest: what their images have in common is the medium.

Within the memory effect the image of every object is one and the same speckle, that of a point, moved and added up: in
the camera's frequencies X_n = S O_n with one transfer function S for all. From a single image S and O_n cannot be
parted but by their moduli; of several images the ratios X_n / X_m = O_n / O_m are the objects' own, phases included.
Each image's own reconstruction says how its object looks, up to a shift and a turn by 180 degrees; the ratios say
which shifts and turns go together, and a few steps of alternating least squares bring all of them into line:

    S = sum_n X_n O_n* / sum_n |O_n|^2,        O_n <- what X_n S* / |S|^2 says where S passes, at least 0

as in multi-frame blind deconvolution (Schulz, J. Opt. Soc. Am. A 10, 1064 (1993)). Steps are few on purpose: what the
camera's edges cut off, and what C_I falls by across an object, is noise that more of them would fit.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from torch import Tensor

from specklegen.core.arguments import choice, flag, host_tensor, instance
from specklegen.core.display.plot import Pictured, draw_stack
from specklegen.core.errors import reject
from specklegen.core.shielded import shielded
from specklegen.models.likelihood.likelihood import Optics, each_of
from specklegen.scene.window import PROFILES, Window

STEPS = 3
"""Of alternating least squares."""
LEFT = 1.5
"""Mean power of S, over which what a frequency says is believed by half."""
MARGIN = 4  # object pixels that are added around, for shifts
REACH = 14  # object pixels by which one object may lie aside of another
_PASSED = 0.005  # of the window's transfer function: below, frequencies are left out
_REGULAR = 0.05  # of the mean power of objects, beside it


@dataclass(frozen=True, eq=False, repr=False)
class Joint(Pictured):
    """Estimates from N images through one medium together.

    Attributes
    ----------
    image : float32[N, n, n]
        Brightness 0 to 1 of each object, all moved together and turned alike, on a frame of 8 pixels more.
    flipped : bool[N]
        Whether each was turned by 180 degrees from what was given.
    shift : int64[N, 2]
        By how many pixels each was moved, down and right, after the turn.
    upright, turned : float
        How well the ratios of all images fit the objects this way up, and the other way up, each at its best.

    Examples
    --------
    >>> import torch
    >>> from specklegen.models import Joint
    >>> images = torch.rand(2, 8, 8)
    >>> found = Joint(images, torch.tensor([False, True]), torch.zeros(2, 2, dtype=torch.int64), 0.9, 0.7)
    >>> found.flipped.tolist(), found.upright > found.turned
    ([False, True], True)
    """

    image: Tensor
    flipped: Tensor
    shift: Tensor
    upright: float
    turned: float

    _named = {"objects": "image", "turned by 180 degrees": "flipped", "fit this way up": "upright",
              "fit the other way up": "turned"}  # fmt: skip

    def _draw(self, axes: Any, label: str | None = None) -> None:
        """The objects, side by side."""
        draw_stack(axes, self.image.numpy())


@shielded()
@shielded()
def joint_objects(images: Tensor, objects: Tensor, optics: Optics) -> Joint:
    """Improve reconstructions of several objects by what their images through one medium have in common.

    Parameters
    ----------
    images
        real[N, H, W], N objects through the same medium, which stood still.
    objects
        What each image alone says of its object, real[N, h, w], at least 0: of any method, in any place and either way
        up, on the pitch of ``optics``.
    optics
        Steps, grains and window, the same for all images. The camera is taken to show objects as the samples of a
        recipe do.

    Raises
    ------
    RuleError
        If there are fewer than two images, not one object for each, one of them is dark, or numbers of the optics
        differ between images.

    Examples
    --------
    >>> import torch
    >>> from specklegen.models import Optics, joint_objects
    >>> images, objects = torch.rand(3, 64, 64), torch.rand(3, 8, 8)
    >>> joint_objects(images, objects, Optics(step=2.0, grain=3.0)).image.shape
    torch.Size([3, 16, 16])
    """
    images, objects = host_tensor("joint_objects images", images), host_tensor("joint_objects objects", objects)
    if images.ndim != 3 or objects.ndim != 3 or len(images) != len(objects) or len(images) < 2:
        reject("joint_objects images, objects", "[N, H, W] and [N, h, w], N at least 2",
               (tuple(images.shape), tuple(objects.shape)))  # fmt: skip
    if not (images.isfinite().all() and objects.isfinite().all()) or (objects < 0).any():
        reject("joint_objects images, objects", "finite, and objects at least 0", "other values")
    if not (images.double().mean((-2, -1)) > 0).all() or not (objects.double().sum((-2, -1)) > 0).all():
        reject("joint_objects images, objects", "above 0 in the mean", "a dark image")
    step, grain = same_optics("joint_objects", optics, len(images))
    seen = _Seen(images.double(), objects.double(), step, grain, optics)
    ways = [seen.placed(turned) for turned in (False, True)]
    ways.sort(key=lambda way: -way[0])
    (best, aligned, flipped, shift), (other, *_) = ways
    for _ in range(STEPS):
        for n in range(len(aligned)):  # against what all others say of the medium
            aligned[n], turn, moved = seen.reconsidered(aligned, n)
            shift[n] = (-shift[n] if turn else shift[n]) + moved
            flipped[n] ^= turn
        aligned = seen.improved(aligned)
    image = (aligned / aligned.amax((-2, -1), keepdim=True).clamp_min(1e-30)).flip((-2, -1)).float()
    return Joint(image, flipped, -shift, best, other)


def same_optics(owner: str, optics: Optics, count: int) -> tuple[float, float]:
    """Step and grain of so many images, of which all have the same."""
    instance(f"{owner} optics", optics, Optics)
    choice("Optics.profile", optics.profile, PROFILES)
    flag("Optics.pixel_integration", optics.pixel_integration)
    step, grain = (
        each_of(f"Optics.{name}", getattr(optics, name), count, torch.float64).unique() for name in ("step", "grain")
    )
    if len(step) > 1 or len(grain) > 1:
        reject(f"{owner} optics", "the same for all images", (step.tolist(), grain.tolist()))
    return float(step), float(grain)


def camera_spectra(flat: Tensor, grain: float, optics: Optics) -> tuple[Tensor, Tensor, Tensor, Tensor]:
    """Spectra of images real[N, H, W] about 0, under a window that falls to zero at the camera's edges.

    Then the power that the optics pass, and the frequencies of rows and columns, in cycles a pixel: complex[N, H, G],
    float64[H, G], float64[H], float64[G].
    """
    rows, columns = flat.shape[-2:]
    edge = [torch.from_numpy(np.sqrt(np.hanning(n + 2)[1:-1])) for n in (rows, columns)]
    down, across = torch.fft.fftfreq(rows, dtype=torch.float64), torch.fft.rfftfreq(columns, dtype=torch.float64)
    window = Window(optics.profile, 1.0)
    passed = torch.from_numpy(window.overlap((across * grain).numpy(), (down[:, None] * grain).numpy()))
    if optics.pixel_integration:
        passed = passed * torch.from_numpy(np.sinc(down[:, None].numpy()) * np.sinc(across.numpy())) ** 2
    return torch.fft.rfft2(flat * edge[0][:, None] * edge[1]), passed, down, across


class _Seen:
    """Images in the camera's frequencies, and what objects look like there; objects as the camera sees them."""

    def __init__(self, images: Tensor, objects: Tensor, step: float, grain: float, optics: Optics) -> None:
        rows, columns = images.shape[-2:]
        light = images / images.mean((-2, -1), keepdim=True) - 1
        spectrum, passed, down, across = camera_spectra(light, grain, optics)
        self.used = passed > _PASSED
        self.used[0, 0] = False
        if not self.used.any() or not float(light.square().mean()) > 1e-20:
            reject("joint_objects images", "images with contrast, several speckle grains wide", tuple(images.shape))
        self.spectrum, self.passed = torch.where(self.used, spectrum, 0), passed
        self.twice = torch.where(across > 0, 2.0, 1.0)  # columns of either sign of the frequency
        self.objects = torch.nn.functional.pad(objects, (MARGIN,) * 4).flip((-2, -1))
        self.waves = tuple(
            torch.exp(-2j * torch.pi * step * f[:, None] * torch.arange(n))
            for f, n in zip((down, across), self.objects.shape[-2:], strict=True)
        )
        aside = torch.arange(-REACH, REACH + 1)
        self.ramps = tuple(torch.exp(2j * torch.pi * step * f[:, None] * aside) for f in (down, across))
        self.share = (step / rows) * (step / columns)  # of a sum over frequencies, in an object pixel

    def transformed(self, objects: Tensor) -> Tensor:
        """O of objects real[..., h, w] of any sum, complex[..., F, G]."""
        whole = objects / objects.sum((-2, -1), keepdim=True)
        return self.waves[0] @ whole.to(torch.complex128) @ self.waves[1].mT

    def best_shift(self, product: Tensor) -> tuple[float, int, int]:
        """Largest value, over shifts of an object, of the sum of a product of spectra complex[F, G], and where."""
        values = (self.ramps[0].mT @ (product * self.twice) @ self.ramps[1]).real
        place = int(values.argmax())
        return float(values.max()), place // len(values) - REACH, place % len(values) - REACH

    def placed(self, turned: bool) -> tuple[float, Tensor, Tensor, Tensor]:
        """Objects in one place, beside the first, which is turned or not; how well they fit, turns and shifts."""
        first = self.objects[0].flip((-2, -1)) if turned else self.objects[0]
        aligned, total = [first], 0.0
        flipped, shift = torch.tensor([turned]), torch.zeros(1, 2, dtype=torch.int64)
        seen = self.transformed(first)
        for n in range(1, len(self.objects)):
            ways = []
            for turn in (False, True):
                own = self.objects[n].flip((-2, -1)) if turn else self.objects[n]
                other = self.transformed(own)
                power = (self.passed * seen.abs() * other.abs()).square()
                weight = self.passed / (power + 1e-3 * power[self.used].max())
                product = self.spectrum[0] * self.spectrum[n].conj() * seen.conj() * other * weight
                ways.append((*self.best_shift(product), own, turn))
            value, down, right, own, turn = max(ways, key=lambda way: way[0])
            total += value
            aligned.append(own.roll((-down, -right), (-2, -1)))
            flipped = torch.cat([flipped, torch.tensor([turn])])
            shift = torch.cat([shift, torch.tensor([[-down, -right]])])
        return total, torch.stack(aligned), flipped, shift

    def medium(self, seen: Tensor, spectrum: Tensor) -> Tensor:
        """S from objects' transforms and images' spectra, complex[F, G]."""
        power = seen.abs().square().sum(0)
        return (spectrum * seen.conj()).sum(0) / (power + _REGULAR * power[self.used].mean())

    def told(self, medium: Tensor, spectrum: Tensor) -> tuple[Tensor, Tensor]:
        """O as images say, where the medium passes, and how far that is to be believed."""
        power = medium.abs().square()
        floor = power + LEFT * power[self.used].mean()
        return spectrum * medium.conj() / floor, torch.where(self.used, power / floor, 0)

    def reconsidered(self, found: Tensor, n: int) -> tuple[Tensor, bool, Tensor]:
        """Object n, turned and moved to where all others have it; whether it was turned, and how far it was moved."""
        seen = self.transformed(found)
        rest = [m for m in range(len(found)) if m != n]
        spectrum, _ = self.told(self.medium(seen[rest], self.spectrum[rest]), self.spectrum[n])
        ways = []
        for turn in (False, True):
            own = found[n].flip((-2, -1)) if turn else found[n]
            ways.append((*self.best_shift(spectrum.conj() * self.transformed(own)), own, turn))
        _, down, right, own, turn = max(ways, key=lambda way: way[0])
        return own.roll((-down, -right), (-2, -1)), turn, torch.tensor([-down, -right])

    def improved(self, found: Tensor) -> Tensor:
        """One step of alternating least squares."""
        seen = self.transformed(found)
        spectrum, believed = self.told(self.medium(seen, self.spectrum), self.spectrum)
        change = (spectrum - believed * seen) * self.twice
        update = (self.waves[0].conj().mT @ change @ self.waves[1].conj()).real * self.share
        whole = found / found.sum((-2, -1), keepdim=True)
        return (whole + update).clamp_min(0)
