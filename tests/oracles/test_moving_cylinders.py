"""Cylinders that move: rest, long times, and the law of single scattering."""

import numpy as np
import pytest
from references import moving_cylinders
from references.moving_cylinders import moved, temporal_correlation
from refusals import assert_refused
from scipy.spatial.distance import pdist
from zscore import assert_mean, assert_z, refute_mean, refute_z

import specklegen as sg
from specklegen.core.statistics import batch_sums, jackknife
from specklegen.oracles.cylinder import Cylinder
from specklegen.oracles.wave_ensemble import CylinderGas
from specklegen.oracles.wave_solver import PlaneLights, directions_of
from specklegen.paths.endpoint_factors import contributions
from specklegen.paths.momentum import doppler_shift, momentum_transfer
from specklegen.paths.tracer import scene_tracer
from specklegen.scene.motion import reduced_time

WEAK = CylinderGas(Cylinder(0.01, 1.5, order=0), (-1.5, -1.5), (1.5, 1.5), 0.7)  # OD 1e-4: light scatters once
LIGHTS = PlaneLights(directions_of(np.array([0.0])))
ANGLES = np.array([0.5, 1.6, 3.0])
X = np.array([0.0, 0.1, 0.5, 8.0])


def far(solved):
    return solved.far_field(directions_of(ANGLES))


@pytest.fixture(scope="module")
def weak():
    return temporal_correlation(WEAK, LIGHTS, far, X, placements=768, seed=4)


def test_light_scattered_once_decays_by_its_momentum_transfer(weak):
    """g1 = e^(-2x (1 - i.v)), nothing at rest, nothing left after a long time."""
    law = np.exp(-2 * X[:, None] * (1 - np.cos(ANGLES)))
    np.testing.assert_allclose(weak.field[0], 1, rtol=1e-12)
    assert_z(weak.field[1:, :, 0], law[1:], weak.standard_error[1:, :, 0], degrees=63)
    assert_z(weak.imaginary[1:], 0.0, weak.imaginary_error[1:], degrees=63)
    assert law[3, 2] < 1e-12
    refute_z(weak.field[1:, :, 0], law[1:] ** 1.5, weak.standard_error[1:, :, 0], degrees=63)  # 6 D tau in flatland


def test_steps_have_their_variance_and_keep_cylinders_apart():
    crowd = CylinderGas(Cylinder(0.05, 1.5), (0.0, 0.0), (1.0, 1.0), 12.0)
    rng = np.random.default_rng(0)
    for n in range(50):
        centres = moved(crowd, crowd.placement(0, n), 0.1, rng, np.array([[0.5, 0.5]]))
        assert len(centres) < 2 or pdist(centres).min() > 0.1
        assert np.linalg.norm(centres - 0.5, axis=1).min(initial=1) > 0.05
    far_apart = 10.0 * np.mgrid[:40, :40].reshape(2, -1).T
    steps = moved(WEAK, far_apart, 0.1, rng, np.empty((0, 2))) - far_apart
    assert_mean(np.square(steps).reshape(64, -1).mean(axis=1), 0.01)


@pytest.mark.parametrize(("x", "placements", "words"), [
    ([0.2, 0.1], 256, "x must be finite, at least 0, and each at least the one before"),
    ([-0.2], 256, "x must be finite, at least 0"), ([np.inf], 256, "x must be finite"), ([], 256, "x must be finite"),
    ([0.1], 100, "placements must be at least two for each of 64 batches"),
])  # fmt: skip
def test_bad_input_is_named(x, placements, words):
    assert_refused(lambda: temporal_correlation(WEAK, LIGHTS, far, x, placements=placements, seed=0), words)


# A square box of optical depth 2, ten wavelengths a mean free path: sides, views from the light's direction, lags.
SIDE, FREE, VIEWS, LAGS = 20.0, 10.0, np.array([0.8, 2.0]), np.array([0.1, 0.4, 1.5])


