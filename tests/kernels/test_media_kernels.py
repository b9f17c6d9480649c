"""From the parameters of a slab to its mixture, half range and modes: kernels against the torch formulas."""

import numpy as np
import pytest
import torch

from specklegen.datasets.recipes.parts.atlas_batches import atlas_tables
from specklegen.synthesis import modes
from specklegen.synthesis.correlations import Mixtures
from specklegen.synthesis.fused import FORMS
from specklegen.synthesis.mixtures import half_range, mixture
from specklegen.synthesis.modes import Lattice

RNG = np.random.default_rng(5)
SLABS = 200
AGREEMENT = 1e-10
"""Sums of a hundred terms in another order differ by 1e-14; half ranges divide by differences of about 1e-4."""


def slabs():
    """Thickness, optical depth, g and albedo, float64[B, 4]: thin, thick, absorbing, forward, ends of the table."""
    drop = 10.0 ** RNG.uniform(-2, 0, SLABS)  # g from 0 to 0.99
    depth, loss = 10.0 ** RNG.uniform(-0.5, 1.8, SLABS), 10.0 ** RNG.uniform(-6, -1, SLABS)
    rows = np.stack([10.0 ** RNG.uniform(-3, 6, SLABS), depth, 1 - drop, np.exp(-loss)], -1)
    ends = [(1.0, 0.5, 0.99, 1.0), (1e4, 60.0, 0.99, 0.9), (1e-3, 0.5, 0.0, 1.0), (1.0, 1e4, 0.9, 1.0)]
    return torch.from_numpy(np.concatenate([rows, ends]))


def looked_up(form, own):
    tables = atlas_tables(torch.device("cpu"))
    return form(own, [*tables.axes], tables.shares, tables.table, tables.bounds, 0.02)


def test_mixtures_and_half_ranges_agree_with_the_torch_formula():
    own = slabs()
    found = looked_up(torch.ops.specklegen.slab_correlations, own)
    expected = looked_up(FORMS["slab_correlations"], own)
    assert torch.equal(found[3], expected[3])
    assert 50 < found[3].sum() < len(own)
    inside = found[3]
    for one, other in zip(found[:3], expected[:3], strict=True):
        np.testing.assert_allclose(one[inside], other[inside], rtol=AGREEMENT)
    half, known = half_range(*(part[inside] for part in found[:3]))
    expected_half, expected_known = FORMS["half_range"](*(part[inside] for part in found[:3]))
    assert torch.equal(known, expected_known)
    np.testing.assert_allclose(half[known], expected_half[known], rtol=1e-9)
    # An optical depth wrong by 1 % is caught in every slab.
    wrong = looked_up(FORMS["slab_correlations"], own * torch.tensor([1.0, 1.01, 1.0, 1.0], dtype=torch.float64))
    assert (abs(found[0] / wrong[0] - 1)[inside, 1:].amax(1) > 1e3 * AGREEMENT).all()


LATTICES = [((28, 28), 1), ((5, 9), 1), ((1, 12), 1), ((1, 1), 5), ((1, 1), 1), ((3, 4), 2)]


@pytest.mark.parametrize(("shape", "tilts"), LATTICES)
def test_modes_agree_with_the_torch_formula(shape, tilts):
    """Over objects a tenth to two memory-effect ranges wide, and tilts along any direction as far apart."""
    some = looked_up(torch.ops.specklegen.slab_correlations, slabs())
    at = torch.nonzero(some[3])[:40, 0]
    correlations = Mixtures(some[0][at], some[1][at], mixture)
    half, _ = half_range(correlations.radius, correlations.share, some[2][at])
    wide = half * torch.from_numpy(10 ** RNG.uniform(-1, 0.3, len(at)))
    base = torch.from_numpy(RNG.uniform(-1, 1, (len(at), tilts, 2))) * wide[:, None, None]
    lattice = Lattice(shape, wide / max(*shape, 2), base)
    degree = modes.first_degree(lattice.full)
    known = modes.memory(correlations, lattice)
    found, reach = modes._factored(known, lattice, degree, 0.01)
    expected, expected_reach = modes._expanded(modes.coefficients(known, lattice, degree), lattice, degree, 0.01)
    assert torch.equal(found.rank, expected.rank)
    np.testing.assert_allclose(reach, expected_reach, rtol=1e-12)
    for n, rank in enumerate(found.rank.tolist()):
        one = found.at([n])
        maps = one.maps(rank, torch.float64)[0]
        values = expected.at([n]).values(rank)[0].unflatten(0, (tilts, -1)).mT
        np.testing.assert_allclose(maps, values, atol=1e-6)
    # K wrong by 1 % off the diagonal is caught.
    wrong, _ = modes._expanded(0.99 * modes.coefficients(known, lattice, degree), lattice, degree, 0.01)
    assert (wrong.columns[:, 0, 0] / found.columns[:, 0, 0] < 0.996).all()
