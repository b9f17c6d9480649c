"""Reading recipes: a name or a path, and changes, to a validated recipe."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from specklegen.datasets.hidden_object import HiddenObject
from specklegen.datasets.partially_coherent import PartiallyCoherent
from specklegen.datasets.recipe import Recipe, merged, recipe_table
from specklegen.datasets.tilt_stack import TiltStack
from specklegen.values import reject

KINDS: dict[str, type[Recipe]] = {
    "tilt-stack": TiltStack,
    "hidden-object": HiddenObject,
    "partially-coherent": PartiallyCoherent,
}


def load_recipe(source: str | Path, changes: Mapping[str, Any] | None = None) -> Recipe:
    """Read a recipe.

    Parameters
    ----------
    source
        Name of a packaged recipe, or path of a TOML file.
    changes
        A nested table merged over it, such as ``{"objects": {"type": "Folder", "path": "my-images"}}``.

    Raises
    ------
    RuleError
        If there is no such recipe, or one of its fields breaks a rule.
    """
    table = merged(recipe_table(source), changes or {})
    kind = table.get("kind")
    if kind not in KINDS:
        reject("recipe.kind", f"one of {', '.join(KINDS)}", kind)
    return KINDS[kind](**table)
