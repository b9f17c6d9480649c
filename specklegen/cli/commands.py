"""The command line: every command under one name, and the process that runs one.

Thin: a command reads its arguments, calls one function of the library, and shows what came out.
"""

import gc
from collections.abc import Callable
from inspect import getdoc
from typing import Annotated, Any

import typer
from typer.core import TyperGroup

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


class _RecipesFirst(TyperGroup):
    """The commands in their order, `recipes` before them, groups behind."""

    def list_commands(self, ctx: Any) -> list[str]:
        """Return the names of commands in the order of the help."""
        return sorted(super().list_commands(ctx), key=lambda name: name != "recipes")


app = typer.Typer(
    cls=_RecipesFirst,
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


COMMANDS: dict[str, Callable[..., None]] = {
    "plan": recipes.plan,
    "preview": stores.preview,
    "generate": stores.generate,
    "train": training.train,
    "evaluate": judging.evaluate,
    "reconstruct": reconstruct.reconstruct,
    "retrieve": retrieve.retrieve,
    "memory-effect": scenes.memory_effect_command,
    "explore": explore.explore,
    "store info": stores.info,
    "store verify": stores.verify,
    "store export": stores.export,
    "fit camera": fit_camera.fit_camera,
    "fit material": fit_material.fit_material,
    "fit setup": fit_setup.fit_setup,
    "fit twin": twin.twin,
    "check recoverable": recoverable.recoverable,
    "check compare": compare.compare_command,
    "check benchmark": benchmark.benchmark,
    "physics render": scenes.render,
    "physics reflectance": scenes.reflectance,
}
"""Every command by its name, that of its group first."""
GROUPS = {
    "store": "Describe, check and export stores.",
    "fit": "Fit a camera, a material or a setup to measurements.",
    "check": "Check whether an object can be reconstructed, compare samplers, score methods.",
    "physics": "Render one stack of speckle; light that a slab reflects, transmits and absorbs.",
}
MOVED = {
    "info": "store info", "verify": "store verify", "export": "store export", "fit-camera": "fit camera",
    "fit-material": "fit material", "fit-setup": "fit setup", "twin": "fit twin", "recoverable": "check recoverable",
    "compare": "check compare", "benchmark": "check benchmark", "measured": "check measured",
    "render": "physics render", "reflectance": "physics reflectance",
}  # fmt: skip
"""New names of commands by their old ones, which work for one version."""
_CLASSES = {"fit camera": fit_camera.ManyFiles}


def _hinting(kind: type[Any], old: str) -> type[Any]:
    """Return the class of a command, or of a group, that prints its new name before it reads its options."""

    def make_context(self: Any, name: Any, words: list[str], parent: Any = None, **settings: Any) -> Any:
        if not settings.get("resilient_parsing"):  # completion in a shell
            typer.echo(f"hint: `specklegen {old}` is now `specklegen {MOVED[old]}`", err=True)
        return kind.make_context(self, name, words, parent, **settings)

    return type(kind.__name__, (kind,), {"make_context": make_context})


app.add_typer(recipes.recipes, name="recipes", epilog=epilog("recipes"))
groups = {name: typer.Typer(help=text, rich_markup_mode=None, no_args_is_help=True) for name, text in GROUPS.items()}
for _name, _command in COMMANDS.items():
    _class = _CLASSES.get(_name, Generated).of(_command)
    _group, _, _short = _name.rpartition(" ")
    groups.get(_group, app).command(_short, cls=_class, help=getdoc(_command), epilog=epilog(_name))(unmade)
for _name, _typer in groups.items():
    app.add_typer(_typer, name=_name)
groups["check"].add_typer(measured.measured, name="measured", epilog=epilog("check measured"))
for _old, _name in MOVED.items():
    if _name == "check measured":
        app.add_typer(measured.measured, name=_old, hidden=True, cls=_hinting(TyperGroup, _old))
    else:
        _class = _hinting(_CLASSES.get(_name, Generated).of(COMMANDS[_name]), _old)
        app.command(_old, cls=_class, help=getdoc(COMMANDS[_name]), epilog=epilog(_name), hidden=True)(unmade)


def main(words: list[str] | None = None) -> None:
    """Run the command line; what stops a command is a message, not a traceback."""
    try:
        with failures_told():
            app(args=words)
    finally:
        if words is None:  # the process ends: its last collections would visit all objects, for a CPU second with torch
            gc.freeze()
