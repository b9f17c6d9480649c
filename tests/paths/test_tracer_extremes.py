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
SLAB = sg.Slab(thickness=20.0, mean_free_path=10.0, scatterer=ISOTROPIC)


def with_medium(**change):
    return SCENE.replace(medium=SCENE.medium.replace(**change))


def estimate(scene, paths=640, **more):
    return sg.covariance(scene, paths=paths, seed=1, threads=1, **{"orders": "all"} | more)


def test_single_scattering_is_equation_41():
    """A01: 20 random quadruples, 3D, by the closed form."""
    rng = np.random.default_rng(1)
    v = rng.normal(size=(4, 20, 3))
    i1, i2, v1, v2 = v / np.linalg.norm(v, axis=2, keepdims=True)
    medium = sg.Box(
        lower=[-1.0, -0.8, -1.2], upper=[1.0, 0.9, 1.1], mean_free_path=1.5, albedo=0.9,
        scatterer=sg.HenyeyGreenstein(g=0.3),
    )  # fmt: skip
    scene = sg.Scene(
        wavelength=1.0, medium=medium, illumination=sg.PlaneWaves(directions=np.concatenate([i1, i2])),
        sensor=sg.FarField(directions=np.concatenate([v1, v2])),
    )  # fmt: skip
    n = np.arange(20)
    pairs = np.stack([n, n, 20 + n, 20 + n], axis=1)
    runs = np.array(
        [sg.covariance(scene, paths=200, seed=(2, b), pairs=pairs, threads=1).single for b in range(BATCHES)]
    )
    truth = box_covariance(
        medium.lower, medium.upper, extinction=1 / 1.5, albedo=0.9, wavelength=1.0,
        amplitude=lambda cos: medium.scatterer.amplitude(cos, 3), lights=(i1, i2), views=(v1, v2),
    )  # fmt: skip
    assert_mean(np.concatenate([runs.real, runs.imag], axis=1), np.concatenate([truth.real, truth.imag]))
    refute_mean(np.concatenate([runs.real, -runs.imag], axis=1), np.concatenate([truth.real, truth.imag]))


def test_vanishing_optical_depth_is_single_scattering():
    """OD 1e-6: sigma_s V |s|^2 to order OD, with an error that does not grow."""
    found = estimate(with_medium(mean_free_path=1e7))
    np.testing.assert_allclose(found.intensity, 1e-7 * 100 / (2 * np.pi), rtol=3e-6)
    assert found.multiple.real.max() < 1e-4 * found.single.real.max()


def test_albedo():
    """Nothing at 0; linear in it where it is tiny, to the bits of the same paths."""
    assert not estimate(with_medium(albedo=0.0)).value.any()
    tiny, full = estimate(with_medium(albedo=1e-12)), estimate(SCENE)
    np.testing.assert_allclose(tiny.value, 1e-12 * full.single, rtol=0, atol=1e-22 * np.abs(full.single).max())


@pytest.mark.filterwarnings("error")
def test_a_point_source_that_almost_touches_a_face():
    """Every second ray goes a way whose square underflows: it scatters nothing, and weighs nothing."""
    touching, on = (
        sg.Scene(
            wavelength=1.0, medium=sg.Slab(thickness=20.0, mean_free_path=10.0, scatterer=ISOTROPIC),
            illumination=sg.PointSources(points=[[-1.0, z]]), sensor=sg.FarField(directions=[[0.0, 1.0], [0.6, -0.8]]),
        )
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
        sg.Scene(
            wavelength=1.0, medium=sg.Slab(thickness=1e-9, mean_free_path=1.0, scatterer=ISOTROPIC),
            illumination=sg.PlaneWaves(directions=[[0.0, 0.0, 1.0]]), sensor=sg.NearField(points=[[-1e-9, 0.0, z]]),
        )
        for z in (height, 1e-30)
    )  # fmt: skip
    with np.errstate(all="raise", under="ignore"):
        np.testing.assert_allclose(estimate(close).intensity, estimate(near).intensity, rtol=1e-12)


