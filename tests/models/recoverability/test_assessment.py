"""The verdict after the image: setups, and what is said where an image fails."""

import numpy as np
import pytest
import torch
from refusals import assert_refused

from specklegen.core.errors import RuleError
from specklegen.datasets import load_recipe
from specklegen.models.learning.solver import EVIDENCE, load_solver, silenced, with_third
from specklegen.models.likelihood.likelihood import SpeckleLikelihood
from specklegen.models.likelihood.periodogram import periodogram
from specklegen.models.metrics import alignment, pearson
from specklegen.models.recoverability.assessment import reconstruct, setup_of
from specklegen.models.retrieval.autocorrelation import envelope

SLAB = {"material": {"thickness": 1000.0, "optical_depth": 10.0, "g": 0.9}}


def test_a_bench_is_what_the_recipe_says():
    recipe = load_recipe("one-angular-size", SLAB)
    setup = setup_of(recipe)
    seen = recipe.geometry
    assert setup.known
    assert setup.optics.grain == pytest.approx(3.0)
    assert setup.optics.step == pytest.approx(recipe.field.pitch / seen.grid.pitch)
    half = setup.range_sine / setup.pitch  # in object pixels
    assert setup.memory_effect(np.array([half]))[0] == pytest.approx(0.5, abs=0.01)


def test_a_slab_in_ranges_is_the_middle_one():
    recipe = load_recipe("one-angular-size")
    setup = setup_of(recipe)
    ranges = [recipe.material_of(0, "train", n).half_range for n in range(15)]
    assert not setup.known
    assert setup.range_sine == pytest.approx(np.median(ranges) * recipe.wavelength / (2 * np.pi))


def test_an_open_bench_is_refused():
    assert_refused(lambda: setup_of(load_recipe("unknown-slab")), r"setup window\.width must be a length")
    with pytest.raises(RuleError, match="setup field must be given by its pitch"):
        setup_of(load_recipe("one-angular-size", {"field": {"pitch": None, "extent_over_range": 1.0}}))


def excesses(recipe, frames):
    """Of images real[B, F, H, W] the settled deviance above its expectation, in its spreads for the true object."""
    seen = periodogram(frames)
    count, looks = SpeckleLikelihood(seen, (36, 36), setup_of(recipe).optics).frequencies[0], torch.tensor(seen.looks)
    spread = float(((torch.polygamma(1, looks) - 1 / looks) / count).sqrt())
    each = reconstruct(frames, recipe, fit=False, fast=True).each
    return each, np.array([(one.deviance - one.expected) / spread for one in each])


def test_images_that_no_object_explains():
    """Divided by a mean over two pixels: no object that shines is darkest at the lowest frequencies. Four objects, each
    in four frames, are compared with themselves undivided. The search for the most probable image ends elsewhere for
    every rounding: four spreads of the deviance of four frames away, one of that of single images. So the mean is
    judged. Measured on six: 31 +- 4 (33 +- 2 with torch without AVX) spreads more than undivided; 0 +- 1 above the
    expectation for single images as they are. Five are allowed: five standard errors off, either way."""
    recipe = load_recipe("one-angular-size", SLAB)
    media = [recipe.prepare(0, "test", n) for n in range(4)]
    frames = torch.from_numpy(np.stack([
        [medium.images(recipe.objects.image(0, "test", n))[0] for medium in media] for n in range(4)
    ])).double()  # fmt: skip
    spoilt, divided = excesses(recipe, frames / envelope(frames, 2.0))
    _, whole = excesses(recipe, frames)
    assert (divided - whole).mean() > 5
    assert excesses(recipe, frames[:, :1])[1].mean() < 5
    assert all(one.probability is None and one.reasons[0].name == "no speckle of this setup" for one in spoilt)
    # A mean over so many pixels takes nothing of the object along: neither does the judgement.
    _, evened = excesses(recipe, frames / envelope(frames, 60.0))
    assert abs((evened - whole).mean()) < 5


def test_an_image_that_is_turned_shows_the_object_turned():
    """Lags are those of before, and so is what the solver makes of them: the third order alone can tell. Characters
    within a third of the range, 85 grains a side; the true turn is that of the better correlation, and none that is
    told may be wrong."""
    within = {"field": {"pitch": None, "extent_over_range": 0.3}, "camera": {"shape": [256, 256]}}
    recipe = load_recipe("one-angular-size", SLAB | within)
    batch = recipe.batch(4, "test", range(4))
    images = torch.from_numpy(batch["image"]).double()[:, None]
    pairs = [reconstruct(each, recipe, fast=True).each for each in (images, images.flip((-2, -1)))]
    objects = torch.nn.functional.pad(torch.from_numpy(batch["object"]).float(), (4, 4, 4, 4))
    told = 0
    for both, placed in zip(pairs, (objects, objects.flip((-2, -1))), strict=True):
        for found, shown in zip(both, placed, strict=True):
            assert found.turn is None or found.turn >= 0.9
            if found.turn is not None:
                told += 1
                assert not alignment(torch.from_numpy(found.image.copy()), shown).flipped
    assert told >= 2


