"""Content: the identity of a user's own part, given by its code and values, never by its name.

A class that a user defines is known by name in recipes and scenes; the name may be given to another class a minute
later, in the next cell of a notebook or the next version of a file. So whatever such a part decides is hashed into
every fingerprint, seal and key of a cache: a registry that admits parts from outside makes them :class:`Admitted`
values, and says, where it can, what decides one (a scatterer: its tabulated amplitude); elsewhere the code of the class
counts. Classes of this package are versioned with it, and count by their fields alone.
"""

import hashlib
import re
import sys
import sysconfig
from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from copyreg import dispatch_table
from functools import cached_property, partial
from pathlib import Path
from types import CodeType, FunctionType, MethodType, ModuleType
from typing import Any, Self

import numpy as np
from pydantic import SerializationInfo, SerializerFunctionWrapHandler, model_serializer, model_validator

from specklegen.core.errors import reject
from specklegen.core.values import CONTENT_KEY, Value, for_identity

_WRAPPED = (property, staticmethod, classmethod, cached_property)
_MACHINERY = re.compile(r"__|_abc_|_\w*_$")
"""Beginning or end of the names of attributes that Python, pydantic and enumerations write themselves."""
_INSTALLED = tuple(sysconfig.get_path(name) for name in ("stdlib", "platstdlib", "purelib", "platlib"))


def content_digest(*things: object) -> str:
    """Return the SHA-256, in hexadecimal, of what things are.

    Numbers, texts, arrays and containers of them count by value; values by their canonical JSON; functions and classes
    by their compiled code with its constants and defaults and whatever it refers to, as it is now: other functions,
    global variables, base classes, what it looks up in modules of a user's own. Other objects count by what a pickle
    would hold. What belongs to Python or an installed package, and what cannot be pickled, counts by its name; a module
    that is imported within a function does not count. Where a function stands, what it is called and what its docstring
    says do not matter. Another minor version of Python compiles otherwise.

    Examples
    --------
    >>> from specklegen.core.content import content_digest
    >>> content_digest(lambda x: x + 1) == content_digest(lambda x: x + 1)
    True
    >>> content_digest(lambda x: x + 1) == content_digest(lambda x: x + 2)
    False
    """
    digest = hashlib.sha256()
    for part in _parts(things, []):
        digest.update(len(part).to_bytes(8, "little") + part)
    return digest.hexdigest()


def is_own(kind: type) -> bool:
    """Return whether a class is a user's own, and not one of this package."""
    return kind.__module__.partition(".")[0] != "specklegen"


class Admitted(Value):
    """A value of a class that a user may define: its content goes into canonical JSON, fingerprints and pickles.

    Read back from JSON, or unpickled in another process, it is refused where the class of that name has become another.
    """

    def content(self) -> object:
        """Return what decides this value beside its fields, for :func:`content_digest`: by default its class's code."""
        return type(self)

    @cached_property
    def content_sha256(self) -> str:
        """SHA-256 of the content of a value of a user's own class; empty for those of this package."""
        return content_digest(self.content()) if is_own(type(self)) else ""

    @model_serializer(mode="wrap")
    def _written(self, write: SerializerFunctionWrapHandler, info: SerializationInfo) -> dict[str, Any]:
        written = super()._written(write, info)
        return written | {CONTENT_KEY: self.content_sha256} if for_identity(info) and self.content_sha256 else written

    @model_validator(mode="wrap")
    @classmethod
    def _as_stated(cls, given: Any, make: Callable[[Any], Self]) -> Self:
        stated = None
        if isinstance(given, Mapping) and CONTENT_KEY in given:
            given = dict(given)
            stated = given.pop(CONTENT_KEY)
        made = make(given)
        with suppress(Exception):  # frozen now, as its fields are; what has none says so where it is asked for
            made.content_sha256  # noqa: B018
        if stated is not None:
            made._require(stated)
        return made

    def _require(self, stated: object) -> None:
        if stated != self.content_sha256:
            found = self.content_sha256[:12] or "none"
            reject(
                f"{type(self).__name__} content", f"that of SHA-256 {str(stated)[:12]}", found,
                "Its class has changed since this was written or sent: restore the class, or make the object again.",
            )  # fmt: skip

    def __getstate__(self) -> dict[Any, Any]:
        state = super().__getstate__()
        if not self.content_sha256:
            return state
        fields = {name: getattr(self, name) for name in type(self).model_fields}  # and nothing that was worked out here
        return state | {"__dict__": fields, CONTENT_KEY: self.content_sha256}

    def __setstate__(self, state: dict[Any, Any]) -> None:
        stated = state.get(CONTENT_KEY)
        super().__setstate__({name: each for name, each in state.items() if name != CONTENT_KEY})
        if stated is not None:
            self._require(stated)


