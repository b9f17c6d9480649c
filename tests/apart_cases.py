"""What a user does on a device, on one that is none of the host's (:mod:`apart`); run by :mod:`test_apart`."""

from contextlib import contextmanager

import numpy as np
import pytest
import torch
from apart import Apart, OnApart  # before what it changes is used
from typer.testing import CliRunner

from specklegen.cli.commands import app
from specklegen.datasets import SpeckleStream, load_recipe
from specklegen.datasets.recipes import generator
from specklegen.models import (
    Optics,
    bootstrap,
    joint_objects,
    judge_photograph,
    load_solver,
    metrics,
    reconstruct,
    turn_of,
)
from specklegen.models.judging.evaluation import evaluate
from specklegen.models.learning.examples import examples, streamed
from specklegen.models.learning.inputs import FEATURES, INPUTS, network_input
from specklegen.models.learning.measurement import measured
from specklegen.models.learning.reconstructor import Reconstructor, load_pretrained
from specklegen.models.learning.targets import TARGETS
from specklegen.models.learning.training import Training, train

FEW = {"material": {"kernel_paths": 500}}
CHANGES = {"through-slab": FEW, "two-tilts": FEW, "through-slab-lab": FEW, "dynamic-slab": FEW, "brownian-slab": FEW,
           "partially-coherent-slab": FEW, "lsci-slab": FEW, "masked-light-slab": FEW, "star-behind-slab": FEW,
           "polarised-tissue": FEW, "refocus-stack": FEW, "tissue-microscope": FEW,
           "flow-vessel": FEW | {"camera": {"shape": [24, 24]}}}  # fmt: skip
QUICK = ("through-slab", "two-tilts", "through-slab-lab", "brownian-slab", "lsci-slab", "unknown-slab", "tilt-stack",
         "ground-glass", "coherent-slab", "coherent-digits")  # fmt: skip
LONG = ("polarised-tissue", "refocus-stack", "flow-vessel", "tissue-microscope", "characters-of-new-fonts",
        "points-beyond-range", "one-angular-size", "dynamic-slab", "partially-coherent-slab", "masked-light-slab",
        "star-behind-slab", "unseen-material", "registered-tilts", "material-regression", "double-diffuser",
        "moving-diffuser", "screen-stack")  # fmt: skip
SHOWN = {  # a recipe that has what a network is shown, and one that has what it is to say
    "camera": "through-slab", "autocorrelation": "through-slab", "periodogram": "unknown-slab",
    "registered": "registered-tilts", "registered+power": "registered-tilts", "exposures": "lsci-slab",
    "local-contrast": "flow-vessel",
}  # fmt: skip
ASKED = {"object": "through-slab", "label": "through-slab", "material": "material-regression", "range": "unknown-slab",
         "motion": "lsci-slab", "contrast": "flow-vessel"}  # fmt: skip
RECIPE, OPTICS = load_recipe("through-slab", FEW), Optics(3.0, 3.0)
kept: dict[tuple[str, str], dict] = {}
looked_at: dict[str, np.ndarray] = {}


@pytest.fixture(autouse=True)
def on_apart(monkeypatch):
    """Small chunks: a device renders a full one for every rank."""
    monkeypatch.setattr(generator, "CHUNK", 2)
    monkeypatch.setattr(generator.SpeckleGenerator, "at_once", 2)
    with OnApart():
        yield


def second_batch(name, device):
    """Two samples, after others."""
    if (name, device) not in kept:
        stream = SpeckleStream(load_recipe(name, CHANGES.get(name, {})), batch_size=2, device=device)
        batches = iter(stream.loader())
        next(batches)
        kept[name, device] = next(batches)
    return kept[name, device]


def test_the_device_is_not_the_host():
    there = torch.arange(3, device="apart")
    assert there.device.type == "apart"
    assert torch.equal((there + 1)[[0, 2]].cpu(), torch.tensor([1, 3]))
    for wrong in (
        np.asarray,
        torch.Tensor.numpy,
        lambda t: t + torch.ones(3),
        lambda t: torch.where(t > 0, t, t.cpu()),
    ):
        with pytest.raises((RuntimeError, TypeError)):
            wrong(there)


