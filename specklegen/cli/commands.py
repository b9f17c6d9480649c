"""The command line: every command under one name, and the process that runs one.

Thin: a command reads its arguments, calls one function of the library, and shows what came out.
"""

from typing import Annotated

import typer

from specklegen import __version__
from specklegen.cli import (
    benchmark,
    compare,
    explore,
    fit_camera,
    fit_material,
    learning,
    recipes,
    reconstruct,
    recoverable,
    scenes,
    stores,
)
from specklegen.cli.failures import failures_told

app = typer.Typer(
    help="Correlated speckle image stacks, and data sets for seeing through scattering media.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
    context_settings={"help_option_names": ["-h", "--help"]},
)


def _show_version(asked: bool) -> None:
    if asked:
        typer.echo(f"specklegen {__version__}")
        raise typer.Exit


@app.callback()
def specklegen(
    version: Annotated[
        bool, typer.Option("--version", callback=_show_version, is_eager=True, help="Print the version and exit.")
    ] = False,
) -> None:
    """Correlated speckle image stacks, and data sets for seeing through scattering media."""


app.add_typer(recipes.recipes, name="recipes")
app.command()(recipes.plan)
app.command()(scenes.render)
app.command("memory-effect")(scenes.memory_effect_command)
app.command()(scenes.reflectance)
app.command()(stores.generate)
app.command()(stores.preview)
app.command()(stores.info)
app.command()(stores.verify)
app.command()(stores.export)
app.command()(learning.train)
app.command()(learning.evaluate)
app.command()(recoverable.recoverable)
app.command()(reconstruct.reconstruct)
app.command("fit-camera", cls=fit_camera.ManyFiles)(fit_camera.fit_camera)
app.command("fit-material")(fit_material.fit_material)
app.command("compare")(compare.compare_command)
app.command()(benchmark.benchmark)
app.command()(explore.explore)


def main(words: list[str] | None = None) -> None:
    """Run the command line; what stops a command is a message, not a traceback."""
    with failures_told():
        app(args=words)
