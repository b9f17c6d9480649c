"""Which of many restarts to believe.

With noise, the modulus of the lowest error is fitted too well: what the restarts share is the object, what differs
is noise. The consensus aligns all restarts with the one of lowest error, then with their mean; their median says
where the object is; each is led by error reduction to fit on that common support; their mean is the answer.
"""

import torch
from torch import Tensor

from specklegen.models.metrics import align
from specklegen.models.retrieval.projections import error_reduction, paired, shrunk, unpaired

_STEPS = 15  # of error reduction
_BLUR = 1.5  # pixels, of the median


def lowest_error(restarts: Tensor, error: Tensor) -> Tensor:
    """Restart of the lowest error of each image, [B, n, n], of [B, R, n, n] and [B, R]."""
    return restarts[torch.arange(len(restarts), device=restarts.device), error.argmin(1)]


def consensus(restarts: Tensor, error: Tensor, modulus: Tensor, share: float = 0.1) -> Tensor:
    """Image that the restarts agree on, float32[B, n, n].

    Parameters
    ----------
    restarts, error
        float32[B, R, n, n] and float32[B, R].
    modulus
        float32[B, n, n/2 + 1].
    share
        Share of the maximum of the blurred median that bounds the common support; 0 for no support.
    """
    aligned = restarts
    reference = lowest_error(restarts, error)
    for _ in range(2):
        aligned = align(restarts, reference[:, None].expand_as(restarts))
        reference = aligned.mean(1)
    support = shrunk(paired(aligned.median(1, keepdim=True).values), _BLUR, share) if share else 1.0
    settled = error_reduction(paired(aligned), modulus[:, None], _STEPS, support)
    return unpaired(settled, restarts.shape[1]).mean(1)
