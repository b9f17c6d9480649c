"""Tables of what networks tell of maps of contrast: R^2 of the pixels of each exposure, over media never seen."""

import csv
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np

from specklegen.core.display.escape import cell, csv_cell
from specklegen.models.judging.answers import determinations
from specklegen.models.judging.isolation import copy_of
from specklegen.models.learning.reconstructor import Reconstructor
from specklegen.models.metrics import Interval


class MapScores(NamedTuple):
    """Errors of maps against the ground truth.

    Attributes
    ----------
    errors : mapping of float64[n, E]
        Mean square error of each map, by the method that drew it.
    mean, square : float64[n, E]
        Mean of each true map, and of its square.
    media : int64[n]
    """

    errors: Mapping[str, np.ndarray]
    mean: np.ndarray
    square: np.ndarray
    media: np.ndarray

    def determination(self, method: str) -> list[Interval]:
        """R^2 of each exposure: 1 less the mean square error over the variance of all pixels of all maps.

        With 95 % intervals over samples, by bootstrap.
        """
        return determinations(self.errors[method], self.mean, self.square)

    def rows(self) -> list[dict[str, Any]]:
        """R^2 of each exposure by everybody."""
        return [
            {"method": method, "exposure": n, **interval._asdict()}
            for method in self.errors for n, interval in enumerate(self.determination(method))
        ]  # fmt: skip

    def markdown(self) -> str:
        """R^2 and the root mean square error of each exposure."""
        lines = [f"{len(self.mean)} stacks, {len(np.unique(self.media))} media; R^2 of the contrast of all pixels [95 "
                 "% interval over stacks]. A constant, the mean over all pixels, scores 0.", ""]  # fmt: skip
        lines += ["| method | exposure | R^2 | root mean square error |", "|---" * 4 + "|"]
        for method, errors in self.errors.items():
            roots = np.sqrt(errors.mean(0))
            for n, (interval, error) in enumerate(zip(self.determination(method), roots, strict=True)):
                lines.append("| {} | {} | {:.3f} [{:.3f}, {:.3f}] | {:.4f} |".format(cell(method), n, *interval, error))
        return "\n".join(lines) + "\n"

    def write(self, folder: Path) -> None:
        """Write summary.md, and the root mean square error of every map as maps.csv."""
        folder.mkdir(parents=True, exist_ok=True)
        (folder / "summary.md").write_text(self.markdown())
        with (folder / "maps.csv").open("w", newline="") as file:
            table = csv.writer(file)
            exposures = range(self.mean.shape[1])
            table.writerow(["stack", "medium", *(csv_cell(f"{who} {n}") for who in self.errors for n in exposures)])
            for n, row in enumerate(np.sqrt(np.hstack([*self.errors.values()]))):
                table.writerow([n, self.media[n], *(f"{value:.6g}" for value in row)])


def judge_maps(
    model: Reconstructor, batches: Iterable[Mapping[str, Any]],
    beside: Mapping[str, Callable[[Mapping[str, Any]], np.ndarray]] = MappingProxyType({}),
) -> MapScores:  # fmt: skip
    """Ask a network that draws maps of contrast of every batch, and other methods, functions of a batch to maps."""
    methods = {"network": lambda batch: model.tell(batch).double().cpu().numpy(), **beside}
    errors: dict[str, list[np.ndarray]] = {name: [] for name in methods}
    mean, square, media = [], [], []
    for batch in map(copy_of, batches):
        true = batch["target"].double().numpy()
        for name, method in methods.items():
            errors[name].append(np.square(method(batch) - true).mean((-2, -1)))
        mean.append(true.mean((-2, -1)))
        square.append(np.square(true).mean((-2, -1)))
        media.append(batch["parameters"]["medium"].long().numpy())
    joined = {name: np.concatenate(parts) for name, parts in errors.items()}
    return MapScores(joined, *(np.concatenate(parts) for parts in (mean, square, media)))
