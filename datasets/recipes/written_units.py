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
_PLAIN = (
    "optical_depth", "g", "albedo", "refractive_index", "index", "outside", "grit", "rms_phase", "concentration",
    "durations", "interval", "tau0", "correlation_time", "diffusion", "tissue_diffusion", "samples", "media", "frames",
    "count", "planes", "pixels_per_grain", "shape", "pixels", "extent_over_range", "tolerance", "mode_tolerance",
    "kernel_tolerance", "kernel_paths", "contrast", "dilution",
)  # fmt: skip
"""Fields of recipes that are neither a length nor an angle."""
_PIXELS = ("grain", "object_pixel", "shape", "profile")
_WIDTH = 5000.0  # micrometres; of a setup in pixels, whose directions alone are seen
_WAVELENGTH = 0.532


def plain(table: Mapping[str, Any]) -> tuple[dict[str, Any], dict[str, str]]:
    """A recipe's table in plain numbers, and what was written with a unit, by field."""
    fields = in_pixels(table)
    lab = fields.get("lab")
    if isinstance(lab, Mapping) and isinstance(lab.get("wavelength"), str):
        plain_lengths("LabSetup", lab, LAB_LENGTHS)  # refuses those without a unit
    written = {where: text for where, text in _texts(fields, ()) if _has_unit(text)}
    if not written:
        return fields, {}
    unit = _unit(fields)
    return _walked(fields, (), unit), {".".join(where): text for where, text in written.items()}


def told(error: RuleError, written: Mapping[str, str]) -> RuleError:
    """The error with what the user wrote for the fields that it names."""
    message = str(error)
    named = [f'{where} = "{text}"' for where, text in written.items() if where.rpartition(".")[2] in message]
    return RuleError(f"{message} Written: {', '.join(named)}.") if named else error


def in_pixels(table: Mapping[str, Any]) -> dict[str, Any]:
    """A recipe's table with window, camera and field for a table ``[pixels]``, where there is one."""
    fields = dict(table)
    if "pixels" not in fields or type(fields["pixels"]) is int:  # a number is a field of the kind's own: of a mask, say
        return fields
    given = fields.pop("pixels")
    if not isinstance(given, Mapping):
        reject("Recipe.pixels", "a table such as {grain = 3.0, object_pixel = 1.0, shape = [256, 256]}", given)
    unknown = [name for name in given if name not in _PIXELS]
    if unknown:
        reject("Pixels", f"given by {', '.join(_PIXELS)}", unknown[0])
    for name in ("grain", "object_pixel", "shape"):
        if name not in given:
            reject(f"Pixels.{name}", "given", "nothing", "In camera pixels; shape as [rows, columns].")
    also = [name for name in ("lab", "window", "camera", "field") if name in fields]
    if also:
        reject("Recipe.pixels", "left out where the setup is given in lengths", also, "Write one or the other.")
    grain, cell = (real_number(f"Pixels.{name}", given[name]) for name in ("grain", "object_pixel"))
    for name, value in (("grain", grain), ("object_pixel", cell)):
        if not 0 < value < 1e6:
            reject(f"Pixels.{name}", "greater than 0, in camera pixels", value)
    if grain < 2:
        reject("Pixels.grain", "at least 2 camera pixels", grain, "Finer speckle is undersampled: do not bin.")
    material: dict[str, Any] = dict(fields.get("material") or {"screens": [{"type": "GroundGlass", "angle": 0.26}]})
    if "screens" not in material or material.get("gaps"):
        reject("Recipe.material", "left out, or one thin screen, where the setup is given in pixels", sorted(material),
               "How far a slab remembers, in pixels, takes a [lab], or a measured C_I (reconstruct --memory-effect).",
        )  # fmt: skip
    material.setdefault("wavelength", _WAVELENGTH)
    wavelength = real_number("Material.wavelength", material["wavelength"])
    width = _WIDTH * wavelength / _WAVELENGTH
    camera = {"shape": given["shape"], "pixels_per_grain": grain}
    window = {"width": width, "profile": given.get("profile", "disc")}
    return fields | {
        "material": material, "window": window, "camera": camera,
        "field": {"pitch": cell * wavelength / width / grain},
    }  # fmt: skip


