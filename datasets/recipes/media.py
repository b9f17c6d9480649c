"""Media of a recipe: drawn in batches, planned, made ready by the sampler that was planned, looked through.

What ``specklegen plan RECIPE`` prints is decided here, and is what runs.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, NamedTuple, Protocol

import numpy as np

from specklegen.core.decision import Decision
from specklegen.core.errors import reject, warn_user
from specklegen.core.lazy import LazyModule
from specklegen.core.nanoseconds import seconds
from specklegen.core.parallel import thread_count
from specklegen.core.values import remembered
from specklegen.datasets.recipes.parts.viewing import Viewing
from specklegen.planning.plan import Plan
from specklegen.planning.planning import plan
from specklegen.samplers.sampler import MediaRequest, Sampler
from specklegen.scene.illumination import CollimatedBeams, IncoherentObject, directions_of_sines, object_sines
from specklegen.scene.media import Slab
from specklegen.scene.scene import Scene
from specklegen.scene.screens import ScreenStack
from specklegen.scene.sensors import FarFieldGrid
from specklegen.scene.validity import IDEALISED
from specklegen.scene.window import Window

if TYPE_CHECKING:
    import torch

    from specklegen.datasets.recipes.materials import Materials
    from specklegen.datasets.recipes.recipe import Recipe
    from specklegen.synthesis.correlations import FilmBatch, Places
    from specklegen.synthesis.sight import Sight
else:
    torch = LazyModule("torch")


class Rendering(NamedTuple):
    """What renders a medium, and the relative error that its number of paths leaves."""

    expected_error: float
    chosen: Sampler

    @property
    def name(self) -> str:
        """Name of the sampler."""
        return self.chosen.name


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
        sines = np.sin(self.tilts)[:, None] + object_sines("object", self.shape, self.pitch, pixels)
        directions = directions_of_sines("object", sines.reshape(-1, 2))
        return CollimatedBeams(directions=directions, width=self.seen.width, profile=self.seen.profile)

    def _scene(self, light: CollimatedBeams | IncoherentObject, grid: FarFieldGrid) -> Scene:
        return Scene(wavelength=self.seen.wavelength, medium=self.slab, illumination=light, sensor=grid)


@dataclass(frozen=True)
class DrawnMedia:
    """M media as they were drawn; nothing of them is made yet.

    Attributes
    ----------
    materials : Materials
    sight : Sight
        How objects are seen through them.
    bandwidth : float
        Of the light, in wavenumber.
    tilts : float64[M, T, 2]
        Tilts of the illumination, radians.
    parameters : dict of float64[M]
        What is stored of them with every sample.
    still : float64[M]
        Correlation of the fields of one frame with the next.
    moved : float64[M, T, S, 2] or None
        How far each of S screens has moved at every base tilt.
    film : FilmBatch or None
        Memory effect in time, of media whose particles move.
    """

    materials: Materials
    sight: Sight
    bandwidth: float
    tilts: torch.Tensor
    parameters: dict[str, torch.Tensor]
    still: torch.Tensor
    moved: torch.Tensor | None = None
    film: FilmBatch | None = None

    def __len__(self) -> int:
        return len(self.sight)

    def at(self, places: Places) -> DrawnMedia:
        """Some of them."""
        return DrawnMedia(
            self.materials.at(places), self.sight.at(places), self.bandwidth, self.tilts[places],
            {name: value[places] for name, value in self.parameters.items()}, self.still[places],
            None if self.moved is None else self.moved[places], None if self.film is None else self.film.at(places),
        )  # fmt: skip

    def view(self, place: int) -> MediumView:
        """One medium as it is planned."""
        sight = self.sight
        grid = FarFieldGrid(shape=sight.camera, pitch=float(sight.camera_pitch[place]))
        seen = Viewing(
            sight.wavelength, float(sight.width[place]), sight.profile, grid, self.bandwidth, sight.integrated
        )
        slab, pitch = self.materials.slabs[place](), float(sight.object_pitch[place])
        return MediumView(slab, seen, sight.shape, pitch, self.tilts[place].cpu().numpy())


def media_requests(recipe: Recipe, drawn: DrawnMedia) -> list[tuple[list[int], MediaRequest]]:
    """What is asked of a sampler for media, and for which."""
    window = Window(drawn.sight.profile, 1.0).area * drawn.sight.width.square()
    requests = []
    for places, light in drawn.materials.light(recipe.light, drawn.bandwidth, recipe.material.kernel_paths):
        some = drawn if len(places) == len(drawn) else drawn.at(places)
        request = MediaRequest(
            sight=some.sight, correlations=some.materials.correlations, light=light,
            tolerance=recipe.mode_tolerance, media=some.materials.slabs, moved=some.moved,
            units=some.parameters["forward_radiance"] * window[places], shared=recipe.shares_media, film=some.film,
        )  # fmt: skip
        requests.append((places, request))
    return requests


@remembered(16)
def planned_whole(scene: Scene, paths: int, sampler: type[Sampler]) -> Plan:
    """Plan of a sampler that is planned medium by medium, for a scene with every beam: path sums, beam by beam."""
    return plan(scene, paths=paths, sampler=sampler, streamed=True)


def medium_plan(recipe: Recipe, view: Planned) -> Plan:
    """Plan one medium: the sampler that its outermost beams allow; path sums, planned medium by medium, for all beams.

    Raises
    ------
    RuleError
        If path sums are needed, and have no model of what the recipe asks for.
    """
    paths = recipe.material.kernel_paths
    probe_plan = plan(view.probe, paths=paths, sampler=recipe.sampler, envelope=False)
    if recipe.moving and not probe_plan.chosen.films and probe_plan.sampler != "paths":
        reject("Recipe.sampler", "one that knows frames of media that move", probe_plan.sampler,
               'Ask for sampler = "stationary".')  # fmt: skip
    probe_plan = replace(probe_plan, decisions=told_by(recipe, view, probe_plan.decisions))
    if not probe_plan.chosen.medium_by_medium:
        return probe_plan
    obstacle = recipe.path_sum_obstacle
    if obstacle and probe_plan.sampler == "paths":
        why = next((d.reason for d in probe_plan.decisions if d.part == "stationary sampler"), "asked for")
        reject("Recipe", f"without {obstacle} where media are rendered by path sums", recipe.name,
               f"The planner chose them: {why}. Widen the window, or ask for sampler = \"stationary\".")  # fmt: skip
    return replace(planned_whole(view.full, paths, type(probe_plan.chosen)), decisions=probe_plan.decisions)


def told_by(recipe: Recipe, view: Planned, decisions: tuple[Decision, ...]) -> tuple[Decision, ...]:
    """Decisions about a scene, with what its recipe models beside it and does not."""
    kept = tuple(decision for decision in decisions if decision.part not in IDEALISED)
    return (*kept, *recipe.idealisations(view.probe))


def by_one_sampler(plans: list[Plan]) -> list[Plan]:
    """Plans of a recipe's media; where they disagree, by the other sampler of those that have one."""
    if len({each.chosen.name for each in plans}) < 2:
        return plans
    pairs = [(each, each.chosen.instead(each.decisions)) for each in plans]
    return [each if other is None else _planned_by(each, *other) for each, other in pairs]


