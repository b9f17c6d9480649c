"""The benchmark: a reconstruction function on frozen tasks (:mod:`specklegen.models.judging.tasks`), by one call.

What a function is handed says nothing of the object but its image: the object is blanked, and what a sample's
parameters tell of it is left out. The score is the Pearson correlation to the sharp object after the best shift and
180-degree turn, with a 95 % interval over media and characters.
"""

import csv
import json
from collections.abc import Callable, Iterable, Mapping
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple, cast

import numpy as np
import torch
from torch import Tensor

from specklegen.core.arguments import whole_number
from specklegen.core.content import content_digest
from specklegen.core.display.escape import cell, csv_cell
from specklegen.core.display.plot import Pictured
from specklegen.core.errors import counted, reject
from specklegen.datasets.recipes.hidden_object import CENTRE, HiddenObject
from specklegen.models.judging import baselines
from specklegen.models.judging.baselines import FRAME, Batch
from specklegen.models.judging.evaluation import Evaluation, evaluate
from specklegen.models.judging.isolation import Failed, Isolated, Limits, arrays_of, copy_of
from specklegen.models.judging.recheck import write_answers
from specklegen.models.judging.tasks import SAMPLES, SEED, TASKS, VERSION, task
from specklegen.models.learning.examples import batches_of
from specklegen.models.learning.reconstructor import load_pretrained
from specklegen.models.learning.solver import load_solver
from specklegen.models.metrics import Interval
from specklegen.models.retrieval.autocorrelation import memory_effect_of
from specklegen.models.retrieval.phase_retrieval import Retrieval

Function = Callable[[Batch], Any]
"""Of a blinded batch (:func:`blinded`) to brightness real[B, n, n], n at most 64, on the object's pitch, up to shift
and 180-degree turn."""

TOLD = ("label", "family", *CENTRE, "expected_contrast", "medium")
"""Parameters of a sample that tell of its object, or its number, of which the object is a function."""

_KNOWN = 256  # training objects whose mean is an answer
_STEP = 16  # images between two steps of a bar
_KATZ = Retrieval(restarts=10)

BASELINES: dict[str, Callable[[HiddenObject], Function]] = {
    "mean image": lambda recipe: baselines.mean_image(_training_objects(recipe)),
    "Katz": lambda recipe: baselines.katz(_KATZ, seed=SEED),
    "Katz, C_I": lambda recipe: baselines.katz(_KATZ, recipe=recipe, seed=SEED),
    "packaged network": lambda recipe: baselines.network(load_pretrained()),
    "solver": lambda recipe: baselines.any_object(load_solver(), recipe, seed=SEED),
}
"""Name of a baseline to what makes it for a task. The last two and "Katz, C_I" come with the package or know C_I."""


def _training_objects(recipe: HiddenObject) -> Tensor:
    return torch.stack([torch.from_numpy(recipe.objects.image(SEED, "train", n)) for n in range(_KNOWN)])


def blinded(batch: Batch, recipe: HiddenObject) -> dict[str, Any]:
    """What a function is handed of a batch.

    Returns
    -------
    dict
        ``image`` float32[B, H, W], or ``frames`` float32[B, F, H, W] (counts where the task has a camera);
        ``object`` float32[B, h, w], all zeros: its shape is known, not what it shows;
        ``memory_effect`` float64[B, FRAME], C_I of the medium between points 0, 1, 2, ... object pixels apart;
        ``parameters``, float64[B] each: ``object_pitch`` and ``camera_pitch`` (direction sines), ``wavelength``,
        ``width`` of the window, and the numbers of the medium, but nothing of the object.
    """
    drawn = batch["parameters"]
    known = {name: values for name, values in drawn.items() if name not in TOLD}
    curves, material = [], cast(Any, recipe.material)  # a slab's or a diffuser's: each knows its own
    for n in range(len(batch["object"])):
        own = {name: float(values[n]) for name, values in drawn.items()}
        correlation = material.known(material.slab_of(own)).correlation
        curves.append(memory_effect_of(correlation, own["wavelength"], own["object_pitch"])(np.arange(FRAME)))
    seen = {name: batch[name] for name in ("image", "frames") if name in batch}
    return {
        **seen, "object": torch.zeros_like(batch["object"]), "parameters": known,
        "memory_effect": torch.from_numpy(np.stack(curves)),
    }  # fmt: skip


