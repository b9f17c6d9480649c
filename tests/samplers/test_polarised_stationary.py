"""The stationary sampler of polarised slabs: stacks, films and images of objects against curves that know no modes."""

import warnings
from functools import cache

import numpy as np
import pytest
import torch
from scenes import slab as slab_of_depth
from zscore import assert_z, refute_z

import specklegen as sg
from specklegen.core.errors import RuleError
from specklegen.memory_effects.polarised_fields import estimate_polarised_correlation
from specklegen.synthesis.objects import object_imaging

WAVELENGTH, WIDTH, THICKNESS, PATHS = 0.5, 40_000.0, 1000.0, 40_000
SINE = 1.5 * WAVELENGTH / (2 * np.pi * THICKNESS)
SHIFT = 20  # views by which a tilt moves its pattern
CHANNELS = {"co": sg.Polarisers.parallel, "crossed": sg.Polarisers.crossed}


def slab(depth=2.0, scatterer=None, **fields):
    found = slab_of_depth(depth, thickness=THICKNESS)
    return found.replace(scatterer=scatterer or sg.Rayleigh(), **{"polarisation": "projector"} | fields)


def beams(sines, **fields):
    sines = np.asarray(sines, dtype=np.float64)
    along = np.sqrt(1 - np.square(sines).sum(axis=1))
    return sg.CollimatedBeams(directions=np.column_stack([sines, along]), width=WIDTH, **fields)


def scene(polarisers, light, medium=None, side=32):
    return sg.Scene(wavelength=WAVELENGTH, medium=medium or slab(), illumination=light, polarisers=polarisers,
                    sensor=sg.FarField.grid((side, side), SINE / SHIFT))  # fmt: skip


def correlation(fields, rows=0, columns=0, beam=1):
    """C_I of one beam with the first, a pattern so many views further, and its error: complex[R, T, H, W]."""
    high, wide = fields.shape[2] - rows, fields.shape[3] - columns
    one, other = fields[:, 0, :high, :wide], fields[:, beam, rows:, columns:]
    sums = np.array([(one * other.conj()).sum((1, 2)), *(np.square(np.abs(f)).sum((1, 2)) for f in (one, other))])

    def value(left):
        return np.abs(left[0]) ** 2 / np.abs(left[1] * left[2])

    without = value(sums.sum(axis=1, keepdims=True) - sums)
    media = len(fields)
    return value(sums.sum(axis=1)), np.sqrt((media - 1) * without.var())


@pytest.fixture(scope="module")
def curves():
    """C_I along, across and at 45 degrees, of 7/10 of the tilt along both axes, with their errors, by channel."""
    diagonal = 0.7 * np.sqrt(2) * SINE
    tilts = {"along": (0.0, SINE), "across": (np.pi / 2, SINE), "45": (np.pi / 4, diagonal),
             "along, turned": (0.0, diagonal), "across, turned": (np.pi / 2, diagonal)}  # fmt: skip

    @cache
    def curve(channel, name):
        azimuth, sine = tilts[name]
        return sg.memory_effect(slab(), wavelength=WAVELENGTH, tilts=[np.arcsin(sine)], channel=channel,
                                azimuth=azimuth, paths=PATHS, seed=4)  # fmt: skip

    return curve


