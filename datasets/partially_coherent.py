"""Recipe kind "partially-coherent": a slab under partially coherent light, coherence length drawn sample by sample."""

from collections.abc import Mapping
from typing import Any, Literal, Self, cast

import numpy as np
import torch
from pydantic import model_validator

from specklegen.datasets.draws import Draw, drawn, ends
from specklegen.datasets.material import known
from specklegen.datasets.protocol import ArraySpec
from specklegen.datasets.recipe import Recipe
from specklegen.datasets.split import Purpose, Split, generator, substream
from specklegen.illumination import CollimatedBeams
from specklegen.media import Slab
from specklegen.partially_coherent import (
    effective_source_modes,
    gaussian_brightness,
    gaussian_schell_object,
    source_lattice,
)
from specklegen.planning import Plan, plan
from specklegen.scene import Scene
from specklegen.stationary.objects import ObjectSampler, object_sampler
from specklegen.values import Positive, remembered


class PartiallyCoherent(Recipe):
    """Camera images of speckle from a Gaussian Schell-model beam along the axis, mean 1 over their expected intensity.

    Samples: ``image`` float32[H, W]. The medium's draw does not depend on the coherence length, so that with
    ``media`` set one medium is seen under many.

    Parameters
    ----------
    coherence_length
        sigma_g on the entrance face, in the unit of the wavelength; may vary from sample to sample.
    mode_tolerance
        Share of the intensity that the Karhunen-Loeve modes of the memory effect may leave out.
    """

    kind: Literal["partially-coherent"] = "partially-coherent"
    coherence_length: Draw
    mode_tolerance: Positive = 0.01

    @model_validator(mode="after")
    def _in_range(self) -> Self:
        source_lattice(self.material.wavelength, self.window.width, self.window.profile, *ends(self.coherence_length))
        return self

    def layout(self) -> Mapping[str, ArraySpec]:
        """Shape, type, axes and unit of every array of a sample."""
        return {
            "image": ArraySpec(
                shape=self.camera.shape, dtype="float32", dims=("y", "x"),
                description="intensity over its expected value",
            ),
        }  # fmt: skip

    @property
    def lattice(self) -> tuple[int, float]:
        """Beams of the source along each axis and their pitch, the same for all coherence lengths."""
        return source_lattice(
            self.material.wavelength, self.window.width, self.window.profile, *ends(self.coherence_length)
        )

    def plans(self) -> list[Plan]:
        """Plans for the least coherent light at the ends of every range of the material."""
        wavelength, window = self.material.wavelength, self.window
        light = gaussian_schell_object(wavelength, ends(self.coherence_length)[0], window.width, window.profile)
        scenes = [
            Scene(wavelength=wavelength, medium=slab, illumination=light, sensor=self.grid)
            for slab in self.material.extremes()
        ]
        return [plan(scene, paths=self.material.kernel_paths) for scene in scenes]

    def scene(self, slab: Slab) -> Scene:
        """Scene of a slab under coherent light, for `specklegen.partially_coherent.render_partially_coherent`."""
        beam = CollimatedBeams.tilts([0.0], width=self.window.width, profile=self.window.profile)
        return Scene(wavelength=self.material.wavelength, medium=slab, illumination=beam, sensor=self.grid)

    def sample(self, seed: int, split: str, index: int) -> dict[str, Any]:
        """One image with its parameters; see :class:`Recipe`."""
        which = cast(Split, split)
        medium = self.medium_number(index)
        wavelength, window = self.material.wavelength, self.window
        length = drawn(self.coherence_length, generator(substream(seed, which, Purpose.OBJECT, index)))
        count, pitch = self.lattice
        brightness = gaussian_brightness(count, pitch, wavelength, length)
        modes = effective_source_modes(brightness, pitch, wavelength, window.width, window.profile)
        material = self.material_of(seed, which, medium)
        sampler = _sampler(self, material.slab)
        image = sampler.image(_medium(self, seed, which, medium), brightness)
        return {
            "image": (image / sampler.mean).numpy().astype(np.float32),
            "index": np.int64(index),
            "parameters": material.parameters(wavelength)
            | {
                "width": window.width,
                "camera_pitch": self.grid.pitch,
                "coherence_length": length,
                "effective_modes": modes,
                "expected_contrast": modes**-0.5,
                "medium": float(medium),
            },
        }


@remembered(64)
def _sampler(recipe: PartiallyCoherent, slab: Slab) -> ObjectSampler:
    count, pitch = recipe.lattice
    return object_sampler(
        known(slab, recipe.material.kernel_paths).kernel,
        wavelength=recipe.material.wavelength,
        object_shape=(count, count),
        object_pitch=pitch,
        width=recipe.window.width,
        profile=recipe.window.profile,
        grid=recipe.grid,
        tolerance=recipe.mode_tolerance,
    )


@remembered(64)
def _medium(recipe: PartiallyCoherent, seed: int, split: Split, medium: int) -> torch.Tensor:
    """A medium's speckle, in the form that its coherence lengths share; a split's media stay in memory."""
    sampler = _sampler(recipe, recipe.material_of(seed, split, medium).slab)
    return sampler.spectra(sampler.medium(substream(seed, split, Purpose.MEDIUM, medium)))
