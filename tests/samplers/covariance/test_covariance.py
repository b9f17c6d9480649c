"""Covariance of boxes against reference data in absolute units: Monte Carlo of 2019, and the wave equation."""

import numpy as np
import pytest
from scenes import DATA, ISOTROPIC, flat_box, views
from volume_batches import engine_batches, intensities
from zscore import assert_mean, assert_z, refute_mean, refute_z

import specklegen as sg
from specklegen.core.statistics import BATCHES, tail_factor
from specklegen.paths.tracer import volume_tracer
from specklegen.samplers.covariance.outer_products import all_pairs, outer_products


def load(name):
    with np.load(DATA / name) as file:
        return {key: file[key] for key in file.files}


def intensity_error(found):
    """Standard errors of ``found.intensity``."""
    shape = found.intensity.shape
    return found.standard_error.reshape(np.prod(shape), -1).diagonal().reshape(shape)


@pytest.fixture(scope="module")
def monte_carlo():
    return load("monte_carlo_2d_od2_reversed.npz")


@pytest.fixture(scope="module")
def isotropic(monte_carlo):
    """The reference's own scene."""
    scene = flat_box(monte_carlo["light_deg"], views(monte_carlo["view_deg"]))
    return sg.covariance(scene, paths=16_000, seed=1, reverse=True)


def test_intensities_are_those_of_the_reference(isotropic, monte_carlo):
    ours = isotropic.intensity.T
    # Total intensity, by the reference's batch error; ours is from three times fewer paths, better placed.
    totals = monte_carlo["I_batches"].sum(axis=0)
    error = totals.std(axis=1, ddof=1) / 4
    assert_z(ours.sum(axis=0), totals.mean(axis=1), np.sqrt(2) * error, degrees=15)
    np.testing.assert_allclose(ours.sum(axis=0), totals.mean(axis=1), rtol=0.015)
    refute_z(1.1 * ours.sum(axis=0), totals.mean(axis=1), np.sqrt(2) * error, degrees=15)


def test_every_entry_is_that_of_the_reference(isotropic, monte_carlo):
    """Root mean square of z over the complex entries; 1 where both errors are right."""
    value = np.moveaxis(isotropic.value[0], 1, 2)  # [view, view, light]
    error = np.sqrt(
        np.moveaxis(isotropic.standard_error[0], 1, 2) ** 2
        + monte_carlo["C_se_re"] ** 2 + monte_carlo["C_se_im"] ** 2
    )  # fmt: skip
    z = np.abs(value - monte_carlo["C"]) / error
    rms = np.sqrt(np.square(z).mean(axis=(0, 1)))
    assert ((rms > 0.8) & (rms < 1.2)).all(), f"rms z {rms}"
    assert np.sqrt(np.square(z).mean()) > 0.9
    assert np.sqrt(np.square(np.abs(1.1 * value - monte_carlo["C"]) / error).mean()) > 1.2  # power: 10 %


def test_standard_errors_are_honest(isotropic):
    """The scatter of independent runs is what each run says."""
    scene = flat_box([0, 4], views([0, 60, 180]))
    runs = [sg.covariance(scene, paths=640, seed=(3, n), reverse=True, threads=1) for n in range(BATCHES)]
    found = np.mean([np.abs(run.value - np.mean([r.value for r in runs], axis=0)) ** 2 for run in runs], axis=0)
    told = np.mean([run.standard_error**2 for run in runs], axis=0)
    ratio = found / told
    # A variance of 64 runs is known to about 1 / sqrt(32) of itself; entries hang together.
    assert 0.4 < ratio.min() <= ratio.max() < 2.2, ratio
    assert 0.75 < ratio.mean() < 1.3, ratio


def test_standard_errors_are_those_of_the_mean_of_batches():
    """To rounding: with one left out of n - 1, times what heavy tails add."""
    scene, paths = flat_box([0, 4], views([0, 60, 180])), 100 * BATCHES
    tracer = volume_tracer(scene, True)
    sums = outer_products(tracer, tracer.layout, paths, 1, reverse=True, entries=all_pairs(6), threads=1)
    means = sums.powers / 100  # of equally many paths
    error = means.std(axis=0, ddof=1) / np.sqrt(BATCHES) * tail_factor(means - means.mean(axis=0))
    np.testing.assert_allclose(sums.error.diagonal(), error, rtol=1e-9)


@pytest.fixture(scope="module")
def wave_solver():
    return load("wave_solver_2d_od2.npz")


@pytest.fixture(scope="module")
def cylinders():
    theta, real, imag = np.loadtxt(DATA / "cylinder_amplitude.csv", delimiter=",", skiprows=1, usecols=(0, 1, 2))[
        :361
    ].T
    return sg.Tabulated(theta=np.deg2rad(theta), amplitude=real + 1j * imag)


@pytest.fixture(scope="module")
def scattered(wave_solver, cylinders):
    scene = flat_box(wave_solver["light_deg"], views(wave_solver["view_deg"]), scatterer=cylinders)
    return sg.covariance(scene, paths=16_000, seed=2, reverse=True)


