"""Fog: drops of water in air, by Mie theory, as many as leave a given visibility.

    n(r) proportional to r^m e^(-Lambda r),      sigma_t = -ln(contrast) / V

Koschmieder's law: a black object is seen up to the visibility V by an eye that tells a contrast of 0.02 (3.912 / V);
the meteorological optical range is that of 0.05.
"""

import math

from specklegen.materials import indices
from specklegen.materials.preset import Checked, Number, Optics, Preset
from specklegen.materials.suspensions import modified_gamma, suspension

_AWAN = "Awan, Leitgeb, Marzuki and Plank, Radioengineering 19, 213 (2010)"


def make(
    wavelength: float, micrometre: float, *, visibility: float, power: float, slope: float, contrast: float
) -> Optics:
    """Optics of a fog, in air of index 1."""
    drops = ((modified_gamma(power, slope), indices.water(wavelength)),)
    scattering, absorption, scatterer = suspension(drops, wavelength)
    extinction = -math.log(contrast) / (visibility * 1e6)
    share = scattering / (scattering + absorption)
    return Optics(scatterer, extinction * share, extinction * (1 - share), 1.0)


FOG = Preset(
    "fog", "radiation fog: drops of water in air, by Mie theory, at a given visibility", indices.WATER,
    {
        "visibility": Number(200.0, 50.0, 1000.0, "m", "distance at which a black object is lost",
                             "A choice of the user; below 1 km it is fog", Checked.ASSUMED),
        "power": Number(6.135, 3.443, 8.827, "", "m of the radii, Graz; 5.288 in Prague", _AWAN, Checked.SOURCE),
        "slope": Number(3.547, 1.612, 5.882, "1 / micrometre", "Lambda of the radii, Graz; 5.882 in Prague", _AWAN,
                        Checked.SOURCE),
        "contrast": Number(0.02, 0.02, 0.05, "", "that an eye tells: 0.02 of Koschmieder, 0.05 of the "
                           "meteorological optical range",
                           "Glossary of the American Meteorological Society: visual-range formula",
                           Checked.SECOND_HAND),
    },
    (_AWAN + ": read in the abstract, as one event in Graz and one in Prague",
     "Daimon and Masumura, Applied Optics 46, 3811 (2007): water"),
    make, "Drops of advection fog are several times larger and scatter further forward: raise power / slope.",
)  # fmt: skip
