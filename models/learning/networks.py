"""Networks that look through fog: a residual net, a small U-Net, its variant for stacks, and a dense net to judge by.

All take float[B, 2, H, W] (:mod:`specklegen.models.learning.inputs`) and return logits float[B, h, w]; the brightness
is their sigmoid. The U-Net first folds blocks of pixels into channels, so that its convolutions run on half the
object's resolution (few, wide ones suit a processor better than many narrow ones), and unfolds them at the end. At its
bottom are two dense layers: every lag bears on every pixel of the object, which convolutions alone would learn only
slowly. The residual net draws the conclusion: it has dense layers only, and sees each pair of opposite lags once.
"""

from collections.abc import Callable

import torch
from torch import Tensor, nn

from specklegen.core.errors import reject
from specklegen.models.learning.inputs import zero_phase

CHANNELS = 2
"""Of every input: the picture, and the scale."""
DEPTH = 2
"""Times that the U-Net halves its picture."""
UNFOLD = 2
"""Object pixels a pixel of the U-Net's top level, either way."""


def parameter_count(network: nn.Module) -> int:
    """Numbers that training changes."""
    return sum(p.numel() for p in network.parameters() if p.requires_grad)


def _convolutions(inward: int, outward: int) -> nn.Sequential:
    layers: list[nn.Module] = []
    for channels in (inward, outward):
        layers += [nn.Conv2d(channels, outward, 3, padding=1, bias=False), nn.GroupNorm(4, outward), nn.SiLU()]
    return nn.Sequential(*layers)


class UNet(nn.Module):
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
        self.down = nn.ModuleList(_convolutions(widths[max(n - 1, 0)], widths[n]) for n in range(DEPTH + 1))
        bottom = widths[-1] * (self.inner // unit) ** 2
        self.mix = nn.Sequential(nn.Flatten(), nn.Linear(bottom, 8 * width), nn.SiLU(), nn.Linear(8 * width, bottom))
        self.up = nn.ModuleList(_convolutions(widths[n] + widths[n + 1], widths[n]) for n in reversed(range(DEPTH)))
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


class StackUNet(UNet):
    """U-Net for several images of one object: each is folded alone, then their features are averaged.

    The order of the images does not matter, and a stack may have any number of them.
    """

    def __init__(self, side: int, shape: tuple[int, int] = (28, 28), width: int = 16) -> None:
        super().__init__(side, shape, width)
        self.each = _convolutions(width, width)

    def forward(self, pictures: Tensor) -> Tensor:
        """Return logits float[B, h, w] of stacks float[B, T, 2, H, W]."""
        each = self.each(self.features(pictures.flatten(0, 1)))
        return self.reconstruct(each.unflatten(0, pictures.shape[:2]).mean(1))


class DenseNet(nn.Module):
    """One hidden layer of 16 * ``width`` units: the least that can be called a network."""

    def __init__(self, side: int, shape: tuple[int, int] = (28, 28), width: int = 16) -> None:
        super().__init__()
        self.shape = shape
        hidden = 16 * width
        self.layers = nn.Sequential(
            nn.Flatten(), nn.Linear(CHANNELS * side**2, hidden), nn.ReLU(), nn.Linear(hidden, shape[0] * shape[1])
        )

    def forward(self, pictures: Tensor) -> Tensor:
        """Return logits float[B, h, w] of pictures float[B, 2, H, W]."""
        return self.layers(pictures).reshape(-1, *self.shape)


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


class ResidualNet(nn.Module):
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

    Raises
    ------
    RuleError
        If the lags of the object do not fit the input.
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


class Perceptron(nn.Module):
    """Two hidden layers of 16 * ``width`` units on features float[B, ``side``]."""

    def __init__(self, side: int, shape: tuple[int, int] = (1, 4), width: int = 8) -> None:
        super().__init__()
        self.shape, units = shape, 16 * width
        self.layers = nn.Sequential(
            nn.Linear(side, units), nn.SiLU(), nn.Linear(units, units), nn.SiLU(),
            nn.Linear(units, shape[0] * shape[1]),
        )  # fmt: skip

    def forward(self, features: Tensor) -> Tensor:
        """Return float[B, h, w] of features float[B, ``side``]."""
        return self.layers(features).reshape(-1, *self.shape)


NETWORKS: dict[str, Callable[..., nn.Module]] = {
    "residual": ResidualNet, "unet": UNet, "stack-unet": StackUNet, "dense": DenseNet, "perceptron": Perceptron,
}  # fmt: skip
"""Name to network of (side, shape, width)."""


def build(name: str, side: int, shape: tuple[int, int], width: int, seed: int) -> nn.Module:
    """Make a network whose first weights are a function of the seed; the global generator is left as it was.

    Raises
    ------
    RuleError
        If there is no network of that name.
    """
    if name not in NETWORKS:
        reject("network", f"one of {', '.join(NETWORKS)}", name)
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(seed)
        return NETWORKS[name](side=side, shape=tuple(shape), width=width)
