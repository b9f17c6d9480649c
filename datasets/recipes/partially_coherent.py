"""Recipe kind "partially-coherent": a slab under partially coherent light, coherence length drawn sample by sample."""

from collections.abc import Mapping, Sequence
from functools import lru_cache
from typing import TYPE_CHECKING, Annotated, Any, Literal, Self

import numpy as np
from pydantic import Field, model_validator

from specklegen.coherence.partially_coherent import source_lattice
from specklegen.core.lazy import torch
from specklegen.core.units import LENGTH
from specklegen.datasets.distributions import UnboundedDraw, ends
from specklegen.datasets.recipes.media import DrawnMedia, MediumView
from specklegen.datasets.recipes.parts.light import Lit
from specklegen.datasets.recipes.recipe import Recipe
from specklegen.datasets.recipes.specification import PARAMETERS
from specklegen.datasets.sample_schema import ArraySpec
from specklegen.datasets.split import Purpose
from specklegen.scene.illumination import CollimatedBeams, Profile
from specklegen.scene.media import Slab
from specklegen.scene.scene import Scene

if TYPE_CHECKING:
    from specklegen.datasets.addresses import Addresses
    from specklegen.datasets.recipes.materials import Materials
    from specklegen.datasets.recipes.parts.source import Source


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
    coherence_length: Annotated[UnboundedDraw, LENGTH]
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
        """Scene of a slab under coherent light, for :func:`specklegen.coherence.render_partially_coherent`."""
        wavelength, width, profile = self._window
        beam = CollimatedBeams.tilts([0.0], width=width, profile=profile)
        return Scene(wavelength=wavelength, medium=slab, illumination=beam, sensor=self.geometry.grid)

    def seen_media(self, drawn: "Addresses", numbers: Sequence[int], materials: "Materials") -> DrawnMedia:  # noqa: ARG002
        """Media under the beams of the source."""
        count, pitch = self.lattice
        return lattice_media(self, drawn, materials, (count, count), pitch)

    def lit(self, drawn: "Addresses", numbers: Sequence[int]) -> Lit:
        """The beams of a source of some coherence length."""
        source = _source(self, drawn.device)
        (length,) = drawn.numbers(Purpose.OBJECT, [self.coherence_length], numbers)
        light = source.beams(length)
        parameters = {"coherence_length": length, "effective_modes": source.effective_modes(light)}
        return Lit(light, None, parameters, {})

    def named(self, images: Any, tilts: Any, parameters: Mapping[str, Any]) -> dict[str, Any]:  # noqa: ARG002
        """One image."""
        return {"image": images[:, 0]}


def lattice_media(
    recipe: Recipe, drawn: "Addresses", materials: "Materials", shape: tuple[int, int], pitch: float
) -> DrawnMedia:
    """Media under a lattice of beams about the axis, the same for all: ``pitch`` direction sines apart."""
    seen = recipe.geometry
    whole = lambda value: torch.full_like(materials.half_range, value)  # noqa: E731
    base = torch.zeros((len(materials), 1, 2), dtype=torch.float64, device=drawn.device)
    parameters = materials.parameters | {"width": whole(seen.width), "camera_pitch": whole(seen.grid.pitch)}
    sight = recipe.sight(drawn, shape, whole(pitch), base)
    return DrawnMedia(materials, sight, seen.bandwidth, base, parameters, whole(1.0))


@lru_cache(maxsize=8)
def _source(recipe: PartiallyCoherent, device: "torch.device") -> "Source":
    from specklegen.datasets.recipes.parts.source import source_of

    return source_of(*recipe.lattice, *recipe._window, device)
