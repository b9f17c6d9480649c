"""The posterior: its net against simpler estimators, draws against their measurement, weights by hand."""

import numpy as np
import pytest
import torch
from refusals import assert_refused

from specklegen.datasets.objects import Glyphs
from specklegen.models import load_solver
from specklegen.models.learning import solver as solver_module
from specklegen.models.learning.feedback import Measured
from specklegen.models.learning.posterior import (
    SOLVED,
    drawn,
    generator_of,
    load_prior,
    posterior,
    read_prior,
    starts_of,
    surprise,
    weighed,
)
from specklegen.models.learning.solver import Solution, restarted
from specklegen.models.likelihood.likelihood import Optics, SpeckleLikelihood
from specklegen.models.likelihood.periodogram import Periodogram, periodogram
from specklegen.models.metrics import align, pearson

FRAME, PAD = 36, (4, 4, 4, 4)
HELD_OUT = {"disjoint": "character", "test": "569BFMTVWt", "validation": "2KPbq"}


def letters(count):
    """Characters that no training saw, float[count, 36, 36]."""
    family = Glyphs(shape=(28, 28), **HELD_OUT)
    return torch.nn.functional.pad(
        torch.from_numpy(np.stack([family.image(3, "test", n) for n in range(count)])).float(), PAD
    )


def measured_of(objects, looks=12.0, seed=0):
    """Measurements drawn from their law, of objects within the memory effect."""
    blank = Periodogram(torch.ones(len(objects), 96, 49), torch.zeros(len(objects)), looks, (96, 96))
    layout = SpeckleLikelihood(blank, (FRAME, FRAME), Optics(1.5, 3.0))
    spectrum = layout.object_spectrum(objects)
    gamma = np.random.default_rng(seed).standard_gamma(looks, tuple(spectrum.shape[1:])) / looks
    seen = layout.seeing(spectrum * torch.from_numpy(gamma).float(), torch.zeros(len(objects)), looks)
    ones = [torch.ones(len(objects), side, side) for side in (2 * FRAME - 1, 64)]
    return Measured.of(seen, *ones)


@pytest.fixture(scope="module")
def net():
    return load_prior()


def test_a_picture_without_noise_is_left_as_it_is(net):
    pictures = 2 * letters(2) - 1
    assert torch.allclose(net(pictures, torch.ones(2)), pictures, atol=1e-5)


@pytest.mark.parametrize(("level", "share"), [(0.3, 0.75), (0.5, 0.5), (0.7, 0.5)])
def test_characters_that_it_never_saw_lose_their_noise_better_than_by_wiener(net, level, share):
    """The best linear filter knows these very pictures' mean and spectrum; the net has to leave half of its error.
    Where nearly all is noise there is little to know, and three quarters are enough."""
    pictures = 2 * letters(24) - 1
    noisy = level * pictures + (1 - level) * torch.randn(pictures.shape, generator=torch.Generator().manual_seed(1))
    found = (net(noisy, torch.full((24,), level)) - pictures).square().mean()
    mean = pictures.mean(0)
    power = torch.fft.rfft2(pictures - mean).abs().square().mean(0) / FRAME**2
    gain = level * power / (level**2 * power + (1 - level) ** 2)
    linear = mean + torch.fft.irfft2(torch.fft.rfft2(noisy - level * mean) * gain, s=(FRAME, FRAME))
    assert found < share * (linear - pictures).square().mean()


def test_pictures_are_more_probable_than_their_pixels_in_another_order(net):
    pictures = letters(6)
    order = torch.randperm(FRAME**2, generator=torch.Generator().manual_seed(0))
    both = torch.stack([pictures, pictures.flatten(1)[:, order].reshape(pictures.shape)], dim=1)
    nats = surprise(net, both, generator_of(0))
    assert (nats[:, 1] > 2 * nats[:, 0]).all()


def test_draws_from_noise_explain_what_was_measured_and_nothing_else(net):
    """Without any first answer. Of seven objects all draws must explain their own measurement better than others do.
    That happens by chance in one case of 2^7."""
    objects = letters(7)
    hints = measured_of(objects)
    draws = drawn(net, hints, torch.zeros(7, 1, FRAME, FRAME), torch.zeros(1), generator_of(1), steps=10)
    own, other = (
        (hints.likelihood.excess(each.clamp_min(1e-3), hints.between[:, None])[:, 0] / hints.likelihood.spread)
        for each in (draws, draws.roll(1, 0))
    )
    assert (own < other).all()
    right, wrong = (pearson(align(draws[:, 0], each), each).mean() for each in (objects, objects.roll(1, 0)))
    assert right > wrong


def test_weights_are_those_of_the_nats():
    pictures = torch.rand(1, 2, FRAME, FRAME, generator=torch.Generator().manual_seed(2))
    pictures[:, 1] = pictures[:, 0].flip((-2, -1)).roll((2, 3), (-2, -1))  # one picture, moved
    nats = torch.tensor([[np.log(3.0), 0.0]], dtype=torch.float32)
    found = weighed(pictures, nats, torch.zeros(1, 2), factors=(1.0, 1.0))
    assert found.weights[0].tolist() == pytest.approx([0.75, 0.25])
    assert torch.equal(found.best, pictures[:, 1])
    assert torch.allclose(found.mean, found.best, atol=1e-6)
    assert torch.allclose(found.certain, torch.ones_like(found.certain), atol=1e-5)
    assert float(found.agreement) == pytest.approx(1.0, abs=1e-5)
    assert found.excess[0].tolist() == pytest.approx([0.0, np.log(3.0)])


