"""Tilts of the illumination of one medium: equally spaced along a line."""

import numpy as np

from specklegen.core.values import PositiveInt, Value
from specklegen.datasets.recipes.parts.distributions import Draw, drawn, ends
from specklegen.datasets.sample_schema import ArraySpec


class Tilts(Value):
    """Equally spaced tilts from the axis.

    Parameters
    ----------
    count
        Number of tilts, the first along the axis.
    step
        Angle between neighbours, radians; may vary from medium to medium.
    azimuth
        Direction of tilting from the x axis, radians; may vary from medium to medium.
    """

    count: PositiveInt = 5
    step: Draw
    azimuth: Draw = 0.0

    def angles(self, step: float, azimuth: float) -> np.ndarray:
        """Tilts float64[T, 2] = (x, y), radians."""
        along = np.array([np.cos(azimuth), np.sin(azimuth)])
        return np.arange(self.count)[:, None] * (step * along)

    def drawn(self, rng: np.random.Generator) -> tuple[np.ndarray, dict[str, float]]:
        """Tilts of one medium, radians, and what was drawn for them."""
        step, azimuth = drawn(self.step, rng), drawn(self.azimuth, rng)
        return self.angles(step, azimuth), {"tilt_step": step, "tilt_azimuth": azimuth}

    @property
    def widest(self) -> np.ndarray:
        """The tilts that reach farthest, radians."""
        return self.angles(max(ends(self.step), key=abs), ends(self.azimuth)[0])

    @property
    def layout(self) -> ArraySpec:
        """Layout of the tilts of a sample."""
        return ArraySpec(
            shape=(self.count, 2), dtype="float64", dims=("tilt", "axis"), units="rad",
            description="tilt of the illumination from the axis along x and y",
        )  # fmt: skip
