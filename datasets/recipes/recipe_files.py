"""Recipes as tables: the packaged ones by name, TOML files by path, and what they inherit.

A table is what a recipe is made from before anything is checked. Reading one imports no engine, so that listing
recipes and completing their names is quick. Paths in a file, of folders, of recipes that it inherits and of modules
(``type = "rings:Rings"``), are relative to that file, wherever the command runs.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from difflib import get_close_matches
from functools import lru_cache
from importlib.resources import files
from importlib.resources.abc import Traversable
from pathlib import Path
from typing import Any

from specklegen.core.errors import reject
from specklegen.core.registry import anchored
from specklegen.core.tables import read_text, toml_table

FIRST_RECIPES = ("through-slab", "through-slab-lab", "ground-glass", "unknown-slab", "tilt-stack", "brownian-slab")
"""Recipes to begin with, in the order of lists."""
LONGEST_CHAIN = 16
"""Recipes that inherit one another in a row, at most."""
_MOST_READ = 256  # files: of lists within lists there are soon very many


@lru_cache(1)
def recipe_names() -> tuple[str, ...]:
    """Names of the packaged recipes: six to begin with, then the others by name.

    Examples
    --------
    >>> from specklegen.datasets import recipe_names
    >>> recipe_names()[:3]
    ('through-slab', 'through-slab-lab', 'ground-glass')
    """
    names = {p.name.removesuffix(".toml") for p in _packaged().iterdir() if p.name.endswith(".toml")}
    return (*FIRST_RECIPES, *sorted(names.difference(FIRST_RECIPES)))


@lru_cache(1)
def table_names() -> tuple[str, ...]:
    """Names of the packaged tables that change a recipe which inherits them beside another, and are none."""
    return tuple(sorted(p.name.removesuffix(".toml") for p in _tables().iterdir() if p.name.endswith(".toml")))


def _packaged() -> Traversable:
    return files("specklegen.datasets") / "recipes" / "packaged"


def _tables() -> Traversable:
    return files("specklegen.datasets") / "recipes" / "tables"


@dataclass(frozen=True)
class RecipeFile:
    """A recipe as it is written: its own tables, and the files that they change, each changing those before it."""

    own: Mapping[str, Any]
    parents: tuple["RecipeFile", ...] = ()

    def table(self) -> dict[str, Any]:
        """Merge all tables as they are written, whatever the units of lengths."""
        table: dict[str, Any] = {}
        for parent in self.parents:
            table = changed(table, parent.table())
        return changed(table, self.own)

    def written(self) -> list[Any]:
        """List all tables, those that are changed before those that change them."""
        return [*(each.written() for each in self.parents), self.own]


def recipe_file(source: str | Path, changes: Mapping[str, Any] | None = None) -> RecipeFile:
    """Read a packaged recipe (by name) or a TOML file (by path), what it inherits, and changes to it.

    Raise a `RuleError` if there is no such recipe, the file is not TOML, or recipes inherit one another in a circle or
    too long a row.
    """
    place = located(str(source), Path())
    if place in table_names():
        reject("recipe", "a recipe", place, f'It changes one: inherits = ["unknown-slab", "{place}"].')
    file = _read(place, (), [0])
    return RecipeFile(changes, (file,)) if changes else file


def recipe_table(source: str | Path, changes: Mapping[str, Any] | None = None) -> dict[str, Any]:
    """Return the tables of :func:`recipe_file` merged as they are written: lengths may be in several units."""
    return recipe_file(source, changes).table()


def _read(place: str, heirs: tuple[str, ...], read: list[int]) -> RecipeFile:
    """Read a recipe, or a part of one, and what it inherits."""
    chain = (*heirs, place)
    if place in heirs:
        reject("recipe.inherits", "free of circles", " -> ".join(chain))
    read[0] += 1
    if len(heirs) == LONGEST_CHAIN or read[0] > _MOST_READ:
        reject("recipe.inherits", f"a chain of at most {LONGEST_CHAIN} recipes", " -> ".join(chain[:3]) + " -> ...")
    own = _parsed(place)
    parents = own.pop("inherits", [])
    named = parents if isinstance(parents, list) else [parents]
    if not all(isinstance(each, str) for each in named):
        reject("recipe.inherits", "the name of a recipe or the path of a TOML file, or a list of them", parents)
    return RecipeFile(own, tuple(_read(located(each, Path(place).parent), chain, read) for each in named))


def located(source: str, folder: Path) -> str:
    """Return a packaged name as it is, and a path as the one absolute path of that file, however it is spelt."""
    if source in recipe_names() or source in table_names():
        return source
    try:
        return str((folder / Path(source).expanduser()).resolve())
    except (OSError, RuntimeError, ValueError) as error:  # links in a circle, no home, a zero byte
        reject("recipe", "a name or a path", source, f"{error}.")


def _parsed(source: str) -> dict[str, Any]:
    if source in recipe_names():
        return toml_table((_packaged() / f"{source}.toml").read_text(encoding="utf-8"), source)
    if source in table_names():
        return toml_table((_tables() / f"{source}.toml").read_text(encoding="utf-8"), source)
    file = Path(source)
    if not _is_file(file):
        close = get_close_matches(file.name, recipe_names(), 1, 0.6)
        listed = "`specklegen recipes --all` lists the packaged ones."
        remedy = f"Did you mean {close[0]}? {listed}" if close else listed
        if file.suffix or file.parent != Path.cwd():
            reject("recipe", "an existing file, or the name of a packaged recipe", _relative(file), remedy)
        reject("recipe", "the name of a packaged recipe, or the path of a TOML file", _relative(file), remedy)
    table = anchored(toml_table(read_text(file, "recipe"), f"recipe {source}"), file.parent)
    objects = table.get("objects")
    members = objects.get("families") if isinstance(objects, dict) else None
    for each in [objects, table.get("mask"), *(members if isinstance(members, list) else [])]:
        for name in ("path", "scene") if isinstance(each, dict) else ():
            if isinstance(each.get(name), str):
                each[name] = str(file.parent / Path(each[name]).expanduser())
    return table


def _is_file(file: Path) -> bool:
    try:
        return file.is_file()
    except (OSError, ValueError):  # a name that is too long, or holds a zero byte
        return False


def _relative(file: Path) -> str:
    """Return a path as it was probably written: from the working folder on, where it lies inside."""
    return str(file.relative_to(Path.cwd())) if file.is_relative_to(Path.cwd()) else str(file)


def changed(base: Mapping[str, Any], changes: Mapping[str, Any]) -> dict[str, Any]:
    """Merge a recipe with what inherits it, and drop terms that the other way of describing the setup replaces.

    A ``[lab]`` takes the place of the window, camera, field and wavelength of what it inherits; ``[pixels]`` takes that
    of window, camera, field, ``[lab]`` and material. With a material of another kind, the refractive index of the old
    one goes. A grey mask takes the place of slits or a star. A camera distance, focal length or focus takes the place
    of the inherited one of them. What ``unset`` names in a table is inherited no more.
    """
    base, changes = _without_unset(base, changes)
    lab, material = base.get("lab"), base.get("material")
    if isinstance(lab, dict) and isinstance(changes.get("lab"), Mapping) and _LENSES & changes["lab"].keys():
        dropped = _LENSES if "focus" in changes["lab"] else _LENSES | {"magnification", "numerical_aperture"}
        lab = base["lab"] = {name: each for name, each in lab.items() if name not in dropped}
    if "pixels" in changes and "pixels" not in base:
        base = {name: each for name, each in base.items() if name not in (*_IN_LENGTHS, "material")}
    elif "pixels" in base and _IN_LENGTHS & changes.keys():
        base.pop("pixels")
    if "lab" in changes and lab is None:
        base = {name: each for name, each in base.items() if name not in ("window", "camera", "field")}
        for name, fields in (("material", ("wavelength",)), ("light", ("bandwidth", "refractive_index"))):
            if isinstance(base.get(name), dict):
                base[name] = {field: each for field, each in base[name].items() if field not in fields}
    elif isinstance(lab, dict) and isinstance(material, dict) and not _alike(material, changes.get("material", {})):
        lab.pop("refractive_index", None)
    if _is_grey(changes) and not _is_grey(base):
        base.pop("mask", None)
    return merged(base, changes)


def _is_grey(table: Mapping[str, Any]) -> bool:
    """Return whether a recipe's mask is grey pixels, as its field ``transmission`` tells."""
    return isinstance(table.get("mask"), Mapping) and "transmission" in table["mask"]


