"""Walks through boxes and voxels in lock step: the same light however drawn, and the same bits in any company."""

from dataclasses import replace

import numpy as np
import pytest
from zscore import assert_z, refute_z

import specklegen as sg
from specklegen.core.random_streams import Stream
from specklegen.paths.endpoint_factors import contributions_of_pairs
from specklegen.paths.pilot import mean_intensity
from specklegen.paths.tracer import volume_tracer

CORNERS = {"lower": np.array([-5.0, -5.0, 0.0]), "upper": np.array([5.0, 5.0, 10.0])}
FOG = sg.VonMisesFisher(concentration=4.0)
MIXED = sg.Mixture(types=(sg.HenyeyGreenstein(g=0.8), sg.Isotropic()), fractions=(0.7, 0.3))
VIEWS = np.arange(5)


def box(scatterer, mean_free_path=3.0):
    return sg.Box(**CORNERS, mean_free_path=mean_free_path, scatterer=scatterer, albedo=0.95)


def voxels(scatterer):
    density = np.random.default_rng(2).uniform(0.1, 0.6, (4, 5, 6))
    return sg.VoxelGrid(**CORNERS, extinction=density, scatterers=(scatterer,))


def tracer_of(medium, reverse=False):
    angles = np.array([0.0, 0.3, 0.9, 1.8, 2.6])
    directions = np.stack([np.sin(angles), np.zeros(5), np.cos(angles)], axis=-1)
    scene = sg.Scene(wavelength=0.5, medium=medium, illumination=sg.CollimatedBeams.tilts([0.0, 0.1], width=6.0),
                     sensor=sg.FarField(directions=directions))  # fmt: skip
    return volume_tracer(scene, reverse)


def intensity(tracer, seed, paths=6000):
    return np.array(mean_intensity(tracer, False, VIEWS, seed, paths))  # noqa: FBT003


def assert_same_light(one, other):
    (value, error), (second, second_error) = intensity(one, 1), intensity(other, 2)
    assert_z(value, second, np.hypot(error, second_error))


def test_the_mean_intensity_is_that_of_its_paths():
    tracer, count = tracer_of(box(FOG)), 500
    bank = tracer.trace(7, count, stream=Stream.PILOT, threads=1)
    lit = np.bincount(bank.paths, contributions_of_pairs(tracer.layout, bank).mean(axis=(0, 1)), count)
    np.testing.assert_allclose(intensity(tracer, 7, count), [lit.mean(), lit.std() / np.sqrt(count)], rtol=1e-9)


@pytest.mark.parametrize("reverse", [False, True])
@pytest.mark.parametrize("medium", [box(FOG), box(MIXED), voxels(FOG)])
def test_lobes_and_particle_types_give_the_same_light(medium, reverse):
    """The table of the lobe in lock step, and every particle drawn by its type; a lobe of another g is caught."""
    tracer = tracer_of(medium, reverse)
    assert tracer.lobe is not None
    assert_same_light(tracer, replace(tracer, lobe=None))


@pytest.mark.parametrize("reverse", [False, True])
@pytest.mark.parametrize("medium", [box(sg.HenyeyGreenstein(g=0.8)), box(FOG, 1.5), voxels(FOG)])
def test_roulette_leaves_the_light_as_it_is(medium, reverse):
    """A threshold at which nine of ten connections are dropped, against all of them kept."""
    tracer = replace(tracer_of(medium, reverse), threshold=0.0)
    everything = tracer.trace(3, 2000, threads=1)
    for threshold in np.geomspace(1e-2, 1e6, 30):
        thinned = replace(tracer, threshold=float(threshold))
        if len(thinned.trace(3, 2000, threads=1)) < 0.1 * len(everything):
            break
    assert_same_light(thinned, tracer)


def test_the_comparisons_have_power():
    """A mean free path, or a lobe, 10 % off is caught."""
    right = tracer_of(box(FOG))
    for wrong in (box(FOG, 3.3), box(sg.VonMisesFisher(concentration=6.0))):
        refute_z(*intensity(tracer_of(wrong), 1, 60_000)[:1], *intensity(right, 2, 60_000))


@pytest.mark.parametrize("medium", [box(FOG), voxels(MIXED)])
@pytest.mark.parametrize("reverse", [False, True])
def test_a_path_has_its_bits_in_any_company(medium, reverse):
    tracer = tracer_of(medium, reverse)
    whole = tracer.trace(5, 500, threads=1)
    parts = [tracer.trace(5, count, first=first, threads=1) for first, count in ((0, 1), (1, 130), (131, 369))]
    for name in ("records", "orders", "paths", "types"):
        assert getattr(whole, name).tobytes() == np.concatenate([getattr(part, name) for part in parts]).tobytes()
    assert whole.events == sum(part.events for part in parts)
    assert (np.diff(whole.paths) >= 0).all()
