"""What a laboratory would see of a slab, against programs that share no table with it; and its derivatives."""

import numpy as np
import pytest
from zscore import assert_z

import specklegen as sg
from specklegen.measured import BallisticFraction, ContrastVersusBandwidth, MemoryCurve, TemporalCurve, Transmittance
from specklegen.memory_effects.atlas import atlas_correlation
from specklegen.models.calibration.prediction import _contrast, _Light, _Row, predict
from specklegen.oracles.adding_doubling import adding_doubling
from specklegen.synthesis.spectrum import estimate_spectral_correlation, light_modes

WAVELENGTH = 0.5
K = 2 * np.pi / WAVELENGTH
TILTS, LAGS, WIDTHS = np.linspace(0, 4e-3, 9), np.array([0.0, 0.01, 0.05, 0.2]), np.array([0.0, 2e-3, 0.02, 0.1])
EVERYTHING = [MemoryCurve(TILTS, None, 0.01), TemporalCurve(LAGS / K**2, None, 0.01, beta=0.8),
              ContrastVersusBandwidth(WIDTHS, None, 0.01),
              ContrastVersusBandwidth(WIDTHS[1:], None, 0.01, spectrum="flat"), Transmittance(None, 0.01),
              BallisticFraction(None, 0.01)]  # fmt: skip
SLABS = [(800.0, 5.3, 0.83, 0.999), (100.0, 2.1, 0.3, 0.97), (300.0, 17.0, 0.91, 1.0)]


def columns(thickness, depth, g, albedo, diffusion=1.0):
    return np.array([np.log(thickness), np.log(depth), np.log1p(-g), -np.log(albedo), np.log(diffusion)])


def seen(observation, *slab):
    return predict([observation], WAVELENGTH, columns(*slab)[None], ()).values[0]


@pytest.mark.parametrize("slab", SLABS)
def test_the_memory_effect_is_that_of_the_atlas(slab):
    thickness, depth, g, albedo = slab
    medium = sg.Slab(thickness=thickness, mean_free_path=thickness / depth, albedo=albedo,
                     scatterer=sg.HenyeyGreenstein(g=g))  # fmt: skip
    expected = atlas_correlation(medium, 1.0)(K * np.sin(TILTS)) ** 2
    np.testing.assert_allclose(seen(EVERYTHING[0], *slab), expected, rtol=0, atol=1e-12)


@pytest.mark.parametrize(("depth", "g", "albedo"), [
    (5.3, 0.83, 0.999), (2.1, 0.3, 0.97), (17.0, 0.7, 1.0), (0.7, -0.3, 0.9), (40.0, 0.9, 0.999),
])  # fmt: skip
def test_transmittance_is_that_of_adding_and_doubling(depth, g, albedo):
    """Cubic interpolation of its logarithm between nodes of the table: 2e-4, found at its worst."""
    expected = adding_doubling(depth, albedo=albedo, g=g).transmittance
    found = float(seen(Transmittance(None, 0.01), 1.0, depth, g, albedo)[0])
    assert abs(found / expected - 1) < 1e-3
    assert abs(1.005 * found / expected - 1) > 1e-3


def test_transmittance_is_that_of_paths_where_lobes_are_narrow():
    slab = sg.Slab(thickness=1.0, mean_free_path=1 / 12, albedo=0.995, scatterer=sg.HenyeyGreenstein(g=0.97))
    light = sg.reflectance_transmittance(slab, paths=40_000)
    found = float(seen(Transmittance(None, 0.01), 1.0, 12.0, 0.97, 0.995)[0])
    assert_z(found, light.transmittance, light.transmittance_error, slack=5e-4)


@pytest.mark.parametrize(("depth", "g", "albedo"),
                         [(5.3, 0.6, 1.0), (2.1, 0.3, 0.97), (12.0, 0.0, 1.0), (15.0, 0.5, 0.999)])  # fmt: skip
