"""Bandwidth and polarisation: coherence from path lengths, modes of the light, contrast by theory."""

from functools import lru_cache

import numpy as np
import pytest
from one_object import one_object
from scipy.special import j0
from zscore import assert_mean, assert_z, refute_mean, refute_z

from specklegen.memory_effects.correlation import axial_tracer, estimate_correlation, lateral_distance
from specklegen.paths.endpoint_factors import contributions
from specklegen.scene.media import Slab
from specklegen.scene.scatterers import HenyeyGreenstein
from specklegen.scene.sensors import FarFieldGrid
from specklegen.synthesis.spectrum import estimate_spectral_correlation, light_modes

PATHS = 100_000
BEAM = np.ones((1, 1))


def slab(g, depth=10.0):
    return Slab(thickness=1000.0, mean_free_path=1000.0 / depth, albedo=1.0, scatterer=HenyeyGreenstein(g=g))


@lru_cache(maxsize=4)
def correlation(g, seed=1, paths=PATHS):
    return estimate_spectral_correlation(slab(g), paths, seed, threads=1)


@lru_cache(maxsize=4)
def kernel(g):
    return estimate_correlation(slab(g), PATHS, 1, threads=1)


def wavenumbers(nanometres):
    """Differences inside the slab for those of a vacuum wavelength of 0.5 micrometres, n = 1.4."""
    return 2 * np.pi * 1.4 * np.asarray(nanometres) * 1e-3 / 0.5**2


@pytest.mark.parametrize(("g", "half_width", "rounding"), [(0.9, 0.24, 0.005), (0.0, 0.007, 0.0005)])
def test_half_widths(g, half_width, rounding):
    """physics.md 8 gives them to two digits, and to one: |C|^2 passes 1/2 between what rounds to them."""
    found = correlation(g, paths=4 * PATHS)
    value, error = found.intensity(wavenumbers([half_width - rounding, half_width + rounding]))
    assert_z(np.maximum(0.5 - value[0], 0), 0, error[0], degrees=63)
    assert_z(np.maximum(value[1] - 0.5, 0), 0, error[1], degrees=63)
    more = correlation(g, paths=8 * PATHS)
    value, error = more.intensity(wavenumbers([1.15 * half_width + rounding]))
    refute_z(np.maximum(0.5 - value, 0), 0, error, degrees=63)  # power: a bracket an eighth too high fails


def paths_of(g):
    """Weight, lateral distance and length of each path, without bins."""
    tracer = axial_tracer(slab(g))
    bank = tracer.trace(1, PATHS, threads=1)
    weight = contributions(tracer.layout, bank)
    length = bank.entry[:, 2] + bank.length + 1000.0 - bank.exit[:, 2]
    return weight / weight.sum(), lateral_distance(bank), length


@pytest.mark.parametrize("g", [0.9, 0.0])
def test_bins_change_nothing(g):
    """Against the sum over the same paths; what the bins of length and distance do stays below 0.005."""
    weight, radius, length = paths_of(g)
    found, middle = correlation(g), (weight * length).sum()
    width = found.half_width()
    dk = width * np.array([0.1, 0.3, 1.0, 2.0, 4.0])
    direct = np.abs(np.exp(1j * dk[:, None] * (length - middle)) @ weight)
    np.testing.assert_allclose(np.abs(found(dk)), direct, atol=0.005)
    q = kernel(g).half_range()
    joint = np.abs(np.exp(1j * dk[:, None] * (length - middle)) @ (weight * j0(q * radius)))
    np.testing.assert_allclose(np.abs(found.joint_correlation(q, dk)), joint, atol=0.005)


def spectrum_grid(kind, width, count=301):
    k = np.linspace(-2, 2, count) * width if kind == "gaussian" else (np.arange(count) + 0.5) / count * width
    shares = np.exp(-4 * np.log(2) * (k / width) ** 2) if kind == "gaussian" else np.ones(count)
    return k, shares / shares.sum()


@pytest.mark.parametrize("kind", ["gaussian", "flat"])
@pytest.mark.parametrize("widths", [0.5, 3.0])
def test_shares_are_the_eigenvalues_over_the_spectrum(kind, widths):
    """The modes are found from the paths; here from the spectrum, on a grid of wavenumbers."""
    found = correlation(0.0)
    width = widths * found.half_width()
    modes = light_modes(found, width, kind)
    k, shares = spectrum_grid(kind, width)
    row, place = found(k - k[0]), np.arange(len(k))
    gap = place[:, None] - place
    toeplitz = np.where(gap >= 0, row[np.abs(gap)], row[np.abs(gap)].conj())
    matrix = np.sqrt(shares)[:, None] * toeplitz * np.sqrt(shares)
    expected = np.linalg.eigvalsh(matrix)[::-1][: len(modes.shares)]
    np.testing.assert_allclose(modes.shares, expected, atol=2e-4)
    exact = (shares[:, None] * shares * np.square(np.abs(toeplitz))).sum()
    assert modes.contrast**2 == pytest.approx(exact, rel=1.5e-3)  # the tolerance of the weakest modes
    assert modes.shares.sum() + modes.flat == pytest.approx(1, abs=1e-12)


