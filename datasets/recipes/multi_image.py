"""Recipe kinds "dynamic-slab" and "two-tilts": one hidden object in several camera images.

Either the medium changes from image to image, or the illumination is tilted.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal, Self, cast

import numpy as np
from pydantic import model_validator

from specklegen.core.decision import Decision
from specklegen.core.errors import reject
from specklegen.core.lazy import optimize, torch
from specklegen.core.units import LENGTH, TIME
from specklegen.core.values import Positive, PositiveInt
from specklegen.datasets.distributions import Draw, UnboundedDraw, ends, require_above
from specklegen.datasets.recipes import brownian as _brownian
from specklegen.datasets.recipes.brownian import Speed
from specklegen.datasets.recipes.hidden_object import HiddenObject
from specklegen.datasets.recipes.media import DrawnMedia
from specklegen.datasets.recipes.parts.diffuser import Diffuser
from specklegen.datasets.recipes.tilted import Tilted
from specklegen.datasets.sample_schema import ArraySpec
from specklegen.datasets.split import Purpose
from specklegen.samplers.screens.film import frame_correlation
from specklegen.scene.scene import Scene
from specklegen.scene.window import Window

if TYPE_CHECKING:
    from specklegen.datasets.addresses import Addresses
    from specklegen.datasets.recipes.recipe import Medium

MODELS = {
    "autoregression": "the fields of two frames are correlated by e^(-t / correlation_time) for paths of any length; "
    "in media of moving scatterers long paths decorrelate first",
    "brownian": "independent Brownian particles, each path with its momentum transfer",
}
"""Laws by which the field of a medium decorrelates, and what each assumes."""
_LOG_TIMES = np.linspace(-20.0, 40.0, 13)
"""Logarithms of times, in frames, between which a correlation time is looked for."""


class Dynamics(Speed):
    """Change of a medium from image to image.

    Parameters
    ----------
    frames
        Images a sample.
    model
        Law of the decorrelation. "brownian": particles move, each by itself, and the fields of two frames are
        correlated as the paths of the material say (:mod:`specklegen.memory_effects.moving`); its speed is given by
        one of ``diffusion``, ``tau0`` and ``correlation_time``, and every sample's parameters have all three.
        "autoregression", the default: the medium is redrawn little by little, by a first-order autoregression of its
        fields (see :mod:`light`), over a ``correlation_time``. **It is assumed, and no medium obeys it.** Scatterers
        in motion change the phases of long paths faster than those of short ones, so that the correlation falls faster
        at first and has a long tail: its square is 0.82 and 0.0025 at 0.1 and 3 correlation times here, 0.59 and 0.04
        with the paths of a slab of optical depth 10 and g 0.9.
    correlation_time
        Time over which the correlation of the field falls to 1/e, and that of the intensity to 1/e^2; may
        vary from medium to medium. In frames, and infinite for a medium that stays as it is, of an autoregression; in
        the unit of the ``interval`` of Brownian particles, whose diffusion follows from it and the material's paths.
    interval
        Time from frame to frame, of Brownian particles.
    diffusion
        Of Brownian particles, the fastest of layers: length^2 over the unit of the ``interval``.
    tau0
        1 / (D k^2), k inside the medium, instead.
    velocities
        Thin screens drift across the light: (x, y) of each, lengths a frame, every number a constant or drawn anew for
        each medium. Frames are correlated by the closed form of that motion, which is that of a tilt
        (:mod:`specklegen.samplers.screens.film`).
    """

    frames: PositiveInt = 8
    model: str = "autoregression"
    correlation_time: Annotated[UnboundedDraw, TIME] | None = None
    interval: Annotated[Positive, TIME] | None = None
    velocities: tuple[tuple[Annotated[Draw, LENGTH], Annotated[Draw, LENGTH]], ...] | None = None

    @classmethod
    def plain_fields(cls, table: Mapping[str, Any]) -> tuple[str, ...]:
        """Names of times that are numbers of frames."""
        return () if table.get("model") == "brownian" else ("correlation_time",)

    @model_validator(mode="after")
    def _check(self) -> Self:
        if self.model not in MODELS:
            reject("Dynamics.model", f"one of {', '.join(MODELS)}", self.model)
        if self.brownian:
            return self._check_brownian()
        for name in ("interval", "diffusion", "tau0"):
            if getattr(self, name) is not None:
                reject(f"Dynamics.{name}", 'left out unless model = "brownian"', getattr(self, name))
        if (self.correlation_time is None) == (self.velocities is None):
            reject("Dynamics", "given by one of correlation_time and velocities", self.model_dump(exclude_none=True))
        if self.velocities is not None and "model" in self.model_fields_set:
            reject("Dynamics.model", "left out if velocities are given", self.model, "Drifting screens need no model.")
        if self.correlation_time is not None:
            require_above("Dynamics.correlation_time", self.correlation_time, 0)
        return self

    def _check_brownian(self) -> Self:
        if self.velocities is not None:
            reject("Dynamics.velocities", 'left out with model = "brownian"', self.velocities,
                   "Velocities belong to screens.")
        if self.interval is None:
            reject("Dynamics.interval", 'given with model = "brownian"', None, "Give the time from frame to frame.")
        self.require_speed("Dynamics", ' of model = "brownian"')
        return self

    @property
    def brownian(self) -> bool:
        """True if particles move."""
        return self.model == "brownian"

class DynamicSlab(HiddenObject):
    """Films of one object through a medium that changes.

    Samples: ``frames`` float32[F, H, W] (or uint16 counts), ``object`` float32[h, w].
    """

    kind: Literal["dynamic-slab"] = "dynamic-slab"  # type: ignore[assignment]
    looked_up: ClassVar[bool] = False  # the atlas knows no motion
    dynamics: Dynamics

    @model_validator(mode="after")
    def _check_velocities(self) -> Self:
        given = self.dynamics.velocities
        screens = len(self.material.screens) if isinstance(self.material, Diffuser) else 0
        if given is not None and len(given) != screens:
            reject("Dynamics.velocities",
                   f"{screens} pairs (x, y), one for each screen" if screens else "left out for a slab",
                   len(given), "For a medium of scatterers, give correlation_time.")  # fmt: skip
        return self

    @model_validator(mode="after")
    def _check_particles(self) -> Self:
        if not self.dynamics.brownian:
            return self
        _brownian.require_moving(self, 'of [dynamics] model = "brownian"')
        return self

    def idealisations(self, scene: Scene) -> list[Decision]:
        """Parts left out of every image, and the law between them."""
        model, modelled = self.dynamics.model, self.dynamics.brownian
        law = Decision("motion", modelled, f'{"" if modelled else "idealised: "}model "{model}": {MODELS[model]}')
        return super().idealisations(scene) + ([law] if self.dynamics.velocities is None else [])

    def images_layout(self) -> dict[str, ArraySpec]:
        """Layout of what :meth:`images_of` names."""
        shape = (self.dynamics.frames, *self.camera_shape)
        return {"frames": self.observation(shape, ("frame", "y", "x"), "one camera image a frame")}

    def named(self, images: Any, tilts: Any, parameters: Mapping[str, Any]) -> dict[str, Any]:  # noqa: ARG002
        """The film."""
        return {"frames": images}

    @property
    def frames(self) -> int:
        """Frames in which the fields are redrawn little by little; those of screens that drift are base tilts."""
        return 1 if self.dynamics.velocities is not None else self.dynamics.frames

    @property
    def pictures(self) -> int:
        """One a frame."""
        return self.dynamics.frames

    @property
    def media_alike(self) -> bool:
        """True if neither material, extent, velocities nor the speed of particles are drawn."""
        drifts = [number for both in self.dynamics.velocities or () for number in both]
        speeds = [self.dynamics.speed] if self.dynamics.brownian else []
        return super().media_alike and all(low == high for low, high in map(ends, drifts + speeds))

    @property
    def moving(self) -> bool:
        """True if particles do."""
        return self.dynamics.brownian

    def later_frames(self, drawn: Addresses, numbers: Sequence[int]) -> torch.Tensor | None:
        """Keys int64[M, halves, F - 1, 2] of the fields of all frames but the first."""
        return None if self.frames == 1 else _brownian.frame_keys(self, drawn, numbers)

    def tilts_of(
        self, drawn: Addresses, numbers: Sequence[int]
    ) -> tuple[torch.Tensor, dict[str, torch.Tensor]]:
        """No tilt; once a frame where screens drift, as frames are base tilts to their modes."""
        angles, tilted = super().tilts_of(drawn, numbers)
        return angles.repeat(1, 1 if self.dynamics.velocities is None else self.dynamics.frames, 1), tilted

    @property
    def widest_tilts(self) -> np.ndarray:
        """No tilt, once a frame where screens drift."""
        return np.repeat(super().widest_tilts, self.pictures // self.frames, axis=0)

    def moved_media(self, drawn: Addresses, numbers: Sequence[int], media: DrawnMedia) -> DrawnMedia:
        """Draw how still media are, how fast their particles move, or how their screens drift."""
        if self.dynamics.brownian:
            return self._filmed(drawn, numbers, media)
        if self.dynamics.velocities is None:
            assert self.dynamics.correlation_time is not None
            (time,) = drawn.numbers(Purpose.DYNAMICS, [self.dynamics.correlation_time], numbers)
            parameters = media.parameters | {"correlation_time": time}
            return replace(media, parameters=parameters, still=torch.exp(-1 / time))
        each = [number for both in self.dynamics.velocities for number in both]
        components = drawn.numbers(Purpose.DYNAMICS, each, numbers)
        names = [f"velocity{m}_{axis}" for m in range(len(self.dynamics.velocities)) for axis in "xy"]
        velocities = torch.stack(components, -1).unflatten(1, (-1, 2))
        frame = torch.arange(self.dynamics.frames, dtype=torch.float64, device=velocities.device)
        times = [self._correlation_time(media, n, motion) for n, motion in enumerate(velocities.tolist())]
        parameters = media.parameters | dict(zip(names, components, strict=True))
        parameters["correlation_time"] = torch.tensor(times, dtype=torch.float64).to(velocities.device)
        return replace(media, parameters=parameters, moved=frame[:, None, None] * velocities[:, None])

    def _filmed(self, drawn: Addresses, numbers: Sequence[int], media: DrawnMedia) -> DrawnMedia:
        """Draw the speed of particles, and ask the paths of every material what it does to fields."""
        assert self.dynamics.interval is not None
        steps = np.arange(self.dynamics.frames)
        return _brownian.filmed_media(
            self, self.dynamics, drawn, numbers, media, steps * self.dynamics.interval, np.abs(steps[:, None] - steps)
        )

    def _correlation_time(self, media: DrawnMedia, place: int, motion: list[list[float]]) -> float:
        """Frames over which the correlation of a field falls to 1/e, of one medium whose screens drift."""
        window = Window(self.profile, float(media.sight.width[place]))
        stack = cast(Any, media.materials.slabs[place]()).stack.replace(velocities=motion)
        excess = lambda log_times: frame_correlation(  # noqa: E731
            stack, self.wavelength, stack.moved(np.exp(log_times)), window
        ) - np.exp(-1)  # fmt: skip
        known = excess(_LOG_TIMES)  # all at once: a search that begins with all of them asks twice as often
        if known[-1] > 0:
            return np.inf
        first = int(np.argmax(known <= 0))
        if first == 0:
            return 0.0  # below the first of the times, 2e-9 of a frame
        log_time = optimize.root_scalar(lambda t: excess([t])[0], bracket=tuple(_LOG_TIMES[first - 1 : first + 1])).root
        return float(np.exp(log_time))

    def frames_correlation(self, ready: Medium) -> np.ndarray:
        """Correlation float64[F] of one beam's field in the first frame with that in every frame."""
        steps, values = np.arange(self.dynamics.frames), ready.parameters
        if self.dynamics.brownian:
            assert self.dynamics.interval is not None
            known = _brownian.moving(self.material, ready.ready.drawn.materials.slabs[0]())
            return known.field(steps * self.dynamics.interval / values["tau0"])
        if self.dynamics.correlation_time is not None:
            return np.exp(-steps / values["correlation_time"])
        assert isinstance(self.material, Diffuser)
        motion = [(values[f"velocity{m}_x"], values[f"velocity{m}_y"]) for m in range(len(self.material.screens))]
        stack = self.material.slab_of(values).stack.replace(velocities=motion)
        return frame_correlation(stack, values["wavelength"], stack.moved(steps), Window(self.profile, values["width"]))

    @property
    def path_sum_obstacle(self) -> str | None:
        """Films."""
        return "dynamics"


class TwoTilts(Tilted, HiddenObject):
    """Images of one object under several tilts of its light, correlated by the memory effect.

    The camera stands still, so that each image is shifted by its tilt. Samples: ``stack`` float32[T, H, W] (or
    uint16 counts), ``tilts`` float64[T, 2] in radians, ``object`` float32[h, w].
    """

    kind: Literal["two-tilts"] = "two-tilts"  # type: ignore[assignment]

    def images_layout(self) -> dict[str, ArraySpec]:
        """Layout of what :meth:`images_of` names."""
        shape = (self.tilts.count, *self.camera_shape)
        return {
            "stack": self.observation(shape, ("tilt", "y", "x"), "one camera image a tilt"),
            "tilts": self.tilts.layout,
        }

    def tilts_of(
        self, drawn: Addresses, numbers: Sequence[int]
    ) -> tuple[torch.Tensor, dict[str, torch.Tensor]]:
        """Tilts float64[M, T, 2] of the illumination of media, radians, and what was drawn for them."""
        return self.tilts.drawn_together(drawn, numbers)

    @property
    def widest_tilts(self) -> np.ndarray:
        """The tilts that reach farthest, radians."""
        return self.tilts.widest
