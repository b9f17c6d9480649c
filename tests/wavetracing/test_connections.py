"""Connections of matt surfaces with receivers, against quadrature, rays that hit by chance, and repetition."""

import numpy as np
import pytest
from wavetracing.solids import box
from zscore import assert_z, refute_z

from specklegen.wavetracing import Absorber, CollimatedEmitter, Diffuse, Geometry, Mesh, Plane, perforated_screen, trace

pytestmark = pytest.mark.filterwarnings("ignore::specklegen.core.errors.DoubtWarning")

QUADS = [[0, 1, 2], [0, 2, 3]]
FLOOR = Mesh([[-50, -50, 0], [50, -50, 0], [50, 50, 0], [-50, 50, 0.0]], QUADS, Diffuse(albedo=0.8))
DOWN = CollimatedEmitter([-4, -4, 10], [4, 4, 10], [0, 0, -1], beam_radius=0.5, wavelength=0.05)
ASIDE = Plane(center=[12, 1, 5], normal=[1, 0, 0], up=[0, 0, 1], shape=(3, 2), pitch=1.0)  # beside the light
LOW, HIGH = np.array([6.0, -3.0, 0.0]), np.array([8.0, 2.0, 1.2])  # a block between floor and receiver
SCENE = Geometry([FLOOR, box(HIGH - LOW, (LOW + HIGH) / 2, material=Absorber())])


def hidden(start, stop):
    """bool[...], whether the block stands between points: by slabs."""
    with np.errstate(divide="ignore"):
        one, two = (LOW - start) / (stop - start), (HIGH - start) / (stop - start)
    return np.minimum(one, two).max(axis=-1).clip(0) < np.maximum(one, two).min(axis=-1).clip(max=1)


def by_quadrature(fine=120, parts=6):
    """Irradiance of the receiver: the floor, evenly lit, is matt."""
    grid = (np.arange(fine) + 0.5) / fine * 8 - 4
    floor = np.stack([*np.meshgrid(grid, grid), np.zeros((fine, fine))], axis=-1).reshape(-1, 3)
    cells = ASIDE.replace(shape=tuple(parts * n for n in ASIDE.shape), pitch=ASIDE.pitch / parts)
    image = []
    for point in cells.points.reshape(-1, 3):
        way = point - floor
        square = (way**2).sum(axis=1)
        image.append((np.abs(way[:, 2] * way[:, 0]) / square**2 * ~hidden(floor, point)).mean())
    rows, columns = ASIDE.shape
    return 0.8 / np.pi * np.reshape(image, (rows, parts, columns, parts)).mean(axis=(1, 3))


def from_the_floor(count, seed=3):
    """Starts and directions of light that the floor scatters."""
    rng = np.random.default_rng(seed)
    start = np.column_stack([rng.uniform(-4, 4, (count, 2)), np.zeros(count)])
    share, angle = rng.random(count), rng.uniform(0, 2 * np.pi, count)
    across = np.sqrt(share)
    return start, np.column_stack([across * np.cos(angle), across * np.sin(angle), np.sqrt(1 - share)])


def test_a_small_receiver_beside_the_light():
    """Each cell as by quadrature; of the mean 1 % is caught, and its error is a fifth of that of as many hits."""
    found = trace(SCENE, DOWN, ASIDE, 600_000, 2, "ray")
    expected = by_quadrature()
    assert_z(found.irradiance[0], expected, found.standard_error[0], slack=2e-3 * expected.max())
    mean, error = found.irradiance[0].mean(), np.sqrt(np.square(found.standard_error[0]).sum()) / 6
    assert_z(mean, expected.mean(), error, slack=1e-3 * mean)
    refute_z(1.01 * mean, expected.mean(), error, slack=1e-3 * mean)
    start, way = from_the_floor(600_000)
    there = start + ((12 - start[:, 0]) / way[:, 0])[:, None] * way
    hit = (way[:, 0] > 0) & ~hidden(start, there) & (np.abs(there - ASIDE.center) < [1, 1.0, 1.5]).all(axis=1)
    noise = 0.8 * hit.std() / np.sqrt(len(hit)) / 6
    assert_z(mean, 0.8 * hit.mean() / 6, np.hypot(error, noise))
    assert error < 0.2 * noise
    assert found.ledger.total == 600_000


def test_a_receiver_just_above_the_floor():
    """Where the square of a connection alone has no bound, errors are no larger than those of hits by chance."""
    plane, count = Plane(center=[0, 0, 0.02], shape=(1, 1), pitch=4.0), 40_000
    found = trace(Geometry([FLOOR]), DOWN, plane, count, 4, "ray")
    start, way = from_the_floor(count)
    there = start + 0.02 / way[:, 2:] * way
    # On its way down, and of eight of ten up.
    brought = 1.0 * (np.abs(start) < 2).all(axis=1) + (np.abs(there) < 2).all(axis=1) * (np.arange(count) % 10 < 8)
    power, error = 16 * found.irradiance[0][0, 0], 16 * found.standard_error[0][0, 0]
    noise = brought.std() / np.sqrt(count)
    assert_z(power, brought.mean(), np.hypot(error, noise))
    assert error < 1.05 * noise


def test_light_through_a_hole_is_counted_once():
    """By beams, which the hole diffracts, as much as by rays: no connection goes through it."""
    flat = perforated_screen([[-50, -50], [50, -50], [50, 50], [-50, 50]], [[[-1, -1], [1, -1], [1, 1], [-1, 1]]])
    scene = Geometry([FLOOR, Mesh(flat.vertices + [0, 0, 3], flat.faces)])
    light = CollimatedEmitter([-4, -4, 2.5], [4, 4, 2.5], [0, 0, -1], beam_radius=0.5, wavelength=0.05)
    above = Plane(center=[0, 0, 6], shape=(1, 1), pitch=400.0)
    wave, ray = trace(scene, light, above, 60_000, 5), trace(scene, light, above, 10**6, 6, "ray")
    value, error = wave.irradiance[0][0, 0], wave.standard_error[0][0, 0]
    expected, noise = ray.irradiance[0][0, 0], ray.standard_error[0][0, 0]
    assert_z(value, expected, np.hypot(error, noise))
    refute_z(1.3 * value, expected, np.hypot(error, noise))


def test_errors_hold_where_a_beam_comes_often():
    """Between two white plates a beam brings light many times: errors as 300 runs scatter, to 0.4 of variance."""
    plates = [Mesh([[-9, -9, z], [9, -9, z], [9, 9, z], [-9, 9, z]], QUADS, Diffuse(albedo=0.95)) for z in (0.0, 3.0)]
    light = CollimatedEmitter([-2, -2, 2.0], [2, 2, 2.0], [0, 0, -1], beam_radius=0.5, wavelength=0.05)
    plane = Plane(center=[0, 0, 1.0], shape=(1, 1), pitch=8.0)
    runs = [trace(Geometry(plates), light, plane, 100, seed, "ray", threads=1) for seed in range(300)]
    values, errors = np.array([(run.irradiance[0][0, 0], run.standard_error[0][0, 0]) for run in runs]).T
    assert np.square(errors).mean() == pytest.approx(values.var(ddof=1), rel=0.4)
