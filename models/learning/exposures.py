"""Statistics of exposures of moving speckle for networks: how far each has blurred, and what they have in common.

The covariance of the images of two exposures, over their means, is the square of the share of the light at rest, since
what moves is forgotten in between (:mod:`specklegen.datasets.recipes.exposure_stack`); that of one exposure with itself
is K^2, what its speckle has left of its contrast (:mod:`specklegen.theory.speckle_contrast`).
"""

from collections.abc import Mapping
from typing import Any

import torch
from torch import Tensor

from specklegen.core.errors import reject
from specklegen.models.retrieval.camera_noise import Stated, camera_noise

LEAST = 1e-6
"""K^2 below which a camera's noise has taken all of it."""
DARKEST = 1e-3
"""Of an intensity over its mean, whose logarithm is taken: a camera counts nothing there."""


def shared_contrast(batch: Mapping[str, Any], camera: Stated = "none") -> Tensor:
    """Covariances of the exposures of stacks over their means, float64[B, T, T]; K^2 on the diagonal, above 0.

    Parameters
    ----------
    batch
        Of a recipe of exposures.
    camera
        What states the noise of a pixel, which is taken off K^2, where grains are too small to read it off the image.
    """
    if "stack" not in batch:
        reject("batch", 'a batch with "stack"', sorted(batch), "Use a recipe such as lsci-slab.")
    stack, drawn = batch["stack"].double(), batch["parameters"]
    flat = (stack / stack.mean((-2, -1), keepdim=True) - 1).flatten(2)
    matrix = flat @ flat.mT / (flat.shape[-1] - 1)
    grain = (drawn["wavelength"] / drawn["width"] / drawn["camera_pitch"]).to(stack)
    squared = (matrix.diagonal(dim1=-2, dim2=-1) - camera_noise(stack, grain[:, None], camera)).clamp_min(LEAST)
    return matrix.diagonal_scatter(squared, dim1=-2, dim2=-1)


def exposures_input(batch: Mapping[str, Any]) -> Tensor:
    """Features float[B, T (T + 3) / 2] of stacks of T exposures.

    log10 of K^2 of each; the mean logarithm of its intensity over the mean, which dark pixels decide as bright ones
    decide K^2, so that both together tell more; and the covariances of each two.
    """
    matrix, stack = shared_contrast(batch), batch["stack"].double()
    one, other = torch.triu_indices(*matrix.shape[-2:], 1)
    flat = (stack / stack.mean((-2, -1), keepdim=True)).clamp_min(DARKEST)
    parts = [matrix.diagonal(dim1=-2, dim2=-1).log10(), flat.log().mean((-2, -1)), matrix[:, one, other]]
    return torch.cat(parts, dim=1).float()
