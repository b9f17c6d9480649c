"""Draws of the object, given what was measured: several pictures that explain it, and how much each is worth.

A picture is drawn by following the flow of :mod:`specklegen.models.learning.networks.flow` from noise, or from a first
answer to which noise was added, to a picture; at each step the net sees what the measurement says of its last estimate
(:mod:`specklegen.models.learning.feedback`). So an object of which several pictures explain the lags is drawn as each
of them, and an answer of the solver, or of phase retrieval, is one start among others. What a draw is worth is said by
two numbers: the exact likelihood, and how well the prior takes noise off it, the sum

    1/2 sum_t (SNR step) |u - u(t)|^2,      SNR(t) = t^2 / (1 - t)^2,

which is minus the logarithm of the prior density, up to a constant and to details finer than the last noise level
(Kingma, Salimans, Poole and Ho, NeurIPS 2021, equation 13). Neither is believed as it is: the prior was learned, and
the draws are few; the factors that they get were fitted on objects that the training never saw
(docs/notes/networks.md).
"""

from functools import lru_cache
from importlib.resources import files
from pathlib import Path
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor

from specklegen.core.display.repr import short
from specklegen.core.errors import reject
from specklegen.core.random_streams import Seed, seed_words
from specklegen.core.shielded import shielded
from specklegen.models.learning.feedback import Measured
from specklegen.models.learning.model_file import read_model
from specklegen.models.learning.networks.flow import Flow
from specklegen.models.learning.reconstructor import centred
from specklegen.models.likelihood.likelihood import SpeckleLikelihood
from specklegen.models.metrics import align

PRIOR = Path(str(files("specklegen.models") / "data" / "prior.pt"))
"""The net that comes with the package."""
STEPS = 20
"""Of a draw that begins at noise."""
KEPT = 0.5
"""Share of a first answer, beside noise, that a draw from it begins with."""
FACTORS = (0.01, 0.02)
"""What a nat of the likelihood, and one of the prior, counts in a weight."""
SOLVED = 0.3
"""Share of the solver's image in the mean: it errs in other ways than draws do."""
_LEVELS = (0.3, 0.45, 0.6, 0.7, 0.8)  # t at which the prior is asked
_MOVES, _RATE = 5, 0.08  # steps towards the likelihood, and their length where all is noise, brightness
_REACH, _CLOSE = 0.12, 0.01  # how far an estimate is believed: where all is noise, and at the end, brightness
_FRESH = 0.5  # share of the noise that is drawn anew at each step


class Posterior(NamedTuple):
    """Pictures that explain B measurements, K of each.

    Attributes
    ----------
    mean : float32[B, n, n]
        Of the draws, by their weights, and of the solver's image, moved onto the best and counted :data:`SOLVED`.
    best : float32[B, n, n]
        The draw of the largest weight.
    draws : float32[B, K, n, n]
        Brightness 0 to 1, moved onto the best; the best first.
    weights : float32[B, K]
        Of the draws; their sum is 1. They order draws, and are no probabilities.
    certain : float32[B, n, n]
        Per pixel, no probability either: 1 less twice the spread of the draws, 1 where all agree, 0 where half say dark
        and half bright.
    agreement : float32[B]
        Mean correlation of two draws, by their weights: how far the picture is determined.
    excess : float32[B, K]
        Minus the log-likelihood of each draw over that expected of the true object, nats.
    """

    mean: Tensor
    best: Tensor
    draws: Tensor
    weights: Tensor
    certain: Tensor
    agreement: Tensor
    excess: Tensor

    __repr__ = short


@lru_cache(maxsize=1)
def load_prior() -> Flow:
    """Return the net that comes with the package."""
    return read_prior(PRIOR)


@shielded()
def read_prior(path: Path) -> Flow:
    """Read a net that ``scripts/build/train_prior.py`` wrote."""
    stated, kept = read_model(path)
    try:
        net = Flow(*(int(stated[name]) for name in ("frame", "width", "inner")))
        net.load_state_dict({name: value.float() for name, value in kept.items()})
    except (KeyError, TypeError, ValueError, RuntimeError):
        reject("prior", "a file written by train_prior.py", str(path))
    return net.eval().requires_grad_(False)


