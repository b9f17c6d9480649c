"""The atlas looked up for a batch of slabs: kernels and half ranges are those that it gives one by one."""

import numpy as np
import pytest
import torch

from specklegen.datasets.recipes.parts.atlas_batches import atlas_tables, correlations
from specklegen.datasets.recipes.parts.material import Material
from specklegen.memory_effects.atlas import atlas_correlation, load
from specklegen.memory_effects.correlation import MemoryEffectCorrelation
from specklegen.scene.scatterers import HenyeyGreenstein
from specklegen.synthesis.fused import FORMS
from specklegen.synthesis.mixtures import half_range


def slab_of(thickness, depth, g, albedo):
    return Material.slab(thickness, depth, albedo, HenyeyGreenstein(g=g))


def slabs():
    """Ends and inside of the atlas, and slabs outside it."""
    made = [(1000.0, 10.0, 0.9, 1.0), (300.0, 3.0, 0.7, 1.0), (1500.0, 20.0, 0.95, 1.0), (800.0, 5.3, 0.83, 0.97),
            (4000.0, 0.2, 0.99, 1.0), (1000.0, 10.0, -0.5, 1.0), (1000.0, 1e4, 0.9, 1.0)]  # fmt: skip
    return made, torch.tensor(made, dtype=torch.float64)


@pytest.mark.parametrize("tolerance", [0.02, 0.0])
def test_kernels_and_half_ranges_are_those_of_the_atlas(tolerance):
    made, tensor = slabs()
    found = correlations(atlas_tables(torch.device("cpu")), *tensor.unbind(-1), tolerance)
    half, known = half_range(found.radius, found.share, found.single)
    by_form, _ = FORMS["half_range"](found.radius, found.share, found.single)
    inside = torch.tensor([load().place(slab_of(*numbers)) is not None for numbers in made])
    assert 3 < inside.sum() < len(made)
    np.testing.assert_allclose(half[inside], by_form[inside], rtol=1e-12)
    assert known[inside].all()
    for n, numbers in enumerate(made):
        kernel = atlas_correlation(slab_of(*numbers), tolerance)
        assert (kernel is not None) == bool(found.served[n])
        if kernel is None:
            continue
        np.testing.assert_allclose(found.radius[n], kernel.radius, rtol=1e-12)
        np.testing.assert_allclose(found.share[n], kernel.weights[0] / kernel.weights.sum(), rtol=1e-12)
        assert float(found.single[n]) == pytest.approx(kernel.single_share, rel=1e-12)
        assert float(half[n]) == pytest.approx(kernel.half_range(), rel=1e-11)
        # The interpolation is off by some 1e-6, the step of Newton by the square of that.
        assert kernel(kernel.half_range()) ** 2 == pytest.approx(0.5 + 0.5 * kernel.single_share**2, rel=1e-11)
    assert found.served.tolist() == [tolerance > 0 and atlas_correlation(slab_of(*m), tolerance) is not None
                                     for m in made]  # fmt: skip
    assert load().place(slab_of(*made[-1])) is None


def test_singly_scattered_light_has_no_half_range():
    radius, share = torch.tensor([[0.0, 1.0]], dtype=torch.float64), torch.tensor([[1.0, 1e-15]], dtype=torch.float64)
    _, known = half_range(radius, share, torch.ones(1, dtype=torch.float64))
    assert not known.any()
    single = MemoryEffectCorrelation(radius[0].numpy(), share.numpy(), 1, 1.0)
    assert single.half_range() == np.inf
