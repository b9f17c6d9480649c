"""Recipe kinds "tilt-stack" and "material-regression": the speckle of one medium under several tilts."""

from collections.abc import Mapping
from functools import partial
from typing import Annotated, Any, Literal, cast

import numpy as np
from pydantic import Field

from specklegen.datasets.recipes.medium_realization import MediumRealization, medium_realization
from specklegen.datasets.recipes.parts.light import draw_medium
from specklegen.datasets.recipes.parts.tilts import Tilts
from specklegen.datasets.recipes.recipe import PARAMETERS, Recipe
from specklegen.datasets.recipes.rendering import MediumView, realization
from specklegen.datasets.sample_schema import ArraySpec
from specklegen.datasets.split import Purpose, Split, generator, substream
from specklegen.scene.media import Slab
from specklegen.scene.screens import ScreenStack

_TOLERANCE = 0.01
_BEAM = np.ones((1, 1), np.float32)  # to the sampler, a beam is an object of one pixel


class TiltStack(Recipe):
    """Stacks of speckle images of one medium, one image a tilt, mean intensity 1.

    Samples: ``stack`` float32[T, H, W] (or uint16 counts), ``tilts`` float64[T, 2] in radians.

    Parameters
    ----------
    tilts
        The tilts.
    mode_tolerance
        Share of the intensity that the stationary sampler's modes may leave out, and that is put back evenly; see
        :class:`~specklegen.datasets.recipes.hidden_object.HiddenObject`.
    """

    kind: Literal["tilt-stack"] = "tilt-stack"
    tilts: Tilts
    mode_tolerance: Annotated[float, Field(gt=0, lt=0.5)] = _TOLERANCE

    def physics(self) -> dict[str, Any]:
        """Everything that decides a pixel; the tolerance only where it is not what it was before it could be given."""
        decided = super().physics()
        if self.mode_tolerance == _TOLERANCE:
            decided.pop("mode_tolerance")
        return decided

    def layout(self) -> Mapping[str, ArraySpec]:
        """Shape, type, axes and unit of every array of a sample."""
        shape = (self.tilts.count, *self.camera_shape)
        return {
            "stack": self.observation(shape, ("tilt", "y", "x"), "one image a tilt"),
            "tilts": self.tilts.layout,
            "parameters": PARAMETERS,
        }

    def view(self, slab: Slab | ScreenStack, angles: np.ndarray) -> MediumView:
        """One medium under its tilts."""
        seen = self.geometry
        return MediumView(slab, seen, (1, 1), seen.grid.pitch, angles)

    def extremes(self) -> list[MediumView]:
        """Media at the ends of every range, under the widest tilts."""
        return [self.view(slab, self.tilts.widest) for slab in self.material.extremes()]

    def prepare(self, seed: int, split: Split, medium: int) -> MediumRealization:
        """Make one medium ready, with all that is drawn for it."""
        material = self.material_of(seed, split, medium)
        angles, tilted = self.tilts.drawn(generator(substream(seed, split, Purpose.TILTS, medium)))
        view = self.view(material.slab, angles)
        parameters = material.parameters(view.seen.wavelength) | {
            "width": view.seen.width,
            "camera_pitch": view.seen.grid.pitch,
            **tilted,
        }
        sampler = partial(
            self.object_sampler, material, view.seen, view.shape, view.pitch, np.sin(angles), self.mode_tolerance
        )
        media = lambda made: [draw_medium(self.light, made, seed, split, medium)]  # noqa: E731
        return realization(self, view, sampler, media, parameters, (seed, split, medium), share=False)

    def rendered(self, seed: int, split: str, index: int) -> dict[str, Any]:
        """One stack with its tilts and parameters; see :class:`Recipe`."""
        which = cast(Split, split)
        medium = self.medium_number(index)
        ready = medium_realization(self, seed, which, medium)
        return {
            "stack": self.observed(ready.images(_BEAM), seed, which, index),
            "tilts": ready.tilts.copy(),
            "index": np.int64(index),
            "parameters": {
                **ready.parameters,
                "expected_contrast": ready.expected_contrast(_BEAM),
                "medium": float(medium),
            },
        }


class MaterialRegression(TiltStack):
    """Stacks to tell the material from.

    Samples: as of "tilt-stack", and ``target`` float32[3]: g, log10 of the optical depth, log10 of the
    thickness in the recipe's unit of length.
    """

    kind: Literal["material-regression"] = "material-regression"  # type: ignore[assignment]

    def layout(self) -> Mapping[str, ArraySpec]:
        """Shape, type, axes and unit of every array of a sample."""
        target = ArraySpec(
            shape=(3,), dims=("target",), description="g, log10 of the optical depth, log10 of the thickness"
        )
        return {**super().layout(), "target": target}

    def rendered(self, seed: int, split: str, index: int) -> dict[str, Any]:
        """One stack with its tilts, target and parameters; see :class:`Recipe`."""
        sample = super().rendered(seed, split, index)
        drawn = sample["parameters"]
        target = [drawn["g"], np.log10(drawn["optical_depth"]), np.log10(drawn["thickness"])]
        return {**sample, "target": np.array(target, np.float32)}
