"""The object sampler under base tilts, with pixels of an area, in several modes of light: against literal sums."""

import numpy as np
import pytest
import torch
from one_object import one_object
from refusals import assert_refused
from zscore import assert_mean, refute_mean

from specklegen.memory_effects.correlation import estimate_correlation
from specklegen.scene.media import Slab
from specklegen.scene.scatterers import HenyeyGreenstein
from specklegen.scene.sensors import FarFieldGrid
from specklegen.synthesis import imaging
from specklegen.synthesis.contrast import speckle_variance
from specklegen.synthesis.correlations import Tabulated
from specklegen.synthesis.sight import Sight
from specklegen.synthesis.spectrum import LightModes

K = estimate_correlation(Slab(thickness=1000.0, mean_free_path=100.0, albedo=1.0, scatterer=HenyeyGreenstein(g=0.9)),
                         20_000, 1, threads=1)  # fmt: skip
GRAIN = 0.5 / 5e4
BRIGHT = np.random.default_rng(0).random((3, 4)) * (np.random.default_rng(1).random((3, 4)) < 0.7)
BASE = np.array([[0.0, 0.0], [4.3 * GRAIN, -2.1 * GRAIN]])


def sampler(**changes):
    options = {"wavelength": 0.5, "object_shape": BRIGHT.shape, "object_pitch": 0.8 * GRAIN, "width": 5e4,
               "grid": FarFieldGrid(shape=(9, 7), pitch=0.4 * GRAIN), "base": BASE,
               "dtype": torch.complex128} | changes  # fmt: skip
    return one_object(K, **options)


def literal(made, medium, pitch, grid, points=1):
    """I(v) = sum_n,j O_j |sum_x e^(-ik(v - i_j - b) . x) sum_r phi_r(j) m_nr(x)|^2, a mean over points of the pixel."""
    k = 2 * np.pi / 0.5
    x, y = made.x.positions, made.y.positions
    fine = ((np.arange(points) + 0.5) / points - 0.5) * grid.pitch
    view_x, view_y = ((s[:, None] + fine).ravel() for s in grid.sines)
    modes, fields = made.modes.numpy(), medium.numpy()
    images = np.zeros((len(BASE), len(view_y), len(view_x)))
    rows, columns = BRIGHT.shape
    for t, (bx, by) in enumerate(BASE):
        for j in range(BRIGHT.size):
            row, column = divmod(j, columns)
            ix, iy = -(column - (columns - 1) / 2) * pitch + bx, -(row - (rows - 1) / 2) * pitch + by
            ey, ex = np.exp(-1j * k * np.outer(view_y - iy, y)), np.exp(-1j * k * np.outer(x, view_x - ix))
            for field in np.einsum("r,nryx->nyx", modes[t, :, j], fields):
                images[t] += BRIGHT[row, column] * np.square(np.abs(ey @ field @ ex))
    shape = (len(BASE), grid.shape[0], points, grid.shape[1], points)
    return made.mean * images.reshape(shape).mean(axis=(2, 4))


@pytest.mark.parametrize("form", ["pairs", "points"])
@pytest.mark.parametrize("lit", [False, True])
def test_images_are_the_literal_sum(form, lit):
    light = LightModes(np.array([0.6, 0.3]), (K, K), 0.1) if lit else None
    made = sampler(light=light)
    medium = made.medium(5)
    expected = literal(made, medium, 0.8 * GRAIN, FarFieldGrid(shape=(9, 7), pitch=0.4 * GRAIN))
    expected += (0.1 if lit else 0.0) * made.mean * BRIGHT.sum()
    np.testing.assert_allclose(made.images(medium, BRIGHT, form=form), expected, rtol=1e-10)
    np.testing.assert_allclose(made.images(made.spectra(medium), BRIGHT), expected, rtol=1e-10)
    np.testing.assert_allclose(made.image(medium, BRIGHT, form=form), expected[0], rtol=1e-10)


@pytest.mark.parametrize("pixels_per_grain", [2.5, 0.7])
def test_pixels_average_over_their_area(pixels_per_grain):
    """Against 24 by 24 points a pixel, whose midpoint rule is off by less than 1e-3; also for coarse pixels."""
    grid = FarFieldGrid(shape=(5, 6), pitch=GRAIN / pixels_per_grain)
    made = sampler(grid=grid, pixel_integration=True)
    medium = made.medium(5)
    expected = literal(made, medium, 0.8 * GRAIN, grid, points=24)
    scale = expected.mean()
    np.testing.assert_allclose(made.images(medium, BRIGHT) / scale, expected / scale, atol=2e-3)
    at_points = literal(made, medium, 0.8 * GRAIN, grid)
    assert np.abs(at_points / scale - expected / scale).max() > 0.05  # else the test says nothing


def test_coarse_points_are_refused():
    assert_refused(lambda: sampler(grid=FarFieldGrid(shape=(5, 6), pitch=0.6 * GRAIN)), "at most half the speckle size")


def test_tilts_are_correlated_by_the_memory_effect():
    """The pattern moves with the tilt, and its intensity correlation there is |K|^2."""
    step = 14  # pixels
    pitch = GRAIN / 2.5
    base = np.array([[0.0, 0.0], [step * pitch, 0.0]])
    grid = FarFieldGrid(shape=(24, 64), pitch=pitch)
    made = sampler(object_shape=(1, 1), base=base, grid=grid, dtype=torch.complex64)
    one = np.ones((1, 1))
    products = []
    for n in range(200):
        first, second = made.images(made.medium(1, n), one).double().numpy() / made.mean - 1
        products.append((first[:, :-step] * second[:, step:]).mean())
    expected = float(K(2 * np.pi / 0.5 * step * pitch)) ** 2
    assert 0.3 < expected < 0.97
    assert_mean(np.array(products), expected)
    refute_mean(np.array(products), expected + 0.1)


def test_modes_of_many_pixels_say_their_seconds_before_they_are_made(monkeypatch, caplog):
    """An object of thousands of pixels a side went on for minutes of a busy core without a word."""

    class Begun(Exception):
        """What is stopped here, after what was said."""

    def stop(*_):
        raise Begun

    monkeypatch.setattr(imaging, "memory", stop)
    for side, said in ((500, 0), (5000, 1)):
        caplog.clear()
        with pytest.raises(Begun):
            sampler(object_shape=(side, side), object_pitch=0.1 * GRAIN / side, base=[[0.0, 0.0]])
        assert [f"{side} x {side} pixels" in record.getMessage() for record in caplog.records] == [True] * said


@pytest.mark.parametrize("profile", ["square", "disc", "gaussian"])
def test_the_contrast_of_one_medium_does_not_know_those_beside_it(profile):
    """Windows of several widths take grids of several sizes: to the bit."""
    width = torch.tensor([5e4, 7.3e4, 9e4], dtype=torch.float64)
    sight = Sight(wavelength=0.5, profile=profile, shape=(3, 4), camera=(9, 7), center=(0.0, 0.0), integrated=True,
                  width=width, object_pitch=torch.full_like(width, 0.8 * GRAIN),
                  camera_pitch=torch.full_like(width, 0.4 * GRAIN),
                  base=torch.zeros((3, 1, 2), dtype=torch.float64))  # fmt: skip
    together = speckle_variance(sight, Tabulated([K, K, K]))
    for n in range(3):
        one = slice(n, n + 1)
        assert torch.equal(speckle_variance(sight.at(one), Tabulated([K])), together[one])
