"""Scenes of layers whose refractive indices differ, by the stationary sampler and by path sums.

Judged by slabs behind faces, and by a literal walk.
"""

import numpy as np
import pytest
from references.layered_walk import BATCHES, walk_layers
from refusals import assert_refused
from scipy.special import j0
from zscore import assert_mean, assert_z, refute_mean, refute_z

import specklegen as sg
from specklegen.mean.field import straight_through
from specklegen.memory_effects import correlation as correlation_module
from specklegen.memory_effects.cached import estimated_anew
from specklegen.paths.phases import random_phases
from specklegen.paths.steps import optics, straight_light, unscattered
from specklegen.paths.tracer import slab_tracer
from specklegen.samplers.path_sums import view_factor
from specklegen.samplers.path_sums.direct import direct_field
from specklegen.samplers.path_sums.nufft import build_nufft_plan, nufft_field

SLAB = sg.Slab(thickness=100.0, mean_free_path=20.0, albedo=0.98, scatterer=sg.HenyeyGreenstein(0.6),
               faces=sg.Faces(inside=1.5))  # fmt: skip
TILTS = np.array([0.0, 1e-3, 2e-3])
UPPER = sg.Layer(thickness=40.0, mean_free_path=10.0, scatterer=sg.HenyeyGreenstein(0.5), index=1.5)
LOWER = sg.Layer(thickness=60.0, mean_free_path=30.0, albedo=0.95, scatterer=sg.Isotropic(), index=1.2)
TWO = sg.Layers([UPPER, LOWER])


def halves(**other):
    """The slab in two layers that differ by next to nothing."""
    return [
        sg.Layer(thickness=50.0, mean_free_path=20.0 * (1 + 1e-9 * n), albedo=0.98, scatterer=SLAB.scatterer, **other)
        for n in range(2)
    ]  # fmt: skip


BY_FACES = sg.Layers(halves(), faces=SLAB.faces)
BY_INDEX = sg.Layers(halves(index=1.5))


def scene_of(medium, index=1.0, *, width=8000.0, sensor=None, **light):
    """A scene whose angles and wavelength are those in an index: the same light whatever it is."""
    beams = sg.CollimatedBeams(
        directions=np.stack([index * np.sin(TILTS), 0 * TILTS, np.sqrt(1 - (index * np.sin(TILTS)) ** 2)], -1),
        width=width, **light,
    )  # fmt: skip
    seen = sensor or sg.FarField.grid((8, 8), 2e-5 * index)
    return sg.Scene(wavelength=0.5 * index, medium=medium, illumination=beams, sensor=seen)


def of_batches(scene, seed, paths=32_000):
    """Mean intensity and K at the tilts, of batches of paths: float64[64, 1 + T]."""
    made = sg.plan(scene, paths=paths)
    assert made.sampler == "stationary"
    with estimated_anew(seed):
        found = made.chosen.prepare(seed, 1).shared.correlation
    q = 2 * np.pi / scene.wavelength * scene.beams.directions[:, 0]
    sums = np.stack([found.weights @ w for w in (np.ones(len(found.radius)), *j0(q[:, None] * found.radius))], -1)
    return np.concatenate([sums[:, :1] * 64 / paths, sums[:, 1:] * 64 / paths], axis=1)


def assert_same(one, other):
    """Means over batches of two runs."""
    error = np.hypot(*(each.std(axis=0, ddof=1) / 8 for each in (one, other)))
    assert_z(one.mean(axis=0), other.mean(axis=0), error, degrees=63)


def test_layers_that_are_a_slab_behind_faces_are_drawn_as_it(monkeypatch):
    """In the index of the slab, and in that of the air, where wavelengths, sines and solid angles are others."""
    slab = of_batches(scene_of(SLAB), 1)
    assert_same(of_batches(scene_of(BY_FACES), 2), slab)
    in_air = scene_of(BY_INDEX, 1.5)
    assert_same(of_batches(in_air, 3) * 1.5**2, slab)
    monkeypatch.setattr(correlation_module, "inside_share", lambda medium: 1.0)
    with pytest.raises(AssertionError, match="z ="):  # light that is not counted per steradian inside
        assert_same(of_batches(scene_of(BY_FACES), 2), slab)


