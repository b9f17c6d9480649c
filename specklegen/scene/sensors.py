"""Sensors: views in the far field, at any directions or on a regular grid of direction sines, and near-field points."""

from __future__ import annotations

from functools import cached_property
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal, Self

import numpy as np
from numpy.typing import ArrayLike
from pydantic import Field, model_validator

from specklegen.core.arguments import real_array
from specklegen.core.content import is_own
from specklegen.core.errors import reject
from specklegen.core.memory import memory_limit
from specklegen.core.quantities import with_units
from specklegen.core.registered import Registered, member_of
from specklegen.core.registry import Registry
from specklegen.core.units import LENGTH, NUMBER, RADIAN, SINE
from specklegen.core.values import Array, Finite, Positive, PositiveInt, position_vectors, read_only, unit_vectors
from specklegen.scene.illumination import directions_of_sines

Side = Literal["transmission", "reflection"]

_GRID = {
    "sines", "sign", "directions", "vectors", "center_direction", "corner_directions", "corners", "nearest",
    "regular_grid", "dimension",
}  # fmt: skip
"""What samplers know of a grid by its fields; a subclass leaves them as they are."""


def _says(cls: type[Sensor], name: str) -> bool:
    return name in cls.model_fields or hasattr(cls, name)


class Sensor(Registered):
    """Views of a scene. Subclass it for a sensor of your own.

    A subclass is a frozen value with fields of its own. It has ``directions`` (unit vectors of travel) or ``points``,
    of shape ``float64[..., 3]``, or ``float64[..., 2]`` in flatland. The name of the class is its ``type``.

    Examples
    --------
    >>> import numpy as np
    >>> import specklegen as sg
    >>> class Ring(sg.sensors.Sensor):
    ...     sine: float
    ...     count: int = 16
    ...     @property
    ...     def directions(self):
    ...         turn = 2 * np.pi * np.arange(self.count) / self.count
    ...         x, y = self.sine * np.cos(turn), self.sine * np.sin(turn)
    ...         return np.stack([x, y, np.sqrt(1 - self.sine**2) * np.ones_like(x)], -1)
    >>> Ring(sine=0.01).shape
    (16,)
    """

    registry: ClassVar = Registry("sensor")
    near: ClassVar[bool] = False
    """Whether views are points, not directions."""
    focused: ClassVar[bool] = False
    """Whether a lens makes the image: it has neither views that are points nor directions."""
    type: Any = None

    @classmethod
    def __pydantic_init_subclass__(cls, **kwargs: Any) -> None:
        super().__pydantic_init_subclass__(**kwargs)
        if cls.is_member():
            cls.near = _says(cls, "points")
            if not _says(cls, "shape"):  # a field of that name may not hide a property of a base
                cls.shape = property(lambda self: self.vectors.shape[:-1],
                                     doc="Shape of an image.")  # type: ignore[assignment]

    if TYPE_CHECKING:

        @property
        def shape(self) -> Any:
            """Shape of an image: that of the views less their last axis."""

    @classmethod
    def is_member(cls) -> bool:
        """Return whether the class says what its views are."""
        return super().is_member() and any(_says(cls, name) for name in ("points", "directions"))

    @property
    def dimension(self) -> int:
        """3 in space, 2 in flatland."""
        return self.vectors.shape[-1]

    @property
    def regular_grid(self) -> "FarFieldGrid | None":
        """The sensor, if its views are a regular grid of direction sines."""
        return None

    @cached_property
    def vectors(self) -> np.ndarray:
        """float64[..., d], directions of travel, of length 1 to the last bit, or points."""
        name = "points" if self.near else "directions"
        given = getattr(self, name)
        if not is_own(type(self)):  # their fields have been checked
            return given
        given = real_array(f"{type(self).__name__}.{name}", given)
        return (position_vectors if self.near else unit_vectors)(f"{type(self).__name__}.{name}", given)

    @property
    def corners(self) -> np.ndarray:
        """float64[n, d], views between which, in direction, all others lie: of a grid its corners, else all."""
        return self.vectors.reshape(-1, self.vectors.shape[-1])


