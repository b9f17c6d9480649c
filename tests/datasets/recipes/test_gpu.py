"""The contract on a CUDA device: ``pytest -m gpu``. Skipped where there is none, as on the machines of the checks."""

import numpy as np
import pytest
import torch

from specklegen.datasets import SpeckleStream, load_recipe
from specklegen.datasets.recipes.generator import SpeckleGenerator

pytestmark = [pytest.mark.gpu, pytest.mark.skipif(not torch.cuda.is_available(), reason="needs a CUDA device")]
QUICK = {"material": {"kernel_paths": 20_000}, "media": 8}
RECIPES = {"unknown-slab": {}, "unseen-material": {}, "tilt-stack": {}, "material-regression": {},
           "through-slab": QUICK, "through-slab-lab": QUICK, "two-tilts": QUICK,
           "dynamic-slab": {"material": QUICK["material"]}, "brownian-slab": {"material": QUICK["material"]},
           "partially-coherent-slab": {"material": QUICK["material"]}}  # fmt: skip


def pair(name, **options):
    recipe = load_recipe(name, RECIPES[name])
    return SpeckleGenerator(recipe, 4), SpeckleGenerator(recipe, 4, device="cuda", **options)


@pytest.mark.parametrize("name", RECIPES)
def test_the_device_renders_what_the_cpu_renders(name):
    """Images within 2e-6 (relative l2), parameters within 1e-11, counts within 1 in all but 1e-3 of pixels."""
    here, there = pair(name)
    one, two = here(range(64)), there(range(64))
    for parameter, value in one["parameters"].items():
        np.testing.assert_allclose(two["parameters"][parameter].cpu(), value, rtol=1e-11, err_msg=parameter)
    for key in set(one) - {"parameters"}:
        expected, found = one[key].numpy().astype(float), two[key].cpu().numpy().astype(float)
        assert found.shape == expected.shape
        if one[key].dtype == torch.uint16:
            assert np.abs(found - expected).max() <= 1
            assert (found != expected).mean() < 1e-3
        elif key in ("image", "stack", "frames"):
            axes = tuple(range(1, expected.ndim))
            error = np.sqrt(np.square(found - expected).sum(axes) / np.square(expected).sum(axes))
            assert error.max() < 2e-6
        else:
            np.testing.assert_allclose(found, expected, rtol=1e-6, atol=1e-12)


@pytest.mark.parametrize("name", ["unknown-slab", "through-slab", "dynamic-slab"])
def test_a_thousand_replays_of_graphs(name):
    """With random numbers of samples; memory that a replay should write is spoilt before each."""
    _, plain = pair(name, graphs=False)
    _, there = pair(name)
    there(range(256))
    assert there.report()["graphs"] == f"{len(there.run.kept)} captured"
    key = next(iter(there.recipe.layout()))
    rng, replays = np.random.default_rng(0), 0
    while replays < 1000:
        for found in there.run.kept.values():
            found.result.fill_(torch.nan)
            replays += 1
        some = rng.integers(0, 2**40, 256)
        assert torch.equal(there(some)[key], plain(some)[key])


def test_batches_made_ahead_are_those_of_the_generator():
    """While the program writes over the memory that it let go."""
    recipe = load_recipe("through-slab", RECIPES["through-slab"])
    stream = SpeckleStream(recipe, batch_size=96, device="cuda")
    generator = SpeckleGenerator(recipe, device="cuda")
    for number, batch in zip(range(60), stream, strict=False):
        expected = generator(stream.indices(0, number))["image"]
        assert torch.equal(batch["image"], expected)
        del batch
        torch.full((96, 128, 128), torch.nan, device="cuda").sum()
