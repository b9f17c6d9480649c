"""The multi-exposure model, fitted to contrasts that a camera shows: the baseline of networks that tell motion.

Contrasts of the exposures, the camera's noise taken off, give a correlation time and the share of the light at rest
(:func:`specklegen.theory.multi_exposure.multi_exposure_fit`). The time is that of one exponential; how far it is from
tau0 = 1/(D k^2) depends on how the material scatters, which the model does not know. One factor between both, the
median over media of the training split, is all that it is given.
"""

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from specklegen.datasets.recipes.exposure_stack import ExposureStack
from specklegen.models.learning.examples import batches_of
from specklegen.models.learning.exposures import shared_contrast
from specklegen.theory.multi_exposure import multi_exposure_fit

Batch = Mapping[str, Any]

KNOWN = 64
"""Training media whose factor between the model's time and tau0 is taken."""


def closed_inversion(recipe: ExposureStack, seed: int = 0, media: int = KNOWN) -> Callable[[Batch], np.ndarray]:
    """A function of batches of a recipe to float64[B, 2]: log10 of tau0, and the share of the light at rest.

    Parameters
    ----------
    recipe
        Of exposures; its durations, its camera and its light are known, as to a laboratory.
    seed
        Of the training split.
    media
        Of it, whose factor is taken.
    """

    def fitted(batch: Batch) -> np.ndarray:
        squared = shared_contrast(batch, recipe.exposure or "none").diagonal(dim1=-2, dim2=-1).numpy()
        fit = multi_exposure_fit(squared, recipe.exposures.durations, beta=1 / recipe.light.halves)
        return np.stack([np.log10(fit.correlation_time), 1 - fit.dynamic_share], axis=-1)

    known = [(fitted(batch), batch["target"].double().numpy()) for batch in batches_of(recipe, media, seed, "train")]
    predicted, true = (np.concatenate(each) for each in zip(*known, strict=True))
    shift = np.array([np.median(true[:, 0] - predicted[:, 0]), 0.0])
    return lambda batch: fitted(batch) + shift