def posterior(
    net: Flow, likelihood: SpeckleLikelihood, between: Tensor, at_lags: Tensor, solved: Tensor, answers: Tensor,
    count: int, seed: Seed = 0,
) -> Posterior:  # fmt: skip
    """Draw pictures from several starts, and weigh them; object by object, so that companions change nothing.

    Parameters
    ----------
    net
        Of the prior.
    likelihood
        Of B measurements.
    between, at_lags
        C_I between the pixels of a frame, and at every lag.
    solved
        The solver's images, float[B, n, n].
    answers
        Of phase retrieval, float[B, A, n, n].
    count
        How many draws.
    seed
        Of the noise, which is the same for all objects.
    """
    posteriors = []
    for n in range(len(solved)):
        own = slice(n, n + 1)
        measured = Measured.of(likelihood.select(own), between[own], at_lags[own])
        generator = generator_of(seed)
        starts, kept = starts_of(measured, solved[own], answers[own], count)
        draws = centred(drawn(net, measured, starts, kept, generator))
        with torch.no_grad():
            nats = measured.likelihood.excess(draws.clamp_min(1e-3), measured.between[:, None])
        weighted = weighed(draws, nats, surprise(net, draws, generator))
        both = (1 - SOLVED) * weighted.mean + SOLVED * align(centred(solved[own]), weighted.best)
        posteriors.append(weighted._replace(mean=both))
    return Posterior(*(torch.cat(each) for each in zip(*posteriors, strict=True)))


