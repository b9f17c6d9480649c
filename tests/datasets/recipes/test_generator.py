"""The contract of the generator: one program, whatever the device, the batch, the order and the program's switches."""

from dataclasses import replace

import numpy as np
import plain_forms
import pytest
import torch
from plain_forms import as_on_devices
from quick_recipes import packaged, quick_recipe
from refusals import assert_refused
from torch.utils._pytree import tree_flatten
from zscore import assert_mean, refute_mean

import specklegen.datasets.recipes.specification as specification
from specklegen.core.memory import array_bytes
from specklegen.datasets import SpeckleStream, load_recipe
from specklegen.datasets.addresses import Addresses
from specklegen.datasets.loading import stream as stream_module
from specklegen.datasets.recipes import contrast_map
from specklegen.datasets.recipes import generator as generator_module
from specklegen.datasets.recipes.generator import SpeckleGenerator
from specklegen.samplers.screens import objects as screen_objects
from specklegen.synthesis import fused
from specklegen.synthesis import imaging as imaging_module
from specklegen.synthesis.imaging import Imaging
from specklegen.synthesis.surface import SurfaceFilm

SAMPLES = 4
CPU = torch.device("cpu")
CHANGES = {
    "through-slab": {"media": 3}, "through-slab-lab": {"media": 3}, "two-tilts": {"media": 3},
    "beyond-memory-effect": {"media": 2}, "dynamic-slab": {"camera": {"shape": [48, 40]}, "dynamics": {"frames": 3}},
    "brownian-slab": {"camera": {"shape": [48, 40]}, "dynamics": {"frames": 3}},
    "lsci-slab": {"camera": {"shape": [48, 40]}, "exposures": {"durations": [1e-4, 1e-3]}},
    "flow-vessel": {"camera": {"shape": [48, 40]}, "exposures": {"durations": [1e-4, 1e-3]}},
    "moving-diffuser": {"camera": {"shape": [48, 40]}, "dynamics": {"frames": 3}, "field": {"pixels": 12.0}},
    "partially-coherent-slab": {"camera": {"shape": [48, 40]}, "coherence_length": {"log_uniform": [10_000.0, 1e5]}},
    "masked-light-slab": {"camera": {"shape": [48, 40]}}, "star-behind-slab": {"camera": {"shape": [48, 40]}},
    "refocus-stack": {"lens": {"planes": 2}},
}  # fmt: skip
SMALL = ("unknown-slab", "tilt-stack", "through-slab", "dynamic-slab", "brownian-slab", "partially-coherent-slab",
         "ground-glass")  # fmt: skip


def recipe_of(name, **more):
    return quick_recipe(name, 2000, **{**CHANGES.get(name, {}), **more})


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


def assert_agree(found, expected, parameters=1e-11):
    """Images within 2e-6 (relative l2), parameters within 1e-11; counts within 1, in less than 1e-3 of pixels. A median
    error of 5e-7 is that of single precision. Parameters are to differ by rounding alone, some 1e-15 times the
    condition of the half range and what follows from it."""
    assert set(found) == set(expected)
    assert set(found["parameters"]) == set(expected["parameters"])
    for parameter, value in expected["parameters"].items():
        np.testing.assert_allclose(found["parameters"][parameter], value, rtol=parameters, err_msg=parameter)
    for key in set(expected) - {"parameters"}:
        one, two = found[key].numpy(), expected[key].numpy()
        assert (one.shape, one.dtype) == (two.shape, two.dtype)
        if one.dtype == np.uint16:
            off = np.abs(one.astype(int) - two.astype(int))
            assert off.max() <= 1
            assert (off > 0).mean() < 1e-3
        elif key in ("image", "stack", "frames"):
            axes = tuple(range(1, one.ndim))
            power = np.square(two.astype(float)).sum(axes)
            assert np.sqrt(np.square(one - two.astype(float)).sum(axes) / power).max() < 2e-6
            wrong = np.roll(one, 1, axis=-1) - two  # power
            assert np.sqrt(np.square(wrong).sum(axes) / power).min() > 1e-3
        else:
            np.testing.assert_allclose(one, two, rtol=1e-6, atol=1e-14)


