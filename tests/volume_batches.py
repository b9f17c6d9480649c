"""Independent batches of the general engine and of the box oracle, and their comparison."""

import numpy as np
from zscore import assert_z

from specklegen.oracles import box_algorithms as oracle
from specklegen.paths.endpoint_factors import multiple_amplitudes, single_amplitudes
from specklegen.paths.tracer import volume_tracer

BATCHES = 64


def engine_batches(scene, paths, *, reverse, seed=1, parts=False):
    """Covariance complex128[64, TV, TV] of ``paths`` paths each; with ``parts`` [64, 2, ...], single and multiple."""
    tracer = volume_tracer(scene, reverse)
    found = []
    for b in range(BATCHES):
        bank = tracer.trace(seed, paths, first=b * paths, threads=1)
        once = single_amplitudes(tracer.layout, bank.single)
        more = multiple_amplitudes(tracer.layout, bank.multiple, bidirectional=tracer.bidirectional, reverse=reverse)
        found.append([a @ a.conj().T / paths for a in (once, more)])
    found = np.array(found)
    return found if parts else found.sum(axis=1)


def oracle_batches(setup, paths, *, reverse, seed=2):
    """Covariance complex128[64, TV, TV] by the literal algorithms."""
    seeds = np.random.SeedSequence(seed).spawn(BATCHES)
    return np.array([oracle.covariance(setup, paths, np.random.default_rng(s), reverse=reverse) for s in seeds])


def oracle_parts(setup, paths, *, reverse, seed=2):
    """The same, single and multiple scattering apart: complex128[64, 2, TV, TV]."""
    found = np.zeros((BATCHES, 2, setup.pairs, setup.pairs), np.complex128)
    for batch, words in zip(found, np.random.SeedSequence(seed).spawn(BATCHES), strict=True):
        for some in oracle.contributions(setup, paths, np.random.default_rng(words), reverse=reverse):
            batch[int(some.order > 1)] += (some.weight * some.amplitude) @ some.amplitude.conj().T / paths
    return found


def intensities(batches):
    """float64[64, TV], the diagonals."""
    return np.diagonal(batches, axis1=-2, axis2=-1).real


def real_parts(values):
    """Real and imaginary parts side by side along the last axis."""
    return np.concatenate([values.real, values.imag], axis=-1) if np.iscomplexobj(values) else values


def z_scores(first, second):
    """Welch's z of the means over two stacks of batches, real and imaginary parts; 0 where both agree to rounding."""
    first, second = real_parts(np.asarray(first)), real_parts(np.asarray(second))
    error = np.sqrt(first.var(0, ddof=1) / len(first) + second.var(0, ddof=1) / len(second))
    gap = np.array(np.abs(first.mean(0) - second.mean(0)))
    gap[gap <= 1e-12 * max(np.abs(first).max(initial=0), np.abs(second).max(initial=0))] = 0
    return np.divide(gap, error, out=np.zeros_like(gap), where=gap > 0)


def assert_same(first, second):
    """Means over batches agree: first the total intensity, then every entry."""
    if first.ndim == 3:
        totals = (intensities(part).sum(axis=1, keepdims=True) for part in (first, second))
        assert_z(z_scores(*totals), 0, 1, degrees=BATCHES - 1)
    assert_z(z_scores(first, second), 0, 1, degrees=BATCHES - 1)
