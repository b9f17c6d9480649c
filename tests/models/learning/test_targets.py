"""What networks tell beside objects: labels and materials, learned from what the recipes give."""

import numpy as np
import pytest
import torch
from refusals import assert_refused

from specklegen.core.errors import RuleError
from specklegen.datasets import SpeckleStream, load_recipe
from specklegen.datasets.loading.stream import tensors
from specklegen.datasets.objects.outlines import CHARACTERS
from specklegen.models.judging.answers import Classification, judge
from specklegen.models.learning import inputs
from specklegen.models.learning.examples import Examples, batches_of, examples, streamed
from specklegen.models.learning.reconstructor import Reconstructor
from specklegen.models.learning.targets import CLASSES, MATERIAL, determination, in_units, labels_of, numbers_of
from specklegen.models.learning.training import Training, train

FEW_TILTS = {"camera": {"shape": [48, 96]}, "tilts": {"count": 5}}
TINY = {"material": {"kernel_paths": 1000, "kernel": "estimate"}, "camera": {"shape": [32, 32]}, "media": 4,
        "samples": {"train": 16, "validation": 8}}  # fmt: skip


@pytest.fixture(scope="module")
def tilted():
    return load_recipe("registered-tilts", FEW_TILTS)


def test_a_label_is_the_character_of_the_sample():
    recipe = load_recipe("through-slab", TINY)
    batch = tensors(recipe.batch(0, "test", range(6)))
    rows = labels_of(batch)
    assert rows.shape == (6, 1, CLASSES)
    expected = [CHARACTERS.index(recipe.objects.source(0, "test",
                                                       n)[1]) for n in range(6)]  # type: ignore[attr-defined]
    assert rows[:, 0].argmax(-1).tolist() == expected
    with pytest.raises(RuleError, match="batch label must be a class from 0 to 44"):
        labels_of({"parameters": {"label": torch.tensor([-1.0])}})


def test_material_numbers_come_back_in_their_units(tilted):
    batch = tensors(tilted.batch(0, "train", range(3)))
    rows = in_units(numbers_of(batch, MATERIAL).double())
    for column, name in enumerate(MATERIAL):
        value = batch["parameters"][name]
        np.testing.assert_allclose(rows[:, column], value if name == "g" else value.log10(), atol=1e-6)


def test_determination_is_one_for_the_truth_and_zero_for_the_mean():
    true = torch.randn(50, 1, 4, generator=torch.Generator().manual_seed(0))
    np.testing.assert_allclose(determination(true, true), 1)
    np.testing.assert_allclose(determination(true.mean(0, keepdim=True).expand_as(true), true), 0, atol=1e-6)


def test_registered_correlations_are_those_of_the_kernel(tilted):
    """Mean over 24 slabs of what is measured less C_I: within 5 standard errors, allowing the 1 % of the modes."""
    batch = tensors(tilted.batch(3, "test", range(24)))
    found = inputs.registered_input(batch)
    tilts = np.arange(1, 5) * tilted.tilts.step
    ideal = [
        tilted.material_of(3, "test", n).correlation(2 * np.pi / tilted.wavelength * tilts) ** 2 for n in range(24)
    ]
    off = found[:, :4].numpy() - np.array(ideal)
    error = off.std(0, ddof=1) / np.sqrt(24)
    # A camera of 512 grains: the mean of an image is known to 1/512, which lowers a correlation by as much.
    assert (np.abs(off.mean(0)) < 5 * error + 0.01).all()
    np.testing.assert_allclose(found[:, 4:], (1 - found[:, :4]).clamp(1e-5, 2).log10())
    unmoved = dict(batch, tilts=torch.zeros_like(batch["tilts"]))  # power: images that are not laid over one another
    assert inputs.registered_input(unmoved)[:, 0].mean() < 0.1 < 0.5 < found[:, 0].mean()
    apart = dict(batch, tilts=batch["tilts"] * 20)
    assert not inputs.registered_input(apart)[:, :4].any()


