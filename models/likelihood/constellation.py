"""An object of few points, where that explains a measurement: searched on the likelihood, point by point.

A few equally bright points on the pixels of a frame are few numbers, so that the likelihood alone decides where they
are, far beyond the range at which lags still show them. What is searched for is the shortest description (Rissanen,
Automatica 14, 465 (1978)),

    cost = -log L(points) + count * log(places),

-log L less what it is expected to be of the true object. From a first image whose brightest places are taken for
points; every point is moved to its neighbours and to the places where the gradient says that light is missing, taken
away, or joined by another; of all these changes the best is made, until none is better. Searches that begin elsewhere
may end elsewhere; the cheapest end counts. The true object has an excess of 0 with the spread of the log-likelihood,
whatever it looks like: points that exceed it by far explain nothing.
"""

from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np
import torch
from scipy.ndimage import maximum_filter
from torch import Tensor

from specklegen.core.display.repr import short

MOST = 14
"""Points that are looked for at most."""
_BRIGHT = 0.25  # of the brightest pixel: what is taken for a point at first
_FIRST = 8  # points that a search begins with, at most
_NEAR = 2  # pixels that a point is moved by
_MISSING = 40  # places where light is missing most that a point is moved to
_TRIED = 120  # changes of a step that promise most, by the gradient
_STEPS = 60
KICKS = 12
"""Searches from the best end, at most."""
_ALIKE = 0.1  # nats between ends that are one, shifted or turned
_AGREED = 3  # searches with one end, after which there are no more
_HOPELESS = 10.0  # times the excess that raises no doubt


class Constellation(NamedTuple):
    """Points that explain a measurement best.

    Attributes
    ----------
    places : tuple of int
        Of the points in the flattened frame.
    cost : float
        Of the description, nats.
    reached : float
        Share of the searches that led to it.
    margin : float
        By how much the next best end of a search costs more; 0 where there was no other.
    """

    places: tuple[int, ...]
    cost: float
    reached: float
    margin: float

    __repr__ = short

    def excess(self, side: int) -> float:
        """-log L over that expected of the true object, nats, of points on a frame of so many pixels a side."""
        return self.cost - len(self.places) * float(np.log(side * side))

    def image(self, side: int) -> Tensor:
        """Return float32[n, n], points of brightness 1."""
        return _drawn([self.places], side)[0]


def constellation(
    starts: Tensor, nats: Callable[[Tensor], Tensor], good: float, *, kicks: int = KICKS
) -> Constellation:
    """Points that explain a measurement best, among those that several searches end at.

    Parameters
    ----------
    starts
        First images, real[s, n, n].
    nats
        -log L of objects float[K, n, n] over that expected of the true one, float[K]; differentiable.
    good
        Excess that raises no doubt, nats: once three searches have had one such end, there are no more; nor where
        those from the starts have ended at ten times as much.
    kicks
        Searches from the best end, some of its points taken away (iterated local search: Lourenco, Martin and
        Stutzle, *Handbook of Metaheuristics*, 2003, chapter 11), after those from the starts, at most.
    """
    side = starts.shape[-1]
    ends: list[tuple[float, tuple[int, ...]]] = []
    rng = np.random.default_rng(0)
    for n in range(len(starts) + kicks):
        if n < len(starts):
            begin = _first(starts[n])
        else:
            best = min(ends)[1]
            kept = rng.permutation(len(best))[: rng.integers(1, max(2, len(best)))]
            begin = tuple(best[place] for place in sorted(kept.tolist()))
        ends.append(_descended(begin, nats, side))
        least, shown = min(ends)
        agreed = sum(cost < least + _ALIKE for cost, _ in ends)
        excess = least - len(shown) * np.log(side * side)
        if (agreed >= _AGREED and excess < good) or (n + 1 >= len(starts) and excess > _HOPELESS * good):
            break
    cost, best = min(ends)
    # Ends that are shifted or turned explain alike: they are one.
    margins = [other - cost for other, _ in ends if other - cost >= _ALIKE]
    return Constellation(best, cost, 1 - len(margins) / len(ends), min(margins, default=0.0))


def bright_pixels(images: Tensor) -> Tensor:
    """Number of bright pixels, (sum x)^2 / sum x^2, float[...] of images real[..., n, n]."""
    return images.sum((-2, -1)).square() / images.square().sum((-2, -1)).clamp_min(torch.finfo(images.dtype).tiny)


def _first(image: Tensor) -> tuple[int, ...]:
    """The brightest maxima of an image, two at least."""
    shown = image.numpy()
    peak = (shown == maximum_filter(shown, 3, mode="constant")) & (shown > _BRIGHT * shown.max())
    order = np.argsort(-np.where(peak, shown, shown - shown.max() - 1).ravel(), kind="stable")
    return tuple(sorted(int(place) for place in order[: min(max(2, int(peak.sum())), _FIRST)]))


def _descended(places: tuple[int, ...], nats: Callable[[Tensor], Tensor], side: int) -> tuple[float, tuple[int, ...]]:
    """Cost of the end of a search, and where it is."""
    best = _costs([places], nats, side)[0]
    for _ in range(_STEPS):
        image = _drawn([places], side).clamp_min(1e-4).requires_grad_()
        with torch.enable_grad():
            (slope,) = torch.autograd.grad(nats(image).sum(), image)
        lack = slope.numpy().ravel()
        changed = sorted(set(_changes(places, np.argsort(lack, kind="stable")[:_MISSING].tolist(), side)))
        here = lack[list(places)].sum()
        promised = np.array([lack[list(each)].sum() - here for each in changed])
        changed = [changed[n] for n in np.argsort(promised, kind="stable")[:_TRIED]]
        costs = _costs(changed, nats, side)
        least = int(np.argmin(costs))
        if costs[least] >= best:
            break
        best, places = costs[least], changed[least]
    return float(best), places


def _changes(places: tuple[int, ...], missing: list[int], side: int) -> Iterator[tuple[int, ...]]:
    """Constellations that differ in one point."""
    here = set(places)
    steps = range(-_NEAR, _NEAR + 1)
    for place in places:
        row, column = divmod(place, side)
        near = ((row + y, column + x) for y in steps for x in steps)
        others = [y * side + x for y, x in near if 0 <= y < side and 0 <= x < side]
        for other in set(others + missing) - here:
            yield tuple(sorted((here - {place}) | {other}))
        if len(places) > 2:
            yield tuple(sorted(here - {place}))
    if len(places) < MOST:
        for other in set(missing) - here:
            yield tuple(sorted(here | {other}))


def _costs(constellations: list[tuple[int, ...]], nats: Callable[[Tensor], Tensor], side: int) -> np.ndarray:
    with torch.no_grad():
        misfit = nats(_drawn(constellations, side)).double().numpy()
    return misfit + np.log(side * side) * np.array([len(each) for each in constellations])


def _drawn(constellations: list[tuple[int, ...]], side: int) -> Tensor:
    """Images float32[K, n, n]."""
    images = torch.zeros(len(constellations), side * side)
    which = [n for n, each in enumerate(constellations) for _ in each]
    images[which, [place for each in constellations for place in each]] = 1.0
    return images.reshape(-1, side, side)
