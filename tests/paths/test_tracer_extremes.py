"""Stiff and extreme scenes of the general engine: finite and right, or refused with a reason."""

import numpy as np
import pytest
from refusals import assert_refused
from scenes import ISOTROPIC, flat_box, views
from volume_batches import BATCHES, engine_batches, intensities
from zscore import assert_mean, assert_z, refute_mean

import specklegen as sg
from specklegen.theory.single_scattering import box_covariance

SCENE = flat_box([0.0], views([0, 90, 180]), half=5.0, mean_free_path=5.0)


def estimate(scene, paths=640, **more):
    return sg.statistics.covariance(scene, paths=paths, seed=1, threads=1, **{"orders": "all"} | more)


def test_single_scattering_is_equation_41():
    """A01: 20 random quadruples, 3D, by the closed form."""
    rng = np.random.default_rng(1)
    v = rng.normal(size=(4, 20, 3))
    i1, i2, v1, v2 = v / np.linalg.norm(v, axis=2, keepdims=True)
    medium = sg.media.Box(lower=[-1.0, -0.8, -1.2], upper=[1.0, 0.9, 1.1], mean_free_path=1.5, albedo=0.9,
                    scatterer=sg.media.HenyeyGreenstein(g=0.3))  # fmt: skip
    scene = sg.Scene(wavelength=1.0, medium=medium,
                     illumination=sg.light.PlaneWaves(directions=np.concatenate([i1, i2])),
                     sensor=sg.sensors.FarField(directions=np.concatenate([v1, v2])))  # fmt: skip
    n = np.arange(20)
    pairs = np.stack([n, n, 20 + n, 20 + n], axis=1)
    runs = np.array(
        [sg.statistics.covariance(scene, paths=200, seed=(2, b), pairs=pairs, threads=1).single for b in range(BATCHES)]
    )
    truth = box_covariance(medium.lower, medium.upper, extinction=1 / 1.5, albedo=0.9, wavelength=1.0,
                           amplitude=lambda cos: medium.scatterer.amplitude(cos, 3), lights=(i1, i2),
                           views=(v1, v2))  # fmt: skip
    assert_mean(np.concatenate([runs.real, runs.imag], axis=1), np.concatenate([truth.real, truth.imag]))
    refute_mean(np.concatenate([runs.real, -runs.imag], axis=1), np.concatenate([truth.real, truth.imag]))


@pytest.mark.filterwarnings("error")
def test_a_point_source_that_almost_touches_a_face():
    """Every second ray goes a way whose square underflows: it scatters nothing, and weighs nothing."""
    touching, on = (
        sg.Scene(wavelength=1.0, medium=sg.Slab(thickness=20.0, mean_free_path=10.0, scatterer=ISOTROPIC),
                 illumination=sg.light.PointSources(points=[[-1.0, z]]),
                 sensor=sg.sensors.FarField(directions=[[0.0, 1.0], [0.6, -0.8]]))
        for z in (1e-255, 0.0)
    )  # fmt: skip
    one, two = estimate(touching), estimate(on)
    assert np.isfinite(one.value).all()
    error = np.hypot(one.standard_error, two.standard_error)[0, [0, 1], 0, [0, 1]]
    assert_z(one.intensity[0], two.intensity[0], error)


@pytest.mark.parametrize("height", [1e-200, 5.13531431e-162, 1e-155])
def test_a_sensor_that_almost_touches_a_face(height):
    """Vertices of every second ray lie so near it that squares of distances underflow: next to no light, left out."""
    close, near = (
        sg.Scene(wavelength=1.0, medium=sg.Slab(thickness=1e-9, mean_free_path=1.0, scatterer=ISOTROPIC),
                 illumination=sg.light.PlaneWaves(directions=[[0.0, 0.0, 1.0]]),
                 sensor=sg.sensors.NearField(points=[[-1e-9, 0.0, z]]))
        for z in (height, 1e-30)
    )  # fmt: skip
    with np.errstate(all="raise", under="ignore"):
        np.testing.assert_allclose(estimate(close).intensity, estimate(near).intensity, rtol=1e-12)


@pytest.mark.parametrize("dense", [1.0, 100.0, 1e6])
@pytest.mark.parametrize("profile", ["square", "disc", "gaussian"])
def test_a_beam_much_wider_than_a_medium_is_a_plane_wave(dense, profile):
    """The same paths: of rays over all the beam one in 1e12 would meet it, and no light was seen of dense parts."""
    medium = sg.media.VoxelGrid(lower=[-0.5] * 3, upper=[0.5] * 3, extinction=[[[1.0, 1.0]], [[dense, 1.0]]],
                                albedo=0.5,
                          scatterers=(ISOTROPIC,))  # fmt: skip
    beam, plane = (
        sg.Scene(
            wavelength=1.0, medium=medium, illumination=light,
            sensor=sg.sensors.FarField(directions=[[-1.0, 0, 0], [0.6, 0, 0.8]]),
        )  # fmt: skip
        for light in (sg.light.CollimatedBeams(directions=[[0.0, 0.0, 1.0]], width=1e6, profile=profile),
                      sg.light.PlaneWaves(directions=[[0.0, 0.0, 1.0]]))
    )  # fmt: skip
    one, two = estimate(beam), estimate(plane)
    assert (one.intensity > 0).all()
    np.testing.assert_allclose(one.intensity, two.intensity, rtol=1e-9)


