"""Data sets: recipes, and samples of them streamed or stored.

Names load when they are first used: torch and zarr are not needed to read a recipe.
"""

import importlib
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from specklegen.datasets.cache import SpeckleCache
    from specklegen.datasets.presets import load_recipe
    from specklegen.datasets.recipe import Recipe, recipe_names
    from specklegen.datasets.stream import SpeckleStream

_HOME = {
    "Recipe": "recipe",
    "SpeckleCache": "cache",
    "SpeckleStream": "stream",
    "load_recipe": "presets",
    "recipe_names": "recipe",
}
__all__ = ["Recipe", "SpeckleCache", "SpeckleStream", "load_recipe", "recipe_names"]


def __getattr__(name: str) -> object:
    if name not in _HOME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = getattr(importlib.import_module(f"{__name__}.{_HOME[name]}"), name)
    globals()[name] = value
    return value
