"""The command ``specklegen check benchmark``: a reconstruction function on frozen tasks, beside baselines."""

import importlib
import importlib.util
from collections.abc import Callable
from pathlib import Path
from typing import Any

import typer

from specklegen.cli.output import AsJson, Progress, echo_json, writable
from specklegen.cli.settings import argument, option
from specklegen.core.errors import reject


def benchmark(
    functions: list[str] | None = argument(
        None, "Your functions: FILE.py:NAME, MODULE:NAME, or a network's best.pt (default: the baselines alone).",
        metavar="FUNCTION...",
    ),
    tasks: list[str] | None = option(None, "Task of --list; repeatable (default: all).", "--task", metavar="NAME"),
    samples: int | None = option(None, "Number of images of each task (default: all).", min=2),
    baselines: bool = option(True, "Score the baselines too."),
    out: Path = option(Path("benchmark"), "Folder for results."),
    seconds: float = option(600.0, "Time limit of a function for 16 images.", min=1e-3),
    gibibytes: float = option(8.0, "Memory limit of a function.", min=1e-3),
    measured: Path | None = option(
        None, "Folder made by `specklegen check measured get hidden-shapes`, for the task of that name.",
        metavar="FOLDER",
    ),
    table: Path | None = option(None, "Print the table of a folder of entries, and exit.", metavar="FOLDER"),
    listed: bool = option(False, "List the tasks and exit.", "--list"),
    as_json: AsJson = False,
) -> None:
    """Score reconstruction functions on frozen tasks: unseen media, noise, thin media, motion, beyond the range."""
    from specklegen.models.judging.tasks import GLASSES, TASKS, VERSION, complete_run, task

    if listed:
        rows = [{"version": VERSION, "task": t.name, "asks": t.asks, "fingerprint": t.fingerprint}
                for t in (*TASKS, *GLASSES)]  # fmt: skip
        if as_json:
            echo_json(rows)
        else:
            for row in rows:
                typer.echo(f"{row['task']:26s} {row['asks']}")
        return
    if table is not None:
        from specklegen.models.judging.entries import read_entries
        from specklegen.models.judging.entries import table as table_of

        if not (entries := read_entries(table)):
            reject("benchmark --table", "a folder with entries, *.json", str(table))
        typer.echo(table_of(entries), nl=False)
        return
    from specklegen.models.judging.benchmark import BASELINES
    from specklegen.models.judging.benchmark import benchmark as score
    from specklegen.models.judging.isolation import Limits

    names = [task(name).name for name in tasks] if tasks else None
    own = {text: _function(text) for text in functions or []}
    if not own and not baselines:
        reject("benchmark FUNCTION", "at least one function with --no-baselines", functions,
               "Name one, such as mine.py:mine, or leave out --no-baselines.")  # fmt: skip
    writable(out)
    asked = names or [each.name for each in complete_run() + [x for x in TASKS if x.fetched and measured]]
    total = sum(task(name).count(samples) for name in asked)
    with Progress(total) as progress:
        beside = tuple(BASELINES) if baselines else ()
        limits = Limits(seconds=seconds, gibibytes=gibibytes)
        results = score(
            own, baselines=beside, tasks=names, samples=samples, progress=progress, limits=limits, measured=measured
        )  # fmt: skip
    results.write(out)
    if as_json:
        echo_json(results.rows())
        return
    typer.echo(results.markdown())
    typer.echo(", ".join(str(out / name) for name in ("results.md", "results.csv", "answers.npz")))


def _function(text: str) -> Callable[[Any], Any]:
    """Names that a user gives: a function in a file or a module, or a network."""
    if text.endswith(".pt"):
        from specklegen.models.judging.baselines import network
        from specklegen.models.learning.reconstructor import Reconstructor

        return network(Reconstructor.load(Path(text)))
    place, _, name = text.rpartition(":")
    if not place or not name:
        reject("benchmark FUNCTION", "FILE.py:NAME, MODULE:NAME, or a file that ends in .pt", text)
    try:
        module = _from_file(Path(place)) if place.endswith(".py") else importlib.import_module(place)
    except (ModuleNotFoundError, FileNotFoundError) as error:
        reject("benchmark FUNCTION", "in a file or a module that can be imported", text, f"{error}.")
    function = getattr(module, name, None)
    if not callable(function):
        reject("benchmark FUNCTION", f"a function {name!r} of {place}", function)
    return function


def _from_file(file: Path) -> Any:
    stated = importlib.util.spec_from_file_location(file.stem, file)
    assert stated is not None
    assert stated.loader is not None
    module = importlib.util.module_from_spec(stated)
    stated.loader.exec_module(module)
    return module
