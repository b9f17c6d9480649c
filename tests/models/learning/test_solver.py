"""The unrolled solver: what holds for any weights. How well it does is in docs/notes/networks.md."""

from types import SimpleNamespace

import numpy as np
import pytest
import torch
from refusals import assert_refused
from scipy.stats import binomtest

from specklegen.core.errors import RuleError
from specklegen.datasets import load_recipe
from specklegen.datasets.objects import Glyphs, Points
from specklegen.models.judging.points import share_found
from specklegen.models.learning.measurement import measured, memory_effect_of, seen_by_camera
from specklegen.models.learning.networks.range_net import RangeNet, extents, shares
from specklegen.models.learning.networks.unrolled import Seen, Unrolled, improved, invariant_loss, settled
from specklegen.models.learning.range_fit import SHAPE, fit_range, range_of
from specklegen.models.learning.solver import Solver, load_solver
from specklegen.models.likelihood.certificate import Certificate
from specklegen.models.likelihood.likelihood import Optics, SpeckleLikelihood
from specklegen.models.likelihood.periodogram import Periodogram
from specklegen.models.metrics import align, pearson

SIDE, GRAIN, STEP = 28, 3.0, 1.2
EVIDENCE = 25
BLIND = Certificate((0.0,) * EVIDENCE, (0.0,) * EVIDENCE, (1.0,) * EVIDENCE, 0.0)


def through_slab(ranges):
    """C_I of the slab of through-slab over object pixels, for objects so many ranges wide."""
    known = load_recipe("through-slab").material_of(0, "train", 0)
    return memory_effect_of(known.correlation, 1.0, ranges * known.half_range / (2 * np.pi) / SIDE)


