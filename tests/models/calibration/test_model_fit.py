"""Fits of layers by Monte Carlo: the truth within intervals, errors of models told by chi squared."""

import numpy as np
import pytest
from refusals import assert_refused
from scipy.stats import binom, chi2

import specklegen as sg
from specklegen.measured import BallisticFraction, ContrastVersusBandwidth, MemoryCurve, TemporalCurve, Transmittance
from specklegen.models.calibration import model_fit
from specklegen.synthesis.spectrum import estimate_spectral_correlation

FALSE_ALARM = 1e-6
WAVELENGTH = 0.5
TILTS = np.linspace(2e-4, 2e-3, 6)


def cell(g, thickness=100.0, mean_free_path=50.0):
    window = sg.Layer(thickness=50.0, mean_free_path=50.0, scatterer=sg.HenyeyGreenstein(0.8), index=1.41)
    return sg.Layers([window, sg.Layer(thickness=thickness, mean_free_path=mean_free_path, index=1.33,
                                       scatterer=sg.HenyeyGreenstein(g))])  # fmt: skip


def walled(mean_free_path, g):
    return sg.Slab(thickness=1000.0, mean_free_path=mean_free_path, scatterer=sg.HenyeyGreenstein(g),
                   faces=sg.Faces(inside=1.33))  # fmt: skip


def curve_of(medium, rng, error, tilts=TILTS, paths=100_000, wavelength=WAVELENGTH):
    exact = sg.memory_effect(medium, wavelength=wavelength, tilts=tilts, paths=paths, seed=99).intensity
    return MemoryCurve(tilts, exact + error * rng.normal(size=len(tilts)), error)


def formula(monkeypatch, noise=0.01):
    """Runs of a known curve, exp(-(a t)^b), with an error of their own, in place of Monte Carlo."""
    at = np.linspace(0.2, 2.0, 12)

    def run(owner, observations, media, wavelengths, budget, key):
        drawn = np.random.default_rng((budget.seed, *key)).normal(size=len(at))
        medium = media[0]
        return np.exp(-((medium.mean_free_path * at) ** medium.thickness)) + noise * drawn

    monkeypatch.setattr(model_fit, "_run", run)
    return at


def fitted(at, rng, seed, error=0.02, **known):
    """Fit a = 1 and b = 1.5, or a alone."""
    data = MemoryCurve(1e-3 * at, np.exp(-(at**1.5)) + error * rng.normal(size=len(at)), error)
    free = {name: ends for name, ends in {"a": (0.3, 3.0), "b": (0.5, 3.0)}.items() if name not in known}

    def model(**numbers):
        numbers |= known
        return sg.Slab(thickness=numbers["b"], mean_free_path=numbers["a"], scatterer=sg.Isotropic())

    return sg.fit_material(data, wavelength=0.5, model=model, free=free, seed=seed)


def test_intervals_hold_the_truth_of_a_known_curve(monkeypatch):
    """40 numbers of 20 sets of data: those that 68 % intervals hold, by the binomial law, and z squared."""
    at, rng = formula(monkeypatch), np.random.default_rng(0)
    held, squares = 0, []
    for seed in range(20):
        fit = fitted(at, rng, seed)
        monkeypatch.setattr(type(fit), "critical", lambda self, level: np.full(2, chi2.ppf(level, 1)))
        bounds = fit.interval(0.68)
        held += (1.0 in bounds["a"]) + (1.5 in bounds["b"])
        squares.append(np.square(fit.problem.model(np.array([[0.7 / 2.7, 0.4]]))[0]).sum() - fit.chi_squared)
    # Numbers of one set are not independent: as if only half of them were.
    assert binom.ppf(1e-3, 20, 0.68) <= held / 2 <= binom.isf(1e-3, 20, 0.68)
    assert chi2.ppf(FALSE_ALARM, 40) < np.sum(squares) < chi2.isf(FALSE_ALARM, 40)


def test_an_error_of_a_held_number_is_caught_by_chi_squared(monkeypatch):
    at, rng = formula(monkeypatch, noise=1e-4), np.random.default_rng(1)
    assert fitted(at, rng, 0, error=1e-3, b=1.5).p_value > 1e-4
    assert fitted(at, rng, 0, error=1e-3, b=1.515).p_value < 1e-4


def test_layers_with_steps_of_the_index_are_fitted_and_one_per_cent_is_caught():
    rng = np.random.default_rng(1)
    light = sg.reflectance_transmittance(cell(0.92), paths=1000).ballistic
    data = [curve_of(cell(0.92), rng, 0.02), BallisticFraction(light * (1 + 0.003 * rng.normal()), 0.003 * light)]
    fit = sg.fit_material(data, wavelength=WAVELENGTH, model=cell, free={"g": (0.8, 0.98)}, paths=2000)
    assert fit.p_value > 1e-4
    assert fit.media[0] == cell(fit.values["g"])
    at = np.array([[(0.92 - 0.8) / 0.18]])
    assert np.square(fit.problem.model(at)[0]).sum() - fit.chi_squared < chi2.isf(FALSE_ALARM, 1)
    assert_refused(lambda: fit.slab, "MaterialFit.slab .* Use .media")
    assert_refused(lambda: fit.recipe("cell"), "MaterialFit.slab")
    wrong = sg.fit_material(data, wavelength=WAVELENGTH, model=lambda g: cell(g, mean_free_path=50.5),
                            free={"g": (0.8, 0.98)}, paths=2000)  # fmt: skip
    assert wrong.hopeless
    assert_refused(wrong.interval, "MaterialFit.interval .*force=True")
    assert set(wrong.interval(force=True)) == {"g"}


