"""Electric-field Monte Carlo: the uncorrelated comparison.

Xu (2004) and Sawicki and others (2008) add the field of every photon with a phase of its own at every
pixel. Intensities come out right; pixels, tilts and everything else are uncorrelated. [Bar19] Figs. 9, 11.
"""

import numpy as np

from specklegen.oracles import algorithms, box_algorithms


def electric_field(
    pairs: algorithms.Pairs | box_algorithms.Setup, paths: int, realizations: int, rng: np.random.Generator
) -> np.ndarray:
    """Fields complex128[realizations, P] with E|u_p|^2 = C_pp and E[u_p u_q*] = 0 for p != q."""
    if isinstance(pairs, box_algorithms.Setup):
        parts = box_algorithms.contributions(pairs, paths * realizations, rng, reverse=False, drawn=True)
        parts = ((part.path, part.weight, part.amplitude) for part in parts)
        field = np.zeros((realizations, pairs.pairs), np.complex128)
    else:
        parts = algorithms.contributions(pairs, paths * realizations, rng, reverse=False)
        field = np.zeros((realizations, len(pairs.lights)), np.complex128)
    for path, weight, amplitude in parts:
        phases = np.exp(2j * np.pi * rng.random(amplitude.shape))  # one for every pair
        field += box_algorithms.add_up(path, phases * np.sqrt(weight) * amplitude, paths, realizations)
    return field / np.sqrt(paths)
