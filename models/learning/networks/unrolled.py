"""An unrolled solver: gradients of the likelihood, and small networks that know what objects look like.

What is seen are a likelihood (:mod:`specklegen.models.likelihood.likelihood`), lags, and first answers of phase
retrieval. A dense net answers from the lags alone; all answers are moved onto one another; then stages follow,

    y = x improved by a few steps down the deviance,     x <- x + small convolutional net (x, y, gradient, answers, ...)

so that data enter by physics, the memory effect, the grain, the noise and the window included, and only the prior is
learned (Monga, Li and Eldar, *IEEE Signal Processing Magazine* 38, 18 (2021)). Nothing depends on the camera: the nets
see the object's frame. Answers of one object differ by shifts and a turn, which neither lags nor likelihood can tell.
"""

from collections.abc import Callable
from typing import NamedTuple

import torch
from torch import Tensor, nn

from specklegen.models.learning.inputs import zero_phase
from specklegen.models.metrics import align, alignment, move, pearson

Deviance = Callable[[Tensor], Tensor]
"""Of objects float[B, K, n, n], float[B, K]."""

SCALARS = 5
"""Numbers that describe the measurement."""
_STEPS = (0.0, 0.15, 0.5)
"""Lengths of a step down the deviance, over the brightest pixel; the best is taken."""


SETTLING = 30
"""Steps down the likelihood after the last stage, for what an image leaves unexplained."""
BRIEFLY = (10, 0.3)
"""Steps of what is settled before the first stage, and their rate."""
_DARK = 0.005
"""Least brightness that a stage begins with."""


class Seen(NamedTuple):
    """Input of the network, of B objects on a frame of n x n pixels.

    Attributes
    ----------
    lags : float[B, 2, 2 n', 2 n']
        Autocorrelations, zero lag in the middle: as measured, and divided by the memory effect as far as noise allows.
    answers : float[B, K, n, n]
        First answers, their centroids in the middle.
    scalars : float[B, SCALARS]
    """

    lags: Tensor
    answers: Tensor
    scalars: Tensor


class Prior(nn.Module):
    """Small convolutional net at half the resolution: float[B, C, n, n] to float[B, n, n]."""

    def __init__(self, channels: int, width: int, blocks: int) -> None:
        super().__init__()
        self.first = nn.Sequential(nn.PixelUnshuffle(2), nn.Conv2d(4 * channels, width, 3, padding=1))
        self.blocks = nn.ModuleList(
            nn.Sequential(
                nn.GroupNorm(4, width), nn.SiLU(), nn.Conv2d(width, width, 3, padding=1), nn.SiLU(),
                nn.Conv2d(width, width, 3, padding=2, dilation=2),
            ) for _ in range(blocks)
        )  # fmt: skip
        change = nn.Conv2d(width, 4, 1)
        with torch.no_grad():
            for weight in change.parameters():
                weight.zero_()
        self.last = nn.Sequential(nn.GroupNorm(4, width), nn.SiLU(), change, nn.PixelShuffle(2))

    def forward(self, pictures: Tensor) -> Tensor:
        """Return float[B, n, n]."""
        x = self.first(pictures)
        for block in self.blocks:
            x = x + block(x)
        return self.last(x)[:, 0]


class Dense(nn.Module):
    """Residual blocks of dense layers from lags to a frame of n x n pixels; logits."""

    def __init__(self, side: int, frame: int, units: int, blocks: int) -> None:
        super().__init__()
        self.side, self.frame = side, frame
        self.first = nn.Linear(3 * side * (2 * side - 1) + SCALARS, units)
        self.blocks = nn.ModuleList(
            nn.Sequential(nn.LayerNorm(units), nn.Linear(units, 2 * units), nn.GELU(), nn.Linear(2 * units, units))
            for _ in range(blocks)
        )
        self.last = nn.Sequential(nn.LayerNorm(units), nn.Linear(units, frame * frame))

    def forward(self, seen: Seen) -> Tensor:
        """Return float[B, n, n]."""
        middle = seen.lags.shape[-1] // 2
        pictures = torch.cat([seen.lags, zero_phase(seen.lags[:, 1])[:, None]], dim=1)
        half = pictures[..., middle + 1 - self.side : middle + 1, middle + 1 - self.side : middle + self.side]
        x = self.first(torch.cat([half.flatten(1), seen.scalars], dim=1))
        for block in self.blocks:
            x = x + block(x)
        return self.last(x).reshape(-1, self.frame, self.frame)