def test_rendered_intensities_follow_the_tilt_as_a_literal_walk_says():
    """Views one tilt further see <I I'> = <I>^2 (1 + K^2); with z of the mean over 200 media."""
    tilt = 16 * 6e-5
    light = sg.CollimatedBeams(directions=[[0.0, 0.0, 1.0], [tilt, 0.0, np.sqrt(1 - tilt**2)]], width=4000.0)
    scene = sg.Scene(wavelength=0.5, medium=TWO, illumination=light, sensor=sg.FarField.grid((12, 32), 6e-5))
    made = sg.plan(scene, paths=30_000)
    renderer = made.chosen.prepare(4, 1)
    stacks = np.square(np.abs([each.image for each in renderer.media(200)]))
    stacks /= stacks.mean()
    moved = (stacks[:, 0, :, :-16] * stacks[:, 1, :, 16:]).mean(axis=(1, 2))
    q = np.array([2 * np.pi / scene.wavelength * tilt])
    sums = walk_layers(
        [(each.thickness, each.mean_free_path, each.albedo, each.scatterer.mean_cosine(), each.index)
         for each in TWO.layers], paths=BATCHES * 400, seed=5,
    ).sums(q).sum(axis=0)  # fmt: skip
    expected = 1 + (sums[1] / sums[0]) ** 2
    assert 1.2 < expected < 1.9
    assert_mean(moved, expected, slack=0.02)  # of the paths of either walk
    still = (stacks[:, 0] * stacks[:, 1]).mean(axis=(1, 2))
    refute_mean(still, expected, slack=0.02)  # views that stay behind


def film_of(scene, seed):
    with estimated_anew(seed):
        return sg.plan(scene, paths=4000, sampler="stationary").chosen.prepare(seed, 1).shared.correlation


def test_films_are_those_of_the_slab():
    """g1 between frames, of batches by seeds."""
    moving = sg.Brownian(diffusion=2e-3)
    times = {"times": [0.0, 0.1, 0.2]}
    found = []
    for medium in (SLAB.replace(motion=moving), sg.Layers(halves(motion=moving), faces=SLAB.faces)):
        scene = scene_of(medium, **times)
        film = [film_of(scene, seed) for seed in range(16)]
        still = np.zeros((3, 2))
        found.append([np.real(each.matrix(still, scene.wavenumber)[0]) for each in film])
    one, other = map(np.array, found)
    assert 0.2 < one[:, 1].mean() < 0.95
    error = np.hypot(one.std(axis=0, ddof=1), other.std(axis=0, ddof=1)) / 4
    assert_z(one.mean(axis=0)[1:], other.mean(axis=0)[1:], error[1:], degrees=15)


def test_what_goes_straight_is_that_of_the_slab():
    mean = [sg.mean_field(scene_of(*each)) for each in ((SLAB,), (BY_FACES,), (BY_INDEX, 1.5))]
    np.testing.assert_allclose(mean[1], mean[0], rtol=1e-6)
    np.testing.assert_allclose(1.5 * np.abs(mean[2]), np.abs(mean[0]), rtol=1e-4)  # to the tilt's square
    one, other = straight_light(SLAB, np.array([0.3, 0.6])), straight_light(BY_INDEX, np.array([0.45, 0.9]))
    np.testing.assert_allclose(other.let_through, one.let_through, rtol=1e-12)
    np.testing.assert_allclose(other.depth, 5.0 / np.sqrt(1 - np.array([0.3, 0.6]) ** 2), rtol=1e-8)
    np.testing.assert_allclose(1.5 * other.slope, one.slope, rtol=1e-12)
    held = straight_light(TWO, np.array([0.0, 1.3]))  # sines in index 1 of what was steep before
    assert held.depth[0] == pytest.approx(TWO.optical_depth)
    assert held.depth[1] == np.inf
    thick = sg.Layers([layer.replace(mean_free_path=10 * layer.thickness) for layer in TWO.layers])
    first, all_echoes = straight_through(thick), unscattered(optics(thick), 0.0)[1]
    assert first < all_echoes < 1.03 * first
    drawn = sg.render(scene_of(TWO), paths=2000, mean=True)
    assert drawn.field.shape == (3, 8, 8)


BELOW_AIR = sg.Layers([UPPER.replace(index=0.8), LOWER])


def moving_two():
    return sg.Layers([layer.replace(motion=sg.Brownian(diffusion=2e-3)) for layer in TWO.layers])


ASIDE = sg.FarField.grid((8, 8), 2e-5, center=(0.3, 0.0))
COARSE = sg.FarField.grid((8, 8), 5e-4)
BACK = sg.FarField.grid((8, 8), 2e-5, side="reflection")
POINT = sg.NearField([[0.0, 0.0, 200.0]])


@pytest.mark.parametrize(("scene", "options", "rule"), [
    (lambda: scene_of(TWO, sensor=ASIDE), {"sampler": "stationary"}, 'sampler must be "paths" or "auto"'),
    (lambda: scene_of(TWO, sensor=BACK), {"sampler": "stationary"}, 'sampler must be "paths" or "auto"'),
    (lambda: scene_of(BELOW_AIR, 450.0), {}, "directions must be of sines below 0.8, where light crosses"),
    (lambda: scene_of(moving_two(), times=[0.0, 0.1, 0.2]), {"sampler": "paths"}, "Layers.motion must be left out"),
    (lambda: scene_of(BY_FACES, sensor=POINT), {}, r"NearField\.points must be at least .* behind the face"),
])  # fmt: skip
def test_what_nothing_serves_is_refused(scene, options, rule):
    assert_refused(lambda: sg.plan(scene(), paths=1000, **options), rule)


