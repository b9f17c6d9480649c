"""Recipes as people write them: files that inherit others in another unit of length, and setups in camera pixels alone.

What is written here becomes the plain numbers of a recipe before anything is checked, so that two ways of writing one
setup have one fingerprint. Each file is read by itself (:mod:`specklegen.core.quantities`): once one of its lengths has
a unit, all must have one, and what it inherits is brought into micrometres.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from specklegen.core.arguments import real_number
from specklegen.core.errors import reject
from specklegen.core.quantities import (
    Bare,
    Mark,
    Nodes,
    Reading,
    dotted,
    in_other_unit,
    nodes_for,
    plain_numbers,
    refuse,
)
from specklegen.core.units import unit_of
from specklegen.datasets.recipes.parts.viewing import LEAST_PIXELS
from specklegen.datasets.recipes.recipe_files import RecipeFile, changed

_PIXELS = ("grain", "object_pixel", "shape", "profile")
_WIDTH = 5000.0  # micrometres; of a setup in pixels, whose directions alone are seen
_WAVELENGTH = 0.532


@dataclass(frozen=True)
class Written:
    """A recipe's table in plain numbers, and how it was written.

    Attributes
    ----------
    table : dict
        Lengths in units of ``mark.metres`` metres, where that is known.
    mark : Mark
        Unit of length, and whether lengths and times were written with units.
    texts : dict of str
        What was written with a unit, by field.
    """

    table: dict[str, Any]
    mark: Mark = Mark()
    texts: dict[str, str] = field(default_factory=dict)


def plain(file: RecipeFile, kind: type) -> Written:
    """Read a recipe of a kind, and what it inherits, into one table.

    Raises
    ------
    RuleError
        For a file with lengths or times that have no unit, where others of it or of what it changes have one, and for
        inherited lengths in an unknown unit.
    """
    whole = file.table()
    return _read(file, nodes_for(kind, whole), whole)


def _read(file: RecipeFile, nodes: Nodes, whole: Mapping[str, Any]) -> Written:
    base = Written({})
    for parent in file.parents:
        base = _changed(base, _read(parent, nodes, whole), nodes)
    table, reading = plain_numbers("", file.own, nodes, whole=whole)
    mark = reading.mark
    lights = sorted((each for each in reading.bare if each.dimension.light), key=lambda each: each.place)
    units = [mark.metres if mark.lengths else None]  # of texts, of a wavelength, stated, of a preset
    units += [unit_of(each.value) for each in lights if not each.dimension.metres]
    units += [mark.metres, *(each.dimension.metres for each in lights)]
    texts = {dotted(place): text for place, text in reading.texts.items()}
    own = Written(table, mark._replace(metres=next((each for each in units if each), None)), texts)
    return _changed(base, own, nodes) if base.table else own


def _changed(base: Written, own: Written, nodes: Nodes) -> Written:
    """Merge inherited tables with those that change them: in the unit of these, if written or a laboratory's."""
    lab = own.table.get("lab")
    leads = own.mark.lengths or (isinstance(lab, Mapping) and unit_of(lab.get("wavelength")) is not None)
    metres = (own if leads else base).mark.metres or own.mark.metres
    if base.mark.lengths and own.mark.metres is None:
        text = next(iter(base.texts.items()), ("a length", "5 mm"))
        rule = f'written with its unit, since the inherited recipe has {text[0]} = "{text[1]}"'
        refuse("", [(each.place, rule, each.value) for each in _lengths(own.table, nodes)])
    table, changes = base.table, own.table
    if leads and base.mark.metres is None:
        stays = {each.place for each in _lengths(changed(table, own.table), nodes)}
        stays -= {each.place for each in _lengths(own.table, nodes)}
        rule = "written with its unit, since other lengths have one"
        refuse("", [(each.place, rule, each.value) for each in _lengths(table, nodes)
                    if each.place in stays and own.mark.lengths])  # fmt: skip
    elif leads and metres and base.mark.metres:
        table = in_other_unit(table, nodes, base.mark.metres, metres)
    elif base.mark.lengths and metres and own.mark.metres:
        changes = in_other_unit(changes, nodes, own.mark.metres, metres)
    mark = Mark(metres, base.mark.lengths or own.mark.lengths, base.mark.times or own.mark.times)
    return Written(changed(table, changes), mark, base.texts | own.texts)


def _lengths(table: Mapping[str, Any], nodes: Nodes) -> list[Bare]:
    bare = Reading(table, nodes).bare
    return [each for each in bare if each.dimension.length and each.dimension.metres is None]


def in_pixels(table: Mapping[str, Any]) -> dict[str, Any]:
    """A recipe's table with window, camera and field for a table ``[pixels]``, where there is one."""
    fields = dict(table)
    if "pixels" not in fields or type(fields["pixels"]) is int:  # a number is a field of the kind's own: of a mask, say
        return fields
    given = fields.pop("pixels")
    if not isinstance(given, Mapping):
        reject("Recipe.pixels", "a table such as {grain = 3.0, object_pixel = 1.0, shape = [256, 256]}", given)
    unknown = [name for name in given if name not in _PIXELS]
    if unknown:
        reject("Pixels", f"given by {', '.join(_PIXELS)}", unknown[0])
    for name in ("grain", "object_pixel", "shape"):
        if name not in given:
            reject(f"Pixels.{name}", "given", "nothing", "In camera pixels; shape as [rows, columns].")
    also = [name for name in ("lab", "window", "camera", "field") if name in fields]
    if also:
        reject("Recipe.pixels", "left out if the setup is given in lengths", also, "Write one or the other.")
    grain, cell = (real_number(f"Pixels.{name}", given[name]) for name in ("grain", "object_pixel"))
    for name, value in (("grain", grain), ("object_pixel", cell)):
        if not 0 < value < 1e6:
            reject(f"Pixels.{name}", "greater than 0, in camera pixels", value)
    if grain < LEAST_PIXELS:
        rule = f"at least {LEAST_PIXELS:g} camera pixels"
        reject("Pixels.grain", rule, grain, "Finer speckle is undersampled: do not bin pixels.")
    material: dict[str, Any] = dict(fields.get("material") or {"screens": [{"type": "GroundGlass", "angle": 0.26}]})
    if "screens" not in material or material.get("gaps"):
        reject("Recipe.material", "left out, or one thin screen, if the setup is given in pixels", sorted(material),
               "For a slab, give a [lab], or a measured C_I (reconstruct --memory-effect).",
        )  # fmt: skip
    material.setdefault("wavelength", _WAVELENGTH)
    wavelength = real_number("Material.wavelength", material["wavelength"])
    width = _WIDTH * wavelength / _WAVELENGTH
    camera = {"shape": given["shape"], "pixels_per_grain": grain}
    window = {"width": width, "profile": given.get("profile", "disc")}
    return fields | {
        "material": material, "window": window, "camera": camera,
        "field": {"pitch": cell * wavelength / width / grain},
    }  # fmt: skip
