"""Partially coherent light in batches: the mutually incoherent beams of Gaussian Schell-model sources, on any device.

What :mod:`specklegen.coherence.partially_coherent` says of one source.
"""

from dataclasses import dataclass

import torch

from specklegen.coherence.partially_coherent import COHERENT, REACH, shared_speckle
from specklegen.scene.window import Profile
from specklegen.synthesis.fused import fused


@dataclass(frozen=True)
class Source:
    """A lattice of beams.

    Attributes
    ----------
    sines : float64[n]
        Of its beams along either axis.
    shared : float64[2n - 1, 2n - 1]
        W^(s)^2 of two beams by their difference, 0 first.
    """

    sines: torch.Tensor
    shared: torch.Tensor
    wavelength: float
    width: float

    def beams(self, length: torch.Tensor) -> torch.Tensor:
        """Brightness float64[B, n, n] of beams at coherence lengths float64[B], sum 1: ``gaussian_brightness``."""
        length = length.clamp(max=COHERENT * self.width)
        spread = self.wavelength / (2 * torch.pi * length)
        # One by one on the CPU, where sums over several have other last bits.
        parts = spread.split(1) if spread.device.type == "cpu" else [spread]
        return torch.cat([gaussian_beams(self.sines, part) for part in parts])

    def effective_modes(self, brightness: torch.Tensor) -> torch.Tensor:
        """N_eff float64[B] of beams float64[B, n, n]: ``effective_source_modes``."""
        parts = brightness.split(1) if brightness.device.type == "cpu" else [brightness]
        return torch.cat([self._effective(part) for part in parts])

    def _effective(self, brightness: torch.Tensor) -> torch.Tensor:
        grid = self.shared.shape
        pairs = torch.fft.irfft2(torch.fft.rfft2(brightness, grid).abs().square(), grid)
        return brightness.sum((1, 2)).square() / (pairs.clamp(min=0) * self.shared).sum((1, 2))


def source_of(
    count: int, pitch: float, wavelength: float, width: float, profile: Profile, device: torch.device
) -> Source:
    """Bring a lattice of so many beams along each axis to a device."""
    shared = torch.from_numpy(shared_speckle((count, count), pitch, wavelength, width, profile))
    place = torch.arange(count, dtype=torch.float64) - (count - 1) / 2
    return Source((place * pitch).to(device), torch.fft.ifftshift(shared).to(device), wavelength, width)


@fused(
    "gaussian_beams(Tensor sines, Tensor spread) -> Tensor",
    lambda sines, spread: sines.new_empty((len(spread), len(sines), len(sines))),
    kernels=2,
)
def gaussian_beams(sines: torch.Tensor, spread: torch.Tensor) -> torch.Tensor:
    """Gaussians float64[B, n, n] of spreads float64[B] over a lattice of sines float64[n], cut off, of sum 1."""
    along = (sines / spread[:, None]).square()
    square = along[:, :, None] + along[:, None]
    beams = torch.where(square <= REACH**2, torch.exp(-square / 2), 0.0)
    return beams / beams.sum((1, 2), keepdim=True)