def _parts(thing: Any, above: list[object]) -> Iterator[bytes]:
    """Bytes that tell one thing from another; of what is inside itself, its depth."""
    kind = type(thing)
    if thing is None or kind in (bool, int, float, complex, str, bytes):
        yield f"{kind.__name__} {thing!r}".encode()
        return
    if any(thing is each for each in above):
        yield f"again {next(n for n, each in enumerate(above) if each is thing)}".encode()
        return
    above = [*above, thing]
    if isinstance(thing, np.ndarray | np.generic):
        array = np.ascontiguousarray(thing)
        yield f"array {array.dtype.str} {np.shape(thing)}".encode()
        yield from _parts(array.tolist(), above) if array.dtype == object else [array.tobytes()]
    elif _is_tensor(thing):
        yield f"tensor {thing.dtype} {tuple(thing.shape)}".encode()
        plain = thing.detach().cpu().resolve_conj().resolve_neg().contiguous().reshape(-1)
        yield plain.view(sys.modules["torch"].uint8).numpy().tobytes()
    elif isinstance(thing, Value):
        yield thing.fingerprint().encode()
    elif isinstance(thing, Mapping):
        yield from _all("mapping", ((key, thing[key]) for key in sorted(thing, key=repr)), above)
    elif isinstance(thing, tuple | list):
        yield from _all("sequence", thing, above)
    elif isinstance(thing, set | frozenset):
        yield from _all("set", sorted(thing, key=repr), above)
    elif isinstance(thing, FunctionType):
        yield from _function(thing, above)
    elif isinstance(thing, CodeType):
        yield from _code(thing, above)
    elif isinstance(thing, MethodType):
        yield from _all("method", (thing.__func__, thing.__self__), above)
    elif isinstance(thing, partial):
        yield from _all("partial", (thing.func, thing.args, thing.keywords), above)
    elif isinstance(thing, _WRAPPED):
        yield from _all(kind.__name__, filter(None, (_inner(thing, n) for n in ("fget", "__func__", "func"))), above)
    elif isinstance(thing, ModuleType):
        yield f"module {thing.__name__}".encode()
    elif isinstance(thing, type):
        yield from _class(thing, above)
    elif _inner(thing, "py_func") is not None:  # compiled by Numba
        yield from _parts(_inner(thing, "py_func"), above)
    elif callable(_inner(thing, "__wrapped__")):  # such as functools.lru_cache makes
        yield from _all("around", (kind, thing.__wrapped__), above)
    elif hasattr(thing, "__dict__") and not _is_installed(kind.__module__):
        yield from _all("object", (kind, _given(kind, vars(thing))), above)
    else:
        yield f"{kind.__module__}.{kind.__qualname__} {getattr(thing, '__name__', '')}".encode()
        yield from _pickled(thing, above)


def _is_tensor(thing: Any) -> bool:
    torch = sys.modules.get("torch")
    return torch is not None and isinstance(thing, torch.Tensor) and thing.layout == torch.strided and not thing.is_meta


