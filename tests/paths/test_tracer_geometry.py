"""Every light, medium and sensor of the general engine against the literal oracle, the slab engine and energy."""

from itertools import product

import numpy as np
import pytest
from volume_batches import BATCHES, assert_same, engine_batches, intensities, oracle_batches, z_scores
from zscore import assert_mean, assert_z, refute_mean, refute_z

import specklegen as sg
from specklegen.oracles.box_algorithms import Beams, Far, Near, Setup
from specklegen.oracles.box_media import box, henyey_greenstein
from specklegen.paths.endpoint_factors import multiple_amplitudes, single_amplitudes
from specklegen.paths.tracer import volume_tracer

WAVELENGTH = 0.7
LIGHTS = ("plane", "beam", "outside", "inside")
SENSORS = ("far", "outside", "inside")


def directions(degrees, dimension):
    angles = np.deg2rad(np.asarray(degrees, dtype=float))
    middle = [np.zeros_like(angles)] * (dimension - 2)
    return np.stack([np.sin(angles), *middle, np.cos(angles)], axis=-1)


def points(dimension, *coordinates):
    return np.array([(x, z) if dimension == 2 else (x, 0.3, z) for x, z in coordinates])


def both_lights(kind, dimension, bottom):
    tilts = directions([0, 25], dimension)
    if kind == "plane":
        return sg.PlaneWaves(directions=tilts), Far(tilts)
    if kind == "beam":
        return sg.CollimatedBeams(directions=tilts, width=2.5), Beams(tilts, 2.5, bottom)
    p = points(dimension, (0.5, -7.0) if kind == "outside" else (0.5, 0.7))
    return sg.PointSources(points=p), Near(p)


def both_sensors(kind, dimension):
    if kind == "far":
        v = directions([3, 140, 180], dimension)
        return sg.FarField(directions=v), Far(v)
    p = points(dimension, (1.0, 8.0), (-4.2, -3.0)) if kind == "outside" else points(dimension, (-1.0, 0.4))
    return sg.NearField(points=p), Near(p)


def both(dimension, g, light, sensor, slab=False):
    """A scene and the same for the oracle."""
    particle = henyey_greenstein(g, dimension)
    scatterer = sg.HenyeyGreenstein(g=g) if g else sg.Isotropic()
    if slab:
        bottom, region = (
            0.0, (np.array([-1.25] * (dimension - 1) + [0.0]), np.array([3.6, 1.25][: dimension - 1] + [5.0])),
        )  # fmt: skip
        medium = sg.Slab(thickness=5.0, mean_free_path=4.0, albedo=0.9, scatterer=scatterer)
        corners = [-np.inf] * (dimension - 1) + [0.0], [np.inf] * (dimension - 1) + [5.0]
    else:
        bottom, region = -2.5, None
        upper = np.array([3.0, 2.0, 2.5])[[0, 2] if dimension == 2 else [0, 1, 2]]
        medium = sg.Box(lower=-upper, upper=upper, mean_free_path=4.0, albedo=0.9, scatterer=scatterer)
        corners = -upper, upper
    (ours, theirs), (sees, watches) = both_lights(light, dimension, bottom), both_sensors(sensor, dimension)
    scene = sg.Scene(wavelength=WAVELENGTH, medium=medium, illumination=ours, sensor=sees)
    literal = box(*corners, extinction=0.25, albedo=0.9, particles=(particle,))
    return scene, Setup(literal, WAVELENGTH, theirs, watches, region=region)


# A literal sensor or source inside the medium has infinite variance in space: energy and reciprocity judge those.
FAST = [(2, 0.6, light, sensor) for light, sensor in product(LIGHTS, SENSORS)]
FAST += [(3, 0.6, light, sensor) for light, sensor in product(LIGHTS[:3], SENSORS[:2])]
ISOTROPIC = [(dimension, 0.0, light, sensor) for dimension, _, light, sensor in FAST]


def assert_agreement(case, paths, seed):
    scene, setup = both(*case)
    # One seed a case: cases that share random numbers would fail together.
    reverse = bool(seed % 2)
    ours = engine_batches(scene, paths, reverse=reverse, seed=seed)
    theirs = oracle_batches(setup, paths, reverse=reverse, seed=seed)
    assert_same(ours, theirs)
    return ours, theirs


@pytest.mark.parametrize("number", range(len(FAST)), ids=["-".join(map(str, case)) for case in FAST])
def test_boxes_against_the_literal_algorithms(number):
    """Lights and sensors near and far, inside and outside; cases take turns with and without reversed paths."""
    assert_agreement(FAST[number], 100, 100 + number)


@pytest.mark.slow
@pytest.mark.parametrize("case", [*FAST, *ISOTROPIC], ids=lambda case: "-".join(map(str, case)))
def test_boxes_against_the_literal_algorithms_both_ways(case):
    number = [*FAST, *ISOTROPIC].index(case)
    assert_agreement(case, 1000, 1000 + 2 * number)
    assert_agreement(case, 1000, 1001 + 2 * number)


def test_the_test_has_power():
    ours, theirs = assert_agreement((2, 0.6, "plane", "far"), 300, 7)
    with pytest.raises(AssertionError, match="z ="):
        assert_same(1.1 * ours, theirs)


