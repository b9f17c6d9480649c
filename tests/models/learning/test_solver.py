"""The unrolled solver: what holds for any weights. How well it does is in docs/networks.md."""

import numpy as np
import pytest
import torch

from specklegen.core.errors import RuleError
from specklegen.datasets import load_recipe
from specklegen.datasets.objects import Glyphs
from specklegen.models.learning.measurement import measured, memory_effect_of, seen_by_camera
from specklegen.models.learning.networks.unrolled import Unrolled, improved, invariant_loss, ranked, settled
from specklegen.models.learning.range_fit import fit_range
from specklegen.models.learning.solver import Solution, Solver
from specklegen.models.likelihood.certificate import Certificate
from specklegen.models.likelihood.likelihood import Optics, SpeckleLikelihood
from specklegen.models.likelihood.periodogram import Periodogram

SIDE, GRAIN, STEP = 28, 3.0, 1.2
EVIDENCE = 16
BLIND = Certificate((0.0,) * EVIDENCE, (0.0,) * EVIDENCE, (1.0,) * EVIDENCE, 0.0)


def through_slab(ranges):
    """C_I of the slab of through-slab over object pixels, for objects so many ranges wide."""
    known = load_recipe("through-slab").material_of(0, "train", 0)
    return memory_effect_of(known.kernel, 1.0, ranges * known.half_range / (2 * np.pi) / SIDE)


def drawn(count, ranges=1.0, camera=128, profile="square", seed=0):
    """Glyphs, and periodograms of them drawn from their law."""
    objects = torch.from_numpy(np.stack([Glyphs().image(seed, "train", n) for n in range(count)])).double()
    optics = Optics(STEP, GRAIN, profile)
    flat = Periodogram(
        torch.ones(count, camera, camera // 2 + 1, dtype=torch.float64), torch.zeros(count), 1.0, (camera, camera)
    )
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
    return Unrolled(width=4, stages=1)


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

    start = 0.5 + 0.5 * objects.float()
    near, found = settled(start, deviance)
    assert (found < deviance(start[:, None])[:, 0]).all()
    assert torch.allclose(found, deviance(near[:, None])[:, 0], atol=1e-5)
    assert torch.equal(near.amax((-2, -1)), torch.ones(2))


def test_most_probable_answer_comes_first():
    objects, _, _, likelihood, c_i = drawn(2)
    blank, blur = torch.ones_like(objects), torch.nn.functional.avg_pool2d(objects[:, None], 5, 1, 2)[:, 0]
    answers = torch.stack([blank, blur, objects.flip((-2, -1))], dim=1).float()
    first, deviances = ranked(answers, lambda images: likelihood(images.double(), c_i).float())
    assert torch.equal(first[:, 0], answers[:, 2])
    assert (deviances.diff(dim=1) >= 0).all()


def test_loss_forgives_shift_and_turn():
    image = torch.rand(2, 12, 12)
    moved = torch.roll(image.flip((-2, -1)), (2, 5), (-2, -1))
    assert invariant_loss(moved, image).abs().max() < 1e-5


@pytest.mark.parametrize(("camera", "profile"), [(96, "square"), (160, "disc")])
def test_any_camera_and_window_and_the_same_bits_again(camera, profile):
    _, seen, optics, _, _ = drawn(2, camera=camera, profile=profile)
    solver, memory = Solver(small(), BLIND), [through_slab(1.0)] * 2
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


def test_one_memory_effect_for_each_image():
    _, seen, optics, _, _ = drawn(2)
    with pytest.raises(RuleError, match="one for each of 2 objects"):
        Solver(small(), BLIND).solve(seen, optics, [through_slab(1.0)])


def test_file_holds_all_of_it(tmp_path):
    solver = Solver(small(3), BLIND._replace(constant=1.5))
    solver.save(tmp_path / "one.pt")
    again = Solver.load(tmp_path / "one.pt")
    assert again.certificate == solver.certificate
    for old, new in zip(solver.network.parameters(), again.network.parameters(), strict=True):
        assert (old - new).abs().max() <= old.abs().max() / 127
    (tmp_path / "one.pt").write_bytes((tmp_path / "one.pt").read_bytes()[:-3] + b"abc")
    with pytest.raises(RuleError, match="as it was written"):
        Solver.load(tmp_path / "one.pt")


class Told:
    """A solver that is told the objects: what is left is the fit of the range."""

    def __init__(self, objects, likelihood):
        self.objects, self.likelihood = objects, likelihood

    def solve(self, seen, optics, memory, *, seed=0):
        steps = np.arange(1 - SIDE, SIDE)
        c_i = torch.from_numpy(memory[0](np.hypot(steps[:, None], steps)))
        found, log = self.likelihood(self.objects, c_i), self.likelihood.log_likelihood(self.objects, c_i)
        return Solution(self.objects, self.objects, found, log, found, found)


@pytest.mark.parametrize("true", [0.7, 1.0, 1.6])
def test_range_is_found_where_objects_are_known(true):
    """16 images at 2.5 ranges; the interval holds the truth, and is narrow."""
    objects, seen, optics, likelihood, _ = drawn(16, 2.5)
    given = through_slab(2.5 * true)  # as if the range were 1 / true as long
    fit = fit_range(Told(objects, likelihood), seen, optics, [given] * 16)  # type: ignore[arg-type]
    assert abs(np.log(fit.factor / true)) < 0.1
    assert fit.low < fit.factor < fit.high
    assert fit.high / fit.low < 1.5
    assert max(fit.tried.values()) == 0


def test_what_a_camera_measures():
    """Noise is read off the image, and agrees with the photons of the recipe."""
    recipe = load_recipe("one-angular-size", {"exposure": {"photons": 20.0, "bit_depth": None}, "media_group": 4})
    seen, optics, memory = measured(recipe.batch(0, "test", range(4)), recipe)
    assert optics.pixel_integration
    assert len(memory) == 4
    assert memory[0](np.zeros(1)) == 1
    assert seen.noise.numpy() == pytest.approx(1 / 20.0, rel=0.1)


def test_large_cameras_are_cut():
    seen = seen_by_camera(torch.rand(1, 1, 480, 480), torch.tensor([3.0]))
    assert seen.looks == 9
    assert seen.shape == (160, 160)
