"""The command that judges networks: ``specklegen evaluate``."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from specklegen.cli.output import AsJson, echo_json, writable
from specklegen.cli.recipe_options import Images, Objects, Seed, Set, Split, load, load_hidden, names_starting_with
from specklegen.cli.settings import argument, option
from specklegen.core.errors import reject

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping

    from specklegen.datasets.recipes.recipe import Recipe
    from specklegen.models.learning.reconstructor import Reconstructor

MOST_KEPT = 10**6
"""Images that are looked at together; all are kept in memory."""
Network = Annotated[
    str | None,
    typer.Option(metavar="MODULE:NAME",
                 help="Import your own network class, which a model uses. This runs its module."),
]


def evaluate(
    models: list[Path] | None = argument(None, "Models (best.pt); by default the packaged one."),
    recipe: str | None = option(
        None, "Test data (default: one-angular-size; characters-of-new-fonts for labels, registered-tilts for "
        "materials, lsci-slab for motion, flow-vessel for contrast).", autocompletion=names_starting_with,
    ),
    split: Split = "test",
    samples: int = option(32, "Number of images.", min=1, max=MOST_KEPT),
    katz: bool = option(True, "Score phase retrieval too, without and with C_I."),
    restarts: int = option(10, "Restarts of phase retrieval.", min=1, max=1000),
    solver: bool = option(False, "Score the solver for any object too."),
    out: Path = option(Path("evaluation"), "Folder for tables and contact sheet."),
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
        reject("evaluate models", "networks of one target", sorted(asked))
    (target,) = asked
    recipe = recipe or _BENCHMARKS[target]
    loaded = (load_hidden if TARGETS[target].hidden else load)(recipe, changes, images, objects)
    if loaded.media_of(samples) < 2:
        reject("evaluate --samples", "enough images for two media", samples,
               "Intervals are computed over media: raise --samples.")
    if target != "object":
        _judge_answers(named, batches_of(loaded, samples, seed, split), out, as_json, closed(loaded, target, seed))
        return
    assert isinstance(loaded, HiddenObject)
    if "image" not in loaded.images_layout():
        reject("evaluate --recipe", "a recipe with one image of each object", recipe,
               "Use through-slab or unknown-slab; `specklegen recipes --all` lists all.")  # fmt: skip
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
    scores, cases = evaluation.evaluate(methods, batches_of(loaded, chosen, seed, split), loaded.profile)
    scores.write(out)
    shown = evaluation.best_median_worst(cases, next(iter(named)))
    contact_sheet(shown, out / "cases.png")
    if as_json:
        echo_json(scores.rows())
        return
    typer.echo(scores.markdown())
    if isinstance(loaded.objects, Points):
        (out / "points.md").write_text(localisation(scores, cases))
        typer.echo((out / "points.md").read_text())
    typer.echo(f"{out / 'summary.md'}, {out / 'summary.csv'}, {out / 'images.csv'}, {out / 'cases.png'}")


_BENCHMARKS = {
    "object": "one-angular-size", "label": "characters-of-new-fonts", "material": "registered-tilts",
    "motion": "lsci-slab", "contrast": "flow-vessel", "range": "characters-of-new-fonts",
}  # fmt: skip


def closed(recipe: "Recipe", target: str, seed: int) -> "Mapping[str, Callable]":
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
        reject("evaluate models", "a single model, since the target is no image of an object", sorted(named))
    writable(out)
    model = next(iter(named.values()))
    scores = (judge_maps if model.target == "contrast" else judge)(model, batches, beside)
    scores.write(out)
    if as_json:
        echo_json(scores.rows())
        return
    typer.echo(scores.markdown())
    typer.echo(f"{out / 'summary.md'}")


def _name(path: Path, models: list[Path] | None) -> str:
    """Name of a model in tables: its run's folder, or its whole path where two folders have one name."""
    folders = [other.absolute().parent.name for other in models or []]
    name = path.absolute().parent.name
    return name if name and folders.count(name) == 1 else str(path)
