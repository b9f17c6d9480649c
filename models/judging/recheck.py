"""Results of the benchmark that anybody can check: answers in a file, scored anew against images rendered anew.

The file, ``answers.npz``, holds what every function answered to every batch of every task, the failures, and the scores
that were stated with it; :func:`recheck` runs no function of anybody's.
"""

import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import torch

from specklegen.core.errors import reject
from specklegen.models.judging.judged import judged
from specklegen.models.judging.secret import require_words, seed_of
from specklegen.models.judging.tasks import SEED, VERSION, drawn_at, task

if TYPE_CHECKING:
    from specklegen.models.judging.results import Results

_TOLERANCE = 1e-3  # of a score: images of another processor differ by 1e-6, a forged one by more than this is found


def write_answers(file: Path, results: "Results") -> None:
    """Write the answers and their scores; see :func:`recheck`."""
    stated = {
        "version": VERSION, "seed": None if results.commitment else SEED, "samples": results.samples,
        "commitment": results.commitment,
        "fingerprints": {name: task(name).fingerprint for name in results.evaluations},
        "failures": [each._asdict() for each in results.failures],
        "answers": [[name, function, len(batches)] for (name, function), batches in results.answers.items()],
        "scores": {
            name: {function: targets["sharp"]["pearson"].tolist() for function, targets in evaluation.values.items()}
            for name, evaluation in results.evaluations.items()
        },
    }  # fmt: skip
    arrays = {
        f"{number}/{place}": images
        for number, batches in enumerate(results.answers.values()) for place, images in enumerate(batches)
    }  # fmt: skip
    np.savez_compressed(file, stated=json.dumps(stated), **arrays)  # type: ignore[arg-type]


def samples_of(file: Path) -> int:
    """Return how many images a task, at most, the answers of a file are for, as it states."""
    with np.load(file, allow_pickle=False) as content:
        return int(json.loads(str(content["stated"]))["samples"])


def recheck(
    file: Path, secret: str | None = None, measured: Path | str | None = None
) -> dict[tuple[str, str], float]:
    """Score the answers of a file anew.

    Parameters
    ----------
    file
        ``answers.npz`` of a run.
    secret
        Words that a run at a secret seed is bound to.
    measured
        Folder of measured frames, where a file has answers to them.

    Returns
    -------
    dict
        Mean Pearson correlation by task and function, as found now.

    Raises
    ------
    RuleError
        If the file is of another version or of other images, or of fewer than it states, answers or scores are of
        tasks or functions that the other ones are not of, or a score is not the one that it states; or the words are
        not those that it is bound to.
    """
    with np.load(file, allow_pickle=False) as content:
        stated: dict[str, Any] = json.loads(str(content["stated"]))
        answers = {
            (name, function): [content[f"{number}/{place}"] for place in range(count)]
            for number, (name, function, count) in enumerate(stated["answers"])
        }
    bound = stated.get("commitment", "")
    if bool(bound) != (secret is not None):
        reject("benchmark secret", "given for answers at a secret seed, and for no others", bound[:12] or "none stated")
    if secret is not None:
        require_words(secret, bound)
    seed = SEED if secret is None else seed_of(secret)
    if (stated["version"], stated["seed"]) != (VERSION, None if bound else SEED):
        reject("answers version", f"{VERSION}, seed {SEED}", f"{stated['version']}, seed {stated['seed']}")
    _require_whole(stated)
    means = {}
    for name in stated["fingerprints"]:
        one = task(name)
        asked = stated["fingerprints"][name]
        if asked != one.fingerprint:
            reject(f"answers of {name!r}", f"to images {one.fingerprint[:12]}", asked[:12])
        of_task = {function: batches for (of, function), batches in answers.items() if of == name}
        sizes = _sizes(name, of_task, one.count(stated["samples"]))
        one.recipe()  # refuses other images
        own = {function: iter(batches) for function, batches in of_task.items()}
        methods = {function: lambda batch, each=each: torch.from_numpy(next(each)) for function, each in own.items()}
        ends = np.cumsum([0, *sizes]).tolist()
        batches = (
            batch for first, last in zip(ends, ends[1:], strict=False)
            for batch in one.batches(range(first, last), seed, measured)
        )  # fmt: skip
        evaluated, _ = judged(one, methods, batches)
        for function, targets in evaluated.values.items():
            scores = targets["sharp"]["pearson"]
            claimed = np.array(stated["scores"][name][function])
            if claimed.shape != scores.shape or not (np.abs(claimed - scores) <= _TOLERANCE).all():
                worst = int(np.abs(claimed - scores).argmax()) if claimed.shape == scores.shape else 0
                reject(f"score of {function!r} on {name!r}, image {worst}", f"{scores[worst]:.4f}, as found now",
                       claimed.tolist()[worst : worst + 1])  # fmt: skip
            means[name, function] = float(scores.mean())
    return means


def _require_whole(stated: dict[str, Any]) -> None:
    """Refuse what would not be looked at: of tasks without a fingerprint, of functions without answers or scores."""
    tasks = set(stated["fingerprints"])
    answered = [(name, function) for name, function, _ in stated["answers"]]
    scored = [(name, function) for name, scores in stated["scores"].items() for function in scores]
    if len(set(answered)) < len(answered):
        reject("answers", "one of each function to each task", sorted(answered))
    if set(answered) != set(scored):
        reject("answers", "of the tasks and functions that are scored", sorted(set(answered) ^ set(scored)))
    if tasks != {name for name, _ in answered} or tasks != set(stated["scores"]):
        there = sorted({name for name, _ in answered})
        reject("answers fingerprints", f"of the tasks answered, {there}", sorted(tasks))


def missing_tasks(file: Path) -> list[str]:
    """Return the tasks of the benchmark that a file has no answers to: with any, it is no complete run."""
    with np.load(file, allow_pickle=False) as content:
        stated = json.loads(str(content["stated"]))
    asked = drawn_at(stated.get("commitment", ""))
    return [each.name for each in asked if each.name not in stated["fingerprints"]]


def _sizes(task: str, answers: dict[str, list[np.ndarray]], samples: int) -> list[int]:
    """Images of each batch: those that every function answered, as many as are stated, and no choice of them."""
    sizes = {function: [len(each) for each in batches] for function, batches in answers.items()}
    for function, counts in sizes.items():
        if sum(counts) != samples or counts != next(iter(sizes.values())):
            reject(f"answers of {function!r} to {task!r}", f"to all of {samples} images, as stated", sum(counts))
    if not sizes:
        reject(f"answers to {task!r}", f"to all of {samples} images, as stated", "none")
    return next(iter(sizes.values()))
