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


def unlike_blurred(logits: Tensor, target: Tensor) -> Tensor:
    """1 - Pearson correlation with the target spread over each pixel's eight neighbours, a half and a quarter of it.

    Of single points, which no gradient finds: a point one pixel away counts as wrong as one that is missing.
    """
    half = torch.tensor([0.5, 1.0, 0.5], dtype=target.dtype, device=target.device)
    spread = functional.conv2d(target[:, None], torch.outer(half, half)[None, None], padding=1)[:, 0]
    return 1 - pearson(logits.sigmoid(), spread).mean()


def invariant(loss: Loss) -> Loss:
    """Make a loss blind to shifts and the 180-degree flip of the target."""

    def aligned(logits: Tensor, target: Tensor) -> Tensor:
        with torch.no_grad():
            target = align(target, logits.sigmoid().to(target.dtype))
        return loss(logits, target)

    aligned.__doc__ = f"{loss.__doc__} The target is first moved onto the prediction."
    return aligned


_PLAIN: dict[str, Loss] = {
    "pearson": negative_pearson,
    "bce": cross_entropy,
    "ssim": dissimilarity,
    "l1": absolute_error,
    "pearson+bce": pearson_and_entropy,
    "blurred": unlike_blurred,
}
LOSSES: dict[str, Loss] = _PLAIN | {f"{name}-invariant": invariant(loss) for name, loss in _PLAIN.items()}
"""Name to loss of (logits, target)."""


def loss_named(name: str) -> Loss:
    """Find a loss.

    Raises
    ------
    RuleError
        If there is none of that name.
    """
    if name not in LOSSES:
        reject("loss", f"one of {', '.join(LOSSES)}", name)
    return LOSSES[name]
