"""Recipe kind "exposure-stack": speckle of one medium in motion, exposed for several times (laser speckle contrast).

A camera adds up light while the speckle moves; what is left of the contrast says how fast (Fercher and Briers, Opt.
Commun. 37, 326 (1981)), and several exposures tell what moves from what rests (Parthasarathy et al., Opt. Express
16, 1975 (2008)). An exposure is the mean of as many instants, at the midpoints of its parts, as its K^2 needs
(:func:`specklegen.theory.speckle_contrast.sub_frames`). Exposures of one medium are so far apart that what moves is
forgotten in between; what rests is the same in all.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import cached_property
from typing import TYPE_CHECKING, Annotated, Any, Literal, Self

import numpy as np
from pydantic import Field, model_validator

from specklegen.core.lazy import torch
from specklegen.core.units import TIME
from specklegen.core.values import Positive
from specklegen.datasets.distributions import ends
from specklegen.datasets.recipes import brownian
from specklegen.datasets.recipes.brownian import Speed
from specklegen.datasets.recipes.media import DrawnMedia, MediumView
from specklegen.datasets.recipes.parts.light import Lit
from specklegen.datasets.recipes.recipe import Recipe
from specklegen.datasets.recipes.specification import PARAMETERS
from specklegen.datasets.sample_schema import ArraySpec
from specklegen.theory.speckle_contrast import class_field, sub_frames

if TYPE_CHECKING:
    from specklegen.datasets.addresses import Addresses
    from specklegen.datasets.recipes.materials import Materials
    from specklegen.memory_effects.moving import MovingCorrelation


class Exposures(Speed):
    """Exposures of one medium, and how fast its particles move: by one of the last three.

    Parameters
    ----------
    durations
        Of the exposures, in any unit of time.
    tolerance
        By how much of itself K^2 of an exposure may be too large, for it is made of instants.
    tau0, diffusion, correlation_time
        In that unit, as of :class:`~specklegen.datasets.recipes.multi_image.Dynamics`.
    """

    durations: tuple[Annotated[Positive, TIME], ...] = Field(min_length=1)
    tolerance: Annotated[float, Field(gt=0, lt=0.5)] = 0.02

    @model_validator(mode="after")
    def _check(self) -> Self:
        self.require_speed("Exposures")
        return self


class ExposureStack(Recipe):
    """Speckle of one beam through a medium in motion, exposed for several times; mean intensity 1.

    Samples: ``stack`` float32[T, H, W] (or uint16 counts), ``target`` float32[2]: log10 of tau0, and the share of the
    light that meets nothing that moves. Among the parameters are ``diffusion``, ``tau0``, ``correlation_time``, and
    ``contrast_squared_0`` ...: K^2 of every exposure as it was drawn, of pixels that are points and one polarisation.
    ``expected_contrast`` is the root of their mean, in unpolarised light over two.

    Parameters
    ----------
    exposures
        How long, and how fast particles move.
    mode_tolerance
        As of other kinds; one beam has one mode, which leaves out nothing.
    """

    kind: Literal["exposure-stack"] = "exposure-stack"
    exposures: Exposures
    mode_tolerance: Annotated[float, Field(gt=0, lt=0.5)] = 0.01

    @model_validator(mode="after")
    def _check_particles(self) -> Self:
        brownian.require_moving(self, "where [exposures] are given")
        return self

    def layout(self) -> Mapping[str, ArraySpec]:
        """Shape, type, axes and unit of every array of a sample."""
        shape = (len(self.exposures.durations), *self.camera_shape)
        target = ArraySpec(shape=(2,), dims=("target",), description="log10 of tau0, share of the light at rest")
        return {
            "stack": self.observation(shape, ("exposure", "y", "x"), "one image an exposure"),
            "target": target, "parameters": PARAMETERS,
        }  # fmt: skip

    def extremes(self) -> list[MediumView]:
        """Media at the ends of every range."""
        seen, still = self.geometry, np.zeros((1, 2))
        return [MediumView(slab, seen, (1, 1), seen.grid.pitch, still) for slab in self.material.extremes()]  # type: ignore[arg-type]

    @cached_property
    def instants(self) -> tuple[int, ...]:
        """Instants of each exposure: as many as the fastest medium at the ends of every range needs."""
        known = [brownian.moving(self.material, slab) for slab in self.material.extremes()]
        fastest = ends(self.exposures.speed)[self.exposures.diffusion is not None]
        tau0 = self.exposures.tau0_of(known, np.full(len(known), fastest), self.wavelength)
        return tuple(
            max(sub_frames(_field(each), duration / time, tolerance=self.exposures.tolerance)
                for each, time in zip(known, tau0.tolist(), strict=True))
            for duration in self.exposures.durations
        )  # fmt: skip

    @property
    def frames(self) -> int:
        """Instants of all exposures."""
        return sum(self.instants)

    @property
    def pictures(self) -> int:
        """One an exposure."""
        return len(self.exposures.durations)

    @property
    def moving(self) -> bool:
        """Particles do."""
        return True

    @property
    def media_alike(self) -> bool:
        """True if neither the material nor the speed is drawn."""
        low, high = ends(self.exposures.speed)
        return super().media_alike and low == high

    @property
    def path_sum_obstacle(self) -> str | None:
        """Exposures."""
        return "exposures"

    def seen_media(self, drawn: Addresses, numbers: Sequence[int], materials: Materials) -> DrawnMedia:
        """Draw the speed of media; a beam is an object of one pixel."""
        seen = self.geometry
        whole = lambda value: torch.full_like(materials.half_range, value)  # noqa: E731
        base = torch.zeros((len(materials), 1, 2), dtype=torch.float64, device=drawn.device)
        parameters = materials.parameters | {"width": whole(seen.width), "camera_pitch": whole(seen.grid.pitch)}
        sight = self.sight(drawn, (1, 1), whole(seen.grid.pitch), base)
        media = DrawnMedia(materials, sight, seen.bandwidth, base, parameters, whole(1.0))
        lags, between = instant_lags(self.instants, self.exposures.durations)
        filmed = brownian.filmed_media(self, self.exposures, drawn, numbers, media, lags, between)
        return replace(filmed, parameters=filmed.parameters | self._contrasts(filmed))

    def _contrasts(self, media: DrawnMedia) -> dict[str, torch.Tensor]:
        """K^2 of every exposure as it is drawn."""
        assert media.film is not None
        contrasts = contrasts_squared(media.film.shares.sum(-1).square(), lag_weights(self.instants))
        return {f"contrast_squared_{place}": each for place, each in enumerate(contrasts.unbind(-1))}

    def later_frames(self, drawn: Addresses, numbers: Sequence[int]) -> torch.Tensor | None:
        """Keys int64[M, halves, F - 1, 2] of the fields of all instants but the first."""
        return None if self.frames == 1 else brownian.frame_keys(self, drawn, numbers)

    def exposed(self, images: torch.Tensor) -> torch.Tensor:
        """Exposures real[B, T, H, W] of images of instants real[B, F, H, W]."""
        return torch.stack([part.mean(1) for part in images.split(self.instants, 1)], 1)

    def contrast_left(self, parameters: Mapping[str, Any]) -> Any:
        """Root of the mean of K^2 of all exposures."""
        return (sum(parameters[f"contrast_squared_{place}"] for place in range(self.pictures)) / self.pictures) ** 0.5

    def lit(self, drawn: Addresses, numbers: Sequence[int]) -> Lit:
        """Beams of brightness 1."""
        return Lit(torch.ones((len(numbers), 1, 1), device=drawn.device), None, {}, {})

    def named(self, images: Any, tilts: Any, parameters: Mapping[str, Any]) -> dict[str, Any]:  # noqa: ARG002
        """Stacks, and the numbers to predict."""
        target = torch.stack([torch.log10(parameters["tau0"]), parameters["static_share"]], -1)
        return {"stack": images, "target": target.to(torch.float32)}


def instant_lags(instants: Sequence[int], durations: Sequence[float]) -> tuple[np.ndarray, np.ndarray]:
    """Lags float64[F + 1] between instants of exposures, the last of them endless, and which lies where, int64[F, F].

    What moves is forgotten from one exposure to the next.
    """
    pairs = zip(instants, durations, strict=True)
    steps = [np.arange(count) * duration / count for count, duration in pairs]
    firsts, frames = np.cumsum([0, *instants]), sum(instants)
    between = np.full((frames, frames), frames)  # the last lag: endless
    for first, own in zip(firsts, steps, strict=False):
        apart = np.abs(np.arange(len(own))[:, None] - np.arange(len(own)))
        between[first : first + len(own), first : first + len(own)] = np.where(apart > 0, first + apart, 0)
    return np.concatenate([*steps, [np.inf]]), between


def lag_weights(instants: Sequence[int]) -> np.ndarray:
    """Weights float64[E, F + 1] of |g1|^2 at those lags in K^2 of each exposure: the mean over pairs of instants."""
    weights, first = np.zeros((len(instants), sum(instants) + 1)), 0
    for own, count in zip(weights, instants, strict=True):
        apart = np.arange(1, count)
        own[0] = 1 / count
        own[first + 1 : first + count] = 2 * (count - apart) / count**2
        first += count
    return weights


def contrasts_squared(left: torch.Tensor, weights: np.ndarray) -> torch.Tensor:
    """K^2 float64[M, E] of exposures of M media, of |g1|^2 at the lags float64[M, F + 1] and their weights.

    Added up medium by medium: a row of a product of matrices has other last bits with other rows beside it, on some
    processors.
    """
    return (left[:, None] * torch.from_numpy(weights).to(left.device)).sum(-1)


def _field(known: MovingCorrelation) -> Any:
    return class_field(known.transfer, known.joint.sum(axis=0))
