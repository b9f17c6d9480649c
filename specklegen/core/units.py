"""Quantities as people write them, ``"5 mm"``, ``"0.8 deg"`` or ``"200 um/s"``, and the dimension of a number.

A field says its dimension in its annotation, and nothing else says it: ``thickness: Annotated[Positive, LENGTH]``.
What follows from it for the texts and numbers of a table or a call: :mod:`specklegen.core.quantities`.
"""

import math
import re
from dataclasses import dataclass
from typing import Any, Literal, NamedTuple

METRES = {"nm": 1e-9, "um": 1e-6, "µm": 1e-6, "μm": 1e-6, "mm": 1e-3, "cm": 1e-2, "m": 1.0}
"""Units of length, in metres."""
SECONDS = {"ns": 1e-9, "us": 1e-6, "µs": 1e-6, "μs": 1e-6, "ms": 1e-3, "s": 1.0}
"""Units of time, in seconds."""
RADIANS = {"rad": 1.0, "mrad": 1e-3, "urad": 1e-6, "deg": math.pi / 180, "°": math.pi / 180}
"""Units of angle, in radians."""
LIGHT = 0.15e-6, 25e-6
"""Wavelengths of light, metres, by which a wavelength tells the unit of a bench."""
NEAR_LIGHT = 0.2e-6, 20e-6
"""Wavelengths, metres, that are accepted without a unit beside a part that has a physical scale."""

_SUPERSCRIPTS = str.maketrans({"⁻": "-", "¹": "1", "²": "2", "³": "3"})
_NUMBER = re.compile(r"\s*([+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)\s*(.*?)\s*", re.DOTALL)
_FACTOR = re.compile(r"\s*([/*·]?)\s*(1|[^\W\d_]+|°)(?:\^?(-?\d))?")


@dataclass(frozen=True)
class Dimension:
    """Dimension of a number: powers of length and time, or an angle.

    Parameters
    ----------
    length, time
        Powers.
    angle
        "radians", "degrees" or "sine": what a bare number of an angle is; empty of all else.
    light
        Whether it is a wavelength of light, which tells the unit of a bare number.
    metres
        Metres in the unit of a bare number, where that is the same in every scene; by default the scene decides.
    scaled
        Whether fingerprints that no unit changes (:mod:`specklegen.scene.unitless`) divide it by a length. They are
        seeds of pilots, so that lengths which they left as they are in data version 7 stay left.
    """

    length: int = 0
    time: int = 0
    angle: Literal["", "radians", "degrees", "sine"] = ""
    light: bool = False
    metres: float | None = None
    scaled: bool = True

    @property
    def unit(self) -> str:
        """Usual unit, as "um^2/s"."""
        if self.angle:
            return "deg"
        names = {metres: name for name, metres in reversed(METRES.items())}
        length = names.get(self.metres or 1e-6, "um") if self != LENGTH else "mm"
        powers = [(length, self.length), ("s", self.time)]
        above = "*".join(_power(name, power) for name, power in powers if power > 0)
        below = "".join(f"/{_power(name, -power)}" for name, power in powers if power < 0)
        return (above or "1") + below

    @property
    def rule(self) -> str:
        """Words for a text of this dimension."""
        if self.angle:
            bare = "a direction sine" if self.angle == "sine" else f"a number in {self.angle}"
            return f"{bare}, or an angle in {', '.join(RADIANS)}"
        if self == NUMBER:
            return "a plain number, without a unit"
        names = {(1, 0): f'a length in {", ".join(METRES)}, such as "0.5 mm"',
                 (0, 1): f'a time in {", ".join(SECONDS)}, such as "0.5 ms"'}  # fmt: skip
        return names.get((self.length, self.time), f'a quantity such as "5 {self.unit}"')

    def example(self, value: Any) -> str:
        """Return a text with a unit for a number without one."""
        number = f"{value:g}" if isinstance(value, int | float) and math.isfinite(value) else "5"
        unit = "um" if self.light else self.unit
        return f'"{number}{unit.removeprefix("1") if unit.startswith("1/") else " " + unit}"'

    def __get_pydantic_json_schema__(self, core: Any, handler: Any) -> dict[str, Any]:
        """Describe a number, or a text with a unit."""
        return {"anyOf": [handler(core), {"type": "string", "pattern": r"^\s*[-+.\d]"}]}


