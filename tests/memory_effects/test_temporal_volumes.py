"""How speckle of boxes and voxels forgets: against walks by hand, the covariance of scenes, and both ways of a path."""

import numpy as np
import pytest
from zscore import assert_z, refute_z

import specklegen as sg
from specklegen.core.errors import RuleError
from specklegen.core.statistics import jackknife

K = 2 * np.pi  # of wavelength 1
SIGMA, ALBEDO = 0.5, 0.9
LOW, HIGH = np.array([-3.0, -2.0, 0.0]), np.array([3.0, 2.0, 4.0])
FLUID, FLOW = sg.Brownian(diffusion=1 / K**2), sg.Drift(velocity=[1.0, -2.0, 3.0])
X, TIMES = np.array([0.05, 0.2, 0.8]), np.array([0.02, 0.05, 0.1])
VIEWS = {"transmission": [0.48, 0.36, 0.8], "reflection": [0.6, 0.0, -0.8]}


def walked(view, motion, lags, paths=80_000, seed=1):
    """Sums complex128[64, lags] of w e^(-2 x Y), or of w e^(-i k t D): what moves is where x > 0. Photons enter through
    the lower face, evenly, along z; isotropic scatterers."""
    rng, view = np.random.default_rng(seed), np.asarray(view)
    place = np.stack([rng.uniform(-3, 3, paths), rng.uniform(-2, 2, paths), np.zeros(paths)], 1)
    way, batch = np.tile([0.0, 0.0, 1.0], (paths, 1)), np.arange(paths) % 64
    turned, shift, weight = np.zeros(paths), np.zeros(paths), np.ones(paths)
    sums = np.zeros((64, len(lags)), complex)
    while len(place):
        place = place + rng.exponential(1 / SIGMA, len(place))[:, None] * way
        inside = ((place > LOW) & (place < HIGH)).all(1)
        place, way, batch, turned, shift, weight = (
            each[inside] for each in (place, way, batch, turned, shift, ALBEDO * weight)
        )
        along = np.flatnonzero(view)
        left = np.min((np.where(view > 0, HIGH, LOW) - place)[:, along] / view[along], axis=1)
        seen = weight * np.exp(-SIGMA * left)
        moves = place[:, 0] > 0
        y, d = turned + moves * (1 - way @ view), shift + moves * ((way - view) @ FLOW.velocity)
        for n, lag in enumerate(lags):
            wave = seen * (np.exp(-2 * lag * y) if motion is FLUID else np.exp(-1j * K * lag * d))
            sums[:, n] += np.bincount(batch, wave.real, 64) + 1j * np.bincount(batch, wave.imag, 64)
        onward = rng.normal(size=place.shape)
        onward /= np.linalg.norm(onward, axis=1, keepdims=True)
        turned, shift = turned + moves * (1 - (way * onward).sum(1)), shift + moves * ((way - onward) @ FLOW.velocity)
        way = onward
    return sums


def halves(motion):
    """Voxels of which those of x > 0 move."""
    return sg.VoxelGrid(lower=LOW, upper=HIGH, extinction=np.full((1, 1, 2), SIGMA), albedo=ALBEDO, material=[[[0, 1]]],
                        scatterers=[sg.Isotropic()] * 2, motion=(None, motion))  # fmt: skip


@pytest.mark.parametrize("motion", [FLUID, FLOW], ids=["Brownian", "flow"])
@pytest.mark.parametrize("mode", VIEWS)
def test_voxels_that_move_in_one_half(motion, mode):
    """By a literal walk; what moves 25 % faster is told."""
    lags = X if motion is FLUID else TIMES
    found = sg.temporal_correlation(halves(motion), wavelength=1.0, lags=lags, mode=mode, view=VIEWS[mode],
                                    paths=40_000, reverse=False)  # fmt: skip
    np.testing.assert_allclose(found.x, X if motion is FLUID else 0.0)
    own = np.repeat(found.standard_error / 2 / np.abs(found.field), 2)

    sums = walked(VIEWS[mode], motion, [0.0, *lags, *1.25 * lags])
    (right, faster), (error, _) = (
        np.split(each, 2) for each in jackknife(sums, lambda s: (s[1:] / s[0].real).view(float))
    )
    assert_z(found.field.view(float), right, np.hypot(own, error), degrees=63)
    refute_z(found.field.view(float), faster, np.hypot(own, error), degrees=63)
    still = sg.temporal_correlation(halves(motion), wavelength=1.0, lags=[1e9], mode=mode, view=VIEWS[mode], paths=4000)
    assert 0.1 < still.static_share < 0.9  # what met nothing that moves


BOX = sg.Box(lower=LOW, upper=HIGH, mean_free_path=2.0, albedo=ALBEDO, scatterer=sg.HenyeyGreenstein(0.4), motion=FLUID)


