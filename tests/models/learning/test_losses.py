"""Losses: their values, their gradients, and what they must not see."""

import pytest
import torch
from refusals import assert_refused

from specklegen.models.learning.losses import LOSSES, loss_named


def logits_and_target(count=3, side=14):
    """The same numbers in every test, whichever process runs it after whichever other."""
    rng = torch.Generator().manual_seed(3)
    logits = torch.randn(count, side, side, generator=rng, dtype=torch.float64)
    return logits, torch.rand(count, side, side, generator=rng, dtype=torch.float64)


@pytest.mark.parametrize("name", LOSSES)
def test_gradient_is_that_of_finite_differences(name):
    logits, target = logits_and_target(2, 12)
    # Along random directions: entry by entry, the alignments of each loss cost a minute.
    assert torch.autograd.gradcheck(lambda x: LOSSES[name](x, target), logits.requires_grad_(), fast_mode=True)


@pytest.mark.parametrize("name", [name for name in LOSSES if name.endswith("-invariant")])
def test_invariant_losses_forget_shift_and_flip(name):
    logits, target = logits_and_target()
    moved = torch.roll(target, (3, -5), (-2, -1)).flip((-2, -1))
    assert LOSSES[name](logits, moved).item() == pytest.approx(LOSSES[name](logits, target).item(), rel=1e-12)
    plain = LOSSES[name.removesuffix("-invariant")]
    assert plain(logits, moved).item() != pytest.approx(plain(logits, target).item(), rel=1e-3)


@pytest.mark.parametrize("name", ["pearson", "ssim", "l1"])
def test_a_perfect_prediction_costs_nothing(name):
    _, target = logits_and_target()
    assert LOSSES[name](torch.logit(target, eps=1e-12), target).item() == pytest.approx(0, abs=1e-9)


def test_a_point_beside_its_place_is_nearly_right():
    """Of sharp points one that is a pixel away is as wrong as one far away; blurred, it costs less, its place least."""
    target = torch.zeros(1, 12, 12, dtype=torch.float64)
    target[0, 5, 5] = 1
    costs = {}
    for name in ("pearson", "blurred"):
        shown = [torch.logit(target.roll(away, 2), eps=1e-12) for away in (0, 1, 4)]
        costs[name] = [LOSSES[name](each, target).item() for each in shown]
    assert costs["pearson"][1] == pytest.approx(costs["pearson"][2], rel=1e-12)
    assert costs["blurred"][0] < costs["blurred"][1] < costs["blurred"][2]
    spread = torch.zeros_like(target)
    spread[0, 4:7, 4:7] = torch.tensor([[0.25, 0.5, 0.25], [0.5, 1.0, 0.5], [0.25, 0.5, 0.25]])
    assert LOSSES["blurred"](torch.logit(spread, eps=1e-12), target).item() == pytest.approx(0, abs=1e-9)


def test_invariant_loss_is_the_least_over_all_motions():
    """By brute force, for the loss that the alignment minimises."""
    logits, target = logits_and_target(1, 8)
    every = [
        LOSSES["pearson"](logits, torch.roll(turned, (y, x), (-2, -1))).item()
        for turned in (target, target.flip((-2, -1)))
        for y in range(8)
        for x in range(8)
    ]
    assert LOSSES["pearson-invariant"](logits, target).item() == pytest.approx(min(every), rel=1e-12)


def test_an_unknown_loss_is_refused():
    assert_refused(lambda: loss_named("mse"), "loss must be one of pearson")
