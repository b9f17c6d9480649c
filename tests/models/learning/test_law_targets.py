"""What samples that a law draws say of themselves, range, material, points, is what rendered images show.

The oracle is written down once more from what a sample tells, without the law: with the numbers of its slab, or with
the places and brightnesses of its points, the mean of a periodogram is a sum of grains,

    S(f) = sum_ab w_a w_b C(d_ab) E(f, d_ab),     E(f, d) = sum_l tri(l) P(l - d s) e^(-2 pi i f l)
"""

import numpy as np
import pytest
import torch

from specklegen.datasets import load_recipe
from specklegen.datasets.loading.stream import tensors
from specklegen.datasets.recipes.hidden_object import HiddenObject
from specklegen.models.learning.inputs import band
from specklegen.models.learning.law import ByLaw
from specklegen.models.learning.networks import build
from specklegen.models.learning.targets import MATERIAL, TARGETS
from specklegen.models.learning.training import Training
from tests.zscore import assert_mean, refute_mean

SIDE, CAMERA = 16, 96
SMALL = {"camera": {"shape": [CAMERA, CAMERA]}, "objects": {"shape": [SIDE, SIDE]}, "field": {"pitch": 6e-6}}


def rendered(name, changes, count):
    """Periodograms float64[n, F, G] of rendered images, and what the law's samples of these numbers say."""
    recipe = load_recipe(name, changes)
    assert isinstance(recipe, HiddenObject)
    images = tensors(recipe.batch(2, "train", range(count)))["image"].double()
    told = tensors(ByLaw(recipe).batch(2, "train", range(count)))
    rows, columns = band((CAMERA, CAMERA), 3.0)
    power = torch.fft.rfft2(images)[:, rows % CAMERA][..., columns].abs().square() / CAMERA**2
    counted = (columns > 0) | (rows > 0)[:, None]
    return recipe, told, power.numpy()[:, counted.numpy()], counted.numpy()


def grains(drawn):
    """E along one axis: complex128[F, 2 SIDE - 1] of rows, and of columns its later half; they are alike for all."""
    step = float(drawn["object_pitch"][0] / drawn["camera_pitch"][0])
    grain = float(drawn["wavelength"][0] / drawn["width"][0] / drawn["camera_pitch"][0])
    lags, away = np.arange(1 - CAMERA, CAMERA), np.arange(1 - SIDE, SIDE)
    seen = (1 - abs(lags) / CAMERA)[:, None] * np.sinc((lags[:, None] - away * step) / grain) ** 2
    rows, columns = (x.numpy() for x in band((CAMERA, CAMERA), grain))
    return tuple(np.exp(-2j * np.pi / CAMERA * np.outer(f, lags)) @ seen for f in (rows, columns))


def memory(recipe, drawn, n, factors=()):
    """C_I between the pixels of the object, from numbers that a sample tells, some of them multiplied."""
    numbers = {name: float(values[n]) for name, values in drawn.items()} | {
        name: float(drawn[name][n]) * by for name, by in factors
    }  # fmt: skip
    correlation = recipe.material.known(recipe.material.slab_of(numbers)).correlation
    away = np.arange(1 - SIDE, SIDE)
    sines = float(drawn["object_pitch"][n]) * np.hypot(away[:, None], away)
    return correlation(2 * np.pi / float(drawn["wavelength"][n]) * sines) ** 2


def autocorrelation(image):
    """R of an object of sum 1, by a double loop over its lit pixels, float64[2 h - 1, 2 w - 1]."""
    places, lags = np.argwhere(image), np.zeros((2 * SIDE - 1, 2 * SIDE - 1))
    weights = image[tuple(places.T)].astype(np.float64)
    apart = places[:, None] - places + SIDE - 1
    np.add.at(lags, tuple(np.moveaxis(apart, -1, 0)), np.outer(weights, weights) / weights.sum() ** 2)
    return lags


def spectrum(lags, waves, counted):
    """S float64[frequencies] of what pairs of pixels add."""
    rows, columns = waves
    return (rows @ lags @ columns.T).real[counted]


def score(powers, expected, other):
    """Of mean 0 where periodograms have the mean that is expected, of any brightness: the slope towards another."""
    weight = np.clip(other / expected - 1, -1, 1)
    return ((powers / expected - 1) * (weight - weight.mean(1, keepdims=True))).sum(1)


def assert_told_apart(powers, right, wrong):
    assert_mean(score(powers, right, wrong), 0)
    refute_mean(score(powers, wrong, right), 0)


