"""Beams that interfere behind the stationary medium: against the sum written out, one beam, and the mean over media."""

import numpy as np
import pytest
import torch
from one_object import one_object
from zscore import assert_mean, refute_mean

import specklegen as sg
from specklegen.memory_effects.correlation import estimate_correlation
from specklegen.scene.sensors import FarFieldGrid

WAVELENGTH, WIDTH, SHAPE, VIEWS = 0.5, 20_000.0, (5, 3), (24, 20)
PITCH = 3 * WAVELENGTH / WIDTH
STEP = 2 * np.pi / WAVELENGTH * PITCH
SLAB = sg.Slab(thickness=1000.0, mean_free_path=100.0, scatterer=sg.HenyeyGreenstein(g=0.9))


@pytest.fixture(scope="module")
def sampler():
    kernel = estimate_correlation(SLAB, 4000, 1, threads=1)
    grid = FarFieldGrid(shape=VIEWS, pitch=WAVELENGTH / (3 * WIDTH))
    return one_object(kernel, wavelength=WAVELENGTH, object_shape=SHAPE, object_pitch=PITCH, width=WIDTH, grid=grid,
                      dtype=torch.complex128)  # fmt: skip


def waves(seed):
    real, imaginary = np.random.default_rng(seed).normal(size=(2, *SHAPE))
    return real + 1j * imaginary


def written_out(sampler, medium, amplitudes):
    """|u(v)|^2 by its definition over its mean, every cell, view and beam; positions from the middle of the window."""
    k = 2 * np.pi / WAVELENGTH
    x, y = sampler.x.positions, sampler.y.positions
    rows, columns = ((np.arange(n) - (n - 1) / 2) * PITCH for n in SHAPE)
    light = np.zeros((len(y), len(x), sampler.rank), complex)
    modes = sampler.modes[0].numpy().reshape(-1, *SHAPE)
    for m, n in np.ndindex(*SHAPE):
        wave = np.exp(1j * k * (rows[m] * y[:, None] + columns[n] * x))
        light += amplitudes[m, n] * wave[:, :, None] * modes[:, -1 - m, -1 - n]
    field = (medium[0].numpy() * light.transpose(2, 0, 1)).sum(axis=0)
    views = [(np.arange(n) - (n - 1) / 2) * WAVELENGTH / (3 * WIDTH) for n in VIEWS]
    u = np.exp(-1j * k * np.multiply.outer(views[0], y)) @ field @ np.exp(-1j * k * np.multiply.outer(x, views[1]))
    window = sampler.imaging.envelope[0].numpy()
    return np.abs(u) ** 2 / (np.square(np.abs(light)).sum(axis=2) * window**2).sum()


def test_image_is_the_sum_written_out(sampler):
    medium, amplitudes = sampler.medium(1), waves(0)
    image = sampler.superposed(medium, amplitudes, STEP)
    expected = written_out(sampler, medium, amplitudes)
    assert np.abs(image.numpy() - expected).max() < 1e-9 * expected.max()
    other = written_out(sampler, medium, amplitudes * np.exp(1j * np.arange(3)))  # phases count
    assert np.abs(image.numpy() - other).max() > 0.1 * expected.max()


def test_one_beam_is_an_object_of_one_pixel(sampler):
    medium, single = sampler.medium(2), np.zeros(SHAPE)
    single[1, 2] = 1.0
    image = sampler.superposed(medium, 1j * single, STEP)
    turned = single[::-1, ::-1].copy()
    assert torch.allclose(image, sampler.image(medium, turned) / sampler.mean, rtol=1e-9, atol=0)


def test_mean_over_media(sampler):
    """The stated mean, by Student's t over 200 media; 5 % off is seen."""
    amplitudes = waves(3)
    found = [float(sampler.superposed(sampler.medium((5, n)), amplitudes, STEP).mean()) for n in range(200)]
    assert_mean(found, 1.0)
    refute_mean(np.array(found) * 1.15, 1.0)
