"""The solver: takes camera images and the slab's memory effect, returns object, deviance and confidence.

Phase retrieval from the lags, divided by Wiener's two guesses, gives first answers; the unrolled network
(:mod:`specklegen.models.learning.networks.unrolled`) makes one of them, by the likelihood and by what it has learned.
Nothing in it depends on the size of the camera, on the window, or on the unit of the images.
"""

import os
from collections.abc import Sequence
from importlib.resources import files
from pathlib import Path
from typing import NamedTuple, Self

import numpy as np
import torch
from torch import Tensor

from specklegen.core.arguments import host_tensor, instance, whole_number
from specklegen.core.display.repr import short, summary
from specklegen.core.errors import reject
from specklegen.core.random_streams import Seed
from specklegen.core.shielded import shielded
from specklegen.models.learning.feedback import EXTENT, LAGS
from specklegen.models.learning.few_points import few_points
from specklegen.models.learning.model_file import read_model, restored, rounded, write_model
from specklegen.models.learning.networks.range_net import RangeNet
from specklegen.models.learning.networks.unrolled import BRIEFLY, Candidates, Seen, Unrolled, settled
from specklegen.models.learning.posterior import Posterior, load_prior, posterior
from specklegen.models.learning.reconstructor import centred
from specklegen.models.likelihood.certificate import Certificate
from specklegen.models.likelihood.likelihood import Optics, SpeckleLikelihood, expected_deviance
from specklegen.models.likelihood.periodogram import Periodogram
from specklegen.models.metrics import align, pearson
from specklegen.models.retrieval import wiener
from specklegen.models.retrieval.autocorrelation import MemoryEffect, at_distances, distances
from specklegen.models.retrieval.edges import shares_of
from specklegen.models.retrieval.phase_retrieval import Retrieval, retrieve

ANY_OBJECT = "any-object"
"""Solver that comes with the package; its card lies beside it, and in docs/networks.md."""
RESTARTS = Retrieval(restarts=2, steps=4, error_reduction=20, extent=EXTENT)
"""Of phase retrieval, from each guess."""
LONG = Retrieval(restarts=10, extent=EXTENT)
"""Of phase retrieval, for an image that draws begin at."""
GUESSES: tuple[wiener.Division, ...] = ("dense", "empirical")
EVIDENCE = (
    "excess of the settled deviance", "excess of the image's own over that", "excess of the best answer's over that",
    "excess of the first image's over the best answer's", "excess on the other half of the data",
    "agreement with the settled image", "agreement with the first image", "agreement with the stage before",
    "agreement with the first image of one half", "agreement with that of the other", "agreement of these two",
    "agreement with the most probable answer", "best agreement with an answer", "mean agreement with the answers",
    "filled share", "blur", "logarithm of the looks", "logarithm of the grain in object pixels",
    "noise of a lag (logarithm / 5 + 1.5)", "half the logarithm of the looks", "C_I over 14 object pixels",
    "C_I over 27 object pixels", "square of the filled share", "filled share times blur",
    "blur times agreement with the stage before",
)  # fmt: skip
"""What the numbers of :func:`evidence_of` are."""
THIRD = ("skewness without the object", "its square", "its product with the noise of a lag")
"""What is added of the camera images themselves (:mod:`specklegen.models.likelihood.third_order`)."""
PATCH = (0.12, 0.3)
"""Filled share above, and blur below, which no confidence is stated (docs/networks.md)."""


class Solution(NamedTuple):
    """Result, of B objects.

    Attributes
    ----------
    image : float32[B, n, n]
        Brightness 0 to 1, up to shift and 180-degree turn, on a frame of n pixels.
    settled : float32[B, n, n]
        The most probable image near it, after a few steps down the likelihood alone.
    deviance : float32[B]
        Of the settled image; that of the true object is ``expected_deviance(looks)``, 0.577 for one look.
    log_likelihood : float32[B]
        Of the settled image, less that of a spectrum equal to the periodogram.
    probability : float32[B]
        Confidence: that the image's correlation with the true object, on the object's 28 x 28 pixels, exceeds 0.8. NaN
        where it is not calibrated for what was measured (:func:`silenced`).
    evidence : float32[B, e]
        What the confidence model was read from; see :func:`evidence_of`.
    points : int64[B]
        How many points the image is of, where few points explain what was measured; 0 where the network made it.
    """

    image: Tensor
    settled: Tensor
    deviance: Tensor
    log_likelihood: Tensor
    probability: Tensor
    evidence: Tensor
    points: Tensor

    __repr__ = short