@pytest.mark.parametrize("name", packaged(lambda name: load_recipe(name).kind not in ("lens-stack", "coherent-object")))
def test_images_are_those_of_double_precision(name, monkeypatch):
    """The same program in complex128."""
    recipe, indices = recipe_of(name), [*range(SAMPLES - 1), 2**40 + 7]
    found, plain, asked = SpeckleGenerator(recipe, 11, "validation")(indices), imaging_module.imagings, []

    def precise(*arguments, **options):
        asked.append(len(arguments[0]))
        return plain(*arguments, **options, precise=True)

    rendered = SpeckleGenerator._rendered
    monkeypatch.setattr(SpeckleGenerator, "_rendered", lambda *given: rendered(*given).to(torch.float32))
    for module in (imaging_module, screen_objects):
        monkeypatch.setattr(module, "imagings", precise)
    double = lambda *given: asked.append(1) or SurfaceFilm(*given, precise=True)  # noqa: E731
    monkeypatch.setattr(contrast_map, "SurfaceFilm", double)
    contrast_map._surface.cache_clear()
    assert_agree(found, SpeckleGenerator(recipe, 11, "validation")(indices))
    contrast_map._surface.cache_clear()
    assert asked


MANY_MODES = pytest.param("beyond-memory-effect", marks=pytest.mark.slow)
BANDS = {"bandwidth of the light": ("through-slab", {
    "light": {"bandwidth": 0.004}, "media": "new", "camera": {"shape": [32, 36]}})}  # fmt: skip


@pytest.mark.parametrize("name", [*packaged(lambda name: name != "beyond-memory-effect"), MANY_MODES, *BANDS])
def test_devices_render_what_the_cpu_renders(name, monkeypatch):
    """What they run, the torch forms on media of few ranks and of one size in chunks that are filled up, on the CPU."""
    source, changes = BANDS.get(name, (name, {}))
    lab = source == "through-slab-lab"
    recipe, indices = recipe_of(source, **({} if lab else {"camera": {"shape": [64, 72]}} | changes)), range(3)
    found = SpeckleGenerator(recipe, 4)(indices)
    with as_on_devices(monkeypatch):
        assert_agree(SpeckleGenerator(recipe, 4)(indices), found)


@pytest.mark.parametrize("name", ["unknown-slab", "through-slab"])
def test_chunks_on_a_device_show_each_object_through_its_own_medium(name, monkeypatch):
    """To the bit, what the media of a chunk give that are taken out of their batch one by one."""
    recipe, numbers = recipe_of(name, camera={"shape": [64, 72]}), [7, 2, 5, 0, 11, 4, 2**40]
    with as_on_devices(monkeypatch, chunk=2):
        generator = SpeckleGenerator(recipe, 4)
        images = generator(numbers)["image"]
        media = recipe.medium_numbers(numbers)
        (behind,), light = generator._ready(media), recipe.lit(generator.shown, numbers).light
        made, apart = behind.made, 0
        for imaging, rows in behind.groups():
            for some in generator_module._chunks(rows, generator._chunk(imaging, made.streams)):
                samples, places = behind.samples[some], behind.media[some]
                own = imaging.at(torch.from_numpy(made.at[places, 1]))
                drawn = own.media(made.streams.at(torch.from_numpy(places)))
                if recipe.shares_media:  # spectra are made and kept medium by medium
                    each = [own.at([n]).spectra(drawn.drawn[n : n + 1]) for n in range(len(some))]
                    drawn = replace(drawn, drawn=None, spectra=torch.cat(each))
                expected = replace(drawn, one_by_one=False).images(light[samples])[:, 0]
                assert torch.equal(expected, images[samples])
                apart += not torch.equal(images[samples], images[np.roll(samples, 1)])
        assert apart, "power"


def test_contrasts_on_a_device_keep_to_the_memory_of_a_chunk(monkeypatch):
    recipe, sizes, plain = recipe_of("unknown-slab", camera={"shape": [64, 72]}), [], generator_module.speckle_contrast
    watched = lambda light, variance: sizes.append(len(light)) or plain(light, variance)  # noqa: E731
    monkeypatch.setattr(generator_module, "speckle_contrast", watched)
    found = []
    for room in (2**30, 3 * 160 * 28 * 28):
        with as_on_devices(monkeypatch), monkeypatch.context() as patch:
            patch.setattr(generator_module, "CHUNK_BYTES", room)
            found.append(SpeckleGenerator(recipe, 4)(range(5))["parameters"]["expected_contrast"])
    assert sizes == [256, 3, 3]
    torch.testing.assert_close(*found, rtol=1e-12, atol=0)


def test_a_device_meets_no_new_shape_in_a_further_batch(monkeypatch):
    """On CUDA every new one is compiled anew: as many samples of a rank as a batch happens to have would never end. All
    operators of unknown-slab, whose ranks and counts of them differ from batch to batch; of ranks that were met."""
    met = {}

    def watched(name, form):
        def run(*arguments):
            shapes = [tuple(a.shape) for a in tree_flatten(arguments)[0] if isinstance(a, torch.Tensor)]
            met.setdefault(name, set()).add(str(shapes))
            return form(*arguments)

        return run

    forms = {name: watched(name, form) for name, form in fused.FORMS.items()}
    monkeypatch.setattr(plain_forms, "FORMS", forms)
    with as_on_devices(monkeypatch):
        generator = SpeckleGenerator(recipe_of("unknown-slab", camera={"shape": [64, 64]}), 4)
        for first in range(0, 36, 12):
            generator(range(first, first + 12))
        counts = {name: len(shapes) for name, shapes in met.items()}
    ranks = counts["pair_products"]
    assert ranks > 1
    assert counts["speckle_contrast"] == 1
    assert max(counts.values()) <= 2 * ranks, counts  # of every rank, of a full and a small chunk