@pytest.mark.parametrize("dimension", [2, 3])
@pytest.mark.parametrize("reverse", [False, True])
def test_beams_through_a_slab_against_the_literal_algorithms(dimension, reverse):
    """First vertices of the oracle in the box that holds both footprints: it is exact for reversed paths too."""
    scene, setup = both(dimension, 0.6, "beam", "far", slab=True)
    assert_same(engine_batches(scene, 200, reverse=reverse, seed=11),
                oracle_batches(setup, 300, reverse=reverse, seed=12))  # fmt: skip


@pytest.mark.parametrize("profile", ["square", "disc", "gaussian"])
@pytest.mark.parametrize("side", ["transmission", "reflection"])
def test_beams_through_a_slab_against_the_slab_engine(profile, side):
    """Oblique tilts too, reversed paths in reflection."""
    reverse = side == "reflection"
    scene = sg.Scene(
        wavelength=1.0,
        medium=sg.Slab(thickness=20.0, mean_free_path=10.0, albedo=0.9, scatterer=sg.HenyeyGreenstein(g=0.6)),
        illumination=sg.CollimatedBeams.tilts([0.0, 0.02, 0.5], width=30.0, profile=profile),
        sensor=sg.FarField(directions=directions([0, 30], 3) * ([1, 1, 1] if side == "transmission" else [1, 1, -1])),
    )
    stack = sg.render(scene, paths=60, realizations=BATCHES * 4, seed=3, sampler="paths", reverse=reverse, threads=1)
    fields = stack.field.reshape(BATCHES, 4, -1).astype(complex)
    theirs = np.einsum("brp,brq->bpq", fields, fields.conj()) / 4
    assert_same(engine_batches(scene, 150, reverse=reverse, seed=13), theirs)


def sphere(rng, n, dimension):
    v = rng.normal(size=(n, dimension))
    return v / np.linalg.norm(v, axis=1, keepdims=True)


@pytest.mark.parametrize("dimension", [2, 3])
@pytest.mark.parametrize("light", ["plane", "beam", "inside"])
def test_energy(dimension, light):
    """A02 at albedo 1: all that does not pass comes out, into views drawn anew for every batch. A source of unit
    strength inside sends 2 pi or 4 pi, less what leaves without a collision."""
    rng = np.random.default_rng(20 + dimension)
    upper = [3.0] * dimension
    medium = sg.Box(lower=[-3.0] * dimension, upper=upper, mean_free_path=4.0, scatterer=sg.HenyeyGreenstein(g=0.6))
    solid_angle = 2 * np.pi * (dimension - 1)
    if light == "inside":
        source = sg.PointSources(points=[[0.0] * dimension])
        rays = sphere(rng, 400_000, dimension)
        expected = solid_angle * -np.expm1(-0.25 * 3.0 / np.abs(rays).max(axis=1)).mean()
    else:
        width = 6.0 if light == "plane" else 2.0
        tilts = directions([0.0], dimension)
        source = (
            sg.PlaneWaves(directions=tilts) if light == "plane" else sg.CollimatedBeams(directions=tilts, width=width)
        )
        expected = -np.expm1(-1.5) * width ** (dimension - 1)
    views = sphere(rng, 48 * BATCHES, dimension)
    scene = sg.Scene(wavelength=1.0, medium=medium, illumination=source, sensor=sg.FarField(directions=views))
    tracer = volume_tracer(scene, False)
    flux = np.empty(BATCHES)
    for b in range(BATCHES):
        bank = tracer.trace(41, 300, first=300 * b, threads=1)
        few = tracer.layout.of_ends(slice(None), slice(48 * b, 48 * b + 48))
        power = [np.square(np.abs(a)).sum() for a in (
            single_amplitudes(few, bank.single),
            multiple_amplitudes(few, bank.multiple, bidirectional=tracer.bidirectional, reverse=False),
        )]  # fmt: skip
        flux[b] = sum(power) / 300 / 48 * solid_angle
    assert_mean(flux, expected, slack=2e-3 * expected if light == "inside" else 0.0)
    refute_mean(1.3 * flux, expected)


def test_backscattering():
    """S + 2M of a plane wave at v = -i, S + M + M_in of a beam narrower than l*; nowhere is B = 1 doubled."""
    for light in ("plane", "beam"):
        scene, setup = both(2, 0.0, light, "far")
        ours = engine_batches(scene, 400, reverse=True, seed=32)
        parts = engine_batches(scene, 400, reverse=False, seed=33, parts=True)
        single, multiple = (np.diagonal(parts[:, n], axis1=1, axis2=2).real[:, 2] for n in (0, 1))  # light 0, view 180
        peak = intensities(ours)[:, 2]
        if light == "plane":
            assert_z(z_scores(peak, single + 2 * multiple), 0, 1, degrees=BATCHES - 1)
            refute_z(z_scores(peak, 2 * (single + multiple)), 0, 1, degrees=BATCHES - 1)
        else:
            # M_in: forward paths that end under the beam, straight from the oracle's definition.
            theirs = intensities(oracle_batches(setup, 400, reverse=True, seed=34))[:, 2]
            assert_z(z_scores(peak, theirs), 0, 1, degrees=BATCHES - 1)
            assert (single + multiple).mean() < 0.97 * peak.mean() < (single + 1.9 * multiple).mean()
