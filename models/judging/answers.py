"""Tables of what networks tell of a sample other than its object: its label, or numbers of the medium."""

import csv
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np
import torch

from specklegen.core.display.escape import cell, csv_cell
from specklegen.datasets.objects.outlines import CHARACTERS
from specklegen.models.judging.isolation import copy_of
from specklegen.models.learning.reconstructor import Reconstructor
from specklegen.models.learning.targets import MATERIAL, TARGETS, Scale, in_units
from specklegen.models.metrics import Interval, bootstrap

_WORST = 10  # confusions in a table


class Classification(NamedTuple):
    """Predicted labels.

    Attributes
    ----------
    probabilities : float64[n, K]
        Of the classes.
    labels, media : int64[n]
        The true class, and the medium, of each image.
    """

    probabilities: np.ndarray
    labels: np.ndarray
    media: np.ndarray

    def accuracy(self, first: int = 1) -> Interval:
        """Share of images whose class is among the ``first`` most probable; 95 % interval over media and classes."""
        ranked = np.argsort(-self.probabilities, axis=1, kind="stable")[:, :first]
        return bootstrap((ranked == self.labels[:, None]).any(1), self.media, self.labels)

    @property
    def confusion(self) -> np.ndarray:
        """Confusion matrix: counts of a class (row) taken for another (column), int64[K, K]."""
        counts = np.zeros((self.probabilities.shape[1],) * 2, np.int64)
        np.add.at(counts, (self.labels, self.probabilities.argmax(1)), 1)
        return counts

    def rows(self) -> list[dict[str, Any]]:
        """Accuracy of the first and of the first five classes."""
        return [{"score": f"among the first {n}", **self.accuracy(n)._asdict()} for n in (1, 5)]

    def markdown(self) -> str:
        """Accuracy beside chance, and the most frequent confusions."""
        shown = np.unique(self.labels)
        lines = [f"{len(self.labels)} images, {len(np.unique(self.media))} media, {len(shown)} classes; share [95 % "
                 "interval over media and classes].", ""]  # fmt: skip
        lines += ["| named rightly | among the first five | chance |", "|---" * 3 + "|"]
        cells = ["{:.3f} [{:.3f}, {:.3f}]".format(*self.accuracy(first)) for first in (1, 5)]
        lines += [f"| {cells[0]} | {cells[1]} | {1 / len(shown):.3f} |", "", "| shown | taken for | times | of |"]
        lines += ["|---" * 4 + "|"]
        wrong = self.confusion - np.diag(np.diag(self.confusion))
        for place in np.argsort(-wrong, axis=None, kind="stable")[:_WORST]:
            true, predicted = np.unravel_index(place, wrong.shape)
            if wrong[true, predicted]:
                times, of = wrong[true, predicted], (self.labels == true).sum()
                lines.append(f"| {CHARACTERS[true]} | {CHARACTERS[predicted]} | {times} | {of} |")
        return "\n".join(lines) + "\n"

    def write(self, folder: Path) -> None:
        """Write summary.md, and the whole confusion table as confusion.csv."""
        folder.mkdir(parents=True, exist_ok=True)
        (folder / "summary.md").write_text(self.markdown())
        with (folder / "confusion.csv").open("w", newline="") as file:
            table = csv.writer(file)
            table.writerow(["shown", *map(csv_cell, CHARACTERS)])
            for name, row in zip(CHARACTERS, self.confusion.tolist(), strict=True):
                table.writerow([csv_cell(name), *row])


