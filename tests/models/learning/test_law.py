"""Training samples drawn from the law of images, against rendered images of the same objects behind the same slabs."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from specklegen.datasets import SpeckleStream, load_recipe
from specklegen.datasets.loading.stream import tensors
from specklegen.models import Training, train
from specklegen.models.learning import inputs, law
from specklegen.models.learning.examples import examples, streamed
from specklegen.models.learning.inputs import band, network_input
from specklegen.models.learning.law import ByLaw
from specklegen.models.learning.run import untrained
from specklegen.models.likelihood.likelihood import Optics, SpeckleLikelihood
from specklegen.models.likelihood.periodogram import periodogram
from specklegen.models.metrics import align, pearson
from tests.core.test_shielded import CONTEXTS
from tests.refusals import assert_refused
from tests.zscore import assert_mean, refute_mean

SIDE = 16
SMALL = {"camera": {"shape": [64, 64]}, "objects": {"shape": [SIDE, SIDE]}}
SETUPS = {
    "characters, 0.04 to 3.7 ranges": ("characters-of-new-fonts", {
        "camera": {"shape": [96, 96]}, "objects": {"shape": [SIDE, SIDE]}, "field": {"pitch": 6e-6}}, 320, 1.1),
    "points behind a disc, 1 to 4 ranges": ("points-beyond-range", {
        "camera": {"shape": [96, 96]}, "objects": {"shape": [SIDE, SIDE]}, "field": {"pitch": 6e-6},
        "window": {"profile": "disc"}}, 256, 1.05),
}  # fmt: skip
"""Recipe, changes, how many images, and by how much a range is off that they must tell."""


def wider_range(patch, by):
    """Law of a memory effect that reaches farther."""
    right = law._memory_effects

    def wrong(media):
        return right(replace(media, sight=replace(media.sight, object_pitch=media.sight.object_pitch / by)))

    patch.setattr(law, "_memory_effects", wrong)


def another_window(patch, by):  # noqa: ARG001
    """Law of a window of another shape, as wide."""
    right = law._transforms
    other = {"square": "disc", "disc": "square"}
    patch.setattr(law, "_transforms", lambda *a: right(*a[:4], other[a[4]], a[5]))


def wider_window(patch, by):  # noqa: ARG001
    """Law of grains 5 % smaller."""
    right = law.transforms
    patch.setattr(law, "_transforms", law._transforms.__wrapped__)
    patch.setattr(law, "transforms", lambda *a: right(*a[:5], a[5] / 1.05, *a[6:]))


ERRORS = {each.__name__: each for each in (wider_range, another_window, wider_window)}


class Certain:
    """A generator that draws what is expected."""

    def standard_exponential(self, shape, dtype):
        return np.ones(shape, dtype)


def half_of(lags):
    """Of lags shorter than the object one of two opposite ones, without the zero lag: float64[n, lags]."""
    some = lags[:, 32 - SIDE + 1 : 32 + SIDE, 32 - SIDE + 1 : 32 + SIDE].flatten(1).double().numpy()
    return some[:, some.shape[1] // 2 + 1 :]


def seen(module, make):
    """What a function makes, and the periodograms float64[n, frequencies] that it asks :func:`banded_lags` about."""
    powers, right = [], module.banded_lags

    def recorded(power, shape, grain, step, taper=0.0):
        assert taper == 0  # of an even light, which the law has
        rows, columns = band(shape, grain)
        powers.append(power[(columns > 0) | (rows > 0)[:, None]].double().numpy())
        return right(power, shape, grain, step)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(module, "banded_lags", recorded)
        patch.setattr(inputs, "taper_of", lambda images: torch.zeros(len(images)))
        return make(), np.stack(powers)


def by_law(recipe, count, error=None, certain=False, by=1.0):
    """Lags float64[n, lags] and periodograms float64[n, frequencies] that a law draws, or expects."""
    with pytest.MonkeyPatch.context() as patch:
        if error is not None:
            error(patch, by)
        if certain:
            patch.setattr(law, "generator", lambda words: Certain())
        batch, powers = seen(law, lambda: ByLaw(recipe).batch(1, "train", range(count)))
    return half_of(torch.from_numpy(batch["lags"])), powers


@pytest.fixture(scope="module", params=[name if "characters" in name else pytest.param(name, marks=pytest.mark.slow)
                                        for name in SETUPS])  # fmt: skip
def setup(request):
    """What is rendered, and what the right law and wrong ones expect and draw: lags and periodograms."""
    name, changes, count, by = SETUPS[request.param]
    recipe = load_recipe(name, changes)
    rendered = tensors(recipe.batch(1, "train", range(count)))
    pictures, powers = seen(inputs, lambda: network_input(rendered, "periodogram"))
    expected = {None: by_law(recipe, count, certain=True)}
    expected |= {name: by_law(recipe, count, error, certain=True, by=by) for name, error in ERRORS.items()}
    return (half_of(pictures[:, 0]), powers), by_law(recipe, count), expected


def score(powers, expected, other):
    """Sums over frequencies of (I / S - 1) w, with w = S' / S - 1 less its mean: of mean 0 where I has the mean S. To
    first order the derivative of the log-likelihood from S towards S', of any brightness; float64[n]."""
    weight = np.minimum(other / expected - 1, 1)  # far off, a few would outweigh the rest
    return ((powers / expected - 1) * (weight - weight.mean(1, keepdims=True))).sum(1)


