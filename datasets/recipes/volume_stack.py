"""Recipe kind "volume-stack": the speckle of a volume under several tilts, seen from afar or from near by."""

from typing import Literal

import numpy as np

from specklegen.core.lazy import torch
from specklegen.datasets.distributions import drawn
from specklegen.datasets.recipes.tilt_stack import TiltStack
from specklegen.datasets.recipes.volume_recipe import Beams, VolumeRecipe, VolumeView
from specklegen.datasets.split import Purpose, Split, generator, substream


class DevelopedSpeckle:
    """The contrast of one beam behind a medium that scrambles it: 1."""

    def contrast(self, light: "torch.Tensor") -> "torch.Tensor":
        """Contrast of beams real[B, 1, 1], whatever their brightness."""
        return torch.ones(len(light), dtype=torch.float64, device=light.device)


class VolumeStack(VolumeRecipe, TiltStack):
    """Stacks of speckle images of a box, homogeneous or of voxels, or of a slab seen from near by, one image a tilt.

    Samples: ``stack`` float32[T, H, W], intensity over its expected mean over tilts and pixels, ``tilts`` float64[T, 2]
    in radians. ``material.kernel_paths`` paths render each stack.
    """

    kind: Literal["volume-stack"] = "volume-stack"  # type: ignore[assignment]

    def beams(self, seed: int, split: Split, medium: int) -> Beams:
        """One a tilt."""
        rng = generator(substream(seed, split, Purpose.TILTS, medium))
        step, azimuth = drawn(self.tilts.step, rng), drawn(self.tilts.azimuth, rng)
        return _tilted(self.tilts.angles(step, azimuth), {"tilt_step": step, "tilt_azimuth": azimuth})

    def widest_beams(self) -> Beams:
        """Beams of the widest tilts."""
        return _tilted(self.tilts.widest, {})

    @property
    def object_shape(self) -> tuple[int, int]:
        """One beam."""
        return 1, 1

    def contrast_of(self, view: VolumeView) -> DevelopedSpeckle:  # noqa: ARG002
        """Contrast of developed speckle."""
        return DevelopedSpeckle()


def _tilted(angles: np.ndarray, told: dict[str, float]) -> Beams:
    return Beams(np.sin(angles), np.arange(len(angles)), angles, told)
