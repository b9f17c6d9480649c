"""Milk: fat globules and casein micelles in water, by Mie theory.

The model is that of Frisvad, Christensen and Jensen, ACM Transactions on Graphics 26, 60 (2007): volumes from weights
by the densities of fat, casein and milk, casein a fixed share of the protein, volumes log-normal in the radius.
"""

from specklegen.materials import indices
from specklegen.materials.preset import Checked, Number, Optics, Preset
from specklegen.materials.suspensions import lognormal, suspension

_FRISVAD = "Frisvad, Christensen and Jensen, ACM Transactions on Graphics 26, 60 (2007)"
_CASEIN = 1.503
_GLOBULES, _MICELLES = 0.6, 0.4


def fat_index(wavelength: float) -> float:
    """Refractive index of milk fat, ``a + b / lambda^2`` through two measured wavelengths.

    Michalski, Briard and Michel, Lait 81, 787 (2001).
    """
    slope = (1.470 - 1.460) / (0.466**-2 - 0.633**-2)
    return 1.460 + slope * (wavelength**-2 - 0.633**-2)


def make(wavelength: float, micrometre: float, *, fat: float, protein: float, globule: float, micelle: float) -> Optics:
    """Optics of a milk of so many per cent by weight."""
    water = indices.water(wavelength)
    globules = lognormal(globule, _GLOBULES).filling(fat / 100 * 1.03 / 0.915)
    micelles = lognormal(micelle, _MICELLES).filling(0.76 * protein / 100 * 1.03 / 1.11)
    parts = ((globules, fat_index(wavelength) / water), (micelles, _CASEIN / water))
    scattering, absorption, scatterer = suspension(parts, wavelength / water)
    return Optics(scatterer, scattering, absorption, water)


MILK = Preset(
    "milk", "cow's milk: fat globules and casein micelles in water, by Mie theory", (0.4, 0.9),
    {
        "fat": Number(3.5, 0.1, 4.0, "% by weight", "0.1 is skimmed, 3.5 whole milk", "Any carton", Checked.ASSUMED),
        "protein": Number(3.3, 3.0, 3.6, "% by weight", "of which 0.76 is casein", "Any carton; " + _FRISVAD,
                          Checked.SECOND_HAND),
        "globule": Number(0.5, 0.3, 1.0, "micrometres", "mean radius of the fat globules by volume, homogenized",
                          "1 to 2 micrometres across: Malvern Instruments, application note on milk",
                          Checked.SECOND_HAND),
        "micelle": Number(0.043, 0.025, 0.075, "micrometres", "mean radius of the casein micelles by volume",
                          f"{_FRISVAD}; 50 to 250 nm across: Malvern Instruments; 150 nm on average: Hristov et al., "
                          "in Milk Proteins (2016)", Checked.NOT),
    },
    (_FRISVAD + ": model, densities, index 1.503 of casein, read in a program of its author",
     "Jensen, Marschner, Levoy and Hanrahan, SIGGRAPH (2001): mu_s (1 - g) of milk, 2.55 3.21 3.77 / mm of whole and "
     "0.70 1.22 1.90 of skimmed in red, green and blue, read in programs that cite it",
     "Michalski, Briard and Michel, Lait 81, 787 (2001): index of milk fat, read in the abstract"),
    make, "Relative widths of the radii, 0.6 and 0.4, are assumed; lactose and whey are left out of the index of "
    "water. mu_s (1 - g) is 3.7 to 5.6 / mm from 650 to 475 nm where whole milk was measured to have 2.6 to 3.8 (2.9 "
    "to 4.5 with globules of 1 micrometre), and 0.85 to 2.0 for the 0.7 to 1.9 of skimmed milk. "
    "Particles scatter independently: PercusYevick is of spheres of one size, which these are far from.",
)  # fmt: skip
