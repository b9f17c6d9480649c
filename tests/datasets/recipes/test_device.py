"""Rendering on another device: the same samples up to rounding, told apart from the CPU's, without workers.

No CUDA device is needed: torch's "meta" device, which has shapes and no numbers, stands in for one; that the program of
other devices renders the samples of the CPU is in test_generator.py.
"""

import pickle
from dataclasses import dataclass, replace

import numpy as np
import pytest
import torch
from fake_recipe import FakeRecipe
from one_object import one_object
from refusals import assert_refused
from torch.utils._python_dispatch import TorchDispatchMode
from torch.utils._pytree import tree_flatten
from torch.utils.data import DataLoader

import specklegen as sg
from specklegen.core.errors import DoubtWarning
from specklegen.datasets import SpeckleStream, load_recipe
from specklegen.datasets.loading import stream as streams
from specklegen.datasets.recipes import specification
from specklegen.datasets.recipes.analysed_object import BehindMosaic
from specklegen.datasets.recipes.parts.material import known
from specklegen.datasets.store.generate import generate
from specklegen.datasets.store.identity import device_kind, fingerprint, identity
from specklegen.memory_effects.polarised_fields import estimate_polarised_correlation
from specklegen.synthesis.objects import object_imaging, object_media
from specklegen.synthesis.stacks import stack_sampler

SMALL = {"through-slab": {"material": {"kernel_paths": 2000}, "camera": {"shape": [32, 32]}, "media": 3},
         "tilt-stack": {"material": {"kernel_paths": 1000}, "camera": {"shape": [16, 16]}}}  # fmt: skip
TIMEOUT = 120


@dataclass(frozen=True)
class Movable(FakeRecipe):
    """Can be asked to render elsewhere."""

    device: str = "cpu"

    def on(self, device):
        return replace(self, device=device)


class OneDevice(TorchDispatchMode):
    """Refuses operations between devices, copies aside, as CUDA does and "meta" does not always."""

    def __torch_dispatch__(self, func, types, args=(), kwargs=None):
        found = tree_flatten((args, kwargs or {}))[0]
        devices = {value.device.type for value in found if isinstance(value, torch.Tensor) and value.ndim}
        if len(devices) > 1 and "copy" not in func.__name__:
            raise RuntimeError(f"{func} mixes devices {devices}")
        return func(*args, **(kwargs or {}))


@pytest.fixture
def meta_is_a_device(monkeypatch):
    """Let "meta", which holds no numbers and is refused, stand for a device."""
    for module in (streams, specification):
        monkeypatch.setattr(module, "checked_device", lambda field, device: torch.device(device))


@pytest.mark.usefixtures("meta_is_a_device")
def test_where_a_recipe_renders_is_no_part_of_what_it_says():
    recipe = load_recipe("through-slab", SMALL["through-slab"])
    moved = recipe.on("meta")
    assert (recipe.device, moved.device) == ("cpu", "meta")
    assert moved.fingerprint() == recipe.fingerprint()
    assert moved.to_toml() == recipe.to_toml()
    assert moved != recipe, "media that are kept for one are not handed to the other"
    assert moved == recipe.on("meta") == pickle.loads(pickle.dumps(moved))
    assert moved.on("cpu") == recipe
    assert hash(moved.on("cpu")) == hash(recipe)


def test_the_kind_of_device_is_part_of_the_identity_of_a_store(tmp_path):
    recipe = Movable()
    kinds = {device: device_kind(recipe.on(device)) for device in ("cpu", "cuda", "cuda:1")}
    assert kinds == {"cpu": "cpu", "cuda": "cuda", "cuda:1": "cuda"}
    prints = [fingerprint(identity(recipe.on(device), 0, "train")) for device in kinds]
    assert prints[0] != prints[1] == prints[2]
    assert fingerprint(identity(FakeRecipe(), 0, "train")) == prints[0]
    generate(recipe, samples=3, folder=tmp_path / "a.zarr", processes=1)
    with pytest.raises(ValueError, match=r"device \('cpu' there, 'cuda' here\)"):
        generate(recipe.on("cuda:0"), samples=3, folder=tmp_path / "a.zarr", processes=1)


@pytest.mark.usefixtures("meta_is_a_device")
def test_batches_lie_on_the_device():
    stream = SpeckleStream(Movable(samples=6), batch_size=4, device="meta")
    assert stream.recipe.device == "meta"
    batches = list(stream.loader())
    assert len(batches) == 2
    for batch in batches:
        arrays = [value for key, value in batch.items() if key != "parameters"] + list(batch["parameters"].values())
        assert {array.device.type for array in arrays} == {"meta"}
    assert batches[0]["image"].shape == (4, 8, 8)
    assert batches[0]["image"].dtype == torch.uint16


