"""Frozen, validated values.

Everything that describes a simulation is a :class:`Value`: keyword-only, immutable, checked once when
it is made, equal by content, and serialisable to canonical JSON (whose SHA-256 is the fingerprint that
keys pilots and stores) and to TOML.
"""

import hashlib
import json
import re
from collections.abc import Callable
from difflib import get_close_matches
from functools import cached_property, lru_cache
from typing import Annotated, Any, ParamSpec, Self, TypeVar, cast, get_args

import numpy as np
import tomli_w
from pydantic import (
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    PlainSerializer,
    SerializationInfo,
    SerializerFunctionWrapHandler,
    TypeAdapter,
    ValidationError,
    WithJsonSchema,
    model_serializer,
)
from pydantic.fields import FieldInfo

from specklegen.core.display.signature import Legible, positional
from specklegen.core.errors import RuleError, reject, shown
from specklegen.core.quantities import (
    Mark,
    dotted,
    holds_text,
    mark_of,
    mark_tables,
    marked,
    nodes_for,
    nodes_of,
    parts_of,
    plain_numbers,
    require_light,
    scales_in,
    trusting,
    with_texts,
)
from specklegen.core.registry import imports_of
from specklegen.core.shielded import FLOAT_ERRORS
from specklegen.core.tables import json_table, toml_table

Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
NonNegative = Annotated[float, Field(ge=0, allow_inf_nan=False)]
Finite = Annotated[float, Field(allow_inf_nan=False)]
UnitInterval = Annotated[float, Field(ge=0, le=1, allow_inf_nan=False)]
PositiveInt = Annotated[int, Field(ge=1, le=2**63 - 1)]

_RULES = {
    "greater_than": "greater than {gt}",
    "greater_than_equal": "at least {ge}",
    "less_than": "less than {lt}",
    "less_than_equal": "at most {le}",
    "finite_number": "finite",
    "float_type": "a number",
    "float_parsing": "a number",
    "int_type": "a whole number",
    "int_parsing": "a whole number",
    "int_from_float": "a whole number",
    "int_parsing_size": "a whole number of fewer digits",
    "missing": "given",
    "extra_forbidden": "left out: there is no such field",
    "frozen_instance": "unchanged: values are frozen, use .replace(...)",
    "literal_error": "one of {expected}",
    "enum": "one of {expected}",
    "bool_type": "True or False",
    "bool_parsing": "True or False",
    "string_type": "a text",
    "union_tag_invalid": "one of the types {expected_tags}",
    "union_tag_not_found": "an object with a known type",
    "model_type": "a table of the fields of {class_name}",
    "model_attributes_type": "a table of fields",
    "dict_type": "a table of fields",
    "tuple_type": "a sequence, such as (2, 3)",
    "list_type": "a sequence, such as [2, 3]",
    "too_short": "at least {min_length} long",
    "too_long": "at most {max_length} long",
}


_MEMBER = re.compile(r"@|constrained-|function-|literal\[|(float|int|str|bool)$")
"""Beginning of a part of a place that tells apart the members of a union; nobody wrote it."""


def broken_rules(owner: str, error: ValidationError, of: type[BaseModel] | None = None) -> RuleError:
    """Words for what a value breaks: by the names of classes, and of the tables in which a file has them.

    ``owner`` is a class, or a field of one; its fields are those of the class ``of``.
    """
    told: list[tuple[str, str]] = []
    broken: dict[str, tuple[list[str], object, str]] = {}  # the rules of one field, those of a union's members together
    above = owner.partition(".")[2]
    for item in error.errors():
        context = {name: _bound(value) for name, value in item.get("ctx", {}).items()}
        place = ".".join(str(part) for part in item["loc"] if not _MEMBER.match(str(part)))
        inner = context.get("error")
        if isinstance(inner, RuleError):
            # Named by its class, which stands in the table of this place; or by a rule that has words of its own.
            said = re.sub(r"^[A-Z]\w*\.(?=[a-z_])", "", inner.in_tables)
            tables = [part for part in (above, _tabled(place)) if part] if said != str(inner) else []
            told.append((str(inner), "\n".join(_within(tables, line) for line in said.split("\n"))))
            continue
        rule = _RULES.get(item["type"])
        rule = rule.format(**context) if rule else _bare(item["msg"])
        remedy = _meant(of, place) if of is not None and item["type"] == "extra_forbidden" else ""
        broken.setdefault(place, ([], item["input"], remedy))[0].append(rule)
    for place, (rules, value, remedy) in broken.items():
        where = ".".join(part for part in (owner, place) if part)
        words = f"must be {' or '.join(dict.fromkeys(rules))}; got {shown(value)}.{remedy}"
        told.append((f"{where} {words}", f"{_tabled(where.partition('.')[2]) or owner} {words}"))
    return RuleError("\n".join(one for one, _ in told), "\n".join(other for _, other in told))


