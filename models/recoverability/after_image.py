"""The verdict after the image: what the object looks like, how sure that is, and what would help.

A bench is a recipe with hidden objects: its window, camera, slab, and how large an object pixel appears. The slab may
be given as ranges. Then one range is fitted to all the images, which were taken through one slab.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import torch
from torch import Tensor

from specklegen.core.errors import reject
from specklegen.core.picturing import SHOWN, Pictured, draw_images
from specklegen.core.random_streams import Seed
from specklegen.core.showing import short
from specklegen.datasets.recipes.hidden_object import HiddenObject
from specklegen.datasets.recipes.parts.distributions import ends
from specklegen.datasets.recipes.parts.material import KnownMaterial
from specklegen.models.learning.measurement import memory_effect_of, seen_by_camera
from specklegen.models.learning.range_fit import RangeFit, fit_range, scaled
from specklegen.models.learning.solver import EXTENT, MemoryEffect, Solution, Solver, load_solver
from specklegen.models.likelihood.likelihood import Optics, expected_deviance
from specklegen.models.likelihood.periodogram import Periodogram
from specklegen.models.recoverability.autocorrelation_error import Conditions
from specklegen.models.recoverability.verdict import Reason, judge

_DRAWN = 15
"""Materials of a bench with ranges, of which the middle one gives the shape of C_I."""
_FEWEST = 4
"""Images that a range is fitted to, at least."""
_SURPRISE = 5.0
"""Spreads of the deviance by which it may exceed its expectation before the bench itself is doubted."""
_MISFIT = Reason(
    "the bench is not what it is said to be", "no object that was found explains the image",
    "check window width, pixel pitch, object pitch, camera noise, and the envelope of the light",
)  # fmt: skip


class Bench(NamedTuple):
    """A bench in the terms of the likelihood.

    Attributes
    ----------
    optics : Optics
    memory_effect : MemoryEffect
        C_I over object pixels; where the slab is not known, of the middle one of its ranges.
    known : bool
        Whether the slab is.
    range_sine : float
        Memory-effect range of that slab, direction sine.
    pitch : float
        Direction sine between object pixels.
    """

    optics: Optics
    memory_effect: MemoryEffect
    known: bool
    range_sine: float
    pitch: float


def bench_of(recipe: HiddenObject) -> Bench:
    """Bench that a recipe describes.

    Raises
    ------
    RuleError
        If the recipe leaves open what a bench must know: the window, and the size of an object pixel.
    """
    if recipe.fits_window:
        reject("bench window.width", "a length", "fitted", "State the width of the window of your bench.")
    field = recipe.field
    known = not recipe.material.varies
    if field is not None and field.pitch is None and not known:
        reject("bench field", "given by its pitch where the slab is not known", field.model_dump(),
               "State the direction sine between object pixels.")  # fmt: skip
    materials = [recipe.material_of(0, "train", n) for n in range(1 if known else _DRAWN)]
    middle: KnownMaterial = sorted(materials, key=lambda each: each.half_range)[len(materials) // 2]
    low, high = ends((field.pitch or field.extent_over_range or 1.0) if field is not None else 1.0)
    pitch = recipe.pitch(middle, float(np.sqrt(low * high))) * max(recipe.objects.shape) / EXTENT
    seen = recipe.geometry
    optics = Optics(
        pitch / seen.grid.pitch, recipe.wavelength / seen.width / seen.grid.pitch, seen.profile, seen.pixel_integration
    )
    memory = memory_effect_of(middle.kernel, recipe.wavelength, pitch)
    return Bench(optics, memory, known, middle.range_sine(recipe.wavelength), pitch)


@dataclass(frozen=True)
class Finding(Pictured):
    """What one image tells.

    Attributes
    ----------
    image : float32[n, n]
        Brightness 0 to 1, up to shift and 180-degree turn.
    deviance, expected : float
        Of the image, and what that of the true object is expected to be.
    probability : float
        Certificate: that the correlation with the true object exceeds .8.
    reasons : tuple of Reason
        Where that is less likely than not: what stands in the way, and what would help.
    """

    image: np.ndarray
    deviance: float
    expected: float
    probability: float
    reasons: tuple[Reason, ...]

    __repr__ = short

    def _facts(self) -> Mapping[str, object]:
        told = {each.name: f"{each.numbers}. Remedy: {each.remedy}" for each in self.reasons}
        return {"probability": self.probability, "deviance": self.deviance, "expected": self.expected} | told

    def _draw(self, axes: Any, label: str | None = None) -> None:
        """What was reconstructed."""
        draw_images(axes, self.image[None], high=1.0)
        axes.set_title(label or "")


@dataclass(frozen=True)
class Findings(Pictured):
    """What the images tell together.

    Attributes
    ----------
    each : tuple of Finding
    range_sine : float
        Memory-effect range of the slab, direction sine: that of the bench, or the one that was fitted.
    fit : RangeFit or None
        Where the slab was not known.
    """

    each: tuple[Finding, ...]
    range_sine: float
    fit: RangeFit | None

    __repr__ = short

    def _facts(self) -> Mapping[str, object]:
        sure = sum(each.probability >= 0.5 for each in self.each)
        fitted = "given" if self.fit is None else "fitted"
        return {"images": len(self.each), "likelier right than not": sure, f"range, sine ({fitted})": self.range_sine}

    def _draw(self, axes: Any, label: str | None = None) -> None:
        """What was reconstructed of the first images, each with its probability."""
        shown = self.each[:SHOWN]
        images = np.stack([each.image for each in shown])
        draw_images(axes, images, [f"p = {each.probability:.2f}" for each in shown], high=1.0)
        axes.set_title(label or "")


def see_through(
    images: Tensor, bench: HiddenObject, *, fit: bool | None = None, solver: Solver | None = None, seed: Seed = 0
) -> Findings:
    """Reconstruct objects from camera images, with a certificate for each.

    Parameters
    ----------
    images
        real[B, F, H, W]: B objects behind one slab, each in F frames through other states of its medium. Any unit
        without an offset; camera noise is read off the images.
    bench
        Recipe with hidden objects that describes the bench; its camera gives the pitch, not the size.
    fit
        Whether to fit the memory-effect range; by default, where the bench leaves the slab open and there are at least
        four images.
    solver
        By default the one that comes with the package.
    seed
        Of phase retrieval's starts.

    Raises
    ------
    RuleError
        If the images are not of that shape, or the bench leaves open what it must know.

    Examples
    --------
    >>> import torch
    >>> from specklegen.datasets import load_recipe
    >>> from specklegen.models import see_through
    >>> bench = load_recipe("through-slab", {"material": {"kernel_paths": 1000}})
    >>> images = torch.from_numpy(bench.batch(0, "test", range(1))["image"])[:, None]
    >>> found = see_through(images, bench)
    >>> found.each[0].image.shape
    (36, 36)
    """
    if images.ndim != 4 or not images.numel():
        reject("see_through images", "of shape [objects, frames, rows, columns]", tuple(images.shape))
    own = bench_of(bench)
    solver = solver or load_solver()
    grain = torch.full((len(images),), float(own.optics.grain))
    seen = seen_by_camera(images, grain, camera=bench.exposure or "unknown")
    memory = [own.memory_effect] * len(images)
    found = None
    if fit if fit is not None else not own.known and len(images) >= _FEWEST:
        found = fit_range(solver, seen, own.optics, memory)
    factor = found.factor if found is not None else 1.0
    memory = [scaled(own.memory_effect, factor)] * len(images)
    solution = solver.solve(seen, own.optics, memory, seed=seed)
    camera = float(np.sqrt(images.shape[-1] * images.shape[-2])) / float(own.optics.grain)
    each = tuple(
        Finding(
            solution.image[n].numpy(), float(solution.deviance[n]), expected_deviance(seen.looks),
            float(solution.probability[n]), _reasons(solution, n, seen, own, memory[n], camera, images.shape[1]),
        )
        for n in range(len(images))
    )  # fmt: skip
    return Findings(each, own.range_sine * factor, found)


def _reasons(
    solution: Solution, n: int, seen: Periodogram, bench: Bench, memory_effect: MemoryEffect, camera: float, frames: int
) -> tuple[Reason, ...]:
    """What would help, judged for an object like the one that was found."""
    if solution.probability[n] >= 0.5:
        return ()
    grain, step = float(bench.optics.grain), float(bench.optics.step)
    noise = float(seen.noise[n])
    c_i = np.asarray(memory_effect(np.arange(int(np.ceil(EXTENT * np.sqrt(2))) + 1.0))).clip(0, 1)
    margin = (solution.image.shape[-1] - EXTENT) // 2
    inside = slice(margin, margin + EXTENT)
    conditions = Conditions(
        objects=solution.image[n : n + 1, inside, inside].double().numpy() + 1e-9, object_pitch=step / grain,
        memory_effect=np.concatenate([[1.0], c_i[1:]]), camera=camera, frames=float(frames),
        electrons=grain**2 / noise if noise > 0 else float("inf"), profile=bench.optics.profile,
    )  # fmt: skip
    reasons = judge(conditions).reasons
    # Of n frequencies the deviance has the spread sqrt((pi^2 / 6 - 1) / n) for one look, and less for more.
    count = float(-solution.log_likelihood[n] / seen.looks / solution.deviance[n].clamp_min(1e-6))
    spread = float(np.sqrt((np.pi**2 / 6 - 1) / count / seen.looks))
    surprised = float(solution.deviance[n]) - expected_deviance(seen.looks) > _SURPRISE * spread
    return (*reasons, _MISFIT) if surprised or not reasons else reasons
