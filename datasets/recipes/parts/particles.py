"""The particles of a recipe's material: a scatterer of any type, its numbers drawn like those of the material.

In TOML: ``scatterer = {type = "VonMisesFisher", concentration = {log_uniform = [5, 50]}}``. A number may be a constant
or be drawn; everything else is passed on to the scatterer as it is.
"""

from collections.abc import Mapping
from itertools import product
from typing import Annotated, Any

import numpy as np
from pydantic import (
    PlainValidator,
    SerializationInfo,
    SerializerFunctionWrapHandler,
    TypeAdapter,
    ValidationError,
    WithJsonSchema,
    WrapSerializer,
)

from specklegen.core.content import content_digest, is_own
from specklegen.core.errors import reject
from specklegen.core.quantities import Like
from specklegen.core.registry import is_import_path
from specklegen.core.values import CONTENT_KEY, IDENTITY, NAME_FIELDS, broken_rules, equals_default, for_identity
from specklegen.datasets.distributions import Draw, drawn, ends, is_draw
from specklegen.scene.scatterers import AnyScatterer, Scatterer
from specklegen.scene.scatterers.scatterer import scatterer_class

_SCATTERER = TypeAdapter(AnyScatterer)
_DRAW = TypeAdapter(Draw)
_PROBES = 4  # within the ranges, besides their ends
_REMEDY = "The class, or a name that it uses, was redefined: load the recipe again."


class ParticleTable(dict[str, Any]):
    """A scatterer's table, with distributions in place of numbers, and what it knows of a user's own classes in it.

    Attributes
    ----------
    classes : tuple of classes
        Those of a user's own; a process that gets the table imports the modules that they stand in.
    code, content : str
        SHA-256 of the code of these classes, and of the contents of scatterers all over the ranges; empty where no
        class is a user's own.
    """

    classes: tuple[type[Scatterer], ...] = ()
    code = content = ""

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state)
        _require_code(self, extreme_scatterers(self)[0])


def _own_classes(scatterer: Scatterer) -> tuple[type[Scatterer], ...]:
    """All of a user's own classes in a scatterer."""
    kinds = {type(each) for each in (scatterer, *(part for part, _ in scatterer.components))}
    return tuple(sorted(filter(is_own, kinds), key=lambda kind: kind.__name__))


def _read(table: Any) -> ParticleTable:
    if isinstance(table, ParticleTable) and table.code:
        _require_code(table, extreme_scatterers(table)[0])
    if isinstance(table, Scatterer):
        table = table.model_dump(context=IDENTITY)
    if not isinstance(table, Mapping) or not isinstance(table.get("type"), str):
        reject("Material.scatterer", 'a table with a type, such as {type = "HenyeyGreenstein", g = 0.9}', table)
    read = ParticleTable(
        {name: _DRAW.validate_python(value) if is_draw(value) else value for name, value in table.items()}
    )
    stated = read.pop(CONTENT_KEY, None) if any(map(is_draw, read.values())) else None
    for scatterer in extreme_scatterers(read):
        read.classes = _own_classes(scatterer)
        if is_import_path(read["type"]):
            read["type"] = type(scatterer).__name__  # known from now on
    read.code = content_digest(read.classes) if read.classes else ""
    read.pop(CONTENT_KEY, None)  # that of one scatterer, which has been compared
    read.content = _content_of(read) if read.code else ""
    if stated not in (None, read.content):
        reject("Material.scatterer", f"of content {str(stated)[:12]}", read.content[:12] or "none", _REMEDY)
    return read


def _written(table: ParticleTable, write: SerializerFunctionWrapHandler, info: SerializationInfo) -> dict[str, Any]:
    written = write(table)
    if not for_identity(info):
        return written
    fields = scatterer_class(table["type"]).model_fields
    decisive = {
        name: value for name, value in written.items()
        if name in NAME_FIELDS or not equals_default(value, fields.get(name))
    }  # fmt: skip
    return decisive | ({CONTENT_KEY: table.content} if table.content else {})


def _content_of(table: Mapping[str, Any]) -> str:
    rng = np.random.default_rng(0)
    probes = [*extreme_scatterers(table), *(drawn_scatterer(table, rng) for _ in range(_PROBES))]
    return content_digest([each.canonical_json() for each in probes])


Particles = Annotated[
    dict[str, Any],
    PlainValidator(_read),
    Like(AnyScatterer),
    WrapSerializer(_written),
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
        scatterer = _SCATTERER.validate_python(dict(table) | numbers)
    except ValidationError as error:
        raise broken_rules("Material.scatterer", error) from None
    _require_code(table, scatterer)
    return scatterer


def _require_code(table: Mapping[str, Any], made: Scatterer) -> None:
    """Refuse a scatterer whose class has become another since the table was read; other code may do the same."""
    if not isinstance(table, ParticleTable) or not table.code:
        return
    code = content_digest(_own_classes(made))
    if code == table.code:
        return
    if _content_of(ParticleTable(table)) != table.content:
        rule = "of a class that is unchanged since the recipe was read"
        reject("Material.scatterer", rule, type(made).__name__, _REMEDY)
    table.code = code
