"""The image of an object as a linear map: the sampler's own images, and an adjoint that is one."""

import numpy as np
import pytest
import torch
from one_object import one_object

import specklegen as sg
from specklegen.memory_effects.correlation import estimate_correlation
from specklegen.synthesis.object_operator import ObjectOperator

SLAB = sg.Slab(thickness=1000.0, mean_free_path=100.0, scatterer=sg.HenyeyGreenstein(0.9))


@pytest.fixture(scope="module")
def sampler():
    """Two tilts, twelve by ten pixels, double precision: rounding is some 1e-15 of the largest term."""
    return one_object(estimate_correlation(SLAB, 500, 0), wavelength=0.5, object_shape=(10, 12), object_pitch=4e-6,
                      width=50_000.0, grid=sg.FarField.grid((16, 18), 4e-6), base=((0.0, 0.0), (2e-6, 0.0)),
                      dtype=torch.float64)  # fmt: skip


def operator_of(sampler, medium):
    return ObjectOperator(sampler.imaging, sampler.spectra(medium))


def test_it_is_what_the_sampler_images(sampler):
    """Both forms of the sampler agree with it; sums of some thousand terms, to 1e-12 of the largest pixel."""
    medium = sampler.medium(3)
    brightness = np.random.default_rng(0).random((10, 12))
    operator = operator_of(sampler, medium)
    found = operator.image(torch.from_numpy(brightness))
    for form in ("pairs", "points"):
        expected = sampler.images(medium, brightness, form=form) / sampler.mean
        torch.testing.assert_close(found, expected, rtol=0, atol=1e-12 * float(expected.max()))


def mismatch(operator: ObjectOperator, adjoint: ObjectOperator) -> float:
    """<A x, y> less <x, A* y>, over the first."""
    random = torch.Generator().manual_seed(1)
    x = torch.rand((3, 10, 12), generator=random, dtype=torch.float64)
    y = torch.rand((3, 2, 16, 18), generator=random, dtype=torch.float64)
    forth, back = (operator.image(x) * y).sum((-3, -2, -1)), (x * adjoint.adjoint(y)).sum((-2, -1))
    return float(((forth - back) / forth).abs().max())


def test_the_adjoint_is_one_and_a_forgotten_conjugate_is_seen(sampler):
    operator = operator_of(sampler, sampler.medium(3))
    assert mismatch(operator, operator) < 1e-12
    assert mismatch(operator, ObjectOperator(sampler.imaging, operator.spectra.conj())) > 1e-6


def test_torch_differentiates_it(sampler):
    """The gradient of <A x, y> is the adjoint of y."""
    operator = operator_of(sampler, sampler.medium(3))
    x = torch.ones((10, 12), dtype=torch.float64, requires_grad=True)
    y = torch.rand((2, 16, 18), generator=torch.Generator().manual_seed(2), dtype=torch.float64)
    (operator.image(x) * y).sum().backward()
    assert x.grad is not None
    torch.testing.assert_close(x.grad, operator.adjoint(y), rtol=0, atol=1e-12 * float(x.grad.abs().max()))