_IN_LENGTHS = {"lab", "window", "camera", "field"}
_LENSES = {"camera_distance", "focal_length", "focus"}
"""Fields of a laboratory of which one says the others."""


def _without_unset(
    base: Mapping[str, Any], changes: Mapping[str, Any], place: str = "recipe"
) -> tuple[dict[str, Any], dict[str, Any]]:  # fmt: skip
    """Return tables without the fields that ``unset`` names in tables of changes, and these without ``unset``."""
    names = changes.get("unset", [])
    if not isinstance(names, list) or not all(isinstance(name, str) and name in base for name in names):
        reject(f"{place}.unset", f"a list of inherited fields ({', '.join(base) or 'none'})", names)
    base = {name: dict(each) if isinstance(each, Mapping) else each for name, each in base.items() if name not in names}
    changes = {name: each for name, each in changes.items() if name != "unset"}
    for name, each in changes.items():
        if isinstance(each, Mapping) and isinstance(base.get(name), Mapping):
            base[name], changes[name] = _without_unset(base[name], each, name)
    return base, changes


def merged(base: Mapping[str, Any], changes: Mapping[str, Any]) -> dict[str, Any]:
    """Merge tables: tables go into tables, everything else is replaced.

    A table with another ``type`` replaces the old one whole, since their fields have nothing in common; so do a
    distribution (``{uniform = ...}``), and a material of another kind (``screens``, ``preset``,
    ``layers`` or ``layer`` where it had none).
    """
    result = dict(base)
    for key, value in changes.items():
        old = result.get(key)
        if isinstance(old, Mapping) and isinstance(value, Mapping) and _alike(old, value):
            result[key] = merged(old, value)
        else:
            result[key] = value
    return result


def _alike(old: Mapping[str, Any], new: Mapping[str, Any]) -> bool:
    """Return whether two tables are of one kind, so that one changes fields of the other."""
    same_type = new.get("type", old.get("type")) == old.get("type")
    return same_type and not _is_draw(old) and {"screens", "preset", "layers", "layer"} & new.keys() <= old.keys()


def _is_draw(table: Mapping[str, Any]) -> bool:
    return bool({"uniform", "log_uniform", "choice"} & table.keys())
