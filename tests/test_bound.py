"""What scripts/figures/bound.py makes of directions, and that its errors are those of what scores see."""

import numpy as np
import pytest
import torch
from scenes import of_the_figures
from zscore import assert_mean, refute_mean

from specklegen.models import Optics, SpeckleLikelihood, periodogram
from specklegen.models.likelihood.fisher import fisher_information


@pytest.fixture(scope="module")
def bound():
    return of_the_figures("bound")


def blob():
    rows, columns = np.indices((36, 36)) - 17.5
    return torch.from_numpy(np.exp(-(rows**2 + 2 * columns**2 + rows * columns) / 60)).float()


def test_directions_are_told_apart_from_what_scores_forget(bound):
    """Brightness, offset and small shifts; the rest of the span stays, orthonormal."""
    picture = blob()
    given = torch.from_numpy(np.random.default_rng(0).normal(size=(5, 36, 36))).float()
    found = bound.told_apart(torch.cat([given, picture[None], given[:1] + picture]), picture)
    flat = found.flatten(1)
    assert len(flat) == 5
    torch.testing.assert_close(flat @ flat.T, torch.eye(5, dtype=torch.float64))
    down, across = torch.gradient(picture.double())
    for forgotten in (picture.double(), torch.ones(36, 36, dtype=torch.float64), down, across):
        assert float((flat @ forgotten.flatten()).abs().max()) < 1e-6 * float(forgotten.norm())


def test_the_best_correlation_is_what_fits_reach(bound):
    """Nine hundred fits of measurements drawn from the law; r as of any picture, not as the bound makes it."""
    side, count, looks = 7, 900, 1000.0
    picture = 0.2 + torch.from_numpy(np.random.default_rng(6).random((side, side)))
    images = torch.rand(count, 1, 48, 48, dtype=torch.float64, generator=torch.Generator().manual_seed(0))
    seen = periodogram(images)._replace(noise=torch.full((count,), 0.1, dtype=torch.float64))
    likelihood = SpeckleLikelihood(seen, (side, side), Optics(3.0, 2.5))
    steps = torch.arange(1.0 - side, side).double()
    c_i = 2.0 ** -((steps.square() + steps[:, None].square()) / 30.0)[None]
    law = likelihood.object_spectrum(picture.expand(count, side, side), c_i.expand(count, -1, -1)) + 0.1
    drawn = torch.from_numpy(np.random.default_rng(7).gamma(looks, 1 / looks, law.shape))
    likelihood = likelihood.seeing(law * drawn, likelihood.noise, looks)
    given = torch.from_numpy(np.random.default_rng(8).normal(size=(6, side, side)))
    along = bound.told_apart(given, picture)
    known = likelihood.seeing(law, likelihood.noise, looks).select(slice(1))
    information = fisher_information(known, picture[None], along[None], c_i)[0]
    found = torch.zeros(count, len(along), dtype=torch.float64, requires_grad=True)
    for _ in range(6):
        objects = picture + torch.einsum("bk,khw->bhw", found, along)
        (slope,) = torch.autograd.grad(likelihood.log_likelihood(objects, c_i.expand(count, -1, -1)).sum(), found)
        with torch.no_grad():
            found += torch.linalg.solve(information, slope.T).T
    objects = picture + torch.einsum("bk,khw->bhw", found.detach(), along)
    r = np.array([np.corrcoef(each.ravel(), picture.ravel())[0, 1] for each in objects])
    best = bound.best_correlation(known, picture, c_i, given)
    assert 0.5 < best < 1
    assert_mean((r**-2 - 1) / (best**-2 - 1), 1.0)
    refute_mean(2.0 * (r**-2 - 1) / (best**-2 - 1), 1.0)


@pytest.mark.slow
def test_the_tangent_of_the_prior_is_few_smooth_directions(bound):
    """Not what a picture may not do: noise of single pixels keeps less of itself there than it has by chance."""
    picture = blob()
    tangent = bound.tangent_of(picture).flatten(1)
    assert 5 < len(tangent) < 200
    torch.testing.assert_close(tangent @ tangent.T, torch.eye(len(tangent)), atol=1e-3, rtol=0)
    noise = torch.from_numpy(np.random.default_rng(1).normal(size=(50, 36 * 36))).float()
    rough = noise - torch.nn.functional.avg_pool2d(noise.unflatten(1, (1, 36, 36)), 3, 1, 1).flatten(1)
    kept = (rough @ tangent.T).square().sum(1).mean() / rough.square().sum(1).mean()
    assert float(kept) < len(tangent) / 36**2
