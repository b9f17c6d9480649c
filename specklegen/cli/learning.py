"""The commands that learn and judge: ``specklegen train`` and ``specklegen evaluate``."""

from pathlib import Path
from typing import Annotated

import typer

from specklegen.cli.recipe_options import Seed, Set, load_hidden
from specklegen.core.errors import reject


def train(
    what: Annotated[str, typer.Argument(help="A recipe, streamed while the network trains, or the folder of a store.")],
    out: Annotated[Path, typer.Option(help="Folder of the run; a stopped run goes on.")],
    validation: Annotated[
        Path | None, typer.Option(help="Store of other media (needed with a store; a recipe has a split for it).")
    ] = None,
    validation_samples: Annotated[int, typer.Option(help="Of a recipe's validation split.")] = 256,
    input: Annotated[str, typer.Option(help="autocorrelation or camera.")] = "autocorrelation",
    network: Annotated[str, typer.Option(help="residual, unet, stack-unet or dense.")] = "unet",
    width: Annotated[int, typer.Option(help="Channels at the top; of the dense nets, units over 16.")] = 16,
    loss: Annotated[str, typer.Option(help="pearson, bce, ssim, l1, pearson+bce; with -invariant or without.")] = (
        "pearson-invariant"
    ),
    learning_rate: Annotated[float, typer.Option(help="Largest learning rate.")] = 3e-3,
    batch_size: Annotated[int, typer.Option(help="Samples a step.")] = 64,
    epochs: Annotated[int, typer.Option(help="Passes through the data.")] = 20,
    seconds: Annotated[float | None, typer.Option(help="Processor time to spend (by default: all epochs).")] = None,
    mirror: Annotated[bool, typer.Option(help="Show half of the samples mirrored.")] = False,
    workers: Annotated[int, typer.Option(help="Processes that render a stream.")] = 0,
    device: Annotated[str, typer.Option(help="Torch device.")] = "cpu",
    seed: Seed = 0,
    changes: Set = None,
) -> None:
    """Train a network to see through fog; checkpoint, log and curves lie in its folder."""
    from tqdm import tqdm

    from specklegen.datasets import SpeckleCache, SpeckleStream
    from specklegen.datasets.store.metadata import is_store
    from specklegen.models.judging.charts import training_curves
    from specklegen.models.learning.examples import examples, streamed
    from specklegen.models.learning.networks import parameter_count
    from specklegen.models.learning.run_record import require_held_out
    from specklegen.models.learning.training import Training
    from specklegen.models.learning.training import train as fit

    settings = Training(
        input=input, network=network, width=width, loss=loss, learning_rate=learning_rate,  # type: ignore[arg-type]
        batch_size=batch_size, epochs=epochs, mirror=mirror, seed=seed,
    )  # fmt: skip
    if is_store(Path(what)):
        if validation is None:
            reject("train --validation", "given with a store", validation, "Generate one with --split validation.")
        if changes:
            reject("train --set", "left out with a store, which has its recipe", " ".join(changes))
        stored, judged = SpeckleCache(what), SpeckleCache(validation)
        require_held_out(stored, judged)
        data, held_out = examples(stored, input), examples(judged, input)
        about = {name: cache.identity | {"samples": len(cache)} for name, cache in
                 (("data", stored), ("validation", judged))}  # fmt: skip
    else:
        if validation is not None:
            reject("train --validation", "left out with a recipe, whose validation split is used", str(validation))
        recipe = load_hidden(what, changes)
        data = streamed(SpeckleStream(recipe, seed=seed, batch_size=batch_size), input, workers)
        held_out = examples(recipe, input, validation_samples, seed, "validation")
        about = {"validation": {"seed": seed, "split": "validation", "samples": validation_samples}}
    rows: list[dict[str, float]] = []

    def show(row: dict[str, float]) -> None:
        rows.append(row)
        tqdm.write(
            f"epoch {row['epoch']}: {row['seconds']:.0f} s, loss {row['train_loss']:.4f}, "
            f"validation {row['validation_pearson']:.4f}"
        )

    with tqdm(unit="step", disable=None, leave=False) as bar:

        def step(done: int, total: int) -> None:
            bar.total = total
            if not bar.n:
                bar.initial = done - 1
            bar.update(done - (bar.n or done - 1))

        try:
            model = fit(
                settings, data, held_out, out, seconds=seconds, device=device, progress=show, steps=step, about=about
            )
        except KeyboardInterrupt:
            typer.echo(f"stopped; the same command goes on from {out / 'checkpoint.pt'}", err=True)
            raise typer.Exit(130) from None
    if not rows:
        typer.echo(f"The run in {out} was finished already: nothing was done. Ask for more --epochs to go on.")
    if rows:
        training_curves({network: rows}, out / "curves.png")
    typer.echo(f"{parameter_count(model.network)} parameters, {out / 'best.pt'}")


def evaluate(
    models: Annotated[list[Path] | None, typer.Argument(help="Models (best.pt); by default the packaged one.")] = None,
    recipe: Annotated[str, typer.Option(help="What to test on: a recipe.")] = "unknown-slab",
    split: Annotated[str, typer.Option(help="Of the recipe.")] = "test",
    samples: Annotated[int, typer.Option(help="Images.")] = 32,
    katz: Annotated[bool, typer.Option(help="Phase retrieval beside, plain and with C_I.")] = True,
    restarts: Annotated[int, typer.Option(help="Of phase retrieval.")] = 10,
    out: Annotated[Path, typer.Option(help="Folder for tables and contact sheet.")] = Path("evaluation"),
    seed: Seed = 0,
    changes: Set = None,
) -> None:
    """Judge networks beside the mean image and phase retrieval, on media that none has seen."""
    import torch

    from specklegen.models.judging import baselines, evaluation
    from specklegen.models.judging.charts import contact_sheet
    from specklegen.models.learning.examples import batches_of
    from specklegen.models.learning.reconstructor import Reconstructor, load_pretrained
    from specklegen.models.retrieval.phase_retrieval import Retrieval

    loaded = load_hidden(recipe, changes)
    if "image" not in loaded.images_layout():
        reject("evaluate --recipe", "one with one image of each object", recipe)
    if loaded.media_of(samples) < 2:
        reject("evaluate --samples", "enough for two media", samples, "One medium tells nothing about the others.")
    named = {path.parent.name or str(path): Reconstructor.load(path) for path in models or []}
    named = named or {"packaged network": load_pretrained()}
    objects = [torch.from_numpy(loaded.objects.image(seed, "train", n)) for n in range(256)]
    methods: dict[str, baselines.Method] = {"mean image": baselines.mean_image(torch.stack(objects))}
    if katz:
        settings = Retrieval(restarts=restarts)
        methods |= {"Katz": baselines.katz(settings, seed=seed)}
        methods |= {"Katz, C_I": baselines.katz(settings, recipe=loaded, seed=seed)}
    methods |= {name: model.reconstruct for name, model in named.items()}
    found, cases = evaluation.evaluate(methods, batches_of(loaded, samples, seed, split), loaded.profile)
    found.write(out)
    shown = evaluation.best_median_worst(cases, next(iter(named)))
    contact_sheet(shown, out / "cases.png")
    typer.echo(found.markdown())
    typer.echo(f"{out / 'summary.md'}, {out / 'summary.csv'}, {out / 'images.csv'}, {out / 'cases.png'}")
