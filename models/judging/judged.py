"""Scores of each kind of task: images up to shift and turn, pages and coherent objects in place, frames up to more.

:func:`judged` asks methods about the batches of a task, whatever its kind, and says what their answers score for the
objects of others.
"""

from collections.abc import Callable, Iterable, Mapping
from typing import Any

import numpy as np
import torch

from specklegen.models.judging import frames, pages
from specklegen.models.judging.baselines import Batch, Method
from specklegen.models.judging.chance import chance, partners
from specklegen.models.judging.evaluation import FRAME, PERFECT, Evaluation, evaluate, identified, on_frame
from specklegen.models.judging.isolation import copy_of
from specklegen.models.judging.tasks import Task
from specklegen.models.metrics import SCORES
from specklegen.models.retrieval.apodisation import framed

Answers = list[np.ndarray]
Scores = dict[str, np.ndarray]


def judged(
    of: Task, methods: Mapping[str, Method], batches: Iterable[Batch]
) -> tuple[Evaluation, Callable[[Answers], Scores]]:
    """Score methods on the batches of a task.

    Returns
    -------
    Evaluation, function
        The second says what answers, batch by batch, score for the objects of other images.
    """
    if of.kind in ("drawn", "waves"):
        evaluation, cases = evaluate(methods, batches, of.recipe().profile)
        partner = partners(evaluation.labels, evaluation.families)
        objects = torch.from_numpy(np.stack([case.object for case in cases]))
        return evaluation, lambda answers: chance([torch.from_numpy(each) for each in answers], objects, partner)
    asked: list[Mapping[str, Any]] = []
    answers: dict[str, Answers] = {name: [] for name in methods}
    for batch in batches:
        for name, method in methods.items():
            answers[name].append(method(copy_of(batch)).numpy())
        asked.append({name: value for name, value in batch.items() if name != "image"})
    return {"pages": _pages, "glasses": _in_place}.get(of.kind, _frames)(answers, asked)


def _in_place(
    answers: Mapping[str, Answers], asked: list[Mapping[str, Any]]
) -> tuple[Evaluation, Callable[[Answers], Scores]]:
    """Coherent objects, whose camera images are upright: neither shift nor turn is tried."""
    objects = torch.cat([each["object"].float() for each in asked])
    rows, columns = objects.shape[-2:]
    drawn = {name: torch.cat([each["parameters"][name] for each in asked]).numpy() for name in ("medium", "label")}
    media, labels = (drawn[name].astype(np.int64) for name in ("medium", "label"))
    none = np.full(len(media), -1)
    partner = partners(labels, none)

    def score(some: Answers, whose: np.ndarray) -> Scores:
        made = torch.cat([framed(torch.from_numpy(each), FRAME) for each in some])[whose, :rows, :columns]
        return {name: of(made, objects).clamp(max=PERFECT).double().numpy() for name, of in SCORES.items()}

    own = np.arange(len(media))
    values = {name: {"sharp": score(some, own)} for name, some in answers.items()}
    shown = framed(objects, FRAME)
    right = {
        name: identified(torch.cat([framed(torch.from_numpy(each), FRAME) for each in some]), shown).numpy()
        for name, some in answers.items()
    }  # fmt: skip
    return Evaluation(values, media, labels, np.zeros(len(media)), none, right), lambda some: score(some, partner)


def _pages(
    answers: Mapping[str, Answers], asked: list[Mapping[str, Any]]
) -> tuple[Evaluation, Callable[[Answers], Scores]]:
    numbers = np.array([int(each["index"][0]) for each in asked])
    wide = np.array([each["page"].shape[1] for each in asked], float)
    extents = wide / asked[0]["spot"].shape[1] * float(asked[0]["parameters"]["extent_over_range"][0])
    partner = partners(np.full(len(asked), -1), np.full(len(asked), -1))

    def score(some: Answers, whose: np.ndarray) -> Scores:
        return pages.scores([torch.from_numpy(some[n]) for n in whose], asked)

    own = np.arange(len(asked))
    values = {name: {"sharp": score(some, own)} for name, some in answers.items()}
    right = {
        name: np.array([_is_own(some[n], asked, n) for n in own]) for name, some in answers.items()
    }  # fmt: skip
    none = np.full(len(asked), -1)
    return Evaluation(values, numbers, none, extents, none, right), lambda some: score(some, partner)


def _is_own(answer: np.ndarray, asked: list[Mapping[str, Any]], n: int) -> bool:
    alike = pages.scores([torch.from_numpy(answer)] * len(asked), asked)["pearson"]
    return int(alike.argmax()) == n


def _frames(
    answers: Mapping[str, Answers], asked: list[Mapping[str, Any]]
) -> tuple[Evaluation, Callable[[Answers], Scores]]:
    shapes, glasses = (
        np.concatenate([each["parameters"][name].numpy() for each in asked]).astype(np.int64)
        for name in ("label", "medium")
    )
    families = np.full(len(shapes), -1)
    partner = partners(shapes, families)

    def of(some: Answers) -> torch.Tensor:
        return torch.cat([on_frame(torch.from_numpy(each)) for each in some])

    values = {name: {"sharp": frames.scores(of(some), shapes)} for name, some in answers.items()}
    right = {name: frames.named(of(some), shapes) for name, some in answers.items()}
    evaluation = Evaluation(values, glasses, shapes, np.zeros(len(shapes)), families, right)
    return evaluation, lambda some: frames.scores(of(some)[torch.from_numpy(partner)], shapes)
