"""A small U-Net with a dense bottom.

It first folds blocks of pixels into channels, so that its convolutions run on half the object's resolution (few, wide
ones suit a processor better than many narrow ones), and unfolds them at the end. At its bottom are two dense layers:
every lag bears on every pixel of the object, which convolutions alone would learn only slowly.
"""

import torch
from torch import Tensor, nn

from specklegen.core.errors import reject
from specklegen.models.learning.networks.channels import CHANNELS
from specklegen.models.learning.networks.network import Network

DEPTH = 2
"""Times that the U-Net halves its picture."""
UNFOLD = 2
"""Object pixels a pixel of the U-Net's top level, either way."""


def convolutions(inward: int, outward: int) -> nn.Sequential:
    """Two 3 x 3 convolutions from some channels to others, each normalised."""
    layers: list[nn.Module] = []
    for channels in (inward, outward):
        layers += [nn.Conv2d(channels, outward, 3, padding=1, bias=False), nn.GroupNorm(4, outward), nn.SiLU()]
    return nn.Sequential(*layers)


class UNet(Network, name="unet"):
    """U-Net of Ronneberger et al. (2015), small, with a dense bottom.

    Parameters
    ----------
    side
        Side of the input, at least that of the object.
    shape
        (rows, columns) of the object.
    width
        Channels at the top, a multiple of 4; twice as many after each halving.

    Raises
    ------
    RuleError
        If the object is larger than the input, or the width is no multiple of 4.
    """

    def __init__(self, side: int, shape: tuple[int, int] = (28, 28), width: int = 32) -> None:
        super().__init__()
        if side < max(shape):
            reject("UNet.side", f"at least that of the object, {max(shape)}", side)
        if width < 4 or width % 4:
            reject("UNet.width", "a multiple of 4", width)
        self.shape = shape
        unit = 2**DEPTH
        needed = unit * -(-max(shape) // (unit * UNFOLD))  # the smallest side that can be halved and holds the object
        self.fold = max(1, side // needed)
        self.inner = unit * -(-side // (unit * self.fold))
        widths = [width * 2**level for level in range(DEPTH + 1)]
        self.stem = nn.Sequential(nn.PixelUnshuffle(self.fold), nn.Conv2d(CHANNELS * self.fold**2, width, 1))
        self.down = nn.ModuleList(convolutions(widths[max(n - 1, 0)], widths[n]) for n in range(DEPTH + 1))
        bottom = widths[-1] * (self.inner // unit) ** 2
        self.mix = nn.Sequential(nn.Flatten(), nn.Linear(bottom, 8 * width), nn.SiLU(), nn.Linear(8 * width, bottom))
        self.up = nn.ModuleList(convolutions(widths[n] + widths[n + 1], widths[n]) for n in reversed(range(DEPTH)))
        self.head = nn.Sequential(nn.Conv2d(width, UNFOLD**2, 1), nn.PixelShuffle(UNFOLD))

    def features(self, pictures: Tensor) -> Tensor:
        """Fold float[B, 2, H, W] into channels, padded with zeros: float[B, width, s, s]."""
        missing = [self.inner * self.fold - n for n in pictures.shape[-2:]]
        return self.stem(nn.functional.pad(pictures, (0, missing[1], 0, missing[0])))

    def reconstruct(self, x: Tensor) -> Tensor:
        """Turn features into logits float[B, h, w]."""
        kept = []
        for level, block in enumerate(self.down):
            x = block(nn.functional.avg_pool2d(x, 2) if level else x)
            kept.append(x)
        x = x + self.mix(kept.pop()).reshape(x.shape)
        for block in self.up:
            x = block(torch.cat([nn.functional.interpolate(x, scale_factor=2.0), kept.pop()], dim=1))
        top, left = ((UNFOLD * self.inner - n) // 2 for n in self.shape)
        return self.head(x)[:, 0, top : top + self.shape[0], left : left + self.shape[1]]

    def forward(self, pictures: Tensor) -> Tensor:
        """Return logits float[B, h, w] of pictures float[B, 2, H, W]."""
        return self.reconstruct(self.features(pictures))
