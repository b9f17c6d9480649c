"""The main job end to end: the packaged recipes through real data loaders and a real store."""

import hashlib

import numpy as np
import pytest
import torch
from zscore import assert_z, limit, refute_z

from specklegen.datasets import SpeckleCache, SpeckleStream, load_recipe
from specklegen.datasets.store.generate import generate

SMALL = {
    "through-slab": {
        "material": {"kernel_paths": 2000}, "camera": {"shape": [32, 32]}, "samples": {"train": 24}, "media": 5,
    },
    "tilt-stack": {"material": {"kernel_paths": 1000}, "camera": {"shape": [16, 16]}, "samples": {"train": 12}},
}  # fmt: skip
TIMEOUT = 240  # seconds for a batch; a hung worker fails instead of hanging the run


def digests(batches) -> dict[str, str]:
    """SHA-256 over every array of all batches, by name, parameters included."""
    total = {}
    for batch in batches:
        for key, part in (batch | batch.pop("parameters")).items():
            total.setdefault(key, hashlib.sha256()).update(np.ascontiguousarray(part).tobytes())
    return {key: each.hexdigest() for key, each in sorted(total.items())}


@pytest.mark.parametrize("name", SMALL)
def test_any_number_of_workers_yields_the_same_bits(name):
    recipe = load_recipe(name, SMALL[name])
    plain = torch.utils.data.DataLoader(SpeckleStream(recipe, seed=3, split="train", batch_size=4), batch_size=None)
    expected = digests(plain)
    for workers in (0, 1, 2, 3):
        loader = SpeckleStream(recipe, seed=3, split="train", batch_size=4).loader(
            num_workers=workers, timeout=TIMEOUT if workers else 0
        )
        assert digests(loader) == expected, f"{workers} workers"
    assert digests(SpeckleStream(recipe, seed=4, split="train", batch_size=4)) != expected


def test_a_store_holds_what_the_recipe_renders(tmp_path):
    recipe = load_recipe("through-slab", SMALL["through-slab"])
    generate(recipe, 0, "validation", samples=6, folder=tmp_path / "s.zarr", processes=1)
    cache = SpeckleCache(tmp_path / "s.zarr")
    for n in range(6):
        stored, fresh = cache.numpy(n), recipe.sample(0, "validation", n)
        assert np.array_equal(stored["image"], fresh["image"])
        assert np.array_equal(stored["object"], fresh["object"])
        assert stored["parameters"] == fresh["parameters"]


def test_samples_share_media_and_splits_do_not():
    recipe = load_recipe("through-slab", SMALL["through-slab"])
    numbers = [int(recipe.sample(0, "train", index)["parameters"]["medium"]) for index in range(10)]
    assert numbers == [0, 1, 2, 3, 4, 0, 1, 2, 3, 4]
    fields = np.array(
        [
            recipe.prepare(0, split, m).seen.drawn.numpy().ravel()
            for split in ("train", "validation", "test")
            for m in range(5)
        ]
    )
    correlation = np.abs(np.corrcoef(fields))
    np.fill_diagonal(correlation, 0)
    # Independent complex fields of n cells: |correlation|^2 n is exponential; 105 pairs share a rate of 1e-6.
    assert correlation.max() ** 2 * fields.shape[1] < np.log(105 / 1e-6)


def test_images_have_the_contrast_that_their_parameters_promise():
    recipe = load_recipe("through-slab", SMALL["through-slab"] | {"camera": {"shape": [128, 128]}, "media": 64})
    measured, expected = [], []
    for index in range(64):
        sample = recipe.sample(1, "train", index)
        image = sample["image"].astype(np.float64)
        # Relative to the expected intensity, which is 1: the mean over one camera fluctuates too.
        measured.append(np.mean((image - 1) ** 2))
        expected.append(sample["parameters"]["expected_contrast"] ** 2)
    difference = np.array(measured) - np.array(expected)
    z = difference.mean() / (difference.std(ddof=1) / 8)
    assert abs(z) < 5.4  # Student's t, 63 degrees of freedom, false-alarm rate 1e-6
    assert np.mean(expected) > 0.02  # and the test is about something


def test_samples_hold_mean_and_contrast_to_three_in_a_thousand():
    """Of 200 stacks of one tilt, each a medium of its own with 65 000 speckles; errors by their scatter."""
    camera = {"shape": [512, 512], "pixels_per_grain": 2}
    recipe = load_recipe("tilt-stack", {"camera": camera, "tilts": {"count": 1}, "material": {"kernel_paths": 1000}})
    stacks = (recipe.sample(0, "train", n)["stack"].astype(np.float64) for n in range(200))
    means, variances = np.array([[stack.mean(), np.square(stack - 1).mean()] for stack in stacks]).T
    found = np.array([means.mean(), np.sqrt(variances.mean())])
    error = np.array([means.std(ddof=1), variances.std(ddof=1) / 2]) / np.sqrt(200)
    assert_z(found, 1.0, error, degrees=199)
    assert (limit(2, 199) * error < 0.003).all(), error
    for wrong in ([1.005, 1.0], [1.0, 1.005]):
        refute_z(found * wrong, 1.0, error, degrees=199)