@pytest.mark.parametrize("channel", CHANNELS)
def test_stacks_correlate_as_the_memory_effect_says(curves, channel):
    """Along, across and at 45 degrees; the curve along the polarisation is not that across it."""
    light = beams([[0, 0], [SINE, 0], [0, SINE], [0.7 * SINE, 0.7 * SINE]])
    asked = scene(CHANNELS[channel](), light)
    assert sg.plan(asked).sampler == "stationary"
    fields = sg.render(asked, seed=3, realizations=60, paths=PATHS).field
    moved = {"along": (0, SHIFT), "across": (SHIFT, 0), "45": (14, 14)}
    for beam, (name, shift) in enumerate(moved.items(), start=1):
        value, error = correlation(fields, *shift, beam)
        curve = curves(channel, name)
        assert_z(value, curve.intensity[0], np.hypot(error, 1.5 * curve.standard_error[0]), degrees=59)
    if channel == "co":
        value, error = correlation(fields, 0, SHIFT)
        refute_z(value, curves(channel, "across").intensity[0], np.hypot(error, 0.01), degrees=59)
    light = sg.mueller_matrix(slab(), wavelength=WAVELENGTH, paths=PATHS, seed=9)
    lit = np.square(np.abs(fields)).mean(axis=(1, 2, 3))
    error = np.hypot(lit.std() / np.sqrt(len(lit)), 2 * light.standard_error[0, 0] * WIDTH**2)
    assert_z(lit.mean(), light.intensity(*asked.polarisers.fields) * WIDTH**2, error, degrees=59)


def test_a_seed_is_one_medium_behind_all_analysers():
    """Fields are linear in the analyser, and without one contrast is sqrt((1 + P^2) / 2)."""
    light = beams([[0, 0], [SINE, 0]])

    def fields(analyser):
        polarisers = sg.Polarisers(light=[1, 0], analyser=analyser)
        return sg.render(scene(polarisers, light), seed=5, realizations=30, paths=PATHS, sampler="stationary").field

    co, crossed = fields([1, 0]), fields([0, 1])
    both = fields([1, 1j])
    np.testing.assert_allclose(both, (co - 1j * crossed) / np.sqrt(2), atol=1e-5 * np.abs(co).max())
    found = np.square(np.abs(co)) + np.square(np.abs(crossed))
    contrast = found.std(axis=(1, 2, 3)) / found.mean(axis=(1, 2, 3))
    known = sg.mueller_matrix(slab(), wavelength=WAVELENGTH, paths=PATHS, seed=9).contrast
    assert_z(contrast.mean(), known, contrast.std() / np.sqrt(len(contrast)), degrees=29)
    refute_z(contrast.mean(), 1.0, contrast.std() / np.sqrt(len(contrast)), degrees=29)


@pytest.mark.parametrize("channel", CHANNELS)
@pytest.mark.parametrize("sampler", ["stationary", "paths"])
def test_films_forget_as_the_temporal_correlation_says(channel, sampler):
    medium = slab(motion=sg.Brownian(diffusion=1e-4))
    curve = sg.temporal_correlation(medium, wavelength=WAVELENGTH, lags=[2.0, 5.0], channel=channel, paths=PATHS,
                                    seed=4)  # fmt: skip
    film = beams(np.zeros((3, 2)), times=[0.0, 2.0, 5.0])
    asked = scene(CHANNELS[channel](), film, medium, side=8 if sampler == "paths" else 24)
    budget = {"paths": 1500, "realizations": 24} if sampler == "paths" else {"paths": PATHS, "realizations": 40}
    fields = sg.render(asked, seed=3, sampler=sampler, **budget).field
    for frame in (1, 2):
        value, error = correlation(fields, beam=frame)
        expected, own = curve.intensity[frame - 1], curve.standard_error[frame - 1]
        assert_z(value, expected, np.hypot(error, 1.5 * own), degrees=23)


def seen(polarisers, bright, pitch=SINE, **budget):
    """Images of an object of some pixels, of three by three."""
    brightness = np.zeros((3, 3))
    for row, column in bright:
        brightness[row, column] = 1.0
    light = sg.IncoherentObject(brightness=brightness, pitch=pitch, width=WIDTH)
    asked = scene(polarisers, light, side=36)
    return asked, sg.render(asked, sampler="stationary", **budget).intensity.astype(np.float64)


