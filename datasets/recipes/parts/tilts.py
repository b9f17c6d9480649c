"""Tilts of the illumination of one medium: equally spaced along a line."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Annotated, Self

import numpy as np
from pydantic import model_validator

from specklegen.core.errors import reject
from specklegen.core.lazy import torch
from specklegen.core.units import RADIAN
from specklegen.core.values import PositiveInt, Value
from specklegen.datasets.distributions import Choice, Draw, ends
from specklegen.datasets.sample_schema import ArraySpec
from specklegen.datasets.split import Purpose

if TYPE_CHECKING:
    from specklegen.datasets.addresses import Addresses


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

    Raises
    ------
    RuleError
        If the last tilt may be at 90 degrees from the axis or beyond.
    """

    count: PositiveInt = 5
    step: Annotated[Draw, RADIAN]
    azimuth: Annotated[Draw, RADIAN] = 0.0

    @model_validator(mode="after")
    def _check(self) -> Self:
        reach = float(self.count - 1) * max(map(abs, ends(self.step)))
        last = reach * np.array([[np.cos(a), np.sin(a)] for a in self._azimuths()])
        if np.abs(last).max() >= np.pi / 2 or np.square(np.sin(last)).sum(1).max() >= 1:
            reject("Tilts.step", f"radians such that tilt {self.count - 1} leans less than 90 degrees", self.step,
                   "Use a smaller step or fewer tilts; 1 degree is 0.01745.")  # fmt: skip
        return self

    def _azimuths(self) -> list[float]:
        """Azimuths that may be drawn, among them those at which a tilt leans most: on an axis, or on a diagonal."""
        if isinstance(self.azimuth, Choice):
            return list(self.azimuth.choice)
        low, high = ends(self.azimuth)
        if high - low >= np.pi / 2:
            return [0.0, np.pi / 4]
        first = np.ceil(low / (np.pi / 4))
        return [low, high, *(a for a in np.pi / 4 * (first + np.arange(2)) if a <= high)]

    def angles(self, step: float, azimuth: float) -> np.ndarray:
        """Tilts float64[T, 2] = (x, y), radians."""
        along = np.array([np.cos(azimuth), np.sin(azimuth)])
        return np.arange(self.count)[:, None] * (step * along)

    @property
    def varies(self) -> bool:
        """True if media may be seen under different tilts."""
        return any(low < high for low, high in map(ends, (self.step, self.azimuth)))

    def drawn_together(
        self, drawn: "Addresses", numbers: Sequence[int]
    ) -> "tuple[torch.Tensor, dict[str, torch.Tensor]]":
        """Tilts of media float64[M, T, 2], radians, and what was drawn for them."""
        step, azimuth = drawn.numbers(Purpose.TILTS, (self.step, self.azimuth), numbers)
        along = torch.stack([torch.cos(azimuth), torch.sin(azimuth)], -1)
        number = torch.arange(self.count, dtype=torch.float64, device=step.device)
        tilts = number[:, None] * (step[:, None] * along)[:, None]
        return tilts, {"tilt_step": step, "tilt_azimuth": azimuth}

    @property
    def widest(self) -> np.ndarray:
        """The tilts that reach farthest, radians."""
        return self.angles(max(ends(self.step), key=abs), ends(self.azimuth)[0])

    @property
    def layout(self) -> ArraySpec:
        """Layout of the tilts of a sample."""
        return ArraySpec(shape=(self.count, 2), dtype="float64", dims=("tilt", "axis"), units="rad",
                         description="tilt of the illumination from the axis along x and y")  # fmt: skip
