"""A test-time fit: an image whose autocorrelation is fitted to that of the speckle by gradient descent, with no prior.

    R_o * P = lags,   o = softplus(z) >= 0 on the object's pixels

P is the autocorrelation of a grain, whose transform is the window's transfer function. Of several random starts the
best fit is taken. It learns nothing, and knows no C_I: what a network that is fitted to one image has to beat.
"""

import torch
from torch import Tensor

from specklegen.datasets.recipes.hidden_object import HiddenObject
from specklegen.models.judging.baselines import FRAME, Batch, Method, seen_lags
from specklegen.models.retrieval.apodisation import transfer_function

STEPS, STARTS, RATE = 300, 4, 0.1


def fitted(recipe: HiddenObject, seed: int = 0, steps: int = STEPS, starts: int = STARTS) -> Method:
    """Method that fits each image's lags.

    Parameters
    ----------
    recipe
        Of the images: its camera's noise, where that cannot be read off, and its window.
    seed
        Of the starts; each image's are the same.
    steps
        Of Adam.
    starts
        How many.
    """

    def method(batch: Batch) -> Tensor:
        seen = seen_lags(batch, recipe.exposure or "none", recipe.profile)
        rows, columns = batch["object"].shape[-2:]
        transfer = torch.stack([transfer_function(FRAME, grain, recipe.profile) for grain in seen.grain.tolist()])
        passed = transfer[:, : FRAME, : FRAME // 2 + 1].clamp_min(0).float()[:, None]
        wanted = _normal(seen.lags.float())[:, None]
        draws = torch.Generator().manual_seed(seed)
        begin = torch.randn(1, starts, rows, columns, generator=draws)
        hidden = begin.repeat(len(wanted), 1, 1, 1).requires_grad_()
        adam = torch.optim.Adam([hidden], RATE)
        misfit = hidden.new_zeros(hidden.shape[:2])
        for _ in range(steps):
            power = torch.fft.rfft2(torch.nn.functional.softplus(hidden), s=(FRAME, FRAME)).abs().square() * passed
            misfit = (_normal(torch.fft.irfft2(power, s=(FRAME, FRAME))) - wanted).square().sum((-2, -1))
            adam.zero_grad()
            misfit.sum().backward()
            adam.step()
        best = misfit.argmin(1)
        return torch.nn.functional.softplus(hidden.detach())[torch.arange(len(best)), best]

    return method


def _normal(lags: Tensor) -> Tensor:
    """Lags without their mean, the sum of their squares 1: neither a background nor the contrast is fitted."""
    centred = lags - lags.mean((-2, -1), keepdim=True)
    return centred / centred.square().sum((-2, -1), keepdim=True).sqrt().clamp_min(torch.finfo(lags.dtype).tiny)
