"""Fisher information of objects: by numerical derivatives, by the scatter of fits, by the scores of literal speckle."""

import numpy as np
import pytest
import torch
from scenes import script_at
from scipy.stats import chi2
from zscore import assert_mean, refute_mean

from specklegen.models import Optics, SpeckleLikelihood, periodogram
from specklegen.models.likelihood.fisher import fisher_information, least_error

FALSE_ALARM = 1e-6
CAMERA, GRAIN, STEP, FITS, LOOKS = 48, 2.5, 3.0, 400, 40.0
OBJECT = torch.tensor([[1.0, 0.2, 0.0], [0.5, 0.9, 0.1], [0.0, 0.3, 0.7]], dtype=torch.float64)
C_I = 2.0 ** -(torch.arange(-2.0, 3.0).square() + torch.arange(-2.0, 3.0)[:, None].square()).double().div(6.0)


def directions(count=4):
    """Directions that leave the sum of the object, about at random."""
    made = torch.from_numpy(np.random.default_rng(2).normal(size=(count, 3, 3)))
    return made - made.mean((1, 2), keepdim=True)


def likelihood_of(count, noise=0.3, looks=LOOKS):
    """Likelihood of as many images of the object, drawn from the law at brightness 1."""
    images = torch.rand(count, 1, CAMERA, CAMERA, dtype=torch.float64, generator=torch.Generator().manual_seed(0))
    seen = periodogram(images)._replace(noise=torch.full((count,), noise, dtype=torch.float64))
    likelihood = SpeckleLikelihood(seen, (3, 3), Optics(STEP, GRAIN, pixel_integration=True))
    law = likelihood.object_spectrum(OBJECT.expand(count, 3, 3), C_I) + noise
    drawn = torch.from_numpy(np.random.default_rng(1).gamma(looks, 1 / looks, law.shape))
    return likelihood.seeing(law * drawn, likelihood.noise, looks), law


def informed(likelihood, along):
    count = len(likelihood.power)
    return fisher_information(likelihood, OBJECT.expand(count, 3, 3), along.expand(count, *along.shape), C_I)


def test_information_is_that_of_numerical_derivatives():
    """Of log S by central differences, the brightness as one more number, whose row and column are eliminated."""
    known, law = likelihood_of(1)
    exact, along, small = known.seeing(law, known.noise, LOOKS), directions(), 1e-5
    pairs = [
        [torch.log(known.object_spectrum(OBJECT[None] + s * small * d, C_I) + 0.3) for s in (1, -1)] for d in along
    ]
    slopes = [(up - down)[0][known.used[0]] / (2 * small) for up, down in pairs]
    bright = torch.log(law[0][known.used[0]] * 1.0)
    bright = (torch.log((1 + small) * (law[0] - 0.3) + 0.3)[known.used[0]] - bright) / small
    every = torch.stack([*slopes, bright])
    whole = LOOKS * every @ every.T
    expected = torch.linalg.inv(torch.linalg.inv(whole)[:4, :4])
    torch.testing.assert_close(informed(exact, along)[0], expected, rtol=1e-4, atol=1e-4 * float(expected.abs().max()))


def test_fits_scatter_as_the_information_says():
    """Most probable objects of 400 measurements drawn from the law, by scoring from the truth: chi-square."""
    likelihood, law = likelihood_of(FITS)
    along = directions()
    information = informed(likelihood.seeing(law, likelihood.noise, LOOKS), along)[0]
    found = torch.zeros(FITS, 4, dtype=torch.float64, requires_grad=True)
    for _ in range(6):
        objects = OBJECT + torch.einsum("bk,khw->bhw", found, along)
        likely = likelihood.log_likelihood(objects, C_I).sum()
        (slope,) = torch.autograd.grad(likely, found)
        with torch.no_grad():
            found += torch.linalg.solve(information, slope.T).T
    scatter = float(torch.einsum("bk,kl,bl->", found.detach(), information, found.detach()))
    ends = chi2.ppf([FALSE_ALARM / 2, 1 - FALSE_ALARM / 2], 4 * FITS)
    assert ends[0] < scatter < ends[1]
    assert not ends[0] < 1.25 * scatter < ends[1]  # a quarter more information than there is would show
    error = float(torch.einsum("bk,khw->bhw", found.detach(), along).square().sum((1, 2)).mean())
    least = float(least_error(information[None], along[None]))
    assert error == pytest.approx(least, rel=0.2)


@pytest.fixture(scope="module")
def whitened_scores():
    return script_at("scripts/score_scatter.py").whitened_scores


@pytest.mark.parametrize(("side", "factor", "slack"),
                         [(5, 1.255, 0.04), pytest.param(7, 1.157, 0.03, marks=pytest.mark.slow)])  # fmt: skip
def test_scores_of_literal_speckle_scatter_somewhat_more(whitened_scores, side, factor, slack):
    """As docs/bound.md says, of other objects than it was measured on; the slack is three of its standard errors."""
    scores = [whitened_scores(side, seed, 30) for seed in range(900, 960)]
    assert_mean(np.concatenate(scores), 0.0)  # the law is right
    spread = np.array([np.square(each).mean() for each in scores])
    assert_mean(spread, factor, slack=slack)
    refute_mean(1.15 * spread, factor, slack=slack)
