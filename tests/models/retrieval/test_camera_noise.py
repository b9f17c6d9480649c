"""Camera noise read off images of speckle, against what was put in."""

import numpy as np
import pytest
import torch
from refusals import assert_refused
from zscore import assert_mean, refute_mean

from specklegen.datasets import load_recipe
from specklegen.datasets.loading.stream import tensors
from specklegen.instrument.camera import Camera, NoiseStreams, expose
from specklegen.models.judging.baselines import seen_lags
from specklegen.models.retrieval.camera_noise import camera_noise

GRAIN = 3


def speckle(count, side=64, seed=0):
    """Intensities float64[count, side, side] of mean 1 behind a square window, of a longer period than the camera."""
    period = 40 * GRAIN
    cells = period // GRAIN
    rng = np.random.default_rng(seed)
    field = rng.standard_normal((count, cells, cells, 2)).view(np.complex128)[..., 0] / np.sqrt(2) / cells
    return np.square(np.abs(np.fft.fft2(field, (period, period))))[:, :side, :side]


def test_light_alone_has_none():
    """What leaks through the Hann window is less than 1e-4 of the speckle's variance, 1."""
    assert camera_noise(torch.from_numpy(speckle(50)), GRAIN).max() < 1e-4


def soft_speckle(count, side=128, grain=3.0, seed=0):
    """Intensities float64[count, side, side] of mean 1 behind a Gaussian window, whose amplitude is exp(-4 x^2)."""
    period = 2 * side
    rng = np.random.default_rng(seed)
    x = np.fft.fftfreq(period) * grain  # places in the window over its 1/e^2 width
    amplitude = np.exp(-4 * (x[:, None] ** 2 + x**2))
    field = rng.standard_normal((count, period, period, 2)).view(np.complex128)[..., 0] * amplitude
    light = np.square(np.abs(np.fft.fft2(field)))[:, :side, :side]
    return light / light.mean((1, 2), keepdims=True)


@pytest.mark.parametrize("profile", [None, "gaussian"])
def test_light_behind_a_gaussian_window_has_none(profile):
    """What such a window passes beyond the edge of others is .006 of the variance; it was taken for noise."""
    images = torch.from_numpy(soft_speckle(20))
    assert camera_noise(images, 3.0, profile=profile).max() < 1e-4
    assert camera_noise(images, 3.0, profile="square").min() > 3e-3  # the test has power


@pytest.mark.parametrize("photons", [10.0, 200.0])
def test_noise_behind_a_gaussian_window_is_found(photons):
    """Variance 1 / photons: by the window's name; without it where noise is not far above what leaks."""
    light = soft_speckle(60, seed=5)
    images = torch.from_numpy(np.random.default_rng(6).poisson(photons * light) / photons)
    scale = photons * images.mean((1, 2)).numpy()
    assert_mean(camera_noise(images, 3.0, profile="gaussian").numpy() * scale, 1.0, slack=1e-3)
    refute_mean(camera_noise(images, 3.0, profile="square").numpy() * scale, 1.0, slack=1e-3)
    if photons == 200.0:
        assert_mean(camera_noise(images, 3.0).numpy() * scale, 1.0, slack=1e-3)


def round_speckle(count, grain, side=96, seed=0):
    """Intensities float64[count, side, side] of mean 1 behind a disc, of a longer period than the camera."""
    period = 2 * side
    rng = np.random.default_rng(seed)
    f = np.fft.fftfreq(period) * grain
    field = rng.standard_normal((count, period, period, 2)).view(np.complex128)[..., 0]
    light = np.square(np.abs(np.fft.fft2(field * (np.hypot(f[:, None], f) <= 0.5))))[:, :side, :side]
    return light / light.mean((1, 2), keepdims=True)


