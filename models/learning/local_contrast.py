"""Blurred speckle place by place, for networks that draw a map of the contrast: sums over blocks of a few pixels.

The mean over a block of the squared fluctuation is what a sliding window calls the squared contrast, of few grains:
right on average, and noisy. A network sees many blocks at once, and what else tells how far speckle has blurred:
logarithms, which dark pixels decide as bright ones decide squares, and products of two exposures, in which only what
rests is alike.
"""

from collections.abc import Mapping
from typing import Any

import torch
from torch import Tensor
from torch.nn import functional

from specklegen.core.errors import reject
from specklegen.models.learning.exposures import DARKEST

BLOCK = 4
"""Side of a block in pixels."""


def require_maps(batch: Mapping[str, Any]) -> None:
    """Refuse batches without stacks and maps of square cameras whose side is a number of blocks."""
    if "stack" not in batch or "target" not in batch or batch["target"].shape != batch["stack"].shape:
        reject("batch", 'a batch with "stack" and, of its shape, "target"', sorted(batch),
               "Use a recipe such as flow-vessel.")
    rows, columns = batch["stack"].shape[-2:]
    if rows != columns or rows % BLOCK:
        reject("batch stack", f"of a square camera whose side is a multiple of {BLOCK}", (rows, columns))


def local_contrast_input(batch: Mapping[str, Any]) -> Tensor:
    """Maps float[B, C, H/BLOCK, W/BLOCK] of stacks of E exposures, ``C = 3 E + E (E - 1) / 2``.

    Of each exposure means over blocks of the fluctuation i = I / <I> - 1, of i^2, and of log(I / <I>); then of the
    products of each two.
    """
    require_maps(batch)
    stack = batch["stack"].float()
    over = stack / stack.mean((-2, -1), keepdim=True)
    flat = over - 1
    one, other = torch.triu_indices(stack.shape[1], stack.shape[1], 1)
    maps = [flat, flat.square(), over.clamp_min(DARKEST).log(), flat[:, one] * flat[:, other]]
    return functional.avg_pool2d(torch.cat(maps, 1), BLOCK)
