"""The contract on a CUDA device: ``pytest -m gpu``. Skipped where there is none, as on the machines of the checks."""

import numpy as np
import pytest
import torch

from specklegen.datasets import SpeckleStream, load_recipe
from specklegen.datasets.batched.generator import SpeckleGenerator

pytestmark = [
    pytest.mark.gpu,
    pytest.mark.skipif(not torch.cuda.is_available(), reason="needs a CUDA device"),
]
QUICK = {"material": {"kernel_paths": 20_000}, "media": 8}
RECIPES = {
    "unknown-slab": {}, "unseen-material": {}, "tilt-stack": {}, "material-regression": {}, "through-slab": QUICK,
    "through-slab-lab": QUICK, "two-tilts": QUICK, "dynamic-slab": {"material": QUICK["material"]},
    "partially-coherent-slab": {"material": QUICK["material"]},
}  # fmt: skip


def pair(name):
    recipe = load_recipe(name, RECIPES[name])
    return SpeckleGenerator(recipe, 4), SpeckleGenerator(recipe, 4, device="cuda")


@pytest.mark.parametrize("name", RECIPES)
def test_the_device_renders_what_the_cpu_renders(name):
    """Images within 2e-6 (relative l2), parameters within 1e-11, counts within 1 in all but 1e-3 of pixels."""
    here, there = pair(name)
    one, two = here(range(64)), there(range(64))
    if hasattr(here, "sizes"):
        assert here.ranks(here.prepare(list(range(64)))[0]) == there.ranks(there.prepare(list(range(64)))[0])
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


@pytest.mark.parametrize("name", ["unknown-slab", "tilt-stack", "through-slab-lab", "dynamic-slab"])
def test_companions_do_not_matter(name):
    """Chunks have one shape, so the images have the same bits in any batch and order, batch after batch."""
    _, there = pair(name)
    key = next(iter(there.recipe.layout()))
    whole = there(range(200))[key].cpu()
    rng = np.random.default_rng(0)
    for _ in range(20):
        some = rng.choice(200, 37, replace=False)
        assert torch.equal(there(some)[key].cpu(), whole[torch.from_numpy(some)])


def test_switches_of_the_program_change_nothing():
    _, there = pair("unknown-slab")
    plain = there(range(32))["image"]
    try:
        torch.set_float32_matmul_precision("medium")
        torch.backends.cuda.matmul.allow_tf32 = True
        with torch.autocast("cuda", dtype=torch.bfloat16):
            assert torch.equal(there(range(32))["image"], plain)
    finally:
        torch.set_float32_matmul_precision("highest")


def test_a_stream_resumes_in_the_middle_of_an_epoch():
    recipe = load_recipe("unknown-slab", {"samples": {"train": 96}})
    whole = SpeckleStream(recipe, batch_size=16, device="cuda").loader()
    batches = [batch["image"].cpu() for batch in whole]
    loader = SpeckleStream(recipe, batch_size=16, device="cuda").loader()
    for number, _ in enumerate(loader):
        if number == 2:
            state = loader.state_dict()
            break
    resumed = SpeckleStream(recipe, batch_size=16, device="cuda").loader()
    resumed.load_state_dict(state)
    for batch, expected in zip(resumed, batches[3:], strict=True):
        assert torch.equal(batch["image"].cpu(), expected)
