"""Short texts of results: what they hold and how large it is, not the numbers themselves."""

from collections.abc import Iterable, Sequence
from dataclasses import fields
from operator import attrgetter
from typing import Any

from specklegen.core.errors import counted


def summary(owner: object, names: Iterable[str] = (), **others: Any) -> str:
    """Write ``Owner(name=value, ...)`` on one line; an array by its type and shape: ``complex64[5, 101, 101]``.

    Of attributes by their names, as ``report.paths``, and of other values.
    """
    values = {name.rpartition(".")[2]: attrgetter(name)(owner) for name in names} | others
    return f"{type(owner).__name__}({', '.join(f'{name}={_short(value)}' for name, value in values.items())})"


def short(self: Any) -> str:
    """``__repr__`` of a dataclass or a named tuple that holds arrays or tensors: its :func:`summary`."""
    return summary(self, shown(self))


def shown(value: Any) -> Sequence[str]:
    """Names of the fields of a dataclass or a named tuple that its line shows."""
    return value._fields if isinstance(value, tuple) else [field.name for field in fields(value) if field.repr]


def _short(value: Any) -> str:
    if hasattr(value, "dtype") and getattr(value, "shape", ()):  # of NumPy or torch
        return f"{str(value.dtype).removeprefix('torch.')}[{', '.join(map(str, value.shape))}]"
    if isinstance(value, list):
        return f"[{', '.join(map(_short, value))}]"
    if isinstance(value, tuple) and any(isinstance(part, str) and " " in part for part in value):
        return f"<{counted(len(value), 'text')}>"
    return f"{value:.4g}" if isinstance(value, float) else repr(value)
