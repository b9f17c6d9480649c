"""The momentum transfer that walks collect, against the vertices themselves."""

from dataclasses import replace

import numpy as np
import pytest

import specklegen as sg
from specklegen.paths import momentum
from specklegen.paths.endpoints import AXIS
from specklegen.paths.layout import plane_layout
from specklegen.paths.momentum import momentum_transfer
from specklegen.paths.tracer import plane_tracer, scene_tracer
from specklegen.paths.volumes import mobility_at, volume_of

FLUID = sg.Brownian(diffusion=1.0)
LOBE = sg.HenyeyGreenstein(0.6)
SLAB = sg.Slab(thickness=40.0, mean_free_path=10.0, scatterer=LOBE, motion=FLUID)
MIXTURE = sg.Mixture(types=[LOBE, sg.VonMisesFisher(20.0)], fractions=[0.5, 0.5])
LAYERS = sg.Layers(layers=[
    sg.Layer(thickness=20.0, mean_free_path=10.0, scatterer=LOBE, motion=sg.Brownian(diffusion=0.25)),
    sg.Layer(thickness=20.0, mean_free_path=5.0, scatterer=sg.Isotropic(), motion=FLUID),
])  # fmt: skip
GRID = sg.VoxelGrid(lower=[-30, -30, 0], upper=[30, 30, 40], extinction=np.full((2, 2, 2), 0.1), albedo=0.9,
                    material=[[[0, 1], [2, 0]], [[1, 1], [0, 2]]], scatterers=[LOBE, sg.Isotropic(), LOBE],
                    motion=(None, FLUID, sg.Brownian(diffusion=0.5)))  # fmt: skip
MEDIA = {"henyey": SLAB, "table": SLAB.replace(scatterer=sg.VonMisesFisher(8.0)),
         "types": SLAB.replace(scatterer=MIXTURE), "stretched": SLAB.replace(thickness=120.0, albedo=0.8),
         "layers": LAYERS, "voxels": GRID}  # fmt: skip


def bank_of(medium, transfer, paths=4000):
    if not medium.has_sides:
        return plane_tracer(medium, 1.0, AXIS[None], AXIS[None], False, transfer=transfer).trace(3, paths, threads=1)
    beams = sg.CollimatedBeams.tilts([0.0, 0.0], width=20.0, times=[0.0, 1.0])
    scene = sg.Scene(wavelength=1.0, medium=medium, illumination=beams, sensor=sg.FarField.grid((2, 2), 0.01))
    tracer = scene_tracer(scene, False)
    return replace(tracer, transfer=transfer).trace(3, paths, threads=1)


@pytest.mark.parametrize("name", MEDIA)
def test_collecting_it_changes_nothing_else(name):
    without, collected = bank_of(MEDIA[name], False), bank_of(MEDIA[name], True)
    assert without.records.shape[1] == 14
    np.testing.assert_array_equal(collected.records[:, :14], without.records)
    np.testing.assert_array_equal(collected.orders, without.orders)
    np.testing.assert_array_equal(collected.paths, without.paths)
    np.testing.assert_array_equal(collected.reversed().transfer, collected.multiple.transfer)


@pytest.mark.parametrize("name", MEDIA)
def test_of_three_vertices_it_is_the_angle_in_the_middle(name):
    """x2 follows from both directions and x3 - x1, and tells which particles were there."""
    medium = MEDIA[name]
    bank = bank_of(medium, True)
    assert not bank.transfer[bank.orders < 3].any()
    three = bank.select(bank.orders == 3)
    assert len(three) > 20
    first, last, way = three.entry_direction, three.exit_direction, three.exit - three.entry
    cos = (first * last).sum(1)
    length = ((way * first).sum(1) - cos * (way * last).sum(1)) / (1 - cos**2)
    middle = three.entry + length[:, None] * first
    sure = 1 - np.abs(cos) > 1e-4  # else x2 is anywhere on the way
    if name == "voxels":
        material = np.array([[[0, 1], [2, 0]], [[1, 1], [0, 2]]])
        x, y, z = (middle > [0, 0, 20]).astype(int).T
        speed = np.array([0.0, 1.0, 0.5])[material[z, y, x]]
    else:
        speed = np.where(middle[:, 2] < 20, 0.25, 1.0) if name == "layers" else np.ones(len(three))
    np.testing.assert_allclose(three.transfer[sure], (speed * (1 - cos))[sure], atol=1e-12)
    np.testing.assert_allclose(mobility_at(volume_of(medium, 3), middle[sure]), speed[sure])