@pytest.mark.parametrize("dense", [1.0, 100.0, 1e6])
@pytest.mark.parametrize("profile", ["square", "disc", "gaussian"])
def test_a_beam_much_wider_than_a_medium_is_a_plane_wave(dense, profile):
    """The same paths: of rays over all the beam one in 1e12 would meet it, and no light was seen of dense parts."""
    medium = sg.VoxelGrid(
        lower=[-0.5] * 3, upper=[0.5] * 3, extinction=[[[1.0, 1.0]], [[dense, 1.0]]], albedo=0.5,
        scatterers=(ISOTROPIC,),
    )  # fmt: skip
    beam, plane = (
        sg.Scene(
            wavelength=1.0, medium=medium, illumination=light,
            sensor=sg.FarField(directions=[[-1.0, 0, 0], [0.6, 0, 0.8]]),
        )  # fmt: skip
        for light in (
            sg.CollimatedBeams(directions=[[0.0, 0.0, 1.0]], width=1e6, profile=profile),
            sg.PlaneWaves(directions=[[0.0, 0.0, 1.0]]),
        )
    )  # fmt: skip
    one, two = estimate(beam), estimate(plane)
    assert (one.intensity > 0).all()
    np.testing.assert_allclose(one.intensity, two.intensity, rtol=1e-9)


@pytest.mark.parametrize("above", [1.2e-13, 1e-9])
def test_a_sensor_within_rounding_of_a_face(above):
    """Far from the origin: vertices that rounding would put beside where they were drawn are left out."""
    close, on = (
        sg.Scene(
            wavelength=1.0, medium=sg.Box(lower=[1000.0] * 3, upper=[1001.0] * 3, mean_free_path=1.0,
                                          scatterer=ISOTROPIC),
            illumination=sg.PlaneWaves(directions=[[0.0, 0.0, 1.0]]),
            sensor=sg.NearField(points=[[1000.5, 1000.5, z]]),
        )
        for z in (1000 + above, 1000.0)
    )  # fmt: skip
    # The same paths: what differs is the light of the layer below the sensor.
    np.testing.assert_allclose(estimate(close).intensity, estimate(on).intensity, rtol=1e-6)


@pytest.mark.parametrize("lights", [0, 1])
@pytest.mark.parametrize("near", [False, True])
def test_nothing_to_look_at(lights, near):
    """No lights or no views: empty results of the right shape."""
    count = 1 - lights
    nothing = np.array([[0.0, 1.0]] * count).reshape(count, 2)
    scene = SCENE.replace(
        illumination=sg.PlaneWaves(directions=np.array([[0.0, 1.0]] * lights).reshape(lights, 2)),
        sensor=sg.NearField(points=nothing) if near else sg.FarField(directions=nothing),
    )
    found = estimate(scene, reverse=True)
    assert found.value.shape == (lights, count, lights, count)
    assert found.sample(2).shape == (2, lights, count)


def test_standard_errors_of_one_path_are_unknown():
    found = estimate(SCENE, paths=1)
    assert np.isnan(found.standard_error).all()
    assert np.isfinite(found.value).all()


def test_large_phases():
    """kL = 1e8: a shift by whole wavelengths along x and z, exactly as many turns."""
    scene = flat_box([0.0, 30.0], views([0, 60]), half=2e7, mean_free_path=2e7)
    shift = np.array([2.0**24, 2.0**24])
    moved = scene.replace(
        medium=scene.medium.replace(lower=scene.medium.lower + shift, upper=scene.medium.upper + shift)
    )
    here, there = (estimate(s, paths=64, reverse=True).value.reshape(4, 4) for s in (scene, moved))
    turn = np.exp(2j * np.pi * ((scene.lights[:, None] - scene.views) @ shift)).ravel()
    # Positions of 4e7 have 7e-9 of a wavelength left, phases 5e-8, twice in a product; sums over paths grow it little.
    np.testing.assert_allclose(there, turn[:, None] * here * turn.conj(), rtol=0, atol=4e-7 * np.abs(here).max())


def test_grazing_views_and_lights_of_a_slab_see_nothing():
    scene = sg.Scene(
        wavelength=1.0, medium=SLAB, illumination=sg.CollimatedBeams.tilts([0.0], width=10.0),
        sensor=sg.FarField(directions=[[1.0, 0, 0], [0, -1, 0], [1, 0, 1e-9], [1, 0, -0.0], [0, 0, 1]]),
    )  # fmt: skip
    intensity = estimate(scene, reverse=False).intensity[0]
    assert not intensity[:4].any()
    assert intensity[4] > 0
    along = scene.replace(
        illumination=sg.PlaneWaves(directions=[[1.0, 0, 0]]), sensor=sg.NearField(points=[[0, 0, 30.0]])
    )
    assert not estimate(along).value.any()


def test_zero_thickness():
    thin = SLAB.replace(thickness=0.0)
    beam = sg.CollimatedBeams.tilts([0.0], width=10.0)
    far = sg.Scene(wavelength=1.0, medium=thin, illumination=beam, sensor=sg.FarField(directions=[[0, 0, 1.0]]))
    near = far.replace(sensor=sg.NearField(points=[[0, 0, 0.0], [0, 0, 1.0]]))
    assert not estimate(far).value.any()
    assert not estimate(near).value.any()


