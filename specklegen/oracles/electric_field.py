"""Electric-field Monte Carlo: the uncorrelated comparison.

Xu (2004) and Sawicki and others (2008) add the field of every photon with a phase of its own at every
pixel. Intensities come out right; pixels, tilts and everything else are uncorrelated. [Bar19] Figs. 9, 11.
"""

import numpy as np

from specklegen.oracles.algorithms import Pairs, contributions


def electric_field(pairs: Pairs, paths: int, realizations: int, rng: np.random.Generator) -> np.ndarray:
    """Fields complex128[realizations, P] with E|u_p|^2 = C_pp and E[u_p u_q*] = 0 for p != q."""
    field = np.zeros((realizations, len(pairs.lights)), np.complex128)
    for path, weight, amplitude in contributions(pairs, paths * realizations, rng, reverse=False):
        phases = np.exp(2j * np.pi * rng.random(amplitude.shape))  # one for every pair
        np.add.at(field, path // paths, (phases * np.sqrt(weight) * amplitude).T)
    return field / np.sqrt(paths)
