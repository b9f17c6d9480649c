"""The verdict after the image: benches, and what is said where an image fails."""

import numpy as np
import pytest
import torch

from specklegen.core.errors import RuleError
from specklegen.datasets import load_recipe
from specklegen.models.learning.solver import load_solver
from specklegen.models.likelihood.likelihood import SpeckleLikelihood
from specklegen.models.likelihood.periodogram import periodogram
from specklegen.models.recoverability.after_image import bench_of, see_through
from specklegen.models.retrieval.autocorrelation import envelope

SLAB = {"material": {"thickness": 1000.0, "optical_depth": 10.0, "g": 0.9}}


def test_a_bench_is_what_the_recipe_says():
    recipe = load_recipe("one-angular-size", SLAB)
    bench = bench_of(recipe)
    seen = recipe.geometry
    assert bench.known
    assert bench.optics.grain == pytest.approx(3.0)
    assert bench.optics.step == pytest.approx(recipe.field.pitch / seen.grid.pitch)
    half = bench.range_sine / bench.pitch  # in object pixels
    assert bench.memory_effect(np.array([half]))[0] == pytest.approx(0.5, abs=0.01)


def test_a_slab_in_ranges_is_the_middle_one():
    recipe = load_recipe("one-angular-size")
    bench = bench_of(recipe)
    ranges = [recipe.material_of(0, "train", n).half_range for n in range(15)]
    assert not bench.known
    assert bench.range_sine == pytest.approx(np.median(ranges) * recipe.wavelength / (2 * np.pi))


def test_an_open_bench_is_refused():
    with pytest.raises(RuleError, match=r"bench window\.width must be a length"):
        bench_of(load_recipe("unknown-slab"))
    with pytest.raises(RuleError, match="bench field must be given by its pitch"):
        bench_of(load_recipe("one-angular-size", {"field": {"pitch": None, "extent_over_range": 1.0}}))


def test_an_image_that_no_object_explains():
    """Divided by a mean over two pixels: no object that shines is darkest at the lowest frequencies.

    Its deviance exceeds the expected one by more than five spreads, as is asked of a bench to be doubted; that of the
    image as it was does not.
    """
    recipe = load_recipe("one-angular-size", SLAB)
    image = torch.from_numpy(recipe.sample(0, "test", 0)["image"]).double()
    both = torch.stack([image / envelope(image, 2.0), image])[:, None]
    found = see_through(both, recipe, solver=load_solver())
    assert found.fit is None
    one, unspoilt = found.each
    frequencies = SpeckleLikelihood(periodogram(both), (36, 36), bench_of(recipe).optics).frequencies
    spread = float(((np.pi**2 / 6 - 1) / frequencies[0]).sqrt())
    assert one.deviance > one.expected + 5 * spread
    assert unspoilt.deviance < unspoilt.expected + 5 * spread
    assert one.probability >= 0.5 or one.reasons[-1].name == "the bench is not what it is said to be"


def test_shapes_are_checked():
    with pytest.raises(RuleError, match="of shape"):
        see_through(torch.ones(64, 64), load_recipe("one-angular-size", SLAB))