@pytest.mark.parametrize("g", [-0.99, 0.999, 0.99999])
def test_sharp_lobes(g):
    assert np.isfinite(estimate(with_medium(scatterer=sg.HenyeyGreenstein(g=g)), reverse=True).value).all()


def test_a_thick_box_ends():
    """OD 1000: a path started in the middle scatters a million times; few are."""
    thick = with_medium(mean_free_path=0.05, albedo=0.9)
    assert np.isfinite(estimate(thick, paths=64).value).all()


POINTS = {"centre": (0.0, 0.0, 0.0), "face": (0.0, 0.0, 5.0), "edge": (5.0, 5.0, 0.0), "corner": (5.0, 5.0, 5.0)}


@pytest.mark.parametrize("where", POINTS)
def test_near_sensors_have_a_finite_variance(where):
    """Standard error falls like 1 / sqrt(N) over a factor of 16: an infinite variance would fall slower, by jumps."""
    scene = sg.Scene(
        wavelength=1.0, medium=sg.Box(lower=[-5] * 3, upper=[5] * 3, mean_free_path=5.0, scatterer=ISOTROPIC),
        illumination=sg.PlaneWaves.tilts([0.0]), sensor=sg.NearField(points=[POINTS[where]]),
    )  # fmt: skip
    few, many = (intensities(engine_batches(scene, n, reverse=False, seed=n))[:, 0] for n in (40, 640))
    assert_z(few.mean(), many.mean(), np.sqrt((few.var(ddof=1) + many.var(ddof=1)) / BATCHES), degrees=BATCHES - 1)
    # Ratio of standard deviations 4, known from 64 batches each to 12 % (one sigma).
    assert 2.2 < few.std(ddof=1) / many.std(ddof=1) < 7.0


def test_sensor_beside_a_source():
    """Single scattering is pi^3 sigma_s / (4 pi distance) at distances far below a mean free path."""
    scene = sg.Scene(
        wavelength=1.0, medium=sg.Box(lower=[-5] * 3, upper=[5] * 3, mean_free_path=500.0, scatterer=ISOTROPIC),
        illumination=sg.PointSources(points=[[0.0, 0, 0]]), sensor=sg.NearField(points=[[0.0, 0, 0.05]]),
    )  # fmt: skip
    parts = engine_batches(scene, 400, reverse=False, seed=4, parts=True)[:, 0, 0, 0].real
    # What lies outside the box, beyond 5 to 8.7 of 0.05: 4 pi sigma_s / (4 pi) / r at most.
    assert_mean(parts, np.pi**2 / 4 / 500.0 / 0.05, slack=1 / 5.0 / 500)


def test_a_sensor_on_a_source_is_refused():
    point = np.array([[0.0, 1.0]])
    source = SCENE.replace(illumination=sg.PointSources(points=point))
    with pytest.raises(sg.RuleError, match="wavelengths from every source inside the medium"):
        source.replace(sensor=sg.NearField(points=point))
    outside = 10 * point
    scene = SCENE.replace(illumination=sg.PointSources(points=outside), sensor=sg.NearField(points=outside))
    assert np.isfinite(estimate(scene).value).all()


@pytest.mark.parametrize(("change", "message"), [
    ({"paths": 0}, r"Budget\.paths must be at least 1"),
    ({"paths": 10.5}, r"Budget\.paths must be a whole number"),
    ({"tolerance": 0.0}, r"Budget\.tolerance must be between 0 and 1"),
    ({"reverse": "never"}, "reverse must be True, False or"),
    ({"reverse": 1}, "reverse must be True, False or"),
    ({"pairs": [[0, 0, 0, 3]]}, "covariance pairs must be below 1 for lights and below 3 for views"),
    ({"pairs": [[0, 0, 0, -1]]}, "covariance pairs must be"),
    ({"pairs": [[0, 0, 0, 1.0]]}, "covariance pairs must be whole numbers"),
    ({"seed": -1}, "seed must be a whole number of at least 0"),
])  # fmt: skip
def test_arguments_are_checked(change, message):
    assert_refused(lambda: sg.covariance(SCENE, **{"paths": 64, **change}), message)


def test_parts_of_a_covariance_cannot_be_sampled():
    found = estimate(SCENE, pairs=[[0, 0, 0, 1]])
    for ask in (lambda: found.intensity, lambda: found.sample(1)):
        assert_refused(ask, "asked of a covariance of all pairs")
    assert_refused(lambda: estimate(SCENE).sample(0), "realizations must be at least 1")
    assert_refused(lambda: next(sg.covariance_blocks(SCENE, rows=0)), "rows must be at least 1")
