"""What flows: Doppler shifts of paths against vertices, moved scatterers, closed forms, and films of both samplers."""

from dataclasses import replace

import numpy as np
import pytest
from refusals import assert_refused
from zscore import assert_z, refute_z

import specklegen as sg
from specklegen.core.errors import DoubtWarning, RuleError
from specklegen.core.statistics import jackknife
from specklegen.kernels.walk import FLOW, RECORD
from specklegen.memory_effects import temporal
from specklegen.paths.endpoints import AXIS
from specklegen.paths.layout import plane_layout
from specklegen.paths.momentum import doppler_shift
from specklegen.paths.tracer import plane_tracer, scene_tracer
from specklegen.paths.volumes import velocity_at, volume_of
from specklegen.scene.motion import fastest, law_of

K = 1e3  # so large that a particle moves little while a phase turns
LOBE, EVEN = sg.HenyeyGreenstein(0.6), sg.Isotropic()
SHEAR = sg.Shear(rate=2.0)


class Turning(sg.Flow):
    """A rigid rotation about the axis, of a user's own."""

    rate: float

    def affine(self, dimension):
        turn = np.zeros((3, 3))
        turn[0, 1], turn[1, 0] = -self.rate, self.rate
        return np.zeros(3), turn


def drift(*velocity):
    return sg.Drift(velocity=velocity)


SLAB = sg.Slab(thickness=40.0, mean_free_path=10.0, scatterer=LOBE, motion=SHEAR)
LAYERS = sg.Layers(layers=[
    sg.Layer(thickness=10.0, mean_free_path=10.0, scatterer=EVEN),
    sg.Layer(thickness=10.0, mean_free_path=10.0, scatterer=EVEN, motion=drift(3.0, 1.0, -2.0)),
    sg.Layer(thickness=10.0, mean_free_path=10.0, scatterer=EVEN, motion=sg.Shear(rate=-0.2)),
])  # fmt: skip
GRID = sg.VoxelGrid(lower=[-30, -30, 0], upper=[30, 30, 40], extinction=np.full((2, 2, 2), 0.1), albedo=0.9,
                    material=[[[0, 1], [2, 0]], [[1, 1], [0, 2]]], scatterers=[LOBE, EVEN, LOBE],
                    motion=(None, drift(1.0, 2.0, 3.0), Turning(rate=0.1)))  # fmt: skip
MIXTURE = sg.Mixture(types=[LOBE, sg.VonMisesFisher(20.0)], fractions=[0.5, 0.5])
MEDIA = {"henyey": SLAB, "table": SLAB.replace(scatterer=sg.VonMisesFisher(8.0)),
         "types": SLAB.replace(scatterer=MIXTURE), "stretched": SLAB.replace(thickness=120.0, albedo=0.8),
         "layers": LAYERS, "voxels": GRID}  # fmt: skip


def bank_of(medium, transfer=True, paths=4000):
    if not medium.has_sides:
        return plane_tracer(medium, 1.0, AXIS[None], AXIS[None], False, transfer=transfer).trace(3, paths, threads=1)
    beams = sg.CollimatedBeams.tilts([0.0, 0.0], width=20.0, times=[0.0, 1.0])
    scene = sg.Scene(wavelength=1.0, medium=medium, illumination=beams, sensor=sg.FarField.grid((2, 2), 0.01))
    return replace(scene_tracer(scene, False), transfer=transfer).trace(3, paths, threads=1)


def velocities(name, points):
    """V(x) as the media above say it."""
    x, y, z = points.T
    zero = 0 * x
    if name == "layers":
        kind = np.digitize(z, [10.0, 20.0])
        sheared = np.stack([-0.2 * z, zero, zero], 1)
        return np.select([kind[:, None] == 1, kind[:, None] == 2], [[[3.0, 1.0, -2.0]], sheared])
    if name == "voxels":
        kind = np.array([[[0, 1], [2, 0]], [[1, 1], [0, 2]]])[tuple((points[:, ::-1] > [20, 0, 0]).astype(int).T)]
        turned = 0.1 * np.stack([-y, x, zero], 1)
        return np.select([kind[:, None] == 1, kind[:, None] == 2], [[[1.0, 2.0, 3.0]], turned])
    return np.stack([2.0 * z, zero, zero], 1)


