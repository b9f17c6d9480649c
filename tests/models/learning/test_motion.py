"""What moves, from exposures: features against sums by hand, the closed inversion, and a network that learns both."""

import json

import numpy as np
import pytest
import torch
from quick_recipes import quick_recipe
from typer.testing import CliRunner
from zscore import assert_mean, refute_mean

from specklegen.cli.commands import app
from specklegen.core.errors import RuleError
from specklegen.datasets.loading.stream import tensors
from specklegen.models.judging.answers import Regression
from specklegen.models.judging.closed_inversion import closed_inversion
from specklegen.models.learning import exposures
from specklegen.models.learning.inputs import network_input
from specklegen.models.learning.targets import MOTION, in_units, numbers_of
from specklegen.theory.speckle_contrast import exponential_contrast_squared

FEW = {"durations": [5e-5, 1.6e-3, 1e-2], "tau0": {"log_uniform": [1e-4, 1e-3]}, "tolerance": 0.1}


@pytest.fixture(scope="module")
def batch():
    """Sixteen media under three short exposures, the third of two dozen instants."""
    return tensors(quick_recipe("lsci-slab", exposures=FEW).batch(0, "test", range(16)))


def test_features_are_contrasts_and_what_exposures_share(batch):
    made = network_input(batch, "exposures").numpy()
    assert made.shape == (16, 9)
    for row, stack in zip(made, batch["stack"].numpy().astype(np.float64), strict=True):
        matrix = np.cov([image.ravel() / image.mean() for image in stack])
        np.testing.assert_allclose(row[:3], np.log10(np.diag(matrix)), atol=1e-5)
        logs = [np.log(np.maximum(image / image.mean(), 1e-3)).mean() for image in stack]
        np.testing.assert_allclose(row[3:6], logs, atol=1e-5)
        np.testing.assert_allclose(row[6:], matrix[np.triu_indices(3, 1)], atol=1e-5)
    told = batch["parameters"]
    measured = exposures.shared_contrast(batch).numpy()
    drawn = np.stack([told[f"contrast_squared_{n}"] for n in range(3)], -1)
    # An image's own mean takes off as much of K^2 as it varies itself, a thousandth.
    assert_mean(np.diagonal(measured, axis1=1, axis2=2) / drawn, 1.0, slack=0.005)
    assert_mean(measured[:, 0, 2] / told["static_share"].numpy() ** 2, 1.0, slack=0.005)
    refute_mean(measured[:, 0, 2] / told["static_share"].numpy(), 1.0, slack=0.005)


def test_a_cameras_noise_is_taken_off():
    """Read where grains are wide, stated where they are small: K^2 of counts is that of many photons."""
    camera, many = {"photons": 20.0, "read_noise": 3.0}, {"photons": 1000.0}
    for grain, stated in ((4.0, False), (2.0, True)):
        short = FEW | {"durations": FEW["durations"][:2]}
        wide = {"exposures": short, "camera": {"shape": [64, 64], "pixels_per_grain": grain}}
        light = tensors(quick_recipe("lsci-slab", **wide, exposure=many).batch(0, "test", range(4)))
        counts = quick_recipe("lsci-slab", **wide, exposure=camera)
        seen = tensors(counts.batch(0, "test", range(4)))
        expected = exposures.shared_contrast(light).diagonal(dim1=-2, dim2=-1)
        found = exposures.shared_contrast(seen, counts.exposure if stated else "none").diagonal(dim1=-2, dim2=-1)
        raw = seen["stack"].double().var((-2, -1)) / seen["stack"].double().mean((-2, -1)).square()
        # The product of noise and light leaves .013 of a K^2 (2 sqrt(E[(I - 1)^2 (I / 20 + 9 / 400)]) / 64), .005 of 8.
        assert float((found - expected).mean()) == pytest.approx(0, abs=0.025)
        assert float((raw - expected).mean()) > 0.04


def test_numbers_come_back_in_their_units(batch):
    told = in_units(numbers_of(batch, MOTION).double(), MOTION)
    np.testing.assert_allclose(told, batch["target"], atol=1e-5)
    with pytest.raises(RuleError, match="batch tau0 must be a finite number for every medium.*media at rest no tau0"):
        numbers_of({"parameters": {"static_share": torch.ones(1)}}, MOTION)