class FarField(Sensor):
    """Views at arbitrary directions of travel, unit vectors float64[..., 3], or float64[..., 2] in flatland.

    Parameters
    ----------
    directions
        Where light goes that is seen, unit vectors float64[..., 3], or float64[..., 2] in flatland; fields have the
        shape of the axes before the last.

    Examples
    --------
    >>> import specklegen as sg
    >>> views = sg.sensors.FarField([[0.0, 0.0, 1.0], [0.0, 0.6, 0.8]])  # straight on, and at 37 degrees
    >>> views.shape
    (2,)
    >>> sg.sensors.FarField.grid((64, 64), 1e-3).shape  # a camera
    (64, 64)
    """

    type: Literal["FarField"] = "FarField"
    directions: Annotated[Array, NUMBER] = Field(kw_only=False)

    @model_validator(mode="after")
    def _check(self) -> Self:
        directions = unit_vectors("FarField.directions", self.directions)
        object.__setattr__(self, "directions", directions)
        return self

    @property
    def shape(self) -> tuple[int, ...]:
        """Shape of an image: that of ``directions`` less its last axis."""
        return self.directions.shape[:-1]

    @property
    def dimension(self) -> int:
        """3 in space, 2 in flatland."""
        return self.directions.shape[-1]

    @classmethod
    @with_units
    def angles(cls, angles: Annotated[ArrayLike, RADIAN]) -> Self:
        """Views in flatland at ``angles`` from the axis, radians, any shape: directions (sin, cos)."""
        angles = real_array("FarField.angles", angles)
        return cls(directions=np.stack([np.sin(angles), np.cos(angles)], axis=-1))

    @staticmethod
    @with_units
    def grid(
        shape: tuple[int, int], pitch: Annotated[float, SINE],
        center: tuple[Annotated[float, SINE], Annotated[float, SINE]] = (0.0, 0.0), side: Side = "transmission",
    ) -> "FarFieldGrid":  # fmt: skip
        """Views on a regular grid of direction sines, a :class:`FarFieldGrid`.

        Parameters
        ----------
        shape
            (rows, columns) = (y, x); row 0 and column 0 hold the smallest sines.
        pitch
            Direction sine between neighbouring views.
        center
            (x, y) direction sines of the middle of the grid.
        side
            "transmission" looks at light that leaves through z = thickness, "reflection" through z = 0.
        """
        return FarFieldGrid(shape=shape, pitch=pitch, center=center, side=side)


