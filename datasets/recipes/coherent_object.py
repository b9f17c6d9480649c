"""Recipe kind "coherent-object": what a modulator or a transparency shows in laser light, before screens or a slab.

The picture of an object is the amplitude of its pixels, or their phase. Its plane waves add as fields
(:class:`specklegen.scene.coherent.CoherentObject`): intensities of pixels do not. Light that is not scattered is added.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import cached_property
from typing import TYPE_CHECKING, Annotated, Any, Literal, NamedTuple, Self

import numpy as np
from pydantic import Field, model_validator

from specklegen.core.errors import reject
from specklegen.core.lazy import torch
from specklegen.core.units import LENGTH, RADIAN, SINE
from specklegen.core.values import NonNegative, Positive, Value
from specklegen.datasets.recipes.media import DrawnMedia
from specklegen.datasets.recipes.partially_coherent import lattice_media
from specklegen.datasets.recipes.parts.diffuser import Diffuser
from specklegen.datasets.recipes.parts.layered_material import LayeredMaterial
from specklegen.datasets.recipes.parts.light import Lit
from specklegen.datasets.recipes.parts.material import Material
from specklegen.datasets.recipes.shown_objects import ShownObjects
from specklegen.datasets.recipes.specification import PARAMETERS
from specklegen.datasets.sample_schema import ArraySpec
from specklegen.samplers.sampler import Waves
from specklegen.scene.coherent import CoherentObject
from specklegen.scene.scene import Scene
from specklegen.synthesis.coherent import wave_grid

if TYPE_CHECKING:
    from specklegen.datasets.addresses import Addresses
    from specklegen.datasets.recipes.materials import Materials
    from specklegen.samplers.sampler import MediaRequest
    from specklegen.scene.media import Layers, Slab
    from specklegen.scene.screens import ScreenStack


class Shown(Value):
    """The plane in which a coherent object is shown.

    Parameters
    ----------
    pitch, distance
        Length of a pixel, and the way from the object to the medium.
    modulation
        What the picture of an object, from 0 to 1, is of the light: its "amplitude", or its "phase" at amplitude 1.
    phase
        Phase of the brightest pixels, where the phase is modulated.
    waist, focus, aperture
        Of the laser beam and of a lens, as of a :class:`~specklegen.light.CoherentObject`.
    ballistic
        Whether light that is not scattered reaches the camera.
    """

    pitch: Annotated[Positive, LENGTH]
    distance: Annotated[NonNegative, LENGTH] = 0.0
    modulation: Literal["amplitude", "phase"] = "amplitude"
    phase: Annotated[Positive, RADIAN] = float(np.pi)
    waist: Annotated[Positive, LENGTH] | None = None
    focus: Annotated[float, LENGTH] | None = None
    aperture: Annotated[float, Field(gt=0, lt=1), SINE] | None = None
    ballistic: bool = True

    def light(self, pictures: np.ndarray, width: float) -> CoherentObject:
        """Return pictures float[T, h, w] as coherent objects behind a window."""
        fields = np.asarray(pictures, np.float64)
        if self.modulation == "phase":
            fields = np.exp(1j * self.phase * fields)
        return CoherentObject(
            fields, self.pitch, self.distance, waist=self.waist, focus=self.focus, aperture=self.aperture, width=width
        )


class CoherentView(NamedTuple):
    """A medium as it is planned: one scene, of which path sums draw no recipe."""

    probe: Scene
    full: Scene


class CoherentObjects(ShownObjects):
    """Camera images of coherent objects behind media, mean 1 over the expected intensity of the scattered light.

    ``extent_over_range`` among the parameters is that of the angular spectrum of the pixels, wavelength / pitch.

    Samples: ``image`` float32[H, W] (or uint16 counts), ``object`` float32[h, w], the picture that is shown. Media are
    drawn, or numbered (``media``): no medium of one split appears in another, so that those of test are unseen.

    Parameters
    ----------
    objects
        Pictures that are shown.
    object
        How, and where: the table ``[object]``.
    """

    kind: Literal["coherent-object"] = "coherent-object"
    object: Shown
    mode_tolerance: Annotated[float, Field(gt=0, lt=0.5)] = 0.001

    @model_validator(mode="after")
    def _check_shown(self) -> Self:
        if not isinstance(self.material, Material | Diffuser | LayeredMaterial):
            reject("Recipe.material", "a slab, layers or screens where the kind is coherent-object",
                   type(self.material).__name__)  # fmt: skip
        for name, given, remedy in (
            ("lab", self.lab is not None, "Write material.wavelength, window and camera."),
            ("light.bandwidth", bool(self.light.bandwidth), "Coherent light has one wavelength."),
            ("light.polarised", not self.light.polarised, "Coherent light has one polarisation."),
        ):
            if given:
                reject(f"Recipe.{name}", "left out where the kind is coherent-object", "given", remedy)
        if self.sampler == "paths":
            reject("Recipe.sampler", '"auto", "stationary" or "screens" where the kind is coherent-object', "paths",
                   "Path sums add up every plane wave of an object, which takes minutes a sample. Render single scenes "
                   "so: sg.render of a Scene with sg.light.CoherentObject.")  # fmt: skip
        if self.profile != "square":
            reject("Window.profile", '"square", on which an object is a Fourier series', self.profile)
        self._waves  # noqa: B018 - its light is refused here
        return self

    @cached_property
    def _waves(self) -> Any:
        """Plane waves of the window before the camera."""
        light = self.object.light(np.ones((1, *self.objects.shape)), self.geometry.width)
        light.require_focus(self.wavelength, 1.0)
        seen = self.geometry.divided_grid
        return wave_grid(light, self.wavelength, seen)[0]

    @property
    def _divisions(self) -> int:
        """Views across a camera pixel."""
        return self._waves.shape[0] // self.camera_shape[0]

    @cached_property
    def _most_cells(self) -> tuple[int, int]:
        """No bound: plane waves have cells of their own."""
        return 1, 1

    def layout(self) -> Mapping[str, ArraySpec]:
        """Shape, type, axes and unit of every array of a sample."""
        return {
            "image": self.observation(self.camera_shape, ("y", "x"), "camera image"),
            "object": ArraySpec(
                shape=self.objects.shape, dtype="float32", dims=("object_y", "object_x"),
                description=f"picture that is shown, 0 to 1; it modulates the {self.object.modulation} of the light",
            ),
            "parameters": PARAMETERS,
        }  # fmt: skip

    def _view(self, medium: Slab | Layers | ScreenStack) -> CoherentView:
        light = self.object.light(np.ones((1, *self.objects.shape)), self.geometry.width)
        scene = Scene(wavelength=self.wavelength, medium=medium, illumination=light, sensor=self.geometry.resolved_grid)
        return CoherentView(scene, scene)

    def extremes(self) -> list[CoherentView]:
        """Media at the ends of every range, under all plane waves."""
        return [self._view(medium) for medium in self.material.extremes()]

    @property
    def path_sum_obstacle(self) -> str | None:
        """Coherent objects, whose plane waves are too many for the paths of each medium."""
        return "coherent objects"

    def seen_media(self, drawn: Addresses, numbers: Sequence[int], materials: Materials) -> DrawnMedia:  # noqa: ARG002
        """Media under the plane waves of the window."""
        count = len(self._waves.sines)
        media = lattice_media(self, drawn, materials, (count, count), self.wavelength / self._waves.side)
        extent = self.wavelength / self.object.pitch / materials.range_sine(self.wavelength)
        return replace(media, parameters=media.parameters | {"extent_over_range": extent})

    def requests(self, media: DrawnMedia) -> list[tuple[list[int], MediaRequest]]:
        """Say what is asked of the sampler: fields of plane waves that add."""
        waves = Waves(self._waves, self._divisions, self.object.ballistic)
        return [(places, replace(request, waves=waves)) for places, request in super().requests(media)]

    def host_work(self) -> list[str]:
        """List the work on the host: all of it."""
        return [*super().host_work(), "objects and fields"]

    def lit(self, drawn: Addresses, numbers: Sequence[int]) -> Lit:
        """Plane waves of objects, the pictures, and their labels."""
        light = self.objects.images(drawn, numbers)
        _, waves = self.object.light(light.cpu().numpy(), self._waves.side).spectrum(self.wavelength)
        shown = torch.from_numpy(waves).to(drawn.device)
        return Lit(shown, 2 * np.pi / self._waves.side, self.labels(drawn, numbers), {"object": light})

    def named(self, images: Any, tilts: Any, parameters: Mapping[str, Any]) -> dict[str, Any]:  # noqa: ARG002
        """One image."""
        return {"image": images[:, 0]}
