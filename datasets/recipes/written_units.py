"""Recipes as people write them: lengths with units, and setups that are known in camera pixels alone.

What is written here becomes the plain numbers of a recipe before anything is checked, so that two ways of writing one
setup have one fingerprint.
"""

from collections.abc import Iterator, Mapping
from typing import Any

from specklegen.core.arguments import real_number
from specklegen.core.errors import RuleError, reject
from specklegen.core.units import LAB_LENGTHS, METRES, RADIANS, length_in, metres_of, plain_lengths, sine_of, unit_of

_TEXTS = ("name", "description", "kind", "type", "path", "inherits", "sampler", "exposure")
_PIXELS = ("grain", "object_pixel", "shape", "profile")
_WIDTH = 5000.0  # micrometres; of a setup in pixels, whose directions alone are seen
_WAVELENGTH = 0.532


def plain(table: Mapping[str, Any]) -> tuple[dict[str, Any], dict[str, str]]:
    """A recipe's table in plain numbers, and what was written with a unit, by field.

    Raises
    ------
    RuleError
        If a unit is none, or says of a field what it is not.
    """
    found = in_pixels(table)
    lab = found.get("lab")
    if isinstance(lab, Mapping) and isinstance(lab.get("wavelength"), str):
        plain_lengths("LabSetup", lab, LAB_LENGTHS)  # refuses those without a unit
    written = {where: text for where, text in _texts(found, ()) if _has_unit(text)}
    if not written:
        return found, {}
    unit = _unit(found)
    return _walked(found, (), unit), {".".join(where): text for where, text in written.items()}


def told(error: RuleError, written: Mapping[str, str]) -> RuleError:
    """The error with what the user wrote for the fields that it names."""
    message = str(error)
    named = [f'{where} = "{text}"' for where, text in written.items() if where.rpartition(".")[2] in message]
    return RuleError(f"{message} Written: {', '.join(named)}.") if named else error


def in_pixels(table: Mapping[str, Any]) -> dict[str, Any]:
    """A recipe's table with window, camera and field for a table ``[pixels]``, where there is one.

    Raises
    ------
    RuleError
        If a field of it is missing or unknown, or the setup is given in lengths too.
    """
    found = dict(table)
    if "pixels" not in found or type(found["pixels"]) is int:  # a number is a field of the kind's own: of a mask, say
        return found
    given = found.pop("pixels")
    if not isinstance(given, Mapping):
        reject("Recipe.pixels", "a table such as {grain = 3.0, object_pixel = 1.0, shape = [256, 256]}", given)
    unknown = [name for name in given if name not in _PIXELS]
    if unknown:
        reject("Pixels", f"given by {', '.join(_PIXELS)}", unknown[0])
    for name in ("grain", "object_pixel", "shape"):
        if name not in given:
            reject(f"Pixels.{name}", "given", "nothing", "In camera pixels; shape as [rows, columns].")
    also = [name for name in ("lab", "window", "camera", "field") if name in found]
    if also:
        reject("Recipe.pixels", "left out where the setup is given in lengths", also, "Write one or the other.")
    grain, cell = (real_number(f"Pixels.{name}", given[name]) for name in ("grain", "object_pixel"))
    for name, value in (("grain", grain), ("object_pixel", cell)):
        if not 0 < value < 1e6:
            reject(f"Pixels.{name}", "greater than 0, in camera pixels", value)
    if grain < 2:
        reject("Pixels.grain", "at least 2 camera pixels", grain, "Finer speckle is undersampled: do not bin.")
    material: dict[str, Any] = dict(found.get("material") or {"screens": [{"type": "GroundGlass", "angle": 0.26}]})
    if "screens" not in material or material.get("gaps"):
        reject("Recipe.material", "left out, or one thin screen, where the setup is given in pixels", sorted(material),
               "How far a slab remembers, in pixels, takes a [lab], or a measured C_I (reconstruct --memory-effect).",
        )  # fmt: skip
    material.setdefault("wavelength", _WAVELENGTH)
    wavelength = real_number("Material.wavelength", material["wavelength"])
    width = _WIDTH * wavelength / _WAVELENGTH
    camera = {"shape": given["shape"], "pixels_per_grain": grain}
    window = {"width": width, "profile": given.get("profile", "disc")}
    return found | {
        "material": material, "window": window, "camera": camera,
        "field": {"pitch": cell * wavelength / width / grain},
    }  # fmt: skip


