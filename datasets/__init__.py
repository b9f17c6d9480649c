"""Data sets: recipes, and samples of them streamed or stored.

Names load when they are first used: torch and zarr are not needed to read a recipe.
"""

from typing import TYPE_CHECKING

from specklegen.lazy import lazily

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

__getattr__ = lazily(__name__, _HOME)
