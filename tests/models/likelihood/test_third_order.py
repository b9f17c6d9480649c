"""The turn against speckle made by hand, and its spread against images that have no third order at all."""

import numpy as np
import pytest
import torch
from refusals import assert_refused
from zscore import assert_mean, assert_z

from specklegen.core.errors import RuleError
from specklegen.datasets.objects import Glyphs
from specklegen.models.likelihood.likelihood import Optics
from specklegen.models.likelihood.third_order import turn_of

CAMERA, GRAIN, STEP = 96, 3, 2
OPTICS = Optics(float(STEP), float(GRAIN))


def objects_of(count, shape=(20, 20)):
    return torch.from_numpy(np.stack([Glyphs(shape=shape).image(2, "train", n) for n in range(count)]))


def seen_through_screens(objects, seed=0):
    """Camera images of objects within the memory effect: their sum over shifted speckle, turned as a camera does."""
    rng, wide = np.random.default_rng(seed), CAMERA * 2
    images = []
    for shown in objects.numpy():
        field = np.zeros((wide, wide), complex)
        side = wide // GRAIN
        field[:side, :side] = rng.standard_normal((side, side)) + 1j * rng.standard_normal((side, side))
        speckle = np.abs(np.fft.fft2(field)) ** 2
        total = np.zeros((CAMERA, CAMERA))
        for row, column in np.argwhere(shown > 0.05):
            y, x = STEP * row, STEP * column
            total += shown[row, column] * speckle[y : y + CAMERA, x : x + CAMERA]
        images.append(total / total.mean())
    return torch.from_numpy(np.stack(images))[:, None]


@pytest.fixture(scope="module")
def letters():
    objects = objects_of(16)
    return objects, seen_through_screens(objects)


def test_the_turn_of_speckle_made_by_hand_is_told(letters):
    """Letters have third order by many spreads: of 16 none may be told wrongly with the probability claimed."""
    objects, images = letters
    found = turn_of(images, objects, OPTICS)
    sure = found.probability > 0.9
    assert sure.sum() >= 12
    assert not found.turned[sure].any()


def test_a_turned_object_is_told_to_be_turned(letters):
    objects, images = letters
    one, other = (turn_of(images, shown, OPTICS) for shown in (objects, objects.flip((-2, -1))))
    assert torch.equal(one.turned, ~other.turned)
    # A turn about another point is a shift besides, of whole pixels here.
    assert torch.allclose(one.spreads, -other.spreads, rtol=1e-9)


def test_images_without_a_third_order_tell_nothing():
    """Gaussian images with the spectrum of speckle: the difference has mean 0 and spread 1."""
    objects = objects_of(1).expand(160, -1, -1)
    power = np.abs(np.fft.rfft2(seen_through_screens(objects[:1])[0, 0].numpy() - 1)) ** 2
    rng = np.random.default_rng(3)
    root = np.sqrt(power)
    root[0, 0] = 0
    images = np.fft.irfft2(np.fft.rfft2(rng.standard_normal((160, CAMERA, CAMERA))) * root, s=(CAMERA, CAMERA))
    images = 1 + 0.1 * images / images.std()
    found = turn_of(torch.from_numpy(images)[:, None], objects, OPTICS).spreads.numpy()
    assert_mean(found, 0.0)
    squares = np.square(found - found.mean())
    assert_z(squares.mean(), 1.0, squares.std() / np.sqrt(160), degrees=159)


def test_an_object_that_is_its_own_turn_tells_nothing(letters):
    _, images = letters
    even = torch.zeros(16, 20, 20)
    even[:, 5:15, 8:12] = 1
    found = turn_of(images, even, OPTICS)
    assert found.spreads.abs().max() < 1e-6
    assert torch.allclose(found.probability, torch.full((16,), 0.5, dtype=torch.float64), atol=1e-6)


def test_one_object_for_each_image(letters):
    objects, images = letters
    assert_refused(lambda: turn_of(images, objects[:3], OPTICS), r"turn_of images, objects must be \[B, F, H, W\]")


def test_images_that_tell_nothing_are_refused(letters):
    objects, images = letters
    with pytest.raises(RuleError, match="turn_of images must be images with contrast"):
        turn_of(torch.ones(1, 1, 32, 32), objects[:1], OPTICS)
    assert_refused(lambda: turn_of(images[:1], objects[:1], Optics(2.0, 1e6)), "several speckle grains wide")
    with pytest.raises(RuleError, match="turn_of objects must be at least 0"):
        turn_of(images[:1], 0.1 + objects[:1] - objects[:1].flip(-1), OPTICS)
