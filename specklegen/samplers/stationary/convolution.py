"""The convolution sampler: images of hidden objects as one speckle pattern a medium, moved with every pixel.

It is what the stationary sampler does with a single mode, and takes the memory effect as complete: C_I = 1 between all
pixels of the object. The error of that is known beforehand, 1 - C_I between the corners of the object that are farthest
apart, and it is the tolerance: no image correlation is off by more. Two patterns that an object's pixels should share
by C_I alone are one here, so speckle of large objects averages out less.
"""

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from typing import TYPE_CHECKING, ClassVar, Self

import numpy as np

from specklegen.core.cached_results import cached_result
from specklegen.core.decision import Decision
from specklegen.core.errors import reject
from specklegen.core.lazy import torch
from specklegen.core.random_streams import pilot_seed
from specklegen.core.values import remembered
from specklegen.memory_effects.atlas import atlas_correlation
from specklegen.samplers.sampler import MediaRequest, Request
from specklegen.samplers.stationary.object_maps import object_of
from specklegen.samplers.stationary.sampler import Stationary
from specklegen.scene.scene import Scene

if TYPE_CHECKING:
    from specklegen.synthesis.correlations import Places
    from specklegen.synthesis.imaging import Imaging

PART = "convolution with one pattern a medium"
_PATHS = 6000  # that tell K where the atlas does not


@dataclass(frozen=True)
class Convolution(Stationary, name="convolution"):
    """The convolution sampler of a scene with a hidden object; see :class:`specklegen.samplers.sampler.Sampler`."""

    complete: ClassVar[bool] = True

    @classmethod
    def obstacles(cls, scene: Scene) -> list[str]:
        """Say why it cannot draw a scene, whatever its memory effect."""
        if not scene.hides_object:
            return ["images hidden objects, and has no correlation between beams of a stack"]
        if object_of(scene).brightness.size == 1:
            return ["moves a pattern with every pixel of an object, and this object has one pixel"]
        return ["does not support analysers"] if scene.polarisers is not None else super().obstacles(scene)

    @classmethod
    def propose(cls, scene: Scene, request: Request) -> tuple[Self | None, list[Decision]]:
        """The sampler for a scene where C_I is 1 over the whole object within the tolerance, or which asks for it."""
        asked = request.asked == cls.name
        obstacles = cls.obstacles(scene) or ["has no reversed paths"] * request.reverse
        if obstacles and asked:
            reject("sampler", '"stationary" or "auto" for this scene', cls.name,
                   f"The convolution sampler {obstacles[0]}.")  # fmt: skip
        if obstacles:
            return None, []
        lost, error = scene_loss(scene)
        enough = lost + 2 * error <= request.tolerance
        reason = f"1 - C_I across the object is {lost:.2g} ± {error:.1g} (limit {request.tolerance:g})"
        if not (asked or enough):
            return None, [Decision(PART, False, reason)]
        served, decisions = Stationary.propose(scene, replace(request, asked=Stationary.name) if asked else request)
        if served is None:
            return None, []
        doubt = asked and not enough
        decision = Decision(PART, True, f"asked for; {reason}" if asked else reason, doubt, lost if doubt else 0.0)
        return cls(**{each.name: getattr(served, each.name) for each in fields(served)}), [*decisions, decision]

    def instead(self, said: Sequence[Decision]) -> tuple[Stationary, tuple[Decision, ...]]:
        """The stationary sampler of the same scene, with the modes of the memory effect."""
        decisions = tuple(
            replace(each, needed=False, reason=f"{each.reason}; but other media of the recipe need modes")
            if each.part == PART else each for each in said
        )  # fmt: skip
        return Stationary(**{each.name: getattr(self, each.name) for each in fields(self)}), decisions

    def prepare_media(self, request: MediaRequest) -> "list[tuple[list[int], Imaging]]":
        """Make media ready, whose memory effect is taken as complete; in time it stays what it is."""
        light, film = request.light, request.film
        even = Complete(len(request.correlations))
        if light is not None:
            light = replace(light, modes=tuple(even for _ in light.modes))
        if film is not None:
            film = replace(film, radius=torch.zeros_like(film.radius))
        return super().prepare_media(replace(request, correlations=even, light=light, film=film))


@dataclass(frozen=True)
class Complete:
    """K of media whose memory effect is complete: 1 everywhere; see :mod:`specklegen.synthesis.correlations`.

    Attributes
    ----------
    count : int
        Media.
    """

    count: int
    isotropic: ClassVar[bool] = True

    def __call__(self, q: "torch.Tensor") -> "torch.Tensor":
        """K float64[M, n]."""
        return torch.ones_like(q)

    def planar(self, qx: "torch.Tensor", qy: "torch.Tensor") -> "torch.Tensor":  # noqa: ARG002
        """K float64[M, ...]."""
        return torch.ones_like(qx)

    def at(self, places: "Places") -> "Complete":
        """Return that of some of the media."""
        return Complete(len(range(self.count)[places]) if isinstance(places, slice) else len(places))

    def __len__(self) -> int:
        return self.count


@remembered(64)
def scene_loss(scene: Scene) -> tuple[float, float]:
    """1 - C_I between the farthest corners of a scene's object, and its standard error: tabulated or by pilot."""
    return cached_result(tuple[float, float], ("loss over an object", scene), lambda: _scene_loss(scene))


def _scene_loss(scene: Scene) -> tuple[float, float]:
    """Result of :func:`scene_loss`."""
    from specklegen.memory_effects.correlation import estimate_correlation

    light = object_of(scene)
    far = scene.wavenumber * light.pitch * np.hypot(*(n - 1 for n in light.brightness.shape))
    correlation = atlas_correlation(scene.slab)
    if correlation is None:
        correlation = estimate_correlation(scene.slab, _PATHS, pilot_seed(scene.unitless_fingerprint()), threads=1)
    if not correlation.weights.any():
        return 0.0, 0.0
    _, lost, error = correlation.intensity(np.array([far]))
    return float(lost[0]), float(error[0])
