"""Media of a recipe: drawn in batches, planned, made ready by the sampler that was planned, looked through.

What ``specklegen plan RECIPE`` prints is decided here, and is what runs.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol

import numpy as np

from specklegen.core.budgets import Budget
from specklegen.core.content import is_own
from specklegen.core.decision import Decision
from specklegen.core.errors import reject, warn_user
from specklegen.core.lazy import LazyModule, torch
from specklegen.core.pace import seconds
from specklegen.core.parallel import thread_count
from specklegen.core.shielded import shielded
from specklegen.core.values import remembered
from specklegen.datasets.recipes.parts.viewing import Viewing
from specklegen.datasets.recipes.specification import Specification
from specklegen.planning.plan import Plan
from specklegen.planning.planning import Options, plan, planned
from specklegen.samplers.sampler import MediaRequest, Sampler
from specklegen.scene.illumination import CollimatedBeams, IncoherentObject, directions_of_sines, object_sines
from specklegen.scene.media import Slab
from specklegen.scene.scene import Scene
from specklegen.scene.screens import ScreenStack
from specklegen.scene.sensors import FarFieldGrid
from specklegen.scene.validity import IDEALISED, idealisations
from specklegen.scene.window import Window
from specklegen.synthesis.sight import Sight

if TYPE_CHECKING:
    from specklegen.datasets.addresses import Addresses
    from specklegen.datasets.recipes import materials as _materials
    from specklegen.datasets.recipes.materials import Materials
    from specklegen.datasets.recipes.parts.light import Lit
    from specklegen.synthesis.correlations import FilmBatch, Places
else:
    _materials = LazyModule("specklegen.datasets.recipes.materials")


class Rendering(NamedTuple):
    """Renderer of a medium, and the relative error that its number of paths leaves."""

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


@remembered(16)
def planned_whole(scene: Scene, paths: int, sampler: type[Sampler]) -> Plan:
    """Plan of a sampler that is planned medium by medium, for a scene with every beam: path sums, beam by beam."""
    return plan(scene, paths=paths, sampler=sampler, streamed=True)


class RecipeMedia(Specification):
    """Media, lights and pictures of a recipe: what each kind says of them, and how the media are planned.

    :class:`~specklegen.datasets.recipes.generator.SpeckleGenerator` asks it, and
    :class:`~specklegen.datasets.recipes.recipe.Recipe` makes samples of it.
    """

    def extremes(self) -> Sequence[Planned]:
        """List media at the ends of every range, looked at by the widest object and the most tilted beams."""
        raise NotImplementedError

    def medium_plan(self, view: Planned) -> Plan:
        """Plan one medium: the sampler that its outermost beams allow; path sums, planned by medium, for all beams.

        Raise a `RuleError` if path sums are needed, and have no model of what the recipe asks for.
        """
        paths = self.material.kernel_paths
        probe_plan = planned(view.probe, Budget(paths=paths), Options(self.sampler, envelope=False, merged=True))
        if self.moving and not probe_plan.chosen.abilities.films and probe_plan.sampler != "paths":
            reject("Recipe.sampler", "a sampler that renders frames of moving media", probe_plan.sampler,
                   'Set sampler = "stationary".')  # fmt: skip
        physical = (decision for decision in probe_plan.decisions if decision.part not in IDEALISED)
        probe_plan = replace(probe_plan, decisions=(*physical, *self.idealisations(view.probe)))
        if not probe_plan.chosen.abilities.medium_by_medium:
            return probe_plan
        obstacle = self.path_sum_obstacle
        if obstacle and probe_plan.sampler == "paths":
            why = next((d.reason for d in probe_plan.decisions if d.part == "stationary sampler"), "asked for")
            reject("Recipe", f"without {obstacle}, since media are rendered by path sums", self.name,
                   f'The planner chose path sums: {why}. Widen the illuminated area, or set sampler = '
                   '"stationary".')  # fmt: skip
        return replace(planned_whole(view.full, paths, type(probe_plan.chosen)), decisions=probe_plan.decisions)

    @shielded()
    def plans(self) -> list[Plan]:
        """Plan the media at the ends of every range: ``specklegen plan`` prints these plans, and samples run by them.

        Where the plans disagree, those that have another sampler take it.
        """
        plans = [self.medium_plan(view) for view in self.extremes()]
        if len({each.sampler for each in plans}) < 2:
            return plans
        pairs = [(each, each.chosen.instead(each.decisions)) for each in plans]
        return [each if other is None else _planned_by(each, *other) for each, other in pairs]

    @cached_property
    def rendering(self) -> Rendering | None:
        """Renderer of all media of the recipe; None where plans do not agree. Carried to the workers.

        Where the plans at the ends of its ranges agree, the same holds for what lies between: the stationary model gets
        worse towards one end of every range. Raise a `RuleError` if no sampler serves, or, where ``strict``, the one
        that is asked for is unfit.
        """
        plans = self.plans()
        doubts = sorted({doubt for each in plans for doubt in each.doubts})
        if doubts:
            remedy = "" if self.sampler == "auto" else ' Use sampler = "auto".'
            if self.strict:
                reject("Recipe.sampler", "accurate for all media, since strict = true", self.sampler,
                       f"{doubts[0]}.{remedy}")
            warn_user(f"recipe {self.name}: {doubts[0]}.{remedy}")
        largest = max(plans, key=lambda each: (each.chosen.by_direction, each.expected_error))
        agree = len({each.sampler for each in plans}) == 1
        error = max(each.expected_error for each in plans)
        return Rendering(error, largest.chosen) if agree else None

    def renderings(self, media: DrawnMedia) -> list[tuple[list[int], Rendering]]:
        """Say what renders media, and which: as for all of the recipe, or as planned for each of them alone."""
        if self.rendering is not None:
            return [([*range(len(media))], self.rendering)]
        plans = [self.medium_plan(media.view(n)) for n in range(len(media))]
        return [([n], Rendering(each.expected_error, each.chosen)) for n, each in enumerate(plans)]

    def idealisations(self, scene: Scene) -> list[Decision]:
        """Parts of a real setup that a scene of the recipe leaves out."""
        index = self.light.refractive_index if self.lab is None else self.lab.refractive_index
        known = self.lab is not None or index != 1
        band = bool(self.light.bandwidth or (self.lab is not None and self.lab.bandwidth))
        return idealisations(scene, refractive_index=index if known else None, band=band, halves=self.light.halves)

    @property
    def path_sum_obstacle(self) -> str | None:
        """Part of the recipe that path sums have no model of, or None."""
        band = self.light.bandwidth or (self.lab is not None and self.lab.wavenumber_bandwidth)
        return "a bandwidth" if band else None

    @property
    def media_alike(self) -> bool:
        """True if media differ in nothing but what is drawn of their fields: one imaging serves them all."""
        return not self.material.varies

    @property
    def frames(self) -> int:
        """Frames of a sample in which the medium is another one."""
        return 1

    @property
    def moving(self) -> bool:
        """True if particles move from frame to frame, so that frames are asked of a sampler together."""
        return False

    @property
    def pictures(self) -> int:
        """Images of a sample: frames, or tilts."""
        return self.frames

    def later_frames(self, drawn: Addresses, numbers: Sequence[int]) -> torch.Tensor | None:  # noqa: ARG002
        """Keys int64[M, halves, F - 1, 2] of the fields of all frames but the first; None of media at rest."""
        return None

    def exposed(self, images: torch.Tensor) -> torch.Tensor:
        """Pictures real[B, pictures, H, W] of the images of all frames or tilts real[B, T or F, H, W]."""
        return images

    def contrast_left(self, parameters: Mapping[str, Any]) -> Any:  # noqa: ARG002
        """Share of the contrast of an instant that exposures leave, of numbers of media: float64[M], or 1."""
        return 1.0

    def polarisation_shares(self, parameters: Mapping[str, Any]) -> torch.Tensor | None:  # noqa: ARG002
        """Shares float64[M, 2] of the light of media in either polarisation; None where they are alike."""
        return None

    def host_work(self) -> list[str]:
        """Parts made on the host, whatever the device, in words."""
        work = [] if _materials.in_atlas(self.material) else ["the memory effect of every material"]
        if self.rendering is None:
            work.append("sums over paths, where they are chosen")
        elif self.rendering.chosen.abilities.medium_by_medium:
            sampler = self.rendering.name
            work.append("sums over paths" if sampler == "paths" else f"media of the {sampler} sampler, one by one")
        elif self.rendering.chosen.by_direction:
            work.append("the brightness and memory effect of every medium by the camera's directions")
        own = self.exposure is not None and is_own(type(self.exposure))
        return [*work, "counts of a camera of a user's own"] if own else work

    def drawn_media(self, drawn: Addresses, numbers: Sequence[int]) -> list[tuple[list[int], DrawnMedia]]:
        """Draw media, those whose materials are known in the same way together, and which they are."""
        parts = _materials.drawn_materials(self.material, drawn, numbers, self.wavelength)
        return [
            (places, self.seen_media(drawn, [numbers[n] for n in places], materials)) for places, materials in parts
        ]

    def seen_media(self, drawn: Addresses, numbers: Sequence[int], materials: Materials) -> DrawnMedia:
        """Draw what is seen of media of known materials; every kind has its own."""
        raise NotImplementedError

    def requests(self, media: DrawnMedia) -> list[tuple[list[int], MediaRequest]]:
        """Say what is asked of the sampler for media, and for which."""
        window = Window(media.sight.profile, 1.0).area * media.sight.width.square()
        requests = []
        for places, light in media.materials.light(self.light, media.bandwidth, self.material.kernel_paths):
            some = media if len(places) == len(media) else media.at(places)
            request = MediaRequest(
                sight=some.sight, correlations=some.materials.correlations, light=light,
                tolerance=self.mode_tolerance, media=some.materials.slabs, moved=some.moved,
                units=some.parameters["forward_radiance"] * window[places], shared=self.shares_media, film=some.film,
            )  # fmt: skip
            requests.append((places, request))
        return requests

    def path_scene(self, media: DrawnMedia, place: int) -> Scene:
        """Scene of one medium with every beam, for path sums."""
        return media.view(place).full

    def lit(self, drawn: Addresses, numbers: Sequence[int]) -> Lit:
        """Draw what shines through the media of samples; every kind has its own."""
        raise NotImplementedError

    def on_sensor(self, images: Any, parameters: Mapping[str, Any]) -> Any:  # noqa: ARG002
        """Light on the pixels, real[B, n, H, W], of images real[B, pictures, H, W]; what a mosaic makes of them."""
        return images

    def named(self, images: Any, tilts: Any, parameters: Mapping[str, Any]) -> dict[str, Any]:
        """Name what the camera saw, [B, T or F, H, W], under tilts float64[B, T, 2]; every kind has its own."""
        raise NotImplementedError

    def sight(
        self, drawn: Addresses, shape: tuple[int, int], object_pitch: Any, base: Any, width: Any = None
    ) -> Sight:
        """Imaging of objects through media.

        Parameters
        ----------
        drawn
            Where the numbers lie.
        shape
            Of the object.
        object_pitch, base
            Direction sines float64[M] between its pixels, and float64[M, T, 2] of the base tilts.
        width : float64[M] or None
            Of the windows, in the recipe's unit of length, where each medium has its own.
        """
        if width is None:
            seen = self.geometry
            width, pitch = (torch.full_like(object_pitch, number) for number in (seen.width, seen.grid.pitch))
        else:
            assert self.camera is not None
            pitch = self.wavelength / (width * self.camera.pixels_per_grain)
        bound = self._most_cells if drawn.device.type != "cpu" or self._on_one_grid else None
        return Sight(wavelength=self.wavelength, profile=self.profile, shape=shape, camera=self.camera_shape,
                     center=(0.0, 0.0), integrated=self.pixel_integration, width=width,
                     object_pitch=object_pitch, camera_pitch=pitch, base=base, bound=bound)  # fmt: skip

    @property
    def _on_one_grid(self) -> bool:
        """True if it pays to have all media on one grid: each is seen once, and they are of about one size."""
        return not (self.media_alike or self.shares_media or self.tilts_turn)

    @cached_property
    def _most_cells(self) -> tuple[int, int]:
        """No fewer cells along (y, x) than any medium has: those at the ends of the ranges, tilted either way."""
        views = [view for view in self.extremes() if isinstance(view, MediumView)]
        put = lambda rows: torch.tensor(np.array(rows), dtype=torch.float64)  # noqa: E731
        cells = []
        for turned in (False, True) if self.tilts_turn else (False,):
            base = [np.sin(view.tilts)[:, ::-1] if turned else np.sin(view.tilts) for view in views]
            sight = Sight(
                wavelength=self.wavelength, profile=self.profile, shape=views[0].shape, camera=self.camera_shape,
                center=(0.0, 0.0), integrated=False, width=put([view.seen.width for view in views]) * (1 + 1e-9),
                object_pitch=put([view.pitch for view in views]), base=put(base),
                camera_pitch=put([view.seen.grid.pitch for view in views]),
            )  # fmt: skip
            cells.append(sight.most_cells)
        rows, columns = np.max(cells, axis=0).tolist()
        return rows, columns

    @property
    def tilts_turn(self) -> bool:
        """True if the direction of tilting differs between media."""
        return False


def _planned_by(made: Plan, chosen: Sampler, decisions: tuple[Decision, ...]) -> Plan:
    cost, threads = chosen.cost(), thread_count(None)
    return replace(
        made, chosen=chosen, decisions=decisions, operations=dict(cost.first), seconds=seconds(cost.first, threads),
        setup_seconds=seconds(cost.once, threads), memory_bytes=chosen.memory(threads),
    )  # fmt: skip