def rescaled(material: Mapping[str, Any], lab: Mapping[str, Any]) -> dict[str, Any]:
    """A material's table in the unit of length of a laboratory that takes the place of its own wavelength."""
    own, wavelength = material.get("wavelength"), lab.get("wavelength")
    old, new = unit_of(own), 1e-6 if isinstance(wavelength, str) else unit_of(wavelength)
    if old is None or new is None or old == new:
        return dict(material)

    def scaled(value: Any) -> Any:
        if isinstance(value, Mapping):
            return {name: scaled(each) for name, each in value.items()}
        if isinstance(value, list | tuple):
            return [scaled(each) for each in value]
        number = isinstance(value, int | float) and not isinstance(value, bool)
        return float(f"{value * old / new:.12g}") if number else value

    found = {name: scaled(each) if name in _LENGTHS else each for name, each in material.items()}
    layers = found.get("layers")
    if isinstance(layers, list | tuple):
        found["layers"] = [
            {name: scaled(value) if name in _LENGTHS else value for name, value in each.items()}
            if isinstance(each, Mapping) else each for each in layers
        ]  # fmt: skip
    return found


_LENGTHS = ("thickness", "mean_free_path", "gaps")


def _unit(table: Mapping[str, Any]) -> float:
    """Metres in the unit of the plain numbers: that of a wavelength that is one, else the micrometre."""
    for name in ("lab", "material"):
        part = table.get(name)
        unit = unit_of(part.get("wavelength")) if isinstance(part, Mapping) else None
        if unit is not None:
            return unit
    material = table.get("material")
    preset = material.get("preset") if isinstance(material, Mapping) else None
    unit = preset.get("unit") if isinstance(preset, Mapping) else None
    return float(unit) if isinstance(unit, int | float) else 1e-6


def _texts(value: Any, where: tuple[str, ...]) -> Iterator[tuple[tuple[str, ...], str]]:
    if isinstance(value, str):
        yield where, value
    elif isinstance(value, Mapping):
        for name, each in value.items():
            if name not in _TEXTS:
                yield from _texts(each, (*where, str(name)))
    elif isinstance(value, list | tuple):
        for each in value:
            yield from _texts(each, where)


def _has_unit(text: str) -> bool:
    return metres_of(text) is not None or sine_of(text) is not None


def _walked(value: Any, where: tuple[str, ...], unit: float) -> Any:
    if isinstance(value, str):
        return _number(value, where, unit) if _has_unit(value) else value
    if isinstance(value, Mapping):
        return {
            name: each if name in _TEXTS else _walked(each, (*where, str(name)), unit) for name, each in value.items()
        }
    if isinstance(value, list | tuple):
        return [_walked(each, where, unit) for each in value]
    return value


def _number(text: str, where: tuple[str, ...], unit: float) -> float:
    field = ".".join(where)
    sine = sine_of(text)
    if where[:2] == ("light", "bandwidth"):
        reject(field, "a number, in wavenumber inside the medium", text, "[lab] takes a bandwidth as a length.")
    if sine is not None:
        if where[0] not in ("field", "tilts", "material", "view", "object"):
            reject(field, f"a length in {', '.join(METRES)}", text)
        return sine
    if where[0] == "field" or where[-1] == "angle":
        reject(field, f"a direction sine, or an angle in {', '.join(RADIANS)}", text)
    found = length_in(text, 1e-6 if where[-2:] == ("preset", "wavelength") else unit)
    assert found is not None
    return found
