"""The command ``specklegen recoverable``: whether phase retrieval works on a scene, and why not."""

import json
from math import isfinite
from pathlib import Path
from typing import Annotated

import typer

from specklegen.values import reject

Set = Annotated[list[str] | None, typer.Option("--set", metavar="KEY=VALUE", help="Change a field of the recipe.")]


def recoverable(
    recipe: Annotated[str, typer.Argument(help="A packaged recipe with hidden objects, or a TOML file.")],
    compensation: Annotated[bool, typer.Option(help="Divide the autocorrelation by the material's C_I.")] = True,
    beam: Annotated[
        float | None, typer.Option(help="Sigma of a Gaussian envelope on the camera, in camera sides (default: even).")
    ] = None,
    removal: Annotated[
        float, typer.Option(help="Sigma of the mean that the envelope is divided out with; 0 leaves it in.")
    ] = 0.0,
    media: Annotated[int, typer.Option(help="Media to draw where the recipe varies.")] = 4,
    seed: Annotated[int, typer.Option(help="Whole number that the result is a function of.")] = 0,
    changes: Set = None,
    images: Annotated[
        Path | None, typer.Option(help="Folder of your own images to hide (PNG, JPEG, TIFF, NPY).")
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON.")] = False,
) -> None:
    """Predict whether phase retrieval recovers a recipe's objects, with the reasons and remedies if it fails."""
    from specklegen.datasets import load_recipe
    from specklegen.datasets.changes import changes_of
    from specklegen.datasets.hidden_object import HiddenObject
    from specklegen.models.recoverability import recoverable as predict

    table = changes_of(changes or [])
    if images is not None:
        table.setdefault("objects", {}).update({"type": "Folder", "path": str(images)})
    loaded = load_recipe(recipe, table)
    if not isinstance(loaded, HiddenObject):
        reject("recoverable recipe", "one with hidden objects", recipe, "`specklegen recipes` lists what there is.")
    verdict = predict(
        loaded, compensation=compensation, beam=float("inf") if beam is None else beam, removal=removal, media=media,
        seed=seed,
    )  # fmt: skip
    if as_json:
        numbers = {name: value if isfinite(value) else None for name, value in verdict.numbers.items()}
        said = {"works": verdict.works, "probability": verdict.probability, "numbers": numbers}
        typer.echo(json.dumps(said | {"reasons": [reason._asdict() for reason in verdict.reasons]}, indent=2))
    else:
        typer.echo(verdict.explain())
