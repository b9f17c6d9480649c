"""Recipe kind "contrast-map": a surface above a vessel, exposed several times (laser speckle contrast imaging).

Light falls on tissue, and a camera images what comes back from its face. Where it has met a vessel, its speckle blurs
(Briers and Webster, J. Biomed. Opt. 1, 174 (1996)); how much at which place, the paths of the tissue say
(:mod:`specklegen.memory_effects.vessel`). Exposures are made of instants as those of the kind "exposure-stack" are.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import product
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal, NoReturn, Self, cast

import numpy as np
from pydantic import Field, model_validator

from specklegen.core.errors import reject
from specklegen.core.lazy import torch
from specklegen.core.random_streams import pilot_seed
from specklegen.core.units import DIFFUSION, LENGTH, RADIAN, SINE, TIME, VELOCITY
from specklegen.core.values import Positive, Value, remembered
from specklegen.datasets.distributions import Draw, drawn, ends
from specklegen.datasets.recipes.exposure_stack import instant_lags, lag_weights
from specklegen.datasets.recipes.parts.light import Lit
from specklegen.datasets.recipes.parts.material import Estimator, Material
from specklegen.datasets.recipes.recipe import Recipe
from specklegen.datasets.recipes.specification import PARAMETERS
from specklegen.datasets.recipes.volume_recipe import VolumeMedia, VolumeView
from specklegen.datasets.recipes.volume_stack import DevelopedSpeckle
from specklegen.datasets.sample_schema import ArraySpec
from specklegen.datasets.split import Purpose, Split, generator, substream
from specklegen.mean.field import straight_through
from specklegen.memory_effects.vessel import LocalLight, Profile, Vessel, local_light
from specklegen.paths.vertices import VertexPaths, vertex_paths
from specklegen.samplers.sampler import MediaRequest
from specklegen.scene.illumination import CollimatedBeams
from specklegen.scene.media import Slab
from specklegen.scene.scene import Scene
from specklegen.scene.sensors import FarFieldGrid
from specklegen.synthesis.correlations import Tabulated
from specklegen.synthesis.sight import Sight
from specklegen.synthesis.surface import SurfaceFilm, SurfaceImaging, padded
from specklegen.theory.speckle_contrast import sub_frames

if TYPE_CHECKING:
    from specklegen.datasets.addresses import Addresses
    from specklegen.datasets.recipes.media import DrawnMedia

KEPT_PATHS = 4096
"""Paths of a tissue that are kept, with all their scatterings."""
_MOST_INSTANTS = 1024
_PLACES = 49  # distances from a vessel at which light is looked at: a tenth of its radius apart, farther away more
_NUMBERS = ("depth", "radius", "speed", "diffusion", "tissue_diffusion", "angle", "offset")


class Vessels(Value):
    """A straight vessel below the surface; every number may vary from medium to medium.

    Parameters
    ----------
    depth, radius
        Of its axis below the face, and of its wall; in the material's unit of length.
    speed
        Of the flow on the axis, length over a unit of time.
    profile
        "parabolic", at rest on the wall (Poiseuille), or "plug", of one velocity.
    diffusion, tissue_diffusion
        D of what is inside beside the flow, and of what is outside: length^2 over a unit of time.
    angle
        Of the vessel from the camera's rows, radians.
    offset
        By how much the axis passes the camera's middle.
    """

    depth: Annotated[Draw, LENGTH]
    radius: Annotated[Draw, LENGTH]
    speed: Annotated[Draw, VELOCITY]
    profile: Profile = "parabolic"
    diffusion: Annotated[Draw, DIFFUSION] = 0.0
    tissue_diffusion: Annotated[Draw, DIFFUSION] = 0.0
    angle: Annotated[Draw, RADIAN] = 0.0
    offset: Annotated[Draw, LENGTH] = 0.0

    @model_validator(mode="after")
    def _check(self) -> Self:
        for name in ("radius", "speed", "diffusion", "tissue_diffusion"):
            low, high = ends(getattr(self, name))
            if not low >= 0 or (name == "radius" and low == 0) or not np.isfinite(high):
                rule = "above 0" if name == "radius" else "finite and at least 0"
                reject(f"Vessels.{name}", rule, getattr(self, name))
        if ends(self.depth)[0] < ends(self.radius)[1]:
            reject("Vessels.depth", "at least the largest radius, so that vessels lie inside the tissue", self.depth)
        if not any(ends(getattr(self, name))[0] > 0 for name in ("speed", "diffusion", "tissue_diffusion")):
            reject("Vessels.speed", "above 0, since nothing else moves", self.speed, "Or give a diffusion.")
        return self


class ExposureTimes(Value):
    """Exposure times of a surface.

    Parameters
    ----------
    durations
        In the unit of time of the vessel's speed.
    tolerance
        By how much of itself K^2 of an exposure may be too large, for it is made of instants.
    """

    durations: tuple[Annotated[Positive, TIME], ...] = Field(min_length=1)
    tolerance: Annotated[float, Field(gt=0, lt=0.5)] = 0.02


@dataclass(frozen=True)
class SurfaceMedium:
    """One medium as it was drawn.

    Attributes
    ----------
    contrast : float64[E, H, W]
        K of every exposure at each pixel, of polarised light.
    parameters : dict
        What samples tell of it.
    """

    film: SurfaceFilm
    contrast: np.ndarray
    parameters: dict[str, float]


class ContrastMap(Recipe):
    """Exposures of the face of a tissue, above a vessel in which blood flows; mean intensity 1.

    Samples: ``stack`` float32[E, H, W] (mean intensity over each exposure), ``target`` float32[E, H, W]: the contrast K
    that each pixel has over media that differ in their speckle alone, without the camera's noise; in unpolarised light
    over the root of two. Pixels are points, or, where there is an ``[exposure]``, average over their area.
    ``material.kernel_paths`` photons are walked into each tissue; KEPT_PATHS of their ways back serve all its vessels.

    Parameters
    ----------
    vessel, exposures
        What flows, and how long the camera stays open.
    aperture
        Largest direction sine inside the medium that the objective takes; a grain is wavelength / (2 aperture).
    camera
        Pixels, by their number in a grain; points of the face.
    """

    kind: Literal["contrast-map"] = "contrast-map"
    vessel: Vessels
    exposures: ExposureTimes
    aperture: Annotated[float, Field(gt=0, le=0.1), SINE]
    sampler: Literal["paths"] = "paths"  # type: ignore[assignment]
    engine_terms: ClassVar = ("material.wavelength", "camera")

    @model_validator(mode="after")
    def _check_surface(self) -> Self:
        kind = "contrast-map"
        if not isinstance(self.material, Material):
            reject("Recipe.material", f"a slab where the kind is {kind}", self.material)
        for name, given, remedy in (
            ("window", self.window is not None, "The whole face is illuminated."),
            ("lab", self.lab is not None, "Write material.wavelength, aperture and camera."),
            ("light.bandwidth", bool(self.light.bandwidth), "Motion with a bandwidth is not modelled."),
            ("material.faces", not self.material.faces.matched, "Paths between reflecting faces are not modelled."),
        ):
            if given:
                reject(f"Recipe.{name}", f"left out where the kind is {kind}", "given", remedy)
        deepest = ends(self.vessel.depth)[1] + ends(self.vessel.radius)[1]
        if deepest > ends(self.material.thickness)[0]:
            thickness = ends(self.material.thickness)[0]
            reject("Vessels.depth", f"such that the vessel lies in the tissue, {thickness:g} thick", deepest)
        return self

    def layout(self) -> Mapping[str, ArraySpec]:
        """Shape, type, axes and unit of every array of a sample."""
        shape = (self.pictures, *self.camera_shape)
        return {
            "stack": self.observation(shape, ("exposure", "y", "x"), "one image an exposure"),
            "target": ArraySpec(shape=shape, dims=("exposure", "y", "x"), description="contrast K of each pixel"),
            "parameters": PARAMETERS,
        }

    @property
    def pixel_pitch(self) -> float:
        """Distance between pixels on the face."""
        assert self.camera is not None
        return self.wavelength / (2 * self.aperture * self.camera.pixels_per_grain)

    @cached_property
    def instants(self) -> tuple[int, ...]:
        """Instants of each exposure: as many as the fastest light of media at the ends of every range needs."""
        most = [ends(getattr(self.vessel, name))[1] for name in ("speed", "diffusion", "tissue_diffusion")]
        places = product(self.material.extremes(), set(ends(self.vessel.depth)), set(ends(self.vessel.radius)))
        lights = [
            local_light(self.tissue(cast(Slab, slab)), Vessel(depth, radius, most[0], self.vessel.profile, *most[1:]),
                        [0.0], self.wavelength)[0]
            for slab, depth, radius in places
        ]  # fmt: skip
        counts = tuple(
            max(_instants(light, duration, self.exposures) for light in lights) for duration in self.exposures.durations
        )
        if sum(counts) > _MOST_INSTANTS:
            _reject_instants(self.exposures, list(counts))
        return counts

    @property
    def pictures(self) -> int:
        """One an exposure."""
        return len(self.exposures.durations)

    @property
    def moving(self) -> bool:
        """Motion in the vessel."""
        return True

    @property
    def media_alike(self) -> bool:
        """Never: each has a vessel of its own."""
        return False

    @property
    def _rendered_by(self) -> str:
        return "Rendered by random fields with the correlation in time of the paths that leave at each place."

    def host_work(self) -> list[str]:
        """Parts made on the host: all but fields and images."""
        return ["the temporal correlation of the light of every place"]

    def tissue(self, slab: Slab) -> VertexPaths:
        """Paths of a slab: they are keyed by it, not by a seed."""
        return vertex_paths(slab, self.material.kernel_paths, KEPT_PATHS, pilot_seed(slab.unitless_fingerprint()))

    def extremes(self) -> list[VolumeView]:  # type: ignore[override]
        """Tissues at the ends of every range, seen from afar: what light comes back from them."""
        views = []
        for slab in self.material.extremes():
            width = max(100 * slab.thickness, 1000 * self.wavelength)
            light = CollimatedBeams(directions=np.array([[0.0, 0.0, 1.0]]), width=width)
            sensor = FarFieldGrid(shape=(2, 2), pitch=self.wavelength / (4 * width), side="reflection")
            scene = Scene(wavelength=self.wavelength, medium=cast(Slab, slab), illumination=light, sensor=sensor)
            views.append(VolumeView(scene, scene))
        return views

    def drawn_media(self, drawn: Addresses, numbers: Sequence[int]) -> list[tuple[list[int], DrawnMedia]]:
        """Draw media one by one: tissues, vessels and what follows from them."""
        return [([n], self._drawn(drawn, number)) for n, number in enumerate(numbers)]  # type: ignore[misc]

    def _drawn(self, drawn: Addresses, number: int) -> SurfaceMedia:
        medium = surface_medium(self, drawn.seed, drawn.split, number)
        put = lambda rows: torch.tensor(np.asarray(rows), dtype=torch.float64)[None].to(drawn.device)  # noqa: E731
        one = put(1.0)
        sight = Sight(
            wavelength=self.wavelength, profile="square", shape=(1, 1), camera=self.camera_shape,
            center=(0.0, 0.0), integrated=False, width=one, object_pitch=one, camera_pitch=one, base=put([[0.0, 0.0]]),
        )  # fmt: skip
        parameters = {name: put(value) for name, value in medium.parameters.items()}
        return SurfaceMedia(
            self.extremes()[0], 1.0, DevelopedSpeckle(), sight, put([[0.0, 0.0]]), parameters, one, medium
        )

    def requests(self, media: SurfaceMedia) -> list[tuple[list[int], MediaRequest]]:  # type: ignore[override]
        """Request for one medium, whose film is already drawn in law."""
        level = float(np.sqrt(np.square(media.medium.contrast).mean()))
        request = MediaRequest(
            sight=media.sight, correlations=Tabulated([]), light=None, tolerance=0.0, media=(),
            units=torch.tensor([1.0], dtype=torch.float64), imager=SurfaceImaging(media.medium.film, level),
        )  # fmt: skip
        return [([0], request)]

    def path_scene(self, media: SurfaceMedia, place: int) -> Scene:  # type: ignore[override]  # noqa: ARG002
        """The tissue from afar."""
        return media.scenes.full

    def exposed(self, images: torch.Tensor) -> torch.Tensor:
        """Exposures real[B, E, H, W] of images of instants real[B, F, H, W]."""
        return torch.stack([part.mean(1) for part in images.split(self.instants, 1)], 1)

    def lit(self, drawn: Addresses, numbers: Sequence[int]) -> Lit:
        """A beam of brightness 1, and the contrast to predict."""
        maps = [
            surface_medium(self, drawn.seed, drawn.split, self.medium_number(n)).contrast for n in numbers
        ]  # fmt: skip
        target = torch.from_numpy(np.array(maps, np.float32) * np.float32(self.light.halves**-0.5)).to(drawn.device)
        return Lit(torch.ones((len(numbers), 1, 1), device=drawn.device), None, {}, {"target": target})

    def named(self, images: Any, tilts: Any, parameters: Mapping[str, Any]) -> dict[str, Any]:  # noqa: ARG002
        """Stacks of exposures."""
        return {"stack": images}


@dataclass(frozen=True)
class SurfaceMedia(VolumeMedia):
    """One medium as it was drawn, with what is to be drawn of it."""

    medium: SurfaceMedium


def surface_medium(recipe: ContrastMap, seed: Any, split: Split, number: int) -> SurfaceMedium:
    """One medium of a recipe: its tissue and vessel, how its speckle forgets at each pixel, and its contrast."""
    material = cast(Material, recipe.material)
    slab, values = material.drawn_medium(generator(substream(seed, split, Purpose.MATERIAL, number)), split)
    rng = generator(substream(seed, split, Purpose.OUTLINE, number))
    own = {name: float(drawn(getattr(recipe.vessel, name), rng)) for name in _NUMBERS}
    vessel = Vessel(
        own["depth"], own["radius"], own["speed"], recipe.vessel.profile, own["diffusion"], own["tissue_diffusion"]
    )
    medium = _surface(recipe, slab, vessel, own["angle"], own["offset"])
    values |= {"wavelength": recipe.wavelength, "pixel_pitch": recipe.pixel_pitch}
    values |= {"ballistic_fraction": straight_through(slab), "estimator": float(Estimator.PATHS)}
    return replace(
        medium, parameters=values | {f"vessel_{name}": value for name, value in own.items()} | medium.parameters
    )


@remembered(8)
def _surface(recipe: ContrastMap, slab: Slab, vessel: Vessel, angle: float, offset: float) -> SurfaceMedium:
    assert recipe.camera is not None
    pitch, grain = recipe.pixel_pitch, recipe.camera.pixels_per_grain
    rows, columns, _ = padded(recipe.camera_shape, grain)
    y, x = ((np.arange(side) - (side - 1) / 2) * pitch for side in (rows, columns))
    apart = np.abs(np.cos(angle) * y[:, None] - np.sin(angle) * x - offset)
    places = vessel.radius * np.sinh(np.linspace(0, np.arcsinh(apart.max() / vessel.radius), _PLACES))
    kind = np.searchsorted((places[1:] + places[:-1]) / 2, apart)
    paths, instants = recipe.tissue(slab), recipe.instants
    lags, between = instant_lags(instants, recipe.exposures.durations)
    lights = local_light(paths, vessel, places.tolist(), recipe.wavelength)
    field = np.stack([light.field(lags) for light in lights])
    film = SurfaceFilm(field, between, kind, recipe.camera_shape, grain, recipe.exposure is not None)
    contrast = np.sqrt(film.contrast_squared(lag_weights(instants)))
    return SurfaceMedium(film, contrast, {"static_share": lights[0].rest, "kept_paths": float(len(paths))})


def _instants(light: LocalLight, duration: float, asked: ExposureTimes) -> int:
    """Instants that the light of one place needs in an exposure; more than a recipe may have are refused."""

    def field(lag: np.ndarray) -> np.ndarray:
        if lag.size > _MOST_INSTANTS:  # the quadrature of the whole exposure asks for fewer
            _reject_instants(asked, duration)
        return light.field(lag)

    return sub_frames(field, duration, tolerance=asked.tolerance)


def _reject_instants(asked: ExposureTimes, found: object) -> NoReturn:
    reject("ExposureTimes.durations", f"made of at most {_MOST_INSTANTS} instants within {asked.tolerance:g} of K^2",
           found, "Shorten the exposures, slow the flow, or allow a larger tolerance.")  # fmt: skip
