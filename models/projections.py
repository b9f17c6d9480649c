"""What phase retrieval knows of an image, each as the projection that puts it right: its modulus, its support.

Images are float32[B, R, n, n], moduli float32[B, 1, n, n/2 + 1] of their real FFT. What is done to every pixel in
every iteration is a kernel on the CPU and array arithmetic elsewhere; the two differ by rounding.
"""

import numpy as np
import torch
from torch import Tensor

from specklegen.kernels import projections as kernels


def with_modulus(image: Tensor, modulus: Tensor) -> Tensor:
    """Image with the phases of ``image`` and the modulus wanted."""
    spectrum = torch.fft.rfft2(image)
    if spectrum.device.type == "cpu":
        size = modulus.shape[-2] * modulus.shape[-1]
        parts = torch.view_as_real(spectrum).view(-1, size, 2)
        kernels.replace_modulus(parts.numpy(), modulus.reshape(-1, size).numpy())
    else:
        spectrum.sgn_().mul_(modulus)
    return torch.fft.irfft2(spectrum, s=image.shape[-2:])


def fed_back(image: Tensor, proposed: Tensor, allowed: Tensor, beta: float) -> Tensor:
    """What is proposed where it is positive and allowed; elsewhere image - beta * proposed. Takes the image's place."""
    if image.device.type == "cpu":
        flat = [x.view(-1).numpy() for x in (image, proposed, allowed)]
        kernels.feed_back(*flat, flat[0].dtype.type(beta))
        return image
    kept = proposed.sign().clamp_min_(0).mul_(allowed)
    return image.sub_(proposed, alpha=beta).lerp_(proposed, kept)


def shrunk(image: Tensor, sigma: float, share: float) -> Tensor:
    """Support, 1 or 0: where the image, blurred over ``sigma`` pixels, exceeds ``share`` of its maximum."""
    n = image.shape[-1]
    one = torch.exp(-2 * (np.pi * sigma * torch.fft.fftfreq(n, device=image.device)) ** 2).to(image)
    spectrum = torch.fft.rfft2(image.clamp_min(0))
    torch.view_as_real(spectrum).mul_((one[:, None] * one[: n // 2 + 1])[..., None])  # real times real
    blurred = torch.fft.irfft2(spectrum, s=image.shape[-2:])
    return blurred.sub_(share * blurred.amax((-2, -1), keepdim=True)).sign_().clamp_min_(0)


def error_reduction(image: Tensor, modulus: Tensor, steps: int, support: Tensor | float = 1.0) -> Tensor:
    """Alternate between the modulus and images that are not negative, on the support."""
    for _ in range(steps):
        image = with_modulus(image, modulus).clamp_min_(0).mul_(support)
    return image


def modulus_error(image: Tensor, modulus: Tensor) -> Tensor:
    """Squared error of the modulus over the power of that wanted, float32[...]."""
    error = (torch.fft.rfft2(image).abs() - modulus).square().sum((-2, -1))
    return error / modulus.square().sum((-2, -1))