LENGTH, WAVELENGTH = Dimension(1), Dimension(1, light=True)
OTHER_LENGTH = Dimension(1, scaled=False)
"""A length that fingerprints without a unit leave as it is."""
AREA, INVERSE_LENGTH = Dimension(2), Dimension(-1)
VELOCITY, DIFFUSION = Dimension(1, -1), Dimension(2, -1)
TIME, RATE = Dimension(0, 1, scaled=False), Dimension(0, -1, scaled=False)
SINE, RADIAN, DEGREE = (Dimension(angle=angle, scaled=False) for angle in ("sine", "radians", "degrees"))
NUMBER = Dimension()
"""A number without a unit, such as a component of a unit vector."""
MICROMETRES = Dimension(1, light=True, metres=1e-6)
"""A wavelength in vacuum that is in micrometres where it has no unit."""
MILLIMETRES = Dimension(1, metres=1e-3)
"""A length of an apparatus, which is in millimetres where it has no unit."""
UNIT = Dimension(1, metres=1.0)
"""Metres in the unit of length of the table that holds it."""


class Quantity(NamedTuple):
    """A number with a unit: its value in metres, seconds and radians, and its powers of them."""

    value: float
    length: int = 0
    time: int = 0
    angle: int = 0

    def of(self, dimension: Dimension) -> bool:
        """Return whether the quantity has a dimension."""
        return (self.length, self.time, self.angle) == (dimension.length, dimension.time, int(bool(dimension.angle)))

    def number(self, dimension: Dimension, metres: float) -> float:
        """Return the plain number, in a unit of so many metres; lengths and times rounded to twelve digits."""
        if dimension.angle == "sine":
            return math.sin(self.value)
        if dimension.angle == "radians":
            return self.value
        unit = math.pi / 180 if dimension.angle else (dimension.metres or metres) ** self.length
        return float(f"{self.value / unit:.12g}")


_UNITS: dict[str, tuple[float, int, int, int]] = (
    {name: (metres, 1, 0, 0) for name, metres in METRES.items()}
    | {name: (1e-6, 1, 0, 0) for name in ("micrometre", "micrometres")}
    | {name: (seconds, 0, 1, 0) for name, seconds in SECONDS.items()}
    | {name: (radians, 0, 0, 1) for name, radians in RADIANS.items()}
    | {name: (hertz, 0, -1, 0) for name, hertz in (("Hz", 1.0), ("kHz", 1e3), ("MHz", 1e6), ("GHz", 1e9))}
    | {"1": (1.0, 0, 0, 0)}
)


def quantity(text: str) -> Quantity | None:
    """Read a number with a unit, such as ``"5 mm"``, ``"200 um/s"`` or ``"1/mm"``; None where a text is none."""
    match = _NUMBER.fullmatch(text)
    if match is None or not match[2]:
        return None
    units, at, result = match[2].translate(_SUPERSCRIPTS), 0, Quantity(1.0)
    while at < len(units):
        factor = _FACTOR.match(units, at)
        if factor is None or factor[2] not in _UNITS or (at > 0 and not factor[1]):
            return None
        power = int(factor[3] or 1) * (-1 if factor[1] == "/" else 1)
        size, *powers = _UNITS[factor[2]]
        lengths, times, angles = (old + power * new for old, new in zip(result[1:], powers, strict=True))
        result, at = Quantity(result.value * size**power, lengths, times, angles), factor.end()
    return result._replace(value=float(match[1]) * result.value)


def unit_of(wavelength: object) -> float | None:
    """Metres in the unit of length in which a number is a wavelength of light; None where it is none in any."""
    if isinstance(wavelength, int | float) and not isinstance(wavelength, bool):
        for unit in (1e-9, 1e-6, 1e-3, 1.0):
            if LIGHT[0] <= wavelength * unit <= LIGHT[1]:
                return unit
    return None


def _power(name: str, power: int) -> str:
    return name if power == 1 else f"{name}^{power}"
