"""Tissues, by the review of Jacques: ``mu_s (1 - g) = a (lambda / 500 nm)^-b``, ``n = 1.514 - (1.514 - 1.33) W``.

S. L. Jacques, Physics in Medicine and Biology 58, R37 (2013), Eqs. 1 and 3; a and b of table 2 with one standard
deviation either way, W the share of water. The absorption is that of the shares of blood, water, fat and melanin
(:mod:`specklegen.materials.absorption`), from 0.4 to 1 micrometres; it may be given instead, and must be elsewhere.

Layers of skin scatter as ``mu_s (1 - g) = a [r (lambda / 500 nm)^-4 + (1 - r) (lambda / 500 nm)^-b]``, r the share of
Rayleigh scattering (ibid., Eq. 2).
"""

from collections.abc import Mapping

from specklegen.materials.absorption import BAND, FAT_BAND, of_tissue
from specklegen.materials.lobes import LOBES, lobe_of
from specklegen.materials.preset import Checked, Number, Optics, Preset

_JACQUES = "Jacques, Physics in Medicine and Biology 58, R37 (2013)"
_PARTS = ("blood", "oxygenation", "fat", "melanin")


def make(
    wavelength: float, micrometre: float, *, a: float, b: float, g: float, water: float,
    absorption: float | None = None, blood: float = 0.0, oxygenation: float = 0.0, fat: float = 0.0,
    melanin: float = 0.0, rayleigh: float = 0.0, lobe: str = LOBES[0],
) -> Optics:  # fmt: skip
    """Optics of a tissue."""
    x = wavelength / 0.5
    reduced = a * 1e-4 * (rayleigh * x**-4 + (1 - rayleigh) * x**-b)  # 1 / cm to 1 / micrometre
    if absorption is None:
        absorption = of_tissue(wavelength, blood_share=blood, oxygenation=oxygenation, water_share=water, fat_share=fat,
                               melanin_share=melanin)  # fmt: skip
    return Optics(lobe_of(lobe, g), reduced / (1 - g), absorption / 1000, 1.514 - (1.514 - 1.33) * water)


def _absorbing(numbers: Mapping[str, Number]) -> Mapping[str, Number]:
    """Add the absorption to the numbers of a tissue."""
    parts = tuple(name for name in _PARTS if name in numbers)
    description = f"that of {', '.join(name for name in parts if name != 'oxygenation')} and water"
    return dict(numbers) | {
        "absorption": Number(None, 0.0, float("inf"), "1 / mm", description, "The tables of data/absorption.txt",
                             Checked.SECOND_HAND, band=FAT_BAND if "fat" in parts else BAND, computed_from=parts),
    }  # fmt: skip


_OXYGENATION = Number(0.75, 0.4, 0.98, "", "share of haemoglobin with oxygen: between that of veins and of arteries",
                      "A choice of the user", Checked.ASSUMED)  # fmt: skip


def _numbers(
    a: tuple[float, float, float], b: tuple[float, float, float], water: tuple[float, float, float],
    blood: tuple[float, float, float], *, from_water: str, checked: Checked = Checked.SOURCE,
    g: Number | None = None, table: str = "table 2, mean and standard deviation",
) -> Mapping[str, Number]:  # fmt: skip
    return _absorbing({
        "a": Number(*a, "1 / cm", "mu_s (1 - g) at 500 nm", f"{_JACQUES}, {table}", Checked.SOURCE),
        "b": Number(*b, "", "power of the wavelength", f"{_JACQUES}, {table}", Checked.SOURCE),
        "g": g or Number(0.9, 0.85, 0.95, "", "anisotropy, hardly known: figure 8 spreads at least so far",
                         _JACQUES, Checked.SOURCE),
        "water": Number(*water, "", "share of water, which gives the refractive index, and absorbs", from_water,
                        checked),
        "blood": Number(*blood, "", "share of whole blood, 150 g of haemoglobin a litre", f"{_JACQUES}, table 3",
                        Checked.SOURCE),
        "oxygenation": _OXYGENATION,
    })  # fmt: skip


def _tissue(name: str, summary: str, numbers: Mapping[str, Number], *more: str, doubts: str = "") -> Preset:
    left_out = (
        "Phase functions of one of two families; those of tissues lie between them at small angles. Fat, bilirubin "
        "and what else "
        "absorbs beside blood and water are left out."
    )
    references = (_JACQUES + ": read in the source", *more)
    return Preset(name, summary, (0.4, 1.3), numbers, references, make, f"{left_out} {doubts}".strip(), LOBES)


SKIN = _tissue(
    "skin", "skin, dermis and epidermis together",
    _numbers((46.0, 32.3, 59.7), (1.421, 0.904, 1.938), (0.65, 0.2, 0.7), (0.0041, 0.0005, 0.0157),
             from_water=f"{_JACQUES}, table 3, dermis and whole skin"),
    doubts="Melanin of the epidermis is left out.",
)  # fmt: skip

