"""The command ``specklegen recoverable``: whether phase retrieval works on a scene, and why not."""

from typing import Annotated

import typer

from specklegen.cli.output import AsJson, echo_json
from specklegen.cli.recipe_options import Images, RecipeName, Seed, Set, load_hidden
from specklegen.core.errors import reject


def recoverable(
    recipe: RecipeName,
    compensation: Annotated[bool, typer.Option(help="Divide the autocorrelation by the material's C_I.")] = True,
    beam: Annotated[
        float | None, typer.Option(help="Sigma of a Gaussian envelope on the camera, in camera sides (default: even).")
    ] = None,
    removal: Annotated[
        float, typer.Option(help="Sigma of the mean that the envelope is divided out with; 0 leaves it in.")
    ] = 0.0,
    media: Annotated[int, typer.Option(min=1, max=10_000, help="Media to draw where the recipe varies.")] = 4,
    seed: Seed = 0,
    changes: Set = None,
    images: Images = None,
    as_json: AsJson = False,
) -> None:
    """Predict whether phase retrieval recovers a recipe's objects, with the reasons and remedies if it fails."""
    from specklegen.models.recoverability.verdict import recoverable as predict

    if beam is not None and not beam > 0:
        reject("--beam", "greater than 0", beam)
    if not 0 <= removal < float("inf"):
        reject("--removal", "at least 0 and finite", removal)
    loaded = load_hidden(recipe, changes, images)
    verdict = predict(
        loaded, compensation=compensation, beam=float("inf") if beam is None else beam, removal=removal, media=media,
        seed=seed,
    )  # fmt: skip
    if as_json:
        echo_json({
            "works": verdict.works, "probability": verdict.probability, "interval": verdict.interval,
            "numbers": verdict.numbers,
            "extrapolates": verdict.extrapolates, "reasons": [reason._asdict() for reason in verdict.reasons],
        })  # fmt: skip
    else:
        typer.echo(verdict.explain())
