"""Recipe kind "partially-coherent": a slab under partially coherent light, coherence length drawn sample by sample."""

from collections.abc import Mapping
from functools import partial
from typing import Annotated, Any, Literal, Self, cast

import numpy as np
from pydantic import Field, model_validator

from specklegen.coherence.partially_coherent import (
    COHERENT,
    effective_source_modes,
    gaussian_brightness,
    source_lattice,
)
from specklegen.core.values import remembered
from specklegen.datasets.recipes.medium_realization import MediumRealization, medium_realization
from specklegen.datasets.recipes.parts.distributions import UnboundedDraw, drawn, ends
from specklegen.datasets.recipes.parts.light import draw_medium
from specklegen.datasets.recipes.recipe import PARAMETERS, Recipe
from specklegen.datasets.recipes.rendering import MediumView, realization
from specklegen.datasets.sample_schema import ArraySpec
from specklegen.datasets.split import Purpose, Split, generator, substream
from specklegen.samplers.stationary.objects import ObjectSampler
from specklegen.scene.illumination import CollimatedBeams, Profile
from specklegen.scene.media import Slab
from specklegen.scene.scene import Scene


class PartiallyCoherent(Recipe):
    """Camera images of speckle from a Gaussian Schell-model beam along the axis, mean 1 over their expected intensity.

    Samples: ``image`` float32[H, W]. The medium's draw does not depend on the coherence length, so that with
    ``media`` set one medium is seen under many.

    Parameters
    ----------
    coherence_length
        sigma_g on the entrance face, in the unit of the wavelength; may vary from sample to sample. From 100 widths of
        the window on, and so for infinity, the light is coherent.
    mode_tolerance
        Share of the intensity that the Karhunen-Loeve modes of the memory effect may leave out.
    """

    kind: Literal["partially-coherent"] = "partially-coherent"
    coherence_length: UnboundedDraw
    mode_tolerance: Annotated[float, Field(gt=0, lt=0.5)] = 0.01

    @model_validator(mode="after")
    def _in_range(self) -> Self:
        source_lattice(*self._window, *ends(self.coherence_length))
        return self

    @property
    def _window(self) -> tuple[float, float, Profile]:
        return self.geometry.wavelength, self.geometry.width, self.geometry.profile

    def layout(self) -> Mapping[str, ArraySpec]:
        """Shape, type, axes and unit of every array of a sample."""
        image = self.observation(self.camera_shape, ("y", "x"), "camera image")
        return {"image": image, "parameters": PARAMETERS}

    @property
    def lattice(self) -> tuple[int, float]:
        """Beams of the source along each axis and their pitch, the same for all coherence lengths."""
        return source_lattice(*self._window, *ends(self.coherence_length))

    def view(self, slab: Slab) -> MediumView:
        """One medium under the beams of the source."""
        count, pitch = self.lattice
        return MediumView(slab, self.geometry, (count, count), pitch, np.zeros((1, 2)))

    def extremes(self) -> list[MediumView]:
        """Media at the ends of every range, under the least coherent light."""
        return [self.view(slab) for slab in self.material.extremes()]

    def scene(self, slab: Slab) -> Scene:
        """Scene of a slab under coherent light, for :func:`specklegen.render_partially_coherent`."""
        wavelength, width, profile = self._window
        beam = CollimatedBeams.tilts([0.0], width=width, profile=profile)
        return Scene(wavelength=wavelength, medium=slab, illumination=beam, sensor=self.geometry.grid)

    def prepare(self, seed: int, split: Split, medium: int) -> MediumRealization:
        """Make one medium ready, for light of every coherence length."""
        material = self.material_of(seed, split, medium)
        view = self.view(material.slab)
        parameters = material.parameters(self.geometry.wavelength) | {
            "width": self.geometry.width,
            "camera_pitch": self.geometry.grid.pitch,
        }
        sampler = partial(_sampler, self, material.slab, view.shape[0], view.pitch)
        media = lambda made: [draw_medium(self.light, made, seed, split, medium)]  # noqa: E731
        return realization(self, view, sampler, media, parameters, (seed, split, medium), share=True)

    def rendered(self, seed: int, split: str, index: int) -> dict[str, Any]:
        """One image with its parameters; see :class:`Recipe`."""
        which = cast(Split, split)
        medium = self.medium_number(index)
        length = drawn(self.coherence_length, generator(substream(seed, which, Purpose.OBJECT, index)))
        wavelength, width, profile = self._window
        brightness = gaussian_brightness(*self.lattice, wavelength, min(length, COHERENT * width))
        ready = medium_realization(self, seed, which, medium)
        return {
            "image": self.observed(ready.images(brightness), seed, which, index)[0],
            "index": np.int64(index),
            "parameters": {
                **ready.parameters,
                "coherence_length": length,
                "effective_modes": effective_source_modes(brightness, self.lattice[1], wavelength, width, profile),
                "expected_contrast": ready.expected_contrast(brightness),
                "medium": float(medium),
            },
        }


@remembered(8)
def _sampler(recipe: PartiallyCoherent, slab: Slab, count: int, pitch: float) -> ObjectSampler:
    material = recipe.material.known(slab)
    axis, tolerance = np.zeros((1, 2)), recipe.mode_tolerance
    return recipe.object_sampler(material, recipe.geometry, (count, count), pitch, axis, tolerance)