class Failure(NamedTuple):
    """A batch of a task that a function had no answer to.

    Attributes
    ----------
    task, function : str
    first, images : int
        First sample of the batch, and how many.
    reason : str
    """

    task: str
    function: str
    first: int
    images: int
    reason: str

    def __str__(self) -> str:
        return f"{self.function} on {self.task}, images {self.first} to {self.first + self.images - 1}: {self.reason}"


@dataclass(frozen=True)
class Results(Pictured):
    """Scores of functions on tasks.

    Attributes
    ----------
    evaluations : dict[str, Evaluation]
        By task; each holds every function's score of every image.
    samples : int
        Images of a task.
    failures : tuple of Failure
        Batches that functions had no answer to, which count as images of nothing.
    answers : dict[(str, str), list of float32[B, n, n]]
        By task and function: what was answered, batch by batch.
    """

    evaluations: dict[str, Evaluation]
    samples: int
    failures: tuple["Failure", ...] = ()
    answers: Mapping[tuple[str, str], list[np.ndarray]] = field(default_factory=dict)

    def _facts(self) -> Mapping[str, object]:
        run = "complete" if self.complete else "not complete: not to be compared with one that is"
        return {f"mean of {function}": self.score(function) for function in self.functions} | {"run": run}

    def _draw(self, axes: Any, label: str | None = None) -> None:
        """Score of every function on every task, with its interval."""
        for number, function in enumerate(self.functions):
            intervals = np.array([self.interval(function, name) for name in self.evaluations]).T
            at = np.arange(len(self.evaluations)) + 0.12 * (number - (len(self.functions) - 1) / 2)
            bars = np.abs(intervals[1:] - intervals[0])
            axes.errorbar(intervals[0], at, xerr=bars, fmt="o", ms=4, lw=1, label=function)
        axes.set_yticks(np.arange(len(self.evaluations)), list(self.evaluations))
        axes.invert_yaxis()
        axes.set(xlabel="Pearson correlation", title=label or "")
        axes.legend(fontsize="small")

    def interval(self, function: str, task: str) -> Interval:
        """Mean Pearson correlation of a function on a task, with its 95 % interval over media and characters."""
        return self.evaluations[task].interval(function)

    def score(self, function: str) -> float:
        """Mean of a function's means over the tasks: the number to rank by, where all tasks were run."""
        return float(np.mean([self.interval(function, name).mean for name in self.evaluations]))

    @property
    def functions(self) -> list[str]:
        """Names, in the order in which they were given."""
        return list(next(iter(self.evaluations.values())).values)

    @property
    def complete(self) -> bool:
        """Whether all of the benchmark was run: other scores are not to be compared with published ones."""
        return self.samples == SAMPLES and list(self.evaluations) == [each.name for each in TASKS]

    def rows(self) -> list[dict[str, Any]]:
        """One row for each task, function, target and score, with version and fingerprint."""
        return [
            {"version": VERSION, "task": name, "fingerprint": task(name).fingerprint, **row}
            for name, evaluation in self.evaluations.items() for row in evaluation.rows()
        ]  # fmt: skip

    def markdown(self) -> str:
        """Table with a row for each task and a column for each function."""
        part = "" if self.complete else " Not a complete run: not to be compared with one."
        lines = [
            f"Benchmark version {VERSION}, {counted(self.samples, 'image')} a task: Pearson correlation to the sharp "
            f"object [95 % interval over media and characters].{part}", "",
            f"| task | {' | '.join(map(cell, self.functions))} |", "|---" * (1 + len(self.functions)) + "|",
        ]  # fmt: skip
        for name in self.evaluations:
            cells = ["{:.3f} [{:.3f}, {:.3f}]".format(*self.interval(function, name)) for function in self.functions]
            lines.append(f"| {cell(name)} | {' | '.join(cells)} |")
        means = " | ".join(f"**{self.score(function):.3f}**" for function in self.functions)
        lines.append(f"| **mean** | {means} |")
        if self.failures:
            lines += ["", "No answer, which counts as an image of nothing:", ""]
            lines += [f"- {each}" for each in self.failures]
        return "\n".join(lines) + "\n"

    def write(self, folder: Path) -> None:
        """Write results.md, results.csv, answers.npz and the data card of the tasks, card.md.

        ``answers.npz`` is what others check: :func:`specklegen.models.judging.recheck.recheck` scores it anew.
        """
        folder.mkdir(parents=True, exist_ok=True)
        (folder / "results.md").write_text(self.markdown())
        (folder / "card.md").write_text(card())
        write_answers(folder / "answers.npz", self)
        rows = self.rows()
        with (folder / "results.csv").open("w", newline="") as file:
            table = csv.DictWriter(file, list(rows[0]))
            table.writeheader()
            table.writerows(row | {"method": csv_cell(str(row["method"]))} for row in rows)


