"""The command ``specklegen recoverable``: whether phase retrieval works on a scene, and why not."""

import json
from math import isfinite
from typing import Annotated

import typer

from specklegen.cli.recipe_options import Images, Seed, Set, load_hidden


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
    seed: Seed = 0,
    changes: Set = None,
    images: Images = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON.")] = False,
) -> None:
    """Predict whether phase retrieval recovers a recipe's objects, with the reasons and remedies if it fails."""
    from specklegen.models.recoverability.verdict import recoverable as predict

    loaded = load_hidden(recipe, changes, images)
    verdict = predict(
        loaded, compensation=compensation, beam=float("inf") if beam is None else beam, removal=removal, media=media,
        seed=seed,
    )  # fmt: skip
    if as_json:
        numbers = {name: value if isfinite(value) else None for name, value in verdict.numbers.items()}
        said = {
            "works": verdict.works, "probability": verdict.probability, "numbers": numbers,
            "extrapolates": verdict.extrapolates, "reasons": [reason._asdict() for reason in verdict.reasons],
        }  # fmt: skip
        typer.echo(json.dumps(said, indent=2))
    else:
        typer.echo(verdict.explain())