def test_what_half_of_the_draws_call_dark_is_not_certain():
    dark, bright = torch.zeros(1, FRAME, FRAME), torch.zeros(1, FRAME, FRAME)
    dark[:, 10:20, 10:13], bright[:, 10:20, 10:13] = 1, 1
    bright[:, 10:13, 13:20] = 1
    found = weighed(torch.stack([dark, bright], 1), torch.zeros(1, 2), torch.zeros(1, 2))
    assert float(found.certain.min()) == pytest.approx(0.0, abs=1e-6)
    assert found.agreement < 1


def test_draws_are_a_function_of_the_seed_whatever_their_companions(net):
    objects = letters(2)
    likelihood, between = measured_of(objects)[:2]
    at_lags = torch.ones(2, 64, 64)

    def found(count, seed):
        first = slice(count)
        one = likelihood.select(first), between[first], at_lags[first], objects[first]
        return posterior(net, *one, objects[first, None].expand(-1, 2, -1, -1), 2, seed)

    one, other, again = found(2, 5), found(1, 5), found(1, 6)
    assert torch.equal(one.draws[:1], other.draws)
    drawn_alone = (other.weights[..., None, None] * other.draws).sum(1)
    assert torch.allclose(other.mean, (1 - SOLVED) * drawn_alone + SOLVED * align(objects[:1], other.best), atol=1e-5)
    assert not torch.allclose(again.draws, other.draws, atol=2e-2)


def seen_on(side):
    """What the solver takes of two characters that no training saw, three pixels a grain, no memory-effect limit."""
    rng, canvas = np.random.default_rng(4), side + 48
    waves = np.zeros((2, canvas, canvas), complex)
    lit = canvas // 3
    waves[:, :lit, :lit] = rng.normal(size=(2, lit, lit, 2)).view(complex)[..., 0]
    light = np.fft.fft2(np.square(np.abs(np.fft.fft2(waves))))
    images = np.fft.ifft2(light * np.fft.fft2(letters(2).numpy(), (canvas, canvas))).real[:, None]
    no_end = [lambda distance: np.ones_like(distance)] * 2
    cut = slice(40, 40 + side)  # clear of the rim, where the convolution wraps
    return periodogram(torch.from_numpy(images[..., cut, cut]).float()), Optics(1.0, 3.0), no_end


@pytest.fixture(scope="module")
def seen():
    return seen_on(64)


@pytest.mark.slow
def test_draws_begin_at_images_that_are_given(seen):
    """Of draws that begin at the objects the best is nearer to them than of draws that begin at one another's."""
    objects, solver = letters(2), load_solver()
    solved = solver.solve(*seen)

    def nearest(first):
        draws = solver.posterior(*seen, draws=4, solved=solved, first=first[:, None]).draws
        truth = objects[:, None].expand_as(draws)
        return pearson(align(draws, truth), truth).amax(1)

    right, wrong = nearest(objects), nearest(objects.flip(0))
    assert (right > wrong).all()
    assert right.min() > 0.8


def test_draws_begin_at_the_image_of_many_restarts():
    seen, objects, solver = seen_on(128), letters(2), load_solver()
    _, likelihood, _, at_lags = solver._measured("posterior", *seen)
    image = restarted(likelihood, at_lags, 36)
    assert (pearson(align(image[:, 0], objects), objects) > 0.7).all()  # 0.85, 0.79; with one another 0.47
    solved = solver.solve(*seen)
    one, other = (solver.posterior(*seen, draws=4, solved=solved, first=first) for first in (None, image.clamp_min(0)))
    assert torch.equal(one.draws, other.draws)


def test_two_draws_need_no_phase_retrieval(monkeypatch):
    """One begins at noise, the other at the solver's image; of four draws one begins at phase retrieval's."""
    seen, solver, none = seen_on(64), load_solver(), torch.zeros(2)
    solved, begun = Solution(letters(2), letters(2), none, none, none, none, none), torch.ones(2, 1, FRAME, FRAME)
    monkeypatch.setattr(solver_module, "restarted", lambda *_: begun)
    monkeypatch.setattr(solver_module, "posterior", lambda *arguments: arguments[5])
    few, more = (solver.posterior(*seen, draws=count, solved=solved) for count in (3, 4))
    assert torch.equal(few, solved.image[:, None])
    assert more is begun
    measured = measured_of(letters(2))
    starts = {count: [starts_of(measured, letters(2), x, count)[0] for x in (begun, few)] for count in (3, 4)}
    assert torch.equal(*starts[3])
    assert not torch.equal(*starts[4])


@pytest.mark.parametrize("first", [torch.ones(2, 36, 36), torch.ones(1, 1, 36, 36), torch.zeros(2, 1, 36, 36), "mean"])
def test_first_images_are_one_for_each_object_and_bright(seen, first):
    assert_refused(lambda: load_solver().posterior(*seen, first=first), "posterior first must be")


def test_a_file_of_something_else_is_refused(tmp_path):
    from specklegen.models.learning.model_file import write_model

    write_model(tmp_path / "other.pt", {"name": "flow", "frame": 36}, {})
    assert_refused(lambda: read_prior(tmp_path / "other.pt"), "prior must be a file written by train_prior.py")