def test_a_tilt_is_that_of_the_covariance_and_a_lag_goes_into_the_same_mean():
    """At rest K(q) of a scene of both pairs; with a lag neither factor alone."""
    tilts, view = np.array([0.0, 0.06, 0.15]), np.array([0.3, 0.0, np.sqrt(0.91)])
    asked = {"wavelength": 1.0, "view": view, "paths": 30_000}
    still = sg.temporal_correlation(BOX, lags=0.0, tilts=tilts, **asked)
    views = np.stack([0.3 + np.sin(tilts), 0 * tilts, np.sqrt(1 - (0.3 + np.sin(tilts)) ** 2)], 1)
    scene = sg.Scene(wavelength=1.0, medium=BOX, illumination=sg.PlaneWaves.tilts(tilts), sensor=sg.FarField(views))
    pairs = [[0, 0, n, n] for n in range(3)] + [[n, n, n, n] for n in range(3)]
    known = sg.covariance(scene, pairs=pairs, paths=30_000, seed=7, orders="all", reverse=False)
    power = known.value[3:].real
    expected = known.value[:3] / np.sqrt(power[0] * power)
    error = np.hypot(still.standard_error / 2, known.standard_error[:3] / power[0])[1:]
    assert_z(np.abs(still.field)[1:], np.abs(expected)[1:], error)
    both = sg.temporal_correlation(BOX, lags=[0.1], tilts=[0.15], **asked)
    lag = sg.temporal_correlation(BOX, lags=[0.1], **asked)
    assert abs(both.field[0]) < min(abs(lag.field[0]), abs(still.field[2]))


def test_both_ways_of_a_path_move_together():
    """At v = -i: (S a + M g) / (S + M), and with both ways (S a + 2 M g) / (S + 2 M), a = e^(-4 x)."""
    view, x = [0.0, 0.0, -1.0], 0.1
    asked = {"wavelength": 1.0, "mode": "reflection", "view": view, "paths": 30_000}
    one, both = (sg.temporal_correlation(BOX, lags=[x], reverse=way, **asked) for way in (False, True))
    assert both.reverse
    scene = sg.Scene(wavelength=1.0, medium=BOX, illumination=sg.PlaneWaves.tilts([0.0]), sensor=sg.FarField([view]))
    known = sg.covariance(scene, paths=30_000, orders="all", reverse=False)
    single = float((known.single / known.value).real.ravel()[0])

    def multiple(found, ways):
        total, share, g1 = single + ways * (1 - single), ways * (1 - single), found.field.real[0]
        return (g1 * total - single * np.exp(-4 * x)) / share, found.standard_error[0] / 2 / g1 * total / share

    (g, error), (same, other) = multiple(one, 1), multiple(both, 2)
    assert_z(g, same, np.hypot(error, other))
    (alike, other) = multiple(both, 1)
    refute_z(g, alike, np.hypot(error, other))


def test_a_box_in_flatland_scatters_once_by_its_law():
    thin = sg.Box(lower=[-20.0, 0.0], upper=[20.0, 0.02], mean_free_path=10.0, scatterer=sg.Isotropic(), motion=FLUID)
    found = sg.temporal_correlation(thin, wavelength=1.0, lags=[0.0, 0.3], view=[0.6, 0.8], paths=2000)
    np.testing.assert_allclose(found.field.real, [1.0, np.exp(-2 * 0.3 * 0.2)], rtol=0.01)  # some scatter twice
    contrast = found.contrast([0.3]).squared[0]
    assert np.exp(-4 * 0.3 * 0.2) < contrast < 1


def test_a_medium_that_moves_as_one_forgets_nothing():
    found = sg.temporal_correlation(BOX.replace(motion=FLOW), wavelength=1.0, lags=[0.0, 0.3], paths=300)
    np.testing.assert_allclose(found.intensity, 1.0, rtol=1e-9)


@pytest.mark.parametrize(("changes", "asked", "says"), [
    ({"motion": None}, {}, "medium must be a medium of moving particles"),
    ({}, {"view": [0.6, 0.8]}, "view must be a unit vector of shape"),
    ({}, {"view": [0.0, 0.0, -1.0]}, "view must be a unit vector of shape"),
    ({}, {"tilts": 2.0}, "tilts must be radians between"), ({}, {"mode": "aside"}, "mode must be one of"),
    ({}, {"lags": [-1.0]}, "lags must be finite and at least 0"), ({}, {"channel": "co"}, "channel must be"),
    ({"albedo": 0.0}, {}, "medium must be a medium that scatters"),
])  # fmt: skip
def test_bad_input_is_named(changes, asked, says):
    with pytest.raises(RuleError, match=f"temporal_correlation {says}"):
        sg.temporal_correlation(BOX.replace(**changes), **{"wavelength": 1.0, "lags": [0.1], "paths": 10} | asked)
