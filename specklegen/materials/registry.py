"""Presets by name."""

from collections.abc import Iterable
from typing import Annotated

import numpy as np

from specklegen.core.arguments import choice, positive_number, real_number
from specklegen.core.errors import reject, warn_user
from specklegen.core.quantities import Like, Mark, Node, marked, unit_remedy, with_units
from specklegen.core.random_streams import Seed, Stream, stream_key
from specklegen.core.units import MICROMETRES, NEAR_LIGHT, UNIT
from specklegen.materials.fog import FOG
from specklegen.materials.ground_glass import GROUND_GLASS
from specklegen.materials.intralipid import INTRALIPID
from specklegen.materials.intralipid_mie import INTRALIPID_MIE
from specklegen.materials.milk import MILK
from specklegen.materials.paint import PAINT
from specklegen.materials.preset import BulkMaterial, Preset
from specklegen.materials.spheres import POLYSTYRENE, SILICA
from specklegen.materials.tissue import BONE, BRAIN, DERMIS, EPIDERMIS, FAT, MUSCLE, SKIN
from specklegen.scene.screens import GroundGlass

PRESETS: dict[str, Preset] = {
    preset.name: preset
    for preset in (
        POLYSTYRENE, SILICA, INTRALIPID, INTRALIPID_MIE, MILK, SKIN, EPIDERMIS, DERMIS, FAT,
        BRAIN, BONE, MUSCLE, FOG, PAINT, GROUND_GLASS,
    )
}  # fmt: skip


NUMBERS = {name: Node(number.dimension) for preset in PRESETS.values() for name, number in preset.numbers.items()}
"""Dimensions of the numbers of all presets; where two have a number of one name, its unit is the same."""


def names() -> list[str]:
    """Names of all presets."""
    return sorted(PRESETS)


def about(name: str) -> Preset:
    """Record of a preset: its numbers, their ranges, where they come from and how far that was checked; print it.

    Parameters
    ----------
    name
        One of ``list()``.
    """
    return PRESETS[choice("materials name", name, names())]


@with_units
def get(
    name: str, wavelength: Annotated[float, MICROMETRES], *, unit: Annotated[float, UNIT] = 1e-6,
    lobe: str | None = None, **numbers: Annotated[float, Like(NUMBERS)],
) -> BulkMaterial | GroundGlass:  # fmt: skip
    """A material by its name.

    Parameters
    ----------
    name
        One of ``list()``.
    wavelength
        In vacuum, micrometres.
    unit
        Metres in the unit of length of what is returned; micrometres by default.
    lobe
        Family of the phase functions that a g belongs to, one of ``about(name).lobes``; the first by default.
    **numbers
        Of the preset, in the units that ``about(name)`` states; what is left out has its default.

    Returns
    -------
    BulkMaterial or GroundGlass
        A bulk, with scatterer, mean free path, albedo, refractive index and the wavelength inside; or a thin medium.

    Raises
    ------
    RuleError
        If there is no such preset or number, the wavelength is beyond its formulas, a number that is known at other
        wavelengths alone is left out, or one is given beside those that it is computed from.

    Warns
    -----
    DoubtWarning
        Where a number lies outside the range of the literature.
    """
    preset = about(name)
    wavelength = known_wavelength(name, wavelength)
    unit = positive_number("materials.get unit", unit)
    for field, value in numbers.items():
        if field not in preset.numbers:
            reject(f"materials.get({name!r})", f"given numbers of {', '.join(preset.numbers)}", field)
        known = preset.numbers[field]
        if not 0 <= real_number(f"materials.get({name!r}) {field}", value) < np.inf:
            reject(f"materials.get({name!r}) {field}", "a finite number of at least 0", value)
        if known.holds(wavelength) and not known.low <= value <= known.high:
            warn_user(f"materials.get({name!r}) {field} = {value:g} lies outside {known.low:g} to {known.high:g}: "
                      f"{known.source}.")  # fmt: skip
        if idle := numbers.keys() & set(known.computed_from):
            reject(f"materials.get({name!r}) {field}", f"left out if {min(idle)} is given", value,
                   f"It is computed from {', '.join(known.computed_from)}, or given.")  # fmt: skip
    require_measured(name, wavelength, numbers)
    given = {field: number.default for field, number in preset.left_open(numbers).items()} | numbers
    micrometre = 1e-6 / unit
    family = {} if lobe is None else {"lobe": known_lobe(name, lobe)}
    material = preset.make(wavelength, micrometre, **given, **family)
    if isinstance(material, GroundGlass):
        return material
    extinction = material.scattering + material.absorption
    if not extinction > 0:
        reject(f"materials.get({name!r})", "given numbers with which it scatters light", given)
    scatterer = marked(material.scatterer.model_copy(), Mark(unit))  # which says the unit of all that is made of it
    return BulkMaterial(name=name, scatterer=scatterer, mean_free_path=micrometre / extinction,
                        albedo=material.scattering / extinction, refractive_index=material.refractive_index,
                        wavelength=wavelength * micrometre / material.refractive_index)  # fmt: skip