def _pickled(thing: Any, above: list[object]) -> Iterator[bytes]:
    """Yield what a pickle would hold of an object; nothing of one known by its name, or that cannot be pickled."""
    reduce = dispatch_table.get(type(thing))
    try:
        reduced = reduce(thing) if reduce else thing.__reduce_ex__(2)
    except Exception:
        return
    if not isinstance(reduced, str):
        listed = (list(part) if isinstance(part, Iterator) else part for part in reduced)
        given = (_given(type(thing), part) if isinstance(part, dict) else part for part in listed)
        yield from _all("held", given, above)


def _given(kind: type, state: Mapping[str, Any]) -> dict[str, Any]:
    """State of an object without what was worked out of it: asking it something makes it no other."""
    return {name: each for name, each in state.items() if not isinstance(_inner(kind, str(name)), cached_property)}


def _all(kind: str, things: Any, above: list[object]) -> Iterator[bytes]:
    things = list(things)
    yield f"{kind} {len(things)}".encode()
    for each in things:
        yield from _parts(each, above)


def _inner(thing: Any, name: str) -> Any:
    return getattr(thing, name, None)


def _function(function: FunctionType, above: list[object]) -> Iterator[bytes]:
    if len(above) > 1 and _is_installed(function.__module__):
        yield f"function {function.__module__}.{function.__qualname__}".encode()
        return
    closure = [cell.cell_contents for cell in function.__closure__ or () if _is_filled(cell)]
    known = _known(sorted(_names(function.__code__)), function.__globals__, [])
    yield from _code(function.__code__, above, function.__doc__)
    yield from _all("refers to", (function.__defaults__, function.__kwdefaults__, closure, known), above)


def _known(names: list[str], space: Mapping[str, Any], modules: list[object]) -> list[tuple[str, Any]]:
    """Return the objects that names stand for in a module, and in the modules of a user's own that stand there."""
    meanings = [(name, space[name]) for name in names if name in space]
    for _, module in list(meanings):
        if isinstance(module, ModuleType) and module not in modules and not _is_installed(module.__name__):
            modules.append(module)
            meanings += _known(names, vars(module), modules)
    return meanings


def _is_filled(cell: Any) -> bool:
    try:
        return cell.cell_contents is not None
    except ValueError:  # a variable that has no value yet
        return False


def _code(code: CodeType, above: list[object], doc: str | None = None) -> Iterator[bytes]:
    constants = [each for n, each in enumerate(code.co_consts) if not (n == 0 and doc is not None and each == doc)]
    yield from _all("code", (code.co_code, code.co_names, code.co_varnames, code.co_freevars), above)
    yield from _all("constants", constants, above)


def _names(code: CodeType) -> set[str]:
    """Global names that a function, or one inside it, may look up."""
    inner = (each for each in code.co_consts if isinstance(each, CodeType))
    return set(code.co_names).union(*map(_names, inner))


def _class(kind: type, above: list[object]) -> Iterator[bytes]:
    if not is_own(kind) or (len(above) > 1 and _is_installed(kind.__module__)):
        yield f"class {kind.__module__}.{kind.__qualname__}".encode()
        return
    members = {
        name: each for name, each in vars(kind).items()
        if isinstance(each, (FunctionType, *_WRAPPED)) or not (name.startswith("model_") or _MACHINERY.match(name))
    }  # fmt: skip
    hidden = kind.__dict__.get("__private_attributes__", {})
    members |= {name: (each.default, each.default_factory) for name, each in hidden.items()}
    # A representation may tell where an object lies in memory, which is no content.
    texts = {name: repr(field) for name, field in kind.__dict__.get("__pydantic_fields__", {}).items()}
    fields = {name: re.sub(r" at 0x[0-9a-fA-F]+", "", text) for name, text in texts.items()}
    yield from _all("class", (kind.__bases__, members, fields), above)


def _is_installed(module: str | None) -> bool:
    """Return whether a module belongs to Python, to this package, or to one that is installed."""
    top = (module or "").partition(".")[0]
    if top in ("specklegen", *sys.stdlib_module_names):
        return top != "__main__"
    file = getattr(sys.modules.get(top), "__file__", None)
    return file is not None and any(Path(file).is_relative_to(place) for place in _INSTALLED if place)
