"""Maps of contrast: features against sums by hand, windows without bias, the model at each place, and the commands."""

import json

import numpy as np
import pytest
import torch
from quick_recipes import quick_recipe
from refusals import assert_refused
from typer.testing import CliRunner
from zscore import assert_mean, refute_mean

from specklegen.cli.commands import app
from specklegen.core.errors import RuleError
from specklegen.datasets.loading.stream import tensors
from specklegen.models.judging import closed_contrast
from specklegen.models.judging.contrast_maps import MapScores
from specklegen.models.learning.inputs import network_input
from specklegen.models.learning.networks import build
from specklegen.models.learning.targets import TARGETS
from specklegen.theory.speckle_contrast import exponential_contrast_squared

FIXED = {"depth": 150.0, "radius": 80.0, "speed": 1500.0, "angle": 0.0, "offset": 0.0}
TWICE = {"durations": [2e-4, 4e-3]}


def recipe_of(**changes):
    """Cameras of 32 x 32 pixels above one vessel."""
    given = {"vessel": FIXED, "exposures": TWICE, "camera": {"shape": [32, 32]}} | changes
    return quick_recipe("flow-vessel", 4000, **given)


@pytest.fixture(scope="module")
def seen():
    recipe = recipe_of()
    return recipe, tensors(recipe.batch(0, "train", range(16)))


def test_features_are_means_over_blocks(seen):
    _, batch = seen
    made = network_input(batch, "local-contrast").numpy()
    assert made.shape == (16, 7, 8, 8)
    over = batch["stack"][5].numpy().astype(np.float64)
    over = over / over.mean((1, 2), keepdims=True)
    rows, columns = slice(8, 12), slice(20, 24)  # the block (2, 5)
    block = over[:, rows, columns]
    i = block - 1
    expected = [*i.mean((1, 2)), *np.square(i).mean((1, 2)), *np.log(np.maximum(block, 1e-3)).mean((1, 2)),
                (i[0] * i[1]).mean()]  # fmt: skip
    np.testing.assert_allclose(made[5, :, 2, 5], expected, atol=1e-5)


def test_windows_tell_the_contrast_without_bias(seen):
    """Developed speckle of a round pupil, drawn here: K^2 = 1. What few grains take off a window's ratio is told."""
    recipe, _ = seen
    rng, frequency = np.random.default_rng(0), np.fft.fftfreq(64)
    pupil = np.hypot(frequency[:, None], frequency) < 1 / (2 * recipe.camera.pixels_per_grain)
    white = rng.normal(size=(200, 2, 64, 64, 2)) @ [1, 1j]
    stack = np.square(np.abs(np.fft.ifft2(pupil * np.fft.fft2(white))))[..., :32, :32]
    batch = {"stack": torch.from_numpy(stack), "target": torch.from_numpy(stack)}
    found = closed_contrast.window_contrast_squared(batch, recipe, 3).numpy()[:, :, 1:-1, 1:-1]
    # An image's own mean takes off a hundredth, ratios of few grains the rest.
    assert_mean(found.mean((1, 2, 3)), 1.0, slack=0.02)
    windows = np.lib.stride_tricks.sliding_window_view(stack, (12, 12), (2, 3))[..., ::4, ::4, :, :]
    raw = windows.var((-2, -1)) / np.square(windows.mean((-2, -1)))
    refute_mean(raw.mean((1, 2, 3)), 1.0, slack=0.02)


def test_the_model_at_each_place_gives_back_what_it_was_made_of():
    recipe = recipe_of(exposures={"durations": [2e-4, 1e-3, 5e-3]})
    times, shares = np.array([5e-4, 2e-3]), np.array([0.9, 0.6])
    made = np.stack([
        exponential_contrast_squared(recipe.exposures.durations, t, dynamic_share=s)
        for t, s in zip(times, shares, strict=True)
    ]).T[None, :, :, None]  # fmt: skip
    told = closed_contrast._modelled(torch.from_numpy(made), recipe)
    np.testing.assert_allclose(told, made, rtol=1e-4)


def test_a_network_of_any_square_camera(seen):
    _, batch = seen
    rows = TARGETS["contrast"].values(batch)
    assert rows.shape == (16, 64, 32)
    network = build("contrast", 8, (64, 32), 4, 0)
    made = network(network_input(batch, "local-contrast"))
    assert made.shape == rows.shape
    np.testing.assert_array_equal(TARGETS["contrast"].read(rows), batch["target"])
    assert TARGETS["contrast"].score(rows, rows) == 1
    spread = batch["target"].var((0, 2, 3), correction=0)
    assert TARGETS["contrast"].score(rows + 0.1, rows) == pytest.approx(1 - 0.02 / float(spread.sum()), rel=1e-4)
    assert_refused(lambda: build("contrast", 8, (64, 48), 4, 0), "ContrastNet.shape must be of square maps")
    flat = dict(batch, stack=batch["stack"][..., :30, :], target=batch["target"][..., :30, :])
    assert_refused(lambda: network_input(flat, "local-contrast"), "batch stack must be of a square camera")
    with pytest.raises(RuleError, match='batch must be a batch with "stack" and, of its shape, "target"'):
        network_input({"stack": batch["stack"]}, "local-contrast")


def test_scores_are_those_of_all_pixels():
    rng = np.random.default_rng(0)
    true = rng.normal(0.8, 0.1, (40, 2, 8, 8))
    told = true + 0.05 * rng.normal(size=true.shape)
    scores = MapScores({"it": np.square(told - true).mean((2, 3))}, true.mean((2, 3)), np.square(true).mean((2, 3)),
                       np.arange(40))  # fmt: skip
    expected = 1 - np.square(told - true).mean((0, 2, 3)) / true.var((0, 2, 3))
    found = scores.determination("it")
    np.testing.assert_allclose([each.mean for each in found], expected)
    assert all(each.low < each.mean < each.high for each in found)
    assert [row["exposure"] for row in scores.rows()] == [0, 1]


SMALL = [f"--set={change}" for change in ("camera.shape=[32, 32]", "material.kernel_paths=4000",
                                          "exposures.durations=[2e-4, 2e-3]", "exposures.tolerance=0.1",
                                          "vessel.depth=150.0", "vessel.radius=80.0")]  # fmt: skip


def run(*words):
    found = CliRunner().invoke(app, [str(word) for word in words])
    assert not found.exception, found.output
    return found.output


def test_maps_are_learned_by_the_command_and_judged_beside_closed_forms(tmp_path, monkeypatch):
    monkeypatch.setattr(closed_contrast.closed_contrast, "__defaults__", (0, 2))
    monkeypatch.setattr(closed_contrast, "WINDOWS", (3, 5))
    run("train", "flow-vessel", "--out", tmp_path / "run", "--target", "contrast", "--input", "local-contrast",
        "--network", "contrast", "--width", 4, "--epochs", 1, "--batch-size", 8, "--validation-samples", 4,
        "--set=samples.train=8", *SMALL)  # fmt: skip
    judged = json.loads(run("evaluate", tmp_path / "run/best.pt", "--samples", 4, "--out", tmp_path / "out", "--json",
                            *SMALL))  # fmt: skip
    methods = ("network", "sliding window", "closed inversion")
    assert [(row["method"], row["exposure"]) for row in judged] == [(who, n) for who in methods for n in (0, 1)]
    assert "| closed inversion | 1 |" in (tmp_path / "out/summary.md").read_text()
    assert len((tmp_path / "out/maps.csv").read_text().splitlines()) == 5
