"""Nothing that is not finite is stored or handed out; infinity works where it means something; tilts stay below 90°."""

import numpy as np
import pytest
import torch
from fake_recipe import FakeRecipe
from refusals import assert_refused
from small_stores import make

from specklegen.core.errors import RuleError
from specklegen.datasets import SpeckleCache, SpeckleStream, load_recipe
from specklegen.datasets.addresses import Addresses
from specklegen.datasets.recipes.parts.tilts import Tilts
from specklegen.datasets.sample_schema import ArraySpec, require_finite
from specklegen.datasets.store.filling import GenerationError
from specklegen.datasets.store.generate import generate
from specklegen.datasets.store.info import info
from specklegen.scene.illumination import CollimatedBeams

SMALL = {"camera": {"shape": [32, 32]}, "material": {"kernel_paths": 2000}}
INF, NAN = float("inf"), float("nan")


class Broken(FakeRecipe):
    """Sample 7 holds a number that is not finite, in the place that ``name`` says."""

    def sample(self, seed, split, index):
        sample = super().sample(seed, split, index)
        if index == 7:
            match self.name:
                case "field":
                    sample["field"][1, 2, 3] = np.nan
                case "level":
                    sample["level"] = np.float64(np.inf)
                case "parameter":
                    sample["parameters"]["level"] = NAN
                case "infinite parameter":
                    sample["parameters"]["level"] = INF
        return sample


@pytest.mark.parametrize(("name", "words"), [
    ("field", r"field of sample \(.*index=7\) must be finite everywhere; got nan"), ("level", "level of .*got inf"),
    ("parameter", "level of .*got nan"), ("infinite parameter", "level of .*got inf"),
])  # fmt: skip
def test_no_such_number_is_stored_or_streamed(tmp_path, name, words):
    recipe = Broken(name=name)
    with pytest.raises(GenerationError, match=words):
        make(tmp_path / "a.zarr", recipe)
    assert info(tmp_path / "a.zarr")["done"] == 17, "all other shards are there"
    cache = SpeckleCache(tmp_path / "a.zarr", missing="render", recipe=recipe)
    assert_refused(lambda: cache.numpy(7), words)
    batches = iter(SpeckleStream(recipe, batch_size=5))
    next(batches)
    assert_refused(lambda: next(batches), words)


class OnDevice(torch.Tensor):
    """What PyTorch does on a device: numbers come to the host by ``cpu`` alone."""

    def __array__(self, *_):
        raise TypeError("cannot convert a tensor of a device to NumPy")

    numpy = __array__

    def cpu(self):
        return self.as_subclass(torch.Tensor)


@pytest.mark.parametrize("wrong", [None, "image", "level"])
def test_batches_on_a_device_are_looked_at_there(wrong):
    """Streams on a GPU raised at their first batch, and no machine of the checks has one."""
    batch = {"image": torch.ones(3, 4, 4), "index": torch.arange(5, 8), "parameters": {"level": torch.ones(3)}}
    if wrong is not None:
        (batch | batch["parameters"])[wrong][1] = NAN
    named = {key: value.as_subclass(OnDevice) for key, value in batch.items() if key != "parameters"}
    batch = named | {"parameters": {"level": batch["parameters"]["level"].as_subclass(OnDevice)}}
    with pytest.raises(TypeError):
        np.asarray(batch["image"])
    if wrong is None:
        require_finite(batch, FakeRecipe(name="a"), 0, "train")
    else:
        with pytest.raises(RuleError, match=rf"{wrong} of sample \(.*index=6\) must be finite everywhere; got nan"):
            require_finite(batch, FakeRecipe(name="a"), 0, "train")


def test_a_parameter_may_be_infinite_where_the_layout_says_so(tmp_path):
    class Unbounded(Broken):
        def layout(self):
            spec = ArraySpec(shape=(2,), dtype="float64", dims=("parameter",), unbounded=("level",))
            return dict(super().layout()) | {"parameters": spec}

    make(tmp_path / "a.zarr", Unbounded(name="infinite parameter"))
    assert SpeckleCache(tmp_path / "a.zarr").numpy(7)["parameters"]["level"] == INF
    with pytest.raises(GenerationError, match="level of .*got nan"):
        make(tmp_path / "b.zarr", Unbounded(name="parameter"))


def test_a_sample_of_a_recipe_is_finite_or_refused(monkeypatch):
    """Whatever goes wrong inside: here the camera hands back one dark pixel as NaN."""
    recipe = load_recipe("tilt-stack", SMALL)
    named = type(recipe).named

    def broken(self, images, *others):
        images[0, 0, 0, 0] = np.nan
        return named(self, images, *others)

    monkeypatch.setattr(type(recipe), "named", broken)
    with pytest.raises(RuleError, match=r"stack of sample \(seed=3, split='test', index=2\) must be finite"):
        recipe.sample(3, "test", 2)


def test_infinite_coherence_length_is_coherent_light(tmp_path):
    coherent = load_recipe("partially-coherent-slab", SMALL | {"coherence_length": INF})
    generate(coherent, samples=2, folder=tmp_path / "a.zarr", processes=1)
    stored = SpeckleCache(tmp_path / "a.zarr").numpy(1)
    assert stored["parameters"]["coherence_length"] == INF
    # 1 - |mu| <= 1e-4 across the window: one mode, and contrast 1, to that.
    assert stored["parameters"]["effective_modes"] == pytest.approx(1, abs=1e-4)
    assert stored["parameters"]["expected_contrast"] == pytest.approx(1, abs=1e-4)
    for length in (100 * coherent.window.width, 1e12, 1e300):
        other = load_recipe("partially-coherent-slab", SMALL | {"coherence_length": length})
        np.testing.assert_array_equal(other.sample(0, "train", 1)["image"], stored["image"])
    written = info(tmp_path / "a.zarr")["recipe"]["coherence_length"]
    again = load_recipe("partially-coherent-slab", SMALL | {"coherence_length": written})
    assert again == coherent, "what a store says of its recipe makes the recipe"
    nearly = load_recipe("partially-coherent-slab", SMALL | {"coherence_length": 30.0 * coherent.window.width})
    # Another lattice of beams is another draw of the medium: only what is expected can be compared.
    assert nearly.sample(0, "train", 1)["parameters"]["effective_modes"] == pytest.approx(1, abs=2e-3)


