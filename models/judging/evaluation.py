"""Evaluation: every method on the same images, against both targets, with intervals over media.

Two targets, named in every table: "sharp" is the object itself; "diffraction-limited" is the object as a lens as wide
as the illuminated window would show it, which is all that speckle of that grain carries. Everything is put on a frame
of 64 pixels, moved onto the target by all shifts and the flip, and scored on the object's own pixels; brightness is 0
to 1 (data range 1).
"""

import csv
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor

from specklegen.core.errors import reject
from specklegen.core.escaping import cell, csv_cell
from specklegen.models.judging.baselines import FRAME, Batch, Method, grain_pixels
from specklegen.models.metrics import SCORES, Interval, align, bootstrap
from specklegen.models.retrieval.apodisation import diffraction_limited, framed, transfer_function
from specklegen.scene.window import Profile

TARGETS = ("sharp", "diffraction-limited")


def targets_of(batch: Batch, profile: Profile = "square") -> dict[str, Tensor]:
    """Both targets of a batch on the frame, float32[B, FRAME, FRAME], the object in its first corner."""
    objects = batch["object"].float()
    blurred = [
        diffraction_limited(one, transfer_function(FRAME, grains, profile))
        for one, grains in zip(objects, grain_pixels(batch).tolist(), strict=True)
    ]
    return dict(zip(TARGETS, (framed(objects, FRAME), torch.stack(blurred).float()), strict=True))


def aligned_to(made: Tensor, target: Tensor, shape: tuple[int, int]) -> Tensor:
    """Reconstructions, framed, moved onto targets on the frame, and cut to the object's pixels.

    The margin goes on as dark as the reconstruction's edge, the median of its outermost pixels: scores forget an offset
    of brightness, and a method should not be found out by the box that the offset would make.
    """
    edge = [made[..., 0, :], made[..., -1, :], made[..., :, 0], made[..., :, -1]]
    dark = torch.cat(edge, dim=-1).median(-1).values[..., None, None]
    return align(framed((made - dark).float(), FRAME), target)[..., : shape[0], : shape[1]]


class Evaluation(NamedTuple):
    """Scores of every method on every image.

    Attributes
    ----------
    values : dict[str, dict[str, dict[str, float64[n]]]]
        By method, target and score.
    media : int64[n]
        Medium of each image.
    """

    values: dict[str, dict[str, dict[str, np.ndarray]]]
    media: np.ndarray

    def interval(self, method: str, target: str = "sharp", score: str = "pearson") -> Interval:
        """Mean with its 95 % interval over media."""
        return bootstrap(self.values[method][target][score], self.media)

    def gain(self, method: str, over: str, target: str = "sharp", score: str = "pearson") -> Interval:
        """Mean of the paired difference of two methods, with its 95 % interval over media."""
        values = self.values
        return bootstrap(values[method][target][score] - values[over][target][score], self.media)

    def rows(self) -> list[dict[str, str | float]]:
        """One row for each method, target and score."""
        return [
            {"method": method, "target": target, "score": score, "images": len(self.media),
             "media": len(np.unique(self.media)), **self.interval(method, target, score)._asdict()}
            for method, targets in self.values.items() for target, found in targets.items() for score in found
        ]  # fmt: skip

    def markdown(self) -> str:
        """Table with a row for each method and target, a column for each score."""
        lines = [f"{len(self.media)} images, {len(np.unique(self.media))} media; mean [95 % interval over media].", ""]
        lines += ["| method | target | " + " | ".join(SCORES) + " |", "|---" * (2 + len(SCORES)) + "|"]
        for method, targets in self.values.items():
            for target in targets:
                cells = [self.interval(method, target, score) for score in SCORES]
                text = " | ".join(f"{c.mean:.3f} [{c.low:.3f}, {c.high:.3f}]" for c in cells)
                lines.append(f"| {cell(method)} | {target} | {text} |")
        return "\n".join(lines) + "\n"

    def write(self, folder: Path) -> None:
        """Write summary.md, summary.csv (intervals) and images.csv (every image)."""
        folder.mkdir(parents=True, exist_ok=True)
        (folder / "summary.md").write_text(self.markdown())
        rows = self.rows()
        with (folder / "summary.csv").open("w", newline="") as file:
            table = csv.DictWriter(file, list(rows[0]))
            table.writeheader()
            table.writerows(row | {"method": csv_cell(str(row["method"]))} for row in rows)
        with (folder / "images.csv").open("w", newline="") as file:
            plain = csv.writer(file)
            plain.writerow(["image", "medium", "method", "target", *SCORES])
            for method, targets in self.values.items():
                for target, found in targets.items():
                    for n, scores in enumerate(zip(*found.values(), strict=True)):
                        plain.writerow([n, self.media[n], csv_cell(method), target, *(f"{v:.6g}" for v in scores)])


