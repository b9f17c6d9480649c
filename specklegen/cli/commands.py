"""The command line: every command under one name, and the process that runs one.

Thin: a command reads its arguments, calls one function of the library, and shows what came out.
"""

from collections.abc import Callable
from inspect import getdoc
from typing import Annotated

import typer

from specklegen import __version__
from specklegen.cli import (
    benchmark,
    compare,
    explore,
    fit_camera,
    fit_material,
    fit_setup,
    judging,
    measured,
    recipes,
    reconstruct,
    recoverable,
    retrieve,
    scenes,
    stores,
    training,
    twin,
)
from specklegen.cli.examples import epilog
from specklegen.cli.failures import failures_told
from specklegen.cli.settings import Generated, unmade
from specklegen.core.registry import trusting_all

app = typer.Typer(
    help="Correlated speckle image stacks, and data sets for seeing through scattering media.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
    context_settings={"help_option_names": ["-h", "--help"]},
    epilog="\b\nExit status: 0 done; 1 something is missing or damaged; 2 refused, with the reason; 130, 143 stopped.",
)


def _show_version(asked: bool) -> None:
    if asked:
        typer.echo(f"specklegen {__version__}")
        raise typer.Exit


@app.callback()
def specklegen(
    context: typer.Context,
    version: Annotated[
        bool, typer.Option("--version", callback=_show_version, is_eager=True, help="Print the version and exit.")
    ] = False,
    trust: Annotated[
        bool, typer.Option("--trust", help="Import the modules that files outside this folder name, which runs them.")
    ] = False,
) -> None:
    """Correlated speckle image stacks, and data sets for seeing through scattering media."""
    if trust:
        context.with_resource(trusting_all())


app.add_typer(recipes.recipes, name="recipes", epilog=epilog("recipes"))
app.add_typer(measured.measured, name="measured", epilog=epilog("measured"))
COMMANDS: dict[str, Callable[..., None]] = {
    "plan": recipes.plan,
    "render": scenes.render,
    "memory-effect": scenes.memory_effect_command,
    "reflectance": scenes.reflectance,
    "generate": stores.generate,
    "preview": stores.preview,
    "info": stores.info,
    "verify": stores.verify,
    "export": stores.export,
    "train": training.train,
    "evaluate": judging.evaluate,
    "recoverable": recoverable.recoverable,
    "reconstruct": reconstruct.reconstruct,
    "retrieve": retrieve.retrieve,
    "fit-camera": fit_camera.fit_camera,
    "fit-material": fit_material.fit_material,
    "fit-setup": fit_setup.fit_setup,
    "twin": twin.twin,
    "compare": compare.compare_command,
    "benchmark": benchmark.benchmark,
    "explore": explore.explore,
}
"""Every command by its name."""
_CLASSES = {"fit-camera": fit_camera.ManyFiles}
for _name, _command in COMMANDS.items():
    _class = _CLASSES.get(_name, Generated).of(_command)
    app.command(_name, cls=_class, help=getdoc(_command), epilog=epilog(_name))(unmade)


def main(words: list[str] | None = None) -> None:
    """Run the command line; what stops a command is a message, not a traceback."""
    with failures_told():
        app(args=words)