def test_no_probability_where_it_is_not_calibrated():
    """With ends of the evidence that leave the image out: no number, a reason that says which, no turn, no crash."""
    recipe, solver = load_recipe("one-angular-size", SLAB), load_solver()
    images = torch.from_numpy(recipe.batch(4, "test", range(1, 3))["image"])[:, None]
    certificate = solver.third
    assert certificate is not None
    assert all(one.probability is not None for one in reconstruct(images, recipe, solver=solver, fast=True).each)
    last = len(EVIDENCE)  # the skewness
    solver.third = certificate._replace(low=(*certificate.low[:last], 50.0, *certificate.low[last + 1 :]),
                                        high=(*certificate.high[:last], 60.0, *certificate.high[last + 1 :]))
    for one in reconstruct(images, recipe, solver=solver, fast=True).each:
        assert one.probability is None
        assert one.turn is None
        assert one.reasons[0].name == "No confidence"
        assert one.reasons[0].numbers.startswith("skewness without the object")
        assert one.reasons[0].numbers.endswith("outside the calibrated range 50 to 60")
        assert "probability" not in one._facts()


def test_shapes_are_checked():
    with pytest.raises(RuleError, match="of shape"):
        reconstruct(torch.ones(64, 64), load_recipe("one-angular-size", SLAB))


def test_no_probability_under_a_taper():
    """A slope of the light, for which the confidence is not calibrated: silent, and the reason says why."""
    recipe = load_recipe("one-angular-size", SLAB)
    images = torch.from_numpy(recipe.batch(4, "test", range(1))["image"])[:, None]
    (found,) = reconstruct(images * torch.linspace(0.7, 1.3, images.shape[-1]), recipe, fast=True).each
    assert found.probability is None
    assert found.reasons[0].name == "No confidence"
    assert found.reasons[0].numbers.startswith("the illumination is uneven")


def test_why_there_is_no_probability_is_said_in_words():
    """Of even light and an object with edges nothing stands in the way; a taper and a patch of light do."""
    evidence = torch.zeros(3, len(EVIDENCE))
    evidence[:, EVIDENCE.index("filled share")] = torch.tensor([0.08, 0.08, 0.2])
    evidence[:, EVIDENCE.index("blur")] = torch.tensor([0.4, 0.4, 0.25])
    even, falling, patch = silenced(evidence, torch.tensor([0.0, 0.25, 0.0]))
    assert not even
    assert falling.startswith("the illumination is uneven, and a taper covers 0.25 of each side")
    assert patch.startswith("the object fills 0.20 of the frame and has hardly an edge (blur 0.25)")


def test_third_order_is_read_beside_the_noise():
    evidence = torch.rand(2, len(EVIDENCE))
    whole = with_third(evidence, torch.tensor([0.5, -2.0]))
    assert torch.equal(whole[:, : len(EVIDENCE)], evidence)
    noise = evidence[:, EVIDENCE.index("noise of a lag (logarithm / 5 + 1.5)")]
    assert torch.allclose(whole[:, len(EVIDENCE) :], torch.stack([torch.tensor([0.5, -2.0]), torch.tensor([0.25, 4.0]),
                                                                  noise * torch.tensor([0.5, -2.0])], dim=1))


def test_the_answer_is_the_mean_of_draws_unless_fast():
    """The mean is moved onto the solver's image, and is another picture."""
    recipe = load_recipe("one-angular-size", SLAB)
    images = torch.from_numpy(recipe.batch(4, "test", range(1, 2))["image"])[:, None]
    (drawn,), (fast,) = (reconstruct(images, recipe, draws=2, fast=fast).each for fast in (False, True))
    assert fast.draws is None
    assert drawn.draws is not None
    assert np.array_equal(drawn.image, drawn.draws.mean[0].numpy())
    assert drawn.probability == fast.probability
    likeness = float(pearson(torch.from_numpy(drawn.image), torch.from_numpy(fast.image)))
    assert 0.8 < likeness < 0.999
