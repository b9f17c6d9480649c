"""Losses by name: ``LOSSES[name](logits, target)`` is float[], the mean over a batch of float[B, H, W].

Networks end in a logit; brightness is its sigmoid. Where the input is an autocorrelation, which has forgotten place and
orientation, name a loss with the suffix ``-invariant``: the target is first moved onto the prediction by
:func:`~specklegen.models.metrics.align`, without gradient, and the loss is then as differentiable as it was.
The motion is the minimum over a finite set, so the gradient is that of the smallest loss wherever there is one
smallest.
"""

from collections.abc import Callable

import torch
from torch import Tensor
from torch.nn import functional

from specklegen.core.errors import reject
from specklegen.models.metrics import align, pearson, structural_similarity

Loss = Callable[[Tensor, Tensor], Tensor]


def negative_pearson(logits: Tensor, target: Tensor) -> Tensor:
    """1 - Pearson correlation of the brightness."""
    return 1 - pearson(logits.sigmoid(), target).mean()


def cross_entropy(logits: Tensor, target: Tensor) -> Tensor:
    """Binary cross-entropy; the target's brightness is the probability of a lit pixel."""
    return functional.binary_cross_entropy_with_logits(logits, target)


def dissimilarity(logits: Tensor, target: Tensor) -> Tensor:
    """1 - SSIM of the brightness."""
    return 1 - structural_similarity(logits.sigmoid(), target).mean()


def absolute_error(logits: Tensor, target: Tensor) -> Tensor:
    """Mean absolute error of the brightness."""
    return functional.l1_loss(logits.sigmoid(), target)


def pearson_and_entropy(logits: Tensor, target: Tensor) -> Tensor:
    """Sum of the first two: the second keeps a gradient where the sigmoid has saturated."""
    return negative_pearson(logits, target) + cross_entropy(logits, target)


def spread(target: Tensor) -> Tensor:
    """Target with a half or a quarter of each pixel on its eight neighbours, cyclic as shifts are."""
    for axis in (-2, -1):
        target = target + 0.5 * (target.roll(1, axis) + target.roll(-1, axis))
    return target


def on_spread(loss: Loss) -> Loss:
    """Make a loss one of the target that is spread: a point one pixel away is nearly right, and is found."""

    def blurred(logits: Tensor, target: Tensor) -> Tensor:
        return loss(logits, spread(target))

    blurred.__doc__ = f"{loss.__doc__} The target is spread first."
    return blurred


def invariant(loss: Loss) -> Loss:
    """Make a loss blind to shifts and the 180-degree flip of the target."""

    def aligned(logits: Tensor, target: Tensor) -> Tensor:
        with torch.no_grad():
            target = align(target, logits.sigmoid().to(target.dtype))
        return loss(logits, target)

    aligned.__doc__ = f"{loss.__doc__} The target is first moved onto the prediction."
    return aligned


_PLAIN: dict[str, Loss] = {
    "pearson": negative_pearson, "bce": cross_entropy, "ssim": dissimilarity, "l1": absolute_error,
    "pearson+bce": pearson_and_entropy,
}  # fmt: skip
LOSSES: dict[str, Loss] = _PLAIN | {f"{name}-invariant": invariant(loss) for name, loss in _PLAIN.items()}
"""Name to loss of (logits, target)."""
LOSSES |= {  # spread first and moved afterwards: where sharp points fit best is decided by noise
    "blurred": on_spread(negative_pearson), "blurred-invariant": on_spread(invariant(negative_pearson))
}  # fmt: skip


def loss_named(name: str) -> Loss:
    """Find a loss."""
    if name not in LOSSES:
        reject("loss", f"one of {', '.join(LOSSES)}", name)
    return LOSSES[name]
