"""Evaluation: every method on the same images, against both targets, with intervals over media.

Beside every table stand the level of chance (another object, the mean image), and how often a method's image names
its object among 32.

Two targets, named in every table: "sharp" is the object itself; "diffraction-limited" is the object as a lens as wide
as the illuminated window would show it, which is all that speckle of that grain carries. Everything is put on a frame
of 64 pixels, moved onto the target by all shifts and the flip, and scored on the object's own pixels; brightness is in
``[0, 1]`` (data range 1).
"""

import csv
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import torch
from torch import Tensor

from specklegen.core.arguments import choice
from specklegen.core.display.escape import cell, csv_cell
from specklegen.core.display.plot import Pictured
from specklegen.core.display.repr import summary
from specklegen.core.errors import reject
from specklegen.core.labelled import Labelled, Labels
from specklegen.models.judging.baselines import FRAME, Batch, Method, grain_pixels
from specklegen.models.judging.isolation import copy_of
from specklegen.models.metrics import SCORES, Interval, align, bootstrap
from specklegen.models.retrieval.apodisation import diffraction_limited, framed, transfer_function
from specklegen.scene.window import PROFILES, Profile

TARGETS = ("sharp", "diffraction-limited")
PERFECT = 100.0
"""Largest score that counts, in decibels of a PSNR: that of an image without error is infinite, and has no mean."""
CANDIDATES = 32
"""Objects among which a method has to name its own."""
EXTENTS = (0.0, 0.5, 1.0, 2.0, float("inf"))
"""Ends of the parts of a table by extent, memory-effect ranges."""
_CLASSES = 1000  # labels of a family, at most


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
    return align(on_frame(made), target)[..., : shape[0], : shape[1]]


def on_frame(images: Tensor, dark: bool = True) -> Tensor:
    """Images real[..., h, w] in the first corner of the frame, ``dark`` those whose edge is made 0 first."""
    return framed(_darkened(images) if dark else images.float(), FRAME)


def _darkened(made: Tensor) -> Tensor:
    """Images less the median of their outermost pixels."""
    edge = [made[..., 0, :], made[..., -1, :], made[..., :, 0], made[..., :, -1]]
    return (made - torch.cat(edge, dim=-1).median(-1).values[..., None, None]).float()