class Solver:
    """An unrolled network with all that it needs.

    Attributes
    ----------
    network : Unrolled
    certificate : Certificate
        Reads the probability of success from the evidence.
    ranges : RangeNet
        Reads the memory-effect range off images of a slab that nobody knows.
    points : Certificate or None
        Reads it from the evidence of constellations (:mod:`specklegen.models.learning.few_points`); None where they are
        not searched for.
    third : Certificate or None
        Reads it from the evidence and the third order of the camera images, :data:`THIRD`, where these are at hand.

    Examples
    --------
    >>> from specklegen.models import load_solver
    >>> load_solver().certificate is not None
    True
    """

    def __init__(
        self, network: Unrolled, certificate: Certificate, ranges: RangeNet, points: Certificate | None = None,
        third: Certificate | None = None,
    ) -> None:  # fmt: skip
        self.network, self.certificate, self.ranges = network, certificate, ranges
        self.points, self.third = points, third

    def __repr__(self) -> str:
        return summary(self, frame=self.network.frame, side=self.network.side, stages=self.network.count)

    @shielded()
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
        """
        seen, likelihood, between, at_lags = self._measured("solve", seen, optics, memory)
        shown = first_look(likelihood, at_lags, self.network.frame, seed)
        return self._solved(seen, likelihood, between, at_lags, shown)

    def _measured(
        self, verb: str, seen: Periodogram, optics: Optics, memory: Sequence[MemoryEffect]
    ) -> tuple[Periodogram, SpeckleLikelihood, Tensor, Tensor]:
        """Return periodogram, its likelihood, and C_I between the pixels of the frame and at every lag."""
        if len(memory) != len(seen.power):
            reject(f"{verb} memory", f"one for each of {len(seen.power)} objects", len(memory))
        seen = seen._replace(power=seen.power.float(), noise=seen.noise.float())
        n = self.network.frame
        likelihood = SpeckleLikelihood(seen, (n, n), optics)
        steps = np.arange(1 - n, n)
        between = torch.stack([at_distances(c_i, np.hypot(steps[:, None], steps)).float() for c_i in memory])
        at_lags = torch.stack([at_distances(c_i, distances(LAGS)).float() for c_i in memory])
        return seen, likelihood, between, at_lags

    def _solved(
        self, seen: Periodogram, likelihood: SpeckleLikelihood, between: Tensor, at_lags: Tensor, shown: Seen
    ) -> Solution:
        """Refine what was seen at first."""
        self.network.eval()

        def deviance(objects: Tensor) -> Tensor:
            return likelihood(objects, between[:, None])

        begun = self.network.candidates(shown, deviance)
        images = [image.detach() for image in self.network.refined(begun, deviance)]
        evidence = evidence_of(self.network, images, begun, likelihood, between, at_lags)
        image, probability = images[-1], self.certificate(evidence)
        count = torch.zeros(len(image), dtype=torch.int64)
        if self.points is not None:
            for place, few in enumerate(few_points(image, begun, likelihood, between, self.network.answers)):
                if few is not None:
                    image[place], count[place] = few.image, few.points
                    probability[place] = self.points(few.evidence)
        spoken = torch.tensor([not reason for reason in silenced(evidence, likelihood.taper)])
        probability = torch.where(spoken, probability, float("nan"))
        (near,), (least_deviance,) = (x.unbind(1) for x in settled(image[:, None], deviance))
        log = -seen.looks * likelihood.frequencies * least_deviance
        return Solution(centred(image), centred(near), least_deviance, log, probability, evidence, count)

    @shielded()
    def posterior(
        self, seen: Periodogram, optics: Optics, memory: Sequence[MemoryEffect], *, draws: int = 8, seed: Seed = 0,
        solved: Solution | None = None, first: Tensor | None = None,
    ) -> Posterior:  # fmt: skip
        """Draw pictures that explain what was measured, and weigh them; see :mod:`.posterior`.

        Parameters
        ----------
        seen
            Of B objects; :func:`~specklegen.models.likelihood.periodogram.periodogram`.
        optics
            Steps between object pixels, grains, window.
        memory
            C_I of the slab before each of them.
        draws
            How many, 2 to 64; the first half begins at noise, the others at the solver's image and at that of ten
            restarts of phase retrieval.
        seed
            Of phase retrieval's starts and of the noise.
        solved
            What :meth:`solve` found of them; it is asked where it was not.
        first
            Images instead of phase retrieval's, float[B, K, n, n] on the frame of the solver, with at least one bright
            pixel each.

        Raises
        ------
        RuleError
            If there is not one memory effect, one solution, and a first image of that frame, for each object, or the
            number of draws is no such number.

        Examples
        --------
        >>> from specklegen.datasets import load_recipe
        >>> from specklegen.models import load_solver
        >>> from specklegen.models.learning.measurement import measured
        >>> recipe = load_recipe("one-angular-size")
        >>> batch = recipe.batch(0, "test", range(1))
        >>> load_solver().posterior(*measured(batch, recipe), draws=2).draws.shape
        torch.Size([1, 2, 36, 36])
        """
        count = whole_number("posterior draws", draws, 2, 64)
        if solved is not None and len(instance("posterior solved", solved, Solution).image) != len(memory):
            reject("posterior solved", f"one for each of {len(memory)} objects", len(solved.image))
        begun = None if first is None else self._first(first, len(memory))
        seen, likelihood, between, at_lags = self._measured("posterior", seen, optics, memory)
        frame = self.network.frame
        if solved is None:
            solved = self._solved(seen, likelihood, between, at_lags, first_look(likelihood, at_lags, frame, seed))
        if begun is None:  # of two or three draws none begins at an image of phase retrieval
            begun = restarted(likelihood, at_lags, frame, seed) if count > 3 else solved.image[:, None]
        return posterior(load_prior(), likelihood, between, at_lags, solved.image, begun, count, seed)

    def _first(self, first: Tensor, count: int) -> Tensor:
        """First images of ``posterior``, checked; float32[B, K, n, n]."""
        images, n = host_tensor("posterior first", first).float(), self.network.frame
        if images.ndim != 4 or len(images) != count or not images.shape[1] or images.shape[2:] != (n, n):
            reject("posterior first", f"of shape [{count}, K, {n}, {n}], one object a row", tuple(images.shape))
        if not (images.amax((-2, -1)) > 0).all():
            reject("posterior first", "of at least one bright pixel each", float(images.amax((-2, -1)).min()))
        return images.clamp_min(0)

    def save(self, path: str | os.PathLike) -> None:
        """Write the solver, its weights rounded to eight bits.

        Parameters
        ----------
        path
            Of the file, which is written whole or not at all.
        """
        stated = {
            "name": "unrolled", "frame": self.network.frame, "side": self.network.side, "width": self.network.width,
            "stages": self.network.count, "answers": self.network.answers, "units": self.network.units,
            "blocks": self.network.blocks, "certificate": self.certificate._asdict(),
            "ranges": [self.ranges.side, self.ranges.units, self.ranges.count],
            "points": None if self.points is None else self.points._asdict(),
            "third": None if self.third is None else self.third._asdict(),
        }  # fmt: skip
        kept: dict[str, Tensor] = {}
        for key, weight in _weights(self.network, self.ranges).items():
            kept |= rounded(key, weight)
        write_model(Path(path), stated, kept)

    @classmethod
    @shielded()
    def load(cls, path: str | os.PathLike) -> Self:
        """Read a solver.

        Parameters
        ----------
        path
            Of a file that :meth:`save` wrote.
        """
        stated, kept = read_model(Path(path))
        weights = restored(kept)
        numbers: list[int] = []
        own: list[int] = []
        certificate = points = third = None
        try:
            numbers = [
                whole_number(f"model {name}", stated[name], 1, 2**10)
                for name in ("frame", "side", "width", "stages", "answers", "units", "blocks")
            ]
            own = [whole_number("model ranges", number, 1, 2**10) for number in stated["ranges"]]
            with torch.device("meta"):
                promised = _weights(Unrolled(*numbers), RangeNet(*own))
            certificate = Certificate.of(stated["certificate"])
            points, third = (
                None if stated.get(name) is None else Certificate.of(stated[name]) for name in ("points", "third")
            )
            fits = stated["name"] == "unrolled" and len(certificate.weights) == len(EVIDENCE)
            fits &= {key: value.shape for key, value in promised.items()} == {k: w.shape for k, w in weights.items()}
        except (KeyError, TypeError, ValueError, RuntimeError):
            fits = False
        if not fits or certificate is None:
            reject("model", "a file written by Solver.save", str(path))
        network, ranges = Unrolled(*numbers), RangeNet(*own)
        for prefix, net in ((_NETWORK, network), (_RANGES, ranges)):
            net.load_state_dict({key[len(prefix) :]: w for key, w in weights.items() if key.startswith(prefix)})
        return cls(network, certificate, ranges, points, third)


_NETWORK, _RANGES = "network.", "ranges."  # what the names of weights begin with


def _weights(network: Unrolled, ranges: RangeNet) -> dict[str, Tensor]:
    """Weights of both, by the names that they have in a file."""
    named = network.state_dict(prefix=_NETWORK) | ranges.state_dict(prefix=_RANGES)
    return dict(named)


def first_look(
    likelihood: SpeckleLikelihood, memory_effect: Tensor, frame: int, seed: Seed = 0,
    retrieval: Retrieval | None = RESTARTS,
) -> Seen:  # fmt: skip
    """Input of the network from periodograms.

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
    retrieval
        What it does from each guess; None for no answers, which is all that the dense net needs.
    """
    lags, variance, grain = lags_of(likelihood)
    weighted = {
        guess: lags * wiener.weights(lags, memory_effect, variance, side=EXTENT, grain=grain, guess=guess)
        for guess in GUESSES
    }
    answers = torch.zeros(len(lags), 0, frame, frame)
    if retrieval is not None:
        restarts = torch.cat(
            [retrieve(each.double(), retrieval, seed=seed).restarts for each in weighted.values()], dim=1
        )
        answers = _on_frame(restarts, frame)
    pictures = torch.fft.fftshift(torch.stack([lags, weighted["dense"]], dim=1), dim=(-2, -1))
    scalars = [
        *described(variance, grain, likelihood.looks).unbind(1),
        memory_effect[:, 0, EXTENT // 2].to(variance),
        memory_effect[:, 0, EXTENT - 1].to(variance),
    ]
    return Seen(pictures.float(), answers, torch.stack(scalars, dim=1).float())


def restarted(likelihood: SpeckleLikelihood, memory_effect: Tensor, frame: int, seed: Seed = 0) -> Tensor:
    """Phase retrieval's image of many restarts on a frame of n pixels, float[B, 1, n, n]; arguments of `first_look`."""
    lags, variance, grain = lags_of(likelihood)
    parts = (lags, memory_effect, variance)
    divided = []
    for n, guess in enumerate(wiener.choice(*parts, side=EXTENT, grain=grain)):
        own = slice(n, n + 1)
        factors = wiener.weights(*(part[own] for part in parts), side=EXTENT, grain=grain[own], guess=guess)
        divided.append(lags[own] * factors)
    found = retrieve(torch.cat(divided).double(), LONG, seed=seed)
    return _on_frame(found.image[:, None], frame)