class Unrolled(nn.Module):
    """The solver; see the module.

    Parameters
    ----------
    frame
        Side of the frame that answers lie on, even.
    side
        Lags either way that the dense net sees.
    width
        Channels of the priors.
    stages
        Of likelihood and prior.
    answers
        First answers of phase retrieval.
    units, blocks
        Of the dense net.
    """

    def __init__(
        self, frame: int = 36, side: int = 28, width: int = 32, stages: int = 3, answers: int = 4, units: int = 448,
        blocks: int = 3,
    ) -> None:  # fmt: skip
        super().__init__()
        self.frame, self.side, self.width, self.count, self.answers = frame, side, width, stages, answers
        self.units, self.blocks = units, blocks
        self.dense = Dense(side, frame, units, blocks)
        channels = 4 + (2 + 2 * answers) + (SCALARS + 2 + answers)
        self.priors = nn.ModuleList(Prior(channels, width, 2) for _ in range(stages))

    def forward(self, seen: Seen, deviance: Deviance) -> list[Tensor]:
        """Brightness 0 to 1 after the dense net and each stage, float[B, n, n] each; the last is the answer."""
        return self.refined(self.candidates(seen, deviance), deviance)

    def candidates(self, seen: Seen, deviance: Deviance) -> "Candidates":
        """Return the start of the stages; no gradient goes through it."""
        with torch.no_grad():
            start = self.started(seen)
            answers = seen.answers / seen.answers.amax((-2, -1), keepdim=True).clamp_min(1e-6)
        near, deviances = settled(torch.cat([start[:, None], answers], dim=1), deviance, *BRIEFLY)
        with torch.no_grad():
            order = deviances[:, 1:].argsort(1)
            answers, group = (x.gather(1, order[..., None, None].expand_as(x)) for x in (answers, near[:, 1:]))
            group = align(group, group[:, :1].expand_as(group))
            onto = alignment(group[:, 0], start)
            group = torch.stack([move(each, onto) for each in group.unbind(1)], dim=1)
            alone = align(answers, start[:, None].expand_as(answers))
            pictures = torch.cat([start[:, None], near[:, :1], group, alone], dim=1)
            return Candidates(
                pictures, torch.cat([deviances[:, :1], deviances[:, 1:].gather(1, order)], dim=1), seen.scalars
            )

    def started(self, seen: Seen) -> Tensor:
        """Mean in logits of the dense net's images of lags and of mirrored lags, float[B, n, n]."""
        mirrored = seen._replace(lags=torch.roll(seen.lags.flip(-2), 1, -2))
        one, other = self.dense(seen).sigmoid(), self.dense(mirrored).flip(-2).sigmoid()
        both = torch.stack([one, align(other, one)]).clamp(_DARK, 1 - _DARK)
        return torch.logit(both).mean(0).sigmoid()

    def refined(self, candidates: "Candidates", deviance: Deviance) -> list[Tensor]:
        """Brightness after the dense net and each stage, as of :meth:`forward`."""
        start = candidates.pictures[:, 0]
        x = torch.logit(start.clamp(_DARK, 1 - _DARK))
        images = [start]
        for prior in self.priors:
            shown = x.sigmoid()
            better, gradient, least = improved(shown.detach(), deviance)
            numbers = [candidates.scalars, candidates.deviances - candidates.deviances.amin(1, keepdim=True),
                       (least - candidates.deviances.amin(1))[:, None]]  # fmt: skip
            maps = torch.cat(numbers, dim=1)[..., None, None].expand(-1, -1, self.frame, self.frame)
            pictures = torch.stack([x / 4, shown, better, gradient], dim=1)
            x = x + prior(torch.cat([pictures, candidates.pictures, maps], dim=1))
            images.append(x.sigmoid())
        return images


class Candidates(NamedTuple):
    """Start of the stages, of B objects.

    Attributes
    ----------
    pictures : float[B, 2 + 2 K, n, n]
        The dense net's image, and the same settled; the answers settled, the most probable first, moved onto one
        another and together onto that image; the answers as they were, moved onto it one by one.
    deviances : float[B, 1 + K]
        Of what was settled.
    scalars : float[B, SCALARS]
        Of :class:`Seen`.
    """

    pictures: Tensor
    deviances: Tensor
    scalars: Tensor


def improved(image: Tensor, deviance: Deviance, steps: int = 1) -> tuple[Tensor, Tensor, Tensor]:
    """An image float[B, n, n] after steps down the deviance, the gradient there over its spread, and the deviance."""
    lengths = torch.tensor(_STEPS, device=image.device)[:, None, None]
    gradient, least = torch.zeros_like(image), torch.zeros(len(image), device=image.device)
    for step in range(steps + 1):
        with torch.enable_grad():
            tried = image[:, None].detach().requires_grad_()
            least = deviance(tried)[:, 0]
            gradient = torch.autograd.grad(least.sum(), tried)[0][:, 0]
        least = least.detach()
        gradient = gradient / gradient.square().mean((-2, -1), keepdim=True).sqrt().clamp_min(1e-20)
        if step == steps:
            break
        with torch.no_grad():
            move = gradient / gradient.abs().amax((-2, -1), keepdim=True).clamp_min(1e-20)
            options = (image[:, None] - lengths * move[:, None]).clamp_min(1e-4)
            best = deviance(options[:, 1:])
            best = torch.cat([least[:, None], best], dim=1).argmin(1)
            image = options[torch.arange(len(image)), best]
            image = image / image.amax((-2, -1), keepdim=True)
    return image, gradient / 4, least


def settled(images: Tensor, deviance: Deviance, steps: int = SETTLING, rate: float = 0.1) -> tuple[Tensor, Tensor]:
    """Most probable images near those given, float[B, K, n, n], brightest pixels 1, and their deviances float[B, K].

    Adam on the logarithm of the brightness (Kingma and Ba, ICLR 2015); few steps, since many fit the noise.
    """
    logarithm = images.detach().clamp_min(1e-3).log().requires_grad_()
    optimizer = torch.optim.Adam([logarithm], lr=rate, betas=(0.9, 0.9))
    with torch.enable_grad():
        for _ in range(steps):
            optimizer.zero_grad()
            deviance(logarithm.exp()).sum().backward()
            optimizer.step()
    with torch.no_grad():
        brightness = logarithm.exp()
        brightness = brightness / brightness.amax((-2, -1), keepdim=True)
        return brightness, deviance(brightness)


def invariant_loss(image: Tensor, target: Tensor) -> Tensor:
    """1 - Pearson's correlation with the target, moved onto the image by all shifts and the turn; float[B]."""
    return 1 - pearson(image, align(target, image.detach()))