BRAIN = _tissue(
    "brain", "brain",
    _numbers((24.2, 12.5, 35.9), (1.611, 0.548, 2.674), (0.8, 0.7, 0.8), (0.03, 0.0142, 0.0375),
             from_water="Gray matter .8, white matter .7: Biswas and Luu (2011)", checked=Checked.SECOND_HAND),
    "Biswas and Luu (2011), as cited by Jacques and in a data set of refractive indices of the brain",
    doubts="White matter scatters several times as much as gray, and less once it is cut out.",
)  # fmt: skip

BONE = _tissue(
    "bone", "bone and skull",
    _numbers((22.9, 8.3, 37.5), (0.716, 0.034, 1.398), (0.19, 0.12, 0.25), (0.0136, 0.0136, 0.03),
             from_water="Timmins and Wall, Calcified Tissue Research 23, 1 (1977)", checked=Checked.SECOND_HAND),
    "Timmins and Wall, Calcified Tissue Research 23, 1 (1977): read in a program that cites it",
    doubts="Three skulls and bones in all, of 9.5 to 38.4 / cm; the index by the share of water is an extrapolation.",
)  # fmt: skip

MUSCLE = _tissue(
    "muscle", "muscle",
    _numbers((13.0, 9.8, 13.0), (0.926, 0.926, 2.82), (0.75, 0.7, 0.8), (0.0116, 0.0116, 0.0361),
             from_water="Water is some three quarters of muscle", checked=Checked.NOT,
             table="table 1, rows 29 (Tromberg 1996) and 40 (Alexandrakis et al. 2005)",
             g=Number(0.93, 0.9, 0.95, "", "anisotropy, measured from 650 to 800 nm, taken beyond",
                      "Bashkatov, Genina and Tuchin, Journal of Innovative Optical Health Sciences 4, 9 (2011), table "
                      "of muscle", Checked.SECOND_HAND)),
    "Bashkatov, Genina and Tuchin, J. Innovative Optical Health Sciences 4, 9 (2011): read in notes that cite it",
    doubts="Fibers, which scatter along and across differently, are left out.",
)  # fmt: skip

_CITED = "Jacques (2013), table 1, as cited in a program of Monte Carlo transport through skin"
_BASHKATOV = "Bashkatov, Genina, Kochubey and Tuchin, Journal of Physics D 38, 2543 (2005)"
_LEFT = "Its layers have no index: refraction between them is left out unless you give indices."


def _layer_of_skin(
    name: str, summary: str, scattering: tuple[float, float, float], source: str, held: Mapping[str, Number],
    doubts: str,
) -> Preset:  # fmt: skip
    """One layer of skin: (a, b, r) as they are cited, without a range, and what of its volume absorbs."""
    a, b, rayleigh = scattering
    numbers = _absorbing({
        "a": Number(a, a, a, "1 / cm", "mu_s (1 - g) at 500 nm", source, Checked.SECOND_HAND),
        "b": Number(b, b, b, "", "power of the wavelength", source, Checked.SECOND_HAND),
        "rayleigh": Number(rayleigh, rayleigh, rayleigh, "", "share of Rayleigh scattering at 500 nm", source,
                           Checked.SECOND_HAND),
        "g": Number(0.9, 0.85, 0.95, "", "anisotropy, hardly known: figure 8 spreads at least so far", _JACQUES,
                    Checked.SOURCE),
        **held,
    })  # fmt: skip
    return Preset(name, summary, (0.4, 1.3), numbers, (source,), make, f"{doubts} {_LEFT}".strip(), LOBES)


_WET = Number(0.65, 0.2, 0.7, "", "share of water, which gives the refractive index, and absorbs",
              f"{_JACQUES}, table 3, dermis and whole skin", Checked.SOURCE)  # fmt: skip

EPIDERMIS = _layer_of_skin(
    "epidermis", "the outer layer of skin, 0.06 mm thick in most models", (66.7, 0.689, 0.29), _CITED,
    {"water": _WET,
     "melanin": Number(0.03, 0.013, 0.43, "", "share of melanosomes: .013 to .063 in light skin, .18 to .43 in dark",
                       "Jacques, Skin optics (Oregon Medical Laser Center)", Checked.NOT)},
    "One kind of melanin.",
)  # fmt: skip

DERMIS = _layer_of_skin(
    "dermis", "the layer of skin below the epidermis, 1 to 2 mm thick", (43.6, 0.562, 0.41), _CITED,
    {"water": _WET,
     "blood": Number(0.0041, 0.0005, 0.0157, "", "share of whole blood, 150 g of haemoglobin a litre",
                     f"{_JACQUES}, table 3", Checked.SOURCE),
     "oxygenation": _OXYGENATION},
    "",
)  # fmt: skip

FAT = _layer_of_skin(
    "fat", "fat below the skin", (15.35, 0.68, 0.0),
    f"{_BASHKATOV}: 1050.6 lambda^-0.68 / cm, lambda in nanometres, as cited in the same program",
    {"water": Number(0.3, 0.1, 0.4, "", "stands for an index of 1.46, and absorbs", "A choice of the user",
                     Checked.ASSUMED),
     "fat": Number(0.7, 0.6, 0.9, "", "share of fat", "The rest of it but water", Checked.ASSUMED)},
    "Its blood is left out.",
)  # fmt: skip
