"""Chance: what a function's answers score for objects that they are not of, after the same shift and turn.

The best of all shifts and two turns flatters everybody: an answer has about 0.45 of correlation to an object that it
has nothing to do with, more where it is a blob. A score says something by what it has above that.
"""

import numpy as np
import torch
from torch import Tensor

from specklegen.models.judging.evaluation import PERFECT, on_frame
from specklegen.models.metrics import SCORES, align


def partners(labels: np.ndarray, families: np.ndarray) -> np.ndarray:
    """Find for each image another one, of another object: int64[n].

    It is the next one, or the first after that whose label or family differs where there are labels: two pictures of
    one character are no chance.

    Parameters
    ----------
    labels, families : int[n]
        Class and family of each object; -1 where there is none.
    """
    count = len(labels)
    found = np.empty(count, np.int64)
    for n in range(count):
        others = [(n + k) % count for k in range(1, count)] or [n]
        alike = lambda m, n=n: labels[m] == labels[n] >= 0 and families[m] == families[n]  # noqa: E731
        found[n] = next((m for m in others if not alike(m)), others[0])
    return found


def chance(answers: list[Tensor], objects: Tensor, partner: np.ndarray) -> dict[str, np.ndarray]:
    """Scores of answers for the objects of other images.

    Parameters
    ----------
    answers : list of real[B, n, n]
        Of all images, batch by batch.
    objects : real[N, h, w]
        Brightness 0 to 1.
    partner : int64[N]
        Whose answer is held against each object (:func:`partners`).

    Returns
    -------
    dict of float64[N]
        By score.
    """
    framed = torch.cat([on_frame(torch.as_tensor(each)) for each in answers])[torch.from_numpy(partner)]
    rows, columns = objects.shape[-2:]
    target = on_frame(objects, dark=False)
    moved = align(framed, target)[..., :rows, :columns]
    return {
        name: score(moved, target[..., :rows, :columns]).clamp(max=PERFECT).double().numpy()
        for name, score in SCORES.items()
    }


def above_chance(score: float, by_chance: float) -> float:
    """Return the skill of a score, ``(r - chance) / (1 - chance)``: 0 for chance, 1 for the object."""
    return (score - by_chance) / (1 - by_chance) if by_chance < 1 else float("nan")