def vertex_between(three):
    """x2 of paths of three scatterings, and where it is known: not where they go straight on."""
    first, last, way = three.entry_direction, three.exit_direction, three.exit - three.entry
    cos = (first * last).sum(1)
    length = ((way * first).sum(1) - cos * (way * last).sum(1)) / (1 - cos**2)
    return three.entry + length[:, None] * first, 1 - np.abs(cos) > 1e-4


@pytest.mark.parametrize("name", MEDIA)
def test_of_three_vertices_it_is_the_turn_in_the_middle_times_the_velocity_there(name):
    bank = bank_of(MEDIA[name])
    assert not bank.doppler[bank.orders < 3].any()
    three = bank.select(bank.orders == 3)
    middle, sure = vertex_between(three)
    assert sure.sum() > 20
    expected = ((three.entry_direction - three.exit_direction) * velocities(name, middle)).sum(1)
    np.testing.assert_allclose(three.doppler[sure], expected[sure], atol=1e-8)
    np.testing.assert_allclose(velocity_at(volume_of(MEDIA[name], 3), middle[sure]), velocities(name, middle)[sure])
    assert np.abs(bank.doppler[bank.orders > 3]).max() > 1


@pytest.mark.parametrize("name", MEDIA)
def test_collecting_it_changes_nothing_else(name):
    without, collected = bank_of(MEDIA[name], False), bank_of(MEDIA[name])
    assert collected.records.shape[1] == FLOW + 1
    if name not in ("layers", "voxels"):  # at rest those layers are a slab, and voxels have no film
        np.testing.assert_array_equal(without.records, bank_of(MEDIA[name].replace(motion=None), False).records)
    np.testing.assert_array_equal(collected.records[:, :RECORD], without.records)
    np.testing.assert_array_equal(collected.orders, without.orders)
    np.testing.assert_array_equal(collected.reversed().doppler, collected.multiple.doppler)


def test_both_ends_follow_for_any_light_and_view_and_the_way_back_gives_the_same():
    bank = bank_of(LAYERS)
    light, view = np.array([0.1, 0.0, np.sqrt(0.99)]), np.array([0.0, -0.6, 0.8])
    found = doppler_shift(plane_layout(LAYERS, 1.0, light[None], view[None]), bank)
    first, last = (velocities("layers", points) for points in (bank.entry, bank.exit))
    once = ((light - view) * first).sum(1)
    more = bank.doppler + ((light - bank.entry_direction) * first).sum(1) + ((bank.exit_direction - view) * last).sum(1)
    np.testing.assert_allclose(found, np.where(bank.orders == 1, once, more), atol=1e-12)
    back = doppler_shift(plane_layout(LAYERS, 1.0, -view[None], -light[None]), bank.reversed())
    np.testing.assert_allclose(found[bank.orders > 1], back, atol=1e-12)


# g1 on the axis at k rate tau l = .1, .2, .5 by another program.
SHEARED = {0.0: [0.964, 0.866, 0.453], 0.9: [0.988, 0.952, 0.758]}


def sheared(g, turns, **asked):
    medium = sg.Slab(thickness=100.0, mean_free_path=10.0, scatterer=sg.HenyeyGreenstein(g), motion=sg.Shear(rate=1.0))
    lags = np.asarray(turns) / (K * 10.0)
    return sg.temporal_correlation(medium, wavelength=2 * np.pi / K, lags=lags, **{"paths": 60_000, "seed": 5} | asked)


@pytest.mark.parametrize("g", SHEARED)
def test_a_shear_as_another_program_has_it(g):
    expected, found = np.array(SHEARED[g]), sheared(g, [0.1, 0.2, 0.5])
    error = np.hypot(found.standard_error / 2 / expected, 0.0015)
    assert_z(found.field.real, expected, error, degrees=63)
    refute_z(sheared(g, [0.11, 0.22, 0.55]).field.real, expected, error, degrees=63)  # of one that is 10 % faster
    assert not found.x.any()