def intensity_correlation(found, width, q):
    """What two tilts q apart have in common in light of a Gaussian spectrum: SS |E[w J0 e^(i dk s)]|^2."""
    k, shares = spectrum_grid("gaussian", width)
    dk = k - k[0]
    power = np.square(np.abs(found.joint_correlation(q, dk)))
    place = np.arange(len(k))
    return (shares[:, None] * shares * power[np.abs(place[:, None] - place)]).sum()


@pytest.mark.parametrize("g", [0.9, 0.0])
def test_each_mode_has_the_memory_effect_of_its_gate(g):
    """To half a range within 1 %, at the half range within 2 %; one K for all modes is off by 25 % for g = 0.9."""
    found = correlation(g)
    width = 2 * found.half_width()
    modes = light_modes(found, width)
    half = kernel(g).half_range()
    for q, bound in ((0.0, 0.002), (0.5 * half, 0.01), (half, 0.02)):
        exact = intensity_correlation(found, width, q)
        ours = sum(s**2 * each(q) ** 2 for s, each in zip(modes.shares, modes.correlations, strict=True))
        assert ours == pytest.approx(exact, rel=bound)
    if g == 0.9:
        assert modes.contrast**2 * kernel(g)(half) ** 2 < 0.75 * exact
    together = sum(s * each(half) for s, each in zip(modes.shares, modes.correlations, strict=True))
    assert together + modes.flat * kernel(g)(half) == pytest.approx(kernel(g)(half), abs=2 * modes.flat)


def test_narrow_light_is_one_mode_and_wide_light_is_refused():
    found = correlation(0.0)
    one = light_modes(found, 0.0)
    assert one.shares.tolist() == pytest.approx([1.0])
    q = np.linspace(0, 3e-3, 7)
    np.testing.assert_allclose(one.correlations[0](q), kernel(0.0)(q), atol=1e-3)
    assert one.correlations[0].single_share == pytest.approx(found.single_share)
    with pytest.raises(ValueError, match="narrow enough for 64 modes of light.*Use a narrower filter"):
        light_modes(found, 100 * found.half_width())


def sampler(light=None, **changes):
    options = {"wavelength": 0.5, "object_shape": (1, 1), "object_pitch": 1e-5, "width": 5e4,
               "grid": FarFieldGrid(shape=(48, 48), pitch=0.5 / 5e4 / 2.5)} | changes  # fmt: skip
    return one_object(kernel(0.9), light=light, **options)


def squared_contrast(made, brightness, draws, offset=0):
    """Mean of (I/<I> - 1)^2 over the camera, one a draw: its expectation is contrast^2 without any bias."""
    scale = made.mean * brightness.sum()
    images = [made.image(made.medium(7, offset + n), brightness).double().numpy() / scale for n in range(draws)]
    return np.array([np.square(image - 1).mean() for image in images])


OBJECT = np.zeros((9, 9))
OBJECT[2, 1:8] = OBJECT[2:7, 4] = 1.0
WIDE = {"object_shape": OBJECT.shape, "object_pitch": 1.1e-5}


@pytest.mark.parametrize("area", [False, True])
@pytest.mark.parametrize("lit", [False, True])
def test_contrast_of_images(lit, area):
    """Of a beam and of an object, in one mode of light and in several, with points and with pixels of an area."""
    light = light_modes(correlation(0.9), 2 * correlation(0.9).half_width()) if lit else None
    for brightness, options in ((BEAM, {}), (OBJECT, WIDE)):
        made = sampler(light, pixel_integration=area, **options)
        found = squared_contrast(made, brightness, 150)
        # Modes leave out 1 % of the intensity; their contrast may differ from the kernel's by as much.
        slack = 0.0 if brightness is BEAM and not lit else 0.02 * made.contrast(brightness) ** 2
        assert_mean(found, made.contrast(brightness) ** 2, slack=slack)
        refute_mean(found, (1.15 * made.contrast(brightness)) ** 2, slack=slack)


def test_mean_of_images_in_wide_light():
    light = light_modes(correlation(0.9), 4 * correlation(0.9).half_width())
    assert light.flat > 0.05  # else nothing is tested
    made = sampler(light, **WIDE)
    images = [made.image(made.medium(3, n), OBJECT).mean().item() / (made.mean * OBJECT.sum()) for n in range(100)]
    assert_mean(np.array(images), 1.0)
    refute_mean(np.array(images) * (1 - light.flat), 1.0)


@pytest.mark.parametrize("spectrum", ["gaussian", "flat"])
def test_contrast_is_that_of_all_modes(spectrum):
    found = correlation(0.9, paths=10_000)
    for width in wavenumbers([0.2, 1.0]):
        modes = light_modes(found, width, spectrum, tolerance=0.0, most=1000)
        assert found.contrast(width, spectrum) == pytest.approx(modes.contrast, rel=1e-9)
        assert found.contrast(1.01 * width, spectrum) != pytest.approx(modes.contrast, rel=1e-5)