def test_infinite_correlation_time_is_a_medium_at_rest():
    recipe = load_recipe("dynamic-slab", SMALL | {"dynamics": {"frames": 3, "correlation_time": INF}})
    frames = recipe.sample(0, "train", 0)["frames"]
    np.testing.assert_array_equal(frames[1:], frames[:1].repeat(2, 0))


FIELDS = [("tilt-stack", "tilts.step", r"Tilts\.step"), ("tilt-stack", "tilts.azimuth", r"Tilts\.azimuth"),
          ("tilt-stack", "material.thickness", r"Material\.thickness"), ("tilt-stack", "material.g", r"Material\.g"),
          ("tilt-stack", "material.optical_depth", r"Material\.optical_depth"),
          ("tilt-stack", "material.albedo", r"Material\.albedo"),
          ("through-slab", "field.extent_over_range", "extent_over"),
          ("partially-coherent-slab", "coherence_length", "coherence_length"),
          ("dynamic-slab", "dynamics.correlation_time", "correlation_time")]  # fmt: skip
VALUES = [NAN, INF, -INF, 10**400, {"choice": [NAN]}, {"uniform": [0.0, INF]}]
MEAN_SOMETHING = ("coherence_length", "correlation_time")


@pytest.mark.parametrize(
    ("recipe", "path", "field", "value"),
    [(*field, value) for field in FIELDS for value in VALUES if value != INF or field[2] not in MEAN_SOMETHING],
    ids=lambda value: str(value)[:30],
)
def test_other_numbers_that_are_not_finite_are_refused_by_name(recipe, path, field, value):
    table = value
    for name in reversed(path.split(".")):
        table = {name: table}
    words = field if not isinstance(value, dict) else "choice|uniform"
    assert_refused(lambda: load_recipe(recipe, table), words)


@pytest.mark.parametrize(
    "tilts",
    [{"step": 2 * np.pi}, {"step": -2 * np.pi}, {"step": NAN}, {"step": np.pi / 8}, {"count": 2, "step": np.pi / 2},
     {"step": {"uniform": [0, 0.4]}}, {"step": {"choice": [-0.4, 0.1]}}, {"count": 10**12, "step": 1e-3},
     # Each component of the tilt turns by an angle of its own, so that a diagonal one leans more.
     {"count": 2, "step": 1.2, "azimuth": np.pi / 4}, {"count": 2, "step": 1.2, "azimuth": {"uniform": [0.0, 1.0]}},
     {"count": 2, "step": 1.2, "azimuth": {"uniform": [-5.0, 1e9]}}],
    ids=repr,
)  # fmt: skip
def test_tilts_beyond_a_right_angle_are_refused(tilts):
    assert_refused(lambda: Tilts(**tilts), r"Tilts\.step")


@pytest.mark.parametrize("tilts", [
    {"step": 0.39}, {"step": -0.39}, {"count": 1, "step": 9.0}, {"count": 2, "step": 1.1, "azimuth": np.pi / 4},
    {"count": 2, "step": 1.2, "azimuth": {"choice": [0.0, np.pi / 2]}},
], ids=repr)  # fmt: skip
def test_whatever_is_not_refused_can_be_drawn_and_is_a_beam(tilts):
    made = Tilts(**tilts)
    for seed in range(20):
        angles = made.drawn_together(Addresses(seed, "train", torch.device("cpu")), [seed])[0][0].numpy()
        CollimatedBeams.tilts(angles, width=1.0)
        steps = np.linalg.norm(np.diff(angles, axis=0), axis=1)
        np.testing.assert_allclose(steps, abs(tilts["step"]), rtol=1e-12)


@pytest.mark.parametrize("albedo", [1e-300, 1e-160])
def test_light_too_faint_for_images_is_refused_by_its_own_rule(albedo):
    """The planner's pilot compares correlations of light whose squares underflow."""
    faint = {"scatterer": {"type": "VonMisesFisher", "concentration": 5.0}, "albedo": albedo, "kernel": "estimate"}
    recipe = load_recipe("characters-of-new-fonts", SMALL | {"material": {"kernel_paths": 1000, **faint}})
    assert_refused(lambda: recipe.sample(0, "train", 0), "Scene intensity must be between")


@pytest.mark.parametrize("kernel", ["atlas", "estimate"])
def test_a_material_that_lets_no_light_through_is_refused(kernel):
    """Of the smallest albedo there is nothing is left; of particles that no atlas has, the atlas asks paths."""
    dark = {"scatterer": {"type": "VonMisesFisher", "concentration": 5.0}, "albedo": 5e-324, "kernel": kernel}
    recipe = load_recipe("characters-of-new-fonts", SMALL | {"material": {"kernel_paths": 1000, **dark}})
    with pytest.raises(RuleError,
                       match=r"Material\.kernel_paths must be enough that some light .* albedo 4.94066e-324"):
        recipe.sample(0, "train", 0)
