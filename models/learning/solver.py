"""The solver as a user holds it: camera images and what is known of the slab in; object, deviance, certificate out.

Phase retrieval from the lags, divided by Wiener's two guesses, gives first answers; the unrolled network
(:mod:`specklegen.models.learning.networks.unrolled`) makes one of them, by the likelihood and by what it has learned.
Nothing in it depends on the size of the camera, on the window, or on the unit of the images.
"""

import os
from collections.abc import Callable, Sequence
from importlib.resources import files
from pathlib import Path
from typing import NamedTuple, Self

import numpy as np
import torch
from torch import Tensor

from specklegen.core.arguments import whole_number
from specklegen.core.errors import reject
from specklegen.core.random_streams import Seed
from specklegen.core.showing import short, summary
from specklegen.models.learning.model_file import read_model, restored, rounded, write_model
from specklegen.models.learning.networks.unrolled import Seen, Unrolled, ranked, settled
from specklegen.models.learning.reconstructor import centred
from specklegen.models.likelihood.certificate import Certificate
from specklegen.models.likelihood.likelihood import Optics, SpeckleLikelihood
from specklegen.models.likelihood.periodogram import Periodogram
from specklegen.models.metrics import align, pearson
from specklegen.models.retrieval import wiener
from specklegen.models.retrieval.autocorrelation import distances
from specklegen.models.retrieval.phase_retrieval import Retrieval, retrieve

ANY_OBJECT = "any-object"
"""Solver that comes with the package; its card lies beside it, and in docs/networks.md."""
LAGS = 64
"""Side of the window of lags, in object pixels."""
EXTENT = 28
"""Longest side of an object, in object pixels."""
RESTARTS = Retrieval(restarts=2, steps=4, error_reduction=20, extent=EXTENT)
"""Of phase retrieval, from each guess."""
GUESSES: tuple[wiener.Division, ...] = ("dense", "empirical")

MemoryEffect = Callable[[np.ndarray], np.ndarray]
"""C_I of a slab at distances in object pixels, any shape."""


class Solution(NamedTuple):
    """What came out, of B objects.

    Attributes
    ----------
    image : float32[B, n, n]
        Brightness 0 to 1, up to shift and 180-degree turn, on a frame of n pixels.
    settled : float32[B, n, n]
        The most probable image near it, after a few steps down the likelihood alone.
    deviance : float32[B]
        Of the settled image; that of the true object is ``expected_deviance(looks)``, .577 for one look.
    log_likelihood : float32[B]
        Of the settled image, less that of a spectrum equal to the periodogram.
    probability : float32[B]
        The certificate: that the image's correlation with the true object exceeds .8.
    evidence : float32[B, e]
        What the certificate was read from; see :func:`evidence_of`.
    """

    image: Tensor
    settled: Tensor
    deviance: Tensor
    log_likelihood: Tensor
    probability: Tensor
    evidence: Tensor

    __repr__ = short


class Solver:
    """An unrolled network with all that it needs.

    Attributes
    ----------
    network : Unrolled
    certificate : Certificate
        Reads the probability of success from the evidence.
    """

    def __init__(self, network: Unrolled, certificate: Certificate) -> None:
        self.network, self.certificate = network, certificate

    def __repr__(self) -> str:
        return summary(self, frame=self.network.frame, side=self.network.side, stages=self.network.count)

    def solve(self, seen: Periodogram, optics: Optics, memory: Sequence[MemoryEffect], *, seed: Seed = 0) -> Solution:
        """Reconstruct objects from their periodograms.

        Parameters
        ----------
        seen
            Of B objects; :func:`~specklegen.models.likelihood.periodogram.periodogram`.
        optics
            Steps between object pixels, grains, window.
        memory
            C_I of the slab before each of them.
        seed
            Of phase retrieval's starts.

        Raises
        ------
        RuleError
            If there is not one memory effect for each object.
        """
        if len(memory) != len(seen.power):
            reject("solve memory", f"one for each of {len(seen.power)} objects", len(memory))
        seen = seen._replace(power=seen.power.float(), noise=seen.noise.float())
        n = self.network.frame
        likelihood = SpeckleLikelihood(seen, (n, n), optics)
        steps = np.arange(1 - n, n)
        between = torch.stack([_at(c_i, np.hypot(steps[:, None], steps)) for c_i in memory])
        at_lags = torch.stack([_at(c_i, distances(LAGS)) for c_i in memory])
        shown = first_look(likelihood, at_lags, n, seed)
        self.network.eval()

        def deviance(objects: Tensor) -> Tensor:
            return likelihood(objects, between[:, None])

        made = [image.detach() for image in self.network(shown, deviance)]
        evidence = evidence_of(made, shown, deviance, seen.looks)
        near, found = settled(made[-1], deviance)
        log = -seen.looks * likelihood.frequencies * found
        return Solution(centred(made[-1]), centred(near), found, log, self.certificate(evidence), evidence)

    def save(self, path: str | os.PathLike) -> None:
        """Write the solver, its weights rounded to eight bits."""
        stated = {
            "name": "unrolled", "frame": self.network.frame, "side": self.network.side, "width": self.network.width,
            "stages": self.network.count, "answers": self.network.answers, "certificate": self.certificate._asdict(),
        }  # fmt: skip
        kept: dict[str, Tensor] = {}
        for key, weight in self.network.state_dict().items():
            kept |= rounded(key, weight)
        write_model(Path(path), stated, kept)

    @classmethod
    def load(cls, path: str | os.PathLike) -> Self:
        """Read a solver.

        Raises
        ------
        RuleError
            If the file holds something else, or is damaged.
        """
        stated, kept = read_model(Path(path))
        weights = restored(kept)
        numbers: list[int] = []
        certificate = None
        try:
            numbers = [
                whole_number(f"model {name}", stated[name], 1, 2**10)
                for name in ("frame", "side", "width", "stages", "answers")
            ]
            with torch.device("meta"):
                promised = Unrolled(*numbers).state_dict()
            certificate = Certificate.of(stated["certificate"])
            fits = stated["name"] == "unrolled"
            fits &= {key: value.shape for key, value in promised.items()} == {k: w.shape for k, w in weights.items()}
        except (KeyError, TypeError, ValueError, RuntimeError):
            fits = False
        if not fits or certificate is None:
            reject("model", "a file that Solver.save wrote", str(path))
        network = Unrolled(*numbers)
        network.load_state_dict(weights)
        return cls(network, certificate)


