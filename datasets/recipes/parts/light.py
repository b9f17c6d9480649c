"""The light of a recipe: how many independent speckle patterns add up in one image.

Light of one wavelength and one polarisation makes speckle of contrast 1. A band of wavelengths makes an
incoherent sum over the modes of the light behind that medium (:mod:`specklegen.synthesis.spectrum`);
light that the medium depolarised one over two independent halves, contrast 1/sqrt(2).
"""

from dataclasses import dataclass
from typing import Any

from specklegen.core.values import NonNegative, Positive, Value
from specklegen.datasets.split import Purpose
from specklegen.synthesis.spectrum import Spectrum


class Light(Value):
    """The light.

    Parameters
    ----------
    bandwidth
        Full width at half maximum of the spectrum in vacuum wavelength, in the recipe's unit of length
        (1 nm is 0.001 where that is the micrometre); 0 is one wavelength.
    spectrum
        "gaussian" or "flat" over the wavenumber.
    polarised
        Whether one polarisation reaches the camera; false adds two independent halves.
    refractive_index
        Of the layer, which turns vacuum wavelengths into wavenumbers inside it.
    """

    bandwidth: NonNegative = 0.0
    spectrum: Spectrum = "gaussian"
    polarised: bool = True
    refractive_index: Positive = 1.0

    @property
    def halves(self) -> int:
        """Independent polarisations."""
        return 1 if self.polarised else 2


MEDIUM_PURPOSES = (Purpose.MEDIUM, Purpose.POLARISATION)
"""Substreams of a medium's fields, one for each polarisation."""


@dataclass(frozen=True)
class Lit:
    """What samples shine through their media.

    Attributes
    ----------
    light : real[B, h, w] or complex128[B, h, w]
        Brightness of objects; or amplitudes of beams that interfere.
    step : float or None
        Transverse wave number between neighbouring beams, where they interfere.
    parameters : dict of float64[B]
        What is stored of it.
    arrays : dict of tensors
        Arrays of the samples that show it, by name.
    """

    light: Any
    step: float | None
    parameters: dict[str, Any]
    arrays: dict[str, Any]

    def at(self, places: Any) -> "Lit":
        """That of some of the samples, to be rendered."""
        return Lit(self.light[places], self.step, {}, {})