def test_both_estimators_agree(monkeypatch):
    ways = sheared(0.0, [0.1, 0.3], paths=20_000)
    monkeypatch.setattr(temporal, "by_ways", temporal.by_amplitudes)
    amplitudes = sheared(0.0, [0.1, 0.3], paths=20_000, seed=6)
    assert_z(amplitudes.intensity, ways.intensity, np.hypot(ways.standard_error, amplitudes.standard_error))


def test_light_that_is_scattered_once_turns_by_its_depth():
    """A shear before a thin slab: the mean of e^(i k tau v_x rate z) over the depths z where light is scattered."""
    thin = sg.Slab(thickness=10.0, mean_free_path=1e5, scatterer=EVEN, motion=sg.Shear(rate=1.0))
    lags, sine = np.array([0.5, 2.0, 7.0]) / (K * 10.0), 0.6
    found = sg.temporal_correlation(thin, wavelength=2 * np.pi / K, lags=lags, view=[sine, 0.0, 0.8], paths=20_000,
                                    seed=1)  # fmt: skip
    turn = K * lags * sine * 10.0
    expected = (np.exp(1j * turn) - 1) / (1j * turn)  # E[u_0 u_tau*], u_tau turned by -k tau v . V
    weights, twice = found.classes.weights, (np.exp(2j * turn) - 1) / (2j * turn)
    count = weights.sum() ** 2 / np.square(weights).sum()
    squares = np.stack([(1 + twice.real) / 2 - expected.real**2, (1 - twice.real) / 2 - expected.imag**2])
    error = np.sqrt(squares / count)  # of so many depths
    slack = 3e-4  # of two scatterings, and of e^(-z / l)
    assert_z(np.stack([found.field.real, found.field.imag]), [expected.real, expected.imag], error, slack=slack)
    refute_z(found.field.imag, -expected.imag, error[1], slack=slack)


def test_a_medium_that_moves_as_one_forgets_nothing():
    slab = sg.Slab(thickness=40.0, mean_free_path=10.0, scatterer=LOBE, motion=drift(3.0, 0.0, 1.0))
    view = np.array([0.6, 0.0, 0.8])
    found = sg.temporal_correlation(slab, wavelength=2 * np.pi / K, lags=[0.0, 0.7], view=view, paths=500)
    assert bank_of(slab).records.shape[1] == RECORD + 1  # nothing is collected
    np.testing.assert_allclose(found.intensity, 1.0, rtol=1e-12)
    turn = K * 0.7 * ((AXIS - view) @ [3.0, 0.0, 1.0])
    np.testing.assert_allclose(found.field[1], np.exp(-1j * turn), atol=1e-9)
    ahead = sg.temporal_correlation(slab, wavelength=2 * np.pi / K, lags=[1.0], paths=500)
    assert ahead.static_share == 1.0
    both = LAYERS.replace(layers=[layer.replace(motion=slab.motion) for layer in LAYERS.layers])
    again = sg.temporal_correlation(both, wavelength=2 * np.pi / K, lags=[0.7], view=view, paths=500)
    np.testing.assert_allclose(again.intensity, 1.0, rtol=1e-12)


