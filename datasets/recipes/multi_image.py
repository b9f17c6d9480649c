"""Recipe kinds "dynamic-slab" and "two-tilts": one hidden object in several camera images.

Either the medium changes from image to image, or the illumination is tilted.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING, Literal, Self

import numpy as np
from pydantic import model_validator

from specklegen.core.lazy import LazyModule
from specklegen.core.values import PositiveInt, Value
from specklegen.datasets.recipes.hidden_object import HiddenObject
from specklegen.datasets.recipes.parts.distributions import UnboundedDraw, drawn, require_above
from specklegen.datasets.recipes.parts.light import draw_frames
from specklegen.datasets.recipes.parts.tilts import Tilts
from specklegen.datasets.sample_schema import ArraySpec
from specklegen.datasets.split import Purpose, Split, generator, substream
from specklegen.samplers.screens.objects import ScreenObjects
from specklegen.samplers.stationary.objects import ObjectSampler

if TYPE_CHECKING:
    import torch
else:
    torch = LazyModule("torch")


class Dynamics(Value):
    """How a medium changes: its fields follow a first-order autoregression (see :mod:`light`).

    Parameters
    ----------
    frames
        Images a sample.
    correlation_time
        Frames over which the correlation of the field falls to 1/e, and that of the intensity to 1/e^2; may
        vary from medium to medium; infinite for a medium that stays as it is.
    """

    frames: PositiveInt = 8
    correlation_time: UnboundedDraw

    @model_validator(mode="after")
    def _check(self) -> Self:
        require_above("Dynamics.correlation_time", self.correlation_time, 0)
        return self


class DynamicSlab(HiddenObject):
    """Films of one object through a medium that changes.

    Samples: ``frames`` float32[F, H, W] (or uint16 counts), ``object`` float32[h, w].
    """

    kind: Literal["dynamic-slab"] = "dynamic-slab"  # type: ignore[assignment]
    dynamics: Dynamics

    def images_layout(self) -> dict[str, ArraySpec]:
        """Layout of what :meth:`images_of` names."""
        shape = (self.dynamics.frames, *self.camera_shape)
        return {"frames": self.observation(shape, ("frame", "y", "x"), "one camera image a frame")}

    def images_of(self, images: np.ndarray, tilts: np.ndarray) -> dict[str, np.ndarray]:  # noqa: ARG002
        """Name what the camera saw, [F, H, W]."""
        return {"frames": images}

    def media_frames(
        self, sampler: ObjectSampler | ScreenObjects, seed: int, split: Split, medium: int
    ) -> tuple[dict[str, float], Callable[[], list[torch.Tensor]]]:
        """What is drawn for the frames of one medium, and how the sampler draws their fields."""
        time = drawn(self.dynamics.correlation_time, generator(substream(seed, split, Purpose.DYNAMICS, medium)))
        kept = float(np.exp(-1 / time))
        frames = partial(draw_frames, self.light, sampler, seed, split, medium, self.dynamics.frames, kept)
        return {"correlation_time": time}, frames

    @property
    def path_sum_obstacle(self) -> str | None:
        """Films."""
        return "dynamics"


class TwoTilts(HiddenObject):
    """Images of one object under several tilts of its light, correlated by the memory effect.

    The camera stands still, so that each image is shifted by its tilt. Samples: ``stack`` float32[T, H, W] (or
    uint16 counts), ``tilts`` float64[T, 2] in radians, ``object`` float32[h, w].
    """

    kind: Literal["two-tilts"] = "two-tilts"  # type: ignore[assignment]
    tilts: Tilts

    def images_layout(self) -> dict[str, ArraySpec]:
        """Layout of what :meth:`images_of` names."""
        shape = (self.tilts.count, *self.camera_shape)
        return {
            "stack": self.observation(shape, ("tilt", "y", "x"), "one camera image a tilt"),
            "tilts": self.tilts.layout,
        }

    def images_of(self, images: np.ndarray, tilts: np.ndarray) -> dict[str, np.ndarray]:
        """Name what the camera saw, [T, H, W], under tilts float64[T, 2]."""
        return {"stack": images, "tilts": tilts.copy()}

    def tilts_of(self, rng: np.random.Generator) -> tuple[np.ndarray, dict[str, float]]:
        """Tilts float64[T, 2] of the illumination of one medium, radians, and what was drawn for them."""
        return self.tilts.drawn(rng)

    @property
    def widest_tilts(self) -> np.ndarray:
        """The tilts that reach farthest, radians."""
        return self.tilts.widest