@pytest.mark.parametrize("sensor", [ASIDE, BACK, COARSE])
def test_what_is_beyond_the_axis_is_summed_by_paths(sensor):
    scene = scene_of(TWO, width=300.0, sensor=sensor)
    made = sg.plan(scene, paths=1000)
    assert made.sampler == "paths"
    assert sg.render(scene, paths=1000).field.shape == (3, 8, 8)


@pytest.mark.parametrize("side", ["transmission", "reflection"])
def test_transforms_are_the_direct_sum(side, monkeypatch):
    """Of the same connections: views aside, whose light is refracted, and light that comes back."""
    scene = scene_of(TWO, width=300.0, sensor=sg.FarField.grid((24, 24), 4e-4, center=(0.3, 0.1), side=side))
    tracer = slab_tracer(scene, False)
    layout, bank = tracer.layout, tracer.trace(1, 1500, threads=1)
    summation = build_nufft_plan(layout, tracer.trace(2, 1500, threads=1), scene.grid, 1e-4)
    phases = random_phases(bank, 3)
    exact = direct_field(layout, bank, (phases, None), threads=1).reshape(3, *scene.grid.shape)
    found = nufft_field(layout, bank, phases, summation, threads=1)
    error = np.linalg.norm(found - exact) / np.linalg.norm(exact)
    assert error < 2e-4
    monkeypatch.setattr(view_factor, "seen_exits", lambda layout, bank, middle: bank.records)
    wrong = nufft_field(layout, bank, phases, summation, threads=1)
    assert np.linalg.norm(wrong - exact) > 0.01 * np.linalg.norm(exact)  # exits where they are, for the factor alone


def covariances(medium, paths, seed, index=1.0, **options):
    """Of pairs of tilts and views aside of the axis, a view that follows its tilt among them; errors, cosines."""
    side = options.pop("side", "transmission")
    sines = np.array([[0.2, 0.1], [0.2 + 2e-3, 0.1], [0.1, -0.1], [-2e-3, 0.0]]) * index
    views = np.stack([*sines.T, np.sqrt(1 - np.square(sines).sum(axis=1)) * (1 if side == "transmission" else -1)], -1)
    scene = scene_of(medium, index, width=400.0, sensor=sg.FarField(directions=views))
    pairs = [[0, 0, 0, 0], [2, 1, 2, 1], [1, 2, 1, 2], [0, 0, 2, 1], [2, 3, 2, 3]]
    found = sg.covariance(scene, paths=paths, seed=seed, pairs=pairs, **options)
    return found.value, found.standard_error, views[[0, 1, 2, 0, 3], 2]


@pytest.mark.parametrize("side", ["transmission", "reflection"])
def test_covariances_are_those_of_the_slab(side):
    """Intensities, and the correlation of a view that moves with the tilt, phases included; also in reflection."""
    slab, one, cosines = covariances(SLAB, 6000, 1, side=side)
    faces, other, _ = covariances(BY_FACES, 6000, 2, side=side)
    errors = np.hypot(one, other) / np.sqrt(2)
    assert_z(np.concatenate([faces.real, faces.imag[3:4]]), np.concatenate([slab.real, slab.imag[3:4]]),
             np.sqrt(2) * np.concatenate([errors, errors[3:4]]))  # fmt: skip
    air, spread, out = covariances(BY_INDEX, 6000, 3, 1.5, side=side)
    share = 1.5**2 * cosines / out
    assert_z((share * air).real, slab.real, np.hypot(one, share * spread))
    refute_z(air.real, slab.real, np.hypot(one, spread))


def test_reversed_paths_are_those_of_the_slab():
    slab, one, _ = covariances(SLAB, 6000, 1, side="reflection", reverse=True)
    faces, other, _ = covariances(BY_FACES, 6000, 2, side="reflection", reverse=True)
    assert_z(faces.real, slab.real, np.hypot(one, other))
    alone, error, _ = covariances(BY_FACES, 6000, 2, side="reflection", reverse=False)
    refute_z(faces.real[4], alone.real[4], np.hypot(other, error)[4])  # at the view straight back


def test_rendered_fields_have_the_covariance():
    """Mean intensity of 48 renders by path sums at views aside, against the covariance of other paths."""
    views = sg.FarField(directions=[[0.2, 0.1, np.sqrt(0.95)], [-0.1, 0.0, np.sqrt(0.99)]])
    scene = scene_of(TWO, width=400.0, sensor=views)
    found = sg.covariance(scene, paths=6000, seed=1)
    fields = sg.render(scene, paths=400, seed=2, realizations=48, sampler="paths").field
    powers = np.square(np.abs(fields)).mean(axis=1)
    expected, error = found.intensity.mean(axis=0), found.standard_error[0, :, 0].diagonal()
    assert_z(powers.mean(axis=0), expected, np.hypot(powers.std(axis=0, ddof=1) / np.sqrt(48), error), degrees=47)
