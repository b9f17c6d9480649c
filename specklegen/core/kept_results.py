"""Results of pure functions of values, kept between processes: what is dear to find and short to write down.

A file is named by the digest of all that decides its content: what was asked of which values, the files of this
package, the versions of libraries and the processor. It holds JSON, with every number to its last bit, so that a
process which reads it goes on as one that finds the result itself. What cannot be read or written costs the finding
and nothing else.

Values that hold a part of a user's own are left out, for its code may change while its name stays.
``SPECKLEGEN_PILOTS=anew`` finds all anew and keeps nothing.
"""

import base64
import hashlib
import json
import os
from collections.abc import Callable
from dataclasses import fields, is_dataclass
from functools import lru_cache
from pathlib import Path
from types import NoneType, UnionType
from typing import Any, TypeVar, get_args, get_origin, get_type_hints

import numpy as np

from specklegen.core.kept_files import cache_root, keep, kept_content, make_room
from specklegen.core.libraries import arithmetic, package_digest
from specklegen.core.values import CONTENT_KEY, Value, read_only

_ABOVE = ("models", "datasets", "cli", "explorer")
"""Folders of the package that know of those where results are found, which know nothing of them."""
SWITCH, ANEW = "SPECKLEGEN_PILOTS", "anew"
_SUFFIX = ".result"
_MOST, _MOST_BYTES = 16, 2**20
"""Files of each of 256 folders, and their bytes: 4096 and 256 MiB in all, of which the oldest go first."""
_MOST_OF_A_PROCESS = 1000
"""Results that one process writes down: media that are planned one by one, once each, are not worth their files."""

Result = TypeVar("Result")


class _Room:
    """How many results this process may still write down."""

    left = _MOST_OF_A_PROCESS


def kept_result(kind: Any, about: tuple[Any, ...], find: Callable[[], Result]) -> Result:
    """Return the result of a pure function: what is kept of it, or found now and kept.

    Parameters
    ----------
    kind
        Its type: number, text, truth value, array, or a tuple or dataclass of these; "or None" of any.
    about
        What decides it: the name of the function, and the values, numbers and texts that it is given.
    find
        Finds it.
    """
    file = _file(about)
    content = None if file is None else kept_content(file)
    if content is not None:
        return from_plain(kind, json.loads(content))
    result = find()
    if file is not None and _Room.left > 0:
        _Room.left -= 1
        try:
            keep(file, json.dumps(to_plain(result)).encode())
            make_room(file.parent, _SUFFIX, _MOST, _MOST_BYTES)
        except OSError:  # a folder that cannot be written is not tried again
            _Room.left = 0
    return result


def _file(about: tuple[Any, ...]) -> Path | None:
    """File of a question; None where nothing is kept of it."""
    if os.environ.get(SWITCH) == ANEW:
        return None
    told = [each.canonical_json() if isinstance(each, Value) else repr(each) for each in about]
    if any(f'"{CONTENT_KEY}"' in each for each in told):
        return None
    name = hashlib.sha256("\n".join([_code(), *told]).encode()).hexdigest()
    return cache_root() / "pilots" / name[:2] / (name[2:] + _SUFFIX)


@lru_cache(maxsize=1)
def _code() -> str:
    return f"{package_digest(*_ABOVE)} {arithmetic()}"


def to_plain(result: Any) -> Any:
    """Return a result as JSON knows it; every number keeps its bits."""
    if isinstance(result, np.ndarray):
        whole = np.ascontiguousarray(result)
        return [whole.dtype.str, result.shape, base64.b64encode(whole.tobytes()).decode()]
    if is_dataclass(result):
        return [to_plain(getattr(result, each.name)) for each in fields(result)]
    if isinstance(result, tuple):
        return [to_plain(each) for each in result]
    return result.item() if isinstance(result, np.generic) else result


def from_plain(kind: Any, plain: Any) -> Any:
    """Return the result of a type that :func:`to_plain` wrote; nobody can write into its arrays."""
    parts = get_args(kind)
    if get_origin(kind) is UnionType:
        return None if plain is None else from_plain(next(part for part in parts if part is not NoneType), plain)
    if get_origin(kind) is tuple:
        each = parts[:1] * len(plain) if parts[-1] is ... else parts
        return tuple(from_plain(part, one) for part, one in zip(each, plain, strict=True))
    if kind is np.ndarray:
        dtype, shape, content = plain
        return read_only(np.frombuffer(base64.b64decode(content), dtype).reshape(shape))
    if is_dataclass(kind):
        hints = get_type_hints(kind)
        given = {each.name: one for each, one in zip(fields(kind), plain, strict=True)}
        return kind(**{name: from_plain(hints[name], one) for name, one in given.items()})  # type: ignore[operator]
    return plain
