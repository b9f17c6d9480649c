"""Lights that keep their angle to narrow lobes: path sums against waves, lateral ways and each light alone."""

from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from zscore import assert_mean, assert_z, refute_z

import specklegen as sg
from specklegen.core.random_streams import Stream
from specklegen.core.statistics import jackknife
from specklegen.memory_effects.oblique import estimate_oblique_correlation
from specklegen.oracles.multi_slice import multi_slice, slice_views
from specklegen.paths import kept_angles
from specklegen.paths.endpoint_factors import multiple_amplitudes, single_amplitudes
from specklegen.paths.far_field import far_field_decision, middle_light
from specklegen.paths.kept_angles import advance
from specklegen.paths.tracer import slab_tracer
from specklegen.samplers.path_sums.direct import direct_field
from specklegen.samplers.path_sums.nufft import build_nufft_plan, nufft_field, nufft_tile
from specklegen.samplers.path_sums.tiling import Tiling

WIDTH = 6000.0
PITCH = 0.5 / WIDTH
BATCHES = 32
AGREED = 0.02  # of C_I: what rendered stacks and waves may differ by

# Forward slabs, tilts in sines, a view beside the beam, and C_I by split-step waves of 40 to 80 slices on 1000 x 1000
# points, an independent program; standard errors of .002 to .01. The last row is the slow test's own.
WAVES = {
    "HG .995": (sg.HenyeyGreenstein(0.995), 400.0, 20.0, [0.004, 0.008, 0.016], 0.0, [0.966, 0.883, 0.677]),
    "HG .99": (sg.HenyeyGreenstein(0.99), 400.0, 40.0, [0.004, 0.008, 0.016], 0.0, [0.977, 0.918, 0.742]),
    "HG .95 aside": (sg.HenyeyGreenstein(0.95), 200.0, 100.0, [0.01, 0.02, 0.04], -0.02, [0.978, 0.931, 0.796]),
    "HG .98 wide": (sg.HenyeyGreenstein(0.98), 100.0, 20.0, [0.0244, 0.0488, 0.0977], 0.0, [0.972, 0.905, 0.729]),
}
# Others, with the direction sines of the first light, the way of the tilts and the view beside the beam.
LATERAL = {
    "vMF 50": (sg.VonMisesFisher(50.0), 80.0, 20.0, [0.0, 0.01, 0.02], (0, 0), (1, 0), (0, 0)),
    "vMF 150": (sg.VonMisesFisher(150.0), 400.0, 40.0, [0.0, 0.004, 0.008], (0, 0), (1, 0), (0, 0)),
    "vMF 500": (sg.VonMisesFisher(500.0), 400.0, 40.0, [0.0, 0.004, 0.008], (0, 0), (1, 0), (0, 0)),
    "wide": (sg.HenyeyGreenstein(0.995), 100.0, 20.0, [0.0, 0.0244, 0.0488, 0.0977], (0, 0), (1, 0), (0, 0)),
    "oblique": (sg.HenyeyGreenstein(0.98), 100.0, 20.0, [-0.02, 0.0, 0.02], (0.5, 0), (1, 0), (0, 0)),
    "oblique, across": (sg.HenyeyGreenstein(0.98), 100.0, 20.0, [-0.02, 0.0, 0.02], (0.5, 0), (0, 1), (0, 0)),
    "rotated": (sg.VonMisesFisher(150.0), 100.0, 20.0, [-0.006, 0.0, 0.006], (0.3, 0.2), (0.6, 0.8), (-0.02, 0.01)),
}


def directions(sines):
    return np.column_stack([sines, np.sqrt(1 - np.square(sines).sum(axis=1))])


def seen(scatterer, thickness, mean_free_path, tilts, first=(0, 0), way=(1, 0), beside=(0, 0)):
    """Tilted beams, each seen at one view, which moves with it."""
    sines = np.array(first, float) + np.outer(tilts, way)
    return sg.Scene(wavelength=1.0,
                    medium=sg.Slab(thickness=thickness, mean_free_path=mean_free_path, scatterer=scatterer),
                    illumination=sg.CollimatedBeams(directions=directions(sines), width=WIDTH),
                    sensor=sg.FarField(directions=directions(sines + beside)))  # fmt: skip


