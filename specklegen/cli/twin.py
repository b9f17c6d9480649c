"""The command ``specklegen twin``: photographs beside simulated ones, and what differs."""

from pathlib import Path
from typing import Annotated

import typer

from specklegen.cli.fit_setup import black_level
from specklegen.cli.output import AsJson, echo_json, picture_file


def twin(
    photographs: Annotated[list[str], typer.Argument(help="Files, folders or patterns of frames.")],
    setup: Annotated[
        str | None, typer.Option(help="Recipe to compare with; else speckle of one point is fitted.")
    ] = None,
    images: Annotated[int, typer.Option(help="How many images, or stacks, to simulate.")] = 64,
    dark: Annotated[str | None, typer.Option(help="Frames without light, or the black level in counts.")] = None,
    envelope: Annotated[str | None, typer.Option(help='"fit", or an image of the light\'s envelope.')] = None,
    points: Annotated[bool, typer.Option("--points", help="Pixels are points, as those of most simulations.")] = False,
    seed: Annotated[int, typer.Option(help="Of the simulated images.")] = 0,
    out: Annotated[Path | None, typer.Option(help="TOML to write: the recipe, with intervals.")] = None,
    picture: Annotated[Path | None, typer.Option(help="PNG to write: your image beside ten simulated ones.")] = None,
    as_json: AsJson = False,
) -> None:
    """Name how photographs differ from simulated ones, and what could cause it."""
    from specklegen.models.calibration.twin import twin as compare

    if picture is not None:
        picture_file("twin --picture", picture)
    comparison = compare(photographs, setup, images=images, envelope=envelope, dark=black_level(dark),
                         pixel_integration=not points, seed=seed)  # fmt: skip
    if out is not None:
        out.write_text(comparison.recipe, encoding="utf-8")
    if picture is not None:
        figure = comparison.plot().get_figure()
        assert figure is not None
        figure.savefig(picture, dpi=120)
    if as_json:
        names = ("verdict", "p_value", "images", "simulated", "recipe", "assumed", "doubts")
        groups = [each._asdict() for each in comparison.compared]
        echo_json({name: getattr(comparison, name) for name in names} | {"compared": groups})
        return
    for key, value in comparison._facts().items():
        typer.echo(f"{key}: {value}")
    for written in (out, picture):
        if written is not None:
            typer.echo(str(written))
