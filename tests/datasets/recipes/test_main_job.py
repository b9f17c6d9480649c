"""The main job end to end: the packaged recipes through real data loaders and a real store."""

import numpy as np
from zscore import assert_z, limit, refute_z

from specklegen.datasets import load_recipe

SMALL = {
    "through-slab": {"material": {"kernel_paths": 2000}, "camera": {"shape": [32, 32]}, "samples": {"train": 24},
                     "media": 5},
    "tilt-stack": {"material": {"kernel_paths": 1000}, "camera": {"shape": [16, 16]}, "samples": {"train": 12}},
}  # fmt: skip


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