@dataclass(frozen=True)
class Evaluation(Pictured, Labelled):
    """Scores of every method on every image.

    Attributes
    ----------
    values : dict[str, dict[str, dict[str, float64[n]]]]
        By method, target and score.
    media : int64[n]
        Medium of each image.
    labels : int64[n]
        Character, or another class, of each; -1 where there is none.
    extents : float64[n]
        Extent of each object over the memory-effect range.
    families : int64[n]
        Number of the family of each, in a mixture.
    identified : dict[str, bool[n]]
        By method: whether the reconstruction is more like its own object than like any other of its
        :data:`CANDIDATES`.
    """

    values: dict[str, dict[str, dict[str, np.ndarray]]]
    media: np.ndarray
    labels: np.ndarray
    extents: np.ndarray
    families: np.ndarray
    identified: dict[str, np.ndarray]

    def __repr__(self) -> str:
        return summary(self, images=len(self.media), methods=list(self.values))

    def _facts(self) -> Mapping[str, object]:
        shown = {method: "{:.3f} [{:.3f}, {:.3f}]".format(*self.interval(method)) for method in self.values}
        return {"images": len(self.media), "media": len(np.unique(self.media))} | shown

    def _arrays(self) -> Mapping[str, Labels]:
        methods = list(self.values)
        targets, scores = ([*dict.fromkeys(x)] for x in (
            (target for each in self.values.values() for target in each),
            (score for each in self.values.values() for by_score in each.values() for score in by_score),
        ))  # fmt: skip
        axes, shape = ("method", "target", "score", "image"), (len(methods), len(targets), len(scores), len(self.media))
        values = np.full(shape, np.nan)
        for m, t, s in np.ndindex(shape[:3]):
            row = self.values[methods[m]].get(targets[t], {}).get(scores[s])
            if row is not None:
                values[m, t, s] = row
        identified = np.array([self.identified[method] for method in methods if method in self.identified])
        known = {"media": self.media, "labels": self.labels, "extents": self.extents, "families": self.families}
        named = {"method": methods, "target": targets, "score": scores}
        return (
            {name: Labels((name,), np.array(words), coordinate=True) for name, words in named.items()}
            | {name: Labels(("image",), column, coordinate=True) for name, column in known.items()}
            | {"values": Labels(axes, values)}
            | ({"identified": Labels(("method", "image"), identified)} if len(identified) == len(methods) else {})
        )

    def _draw(self, axes: Any, label: str | None = None) -> None:
        """Mean Pearson correlation of every method to the sharp object, with its interval."""
        intervals = np.array([self.interval(method) for method in self.values]).T
        at = np.arange(len(self.values))
        axes.errorbar(intervals[0], at, xerr=np.abs(intervals[1:] - intervals[0]), fmt="o", ms=4, lw=1)
        axes.set_yticks(at, list(self.values))
        axes.invert_yaxis()
        axes.set(xlabel="Pearson correlation")

    @property
    def characters(self) -> np.ndarray:
        """Class of each image among those of all families, int64[n]; -1 where there is none."""
        return np.where(self.labels < 0, -1, self.labels + _CLASSES * self.families.clip(0))

    def interval(self, method: str, target: str = "sharp", score: str = "pearson") -> Interval:
        """Mean with its 95 % interval over media and characters."""
        return bootstrap(self.values[method][target][score], self.media, self.characters)

    def gain(self, method: str, over: str, target: str = "sharp", score: str = "pearson") -> Interval:
        """Mean of the paired difference of two methods, with its 95 % interval over media and characters."""
        values = self.values
        return bootstrap(values[method][target][score] - values[over][target][score], self.media, self.characters)

    def part(self, chosen: np.ndarray) -> "Evaluation":
        """Evaluation of some of the images, bool[n]."""
        values = {
            method: {target: {name: score[chosen] for name, score in scores.items()} for target, scores in each.items()}
            for method, each in self.values.items()
        }
        identified = {method: right[chosen] for method, right in self.identified.items()}
        return Evaluation(
            values, self.media[chosen], self.labels[chosen], self.extents[chosen], self.families[chosen], identified
        )

    def parts(self) -> dict[str, "Evaluation"]:
        """Images by the extent of their objects, and by family where there are several; of two media at least."""
        chosen = {
            f"{low:g} to {high:g} ranges" if high < np.inf else f"above {low:g} ranges": (low < x) & (x <= high)
            for x in [np.round(self.extents, 9)] for low, high in zip(EXTENTS[:-1], EXTENTS[1:], strict=True)
        }  # fmt: skip
        if len(np.unique(self.families)) > 1:
            chosen |= {f"family {number}": self.families == number for number in np.unique(self.families)}
        return {name: self.part(mask) for name, mask in chosen.items() if len(np.unique(self.media[mask])) > 1}

    def rows(self) -> list[dict[str, str | float]]:
        """One row for each method, target and score."""
        return [
            {"method": method, "target": target, "score": score, "images": len(self.media),
             "media": len(np.unique(self.media)), **self.interval(method, target, score)._asdict()}
            for method, targets in self.values.items() for target, by_score in targets.items() for score in by_score
        ]  # fmt: skip

    def markdown(self) -> str:
        """Table with a row for each method and target, a column for each score."""
        kinds = len(np.unique(self.labels[self.labels >= 0]))
        over = f"{len(np.unique(self.media))} media" + (f", {kinds} characters" if kinds else "")
        lines = [f"{len(self.media)} images, {over}; mean [95 % interval over {'both' if kinds > 1 else 'media'}].", ""]
        lines += ["| method | target | " + " | ".join(SCORES) + " |", "|---" * (2 + len(SCORES)) + "|"]
        for method, targets in self.values.items():
            for target in targets:
                cells = [self.interval(method, target, score) for score in SCORES]
                text = " | ".join(f"{c.mean:.3f} [{c.low:.3f}, {c.high:.3f}]" for c in cells)
                lines.append(f"| {cell(method)} | {target} | {text} |")
        parts = self.parts()
        heads = " | ".join(f"{name} ({len(part.media)})" for name, part in parts.items())
        candidates = min(CANDIDATES, len(self.media))
        lines += ["", f"Which of {candidates} objects is it, and Pearson correlation (sharp) by part:", ""]
        lines += [f"| method | named rightly | {heads} |", "|---" * (2 + len(parts)) + "|"]
        for method, right in self.identified.items():
            each = " | ".join("{:.3f} [{:.3f}, {:.3f}]".format(*part.interval(method)) for part in parts.values())
            lines.append(f"| {cell(method)} | {100 * right.mean():.0f} % | {each} |")
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
            plain.writerow(["image", "medium", "label", "extent", "method", "target", *SCORES])
            for method, targets in self.values.items():
                for target, by_score in targets.items():
                    for n, scores in enumerate(zip(*by_score.values(), strict=True)):
                        about = (n, self.media[n], self.labels[n], f"{self.extents[n]:.6g}")
                        plain.writerow([*about, csv_cell(method), target, *(f"{v:.6g}" for v in scores)])


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
        Of a hidden-object recipe, as tensors; films too.
    profile
        Of the illuminated window.

    Returns
    -------
    Evaluation, list[Case]
        The second has every image, its reconstructions aligned to the sharp target, and their Pearson correlations.

    Raises
    ------
    RuleError
        If there are no methods or no batches, or a batch has neither an image nor a film of each object.

    Examples
    --------
    >>> from specklegen.datasets import load_recipe
    >>> from specklegen.datasets.loading.stream import tensors
    >>> from specklegen.models import evaluate
    >>> recipe = load_recipe("through-slab", {"material": {"kernel_paths": 1000}})
    >>> batch = tensors(recipe.batch(0, "test", range(2)))
    >>> found, cases = evaluate({"a guess": lambda batch: batch["image"][:, 50:78, 50:78]}, [batch])
    >>> len(cases), -1 <= found.interval("a guess").mean <= 1
    (2, True)
    """
    if not isinstance(methods, Mapping) or not methods or not all(map(callable, methods.values())):
        reject("evaluate methods", "a table of at least one function of batches, by name", methods)
    choice("evaluate profile", profile, PROFILES)
    try:
        each = iter(batches)
    except TypeError:  # of arrays without dimensions too
        reject("evaluate batches", "an iterable of batches", batches)
    values: dict[str, dict[str, dict[str, list[Tensor]]]] = {
        method: {target: {score: [] for score in SCORES} for target in TARGETS} for method in methods
    }
    parameters: dict[str, list[Tensor]] = {name: [] for name in ("medium", "label", "extent_over_range", "family")}
    answers: dict[str, list[Tensor]] = {method: [] for method in methods}
    objects: list[Tensor] = []
    cases: list[Case] = []
    for batch in each:
        if not isinstance(batch, Mapping) or "object" not in batch or not ("image" in batch or "frames" in batch):
            given = sorted(batch) if isinstance(batch, Mapping) else batch
            reject("evaluate batch", 'a batch with "object", and "image" or "frames"', given)
        batch = copy_of(batch)
        nothing = torch.full((len(batch["object"]),), -1.0, dtype=torch.float64)
        for name, values_ in parameters.items():
            values_.append(batch["parameters"].get(name, nothing))
        truths = targets_of(batch, profile)
        shape = (batch["object"].shape[-2], batch["object"].shape[-1])
        shown: dict[str, Tensor] = {}
        for name, method in methods.items():
            answer = copy_of(method(copy_of(batch)))  # what one does in place is not the next one's
            answers[name].append(framed(_darkened(answer), FRAME))
            aligned = {target: aligned_to(answer, truth, shape) for target, truth in truths.items()}
            shown[name] = aligned["sharp"]
            for target, truth in truths.items():
                for score, function in SCORES.items():
                    scored = function(aligned[target], truth[..., : shape[0], : shape[1]])
                    values[name][target][score].append(scored.clamp(max=PERFECT))
        objects.append(truths["sharp"])
        cases += _cases(batch, shown, {name: values[name]["sharp"]["pearson"][-1] for name in methods})
    if not cases:
        reject("evaluate batches", "at least one", 0)
    joined = {
        method: {
            target: {score: torch.cat(parts).double().numpy() for score, parts in scores.items()}
            for target, scores in targets.items()
        }
        for method, targets in values.items()
    }
    column = {name: torch.cat(parts).numpy() for name, parts in parameters.items()}
    whole = {name: column[name].astype(np.int64) for name in ("medium", "label", "family")}
    named = {method: identified(torch.cat(parts), torch.cat(objects)).numpy() for method, parts in answers.items()}
    scored = Evaluation(
        joined, whole["medium"], whole["label"], column["extent_over_range"], whole["family"], named
    )  # fmt: skip
    return scored, cases


def identified(made: Tensor, objects: Tensor) -> Tensor:
    """Return whether reconstructions float[n, H, W] are most like their own of the objects, bool[n].

    Candidates are the other objects of the same :data:`CANDIDATES`; likeness is the largest Pearson correlation over
    all shifts and the flip. Of equally alike ones, as of an even image, the first is taken.
    """
    right = []
    for some, candidates in zip(made.split(CANDIDATES), objects.split(CANDIDATES), strict=True):
        rows, columns = some.shape[-2:]
        a, b = (x - x.mean((-2, -1), keepdim=True) for x in (some.float(), candidates.float()))
        norms = b.square().sum((-2, -1)).sqrt().clamp_min(torch.finfo(b.dtype).tiny)
        one, two = torch.fft.rfft2(a), torch.fft.rfft2(b)
        for n in range(len(some)):
            lags = torch.fft.irfft2(torch.stack([one[n].conj() * two, one[n] * two]), s=(rows, columns))
            right.append(int((lags.amax((0, -2, -1)) / norms).argmax()) == n)
    return torch.tensor(right)


def _cases(batch: Batch, shown: Mapping[str, Tensor], scores: Mapping[str, Tensor]) -> list[Case]:
    seen = batch["image"] if "image" in batch else batch["frames"][:, 0]
    return [
        Case(
            hidden.numpy(),
            image.float().numpy(),
            {name: images[n].numpy() for name, images in shown.items()},
            {name: float(numbers[n]) for name, numbers in scores.items()},
        )
        for n, (hidden, image) in enumerate(zip(batch["object"], seen, strict=True))
    ]


def best_median_worst(cases: list[Case], method: str, each: int = 3) -> list[Case]:
    """Cases at the two ends and in the middle of a method's scores, best first."""
    ranked = sorted(cases, key=lambda case: -case.scores[method])
    each = min(each, max(len(ranked) // 3, 1))
    middle = (len(ranked) - each) // 2
    return ranked[:each] + ranked[middle : middle + each] + ranked[-each:]
