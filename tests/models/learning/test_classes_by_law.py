"""Classes told by the law of images, against the likelihood asked example by example, and on rendered images."""

import numpy as np
import pytest
import torch
from scipy.special import logsumexp

from specklegen.core.errors import RuleError
from specklegen.datasets import load_recipe
from specklegen.datasets.addresses import Addresses
from specklegen.models import SpeckleLikelihood, memory_effect_between
from specklegen.models.learning.classes import MATERIALS, classes_by_law
from specklegen.models.learning.measurement import measured
from tests.core.test_shielded import CONTEXTS
from tests.refusals import assert_refused

SMALL = {"camera": {"shape": [48, 48]}, "objects": {"shape": [20, 20]}, "field": {"pitch": 5e-6}}


@pytest.fixture(scope="module")
def recipe():
    return load_recipe("characters-of-new-fonts", SMALL)


@pytest.fixture(scope="module")
def batch(recipe):
    return recipe.batch(3, "test", range(60))


def by_hand(recipe, batch, samples, seed, memory_power=1.0):
    """Mean likelihood of every class's examples, each asked of :class:`SpeckleLikelihood` by itself."""
    seen, optics, _ = measured(batch, recipe, taper=0.0)
    materials = [recipe.material.realized(np.random.default_rng([seed, 46, n]), "train") for n in range(MATERIALS)]
    shape = recipe.objects.shape
    memory = [memory_effect_between(m.correlation, recipe.wavelength, recipe.field.pitch, shape) for m in materials]
    one = optics._replace(step=float(optics.step[0]), grain=float(optics.grain[0]))
    likelihood = SpeckleLikelihood(seen, recipe.objects.shape, one)
    objects = recipe.objects.images(Addresses(seed, "train", torch.device("cpu")), range(samples))
    which = np.random.default_rng([seed, 45]).integers(0, MATERIALS, samples)
    labels = [recipe.objects.labels(recipe.objects.source(seed, "train", n))["label"] for n in range(samples)]
    effects = [memory[m] ** memory_power for m in which]
    nats = np.array([
        likelihood.log_likelihood(one[None].expand(len(seen.power), -1, -1), effect).numpy()
        for one, effect in zip(objects, effects, strict=True)
    ])  # fmt: skip
    classes = np.unique(labels)
    return classes, np.array([logsumexp(nats[labels == c], axis=0) - np.log(np.sum(labels == c)) for c in classes]).T


def test_evidence_is_the_mean_likelihood_of_examples(recipe, batch):
    few = {"image": batch["image"][:3], "parameters": {k: v[:3] for k, v in batch["parameters"].items()}}
    found = classes_by_law(few["image"], recipe, samples=90, seed=5)
    classes, expected = by_hand(recipe, few, 90, 5)
    np.testing.assert_array_equal(found.classes, classes)
    seen = found.log_evidence.numpy()
    scale = np.abs(expected - expected.max(1, keepdims=True)).max()
    np.testing.assert_allclose(seen - seen.max(1, keepdims=True), expected - expected.max(1, keepdims=True),
                               atol=1e-4 * scale)  # fmt: skip
    _, other = by_hand(recipe, few, 90, 5, memory_power=1.1)
    assert np.abs((other - other.max(1, keepdims=True)) - (seen - seen.max(1, keepdims=True))).max() > 1e-3 * scale


def test_characters_of_new_fonts_are_named_far_above_chance(recipe, batch):
    """Of 60 images on a small camera: chance names one in 45 rightly, and more than 12 of 60 once in 1e8."""
    label = torch.from_numpy(batch["parameters"]["label"]).long()
    ranked = classes_by_law(batch["image"], recipe, samples=8000).ranked
    assert int((ranked[:, 0] == label).sum()) > 12
    assert torch.equal(ranked.sort(1).values[0], torch.arange(45))


def test_it_is_a_function_of_images_and_seed(recipe, batch):
    one, other, alone = (
        classes_by_law(images, recipe, samples=700, seed=seed)
        for images, seed in ((batch["image"][:4], 1), (batch["image"][:4], 2), (batch["image"][:1], 1))
    )
    assert not torch.equal(one.log_evidence, other.log_evidence)
    np.testing.assert_allclose(one.log_evidence[:1], alone.log_evidence, rtol=1e-5)


@pytest.mark.parametrize("name", ["autocast", "double", "inference", "meta device", "threads"])
def test_what_the_program_has_set_does_not_matter(recipe, batch, name):
    expected = classes_by_law(batch["image"][:3], recipe, samples=200, seed=1).log_evidence
    with CONTEXTS[name]():
        found = classes_by_law(batch["image"][:3], recipe, samples=200, seed=1).log_evidence
    assert found.dtype == torch.float64
    assert found.numpy().tobytes() == expected.numpy().tobytes()


def test_what_it_cannot_answer_is_refused(recipe, batch):
    small = {"camera": {"shape": [48, 48]}, "field": {"pixels": 20.0}, "objects": {"shape": [20, 20]}}
    for images, other, match in (
        (batch["image"][0], recipe, "images must be"),
        (batch["image"][:2, :40], recipe, "images must be"),
        (batch["image"][:2], load_recipe("unknown-slab", small), "one illuminated area"),
        (batch["image"][:2], recipe.replace(objects={"type": "Points", "shape": [20, 20]}),
         "a family with labelled classes"),
    ):  # fmt: skip
        with pytest.raises(RuleError, match=match):
            classes_by_law(images, other, samples=10)
    assert_refused(lambda: classes_by_law(batch["image"][:2], recipe, samples=0), "samples must be")