def transported(paths, seed, speed=1.0):
    """g1 of that box by a random walk in flatland and nothing else, float64[64, X, V]: E[w e^(-2xY)] / E[w]."""
    rng = np.random.default_rng(seed)
    place = np.stack([rng.uniform(-SIDE / 2, SIDE / 2, paths), np.full(paths, -SIDE / 2)], axis=1)
    direction, batch, transfer = np.tile([0.0, 1.0], (paths, 1)), np.arange(paths) % 64, np.zeros(paths)
    views, sums = directions_of(VIEWS), np.zeros((64, 1 + len(LAGS), len(VIEWS)))
    lags = np.append(0.0, speed * LAGS)
    while len(place):
        place = place + rng.exponential(FREE, len(place))[:, None] * direction
        inside = (np.abs(place) < SIDE / 2).all(axis=1)
        place, direction, batch, transfer = place[inside], direction[inside], batch[inside], transfer[inside]
        for v, view in enumerate(views):
            left = np.min((SIDE / 2 - np.sign(view) * place) / np.abs(view), axis=1)
            moved = transfer + 1 - direction @ view
            for n, x in enumerate(lags):
                sums[:, n, v] += np.bincount(batch, np.exp(-left / FREE - 2 * x * moved), 64)
        angle = rng.uniform(0, 2 * np.pi, len(place))
        onward = directions_of(angle)
        transfer, direction = transfer + 1 - np.sum(direction * onward, axis=1), onward
    return sums[:, 1:] / sums[:, :1]


@pytest.fixture(scope="module")
def waves():
    """g1 of that box by waves and its standard error, float64[X, V]: four lights and a mirror, 32 batches."""
    gas = CylinderGas.with_mean_free_path(Cylinder.resonant(0.02, order=0), (-SIDE / 2, -SIDE / 2),
                                          (SIDE / 2, SIDE / 2), FREE)  # fmt: skip
    turns = np.arange(4) * np.pi / 2
    lights = PlaneLights(directions_of(turns))
    angles = np.concatenate([VIEWS, -VIEWS])

    def seen(solved):
        every = solved.far_field(directions_of((turns[:, None] + angles).ravel())).reshape(4, 4, len(angles))
        own = every[np.arange(4), np.arange(4)]  # of each light the views that are turned with it
        return own.reshape(4 * 2, len(VIEWS))

    runs = [temporal_correlation(gas, lights, seen, LAGS, placements=64, batches=32, seed=n).field for n in range(32)]
    found = np.array(runs).mean(axis=-1)
    return found.mean(axis=0), found.std(axis=0, ddof=1) / np.sqrt(len(runs))


def judged(waves, law, noise=0.0):
    """Assert that waves and a law agree, the difference known within 0.01; more placements: docs/notes/motion.md."""
    found, error = waves
    assert np.hypot(error, noise).max() < 0.01
    assert_z(found, law, np.hypot(error, noise), degrees=31)


@pytest.mark.slow
def test_a_box_of_optical_depth_two_by_random_walks(waves):
    """Waves against transport, where a third of the light is scattered more than once."""
    theory = transported(400_000, seed=1)
    law, noise = theory.mean(axis=0), theory.std(axis=0, ddof=1) / 8
    assert (noise < 0.3 * waves[1]).all()
    judged(waves, law, noise)
    single = np.exp(-2 * LAGS[:, None] * (1 - np.cos(VIEWS)))
    assert np.abs(law - single).max() > 0.04  # or it proves nothing of multiple scattering
    for wrong in (transported(400_000, seed=2, speed=1.15).mean(axis=0), single):  # a motion 15 % faster
        with pytest.raises(AssertionError, match="z ="):
            judged(waves, wrong)


