"""Henyey-Greenstein scattering: density and sampling on the sphere and on the circle.

``rho(cos) = (1 - g^2) / (4 pi (1 + g^2 - 2 g cos)^(3/2))``, s = sqrt(rho), integral of |s|^2 = 1; in flatland
``rho(cos) = (1 - g^2) / (2 pi (1 + g^2 - 2 g cos))``; g is the mean cosine in both.
"""

import math

from specklegen.kernels import inlined
from specklegen.kernels.arithmetic import fma, power_minus_three_quarters

_FOUR_PI = 4.0 * math.pi
_TWO_PI = 2.0 * math.pi


@inlined
def _base(g, cos):
    """Return ``1 + g^2 - 2 g cos``, without its cancellation at g -> 1 and g -> -1."""
    if g < 0.0:
        return (1.0 + g) * (1.0 + g) - 2.0 * g * (1.0 + cos)
    return (1.0 - g) * (1.0 - g) + 2.0 * g * (1.0 - cos)


@inlined
def henyey_greenstein(g, cos):
    """Phase function per steradian at the cosine of the scattering angle, g in (-1, 1)."""
    base = _base(g, cos)
    return (1.0 - g * g) / (_FOUR_PI * base * math.sqrt(base))


@inlined
def amplitude(g, cos):
    """Root of :func:`henyey_greenstein`, of arithmetic that vectorises."""
    forward, backward = fma(2.0 * g, 1.0 - cos, (1.0 - g) * (1.0 - g)), fma(-2.0 * g, 1.0 + cos, (1.0 + g) * (1.0 + g))
    base = forward if g > 0.0 else backward  # as in _base, without its cancellation
    return math.sqrt((1.0 - g * g) / _FOUR_PI) * power_minus_three_quarters(base)


@inlined
def sample_henyey_greenstein(g, u):
    """Return ``1 - cos`` of a scattering angle, from u in ``(0, 1)``.

    With ``d = 1 - g + 2 g u`` and ``s = (1 - g^2)/d``, ``1 - cos = (1 - g)(1 - u)(s + 1 - g)/d``: exact at g = 0 and
    free of cancellation towards g = 1, where the textbook form loses four digits. Below g = -0.9 the mirrored phase
    function is drawn, which is as precise about the backward direction.
    """
    h = -g if g < -0.9 else g
    inverse = 1.0 / (1.0 - h + 2.0 * h * u)
    one_minus_cos = (1.0 - h) * (1.0 - u) * ((1.0 - h * h) * inverse + 1.0 - h) * inverse
    return 2.0 - one_minus_cos if g < -0.9 else one_minus_cos


@inlined
def henyey_greenstein_2d(g, cos):
    """Phase function per radian in flatland at the cosine of the scattering angle, g in (-1, 1)."""
    return (1.0 - g * g) / (_TWO_PI * _base(g, cos))


@inlined
def sample_henyey_greenstein_2d(g, u):
    """Return ``1 - cos`` of a scattering angle in flatland, from u in ``(0, 1)``.

    ``tan(theta / 2) = (1 - g)/(1 + g) tan(pi u / 2)`` as the ratio of two numbers that are both precise:
    ``1 - cos = 2 a^2 / (a^2 + b^2)``, ``a = (1 - g) sin``, ``b = (1 + g) cos``.
    """
    a = (1.0 - g) * math.sin(0.5 * math.pi * u)
    b = (1.0 + g) * math.cos(0.5 * math.pi * u)
    return 2.0 * a * a / (a * a + b * b)