def starts_of(measured: Measured, solved: Tensor, answers: Tensor, count: int) -> tuple[Tensor, Tensor]:
    """Start of draws, float[B, count, n, n], and the share of it beside noise, float[count].

    The first half begins at noise; then the solver's image and phase retrieval's answers, the most probable first.
    """
    answers = answers / answers.amax((-2, -1), keepdim=True).clamp_min(1e-6)
    with torch.no_grad():
        order = measured.deviance(answers.clamp_min(1e-3)).argsort(1)
    answers = answers.gather(1, order[..., None, None].expand_as(answers))
    known = centred(torch.cat([solved[:, None], answers], dim=1))
    later = count // 2
    chosen = [0 if n % 2 == 0 else 1 + (n // 2) % answers.shape[1] for n in range(later)]
    starts = torch.cat([torch.zeros_like(known[:, :1]).expand(-1, count - later, -1, -1), known[:, chosen]], dim=1)
    kept = torch.tensor([0.0] * (count - later) + [KEPT] * later)
    return starts, kept


def drawn(
    net: Flow, measured: Measured, starts: Tensor, kept: Tensor, generator: torch.Generator, steps: int = STEPS
) -> Tensor:
    """Draw pictures, brightness 0 to 1, float32[B, K, n, n].

    Parameters
    ----------
    net
        Of the prior.
    measured
        Of B objects.
    starts
        What each draw begins with, brightness 0 to 1, float[B, K, n, n].
    kept
        Share of it beside noise, float[K], 0 for noise alone.
    generator
        Of the noise.
    steps
        Of a draw from noise; one that begins later makes as many of shorter ones.
    """
    shape = starts.shape

    def noise() -> Tensor:  # the same for every object
        return torch.randn(1, *shape[1:], generator=generator).expand(shape)

    begin = kept.expand(shape[:2])
    with torch.no_grad():
        x = begin[..., None, None] * (2 * starts - 1) + (1 - begin[..., None, None]) * noise()
        first = 0.5 * net(x.flatten(0, 1), begin.flatten()).reshape(shape) + 0.5
        estimate = torch.where(begin[..., None, None] > 0, starts, first).clamp(0, 1)
    for n in range(steps):
        shown, numbers, _ = measured(estimate)
        with torch.no_grad():
            t, after = (begin + (1 - begin) * m / steps for m in (n, n + 1))
            means = net(x.flatten(0, 1), t.flatten(), shown.flatten(0, 1), numbers.flatten(0, 1)).reshape(shape)
            t, after = t[..., None, None], after[..., None, None]
        estimate = explained(((means + 1) / 2).clamp(0, 1), measured, 1 - t)
        with torch.no_grad():
            away = (x - t * means) / (1 - t).clamp_min(1e-3)
            away = (1 - _FRESH**2) ** 0.5 * away + _FRESH * noise()
            x = after * (2 * estimate - 1) + (1 - after) * away
    return estimate  # pyright: ignore[reportPossiblyUnbound]


def explained(pictures: Tensor, measured: Measured, noise: Tensor) -> Tensor:
    """Move pictures float[B, K, n, n] to where the exact likelihood wants them, as far as the net's estimate is open.

    A few steps of Adam on nats plus ``|x - estimate|^2 / (2 r^2)``, r that share of the noise that is left, float[B, K,
    1, 1]: the decoupled step of annealed posterior sampling (Zhang et al., CVPR 2025), its Langevin walk left out.
    """
    looks, count = measured.likelihood.looks, measured.likelihood.frequencies.to(pictures)[:, None]
    reach = (_REACH * noise).clamp_min(_CLOSE)
    moved = pictures.clone().requires_grad_()
    optimizer = torch.optim.Adam([moved], lr=1.0, betas=(0.8, 0.95))
    rate = (_RATE * noise).clamp_min(_RATE / 50)
    for _ in range(_MOVES):
        with torch.enable_grad():
            nats = looks * count * measured.deviance(moved.clamp_min(2e-3))
            cost = nats.sum() + ((moved - pictures).square() / (2 * reach.square())).sum()
            (moved.grad,) = torch.autograd.grad(cost, moved)
        with torch.no_grad():
            before = moved.clone()
            optimizer.step()
            moved.copy_((before + rate * (moved - before)).clamp(0, 1.2))
    return moved.detach().clamp(0, 1)


def surprise(net: Flow, pictures: Tensor, generator: torch.Generator) -> Tensor:
    """Minus the logarithm of the prior density, nats, up to a constant, float[B, K]; all draws get the same noise."""
    count, shape = pictures.shape[1], pictures.shape
    u, total, before = 2 * pictures - 1, torch.zeros(shape[:2]), 0.0
    with torch.no_grad():
        for level in _LEVELS:
            noise = torch.randn(1, 1, *shape[2:], generator=generator).expand(shape)
            x = level * u + (1 - level) * noise
            means = net(x.flatten(0, 1), torch.full((shape[0] * count,), level)).reshape(shape)
            ratio = (level / (1 - level)) ** 2
            total += 0.5 * (ratio - before) * (means - u).square().sum((-2, -1))
            before = ratio
    return total


def weighed(draws: Tensor, excess: Tensor, prior: Tensor, factors: tuple[float, float] = FACTORS) -> Posterior:
    """Put draws float[B, K, n, n] together by their nats, likelihood's and prior's, float[B, K] each."""
    cost = factors[0] * excess + factors[1] * prior
    order = cost.argsort(1)
    cost, excess = cost.gather(1, order), excess.gather(1, order)
    draws = draws.gather(1, order[..., None, None].expand_as(draws))
    draws = align(draws, draws[:, :1].expand_as(draws))
    weights = (cost[:, :1] - cost).softmax(1)
    share = weights[..., None, None]
    mean = (share * draws).sum(1)
    spread = (share * (draws - mean[:, None]).square()).sum(1).sqrt()
    flat = draws.flatten(2) - draws.flatten(2).mean(-1, keepdim=True)
    flat = flat / flat.norm(dim=-1, keepdim=True).clamp_min(1e-9)
    agreement = (share[..., 0] * flat).sum(1).square().sum(-1)
    return Posterior(mean, draws[:, 0], draws, weights, 1 - 2 * spread, agreement, excess)


def generator_of(seed: Seed) -> torch.Generator:
    """Generator of a seed's own."""
    words = seed_words(seed)
    (state,) = np.random.SeedSequence([41, len(words), *words]).generate_state(1, np.uint64)
    return torch.Generator().manual_seed(int(state) % 2**63)
