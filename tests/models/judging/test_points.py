"""Localisation: points that are shown where they are, and points that are not."""

import numpy as np
import pytest

from specklegen.datasets.objects import Points
from specklegen.models.judging.points import brightest, share_found


@pytest.fixture(scope="module")
def objects():
    return [Points().image(0, "test", n) for n in range(100)]


def test_an_object_shows_its_own_points(objects):
    apart = [x for x in objects if len(brightest(x, 5)) == 5]
    assert len(apart) > 90
    assert all(share_found(x, x) == 1 for x in apart)


def test_a_pixel_away_is_found_and_two_are_not():
    points = np.zeros((12, 12))
    points[3, 3] = points[8, 8] = 1
    assert share_found(np.roll(points, (1, 1), (0, 1)), points) == 1
    assert share_found(np.roll(points, 2, 0), points) == 0
    half = points.copy()
    half[8, 8], half[8, 2] = 0, 2
    assert share_found(half, points) == 0.5


def test_one_maximum_finds_one_point():
    """Two points in reach of one maximum: it is paired with one of them."""
    points = np.zeros((12, 12))
    points[5, 4] = points[5, 6] = 1
    image = np.zeros((12, 12))
    image[5, 5] = 1
    assert share_found(image, points) == 0.5


def test_chance_is_small(objects):
    """Maxima of noise: five discs of nine pixels on 784 hold a given place with a chance of at most 45 / 784."""
    rng = np.random.default_rng(0)
    found = np.mean([share_found(rng.random(x.shape), x) for x in objects])
    assert found < 45 / 784 + 5 * np.sqrt(45 / 784 / 500)