def test_the_power_is_the_radiance_that_is_seen(tilted):
    batch = tensors(tilted.batch(0, "train", range(2)))
    found = inputs.registered_and_power_input(batch)
    assert torch.equal(found[:, :-1], inputs.registered_input(batch))
    seen = batch["stack"].double().mean((1, 2, 3)) * batch["parameters"]["forward_radiance"]
    np.testing.assert_allclose(found[:, -1], seen.log10(), rtol=1e-6)


def rows_of(count, seed):
    """Features that hold the answer outright."""
    rng = np.random.default_rng(seed)
    true = rng.standard_normal((count, 4)).astype(np.float32)
    features = true @ np.random.default_rng(99).standard_normal((4, 9)).astype(np.float32)
    return Examples(torch.from_numpy(features).half(), torch.from_numpy(true)[:, None], torch.arange(count))


def test_a_material_is_learned_saved_and_read_again(tmp_path):
    settings = Training(target="material", input="registered+power", network="perceptron", width=4, epochs=60,
                        learning_rate=1e-2)  # fmt: skip
    held_out = rows_of(64, 1)
    model = train(settings, rows_of(512, 0), held_out, tmp_path)
    assert (tmp_path / "log.csv").read_text().startswith("epoch,seconds,train_loss,validation_r2,")
    again = Reconstructor.load(tmp_path / "best.pt")
    assert (again.target, again.input) == ("material", "registered+power")
    assert torch.equal(again(held_out.inputs.float()), model(held_out.inputs.float()))
    assert determination(model(held_out.inputs.float()), held_out.targets).min() > 0.98


def test_labels_are_learned_from_a_stream_and_told(tmp_path):
    recipe = load_recipe("through-slab", TINY)
    settings = Training(target="label", network="dense", width=2, batch_size=8, epochs=1)
    held_out = examples(recipe, "autocorrelation", split="validation", target="label")
    data = streamed(SpeckleStream(recipe, batch_size=8), "autocorrelation", target="label")
    model = train(settings, data, held_out, tmp_path)
    batch = tensors(recipe.batch(0, "test", range(3)))
    told = model.tell(batch)
    assert told.shape == (3, CLASSES)
    torch.testing.assert_close(told.sum(-1), torch.ones(3))
    found = judge(model, batches_of(recipe, 6))
    assert isinstance(found, Classification)
    assert found.confusion.sum() == 6
    assert_refused(lambda: model.reconstruct(batch), "reconstruct model must be a model of objects")
    assert_refused(lambda: inputs.network_input(batch, "registered"), 'batch must be a batch with "stack" and "tilts"')


@pytest.mark.parametrize(("fields", "message"), [
    ({"input": "registered"}, r"Training\.input must be one of autocorrelation, periodogram, camera .*perceptron"),
    ({"network": "perceptron"}, r"Training\.input must be one of registered"),
    ({"target": "label"}, r"Training\.target must be one of object .*dense, residual"),
    ({"target": "material"}, r"Training\.target must be one of object .*perceptron"),
    ({"target": "label", "network": "dense", "mirror": True}, r"Training\.mirror must be false"),
])  # fmt: skip
def test_settings_that_do_not_go_together_are_refused(fields, message):
    assert_refused(lambda: Training(**fields), message)


def test_materials_without_these_numbers_are_refused():
    numbers = {name: torch.ones(2) for name in MATERIAL}
    with pytest.raises(RuleError, match="batch memory_effect_range must be a finite number.*another target"):
        numbers_of({"parameters": numbers | {"memory_effect_range": torch.tensor([1.0, torch.inf])}}, MATERIAL)
    with pytest.raises(RuleError, match="batch optical_depth must be"):
        numbers_of({"parameters": {name: numbers[name] for name in MATERIAL if name != "optical_depth"}}, MATERIAL)