@pytest.mark.parametrize("above", [1.2e-13, 1e-9])
def test_a_sensor_within_rounding_of_a_face(above):
    """Far from the origin: vertices that rounding would put beside where they were drawn are left out."""
    close, on = (
        sg.Scene(
            wavelength=1.0, medium=sg.media.Box(lower=[1000.0] * 3, upper=[1001.0] * 3, mean_free_path=1.0,
                                          scatterer=ISOTROPIC),
            illumination=sg.light.PlaneWaves(directions=[[0.0, 0.0, 1.0]]),
            sensor=sg.sensors.NearField(points=[[1000.5, 1000.5, z]]),
        )
        for z in (1000 + above, 1000.0)
    )  # fmt: skip
    # The same paths: what differs is the light of the layer below the sensor.
    np.testing.assert_allclose(estimate(close).intensity, estimate(on).intensity, rtol=1e-6)


POINTS = {"centre": (0.0, 0.0, 0.0), "face": (0.0, 0.0, 5.0), "edge": (5.0, 5.0, 0.0), "corner": (5.0, 5.0, 5.0)}


@pytest.mark.parametrize("where", POINTS)
def test_near_sensors_have_a_finite_variance(where):
    """Standard error falls like 1 / sqrt(N) over a factor of 16: an infinite variance would fall slower, by jumps."""
    scene = sg.Scene(wavelength=1.0,
                     medium=sg.media.Box(lower=[-5] * 3, upper=[5] * 3, mean_free_path=5.0, scatterer=ISOTROPIC),
                     illumination=sg.light.PlaneWaves.tilts([0.0]),
                     sensor=sg.sensors.NearField(points=[POINTS[where]]))  # fmt: skip
    few, many = (intensities(engine_batches(scene, n, reverse=False, seed=n))[:, 0] for n in (40, 640))
    assert_z(few.mean(), many.mean(), np.sqrt((few.var(ddof=1) + many.var(ddof=1)) / BATCHES), degrees=BATCHES - 1)
    # Ratio of standard deviations 4, known from 64 batches each to 12 % (one sigma).
    assert 2.2 < few.std(ddof=1) / many.std(ddof=1) < 7.0


def test_sensor_beside_a_source():
    """Single scattering is pi^3 sigma_s / (4 pi distance) at distances far below a mean free path."""
    scene = sg.Scene(
        wavelength=1.0, medium=sg.media.Box(lower=[-5] * 3, upper=[5] * 3, mean_free_path=500.0, scatterer=ISOTROPIC),
        illumination=sg.light.PointSources(points=[[0.0, 0, 0]]), sensor=sg.sensors.NearField(points=[[0.0, 0, 0.05]]),
    )  # fmt: skip
    parts = engine_batches(scene, 400, reverse=False, seed=4, parts=True)[:, 0, 0, 0].real
    # What lies outside the box, beyond 5 to 8.7 of 0.05: 4 pi sigma_s / (4 pi) / r at most.
    assert_mean(parts, np.pi**2 / 4 / 500.0 / 0.05, slack=1 / 5.0 / 500)


@pytest.mark.parametrize(("change", "message"), [
    ({"pairs": [[0, 0, 0, 3]]}, "covariance pairs must be below 1 for lights and below 3 for views"),
    ({"pairs": [[0, 0, 0, -1]]}, "covariance pairs must be"),
    ({"pairs": [[0, 0, 0, 1.0]]}, "covariance pairs must be whole numbers"),
])  # fmt: skip
def test_arguments_are_checked(change, message):
    assert_refused(lambda: sg.statistics.covariance(SCENE, **{"paths": 64, **change}), message)


def test_parts_of_a_covariance_cannot_be_sampled():
    found = estimate(SCENE, pairs=[[0, 0, 0, 1]])
    for ask in (lambda: found.intensity, lambda: found.sample(1)):
        assert_refused(ask, "computed for a covariance of all pairs")
    assert_refused(lambda: estimate(SCENE).sample(0), "realizations must be at least 1")
    assert_refused(lambda: next(sg.statistics.covariance_blocks(SCENE, rows=0)), "rows must be at least 1")
