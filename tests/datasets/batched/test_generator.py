"""The contract of the generator: the recipe's samples, whatever the batch, the order and the program's switches."""

import math
from contextlib import contextmanager

import numpy as np
import pytest
import torch

import specklegen.datasets.recipes.recipe as recipes
from specklegen.datasets import SpeckleStream, load_recipe
from specklegen.datasets.batched import fresh, kept, optics, plan
from specklegen.datasets.batched import generator as generator_module
from specklegen.datasets.batched.generator import SpeckleGenerator
from specklegen.datasets.loading import stream as stream_module
from specklegen.datasets.recipes import hidden_object, partially_coherent
from specklegen.datasets.recipes.medium_realization import medium_realization
from specklegen.datasets.recipes.recipe_files import recipe_names

SAMPLES = 64
QUICK = {"kernel_paths": 20_000}
CHANGES = {
    "unknown-slab": {}, "unseen-material": {}, "tilt-stack": {}, "material-regression": {},
    "through-slab": {"material": QUICK, "media": 5}, "through-slab-lab": {"material": QUICK, "media": 5},
    "two-tilts": {"material": QUICK, "media": 3},
    "dynamic-slab": {"material": QUICK, "camera": {"shape": [48, 40]}, "dynamics": {"frames": 3}},
    "partially-coherent-slab": {
        "material": QUICK, "camera": {"shape": [48, 40]}, "coherence_length": {"log_uniform": [10_000.0, 1e5]},
    },
}  # fmt: skip
OTHERS = {
    "any-object": {}, "beyond-memory-effect": {"material": QUICK, "media": 2}, "characters-of-new-fonts": {},
    "one-angular-size": {}, "points-beyond-range": {}, "registered-tilts": {},
}  # fmt: skip
BY_STEPS = {"double-diffuser", "ground-glass", "masked-light-slab", "moving-diffuser", "screen-stack"}
SMALL = {
    "unknown-slab": {}, "tilt-stack": {},
    **{name: CHANGES[name] for name in ("through-slab", "dynamic-slab", "partially-coherent-slab")},
}  # fmt: skip


def recipe_of(name, **more):
    return load_recipe(name, {**CHANGES[name], **more})


@contextmanager
def double_precision(monkeypatch):
    """Samplers in complex128, their images float64."""
    plain = recipes.object_sampler

    def exact(recipe, slab, count, pitch):
        material, axis = recipe.material.known(slab), np.zeros((1, 2))
        return recipe.object_sampler(material, recipe.geometry, (count, count), pitch, axis, recipe.mode_tolerance)

    caches = (medium_realization, hidden_object._sampler)
    with monkeypatch.context() as patch:
        patch.setattr(recipes, "object_sampler", lambda *a, **k: plain(*a, **k, dtype=torch.complex128))
        patch.setattr(partially_coherent, "_sampler", exact)
        for cache in caches:
            cache.cache_clear()
        yield
    for cache in caches:
        cache.cache_clear()


def equal(one, two, pick=slice(None)):
    """All tensors of two batches, to the bit; of the second only some samples."""
    assert set(one) == set(two)
    for key, value in one.items():
        if isinstance(value, dict):
            equal(value, two[key], pick)
        else:
            other = two[key]
            assert value.dtype == other.dtype
            assert np.array_equal(value.numpy(), other.numpy()[pick], equal_nan=True), key


def test_every_packaged_recipe_is_compared_here_or_made_step_by_step():
    assert set(CHANGES) | set(OTHERS) | BY_STEPS == set(recipe_names())
    for name in recipe_names():
        way, why = plan.way_of(load_recipe(name))
        assert (way == plan.STEPS) == (name in BY_STEPS)
        assert bool(why) == (way == plan.STEPS)


