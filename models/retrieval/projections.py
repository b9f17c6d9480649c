"""Constraints of phase retrieval as projections: the modulus and the support of an image.

Images go in pairs, float32[B, P, n, n, 2]: two restarts are the real and the imaginary part of one image, and one
complex transform serves both, in less than half of the time of two real ones there and back. Moduli are float32[B, 1,
n, n/2 + 1], of the real FFT. What is done to every pixel in every iteration is a kernel on the CPU and array
arithmetic elsewhere; the two differ by rounding.
"""

import numpy as np
import torch
from torch import Tensor

from specklegen.kernels import projections as kernels

_SPACE = (-3, -2)  # rows and columns of pairs


def paired(images: Tensor) -> Tensor:
    """Images real[..., R, n, n] as pairs; the last of an odd number is its own partner."""
    if images.shape[-3] % 2:
        images = torch.cat([images, images[..., -1:, :, :]], dim=-3)
    return images.unflatten(-3, (-1, 2)).movedim(-3, -1).contiguous()


def unpaired(pairs: Tensor, count: int) -> Tensor:
    """The first ``count`` images of pairs, real[..., count, n, n]."""
    return pairs.movedim(-1, -3).flatten(-4, -3)[..., :count, :, :]


def with_modulus(pairs: Tensor, modulus: Tensor) -> Tensor:
    """Images with the phases of those given and the modulus wanted."""
    if pairs.device.type != "cpu":
        return _with_modulus_by_arrays(pairs, modulus)
    spectrum = torch.fft.fft2(torch.view_as_complex(pairs))
    flat = spectrum.view(-1, *spectrum.shape[-2:]), modulus.reshape(-1, *modulus.shape[-2:])
    kernels.replace_moduli(*(x.numpy() for x in flat))
    return torch.view_as_real(torch.fft.ifft2(spectrum))


def _with_modulus_by_arrays(pairs: Tensor, modulus: Tensor) -> Tensor:
    spectrum = torch.fft.rfft2(pairs, dim=_SPACE).sgn_().mul_(modulus[..., None])
    return torch.fft.irfft2(spectrum, s=pairs.shape[-3:-1], dim=_SPACE).contiguous()


def fed_back(image: Tensor, proposed: Tensor, allowed: Tensor, beta: float) -> Tensor:
    """Return the proposal where it is positive and allowed; elsewhere image - beta * proposed. Works in place."""
    if image.device.type == "cpu":
        flat = [x.view(-1).numpy() for x in (image, proposed, allowed)]
        kernels.feed_back(*flat, flat[0].dtype.type(beta))
        return image
    kept = proposed.sign().clamp_min_(0).mul_(allowed)
    return image.sub_(proposed, alpha=beta).lerp_(proposed, kept)


def shrunk(pairs: Tensor, sigma: float, share: float) -> Tensor:
    """Supports, 1 or 0: where an image, blurred over ``sigma`` pixels, exceeds ``share`` of its maximum."""
    n = pairs.shape[-2]
    one = torch.exp(-2 * (np.pi * sigma * torch.fft.fftfreq(n, device=pairs.device)) ** 2).to(pairs)
    spectrum = torch.fft.fft2(torch.view_as_complex(pairs.clamp_min(0))).mul_(one[:, None] * one)
    blurred = torch.view_as_real(torch.fft.ifft2(spectrum))
    largest = blurred.amax(-3, keepdim=True).amax(-2, keepdim=True)  # row by row, ten times faster than at once
    return blurred.sub_(share * largest).sign_().clamp_min_(0)


def error_reduction(pairs: Tensor, modulus: Tensor, steps: int, support: Tensor | float = 1.0) -> Tensor:
    """Alternate between the modulus and images that are not negative, on the support."""
    for _ in range(steps):
        pairs = with_modulus(pairs, modulus).clamp_min_(0).mul_(support)
    return pairs


def modulus_error(image: Tensor, modulus: Tensor) -> Tensor:
    """Squared error of the modulus of images float32[B, R, n, n] over the power of that wanted, float32[B, R]."""
    error = (torch.fft.rfft2(image).abs() - modulus).square().sum((-2, -1))
    return error / modulus.square().sum((-2, -1))
