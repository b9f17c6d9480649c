"""The particles of a recipe's material: a scatterer of any type, its numbers drawn like those of the material.

In TOML: ``scatterer = {type = "VonMisesFisher", concentration = {log_uniform = [5, 50]}}``. A number may be a constant
or be drawn; everything else is passed on to the scatterer as it is.
"""

from collections.abc import Mapping
from itertools import product
from typing import Annotated, Any

import numpy as np
from pydantic import BeforeValidator, TypeAdapter, WithJsonSchema

from specklegen.core.errors import RuleError, reject
from specklegen.datasets.recipes.parts.distributions import Draw, drawn, ends, is_draw
from specklegen.scene.scatterers import AnyScatterer, Scatterer

_SCATTERER = TypeAdapter(AnyScatterer)
_DRAW = TypeAdapter(Draw)


def _read(table: Any) -> Any:
    if isinstance(table, Scatterer):
        table = table.model_dump()
    if not isinstance(table, Mapping) or not isinstance(table.get("type"), str):
        reject("Material.scatterer", 'a table with a type, such as {type = "HenyeyGreenstein", g = 0.9}', table)
    read = {name: _DRAW.validate_python(value) if is_draw(value) else value for name, value in table.items()}
    for scatterer in extreme_scatterers(read):
        assert isinstance(scatterer, Scatterer)
    return read


Particles = Annotated[
    dict[str, Any],
    BeforeValidator(_read),
    WithJsonSchema({"type": "object", "required": ["type"], "properties": {"type": {"type": "string"}}}),
]
"""A scatterer's table, with distributions in place of numbers."""


def drawn_scatterer(table: Mapping[str, Any], rng: np.random.Generator) -> Scatterer:
    """One scatterer; its numbers are drawn in the order of their names."""
    return _made(table, {name: drawn(table[name], rng) for name in drawn_numbers(table)})


def extreme_scatterers(table: Mapping[str, Any]) -> list[Scatterer]:
    """Scatterers at the ends of every range."""
    names = drawn_numbers(table)
    corners = product(*(sorted(set(ends(table[name]))) for name in names))
    return [_made(table, dict(zip(names, corner, strict=True))) for corner in corners]


def drawn_numbers(table: Mapping[str, Any]) -> list[str]:
    """Names of the numbers that are drawn."""
    return sorted(name for name, value in table.items() if is_draw(value))


def scatterer_with(table: Mapping[str, Any], numbers: Mapping[str, float]) -> Scatterer:
    """The scatterer with so many numbers, one for each that is drawn."""
    return _made(table, {name: numbers[name] for name in drawn_numbers(table)})


def _made(table: Mapping[str, Any], numbers: dict[str, float]) -> Scatterer:
    try:
        return _SCATTERER.validate_python(dict(table) | numbers)
    except RuleError:
        raise
    except ValueError as error:
        reject("Material.scatterer", "a scatterer", dict(table) | numbers, str(error))
