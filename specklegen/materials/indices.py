"""Refractive indices over vacuum wavelength in micrometres, by the formulas of their papers.

Each was compared with the coefficients of the public-domain data base refractiveindex.info (M. N. Polyanskiy,
Scientific Data 11, 94 (2024)).
"""

import math

WATER = (0.182, 1.129)
"""Where :func:`water` holds, micrometres; so below."""
CLEAR_WATER = 0.9
"""Up to where the absorption of water may be left out of a suspension, micrometres: below .007 / mm."""
POLYSTYRENE = (0.4368, 1.052)
SILICA = (0.21, 3.71)
RUTILE = (0.43, 1.53)


def sellmeier(wavelength: float, *terms: tuple[float, float]) -> float:
    """Index by Sellmeier's formula, ``n^2 = 1 + sum B lambda^2 / (lambda^2 - C)``."""
    square = wavelength**2
    return math.sqrt(1 + math.fsum(b * square / (square - c) for b, c in terms))


def water(wavelength: float) -> float:
    """Refractive index at 20 degrees Celsius: Daimon and Masumura, Applied Optics 46, 3811 (2007)."""
    return sellmeier(wavelength, (5.684027565e-1, 5.101829712e-3), (1.726177391e-1, 1.821153936e-2),
                     (2.086189578e-2, 2.620722293e-2), (1.130748688e-1, 1.069792721e1))  # fmt: skip


def polystyrene(wavelength: float) -> float:
    """Sultanova, Kasarova and Nikolov, Acta Physica Polonica A 116, 585 (2009)."""
    return sellmeier(wavelength, (1.4435, 0.020216))


def silica(wavelength: float) -> float:
    """Fused silica: Malitson, Journal of the Optical Society of America 55, 1205 (1965)."""
    return sellmeier(
        wavelength, (0.6961663, 0.0684043**2), (0.4079426, 0.1162414**2), (0.8974794, 9.896161**2)
    )  # fmt: skip


def rutile(wavelength: float) -> float:
    """Mean of two ordinary and one extraordinary index: Devore, J. Opt. Soc. Am. 41, 416 (1951).

    Crystals of pigment lie at random; neither this mean nor that of the cross-sections is exact (Thiele and French,
    Journal of the American Ceramic Society 81, 469 (1998)).
    """
    ordinary, extraordinary = (
        math.sqrt(a + b / (wavelength**2 - c)) for a, b, c in ((5.913, 0.2441, 0.0803), (7.197, 0.3322, 0.0843))
    )
    return (2 * ordinary + extraordinary) / 3
