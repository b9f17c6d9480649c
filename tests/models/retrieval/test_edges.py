"""The taper of a camera's edges: its kernel and weights against sums over pixels, and whom it is given."""

import numpy as np
import pytest
import torch
from zscore import assert_z, refute_z

from specklegen.models.retrieval import edges
from specklegen.models.retrieval.autocorrelation import lag_means
from specklegen.models.retrieval.wiener import lag_variance


@pytest.mark.parametrize("share", [0.0, 0.25, 0.5, 1.0])
@pytest.mark.parametrize("pixels", [24, 31])
def test_kernel_and_weights_are_sums_over_pixels(pixels, share):
    taper, places = edges.edge_taper(pixels, share), np.arange(pixels)
    assert np.square(taper).mean() == pytest.approx(1, rel=1e-14)
    frequency = np.linspace(-0.7, 1.3, 41)
    direct = np.abs(np.exp(-2j * np.pi * np.outer(frequency, places)) @ taper) ** 2 / pixels
    np.testing.assert_allclose(edges.taper_kernel(frequency, pixels, share), direct, atol=1e-12 * pixels)
    pairs = [sum(taper[n] * taper[n + lag] for n in range(pixels - lag)) / pixels for lag in places]
    found = edges.lag_weights(torch.from_numpy(-places.astype(float)), pixels, share).numpy()
    np.testing.assert_allclose(found, pairs, atol=1e-14)
    other = edges.lag_weights(torch.from_numpy(places.astype(float)), pixels, share + 0.1 * (1 - 2 * (share == 1)))
    assert np.abs(other.numpy() - pairs).max() > 1e-3  # the weights of another taper are seen
    share_left, growth = edges.independent((pixels, pixels), share)
    assert share_left == pytest.approx(1 / np.mean(taper**4) ** 2)
    assert (growth == 1) == (share == 0)


def test_variance_of_lags_under_a_taper_is_their_spread():
    """White noise: lags 1 and 2 along both axes of 1500 images, over their share of pairs."""
    images = 1 + 0.1 * torch.from_numpy(np.random.default_rng(5).standard_normal((1500, 1, 24, 24)))
    share = torch.full((1500,), 0.5, dtype=torch.float64)
    lags = lag_means(images / images.mean((-2, -1), keepdim=True) - 1, (2, 2), share)[:, 0]
    weight = edges.lag_weights(torch.arange(3.0, dtype=torch.float64), 24, 0.5)
    near = torch.stack([lags[:, 0, 1] * weight[1], lags[:, 1, 0] * weight[1]])
    taper = np.outer(edges.edge_taper(24, 0.5), edges.edge_taper(24, 0.5))
    moved = np.mean(np.square(taper[:, 1:] * taper[:, :-1])) * 23 / 24 / np.mean(taper**4)  # of a lag of a pixel
    stated = lag_variance(images, share).mean().item() * moved
    error = np.sqrt(2 / 3000)
    assert_z(float(near.var(1).mean()) / stated, 1.0, error, slack=0.04)  # eight of 575 frequencies are left out
    refute_z(float(near.var(1).mean()) / stated * edges.independent((24, 24), 0.5)[0], 1.0, error, slack=0.04)


def test_deviance_under_a_taper_varies_as_is_stated():
    """Of 4000 circular Gaussian fields: the variance of the sum of I - log I over all frequencies."""
    rng, taper = np.random.default_rng(2), edges.edge_taper(24, 1.0)
    fields = rng.standard_normal((4000, 24, 24, 2)) @ (np.array([1, 1j]) / 2**0.5)
    power = np.abs(np.fft.fft2(fields * np.outer(taper, taper))) ** 2 / 24**2
    found = (power - np.log(power)).sum((1, 2)).var() / 24**2 / (np.pi**2 / 6 - 1)
    stated, error = edges.independent((24, 24), 1.0)[1], found * np.sqrt(2 / 4000)
    assert_z(found, stated, error)
    refute_z(found, 1.0, error)
    refute_z(found, 1 + 1.5 * (stated - 1), error)


def speckle(light, count=40, side=96, grain=3, seed=3):
    """Images real[B, H, W] of a blot of 8 pixels, in circular Gaussian speckle, under some light."""
    rng = np.random.default_rng(seed)
    fields = np.fft.fft2(rng.standard_normal((count, 2 * side, 2 * side, 2)) @ np.array([1, 1j]))
    f = np.abs(np.fft.fftfreq(2 * side))
    passed = np.maximum(f[:, None], f) < 0.5 / grain
    bright = np.abs(np.fft.ifft2(fields * passed)) ** 2
    blurred = np.fft.ifft2(np.fft.fft2(bright) * np.exp(-2 * (np.pi * 4 * np.hypot(f[:, None], f)) ** 2)).real
    u = np.linspace(-1, 1, side)
    return torch.from_numpy(blurred[:, :side, :side] * light(u[:, None], u))


def test_taper_is_as_wide_as_light_is_uneven(monkeypatch):
    def chosen(light):
        return edges.taper_of(speckle(light))

    even, tilted = chosen(lambda y, x: 1 + 0 * x * y), chosen(lambda y, x: 1 + 0.6 * x + 0.2 * y)
    beam = chosen(lambda y, x: np.exp(-2 * (x**2 + y**2)))
    assert (even == 0).double().mean() > 0.7
    assert (tilted > 0).double().mean() > 0.85
    assert (beam == 0.5).all()
    dim = speckle(lambda y, x: np.exp(-0.5 * (x**2 + y**2)))  # to edges without much of a jump
    assert (edges.taper_of(dim) > 0).double().mean() > 0.5
    monkeypatch.setattr(edges, "FALLING", (1.0, 7.0))
    assert (edges.taper_of(dim) > 0).double().mean() < 0.3  # the axes alone do not tell
    assert (edges.taper_of(torch.ones(2, 12, 12)) == 0).all()  # no room
    assert (edges.taper_of(torch.ones(2, 32, 32)) == 0).all()  # nothing to be seen


def test_images_of_no_taper_stay_as_they_are():
    images = torch.rand(2, 3, 20, 24, dtype=torch.float64) - 0.5
    found = edges.tapered(images, torch.tensor([0.0, 0.5]))
    assert torch.equal(found[0], images[0])
    assert found[1, :, 0].abs().max() < 0.5 * images[1, :, 0].abs().max()
    assert found[1].mean((-2, -1)).abs().max() < 1e-15