@pytest.mark.parametrize("name", CHANGES)
def test_samples_are_those_of_the_recipe(name, monkeypatch):
    """Images within 2e-6 of those in complex128 (relative l2); parameters within 1e-11, the rest equal.

    A median error of 5e-7 is that of single precision. Parameters are to differ by rounding alone, some 1e-15 times
    the condition of the half range and what follows from it. Counts may differ by 1, in less than 1e-3 of pixels.
    """
    recipe, indices = recipe_of(name), [*range(SAMPLES - 1), 2**40 + 7]
    found = SpeckleGenerator(recipe, 11, "validation")(indices)
    with double_precision(monkeypatch):
        expected = recipe.batch(11, "validation", indices)
    assert set(found) == set(expected)
    assert set(found["parameters"]) == set(expected["parameters"])
    for parameter, value in expected["parameters"].items():
        np.testing.assert_allclose(found["parameters"][parameter], value, rtol=1e-11, err_msg=parameter)
    for key in set(expected) - {"parameters"}:
        one, two = found[key].numpy(), expected[key]
        assert one.shape == two.shape
        assert one.dtype == two.dtype
        if one.dtype == np.uint16:
            off = np.abs(one.astype(int) - two.astype(int))
            assert off.max() <= 1
            assert (off > 0).mean() < 1e-3
        elif key in ("image", "stack", "frames"):
            axes = tuple(range(1, one.ndim))
            error = np.sqrt(np.square(one - two.astype(float)).sum(axes) / np.square(two.astype(float)).sum(axes))
            assert error.max() < 2e-6
            wrong = np.roll(one, 1, axis=-1) - two  # power
            assert np.sqrt(np.square(wrong).sum(axes) / np.square(two.astype(float)).sum(axes)).min() > 1e-3
        else:
            np.testing.assert_allclose(one, two, rtol=1e-6, atol=1e-14)


@pytest.mark.parametrize("name", SMALL)
def test_companions_and_order_do_not_matter(name):
    """On the CPU to the bit: permuted, alone, in another batch."""
    generator = SpeckleGenerator(load_recipe(name, SMALL[name]), 3)
    whole = generator(range(12))
    order = np.random.default_rng(0).permutation(12)
    equal(generator(order), whole, order)
    equal(generator([7]), whole, slice(7, 8))
    equal(SpeckleGenerator(load_recipe(name, SMALL[name]), 3)(np.arange(4, 9)), whole, slice(4, 9))


def _old_and_new():
    torch.set_float32_matmul_precision("medium")
    torch.backends.cuda.matmul.allow_tf32 = True


SWITCHES = {
    "all": lambda: torch.set_float32_matmul_precision("medium"),
    "old and new": _old_and_new,  # torch then refuses to say what the switch of all is
    "one backend": lambda: setattr(torch.backends.cuda.matmul, "fp32_precision", "tf32"),
}
BACKENDS = (torch.backends.cuda.matmul, torch.backends.mkldnn.matmul)


@pytest.mark.parametrize("name", ["unknown-slab", "through-slab-lab"])
def test_switches_of_the_program_change_nothing(name, monkeypatch):
    """TF32, autocast and gradients around the generator; they are left as they were."""
    generator = SpeckleGenerator(recipe_of(name), 1)
    plain = generator(range(3))
    seen, images = [], optics.images
    monkeypatch.setattr(optics, "images", lambda *a: [seen.append([b.fp32_precision for b in BACKENDS]), images(*a)][1])
    for switch in SWITCHES.values():
        try:
            switch()
            before = [backend.fp32_precision for backend in BACKENDS]
            assert before != ["ieee"] * 2
            with torch.autocast("cpu", dtype=torch.bfloat16):
                equal(generator(range(3)), plain)
                assert torch.is_autocast_enabled("cpu")
            assert [backend.fp32_precision for backend in BACKENDS] == before
        finally:
            torch.set_float32_matmul_precision("highest")
    assert all(each == ["ieee"] * 2 for each in seen)
    assert len(seen) == 9
    image = plain["image"]
    assert not image.requires_grad
    assert not image.is_inference()