def tracer_of(scene, **layout):
    tracer = slab_tracer(scene, False)
    return replace(tracer, layout=replace(tracer.layout, **layout))


def found(tracer, paths=30_000):
    """C_I of the first light with all others at the view that moves with them, its error, and intensities [T]."""
    lights = len(tracer.layout.lights)
    pairs, sums = np.arange(lights) * (lights + 1), []
    for n in range(BATCHES):
        bank = tracer.trace(5, paths // BATCHES, first=n * (paths // BATCHES), stream=Stream.PATHS, threads=1)
        often = multiple_amplitudes(tracer.layout, bank.multiple, bidirectional=False, reverse=False)
        a = np.concatenate([single_amplitudes(tracer.layout, bank.single)[pairs], often[pairs]], axis=1)
        sums.append([a @ a[0].conj(), np.square(np.abs(a)).sum(axis=1)])

    def correlation(some):
        joint, power = some.sum(axis=0)
        return np.square(np.abs(joint)) / (power * power[0]).real

    sums = np.array(sums)
    left_out = np.array([correlation(np.delete(sums, n, axis=0)) for n in range(BATCHES)])
    error = np.sqrt((BATCHES - 1) * left_out.var(axis=0))
    return correlation(sums)[1:], error[1:], sums[:, 1].sum(axis=0).real / paths


@pytest.mark.parametrize("case", WAVES)
def test_the_correlation_of_lights_is_that_of_waves(case):
    scatterer, thickness, mean_free_path, tilts, beside, expected = WAVES[case]
    scene = seen(scatterer, thickness, mean_free_path, [0.0, *tilts], beside=(beside, 0.0))
    intensity, error, power = found(tracer_of(scene))
    assert_z(intensity, expected, np.hypot(error, 0.005), degrees=BATCHES - 1, slack=AGREED)
    np.testing.assert_allclose(power / power[0], 1, atol=0.02)  # all light moves with its beam


def test_looked_up_at_every_lights_own_angle_it_is_not():
    """The power of the test above: what path sums did."""
    scatterer, thickness, mean_free_path, tilts, _, expected = WAVES["HG .995"]
    scene = seen(scatterer, thickness, mean_free_path, [0.0, *tilts])
    intensity, error, _ = found(tracer_of(scene, middle=None))
    assert (intensity < np.array(expected) - [0.1, 0.3, 0.4]).all()
    refute_z(intensity, expected, np.hypot(error, 0.005), degrees=BATCHES - 1, slack=AGREED)


@pytest.mark.parametrize("case", LATERAL)
def test_it_is_that_of_lateral_ways(case):
    scene = seen(*LATERAL[case])
    intensity, error, _ = found(tracer_of(scene))
    middle = middle_light(scene)
    beside = np.array(LATERAL[case][-1])
    view = directions(middle[None, :2] + beside)[0]
    known = estimate_oblique_correlation(scene.slab, middle, view, 30_000, 3)
    expected = np.square(np.abs(known.matrix(scene.lights[:, :2], scene.wavenumber)[0, 1:]))
    # Their own error is about as large, of as many paths that have other seeds.
    assert_z(intensity, expected, error * 2**0.5, degrees=BATCHES - 1, slack=0.01)


@pytest.mark.parametrize(("g", "depth"), [(0.95, 2.0), pytest.param(0.98, 4.0, marks=pytest.mark.slow)])
def test_lights_on_either_side_of_their_middle_are_those_of_slices(g, depth):
    """Each .1 from the middle, .2 apart: C_I about the axis of screens and of paths, .87 and .62 of some 10 ranges."""
    medium = sg.Slab(thickness=10 * depth, mean_free_path=10.0, scatterer=sg.HenyeyGreenstein(g))
    y, x = np.mgrid[-4:5, -4:5]
    kept = (x**2 + y**2 <= 16) & ((x != 0) | (y != 0))  # bins of .01, without what was not scattered
    x, y = x[kept], y[kept]

    def sums(one, other):
        return [(one * other.conj()).sum(), np.square(np.abs(one)).sum(), np.square(np.abs(other)).sum()]

    slices = slice_views(medium, wavelength=1.0, pitch=0.5, size=200, bins=[(-10, 0), (10, 0)], realizations=60)
    waves = [sums(one[y, x - 10], other[y, x + 10]) for one, other in slices]
    views = np.stack([np.concatenate([x - 10, x + 10]), np.concatenate([y, y])], -1) / 100
    light = sg.CollimatedBeams.tilts(np.arcsin([-0.1, 0.1]), width=600.0)
    sensor = sg.FarField(directions=directions(views))
    scene = sg.Scene(wavelength=1.0, medium=medium, illumination=light, sensor=sensor)
    tracer, paths = slab_tracer(scene, False), []
    assert tracer.layout.middle is not None
    for n in range(BATCHES):
        bank = tracer.trace(1, 150, first=150 * n, threads=1)
        often = multiple_amplitudes(tracer.layout, bank.multiple, bidirectional=False, reverse=False)
        a = np.concatenate([single_amplitudes(tracer.layout, bank.single), often], axis=1)
        a = a.reshape(2, 2, len(x), -1)
        paths.append(sums(a[0, 0], a[1, 1]))

    def joined(total):
        return np.square(np.abs(total[0])) / (total[1] * total[2]).real

    expected, spread = jackknife(np.array(waves).reshape(20, 3, 3).sum(axis=1), joined)
    found, error = jackknife(np.array(paths), joined)
    assert_z(found, expected, np.hypot(error, spread), degrees=min(BATCHES, 20) - 1, slack=0.01)
    refute_z(0.8 * found, expected, np.hypot(error, spread), degrees=min(BATCHES, 20) - 1, slack=0.01)


def test_what_a_tilt_adds_between_the_ends_matters(monkeypatch):
    """The power of the test above, where the middle of two lights is not that of all."""
    monkeypatch.setattr(kept_angles, "advance", lambda *_: 0.0)
    with pytest.raises(AssertionError, match="z ="):
        test_it_is_that_of_lateral_ways("wide")


@pytest.mark.slow
def test_the_slices_of_wide_tilts():
    scatterer, thickness, mean_free_path, _, _, expected = WAVES["HG .98 wide"]
    medium = sg.Slab(thickness=thickness, mean_free_path=mean_free_path, scatterer=scatterer)
    slices = multi_slice(medium, wavelength=1.0, pitch=0.4, size=1024, bins=[10, 20, 40], realizations=8, seed=1,
                         reach=0.01)  # fmt: skip
    grains = 52  # of independent views within reach as many add 1 / N to |K|^2
    assert_mean((slices.on_axis - 1 / grains) / (1 - 1 / grains), np.array(expected), slack=0.005)


@pytest.mark.parametrize("case", LATERAL)
def test_every_light_is_as_bright_as_alone(case):
    """Within 2 %: alone a light's lobes are looked up at its own angle, which is radiative transfer."""
    scene = seen(*LATERAL[case])
    _, _, together = found(tracer_of(scene))
    alone = []
    for light, view in zip(scene.lights, scene.views, strict=True):
        beams = scene.illumination.replace(directions=[light])
        one = scene.replace(illumination=beams, sensor=sg.FarField(directions=[view]))
        alone.append(found(tracer_of(one))[2][0])
    np.testing.assert_allclose(together, alone, rtol=0.02)


def test_what_a_tilt_adds_along_z_is_of_second_order():
    axis, tilted = np.array([0.0, 0, 1]), directions(np.array([[1e-3, 0.0]]))[0]
    assert advance(axis, tilted) == pytest.approx(-0.5e-6, rel=1e-6)
    oblique = directions(np.array([[0.5, 0.1]]))[0]
    for step in (1e-3, 1e-4):
        moved = directions(oblique[None, :2] + [step, -2 * step])[0]
        slope = -(np.array([step, -2 * step]) @ oblique[:2]) / oblique[2]
        assert advance(oblique, moved) == pytest.approx(moved[2] - oblique[2] - slope, abs=1e-15)


# ---- Rendered stacks ------------------------------------------------------------------------------------

SIDE = 24


@pytest.fixture(scope="module")
def scene():
    """A camera that holds the same grains under every tilt."""
    scatterer, thickness, mean_free_path, tilts, _, _ = WAVES["HG .99"]
    sines = np.outer([0.0, *tilts], [1.0, 0.0])
    shape = (SIDE, SIDE + round(tilts[-1] / PITCH))
    return sg.Scene(wavelength=1.0,
                    medium=sg.Slab(thickness=thickness, mean_free_path=mean_free_path, scatterer=scatterer),
                    illumination=sg.CollimatedBeams(directions=directions(sines), width=WIDTH),
                    sensor=sg.FarField.grid(shape, PITCH, center=(tilts[-1] / 2, 0.0)))  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize("sampler", ["auto", "paths"])
def test_rendered_stacks_are_those_of_waves(scene, sampler):
    expected, count = WAVES["HG .99"][-1], 16
    columns = np.rint(scene.lights[:, 0] / PITCH).astype(int)
    fields = np.asarray(sg.render(scene, sampler=sampler, realizations=count, paths=20_000, seed=4).field)
    moved = np.stack([fields[:, t, :, m : m + SIDE] for t, m in enumerate(columns)], axis=1).reshape(count, 4, -1)
    joint = np.einsum("rtp,rp->rt", moved, moved[:, 0].conj())
    power = np.square(np.abs(moved)).sum(axis=2)

    def correlation(of):
        some = np.square(np.abs(joint[of].sum(axis=0))) / (power[of].sum(axis=0) * power[of, 0].sum())
        grains = len(of) * SIDE**2 / 4  # of independent grains as many add 1 / N to |K|^2
        return ((some - 1 / grains) / (1 - 1 / grains))[1:]

    every = np.arange(count)
    left_out = np.array([correlation(np.delete(every, n)) for n in every])
    error = np.sqrt((count - 1) * left_out.var(axis=0))
    assert_z(correlation(every), expected, error, degrees=count - 1, slack=AGREED)
    # And at the same views: the light of tilted beams has moved on, here to be a sixth darker.
    if sampler == "paths":
        dark = np.square(np.abs(fields[:, -1, :, :SIDE])).mean() / np.square(np.abs(fields[:, 0, :, :SIDE])).mean()
        one = seen(*WAVES["HG .99"][:3], [0.0], beside=(-0.016, 0.0))
        own = found(tracer_of(one))[2][0] / found(tracer_of(seen(*WAVES["HG .99"][:3], [0.0])))[2][0]
        assert dark == pytest.approx(own, rel=0.1)  # 2304 grains each
        assert own < 0.9


@pytest.fixture(scope="module")
def bank(scene):
    return slab_tracer(scene, False).trace(3, 1500, threads=1)


def test_transforms_and_tiles_are_the_direct_sum(scene, bank):
    layout = slab_tracer(scene, False).layout
    phases = np.exp(2j * np.pi * np.random.default_rng(1).random(len(bank)))
    expected = direct_field(layout, bank, (phases, None), threads=1).reshape(4, *scene.sensor.shape)
    tiling = Tiling(scene.grid, (SIDE, 72))
    for tolerance in (1e-3, 1e-5):
        summation = build_nufft_plan(layout, bank, scene.grid, tolerance, tiling)
        transformed = nufft_field(layout, bank, phases, summation, threads=1)
        assert np.linalg.norm(transformed - expected) < 2 * tolerance * np.linalg.norm(expected)
        tile = summation.tiling.tiles[1]
        piece = nufft_tile(layout.of_lights(slice(1, 3)), bank, phases, summation, tile, threads=1)
        np.testing.assert_array_equal(piece, transformed[1:3, tile.rows, tile.columns])
    own = direct_field(replace(layout, middle=None), bank, (phases, None), threads=1).reshape(expected.shape)
    assert np.linalg.norm(own - expected) > 0.1 * np.linalg.norm(expected)


def test_the_way_backwards_is_that_of_the_paths_reversed(scene):
    few = scene.replace(sensor=sg.FarField(directions=-scene.lights + [[0, 1e-3, 0]]))
    tracer = slab_tracer(few, True)
    bank = tracer.trace(3, 400, threads=1).multiple
    phases = np.exp(2j * np.pi * np.random.default_rng(1).random(len(bank)))
    both = multiple_amplitudes(tracer.layout, bank, bidirectional=True, reverse=True) @ phases
    field = direct_field(tracer.layout, bank, (phases, phases), threads=1) * np.sqrt(bank.count)
    np.testing.assert_allclose(field.ravel(), both, rtol=0, atol=1e-9 * np.abs(both).max())


# ---- Where -----------------------------------------------------------------------------------------------
def test_scenes_in_which_lobes_are_one_are_as_before(scene):
    def middle(**beams):
        return middle_light(scene.replace(illumination=sg.CollimatedBeams.tilts(width=WIDTH, **beams)))

    assert middle_light(scene) is not None
    assert middle(angles=[0.0, 1e-5]) is None  # small beside the lobe
    assert middle(angles=[0.01]) is None
    assert middle(angles=[-0.1, 0.1]) is not None
    assert middle(angles=[-0.11, 0.11]) is None  # too large
    for medium in (
        sg.Slab(thickness=400.0, mean_free_path=40.0, scatterer=sg.HenyeyGreenstein(0.3)),
        sg.Slab(thickness=4e6, mean_free_path=4e5, scatterer=sg.HenyeyGreenstein(0.99)),  # in the far field
        sg.Slab(thickness=400.0, mean_free_path=40.0, scatterer=sg.HenyeyGreenstein(0.99), albedo=0.0),
    ):
        assert middle_light(scene.replace(medium=medium)) is None


def test_layers_keep_their_angles_too(scene):
    part = sg.Layer(thickness=200.0, mean_free_path=40.0, scatterer=sg.HenyeyGreenstein(0.99))
    layered = scene.replace(medium=sg.Layers(layers=[part, part.replace(mean_free_path=30.0)]))
    assert middle_light(layered) is not None
    assert not far_field_decision(layered).doubt


QUICK = {(0.98, 5.0, 0.5), (0.995, 10.0, 1.0), (0.98, 5.0, 2.0)}
SCENES = list(product((0.95, 0.98, 0.99, 0.995), (5.0, 10.0, 20.0), (0.5, 1.0, 2.0)))


@pytest.mark.parametrize(
    ("g", "depth", "part"), [each if each in QUICK else pytest.param(*each, marks=pytest.mark.slow) for each in SCENES]
)
def test_no_scene_falls_to_the_sampler_of_the_larger_error(g, depth, part):
    """Tilts up to 2 half ranges: the samplers' stated errors are .05 at most, or the other one's is no smaller."""
    medium = sg.Slab(thickness=20 * depth, mean_free_path=20.0, scatterer=sg.HenyeyGreenstein(g))
    tilts = np.linspace(0, 0.0999, 101)
    curve = sg.memory_effect(medium, wavelength=1.0, tilts=tilts, paths=4000).intensity
    reach = part * float(np.interp(-0.5, -curve, tilts))
    beams = sg.CollimatedBeams.tilts(np.linspace(-0.5, 0.5, 5) * reach, width=WIDTH)
    sensor = sg.FarField.grid((16, 16), PITCH)
    scene = sg.Scene(wavelength=1.0, medium=medium, illumination=beams, sensor=sensor)
    made, other = sg.plan(scene), far_field_decision(scene)
    stated = max((each.error for each in made.decisions if each.doubt), default=0.0)
    # Path sums beyond .1 rad are off by as much as they say; the stationary sampler is taken where it is off by less.
    assert stated < 0.05 or (made.sampler == "stationary" and stated < other.error)
    assert not made.doubts or reach > 0.1  # farther apart there may be no correlation left to be wrong


@pytest.mark.parametrize("views", [0, 1])
def test_lights_that_keep_their_angles_need_neither_paths_nor_views(views):
    """A slab of thickness 0, whose light is reflected alone, and a sensor that looks nowhere."""
    thin = sg.Slab(thickness=0.0, mean_free_path=1.0, scatterer=sg.HenyeyGreenstein(g=-0.99),
                   faces=sg.Faces(inside=2.0, outside=1.0, wall=0.5))  # fmt: skip
    scene = sg.Scene(wavelength=1.0, medium=thin, illumination=sg.CollimatedBeams.tilts([0.1, 0.2], width=1.0),
                     sensor=sg.FarField(directions=np.array([[0.0, 0.0, 1.0]])[:views]))  # fmt: skip
    assert sg.render(scene, paths=16, sampler="paths").field.tolist() == [[0j] * views] * 2
    assert sg.covariance(scene, paths=16).value.shape == (2, views, 2, views)
