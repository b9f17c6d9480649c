"""A U-Net of convolutions alone that draws maps of the contrast of several exposures."""

import torch
from torch import Tensor, nn

from specklegen.core.errors import reject
from specklegen.models.learning.networks.network import Network

_DEPTH = 3  # times that the maps are halved: a vessel is as wide as several blocks
_LEVEL = 0.8  # contrast that an untrained network tells


class ContrastNet(Network, name="contrast", inputs=("local-contrast",), targets=("contrast",)):
    """Maps of blocks float[B, C, ``side``, ``side``] to contrasts, one map below the other, float[B, E H, W].

    Nothing is normalised on the way: how large squares of fluctuations are is what is asked.

    Parameters
    ----------
    side
        Blocks along a side.
    shape
        (E H, W) of E maps of square cameras, W a multiple of ``side``.
    width
        Channels at the top; twice as many after each halving.

    Raises
    ------
    RuleError
        For maps that are not square, or not of whole blocks.
    """

    def __init__(self, side: int, shape: tuple[int, int] = (384, 128), width: int = 16) -> None:
        super().__init__()
        if shape[0] % shape[1] or shape[1] % side:
            reject("ContrastNet.shape", f"of square maps, one below the other, of blocks of {side} a side", shape)
        self.shape, self.maps = shape, shape[0] // shape[1]
        widths = [width * 2**level for level in range(_DEPTH + 1)]
        seen = 3 * self.maps + self.maps * (self.maps - 1) // 2
        self.down = nn.ModuleList(_convolutions(below, above) for below, above in
                                  zip([seen, *widths[:-1]], widths, strict=True))  # fmt: skip
        self.up = nn.ModuleList(_convolutions(3 * widths[n], widths[n]) for n in reversed(range(_DEPTH)))
        self.head = nn.Conv2d(width, self.maps, 1)
        nn.init.constant_(self.head.bias, _LEVEL)  # type: ignore[arg-type]

    def forward(self, blocks: Tensor) -> Tensor:
        """Return contrasts float[B, E H, W] of maps float[B, C, ``side``, ``side``]."""
        x, kept = blocks, []
        for level, block in enumerate(self.down):
            x = block(nn.functional.avg_pool2d(x, 2, ceil_mode=True) if level else x)
            kept.append(x)
        x = kept.pop()
        for block in self.up:
            beside = kept.pop()
            x = nn.functional.interpolate(x, size=beside.shape[-2:], mode="bilinear")
            x = block(torch.cat([x, beside], dim=1))
        pixels = nn.functional.interpolate(self.head(x), size=(self.shape[1],) * 2, mode="bilinear")
        return pixels.flatten(1, 2)


def _convolutions(inward: int, outward: int) -> nn.Sequential:
    """Two 3 x 3 convolutions; beyond the edge the picture goes on as it is there."""
    layers: list[nn.Module] = []
    for channels in (inward, outward):
        layers += [nn.Conv2d(channels, outward, 3, padding=1, padding_mode="replicate"), nn.SiLU()]
    return nn.Sequential(*layers)
