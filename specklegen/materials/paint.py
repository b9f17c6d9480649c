"""White paint: crystals of rutile in a resin, taken for spheres, by Mie theory."""

from specklegen.materials import indices
from specklegen.materials.preset import Checked, Number, Optics, Preset
from specklegen.materials.suspensions import lognormal, suspension

_CROWDED = "McNeil and French, Acta Materialia 48, 4571 (2000)"


def make(
    wavelength: float, micrometre: float, *, volume_fraction: float, radius: float, variation: float, resin: float
) -> Optics:
    """Optics of a film of paint."""
    pigment = lognormal(radius, variation).filling(volume_fraction)
    parts = ((pigment, indices.rutile(wavelength) / resin),)
    scattering, absorption, scatterer = suspension(parts, wavelength / resin)
    return Optics(scatterer, scattering, absorption, resin)


PAINT = Preset(
    "tio2-paint", "white paint: titanium dioxide (rutile) in resin, by Mie theory", (indices.RUTILE[0], 1.2),
    {
        "volume_fraction": Number(0.01, 0.001, 0.01, "", "share of the volume that the pigment fills; paint has "
                                  "0.1 to 0.2", f"Independent up to about 1 %: {_CROWDED}, abstract", Checked.SOURCE),
        "radius": Number(0.125, 0.1, 0.15, "micrometres", "mean of the pigment by volume",
                         "Ground to scatter green light best", Checked.ASSUMED),
        "variation": Number(0.3, 0.2, 0.4, "", "standard deviation of the radius over its mean",
                            "No source", Checked.ASSUMED),
        "resin": Number(1.5, 1.45, 1.55, "", "refractive index of the resin", "Usual binders", Checked.ASSUMED),
    },
    ("Devore, Journal of the Optical Society of America 41, 416 (1951): rutile, coefficients read in a data base",
     "Thiele and French, Journal of the American Ceramic Society 81, 469 (1998): the mean index serves as well as the "
     "mean of both cross-sections, read in the abstract",
     _CROWDED + ": read in the abstract"),
    make, "Above 1 % of pigment neighbors act on each other, and real paint scatters less than this. PercusYevick "
    "would add that their places depend on each other, not that their near fields do.",
)  # fmt: skip