@pytest.fixture(scope="module")
def characters():
    return rendered("characters-of-new-fonts", SMALL, 320)


@pytest.mark.slow
@pytest.mark.parametrize(("name", "by"), [("thickness", 1.1), ("optical_depth", 1.3), ("g", 0.95)])
def test_images_are_of_the_slab_that_is_told(characters, name, by):
    """Thickness off by a tenth, which moves the range as much, or a wrong depth or g, is caught."""
    recipe, told, powers, counted = characters
    drawn, waves = told["parameters"], grains(told["parameters"])
    lags = [autocorrelation(image) for image in told["object"].numpy()]

    def law(factors=()):
        return np.stack([spectrum(r * memory(recipe, drawn, n, factors), waves, counted) for n, r in enumerate(lags)])

    assert_told_apart(powers, law(), law([(name, by)]))


def test_the_range_that_is_told_is_where_half_of_it_is_left(characters):
    """Half of C_I above its floor, the square of the single share; a range 1 % off is told by ten times as much."""
    recipe, told, *_ = characters
    for n in range(20):
        drawn = {name: float(values[n]) for name, values in told["parameters"].items()}
        q = 2 * np.pi / drawn["wavelength"] * np.sin(drawn["memory_effect_range"])
        correlation = recipe.material.known(recipe.material.slab_of(drawn)).correlation
        floor = drawn["single_share"] ** 2
        off = np.abs((correlation(q * np.array([0.99, 1, 1.01])) ** 2 - floor) / (1 - floor) - 0.5)
        assert off[1] < 0.1 * min(off[0], off[2])


def test_targets_of_the_law_are_those_of_rendered_samples(characters):
    recipe, told, *_ = characters
    one = tensors(recipe.batch(2, "train", range(8)))
    few = {"object": told["object"][:8], "parameters": {name: x[:8] for name, x in told["parameters"].items()}}
    for target in ("range", "material", "object", "label"):
        assert torch.equal(TARGETS[target].values(few), TARGETS[target].values(one))


def test_numbers_of_a_medium_are_read_off_lags_whatever_the_scale():
    """One of two opposite lags is looked at, and not how many pixels the camera has in an object pixel."""
    net = build("lags", 64, (1, len(MATERIAL)), 4, seed=0)
    pictures = torch.rand(2, 2, 64, 64, generator=torch.Generator().manual_seed(0))
    changed = pictures.clone()
    changed[:, 1] += 1
    changed[:, 0, 33:] += 1
    assert net(pictures).shape == (2, 1, 4)
    assert torch.equal(net(changed), net(pictures))
    changed[:, 0, 5, 40] += 1
    assert not torch.equal(net(changed), net(pictures))
    assert Training(target="material", input="periodogram", network="lags").network == "lags"


@pytest.fixture(scope="module")
def points():
    changes = SMALL | {"objects": {"shape": [SIDE, SIDE], "faintest": 0.3}}
    return rendered("points-beyond-range", changes, 256)


def moved(places, weights):
    """The brightest point stands one pixel aside."""
    first = weights.argmax()
    places = places.copy()
    places[first, 1] += 1 if places[first, 1] < SIDE - 1 else -1
    return places, weights


def dimmed(places, weights):
    """The brightest point has a third less."""
    return places, np.where(weights == weights.max(), weights * 2 / 3, weights)


@pytest.mark.slow
@pytest.mark.parametrize("wrong", [moved, dimmed])
def test_images_are_of_the_points_that_are_told(points, wrong):
    """Pair by pair; a point one pixel off, and one whose brightness is a third too low, are caught."""
    recipe, told, powers, counted = points
    drawn = told["parameters"]
    rows, columns = grains(drawn)

    def law(change=lambda *points: points):
        expected = []
        for n, image in enumerate(told["object"].numpy()):
            places = np.argwhere(image)
            places, weights = change(places, image[tuple(places.T)].astype(np.float64))
            c_i, weights = memory(recipe, drawn, n), weights / weights.sum()
            lags = np.zeros_like(c_i)
            for one, lit in zip(places, weights, strict=True):
                for other, also in zip(places, weights, strict=True):
                    at = tuple(other - one + SIDE - 1)
                    lags[at] += lit * also * c_i[at]
            expected.append(spectrum(lags, (rows, columns), counted))
        return np.stack(expected)

    assert_told_apart(powers, law(), law(wrong))
