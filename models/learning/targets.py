"""What a network is to tell of a sample: its object, the label of the object, or the material in front of it.

Answers other than the object are one row, float[B, 1, K], so that the networks and runs are those of objects.
"""

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import torch
from torch import Tensor
from torch.nn import functional

from specklegen.core.errors import reject
from specklegen.models.learning.losses import Loss
from specklegen.models.metrics import align, pearson

CLASSES = 45
"""Of labels: as many as there are characters; digits and photographs are fewer."""
MATERIAL = {
    "memory_effect_range": (-3.5, 0.5), "thickness": (3.0, 0.25), "optical_depth": (0.9, 0.25), "g": (0.83, 0.07),
}  # fmt: skip
"""Names of a material's numbers, with the middle and the spread of what networks are shown: log10 of all but g."""


class Target(NamedTuple):
    """What is asked of a network.

    Attributes
    ----------
    values : function
        Of a batch, to float32[B, h, w] or float32[B, 1, K].
    loss : function or None
        Of (logits, values); None for the loss that the training names.
    answer : function
        Of logits, to the answer.
    score : function
        Of (answers, values), to a number: the larger the better, at most 1.
    scored : str
        Name of the score.
    """

    values: Callable[[Mapping[str, Any]], Tensor]
    loss: Loss | None
    answer: Callable[[Tensor], Tensor]
    score: Callable[[Tensor, Tensor], float]
    scored: str


def objects_of(batch: Mapping[str, Any]) -> Tensor:
    """Objects float32[B, h, w]."""
    if "object" not in batch:
        reject("batch", 'one with "object"', sorted(batch))
    return batch["object"].float()


def labels_of(batch: Mapping[str, Any]) -> Tensor:
    """Labels as rows of zeros and a one, float32[B, 1, CLASSES]."""
    drawn = batch["parameters"]
    if "label" not in drawn or not ((drawn["label"] >= 0) & (drawn["label"] < CLASSES)).all():
        reject("batch label", f"a class from 0 to {CLASSES - 1}", drawn.get("label"), "Hide objects that have labels.")
    return functional.one_hot(drawn["label"].long(), CLASSES)[:, None].float()


def material_of(batch: Mapping[str, Any]) -> Tensor:
    """Numbers of the material over their spread, float32[B, 1, 4]."""
    drawn = batch["parameters"]
    for name in MATERIAL:
        if name not in drawn or not drawn[name].isfinite().all():
            reject(f"batch {name}", "a finite number of every slab", drawn.get(name),
                   "Thin screens have no optical depth, and a single one no range: ask for another target.")  # fmt: skip
    numbers = [drawn[name] if name == "g" else drawn[name].log10() for name in MATERIAL]
    middle, spread = torch.tensor(list(MATERIAL.values()), dtype=torch.float64).T
    return ((torch.stack(numbers, -1) - middle) / spread)[:, None].float()


def in_units(rows: Tensor) -> Tensor:
    """Numbers of the material, log10 of all but g, float[B, 4], from rows over their spread."""
    middle, spread = torch.tensor(list(MATERIAL.values()), dtype=rows.dtype).T
    return rows[:, 0] * spread + middle


def likeness(made: Tensor, objects: Tensor) -> float:
    """Mean Pearson correlation after alignment."""
    return float(pearson(align(made, objects), objects).mean())


def accuracy(made: Tensor, labels: Tensor) -> float:
    """Share of samples whose most probable class is theirs."""
    return float((made.argmax(-1) == labels.argmax(-1)).float().mean())


def determination(made: Tensor, rows: Tensor) -> Tensor:
    """Coefficient of determination R^2 of each number, float[K]: 1 less the mean square error over the variance."""
    error, spread = (made - rows).square().mean((0, 1)), rows.var((0, 1), correction=0)
    return 1 - error / spread.clamp_min(torch.finfo(rows.dtype).tiny)


def cross_entropy_of_classes(logits: Tensor, labels: Tensor) -> Tensor:
    """Cross-entropy of the classes' probabilities."""
    return functional.cross_entropy(logits[:, 0], labels[:, 0])


TARGETS: dict[str, Target] = {
    "object": Target(objects_of, None, torch.sigmoid, likeness, "pearson"),
    "label": Target(labels_of, cross_entropy_of_classes, lambda logits: logits.softmax(-1), accuracy, "accuracy"),
    "material": Target(material_of, functional.mse_loss, lambda logits: logits,
                       lambda made, rows: float(determination(made, rows).mean()), "r2"),
}  # fmt: skip
"""Name to target."""