def test_both_ends_follow_for_any_light_and_view():
    bank = bank_of(LAYERS, True)
    light, view = np.array([0.1, 0.0, np.sqrt(0.99)]), np.array([0.0, -0.6, 0.8])
    layout = plane_layout(LAYERS, 1.0, light[None], view[None])
    found = momentum_transfer(layout, bank)
    first, last = (np.where(z[:, 2] < 20, 0.25, 1.0) for z in (bank.entry, bank.exit))
    once = first * (1 - light @ view)
    more = bank.transfer + first * (1 - bank.entry_direction @ light) + last * (1 - bank.exit_direction @ view)
    np.testing.assert_allclose(found, np.where(bank.orders == 1, once, more), atol=1e-12)
    ahead = momentum_transfer(plane_layout(LAYERS, 1.0, light[None], light[None]), bank.single)
    np.testing.assert_array_equal(ahead, 0.0)


def test_the_way_back_gives_the_same_at_the_light_and_view_exchanged():
    bank = bank_of(SLAB, True).multiple
    light, view = np.array([0.1, 0.0, np.sqrt(0.99)]), np.array([0.0, -0.6, -0.8])
    there = momentum_transfer(plane_layout(SLAB, 1.0, light[None], view[None]), bank)
    back = momentum_transfer(plane_layout(SLAB, 1.0, -view[None], -light[None]), bank.reversed())
    np.testing.assert_allclose(there, back, atol=1e-12)


def test_a_medium_at_rest_collects_nothing():
    still = GRID.replace(motion=(None, None, sg.Brownian(diffusion=0.0)))
    bank = plane_tracer(LAYERS.replace(layers=[layer.replace(motion=None) for layer in LAYERS.layers]), 1.0,
                        AXIS[None], AXIS[None], False, transfer=True).trace(3, 500, threads=1)  # fmt: skip
    assert not bank.transfer.any()
    assert not still.moves


def test_classes_are_so_narrow_that_nobody_sees_them(monkeypatch):
    """E[w e^(-2xY)] with the mean Y of classes: (2xY)^2 e^(-2xY) / 2 of the variance of Y in a class; at rest exact."""
    rng = np.random.default_rng(1)
    transfer, weights = rng.lognormal(0, 2, 50_000) * (rng.random(50_000) < 0.9), rng.random(50_000)
    x = np.append(np.geomspace(1e-4, 1e3, 40), 1e30)
    right = np.exp(-2 * x[:, None] * transfer) @ weights / weights.sum()

    def by_classes():
        bins = momentum.momentum_classes(transfer)
        share = np.bincount(bins, weights, momentum.CLASSES)
        mean = np.bincount(bins, weights * transfer, momentum.CLASSES) / np.maximum(share, 1e-300)
        return np.exp(-2 * x[:, None] * mean) @ share / weights.sum()

    assert momentum.momentum_classes(np.zeros(3)).max() == 0
    assert np.abs(by_classes() - right).max() < 2e-6
    assert by_classes()[-1] == pytest.approx(weights[transfer == 0].sum() / weights.sum(), rel=1e-12)
    monkeypatch.setattr(momentum, "CLASSES", 512)
    assert np.abs(by_classes() - right).max() > 2e-6