class Regression(NamedTuple):
    """Predicted numbers of the medium, beside those of baselines.

    Attributes
    ----------
    told, true : float64[n, K]
        The numbers, some by their log10.
    media : int64[n]
        Medium of each stack.
    names : mapping
        Of the numbers, of :mod:`specklegen.models.learning.targets`.
    beside : mapping of float64[n, K]
        What other methods told, by their names.
    """

    told: np.ndarray
    true: np.ndarray
    media: np.ndarray
    names: Mapping[str, Scale] = MappingProxyType(MATERIAL)
    beside: Mapping[str, np.ndarray] = MappingProxyType({})

    @property
    def methods(self) -> dict[str, np.ndarray]:
        """Answers of every method, float64[n, K] each."""
        return {"network": self.told, **self.beside}

    def determination(self, told: np.ndarray) -> dict[str, Interval]:
        """R^2 of each number, 1 less the mean square error over the variance; 95 % interval over samples."""
        intervals = determinations(np.square(told - self.true), self.true, np.square(self.true))
        return dict(zip(self.names, intervals, strict=True))

    def rows(self) -> list[dict[str, Any]]:
        """R^2 of each number, of everybody where others stand beside the network."""
        return [
            ({"method": method} if self.beside else {}) | {"number": name, **interval._asdict()}
            for method, answer in self.methods.items() for name, interval in self.determination(answer).items()
        ]  # fmt: skip

    def markdown(self) -> str:
        """R^2 and the root mean square error of each number."""
        lines = [f"{len(self.true)} stacks, {len(np.unique(self.media))} media; R^2 [95 % interval over stacks]. A "
                 "constant, the mean over all media, scores 0.", ""]  # fmt: skip
        first, bar = ("| method ", "|---") if self.beside else ("", "")
        lines += [f"{first}| number | R^2 | root mean square error |", f"{bar}{'|---' * 3}|"]
        for method, answer in self.methods.items():
            errors = np.sqrt(np.square(answer - self.true).mean(0))
            for (name, interval), error in zip(self.determination(answer).items(), errors, strict=True):
                label = f"log10 {name}" if self.names[name].logarithm else name
                who = f"| {cell(method)} " if self.beside else ""
                lines.append("{}| {} | {:.3f} [{:.3f}, {:.3f}] | {:.3f} |".format(who, label, *interval, error))
        return "\n".join(lines) + "\n"

    def write(self, folder: Path) -> None:
        """Write summary.md, and every stack as stacks.csv."""
        folder.mkdir(parents=True, exist_ok=True)
        (folder / "summary.md").write_text(self.markdown())
        columns = {"told": self.told, **{f"by {name}": rows for name, rows in self.beside.items()}, "true": self.true}
        with (folder / "stacks.csv").open("w", newline="") as file:
            table = csv.writer(file)
            table.writerow(["stack", "medium", *(csv_cell(f"{name} {who}") for who in columns for name in self.names)])
            for n, row in enumerate(np.hstack([*columns.values()])):
                table.writerow([n, self.media[n], *(f"{value:.6g}" for value in row)])


def judge(
    model: Reconstructor, batches: Iterable[Mapping[str, Any]],
    beside: Mapping[str, Callable[[Mapping[str, Any]], np.ndarray]] = MappingProxyType({}),
) -> Classification | Regression:  # fmt: skip
    """Ask a network that tells labels or numbers of every batch.

    ``beside`` are other methods by their names, functions of a batch to the numbers float64[B, K].
    """
    batch_answers, true, media = [], [], []
    others: dict[str, list[np.ndarray]] = {name: [] for name in beside}
    for batch in map(copy_of, batches):
        batch_answers.append(model.tell(batch).cpu())
        true.append(TARGETS[model.target].values(batch))
        media.append(batch["parameters"]["medium"].long())
        for name, method in beside.items():
            others[name].append(method(batch))
    predicted, rows, where = torch.cat(batch_answers).double().numpy(), torch.cat(true), torch.cat(media).numpy()
    if model.target == "label":
        return Classification(predicted, rows[:, 0].argmax(-1).numpy(), where)
    names = TARGETS[model.target].numbers
    answers = {name: np.concatenate(parts) for name, parts in others.items()}
    return Regression(predicted, in_units(rows.double(), names).numpy(), where, names, answers)


def determinations(errors: np.ndarray, mean: np.ndarray, square: np.ndarray) -> list[Interval]:
    """R^2 of each of K numbers with 95 % intervals over samples, by bootstrap.

    Of float64[n, K]: square errors, and the mean of what is true, and of its square, in each sample.
    """
    count = len(mean)
    draws = np.random.default_rng(np.random.SeedSequence(0)).multinomial(count, np.full(count, 1 / count), size=2000)

    def score(weight: np.ndarray) -> np.ndarray:
        return 1 - weight @ errors / (weight @ square - np.square(weight @ mean))

    low, high = np.quantile(score(draws / count), [0.025, 0.975], axis=0)
    numbers = zip(score(np.full(count, 1 / count)), low, high, strict=True)
    return [Interval(*map(float, each)) for each in numbers]
