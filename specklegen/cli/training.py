"""The command that trains networks: ``specklegen train``."""

import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple

import typer

from specklegen.cli.failures import exit_status
from specklegen.cli.judging import MOST_KEPT, closed
from specklegen.cli.output import require_left_out, writable
from specklegen.cli.recipe_options import Images, Objects, RecipeOrStore, Set, is_store, load, load_objects
from specklegen.cli.settings import Fields, option
from specklegen.core.devices import checked_device
from specklegen.core.errors import counted, reject
from specklegen.core.interrupts import Terminated

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from specklegen.datasets import SpeckleCache
    from specklegen.datasets.recipes.recipe import Recipe
    from specklegen.datasets.sample_schema import Renderable
    from specklegen.models.judging.beside import Beside
    from specklegen.models.learning.examples import Examples
    from specklegen.models.learning.reconstructor import Reconstructor
    from specklegen.models.learning.settings import Training
    from specklegen.models.learning.training import Batches

PACKAGED = "packaged"
"""Name of the model to start from that comes with the package."""
_PREPARING = 0.2  # share of the seconds after which no more validation images are begun, and as much for the table
_TABLED = 32  # validation images in the table


def losses_starting_with(incomplete: str) -> list[str]:
    """Losses that a shell may complete."""
    from specklegen.models.learning.losses import LOSSES

    return [name for name in LOSSES if name.startswith(incomplete)]


TrainingOptions = Annotated[
    dict[str, Any],
    Fields("specklegen.models.learning.settings:Training", {"loss": {"autocompletion": losses_starting_with}}),
]