def _on_frame(images: Tensor, frame: int) -> Tensor:
    """Images float[B, K, LAGS, LAGS] centred on a frame of n pixels, float[B, K, n, n]."""
    margin = (LAGS - frame) // 2
    return centred(images)[..., margin : margin + frame, margin : margin + frame].contiguous()


def lags_of(likelihood: SpeckleLikelihood) -> tuple[Tensor, Tensor, Tensor]:
    """Lags float[B, LAGS, LAGS] over their zero lag, which is first; their variance, and the grain in object pixels."""
    lags = likelihood.lags(LAGS)
    peak = lags[:, 0, 0].clamp_min(1e-9)
    return lags / peak[:, None, None], likelihood.lag_variance() / peak.square(), likelihood.grain / likelihood.step


def described(variance: Tensor, grain: Tensor, looks: float) -> Tensor:
    """Features of lags, in numbers of order one, float[B, 3]."""
    count = torch.full_like(variance, 0.5 * float(np.log(looks)))
    return torch.stack([grain.log(), 0.2 * variance.clamp_min(1e-12).log() + 1.5, count], dim=1)


def evidence_of(
    network: Unrolled, made: Sequence[Tensor], begun: Candidates, likelihood: SpeckleLikelihood, between: Tensor,
    memory_effect: Tensor,
) -> Tensor:  # fmt: skip
    """Numbers that tell a good image from a bad one without the object, float[B, e].

    Parameters
    ----------
    network
        What made the images.
    made, begun
        Of it: images after each stage, and what they began with.
    likelihood
        Of the measurement.
    between, memory_effect
        C_I between the pixels of the frame, and at every lag.
    """
    last = made[-1]

    def deviance(objects: Tensor, of: SpeckleLikelihood = likelihood) -> Tensor:
        return of(objects, between[:, None])

    def agreed(images: Tensor) -> Tensor:
        return pearson(align(images, last), last)

    (near,), (own,) = (x.unbind(1) for x in settled(last[:, None], deviance))
    halves = likelihood.thinned()
    held_out, starts = [], []
    for one, other in (halves, halves[::-1]):
        image, _ = settled(last[:, None], lambda x, one=one: deviance(x, one), *BRIEFLY)
        held_out.append(deviance(image, other)[:, 0].detach() - expected_deviance(other.looks))
        with torch.no_grad():
            starts.append(network.started(first_look(one, memory_effect, network.frame, retrieval=None)))
    with torch.no_grad():
        count = network.answers
        led, alone = begun.pictures[:, 2 : 2 + count], begun.pictures[:, 2 + count :]
        answers = torch.stack([agreed(each) for each in (*led.unbind(1), *alone.unbind(1))], dim=1)
        filled = last.mean((-2, -1)) / last.amax((-2, -1)).clamp_min(1e-6)
        sharpness = (last * (1 - last)).sum((-2, -1)) / last.sum((-2, -1)).clamp_min(1e-6)
        least, before = begun.deviances.amin(1), agreed(made[-2])
        return torch.stack(
            [
                own - expected_deviance(likelihood.looks), deviance(last[:, None])[:, 0] - own, least - own,
                begun.deviances[:, 0] - least, (held_out[0] + held_out[1]) / 2, pearson(near, last),
                agreed(made[0]), before, agreed(starts[0]), agreed(starts[1]),
                pearson(align(starts[0], starts[1]), starts[1]), answers[:, 0], answers.amax(1), answers.mean(1),
                filled, sharpness, torch.full_like(own, float(np.log(likelihood.looks))), *begun.scalars.unbind(1),
                filled.square(), filled * sharpness, sharpness * before,
            ], dim=1,
        )  # fmt: skip


def with_third(evidence: Tensor, skewness: Tensor) -> Tensor:
    """Evidence float[B, e] with :data:`THIRD`, float[B, e + 3], of skewness float[B]."""
    skewness = skewness.to(evidence)
    noise = evidence[:, EVIDENCE.index("noise of a lag (logarithm / 5 + 1.5)")]
    return torch.cat([evidence, torch.stack([skewness, skewness.square(), noise * skewness], dim=1)], dim=1)


def silenced(evidence: Tensor, taper: Tensor | float) -> list[str]:
    """Why no confidence is stated for images of some evidence and taper; empty where one may be."""
    reasons = []
    filled, blur = (evidence[:, EVIDENCE.index(name)].tolist() for name in ("filled share", "blur"))
    for n, share in enumerate(shares_of(taper, len(evidence))):
        patch = filled[n] > PATCH[0] and blur[n] < PATCH[1]
        reasons.append(
            f"the illumination is uneven, and a taper covers {share:.2g} of each side: calibration covers even "
            "illumination"
            if share else
            f"the object fills {filled[n]:.2f} of the frame and has hardly an edge (blur {blur[n]:.2f}): missing fine "
            "detail would not be detected" if patch else ""
        )  # fmt: skip
    return reasons


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
