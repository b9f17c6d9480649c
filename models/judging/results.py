"""Results of the benchmark: scores of functions on tasks, as tables, rows and files."""

import csv
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from specklegen.core.display.escape import cell, csv_cell
from specklegen.core.display.plot import Pictured
from specklegen.core.errors import counted
from specklegen.models.judging.chance import above_chance
from specklegen.models.judging.entries import entry, write_entry
from specklegen.models.judging.evaluation import Evaluation
from specklegen.models.judging.tasks import VERSION, complete_run, counted_tasks, task
from specklegen.models.metrics import Interval

SHOWN = {"pearson": "Pearson", "psnr": "PSNR, dB", "ssim": "SSIM"}
"""Scores of the second table, by their names there."""
DIGITS = {"pearson": "{:.3f} ({:.3f})", "psnr": "{:.1f} ({:.1f})", "ssim": "{:.3f} ({:.3f})"}
"""How a score and its chance are written."""


class Failure(NamedTuple):
    """A batch of a task that a function had no answer to.

    Attributes
    ----------
    first, images : int
        First sample of the batch, and how many.
    """

    task: str
    function: str
    first: int
    images: int
    reason: str

    def __str__(self) -> str:
        return f"{self.function} on {self.task}, images {self.first} to {self.first + self.images - 1}: {self.reason}"