def train(
    training: TrainingOptions,
    what: RecipeOrStore,
    out: Path = option(..., "Folder of the run; a stopped run is resumed."),
    validation: Path | None = option(None, "Store of other media to validate on (needed if training data is a store)."),
    validation_samples: int = option(256, "Number of validation images of a recipe.", min=1, max=MOST_KEPT),
    start: str | None = option(
        None, "Model (best.pt) to start from, or packaged; it fixes --network, --width, "
        "--input and --target.", metavar="MODEL",
    ),
    seconds: float | None = option(None, "Wall-clock budget, setup and validation included (default: all epochs)."),
    law: bool = option(
        False, "Draw training samples from the statistical law of images instead of rendering them. Needs a recipe "
        "with one image of a hidden object, and --input periodogram. Validation images are rendered.", "--law",
    ),
    workers: int = option(0, "Processes that render a stream.", min=0, max=1024),
    cache: str | None = option(
        None, "Folder or address of a store that keeps the stream for later runs.", metavar="FOLDER",
    ),
    media_group: int = option(8, "Samples of a stream that share a medium, if each has its own in the recipe.", min=1),
    device: str = option("cpu", "Torch device for training; without --workers it also renders the stream (not with "
                                "--law)."),
    changes: Set = None,
    images: Images = None,
    objects: Objects = None,
) -> None:
    """Train a network to see through fog, on a recipe streamed meanwhile or on a store.

    The folder of the run holds checkpoint, log and curves. A table at the beginning and the end compares the network
    with baselines on validation images (summary.md). --seconds includes setup and validation; the validation set
    shrinks to fit.

    Where a sample takes long to render, draw the training set from the law of images:
    specklegen train characters-of-new-fonts --law --input periodogram --target label --network residual --width 26
    --learning-rate 1e-3 --out runs/label
    """
    begun = time.perf_counter()
    checked_device("--device", device)
    if seconds is not None and not seconds > 0:
        reject("--seconds", "greater than 0", seconds, "Leave it out to train all --epochs.")
    if (stored := is_store(what)) and validation is None:
        reject("train --validation", "given if training data is a store", validation,
               "Generate one: `specklegen generate RECIPE --split validation`.")  # fmt: skip
    typer.echo(f"Training on {what}: rendering validation images, then scoring the untrained network on them.")
    writable(out)
    from specklegen.models.judging.beside import STARTED, UNTRAINED, Beside
    from specklegen.models.learning.examples import batches_of
    from specklegen.models.learning.run import untrained
    from specklegen.models.learning.settings import Training

    first = None if start is None else _model(start, training, device)
    settings = Training(**training | _kind_of(first))
    if stored:
        assert validation is not None
        reason = "with a store, which has its recipe"
        require_left_out("train", reason, set=changes, images=images, objects=objects, law=law, cache=cache)
        material = _of_stores(Path(what), validation, settings)
    else:
        require_left_out("train", "with a recipe, whose validation split is used", validation=validation)
        recipe = (load_objects if settings.of_objects else load)(what, changes, images, objects)
        until = None if seconds is None else begun + _PREPARING * seconds
        if law and settings.input != "periodogram":
            reject("train --input", "periodogram with --law, which draws only periodograms", settings.input)
        if law:
            require_left_out("train", "with --law, whose samples are not rendered", cache=cache)
        shown = _shown(recipe, media_group, law)
        renders = "cpu" if workers or law else device
        material = _of_recipe(recipe, shown, settings, out, validation_samples, until, workers, renders,
                              cache)  # fmt: skip
    few = min(_TABLED, len(material.held_out.targets))
    beside = Beside(batches_of(material.source, few, settings.seed, "validation", _TABLED // 8),
                    _methods(material.recipe, settings, seconds, begun),
                    untrained(settings, material.held_out, device) if first is None else first,
                    None if seconds is None else begun + 2 * _PREPARING * seconds,
                    getattr(material.recipe, "profile", "square") if settings.of_objects else "square",
                    UNTRAINED if first is None else STARTED)  # fmt: skip
    reserve = -time.perf_counter()
    if beside.judged:
        typer.echo(f"\nbefore training: {beside.table()}")
    reserve += time.perf_counter()
    _draw_once(out)
    model = _fitted(settings, material, out, seconds, device, begun, 2 * reserve, first)
    _conclude(model, beside, out)


class _Material(NamedTuple):
    """Training and validation data of a run."""

    data: "Examples | tuple[Batches, int]"
    held_out: "Examples"
    source: "Recipe | SpeckleCache"
    """Where validation images are taken from once more for the table."""
    recipe: "Recipe | None"
    about: dict[str, Any]
    """What the data are, as recorded with the run."""


def _model(path: str, asked: dict[str, Any], device: str) -> "Reconstructor":
    """Read the model to start from; refuse options that ask for another kind than it is."""
    from specklegen.models.learning.reconstructor import Reconstructor, load_pretrained
    from specklegen.models.learning.settings import Training

    model = load_pretrained(device) if path == PACKAGED else Reconstructor.load(path, device)
    for name, has in _kind_of(model).items():
        if asked[name] not in (Training.model_fields[name].default, has):
            reject(f"train --{name}", f"left out, or that of the model to start from ({has})", asked[name])
    return model


def _kind_of(model: "Reconstructor | None") -> dict[str, Any]:
    """Fields of a model to start from that settings of training have too."""
    if model is None:
        return {}
    return {"target": model.target, "input": model.input, "network": model.name, "width": model.width}


def _of_stores(folder: Path, validation: Path, settings: "Training") -> _Material:
    """Read examples of two stores, which share neither media nor objects."""
    from specklegen.datasets import SpeckleCache
    from specklegen.models.learning.examples import examples
    from specklegen.models.learning.run_record import require_held_out

    stored, judged = SpeckleCache(folder), SpeckleCache(validation)
    require_held_out(stored, judged)
    data, held_out = (examples(cache, settings.input, target=settings.target) for cache in (stored, judged))
    about = {name: cache.identity | {"samples": len(cache)} for name, cache in
             (("data", stored), ("validation", judged))}  # fmt: skip
    return _Material(data, held_out, judged, None, about)


def _shown(recipe: "Recipe", media_group: int, law: bool) -> "Renderable":
    """Training data: the recipe with shared media, rendered or drawn by the law of its images."""
    from specklegen.models.learning.examples import sharing_media
    from specklegen.models.learning.law import ByLaw

    shown = sharing_media(recipe, media_group)
    return ByLaw(shown) if law else shown  # type: ignore[arg-type]


def _of_recipe(
    recipe: "Recipe", shown: "Renderable", settings: "Training", out: Path, asked: int, until: float | None,
    workers: int, device: str, cache: str | None,
) -> _Material:  # fmt: skip
    """Stream what is shown for training, from a device, and render validation images: as many as asked, or for a time.

    A run that goes on has as many of them as before.
    """
    from specklegen.datasets import SpeckleStream
    from specklegen.models.learning.examples import examples, streamed

    seed, target = settings.seed, settings.target
    stream = SpeckleStream(shown, seed=seed, batch_size=settings.batch_size, device=device, cache=cache)
    if device != "cpu":
        first = ". The first batch takes a minute or two: operators are compiled (--workers 2 renders on the CPU)."
        typer.echo(f"Rendering training images on {device}{first if device.startswith('cuda') else ''}")
    data = streamed(stream, settings.input, workers, target)
    before = rendered_before(out, asked)
    held_out = examples(recipe, settings.input, before or asked, seed, "validation", target, None if before else until)
    about: dict[str, Any] = {"validation": {"seed": seed, "split": "validation", "samples": asked}}
    if len(held_out.targets) < asked:
        about["validation"]["rendered"] = len(held_out.targets)
        typer.echo(f"Validation uses {len(held_out.targets)} of {asked} images, to stay within --seconds.")
    return _Material(data, held_out, recipe, recipe, about)


def rendered_before(out: Path, asked: int) -> int | None:
    """Validation images that a run in a folder has looked at so far, where as many were asked for; None: no run."""
    import json

    try:
        validation = json.loads((out / "run.json").read_bytes())["validation"]
        return int(validation.get("rendered", asked)) if validation["samples"] == asked else None
    except (OSError, ValueError, KeyError, TypeError):
        return None


def _methods(
    recipe: "Recipe | None", settings: "Training", seconds: float | None, begun: float,
) -> "dict[str, Callable]":  # fmt: skip
    """Methods that learn nothing and stand beside a network in training; where there is no time, none."""
    spent = time.perf_counter() - begun
    if seconds is not None and (seconds < 60 or spent > 1.5 * _PREPARING * seconds):
        reason = "they need --seconds 60 or more" if seconds < 60 else f"setup took {spent:.0f} of {seconds:.0f} s"
        typer.echo(f"Baselines (mean image, phase retrieval) are skipped: {reason}.")
        return {}
    seed = settings.seed
    if settings.target != "object":
        return {} if recipe is None else dict(closed(recipe, settings.target, seed))
    from specklegen.datasets.recipes.hidden_object import HiddenObject
    from specklegen.models.judging.beside import methods_beside
    from specklegen.models.learning.solver import load_solver

    if recipe is None:
        return methods_beside(None, seed, None)
    if not isinstance(recipe, HiddenObject):  # coherent objects have no autocorrelation of their own
        return {}
    return methods_beside(recipe, seed, load_solver()) if "image" in recipe.images_layout() else {}


def _fitted(
    settings: "Training", material: _Material, out: Path, seconds: float | None, device: str, begun: float,
    reserve: float, first: "Reconstructor | None",
) -> "Reconstructor":  # fmt: skip
    """Train with a bar of steps and a line an epoch; Ctrl-C and SIGTERM end the command after a checkpoint."""
    from tqdm import tqdm

    from specklegen.models.judging.charts import training_curves
    from specklegen.models.learning.run import read_log
    from specklegen.models.learning.training import train as fit

    rows: list[Mapping[str, float]] = []

    def show(row: "Mapping[str, float]") -> None:
        rows.append(row)
        training_curves({settings.network: read_log(out)}, out / "curves.png")
        tqdm.write(
            f"epoch {row['epoch']}: {row['seconds']:.0f} s, loss {row['train_loss']:.4f}, "
            f"validation {next(value for name, value in row.items() if name.startswith('validation_')):.4f}"
        )

    with tqdm(unit="step", disable=None, leave=False) as bar:

        def step(done: int, total: int) -> None:
            bar.total = total
            if not bar.n:
                bar.initial = done - 1
            bar.update(done - (bar.n or done - 1))

        try:
            model = fit(settings, material.data, material.held_out, out, seconds=seconds, device=device, progress=show,
                        steps=step, about=material.about, begun=begun, reserve=reserve, start=first)  # fmt: skip
        except (KeyboardInterrupt, Terminated) as stopped:
            typer.echo(f"stopped: run the same command again to resume from {out / 'checkpoint.pt'}", err=True)
            raise typer.Exit(exit_status(stopped)) from None
    if not rows:
        typer.echo(f"The run in {out} is already finished, so nothing was trained. Raise --epochs to continue it.")
    return model


def _draw_once(out: Path) -> None:
    """Draw empty curves, so that the plotting library is loaded before training and not after its seconds."""
    from specklegen.models.judging.charts import training_curves

    blank = {"seconds": 0.0, "train_loss": 0.0, "validation_": 0.0}
    training_curves({"": [blank]}, out / ".curves.png").unlink()


def fed(made: float, trained: float) -> str:
    """Return whether the data kept a network fed, in a sentence: images a second of either."""
    waits = trained / (made + trained)
    words = f"Data: {made:.3g} images/s rendered or read, {trained:.3g} images/s trained"
    if waits < 0.2:
        return f"{words}. The data are fast enough."
    return f"{words}. The network waits {waits:.0%} of the time: add --workers, or train from a store."


def _conclude(model: "Reconstructor", beside: "Beside", out: Path) -> None:
    """Print and write the table at the end of a run."""
    from specklegen.models.learning.networks import parameter_count
    from specklegen.models.learning.run import read_log

    if log := read_log(out):
        typer.echo(fed(log[-1]["made_per_second"], log[-1]["trained_per_second"]))
    if beside.judged:
        table = beside.table(model)
        (out / "summary.md").write_text(table)
        typer.echo(f"\nepochs: {len(read_log(out))}. {table}")
    typer.echo(f"{counted(parameter_count(model.network), 'parameter')}, {out / 'best.pt'}")