def drawn(count, ranges=1.0, camera=128, profile="square", seed=0):
    """Glyphs, and periodograms of them drawn from their law."""
    objects = torch.from_numpy(np.stack([Glyphs().image(seed, "train", n) for n in range(count)])).double()
    optics = Optics(STEP, GRAIN, profile)
    flat = Periodogram(torch.ones(count, camera, camera // 2 + 1, dtype=torch.float64), torch.zeros(count), 1.0,
                       (camera, camera))  # fmt: skip
    likelihood = SpeckleLikelihood(flat, (SIDE, SIDE), optics)
    steps = np.arange(1 - SIDE, SIDE)
    c_i = torch.from_numpy(through_slab(ranges)(np.hypot(steps[:, None], steps)))
    likelihood.power = likelihood.object_spectrum(objects, c_i) * torch.from_numpy(
        np.random.default_rng(seed).exponential(1.0, likelihood.power.shape)
    )
    reach = likelihood.power.shape[1] // 2
    power = flat.power.clone()
    power[:, np.arange(-reach, reach + 1) % camera, : likelihood.power.shape[2]] = likelihood.power
    return objects, flat._replace(power=power), optics, likelihood, c_i


def small(seed=0):
    torch.manual_seed(seed)
    return Unrolled(width=4, stages=1, units=40, blocks=2)


def test_steps_down_the_deviance_go_down():
    objects, _, _, likelihood, c_i = drawn(3)
    start = torch.rand(objects.shape, generator=torch.Generator().manual_seed(1)) * 0.5 + 0.5 * objects.float()

    def deviance(images):
        return likelihood(images.double(), c_i).float()

    better, gradient, least = improved(start, deviance, steps=3)
    assert (least < deviance(start[:, None])[:, 0]).all()
    assert torch.allclose(least, deviance(better[:, None])[:, 0], atol=1e-5)
    assert torch.allclose(gradient.square().mean((-2, -1)), torch.full((3,), 1 / 16), rtol=1e-4)


def test_settling_goes_down_further():
    objects, _, _, likelihood, c_i = drawn(2)

    def deviance(images):
        return likelihood(images.double(), c_i).float()

    start = torch.stack([0.5 + 0.5 * objects.float(), torch.ones(objects.shape)], dim=1)
    near, found = settled(start, deviance)
    assert (found < deviance(start)).all()
    assert torch.allclose(found, deviance(near), atol=1e-5)
    assert torch.equal(near.amax((-2, -1)), torch.ones(2, 2))


def test_a_mirrored_image_gives_a_mirrored_start():
    """Up to a shift and the turn, for any weights."""
    torch.manual_seed(1)
    lags = torch.rand(3, 2, 64, 64)
    lags = lags + torch.roll(lags.flip((-2, -1)), (1, 1), (-2, -1))  # autocorrelations are even
    network = small()
    for weight in network.dense.last.parameters():
        torch.nn.init.normal_(weight)
    with torch.no_grad():
        one = network.started(Seen(lags, torch.zeros(3, 0, 36, 36), torch.zeros(3, 5)))
        other = network.started(Seen(torch.roll(lags.flip(-2), 1, -2), torch.zeros(3, 0, 36, 36), torch.zeros(3, 5)))
    assert invariant_loss(other.flip(-2), one).abs().max() < 1e-4
    assert invariant_loss(other, one).min() > 0.1


def test_answers_are_moved_together_and_one_by_one():
    objects, _, _, likelihood, c_i = drawn(2)
    network = small()
    answers = torch.rand(2, 4, SIDE, SIDE)
    seen = Seen(torch.rand(2, 2, 64, 64), answers, torch.zeros(2, 5))
    network.frame, network.dense = SIDE, Unrolled(frame=SIDE, width=4, stages=1).dense
    begun = network.candidates(seen, lambda images: likelihood(images.double(), c_i).float())
    assert begun.pictures.shape == (2, 2 + 2 * 4, SIDE, SIDE)
    assert (begun.deviances[:, 1:].diff(dim=1) >= 0).all()
    start, alone = begun.pictures[:, 0], begun.pictures[:, 6:]
    for each in alone.unbind(1):
        assert torch.allclose(invariant_loss(start, each), 1 - pearson(start, each), atol=1e-5)
        assert (each.flatten(1).sort(1).values[:, None] - (answers / answers.amax((-2, -1), keepdim=True)).flatten(2)
                .sort(2).values).abs().amax(2).amin(1).max() < 1e-6  # fmt: skip


@pytest.mark.parametrize(("camera", "profile"), [(96, "square"), (120, "disc")])
def test_any_camera_and_window_and_the_same_bits_again(camera, profile):
    _, seen, optics, _, _ = drawn(2, camera=camera, profile=profile)
    solver, memory = Solver(small(), BLIND, RangeNet(units=8)), [through_slab(1.0)] * 2
    found = solver.solve(seen, optics, memory)
    assert found.image.shape == (2, 36, 36)
    assert ((found.image >= 0) & (found.image <= 1)).all()
    assert torch.isfinite(found.evidence).all()
    assert found.evidence.shape[1] == EVIDENCE
    assert torch.equal(found.probability, torch.full((2,), 0.5))
    again = solver.solve(seen, optics, memory)
    assert torch.equal(found.image, again.image)
    alone = solver.solve(seen.select(slice(1, 2)), optics, memory[1:])
    assert torch.allclose(alone.image[0], found.image[1], atol=1e-3)


def test_the_packaged_solver_puts_points_in_their_places():
    """Three points, one range wide, drawn from the law; a character beside them stays the network's."""
    objects = torch.from_numpy(np.stack([Points(count=3).image(2, "test", 0), Glyphs().image(2, "test", 0)])).float()
    dark = Periodogram(torch.ones(2, 128, 65), torch.zeros(2), 1.0, (128, 128))
    likelihood = SpeckleLikelihood(dark, (SIDE, SIDE), Optics(STEP, GRAIN))
    steps = np.arange(1 - SIDE, SIDE)
    spectrum = likelihood.object_spectrum(objects, torch.from_numpy(through_slab(1.0)(np.hypot(steps[:, None], steps))))
    reach = spectrum.shape[1] // 2
    drawn = spectrum * torch.from_numpy(np.random.default_rng(4).exponential(1.0, spectrum.shape)).float()
    dark.power[:, np.arange(-reach, reach + 1) % 128, : spectrum.shape[2]] = drawn
    found = load_solver().solve(dark, Optics(STEP, GRAIN), [through_slab(1.0)] * 2)
    assert found.points.tolist() == [3, 0]
    whole = torch.nn.functional.pad(objects, (4, 4, 4, 4))
    assert share_found(align(found.image, whole)[0].numpy(), whole[0].numpy()) == 1  # within 1.5 pixels
    assert found.probability[0] > 0.5


def test_one_memory_effect_for_each_image():
    _, seen, optics, _, _ = drawn(2)
    with pytest.raises(RuleError, match="one for each of 2 objects"):
        Solver(small(), BLIND, RangeNet(units=8)).solve(seen, optics, [through_slab(1.0)])


def test_file_holds_all_of_it(tmp_path):
    solver = Solver(small(3), BLIND._replace(constant=1.5), RangeNet(units=8), BLIND)
    solver.save(tmp_path / "one.pt")
    again = Solver.load(tmp_path / "one.pt")
    assert again.certificate == solver.certificate
    assert again.points == BLIND
    for net, read in ((solver.network, again.network), (solver.ranges, again.ranges)):
        for old, new in zip(net.parameters(), read.parameters(), strict=True):
            assert (old - new).abs().max() <= old.abs().max() / 127
    (tmp_path / "one.pt").write_bytes((tmp_path / "one.pt").read_bytes()[:-3] + b"abc")
    assert_refused(lambda: Solver.load(tmp_path / "one.pt"), "as it was written")


def told(extent):
    """A solver whose network reads off every image how wide its object is, in ranges, and how sure it is of that."""

    def ranges(lags, numbers):
        steps = np.log(extents()) - np.log(extent)[:, None]
        return torch.from_numpy(-0.5 * np.square(steps / 0.3)).log_softmax(1)

    return SimpleNamespace(network=small(), ranges=ranges)


@pytest.mark.parametrize("true", [0.7, 1.0, 1.6])
def test_range_is_what_the_images_say_together(true):
    """Objects of several sizes behind one slab, each told with an error of its own; the range is their mean."""
    _, seen, optics, _, _ = drawn(16, 2.5)
    sizes, wrong = np.geomspace(0.5, 2.0, 16), np.random.default_rng(0).normal(0, 0.3, 16)
    memory = [through_slab(size * true) for size in sizes]  # as if the range were 1 / true as long
    fit = fit_range(told(sizes * np.exp(wrong)), seen, optics, memory)  # type: ignore[arg-type]
    # Interpolated linearly between extents a factor 1.19 apart, a parabola of spread 0.3 is moved by less than 0.01.
    assert abs(np.log(fit.factor / true) + wrong.mean()) < 0.01
    assert fit.low < fit.factor < fit.high
    # Sixteen parabolas of spread 0.3, and the shape of C_I; between extents they are straight: 1/6 step squared more.
    step = np.log(extents()[1] / extents()[0])
    assert np.log(fit.high / fit.low) == pytest.approx(
        2 * 1.96 * np.hypot(np.sqrt(0.3**2 + step**2 / 6) / 4, SHAPE), rel=0.05
    )
    low, high = fit.interval(0.68)
    assert fit.low < low < fit.factor < high < fit.high
    assert max(fit.tried.values()) == 0


def test_half_a_memory_effect():
    assert range_of(lambda d: np.exp(-np.log(2) * np.square(np.asarray(d) / 7.0))) == pytest.approx(7.0, rel=1e-4)
    assert_refused(lambda: range_of(lambda d: np.ones(np.shape(d))), "falls to one half")


def test_shares_of_extents():
    """Two neighbours, of sum 1, whose mean is the extent."""
    extent = torch.tensor([0.1, 0.37, 2.9, 6.0])
    found = shares(extent).double()
    assert torch.allclose(found.sum(1), torch.ones(4, dtype=torch.float64), atol=1e-5)
    assert ((found > 0).sum(1) <= 2).all()
    assert np.allclose(np.exp(found.numpy() @ np.log(extents())), extent, rtol=1e-4)


def test_what_a_camera_measures():
    """Noise is read off the image, and agrees with the photons of the recipe."""
    recipe = load_recipe("one-angular-size", {"exposure": {"photons": 20.0, "bit_depth": None}, "media_group": 4})
    seen, optics, memory = measured(recipe.batch(0, "test", range(4)), recipe)
    assert optics.pixel_integration
    assert len(memory) == 4
    assert memory[0](np.zeros(1)) == pytest.approx(1, rel=1e-12)  # to rounding, which is the processor's
    assert seen.noise.numpy() == pytest.approx(1 / 20.0, rel=0.1)


def test_large_cameras_are_cut():
    seen = seen_by_camera(torch.rand(1, 1, 480, 480), torch.tensor([3.0]))
    assert seen.looks == 9
    assert seen.shape == (160, 160)


def test_an_image_of_an_infinite_range_gives_an_open_interval():
    """One image; of fits by resampling images the interval had no width and held nothing."""
    _, seen, optics, _, _ = drawn(1, 1e-3)
    fit = fit_range(load_solver(), seen, optics, [through_slab(1.0)])
    assert fit.low < fit.factor < fit.high == np.inf


@pytest.mark.slow
def test_intervals_cover():
    """Characters drawn from the law, one and four together, far within the range, and one and three ranges wide.
    Wilson's 99 % limits, for each level and number of images."""
    solver, holds = load_solver(), {}
    for number, extent in enumerate((1e-3, 1.0, 3.0)):
        _, seen, optics, _, _ = drawn(48, extent, seed=10 + number)
        for together in (1, 4):
            for part in torch.arange(48).split(together):
                fit = fit_range(solver, seen.select(part), optics, [through_slab(max(extent, 1.0))] * together)
                true = float("inf") if extent < 1 else 1.0
                for level in (0.68, 0.95):
                    low, high = fit.interval(level)
                    assert low < high
                    holds.setdefault((together, level), []).append(low <= true <= high)
    for (_, level), found in holds.items():
        limits = binomtest(sum(found), len(found)).proportion_ci(0.99, "wilson")
        assert limits.low < level < limits.high, (level, sum(found), len(found))


def test_an_interval_that_is_wrong_by_a_factor_is_noticed():
    """The same intervals, each moved by 1.5, do not cover."""
    solver, held = load_solver(), 0
    _, seen, optics, _, _ = drawn(48, 3.0, seed=12)
    for part in torch.arange(48).split(4):
        low, high = fit_range(solver, seen.select(part), optics, [through_slab(3.0)] * 4).interval(0.68)
        held += low <= 1.5 <= high
    assert binomtest(held, 12).proportion_ci(0.99, "wilson").high < 0.68