def test_correlation_in_time_is_that_of_adding_and_doubling(depth, g, albedo):
    """Tables of 3e5 paths a node: some .003 in g1 squared."""
    x = np.array([0.0, 0.3, 1.0, 3.0]) / (depth * (1 + depth * (1 - g)))
    light = [adding_doubling(depth, albedo=albedo, g=g, motion=float(each)).transmitted for each in x]
    found = seen(TemporalCurve(x / K**2, None, 0.01), 1.0, depth, g, albedo)
    expected = 1 + (np.array(light) / light[0]) ** 2
    assert np.abs(found - expected).max() < 0.008
    faster = seen(TemporalCurve(1.1 * x / K**2, None, 0.01), 1.0, depth, g, albedo)
    assert np.abs(faster - expected).max() > 0.008


@pytest.mark.parametrize("spectrum", ["gaussian", "flat"])
def test_contrast_is_that_of_the_modes_of_the_light(spectrum):
    slab = sg.Slab(thickness=1.0, mean_free_path=1 / 5.3, scatterer=sg.HenyeyGreenstein(g=0.83))
    paths = estimate_spectral_correlation(slab, 40_000, 3)
    widths = np.array([3.0, 20.0, 100.0])
    expected = [light_modes(paths, width, spectrum, tolerance=1e-4, most=1000).contrast for width in widths]
    found = seen(ContrastVersusBandwidth(widths, None, 0.01, spectrum=spectrum), 1.0, 5.3, 0.83, 1.0)
    assert np.abs(found - expected).max() < 0.006
    wider = seen(ContrastVersusBandwidth(1.1 * widths, None, 0.01, spectrum=spectrum), 1.0, 5.3, 0.83, 1.0)
    assert np.abs(wider - expected).max() > 0.006


@pytest.mark.parametrize("spectrum", ["gaussian", "flat"])
def test_contrast_of_three_lengths_is_that_of_their_fringes(spectrum):
    """Of light of three path lengths, by the sum over a spectrum that is one half at its full width: to rounding."""
    length, share, width, thickness = np.array([0.0, 0.7, 2.0]), np.array([0.2, 0.5, 0.3]), 1.7, 1.3
    k = (np.arange(400_000) + 0.5) / 400_000 * 16 * width - 8 * width
    bright = 2.0 ** -np.square(2 * k / width) if spectrum == "gaussian" else np.abs(k) < width / 2
    apart = thickness * np.subtract.outer(length, length)
    fringes = np.array([(bright * np.cos(k * each)).sum() / bright.sum() for each in apart.ravel()]).reshape(3, 3)
    light = _Light(_Row(length[None], np.zeros((1, 3, 5))), _Row(share[None], np.zeros((1, 3, 5))))
    seen_by = ContrastVersusBandwidth([width], None, 0.01, spectrum=spectrum)
    found, _ = _contrast(seen_by, np.array([thickness]), light)
    assert found[0, 0] == pytest.approx(np.sqrt(share @ np.square(fringes) @ share), rel=1e-7)


@pytest.mark.parametrize("slab", SLABS[:2])
def test_slopes_are_those_of_differences(slab):
    at, step = columns(*slab), 2e-5
    found = predict(EVERYTHING, WAVELENGTH, np.stack([at, at + 0.01]), range(5))
    for column in range(5):
        moved = at + step * np.array([-2, -1, 1, 2])[:, None] * np.eye(5)[column]
        a, b, c, d = predict(EVERYTHING, WAVELENGTH, moved, ()).values
        expected = (8 * (c - b) - (d - a)) / (12 * step)
        bound = 1e-8 * max(np.abs(expected).max(), 1e-3)
        assert np.abs(found.slopes[0, :, column] - expected).max() < bound
        if np.abs(expected).max() > 1e-3:
            assert np.abs(1.01 * found.slopes[0, :, column] - expected).max() > bound


def test_slopes_of_what_does_not_move_are_left_out():
    at = columns(*SLABS[0])[None]
    some, every = (predict(EVERYTHING[:1], WAVELENGTH, at, moved) for moved in ((0, 2), range(5)))
    np.testing.assert_array_equal(some.slopes[..., [0, 2]], every.slopes[..., [0, 2]])
    assert not some.slopes[..., [1, 3]].any()


def test_slabs_outside_the_tables_are_told():
    at = np.stack(
        [columns(1.0, *each) for each in ((10.0, 0.9, 1.0), (0.3, 0.9, 1.0), (10.0, 0.99, 1.0), (60.0, 0, 0.5))]
    )
    assert predict(EVERYTHING[:1], WAVELENGTH, at, ()).inside.tolist() == [True, False, False, False]
