"""Targets of networks: the object of a sample, its label, numbers of the medium, or maps of contrast.

Numbers are one row, float[B, 1, K], and maps lie one below the other, so that networks and runs are those of objects.
"""

from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import Any, NamedTuple

import torch
from torch import Tensor
from torch.nn import functional

from specklegen.core.errors import reject
from specklegen.models.learning.local_contrast import require_maps
from specklegen.models.learning.losses import Loss
from specklegen.models.metrics import align, pearson

CLASSES = 45
"""Of labels: as many as there are characters; digits and photographs are fewer."""


class Scale(NamedTuple):
    """Range of a number of a medium in training, and whether its log10 is used."""

    middle: float
    spread: float
    logarithm: bool = True


MATERIAL = {
    "memory_effect_range": Scale(-3.5, 0.5), "thickness": Scale(3.0, 0.25), "optical_depth": Scale(0.9, 0.25),
    "g": Scale(0.83, 0.07, logarithm=False),
}  # fmt: skip
"""Numbers of a material."""
MOTION = {"tau0": Scale(-3.5, 0.3), "static_share": Scale(0.4, 0.15, logarithm=False)}
"""Numbers of what moves: tau0 = 1/(D k^2), and the share of the light that meets nothing that moves."""


class Target(NamedTuple):
    """Request to a network.

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
    hidden : bool
        Whether it is asked of hidden objects.
    numbers : mapping
        Of targets that are numbers of the medium: their names, in order; else empty.
    read : function
        Of answers, to what is told of a batch: float[B, K], or maps float[B, E, H, W].
    """

    values: Callable[[Mapping[str, Any]], Tensor]
    loss: Loss | None
    answer: Callable[[Tensor], Tensor]
    score: Callable[[Tensor, Tensor], float]
    scored: str
    hidden: bool = True
    numbers: Mapping[str, Scale] = MappingProxyType({})
    read: Callable[[Tensor], Tensor] = lambda rows: rows[:, 0]


def objects_of(batch: Mapping[str, Any]) -> Tensor:
    """Objects float32[B, h, w]."""
    if "object" not in batch:
        reject("batch", 'a batch with "object"', sorted(batch))
    return batch["object"].float()


def labels_of(batch: Mapping[str, Any]) -> Tensor:
    """Labels as rows of zeros and a one, float32[B, 1, CLASSES]."""
    drawn = batch["parameters"]
    if "label" not in drawn or not ((drawn["label"] >= 0) & (drawn["label"] < CLASSES)).all():
        reject("batch label", f"a class from 0 to {CLASSES - 1}", drawn.get("label"), "Use objects with labels.")
    return functional.one_hot(drawn["label"].long(), CLASSES)[:, None].float()


def numbers_of(batch: Mapping[str, Any], names: Mapping[str, Scale]) -> Tensor:
    """Numbers of the medium over their spread, float32[B, 1, K]."""
    drawn = batch["parameters"]
    for name in names:
        if name not in drawn or not drawn[name].isfinite().all():
            reject(f"batch {name}", "a finite number for every medium", drawn.get(name),
                   "Thin screens have no optical depth, a single screen no range, media at rest no tau0: "
                   "choose another "
                   "target.")  # fmt: skip
    numbers = torch.stack(
        [drawn[name].log10() if scale.logarithm else drawn[name] for name, scale in names.items()], -1
    )
    middle, spread = _scales(names, numbers.double())
    return ((numbers - middle) / spread)[:, None].float()


def in_units(rows: Tensor, names: Mapping[str, Scale] = MATERIAL) -> Tensor:
    """Numbers of the medium, some by their log10, float[B, K], from rows over their spread."""
    middle, spread = _scales(names, rows)
    return rows[:, 0] * spread + middle


def maps_of(batch: Mapping[str, Any]) -> Tensor:
    """Maps of contrast, those of a sample one below the other, float32[B, E H, W]."""
    require_maps(batch)
    return batch["target"].float().flatten(1, 2)


def apart(rows: Tensor) -> Tensor:
    """Square maps float[B, E, W, W] that lie one below the other in float[B, E W, W]."""
    return rows.unflatten(1, (-1, rows.shape[-1]))


def _scales(names: Mapping[str, Scale], like: Tensor) -> Tensor:
    return torch.tensor([(each.middle, each.spread) for each in names.values()], dtype=like.dtype, device=like.device).T


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


def map_determination(made: Tensor, rows: Tensor) -> float:
    """R^2 of the pixels of all maps: 1 less the square error over the variance within exposures, both their sums."""
    true = apart(rows).double()
    spread = true.var((0, 2, 3), correction=0).sum().clamp_min(torch.finfo(torch.float32).tiny)
    return float(1 - (apart(made).double() - true).square().mean((0, 2, 3)).sum() / spread)


def cross_entropy_of_classes(logits: Tensor, labels: Tensor) -> Tensor:
    """Cross-entropy of the classes' probabilities."""
    return functional.cross_entropy(logits[:, 0], labels[:, 0])


def _of_numbers(names: Mapping[str, Scale]) -> Target:
    return Target(lambda batch: numbers_of(batch, names), functional.mse_loss, lambda logits: logits,
                  lambda made, rows: float(determination(made, rows).mean()), "r2", False, names,
                  lambda rows: in_units(rows, names))  # fmt: skip


TARGETS: dict[str, Target] = {
    "object": Target(objects_of, None, torch.sigmoid, likeness, "pearson"),
    "label": Target(labels_of, cross_entropy_of_classes, lambda logits: logits.softmax(-1), accuracy, "accuracy"),
    "material": _of_numbers(MATERIAL),
    "range": _of_numbers({"memory_effect_range": MATERIAL["memory_effect_range"]}),
    "motion": _of_numbers(MOTION),
    "contrast": Target(maps_of, functional.mse_loss, lambda told: told, map_determination, "r2", False, read=apart),
}
"""Name to target."""
