"""No unit of length matters: every kind of scene by every sampler, in micrometres and in nanometres."""

import warnings

import numpy as np
import pytest

import specklegen as sg

PATHS = 400
ANGLES = np.array([0.0, 0.2, 0.4])


def _slab(unit, **changes):
    fields = {"thickness": 40.0 * unit, "mean_free_path": 10.0 * unit, "scatterer": sg.HenyeyGreenstein(g=0.5)}
    return sg.Slab(**(fields | changes))


def _box(unit, dimension=3):
    corner = np.full(dimension, 5.0 * unit)
    return sg.Box(lower=-corner, upper=corner, mean_free_path=4.0 * unit, scatterer=sg.HenyeyGreenstein(g=0.5))


def _voxels(unit):
    density = np.random.default_rng(0).uniform(0, 0.5, (3, 4, 5)) / unit
    return sg.VoxelGrid(lower=[-5 * unit] * 3, upper=[5 * unit] * 3, extinction=density, scatterers=(sg.Isotropic(),))


def _beams(unit, profile="square"):
    return sg.CollimatedBeams.tilts([0.0, 1e-4], width=2000.0 * unit, profile=profile)


def _fan():
    return sg.FarField(directions=np.stack([np.sin(ANGLES), 0 * ANGLES, np.cos(ANGLES)], axis=-1))


def _near(unit):
    return sg.NearField(points=np.array([[0.0, 0.0, 8.0], [1.0, 0.0, 8.0]]) * unit)


def _object(unit):
    return sg.IncoherentObject(brightness=np.eye(2), pitch=1e-4, width=2000.0 * unit)


MIXED = sg.Mixture(types=(sg.Isotropic(), sg.HenyeyGreenstein(g=0.9)), fractions=(0.4, 0.6))
GRID = sg.FarField.grid(shape=(8, 8), pitch=1e-4)
BACK = sg.FarField.grid(shape=(8, 8), pitch=1e-4, side="reflection")
SLAB, ANY = ("paths", "stationary", "covariance"), ("paths", "covariance")
KINDS = {
    "beams through a slab": (SLAB, lambda u: (_slab(u), _beams(u), GRID)),
    "Gaussian beams, absorbing mixture": (
        SLAB, lambda u: (_slab(u, scatterer=MIXED, albedo=0.9), _beams(u, "gaussian"), GRID)
    ),
    "reflection": (ANY, lambda u: (_slab(u), _beams(u, "disc"), BACK)),
    "a hidden object": (("paths", "stationary"), lambda u: (_slab(u), _object(u), GRID)),
    "plane waves on a slab, seen near by": (ANY, lambda u: (_slab(u), sg.PlaneWaves.tilts([0.0, 0.1]), _near(6 * u))),
    "a box": (ANY, lambda u: (_box(u), sg.PlaneWaves.tilts([0.0, 0.1]), _fan())),
    "a point source and a near sensor": (
        ANY, lambda u: (_box(u), sg.PointSources(points=np.array([[0.0, 0.0, -9.0]]) * u), _near(u))
    ),
    "voxels": (ANY, lambda u: (_voxels(u), sg.CollimatedBeams.tilts([0.0, 0.1], width=6.0 * u), _fan())),
    "flatland": (
        ANY, lambda u: (_box(u, 2), sg.PlaneWaves.tilts([0.0, 0.1], dimensions=2), sg.FarField.angles(ANGLES))
    ),
}  # fmt: skip


def rendered(kind, sampler, unit):
    """What a plan says, and the image of a run over its root mean square."""
    medium, illumination, sensor = KINDS[kind][1](unit)
    scene = sg.Scene(wavelength=unit, medium=medium, illumination=illumination, sensor=sensor)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", sg.DoubtWarning)
        made = sg.plan(scene, paths=PATHS, sampler=sampler)
        stack = sg.render(scene, paths=PATHS, sampler=sampler, seed=3, threads=1)
    image = stack.intensity if isinstance(illumination, sg.IncoherentObject) else stack.field
    said = [(d.part, d.needed) for d in made.decisions], made.summation, made.expected_error
    return said, image / np.sqrt(np.square(np.abs(image)).mean())


@pytest.mark.parametrize(("kind", "sampler"), [(kind, each) for kind in KINDS for each in KINDS[kind][0]])
def test_lengths_in_another_unit(kind, sampler):
    """Numbers 1000 times as large: rounding alone differs, 1e-5 of a field in single precision."""
    (micro, image), (nano, other) = rendered(kind, sampler, 1.0), rendered(kind, sampler, 1000.0)
    assert micro[:2] == nano[:2]
    assert nano[2] == pytest.approx(micro[2], rel=1e-6)
    np.testing.assert_allclose(other, image, rtol=0, atol=1e-4)


def test_another_length_is_another_medium():
    """Power: a slab one in a thousand thicker, all else alike, is rendered by other paths."""
    scene = sg.Scene(wavelength=1.0, medium=_slab(1.0), illumination=_beams(1.0), sensor=GRID)
    thicker = scene.replace(medium=_slab(1.0, thickness=40.04))
    one, other = (sg.render(each, paths=PATHS, sampler="paths", seed=3, threads=1).field for each in (scene, thicker))
    assert np.abs(other - one).max() > 1e-3 * np.abs(one).max()


def test_the_memory_effect_in_another_unit():
    tilts = np.array([0.0, 0.002, 0.01])
    one, other = (
        sg.memory_effect(_slab(unit), wavelength=unit, tilts=tilts, paths=2000, seed=1) for unit in (1.0, 1000.0)
    )
    np.testing.assert_allclose(other.intensity, one.intensity, rtol=1e-9)
