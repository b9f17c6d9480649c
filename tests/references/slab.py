"""Closed forms for a slab of isotropic scatterers of albedo 1 at normal incidence, without steps of the index."""

import numpy as np

from specklegen.theory.slab import EXTRAPOLATION


def slab_transmission(optical_depth: float) -> float:
    """T = 1.6788 / (OD + 1.4208), total transmittance at normal incidence, ballistic light included. The numerator is
    H(1) / sqrt(3) of Chandrasekhar's H function. Within 0.2 % from an optical depth of 5 on; the diffusion
    approximation's 1.7104 is 1.9 % too high (physics.md 4)."""
    return 1.6788 / (optical_depth + 2 * EXTRAPOLATION)


def double_to_single(optical_depth: float) -> float:
    """Scattered power of order two over that of order one, OD/2 (ln(1/OD) + 0.92), for a thin infinite slab. The
    leading term in small optical depth; long grazing steps give the logarithm (physics.md 4)."""
    return 0.5 * optical_depth * (np.log(1 / optical_depth) + 0.92)