def walked_by_hand(lags, paths, seed, turn=1.0):
    """g1 of ``LAYERS`` by a literal walk whose scatterers have moved: lengths between them before and after.
    complex128[64, 1 + lags]: of 64 batches, the sum of weights first."""
    rng = np.random.default_rng(seed)
    sums = np.zeros((64, 1 + len(lags)), complex)
    place = np.stack([np.zeros(paths), np.zeros(paths), rng.exponential(10.0, paths)], 1)
    batch = np.arange(paths) % 64
    moved = [place + turn * lag * velocities("layers", place) for lag in lags]
    extra = [(new - place)[:, 2] for new in moved]  # along the light, +z
    while len(place):
        inside = (place[:, 2] > 0) & (place[:, 2] < 30)
        place, batch = place[inside], batch[inside]
        moved, extra = [m[inside] for m in moved], [e[inside] for e in extra]
        weight = np.exp(-(30 - place[:, 2]) / 10)
        sums[:, 0] += np.bincount(batch, weight, 64)
        for n in range(len(lags)):
            phase = K * (extra[n] - (moved[n] - place)[:, 2])  # seen along +z
            left = weight * np.exp(-1j * phase)
            sums[:, n + 1] += np.bincount(batch, left.real, 64) + 1j * np.bincount(batch, left.imag, 64)
        cos, azimuth = rng.uniform(-1, 1, len(place)), rng.uniform(0, 2 * np.pi, len(place))
        sine = np.sqrt(1 - cos**2)
        flight = rng.exponential(10.0, len(place))
        step = flight[:, None] * np.stack([sine * np.cos(azimuth), sine * np.sin(azimuth), cos], 1)
        onward = place + step
        for n, lag in enumerate(lags):
            new = onward + turn * lag * velocities("layers", onward)
            extra[n] = extra[n] + np.linalg.norm(new - moved[n], axis=1) - flight
            moved[n] = new
        place = onward
    return sums


def test_layers_that_flow_against_scatterers_that_have_moved():
    """Lengths between moved scatterers, walked by hand; of velocities 20 % larger they are told apart."""
    lags = np.array([1e-4, 3e-4, 8e-4])
    found = sg.temporal_correlation(LAYERS, wavelength=2 * np.pi / K, lags=lags, paths=60_000, seed=2)

    def judged(turn):
        value, error = jackknife(walked_by_hand(lags, 60_000, 1, turn), lambda s: (s[1:] / s[0]).view(float))
        its = np.repeat(found.standard_error / np.maximum(np.abs(found.field), 0.05), 2)
        assert_z(found.field.view(float), value, np.hypot(error, its), degrees=63)

    judged(1.0)
    with pytest.raises(AssertionError, match="z ="):
        judged(1.2)


def exits_by_hand(lags, paths, seed, turn=1.0):
    """E[w e^(i k tau D)] of all light behind ``LAYERS`` whose scatterers have moved: the same walk to its end."""
    rng = np.random.default_rng(seed)
    sums = np.zeros((64, 1 + len(lags)), complex)
    place, batch = np.stack([np.zeros(paths), np.zeros(paths), rng.exponential(10.0, paths)], 1), np.arange(paths) % 64
    moved = [place + turn * lag * velocities("layers", place) for lag in lags]
    extra = [(new - place)[:, 2] for new in moved]
    inside = place[:, 2] < 30
    while inside.any():
        place, batch = place[inside], batch[inside]
        moved, extra = [m[inside] for m in moved], [e[inside] for e in extra]
        cos, azimuth = rng.uniform(-1, 1, len(place)), rng.uniform(0, 2 * np.pi, len(place))
        sine, flight = np.sqrt(1 - cos**2), rng.exponential(10.0, len(place))
        way = np.stack([sine * np.cos(azimuth), sine * np.sin(azimuth), cos], 1)
        onward = place + flight[:, None] * way
        out = onward[:, 2] > 30
        sums[:, 0] += np.bincount(batch, out, 64)
        for n, lag in enumerate(lags):
            left = out * np.exp(1j * K * (extra[n] - ((moved[n] - place) * way).sum(1)))
            sums[:, n + 1] += np.bincount(batch, left.real, 64) + 1j * np.bincount(batch, left.imag, 64)
            new = onward + turn * lag * velocities("layers", onward)
            extra[n] = extra[n] + np.linalg.norm(new - moved[n], axis=1) - flight
            moved[n] = new
        place, inside = onward, (onward[:, 2] > 0) & (onward[:, 2] < 30)
    return sums