def _tabled(place: str) -> str:
    """A place by its tables and fields alone: without the classes that say which member of a union it is."""
    return ".".join(part for part in place.split(".") if not part[:1].isupper())


def _within(tables: list[str], line: str) -> str:
    """A line about a field of the innermost of some tables; the check of a field may have named it already."""
    for table in reversed(tables):
        line = line if re.match(rf"{re.escape(table)}[. ]", line) else f"{table}.{line}"
    return line


def _meant(owner: type[BaseModel], name: str) -> str:
    """Ask whether a field was meant that is written alike, or stands in a table of the owner."""
    within = {
        inner: f"{field}.{inner}"
        for field, info in reversed(owner.model_fields.items()) for part in _values_in(info.annotation)
        for inner in part.model_fields
    }  # fmt: skip
    close = get_close_matches(name, owner.model_fields, 1, 0.6)
    meant = close[0] if close else within.get(name)
    return f" Did you mean {meant}?" if meant else ""


def _values_in(annotation: Any) -> list[type[BaseModel]]:
    """Classes of values that an annotation names."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return [annotation]
    return [each for part in get_args(annotation) for each in _values_in(part)]


def _bound(value: object) -> object:
    """Return a bound as people write it: large ones with an exponent."""
    return f"{value:g}" if isinstance(value, float) and abs(value) >= 1e12 else value


def _bare(message: str) -> str:
    """Return the rule in a message of pydantic, without the words that stand before it in each."""
    return message.removeprefix("Value error, ").removeprefix("Input should be ")


CONTENT_KEY = "content_sha256"
"""Key of the content of a user's own class (:mod:`specklegen.core.content`) in a value written for its identity."""
IDENTITY = {"identity": True}
"""Serialisation context of fingerprints: without fields that equal their defaults, with the content of own classes."""
NAME_FIELDS = ("type", "kind")
"""Fields that tell the members of a union apart: part of every identity, although each equals its default."""


def for_identity(info: SerializationInfo) -> bool:
    """Return whether a value is written for its fingerprint, and not for a reader."""
    return bool(info.context) and "identity" in info.context


def equals_default(value: Any, field: FieldInfo | None) -> bool:
    """Return whether a field has its default value: arrays by their elements, and True is not 1."""
    if field is None or field.is_required():
        return False
    # Not the copy that get_default makes: a default that is a value remembers its canonical JSON.
    default = field.default if field.default_factory is None else field.get_default(call_default_factory=True)
    if isinstance(value, np.ndarray) or isinstance(default, np.ndarray):
        return type(value) is type(default) and np.array_equal(value, default)
    return isinstance(value, bool) == isinstance(default, bool) and bool(value == default)


def _one_zero(value: Any, levels: int = 8) -> Any:
    """Return a value with 0.0 for -0.0, which equals it and is written otherwise: equal values have one fingerprint."""
    if type(value) in (list, tuple):  # no field has as many levels; what has more is refused by its field
        return type(value)(_one_zero(each, levels - 1) for each in value) if levels else value
    number = isinstance(value, float | np.floating) or (isinstance(value, np.ndarray) and value.ndim == 0)
    return 0.0 if number and value == 0 else value


def _part(kind: type[BaseModel], name: str, content: Any) -> Any:
    """Return a field's value; None of a table that it cannot be made of."""
    try:
        return TypeAdapter(cast("Any", kind.model_fields[name].annotation)).validate_python(content)
    except (TypeError, ValueError):
        return None


