"""The benchmark: a reconstruction function on frozen tasks (:mod:`specklegen.models.judging.tasks`), by one call.

What a function is handed says nothing of the object but its image: the object is blanked, and what a sample's
parameters tell of it is left out. The score to rank by is the Pearson correlation to the sharp object after the best
shift and 180-degree turn, with a 95 % interval over media and characters; PSNR and SSIM after the same motion, and what
chance scores, stand beside it.
"""

from collections.abc import Callable, Iterable, Mapping
from contextlib import ExitStack
from functools import partial
from pathlib import Path
from typing import Any, cast

import numpy as np
import torch
from torch import Tensor

from specklegen.core.arguments import whole_number
from specklegen.core.content import content_digest
from specklegen.core.errors import reject
from specklegen.datasets.objects.scan import Scan
from specklegen.datasets.recipes.hidden_object import CENTRE, HiddenObject
from specklegen.models.judging import baselines, frames, pages
from specklegen.models.judging.baselines import FRAME, Batch
from specklegen.models.judging.fitted import fitted
from specklegen.models.judging.isolation import Failed, Isolated, Limits, arrays_of, copy_of
from specklegen.models.judging.judged import judged
from specklegen.models.judging.results import Failure, Results
from specklegen.models.judging.tasks import SEED, TASKS, Task, complete_run, task
from specklegen.models.learning.reconstructor import load_pretrained
from specklegen.models.learning.solver import load_solver
from specklegen.models.retrieval.autocorrelation import memory_effect_of
from specklegen.models.retrieval.camera_noise import READABLE, Stated
from specklegen.models.retrieval.phase_retrieval import Retrieval

Function = Callable[[Batch], Any]
"""Of a blinded batch (:func:`blinded`) to brightness real[B, n, n], n at most 64, on the object's pitch, up to shift
and 180-degree turn; of a page of exposures the page too, real[1, rows, columns]."""

TOLD = ("label", "family", *CENTRE, "expected_contrast", "medium")
"""Parameters of a sample that tell of its object, or its number, of which the object is a function."""

_KNOWN = 256  # training objects whose mean is an answer
_STEP = 16  # images between two steps of a bar
_KATZ = Retrieval(restarts=10)

BASELINES: dict[str, Callable[[HiddenObject], Function]] = {
    "mean image": lambda recipe: baselines.mean_image(_training_objects(recipe)),
    "Katz": lambda recipe: baselines.katz(_KATZ, seed=SEED, camera=_camera(recipe), profile=recipe.profile),
    "Katz, C_I": lambda recipe: baselines.katz(_KATZ, recipe=recipe, seed=SEED),
    "packaged network": lambda recipe: baselines.network(load_pretrained()),
    "solver": lambda recipe: baselines.any_object(load_solver(), recipe, seed=SEED),
    "solver, drawn": lambda recipe: baselines.drawn(load_solver(), recipe, _KATZ, seed=SEED),
    "Katz, even light": lambda recipe: baselines.on_even_light(baselines.katz(_KATZ, recipe=recipe, seed=SEED)),
    "solver, even light": lambda recipe: baselines.on_even_light(
        baselines.any_object(load_solver(), recipe, seed=SEED)
    ),
    "untrained network": lambda recipe: baselines.network(baselines.untrained(load_pretrained(), seed=SEED)),
    "test-time fit": lambda recipe: fitted(recipe, seed=SEED),
    "multiframe": lambda recipe: baselines.together(recipe, seed=SEED),
    "spots together": lambda recipe: pages.scanned(recipe, seed=SEED),
}
"""Name of a baseline to what makes it for a task. "Katz, C_I", "Katz, even light" and the solvers know C_I; network and
solver were trained by this package's samples, and the others have learned nothing but the mean image. "Even light" is
an image over its fitted envelope, "drawn" the mean of eight pictures that the solver draws."""

OF_SOME: dict[str, Callable[[HiddenObject], bool]] = {
    "multiframe": lambda recipe: recipe.media_group > 2,
    "spots together": lambda recipe: isinstance(recipe.objects, Scan),
}
"""Baselines that can do some tasks alone: which. From two images of a medium multiframe deconvolution says little."""