def test_all_views_together_of_what_flows():
    """joint_correlation with a lag: against moved scatterers; a medium that moves as one is found where it is."""
    lags, alone = np.array([1e-4, 3e-4, 8e-4]), {"wavelength": 2 * np.pi / K, "tilts": [0.0], "paths": 60_000}
    found = sg.joint_correlation(LAYERS, **alone, shifts=[0.0], lags=lags)
    for turn in (1.0, 1.2):
        value, error = jackknife(exits_by_hand(lags, 60_000, 1, turn), lambda s: np.abs(s[1:] / s[0]))
        noise = np.hypot(error, found.standard_error[0, 0])
        if turn == 1:
            assert_z(found.magnitude[0, 0], value, noise, degrees=63)
        else:
            refute_z(found.magnitude[0, 0], value, noise, degrees=63)
    slab = sg.Slab(thickness=40.0, mean_free_path=10.0, scatterer=LOBE, motion=drift(3.0, 0.0, 0.0))
    moved = sg.joint_correlation(slab, **alone | {"paths": 2000}, shifts=[0.0, 3e-3], lags=[0.0, 1e-3])
    np.testing.assert_allclose(moved.magnitude[0, 1, 1], 1.0)
    np.testing.assert_allclose(moved.magnitude[0, 0, 1], moved.magnitude[0, 1, 0])


def test_what_rests_above_what_flows_is_the_floor():
    still = sg.Layer(thickness=5.0, mean_free_path=10.0, scatterer=EVEN)
    pair = [still, still.replace(motion=drift(1.0, 0.0, 0.0))]
    found = sg.temporal_correlation(sg.Layers(layers=pair), wavelength=2 * np.pi / K, lags=[1e6], paths=20_000)
    single = sg.memory_effect(sg.Layers(layers=pair), wavelength=2 * np.pi / K, tilts=[0.0], paths=20_000).single_share
    assert found.static_share > single  # scattered once straight ahead, or in the layer at rest alone
    assert_z(np.abs(found.field), found.static_share, 3e-2)


# Films. Of wavelength 1.
THIN = sg.Slab(thickness=40.0, mean_free_path=10.0, scatterer=LOBE, motion=sg.Shear(rate=1.0))
WIDE = sg.Slab(thickness=1000.0, mean_free_path=100.0, scatterer=sg.HenyeyGreenstein(0.9))
TIMES = np.array([0.0, 0.005, 0.015])
STILL = sg.Layer(thickness=5.0, mean_free_path=5.0, scatterer=LOBE)
MOVING = STILL.replace(motion=drift(2.0, 0, 0))
VOXELS = sg.VoxelGrid(lower=[-100, -100, 0], upper=[100, 100, 10], extinction=np.full((2, 1, 1), 0.2),
                      material=[[[0]], [[1]]], scatterers=[LOBE, LOBE], motion=(None, drift(2.0, 0, 0)))  # fmt: skip
SMALL = {"times": 20 * TIMES, "width": 60.0, "shape": (8, 8), "pitch": 0.005, "center": (0.2, 0.0)}


def film(medium=THIN, times=TIMES, width=200.0, shape=(16, 16), pitch=0.002, **view):
    beams = sg.CollimatedBeams.tilts(np.zeros(len(times)), width=width, times=times)
    return sg.Scene(wavelength=1.0, medium=medium, illumination=beams, sensor=sg.FarField.grid(shape, pitch, **view))


def correlated(fields):
    """E[u_0 u_t*] of frames complex[R, T, ...] over their powers, real and imaginary parts, and errors, [T - 1, 2]."""
    u = fields.astype(complex).reshape(*fields.shape[:2], -1)
    t = u.shape[1]
    sums = np.concatenate([(u[:, :1] * u.conj()).sum(-1), np.square(np.abs(u)).sum(-1)], axis=1)
    return jackknife(sums, lambda s: (s[1:t] / np.sqrt(s[t + 1 :] * s[t]).real).view(float).reshape(-1, 2))