class Value(BaseModel, metaclass=Legible):
    """A frozen, validated, serialisable value; equal to another when their canonical JSON is equal.

    Fields are given by name. One whose place is obvious is declared with ``Field(kw_only=False)`` and may go without.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", arbitrary_types_allowed=True, ser_json_inf_nan="constants")

    def __init__(self, *unnamed: Any, **fields: Any) -> None:
        owner = type(self).__name__
        first = positional(type(self)) if unnamed else []
        if len(unnamed) > len(first) or set(first[: len(unnamed)]) & fields.keys():
            names = ", ".join(field.alias or name for name, field in type(self).model_fields.items())
            reject(owner, f"given by the names of its fields ({names})", unnamed, "Write name=value.")
        given = dict(zip(first, unnamed, strict=False)) | fields
        nodes, mark, texts = nodes_of(type(self)), Mark(), {}
        if nodes and any(name in nodes and holds_text(value) for name, value in given.items()):
            given, reading = plain_numbers(f"{owner}.", given, nodes_for(type(self), given), made=self)
            mark, texts = reading.mark, {dotted(place): text for place, text in reading.texts.items()}
        try:
            with np.errstate(**FLOAT_ERRORS):  # a value is the same in a program that hunts for errors of its own
                super().__init__(**{name: _one_zero(value) for name, value in given.items()})
        except ValidationError as error:
            parts = () if mark.lengths else [_part(type(self), name, given.get(name)) for name in parts_of(type(self))]
            if scales := scales_in(parts):  # a wavelength in another unit breaks other rules
                require_light(f"{owner}.", given, nodes, scales, made=self)
            raise with_texts(broken_rules(owner, error, type(self)), texts) from None
        if not mark.lengths and (scales := scales_in(map(self.__dict__.get, parts_of(type(self))))):
            require_light(f"{owner}.", given, nodes, scales, made=self)
            mark = mark._replace(metres=min(scales))
        if any(mark):
            marked(self, mark)
        if mark.lengths or mark.times:
            mark_tables(given, self, mark)

    def __dir__(self) -> list[str]:
        return sorted({*dir(type(self)), *type(self).model_fields})

    @model_serializer(mode="wrap")
    def _written(self, write: SerializerFunctionWrapHandler, info: SerializationInfo) -> dict[str, Any]:
        """Write the fields; for an identity, those that differ from their defaults (see :meth:`canonical_json`)."""
        written = write(self)
        if not for_identity(info):
            return written
        for name, field in type(self).__pydantic_fields__.items():
            if name not in NAME_FIELDS and equals_default(getattr(self, name), field):
                written.pop(name, None)
                written.pop(field.alias, None)
        return written

    def __setattr__(self, name: str, value: Any) -> None:
        try:
            super().__setattr__(name, value)
        except ValidationError as error:
            raise broken_rules(type(self).__name__, error, type(self)) from None

    def canonical_json(self) -> str:
        """Write the identity of the value as JSON: sorted keys, shortest round-trip numbers; equal values, equal text.

        Fields that equal their defaults are left out, except ``type`` and ``kind``. So a new field with a default
        changes the identity of no value that was written before.
        """
        return self._canonical_json

    @cached_property
    def _canonical_json(self) -> str:
        written = self.model_dump(mode="json", by_alias=True, context=IDENTITY)
        return json.dumps(written, sort_keys=True, separators=(",", ":"))

    def fingerprint(self) -> str:
        """Return the SHA-256 of the canonical JSON, and of the class's name where no field tells it, in hexadecimal."""
        name = type(self).__name__ if type(self).model_fields.keys().isdisjoint(NAME_FIELDS) else ""
        return hashlib.sha256(f"{name}{self.canonical_json()}".encode()).hexdigest()

    def to_toml(self) -> str:
        """Write the value as TOML."""
        return tomli_w.dumps(_without_none(self.model_dump(mode="json", by_alias=True, exclude_none=True)))

    @classmethod
    def from_json(cls, text: str, *, trusted: bool = False) -> Self:
        """Read a value from JSON; import paths such as "my_module:Rings" are refused unless the text is trusted."""
        return cls._from_table(json_table(text, f"{cls.__name__} in JSON"), trusted)

    @classmethod
    def from_toml(cls, text: str, *, trusted: bool = False) -> Self:
        """Read a value from TOML; import paths such as "my_module:Rings" are refused unless the text is trusted."""
        return cls._from_table(toml_table(text, f"{cls.__name__} in TOML"), trusted)

    @classmethod
    def _from_table(cls, table: dict[str, Any], trusted: bool) -> Self:
        with imports_of(table, trusted):
            return cls(**table)

    def replace(self, **changes: Any) -> Self:
        """Return a copy with some fields changed, validated anew."""
        fields = {field.alias or name: getattr(self, name) for name, field in type(self).model_fields.items()}
        mark = mark_of(self)
        if mark is None or not (mark.lengths or mark.times or any(map(holds_text, changes.values()))):
            return type(self)(**fields | changes)
        changes, reading = plain_numbers(f"{type(self).__name__}.", changes, nodes_of(type(self)), beside=mark)
        with trusting():
            return marked(type(self)(**fields | changes), reading.mark)

    def __eq__(self, other: object) -> bool:
        return type(self) is type(other) and self._canonical_json == other._canonical_json  # type: ignore[attr-defined]

    def __hash__(self) -> int:
        return hash(self._canonical_json)


P = ParamSpec("P")
R = TypeVar("R")


def _without_none(content: Any) -> Any:
    """JSON with an empty table for each None in a list: TOML has none."""
    if isinstance(content, dict):
        return {name: _without_none(value) for name, value in content.items()}
    if isinstance(content, list) and not (content and isinstance(content[0], float)):  # millions of numbers stay
        return [{} if value is None else _without_none(value) for value in content]
    return content


