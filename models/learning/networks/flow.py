"""A net that takes noise off pictures, given the measurement or not: the prior of objects, and its posterior.

Flow matching (Lipman et al., ICLR 2023): between noise z and a picture u, whose brightness is scaled to ``[-1, 1]``,
lies

    x(t) = t u + (1 - t) z,      dx/dt = (u - x) / (1 - t),

so that who knows the mean of u given x(t) can go from noise to a picture. The net states that mean. Shown nothing
else it is the prior, what pictures look like. Shown, of an earlier estimate, the gradient of the exact likelihood and
the picture with the amplitudes that lags were measured to have
(:mod:`specklegen.models.learning.feedback`), it states the mean given the measurement too: how far to follow them is
learned, on measurements drawn from their law. Input and output are scaled to order one at every t (Karras et al.,
NeurIPS 2022, section 5). Nothing depends on the camera.
"""

import math

import torch
from torch import Tensor, nn

SPREAD = 0.6
"""Spread of the values of pictures, -1 to 1, that the scales suppose."""
WAVES = 16  # sines and cosines of t


class Residual(nn.Module):
    """Two convolutions, their scale and offset between them computed from a description float[B, d]."""

    def __init__(self, width: int, described: int) -> None:
        super().__init__()
        self.first = nn.Sequential(nn.GroupNorm(8, width), nn.SiLU(), nn.Conv2d(width, width, 3, padding=1))
        self.norm = nn.GroupNorm(8, width)
        self.told = nn.Linear(described, 2 * width)
        self.last = nn.Conv2d(width, width, 3, padding=1)
        for weight in (*self.last.parameters(), *self.told.parameters()):
            nn.init.zeros_(weight)

    def forward(self, x: Tensor, description: Tensor) -> Tensor:
        """Return float[B, width, h, w]."""
        scale, offset = self.told(description)[..., None, None].chunk(2, dim=1)
        return x + self.last(nn.functional.silu(self.norm(self.first(x)) * (1 + scale) + offset))


class Attention(nn.Module):
    """Every place sees every other one."""

    def __init__(self, width: int, heads: int = 4) -> None:
        super().__init__()
        self.heads = heads
        self.norm, self.asked = nn.GroupNorm(8, width), nn.Conv2d(width, 3 * width, 1)
        self.last = nn.Conv2d(width, width, 1)
        for weight in self.last.parameters():
            nn.init.zeros_(weight)

    def forward(self, x: Tensor) -> Tensor:
        """Return float[B, width, h, w]."""
        asked = self.asked(self.norm(x)).flatten(2).unflatten(1, (3, self.heads, -1)).transpose(-2, -1)
        attended = nn.functional.scaled_dot_product_attention(*asked.unbind(1))
        return x + self.last(attended.transpose(-2, -1).reshape_as(x))


class Flow(nn.Module):
    """The net; see the module.

    Parameters
    ----------
    frame
        Side of the pictures, a multiple of 4.
    width, inner
        Channels at a half and at a quarter of the resolution, multiples of 8.
    pictures, numbers
        How many pictures, and numbers, feedback has.
    """

    def __init__(self, frame: int = 36, width: int = 48, inner: int = 128, pictures: int = 4, numbers: int = 9) -> None:
        super().__init__()
        self.frame, self.width, self.inner, self.pictures, self.numbers = frame, width, inner, pictures, numbers
        features = inner
        self.describe = nn.Sequential(
            nn.Linear(2 * WAVES + numbers, features), nn.SiLU(), nn.Linear(features, features), nn.SiLU()
        )
        self.first = nn.Conv2d(4 * (1 + pictures), width, 3, padding=1)
        self.before = nn.ModuleList(Residual(width, features) for _ in range(2))
        self.down = nn.Conv2d(width, inner, 2, stride=2)
        self.middle = nn.ModuleList(Residual(inner, features) for _ in range(4))
        self.look = nn.ModuleList([Attention(inner), nn.Identity(), Attention(inner), nn.Identity()])
        self.up = nn.ConvTranspose2d(inner, width, 2, stride=2)
        self.join = nn.Conv2d(2 * width, width, 1)
        self.after = nn.ModuleList(Residual(width, features) for _ in range(2))
        self.last = nn.Sequential(nn.GroupNorm(8, width), nn.SiLU(), nn.Conv2d(width, 4, 3, padding=1))

    def forward(self, noisy: Tensor, time: Tensor, shown: Tensor | None = None, told: Tensor | None = None) -> Tensor:
        """Mean of the pictures, about -1 to 1, float[B, n, n].

        Parameters
        ----------
        noisy
            x(t), float[B, n, n].
        time
            t, float[B], 0 for noise, 1 for a picture.
        shown, told
            Feedback: float[B, pictures, n, n] and float[B, numbers]; None for the prior.
        """
        t = time[:, None, None]
        spread = (t.square() * SPREAD**2 + (1 - t).square()).sqrt()
        if shown is None:
            shown = noisy.new_zeros(len(noisy), self.pictures, self.frame, self.frame)
        if told is None:
            told = noisy.new_zeros(len(noisy), self.numbers)
        turns = time[:, None] * math.pi * 2.0 ** torch.linspace(-1, 4, WAVES, device=time.device, dtype=time.dtype)
        description = self.describe(torch.cat([turns.sin(), turns.cos(), told], dim=1))
        pictures = torch.cat([(noisy / spread)[:, None], shown], dim=1)
        x = self.first(nn.functional.pixel_unshuffle(pictures, 2))
        for block in self.before:
            x = block(x, description)
        y = self.down(x)
        for block, look in zip(self.middle, self.look, strict=True):
            y = look(block(y, description))
        x = self.join(torch.cat([x, self.up(y)], dim=1))
        for block in self.after:
            x = block(x, description)
        correction = nn.functional.pixel_shuffle(self.last(x), 2)[:, 0].to(noisy.dtype)
        return t * (SPREAD / spread).square() * noisy + (1 - t) * SPREAD / spread * correction


def scaled_loss(found: Tensor, pictures: Tensor, time: Tensor) -> Tensor:
    """Squared error over the square of the scale that the net's own output has there, float[B]."""
    scale = (1 - time) * SPREAD / (time.square() * SPREAD**2 + (1 - time).square()).sqrt()
    return (found - pictures).square().mean((-2, -1)) / scale.square()