FILMS = {"slab": (film(), THIN), "off the axis": (film(center=(0.3, 0.0)), THIN),
         "layers": (film(sg.Layers(layers=[STILL, MOVING]), **SMALL), sg.Layers(layers=[STILL, MOVING])),
         "voxels": (film(VOXELS, **SMALL), sg.Layers(layers=[STILL, MOVING]))}  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize("name", FILMS)
def test_frames_by_path_sums_forget_as_the_medium_does(name):
    scene, medium = FILMS[name]
    stack = sg.render(scene, sampler="paths", paths=800, seed=2, realizations=32, reverse=False)
    value, error = correlated(stack.field)
    times, view = scene.beams.times, scene.sensor.center_direction

    def law(speed):
        found = sg.temporal_correlation(medium, wavelength=1.0, lags=speed * times, view=view, paths=20_000, seed=9)
        its = found.standard_error / 2 / np.abs(found.field)
        return found.field[1:].view(float).reshape(-1, 2), np.hypot(error, its[1:, None])

    assert_z(value, *law(1.0), degrees=31, slack=0.02)  # of views beside the middle one
    refute_z(value, *law(1.7), degrees=31, slack=0.02)


def test_a_flow_of_velocity_0_is_rest():
    for nothing in (drift(0.0, 0.0, 0.0), sg.Shear(rate=0.0)):
        medium = THIN.replace(motion=nothing)
        assert not medium.moves
        with pytest.raises(RuleError, match="CollimatedBeams.times must be left out for a medium at rest"):
            film(medium)
        assert bank_of(medium).records.shape[1] == RECORD + 1


def test_a_medium_that_moves_as_one_is_seen_elsewhere_by_the_window_and_nothing_else():
    """By the stationary sampler as far as the window reaches; by path sums the phase of each view, moving little."""
    times, speed = np.array([0.0, 1.0, 3.0, 8.0]), 2000.0
    scene = film(WIDE.replace(motion=drift(speed, 0.0, 0.0)), times, 20_000.0, (48, 48), 2.5e-5)
    stack = sg.render(scene, seed=3, paths=2000, realizations=16)
    assert stack.report.sampler == "stationary"
    x, _ = scene.grid.sines
    turn = np.exp(-2j * np.pi * times[:, None, None] * speed * (0.0 - x))
    value, error = correlated(stack.field / turn.conj())
    kept = scene.beams.window.overlap(times[1:] * speed, 0.0 * times[1:])
    assert_z(value, np.stack([kept, 0 * kept], 1), error, degrees=15, slack=0.01)  # cells at the edge
    asked = {"sampler": "paths", "seed": 3, "paths": 500}
    near = film(WIDE.replace(motion=drift(30.0, 0.0, 0.0)), times / 2, 20_000.0, (16, 16), 2.5e-5)
    fields, (x, _) = sg.render(near, **asked).field, near.grid.sines
    moved = fields[:1] * np.exp(2j * np.pi * (times / 2)[:, None, None] * 30.0 * (0.0 - x))
    assert np.abs(fields - moved).max() < 2e-3 * np.abs(fields).max()  # field_tolerance
    with pytest.raises(RuleError, match="CollimatedBeams.times must be so close that the medium moves"):
        sg.render(scene, **asked)


@pytest.mark.parametrize("medium", ["shear", "layers"])
def test_the_stationary_sampler_draws_flows_that_differ(medium):
    """Frames and tilts of a wide medium as the medium has them; they are those of path sums."""
    half = sg.Layer(thickness=500.0, mean_free_path=100.0, scatterer=WIDE.scatterer)
    flows = {"shear": WIDE.replace(motion=sg.Shear(rate=1 / 200)),
             "layers": sg.Layers(layers=[half, half.replace(motion=drift(2.0, 0.0, 0.0))])}  # fmt: skip
    times, pitch, step = np.array([0.0, 0.2, 0.5]), 2.5e-5, 4
    beams = sg.CollimatedBeams.tilts(np.arcsin(np.arange(3) * step * pitch), width=20_000.0, times=times)
    grid = sg.FarField.grid((48, 56), pitch)
    scene = sg.Scene(wavelength=1.0, medium=flows[medium], illumination=beams, sensor=grid)
    stack = sg.render(scene, sampler="stationary", seed=3, paths=20_000, realizations=12)
    seen = np.stack([stack.field[:, t, :, t * step : t * step + 48] for t in range(3)], axis=1)
    value, error = correlated(seen)

    def law(speed):
        found = sg.temporal_correlation(flows[medium], wavelength=1.0, lags=speed * times, paths=40_000, seed=4,
                                        tilts=np.arcsin(np.arange(3) * step * pitch))  # fmt: skip
        its = np.hypot(found.standard_error / 2 / np.abs(found.field), 0.01)[1:, None]
        return found.field[1:].view(float).reshape(-1, 2), np.hypot(error, its)

    assert_z(value, *law(1.0), degrees=11)
    refute_z(value, *law(2.0), degrees=11)


