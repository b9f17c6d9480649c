"""What phase retrieval knows of an image, each as the projection that puts it right: its modulus, its support.

Images are float32[..., n, n], moduli float32[..., n, n/2 + 1] of their real FFT.
"""

import numpy as np
import torch
from torch import Tensor


def with_modulus(image: Tensor, modulus: Tensor) -> Tensor:
    """Image with the phases of ``image`` and the modulus wanted."""
    return torch.fft.irfft2(torch.fft.rfft2(image).sgn_().mul_(modulus), s=image.shape[-2:])


def shrunk(image: Tensor, sigma: float, share: float) -> Tensor:
    """Support, 1 or 0: where the image, blurred over ``sigma`` pixels, exceeds ``share`` of its maximum."""
    n = image.shape[-1]
    one = torch.exp(-2 * (np.pi * sigma * torch.fft.fftfreq(n, device=image.device)) ** 2).to(image)
    spectrum = torch.fft.rfft2(image.clamp_min(0)) * (one[:, None] * one[: n // 2 + 1])
    blurred = torch.fft.irfft2(spectrum, s=image.shape[-2:])
    return (blurred > share * blurred.amax((-2, -1), keepdim=True)).to(image)


def error_reduction(image: Tensor, modulus: Tensor, steps: int, support: Tensor | float = 1.0) -> Tensor:
    """Alternate between the modulus and images that are not negative, on the support."""
    for _ in range(steps):
        image = with_modulus(image, modulus).clamp_min_(0).mul_(support)
    return image


def modulus_error(image: Tensor, modulus: Tensor) -> Tensor:
    """Squared error of the modulus over the power of that wanted, float32[...]."""
    error = (torch.fft.rfft2(image).abs() - modulus).square().sum((-2, -1))
    return error / modulus.square().sum((-2, -1))