@pytest.mark.filterwarnings("ignore::specklegen.DoubtWarning")
def test_what_the_atlas_does_not_serve_is_made_step_by_step():
    """Some slabs of this recipe leave the tables: they come from the recipe, the others from the device."""
    changes = {"material": {"g": {"uniform": [0.97, 0.9999]}, "kernel_paths": 2000}, "camera": {"shape": [16, 16]}}
    recipe = load_recipe("tilt-stack", changes | {"sampler": "stationary"})
    generator = SpeckleGenerator(recipe, 0)
    ranks = generator.ranks(generator.prepare(list(range(12)))[0])
    assert 0 in ranks
    assert max(ranks) > 0
    found, expected = generator(range(12)), recipe.batch(0, "train", range(12))
    np.testing.assert_allclose(found["stack"], expected["stack"], rtol=0, atol=1e-5 * expected["stack"].max())
    np.testing.assert_allclose(found["parameters"]["estimator"], expected["parameters"]["estimator"])
    assert all(estimator == 2 for estimator, rank in zip(found["parameters"]["estimator"], ranks, strict=True) if rank)


@pytest.mark.parametrize(
    ("name", "changes", "way", "words"),
    [
        ("unknown-slab", {}, plan.DRAWN, ""),
        ("through-slab", {"media": 2, "material": QUICK}, plan.KEPT, ""),
        ("unknown-slab", {"window": {"profile": "disc"}}, plan.STEPS, "disc"),
        ("unknown-slab", {"material": {"g": {"choice": [0.8, 0.9]}}}, plan.STEPS, "choice"),
        ("unknown-slab", {"light": {"polarised": False}}, plan.STEPS, "polarised"),
        ("through-slab", {"media": "new", "material": QUICK}, plan.FRESH, ""),
        ("through-slab", {"media": "new", "field": {"extent_over_range": {"uniform": [0.4, 0.5]}}}, plan.STEPS,
         "traces paths"),
        ("dynamic-slab", {"material": QUICK}, plan.FRESH, ""),
        ("dynamic-slab", {"material": QUICK | {"g": {"uniform": [0.88, 0.9]}}}, plan.STEPS, "several materials"),
        ("dynamic-slab", {"material": QUICK, "dynamics": {"correlation_time": {"choice": [2.0, 9.0]}}}, plan.STEPS,
         "correlation_time is a choice"),
        ("partially-coherent-slab", {"material": QUICK}, plan.FRESH, ""),
        ("partially-coherent-slab", {"coherence_length": {"choice": [5e3, 5e4]}}, plan.STEPS, "coherence_length"),
        ("masked-light-slab", {}, plan.STEPS, "masked-light"),
    ],
)  # fmt: skip
def test_the_report_says_what_keeps_a_recipe_off_the_fast_path(name, changes, way, words):
    report = SpeckleGenerator(load_recipe(name, changes), 0).report()
    assert report["way"] == way
    assert words in " ".join(report["why"])
    assert bool(report["why"]) == (way == plan.STEPS)


