"""Costs: what is counted is what is done, and each count has its nanoseconds. No clock: scripts/plan_accuracy.py."""

import numpy as np
import pytest
from zscore import assert_z, refute_z

import specklegen as sg
from specklegen.core.nanoseconds import NANOSECONDS, SERIAL, seconds

SLAB = sg.Slab(thickness=1000.0, mean_free_path=200.0, scatterer=sg.HenyeyGreenstein(g=0.7))
BEAMS = sg.CollimatedBeams.tilts([0.0, 1e-4, 3e-4], width=3e4)
SCENE = sg.Scene(wavelength=1.0, medium=SLAB, illumination=BEAMS, sensor=sg.FarField.grid(shape=(20, 30), pitch=1e-5))
BOX = sg.Box(lower=[-5.0] * 3, upper=[5.0] * 3, mean_free_path=9.0, scatterer=sg.Isotropic())
DIRECTIONS = sg.FarField(directions=np.eye(3))
GRID = sg.VoxelGrid(lower=[-5.0] * 3, upper=[5.0] * 3, extinction=np.full((4, 3, 2), 0.1), scatterers=(sg.Isotropic(),))
HIDDEN = sg.IncoherentObject(brightness=np.ones((30, 30)), pitch=3e-5, width=3e4)
WAYS = {"stationary": (SCENE, {"sampler": "stationary"}), "nufft": (SCENE, {"sampler": "paths"}),
        "direct": (SCENE.replace(sensor=DIRECTIONS), {"reverse": False}),
        "reversed": (SCENE.replace(sensor=DIRECTIONS), {"reverse": True}),
        "box": (SCENE.replace(medium=BOX, sensor=DIRECTIONS), {}),
        "voxels": (SCENE.replace(medium=GRID, sensor=DIRECTIONS), {}),
        "near": (SCENE.replace(medium=BOX, sensor=sg.NearField(points=[[0.0, 0, 9.0]])), {}),
        "covariance": (SCENE.replace(medium=BOX, sensor=DIRECTIONS), {"sampler": "covariance"}),
        "hidden object": (SCENE.replace(illumination=HIDDEN), {"sampler": "stationary"})}  # fmt: skip


COUNTED = {
    "stationary": ("path", "event", "connection", "normal", "flop", "stack view"),
    "nufft": ("path", "event", "connection", "end", "spread", "FFT point", "pattern"),
    "direct": ("path", "event", "connection", "end", "direct view", "direct tilt"),
    "reversed": ("path", "event", "connection", "end", "direct view", "direct tilt"),
    "box": ("volume path", "volume event", "volume connection", "volume end", "product"),
    "voxels": ("volume path", "volume event", "volume connection", "volume end", "product", "voxel"),
    "near": ("volume path", "volume event", "volume connection", "near end", "product"),
    "hidden object": ("path", "event", "object pixel", "object difference", "normal", "image", "phasor", "product"),
    "covariance": ("volume path", "volume event", "volume connection", "volume end", "product", "amplitude", "batch"),
}


@pytest.mark.parametrize("way", WAYS)
def test_every_operation_has_its_nanoseconds(way):
    scene, options = WAYS[way]
    made = sg.plan(scene, paths=1000, threads=1, **options)
    assert set(made.operations) <= set(NANOSECONDS)
    assert made.seconds == pytest.approx(1e-9 * sum(n * NANOSECONDS[name] for name, n in made.operations.items()))
    for name in COUNTED[way]:
        assert made.operations[name] > 0, name
    event = "event" if "event" in made.operations else "volume event"
    assert made.operations[event] == pytest.approx(1000 * made.chosen.pilot.events_per_path)
    twice = sg.plan(scene, paths=2000, threads=1, **options)
    for name, count in made.operations.items():
        assert count >= 0
        assert count <= twice.operations[name] <= 2 * count
    # Threads share all but what is said to be left to one.
    serial = 1e-9 * sum(n * NANOSECONDS[name] for name, n in made.operations.items() if name in SERIAL)
    assert seconds(made.operations, 2) == pytest.approx(serial + (made.seconds - serial) / 2)