def engine(speed=1.0, aside=(0.0,)):
    """The same box as a user would have it, whose particles move ``speed`` times faster; times are D k^2 tau."""
    box = sg.Box(lower=[-SIDE / 2] * 2, upper=[SIDE / 2] * 2, mean_free_path=FREE, scatterer=sg.Isotropic(),
                 motion=sg.Brownian(diffusion=speed / (2 * np.pi) ** 2))  # fmt: skip
    beams = sg.CollimatedBeams(directions=[[0.0, 1.0]] * 4, width=3 * SIDE, times=[0.0, *LAGS])
    angles = np.stack([VIEWS, -VIEWS])[..., None] + np.array(aside)
    sensor = sg.FarField(directions=directions_of(angles.ravel()))
    return sg.Scene(wavelength=1.0, medium=box, illumination=beams, sensor=sensor)


def averaged(speed=1.0):
    """Law and standard error [X, V] of the engine's banks, E[w e^(-2xY)] / E[w]."""
    scene = engine(speed)
    tracer, x = scene_tracer(scene, False), reduced_time("x", scene.medium.motion, 1.0, scene.beams.times)
    bank, sums = tracer.trace(1, 200_000), []
    for v in range(len(VIEWS)):
        layout = tracer.layout.of_ends(slice(0, 1), slice(v, v + 1))
        weights, moved = contributions(layout, bank), momentum_transfer(layout, bank)
        sums.append(batch_sums(weights * np.exp(-2 * x[:, None] * moved), bank.paths, 200_000).real)
    return jackknife(np.stack(sums, axis=-1), lambda some: some[1:] / some[:1])


def filmed():
    """The same from frames by path sums: two views and their mirrors, each of five pixels that are a grain apart."""
    scene = engine(aside=0.05 * np.arange(-2, 3))
    u = sg.render(scene, sampler="paths", paths=60, seed=3, realizations=1600, reverse=False).field.astype(complex)
    u = u.reshape(64, 25, 1 + len(LAGS), 2, len(VIEWS), 5)
    sums = np.stack([u[:, :, :1].conj() * u, np.square(np.abs(u))], axis=1).sum(axis=(2, 4, 6))
    return jackknife(sums, lambda some: (some[0] / np.sqrt(some[1] * some[1, :1]).real).real[1:])


@pytest.mark.slow
def test_that_box_by_the_engine(waves):
    """Banks of the engine, and frames of `render`, against waves that know no path; a motion 15 % faster is told."""
    law, noise = averaged()
    assert (noise < 0.4 * waves[1]).all()
    judged(waves, law, noise)
    judged(waves, *filmed())
    with pytest.raises(AssertionError, match="z ="):
        judged(waves, *averaged(speed=1.15))


def test_steps_are_of_the_law_that_a_medium_states(monkeypatch):
    """<Dr^2> of a motion is that of three components, of which flatland keeps two: 4 D tau for 6 D tau."""
    squares = []

    def watched(gas, centres, *rest):
        if len(centres):
            squares.append(np.square(moved(gas, centres, *rest) - centres).sum(axis=1).mean())
        return centres

    monkeypatch.setattr(moving_cylinders, "moved", watched)
    law = sg.Brownian(diffusion=3.0)
    lag = 0.01
    x = reduced_time("test", law, WEAK.cylinder.wavelength, lag)
    temporal_correlation(WEAK, LIGHTS, far, [x], placements=256, seed=4)
    assert_mean(squares, 4 * law.diffusion * lag)
    assert law.mean_square(lag) == pytest.approx(6 * law.diffusion * lag)
    refute_mean(squares, law.mean_square(lag))


SHEARED = np.array([0.5, 1.5, 3.0])
"""k rate t l of a shear, over the box of optical depth 2."""


def sheared(side, rate=1.0):
    """A flow (V, 0) along x that grows with z from the middle of a box on: of wavelength 1, rate / (2 pi) z / side."""
    return lambda centres: np.stack([rate / (2 * np.pi) * centres[:, 1] / side, 0 * centres[:, 1]], axis=1)


