"""Short texts of results: what they hold and how large it is, not the numbers themselves."""

from dataclasses import fields
from typing import Any


def summary(owner: object, **fields: Any) -> str:
    """Write ``Owner(name=value, ...)`` on one line; an array by its type and shape: ``complex64[5, 101, 101]``."""
    return f"{type(owner).__name__}({', '.join(f'{name}={_short(value)}' for name, value in fields.items())})"


def short(self: Any) -> str:
    """``__repr__`` of a dataclass or a named tuple that holds arrays or tensors: its :func:`summary`."""
    names = self._fields if isinstance(self, tuple) else [field.name for field in fields(self) if field.repr]
    return summary(self, **{name: getattr(self, name) for name in names})


def _short(value: Any) -> str:
    if hasattr(value, "dtype") and getattr(value, "shape", ()):  # of NumPy or torch
        return f"{str(value.dtype).removeprefix('torch.')}[{', '.join(map(str, value.shape))}]"
    return f"{value:.4g}" if isinstance(value, float) else repr(value)
