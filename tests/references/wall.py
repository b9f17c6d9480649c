"""Reflection of a half space; reflection and transmission of a wall in air, the sum over its internal reflections."""

import numpy as np


def fresnel(permittivity: complex, cosine: np.ndarray | float) -> tuple[np.ndarray, np.ndarray]:
    """Return the field reflection coefficients (r_TE, r_TM) of a half space at cos(theta) in [0, 1]."""
    c = np.asarray(cosine, float)
    q = np.sqrt(np.asarray(permittivity - (1 - c * c), complex))
    q = np.where(q.imag < 0, -q, q)
    return (c - q) / (c + q), (permittivity * c - q) / (permittivity * c + q)


def wall_coefficients(
    permittivity: complex, thickness: float, wavelength: float, cosine: np.ndarray | float
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Return (R_TE, T_TE, R_TM, T_TM) of a wall in air; T includes the phase through the wall."""
    c = np.asarray(cosine, float)
    q = np.sqrt(np.asarray(permittivity - (1 - c * c), complex))
    q = np.where(q.imag < 0, -q, q)
    x = np.exp(2j * np.pi * thickness / wavelength * q)
    found = []
    for r in fresnel(permittivity, c):
        below = 1 - r * r * x * x
        found += [r * (1 - x * x) / below, (1 - r * r) * x / below]
    return found[0], found[1], found[2], found[3]