def test_random_motion_and_a_flow_in_one_medium():
    """Particles that boil in one layer and flow in another: e^(-2 x Y) and e^(i k tau D) of the same paths."""
    fluid = sg.Brownian(diffusion=1.0)
    layers = [LAYERS.layers[0].replace(motion=fluid), LAYERS.layers[1]]
    assert fastest(sg.Layers(layers=layers).motions)[0] == fluid
    assert law_of([None, SHEAR]) == SHEAR
    lags = np.array([2e-5, 2e-4]) / 10
    both, boiling = (sg.Layers(layers=[layers[0], layers[1].replace(motion=m)]) for m in (layers[1].motion, None))
    flowing = sg.Layers(layers=[layers[0].replace(motion=None), layers[1]])
    asked = {"wavelength": 2 * np.pi / K, "lags": lags, "paths": 5000, "seed": 3}
    found, one, other = (sg.temporal_correlation(medium, **asked) for medium in (both, boiling, flowing))
    assert (found.intensity < np.minimum(one.intensity, other.intensity)).all()
    np.testing.assert_array_equal(found.x, one.x)


def test_refusals():
    tilted = {"wavelength": 1.0, "tilts": [0.0], "shifts": [0.0]}
    with pytest.raises(RuleError, match="joint_correlation medium must be of a flow that is uniform along"):
        sg.joint_correlation(THIN.replace(motion=Turning(rate=1.0)), **tilted, lags=1.0)
    with pytest.raises(RuleError, match="Slab.motion must be at rest or random, since its faces reflect"):
        THIN.replace(faces=sg.Faces(inside=1.33))
    with pytest.raises(RuleError, match="Layers.motion must be at rest or random, since its faces reflect"):
        sg.Layers(layers=[STILL, MOVING], faces=sg.Faces(inside=1.33))
    with pytest.raises(RuleError, match="Drift.velocity must be of 3 components in this medium"):
        film(THIN.replace(motion=drift(1.0, 2.0)))
    assert_refused(lambda: drift(1.0), "Drift.velocity must be")
    assert_refused(lambda: sg.Shear(rate=np.inf), "Shear.rate must be")
    with pytest.raises(RuleError, match="temporal_correlation medium must be of a flow that is uniform along"):
        sg.temporal_correlation(THIN.replace(motion=Turning(rate=1.0)), wavelength=1.0, lags=[0.0])
    for flow in (SHEAR, Turning(rate=1e-9)):
        with pytest.raises(RuleError,
                           match="sampler must be .* The stationary sampler supports flows near the middle of"):
            sg.plan(film(WIDE.replace(motion=flow), [0.0, 1.0], 20_000.0, (16, 16), 2.5e-5), sampler="stationary")
    with pytest.raises(RuleError, match="sampler must be .* The stationary sampler draws no medium that moves along"):
        sg.plan(film(WIDE.replace(motion=drift(0, 0, 1.0)), TIMES, 20_000.0, (16, 16), 2.5e-5), sampler="stationary")
    with pytest.warns(DoubtWarning, match="flow: particles move by up to"):
        sg.render(film(sg.Layers(layers=[MOVING, STILL]), [0.0, 5.0]), sampler="paths", paths=200)