@pytest.mark.parametrize("name", [*QUICK, *(pytest.param(name, marks=pytest.mark.slow) for name in LONG)])
def test_streams_of_every_kind(name):
    """Within 2e-6 of the CPU's, the second batch too, counts but for rounding; parameters within 1e-11."""
    here, there = second_batch(name, "cpu"), second_batch(name, "apart")
    assert here.keys() == there.keys()
    for parameter, value in here["parameters"].items():
        assert isinstance(there["parameters"][parameter], Apart)
        np.testing.assert_allclose(there["parameters"][parameter].cpu(), value, rtol=1e-11, err_msg=parameter)
    for key in here.keys() - {"parameters", "file"}:
        assert isinstance(there[key], Apart), key
        one, two = here[key].to(torch.complex128), there[key].cpu().to(torch.complex128)
        if here[key].dtype == torch.uint16:  # counts: rounding of the light takes one or another to its neighbour
            assert (two - one).abs().max() <= 1, key
            assert (two != one).double().mean() < 1e-3, key
        else:
            assert (two - one).abs().square().sum().sqrt() <= 2e-6 * one.abs().square().sum().sqrt(), key


def weekly_if(name, slow):
    """Name of a case, marked slow where it is one of those."""
    return pytest.param(name, marks=pytest.mark.slow) if name in slow else name


@pytest.mark.parametrize("kind", [weekly_if(kind, ("local-contrast",)) for kind in SHOWN])
def test_what_networks_are_shown(kind):
    assert SHOWN.keys() == INPUTS.keys() | FEATURES.keys()
    here, there = (network_input(second_batch(SHOWN[kind], device), kind) for device in ("cpu", "apart"))
    assert isinstance(there, Apart)
    assert (there.cpu() - here).abs().max() <= 1e-5 * here.abs().max()


@pytest.mark.parametrize("target", [weekly_if(target, ("contrast",)) for target in ASKED])
def test_what_networks_are_asked(target):
    assert ASKED.keys() == TARGETS.keys()
    here, there = (TARGETS[target].values(second_batch(ASKED[target], device)) for device in ("cpu", "apart"))
    assert isinstance(there, Apart)
    torch.testing.assert_close(there.cpu(), here, rtol=1e-6, atol=1e-9)


@pytest.mark.slow  # the command trains below
@pytest.mark.parametrize("mirror", [False, True])
def test_training_on_a_stream_of_the_device(tmp_path, mirror):
    """The same steps as on the host's stream, but for rounding."""
    recipe = load_recipe("through-slab", FEW | {"samples": {"train": 16, "validation": 8}})
    settings = Training(width=4, epochs=1, batch_size=4, mirror=mirror)
    held_out = examples(recipe, "autocorrelation", 8, split="validation")
    made = []
    for device in ("cpu", "apart"):
        data = streamed(SpeckleStream(recipe, batch_size=4, device=device), "autocorrelation")
        made.append(train(settings, data, held_out, tmp_path / device, device=device)(held_out.inputs.float()).cpu())
    # Adam divides by the size of gradients, small ones too: what rounding does to them is no longer rounding.
    assert (made[1] - made[0]).abs().max() < 0.02
    assert made[0].std() > 0


def test_models_are_read_onto_the_device(tmp_path):
    model = load_pretrained("apart")
    model.save(tmp_path / "model.pt")
    image = second_batch("through-slab", "cpu")
    shown = network_input(image, model.input)
    here = load_pretrained()(shown)
    for there in (model(shown), Reconstructor.load(tmp_path / "model.pt", "apart")(shown), model(shown.to("apart"))):
        torch.testing.assert_close(there.cpu(), here, rtol=1e-4, atol=1e-5)


@pytest.mark.parametrize("name", ["align", "pearson", "psnr", "ssim", "jaccard"])
def test_scores(name):
    light = second_batch("through-slab", "cpu")["object"].float()
    made = light.roll((1, 2), (-2, -1)) * 0.8 + 0.1 * torch.linspace(0, 1, light.numel()).view_as(light)
    score = getattr(metrics, name)
    there = score(made.to("apart"), light.to("apart")).cpu()
    torch.testing.assert_close(there, score(made, light), rtol=1e-4, atol=1e-5)


