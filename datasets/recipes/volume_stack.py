"""Recipe kind "volume-stack": the speckle of a volume under several tilts, seen from afar or from near by."""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from specklegen.core.parallel import one_blas_thread
from specklegen.core.random_streams import Seed
from specklegen.datasets.recipes.medium_realization import planned_sums
from specklegen.datasets.recipes.tilt_stack import TiltStack
from specklegen.datasets.recipes.volume_recipe import Beams, VolumeRecipe, VolumeView
from specklegen.datasets.split import Purpose, Split, generator, substream
from specklegen.scene.scene import Scene


@dataclass(frozen=True)
class VolumeFields:
    """The fields of path sums under every tilt; see :class:`~specklegen.datasets.recipes.medium_realization.Fields`.

    Attributes
    ----------
    scene : Scene
    paths : int
    unit : float
        Expected intensity, in which intensities are given.
    seeds : tuple of seeds
        Of each polarisation.
    """

    scene: Scene
    paths: int
    unit: float
    seeds: tuple[Seed, ...]

    mean = 1.0

    def intensities(self, brightness: np.ndarray) -> np.ndarray:
        """Images float32[T, H, W], mean over the polarisations; ``brightness`` float32[1, 1] is the beam's."""
        sums, found = planned_sums(self.scene, self.paths).chosen, 0.0
        with one_blas_thread():
            for seed in self.seeds:
                (drawn_once,) = sums.prepare(seed, 1).images(1)
                found = found + np.square(drawn_once.image.real) + np.square(drawn_once.image.imag)
        return np.asarray(found * (float(brightness.sum()) / (len(self.seeds) * self.unit)), np.float32)

    def superposed(self, amplitudes: np.ndarray, step: float) -> tuple[np.ndarray, float]:  # noqa: ARG002
        """Of the one beam complex[1, 1], under the first tilt."""
        brightness = np.square(np.abs(amplitudes))
        return self.intensities(brightness)[0], float(brightness.sum())


class DevelopedSpeckle:
    """The contrast of one beam behind a medium that scrambles it: 1."""

    def contrast(self, brightness: np.ndarray) -> float:  # noqa: ARG002
        """Of one beam, whatever its brightness."""
        return 1.0


class VolumeStack(VolumeRecipe, TiltStack):
    """Stacks of speckle images of a box, homogeneous or of voxels, or of a slab seen from near by, one image a tilt.

    Samples: ``stack`` float32[T, H, W], intensity over its expected mean over tilts and pixels, ``tilts`` float64[T, 2]
    in radians. ``material.kernel_paths`` paths render each stack.
    """

    kind: Literal["volume-stack"] = "volume-stack"  # type: ignore[assignment]

    def beams(self, seed: int, split: Split, medium: int) -> Beams:
        """One a tilt."""
        return _tilted(*self.tilts.drawn(generator(substream(seed, split, Purpose.TILTS, medium))))

    def widest_beams(self) -> Beams:
        """Of the widest tilts."""
        return _tilted(self.tilts.widest, {})

    def speckle(
        self, view: VolumeView, unit: float, seeds: tuple[Seed, ...]
    ) -> tuple[VolumeFields, DevelopedSpeckle]:
        """Summed anew for every stack."""
        return VolumeFields(view.full, self.material.kernel_paths, unit, seeds), DevelopedSpeckle()


def _tilted(angles: np.ndarray, told: dict[str, float]) -> Beams:
    return Beams(np.sin(angles), np.arange(len(angles)), angles, told)