def test_a_slab_with_a_step_of_the_index_is_no_slab_of_the_tables():
    """The tables fit it by g = -0.36 for 0.9; chi squared tells, and no interval is given."""
    true, tilts, rng = walled(100.0, 0.9), np.linspace(1e-4, 8e-4, 8), np.random.default_rng(1)
    found = sg.fit_material(curve_of(true, rng, 0.01, tilts), wavelength=WAVELENGTH, known={"thickness": 1000.0},
                free=("mean_free_path", "g"))  # fmt: skip
    assert found.values["g"] < 0
    assert found.hopeless
    assert_refused(found.interval, "MaterialFit.interval .*fit another model")


@pytest.mark.slow
def test_several_thicknesses_and_wavelengths_share_numbers():
    """Five seeds: g of two layers from curves of two thicknesses at two wavelengths; the sum of z squared."""
    thicknesses, wavelengths = (100.0, 300.0), (0.5, 0.6)
    squares = []
    for seed in range(5):
        rng = np.random.default_rng(seed)
        data = [curve_of(cell(0.92, L), rng, 0.01, wavelength=w) for L, w in zip(thicknesses, wavelengths, strict=True)]
        fit = sg.fit_material(data, wavelength=wavelengths, model=lambda g: [cell(g, L) for L in thicknesses],
                              free={"g": (0.6, 0.98)}, paths=10_000, seed=seed)  # fmt: skip
        at = np.array([[(0.92 - 0.6) / 0.38]])
        squares.append(np.square(fit.problem.model(at)[0]).sum() - fit.chi_squared)
        assert fit.p_value > 1e-4
    assert np.sum(squares) < chi2.isf(FALSE_ALARM, 5)


@pytest.mark.slow
def test_profiles_behind_a_step_of_the_index_hold_the_truth():
    """Ten sets of mean free path and g, which data tell badly: of twenty 95 % intervals at most five miss (p 3e-4 if
    all are independent). The lookup tables, which know no step, fit them with wrong numbers."""
    true, tilts = walled(200.0, 0.9), np.linspace(1e-4, 8e-4, 6)
    light = sg.reflectance_transmittance(true, paths=500_000, seed=99).transmittance
    held, rises = 0, []
    for seed in range(10):
        rng = np.random.default_rng(seed)
        data = [curve_of(true, rng, 0.02, tilts, 1_000_000), Transmittance(light + 0.01 * rng.normal(), 0.01)]
        fit = sg.fit_material(data, wavelength=WAVELENGTH, model=walled, paths=4000, seed=seed,
                              free={"mean_free_path": (100.0, 400.0), "g": (0.6, 0.97)})  # fmt: skip
        bounds = fit.interval(0.95)
        held += (200.0 in bounds["mean_free_path"]) + (0.9 in bounds["g"])
        rises.append(np.square(fit.problem.model(np.array([[1 / 3, 0.3 / 0.37]]))[0]).sum() - fit.chi_squared)
    assert held >= 15
    assert np.sum(rises) < chi2.isf(FALSE_ALARM, 20)


def test_curves_in_time_and_units():
    def cell(diffusion):
        return sg.Slab(thickness="100 um", mean_free_path="50 um", scatterer=sg.HenyeyGreenstein(0.8),
                       motion=sg.Brownian(diffusion=f"{diffusion} um^2/s"))  # fmt: skip

    lags = np.array([1e-3, 3e-3, 1e-2])
    exact = 1 + sg.temporal_correlation(cell(2.0), wavelength="500 nm", lags=[f"{lag} s" for lag in lags]).intensity
    data = TemporalCurve([f"{lag} s" for lag in lags], exact, 0.02)
    fit = sg.fit_material(data, wavelength="500 nm", model=cell, free={"diffusion": (0.5, 8.0)}, paths=1000)
    assert 2.0 in fit.interval(0.999)["diffusion"]


def test_contrast_in_light_of_many_wavelengths():
    """Of layers of two kinds, and of a slab behind its faces."""
    def pair(g):
        layer = sg.Layer(thickness=50.0, mean_free_path=25.0, scatterer=sg.HenyeyGreenstein(g))
        return sg.Layers([layer, layer.replace(scatterer=sg.HenyeyGreenstein(0.3))])

    widths = np.array([0.01, 0.03, 0.1])
    light = estimate_spectral_correlation(pair(0.8), 50_000, 99)
    exact = [light.contrast(width) for width in widths]
    data = ContrastVersusBandwidth(widths, exact, 0.01)
    fit = sg.fit_material(data, wavelength=0.5, model=pair, free={"g": (0.5, 0.95)}, paths=500)
    assert 0.8 in fit.interval(0.999)["g"]
    assert 0.85 not in fit.interval(0.999)["g"]
    far = ContrastVersusBandwidth([0.01], [0.5], 0.1)
    assert sg.fit_material(far, wavelength=0.5, model=lambda g: walled(200.0, g), free={"g": (0.5, 0.9)},
                           paths=100).degrees == 0  # fmt: skip
    for medium in (cell(0.8), pair(0.8).replace(polarisation="projector")):
        ask = {"wavelength": 0.5, "model": lambda g, medium=medium: medium, "free": {"g": (0.5, 0.9)}}
        assert_refused(lambda ask=ask: sg.fit_material(data, **ask), "medium must be|model must be")
