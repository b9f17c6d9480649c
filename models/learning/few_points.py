"""Solver for objects of few points: the likelihood alone places them.

The network shows that an object is sparse; which of many constellations it is, it cannot tell, since lags of points
that are wide apart fade beyond the memory-effect range. The search is that of
:mod:`specklegen.models.likelihood.constellation`, from the network's image and from phase retrieval's answers.
"""

import math
from typing import NamedTuple

import torch
from torch import Tensor

from specklegen.core.display.repr import short
from specklegen.models.learning.networks.unrolled import Candidates
from specklegen.models.likelihood.constellation import bright_pixels, constellation
from specklegen.models.likelihood.likelihood import SpeckleLikelihood
from specklegen.models.metrics import align, pearson

SPARSE = 60.0
"""Bright pixels of the network's image, below which points are searched for (docs/notes/networks.md)."""
SURPRISE = 3.0
"""Spreads of the log-likelihood by which points may exceed what is expected of the true object."""


class FewPoints(NamedTuple):
    """A constellation that explains an image.

    Attributes
    ----------
    image : float32[n, n]
        Points of brightness 1.
    evidence : float32[5]
        What the confidence model of constellations is read from: the excess in spreads of the log-likelihood, the
        logarithm of the count, the share of the searches that ended here, the logarithm of 1 and what the next best end
        costs more, and the correlation with the network's image.
    """

    image: Tensor
    points: int
    evidence: Tensor

    __repr__ = short


def few_points(
    last: Tensor, begun: Candidates, likelihood: SpeckleLikelihood, between: Tensor, answers: int
) -> list[FewPoints | None]:
    """Constellations of B objects; None where an object is not sparse, or no points explain its image.

    Parameters
    ----------
    last
        The network's images, float[B, n, n].
    begun
        What it began with, of which so many ``answers`` are phase retrieval's, settled.
    likelihood
        Of the measurement.
    between
        C_I between the pixels of the frame, float[B, 2 n - 1, 2 n - 1].
    """
    shining, spread = bright_pixels(last), likelihood.spread
    constellations: list[FewPoints | None] = [None] * len(last)
    for n in torch.nonzero(shining < SPARSE).flatten().tolist():
        one, c_i = likelihood.select(slice(n, n + 1)), between[n : n + 1, None]

        def nats(objects: Tensor, one: SpeckleLikelihood = one, c_i: Tensor = c_i) -> Tensor:
            return one.excess(objects[None], c_i)[0]

        starts = torch.cat([last[n : n + 1], begun.pictures[n, 1 : 2 + answers]])
        best = constellation(starts, nats, float(spread[n]))
        excess = best.excess(last.shape[-1]) / float(spread[n])
        if excess > SURPRISE:
            continue
        image = best.image(last.shape[-1])
        alike = pearson(align(last[n : n + 1], image[None]), image[None])[0]
        evidence = [excess, math.log(len(best.places)), best.reached, math.log1p(best.margin), float(alike)]
        constellations[n] = FewPoints(image, len(best.places), torch.tensor(evidence))
    return constellations
