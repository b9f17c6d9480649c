"""Absorption of blood, water, fat and melanin, and of a tissue that holds so much of each.

    mu_a = B [S blood(oxygenated) + (1 - S) blood(deoxygenated)] + W water + F fat + M melanosome

Jacques, Physics in Medicine and Biology 58, R37 (2013), section 2.3: shares of the volume. ``data/absorption.txt`` says
where its tables are from; haemoglobin ends at 1 micrometre.
"""

from collections.abc import Mapping
from functools import cache
from importlib.resources import files

import numpy as np

from specklegen.core.arguments import real_number
from specklegen.core.errors import reject

BAND = (0.4, 1.0)
"""Vacuum wavelengths at which all but fat is tabulated, micrometres."""
FAT_BAND = (0.43, 1.0)
HAEMOGLOBIN = 150.0
"""Grams in a litre of whole blood."""
_MOLAR_MASS = 64_500.0  # grams
_LN_10 = 2.303


@cache
def _tables() -> Mapping[str, np.ndarray]:
    text = (files("specklegen") / "data/absorption.txt").read_text(encoding="utf-8")
    columns = np.loadtxt(text.splitlines(), unpack=True)
    return dict(zip(("wavelength", "oxygenated", "deoxygenated", "water", "fat"), columns, strict=True))


def _at(name: str, wavelength: float, band: tuple[float, float]) -> float:
    low, high = band
    if not low <= real_number(f"absorption of {name}: wavelength", wavelength) <= high:
        reject(f"absorption of {name}: wavelength", f"{low:g} to {high:g} micrometres, in vacuum", wavelength)
    tables = _tables()
    known = ~np.isnan(tables[name])
    return float(np.exp(np.interp(1000 * wavelength, tables["wavelength"][known], np.log(tables[name][known]))))


def blood(wavelength: float, oxygenation: float) -> float:
    """Whole blood with 150 g of haemoglobin a litre, 1 / mm.

    Parameters
    ----------
    wavelength
        In vacuum, 0.4 to 1 micrometres.
    oxygenation
        Share of the haemoglobin that holds oxygen.
    """
    if not 0 <= real_number("absorption of blood: oxygenation", oxygenation) <= 1:
        reject("absorption of blood: oxygenation", "from 0 to 1", oxygenation)
    with_oxygen, without = (_at(name, wavelength, BAND) for name in ("oxygenated", "deoxygenated"))
    extinction = oxygenation * with_oxygen + (1 - oxygenation) * without
    return _LN_10 * extinction * HAEMOGLOBIN / _MOLAR_MASS / 10


def water(wavelength: float) -> float:
    """Absorption of water per mm, at 0.4 to 1 micrometres; RuleError elsewhere."""
    return _at("water", wavelength, BAND) / 10


def fat(wavelength: float) -> float:
    """Absorption of mammalian fat per mm, at 0.43 to 1 micrometres; RuleError elsewhere."""
    return _at("fat", wavelength, FAT_BAND) / 10


def melanosome(wavelength: float) -> float:
    """The inside of a melanosome, 1 / mm: 6.6e11 lambda^-3.33 / cm, lambda in nanometres.

    Jacques, Optical absorption of melanin (Oregon Medical Laser Center), as two programs of skin's colour cite it.
    """
    return 6.6e10 * (1000 * wavelength) ** -3.33


def of_tissue(
    wavelength: float, *, blood_share: float, oxygenation: float, water_share: float, fat_share: float,
    melanin_share: float,
) -> float:  # fmt: skip
    """Absorption of a tissue, 1 / mm, by the shares of its volume; what it does not hold is not looked up."""
    parts = (
        (blood_share, lambda: blood(wavelength, oxygenation)), (water_share, lambda: water(wavelength)),
        (fat_share, lambda: fat(wavelength)), (melanin_share, lambda: melanosome(wavelength)),
    )  # fmt: skip
    return float(sum(share * absorption() for share, absorption in parts if share > 0))