def test_the_closed_inversion_is_right_where_its_model_is():
    """Images of exactly the model's contrasts: shares to the digit, times over one factor for all."""
    recipe = quick_recipe("lsci-slab", exposures=FEW)
    inversion = closed_inversion(recipe, media=2)
    trained = tensors(recipe.batch(0, "train", range(2)))
    # The median of two factors is their mean.
    assert inversion(trained)[:, 0].mean() == pytest.approx(float(trained["target"][:, 0].mean()), abs=1e-6)

    times, shares = np.array([3e-4, 1e-3, 4e-3]), np.array([0.9, 0.6, 0.8])
    squared = np.array(
        [
            exponential_contrast_squared(FEW["durations"], time, dynamic_share=share)
            for time, share in zip(times, shares, strict=True)
        ]
    )
    noise = np.random.default_rng(0).standard_normal((64, 64))
    noise = (noise - noise.mean()) / noise.std(ddof=1)
    made = dict(trained, stack=torch.from_numpy(1 + np.sqrt(squared)[..., None, None] * noise))
    made["parameters"] = {name: value[:1].expand(3) for name, value in trained["parameters"].items()}
    told = inversion(made)
    np.testing.assert_allclose(told[:, 1], 1 - shares, atol=1e-5)
    np.testing.assert_allclose(np.diff(told[:, 0]), np.diff(np.log10(times)), atol=1e-5)


SMALL = [f"--set={change}" for change in (f"exposures.durations={FEW['durations']}", "exposures.tolerance=0.1",
                                          "material.kernel_paths=1000")]  # fmt: skip
LEARN = ("--target", "motion", "--input", "exposures", "--network", "perceptron")


def run(*words):
    found = CliRunner().invoke(app, [str(word) for word in words])
    assert not found.exception, found.output
    return found.output


def test_motion_is_learned_by_the_command_and_judged_beside_the_closed_inversion(tmp_path, monkeypatch):
    monkeypatch.setattr(closed_inversion, "__defaults__", (0, 4))
    run("train", "lsci-slab", "--out", tmp_path / "run", *LEARN, "--width", 1, "--epochs", 1, "--batch-size", 16,
        "--validation-samples", 8, "--set=samples.train=16", *SMALL)  # fmt: skip
    asked = ("evaluate", tmp_path / "run/best.pt", "--samples", 8, "--out", tmp_path / "judged", *SMALL)
    rows = json.loads(run(*asked, "--json"))
    assert [(row["method"], row["number"]) for row in rows] == [
        (method, number) for method in ("network", "closed inversion") for number in MOTION
    ]
    table = (tmp_path / "judged/summary.md").read_text()
    assert "| closed inversion | static_share |" in table
    assert "| network | log10 tau0 |" in table
    columns = (tmp_path / "judged/stacks.csv").read_text().splitlines()[0].split(",")
    assert columns[2:] == [f"{name} {who}" for who in ("told", "by closed inversion", "true") for name in MOTION]


@pytest.mark.slow
def test_media_never_seen_are_told_within_a_twentieth_of_their_variance(tmp_path):
    """Five CPU minutes: train and judge as in docs/notes/motion.md; R^2 of log10 tau0 was 0.961."""
    for split, samples in (("train", 1024), ("validation", 128)):
        run("generate", "lsci-slab", "--split", split, "--samples", samples, "--out", tmp_path / f"{split}.zarr")
    stores = tmp_path / "train.zarr", "--validation", tmp_path / "validation.zarr"
    run("train", *stores, "--out", tmp_path / "run", *LEARN, "--width", 4, "--epochs", 60)
    judged = run("evaluate", tmp_path / "run/best.pt", "--samples", 256, "--out", tmp_path / "judged", "--json")
    rows = json.loads(judged)
    found = {(row["method"], row["number"]): row["mean"] for row in rows}
    assert found["network", "tau0"] >= 0.95
    assert found["network", "static_share"] >= 0.98
    assert all(found["network", name] > found["closed inversion", name] + 0.3 for name in MOTION)


def test_others_are_scored_as_the_network_is():
    true = np.random.default_rng(0).standard_normal((50, 2))
    noisy = true + 0.5 * np.random.default_rng(1).standard_normal((50, 2))
    found = Regression(true, true, np.arange(50), MOTION, {"other": noisy})
    rows = {(row["method"], row["number"]): row["mean"] for row in found.rows()}
    assert rows["network", "tau0"] == 1
    expected = 1 - np.square(noisy - true).mean(0) / true.var(0)
    np.testing.assert_allclose([rows["other", name] for name in MOTION], expected)