def _camera(recipe: HiddenObject) -> Stated:
    """Camera noise as Katz is given it: nothing, where it can read it off the image."""
    assert recipe.camera is not None
    return "unknown" if recipe.camera.pixels_per_grain > READABLE else recipe.exposure or "none"


def _training_objects(recipe: HiddenObject) -> Tensor:
    return torch.stack([torch.from_numpy(recipe.objects.image(SEED, "train", n)) for n in range(_KNOWN)])


def blinded(batch: Batch, recipe: HiddenObject) -> dict[str, Any]:
    """Part of a batch that a function receives.

    Returns
    -------
    dict
        ``image`` float32[B, H, W], or ``frames`` float32[B, F, H, W] (counts where the task has a camera);
        ``object`` float32[B, h, w], all zeros: its shape is known, not what it shows;
        ``medium`` int64[B], in tasks whose samples share media: those of one number are seen through one medium, at
        rest, one after the other; numbers are of the batch;
        ``places`` int64[B, 2] and ``spot`` float32[h, w], of a page lit a spot at a time, whose exposures are the
        batch: first row and column of the spot at each, and its brightness; ``parameters`` have their ``light``;
        ``memory_effect`` float64[B, FRAME], C_I of the medium between points 0, 1, 2, ... object pixels apart, but of
        coherent objects, which have no pitch on the camera;
        ``parameters``, float64[B] each: ``object_pitch`` and ``camera_pitch`` (direction sines), ``wavelength``,
        ``width`` of the window, and the numbers of the medium, but nothing of the object.
    """
    drawn = batch["parameters"]
    known = {name: values for name, values in drawn.items() if name not in TOLD}
    curves, material = [], cast(Any, recipe.material)  # a slab's or a diffuser's: each knows its own
    for n in range(len(batch["object"]) if "object_pitch" in drawn else 0):
        own = {name: float(values[n]) for name, values in drawn.items()}
        correlation = material.known(material.slab_of(own)).correlation
        curves.append(memory_effect_of(correlation, own["wavelength"], own["object_pitch"])(np.arange(FRAME)))
    seen = {name: batch[name].float() for name in ("image", "frames") if name in batch}
    seen |= {name: batch[name] for name in ("places", "spot") if name in batch}
    if recipe.media_group > 1:  # numbered anew: of a medium's own number the object would be a function
        seen["medium"] = torch.unique(drawn["medium"], return_inverse=True)[1]
    effect = {"memory_effect": torch.from_numpy(np.stack(curves))} if curves else {}
    return {**seen, "object": torch.zeros_like(batch["object"]), "parameters": known, **effect}