def test_events_and_connections_are_those_of_a_run():
    """Predicted from the pilot against 64 batches of another seed, both with their errors."""
    made = sg.plan(SCENE, paths=1000, sampler="paths")
    banks = [made.chosen.tracer.trace((7, n), 500) for n in range(64)]
    found = np.array([[bank.events, len(bank)] for bank in banks]) / 500
    error = found.std(axis=0, ddof=1) / 8
    pilot = error * np.sqrt(64 * 500 / 6000)
    said = np.array([made.chosen.pilot.events_per_path, made.chosen.pilot.connections_per_path])
    assert_z(said, found.mean(axis=0), np.hypot(error, pilot), degrees=63)
    refute_z(1.1 * said, found.mean(axis=0), np.hypot(error, pilot), degrees=63)


def test_what_the_nufft_does_is_counted():
    made = sg.plan(SCENE, paths=1000, sampler="paths")
    assert made.chosen.nufft is not None
    transforms = made.chosen.nufft.rank * len(BEAMS.directions)
    assert made.operations["FFT point"] == 4 * transforms * 600
    ends = 1000 * made.chosen.pilot.connections_per_path * (3 + made.chosen.nufft.spreads)
    assert made.operations["end"] == pytest.approx(ends)
    assert set(made.alternatives) == {"the direct sum", "adding reversed paths (reverse=True)"}
    assert made.alternatives["adding reversed paths (reverse=True)"] > made.alternatives["the direct sum"]


def test_views_behind_drawn_screens_are_counted():
    """A lens twice as open passes four times the waves, and an object's light is counted once for all media."""
    shown = sg.light.CoherentObject(np.ones((9, 9)), pitch=40.0, distance=1e4)
    cameras = [sg.sensors.Imaging(shape=(32, 32), pitch=2.5, aperture=sine, focus=-10.0) for sine in (0.05, 0.1)]
    glass = sg.GroundGlass(angle=0.05)
    plans = [sg.plan(sg.Scene(wavelength=1.0, medium=glass, illumination=shown, sensor=each)) for each in cameras]
    one, wide = (made.operations["flop"] for made in plans)
    assert one < wide < 4 * one
    light = plans[0].chosen.cost().once["flop"]
    assert 0 < light < one
    many = plans[0].chosen.cost().of(10)["flop"]
    assert many == pytest.approx(10 * one - 9 * light)


def test_frames_of_a_film_are_counted_one_by_one():
    """Each has its own points and view factors, and particles that have moved."""
    medium, times = SLAB.replace(motion=sg.media.Brownian(diffusion=1e-3)), np.arange(4.0)
    films = [SCENE.replace(medium=medium, illumination=sg.CollimatedBeams.tilts(0 * t, width=3e4, times=t))
             for t in (times[:2], times)]  # fmt: skip
    two, four = (sg.plan(film, paths=1000, sampler="paths").operations for film in films)
    for name in ("end", "spread", "phasor", "moved connection"):
        assert four[name] == pytest.approx(2 * two[name])
    assert four["event"] == two["event"]


def test_layers_are_walked_at_the_cost_of_any_volume():
    types = sg.HenyeyGreenstein(0.5), sg.HenyeyGreenstein(0.7)
    layers = [sg.media.Layer(thickness=500.0, mean_free_path=200.0, scatterer=each) for each in types]
    made = sg.plan(SCENE.replace(medium=sg.Layers(layers=layers)), paths=1000, sampler="paths")
    assert made.operations["volume event"] > 1000
    assert "event" not in made.operations


def test_envelopes_behind_screens_are_counted_once():
    glass = sg.GroundGlass(angle=0.05)
    stack = sg.media.ScreenStack(screens=(glass, glass), gaps=(1000.0,))
    cost = sg.plan(SCENE.replace(medium=stack)).chosen.cost()
    assert cost.first["envelope"] == cost.of(10)["envelope"] == 3 * 600
    assert cost.first["lobe"] == cost.of(10)["lobe"] > cost.first["envelope"]