class Case(NamedTuple):
    """One image with everything that a picture shows of it."""

    object: np.ndarray
    image: np.ndarray
    reconstructions: dict[str, np.ndarray]
    scores: dict[str, float]


def evaluate(
    methods: Mapping[str, Method], batches: Iterable[Batch], profile: Profile = "square"
) -> tuple[Evaluation, list[Case]]:
    """Score methods on the same batches.

    Parameters
    ----------
    methods
        Name to method.
    batches
        Of a hidden-object recipe, as tensors.
    profile
        Of the illuminated window.

    Returns
    -------
    Evaluation, list[Case]
        The second has every image, its reconstructions aligned to the sharp target, and their Pearson correlations.

    Raises
    ------
    RuleError
        If there are no methods or no batches, or a batch has not one image of each object.
    """
    if not methods:
        reject("evaluate methods", "at least one", list(methods))
    values: dict[str, dict[str, dict[str, list[Tensor]]]] = {
        method: {target: {score: [] for score in SCORES} for target in TARGETS} for method in methods
    }
    media: list[Tensor] = []
    cases: list[Case] = []
    for batch in batches:
        if "image" not in batch or "object" not in batch:
            reject("evaluate batch", 'one with "object" and "image"', sorted(batch), "Films and stacks have several.")
        media.append(batch["parameters"]["medium"].long())
        truths = targets_of(batch, profile)
        shape = (batch["object"].shape[-2], batch["object"].shape[-1])
        shown: dict[str, Tensor] = {}
        for name, method in methods.items():
            made = method(batch)
            aligned = {target: aligned_to(made, truth, shape) for target, truth in truths.items()}
            shown[name] = aligned["sharp"]
            for target, truth in truths.items():
                for score, function in SCORES.items():
                    found = function(aligned[target], truth[..., : shape[0], : shape[1]])
                    values[name][target][score].append(found)
        cases += _cases(batch, shown, {name: values[name]["sharp"]["pearson"][-1] for name in methods})
    if not media:
        reject("evaluate batches", "at least one", 0)
    joined = {
        method: {
            target: {score: torch.cat(parts).double().numpy() for score, parts in scores.items()}
            for target, scores in targets.items()
        }
        for method, targets in values.items()
    }
    return Evaluation(joined, torch.cat(media).numpy()), cases


def _cases(batch: Batch, shown: Mapping[str, Tensor], scores: Mapping[str, Tensor]) -> list[Case]:
    return [
        Case(
            hidden.numpy(),
            image.float().numpy(),
            {name: images[n].numpy() for name, images in shown.items()},
            {name: float(found[n]) for name, found in scores.items()},
        )
        for n, (hidden, image) in enumerate(zip(batch["object"], batch["image"], strict=True))
    ]


def best_median_worst(cases: list[Case], method: str, each: int = 3) -> list[Case]:
    """Cases at the two ends and in the middle of a method's scores, best first."""
    ranked = sorted(cases, key=lambda case: -case.scores[method])
    each = min(each, max(len(ranked) // 3, 1))
    middle = (len(ranked) - each) // 2
    return ranked[:each] + ranked[middle : middle + each] + ranked[-each:]