@pytest.mark.slow
def test_drawn_inputs_are_distributed_as_rendered_ones(setup):
    """Means, variances, covariances of lags: object and slab of a number are the same, so differences have mean 0."""
    (rendered, _), (drawn, _), laws = setup
    expected, _ = laws[None]
    assert_mean(rendered - drawn, 0)
    one, other = rendered - expected, drawn - expected
    assert_mean(np.square(one) - np.square(other), 0)
    assert_mean((np.square(one) - np.square(other)).sum(1), 0)
    left, right = np.random.default_rng(0).integers(one.shape[1], size=(2, 300))
    assert_mean(one[:, left] * one[:, right] - other[:, left] * other[:, right], 0)


def test_a_wider_scatter_is_caught(setup):
    """Images of two thirds of the pixels, whose lags have half as much variance again."""
    (rendered, _), (drawn, _), laws = setup
    expected, _ = laws[None]
    one, other = rendered - expected, (drawn - expected) * 1.5**0.5
    refute_mean((np.square(one) - np.square(other)).sum(1), 0)


@pytest.mark.parametrize("error", ERRORS)
def test_periodograms_have_the_mean_that_is_drawn_about(setup, error):
    """And a small error of the law is caught: the range 5 or 10 % off, grains 5 % smaller, another window."""
    (_, powers), _, laws = setup
    (_, right), (_, wrong) = laws[None], laws[error]
    assert_mean(score(powers, right, wrong), 0)
    refute_mean(score(powers, wrong, right), 0)


@pytest.fixture(scope="module")
def small():
    return load_recipe("characters-of-new-fonts", SMALL)


def test_expected_lags_are_those_of_the_likelihood(small):
    """Deterministic: S of the likelihood, through its own way to lags; both in single precision."""
    batch = ByLaw(small).batch(4, "train", range(3))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(law, "generator", lambda words: Certain())
        found = ByLaw(small).batch(4, "train", range(3))["lags"]
    drawn = batch["parameters"]
    memory = []
    rows = np.arange(1 - SIDE, SIDE)
    for n in range(3):
        q = 2 * np.pi / drawn["wavelength"][n] * drawn["object_pitch"][n] * np.hypot(rows[:, None], rows)
        memory.append(small.material_of(4, "train", n).correlation(q) ** 2)
    grain = drawn["wavelength"] / drawn["width"] / drawn["camera_pitch"]
    step = drawn["object_pitch"] / drawn["camera_pitch"]
    optics = Optics(torch.tensor(step).float(), torch.tensor(grain).float())
    one = SpeckleLikelihood(periodogram(torch.rand(3, 1, 64, 64)), (SIDE, SIDE), optics)
    spectrum = one.object_spectrum(torch.from_numpy(batch["object"]), torch.from_numpy(np.stack(memory)))
    lags = one.seeing(spectrum, one.noise * 0, 1.0).lags(64)
    lags = torch.fft.fftshift(lags / lags[:, :1, :1], dim=(1, 2))
    np.testing.assert_allclose(found, lags, atol=2e-4)  # the atlas, looked up in two ways, and its interpolation


