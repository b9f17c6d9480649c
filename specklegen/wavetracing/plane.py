"""Planes with a grid: receivers, maps, and the grids of fields; and a field on one."""

from dataclasses import dataclass
from functools import cached_property
from typing import Annotated, Any, Literal, Self

import numpy as np
from pydantic import model_validator

from specklegen.core.arguments import complex_array, real_number
from specklegen.core.display.plot import Pictured, draw_map
from specklegen.core.errors import reject
from specklegen.core.quantities import takes_units
from specklegen.core.units import LENGTH, WAVELENGTH
from specklegen.core.values import Array, Positive, PositiveInt, Value, read_only


class Plane(Value):
    """A rectangular grid of square pixels on a plane.

    Parameters
    ----------
    center
        float64[3], the middle of the grid.
    normal
        float64[3], of any length; light that travels along it is seen with x to the right.
    up
        float64[3], of any length and not along the normal: its part in the plane is the direction y of the rows.
    shape
        (rows, columns) = (y, x); row 0 and column 0 hold the smallest y and x.
    pitch
        Side of a pixel.

    Examples
    --------
    >>> from specklegen.wavetracing import Plane
    >>> Plane(center=[0, 0, 500], shape=(8, 10), pitch=2.0).points.shape
    (8, 10, 3)
    """

    type: Literal["Plane"] = "Plane"
    center: Annotated[Array, LENGTH] = np.zeros(3)
    normal: Array = np.array([0.0, 0.0, 1.0])
    up: Array = np.array([0.0, 1.0, 0.0])
    shape: tuple[PositiveInt, PositiveInt]
    pitch: Annotated[Positive, LENGTH]

    @model_validator(mode="after")
    def _check(self) -> Self:
        for name in ("center", "normal", "up"):
            if np.shape(getattr(self, name)) != (3,):
                reject(f"Plane.{name}", "of shape (3,)", getattr(self, name))
        length = np.linalg.norm(self.normal)
        if not length > 0:
            reject("Plane.normal", "longer than 0", self.normal)
        across = np.linalg.norm(np.cross(self.up, self.normal))
        if not across > 1e-9 * length * np.linalg.norm(self.up):
            reject("Plane.up", "a direction other than the normal's", self.up)
        return self

    @cached_property
    def axes(self) -> np.ndarray:
        """float64[3, 3]: rows are the unit vectors x, y and normal, right-handed."""
        normal = self.normal / np.linalg.norm(self.normal)
        x = np.cross(self.up, normal)
        x = x / np.linalg.norm(x)
        return read_only(np.stack([x, np.cross(normal, x), normal]))

    @cached_property
    def coordinates(self) -> tuple[np.ndarray, np.ndarray]:
        """Positions of the columns along x and of the rows along y, float64[W] and float64[H], 0 in the middle."""
        rows, columns = self.shape
        x, y = ((np.arange(n) - (n - 1) / 2) * self.pitch for n in (columns, rows))
        return read_only(x), read_only(y)

    @cached_property
    def points(self) -> np.ndarray:
        """Middles of the pixels, float64[H, W, 3]."""
        x, y = self.coordinates
        return read_only(self.center + x[None, :, None] * self.axes[0] + y[:, None, None] * self.axes[1])


@takes_units
@dataclass(frozen=True, repr=False)
class PlaneField(Pictured):
    """A complex field on the grid of a plane.

    Attributes
    ----------
    values : complex128[H, W]
        At the middles of the pixels; rows y, columns x, from the smallest.
    pitch : float
    wavelength : float
        In the medium on this side of the screen.

    Examples
    --------
    >>> from specklegen.wavetracing import Plane, PlaneWave, field_on_plane
    >>> square = [[-5, -5], [5, -5], [5, 5], [-5, 5]]
    >>> found = field_on_plane(square, PlaneWave(wavelength=1.0), Plane(center=[0, 0, 50], shape=(8, 8), pitch=2.0))
    >>> found.values.shape, found.pitch
    ((8, 8), 2.0)
    """

    values: np.ndarray
    pitch: Annotated[float, LENGTH]
    wavelength: Annotated[float, WAVELENGTH]

    _named = {"|u|": "values", "pitch": "pitch", "wavelength": "wavelength", "power": "power"}

    def __post_init__(self) -> None:
        values = complex_array("PlaneField.values", self.values)
        if values.ndim != 2 or not values.size or not np.isfinite(values).all():
            reject("PlaneField.values", "finite, of shape (H, W)", values)
        for name in ("pitch", "wavelength"):
            value = getattr(self, name)
            if not 0 < real_number(f"PlaneField.{name}", value) < np.inf:
                reject(f"PlaneField.{name}", "finite and greater than 0", value)
        object.__setattr__(self, "values", values)

    def _draw(self, axes: Any, label: str | None = None) -> None:
        """|u|^2, with lengths beside it."""
        rows, columns = (n * self.pitch / 2 for n in self.values.shape)
        draw_map(axes, np.square(np.abs(self.values)), "|u|²", span=(-columns, columns, -rows, rows), low=0)
        axes.set(xlabel="x", ylabel="y")

    @property
    def power(self) -> float:
        """Integral of |u|^2 over the grid, an area times the irradiance of u = 1."""
        return float(np.square(np.abs(self.values)).sum() * self.pitch**2)