@pytest.mark.parametrize("name", SMALL)
def test_companions_and_order_do_not_matter(name):
    """On the CPU to the bit: permuted, alone, in another batch, of the recipe itself."""
    recipe = recipe_of(name)
    generator = SpeckleGenerator(recipe, 3)
    whole = generator(range(9))
    order = np.random.default_rng(0).permutation(9)
    equal(generator(order), whole, order)
    equal(generator([7]), whole, slice(7, 8))
    equal(SpeckleGenerator(recipe_of(name), 3)(np.arange(4, 9)), whole, slice(4, 9))
    batch = recipe.batch(3, "train", [8, 0])
    for key in set(batch) - {"parameters"}:
        np.testing.assert_array_equal(batch[key], whole[key].numpy()[[8, 0]])


@pytest.mark.filterwarnings("ignore::specklegen.DoubtWarning")
def test_slabs_in_the_atlas_and_beyond_it_share_a_batch():
    """The tables are not good enough for some slabs of this recipe: the bits of each are those that it has alone."""
    material = {"kernel_paths": 2000, "kernel_tolerance": 0.008}
    changes = {"material": material, "camera": {"shape": [16, 16]}, "sampler": "stationary"}
    recipe = load_recipe("tilt-stack", changes)
    whole = SpeckleGenerator(recipe, 0)(range(12))
    assert set(whole["parameters"]["estimator"].tolist()) == {1.0, 2.0}
    for n in range(12):
        equal(SpeckleGenerator(recipe, 0)([n]), whole, slice(n, n + 1))


@pytest.mark.parametrize(("name", "changes", "sampler", "host"), [
    ("unknown-slab", {}, "stationary", []), ("through-slab", {}, "stationary", ["the memory effect of every material"]),
    ("ground-glass", {}, "screens", ["the memory effect of every material"]),
    ("unknown-slab", {"objects": {"type": "Points", "shape": [12, 12]}}, "stationary", ["pictures of Points"]),
    ("masked-light-slab", {}, "stationary",
     ["the memory effect of every material", "masks, and the waves behind them"]),
    ("through-slab", {"window": {"width": 4000.0}, "camera": {"shape": [16, 16]}, "objects": {"shape": [6, 6]}},
     "paths", ["the memory effect of every material", "sums over paths"]),
])  # fmt: skip
def test_the_report_says_who_renders_and_what_the_host_does(name, changes, sampler, host):
    report = SpeckleGenerator(quick_recipe(name, 2000, **changes), 0).report()
    assert report == {"sampler": sampler, "device": "cpu", "host": host, "graphs": "none"}


def test_unpolarised_light_is_two_halves_of_one_brightness():
    """Of one beam the mean is 1 and E I^2 = 3/2, over 150 media by Student's t; of one polarisation it is 2."""
    small = {"material": {"kernel_paths": 2000}, "camera": {"shape": [16, 16]}, "objects": {"shape": [4, 4]}}
    point = np.zeros((4, 4))
    point[1, 2] = 1.0
    found = {}
    for polarised in (False, True):
        recipe = load_recipe("through-slab", small | {"light": {"polarised": polarised}})
        seen = np.stack([recipe.prepare(3, "train", n).images(point)[0] for n in range(150)]).astype(float)
        found[polarised] = np.square(seen).mean((1, 2))
        assert_mean(seen.mean((1, 2)), 1.0)
        assert_mean(found[polarised], 2.0 if polarised else 1.5)
        refute_mean(seen.mean((1, 2)), 0.5)  # the two halves not halved
    refute_mean(found[False], 2.0)


