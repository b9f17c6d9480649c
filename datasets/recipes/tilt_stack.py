"""Recipe kinds "tilt-stack" and "material-regression": the speckle of one medium under several tilts."""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal

from pydantic import Field

from specklegen.core.lazy import torch
from specklegen.datasets.recipes.media import DrawnMedia, MediumView
from specklegen.datasets.recipes.parts.light import Lit
from specklegen.datasets.recipes.specification import PARAMETERS
from specklegen.datasets.recipes.tilted import Tilted
from specklegen.datasets.sample_schema import ArraySpec
from specklegen.scene.media import Slab
from specklegen.scene.screens import ScreenStack

if TYPE_CHECKING:
    import numpy as np

    from specklegen.datasets.addresses import Addresses
    from specklegen.datasets.recipes.materials import Materials

_TOLERANCE = 0.01


class TiltStack(Tilted):
    """Stacks of speckle images of one medium, one image a tilt, mean intensity 1.

    Samples: ``stack`` float32[T, H, W] (or uint16 counts), ``tilts`` float64[T, 2] in radians.

    Parameters
    ----------
    mode_tolerance
        Share of the intensity that the stationary sampler's modes may leave out, and that is put back evenly; see
        :class:`~specklegen.datasets.recipes.hidden_object.HiddenObject`.
    """

    kind: Literal["tilt-stack"] = "tilt-stack"
    looked_up: ClassVar[bool] = True
    mode_tolerance: Annotated[float, Field(gt=0, lt=0.5)] = _TOLERANCE

    def layout(self) -> Mapping[str, ArraySpec]:
        """Shape, type, axes and unit of every array of a sample."""
        shape = (self.tilts.count, *self.camera_shape)
        return {
            "stack": self.observation(shape, ("tilt", "y", "x"), "one image a tilt"),
            "tilts": self.tilts.layout,
            "parameters": PARAMETERS,
        }

    def view(self, slab: Slab | ScreenStack, angles: "np.ndarray") -> MediumView:
        """One medium under its tilts."""
        seen = self.geometry
        return MediumView(slab, seen, (1, 1), seen.grid.pitch, angles)

    def extremes(self) -> list[MediumView]:
        """Media at the ends of every range, under the widest tilts."""
        return [self.view(slab, self.tilts.widest) for slab in self.material.extremes()]

    def seen_media(self, drawn: "Addresses", numbers: Sequence[int], materials: "Materials") -> DrawnMedia:
        """Draw the tilts of media; a beam is an object of one pixel."""
        angles, tilted = self.tilts.drawn_together(drawn, numbers)
        seen = self.geometry
        whole = lambda value: torch.full_like(angles[:, 0, 0], value)  # noqa: E731
        parameters = materials.parameters | {
            "width": whole(seen.width), "camera_pitch": whole(seen.grid.pitch), **tilted
        }  # fmt: skip
        sight = self.sight(drawn, (1, 1), whole(seen.grid.pitch), torch.sin(angles))
        return DrawnMedia(materials, sight, seen.bandwidth, angles, parameters, whole(1.0))

    def lit(self, drawn: "Addresses", numbers: Sequence[int]) -> Lit:
        """Beams of brightness 1."""
        return Lit(torch.ones((len(numbers), 1, 1), device=drawn.device), None, {}, {})


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

    def named(self, images: Any, tilts: Any, parameters: Mapping[str, Any]) -> dict[str, Any]:
        """Stacks, their tilts, and the numbers to predict."""
        target = [parameters["g"], torch.log10(parameters["optical_depth"]), torch.log10(parameters["thickness"])]
        arrays = super().named(images, tilts, parameters)
        return {**arrays, "target": torch.stack(target, -1).to(torch.float32)}
