"""Periodograms against the definition, and what camera noise, background, envelopes and tiles do to them."""

import numpy as np
import pytest
import torch
from refusals import assert_refused
from zscore import assert_mean, refute_mean

from specklegen.models.likelihood.periodogram import periodogram


def test_definition():
    image = torch.from_numpy(np.random.default_rng(0).random((1, 1, 9, 12)))
    x = (image[0, 0] / image.mean() - 1).numpy()
    rows, columns = np.arange(9)[:, None], np.arange(12)
    exact = [
        [abs((x * np.exp(-2j * np.pi * (f * rows / 9 + g * columns / 12))).sum()) ** 2 / 108 for g in range(7)]
        for f in range(9)
    ]
    assert np.allclose(periodogram(image).power[0], exact, atol=1e-12)


def test_camera_noise_is_the_level_of_an_even_image():
    """Poisson counts over a background, with a readout: every frequency has the noise that is stated."""
    rng = np.random.default_rng(1)
    electrons, background, read = 5.0, 0.4, 2.0
    shape = (200, 1, 32, 32)
    counts = rng.poisson(electrons * (1 + background), shape) + read * rng.standard_normal(shape)
    seen = periodogram(torch.from_numpy(counts / electrons), background=background, electrons=electrons,
                       read_noise=read)  # fmt: skip
    power = seen.power[:, 1:, 1:].mean((1, 2)).numpy()
    assert_mean(power / seen.noise.numpy(), 1.0, slack=2e-3)  # of the image's own mean
    refute_mean(power / seen.noise.numpy() * 1.02, 1.0, slack=2e-3)


def test_frames_and_tiles_are_looks():
    images = torch.rand(2, 3, 32, 48, generator=torch.Generator().manual_seed(0))
    seen = periodogram(images, tile=16)
    assert seen.looks == 18
    assert seen.shape == (16, 16)
    by_hand = torch.stack([
        periodogram((images / images.mean((-2, -1), keepdim=True))[:, f : f + 1, y : y + 16, x : x + 16]).power
        * (images[:, f, y : y + 16, x : x + 16].mean((-2, -1)) / images[:, f].mean((-2, -1))).square()[:, None, None]
        for f in range(3) for y in (0, 16) for x in (0, 16, 32)
    ])  # fmt: skip
    inside = (slice(None), slice(1, None), slice(1, None))
    assert torch.allclose(seen.power[inside], by_hand.mean(0)[inside], atol=1e-5)


def test_an_envelope_that_is_divided_out_takes_its_frequencies_along():
    images = torch.rand(1, 1, 64, 64) + 1
    assert periodogram(images).lowest == 0
    assert periodogram(images, sigma=10.0).lowest == pytest.approx(np.sqrt(-np.log(0.025) / 2) / np.pi / 10)


@pytest.mark.parametrize(("shape", "options", "message"), [
    ((4, 4), {}, "of shape"), ((1, 1, 4, 64), {}, "at least 8 pixels"),
    ((1, 1, 16, 16), {"tile": 4}, "tile must be at least 8; got 4"), ((1, 1, 16, 16), {"electrons": 0.0}, "above 0"),
    ((1, 1, 16, 16), {"read_noise": 1.0}, "given, since read_noise is"),
    ((1, 1, 16, 16), {"background": 2.0}, "brighter in the mean than their background"),
])  # fmt: skip
def test_bad_input_is_refused(shape, options, message):
    assert_refused(lambda: periodogram(torch.ones(shape), **options), message)
