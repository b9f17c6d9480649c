"""Fingerprints that no unit of length changes."""

import hashlib
import json
from typing import Any

from specklegen.core.values import Value

_LENGTHS = {
    "wavelength": 1, "thickness": 1, "mean_free_path": 1, "width": 1, "radius": 1, "lower": 1, "upper": 1, "points": 1,
    "velocities": 1, "extinction": -1,
}  # fmt: skip
"""Fields of scenes with a dimension, and the power of length that it is."""


def unitless_fingerprint(value: Value, unit: float) -> str:
    """SHA-256 of a value with every length over ``unit``, to 9 digits: the same in any unit of length.

    Numbers without a dimension are taken whole. A sine that was computed from lengths may differ in its last bit.
    """
    content = _unitless(value.model_dump(mode="json"), unit)
    return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()


def _unitless(content: Any, unit: float, power: int = 0) -> Any:
    """JSON with every field of ``_LENGTHS`` divided by its power of the unit, and rounded; motions decide no path."""
    if isinstance(content, dict):
        return {key: _unitless(value, unit, _LENGTHS.get(key, 0)) for key, value in content.items() if key != "motion"}
    if isinstance(content, list):
        if not power and isinstance(next(iter(content), None), float):  # millions of pixels stay as they are
            return content
        return [_unitless(value, unit, power) for value in content]
    return float(f"{content / unit**power:.9g}") if power else content
