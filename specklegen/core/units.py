"""Lengths and angles as people write them: "5 mm", "3.45 um", "0.8 deg"."""

import math
import re
from collections.abc import Mapping
from typing import Any

from specklegen.core.errors import reject

METRES = {"nm": 1e-9, "um": 1e-6, "µm": 1e-6, "μm": 1e-6, "mm": 1e-3, "cm": 1e-2, "m": 1.0}
"""Units of length, in metres."""
RADIANS = {"rad": 1.0, "mrad": 1e-3, "urad": 1e-6, "deg": math.pi / 180, "°": math.pi / 180}
"""Units of angle, in radians."""
LIGHT = 0.15e-6, 25e-6
"""Wavelengths of light, metres."""
LAB_LENGTHS = (
    "wavelength", "object_distance", "object_extent", "aperture", "camera_distance", "focal_length", "pixel_pitch",
    "focus", "bandwidth",
)  # fmt: skip
"""Lengths of a laboratory."""
_WRITTEN = re.compile(r"\s*([+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)\s*([^\W\d_]+|°)\s*")


def metres_of(text: str) -> float | None:
    """A length in metres, of a text such as "5 mm"; None where the text is no number with a unit of length."""
    match = _WRITTEN.fullmatch(text)
    return float(match[1]) * METRES[match[2]] if match and match[2] in METRES else None


def sine_of(text: str) -> float | None:
    """The sine of an angle of a text such as "0.8 deg"; None where the text is no number with a unit of angle."""
    match = _WRITTEN.fullmatch(text)
    return math.sin(float(match[1]) * RADIANS[match[2]]) if match and match[2] in RADIANS else None


def length_in(text: str, metres: float) -> float | None:
    """A length in units of so many metres, rounded to twelve digits; None where the text is no length."""
    length = metres_of(text)
    return None if length is None else float(f"{length / metres:.12g}")


def unit_of(wavelength: object) -> float | None:
    """Metres in the unit of length in which a number is a wavelength of light; None where it is none in any."""
    if isinstance(wavelength, int | float) and not isinstance(wavelength, bool):
        for unit in (1e-9, 1e-6, 1e-3, 1.0):
            if LIGHT[0] <= wavelength * unit <= LIGHT[1]:
                return unit
    return None


def plain_lengths(owner: str, fields: Mapping[str, Any], names: tuple[str, ...]) -> dict[str, Any]:
    """Fields with numbers for lengths that are written with units.

    The unit is that of a wavelength that is a plain number, else the micrometre.
    """
    written = {name: value for name in names if isinstance(value := fields.get(name), str)}
    if not written:
        return dict(fields)
    wavelength = fields.get("wavelength")
    unit = 1e-6 if isinstance(wavelength, str) or wavelength is None else unit_of(wavelength)
    if unit is None:
        reject(f"{owner}.wavelength", "that of light, or written with its unit", wavelength)
    plain = [name for name in names if name != "wavelength" and isinstance(fields.get(name), int | float)]
    if isinstance(wavelength, str) and any(fields[name] for name in plain):
        name = next(name for name in plain if fields[name])
        reject(f"{owner}.{name}", 'written with its unit, such as "5 mm", where the wavelength is', fields[name])
    numbers = dict(fields)
    for name, text in written.items():
        value = length_in(text, unit)
        if value is None:
            reject(f"{owner}.{name}", f"a number, or a length in {', '.join(METRES)}", text)
        numbers[name] = value
    return numbers