@pytest.mark.parametrize(
    ("name", "changes"),
    [
        ("through-slab", {"media": "new", "light": {"polarised": False}}),
        ("through-slab", {"media": 2, "light": {"polarised": False}}),
        ("through-slab", {"media": "new", "media_group": 2, "light": {"bandwidth": 0.002}}),
        ("through-slab-lab", {"media": "new"}),
        ("two-tilts", {"media": "new", "tilts": {"step": 1e-4, "azimuth": 0.3}}),
        ("dynamic-slab", {"light": {"polarised": False}, "dynamics": {"frames": 2, "correlation_time": math.inf}}),
        ("dynamic-slab", {"media": 2, "dynamics": {"frames": 2, "correlation_time": 3.0}}),
        ("partially-coherent-slab", {"media": 2, "coherence_length": math.inf, "exposure": {"photons": 300.0}}),
    ],
)  # fmt: skip
def test_other_light_and_media_of_one_material(name, changes):
    """Polarisations, modes of light, groups, a laboratory, films of kept media: 1e-5, rounding of both programs."""
    if "lab" not in name:
        changes = changes | {"camera": {"shape": [20, 24]}}
    recipe = load_recipe(name, {"material": QUICK, **changes})
    generator = SpeckleGenerator(recipe, 5)
    assert generator.way != plan.STEPS
    found, expected = generator(range(4)), recipe.batch(5, "train", range(4))
    assert list(found) == list(expected)
    for key in {"image", "stack", "frames"} & set(expected):
        one, two = found[key].numpy().astype(float), expected[key].astype(float)
        if expected[key].dtype == np.uint16:
            assert np.abs(one - two).max() <= 1
            assert (one != two).mean() < 1e-3
        else:
            np.testing.assert_allclose(one, two, rtol=0, atol=1e-5 * two.max())
    for parameter, value in expected["parameters"].items():
        np.testing.assert_allclose(found["parameters"][parameter], value, rtol=1e-11, err_msg=parameter)


def test_frames_are_correlated_as_the_recipe_says(monkeypatch):
    """A film whose frames were drawn anew, or stood still, would not pass as this one."""
    recipe = recipe_of("dynamic-slab")
    right = SpeckleGenerator(recipe, 0)(range(2))["frames"]
    plain = fresh.spectra
    for share in (torch.zeros, torch.ones):
        with monkeypatch.context() as patch:
            patch.setattr(fresh, "spectra", lambda m, k, s, _share=share: plain(m, k, _share(1).to(s)))
            wrong = SpeckleGenerator(recipe, 0)(range(2))["frames"]
        assert torch.equal(wrong[:, 0], right[:, 0])
        assert (wrong[:, 1:] - right[:, 1:]).abs().amax() > 0.1


@pytest.mark.slow
@pytest.mark.parametrize("name", ["dynamic-slab", "partially-coherent-slab"])
def test_samples_of_packaged_size(name, monkeypatch):
    monkeypatch.setitem(CHANGES, name, {"material": QUICK})
    test_samples_are_those_of_the_recipe(name, monkeypatch)


@pytest.mark.slow
@pytest.mark.parametrize("name", OTHERS)
def test_samples_of_the_other_packaged_recipes(name, monkeypatch):
    monkeypatch.setitem(CHANGES, name, OTHERS[name])
    test_samples_are_those_of_the_recipe(name, monkeypatch)


def test_media_that_would_fill_the_memory_are_not_kept(monkeypatch):
    monkeypatch.setattr(kept, "MOST_BYTES", 2**20)
    report = SpeckleGenerator(recipe_of("through-slab"), 0).report()
    assert (report["way"], report["why"]) == (plan.STEPS, ["its media take more than 1 MB"])


def test_pictures_from_the_host_are_named_and_right():
    recipe = recipe_of("through-slab", objects={"type": "Photographs", "shape": [20, 20]}, media=2)
    generator = SpeckleGenerator(recipe, 0)
    assert generator.report()["host"][-1] == "pictures of Photographs"
    found, expected = generator(range(3)), recipe.batch(0, "train", range(3))
    np.testing.assert_array_equal(found["object"], expected["object"])
    np.testing.assert_allclose(found["image"], expected["image"], rtol=0, atol=1e-5 * expected["image"].max())


def test_a_steps_recipe_gives_the_recipes_own_bits():
    changes = {"material": QUICK | {"g": {"uniform": [0.89, 0.9]}}, "camera": {"shape": [16, 16]}}
    recipe = load_recipe("dynamic-slab", changes)
    found, expected = SpeckleGenerator(recipe, 0)(range(2)), recipe.batch(0, "train", range(2))
    np.testing.assert_array_equal(found["frames"], expected["frames"])