class FarFieldGrid(Sensor):
    """Views on a regular grid of direction sines inside the medium; the camera of a far-field scene.

    Parameters
    ----------
    shape
        (rows, columns) = (y, x); row 0 and column 0 hold the smallest sines.
    pitch
        Direction sine between neighbouring views.
    center
        (x, y) direction sines of the middle of the grid.
    side
        "transmission" looks at light that leaves through z = thickness, "reflection" through z = 0.

    Examples
    --------
    >>> import specklegen as sg
    >>> camera = sg.sensors.FarFieldGrid(shape=(3, 4), pitch=1e-3, center=(0.01, 0.0))
    >>> camera.directions.shape
    (3, 4, 3)
    """

    type: Literal["FarFieldGrid"] = "FarFieldGrid"
    shape: tuple[PositiveInt, PositiveInt]  # type: ignore[assignment]
    pitch: Annotated[Positive, SINE]
    center: tuple[Annotated[Finite, SINE], Annotated[Finite, SINE]] = (0.0, 0.0)
    side: Side = "transmission"

    @model_validator(mode="after")
    def _check(self) -> Self:
        if 8 * max(self.shape) > 0.1 * memory_limit():  # of one axis, before it is allocated
            reject(
                "FarFieldGrid.shape", f"at most {int(0.1 * memory_limit() / 8):.1e} views a side here", self.shape,
                "A render keeps 8 bytes for each tilt and view: use fewer views, or render tiles.",
            )  # fmt: skip
        x, y = self.sines
        corner = np.hypot(np.abs(x).max(), np.abs(y).max())
        if corner > 1:
            reject("FarFieldGrid.pitch", "small enough that every view has a direction sine of at most 1", self.pitch,
                   f"The corner of this grid would lie at {corner:.3g}: lower shape, pitch or |center|.")  # fmt: skip
        return self

    @classmethod
    def __pydantic_init_subclass__(cls, **kwargs: Any) -> None:
        changed = sorted(vars(cls).keys() & _GRID)
        if changed:
            reject(f"{cls.__name__}", "a regular grid, such as FarFieldGrid", changed,
                   "For other views subclass Sensor.")  # fmt: skip
        super().__pydantic_init_subclass__(**kwargs)

    @property
    def dimension(self) -> int:
        """3: grids are in space."""
        return 3

    @property
    def regular_grid(self) -> "FarFieldGrid":
        """Itself."""
        return self

    @property
    def corners(self) -> np.ndarray:
        """float64[4, 3]."""
        return self.corner_directions

    @property
    def sines(self) -> tuple[np.ndarray, np.ndarray]:
        """Direction sines (x of the columns, y of the rows), float64[W] and float64[H]."""
        rows, columns = self.shape
        return (
            self.center[0] + (np.arange(columns) - (columns - 1) / 2) * self.pitch,
            self.center[1] + (np.arange(rows) - (rows - 1) / 2) * self.pitch,
        )

    @property
    def sign(self) -> float:
        """Sign of the views' z component."""
        return 1.0 if self.side == "transmission" else -1.0

    @cached_property
    def directions(self) -> np.ndarray:
        """float64[H, W, 3], unit vectors of travel."""
        y, x = np.meshgrid(*reversed(self.sines), indexing="ij")
        return read_only(directions_of_sines("FarFieldGrid.pitch", np.stack([x, y], axis=-1), self.sign))

    @property
    def center_direction(self) -> np.ndarray:
        """float64[3], the view in the middle of the grid."""
        return directions_of_sines("FarFieldGrid.center", self.center, self.sign)

    @property
    def corner_directions(self) -> np.ndarray:
        """float64[4, 3], the views at the corners."""
        x, y = self.sines
        return directions_of_sines(
            "FarFieldGrid.pitch", [(a, b) for a in (x[0], x[-1]) for b in (y[0], y[-1])], self.sign
        )

    def nearest(self, directions: np.ndarray) -> np.ndarray:
        """float64[n, 3], the view nearest to each of the directions float64[n, 3], without building all views.

        Along a row, -d . v is convex on the side of the sphere that d is on, so its least value lies beside the
        continuous one, and concave on the other side, where it lies at an end.
        """
        x, y = self.sines
        rows = np.sqrt(np.clip(1 - y**2, 0, None))
        sines = []
        for d in directions:
            best = rows * d[0] / max(np.hypot(d[0], d[2]), 1e-300)
            beside = np.clip(np.floor((best - x[0]) / self.pitch), 0, max(len(x) - 2, 0)).astype(int)
            columns = np.stack([0 * beside, beside, np.minimum(beside + 1, len(x) - 1), 0 * beside + len(x) - 1])
            across = x[columns] * d[0] + y * d[1]
            towards = across + self.sign * d[2] * np.sqrt(np.clip(rows**2 - x[columns] ** 2, 0, None))
            candidate, row = np.unravel_index(towards.argmax(), towards.shape)
            sines.append((x[columns[candidate, row]], y[row]))
        return directions_of_sines("FarFieldGrid.pitch", np.reshape(sines, (-1, 2)), self.sign)


def require_resolved(field: str, wavelength: float, width: float, pitch: float) -> None:
    """Refuse a grid that undersamples the speckle's intensity: pitch <= wavelength / (2 width)."""
    grain = wavelength / width
    if pitch > 0.5 * grain * (1 + 1e-9):
        reject(field, f"at most half the speckle size (wavelength / width = {grain:.3g})", pitch,
               f"It undersamples the speckle: use a pitch <= {grain / 2:.3g}, or a beam narrower than "
               f"{wavelength / (2 * pitch):.4g}.")  # fmt: skip


class NearField(Sensor):
    """Points at which the field itself is measured, float64[..., 3] or float64[..., 2]; inside or outside the medium.

    |u|^2 is an irradiance ratio.

    Parameters
    ----------
    points
        Where the field is measured, float64[..., 3] or float64[..., 2], in the scene's unit of length; fields have the
        shape of the axes before the last.

    Examples
    --------
    >>> import specklegen as sg
    >>> points = sg.sensors.NearField([[0.0, 0.0, 120.0], [1.0, 0.0, 120.0]])  # lengths
    >>> points.shape
    (2,)
    """

    near: ClassVar[bool] = True
    type: Literal["NearField"] = "NearField"
    points: Annotated[Array, LENGTH] = Field(kw_only=False)

    @model_validator(mode="after")
    def _check(self) -> Self:
        object.__setattr__(self, "points", position_vectors("NearField.points", self.points))
        return self

    @property
    def shape(self) -> tuple[int, ...]:
        """Shape of an image: that of ``points`` less its last axis."""
        return self.points.shape[:-1]

    @property
    def dimension(self) -> int:
        """3 in space, 2 in flatland."""
        return self.points.shape[-1]


AnySensor = Annotated[Sensor, *member_of(Sensor)]
"""A sensor of any type, written with it."""
