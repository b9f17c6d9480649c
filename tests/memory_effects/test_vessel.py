"""Light above a vessel, place by place: against the engine's layers and voxels, single scattering, and rest."""

from dataclasses import replace

import numpy as np
import pytest
from zscore import assert_z, refute_z

import specklegen as sg
from specklegen.core.errors import RuleError
from specklegen.core.statistics import jackknife
from specklegen.memory_effects.vessel import Vessel, local_light
from specklegen.paths.endpoint_factors import contributions
from specklegen.paths.momentum import doppler_shift, momentum_transfer
from specklegen.paths.roulette import with_capacity
from specklegen.paths.tracer import scene_tracer
from specklegen.paths.vertices import VertexPaths, vertex_paths

WAVELENGTH = 2 * np.pi / 1e3  # k = 1000: particles move little while a phase turns
TISSUE = sg.Slab(thickness=40.0, mean_free_path=10.0, albedo=0.95, scatterer=sg.HenyeyGreenstein(0.6))
WIDE = 1e7  # radius of a vessel that is a layer
BATCHES = 32


@pytest.fixture(scope="module")
def paths():
    return vertex_paths(TISSUE, 131_072, 12_000, 5)


def local(paths, vessel, distances, lags):
    """g1 float64[n] at places that count alike, and its standard error, by the parts of the photons."""
    parts = []
    for part in range(BATCHES):
        mine = paths.part == part
        number = np.cumsum(mine) - 1
        at = mine[paths.path]
        own = VertexPaths(paths.weight[mine], number[paths.path[at]], paths.place[at], paths.depth[at], paths.turn[at],
                          paths.part[mine])  # fmt: skip
        found = np.mean([each.field(lags) for each in local_light(own, vessel, distances, WAVELENGTH)], axis=0)
        parts.append(own.weight.sum() * np.concatenate([[1.0], found]))
    return jackknife(np.array(parts), lambda total: total[1:] / total[0])


