"""Intralipid, the fat emulsion of most phantoms.

    mu_s = 3.873e8 lambda^-2.397 / mm,      g = 1.090 - 6.812e-4 lambda,      lambda in nanometres, of Intralipid-20 %

Michels, Foschum and Kienle, Optics Express 16, 5907 (2008), tables 3 and 4, undiluted and as if its droplets scattered
independently; a dilution by volume takes its share. Its mu_s (1 - g) per mm lies within 2 % of what Di Ninni, Martelli
and Zaccanti found for nine batches (Physics in Medicine and Biology 56, N21 (2011)):

    wavelength      632.8 nm    751 nm    833 nm
    here            25.5        20.9      18.5
    nine batches    25.9        21.2      18.4
"""

from specklegen.materials import indices
from specklegen.materials.lobes import LOBES, lobe_of
from specklegen.materials.preset import Checked, Number, Optics, Preset


def make(wavelength: float, micrometre: float, *, dilution: float, lobe: str = LOBES[0]) -> Optics:
    """Optics of a dilution of Intralipid-20 %."""
    nanometres = 1000 * wavelength
    scattering = dilution * 3.873e8 * nanometres**-2.397 / 1000
    g = 1.090 - 6.812e-4 * nanometres
    return Optics(lobe_of(lobe, g), scattering, 0.0, indices.water(wavelength))


INTRALIPID = Preset(
    "intralipid", "fat emulsion Intralipid-20 %, diluted with water", (0.4, 0.9),
    {"dilution": Number(0.05, 0.005, 0.1, "", "volume of Intralipid-20 % in the volume of the mixture; 0.05 is 1 % fat",
                        "A choice of the user", Checked.ASSUMED)},
    ("Michels, Foschum and Kienle, Optics Express 16, 5907 (2008), tables 3 and 4: read in the source",
     "Di Ninni, Martelli and Zaccanti, Physics in Medicine and Biology 56, N21 (2011): reduced scattering within 2 %",
     "van Staveren et al., Applied Optics 30, 4507 (1991), for Intralipid-10 %: mu_s = 16 lambda^-2.4 / mm, "
     "g = 1.1 - 0.58 lambda, lambda in micrometres (read in works that cite it): for the same fat 28 % more mu_s at "
     "633 nm and the same mu_s (1 - g) within 1 %"),
    make, "Phase functions of the measured g from a chosen family; intralipid-mie has those of the droplets. The "
    "absorption of water is left out; above a tenth the droplets screen each other.", LOBES,
)  # fmt: skip