def second_peak(images, rows, columns):
    """Covariance of two views so many apart over the squared mean, times 4: C_I of two points that cast them."""
    high, wide = images.shape[1] - rows, images.shape[2] - columns
    one, other = images[:, :high, :wide], images[:, rows:, columns:]
    sums = np.array([(one * other).mean((1, 2)), one.mean((1, 2)), other.mean((1, 2))])

    def value(mean):
        return 4 * (mean[0] - mean[1] * mean[2]) / (mean[1] * mean[2])

    media = len(images)
    without = value((sums.sum(axis=1, keepdims=True) - sums) / (media - 1))
    return value(sums.mean(axis=1)), np.sqrt((media - 1) * without.var())


TWO_POINTS = {"along": (0.0, SINE, ((1, 0), (1, 1)), (0, SHIFT)), "across": (0.0, SINE, ((0, 1), (1, 1)), (SHIFT, 0)),
              "45": (0.0, 0.7 * SINE, ((0, 0), (1, 1)), (14, 14)),
              "along, turned": (np.pi / 4, 0.7 * SINE, ((0, 0), (1, 1)), (14, 14)),
              "across, turned": (-np.pi / 4, 0.7 * SINE, ((0, 0), (1, 1)), (14, 14))}  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize(("channel", "name"), [("crossed", "along"), *(("co", name) for name in TWO_POINTS)])
def test_images_of_objects_see_the_memory_effect(curves, channel, name):
    """Two points cast two images of one pattern, as alike as C_I, along the polarisation and across it."""
    angle, pitch, bright, shift = TWO_POINTS[name]
    asked, images = seen(CHANNELS[channel](angle), bright, pitch, seed=6, realizations=150, paths=PATHS)
    value, error = second_peak(images, *shift)
    curve = curves(channel, name)
    assert_z(value, curve.intensity[0], np.hypot(error, 1.5 * curve.standard_error[0]), degrees=149)
    light = sg.mueller_matrix(slab(), wavelength=WAVELENGTH, paths=PATHS, seed=9)
    lit, power = images.mean(axis=(1, 2)), 2 * light.intensity(*asked.polarisers.fields) * WIDTH**2
    assert_z(lit.mean(), power, np.hypot(lit.std() / np.sqrt(len(lit)), 0.02 * power), degrees=149)
    if name == "across":
        refute_z(value, curves(channel, "along").intensity[0], error, degrees=149)


def test_modes_and_contrast_are_those_of_all_pairs_of_pixels():
    """By the matrix of K between all beams: of light at an angle to the pixels, whose K no mirror leaves as it is."""
    known = estimate_polarised_correlation(slab(), sg.Polarisers.parallel(0.4), 5000, 1)
    step = 2 * np.pi / WAVELENGTH * SINE
    y, x = (each.ravel() for each in np.mgrid[:4, :5] * step)
    pairs = known.planar(x[:, None] - x, y[:, None] - y)
    assert np.linalg.eigvalsh(pairs).min() > -1e-6
    grid = sg.FarField.grid((8, 8), 2e-6)
    made = object_imaging(known, wavelength=WAVELENGTH, object_shape=(4, 5), object_pitch=SINE, width=10.0, grid=grid,
                          tolerance=1e-6, dtype=torch.complex128)  # fmt: skip
    modes = made.modes[0, 0]
    np.testing.assert_allclose(modes.T @ modes, pairs, atol=1e-4)
    light = torch.rand((1, 4, 5), generator=torch.Generator().manual_seed(1), dtype=torch.float64)
    weights = light.flatten()
    # A window so narrow that all pixels' patterns lie upon each other.
    expected = float(weights @ torch.from_numpy(pairs**2) @ weights) ** 0.5 / float(weights.sum())
    assert abs(float(made.contrast(light)[0]) - expected) < 1e-3 * expected
    mirrored = float(weights @ torch.from_numpy(known.planar(x[:, None] - x, y - y[:, None]) ** 2) @ weights) ** 0.5
    assert abs(mirrored / float(weights.sum()) - expected) > 2e-3 * expected


