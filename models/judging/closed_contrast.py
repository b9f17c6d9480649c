"""Maps of contrast without learning: the sliding window, and the multi-exposure model fitted at each place.

s^2 / m^2 of the pixels in a window is noisy where it holds few grains, and blurs where it holds many (Briers and
Webster, J. Biomed. Opt. 1, 174 (1996)). Of a few sides of window the one is taken that is best on media of the training
split, of either method; the camera's noise is taken off, and what the window's own mean and few grains take off K^2 is
put back. The model (:func:`specklegen.theory.multi_exposure.multi_exposure_fit`) then has two numbers a place for all
exposures.
"""

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
import torch
from torch import Tensor
from torch.nn import functional

from specklegen.datasets.recipes.contrast_map import ContrastMap
from specklegen.models.learning.examples import batches_of
from specklegen.models.learning.exposures import LEAST
from specklegen.models.learning.local_contrast import BLOCK, require_maps
from specklegen.models.retrieval.camera_noise import camera_noise
from specklegen.theory.multi_exposure import multi_exposure_fit
from specklegen.theory.speckle_contrast import exponential_contrast_squared

Batch = Mapping[str, Any]
Maps = Callable[[Batch], np.ndarray]

WINDOWS = (3, 5, 7, 9, 13)
"""Sides of a window, in blocks."""
KNOWN = 16
"""Training media by which its side is chosen."""
_GRAIN = 4 / np.pi  # integral of [2 J1(z) / z]^2 over the plane, z = pi r, in squared grains


def window_contrast_squared(batch: Batch, recipe: ContrastMap, side: int) -> Tensor:
    """K^2 float64[B, E, H/BLOCK, W/BLOCK] of windows of so many blocks a side about each block, above 0."""
    require_maps(batch)
    assert recipe.camera is not None
    stack, grain = batch["stack"].double(), recipe.camera.pixels_per_grain
    # The pupil of a lens is round.
    noise = camera_noise(stack, torch.full((len(stack), 1), grain), recipe.exposure or "none", "disc")
    stack = stack / stack.mean((-2, -1), keepdim=True)
    mean, square = (
        functional.avg_pool2d(functional.avg_pool2d(each, BLOCK), side, 1, side // 2, count_include_pad=False)
        for each in (stack, stack.square())
    )
    ratio = (square - mean.square() - noise[..., None, None]) / mean.square()
    held = functional.avg_pool2d(torch.ones_like(mean), side, 1, side // 2) * (side * BLOCK) ** 2
    share = _GRAIN * grain**2 / held  # one over the grains of a window
    return (ratio / (1 - share - ratio * share)).clamp_min(LEAST)


def closed_contrast(recipe: ContrastMap, seed: int = 0, media: int = KNOWN) -> dict[str, Maps]:
    """Functions of batches of a recipe to maps of K float64[B, E, H, W]: a sliding window, and the model behind it.

    Parameters
    ----------
    recipe
        Whose durations, grain and camera are known, as to a laboratory.
    seed
        Of the training split.
    media
        Of it, by which the side of the window is chosen.
    """
    known = list(batches_of(recipe, media, seed, "train"))

    def windowed(side: int) -> Maps:
        return lambda batch: _pixels(window_contrast_squared(batch, recipe, side).clamp_max(1.0), batch)

    def fitted(side: int) -> Maps:
        return lambda batch: _pixels(_modelled(window_contrast_squared(batch, recipe, side), recipe), batch)

    def best(method: Callable[[int], Maps]) -> Maps:
        maps = [method(side) for side in WINDOWS]
        errors = [sum(float(np.square(one(b) - b["target"].double().numpy()).mean()) for b in known) for one in maps]
        return maps[int(np.argmin(errors))]

    return {"sliding window": best(windowed), "closed inversion": best(fitted)}


def _modelled(squared: Tensor, recipe: ContrastMap) -> Tensor:
    """K^2 of the multi-exposure model nearest to K^2 float64[B, E, h, w], of that shape."""
    durations, beta = recipe.exposures.durations, 1 / recipe.light.halves
    if len(durations) == 1:
        return squared
    fit = multi_exposure_fit(squared.movedim(1, -1).numpy(), durations, beta=beta)
    rho, time = fit.dynamic_share, fit.correlation_time
    once, twice = (np.stack([exponential_contrast_squared(n * t, time) for t in durations], 1) for n in (0.5, 1.0))
    rho = rho[:, None]
    return torch.from_numpy(beta * (rho**2 * twice + 2 * rho * (1 - rho) * once + (1 - rho) ** 2))


def _pixels(squared: Tensor, batch: Batch) -> np.ndarray:
    """K of every pixel of maps of blocks."""
    side = batch["stack"].shape[-2:]
    return functional.interpolate(squared.sqrt(), size=side, mode="bilinear").numpy()
