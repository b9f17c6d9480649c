"""The confidence: how probably a reconstruction is right, read from evidence that needs no object.

A logistic function of standardised numbers, fitted by penalised maximum likelihood (Newton's method; McCullagh and
Nelder, *Generalized Linear Models*, 1989, section 4.4) on reconstructions whose objects are known. It knows what it was
fitted to: where a number of the evidence lies far outside of that, it is silent.
"""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple, Self

import numpy as np
import torch
from torch import Tensor

_PENALTY = 1.0
_STEPS = 30
_SHARE = 0.01
"""Of the evidence fitted to, on either side, what does not count for its ends."""
_MARGIN = 0.25
"""Of what lies between those, by which evidence may be further out."""


class Certificate(NamedTuple):
    """Logistic regression on standardised evidence.

    Attributes
    ----------
    weights, mean, spread : tuple of float
        One for each number of the evidence.
    low, high : tuple of float
        Ends of each number within which it was fitted; none, and it is never silent.
    """

    weights: tuple[float, ...]
    mean: tuple[float, ...]
    spread: tuple[float, ...]
    constant: float
    low: tuple[float, ...] = ()
    high: tuple[float, ...] = ()

    @classmethod
    def fitted(cls, evidence: np.ndarray, success: np.ndarray, chosen: Sequence[int] | None = None) -> Self:
        """Confidence model fitted to evidence float[n, e] and successes bool[n], or to chosen columns alone."""
        if chosen is not None:
            count, places = evidence.shape[1], np.asarray(chosen)
            certificate = cls.fitted(evidence[:, places], success)
            filled = {name: np.full(count, float(name == "spread")) for name in cls._fields if name != "constant"}
            for name, values in filled.items():
                values[places] = getattr(certificate, name)
            return cls(constant=certificate.constant, **{name: tuple(x.tolist()) for name, x in filled.items()})
        mean, spread = evidence.mean(0), np.maximum(evidence.std(0), 1e-6)
        x = np.column_stack([(evidence - mean) / spread, np.ones(len(evidence))])
        penalty = np.diag([_PENALTY] * (x.shape[1] - 1) + [1e-6])
        weights = np.zeros(x.shape[1])
        for _ in range(_STEPS):
            p = 1 / (1 + np.exp(-x @ weights))
            slope = x.T @ (success - p) - penalty @ weights
            weights = weights + np.linalg.solve((x * (p * (1 - p))[:, None]).T @ x + penalty, slope)
        *slopes, constant = map(float, weights)
        low, high = np.quantile(evidence, [_SHARE, 1 - _SHARE], axis=0)
        beyond = _MARGIN * (high - low)
        ends = (tuple(x.tolist()) for x in (low - beyond, high + beyond))
        return cls(tuple(slopes), tuple(map(float, mean)), tuple(map(float, spread)), constant, *ends)

    @classmethod
    def of(cls, table: Mapping[str, Any]) -> Self:
        """Confidence model of stored numbers.

        Raises
        ------
        ValueError, KeyError, TypeError
            If they are not those of a confidence model.
        """
        lists: list[Sequence[float]] = [table["weights"], table["mean"], table["spread"]]
        ends: list[Sequence[float]] = [table.get("low", ()), table.get("high", ())]
        with_ends = lists + ends if any(map(len, ends)) else lists
        if len({len(each) for each in with_ends}) != 1 or not all(float(s) > 0 for s in lists[2]):
            raise ValueError("lists of one length, spreads above 0")
        weights, mean, spread, low, high = (tuple(map(float, each)) for each in lists + ends)
        return cls(weights, mean, spread, float(table["constant"]), low, high)

    def __call__(self, evidence: Tensor) -> Tensor:
        """Probability float[B] of evidence float[B, e]; NaN where some of it is unlike all that was fitted to."""
        weights, mean, spread = (torch.tensor(x, dtype=evidence.dtype) for x in self[:3])
        probability = (((evidence - mean) / spread) @ weights + self.constant).sigmoid()
        return torch.where(self.unlike(evidence).any(-1), float("nan"), probability)

    def unlike(self, evidence: Tensor) -> Tensor:
        """Which numbers of evidence float[B, e], of those that count, lie outside of all that was fitted to."""
        if not self.low:
            return torch.zeros(evidence.shape, dtype=torch.bool)
        weights, low, high = (torch.tensor(x, dtype=evidence.dtype) for x in (self.weights, self.low, self.high))
        return (weights != 0) & ~((evidence >= low) & (evidence <= high))
