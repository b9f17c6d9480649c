"""Short texts of results: what they hold and how large it is, not the numbers themselves."""

from typing import Any

import numpy as np


def summary(owner: object, **fields: Any) -> str:
    """Write ``Owner(name=value, ...)`` on one line; an array by its type and shape: ``complex64[5, 101, 101]``."""
    return f"{type(owner).__name__}({', '.join(f'{name}={_short(value)}' for name, value in fields.items())})"


def _short(value: Any) -> str:
    if isinstance(value, np.ndarray):
        return f"{value.dtype}[{', '.join(map(str, value.shape))}]"
    return f"{value:.4g}" if isinstance(value, float) else repr(value)
