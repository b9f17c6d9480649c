"""The physics and the generator of deepinv, judged by deepinv itself.

torchvision, which deepinv loads for its data sets, is stood in for where it is missing: neither base class uses it.
"""

import importlib
import importlib.machinery
import importlib.util
import sys
import types

import pytest
import torch
from test_docs import blocks

from specklegen.core.errors import RuleError
from specklegen.datasets import load_recipe

SMALL = {"material": {"kernel_paths": 1000}, "camera": {"shape": [24, 20]}, "media": 4}


class NoTorchvision:
    """Finds torchvision and all in it; every name is an empty class."""

    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] == "torchvision":
            return importlib.machinery.ModuleSpec(name, self, is_package=True)
        return None

    def create_module(self, spec):
        module = types.ModuleType(spec.name)
        module.__path__ = []
        module.__getattr__ = _empty
        return module

    def exec_module(self, module):
        """Nothing is in it."""


def _empty(name: str) -> type:
    if name.startswith("__"):
        raise AttributeError(name)
    return type(name, (), {})


@pytest.fixture(scope="module")
def deepinv():
    """The library; nothing else is to take what stands in for torchvision for the real one."""
    if importlib.util.find_spec("deepinv") is None:
        pytest.skip("needs the extra deepinv")
    if importlib.util.find_spec("torchvision") is None:
        sys.meta_path.append(finder := NoTorchvision())
        try:
            importlib.import_module("deepinv")
        finally:
            sys.meta_path.remove(finder)
            for name in [name for name in sys.modules if name.partition(".")[0] == "torchvision"]:
                del sys.modules[name]
    return importlib.import_module("deepinv")


@pytest.fixture(scope="module")
def recipe():
    return load_recipe("through-slab", SMALL)


@pytest.fixture(scope="module")
def physics(deepinv, recipe):
    from specklegen.datasets.loading.deepinverse import SpecklePhysics

    return SpecklePhysics(recipe, seed=5)


def test_it_sees_what_the_recipe_renders(physics, recipe):
    """Single precision: to 1e-5 of the brightest pixel."""
    samples = [recipe.sample(5, "train", index) for index in range(3)]
    objects = torch.stack([torch.from_numpy(sample["object"]) for sample in samples])
    medium = torch.tensor([recipe.medium_number(index) for index in range(3)])
    images = physics(objects[:, None], medium=medium)
    assert images.shape == (3, 1, 24, 20)
    for image, sample, brightness in zip(images, samples, objects, strict=True):
        expected = torch.from_numpy(sample["image"]) * brightness.mean()
        torch.testing.assert_close(image[0], expected, rtol=0, atol=1e-5 * float(expected.max()))
    others = physics.A(objects[:, None], medium=medium.flip(0))
    assert not torch.allclose(images, others)


def test_its_adjoint_passes_the_test_of_deepinv(physics, monkeypatch):
    torch.manual_seed(0)
    assert float(physics.adjointness_test(num_samples=3)) < 1e-5
    assert float(physics.adjointness_test(num_samples=3, medium=torch.tensor([0, 1, 3]))) < 1e-5
    right = physics.A_adjoint
    monkeypatch.setattr(physics, "A_adjoint", lambda y, **words: right(y, **words) * 1.01)
    assert float(physics.adjointness_test(num_samples=3)) > 1e-3  # a wrong one does not


def test_media_are_drawn_by_the_seed(physics, recipe):
    from specklegen.datasets.loading.deepinverse import MediumGenerator

    generator = MediumGenerator(recipe)
    drawn = generator.step(batch_size=100, seed=3)["medium"]
    assert drawn.dtype == torch.int64
    assert set(drawn.tolist()) == {0, 1, 2, 3}
    assert torch.equal(drawn, generator.step(100, 3)["medium"])
    assert not torch.equal(drawn, generator.step(100, 4)["medium"])
    x = torch.rand((2, 1, 28, 28), generator=torch.Generator().manual_seed(0))
    medium = generator.step(batch_size=2, seed=1)
    torch.testing.assert_close(physics(x, **medium), physics.A(x, medium=medium["medium"]))


def test_deepinv_reconstructs_with_it(deepinv, recipe):
    """A medium that is known: data that least squares explain, noise and gradients as for any other physics."""
    from specklegen.datasets.loading.deepinverse import SpecklePhysics

    known = SpecklePhysics(recipe, seed=5, noise_model=deepinv.physics.GaussianNoise(sigma=1e-3), max_iter=30)
    x = torch.zeros((1, 1, 28, 28))
    x[..., 8:16, 10:14] = 1
    y = known(x)
    found = known.A_dagger(y)
    assert float((known.A(found) - y).norm() / y.norm()) < 0.05
    guess = torch.ones_like(x).requires_grad_()
    deepinv.optim.data_fidelity.L2()(guess, y, known).sum().backward()
    step = guess.detach() - 1e-3 * guess.grad / guess.grad.abs().max()
    assert float((known.A(step) - y).norm()) < float((known.A(guess.detach()) - y).norm())


def test_the_block_of_the_page_runs(deepinv):
    (block,) = [block for block in blocks() if "import deepinv" in block.text]
    made = {"__name__": "__main__"}
    exec(compile(block.text, str(block), "exec"), made)
    assert made["back"].shape == made["x"].shape


@pytest.mark.parametrize(
    ("made", "says"),
    [
        (lambda: load_recipe("tilt-stack"),
         "SpecklePhysics.recipe must be a recipe with hidden objects; got 'TiltStack'"),
        (lambda: load_recipe("through-slab", SMALL | {"sampler": "paths"}), "that the stationary sampler renders"),
        (lambda: load_recipe("ground-glass"), "that the stationary sampler renders"),
    ],
)
def test_what_has_no_such_map_is_refused(deepinv, made, says):
    from specklegen.datasets.loading.deepinverse import SpecklePhysics

    with pytest.raises(RuleError, match=says):
        SpecklePhysics(made()).A(torch.ones((1, 1, 28, 28)))


def test_as_many_media_as_images(physics):
    with pytest.raises(RuleError, match="SpecklePhysics.medium must be one number, or one for each of 2 images"):
        physics.A(torch.ones((2, 1, 28, 28)), medium=torch.tensor([0, 1, 2]))
    physics.A(torch.ones((2, 1, 28, 28)), medium=torch.tensor([0]))
