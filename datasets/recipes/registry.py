"""Reading recipes: a name or a path, and changes, to a validated recipe."""

from collections.abc import Mapping
from contextlib import AbstractContextManager
from pathlib import Path
from typing import Any

from specklegen.core.errors import RuleError, reject
from specklegen.core.quantities import with_texts
from specklegen.core.registry import Registry, import_paths, imports_of, is_import_path, is_trusted
from specklegen.datasets.recipes.analysed_object import AnalysedObject
from specklegen.datasets.recipes.coherent_object import CoherentObjects
from specklegen.datasets.recipes.contrast_map import ContrastMap
from specklegen.datasets.recipes.exposure_stack import ExposureStack
from specklegen.datasets.recipes.hidden_object import HiddenObject
from specklegen.datasets.recipes.lens_stack import LensStack
from specklegen.datasets.recipes.masked_light import MaskedLight
from specklegen.datasets.recipes.multi_image import DynamicSlab, TwoTilts
from specklegen.datasets.recipes.partially_coherent import PartiallyCoherent
from specklegen.datasets.recipes.recipe import Recipe
from specklegen.datasets.recipes.recipe_files import located, recipe_file, recipe_names, recipe_table
from specklegen.datasets.recipes.tilt_stack import MaterialRegression, TiltStack
from specklegen.datasets.recipes.volume_object import VolumeObject
from specklegen.datasets.recipes.volume_stack import VolumeStack
from specklegen.datasets.recipes.written_units import in_pixels, plain

PACKAGED: tuple[type[Recipe], ...] = (
    TiltStack, MaterialRegression, HiddenObject, PartiallyCoherent, MaskedLight, DynamicSlab, ExposureStack, TwoTilts,
    VolumeStack, VolumeObject, LensStack, AnalysedObject, ContrastMap, CoherentObjects,
)  # fmt: skip
"""Kinds of this library; they are known, as those of users are, by being defined."""
KINDS: Registry[type[Recipe]] = Recipe.registry
"""Every kind of recipe by its name."""


def load_recipe(
    source: str | Path, changes: Mapping[str, Any] | None = None, *, trusted: bool | None = None
) -> Recipe:
    """Read a recipe.

    Parameters
    ----------
    source
        Name of a packaged recipe, or path of a TOML file. Where a ``type`` or ``kind`` is an import path, as in
        "my_module:Rings", **the module is imported, which runs it**: read such a file as you would run a program.
    changes
        A nested table merged over it, such as ``{"objects": {"type": "Folder", "path": "my-images"}}``. By default
        none.
    trusted
        Whether modules that the file names may be imported. By default they may if the file lies below the working
        folder, or the environment variable SPECKLEGEN_TRUST is 1. Modules that ``changes`` name always may.

    Raises
    ------
    RuleError
        If there is no such recipe, one of its fields breaks a rule, or it names a module and is not trusted.

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
    file = recipe_file(source, changes)
    with imports_of_recipe(source, file.table(), changes, trusted):
        kind = _kind(file.table().get("kind"))
        written = plain(file, kind)
        try:
            return kind(**in_pixels(written.table) | {"kind": kind.class_name()})
        except RuleError as error:
            raise with_texts(error, written.texts) from None


def imports_of_recipe(
    source: str | Path, table: Mapping[str, Any], changes: Mapping[str, Any] | None, trusted: bool | None = None
) -> AbstractContextManager[None]:
    """Refuse import paths of a recipe that is not trusted; see :func:`load_recipe`."""
    if trusted is None:
        place = located(str(source), Path())
        trusted = place in recipe_names() or is_trusted(Path(place))
    return imports_of(table, trusted, [*import_paths(changes)])


def recipe_schema(name: str) -> dict[str, Any]:
    """JSON schema of a kind of recipe, by its name, its import path or a recipe of the kind."""
    known = name in KINDS or is_import_path(name)
    return _kind(name if known else recipe_table(name).get("kind")).model_json_schema()


def _kind(name: object) -> type[Recipe]:
    if name is None:
        reject("recipe.kind", "given", name, 'Write `inherits = "through-slab"`, or a kind: `kind = "hidden-object"`.')
    return KINDS.find("recipe.kind", name)
