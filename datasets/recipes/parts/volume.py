"""The medium and the camera of recipes that path sums render: a box, voxels, or a slab seen from near by."""

from typing import Annotated, Any, Self

import numpy as np
from pydantic import model_validator

from specklegen.core.units import LENGTH
from specklegen.core.values import Positive, PositiveInt, Value
from specklegen.datasets.distributions import Draw, require_above
from specklegen.datasets.recipes.parts.viewing import CameraGrid
from specklegen.scene.media import Box, Slab, VoxelGrid
from specklegen.scene.sensors import FarFieldGrid, NearField


class Outline(Value):
    """The medium's outline: a box about the optical axis, as thick as the material says, homogeneous or of voxels.

    Parameters
    ----------
    width
        Of the box along x and y, in the recipe's unit of length; may vary from medium to medium.
    voxels
        (z, y, x) into which the box is cut; left out, it is homogeneous.
    contrast
        Standard deviation of the voxels' densities over their mean, which the material's optical depth gives; the
        densities are independent and log-normal. May vary from medium to medium.
    """

    width: Annotated[Draw, LENGTH]
    voxels: tuple[PositiveInt, PositiveInt, PositiveInt] | None = None
    contrast: Draw = 0.5

    @model_validator(mode="after")
    def _check(self) -> Self:
        require_above("Outline.width", self.width, 0)
        require_above("Outline.contrast", self.contrast, 0)
        return self

    def medium(self, slab: Slab, width: float, contrast: float, rng: np.random.Generator) -> Box | VoxelGrid:
        """Cut a volume out of a slab; densities of voxels are drawn from ``rng``."""
        side = np.array([width / 2, width / 2])
        corners: dict[str, Any] = {"lower": np.append(-side, 0.0), "upper": np.append(side, slab.thickness)}
        if self.voxels is None:
            return Box(**corners, mean_free_path=slab.mean_free_path, albedo=slab.albedo, scatterer=slab.scatterer)
        spread = np.sqrt(np.log1p(contrast**2))  # of the logarithm, whose mean makes the density's 1
        density = np.exp(spread * rng.standard_normal(self.voxels) - spread**2 / 2)
        return VoxelGrid(
            **corners, extinction=slab.extinction * density, albedo=np.array(slab.albedo), scatterers=(slab.scatterer,)
        )


class PlacedCamera(CameraGrid):
    """The camera's pixels, in the far field or a distance behind the medium.

    Parameters
    ----------
    distance
        From the medium's exit face to a plane of pixels about the axis, at whose centers the field is found; left out,
        the camera is in the far field. A speckle is wavelength sqrt(distance^2 + width^2 / 4) / width across there.
    """

    distance: Annotated[Positive, LENGTH] | None = None

    def sensor(self, wavelength: float, thickness: float, lit: float) -> FarFieldGrid | NearField:
        """The camera behind an exit face of which at most ``lit`` shines."""
        rows, columns = self.shape
        grain = wavelength / lit
        if self.distance is None:
            return FarFieldGrid(shape=(rows, columns), pitch=grain / self.pixels_per_grain)
        pitch = grain * float(np.hypot(self.distance, lit / 2)) / self.pixels_per_grain
        y, x = (pitch * (np.arange(count) - (count - 1) / 2) for count in (rows, columns))
        points = np.stack([*np.meshgrid(x, y), np.full((rows, columns), thickness + self.distance)], axis=-1)
        return NearField(points=points)