def test_light_scattered_once_turns_with_the_flow():
    """g1 is the mean of e^(-i k t (i - v) . V(z)) over the box, |z| <= side / 2, a sinc; of one velocity a phase."""
    times, side = np.array([0.0, 2.0, 6.0]), 3.0
    flow = sheared(side)
    found = temporal_correlation(WEAK, LIGHTS, far, times, placements=768, seed=4, flow=flow)
    law, faster = (np.sinc(speed * times[:, None] * np.sin(ANGLES) / (2 * np.pi)) for speed in (1.0, 1.4))
    np.testing.assert_allclose(found.field[0], 1, rtol=1e-12)
    assert_z(found.field[1:, :, 0], law[1:], found.standard_error[1:, :, 0], degrees=63)
    assert_z(found.imaginary[1:], 0.0, found.imaginary_error[1:], degrees=63)
    refute_z(found.field[1:, :, 0], faster[1:], found.standard_error[1:, :, 0], degrees=63)
    once = temporal_correlation(WEAK, LIGHTS, far, [1.0], placements=256, seed=4, flow=lambda c: 0 * c + [0.1, 0.2])
    turn = 2 * np.pi * (directions_of(np.array([0.0])) - directions_of(ANGLES)) @ [0.1, 0.2]
    np.testing.assert_allclose((once.field + 1j * once.imaginary)[0, :, 0], np.exp(-1j * turn), atol=1e-9)


def carried_waves():
    """g1 of the box of optical depth 2 under a shear, real and imaginary parts float64[2, X, V], and their errors."""
    gas = CylinderGas.with_mean_free_path(Cylinder.resonant(0.02, order=0), (-SIDE / 2, -SIDE / 2),
                                          (SIDE / 2, SIDE / 2), FREE)  # fmt: skip
    turns = np.array([0.0, np.pi])  # by which the flow is what it was
    angles = np.concatenate([VIEWS, -VIEWS])

    def seen(solved):
        every = solved.far_field(directions_of((turns[:, None] + angles).ravel())).reshape(2, 2, len(angles))
        return every[np.arange(2), np.arange(2)].reshape(2 * 2, len(VIEWS))

    runs = []
    for n in range(32):
        found = temporal_correlation(gas, PlaneLights(directions_of(turns)), seen, SHEARED, placements=64, batches=32,
                                     seed=n, flow=sheared(1.0, 1 / FREE))  # fmt: skip
        mirrored = np.array([1, -1] * 2)  # at -v the conjugate
        runs.append([found.field.mean(axis=-1), (found.imaginary * mirrored).mean(axis=-1)])
    return np.mean(runs, axis=0), np.std(runs, axis=0, ddof=1) / np.sqrt(len(runs))


@pytest.mark.slow
def test_a_shear_of_that_box_by_the_engine():
    """Doppler shifts of the engine's paths against waves that know no path; a flow 20 % faster is told."""
    waves, error = carried_waves()
    scene = engine().replace(medium=engine().medium.replace(motion=sg.Shear(rate=1 / (2 * np.pi * FREE))))
    tracer, sums = scene_tracer(scene, False), []
    bank = tracer.trace(1, 200_000)
    for v in range(len(VIEWS)):
        layout = tracer.layout.of_ends(slice(0, 1), slice(v, v + 1))
        weights, shifts = contributions(layout, bank), doppler_shift(layout, bank)
        times = np.concatenate([[0.0], SHEARED, 1.2 * SHEARED])[:, None]
        sums.append(batch_sums(weights * np.exp(-2j * np.pi * times * shifts), bank.paths, 200_000))
    value, noise = jackknife(np.stack(sums, axis=-1), lambda some: np.stack([(some[1:] / some[:1]).real,
                                                                              (some[1:] / some[:1]).imag]))  # fmt: skip
    right, faster = np.split(value, 2, axis=1)
    its, other = np.split(noise, 2, axis=1)
    assert_z(waves, right, np.hypot(error, its), degrees=31)
    refute_z(waves, faster, np.hypot(error, other), degrees=31)
