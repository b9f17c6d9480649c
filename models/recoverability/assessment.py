"""The judgement after the image: the object, how sure it is, and what would help.

A setup is a recipe with hidden objects: its window, camera, slab, and how large an object pixel appears. The slab may
be given as ranges. Then one range is fitted to all the images, which were taken through one slab.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import torch
from scipy.special import polygamma
from torch import Tensor

from specklegen.core.arguments import flag, host_tensor, instance, positive_number, whole_number
from specklegen.core.display.plot import SHOWN, Pictured, draw_images
from specklegen.core.errors import reject
from specklegen.core.random_streams import Seed
from specklegen.core.shielded import shielded
from specklegen.datasets.distributions import ends
from specklegen.datasets.recipes.hidden_object import HiddenObject
from specklegen.datasets.recipes.materials import characterized_materials
from specklegen.datasets.recipes.parts.material import CharacterizedMaterial
from specklegen.measured.curve import MeasuredCurve
from specklegen.measured.measurement import Measurement
from specklegen.models.learning.measurement import TILE, memory_effect_of, seen_by_camera
from specklegen.models.learning.posterior import Posterior
from specklegen.models.learning.range_fit import RangeFit, fit_range, scaled
from specklegen.models.learning.solver import (
    EVIDENCE,
    EXTENT,
    THIRD,
    MemoryEffect,
    Solution,
    Solver,
    load_solver,
    silenced,
    with_third,
)  # fmt: skip
from specklegen.models.likelihood.likelihood import Optics, SpeckleLikelihood, expected_deviance
from specklegen.models.likelihood.periodogram import Periodogram
from specklegen.models.likelihood.third_order import CLAIMED, third_moments
from specklegen.models.metrics import Alignment, alignment, move
from specklegen.models.recoverability.autocorrelation_error import Conditions
from specklegen.models.recoverability.speckle_test import SpeckleTest, speckle_test
from specklegen.models.recoverability.verdict import Reason, conditions_of, judge
from specklegen.models.retrieval.autocorrelation import at_distances
from specklegen.models.retrieval.measured_memory_effect import measured_memory_effect

_DRAWN = 15
"""Materials of a setup with ranges, of which the middle one gives the shape of C_I."""
_FEWEST = 4
"""Images that a range is fitted to, at least."""
_SURPRISE = 5.0
"""Spreads of the deviance by which it may exceed its expectation before the setup itself is doubted."""
_OWN = 0.01
"""Of the deviance, spread by which the solver's search ends elsewhere for another rounding; see docs/versioning.md."""
_NO_SPECKLE = "no speckle of this setup"
_UNLIKE = "No confidence"
_TRY_OTHER = "compare the deviances, look at several draws, or test a known object in the same setup"
_TAKE_OFF = "remove background and envelope; check illuminated area, slab, object pitch, polarisation, bandwidth"
_TURN_SLOPE = 0.6
"""Logarithm of the odds that a spread of third order is worth, of the solver's images; see docs/notes/likelihood.md."""
_WITHIN = 0.5
"""Memory effect across an object, from which on its turn is told at all."""
_LIT = 0.2  # of the brightest pixel: what counts as the object
_MISFIT = Reason(
    "the setup differs from its description", "no reconstructed object explains the image",
    "check illuminated area, pixel pitch, object pitch, camera noise, and the envelope of the light",
)  # fmt: skip


class Setup(NamedTuple):
    """A setup in the terms of the likelihood.

    Attributes
    ----------
    memory_effect : MemoryEffect
        C_I over object pixels; where the slab is not known, of the middle one of its ranges.
    known : bool
        Whether the slab is.
    range_sine : float
        Memory-effect range of that slab, direction sine.
    pitch : float
        Direction sine between object pixels.
    contrast : (float, float)
        Smallest and largest contrast of the speckle of one point: with and without what the camera adds.
    """

    optics: Optics
    memory_effect: MemoryEffect
    known: bool
    range_sine: float
    pitch: float
    contrast: tuple[float, float]


