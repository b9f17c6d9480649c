"""Entries of the folder ``results/``: what a method scored, one file each, and the table of all of them.

Scores are added as files by a pull request; ``results/README.md`` says how.
"""

import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Self

from pydantic import Field, ValidationError, model_validator

from specklegen.core.display.escape import cell
from specklegen.core.errors import reject
from specklegen.core.tables import json_table, read_text
from specklegen.core.values import Finite, PositiveInt, Value, broken_rules
from specklegen.models.judging.chance import above_chance
from specklegen.models.judging.tasks import TASKS, VERSION, complete_run, counted_tasks, task

if TYPE_CHECKING:
    from specklegen.models.judging.results import Results

UNNAMED = "to be filled in"
"""What :func:`entry` leaves to its author."""


class Scored(Value):
    """A mean score.

    Parameters
    ----------
    mean, low, high
        With its 95 % interval over media and characters.
    chance
        What the same answers score for other images' objects.
    """

    mean: Finite
    low: Finite
    high: Finite
    chance: Finite

    @model_validator(mode="after")
    def _check(self) -> Self:
        if not self.low <= self.mean <= self.high:
            reject("Scored.mean", "between low and high", (self.low, self.mean, self.high))
        return self


class OfTask(Value):
    """Scores of a method on a task.

    Parameters
    ----------
    digest
        Fingerprint of the task.
    images
        How many of it, the first ones.
    unanswered
        How many had no answer, which count as images of nothing.
    pearson, psnr, ssim
        To the sharp object.
    """

    digest: Annotated[str, Field(pattern=r"^[0-9a-f]{64}$")]
    images: PositiveInt
    unanswered: Annotated[int, Field(ge=0)] = 0
    pearson: Scored
    psnr: Scored
    ssim: Scored


class Entry(Value):
    """A file of ``results/``.

    Parameters
    ----------
    name
        Of the method, as it stands in the table.
    by
        Who ran it.
    about
        What it is, in a sentence; a link where there is one.
    trained_on
        What it has learned from; "nothing" where it has not.
    memory_effect
        Whether it is told C_I.
    version
        Of the benchmark.
    tasks
        By name.
    """

    name: Annotated[str, Field(min_length=1, max_length=60)]
    by: Annotated[str, Field(min_length=1)]
    about: Annotated[str, Field(min_length=1)]
    trained_on: Annotated[str, Field(min_length=1)]
    memory_effect: bool
    version: PositiveInt
    tasks: Annotated[dict[str, OfTask], Field(min_length=1)]

    @model_validator(mode="after")
    def _check(self) -> Self:
        if self.version > VERSION:
            reject("Entry.version", f"at most {VERSION}, the version of this build", self.version)
        if self.version == VERSION:
            for name, each in self.tasks.items():
                known = task(name)
                if each.digest != known.fingerprint:
                    reject(f"Entry.tasks[{name!r}].digest", known.fingerprint[:12], each.digest[:12])
                if not 2 <= each.images <= known.samples or each.unanswered > each.images:
                    reject(f"Entry.tasks[{name!r}].images",
                           f"2 to {known.samples}, and at least the number without an answer",
                           (each.images, each.unanswered))  # fmt: skip
        return self

    @property
    def complete(self) -> bool:
        """True if all images of all tasks were asked, but those that have to be fetched."""
        return all(each.name in self.tasks and self.tasks[each.name].images == each.samples for each in complete_run())


def entry(results: "Results", function: str, **about: Any) -> Entry:
    """Entry of a function of a run; ``about`` are fields that a run does not know, which are else left to fill in."""
    tasks = {}
    for name, evaluation in results.evaluations.items():
        if not results.asked(function, name):
            continue
        scores = {
            score: Scored(**results.interval(function, name, score)._asdict(),
                          chance=results.chance(function, name, score))
            for score in ("pearson", "psnr", "ssim")
        }  # fmt: skip
        failed = sum(each.images for each in results.failures if (each.task, each.function) == (name, function))
        tasks[name] = OfTask(digest=task(name).fingerprint, images=len(evaluation.media), unanswered=failed, **scores)
    stated = {"by": UNNAMED, "about": UNNAMED, "trained_on": UNNAMED, "memory_effect": True} | about
    found = {"name": function[:60], "version": VERSION, "tasks": tasks}
    return Entry(**found | stated)


def write_entry(file: Path, one: Entry) -> None:
    """Write an entry as JSON, numbers to a millionth."""
    file.write_text(json.dumps(_rounded(one.model_dump(mode="json")), indent=1, ensure_ascii=False) + "\n")


def _rounded(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _rounded(each) for key, each in value.items()}
    return round(value, 6) if isinstance(value, float) else value


def read_entry(file: Path) -> Entry:
    """Read an entry."""
    field = f"entry {file.name}"
    content = json_table(read_text(file, field), field)
    content.pop("answers", None)  # entries of earlier versions name a file, and a commitment to a secret seed or none
    if content.get("commitment") == "":
        del content["commitment"]
    try:
        return Entry.model_validate(content)
    except ValidationError as error:
        raise broken_rules("Entry", error, Entry) from None


def read_entries(folder: Path) -> list[Entry]:
    """Entries of a folder, by the names of their files."""
    return [read_entry(file) for file in sorted(folder.glob("*.json"))]


def table(entries: list[Entry]) -> str:
    """Markdown: a row for each entry, by mean Pearson correlation, complete ones first; a column for each task asked.

    A number after a score in brackets says on how many images it is, where it is not on all.
    """
    heads = [each.name for each in TASKS if any(each.name in one.tasks for one in entries)]
    lines = [
        f"| method | C_I | mean (chance) | above chance | PSNR, dB | SSIM | {' | '.join(map(cell, heads))} |",
        "|---" * (6 + len(heads)) + "|",
    ]
    for one in sorted(entries, key=lambda each: (not each.complete, -_mean(each, "pearson", "mean"), each.name)):
        cells = [_of_task(one, name) for name in heads]
        mean, chance = (_mean(one, "pearson", what) for what in ("mean", "chance"))
        decibels, structure = (_mean(one, score, "mean") for score in ("psnr", "ssim"))
        shares = [above_chance(each.pearson.mean, each.pearson.chance) for each in _counted(one)]
        note = "" if one.complete else " *"
        share = f"{sum(shares) / len(shares):.3f}"
        told = [cell(one.name) + note, "yes" if one.memory_effect else "no", f"{mean:.3f} ({chance:.3f})", share]
        lines.append(f"| {' | '.join([*told, f'{decibels:.1f}', f'{structure:.3f}', *cells])} |")
    if any(not one.complete for one in entries):
        lines += ["", "\\* not complete: the mean is over the tasks that were run; the number in brackets after a "
                      "score is its number of images."]  # fmt: skip
    return "\n".join(lines) + "\n"


def _mean(one: Entry, score: str, what: str) -> float:
    values = [getattr(getattr(scores, score), what) for scores in _counted(one)]
    return sum(values) / len(values)


def _counted(one: Entry) -> list[OfTask]:
    """Scores of the tasks that the mean is of."""
    names = counted_tasks(one.tasks) if one.version == VERSION else one.tasks
    return [one.tasks[name] for name in names]


def _of_task(one: Entry, name: str) -> str:
    if name not in one.tasks:
        return "–"
    asked, whole = one.tasks[name].images, task(name).samples
    return f"{one.tasks[name].pearson.mean:.3f}" + ("" if asked == whole else f" [{asked}]")
