"""How a recipe's media are rendered: planned once a recipe, or once a medium where its ranges reach across a rule.

What ``specklegen plan RECIPE`` prints is decided here, and is what runs.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable
from dataclasses import dataclass, replace
from enum import IntEnum
from typing import TYPE_CHECKING, NamedTuple, Protocol

import numpy as np

from specklegen.core.errors import DoubtWarning, reject
from specklegen.core.lazy import LazyModule
from specklegen.datasets.recipes.medium_realization import (
    Contrast,
    MediumRealization,
    PathSumFields,
    StationaryFields,
    planned_sums,
    stationary_fields,
)
from specklegen.datasets.recipes.parts.light import medium_seeds
from specklegen.datasets.recipes.parts.viewing import Viewing
from specklegen.datasets.split import Split
from specklegen.planning.plan import Plan
from specklegen.planning.planning import plan
from specklegen.samplers.screens.objects import ScreenObjects
from specklegen.samplers.stationary.objects import ObjectSampler
from specklegen.scene.illumination import CollimatedBeams, IncoherentObject, directions_of_sines, object_sines
from specklegen.scene.media import Slab
from specklegen.scene.scene import Scene
from specklegen.scene.screens import ScreenStack
from specklegen.scene.sensors import FarFieldGrid

if TYPE_CHECKING:
    import torch

    from specklegen.datasets.recipes.recipe import Recipe
else:
    torch = LazyModule("torch")


class RenderedBy(IntEnum):
    """The sampler that renders a sample; the number is stored with it."""

    PATHS = 1
    STATIONARY = 2
    SCREENS = 3


class Rendering(NamedTuple):
    """What renders a medium, and the relative error that its number of paths leaves."""

    sampler: RenderedBy
    expected_error: float


class Planned(Protocol):
    """A medium as it is planned and rendered."""

    @property
    def probe(self) -> Scene:
        """Scene with the beams that the planner judges."""
        ...

    @property
    def full(self) -> Scene:
        """Scene with every beam."""
        ...


@dataclass(frozen=True)
class MediumView:
    """A medium, what shines on it and who looks.

    Attributes
    ----------
    slab : Slab or ScreenStack
    seen : Viewing
    shape : (int, int)
        Of the object; a beam is an object of one pixel.
    pitch : float
        Direction sine between its pixels.
    tilts : float64[T, 2]
        Tilts of all its beams, radians.
    """

    slab: Slab | ScreenStack
    seen: Viewing
    shape: tuple[int, int]
    pitch: float
    tilts: np.ndarray

    @property
    def probe(self) -> Scene:
        """Scene with the beams of the object's corners, the outermost, and the tilts: those that the planner judges."""
        rows, columns = self.shape
        if self.tilts.any():
            corners = np.reshape([(r, c) for r in (0, rows - 1) for c in (0, columns - 1)], (-1, 2))
            pixels = np.unique(corners @ (columns, 1))
            return self._scene(self._beams(pixels), self.seen.resolved_grid)
        brightness = np.zeros(self.shape)
        brightness[:: max(rows - 1, 1), :: max(columns - 1, 1)] = 1.0
        light = IncoherentObject(
            brightness=brightness, pitch=self.pitch, width=self.seen.width, profile=self.seen.profile
        )
        return self._scene(light, self.seen.resolved_grid)

    @property
    def full(self) -> Scene:
        """Scene with the beam of every pixel under every tilt, tilt after tilt, seen as finely as pixels need."""
        return self._scene(self._beams(np.arange(self.shape[0] * self.shape[1])), self.seen.divided_grid)

    def _beams(self, pixels: np.ndarray) -> CollimatedBeams:
        sines = np.sin(self.tilts)[:, None] + object_sines("object", self.shape, self.pitch)[pixels]
        directions = directions_of_sines("object", sines.reshape(-1, 2))
        return CollimatedBeams(directions=directions, width=self.seen.width, profile=self.seen.profile)

    def _scene(self, light: CollimatedBeams | IncoherentObject, grid: FarFieldGrid) -> Scene:
        return Scene(wavelength=self.seen.wavelength, medium=self.slab, illumination=light, sensor=grid)


