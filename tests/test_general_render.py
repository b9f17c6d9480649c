"""Rendering and planning any geometry: the same bits on any threads, realizations of their own, plans that tell."""

import numpy as np
import pytest
from scenes import flat_box, views
from volume_batches import BATCHES, assert_same, engine_batches

import specklegen as sg

SCENE = flat_box([0.0, 4.0], views([0, 4, 180]), half=5.0, mean_free_path=5.0)
BEAMS = sg.CollimatedBeams.tilts([0.0, 0.05], width=4.0, dimensions=2)
POINTS = sg.PointSources(points=[[0.0, -9.0], [1.0, 1.0]])
NEAR = sg.NearField(points=[[[0.0, 2.0], [8.0, 8.0]]])
SCENES = {
    "box": SCENE, "beams": SCENE.replace(illumination=BEAMS), "points": SCENE.replace(illumination=POINTS),
    "near": SCENE.replace(sensor=NEAR),
    "voxels": SCENE.replace(
        medium=sg.VoxelGrid(lower=[-5, -5], upper=[5, 5], extinction=[[0.1, 0.2]], scatterers=(sg.Isotropic(),))
    ),
    "slab": SCENE.replace(medium=sg.Slab(thickness=9.0, mean_free_path=5.0, scatterer=sg.Isotropic()),
                          illumination=BEAMS),
}  # fmt: skip


@pytest.mark.parametrize("name", SCENES)
def test_plans_tell_what_is_done(name):
    text = sg.plan(SCENES[name], paths=1000).explain()
    kinds = {"voxels": "Grid of 1x2 voxels", "slab": "Slab 9 thick, optical depth 1.8"}
    assert text.startswith(f"Scene:       {kinds.get(name, 'Box optical depth 2')}")
    assert "1000 paths" in text
    assert "paths in lock step and NUFFT: left out" in text
    assert "nan" not in text


@pytest.mark.slow
@pytest.mark.parametrize("sampler", ["paths", "covariance"])
def test_images_have_the_covariance(sampler):
    stack = sg.render(SCENE, paths=30 if sampler == "paths" else 3_000, realizations=BATCHES * 2, seed=6,
                      sampler=sampler, reverse=True)  # fmt: skip
    fields = stack.field.reshape(BATCHES, 2, -1).astype(complex)
    drawn = np.einsum("brp,brq->bpq", fields, fields.conj()) / 2
    assert_same(drawn, engine_batches(SCENE, 300, reverse=True, seed=7))
    with pytest.raises(AssertionError, match="z ="):
        assert_same(1.5 * drawn, engine_batches(SCENE, 300, reverse=True, seed=7))


def test_an_incoherent_object_is_drawn_from_the_covariance_of_its_beams():
    """Two bright pixels of three: an image without a field, never negative."""
    scene = sg.Scene(wavelength=1.0, medium=sg.Slab(thickness=20.0, mean_free_path=10.0, scatterer=sg.Isotropic()),
                     illumination=sg.IncoherentObject(brightness=[[1.0, 0.0, 2.0]], pitch=0.01, width=20.0),
                     sensor=sg.FarField(directions=[[0.0, 0.0, 1.0], [0.6, 0.0, 0.8]]))  # fmt: skip
    stack = sg.render(scene, sampler="covariance", paths=64, seed=1)
    assert stack.intensity.shape == (2,)
    assert stack.intensity.min() > 0
