"""Values of one of several classes, distinguished by a name that they carry, to which users add classes of their own.

A family has a root (of hidden objects :class:`~specklegen.datasets.objects.ObjectFamily`). A subclass has
added to it: the class is known by its name, in Python and in files; by its import path even where nobody has imported
it (:mod:`specklegen.core.registry`). What is kept of it is kept for its content (:mod:`specklegen.core.content`).
"""

import inspect
import sys
from collections.abc import Iterable, Iterator, Mapping
from typing import Any, ClassVar, Literal

from pydantic import (
    BaseModel,
    BeforeValidator,
    GetJsonSchemaHandler,
    SerializationInfo,
    SerializeAsAny,
    SerializerFunctionWrapHandler,
    model_serializer,
    model_validator,
)

from specklegen.core.content import Admitted, is_own
from specklegen.core.errors import reject
from specklegen.core.registry import Registry


class Registered(Admitted):
    """A value of a class that is known by name; the base of roots.

    A root says ``registry = Registry(...)``, and may say ``name_key``, the field that holds the name. Classes that
    lack something (abstract methods) or whose name begins with an underscore are not known.
    """

    registry: ClassVar[Registry]
    name_key: ClassVar[str] = "type"

    @classmethod
    def __pydantic_init_subclass__(cls, **kwargs: Any) -> None:
        super().__pydantic_init_subclass__(**kwargs)
        if "registry" in vars(cls):
            cls.registry.root = cls
        if not cls.is_member():
            return
        field = cls.model_fields.get(cls.name_key)
        if field is None:
            cls.registry.add(cls.__name__, cls)
            return
        inherited = [base.model_fields[cls.name_key].default for base in cls.__mro__[1:] if _has(base, cls.name_key)]
        if field.default is None or field.default in inherited:
            field.annotation, field.default = Literal[cls.__name__], cls.__name__  # type: ignore[assignment]
            cls.model_rebuild(force=True)
        cls.registry.add(field.default, cls)

    @classmethod
    def is_member(cls) -> bool:
        """Return whether the class is one that a value may have."""
        return not inspect.isabstract(cls) and not cls.__name__.startswith("_")

    @classmethod
    def class_name(cls) -> str:
        """Name by which files know the class."""
        field = cls.model_fields.get(cls.name_key)
        return cls.__name__ if field is None else field.default

    @classmethod
    def read(cls, value: Any) -> Any:
        """Return a member of the family, from a member or a table with its name."""
        if isinstance(value, cls):
            return value
        if not isinstance(value, Mapping):
            raise ValueError("a table of fields")
        named = value.get(cls.name_key, cls.class_name() if cls.is_member() else None)
        member = cls.registry.find(f"{cls.__name__}.{cls.name_key}", named)
        return member(**{**value, cls.name_key: member.class_name()})

    @model_validator(mode="before")
    @classmethod
    def _without_name(cls, table: Any) -> Any:
        """Take the name of the class where no field holds it."""
        if isinstance(table, Mapping) and cls.name_key not in cls.model_fields:
            if table.get(cls.name_key) == cls.class_name():
                return {name: value for name, value in table.items() if name != cls.name_key}
        return table

    @model_serializer(mode="wrap")
    def _written(self, write: SerializerFunctionWrapHandler, info: SerializationInfo) -> dict[str, Any]:
        """Write the name of a user's own class too, and its content for an identity."""
        written, cls = super()._written(write, info), type(self)
        return written | {cls.name_key: cls.class_name()} if is_own(cls) else written


def _has(base: type, field: str) -> bool:
    return issubclass(base, BaseModel) and field in base.model_fields


class _Members:
    """Schema in JSON of any of the classes that are known; inside of one of them their names alone."""

    def __init__(self, root: type[Registered]) -> None:
        self._root, self._inside = root, False

    def __get_pydantic_json_schema__(self, core: Any, handler: GetJsonSchemaHandler) -> dict[str, Any]:  # noqa: ARG002
        registry, key = self._root.registry, self._root.name_key
        if self._inside:
            return {"type": "object", "required": [key], "properties": {key: {"enum": list(registry)}}}
        self._inside = True
        try:
            return {"anyOf": [handler(registry[name].__pydantic_core_schema__) for name in registry]}
        finally:
            self._inside = False


def member_of(root: type[Registered]) -> tuple[Any, ...]:
    """Return the annotations by which a field takes any member of a family: ``Annotated[Root, *member_of(Root)]``."""
    return SerializeAsAny(), BeforeValidator(root.read), _Members(root)  # type: ignore[operator]


def own_classes(value: Any) -> Iterator[type]:
    """Classes of a user's own among a value and what it holds."""
    if isinstance(value, BaseModel):
        if is_own(type(value)):
            yield type(value)
        for name in type(value).model_fields:
            yield from own_classes(getattr(value, name))
    elif isinstance(value, tuple | list):
        for part in value:
            yield from own_classes(part)


def require_importable(classes: Iterable[type]) -> None:
    """Refuse classes that another process cannot import."""
    main = sys.modules["__main__"]
    for cls in classes:
        typed_in = cls.__module__ == "__main__" and getattr(main, "__file__", None) is None
        if "<locals>" in cls.__qualname__ or typed_in:
            reject(f"class {cls.__name__}", "defined at the top of a file, for worker processes to import",
                   f"{cls.__module__}.{cls.__qualname__}",
                   "Move it into a file my_module.py and import it from there, or render in one process.")  # fmt: skip
