"""The faces of a slab: a step of the refractive index, which reflects light on its way in and out."""

from typing import Self

from pydantic import model_validator

from specklegen.core.errors import reject
from specklegen.core.values import Positive, Value


def require_index(field: str, index: float) -> None:
    """Refuse a refractive index that nothing has."""
    if not 0.1 <= index <= 10:
        reject(field, "a refractive index between 0.1 and 10", index)


class Faces(Value):
    """Both faces of a slab: smooth, alike, and between two refractive indices. By default matched: no step.

    Scalar light is reflected as the mean of both polarisations, polarised light as either (not through a wall).

    Parameters
    ----------
    inside, outside
        Refractive index of the slab, and of what is before and behind it.
    wall
        Of a thin plate (glass, say) over each face; by default there is none. Its echoes add up as powers at the place
        where they left: right for plates much thinner than the slab.

    Examples
    --------
    >>> import specklegen as sg
    >>> glass = sg.media.Faces(inside=1.5, outside=1.0)
    >>> slab = sg.Slab(thickness=100.0, mean_free_path=20.0, scatterer=sg.media.Isotropic(), faces=glass)
    >>> round(glass.largest_sine, 3)  # of views from outside, measured inside
    0.667
    """

    inside: Positive = 1.0
    outside: Positive = 1.0
    wall: Positive | None = None

    @model_validator(mode="after")
    def _check(self) -> Self:
        for name in ("inside", "outside", "wall"):
            index = getattr(self, name)
            if index is not None:
                require_index(f"Faces.{name}", index)
        return self

    @property
    def matched(self) -> bool:
        """True if nothing is reflected."""
        return self.inside == self.outside and self.wall in (None, self.inside)

    @property
    def indices(self) -> tuple[float, float, float]:
        """Refractive indices inside, of the wall (inside again where there is none), and outside."""
        return self.inside, self.inside if self.wall is None else self.wall, self.outside

    @property
    def largest_sine(self) -> float:
        """Direction sine inside up to which light enters and leaves; beyond, all of it is reflected."""
        return min(1.0, min(self.indices[1:]) / self.inside)
