"""Reading recipes: a name or a path, and changes, to a validated recipe."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from specklegen.core.errors import reject
from specklegen.datasets.recipes.hidden_object import HiddenObject
from specklegen.datasets.recipes.masked_light import MaskedLight
from specklegen.datasets.recipes.multi_image import DynamicSlab, TwoTilts
from specklegen.datasets.recipes.partially_coherent import PartiallyCoherent
from specklegen.datasets.recipes.recipe import Recipe
from specklegen.datasets.recipes.recipe_files import merged, recipe_table
from specklegen.datasets.recipes.tilt_stack import MaterialRegression, TiltStack
from specklegen.datasets.recipes.volume_object import VolumeObject
from specklegen.datasets.recipes.volume_stack import VolumeStack

KINDS: dict[str, type[Recipe]] = {
    "tilt-stack": TiltStack,
    "material-regression": MaterialRegression,
    "hidden-object": HiddenObject,
    "partially-coherent": PartiallyCoherent,
    "masked-light": MaskedLight,
    "dynamic-slab": DynamicSlab,
    "two-tilts": TwoTilts,
    "volume-stack": VolumeStack,
    "volume-object": VolumeObject,
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

    Examples
    --------
    >>> from specklegen.datasets import load_recipe
    >>> load_recipe("through-slab").name
    'through-slab'
    >>> load_recipe("through-slab", {"material": {"optical_depth": 5.0}}).material.optical_depth
    5.0
    """
    if changes is not None and not isinstance(changes, Mapping):
        reject("load_recipe changes", 'a table such as {"material": {"g": 0.8}}', changes)
    table = merged(recipe_table(source), changes or {})
    return _kind(table)(**table)


def recipe_schema(name: str) -> dict[str, Any]:
    """JSON schema of a kind of recipe, by its name or that of a recipe of the kind.

    Raises
    ------
    RuleError
        If there is neither.
    """
    return _kind({"kind": name} if name in KINDS else recipe_table(name)).model_json_schema()


def _kind(table: Mapping[str, Any]) -> type[Recipe]:
    kind = table.get("kind")
    if not isinstance(kind, str) or kind not in KINDS:
        reject("recipe.kind", f"one of {', '.join(KINDS)}", kind)
    return KINDS[kind]