@pytest.mark.parametrize("lobe", ["rayleigh", "mie"])
def test_circular_light_and_amplitude_matrices_are_drawn_too(lobe):
    """Kept helicity against path sums: the mean, and C_I of a tilt."""
    pytest.importorskip("miepython")
    scatterer = sg.Rayleigh() if lobe == "rayleigh" else sg.Mie(radius=0.2, wavelength=WAVELENGTH, refractive_index=1.2)
    medium = slab(scatterer=scatterer, polarisation="vector")
    light = beams([[0, 0], [SINE, 0]])
    asked = scene(sg.Polarisers.circular(), light, medium)
    fields = sg.render(asked, seed=3, realizations=40, paths=PATHS, sampler="stationary").field
    value, error = correlation(fields, 0, SHIFT)
    views = sg.FarField(directions=[[0.0, 0.0, 1.0], [SINE, 0.0, np.sqrt(1 - SINE**2)]])
    known = sg.covariance(asked.replace(sensor=views), paths=30_000, seed=4,
                          pairs=[[0, 0, 1, 1], [0, 0, 0, 0], [1, 1, 1, 1]])  # fmt: skip
    squared = abs(known.value[0]) ** 2 / abs(known.value[1] * known.value[2])
    relative = 2 * (known.standard_error / abs(known.value)).max()
    assert_z(value, squared, np.hypot(error, squared * relative), degrees=39)


def test_light_aside_of_the_axis_is_that_of_the_covariance():
    """Views at 8 degrees, whose correlation is complex and not even: intensity and C_I behind either analyser."""
    tissue = slab(5.0, sg.HenyeyGreenstein(0.9))
    centre = (0.1, 0.1)
    one, other = (np.array([x, 0.1, 0.0]) for x in (0.1, 0.1 + SINE))
    views = sg.FarField(directions=[each + [0, 0, np.sqrt(1 - each @ each)] for each in (one, other)])
    for name, polarisers in CHANNELS.items():
        asked = scene(polarisers(), beams([[0, 0], [SINE, 0]]), tissue)
        grid = sg.FarField.grid((32, 32), SINE / SHIFT, center=centre)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", sg.DoubtWarning)  # of the crossed one
            fields = sg.render(asked.replace(sensor=grid), seed=3, realizations=40, paths=PATHS,
                               sampler="stationary").field  # fmt: skip
        value, error = correlation(fields, 0, SHIFT)
        known = sg.covariance(asked.replace(sensor=views), paths=20_000, seed=4,
                              pairs=[[0, 0, 1, 1], [0, 0, 0, 0], [1, 1, 1, 1]])  # fmt: skip
        squared = abs(known.value[0]) ** 2 / abs(known.value[1] * known.value[2])
        own = (known.standard_error / abs(known.value)).max()
        slack = 0.02 if name == "co" else 0.04  # what the planner says of either
        assert_z(value, squared, np.hypot(error, 2 * squared * own), degrees=39, slack=slack)
        lit = np.square(np.abs(fields)).mean(axis=(1, 2, 3))
        spread = np.hypot(lit.std() / np.sqrt(len(lit)), 1.5 * own * abs(known.value[1]))
        assert_z(lit.mean(), abs(known.value[1]), spread, degrees=39)


def test_an_analyser_that_nothing_passes_is_dark():
    asked = scene(CHANNELS["crossed"](), beams([[0, 0], [SINE, 0]]), slab(1e-6))
    assert not sg.render(asked, seed=1, paths=20, sampler="stationary").field.any()


def test_what_the_stationary_sampler_cannot_serve_is_refused():
    with pytest.raises(RuleError, match="sampler must be"):
        sg.plan(scene(CHANNELS["co"](), beams([[0, 0]])), sampler="stationary", reverse=True)
    with pytest.raises(RuleError, match="Scene.medium must be of polarisation"):
        scene(CHANNELS["co"](), beams([[0, 0]], times=[0.0], exposure=1.0), slab(motion=sg.Brownian(diffusion=1e-4)))
