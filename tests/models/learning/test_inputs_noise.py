"""Shot noise in what a network sees: taken off the zero lag, and nothing else changed."""

import numpy as np
import pytest
import torch

from specklegen.datasets import load_recipe
from specklegen.datasets.loading.stream import tensors
from specklegen.models.learning import inputs
from specklegen.models.learning.inputs import LAGS, autocorrelation_input, network_input, steps_of


def batches():
    """The same samples without noise, and with 10 photons a pixel."""
    changes = {"media": 4, "samples": {"train": 8}}
    quiet = load_recipe("through-slab", changes)
    noisy = load_recipe("through-slab", changes | {"exposure": {"photons": 10.0, "bit_depth": None}})
    return tensors(quiet.batch(0, "train", range(8))), tensors(noisy.batch(0, "train", range(8)))


def test_without_noise_nothing_changes():
    quiet, _ = batches()
    plain = autocorrelation_input(quiet["image"].float(), steps_of(quiet).float())
    assert torch.equal(network_input(quiet, "autocorrelation"), plain)


@pytest.mark.parametrize("kind", ["autocorrelation", "periodogram"])
def test_behind_a_gaussian_window_no_light_is_taken_for_noise(kind, monkeypatch):
    """To the last bit as if nothing were taken off; read as behind an edge, something would be."""
    recipe = load_recipe("unknown-slab", {"window": {"profile": "gaussian"}, "samples": {"train": 8}})
    batch = tensors(recipe.batch(3, "train", range(8)))
    found = network_input(batch, kind)
    edged = inputs.camera_noise
    monkeypatch.setattr(inputs, "camera_noise", lambda images, grain: edged(images, grain, profile="square"))
    wrong = network_input(batch, kind)
    monkeypatch.setattr(inputs, "noise_of", lambda *words: None)  # noqa: ARG005
    assert torch.equal(found, network_input(batch, kind))
    assert not torch.equal(found, wrong)


def test_shot_noise_is_gone():
    """Beside the peak, where noise of 10 photons halves the lags and more, they are as without it."""
    quiet, noisy = batches()
    clean = network_input(quiet, "autocorrelation")[:, 0]
    found = network_input(noisy, "autocorrelation")[:, 0]
    left = autocorrelation_input(noisy["image"].float(), steps_of(noisy).float())[:, 0]
    middle = slice(LAGS // 2 - 6, LAGS // 2 + 7)
    near = [x[:, middle, middle].mean((1, 2)).numpy() for x in (clean, found, left)]
    assert abs(np.median(near[1] / near[0]) - 1) < 0.15  # spread of a lag over the level, 8 images
    assert np.median(near[2] / near[0]) < 0.7