def medium_plan(recipe: "Recipe", view: Planned) -> Plan:
    """Plan one medium: the sampler that its outermost beams allow; path sums for all its beams.

    Raises
    ------
    RuleError
        If path sums are needed, and have no model of what the recipe asks for.
    """
    paths = recipe.material.kernel_paths
    made = plan(view.probe, paths=paths, sampler=recipe.sampler, envelope=False)
    if made.sampler != "paths":
        return made
    obstacle = recipe.path_sum_obstacle
    if obstacle:
        why = next((d.reason for d in made.decisions if d.part == "stationary sampler"), "asked for")
        reject("Recipe", f"without {obstacle} where media are rendered by path sums", recipe.name,
               f"The planner chose them: {why}. Widen the window, or ask for sampler = \"stationary\".")  # fmt: skip
    return replace(planned_sums(view.full, paths), decisions=made.decisions)


def rendering_of(recipe: "Recipe", plans: list[Plan]) -> Rendering | None:
    """What renders all media of a recipe, from its plans at the ends of its ranges; None where they do not agree.

    Where they agree, the same holds for what lies between: the stationary model gets worse towards one end of every
    range.

    Raises
    ------
    RuleError
        If the recipe is strict, and the sampler that it asks for unfit.
    """
    doubts = sorted({doubt for made in plans for doubt in made.doubts})
    if doubts:
        remedy = "" if recipe.sampler == "auto" else ' Leave the choice to sampler = "auto".'
        if recipe.strict:
            reject("Recipe.sampler", "fit for all media where strict = true", recipe.sampler, f"{doubts[0]}.{remedy}")
        warnings.warn(f"recipe {recipe.name}: {doubts[0]}.{remedy}", DoubtWarning, stacklevel=3)
    found = [_rendering(made) for made in plans]
    return max(found, key=lambda made: made.expected_error) if len({made.sampler for made in found}) == 1 else None


def chosen_rendering(recipe: "Recipe", view: Planned) -> Rendering:
    """What renders one medium: as for all of the recipe, or as planned for it alone."""
    return recipe.rendering or _rendering(medium_plan(recipe, view))


def _rendering(made: Plan) -> Rendering:
    return Rendering(RenderedBy[made.sampler.upper()], made.expected_error)


def realization(
    recipe: "Recipe",
    view: MediumView,
    sampler: Callable[[], ObjectSampler | ScreenObjects],
    media: Callable[[ObjectSampler | ScreenObjects], list[torch.Tensor]],
    parameters: dict[str, float],
    where: tuple[int, Split, int],
    *,
    share: bool,
) -> MediumRealization:
    """Make a medium ready, by the sampler that is planned for it.

    Parameters
    ----------
    recipe, view
        The recipe, and one of its media.
    sampler, media
        How the stationary sampler is made, and how it draws the frames of the medium; not called for path sums.
    parameters
        What was drawn for the medium.
    where
        (seed, split, number of the medium).
    share
        Whether many objects look through it.
    """
    chosen = chosen_rendering(recipe, view)
    known: Contrast
    if chosen.sampler is not RenderedBy.PATHS:
        made = sampler()
        known = made
        fields: StationaryFields | PathSumFields = stationary_fields(made, media(made), share=share)
    else:
        known = speckle = recipe.object_speckle(view.slab, view.seen, view.shape, view.pitch, np.sin(view.tilts))
        seeds = tuple(medium_seeds(recipe.light, *where))
        fields = PathSumFields(
            view.full, recipe.material.kernel_paths, speckle.mean, seeds, len(view.tilts), view.seen.divisions, share
        )  # fmt: skip
    told = parameters | recipe.material.labels(view.slab)
    told |= {"sampler": float(chosen.sampler), "expected_error": chosen.expected_error}
    return MediumRealization(fields, known, told, view.tilts, recipe.light.halves**-0.5)