@pytest.mark.parametrize(("grain", "more"), [(1.7, 1.15), (2.0, 1.05), (2.3, 1.05), (3.0, 1.05)])
def test_noise_behind_a_disc_is_found_in_the_corners(grain, more):
    """Variance 1 / photons; a square of those grains would fill all frequencies, or nearly so, and leave none to read.
    False alarms as of every z-score of these tests. More noise by 5 % would be found out; of 1.7 pixels a grain, whose
    corners are small, by 15 %."""
    photons, light = 20.0, round_speckle(150, grain)
    images = torch.from_numpy(np.random.default_rng(8).poisson(photons * light) / photons)
    scale = photons * images.mean((1, 2)).numpy()
    found = camera_noise(images, grain, profile="disc").numpy() * scale
    assert_mean(found, 1.0, slack=1e-3)
    refute_mean(more * found, 1.0, slack=1e-3)
    if grain < 2.16:
        assert_refused(lambda: camera_noise(images, grain), r"camera_noise grain must be above 2\.16")


def test_light_alone_behind_a_disc_has_none():
    """What leaks through the Hann window is less than 1e-4 of the speckle's variance, 1, at small grains too."""
    assert camera_noise(torch.from_numpy(round_speckle(20, 1.7)), 1.7, profile="disc").max() < 1e-4
    assert camera_noise(torch.from_numpy(round_speckle(20, 1.7)), 2.0, profile="disc").min() > 1e-4  # a wrong grain


@pytest.mark.parametrize("gain", [1.0, 0.25])
def test_photons_background_and_readout_are_found(gain):
    """In any unit: variance (photons + background + read^2) / (photons + background)^2, to first order in the mean."""
    photons, background, read = 6.0, 2.0, 1.5
    rng = np.random.default_rng(1)
    light = speckle(200)
    light /= light.mean((1, 2), keepdims=True)  # so that the mean of an image is known
    counts = rng.poisson(photons * light + background) + read * rng.standard_normal(light.shape)
    found = camera_noise(torch.from_numpy(counts / gain), GRAIN).numpy()
    exact = (photons + background + read**2) / (photons + background) ** 2
    assert_mean(found / exact, 1.0, slack=1e-3)  # of the square of the image's own mean
    refute_mean(1.05 * found / exact, 1.0, slack=1e-3)


def test_grains_may_differ():
    images = torch.from_numpy(np.random.default_rng(2).poisson(5.0, (2, 48, 48)) / 5.0)
    both = camera_noise(images, torch.tensor([3.0, 4.0]))
    assert both[1].item() == pytest.approx(camera_noise(images[1:], 4.0)[0].item(), rel=1e-12)


def test_a_camera_states_what_cannot_be_read():
    """Of the same counts: read where grains leave frequencies, stated where they do not."""
    camera = Camera(photons=6.0, background=2.0, read_noise=1.5, gain=0.25, offset=10.0, bit_depth=None)
    light = speckle(200)
    light /= light.mean((1, 2), keepdims=True)
    images = torch.from_numpy(expose(camera, light, NoiseStreams.of(3)))
    read, stated = (camera_noise(images, grain, camera).numpy() for grain in (GRAIN, 2.0))
    assert_mean(read / stated, 1.0, slack=1e-3)
    refute_mean(1.05 * read / stated, 1.0, slack=1e-3)
    assert not camera_noise(images, 2.0, "none").any()
    # Each image for itself, whatever stands beside it.
    mixed = camera_noise(images[:2], torch.tensor([GRAIN, 2.0]), camera).numpy()
    np.testing.assert_allclose(mixed, [read[0], stated[1]], rtol=1e-12)


def test_a_packaged_recipe_of_small_grains_is_judged():
    """through-slab-lab: 2.13 pixels a grain. Its lags are seen by its own camera's noise."""
    recipe = load_recipe("through-slab-lab", {"material": {"kernel_paths": 1000}})
    batch = tensors(recipe.batch(0, "test", range(2)))
    assert_refused(lambda: seen_lags(batch), r"camera_noise grain must be above 2\.16.*\[exposure\]")
    images = batch["image"].double()
    contrast = (images / images.mean((1, 2), keepdim=True)).var((1, 2), correction=0)
    # A lag's variance is over the square of the zero lag, which loses the noise and nothing else.
    stated, none = (seen_lags(batch, camera).variance for camera in (recipe.exposure, "none"))
    noise = recipe.exposure.noise(images.mean((1, 2)))
    np.testing.assert_allclose(1 - (none / stated).sqrt(), noise / contrast, rtol=1e-3)