LAGS = np.array([0.2, 0.6, 1.5, np.inf])
LAYERED = {
    "a shear": (Vessel(WIDE, WIDE, WIDE / 2), TISSUE.replace(motion=sg.Shear(rate=1.0)), 1e-4),
    "a drifting layer": (
        Vessel(WIDE + 8.0, WIDE, 4.0, "plug"), sg.Layers(layers=[
            sg.Layer(thickness=8.0, mean_free_path=10.0, albedo=0.95, scatterer=TISSUE.scatterer),
            sg.Layer(thickness=32.0, mean_free_path=10.0, albedo=0.95, scatterer=TISSUE.scatterer,
                     motion=sg.Drift(velocity=[0.0, 4.0, 0.0])),
        ]), 1e-3,
    ),
    "Brownian layers": (
        Vessel(WIDE + 8.0, WIDE, 0.0, "plug", 2.0, 0.5), sg.Layers(layers=[
            sg.Layer(thickness=8.0, mean_free_path=10.0, albedo=0.95, scatterer=TISSUE.scatterer,
                     motion=sg.Brownian(diffusion=0.5)),
            sg.Layer(thickness=32.0, mean_free_path=10.0, albedo=0.95, scatterer=TISSUE.scatterer,
                     motion=sg.Brownian(diffusion=2.0)),
        ]), 1e-7,
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", LAYERED)
def test_a_vessel_as_wide_as_a_layer_is_the_engines_layer(paths, name):
    """g1 straight back, one way of each path; a vessel whose Poiseuille flow is a shear near its wall."""
    vessel, medium, unit = LAYERED[name]
    lags = LAGS[:-1] * unit
    curve = sg.temporal_correlation(medium, wavelength=WAVELENGTH, lags=lags, mode="reflection", view=[0.0, 0.0, -1.0],
                                    reverse=False, paths=60_000, seed=2)  # fmt: skip
    expected = curve.field.real
    assert expected[-1] < 0.8
    found, error = local(paths, vessel, [0.0], lags)
    error = np.hypot(error, curve.standard_error / 2 / expected)
    assert_z(found, expected, error, degrees=BATCHES - 1)
    wrong, _ = local(paths, vessel._replace(speed=1.2 * vessel.speed, diffusion=1.2 * vessel.diffusion), [0.0], lags)
    refute_z(wrong, expected, error, degrees=BATCHES - 1)


CHANNEL, FINE = Vessel(12.0, 6.0, 3.0, "plug"), 1.0
EDGES = np.array([0.0, 4.0, 8.0, 16.0, 30.0])


def by_voxels(lags):
    """g1 in bins of the distance by the engine's paths through voxels, and its error, float64[bins, lags]. What enters
    at a place is, by reciprocity, what leaves there of a beam that is wide."""
    x = (np.arange(-200, 200) + 0.5) * FINE
    z = (np.arange(40) + 0.5) * FINE
    inside = x**2 + (z[:, None] - CHANNEL.depth) ** 2 < CHANNEL.radius**2
    medium = sg.VoxelGrid(lower=[-200, -400, 0], upper=[200, 400, 40], extinction=np.full((40, 1, 400), 0.1),
                          albedo=0.95, material=inside[:, None].astype(float), scatterers=[TISSUE.scatterer] * 2,
                          motion=(None, sg.Drift(velocity=[0.0, CHANNEL.speed, 0.0])))  # fmt: skip
    beams = sg.CollimatedBeams.tilts([0.0, 0.0], width=2 * EDGES[-1], times=[0.0, 1.0])
    sensor = sg.FarField.grid((1, 1), 1e-6, side="reflection")
    scene = sg.Scene(wavelength=WAVELENGTH, medium=medium, illumination=beams, sensor=sensor)
    tracer = with_capacity(replace(scene_tracer(scene, False), threshold=0.0))  # which would thin what is faint
    bank = tracer.trace(4, 80_000, threads=1)
    layout = tracer.layout.of_ends(slice(0, 1), slice(0, 1))
    weight, turned = contributions(layout, bank), doppler_shift(layout, bank)
    assert not momentum_transfer(layout, bank).any()
    waves = weight[:, None] * np.cos(1e3 * np.concatenate([[0.0], lags]) * turned[:, None])
    place, batch = np.digitize(np.abs(bank.entry[:, 0]), EDGES[1:]), bank.paths % BATCHES
    found = []
    for n in range(len(EDGES) - 1):
        own = place == n
        sums = np.stack([np.bincount(batch[own], wave[own], BATCHES) for wave in waves.T], axis=1)
        found.append(jackknife(sums, lambda total: total[1:] / total[0]))
    return (np.array(rows) for rows in zip(*found, strict=True))


def test_places_beside_a_vessel_are_those_of_paths_through_voxels(paths):
    """In four bins of the distance; a wider vessel, a deeper one and another flow are told."""
    lags = np.array([3e-4, 1e-3, 4e-3])
    expected, error = by_voxels(lags)
    assert np.ptp(expected[:, 1]) > 0.3, "places differ"

    def compare(vessel):
        for n, (low, high) in enumerate(zip(EDGES[:-1], EDGES[1:], strict=True)):
            places = low + (np.arange(4) + 0.5) / 4 * (high - low)
            found, own = local(paths, vessel, places.tolist(), lags)
            # Voxels a sixth of the radius wide have a channel whose wall is rough.
            assert_z(found, expected[n], np.hypot(own, error[n]), degrees=BATCHES - 1, slack=0.01)

    compare(CHANNEL)
    for wrong in (CHANNEL._replace(radius=7.5), CHANNEL._replace(depth=18.0), CHANNEL._replace(profile="parabolic")):
        with pytest.raises(AssertionError, match="z ="):
            compare(wrong)


def test_light_scattered_once_is_the_attenuation_of_its_depth(paths):
    """Of such paths e^(-2 z) lies in the vessel, and Y = 2."""
    once = np.bincount(paths.path) == 1
    single = replace(paths, weight=np.where(once, paths.weight, 0.0))
    vessel = Vessel(12.0, 6.0, 0.0, diffusion=1.0)
    for distance in (0.0, 4.0, 9.0):
        half = np.sqrt(max(36.0 - distance**2, 0.0))
        inside = (np.exp(-0.2 * (12 - half)) - np.exp(-0.2 * (12 + half))) / (1 - np.exp(-8.0))
        lag = np.array([2e-7])
        expected = 1 - inside * (1 - np.exp(-4 * 1e6 * lag))
        found, error = local(single, vessel, [distance], lag)
        assert_z(found, expected, np.maximum(error, 1e-12), degrees=BATCHES - 1)


def test_at_rest_and_far_away(paths):
    flow = Vessel(12.0, 6.0, 3.0)

    def at(vessel, *distances):
        return local_light(paths, vessel, distances, WAVELENGTH)

    assert at(flow._replace(speed=0.0), 0.0)[0].rest == pytest.approx(1.0)
    lights = at(flow, 0.0, 20.0, 1e4)
    rest = [light.rest for light in lights]
    assert rest[0] < rest[1] < rest[2]
    assert rest[2] == pytest.approx(1.0)
    np.testing.assert_allclose(lights[0].field(np.array([0.0, np.inf])), [1.0, rest[0]])
    moving = at(flow._replace(diffusion=0.5, tissue_diffusion=1.0), 0.0)[0]
    assert moving.rest == 0.0, "nothing rests where all boils"


def test_intensity_is_the_engines():
    """Radiance straight back per photon, one way of each path: the weights are no more than that. A mutation: photons
    that are absorbed before they are counted would have albedo too much."""
    found = vertex_paths(TISSUE, 65_536, 8000, 1)
    mean = np.bincount(found.part, found.weight, 16) / 4096
    memory = sg.memory_effect(TISSUE, wavelength=WAVELENGTH, tilts=[0.0], mode="reflection", view=[0.0, 0.0, -1.0],
                              reverse=False, paths=60_000)  # fmt: skip
    once = found.weight[np.bincount(found.path) == 1].sum() / 65_536
    p = np.square(np.abs(TISSUE.scatterer.amplitude(-1.0)))
    error = mean.std(ddof=1) / 4
    assert_z(once, 0.95 * p * (1 - np.exp(-8.0)) / 2, error, degrees=15)
    assert_z(mean.mean() * memory.single_share, once, np.hypot(error, 0.03 * once), degrees=15)


def test_what_is_refused():
    with pytest.raises(RuleError, match="vertex_paths slab must be of index-matched faces"):
        vertex_paths(TISSUE.replace(faces=sg.Faces(inside=1.33)), 100, 10, 0)
    again = vertex_paths(TISSUE, 5000, 100, 7)
    vertex_paths.__wrapped__  # noqa: B018 - remembered: its result is read-only
    with pytest.raises(ValueError, match="read-only"):
        again.weight[0] = 1.0
    np.testing.assert_array_equal(vertex_paths.__wrapped__(TISSUE, 5000, 100, 7).turn, again.turn)
