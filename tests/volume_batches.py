"""Independent batches of the general engine and of the box oracle, and their comparison."""

from functools import partial
from itertools import pairwise

import numpy as np
from zscore import assert_z

from specklegen.oracles import box_algorithms as oracle
from specklegen.paths.endpoint_factors import multiple_amplitudes, single_amplitudes
from specklegen.paths.tracer import volume_tracer

BATCHES = 64


def engine_batches(scene, paths, *, reverse, seed=1, parts=False):
    """Covariance complex128[64, TV, TV] of ``paths`` paths each; with ``parts`` [64, 2, ...], single and multiple."""
    tracer, found = volume_tracer(scene, reverse), []
    bank = tracer.trace(seed, BATCHES * paths, threads=1)
    options = {"bidirectional": tracer.bidirectional, "reverse": reverse}
    multiple = partial(multiple_amplitudes, **options)
    for some, amplitudes in ((bank.single, single_amplitudes), (bank.multiple, multiple)):
        found.append(by_batch(some.paths, paths, amplitudes(tracer.layout, some)))
    return np.stack(found, axis=1) if parts else sum(found)


def by_batch(numbers, paths, amplitudes, weights=1.0, count=BATCHES):
    """Covariances of so many paths each, complex128[count, P, P], of amplitudes [P, n] and the paths they belong to.

    Where both ways of a path stand side by side, [P, 2 n], both count."""
    ends = np.searchsorted(numbers, paths * np.arange(count + 1))  # connections come in the order of their paths
    found = np.zeros((count, len(amplitudes), len(amplitudes)), np.complex128)
    for first in range(0, amplitudes.shape[1], max(1, len(numbers))):
        some = amplitudes[:, first : first + len(numbers)]
        weighted, conjugate = some * weights, some.conj()
        found += [weighted[:, a:b] @ conjugate[:, a:b].T for a, b in pairwise(ends)]
    return found / paths


def oracle_batches(setup, paths, *, reverse, seed=2):
    """Covariance complex128[64, TV, TV] by the literal algorithms."""
    return oracle_parts(setup, paths, reverse=reverse, seed=seed).sum(axis=1)


def oracle_parts(setup, paths, *, reverse, seed=2):
    """The same, single and multiple scattering apart: complex128[64, 2, TV, TV]; batches walk together."""
    found = np.zeros((BATCHES, 2, setup.pairs, setup.pairs), np.complex128)
    count = min(BATCHES, 2 ** int(np.log2(max(1, 16_384 // paths))))
    seeds = np.random.SeedSequence(seed).spawn(BATCHES // count)
    for first, words in zip(range(0, BATCHES, count), seeds, strict=True):
        for some in oracle.contributions(setup, count * paths, np.random.default_rng(words), reverse=reverse):
            part = found[first : first + count, int(some.order > 1)]
            part += by_batch(some.path, paths, some.amplitude, some.weight, count)
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
