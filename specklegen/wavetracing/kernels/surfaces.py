"""Interaction of a ray with a surface: material rows, reflection probabilities, directions.

A row of materials is float64[4]: kind, Re and Im of the permittivity (the albedo of a diffuse surface in place of Re),
thickness in wavelengths; see `specklegen.wavetracing.materials` for the equations. Power is unpolarised.
"""

import cmath
import math

from specklegen.kernels import inlined

ABSORBER, CONDUCTOR, HALF_SPACE, WALL, DIFFUSE = 0, 1, 2, 3, 4
# Outcomes.
ABSORBED, REFLECTED, TRANSMITTED, SCATTERED = 0, 1, 2, 3


@inlined
def _interface(materials, row, cosine):
    """Reflection (TE, TM) of a half space, and x, the phase and loss of one passage through a wall (0 of none)."""
    eta = complex(materials[row, 1], materials[row, 2])
    q = cmath.sqrt(eta - (1.0 - cosine * cosine))
    if q.imag < 0.0:
        q = -q
    te = (cosine - q) / (cosine + q)
    tm = (eta * cosine - q) / (eta * cosine + q)
    if int(materials[row, 0]) != WALL:
        return te, tm, complex(0.0, 0.0)
    # cmath.exp of a large negative real part is 0: a thick lossy wall transmits nothing
    return te, tm, cmath.exp(complex(0.0, 2.0 * math.pi * materials[row, 3]) * q)


@inlined
def field_coefficients(materials, row, cosine):
    """Field reflection (TE, TM) at cos(theta) in [0, 1]; a black or diffuse surface has no image."""
    kind = int(materials[row, 0])
    if kind == CONDUCTOR:
        return complex(-1.0, 0.0), complex(1.0, 0.0)
    if kind == ABSORBER or kind == DIFFUSE:
        return complex(0.0, 0.0), complex(0.0, 0.0)
    te, tm, x = _interface(materials, row, cosine)
    return te * (1.0 - x * x) / (1.0 - te * te * x * x), tm * (1.0 - x * x) / (1.0 - tm * tm * x * x)


@inlined
def field_transmission(materials, row, cosine):
    """Field (TE, TM) that goes through a wall at cos(theta) in [0, 1], the phase of its thickness taken off."""
    te, tm, x = _interface(materials, row, cosine)
    air = cmath.exp(complex(0.0, -2.0 * math.pi * materials[row, 3] * cosine))
    te, tm = (1.0 - te * te) * x / (1.0 - te * te * x * x), (1.0 - tm * tm) * x / (1.0 - tm * tm * x * x)
    return te * air, tm * air


@inlined
def power_coefficients(materials, row, cosine):
    """Shares (reflected, transmitted) of unpolarised power at cos(theta) in [0, 1] of a smooth surface."""
    te, tm, x = _interface(materials, row, cosine)
    reflected = transmitted = 0.0
    for n in range(2):
        r = te if n == 0 else tm
        below = 1.0 - r * r * x * x
        reflected += 0.5 * abs(r * (1.0 - x * x) / below) ** 2
        transmitted += 0.5 * abs((1.0 - r * r) * x / below) ** 2
    return reflected, transmitted


@inlined
def outcome(materials, row, cosine, u):
    """Outcome of an event, from one uniform u."""
    kind = int(materials[row, 0])
    if kind == ABSORBER:
        return ABSORBED
    if kind == CONDUCTOR:
        return REFLECTED
    if kind == DIFFUSE:
        return SCATTERED if u < materials[row, 1] else ABSORBED
    reflected, transmitted = power_coefficients(materials, row, cosine)
    if u < reflected:
        return REFLECTED
    return TRANSMITTED if u < reflected + transmitted else ABSORBED
