"""A small net of convolutions that reads numbers of a medium off lags: how they fade tells of the memory effect.

Lags that are far from zero are faint, and it is there that the memory effect is seen. So what goes in beside the lags
are their square roots, as they are and times their distance, and the distance.
"""

import torch
from torch import Tensor, nn

from specklegen.models.learning.networks.network import Network

_STRIDES = 3  # times that the lags are halved
_RISE = 4.0  # weight of the longest lag's root over that at zero


class LagNet(Network, name="lags", inputs=("autocorrelation", "periodogram"), targets=("range", "material")):
    """Three convolutions and a dense layer on one of two opposite lags each: float[B, 2, H, W] to float[B, h, w].

    The scale, camera pixels in an object pixel, is not looked at: lags are on the object's pitch.

    Parameters
    ----------
    side
        Side of the input, the zero lag at [side // 2, side // 2].
    shape
        (1, K) of K numbers.
    width
        Channels of the first convolution; a sixteenth of the dense layer.
    """

    distance: Tensor

    def __init__(self, side: int, shape: tuple[int, int] = (1, 1), width: int = 8) -> None:
        super().__init__()
        self.shape, self.rows = shape, side // 2 + 1
        along = (torch.arange(side) - side // 2) / (side // 2)
        self.register_buffer("distance", torch.hypot(along[: self.rows, None], along), persistent=False)
        layers: list[nn.Module] = []
        channels, size = 4, [self.rows, side]
        for level in range(_STRIDES):
            wider, kernel = width * 2**level, 3 if level else 5
            layers += [nn.Conv2d(channels, wider, kernel, 2, kernel // 2), nn.SiLU()]
            channels, size = wider, [(n + 1) // 2 for n in size]
        units = channels * size[0] * size[1]
        self.convolutions = nn.Sequential(*layers, nn.Flatten())
        self.last = nn.Sequential(
            nn.LayerNorm(units), nn.Linear(units, 16 * width), nn.SiLU(), nn.Linear(16 * width, shape[0] * shape[1])
        )

    def forward(self, pictures: Tensor) -> Tensor:
        """Return float[B, h, w] of pictures float[B, 2, H, W]."""
        lags = pictures[:, 0, : self.rows]
        roots = lags.sign() * lags.abs().sqrt()
        away = self.distance.expand_as(lags)
        seen = torch.stack([2 * lags, 2 * roots, roots * (1 + _RISE * away), away], dim=1)
        return self.last(self.convolutions(seen)).reshape(-1, *self.shape)
