"""Tables of what networks tell of a sample other than its object: its label, or the material."""

import csv
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import torch

from specklegen.core.display.escape import csv_cell
from specklegen.datasets.objects.outlines import CHARACTERS
from specklegen.models.learning.reconstructor import Reconstructor
from specklegen.models.learning.targets import MATERIAL, TARGETS, in_units
from specklegen.models.metrics import Interval, bootstrap

_WORST = 10  # confusions in a table


class Classification(NamedTuple):
    """What a network said of labels.

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
        """How often a class (row) was taken for another (column), int64[K, K]."""
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
            true, told = np.unravel_index(place, wrong.shape)
            if wrong[true, told]:
                times, of = wrong[true, told], (self.labels == true).sum()
                lines.append(f"| {CHARACTERS[true]} | {CHARACTERS[told]} | {times} | {of} |")
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
    """What a network said of materials.

    Attributes
    ----------
    told, true : float64[n, 4]
        log10 of range, thickness and optical depth, and g.
    media : int64[n]
        Medium of each stack.
    """

    told: np.ndarray
    true: np.ndarray
    media: np.ndarray

    def determination(self, resamples: int = 2000, seed: int = 0) -> dict[str, Interval]:
        """R^2 of each number, 1 less the mean square error over the variance; 95 % interval over samples."""
        square = np.square(self.told - self.true)
        rng = np.random.default_rng(np.random.SeedSequence(seed))
        weights = rng.multinomial(len(square), np.full(len(square), 1 / len(square)), size=resamples) / len(square)
        variance = weights @ np.square(self.true) - np.square(weights @ self.true)
        low, high = np.quantile(1 - weights @ square / variance, [0.025, 0.975], axis=0)
        mean = 1 - square.mean(0) / self.true.var(0)
        return {name: Interval(*map(float, found)) for name, *found in zip(MATERIAL, mean, low, high, strict=True)}

    def rows(self) -> list[dict[str, Any]]:
        """R^2 of each number."""
        return [{"number": name, **found._asdict()} for name, found in self.determination().items()]

    def markdown(self) -> str:
        """R^2 and the root mean square error of each number."""
        lines = [f"{len(self.true)} stacks, {len(np.unique(self.media))} media; R^2 [95 % interval over stacks]. The "
                 "mean of all materials scores 0.", ""]  # fmt: skip
        lines += ["| number | R^2 | root mean square error |", "|---" * 3 + "|"]
        errors = np.sqrt(np.square(self.told - self.true).mean(0))
        for (name, found), error in zip(self.determination().items(), errors, strict=True):
            label = name if name == "g" else f"log10 {name}"
            lines.append("| {} | {:.3f} [{:.3f}, {:.3f}] | {:.3f} |".format(label, *found, error))
        return "\n".join(lines) + "\n"

    def write(self, folder: Path) -> None:
        """Write summary.md, and every stack as stacks.csv."""
        folder.mkdir(parents=True, exist_ok=True)
        (folder / "summary.md").write_text(self.markdown())
        with (folder / "stacks.csv").open("w", newline="") as file:
            table = csv.writer(file)
            table.writerow(["stack", "medium", *(f"{name} {what}" for what in ("told", "true") for name in MATERIAL)])
            for n, row in enumerate(np.hstack([self.told, self.true])):
                table.writerow([n, self.media[n], *(f"{value:.6g}" for value in row)])


def judge(model: Reconstructor, batches: Iterable[Mapping[str, Any]]) -> Classification | Regression:
    """Ask a network that tells labels or materials of every batch."""
    told, true, media = [], [], []
    for batch in batches:
        told.append(model.tell(batch))
        true.append(TARGETS[model.target].values(batch))
        media.append(batch["parameters"]["medium"].long())
    made, rows, where = torch.cat(told).double().numpy(), torch.cat(true), torch.cat(media).numpy()
    if model.target == "label":
        return Classification(made, rows[:, 0].argmax(-1).numpy(), where)
    return Regression(made, in_units(rows.double()).numpy(), where)
