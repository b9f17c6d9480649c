"""The camera of batches: its torch form against the engine's, and no field of a camera that it leaves out."""

import numpy as np
import pytest
import torch
from refusals import assert_refused

from specklegen.core.random_streams import Stream, stream_key
from specklegen.datasets import SpeckleStream, load_recipe
from specklegen.datasets.recipes.generator import SpeckleGenerator
from specklegen.datasets.recipes.parts import exposure
from specklegen.datasets.store.generate import generate
from specklegen.instrument.camera import Camera, NoiseStreams
from specklegen.instrument.camera import expose as expose_one
from specklegen.synthesis.fused import FORMS

CAMERAS = {
    "all": Camera(photons=300.0, background=5.0, dark_current=3.0, exposure=0.5, read_noise=2.0, gain=1.7,
                  full_well=1500.0, offset=50.0, bit_depth=12),
    "shot": Camera(photons=20.0, bit_depth=None),
    "bright": Camera(photons=1e5, background=800.0, read_noise=1.0),
    "map": Camera(photons=20.0, read_noise=np.arange(33 * 35.0).reshape(33, 35) / 100, offset=50.0),
}  # fmt: skip
SEEN = {"exposure": {"photons": 200.0, "read_noise": 1.0}, "camera": {"shape": [16, 16]}}


@pytest.mark.parametrize("name", CAMERAS)
def test_counts(name):
    """The same uniform numbers: equal counts but where an expansion is off by its 1e-6, of 7000 pixels none or one."""
    images = torch.from_numpy(np.random.default_rng(0).exponential(size=(2, 3, 33, 35)).astype(np.float32))
    camera, streams = CAMERAS[name], [NoiseStreams.of(seed) for seed in (3, 4)]
    keys = torch.tensor([[stream_key(words, Stream.CAMERA) for words in each] for each in streams])
    given = camera.photons * images.double(), keys, camera.electronics
    noise_map = camera.noise_map((33, 35))
    given += () if noise_map is None else (torch.tensor(noise_map),)
    found, expected = FORMS["exposed"](*given), exposure.exposed(*given)
    assert ((found - expected).abs() > 1e-3).sum() <= 1
    counts = exposure.expose(camera, images, keys)
    assert counts.dtype == (torch.float32 if camera.bit_depth is None else torch.uint16)
    for n, own in enumerate(streams):
        np.testing.assert_array_equal(counts[n], expose_one(camera, images[n], own))


def test_every_field_of_a_camera_is_obeyed():
    """In the form of either: another number, other counts."""
    images, keys = torch.full((1, 1, 16, 16), 1.5), torch.arange(8).reshape(1, 4, 2)
    other = {"photons": 400.0, "background": 9.0, "dark_current": 9.0, "exposure": 2.0, "read_noise": 9.0,
             "gain": 3.0, "full_well": 300.0, "bit_depth": 8, "offset": 90.0}  # fmt: skip
    assert {*other, "oversampling"} == {*Camera.model_fields} == {*exposure.FIELDS}
    base = CAMERAS["all"]
    light = base.photons * images.double()
    for field, value in other.items():
        camera = base.replace(**{field: value})
        assert not torch.equal(exposure.expose(camera, images, keys), exposure.expose(base, images, keys)), field
        if field != "photons":
            one, two = (FORMS["exposed"](light, keys, each.electronics) for each in (camera, base))
            assert not torch.equal(one, two), field


def test_a_field_that_batches_do_not_know_is_refused_at_every_door(monkeypatch, tmp_path):
    recipe = load_recipe("tilt-stack", SEEN)
    monkeypatch.setattr(exposure, "FIELDS", tuple(name for name in exposure.FIELDS if name != "read_noise"))
    doors = (lambda: recipe.sample(0, "train", 0), lambda: next(iter(SpeckleStream(recipe, batch_size=2))),
             lambda: SpeckleGenerator(recipe, 0, device="meta")(range(2)),
             lambda: generate(recipe, samples=2, folder=tmp_path / "s.zarr", processes=1))  # fmt: skip
    for door in doors:
        assert_refused(door, r"Recipe\.exposure must be .*read_noise")