def benchmark(
    functions: Function | Mapping[str, Function],
    *,
    baselines: Iterable[str] = (),
    tasks: Iterable[str] | None = None,
    samples: int = SAMPLES,
    progress: Callable[[int, int], None] | None = None,
    limits: Limits | None = Limits(),  # noqa: B008
) -> Results:
    """Score reconstruction functions on the frozen tasks.

    Parameters
    ----------
    functions
        One function, named "yours" in tables, or several by name. Each is called with a batch as :func:`blinded` makes
        it, and returns brightness real[B, n, n], as an array or a tensor: n at most 64, on the object's pitch, up to
        shift and 180-degree turn, any unit and offset.
    baselines
        Names of :data:`BASELINES` to run beside.
    tasks
        Names of tasks; by default all.
    samples
        Images of each task, the first of its test split. Only runs of all :data:`SAMPLES` are to be compared.
    progress
        Called with (images done, images in all); by default nothing is.
    limits
        Time and memory of each function, which runs in a process of its own, on one thread. None runs all of them in
        this process, without limits, as a network on a CUDA device needs. Either way each gets copies of its own; one
        that does not answer (an error, something else than an image, too long, too large) is scored as an image of
        nothing, and named in ``failures``.

    Raises
    ------
    RuleError
        If there is nothing to score, a name is unknown, there are too few samples for two media, this build renders
        other images than those of the benchmark's version, or images are changed while functions run.

    Examples
    --------
    >>> from specklegen.models import benchmark
    >>> found = benchmark(lambda batch: batch["object"] + 1, tasks=["unseen media"], samples=4)
    >>> found.interval("yours", "unseen media").mean
    0.0
    """
    own = {"yours": functions} if callable(functions) else dict(functions)
    beside = list(baselines)
    for name in beside:
        if name not in BASELINES or name in own:
            reject("benchmark baselines", f"among {', '.join(BASELINES)}, and not a name of yours", name)
    if not own and not beside:
        reject("benchmark functions", "at least one, or a baseline", own)
    chosen = [task(name) for name in tasks] if tasks is not None else list(TASKS)
    names = [each.name for each in chosen]
    if not names or len(set(names)) < len(names):
        reject("benchmark tasks", "at least one, each once", names)
    whole_number("benchmark samples", samples, 2, SAMPLES)
    recipes = {each.name: each.recipe() for each in chosen}
    tell = progress or (lambda done, total: None)
    evaluations, total = {}, len(recipes) * samples
    failures: list[Failure] = []
    answers: dict[tuple[str, str], list[np.ndarray]] = {}
    for number, (name, recipe) in enumerate(recipes.items()):
        methods = own | {each: BASELINES[each](recipe) for each in beside}
        with ExitStack() as stack:
            asked = {}
            for each, function in methods.items():
                run = _here(function) if limits is None else Isolated(function, _checked, limits)
                if isinstance(run, Isolated):
                    stack.callback(run.close)
                asked[each] = _asked(name, each, run, recipe, failures, answers.setdefault((name, each), []))
            batches = _told(recipe, samples, lambda done, before=number * samples: tell(before + done, total))
            evaluations[name], _ = evaluate(asked, batches, recipe.profile)
    return Results(evaluations, samples, tuple(failures), answers)


