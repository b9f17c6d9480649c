"""Images of beams that interfere, through the media of an object sampler.

A hidden object's pixels add up as intensities, the waves of one illumination as fields: beams i_j of amplitudes
a_j make

    u(v) = sum_x e^(-ik v . x) sum_r G_r(x) L_r(x),   L_r(x) = sum_j a_j phi_r(j) e^(ik i_j . x),

L_r being the light on the window as far as the r-th mode of the memory effect carries it. Over media the intensity has
the mean sum_x b(x)^2 sum_r |L_r(x)|^2, the same at every view.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from specklegen.core.errors import reject
from specklegen.core.lazy import LazyModule
from specklegen.core.parallel import one_torch_thread
from specklegen.samplers.stationary.objects import ObjectSampler

if TYPE_CHECKING:
    import torch
else:
    torch = LazyModule("torch")


def superposed_image(
    sampler: ObjectSampler, medium: torch.Tensor, amplitudes: np.ndarray, step: float
) -> tuple[torch.Tensor, float]:
    """Return the image of interfering beams under the first base tilt, real[H, W], and its mean over media.

    Parameters
    ----------
    sampler
        Of the lattice of beams.
    medium
        From `ObjectSampler.medium`.
    amplitudes : complex[h, w]
        Of the beams from the smallest sines y and x; their phases are 0 in the middle of the window.
    step
        Transverse wave number between neighbouring beams, radians per unit length.

    Raises
    ------
    RuleError
        If there is not one amplitude a beam.
    """
    if np.shape(amplitudes) != sampler.shape:
        reject("superposed_image amplitudes", f"of shape {sampler.shape}, one a beam", np.shape(amplitudes))
    # Waves are counted from the first cell there, from the middle of the window here.
    rows, columns = ((np.arange(n) - (n - 1) / 2) * step for n in sampler.shape)
    phase = np.multiply.outer(np.exp(1j * rows * sampler.y.positions[0]), np.exp(1j * columns * sampler.x.positions[0]))
    # The sampler's first beam is that of the largest sines: images of objects are turned.
    waves = torch.as_tensor((amplitudes * phase)[::-1, ::-1].copy()).to(sampler.object_rows)
    with one_torch_thread():
        light = sampler.modes[0].reshape(-1, *sampler.shape) * waves
        light = sampler.object_rows[: sampler.y.count] @ light @ sampler.object_columns[: sampler.x.count].T
        views = torch.fft.ifft2((medium * light).sum(1), s=sampler.lags, norm="forward")
        spectrum = torch.fft.rfft2(torch.view_as_real(views).square_().sum(-1).sum(0), norm="forward")
        image = ((sampler.camera_rows[0] @ spectrum) @ sampler.camera_columns[0]).real.contiguous()
        power = torch.view_as_real(light).square().sum(-1).sum(0) * sampler.envelope.square()
        flat = sampler.flat * sampler.mean * float(torch.view_as_real(waves).square().sum())
    return image + flat, float(power.sum(dtype=torch.float64)) + flat
