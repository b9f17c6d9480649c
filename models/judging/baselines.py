"""What a network is judged beside: the mean image, which looks at nothing, and phase retrieval, which learns nothing.

A method is a function of a batch (of a hidden-object recipe, as tensors) to brightness float32[B, n, n] on the pitch of
the object, up to shift and flip; n is the object's side or :data:`FRAME`.
"""

from collections.abc import Callable, Mapping
from typing import Any

import torch
from torch import Tensor

from specklegen.datasets.recipes.hidden_object import HiddenObject
from specklegen.models.learning.inputs import (
    LAGS,
    resampled_lags,
    speckle_autocorrelation,
    steps_of,
    without_background,
)
from specklegen.models.metrics import align
from specklegen.models.retrieval.apodisation import transfer_function
from specklegen.models.retrieval.autocorrelation import memory_effect_at_lags
from specklegen.models.retrieval.phase_retrieval import Retrieval, retrieve

Batch = Mapping[str, Any]
Method = Callable[[Batch], Tensor]

FRAME = LAGS
"""Side of the frame that everything is scored on: an object, and a margin as wide."""


def grain_pixels(batch: Batch) -> Tensor:
    """Object pixels in a speckle grain, float64[B]."""
    drawn = batch["parameters"]
    return drawn["wavelength"] / drawn["width"] / drawn["object_pitch"]


def mean_image(objects: Tensor) -> Method:
    """Answer every question with the mean of the training objects [N, h, w], moved onto the first, then onto that."""
    reference = objects[0]
    for _ in range(2):
        reference = align(objects, reference.expand_as(objects)).mean(0)
    return lambda batch: reference.expand(len(batch["object"]), -1, -1)


def another_object(objects: Tensor) -> Method:
    """Answer with some training object [N, h, w], which has nothing to do with the image: the level of chance.

    Not with that of the image's own number, which is the answer where training images are judged.
    """
    return lambda batch: objects[(batch["index"].long() + len(objects) // 2) % len(objects)]


def katz(retrieval: Retrieval | None = None, recipe: HiddenObject | None = None, seed: int = 0) -> Method:
    """Phase retrieval from the same lags that a network sees.

    Parameters
    ----------
    retrieval
        Restarts and iterations; the extent is by default that of the object.
    recipe
        If given: divide by each material's C_I, and apodise by the window's transfer function. The simulator
        knows both; a laboratory knows the second.
    seed
        Of the random starts.
    """

    def method(batch: Batch) -> Tensor:
        settings = retrieval or Retrieval()
        if settings.extent is None:
            settings = settings.replace(extent=max(batch["object"].shape[-2:]))
        lags = resampled_lags(speckle_autocorrelation(batch["image"].double()), steps_of(batch), FRAME)
        lags = torch.fft.ifftshift(without_background(lags), dim=(-2, -1))
        if recipe is None:
            return retrieve(lags, settings, seed=seed).image
        made = []
        for n, grains in enumerate(grain_pixels(batch).tolist()):
            drawn = {name: float(values[n]) for name, values in batch["parameters"].items()}
            slab = recipe.material.slab_of(drawn)
            kernel = recipe.material.known(slab).kernel
            c_i = memory_effect_at_lags(kernel, drawn["wavelength"], drawn["object_pitch"], FRAME)
            transfer = transfer_function(FRAME, grains, recipe.profile)
            made.append(retrieve(lags[n : n + 1], settings, memory_effect=c_i, transfer=transfer, seed=seed).image)
        return torch.cat(made)

    return method