def _at(c_i: MemoryEffect, distance: np.ndarray) -> Tensor:
    unique, inverse = np.unique(distance, return_inverse=True)
    return torch.from_numpy(np.asarray(c_i(unique), np.float32)[inverse].reshape(distance.shape))


def first_look(likelihood: SpeckleLikelihood, memory_effect: Tensor, frame: int, seed: Seed = 0) -> Seen:
    """What the network sees of periodograms.

    Parameters
    ----------
    likelihood
        Of B objects.
    memory_effect
        C_I at every lag, float[B, LAGS, LAGS], the zero lag first.
    frame
        n, of the answers.
    seed
        Of phase retrieval's starts.
    """
    lags = likelihood.lags(LAGS)
    peak = lags[:, 0, 0].clamp_min(1e-9)
    lags = lags / peak[:, None, None]
    variance = likelihood.lag_variance() / peak.square()
    grain = likelihood.grain / likelihood.step
    weighted = {
        guess: lags * wiener.weights(lags, memory_effect, variance, side=EXTENT, grain=grain, guess=guess)
        for guess in GUESSES
    }
    found = torch.cat([retrieve(each.double(), RESTARTS, seed=seed).restarts for each in weighted.values()], dim=1)
    margin = (LAGS - frame) // 2
    answers = centred(found)[..., margin : margin + frame, margin : margin + frame].contiguous()
    pictures = torch.fft.fftshift(torch.stack([lags, weighted["dense"]], dim=1), dim=(-2, -1))
    scalars = [
        grain.log(),
        0.2 * variance.clamp_min(1e-12).log() + 1.5,
        torch.full_like(variance, 0.5 * float(np.log(likelihood.looks))),
        memory_effect[:, 0, EXTENT // 2].to(variance),
        memory_effect[:, 0, EXTENT - 1].to(variance),
    ]
    return Seen(pictures.float(), answers, torch.stack(scalars, dim=1).float())


def evidence_of(made: Sequence[Tensor], seen: Seen, deviance: Callable[[Tensor], Tensor], looks: float) -> Tensor:
    """Numbers that tell a good image from a bad one without the object, float[B, e].

    The deviance of the settled image, and how far it is from the image; how much the image's own and the best first
    answer's exceed it; how far image, answers, dense net and the stage before agree; how bright and how sharp the image
    is; and what the measurement was like.
    """
    last = made[-1]
    near, own = settled(last, deviance)
    with torch.no_grad():
        answers, deviances = ranked(seen.answers, deviance)
        before = deviance(last[:, None])[:, 0] - own
        agreed = pearson(align(answers, last[:, None].expand_as(answers)), last[:, None].expand_as(answers))
        others = [pearson(align(each, last), last) for each in (made[0], made[-2])]
        filled = last.mean((-2, -1)) / last.amax((-2, -1)).clamp_min(1e-6)
        sharpness = (last * (1 - last)).sum((-2, -1)) / last.sum((-2, -1)).clamp_min(1e-6)
        log_looks = torch.full_like(own, float(np.log(looks)))
        return torch.stack(
            [own, pearson(near, last), before, deviances[:, 0] - own, agreed.amax(1), agreed.mean(1), *others, filled,
             sharpness, log_looks, *seen.scalars.unbind(1)], dim=1,
        )  # fmt: skip


def load_solver() -> Solver:
    """Return the solver that comes with the package, trained on objects of many kinds behind slabs of any material.

    Examples
    --------
    >>> from specklegen.datasets import load_recipe
    >>> from specklegen.models import load_solver
    >>> from specklegen.models.learning.measurement import measured
    >>> recipe = load_recipe("one-angular-size")
    >>> batch = recipe.batch(0, "test", range(2))
    >>> load_solver().solve(*measured(batch, recipe)).image.shape
    torch.Size([2, 36, 36])
    """
    return Solver.load(str(files("specklegen.models") / "data" / f"{ANY_OBJECT}.pt"))
