"""Options that every command with a recipe shares: the options that change it, and its reading."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from specklegen.core.errors import reject
from specklegen.core.registry import import_paths

if TYPE_CHECKING:
    from specklegen.datasets import Recipe
    from specklegen.datasets.recipes.coherent_object import CoherentObjects
    from specklegen.datasets.recipes.hidden_object import HiddenObject


def names_starting_with(incomplete: str) -> list[str]:
    """Packaged recipes that a shell may complete."""
    from specklegen.datasets import recipe_names

    return [name for name in recipe_names() if name.startswith(incomplete)]


RecipeName = Annotated[
    str,
    typer.Argument(
        metavar="RECIPE",
        help="A packaged recipe (see `specklegen recipes`) or a TOML file.",
        autocompletion=names_starting_with,
    ),
]
RecipeOrStore = Annotated[
    str, typer.Argument(help="A recipe, or the folder of a store.", autocompletion=names_starting_with)
]
Set = Annotated[
    list[str] | None,
    typer.Option(
        "--set", metavar="KEY=VALUE", help="Change a field, e.g. --set material.g=0.8 (TOML values; repeatable)."
    ),
]
Images = Annotated[Path | None, typer.Option(help="Folder of your own images to hide (PNG, JPEG, TIFF, NPY).")]
Objects = Annotated[
    str | None,
    typer.Option(
        metavar="FAMILY",
        help="Hide objects of another family: Glyphs, Points, Bars, ..., or my_module:Name, whose module is imported.",
    ),
]
Seed = Annotated[int, typer.Option(min=0, help="Random seed, a whole number.")]
Split = Annotated[Literal["train", "validation", "test"],
                  typer.Option(help="No two splits share a medium or an object.")]


def load(recipe: str, changes: list[str] | None, images: Path | None = None, objects: str | None = None) -> "Recipe":
    """Read a recipe with the command line's changes; other objects keep the recipe's shape, and none of its fields."""
    from specklegen.datasets import load_recipe
    from specklegen.datasets.recipes.hidden_object import HiddenObject
    from specklegen.datasets.recipes.overrides import changes_of
    from specklegen.datasets.recipes.recipe_files import recipe_table
    from specklegen.datasets.recipes.registry import imports_of_recipe

    table = changes_of(changes or [])
    whole = recipe_table(recipe, table)
    with imports_of_recipe(recipe, whole, table):
        for path in import_paths(whole):
            typer.echo(f"{recipe} imports {path}, which runs its code", err=True)
    if images is None and objects is None:
        return load_recipe(recipe, table)
    if images is not None and objects is not None:
        reject("--objects", "left out where --images is given", objects)
    fields = table.pop("objects", {})
    if not isinstance(fields, dict):
        reject("--set objects", "a table where --images or --objects is given", fields)
    loaded = load_recipe(recipe, table)
    if not isinstance(loaded, HiddenObject):
        reject("recipe", "a recipe with hidden objects, for --images or --objects", recipe,
               "Choose one of kind hidden-object: `specklegen recipes --all --json` lists kinds.")  # fmt: skip
    family = {"type": objects} if images is None else {"type": "Folder", "path": str(images)}
    return loaded.replace(objects={"shape": loaded.objects.shape} | fields | family)


def load_hidden(
    recipe: str, changes: list[str] | None, images: Path | None = None, objects: str | None = None
) -> "HiddenObject":
    """Read a recipe that hides objects."""
    from specklegen.datasets.recipes.coherent_object import CoherentObjects
    from specklegen.datasets.recipes.hidden_object import HiddenObject

    loaded = load(recipe, changes, images, objects)
    if isinstance(loaded, CoherentObjects):
        reject("recipe", "one whose objects shine incoherently", f"{recipe}, of coherent objects", COHERENT)
    if not isinstance(loaded, HiddenObject):
        reject("recipe", "a recipe with hidden objects", recipe,
               "Choose one of kind hidden-object: `specklegen recipes --all --json` lists kinds.")  # fmt: skip
    return loaded


COHERENT = (
    "The autocorrelation of coherent speckle is not that of the object, so phase retrieval does not apply: train a "
    "network, as by `specklegen train coherent-digits --network unet --input camera --loss pearson`."
)
"""Remedy where a coherent object is to be reconstructed from its autocorrelation."""


def load_objects(
    recipe: str, changes: list[str] | None, images: Path | None = None, objects: str | None = None
) -> "HiddenObject | CoherentObjects":
    """Read a recipe whose samples have an image and an object: hidden ones, or coherent ones."""
    from specklegen.datasets.recipes.coherent_object import CoherentObjects

    loaded = load(recipe, changes, images, objects)
    return loaded if isinstance(loaded, CoherentObjects) else load_hidden(recipe, changes, images, objects)


def is_store(what: str) -> bool:
    """Return whether a name is the folder of a store, or its address."""
    from specklegen.datasets.store.metadata import is_store as meant
    from specklegen.datasets.store.places import place_of

    try:
        return meant(place_of(what))
    except (OSError, ValueError):  # a name that is too long
        return False
