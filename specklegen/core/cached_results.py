"""Results of pure functions of values, cached on disk: what is dear to compute and short to write down.

A file is named by the function, the values that it is given, its sources, the versions of libraries and the processor.
It holds a line of JSON and the bytes of arrays, every number to its last bit, so that a process that reads it goes on
as one that computes the result itself. Values that hold a part of a user's own are not cached, for its code may change
while its name stays.
"""

import io
import json
from collections.abc import Callable
from dataclasses import fields, is_dataclass
from math import prod
from pathlib import Path
from types import NoneType, UnionType
from typing import Any, BinaryIO, TypeVar, get_args, get_origin, get_type_hints

import numpy as np

from specklegen.core.libraries import arithmetic
from specklegen.core.values import CONTENT_KEY, Value
from specklegen.disk_cache import folder_of, name_of, read, source_digest, write

Result = TypeVar("Result")


def cached_result(kind: Any, about: tuple[Any, ...], compute: Callable[[], Result], folder: str = "pilots") -> Result:
    """Return the result of a pure function, read from the cache on disk, or computed now and written there.

    Parameters
    ----------
    kind
        Its type: number, text, truth value, array, or a tuple or dataclass of these; "or None" of any.
    about
        What decides it: the name of the function, and the values, numbers and texts that it is given.
    compute
        Computes it. The sources are the file in which this function stands and all that it imports.
    folder
        One of :data:`specklegen.disk_cache.LIMITS`.
    """
    name = file_name(about, Path(compute.__code__.co_filename)) if folder_of(folder) else None
    content = read(folder, name) if name else None
    if content is not None:
        return unpacked(kind, content)
    result = compute()
    if name:
        write(folder, name, packed(result))
    return result


def file_name(about: tuple[Any, ...], source: Path) -> str | None:
    """Return the name of a result's file; None where it is not cached."""
    texts = [part.canonical_json() if isinstance(part, Value) else repr(part) for part in about]
    if any(f'"{CONTENT_KEY}"' in text for text in texts):
        return None
    return name_of(source_digest(source), arithmetic(), *texts)


def packed(result: Any) -> bytes:
    """Return a result as bytes; every number keeps its bits."""
    arrays = io.BytesIO()
    return json.dumps(_plain(result, arrays)).encode() + b"\n" + arrays.getvalue()


def unpacked(kind: Any, content: bytes) -> Any:
    """Return the result of a type that :func:`packed` wrote; nobody can write into its arrays."""
    stream = io.BytesIO(content)
    return _typed(kind, json.loads(stream.readline()), stream)


def _plain(result: Any, arrays: BinaryIO) -> Any:
    """Return a result as JSON knows it; the bytes of its arrays are written one after another."""
    if isinstance(result, np.ndarray):
        arrays.write(np.ascontiguousarray(result).tobytes())
        return [result.dtype.str, result.shape]
    if is_dataclass(result):
        return [_plain(getattr(result, field.name), arrays) for field in fields(result)]
    if isinstance(result, tuple):
        return [_plain(part, arrays) for part in result]
    return result.item() if isinstance(result, np.generic) else result


def _typed(kind: Any, plain: Any, arrays: BinaryIO) -> Any:
    """Return the result of a type; its arrays are read in the order in which they were written."""
    parts = get_args(kind)
    if get_origin(kind) is UnionType:
        return None if plain is None else _typed(next(part for part in parts if part is not NoneType), plain, arrays)
    if get_origin(kind) is tuple:
        kinds = parts[:1] * len(plain) if parts[-1] is ... else parts
        return tuple(_typed(part, value, arrays) for part, value in zip(kinds, plain, strict=True))
    if kind is np.ndarray:
        dtype, shape = np.dtype(plain[0]), plain[1]
        return np.frombuffer(arrays.read(dtype.itemsize * prod(shape)), dtype).reshape(shape)
    if is_dataclass(kind):
        hints = get_type_hints(kind)
        values = zip(fields(kind), plain, strict=True)
        return kind(**{field.name: _typed(hints[field.name], value, arrays) for field, value in values})  # type: ignore[operator]
    return plain
