"""Signatures for help(), editors and the tab key: a value's fields with their rules, without the machinery below.

pydantic's signature spells every validator out (``Annotated[ndarray, BeforeValidator(...)]``), and its classes list a
hundred names of their own. A class made by :class:`Legible` shows ``Slab(*, thickness: float >= 0, ...)``, and
its own names.
"""

import inspect
import types
from typing import TYPE_CHECKING, Annotated, Any, Literal, Union, get_args, get_origin

import numpy as np
from annotated_types import Ge, Gt, Le, Lt
from pydantic import BaseModel
from pydantic.fields import FieldInfo

if TYPE_CHECKING:
    from pydantic._internal._model_construction import ModelMetaclass
else:
    ModelMetaclass = type(BaseModel)


class Annotation:
    """An annotation in words; the way it prints is all there is to it."""

    def __init__(self, words: str) -> None:
        self._words = words

    def __repr__(self) -> str:
        return self._words


class Legible(ModelMetaclass):
    """The class of the classes of values."""

    @property
    def __signature__(cls) -> inspect.Signature:
        return signature(cls)  # type: ignore[arg-type]

    @__signature__.setter
    def __signature__(cls, spelt_out: object) -> None:
        """Drop the one that pydantic gives each class."""

    def __dir__(cls) -> list[str]:
        return [name for name in super().__dir__() if name not in _MACHINERY and not name.startswith("_")]


def positional(model: type[BaseModel]) -> list[str]:
    """Names of the fields that may be given without their name: those declared with ``Field(kw_only=False)``."""
    return [name for name, field in model.__pydantic_fields__.items() if field.kw_only is False]


def signature(model: type[BaseModel]) -> inspect.Signature:
    """Signature of a value: fields by position first, then by name, each with its type and rule in words."""
    first = positional(model)
    fields = sorted(model.__pydantic_fields__.items(), key=lambda item: item[0] not in first)
    return inspect.Signature([_parameter(name, field, name in first) for name, field in fields if name != "type"])


def _parameter(name: str, field: FieldInfo, by_position: bool) -> inspect.Parameter:
    kind = inspect.Parameter.POSITIONAL_OR_KEYWORD if by_position else inspect.Parameter.KEYWORD_ONLY
    default = inspect.Parameter.empty if field.is_required() else field.get_default(call_default_factory=True)
    names = next((rule.func.names for rule in field.metadata if hasattr(getattr(rule, "func", None), "names")), None)
    words = _in_words(field.annotation) + _rules(field.metadata)
    written = Annotation(words if names is None else " | ".join(map(repr, names)))
    return inspect.Parameter(field.alias or name, kind, default=default, annotation=written)


def _in_words(annotation: Any) -> str:
    origin, parts = get_origin(annotation), get_args(annotation)
    if origin is Annotated:
        inner, *metadata = parts
        return _in_words(inner) + _rules(metadata)
    if origin is Literal:
        return " | ".join(map(repr, parts))
    if origin in (Union, types.UnionType):
        return " | ".join(dict.fromkeys(map(_in_words, parts)))
    if origin is not None:
        return f"{_in_words(origin)}[{', '.join('...' if part is ... else _in_words(part) for part in parts)}]"
    if annotation is np.ndarray:
        return "array"
    if annotation is types.NoneType:
        return "None"
    return getattr(annotation, "__name__", str(annotation))


_WHOLE = Le(2**63 - 1)
"""What arrays hold of whole numbers, which nobody has to be told."""


def _rules(metadata: list[Any]) -> str:
    """Bounds of a number as text: ``" > 0"``, ``" in [0, 1)"``."""
    flat = [rule for item in metadata for rule in (item.metadata if isinstance(item, FieldInfo) else [item])]
    low = next(((rule.gt, "(", ">") if isinstance(rule, Gt) else (rule.ge, "[", ">=")
                for rule in flat if isinstance(rule, Gt | Ge)), None)  # fmt: skip
    high = next(((rule.lt, ")", "<") if isinstance(rule, Lt) else (rule.le, "]", "<=")
                 for rule in flat if isinstance(rule, Lt | Le) and rule != _WHOLE), None)  # fmt: skip
    if low and high:
        return f" in {low[1]}{low[0]:g}, {high[0]:g}{high[1]}"
    bound = low or high
    return f" {bound[2]} {bound[0]:g}" if bound else ""


_MACHINERY = {name for name in dir(BaseModel) if not name.startswith("_")} | {"model_config"}
