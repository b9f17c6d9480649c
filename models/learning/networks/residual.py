"""A residual net of dense layers: every lag bears on every pixel of the object, and it sees opposite lags once."""

import torch
from torch import Tensor, nn

from specklegen.core.errors import reject
from specklegen.models.learning.inputs import zero_phase
from specklegen.models.learning.networks.network import Network


class ResidualBlock(nn.Module):
    """x + W2 gelu(W1 norm(x)), twice as wide inside (He et al. 2016); at first the identity."""

    def __init__(self, width: int) -> None:
        super().__init__()
        self.norm = nn.LayerNorm(width)
        self.widen, self.narrow = nn.Linear(width, 2 * width), nn.Linear(2 * width, width)
        nn.init.zeros_(self.narrow.weight)
        nn.init.zeros_(self.narrow.bias)

    def forward(self, x: Tensor) -> Tensor:
        """Return float[B, width] of float[B, width]."""
        return x + self.narrow(nn.functional.gelu(self.widen(self.norm(x))))


class ResidualNet(
    Network, name="residual", inputs=("autocorrelation", "periodogram"), targets=("object", "label", "range")
):
    """Residual blocks of dense layers, for autocorrelations: no lag is nearer to a pixel than another.

    What goes in are the lags shorter than the object, of two opposite ones one; the same of the image of zero phases
    (:func:`~specklegen.models.learning.inputs.zero_phase`), whose square root no layer would find by itself; and the
    scale.

    Parameters
    ----------
    side
        Side of the input, at least twice that of the object.
    shape
        (rows, columns) of the object.
    width
        A sixteenth of the units that pass from block to block.
    """

    BLOCKS = 3

    def __init__(self, side: int, shape: tuple[int, int] = (28, 28), width: int = 26) -> None:
        super().__init__()
        if shape[0] > 1 and side < 2 * max(shape):
            reject("ResidualNet.side", f"at least twice that of the object, {2 * max(shape)}", side)
        self.shape, units, middle = shape, 16 * width, side // 2
        rows, columns = shape if shape[0] > 1 else (middle, middle)  # a row is no object: every lag may count
        self.rows = slice(middle + 1 - rows, middle + 1)
        self.columns = slice(middle + 1 - columns, middle + columns)
        self.first = nn.Linear(2 * rows * (2 * columns - 1) + 1, units)
        self.blocks = nn.Sequential(*(ResidualBlock(units) for _ in range(self.BLOCKS)))
        self.last = nn.Sequential(nn.LayerNorm(units), nn.Linear(units, shape[0] * shape[1]))

    def forward(self, pictures: Tensor) -> Tensor:
        """Return logits float[B, h, w] of pictures float[B, 2, H, W]."""
        lags = pictures[:, 0]
        halves = [x[:, self.rows, self.columns].flatten(1) for x in (lags, zero_phase(lags))]
        seen = torch.cat([*halves, pictures[:, -1, :1, 0]], dim=1)
        return self.last(self.blocks(self.first(seen))).reshape(-1, *self.shape)