def known_wavelength(name: str, wavelength: float) -> float:
    """Return a vacuum wavelength at which a preset is known, micrometres."""
    low, high = about(name).wavelengths
    if not low <= real_number(f"materials.get({name!r}) wavelength", wavelength) <= high:
        remedy = "" if NEAR_LIGHT[0] <= wavelength * 1e-6 <= NEAR_LIGHT[1] else unit_remedy(wavelength, 1e-6)
        reject(f"materials.get({name!r}) wavelength", f"{low:g} to {high:g} micrometres, in vacuum", wavelength, remedy)
    return float(wavelength)


def known_lobe(name: str, lobe: str) -> str:
    """Return a family of phase functions that a preset may have."""
    lobes = about(name).lobes
    if not lobes:
        reject(f"materials.get({name!r}) lobe", "left out, since its particles determine the phase function", lobe)
    return choice(f"materials.get({name!r}) lobe", lobe, lobes)


def require_measured(name: str, wavelength: float, given: Iterable[str]) -> None:
    """Refuse to take a number of a preset, or its range, at wavelengths at which it is not known."""
    for field, number in about(name).numbers.items():
        if field not in given and not number.holds(wavelength):
            low, high = number.band
            reject(
                f"materials.get({name!r}) {field}", f"given outside {low:g} to {high:g} micrometres", None,
                f"Its default is {number.meaning}, which is not tabulated at {wavelength:g} micrometres. Give {field}= "
                f"({number.unit}) as it was measured there.",
            )  # fmt: skip


@with_units
def draw(
    name: str, wavelength: Annotated[float, MICROMETRES], *, seed: Seed, unit: Annotated[float, UNIT] = 1e-6,
    lobe: str | None = None, **numbers: Annotated[float, Like(NUMBERS)],
) -> BulkMaterial | GroundGlass:  # fmt: skip
    """A material by its name, what is not given drawn evenly from the ranges of the literature.

    A family of phase functions is drawn as well, where a material may have several.

    Parameters
    ----------
    name
        One of ``list()``.
    wavelength
        In vacuum, micrometres.
    seed
        A whole number, or a sequence of them: another one draws another material.
    unit
        Metres in the unit of length of what is returned; micrometres by default.
    lobe
        Family of the phase functions, one of ``about(name).lobes``, where it is known.
    **numbers
        What is known, in the units that ``about(name)`` states; all else is drawn.
    """
    require_measured(name, known_wavelength(name, wavelength), numbers)
    rng = np.random.default_rng(stream_key(seed, Stream.MATERIALS))
    spread = {field: number.drawn(rng) for field, number in about(name).left_open(()).items()}
    kept = about(name).left_open(numbers)
    lobes = about(name).lobes
    if lobes and lobe is None:
        lobe = lobes[int(rng.integers(len(lobes)))]
    return get(name, wavelength, unit=unit, lobe=lobe, **({field: spread[field] for field in kept} | numbers))