def benchmark(
    functions: Function | Mapping[str, Function],
    *,
    baselines: Iterable[str] = (),
    tasks: Iterable[str] | None = None,
    samples: int | None = None,
    progress: Callable[[int, int], None] | None = None,
    limits: Limits | None = Limits(),  # noqa: B008
    measured: str | Path | None = None,
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
        Images of each task, the first of its test split; by default, and at most, all of each, and as many as are of
        two media where images share them. Only runs of all are to be compared.
    progress
        Called with (images done, images in all); by default nothing is.
    limits
        Time and memory of each function, which runs in a process of its own, on one thread. None runs all of them in
        this process, without limits, as a network on a CUDA device needs. Either way each gets copies of its own; one
        that does not answer (an error, something else than an image, too long, too large) is scored as an image of
        nothing, and named in ``failures``.
    measured
        Folder of the clone that ``specklegen check measured get hidden-shapes`` makes. By default there is none, and
        the task of measured frames is skipped, which the tables say.

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
            reject("benchmark baselines", f"one of {', '.join(BASELINES)}, and no name of your own functions", name)
    if not own and not beside:
        reject("benchmark functions", "at least one function, or a baseline", own)
    fetched = [each for each in TASKS if each.fetched]
    there = [] if measured is None or frames.missing(measured) else fetched
    if measured is not None and not there:
        reject("benchmark measured", f"a folder of {frames.SET}", str(measured),
               f"`specklegen check measured get {frames.SET}` fetches it.")  # fmt: skip
    chosen = [task(name) for name in tasks] if tasks is not None else complete_run() + there
    for each in chosen:
        if each in fetched and not there:
            reject("benchmark tasks", "tasks whose files are on this machine", each.name,
                   f"`specklegen check measured get {frames.SET}` fetches them; pass the folder as measured.",
                   )  # fmt: skip
    names = [each.name for each in chosen]
    if not names or len(set(names)) < len(names):
        reject("benchmark tasks", "at least one, each once", names)
    most = max(each.samples for each in chosen)
    samples = most if samples is None else whole_number("benchmark samples", samples, 2, most)
    for each in chosen:
        each.recipe()  # refuses other images before any is drawn
    tell = progress or (lambda done, total: None)
    counts = [each.count(samples) for each in chosen]
    evaluations, total = {}, sum(counts)
    failures: list[Failure] = []
    answers: dict[tuple[str, str], list[np.ndarray]] = {}
    chances: dict[tuple[str, str], dict[str, np.ndarray]] = {}
    for number, (of, count) in enumerate(zip(chosen, counts, strict=True)):
        name, recipe, before = of.name, of.recipe(), sum(counts[:number])
        serving = [each for each in beside if each not in OF_SOME or OF_SOME[each](recipe)]
        if of.kind == "glasses":
            serving = [each for each in beside if each == "mean image"]
        methods = own | {each: _beside(each, of, recipe) for each in serving}
        check = partial(_checked, pages=pages.shapes(recipe) if of.kind == "pages" else {})
        if not methods:
            reject("benchmark baselines", f"at least one that serves the task {name!r}", beside)
        with ExitStack() as stack:
            asked = {}
            for each, function in methods.items():
                run = _here(function, check) if limits is None else Isolated(function, check, limits)
                if isinstance(run, Isolated):
                    stack.callback(run.close)
                asked[each] = _asked(name, each, run, recipe, failures, answers.setdefault((name, each), []))
            batches = _told(of, count, measured, lambda done, before=before: tell(before + done, total))
            evaluations[name], by_chance = judged(of, asked, batches)
        for each in methods:
            chances[name, each] = by_chance(answers[name, each])
    skipped = () if tasks is not None or there else tuple(each.name for each in fetched)
    return Results(evaluations, samples, tuple(failures), answers, chances, skipped)


def _beside(name: str, of: Task, recipe: HiddenObject) -> Function:
    """A baseline of a task; one of images alone sees the exposures of a page a few at a time."""
    if of.kind == "glasses":  # scored in place
        mean = _training_objects(recipe).mean(0)
        return lambda batch: mean.expand(len(batch["object"]), -1, -1)
    made = BASELINES[name](recipe)
    return pages.in_parts(made) if of.kind == "pages" and name not in OF_SOME else made


def _told(of: Task, samples: int, measured: str | Path | None, tell: Callable[[int], None]) -> Iterable[Batch]:
    """Batches of a task; tells how many of its images are done."""
    for first in range(0, samples, _STEP):
        last = min(first + _STEP, samples)
        yield from of.batches(range(first, last), measured)
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
            failures.append(Failure(task, name, first, len(batch["index"]), str(why)))
            answer = torch.zeros_like(blind["object"])
        if content_digest(arrays_of(batch), arrays_of(blind)) != before:
            reject(f"benchmark function {name!r}", "a function that does not change its input", f"changed in {task!r}")
        if "places" in blind:
            answer = pages.together(answer, blind)
        answers.append(answer.numpy())
        return answer

    return method


def _here(function: Function, check: Callable[[Any, int], Tensor]) -> Function:
    """A function that is called in this process, on copies."""

    def run(batch: Batch) -> Tensor:
        try:
            return check(function(copy_of(batch)), len(batch["object"]))
        except Exception as error:
            raise Failed(f"{type(error).__name__}: {error}") from error

    return run


def _checked(made: Any, count: int, pages: Mapping[int, tuple[int, int]]) -> Tensor:
    """Return the answer of a function to some images, which may be the exposures of a page of some shape."""
    made = torch.as_tensor(made)
    if tuple(made.shape) == (1, *pages.get(count, ())) and not made.is_complex():
        pass
    elif made.ndim != 3 or len(made) != count or not 0 < max(made.shape[1:]) <= FRAME or made.is_complex():
        reject("the answer", f"real[{count}, n, n], n at most {FRAME}", f"{made.dtype}{list(made.shape)}")
    if not torch.isfinite(made).all():
        reject("the answer", "finite numbers", "inf or nan")
    return made.detach().cpu().float()
