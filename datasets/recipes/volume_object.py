"""Recipe kind "volume-object": an incoherent object seen through a box, through voxels, or by a camera near a slab."""

from dataclasses import dataclass
from typing import ClassVar, Literal, Self

import numpy as np
from pydantic import model_validator

from specklegen.core.errors import reject
from specklegen.core.lazy import torch
from specklegen.core.values import remembered
from specklegen.datasets.distributions import drawn, ends
from specklegen.datasets.recipes.hidden_object import HiddenObject
from specklegen.datasets.recipes.media import planned_whole
from specklegen.datasets.recipes.volume_recipe import Beams, VolumeRecipe, VolumeView
from specklegen.datasets.split import Purpose, Split, generator, substream
from specklegen.paths.bank import PathBank
from specklegen.paths.endpoint_factors import multiple_amplitudes, single_amplitudes
from specklegen.samplers.path_sums.sampler import PathSums
from specklegen.scene.illumination import object_sines
from specklegen.scene.scene import Scene

_JUDGED = 4  # beams along a side of the object that stand for all of them
_AMPLITUDES = 2**22  # of beams and connections, from which a contrast is found


@dataclass(frozen=True)
class EstimatedContrast:
    """The contrast of images of incoherent objects, from the pilot's paths.

    ``contrast^2 = sum_ij b_i b_j |C_ij|^2 / (sum_i b_i C_ii)^2`` with C the covariance of the beams' fields at the
    camera's middle [Bar19, Eq. 14]. |C_ij|^2 is the product of two estimates from different paths, so that it has no
    bias.

    Attributes
    ----------
    squares : float32[n, n]
        |C_ij|^2 of the beams.
    powers : float64[2, n]
        C_ii of each estimate.
    """

    squares: np.ndarray
    powers: np.ndarray

    def contrast(self, light: "torch.Tensor") -> "torch.Tensor":
        """Expected contrast float64[B] of images of objects real[B, h, w]."""
        rows = np.asarray(light.cpu().numpy(), np.float64).reshape(len(light), -1)
        contrasts = [np.sqrt(max(own @ (self.squares @ own), 0.0) / np.prod(self.powers @ own)) for own in rows]
        return torch.tensor(np.array(contrasts), device=light.device)


class VolumeObject(VolumeRecipe, HiddenObject):
    """Camera images of incoherent objects hidden behind volumes; mean 1 over the expected intensity.

    Samples: as of "hidden-object". ``material.kernel_paths`` paths render each medium; all beams of the object share
    them. ``expected_contrast`` is an estimate from the pilot's paths.
    """

    kind: Literal["volume-object"] = "volume-object"  # type: ignore[assignment]
    on_benches: ClassVar[bool] = False
    looked_up: ClassVar[bool] = False

    @model_validator(mode="after")
    def _check_pitch(self) -> Self:
        if self.field is None or self.field.pitch is None or self.field.pixels is not None:
            reject("ObjectField", "given by pitch alone where the kind is volume-object", self.field,
                   "Volumes have no memory-effect range in closed form: give the direction sine "
                   "between pixels.")  # fmt: skip
        return self

    def beams(self, seed: int, split: Split, medium: int) -> Beams:
        """One a pixel of the object."""
        return self._object_beams(drawn(self._field_number, generator(substream(seed, split, Purpose.FIELD, medium))))

    def widest_beams(self) -> Beams:
        """Beams of the largest object."""
        return self._object_beams(ends(self._field_number)[1])

    def _object_beams(self, pitch: float) -> Beams:
        rows, columns = (np.unique(np.linspace(0, n - 1, _JUDGED).round().astype(int)) for n in self.objects.shape)
        judged = (rows[:, None] * self.objects.shape[1] + columns).ravel()
        sines = object_sines("object", self.objects.shape, pitch)
        return Beams(sines, judged, np.zeros((1, 2)), {"object_pitch": pitch})

    @property
    def object_shape(self) -> tuple[int, int]:
        """Pixels of the object."""
        return self.objects.shape

    def contrast_of(self, view: VolumeView) -> EstimatedContrast:
        """Contrast from the pilot's paths."""
        return estimated_contrast(view.full, self.material.kernel_paths)


@remembered(16)
def estimated_contrast(scene: Scene, paths: int) -> EstimatedContrast:
    """Contrast of objects made of a scene's beams, at the middle of its camera."""
    plan = planned_whole(scene, paths, PathSums)
    pilot, (rows, columns) = plan.chosen.pilot, scene.sensor.shape
    layout = pilot.tracer.layout.of_ends(slice(None), np.array([rows // 2 * columns + columns // 2]))
    most = max(_AMPLITUDES // len(scene.lights), 64)

    def covariance(half: PathBank) -> np.ndarray:
        once, more = half.single, half.multiple
        bidirectional = pilot.tracer.bidirectional
        often = multiple_amplitudes(layout, more, bidirectional=bidirectional, reverse=plan.reverse)
        fields = np.concatenate([single_amplitudes(layout, once), often], axis=1)
        return fields @ fields.conj().T

    some = pilot.bank.select(slice(0, most))
    one, other = (covariance(some.select(some.paths % 2 == n)) for n in (0, 1))
    powers = np.stack([np.diagonal(one).real, np.diagonal(other).real])
    return EstimatedContrast(np.real(one * other.conj()).astype(np.float32), powers)
