"""The certificate: how probably a reconstruction is right, read from evidence that needs no object.

A logistic function of standardised numbers, fitted by penalised maximum likelihood (Newton's method; McCullagh and
Nelder, *Generalized Linear Models*, 1989, section 4.4) on reconstructions whose objects are known.
"""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple, Self

import numpy as np
import torch
from torch import Tensor

_PENALTY = 1.0
_STEPS = 30


class Certificate(NamedTuple):
    """Logistic regression on standardised evidence.

    Attributes
    ----------
    weights, mean, spread : tuple of float
        One for each number of the evidence.
    constant : float
    """

    weights: tuple[float, ...]
    mean: tuple[float, ...]
    spread: tuple[float, ...]
    constant: float

    @classmethod
    def fitted(cls, evidence: np.ndarray, success: np.ndarray) -> Self:
        """Certificate of evidence float[n, e] and successes bool[n]."""
        mean, spread = evidence.mean(0), np.maximum(evidence.std(0), 1e-6)
        x = np.column_stack([(evidence - mean) / spread, np.ones(len(evidence))])
        penalty = np.diag([_PENALTY] * (x.shape[1] - 1) + [1e-6])
        weights = np.zeros(x.shape[1])
        for _ in range(_STEPS):
            p = 1 / (1 + np.exp(-x @ weights))
            slope = x.T @ (success - p) - penalty @ weights
            weights = weights + np.linalg.solve((x * (p * (1 - p))[:, None]).T @ x + penalty, slope)
        *slopes, constant = map(float, weights)
        return cls(tuple(slopes), tuple(map(float, mean)), tuple(map(float, spread)), constant)

    @classmethod
    def of(cls, table: Mapping[str, Any]) -> Self:
        """Certificate of stored numbers.

        Raises
        ------
        ValueError, KeyError, TypeError
            If they are not those of a certificate.
        """
        lists: list[Sequence[float]] = [table["weights"], table["mean"], table["spread"]]
        if len({len(each) for each in lists}) != 1 or not all(float(s) > 0 for s in lists[2]):
            raise ValueError("lists of one length, spreads above 0")
        weights, mean, spread = (tuple(map(float, each)) for each in lists)
        return cls(weights, mean, spread, float(table["constant"]))

    def __call__(self, evidence: Tensor) -> Tensor:
        """Probability float[B] of evidence float[B, e]."""
        weights, mean, spread = (torch.tensor(x, dtype=evidence.dtype) for x in self[:3])
        return (((evidence - mean) / spread) @ weights + self.constant).sigmoid()