@dataclass(frozen=True, repr=False)
class Results(Pictured):
    """Scores of functions on tasks.

    Attributes
    ----------
    evaluations : dict[str, Evaluation]
        By task; each holds every function's score of every image.
    samples : int
        Images of a task, at most: a task has no more than its own.
    failures : tuple of Failure
        Batches that functions had no answer to, which count as images of nothing.
    answers : dict[(str, str), list of float32[B, n, n]]
        By task and function: what was answered, batch by batch.
    chances : dict[(str, str), dict[str, float64[n]]]
        By task and function: scores of its answers for other images' objects (:mod:`specklegen.models.judging.chance`).
    skipped : tuple of str
        Tasks left out because nobody has said where their files are.
    """

    evaluations: dict[str, Evaluation]
    samples: int
    failures: tuple["Failure", ...] = ()
    answers: Mapping[tuple[str, str], list[np.ndarray]] = field(default_factory=dict)
    chances: Mapping[tuple[str, str], Mapping[str, np.ndarray]] = field(default_factory=dict)
    skipped: tuple[str, ...] = ()

    def _facts(self) -> Mapping[str, object]:
        run = "complete" if self.complete else "not complete: do not compare it with complete runs"
        return {f"mean of {function}": self.score(function) for function in self.functions} | {"run": run}

    def _draw(self, axes: Any, label: str | None = None) -> None:
        """Score of every function on every task, with its interval."""
        for number, function in enumerate(self.functions):
            asked = [n for n, name in enumerate(self.evaluations) if self.asked(function, name)]
            intervals = np.array([self.interval(function, list(self.evaluations)[n]) for n in asked]).T
            at = np.array(asked) + 0.12 * (number - (len(self.functions) - 1) / 2)
            bars = np.abs(intervals[1:] - intervals[0])
            axes.errorbar(intervals[0], at, xerr=bars, fmt="o", ms=4, lw=1, label=function)
        axes.set_yticks(np.arange(len(self.evaluations)), list(self.evaluations))
        axes.invert_yaxis()
        axes.set(xlabel="Pearson correlation")
        axes.legend(fontsize="small")

    def interval(self, function: str, task: str, score: str = "pearson") -> Interval:
        """Mean score of a function on a task, with its 95 % interval over media and characters."""
        return self.evaluations[task].interval(function, score=score)

    def asked(self, function: str, task: str) -> bool:
        """Return whether a function was asked about a task: some baselines are of some tasks alone."""
        return function in self.evaluations[task].values

    def score(self, function: str, score: str = "pearson") -> float:
        """Mean of a function's means over the tasks; by Pearson the number to rank by, where all tasks were run.

        Tasks whose images have to be fetched are no part of it, where there are others. NaN of a function that was not
        asked about all of them.
        """
        names = counted_tasks(self.evaluations)
        if not all(self.asked(function, name) for name in names):
            return float("nan")
        return float(np.mean([self.interval(function, name, score).mean for name in names]))

    def chance(self, function: str, task: str, score: str = "pearson") -> float:
        """Mean score of a function's answers for objects of other images of the task."""
        return float(self.chances[task, function][score].mean())

    @property
    def functions(self) -> list[str]:
        """Names, in the order in which they were given."""
        return list(dict.fromkeys(name for each in self.evaluations.values() for name in each.values))

    @property
    def complete(self) -> bool:
        """True if all of the benchmark was run: other scores are not to be compared with published ones."""
        whole = all(len(each.media) == task(name).samples for name, each in self.evaluations.items())
        asked = [each.name for each in complete_run()]
        return whole and [name for name in self.evaluations if not task(name).fetched] == asked

    def by_family(self) -> dict[tuple[str, str], Evaluation]:
        """Parts of the tasks of several families, by task and family; of two media at least."""
        return {
            (name, family): evaluation.part(evaluation.families == number)
            for name, evaluation in self.evaluations.items() for number, family in enumerate(task(name).families)
            if len(np.unique(evaluation.media[evaluation.families == number])) > 1
        }  # fmt: skip

    def rows(self) -> list[dict[str, Any]]:
        """One row for each task, function, target and score, with version, fingerprint and what chance scores.

        Rows of a part of a task name the ``family``, which is empty otherwise; chance is stated for whole tasks, for
        the sharp target.
        """
        whole = {(name, ""): evaluation for name, evaluation in self.evaluations.items()}
        return [
            {"version": VERSION, "task": name, "fingerprint": task(name).fingerprint, "family": family, **row,
             "chance": self._chance_of(name, family, row)}
            for (name, family), evaluation in (whole | self.by_family()).items() for row in evaluation.rows()
        ]  # fmt: skip

    def _chance_of(self, task: str, family: str, row: Mapping[str, Any]) -> float | None:
        known = not family and row["target"] == "sharp" and (task, row["method"]) in self.chances
        return self.chance(task=task, function=row["method"], score=row["score"]) if known else None

    def markdown(self) -> str:
        """Tables: a row for each task and a column for each function; all scores beside chance; families."""
        part = "" if self.complete else " Not a complete run: do not compare it with complete runs."
        lines = [
            f"Benchmark version {VERSION}, {self._images()}: Pearson correlation to the sharp "
            f"object [95 % interval over media and characters].{part}", "",
            f"| task | {' | '.join(map(cell, self.functions))} |", "|---" * (1 + len(self.functions)) + "|",
        ]  # fmt: skip
        for name in self.evaluations:
            lines.append(f"| {cell(name)} | {' | '.join(self._cells(name, self.evaluations[name]))} |")
        means = " | ".join("–" if np.isnan(mean) else f"**{mean:.3f}**" for mean in map(self.score, self.functions))
        lines.append(f"| **mean** | {means} |")
        lines += self._beside_chance() + self._families() + self._left_out()
        if self.failures:
            lines += ["", "No answer (scored as a dark image):", ""]
            lines += [f"- {each}" for each in self.failures]
        return "\n".join(lines) + "\n"

    def _images(self) -> str:
        """Number of images a task."""
        counts = sorted({len(each.media) for each in self.evaluations.values()})
        many = counted(counts[0], "image") if len(counts) == 1 else f"{counts[0]} to {counts[-1]} images"
        return f"{many} a task"

    def _cells(self, task: str, evaluation: Evaluation) -> list[str]:
        return [
            "{:.3f} [{:.3f}, {:.3f}]".format(*evaluation.interval(function)) if self.asked(function, task) else "–"
            for function in self.functions
        ]

    def _beside_chance(self) -> list[str]:
        """Table of the means over the tasks that a function was asked about, each with what chance scores."""
        counting = counted_tasks(self.evaluations)
        known = [name for name in self.functions if any((task, name) in self.chances for task in counting)]
        if not known:
            return []
        lines = [
            "", "Means over tasks after the same shift and turn, and (chance) what the same answers score for other "
            "images' objects. Above chance: the share (r - chance) / (1 - chance), of Pearson's r.", "",
            f"| function | {' | '.join(SHOWN.values())} | above chance |", "|---" * (2 + len(SHOWN)) + "|",
        ]  # fmt: skip
        for name in known:
            tasks = [task for task in counting if (task, name) in self.chances]
            means = [np.mean([self.interval(name, task, score).mean for task in tasks]) for score in SHOWN]
            chances = [np.mean([self.chance(name, task, score) for task in tasks]) for score in SHOWN]
            cells = [DIGITS[score].format(a, b) for score, a, b in zip(SHOWN, means, chances, strict=True)]
            share = np.mean([above_chance(self.interval(name, task).mean, self.chance(name, task)) for task in tasks])
            lines.append(f"| {cell(name)} | {' | '.join(cells)} | {share:.3f} |")
        return lines

    def _families(self) -> list[str]:
        """Table of the tasks of several families, by family."""
        parts = self.by_family()
        if not parts:
            return []
        lines = ["", "By family:", "", f"| task, family (images) | {' | '.join(map(cell, self.functions))} |",
                 "|---" * (1 + len(self.functions)) + "|"]  # fmt: skip
        for (name, family), part in parts.items():
            row = f"{cell(name)}, {cell(family)} ({len(part.media)})"
            lines.append(f"| {row} | {' | '.join(self._cells(name, part))} |")
        return lines

    def _left_out(self) -> list[str]:
        """Name the tasks left out because their files were not named."""
        if not self.skipped:
            return []
        names = ", ".join(self.skipped)
        return ["", f"Skipped, since their files were not named: {names}. `specklegen check measured get "
                    "hidden-shapes` fetches them; then give the folder: `--measured hidden-shapes`."]  # fmt: skip

    def write(self, folder: Path) -> None:
        """Write results.md, results.csv, answers.npz, and an entry of each function.

        ``answers.npz`` holds every answer, float32[B, n, n], as "task/function/batch". The folder ``entries`` holds
        what ``results/`` of the repository collects (:mod:`specklegen.models.judging.entries`), but for what their
        authors say of them.
        """
        folder.mkdir(parents=True, exist_ok=True)
        (folder / "results.md").write_text(self.markdown())
        batches = {
            f"{name}/{function}/{number}": images
            for (name, function), answers in self.answers.items() for number, images in enumerate(answers)
        }  # fmt: skip
        np.savez_compressed(folder / "answers.npz", **batches)  # type: ignore[arg-type]
        (folder / "entries").mkdir(exist_ok=True)
        for number, function in enumerate(self.functions):
            if all((name, function) in self.chances for name in self.evaluations if self.asked(function, name)):
                write_entry(folder / "entries" / f"{number}.json", entry(self, function))
        rows = self.rows()
        with (folder / "results.csv").open("w", newline="") as file:
            table = csv.DictWriter(file, list(rows[0]))
            table.writeheader()
            table.writerows(row | {"method": csv_cell(str(row["method"]))} for row in rows)
