"""Baselines of a training run: methods that learn nothing, scored once on its validation images.

They answer before training begins, so that what they take is known and comes off the seconds of the run; the table is
shown then with the network as it is before its first step, and again with what it has become, on the same images.
"""

import time
from collections.abc import Callable, Iterable, Mapping
from typing import Any

import numpy as np
import torch
from torch import Tensor

from specklegen.datasets.recipes.hidden_object import HiddenObject
from specklegen.models.judging import baselines
from specklegen.models.judging.answers import judge
from specklegen.models.judging.contrast_maps import judge_maps
from specklegen.models.judging.evaluation import Evaluation, evaluate
from specklegen.models.learning.reconstructor import Reconstructor
from specklegen.models.learning.solver import EXTENT, Solver
from specklegen.models.retrieval.phase_retrieval import Retrieval

Batch = Mapping[str, Any]

RESTARTS = 4
"""Of phase retrieval."""
UNTRAINED, STARTED, TRAINED = "untrained network", "network at the start", "network"


def methods_beside(recipe: HiddenObject | None, seed: int, solver: Solver | None) -> dict[str, baselines.Method]:
    """Methods that show objects and learn nothing: phase retrieval and, where its recipe is known, the packaged solver.

    Parameters
    ----------
    recipe
        Of the images; None where only a store is there, whose images phase retrieval alone is asked about.
    seed
        Of random starts.
    solver
        The packaged one, left out where objects are larger than it shows.
    """
    settings = Retrieval(restarts=RESTARTS)
    methods = {"phase retrieval": baselines.katz(settings, recipe=recipe, seed=seed)}
    if recipe is not None and solver is not None and max(recipe.objects.shape) <= EXTENT:
        methods["packaged solver"] = baselines.any_object(solver, recipe, seed)
    return methods


class Beside:
    """Batches of validation images, and what methods answered about them.

    Parameters
    ----------
    batches
        Of validation images, a few each; more are taken until ``until``, two batches at least.
    methods
        Functions of a batch, by their names. Each is asked once about every batch.
    untrained
        The network as it is before its first step.
    until
        Reading of ``time.perf_counter`` after which no further batch is begun; None: all of them.
    profile
        Of the window, where objects are shown.
    called
        Name of ``untrained`` in tables: whether its weights are those of a seed or of a model.
    """

    def __init__(
        self, batches: Iterable[Batch], methods: Mapping[str, Callable[[Batch], Any]], untrained: Reconstructor,
        until: float | None = None, profile: Any = "square", called: str = UNTRAINED,
    ) -> None:  # fmt: skip
        self.batches: list[Batch] = []
        self.answers: dict[str, list[Any]] = {name: [] for name in methods}
        self.untrained, self.profile, self.called = untrained, profile, called
        for batch in batches:
            if until is not None and len(self.batches) > 1 and time.perf_counter() > until:
                break
            for name, method in methods.items():
                self.answers[name].append(method(batch))
            self.batches.append({**batch, "number": torch.tensor(len(self.batches))})

    @property
    def judged(self) -> bool:
        """True if there can be a table: of two media at least (one says nothing of others), and no coherent objects."""
        first = self.batches[0]
        hidden = "object_pitch" in first["parameters"] and not {"image", "frames"}.isdisjoint(first)
        shown = self.untrained.target != "object" or hidden
        return shown and len(torch.cat([batch["parameters"]["medium"].long() for batch in self.batches]).unique()) > 1

    def table(self, trained: Reconstructor | None = None) -> str:
        """Everybody's scores, as lines of Markdown; with the network once it is trained.

        Objects by their Pearson correlation to the sharp object after alignment, with intervals over media and
        characters, and by what the trained network is above each other method on the same images.
        """
        network = self.untrained if trained is None else trained
        if network.target == "object":
            return self._objects(trained)
        asked: dict[str, Callable[[Batch], np.ndarray]] = {name: _recalled(rows) for name, rows in self.answers.items()}
        if trained is not None and network.target != "label":
            asked[self.called] = lambda batch: self.untrained.tell(batch).double().cpu().numpy()
        text = (judge_maps if network.target == "contrast" else judge)(network, self.batches, asked).markdown()
        if trained is not None and network.target == "label":
            text += f"\nThe same images, {self.called}:\n\n{judge(self.untrained, self.batches).markdown()}"
        return text

    def _objects(self, trained: Reconstructor | None) -> str:
        others = torch.cat([batch["object"].float() for batch in self.batches]).roll(len(self.batches[0]["object"]), 0)
        answers: dict[str, list[Tensor]] = {
            "another object": list(others.split([len(batch["object"]) for batch in self.batches])), **self.answers,
            self.called: [baselines.network(self.untrained)(batch) for batch in self.batches],
        }  # fmt: skip
        if trained is not None:
            answers[TRAINED] = [baselines.network(trained)(batch) for batch in self.batches]
        methods = {name: _recalled(parts) for name, parts in answers.items()}
        return _scores(evaluate(methods, self.batches, self.profile)[0], TRAINED if trained is not None else None)


def _recalled(parts: list[Any]) -> Callable[[Batch], Any]:
    """A method whose answers are there already."""
    return lambda batch: parts[int(batch["number"])]


def _scores(found: Evaluation, ahead: str | None) -> str:
    """Rows of methods, with what the method ``ahead`` is above each."""
    head = f" | {ahead} less it, paired |" if ahead else " |"
    count, media = len(found.media), len(np.unique(found.media))
    lines = [f"{count} validation images, {media} media; Pearson correlation to the sharp object, moved onto it [95 %]",
             "", f"| method | correlation{head}", "|---" * (3 if ahead else 2) + "|"]  # fmt: skip
    for name in found.values:
        row = "| {} | {:.3f} [{:.3f}, {:.3f}] |".format(name, *found.interval(name))
        if ahead:
            row += " |" if name == ahead else " {:+.3f} [{:+.3f}, {:+.3f}] |".format(*found.gain(ahead, name))
        lines.append(row)
    return "\n".join(lines) + "\n"