@pytest.mark.usefixtures("meta_is_a_device")
def test_resuming_on_another_kind_of_device_is_said_or_refused():
    here = SpeckleStream(Movable(samples=6), batch_size=2).loader()
    next(iter(here))
    state = here.state_dict()
    loader = SpeckleStream(Movable(samples=6), batch_size=2, device="meta").loader()
    assert_refused(lambda: loader.load_state_dict(state, strict_device=True), r"device \('cpu' there, 'meta' here\)")
    with pytest.warns(DoubtWarning, match="saved on 'cpu' and is resumed on 'meta'"):
        loader.load_state_dict(state)
    assert loader.state_dict() == state | {"device": "meta"}
    assert len(list(loader)) == 2
    with pytest.raises(ValueError, match="device"):  # no device at all is no position of a stream
        loader.load_state_dict({key: value for key, value in state.items() if key != "device"})


@pytest.mark.usefixtures("meta_is_a_device")
def test_workers_and_a_device_are_refused():
    stream = SpeckleStream(Movable(), device="meta")
    with pytest.raises(ValueError, match=r'loader.num_workers must be 0 for a stream with device="meta"; got 2.'):
        stream.loader(num_workers=2)
    with pytest.raises(ValueError, match=r"loader.num_workers must be 0"):
        next(iter(DataLoader(stream, batch_size=None, num_workers=1, timeout=TIMEOUT)))
    assert len(list(SpeckleStream(Movable(samples=4), device="cpu").loader(num_workers=1, timeout=TIMEOUT))) == 1


@pytest.mark.parametrize(("recipe", "device", "words"), [
    (Movable(), "meta", "SpeckleStream.device must be a device that torch has here; got 'meta'"),
    (Movable(), "abacus", "SpeckleStream.device must be a device that torch has here; got 'abacus'"),
    (FakeRecipe(), "meta", r"SpeckleStream.device must be \"cpu\" for FakeRecipe, which has no method `on`"),
    pytest.param(Movable(), "cuda", "SpeckleStream.device must be a device that torch has here; got 'cuda'",
                 marks=pytest.mark.skipif(torch.cuda.is_available(), reason="there is a CUDA device")),
])  # fmt: skip
def test_devices_that_are_not_there_are_refused(recipe, device, words):
    assert_refused(lambda: SpeckleStream(recipe, device=device), words)


def test_every_tensor_of_an_object_is_on_the_device():
    recipe = load_recipe("through-slab", SMALL["through-slab"])
    kernel = known(recipe.material_of(0, "train", 0).slab, 2000).correlation
    brightness = np.ones((10, 10), np.float32)
    with OneDevice():
        sampler = one_object(kernel, wavelength=0.5, object_shape=(10, 10), object_pitch=3e-6, width=5e4,
                             grid=recipe.geometry.grid, device="meta")  # fmt: skip
        medium = sampler.medium((1, 2, 3))
        for seen in (medium, sampler.spectra(medium)):
            image = sampler.image(seen, brightness, form="pairs")
            assert (image.device.type, image.shape, image.dtype) == ("meta", (32, 32), torch.float32)
        for name in ("modes", "object_rows", "object_columns", "camera_rows", "camera_columns"):  # power
            left_behind = torch.ones_like(getattr(sampler.imaging, name), device="cpu")
            moved = replace(sampler, imaging=replace(sampler.imaging, **{name: left_behind}))
            with pytest.raises(RuntimeError, match="mixes devices"):
                moved.image(medium, brightness, form="pairs")


def test_memory_effects_that_are_not_round_are_drawn_on_the_device():
    """Modes in two dimensions, of one analyser and of all four of a mosaic; numbers of K come from the host."""
    slab = sg.Slab(thickness=1000.0, mean_free_path=500.0, scatterer=sg.Rayleigh(), polarisation="projector")
    along, across, between = (
        estimate_polarised_correlation(slab, sg.Polarisers(light=[1, 0], analyser=seen), 300, 1)
        for seen in ([1, 0], [0, 1], [1, 1])
    )
    mosaic = BehindMosaic((along, across, between), (0.0, np.pi / 4, np.pi / 2, 3 * np.pi / 4))
    for seen, base in ((along, np.zeros((1, 2))), (mosaic, np.zeros((4, 2)))):
        with OneDevice():
            made = object_imaging(seen, wavelength=0.5, object_shape=(6, 6), object_pitch=1e-5, width=5e4, base=base,
                                  grid=load_recipe("through-slab", SMALL["through-slab"]).geometry.grid,
                                  device="meta")  # fmt: skip
            images = object_media(made, (1, 2, 3)).images(torch.ones((1, 6, 6), device="meta"))
        assert images.device.type == "meta"
        assert images.shape == (1, len(base), 32, 32)


@pytest.mark.parametrize("fft", [False, True])
def test_every_tensor_of_a_stack_is_on_the_device(fft):
    recipe = load_recipe("tilt-stack", SMALL["tilt-stack"])
    material = recipe.material_of(0, "train", 0)
    scene = recipe.view(material.slab, recipe.tilts.angles(4e-5, 0.0)).full
    with OneDevice():
        field = stack_sampler(scene, material.correlation, device="meta", fft=fft).sample((1, 2, 3))
    assert (field.device.type, field.shape, field.dtype) == ("meta", (5, 16, 16), torch.complex64)