@pytest.mark.parametrize(
    "told", [pytest.param([], marks=pytest.mark.slow), ["--target", "label", "--network", "residual"]]
)
def test_train_makes_its_images_on_the_device(tmp_path, told):
    """By the command, with the tables at its beginning and end."""
    run = CliRunner().invoke(app, ["train", "through-slab", "--set", "material.kernel_paths=2000", "--set",
                                   "samples.train=8", *told, "--width", "4", "--epochs", "1", "--batch-size", "4",
                                   "--validation-samples", "16", "--device", "apart", "--seconds", "45", "--out",
                                   str(tmp_path / "run")])  # fmt: skip
    assert run.exit_code == 0, run.output
    assert "Rendering training images on apart" in run.output
    assert (tmp_path / "run" / "summary.md").exists()


def test_methods_are_judged_on_batches_of_the_device():
    batch = second_batch("through-slab", "cpu")
    found = [
        evaluate({"the image": lambda seen: seen["image"][:, 50:78, 50:78]}, [second_batch("through-slab", device)])[0]
        for device in ("cpu", "apart")
    ]
    here, there = (each.values["the image"]["sharp"]["pearson"] for each in found)
    assert len(here) == len(batch["image"])
    np.testing.assert_allclose(there, here, rtol=1e-4)


def first_of(batch):
    return {"image": batch["image"][:1], "parameters": {name: each[:1] for name, each in batch["parameters"].items()}}


LOOKED_AT = {"solver": lambda image, light: load_solver().solve(*measured(first_of(image), RECIPE)).image,
             "turn": lambda image, light: turn_of(image["image"][:, None], light, OPTICS).spreads,
             "joint": lambda image, light: joint_objects(image["image"], light, OPTICS).image,
             "assessment": lambda image, light: reconstruct(image["image"][:1, None], RECIPE, fast=True).each[0].image,
             "photograph": lambda image, light: judge_photograph(image["image"][0]).probability,
             "interval": lambda image, light: bootstrap(image["image"].mean((1, 2)), torch.arange(2)).mean}  # fmt: skip

WITHOUT = [what for what in LOOKED_AT if what != "solver"]  # the assessment calls it


def looked(what, device):
    image = second_batch("through-slab", "cpu")
    parameters = {name: values.to(device) for name, values in image["parameters"].items()}
    image = {name: image[name].to(device) for name in ("image", "object")} | {"parameters": parameters}
    return np.asarray(LOOKED_AT[what](image, image["object"].float()))


def looked_on_host(what):
    """What is found where nothing is set; once a process."""
    if what not in looked_at:
        looked_at[what] = looked(what, "cpu")
    return looked_at[what]


@pytest.mark.parametrize("what", [weekly_if(what, ("solver", "assessment")) for what in LOOKED_AT])
def test_images_of_the_device_can_be_looked_at(what):
    """What computes on the host takes tensors from wherever they lie."""
    np.testing.assert_array_equal(looked(what, "apart"), looked_on_host(what))


@contextmanager
def set_by_a_program(name):
    """What many programs begin with; the other way at the end."""
    dtype, device = torch.get_default_dtype(), torch.get_default_device()
    try:
        if name == "device":
            torch.set_default_device("apart")
        else:
            torch.set_default_dtype(getattr(torch, name))
        yield
    finally:
        torch.set_default_dtype(dtype)
        torch.set_default_device(device)


def trained(folder):
    data, held_out = (examples(RECIPE, "autocorrelation", count, split=split) for count,
                      split in ((8, "train"), (4, "validation")))  # fmt: skip
    return train(Training(width=4, epochs=1, batch_size=4), data, held_out, folder)(held_out.inputs.float())


def shown_and_trained(folder):
    return load_pretrained().reconstruct(second_batch("unknown-slab", "cpu")), trained(folder)


@pytest.fixture(scope="module")
def expected(tmp_path_factory):
    return [*map(looked_on_host, WITHOUT), *shown_and_trained(tmp_path_factory.mktemp("plain"))]


@pytest.mark.parametrize(
    "name", ["device", *(pytest.param(name, marks=pytest.mark.slow) for name in ("float64", "bfloat16"))]
)
def test_what_a_program_has_set_is_no_argument(name, expected, tmp_path):
    """Networks, solvers, verdicts and training find the same bits; they raised."""
    with set_by_a_program(name):
        found = [*(looked(what, "cpu") for what in WITHOUT), *shown_and_trained(tmp_path)]
    for what, value, right in zip([*WITHOUT, "network", "trained"], found, expected, strict=True):
        np.testing.assert_array_equal(np.asarray(value), np.asarray(right), err_msg=what)