@pytest.mark.parametrize("profile", ["square", "gaussian"])
def test_sizes_hold_for_every_medium(profile):
    for name in ("unknown-slab", "tilt-stack"):
        recipe = load_recipe(name, {"window": {"profile": profile}})
        sizes = plan.sizes_of(recipe)
        generator = SpeckleGenerator(recipe, 5)
        cells = generator.prepare(list(range(300)))[0].cells
        assert (cells.amax(0) <= torch.tensor(sizes.cells)).all()
        assert (cells.amax(0) >= 0.8 * torch.tensor(sizes.cells)).all()


@pytest.mark.parametrize("indices", [[], [-1], [3, -2**40]])
def test_bad_indices_are_refused(indices):
    with pytest.raises(ValueError, match="at least one index, each a whole number of at least 0"):
        SpeckleGenerator(load_recipe("tilt-stack"), 0)(indices)


def test_bad_recipes_and_splits_are_refused():
    with pytest.raises(ValueError, match="a recipe of this library"):
        SpeckleGenerator("through-slab", 0)  # type: ignore[arg-type]
    with pytest.raises(ValueError, match="split must be one of"):
        SpeckleGenerator(load_recipe("tilt-stack"), 0, "exam")


def test_a_device_that_is_not_there_is_named():
    with pytest.raises(ValueError, match="SpeckleGenerator.device must be a device that torch has here; got 'gpu'"):
        SpeckleGenerator(load_recipe("tilt-stack"), 0, device="gpu")


def test_a_stream_uses_the_generator_where_it_can(monkeypatch, caplog):
    for module in (stream_module, generator_module, recipes):
        monkeypatch.setattr(module, "checked_device", lambda _field, device: torch.device(device))
    stream = SpeckleStream(recipe_of("through-slab"), device="meta", batch_size=4)
    assert stream.report()["way"] == plan.KEPT
    batch = next(iter(stream))
    assert batch["image"].device.type == "meta"
    assert batch["image"].shape == (4, 128, 128)
    slow = SpeckleStream(load_recipe("dynamic-slab", {"material": {"g": {"uniform": [0.89, 0.9]}}}), device="meta")
    with caplog.at_level("WARNING"):
        assert slow._generator is None
    assert "sample by sample on meta: kind 'dynamic-slab' with media of several materials" in caplog.text
    assert SpeckleStream(recipe_of("through-slab")).report()["way"] == plan.STEPS


class Asked(SpeckleGenerator):
    """Notes how many samples it is asked for at a time."""

    def __call__(self, indices):
        self.counts.append(len(indices))
        return super().__call__(indices)


def test_small_batches_are_made_several_at_once_and_resumed_in_the_middle(monkeypatch):
    """Two of four samples at a time, the last of one: the bits of each batch by itself, in memory of its own."""
    recipe = load_recipe("tilt-stack", {"samples": {"train": 21}, "camera": {"shape": [8, 8]}})
    stream = SpeckleStream(recipe, 3, batch_size=4)
    generator = stream.__dict__["_generator"] = Asked(recipe, 3)
    monkeypatch.setattr(generator_module, "AT_ONCE", 9)
    generator.counts = []
    batches = list(stream)
    assert generator.counts == [8, 8, 5]
    for number, batch in enumerate(batches):
        equal(dict(batch), SpeckleGenerator(recipe, 3)(stream.indices(0, number)))
        assert batch["stack"].untyped_storage().nbytes() == 4 * batch["stack"].numel()
    assert stream.report()["batches_at_once"] == 2

    loader = stream.loader()
    for number, _ in enumerate(loader):
        if number == 2:  # the first of two
            state = loader.state_dict()
            break
    resumed = stream.loader()
    resumed.load_state_dict(state)
    generator.counts.clear()
    for found, expected in zip(resumed, batches[3:], strict=True):
        equal(dict(found), dict(expected))
    assert generator.counts == [8, 1]

    monkeypatch.setattr(generator_module, "AT_ONCE_BYTES", 4 * 5 * 8 * 8 * 3)
    assert generator.at_once == 3, "fewer of large images"
    assert stream.report()["batches_at_once"] == 1
