"""Electric-field Monte Carlo: the uncorrelated comparison.

Xu (2004) and Sawicki and others (2008) add the field of every photon with a phase of its own at every
pixel. Intensities come out right; pixels, tilts and everything else are uncorrelated. [Bar19] Figs. 9, 11.
"""

import numpy as np

from specklegen.oracles.box_algorithms import Setup, add_up, contributions


def electric_field(setup: Setup, paths: int, realizations: int, rng: np.random.Generator) -> np.ndarray:
    """Fields complex128[realizations, P] with E|u_p|^2 = C_pp and E[u_p u_q*] = 0 for p != q."""
    field = np.zeros((realizations, setup.pairs), np.complex128)
    for part in contributions(setup, paths * realizations, rng, reverse=False, drawn=True):
        phases = np.exp(2j * np.pi * rng.random(part.amplitude.shape))  # one for every pair
        field += add_up(part.path, phases * np.sqrt(part.weight) * part.amplitude, paths, realizations)
    return field / np.sqrt(paths)
