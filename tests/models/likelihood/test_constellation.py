"""Constellations against every constellation there is, and the log-likelihood of the true object against its law."""

from itertools import combinations

import numpy as np
import pytest
import torch
from zscore import assert_mean, assert_z

from specklegen.datasets.objects import Glyphs, Points
from specklegen.models.likelihood.constellation import bright_pixels, constellation
from specklegen.models.likelihood.likelihood import Optics, SpeckleLikelihood
from specklegen.models.likelihood.periodogram import Periodogram

GRAIN = 3.0


def falling(side, half):
    """C_I between pixels, one half at a distance."""
    steps = np.arange(1 - side, side)
    return torch.from_numpy(np.exp2(-np.hypot(steps[:, None], steps) / half)).float()


def measured(objects, c_i, camera, step, looks=1.0, seed=0):
    """Likelihood of periodograms drawn from their law."""
    count, side = len(objects), objects.shape[-1]
    ones = torch.ones(count, camera, camera // 2 + 1, dtype=objects.dtype)
    dark = Periodogram(ones, torch.zeros(count), looks, (camera, camera))
    likelihood = SpeckleLikelihood(dark, (side, side), Optics(step, GRAIN))
    spectrum = likelihood.object_spectrum(objects, c_i)
    drawn = np.random.default_rng(seed).standard_gamma(looks, spectrum.shape, dtype=np.float32) / looks
    return likelihood.seeing(spectrum * torch.from_numpy(drawn).to(spectrum), likelihood.noise, looks)


def nats_of(likelihood, c_i, n):
    one = likelihood.select(slice(n, n + 1))
    return lambda objects: one.excess(objects[None], c_i)[0]


def several(family, count, seed=1):
    return torch.from_numpy(np.stack([family.image(seed, "train", n) for n in range(count)]))


def test_no_constellation_is_cheaper():
    """All 2 and 3 points on 5 x 5 pixels, 2600 of them: the search ends at the cheapest, or at one cheaper still."""
    side = 5
    objects, c_i = several(Points(shape=(side, side), count=3), 2), falling(side, 2.0)
    likelihood = measured(objects, c_i, 96, 3.0)
    starts = torch.rand(3, side, side, generator=torch.Generator().manual_seed(0))
    every = [list(each) for count in (2, 3) for each in combinations(range(side * side), count)]
    images = torch.zeros(len(every), side * side)
    for image, places in zip(images, every, strict=True):
        image[places] = 1
    counts = images.sum(1).double().numpy()
    for n in range(len(objects)):
        nats = nats_of(likelihood, c_i, n)
        with torch.no_grad():
            costs = nats(images.reshape(-1, side, side)).double().numpy() + np.log(side**2) * counts
        found = constellation(starts, nats, 0.0, kicks=4)
        assert found.cost < costs.min() + 0.05  # rounding of sums of 1500 float32 numbers
        assert found.excess(side) == pytest.approx(float(nats(found.image(side)[None])), abs=0.05)
        assert 0 < found.reached <= 1
        assert found.margin >= 0


def test_points_beyond_the_range_are_found_and_characters_are_not():
    """Five points on 28 pixels, two ranges wide, from what a blur shows of them: of three at least two as they are."""
    c_i, side = falling(36, 14), 36
    points = torch.nn.functional.pad(several(Points(), 3), (4, 4, 4, 4))
    likelihood, right = measured(points, c_i, 128, 1.5), []
    for n in range(3):
        nats, spread = nats_of(likelihood, c_i, n), float(likelihood.spread[n])
        blurred = torch.nn.functional.avg_pool2d(points[n : n + 1], 5, 1, 2)
        blurred = blurred + 0.01 * torch.rand(2, side, side, generator=torch.Generator().manual_seed(n))
        found = constellation(blurred, nats, spread, kicks=6)
        right.append(found.cost < float(nats(points[n : n + 1])) + 5 * np.log(side**2) + 0.05)
        assert found.excess(side) < 4 * spread
    assert sum(right) >= 2
    glyphs = torch.nn.functional.pad(several(Glyphs(), 1), (4, 4, 4, 4))
    likelihood = measured(glyphs, c_i, 128, 1.5)
    found = constellation(glyphs, nats_of(likelihood, c_i, 0), 0.0, kicks=0)
    assert found.excess(side) > 4 * float(likelihood.spread[0])


@pytest.mark.parametrize("looks", [1.0, 6.0])
def test_excess_of_the_true_object(looks):
    """Its mean is 0, its spread the one that is said; 400 periodograms of 48 x 48 pixels."""
    count, side = 400, 6
    objects = torch.from_numpy(Glyphs(shape=(side, side)).image(0, "train", 0)).expand(count, -1, -1)
    likelihood = measured(objects, falling(side, 3.0), 48, 2.0, looks, seed=2)
    # At the true brightness: the profiled one takes half a nat, of a chi squared of one degree.
    found = (likelihood.excess(objects, falling(side, 3.0)) + 0.5).double().numpy()
    spread = likelihood.spread.double().numpy()
    assert_mean(found / spread, 0.0)
    # Of nearly Gaussian numbers: the sum of 260 skewed ones has an excess kurtosis of 0.05.
    assert_z(float((found / spread).var(ddof=1)), 1.0, float(np.sqrt(2.05 / count)))


def test_one_of_several_objects():
    """Whatever its companions are, brighter ones among them; in double precision, where rounding does not show."""
    objects = torch.rand(3, 6, 6, dtype=torch.float64, generator=torch.Generator().manual_seed(0))
    objects *= torch.tensor([1e4, 1.0, 1e-4])[:, None, None]
    likelihood = measured(objects, falling(6, 3.0), 48, 2.0)
    whole = likelihood(objects)
    for n in range(3):
        one = likelihood.select(slice(n, n + 1))(objects[n : n + 1])
        torch.testing.assert_close(whole[n : n + 1], one, rtol=1e-9, atol=0)


def test_bright_pixels():
    image = torch.zeros(2, 8, 8)
    image[0, 2, 3:6] = 0.7
    image[1, 0, 0], image[1, 5, 5] = 1.0, 3.0
    assert bright_pixels(image).tolist() == pytest.approx([3.0, 1.6])