def _planned_by(made: Plan, chosen: Sampler, decisions: tuple[Decision, ...]) -> Plan:
    counted, threads = chosen.operations(), thread_count(None)
    return replace(
        made, chosen=chosen, decisions=decisions, operations=dict(counted), seconds=seconds(counted, threads),
        setup_seconds=seconds(chosen.setup(), threads), memory_bytes=chosen.memory(threads),
    )  # fmt: skip


def rendering_of(recipe: Recipe, plans: list[Plan]) -> Rendering | None:
    """What renders all media of a recipe, from its plans at the ends of its ranges; None where they do not agree.

    Where they agree, the same holds for what lies between: the stationary model gets worse towards one end of every
    range.

    Raises
    ------
    RuleError
        If the recipe is strict, and the sampler that it asks for unfit.
    """
    doubts = sorted({doubt for each in plans for doubt in each.doubts})
    if doubts:
        remedy = "" if recipe.sampler == "auto" else ' Leave the choice to sampler = "auto".'
        if recipe.strict:
            reject("Recipe.sampler", "fit for all media where strict = true", recipe.sampler, f"{doubts[0]}.{remedy}")
        warn_user(f"recipe {recipe.name}: {doubts[0]}.{remedy}")
    options = [planned_rendering(each) for each in plans]
    return max(options, key=lambda each: each.expected_error) if len({each.name for each in options}) == 1 else None


def planned_rendering(made: Plan) -> Rendering:
    """What renders a medium of a plan."""
    return Rendering(made.expected_error, made.chosen)


def renderings(recipe: Recipe, views: Sequence[Planned] | DrawnMedia) -> list[tuple[list[int], Rendering]]:
    """What renders media: as for all of the recipe, or as planned for each of them alone; and which they are."""
    if recipe.rendering is not None:
        return [([*range(len(views))], recipe.rendering)]
    view = views.view if isinstance(views, DrawnMedia) else views.__getitem__
    return [([n], planned_rendering(medium_plan(recipe, view(n)))) for n in range(len(views))]