def test_samples_are_pure_functions_of_their_number(small):
    drawn = ByLaw(small)
    batch = drawn.batch(2, "test", [7, 3, 7])
    alone = drawn.sample(2, "test", 7)
    np.testing.assert_array_equal(batch["lags"][0], batch["lags"][2])
    np.testing.assert_array_equal(batch["lags"][0], alone["lags"])
    rendered = small.sample(2, "test", 7)
    np.testing.assert_array_equal(alone["object"], rendered["object"])
    assert {name: rendered["parameters"][name] for name in alone["parameters"]} == alone["parameters"]
    for other in (drawn.sample(3, "test", 7), drawn.sample(2, "train", 7), drawn.sample(2, "test", 8)):
        assert not np.array_equal(other["lags"], alone["lags"])
    assert drawn.fingerprint() != small.fingerprint()
    assert {name: spec.shape for name, spec in drawn.layout().items() if name in batch} == {
        "lags": alone["lags"].shape, "object": alone["object"].shape, "parameters": ()
    }  # fmt: skip


def test_companions_and_workers_change_nothing(small):
    grouped = ByLaw(small.replace(media_group=3))
    stream = SpeckleStream(grouped, seed=5, batch_size=8)
    here, there = next(iter(stream.loader())), next(iter(stream.loader(num_workers=1)))
    assert torch.equal(here["lags"], there["lags"])
    assert all(np.array_equal(here["lags"][n], grouped.sample(5, "train", n)["lags"]) for n in (0, 4, 7))


@pytest.mark.parametrize("name", ["autocast", "double", "inference", "meta device", "threads"])
def test_what_the_program_has_set_does_not_matter(small, name):
    expected = ByLaw(small).batch(0, "train", range(2))["lags"]
    with CONTEXTS[name]():
        found = ByLaw(small).batch(0, "train", range(2))["lags"]
    assert found.tobytes() == expected.tobytes()


def test_a_network_learns_from_the_law_alone(small, tmp_path):
    """Twenty steps, judged on rendered images of other fonts and slabs beside the untrained network."""
    stream = SpeckleStream(ByLaw(small.replace(media_group=8, samples={"train": 1280})), batch_size=64)
    judged = examples(small, "periodogram", 64, seed=1, split="validation")
    settings = Training(input="periodogram", network="residual", width=4, epochs=1, learning_rate=1e-3)
    scores, trained = [], train(settings, streamed(stream, "periodogram"), judged, tmp_path)
    for model in (untrained(settings, judged, "cpu"), trained):
        with torch.no_grad():
            made = torch.sigmoid(model.network(judged.inputs.float()))
        scores.append(pearson(align(made, judged.targets), judged.targets).double().numpy())
    refute_mean(scores[1] - scores[0], 0)
    assert scores[1].mean() > scores[0].mean()


@pytest.mark.parametrize(("name", "changes", "message"), [
    ("registered-tilts", {}, r"ByLaw\.recipe must be of kind .*Render other kinds"),
    ("dynamic-slab", {}, r"ByLaw\.recipe must be of kind"),
    ("through-slab", {"exposure": {"photons": 10.0}}, r"exposure must be left out"),
    ("through-slab", {"light": {"bandwidth": 1e-3}}, r"bandwidth must be 0"),
    ("through-slab", {"window": {"profile": "gaussian"}}, r"profile must be square or disc"),
    ("through-slab", {"sampler": "convolution"}, r"sampler must be stationary for all"),
])  # fmt: skip
def test_what_has_no_law_is_refused(name, changes, message):
    assert_refused(lambda: ByLaw(load_recipe(name, changes)), message)