def test_intensities_are_those_of_the_wave_equation(scattered, wave_solver):
    """A07, absolute: totals within 2 %, single views within 4 % (wave effects of order 1/(k l)) and noise."""
    ours, truth = scattered.intensity.T, wave_solver["I_var"]
    np.testing.assert_allclose(ours.sum(axis=0), truth.sum(axis=0), rtol=0.02)
    error = np.hypot(intensity_error(scattered).T, wave_solver["I_var_se"])
    assert_z(ours, truth, error, degrees=15, slack=0.04 * truth)
    with pytest.raises(AssertionError):
        np.testing.assert_allclose(1.05 * ours.sum(axis=0), truth.sum(axis=0), rtol=0.02)


def test_correlations_are_those_of_the_wave_equation(scattered, wave_solver):
    for j, least in enumerate((0.995, 0.995, 0.980, 0.935)):
        ours, truth = scattered.value[0, :, j], wave_solver["C"][..., j]
        noise = np.square(scattered.standard_error[0, :, j]).sum()
        norm = np.sqrt((np.square(np.abs(ours)).sum() - noise) * np.square(np.abs(truth)).sum())
        assert abs(np.vdot(truth, ours)) / norm >= least


def test_backscattering_peak_is_that_of_the_wave_equation(scattered, wave_solver):
    """Peak over the mean of its neighbours at 160, 165, 195 and 200 degrees: 1.424 +- 0.03."""
    intensity = scattered.intensity[0]
    angles = np.round(np.asarray(wave_solver["view_deg"]) % 360).astype(int)
    around = np.mean([intensity[angles == a][0] for a in (160, 165, 195, 200)])
    assert intensity[angles == 180][0] / around == pytest.approx(1.424, abs=0.03 + 0.012)


@pytest.mark.slow
def test_near_field_line_is_that_of_the_wave_equation(wave_solver, cylinders):
    scene = flat_box(wave_solver["light_deg"], sg.NearField(points=wave_solver["near_pos"]), scatterer=cylinders)
    found = sg.covariance(scene, paths=16_000, seed=3, reverse=True)
    ours, truth = found.intensity.T, wave_solver["near_I_var"]
    np.testing.assert_allclose(ours.sum(axis=0), truth.sum(axis=0), rtol=0.05)
    error = np.hypot(intensity_error(found).T, wave_solver["near_I_var_se"])
    assert_z(ours, truth, error, degrees=15, slack=0.05 * truth)
    # The ridge between two lights: as correlated as far views are, where the waves have it, and not one point beside.
    for j, least in enumerate((0.995, 0.995, 0.980, 0.925)):
        ours, truth = found.value[0, :, j], wave_solver["near_C"][..., j]
        power = np.square(np.abs(ours)).sum() - np.square(found.standard_error[0, :, j]).sum()
        norm = np.sqrt(power * np.square(np.abs(truth)).sum())
        assert abs(np.vdot(truth, ours)) / norm >= least > abs(np.vdot(np.roll(truth, 1, axis=1), ours)) / norm


def test_cube_is_that_of_the_reference():
    """3D, forward only; the reference's single and multiple scattering apart."""
    reference = load("monte_carlo_3d_box_forward.npz")
    scene = sg.Scene(
        wavelength=1.0, medium=sg.Box(lower=[-50.0] * 3, upper=[50.0] * 3, mean_free_path=20.0, scatterer=ISOTROPIC),
        illumination=sg.PlaneWaves.tilts([0.0]), sensor=sg.FarField(directions=reference["v"].T),
    )  # fmt: skip
    entries = [[0, n, 0, n] for n in range(37)]
    found = sg.covariance(scene, paths=12_800, seed=4, reverse=False, pairs=entries)
    for ours, name in ((found.single, "I_single"), (found.multiple, "I_multiple")):
        batches = reference[f"{name}_batches"]
        error = np.sqrt(found.standard_error**2 + batches.var(axis=1, ddof=1) / 16)
        assert_z(ours.real, reference[name], error, degrees=15)
    # Exact anchors of single scattering, forward and back.
    np.testing.assert_allclose(reference["I_single"][[0, 36]], [26.809, 397.87], rtol=0.02)
    refute_z(2 * ours.real, reference[name], error, degrees=15)


@pytest.mark.parametrize("albedo", [1.0, 0.6])
def test_energy_in_flatland(albedo):
    """A02: 36 views integrate a smooth intensity; what is absorbed is missing."""
    angles = np.arange(36) * 10 + 5.0
    scene = flat_box([0.0], views(angles), half=5.0, mean_free_path=5.0, scatterer=sg.HenyeyGreenstein(g=0.5),
                     albedo=albedo)  # fmt: skip
    flux = intensities(engine_batches(scene, 200, reverse=False, seed=5)).mean(axis=1) * 2 * np.pi
    lost = 10 * (1 - np.exp(-2))
    if albedo == 1.0:
        assert_mean(flux, lost)
        refute_mean(1.1 * flux, lost)
    else:
        assert flux.mean() < 0.75 * lost


def test_a_batch_may_be_traced_in_pieces(monkeypatch):
    """What bounds the memory of a long run changes nothing but rounding."""
    scene = flat_box([0.0, 1.0], views([0.0, 90.0, 180.0]))
    whole = sg.covariance(scene, paths=6400, seed=3)
    monkeypatch.setattr("specklegen.samplers.covariance.outer_products._PATHS_AT_ONCE", 33)
    pieces = sg.covariance(scene, paths=6400, seed=3)
    scale = np.abs(whole.value).max()
    for name in ("value", "single", "multiple", "standard_error"):
        np.testing.assert_allclose(getattr(pieces, name), getattr(whole, name), rtol=1e-9, atol=1e-12 * scale)