def _told(recipe: HiddenObject, samples: int, tell: Callable[[int], None]) -> Iterable[Batch]:
    """Batches of a task; tells how many of its images are done."""
    for first in range(0, samples, _STEP):
        last = min(first + _STEP, samples)
        yield from batches_of(recipe, range(first, last), SEED, "test")
        tell(last)


def _asked(
    task: str, name: str, run: Function, recipe: HiddenObject, failures: list[Failure], answers: list[np.ndarray]
) -> baselines.Method:
    """Ask a function about a blinded batch, keep what it says, and see that nothing else has changed."""

    def method(batch: Batch) -> Tensor:
        blind = blinded(batch, recipe)
        before = content_digest(arrays_of(batch), arrays_of(blind))
        try:
            answer = run(blind)
        except Failed as why:
            first = int(batch["index"][0])
            failures.append(Failure(task, name, first, len(batch["object"]), str(why)))
            answer = torch.zeros_like(blind["object"])
        if content_digest(arrays_of(batch), arrays_of(blind)) != before:
            reject(f"benchmark function {name!r}", "one that leaves the images of others alone", f"changed in {task!r}")
        answers.append(answer.numpy())
        return answer

    return method


def _here(function: Function) -> Function:
    """A function that is called in this process, on copies."""

    def run(batch: Batch) -> Tensor:
        try:
            return _checked(function(copy_of(batch)), len(batch["object"]))
        except Exception as error:
            raise Failed(f"{type(error).__name__}: {error}") from error

    return run


def _checked(made: Any, count: int) -> Tensor:
    """What a function answers to so many images.

    Raises
    ------
    RuleError
        If it is no answer.
    """
    made = torch.as_tensor(made)
    if made.ndim != 3 or len(made) != count or not 0 < max(made.shape[1:]) <= FRAME or made.is_complex():
        reject("the answer", f"real[{count}, n, n], n at most {FRAME}", f"{made.dtype}{list(made.shape)}")
    if not torch.isfinite(made).all():
        reject("the answer", "finite numbers", "inf or nan")
    return made.detach().cpu().float()


def card() -> str:
    """Data card of the benchmark, in Markdown: the tasks, the data to learn from, and the licence."""
    lines = [
        f"# Benchmark of specklegen, version {VERSION}", "",
        f"{len(TASKS)} tasks of {SAMPLES} images: samples 0 to {SAMPLES - 1} of the test split of a recipe, seed "
        f"{SEED}. A sample is a pure function of (recipe, seed, split, number): nothing is downloaded, and "
        "`specklegen.models.benchmark` renders the images anew. The fingerprint is the SHA-256 of all that decides a "
        "pixel; a build that renders other images refuses the task.", "",
        "| task | what is new or hard | starts from | fingerprint |", "|---|---|---|---|",
        *(f"| {cell(t.name)} | {cell(t.asks)} | `{t.base}` | `{t.fingerprint[:16]}` |" for t in TASKS), "",
        "**To learn from**: anything but the test splits of these recipes at this seed, and no character of "
        "569BFMTVWt, in any font (but in the task \"unseen media\"), no bars and no photographs. The `train` and "
        "`validation` splits of the recipes hold to that where they show characters.", "",
        "**What a function may use**: the image or film, pitches, wavelength, window, the numbers of the medium and "
        "its C_I. A method that does without C_I should say so beside its score.", "",
        "**Not in it**: measured images. All are simulated, with the assumptions that docs/trust.md lists.", "",
        "**Licence**: recipes, tasks and what is rendered from them: MIT, as the package. Characters are outlines of "
        "fonts (DejaVu, STIX, Computer Modern) that this package carries, with their licences; "
        "silhouettes are of photographs that scikit-image carries, under the licences that it states.", "",
        "## Recipes", "",
    ]  # fmt: skip
    for each in TASKS:
        table = json.dumps(each.recipe().physics(), indent=2, sort_keys=True)
        lines += [f"### {each.name}", "", "```json", table, "```", ""]
    return "\n".join(lines)