def test_media_are_kept_between_calls_up_to_a_number_and_a_size(monkeypatch):
    recipe = recipe_of("through-slab", media=5)
    whole = SpeckleGenerator(recipe, 0)(range(10))
    monkeypatch.setattr(generator_module, "KEPT", 2)
    few = SpeckleGenerator(recipe, 0)
    equal(few(range(5)), whole, slice(5))
    assert [*few._media] == [*few._spectra] == [3, 4]
    equal(few([9, 8]), whole, [9, 8])
    monkeypatch.setattr(generator_module, "_KEPT_BYTES", 0)
    monkeypatch.setattr(generator_module, "KEPT", 5)
    first = SpeckleGenerator(recipe, 0)
    each = max(made.groups[made.at[n][0]][1].spectra_bytes for made, n in few._media.values())
    monkeypatch.setattr(generator_module, "_FIRST_BYTES", each)  # room for those of medium 0 alone, whenever it comes
    found = [first(order)["image"] for order in ([4, 0, 1], [0, 1, 4], [1])]
    assert [*first._spectra] == [0]
    assert torch.equal(found[0], found[1][[2, 0, 1]])
    assert torch.equal(found[1][1:2], found[2])
    monkeypatch.setattr(generator_module, "_FIRST_BYTES", 0)
    none = SpeckleGenerator(recipe, 0)
    found = none(range(5))["image"]  # sums over bright pixels, where that is cheaper: other rounding
    np.testing.assert_allclose(found, whole["image"][:5], rtol=0, atol=1e-5 * float(whole["image"].max()))
    assert not none._spectra


def test_fields_are_kept_where_spectra_are_not(monkeypatch):
    """Of wide objects: a medium's noise is drawn once, and its images have the bits of noise that is drawn anew."""
    recipe, plain, drawn = recipe_of("beyond-memory-effect", media=4), Imaging.fields, []
    monkeypatch.setattr(Imaging, "fields", lambda own, *more, **named: drawn.append(own) or plain(own, *more, **named))
    kept = SpeckleGenerator(recipe, 0)
    found = [kept(range(4)), kept(range(4, 8))]
    assert sorted([*kept._spectra, *kept._fields]) == [0, 1, 2, 3]
    assert kept._fields, "one of the objects is wide"
    assert len(drawn) == 4
    assert array_bytes(kept.held()) > sum(fields.nbytes for fields in kept._fields.values())
    monkeypatch.setattr(SpeckleGenerator, "_keeps_fields", lambda *_: False)
    anew = SpeckleGenerator(recipe, 0)
    for numbers, before in zip((range(4), range(4, 8)), found, strict=True):
        equal(anew(numbers), before)
    assert len(drawn) == 4 + len(kept._spectra) + 2 * len(kept._fields)


@pytest.mark.parametrize("profile", ["square", "gaussian"])
@pytest.mark.parametrize("name", ["unknown-slab", "tilt-stack"])
def test_bounds_of_cells_hold_for_every_medium(name, profile):
    """Devices know them without asking; they are not far off."""
    recipe = load_recipe(name, {"window": {"profile": profile}})
    ((_, media),) = recipe.drawn_media(Addresses(5, "train", CPU), range(300))
    ((_, there),) = recipe.drawn_media(Addresses(5, "train", torch.device("meta")), range(3))
    most, bound = media.sight.cells.number.amax(0), torch.tensor(there.sight.bound)
    assert media.sight.bound == there.sight.bound
    assert (most <= bound).all()
    assert (most >= 0.8 * bound).all()


@pytest.mark.parametrize("indices", [[], [-1], [3, -(2**40)], [2**63]])
def test_bad_indices_are_refused(indices):
    with pytest.raises(ValueError, match="SpeckleGenerator indices must be at least one index"):
        SpeckleGenerator(load_recipe("tilt-stack"), 0)(indices)


def test_samples_beyond_the_numbers_that_hold_them_are_refused():
    """By name, not by torch; the last one that there is, is made."""
    recipe = load_recipe("through-slab", {"material": {"kernel_paths": 1000}, "camera": {"shape": [16, 16]}})
    assert recipe.sample(0, "train", 2**63 - 1)["index"] == 2**63 - 1
    assert_refused(lambda: recipe.sample(0, "train", 2**63), "sample index must be at least 0 and at most")


def test_bad_recipes_and_splits_are_refused():
    with pytest.raises(ValueError, match="a recipe of this library"):
        SpeckleGenerator("through-slab", 0)  # type: ignore[arg-type]
    assert_refused(lambda: SpeckleGenerator(load_recipe("tilt-stack"), 0, "exam"), "split must be one of")


def test_a_stream_uses_the_generator_of_its_device(monkeypatch):
    for module in (stream_module, specification):
        monkeypatch.setattr(module, "checked_device", lambda _field, device: torch.device(device))
    monkeypatch.setattr(stream_module, "require_finite", lambda *_: None)  # there are no numbers
    stream = SpeckleStream(recipe_of("through-slab"), device="meta", batch_size=4)
    assert stream.report()["device"] == "meta"
    batch = next(iter(stream))
    assert batch["image"].device.type == "meta"
    assert batch["image"].shape == (4, 128, 128)
    here = SpeckleStream(recipe_of("through-slab"))
    assert here._generator is None
    assert here.report() == {"device": "cpu", "host": ["everything"]}


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
