"""Recipe kinds "dynamic-slab" and "two-tilts": one hidden object in several camera images.

Either the medium changes from image to image, or the illumination is tilted.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, Literal, Self

import numpy as np
from pydantic import SerializerFunctionWrapHandler, model_serializer, model_validator

from specklegen.core.errors import reject
from specklegen.core.lazy import LazyModule
from specklegen.core.values import PositiveInt, Value
from specklegen.datasets.recipes.hidden_object import HiddenObject, Motion
from specklegen.datasets.recipes.medium_realization import MediumRealization
from specklegen.datasets.recipes.parts.diffuser import Diffuser, KnownDiffuser
from specklegen.datasets.recipes.parts.distributions import Draw, UnboundedDraw, drawn, require_above
from specklegen.datasets.recipes.parts.light import draw_frames
from specklegen.datasets.recipes.parts.material import KnownMaterial
from specklegen.datasets.recipes.parts.tilts import Tilts
from specklegen.datasets.recipes.parts.viewing import Viewing
from specklegen.datasets.sample_schema import ArraySpec
from specklegen.datasets.split import Purpose, Split, generator, substream
from specklegen.samplers.screens.film import frame_correlation
from specklegen.samplers.screens.objects import ScreenObjects
from specklegen.samplers.stationary.objects import ObjectSampler
from specklegen.scene.window import Window

if TYPE_CHECKING:
    import torch
    from scipy import optimize
else:
    torch, optimize = LazyModule("torch"), LazyModule("scipy.optimize")

_TIMES = (-20.0, 40.0)
"""Logarithms of times, in frames, between which a correlation time is looked for."""


class Dynamics(Value):
    """How a medium changes from image to image: by one of the last two fields.

    Parameters
    ----------
    frames
        Images a sample.
    correlation_time
        The medium is redrawn little by little: its fields follow a first-order autoregression (see :mod:`light`).
        Frames over which the correlation of the field falls to 1/e, and that of the intensity to 1/e^2; may
        vary from medium to medium; infinite for a medium that stays as it is.
    velocities
        Thin screens drift across the light: (x, y) of each, lengths a frame, every number a constant or drawn anew for
        each medium. Frames are correlated by the closed form of that motion, which is that of a tilt
        (:mod:`specklegen.samplers.screens.film`).
    """

    frames: PositiveInt = 8
    correlation_time: UnboundedDraw | None = None
    velocities: tuple[tuple[Draw, Draw], ...] | None = None

    @model_validator(mode="after")
    def _check(self) -> Self:
        if (self.correlation_time is None) == (self.velocities is None):
            reject("Dynamics", "given by one of correlation_time and velocities", self.model_dump(exclude_none=True))
        if self.correlation_time is not None:
            require_above("Dynamics.correlation_time", self.correlation_time, 0)
        return self

    @model_serializer(mode="wrap")
    def _without_velocities(self, write: SerializerFunctionWrapHandler) -> dict[str, Any]:
        """Leave out velocities that are not there: the dynamics are what they were before they could have any."""
        content = write(self)
        if self.velocities is None:
            content.pop("velocities", None)
        return content


class DynamicSlab(HiddenObject):
    """Films of one object through a medium that changes.

    Samples: ``frames`` float32[F, H, W] (or uint16 counts), ``object`` float32[h, w].
    """

    kind: Literal["dynamic-slab"] = "dynamic-slab"  # type: ignore[assignment]
    dynamics: Dynamics

    @model_validator(mode="after")
    def _check_velocities(self) -> Self:
        given = self.dynamics.velocities
        screens = len(self.material.screens) if isinstance(self.material, Diffuser) else 0
        if given is not None and len(given) != screens:
            reject("Dynamics.velocities", f"{screens} pairs (x, y), one a screen" if screens else "left out for a slab",
                   len(given), "Give a correlation_time to a medium of scatterers.")  # fmt: skip
        return self

    def images_layout(self) -> dict[str, ArraySpec]:
        """Layout of what :meth:`images_of` names."""
        shape = (self.dynamics.frames, *self.camera_shape)
        return {"frames": self.observation(shape, ("frame", "y", "x"), "one camera image a frame")}

    def images_of(self, images: np.ndarray, tilts: np.ndarray) -> dict[str, np.ndarray]:  # noqa: ARG002
        """Name what the camera saw, [F, H, W]."""
        return {"frames": images}

    def media_frames(
        self, seed: int, split: Split, medium: int
    ) -> tuple[dict[str, float], Callable[[ObjectSampler | ScreenObjects], list[torch.Tensor]]]:
        """What is drawn for the frames of one medium, and how a sampler draws their fields."""
        if self.dynamics.correlation_time is None:  # the sampler's modes hold all frames
            return super().media_frames(seed, split, medium)
        time = drawn(self.dynamics.correlation_time, generator(substream(seed, split, Purpose.DYNAMICS, medium)))
        kept = float(np.exp(-1 / time))
        fixed = seed, split, medium, self.dynamics.frames, kept
        return {"correlation_time": time}, lambda made: draw_frames(self.light, made, *fixed)

    def tilts_of(self, rng: np.random.Generator) -> tuple[np.ndarray, dict[str, float]]:
        """No tilt; once a frame where screens drift, as frames are base tilts to their modes."""
        angles, tilted = super().tilts_of(rng)
        return np.repeat(angles, 1 if self.dynamics.velocities is None else self.dynamics.frames, axis=0), tilted

    def motion_of(
        self, material: KnownMaterial | KnownDiffuser, seed: int, split: Split, medium: int,  # noqa: ARG002
    ) -> Motion:  # fmt: skip
        """Velocity (x, y) of each screen of one medium, lengths a frame; none of what stands still."""
        rng = generator(substream(seed, split, Purpose.DYNAMICS, medium))
        return tuple((drawn(x, rng), drawn(y, rng)) for x, y in self.dynamics.velocities or ())

    def motion_parameters(
        self, material: KnownMaterial | KnownDiffuser, seen: Viewing, motion: Motion
    ) -> dict[str, float]:
        """Velocities, and the correlation time that follows from them."""
        if not motion:
            return {}
        named = {f"velocity{m}_{axis}": v for m, both in enumerate(motion) for axis, v in zip("xy", both, strict=True)}
        assert isinstance(material, KnownDiffuser)
        window = Window(seen.profile, seen.width)
        stack = material.slab.stack.replace(velocities=motion)
        kept = lambda log_time: frame_correlation(stack, seen.wavelength, stack.moved(np.exp([log_time])), window)[0]  # noqa: E731
        if kept(_TIMES[1]) > np.exp(-1):
            return named | {"correlation_time": np.inf}
        log_time = optimize.root_scalar(lambda t: kept(t) - np.exp(-1), bracket=_TIMES).root
        return named | {"correlation_time": float(np.exp(log_time))}

    def frames_correlation(self, ready: MediumRealization) -> np.ndarray:
        """Correlation float64[F] of one beam's field in the first frame with that in every frame."""
        steps, told = np.arange(self.dynamics.frames), ready.parameters
        if self.dynamics.correlation_time is not None:
            return np.exp(-steps / told["correlation_time"])
        assert isinstance(self.material, Diffuser)
        motion = [(told[f"velocity{m}_x"], told[f"velocity{m}_y"]) for m in range(len(self.material.screens))]
        stack = self.material.slab_of(told).stack.replace(velocities=motion)
        return frame_correlation(stack, told["wavelength"], stack.moved(steps), Window(self.profile, told["width"]))

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