def remembered(size: int) -> Callable[[Callable[P, R]], Callable[P, R]]:
    """Remember the last ``size`` results of a pure function of values, keyed by their content."""

    def wrap(function: Callable[P, R]) -> Callable[P, R]:
        return cast("Callable[P, R]", lru_cache(maxsize=size)(function))

    return wrap


def read_only(array: np.ndarray) -> np.ndarray:
    """Return an array as read-only, since it is cached and returned again."""
    array.flags.writeable = False
    return array


def _frozen_array(value: Any) -> np.ndarray:
    try:
        real = not np.iscomplexobj(value)
        array = np.asarray(np.array(value if real else 0, dtype=np.float64) + 0.0)  # one zero
    except (TypeError, ValueError, OverflowError, RuntimeError):  # the last of torch, of what has gradients
        raise ValueError("an array of numbers") from None
    if not real:  # an imaginary part is not thrown away
        raise ValueError("an array of real numbers")
    if not np.isfinite(array).all():
        raise ValueError("finite everywhere")
    array.flags.writeable = False
    return array


_NESTED: dict[str, Any] = {"type": "array", "items": {"anyOf": [{"type": "number"}, {"type": "array"}]}}
_PARTS: dict[str, Any] = {"type": "object", "required": ["real", "imag"],
                          "properties": {"real": _NESTED, "imag": _NESTED}}  # fmt: skip
Array = Annotated[
    np.ndarray, BeforeValidator(_frozen_array), PlainSerializer(lambda a: a.tolist()), WithJsonSchema(_NESTED)
]
"""A read-only float64 array of any shape, finite everywhere, written to JSON as nested lists."""


def _complex_array(value: Any) -> np.ndarray:
    if isinstance(value, dict):
        if set(value) != {"real", "imag"}:
            raise ValueError("an array of numbers, or its parts real and imag")
        real, imag = _frozen_array(value["real"]), _frozen_array(value["imag"])
        if real.shape != imag.shape:
            raise ValueError("of as many imaginary parts as real ones")
        array = np.asarray(real + 1j * imag)
    else:
        try:
            array = np.asarray(np.array(value, dtype=np.complex128) + 0.0)
        except (TypeError, ValueError, OverflowError, RuntimeError):
            raise ValueError("an array of numbers") from None
    if not np.isfinite(array).all():
        raise ValueError("finite everywhere")
    array.flags.writeable = False
    return array


def _parts(array: np.ndarray) -> dict[str, Any]:
    return {"real": array.real.tolist(), "imag": array.imag.tolist()}


ComplexArray = Annotated[
    np.ndarray, BeforeValidator(_complex_array), PlainSerializer(_parts),
    WithJsonSchema({"anyOf": [_NESTED, _PARTS]}),
]  # fmt: skip
"""A read-only complex128 array of any shape, finite everywhere, written to JSON as its real and imaginary parts."""


def _complex_number(value: Any) -> complex:
    array = _complex_array(value)
    if array.shape:
        raise ValueError("one number")
    return complex(array)


ComplexNumber = Annotated[complex, BeforeValidator(_complex_number), PlainSerializer(lambda z: _parts(np.array(z)))]
"""A complex number, finite, written to JSON as its real and imaginary parts."""


def unit_vectors(field: str, vectors: np.ndarray) -> np.ndarray:
    """Check directions ``(..., d)``, d = 2 or 3, and return them normalised to the last bit."""
    if vectors.shape == (0,):  # no vectors at all: nested lists lose the last axis
        vectors = vectors.reshape(0, 3)
    if vectors.ndim < 1 or vectors.shape[-1] not in (2, 3):
        reject(field, "unit vectors along the last axis, of length 2 or 3", vectors.shape)
    lengths = np.linalg.norm(vectors, axis=-1)
    if vectors.size and np.abs(lengths - 1).max() > 1e-6:
        worst = vectors.reshape(-1, vectors.shape[-1])[np.abs(lengths - 1).argmax()]
        reject(field, "unit vectors", worst, "Divide each direction by its length.")
    # Left alone when already of unit length to rounding, so that normalising twice changes nothing.
    vectors = np.where(np.abs(lengths - 1)[..., None] > 1e-15, vectors / lengths[..., None], vectors)
    vectors.flags.writeable = False
    return vectors


def position_vectors(field: str, points: np.ndarray) -> np.ndarray:
    """Check positions ``(..., d)``, d = 2 or 3."""
    if points.shape == (0,):
        points = points.reshape(0, 3)
    if points.ndim < 1 or points.shape[-1] not in (2, 3):
        reject(field, "positions along the last axis, of length 2 or 3", points.shape)
    return points
