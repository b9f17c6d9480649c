"""Directions of light and camera: in the engine's terms, or in those of a laboratory.

Engine: a wavelength inside the medium, an illuminated window, a grid of direction sines. Laboratory: a
table ``[lab]`` with distances, pixels and an aperture (:class:`specklegen.instrument.LabSetup`). A recipe is written in
one or the other; both become a :class:`Viewing`.
"""

from dataclasses import dataclass
from typing import Annotated, Literal, Self

import numpy as np
from pydantic import Field, model_validator

from specklegen.core.errors import reject
from specklegen.core.units import LENGTH
from specklegen.core.values import Positive, PositiveInt, Value
from specklegen.instrument.lab import LabSetup
from specklegen.scene.illumination import Profile
from specklegen.scene.sensors import FarFieldGrid


class Window(Value):
    """The illuminated window on the entrance face.

    Parameters
    ----------
    width
        Full side ("square"), diameter ("disc") or 1/e^2 intensity diameter ("gaussian"); or "fitted": for each medium
        as wide as shows the object across ``field.pixels`` of the camera.
    profile
        Its shape.
    """

    width: Annotated[Positive, LENGTH] | Literal["fitted"]
    profile: Profile = "square"


LEAST_PIXELS = 1.6
"""Camera pixels per speckle grain, at least: from there on camera noise can be read off an image behind a disc, and
phase retrieval and the solver reconstruct as well as at 2.5 (docs/notes/recipes.md)."""
LEAST_POINTS = 2.0
"""The same of pixels without an area, of which fewer undersample the speckle."""


class CameraGrid(Value):
    """The camera's pixels in the far field.

    Parameters
    ----------
    shape
        (rows, columns).
    pixels_per_grain
        Pixels per speckle grain (wavelength / width); at least 1.6 of hidden objects, 2 of other kinds. Below 2 a pixel
        averages over its area, as it does with an exposure.
    """

    shape: tuple[PositiveInt, PositiveInt]
    pixels_per_grain: Annotated[float, Field(ge=LEAST_PIXELS, allow_inf_nan=False)] = 3.0


class Lab(LabSetup):
    """A laboratory, and the shape of its aperture: every field of :class:`~specklegen.instrument.lab.LabSetup`,
    and one more.

    Parameters
    ----------
    profile
        Shape of the illuminated part of the layer, ``aperture`` across: a round aperture unless it is said.
    """

    profile: Profile = "disc"

    @model_validator(mode="after")
    def _one_unit(self) -> Self:
        """An object below a wavelength is a length in another unit: nothing of it could be seen."""
        if self.object_extent < self.wavelength:
            reject("Lab.object_extent", f"at least the wavelength, {self.wavelength:g}", self.object_extent,
                   "All lengths of a [lab] are in the unit of its wavelength.")  # fmt: skip
        return self


@dataclass(frozen=True)
class Viewing:
    """Facts that the engine needs about window and camera.

    Attributes
    ----------
    wavelength : float
        Inside the medium.
    width, profile :
        The illuminated window.
    grid : FarFieldGrid
        The camera's pixels.
    bandwidth : float
        Full width of the spectrum in wavenumber inside the medium.
    pixel_integration : bool
        Whether pixels average over their area.
    """

    wavelength: float
    width: float
    profile: Profile
    grid: FarFieldGrid
    bandwidth: float
    pixel_integration: bool

    @property
    def divisions(self) -> int:
        """Views across a pixel from which its mean intensity is found; one where pixels do
        not average. In threes, a sixth of a grain apart or closer: contrasts are then within 0.2 % of those over the
        pixel's area.
        """
        grain = self.wavelength / self.width
        return 3 * int(np.ceil(2 * self.grid.pitch / grain * (1 - 1e-9))) if self.pixel_integration else 1

    @property
    def divided_grid(self) -> FarFieldGrid:
        """The views of all pixels."""
        n = self.divisions
        return FarFieldGrid(shape=tuple(n * side for side in self.grid.shape), pitch=self.grid.pitch / n)

    @property
    def resolved_grid(self) -> FarFieldGrid:
        """The pixels' centres, if they resolve the speckle; else their views."""
        return self.grid if 2 * self.grid.pitch * self.width <= self.wavelength else self.divided_grid
