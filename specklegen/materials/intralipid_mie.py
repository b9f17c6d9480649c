"""Intralipid as what it is, droplets of soybean oil in water, by Mie theory.

    n(d) proportional to e^(-d / length) up to a largest diameter

That is the form which Michels, Foschum and Kienle, Optics Express 16, 5907 (2008), found for six emulsions. Length and
largest diameter are fitted here to their mu_s and g of ``Intralipid-20 %`` (their tables 3 and 4). That was at five
wavelengths from 400 to 900 nm; the volume of oil and phospholipid being that of the recipe. Their own largest diameter
comes out within 0.5 %. Their slopes (table 2) do only if multiplied by about 2.15, for each of the six emulsions, so
that theirs is not the slope of this formula. The mean diameter by number, 0.11 micrometres, is near that of van
Staveren et al., Applied Optics 30, 4507 (1991), who saw 0.097 in an electron microscope.
"""

from specklegen.materials import indices
from specklegen.materials.preset import Checked, Number, Optics, Preset
from specklegen.materials.suspensions import exponential, suspension

_MICHELS = "Michels, Foschum and Kienle, Optics Express 16, 5907 (2008)"
_DROPLETS = 200 / 920 + 12 / 1030
"""Share of the undiluted emulsion: 200 g of oil and 12 g of phospholipid a litre (ibid., table 1), of .92 and 1.03."""


_CONTRAST = 0.14
"""Index of soybean oil less that of water, the same at all wavelengths in the formulas of Michels et al."""


def make(wavelength: float, micrometre: float, *, dilution: float, length: float, largest: float) -> Optics:  # noqa: ARG001
    """Optics of a dilution of Intralipid-20 %."""
    water = indices.water(wavelength)
    droplets = exponential(length, largest).filling(dilution * _DROPLETS)
    scattering, _, scatterer = suspension(((droplets, (water + _CONTRAST) / water),), wavelength / water)
    return Optics(scatterer, scattering, 0.0, water)


INTRALIPID_MIE = Preset(
    "intralipid-mie", "fat emulsion Intralipid-20 %, diluted with water: oil droplets, by Mie theory", (0.4, 0.9),
    {
        "dilution": Number(0.05, 0.005, 0.1, "", "volume of Intralipid-20 % in the volume of the mixture; 0.05 is 1 % "
                           "fat", "A choice of the user", Checked.ASSUMED),
        "length": Number(0.1114, 0.091, 0.138, "micrometres", "of diameter, over which droplets become e times fewer; "
                         "the ends are those of ClinOleic and Lipovenoes of 20 %, fitted alike",
                         f"Fitted to mu_s and g of {_MICHELS}", Checked.SOURCE),
        "largest": Number(0.472, 0.472, 0.531, "micrometres", "largest diameter; printed as 0.4739, of the others as "
                          "0.5133 and 0.5494", f"Fitted to mu_s and g of {_MICHELS}", Checked.SOURCE),
    },
    (_MICHELS + ": tables 1 to 4 read in the source, the indices in a program that cites it; its equation of the sizes "
     "was not at hand",
     "van Staveren et al., Applied Optics 30, 4507 (1991): mean diameter, and that Mie theory holds within 6 %"),
    make, "Droplets scatter independently here: above a tenth they screen each other. The absorption of water is left "
    "out.",
)  # fmt: skip
