"""The commands that learn and judge: ``specklegen train`` and ``specklegen evaluate``."""

import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from specklegen.cli.output import AsJson, echo_json, writable
from specklegen.cli.recipe_options import (
    Images,
    Objects,
    RecipeOrStore,
    Seed,
    Set,
    Split,
    is_store,
    load,
    load_hidden,
    names_starting_with,
)
from specklegen.core.devices import checked_device
from specklegen.core.errors import counted, reject

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping

    from specklegen.datasets.recipes.recipe import Recipe
    from specklegen.models.learning.reconstructor import Reconstructor

MOST_KEPT = 10**6
"""Images that are looked at together; all are kept in memory."""
Network = Annotated[
    str | None,
    typer.Option(metavar="MODULE:NAME", help="Import a network of your own, which a model names; runs its module."),
]


def losses_starting_with(incomplete: str) -> list[str]:
    """Losses that a shell may complete."""
    from specklegen.models.learning.losses import LOSSES

    return [name for name in LOSSES if name.startswith(incomplete)]


def train(
    what: RecipeOrStore,
    out: Annotated[Path, typer.Option(help="Folder of the run; a stopped run goes on.")],
    validation: Annotated[
        Path | None, typer.Option(help="Store of other media (needed with a store; a recipe has a split for it).")
    ] = None,
    validation_samples: Annotated[
        int, typer.Option(min=1, max=MOST_KEPT, help="Of a recipe's validation split.")
    ] = 256,
    target: Annotated[
        str, typer.Option(help="What the network is to tell: object, label, material, motion or contrast.")
    ] = "object",
    input: Annotated[
        str,
        typer.Option(
            help="What the network sees: camera or autocorrelation; of stacks of tilts registered or registered+power; "
            "of exposures exposures, or, of a surface, local-contrast."
        ),
    ] = "autocorrelation",
    network: Annotated[
        str,
        typer.Option(
            help="Kind of network: contrast, dense, perceptron, residual, stack-unet or unet; or one of your own, as "
            "my_module:Name, whose module is run."
        ),
    ] = "unet",
    width: Annotated[
        int, typer.Option(min=1, max=4096, help="Channels at the top; of the dense nets, units over 16.")
    ] = 16,
    loss: Annotated[
        str,
        typer.Option(
            help="pearson, bce, ssim, l1, pearson+bce; with -invariant or without.", autocompletion=losses_starting_with
        ),
    ] = "pearson-invariant",
    learning_rate: Annotated[float, typer.Option(help="Largest learning rate.")] = 3e-3,
    batch_size: Annotated[int, typer.Option(min=1, help="Samples a step.")] = 64,
    epochs: Annotated[int, typer.Option(min=1, help="Passes through the data.")] = 20,
    seconds: Annotated[
        float | None, typer.Option(help="Time to spend by the clock, everything included (by default: all epochs).")
    ] = None,
    mirror: Annotated[bool, typer.Option(help="Show half of the samples mirrored.")] = False,
    workers: Annotated[int, typer.Option(min=0, max=1024, help="Processes that render a stream.")] = 0,
    media_group: Annotated[
        int, typer.Option(min=1, help="Samples of a stream that share a medium, where each has one of its own.")
    ] = 8,
    device: Annotated[str, typer.Option(help="Torch device.")] = "cpu",
    seed: Seed = 0,
    changes: Set = None,
    images: Images = None,
    objects: Objects = None,
) -> None:
    """Train a network to see through fog, on a recipe streamed meanwhile or on a store.

    Checkpoint, log and curves lie in the folder of the run, and are renewed while it goes on. At its beginning and end
    a table says how the network does on validation images beside methods that learn nothing (summary.md). Of
    --seconds preparation, table and last validation are a part; where they take long, validation images are fewer.
    """
    begun = time.perf_counter()
    typer.echo(f"train {what}: a network is made ready and validation images are rendered; then the first table.")
    checked_device("--device", device)
    if seconds is not None and not seconds > 0:
        reject("--seconds", "greater than 0", seconds)
    writable(out)
    from tqdm import tqdm

    from specklegen.datasets import SpeckleCache, SpeckleStream
    from specklegen.models.judging.beside import Beside
    from specklegen.models.judging.charts import training_curves
    from specklegen.models.learning.examples import batches_of, examples, sharing_media, streamed
    from specklegen.models.learning.networks import parameter_count
    from specklegen.models.learning.run import read_log, untrained
    from specklegen.models.learning.run_record import require_held_out
    from specklegen.models.learning.training import Training
    from specklegen.models.learning.training import train as fit

    settings = Training(
        target=target, input=input, network=network, width=width, loss=loss, learning_rate=learning_rate,
        batch_size=batch_size, epochs=epochs, mirror=mirror, seed=seed,
    )  # fmt: skip
    if is_store(what):
        if validation is None:
            reject("train --validation", "given with a store", validation, "Generate one with --split validation.")
        for option, given in (("--set", changes), ("--images", images), ("--objects", objects)):
            if given:
                reject(f"train {option}", "left out with a store, which has its recipe", given)
        stored, judged = SpeckleCache(what), SpeckleCache(validation)
        loaded, source = None, judged
        require_held_out(stored, judged)
        data, held_out = examples(stored, input, target=target), examples(judged, input, target=target)
        about = {name: cache.identity | {"samples": len(cache)} for name, cache in
                 (("data", stored), ("validation", judged))}  # fmt: skip
    else:
        if validation is not None:
            reject("train --validation", "left out with a recipe, whose validation split is used", str(validation))
        recipe = loaded = source = (load_hidden if settings.of_objects else load)(what, changes, images, objects)
        shown = sharing_media(recipe, media_group)
        data = streamed(SpeckleStream(shown, seed=seed, batch_size=batch_size), input, workers, target)
        looked_at = rendered_before(out, validation_samples)
        until = None if seconds is None or looked_at else begun + _PREPARING * seconds
        held_out = examples(recipe, input, looked_at or validation_samples, seed, "validation", target, until)
        about = {"validation": {"seed": seed, "split": "validation", "samples": validation_samples}}
        if len(held_out.targets) < validation_samples:
            about["validation"]["rendered"] = len(held_out.targets)
            typer.echo(f"{len(held_out.targets)} validation images, of {validation_samples}: for want of seconds")
    few = min(_TABLED, len(held_out.targets))
    beside = Beside(
        batches_of(source, few, seed, "validation", _TABLED // 8),
        _methods(loaded, target, seed, seconds), untrained(settings, held_out, device),
        None if seconds is None else begun + 2 * _PREPARING * seconds,
        getattr(loaded, "profile", "square") if settings.of_objects else "square",
    )  # fmt: skip
    reserve = -time.perf_counter()
    if beside.judged:
        typer.echo(f"\nbefore training: {beside.table()}")
    reserve += time.perf_counter()
    rows: list[dict[str, float]] = []

    def show(row: dict[str, float]) -> None:
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
            model = fit(
                settings, data, held_out, out, seconds=seconds, device=device, progress=show, steps=step, about=about,
                begun=begun, reserve=2 * reserve,
            )  # fmt: skip
        except KeyboardInterrupt:
            typer.echo(f"stopped; the same command goes on from {out / 'checkpoint.pt'}", err=True)
            raise typer.Exit(130) from None
    if not rows:
        typer.echo(f"The run in {out} was finished already: nothing was done. Ask for more --epochs to go on.")
    if beside.judged:
        table = beside.table(model)
        (out / "summary.md").write_text(table)
        typer.echo(f"\nepochs: {len(read_log(out))}. {table}")
    typer.echo(f"{counted(parameter_count(model.network), 'parameter')}, {out / 'best.pt'}")


_PREPARING = 0.2  # share of the seconds after which no more validation images are begun, and as much for the table
_TABLED = 32  # validation images in the table


def rendered_before(out: Path, asked: int) -> int | None:
    """Validation images that a run in a folder has looked at so far, where as many were asked for; None: no run."""
    import json

    try:
        told = json.loads((out / "run.json").read_bytes())["validation"]
        return int(told.get("rendered", asked)) if told["samples"] == asked else None
    except (OSError, ValueError, KeyError, TypeError):
        return None


def _methods(recipe: "Recipe | None", target: str, seed: int, seconds: float | None) -> "dict[str, Callable]":
    """Methods that learn nothing and stand beside a network in training; where there is no time, none."""
    if seconds is not None and seconds < 60:
        typer.echo("methods that learn nothing are left out: they take some seconds (--seconds 60 has them)")
        return {}
    if target != "object":
        return {} if recipe is None else dict(_closed(recipe, target, seed))
    from specklegen.datasets.recipes.hidden_object import HiddenObject
    from specklegen.models.judging.beside import methods_beside
    from specklegen.models.learning.solver import load_solver

    if recipe is None:
        return methods_beside(None, seed, None)
    assert isinstance(recipe, HiddenObject)
    return methods_beside(recipe, seed, load_solver()) if "image" in recipe.images_layout() else {}


def evaluate(
    models: Annotated[list[Path] | None, typer.Argument(help="Models (best.pt); by default the packaged one.")] = None,
    recipe: Annotated[
        str | None,
        typer.Option(
            help="What to test on (default: one-angular-size; characters-of-new-fonts for labels, registered-tilts for "
            "materials, lsci-slab for motion, flow-vessel for contrast).", autocompletion=names_starting_with,
        ),
    ] = None,
    split: Split = "test",
    samples: Annotated[int, typer.Option(min=1, max=MOST_KEPT, help="Images.")] = 32,
    katz: Annotated[bool, typer.Option(help="Phase retrieval beside, plain and with C_I.")] = True,
    restarts: Annotated[int, typer.Option(min=1, max=1000, help="Of phase retrieval.")] = 10,
    solver: Annotated[bool, typer.Option(help="The solver for any object beside.")] = False,
    out: Annotated[Path, typer.Option(help="Folder for tables and contact sheet.")] = Path("evaluation"),
    network: Network = None,
    seed: Seed = 0,
    changes: Set = None,
    images: Images = None,
    objects: Objects = None,
    as_json: AsJson = False,
) -> None:
    """Judge networks beside chance and phase retrieval, on media and characters that none has seen.

    Images of characters that a network was trained on are passed over, except with --split train. Networks that tell
    labels, materials, motion or contrast are judged one at a time, by a table of confusions or of R^2; of motion beside
    the multi-exposure model in closed form, of contrast beside that and a sliding window.
    """
    import torch

    from specklegen.datasets.objects import Points
    from specklegen.datasets.recipes.hidden_object import HiddenObject
    from specklegen.models.judging import baselines, evaluation
    from specklegen.models.judging.charts import contact_sheet
    from specklegen.models.judging.points import localisation
    from specklegen.models.judging.unseen import seen_by, unseen
    from specklegen.models.learning.examples import batches_of
    from specklegen.models.learning.networks import NETWORKS
    from specklegen.models.learning.reconstructor import Reconstructor, load_pretrained
    from specklegen.models.learning.solver import ANY_OBJECT, EXTENT, load_solver
    from specklegen.models.learning.targets import TARGETS
    from specklegen.models.retrieval.phase_retrieval import Retrieval

    if network is not None:
        NETWORKS.find("--network", network)
    named = {_name(path, models): Reconstructor.load(path) for path in models or []}
    named = named or {"packaged network": load_pretrained()}
    asked = {model.target for model in named.values()}
    if len(asked) > 1:
        reject("evaluate models", "networks that tell the same", sorted(asked))
    (target,) = asked
    recipe = recipe or _BENCHMARKS[target]
    loaded = (load_hidden if TARGETS[target].hidden else load)(recipe, changes, images, objects)
    if loaded.media_of(samples) < 2:
        reject("evaluate --samples", "enough for two media", samples, "One medium tells nothing about the others.")
    if target != "object":
        _judge_answers(named, batches_of(loaded, samples, seed, split), out, as_json, _closed(loaded, target, seed))
        return
    assert isinstance(loaded, HiddenObject)
    if "image" not in loaded.images_layout():
        reject("evaluate --recipe", "one with one image of each object", recipe,
               "through-slab and unknown-slab are; `specklegen recipes` lists all.")  # fmt: skip
    writable(out)
    tables = [model.trained_on for model in named.values()]
    if solver:
        if max(loaded.objects.shape) > EXTENT:
            reject("evaluate --solver", f"for objects of at most {EXTENT} pixels a side", loaded.objects.shape)
        tables.append(load_hidden(ANY_OBJECT, None).objects.model_dump(mode="json"))
    seen = seen_by(tables) if split != "train" else set()
    chosen = unseen(loaded.objects, seed, split, samples, seen)
    known = torch.stack([torch.from_numpy(loaded.objects.image(seed, "train", n)) for n in range(256)])
    methods: dict[str, baselines.Method] = {
        "another object": baselines.another_object(known), "mean image": baselines.mean_image(known),
    }  # fmt: skip
    if katz:
        settings = Retrieval(restarts=restarts)
        methods |= {"Katz": baselines.katz(settings, recipe=loaded, division="none", seed=seed)}
        methods |= {"Katz, C_I": baselines.katz(settings, recipe=loaded, seed=seed)}
    if solver:
        methods |= {"solver for any object": baselines.any_object(load_solver(), loaded, seed)}
    methods |= {name: model.reconstruct for name, model in named.items()}
    found, cases = evaluation.evaluate(methods, batches_of(loaded, chosen, seed, split), loaded.profile)
    found.write(out)
    shown = evaluation.best_median_worst(cases, next(iter(named)))
    contact_sheet(shown, out / "cases.png")
    if as_json:
        echo_json(found.rows())
        return
    typer.echo(found.markdown())
    if isinstance(loaded.objects, Points):
        (out / "points.md").write_text(localisation(found, cases))
        typer.echo((out / "points.md").read_text())
    typer.echo(f"{out / 'summary.md'}, {out / 'summary.csv'}, {out / 'images.csv'}, {out / 'cases.png'}")


_BENCHMARKS = {
    "object": "one-angular-size", "label": "characters-of-new-fonts", "material": "registered-tilts",
    "motion": "lsci-slab", "contrast": "flow-vessel",
}  # fmt: skip


def _closed(recipe: "Recipe", target: str, seed: int) -> "Mapping[str, Callable]":
    """Methods without learning that stand beside a network of a target."""
    from specklegen.datasets.recipes.contrast_map import ContrastMap
    from specklegen.datasets.recipes.exposure_stack import ExposureStack
    from specklegen.models.judging.closed_contrast import closed_contrast
    from specklegen.models.judging.closed_inversion import closed_inversion

    if target == "motion" and isinstance(recipe, ExposureStack):
        return {"closed inversion": closed_inversion(recipe, seed)}
    return closed_contrast(recipe, seed) if target == "contrast" and isinstance(recipe, ContrastMap) else {}


def _judge_answers(
    named: "dict[str, Reconstructor]", batches: "Iterator[dict]", out: Path, as_json: bool,
    beside: "Mapping[str, Callable]",
) -> None:  # fmt: skip
    """Print and write the table of a network that tells labels, numbers or maps, and of methods beside it."""
    from specklegen.models.judging.answers import judge
    from specklegen.models.judging.contrast_maps import judge_maps

    if len(named) > 1:
        reject("evaluate models", "one at a time where they tell no object", sorted(named))
    writable(out)
    model = next(iter(named.values()))
    found = (judge_maps if model.target == "contrast" else judge)(model, batches, beside)
    found.write(out)
    if as_json:
        echo_json(found.rows())
        return
    typer.echo(found.markdown())
    typer.echo(f"{out / 'summary.md'}")


def _name(path: Path, models: list[Path] | None) -> str:
    """What a model is called in tables: its run's folder, or its whole path where two folders have one name."""
    folders = [other.absolute().parent.name for other in models or []]
    name = path.absolute().parent.name
    return name if name and folders.count(name) == 1 else str(path)
