"""Fingerprints that no unit of length changes."""

import hashlib
import json
from typing import Any

from specklegen.core.values import IDENTITY, Value

_LENGTHS = {
    "wavelength": 1, "thickness": 1, "mean_free_path": 1, "width": 1, "radius": 1, "lower": 1, "upper": 1, "points": 1,
    "velocities": 1, "extinction": -1, "directions": 0,
}  # fmt: skip
"""Fields of scenes that are computed, and the power of length that they have. Other arrays are what a user gave."""


def unitless_fingerprint(value: Value, unit: float) -> str:
    """SHA-256 of a value with every length over ``unit``, to 9 digits: the same in any unit, on any processor.

    Sines are rounded as lengths are: where one was computed, its last bit is the processor's.
    """
    content = _unitless(value.model_dump(mode="json", context=IDENTITY), unit)
    return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()


def _unitless(content: Any, unit: float, power: int | None = None) -> Any:
    """JSON with every number rounded, and lengths by their power of the unit; motions decide no path."""
    if isinstance(content, dict):
        return {key: _unitless(value, unit, _LENGTHS.get(key)) for key, value in content.items() if key != "motion"}
    if isinstance(content, list):
        if power is None and isinstance(next(iter(content), None), float):  # millions of pixels stay as they are
            return content
        return [_unitless(value, unit, power) for value in content]
    if isinstance(content, float) or power:
        return float(f"{content / unit ** (power or 0):.9g}")
    return content