def setup_of(recipe: HiddenObject) -> Setup:
    """Setup that a recipe describes."""
    if recipe.fits_window:
        reject("setup window.width", "a length", "fitted", "Give the width of the illuminated area of your setup.")
    field = recipe.field
    known = not recipe.material.varies
    if field is not None and field.pitch is None and not known:
        reject("setup field", "given by its pitch, since the slab is unknown", field.model_dump(),
               "Give the direction sine between object pixels.")  # fmt: skip
    material: Any = recipe.material  # a slab's, or a diffuser's
    materials: list[Any] = [recipe.material_of(0, "train", n) for n in range(1 if known else _DRAWN)]
    middle: CharacterizedMaterial = sorted(materials, key=lambda each: each.half_range)[len(materials) // 2]
    low, high = ends((field.pitch or field.extent_over_range or 1.0) if field is not None else 1.0)
    one = characterized_materials(material, [middle], recipe.wavelength, torch.device("cpu"))
    share = torch.full_like(one.half_range, float(np.sqrt(low * high)))
    pitch = float(recipe.pitches(one, share)[0]) * max(recipe.objects.shape) / EXTENT
    seen = recipe.geometry
    optics = Optics(
        pitch / seen.grid.pitch, recipe.wavelength / seen.width / seen.grid.pitch, seen.profile, seen.pixel_integration
    )
    memory = memory_effect_of(middle.correlation, recipe.wavelength, pitch)
    return Setup(optics, memory, known, middle.range_sine(recipe.wavelength), pitch, _contrast(recipe))


def _with_curve(setup: Setup, curve: MeasuredCurve) -> Setup:
    """Setup whose memory effect was measured, over pixels of the camera."""
    c_i = measured_memory_effect(curve.at / float(setup.optics.step), curve.values)
    distance = np.linspace(0, curve.at[-1] / float(setup.optics.step), 1000)
    below = np.flatnonzero(c_i(distance) < 0.5)
    half = distance[below[0]] * setup.pitch if len(below) else float("inf")
    return setup._replace(memory_effect=c_i, known=True, range_sine=half)


def _contrast(recipe: HiddenObject) -> tuple[float, float]:
    """Contrast of the speckle of one point, background, dark current and offset of the camera left in and taken off."""
    contrast, camera = conditions_of(recipe).contrast, recipe.exposure
    if camera is None:
        return contrast, contrast
    added = camera.background + camera.dark_current * camera.exposure + camera.offset * camera.gain
    return contrast * camera.photons / (camera.photons + added), contrast


@dataclass(frozen=True, repr=False)
class Finding(Pictured):
    """Estimates from one image.

    Attributes
    ----------
    image : float32[n, n]
        Brightness 0 to 1, up to a shift; up to a turn by 180 degrees too, where that is not told. The mean of the draws
        and the solver's image; of few points where these explain the camera image; without draws the solver's image.
    turn : float or None
        Probability that the image is the right way up, from the third order of the camera image
        (:func:`~specklegen.models.likelihood.third_order.turn_of`). None where it is not stated: where it is below 0.9,
        the image itself is likelier wrong than right, or the object is wider than the memory-effect range.
    draws : Posterior or None
        Pictures that explain the camera image, of one object, the right way up where that is told; None without any.
    deviance, expected : float
        Of the solver's image, settled, and what that of the true object is expected to be.
    probability : float or None
        Confidence: that the correlation with the true object exceeds 0.8, on the object's 28 x 28 pixels, as the pages
        score it. None where the image is no speckle of the setup, unlike all that the confidence was fitted to, seen
        under a taper since its light falls off, or a patch of light without edges; the reasons say which.
    reasons : tuple of Reason
        What stands in the way, and what would help: where that is less likely than not, where nothing that was found
        explains the image, where it is no speckle of the setup, and where the confidence model is silent.
    speckle : SpeckleTest
        What says whether it is.
    """

    image: np.ndarray
    deviance: float
    expected: float
    probability: float | None
    reasons: tuple[Reason, ...]
    speckle: SpeckleTest
    turn: float | None = None
    draws: Posterior | None = None

    def _facts(self) -> Mapping[str, object]:
        reasons = {each.name: f"{each.numbers}. Remedy: {each.remedy}" for each in self.reasons}
        stated: dict[str, object] = {} if self.probability is None else {"probability": self.probability}
        stated |= {} if self.turn is None else {"probability of the turn": self.turn}
        stated |= {} if self.draws is None else {"agreement of draws": float(self.draws.agreement[0])}
        return stated | {"deviance": self.deviance, "expected": self.expected} | reasons

    def _draw(self, axes: Any, label: str | None = None) -> None:
        """Reconstruction."""
        draw_images(axes, self.image[None], high=1.0)


@dataclass(frozen=True, repr=False)
class Findings(Pictured):
    """Estimates from all images together.

    Attributes
    ----------
    range_sine : float
        Memory-effect range of the slab, direction sine: that of the setup, or the one that was fitted.
    fit : RangeFit or None
        Where the slab was not known.
    """

    each: tuple[Finding, ...]
    range_sine: float
    fit: RangeFit | None

    def _facts(self) -> Mapping[str, object]:
        sure = sum((each.probability or 0.0) >= 0.5 for each in self.each)
        fitted = "given" if self.fit is None else "fitted"
        return {"images": len(self.each), "probably right": sure, f"range, sine ({fitted})": self.range_sine}

    def _draw(self, axes: Any, label: str | None = None) -> None:
        """Reconstructions of the first images, each with its probability."""
        shown = self.each[:SHOWN]
        images = np.stack([each.image for each in shown])
        draw_images(axes, images, [
            "no confidence" if each.probability is None else f"p = {each.probability:.2f}" for each in shown
        ], high=1.0)  # fmt: skip


@shielded()
def reconstruct(
    images: Tensor | Measurement, setup: HiddenObject, *, frames: bool = False,
    memory_effect: MeasuredCurve | None = None, grain: float | None = None, fit: bool | None = None,
    solver: Solver | None = None, draws: int | None = None, fast: bool = False, seed: Seed = 0,
) -> Findings:  # fmt: skip
    """Reconstruct objects from camera images, with a confidence for each.

    Parameters
    ----------
    images
        real[B, F, H, W]: B objects behind one slab, each in F frames through other states of its medium. Any unit
        without an offset; camera noise is read off the images. Or what :func:`specklegen.measured.read_measurement`
        read: its light over its envelope, an object a frame.
    setup
        Recipe with hidden objects that describes the setup; its camera gives the pitch, not the size.
    frames
        Whether the frames of a measurement show one object through other states of the medium.
    memory_effect
        C_I as it was measured, at distances on the camera in pixels, instead of the setup's own; by default that is
        taken.
    grain
        Camera pixels in a grain, as they were measured (:func:`~specklegen.models.calibration.grain_fit.fit_grain`),
        by default those of the setup.
    fit
        Whether to fit the memory-effect range; by default, where the setup leaves the slab open and there are at least
        four images.
    solver
        By default the one that comes with the package.
    draws
        How many pictures to draw of each object (:meth:`~specklegen.models.learning.solver.Solver.posterior`), whose
        mean is the answer; 0 for none, else at least 2. By default 8, and 4 of cameras above 160 pixels a side.
    fast
        Whether to draw none, whatever ``draws``: the answer is the solver's image, in a seventh of the time.
    seed
        Of phase retrieval's starts, and of the noise of draws.

    Raises
    ------
    RuleError
        If the images are not of that shape, or the setup leaves open what it must know.

    Examples
    --------
    >>> import torch
    >>> from specklegen.datasets import load_recipe
    >>> from specklegen.models import reconstruct
    >>> setup = load_recipe("through-slab", {"material": {"kernel_paths": 1000}})
    >>> images = torch.from_numpy(setup.batch(0, "test", range(1))["image"])[:, None]
    >>> found = reconstruct(images, setup)
    >>> found.each[0].image.shape
    (36, 36)
    """
    flag("reconstruct frames", frames)
    if draws is not None and draws != 0:
        whole_number("reconstruct draws", draws, 2, 64)
    if isinstance(images, Measurement):
        stack = torch.from_numpy(images.images)
        images = stack[None] if frames else stack[:, None]
    elif frames:
        reject("reconstruct frames", "False of a tensor, whose second axis numbers frames", frames)
    images = host_tensor("reconstruct images", images)
    if images.ndim != 4 or not images.numel():
        reject("reconstruct images", "of shape [objects, frames, rows, columns]", tuple(images.shape))
    if draws is None:
        draws = 8 if max(images.shape[-2:]) <= TILE else 4
    draws = 0 if flag("reconstruct fast", fast) else draws
    setup.warn_of_implausible()
    own = setup_of(setup)
    if memory_effect is not None:
        own = _with_curve(own, instance("reconstruct memory_effect", memory_effect, MeasuredCurve))
    if grain is not None:
        own = own._replace(optics=own.optics._replace(grain=positive_number("reconstruct grain", grain)))
    solver = solver or load_solver()
    grains = torch.full((len(images),), float(own.optics.grain))
    disc = "disc" if own.optics.profile == "disc" else None  # whose corners hold noise alone; of others the images tell
    seen = seen_by_camera(images, grains, camera=setup.exposure or "unknown", profile=disc)
    memory = [own.memory_effect] * len(images)
    fitted = None
    if fit if fit is not None else not own.known and len(images) >= _FEWEST:
        fitted = fit_range(solver, seen, own.optics, memory)
    factor = fitted.factor if fitted is not None else 1.0
    memory = [scaled(own.memory_effect, factor)] * len(images)
    solution = solver.solve(seen, own.optics, memory, seed=seed)
    tests = _tested(images, solution, seen, own, memory)
    camera = float(np.sqrt(images.shape[-1] * images.shape[-2])) / float(own.optics.grain)
    third = _third(images, solution, seen, own, tests)
    solution, silent = _certified(solution, third, solver, seen)
    turned, probabilities = _turns(solution, memory, third)
    drawn = solver.posterior(seen, own.optics, memory, draws=draws, seed=seed, solved=solution) if draws else None
    own_draws = [None if drawn is None else _of_one(drawn, n, solution.image[n], turned[n]) for n in range(len(images))]
    each = tuple(
        Finding(
            _answer(solution, n, turned[n], own_draws[n]).numpy(), float(solution.deviance[n]),
            expected_deviance(seen.looks),
            float(solution.probability[n]) if tests[n].passes and not silent[n] else None,
            _reasons(solution, n, seen, own, memory[n], camera, images.shape[1], tests[n], silent[n]), tests[n],
            probabilities[n], own_draws[n],
        )
        for n in range(len(images))
    )  # fmt: skip
    return Findings(each, own.range_sine * factor, fitted)


def _third(
    images: Tensor, solution: Solution, seen: Periodogram, setup: Setup, tests: tuple[SpeckleTest, ...]
) -> Tensor:
    """Third order of camera images with each reconstruction, float64[B, 2]; NaN of what is no speckle."""
    moments = torch.full((len(images), 2), float("nan"), dtype=torch.float64)
    for n, test in enumerate(tests):
        if test.passes:
            noise = float(seen.noise[n].clamp_min(0))
            moments[n] = third_moments(images[n : n + 1], solution.image[n : n + 1].double(), setup.optics, noise)[0]
    return moments


def _certified(solution: Solution, third: Tensor, solver: Solver, seen: Periodogram) -> tuple[Solution, list[str]]:
    """Solution with the probabilities that the third order adds to, and why there is none; empty where there is one."""
    certificate, evidence, names = solver.certificate, solution.evidence, EVIDENCE
    silent = silenced(evidence, seen.taper)
    if solver.third is not None:
        certificate, names = solver.third, (*EVIDENCE, *THIRD)
        evidence = with_third(evidence, third[:, 1])
        kept = (solution.points > 0) | torch.tensor([bool(reason) for reason in silent])
        probability = torch.where(kept, solution.probability, certificate(evidence))
        solution = solution._replace(probability=probability)
    for n in torch.nonzero(solution.probability.isnan()).flatten().tolist():
        far = [] if solution.points[n] else torch.nonzero(certificate.unlike(evidence[n])).flatten().tolist()
        silent[n] = silent[n] or "; ".join(
            _beyond(names[k], float(evidence[n, k]), float(certificate.low[k]), float(certificate.high[k])) for k in far
        ) or "the image is outside the range of images that the confidence is calibrated for"
    return solution, silent


def _beyond(name: str, value: float, low: float, high: float) -> str:
    """Say which number lies outside of those that a confidence model knows; of a logarithm the number itself."""
    plain = name.removeprefix("logarithm of the ")
    if plain != name:
        value, low, high = math.exp(value), math.exp(low), math.exp(high)
    return f"{plain} {value:.3g} is outside the calibrated range {low:.3g} to {high:.3g}"


def _turns(solution: Solution, memory: list[MemoryEffect], third: Tensor) -> tuple[list[bool], list[float | None]]:
    """Return whether each image is upside down, and the probability of that; None where it is not stated."""
    turned: list[bool] = [False] * len(third)
    probabilities: list[float | None] = [None] * len(third)
    for n, spreads in enumerate(third[:, 0].tolist()):
        if not solution.probability[n] >= 0.5 or not np.isfinite(spreads):
            continue
        lit = torch.nonzero(solution.image[n] > _LIT * solution.image[n].max())
        side = float((lit.amax(0) - lit.amin(0)).max())
        if memory[n](np.array([side]))[0] < _WITHIN:
            continue
        probability = float(1 / (1 + np.exp(-_TURN_SLOPE * abs(spreads))))
        if probability >= CLAIMED:
            turned[n], probabilities[n] = spreads < 0, probability
    return turned, probabilities


def _answer(solution: Solution, n: int, turned: bool, drawn: Posterior | None) -> Tensor:
    """Return the mean of the draws; few points where these explain the image; without draws the solver's image."""
    return _upright(solution.image[n], turned) if drawn is None or solution.points[n] else drawn.mean[0]


def _upright(image: Tensor, turned: bool) -> Tensor:
    """Images [..., n, n] turned by 180 degrees, or not."""
    return image.flip((-2, -1)) if turned else image


def _of_one(drawn: Posterior, n: int, image: Tensor, turned: bool) -> Posterior:
    """Draws of one object, all pictures moved together as the best one is moved onto the solver's image."""
    own = Posterior(*(each[n : n + 1] for each in drawn))
    motion = alignment(own.best[0], image)
    moved = {
        name: _upright(move(picture, Alignment(*(x.expand(picture.shape[:-2] + x.shape) for x in motion))), turned)
        for name in ("mean", "best", "draws", "certain") for picture in (getattr(own, name),)
    }  # fmt: skip
    return own._replace(**moved)


def _tested(
    images: Tensor, solution: Solution, seen: Periodogram, setup: Setup, memory: list[MemoryEffect]
) -> tuple[SpeckleTest, ...]:
    """Test whether the images are speckle of the setup, with the reconstructions that were made of them."""
    n = solution.image.shape[-1]
    steps = np.arange(1 - n, n)
    between = torch.stack([at_distances(c_i, np.hypot(steps[:, None], steps)).float() for c_i in memory])
    seen = seen._replace(power=seen.power.float(), noise=seen.noise.float())
    likelihood = SpeckleLikelihood(seen, (n, n), setup.optics)
    return speckle_test(images, solution.image, solution.deviance, likelihood, between, setup.contrast)


def _reasons(
    solution: Solution, n: int, seen: Periodogram, setup: Setup, memory_effect: MemoryEffect, camera: float,
    frames: int, test: SpeckleTest, silent: str,
) -> tuple[Reason, ...]:  # fmt: skip
    """Advice, judged for an object like the one that was found, and whether there is reason for doubt."""
    if not test.passes:
        return (Reason(_NO_SPECKLE, test.words, _TAKE_OFF),)
    # Of m looks the deviance of n frequencies has the variance (psi'(m) - 1 / m) / n.
    count = float(-solution.log_likelihood[n] / seen.looks / solution.deviance[n].clamp_min(1e-6))
    spread = float(np.hypot(np.sqrt((polygamma(1, seen.looks) - 1 / seen.looks) / count), _OWN))
    surprised = float(solution.deviance[n]) - expected_deviance(seen.looks) > _SURPRISE * spread
    misfit = (_MISFIT,) if surprised else ()
    if silent:
        return (Reason(_UNLIKE, silent, _TRY_OTHER), *misfit)
    if solution.probability[n] >= 0.5:
        return misfit
    grain, step = float(setup.optics.grain), float(setup.optics.step)
    noise = float(seen.noise[n])
    c_i = np.asarray(memory_effect(np.arange(int(np.ceil(EXTENT * np.sqrt(2))) + 1.0))).clip(0, 1)
    margin = (solution.image.shape[-1] - EXTENT) // 2
    inside = slice(margin, margin + EXTENT)
    conditions = Conditions(
        objects=solution.image[n : n + 1, inside, inside].double().numpy() + 1e-9, object_pitch=step / grain,
        memory_effect=np.concatenate([[1.0], c_i[1:]]), camera=camera, frames=float(frames),
        electrons=grain**2 / noise if noise > 0 else float("inf"), profile=setup.optics.profile,
    )  # fmt: skip
    return (*judge(conditions).reasons, *misfit) or (_MISFIT,)