def rescaled(base: Mapping[str, Any], lab: Mapping[str, Any]) -> dict[str, Any]:
    """A recipe's tables in the unit of length that a laboratory's own wavelength tells, where it tells another one."""
    old = _unit_of_lengths(base.get("lab")) or _unit_of_lengths(base.get("material"))
    new = _unit_of_lengths(lab)
    if old is None or new is None or old == new:
        return dict(base)
    tables = {name: _rescaled(each, old / new) if name in _IN_LENGTHS else each for name, each in base.items()}
    if isinstance(tables.get("lab"), Mapping):
        tables["lab"] = {
            name: _scaled(each, old / new) if name in LAB_LENGTHS else each for name, each in tables["lab"].items()
        }
    return _rescaled({name: tables.pop(name) for name in _LENGTHS if name in tables}, old / new) | tables


_IN_LENGTHS = ("material", "dynamics", "exposures")
"""Tables of a recipe that hold lengths, beside those that a laboratory takes the place of."""
_LENGTHS = {name: 1 for name in (
    "thickness", "mean_free_path", "gaps", "correlation_length", "velocities", "coherence_length",
)} | {"diffusion": 2}  # fmt: skip
"""Fields that are powers of a length, in them or of the recipe, and which power."""


def _unit_of_lengths(table: Any) -> float | None:
    """Metres in a unit of length, by the wavelength of a table; written lengths come to micrometres."""
    wavelength = table.get("wavelength") if isinstance(table, Mapping) else None
    return 1e-6 if isinstance(wavelength, str) else unit_of(wavelength)


def _rescaled(value: Any, ratio: float) -> Any:
    if isinstance(value, list | tuple):
        return [_rescaled(each, ratio) for each in value]
    if not isinstance(value, Mapping):
        return value
    return {
        name: _scaled(each, ratio ** _LENGTHS[name]) if name in _LENGTHS
        else each if name == "scatterer" else _rescaled(each, ratio)
        for name, each in value.items()
    }  # fmt: skip


def _scaled(value: Any, ratio: float) -> Any:
    """A length times a ratio: a number, a distribution, or a list of them; rounded to twelve digits."""
    if isinstance(value, Mapping):
        return {name: _scaled(each, ratio) for name, each in value.items()}
    if isinstance(value, list | tuple):
        return [_scaled(each, ratio) for each in value]
    number = isinstance(value, int | float) and not isinstance(value, bool)
    return float(f"{value * ratio:.12g}") if number else value


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
            if not _is_text(where, name):
                yield from _texts(each, (*where, str(name)))
    elif isinstance(value, list | tuple):
        for each in value:
            yield from _texts(each, where)


def _is_text(where: tuple[str, ...], name: str) -> bool:
    """Whether a field holds words, among which "5deg" is four characters that are held out."""
    return name in _TEXTS or (where[:1] == ("objects",) and name in ("train", "validation", "test", "characters"))


def _has_unit(text: str) -> bool:
    return metres_of(text) is not None or sine_of(text) is not None


def _walked(value: Any, where: tuple[str, ...], unit: float) -> Any:
    if isinstance(value, str):
        return _number(value, where, unit) if _has_unit(value) else value
    if isinstance(value, Mapping):
        return {
            name: each if _is_text(where, name) else _walked(each, (*where, str(name)), unit)
            for name, each in value.items()
        }
    if isinstance(value, list | tuple):
        return [_walked(each, where, unit) for each in value]
    return value


def _number(text: str, where: tuple[str, ...], unit: float) -> float:
    field = ".".join(where)
    sine = sine_of(text)
    if any(name in _PLAIN for name in where):
        reject(field, "a plain number, which has no unit of length or angle", text)
    if where[:2] == ("light", "bandwidth"):
        reject(field, "a number, in wavenumber inside the medium", text, "[lab] takes a bandwidth as a length.")
    if sine is not None:
        if where[0] not in ("field", "tilts", "material", "view", "object"):
            reject(field, f"a length in {', '.join(METRES)}", text)
        return sine
    if where[0] == "field" or "angle" in where or ("aperture" in where and where[0] != "lab"):
        reject(field, f"a direction sine, or an angle in {', '.join(RADIANS)}", text)
    length = length_in(text, 1e-6 if where[-2:] == ("preset", "wavelength") else unit)
    assert length is not None
    return length
