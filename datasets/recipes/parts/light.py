"""The light of a recipe: how many independent speckle patterns add up in one image.

Light of one wavelength and one polarisation makes speckle of contrast 1. A band of wavelengths makes an
incoherent sum over the modes of the light behind that medium (:mod:`specklegen.synthesis.spectrum`);
light that the medium depolarised one over two independent halves, contrast 1/sqrt(2).
"""

from dataclasses import dataclass
from typing import Annotated, Any, Literal, Self

import numpy as np
from pydantic import Field, model_validator

from specklegen.core.errors import reject
from specklegen.core.units import LENGTH, RADIAN
from specklegen.core.values import NonNegative, Positive, Value
from specklegen.datasets.split import Purpose
from specklegen.scene.polarisation import Polarisation
from specklegen.synthesis.spectrum import Spectrum

Analyser = Literal["none", "parallel", "crossed", "circular", "flipped"] | Annotated[
    float, Field(ge=-np.pi, le=np.pi), RADIAN
]
"""Before the camera: none; along linear light, across it; for circular light that of its own helicity, or of the
other; or at an angle (radians) from linear light."""


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
    polarisation
        What the particles do to polarised light, as of a :class:`specklegen.Slab`: of kind "analysed-object" alone.
    analyser
        There, what stands before the camera, "none", "parallel", "crossed", "circular", "flipped" or an angle from
        linear light; or a list of those at right angles to each other, which see one medium.
    """

    bandwidth: Annotated[NonNegative, LENGTH] = 0.0
    spectrum: Spectrum = "gaussian"
    polarised: bool = True
    refractive_index: Positive = 1.0
    polarisation: Polarisation = "scalar"
    analyser: Analyser | tuple[Analyser, ...] = "none"

    @model_validator(mode="after")
    def _check(self) -> Self:
        if not self.analysers:
            reject("Light.analyser", "at least one", self.analyser)
        if self.polarisation == "scalar" and self.analyser != "none":
            reject("Light.analyser", "left out for scalar light", self.analyser,
                   'Give polarisation = "projector" in a recipe of kind "analysed-object".')  # fmt: skip
        return self

    @property
    def analysers(self) -> tuple[Analyser, ...]:
        """All of them."""
        return self.analyser if isinstance(self.analyser, tuple) else (self.analyser,)

    @property
    def halves(self) -> int:
        """Independent polarisations."""
        return 1 if self.polarised else 2


MEDIUM_PURPOSES = (Purpose.MEDIUM, Purpose.POLARISATION)
"""Substreams of a medium's fields, one for each polarisation."""


@dataclass(frozen=True)
class Lit:
    """Light of samples.

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
    exit_radius : float64[B] or None
        Of a round aperture about the axis on the exit face, for beams that interfere.
    """

    light: Any
    step: float | None
    parameters: dict[str, Any]
    arrays: dict[str, Any]
    exit_radius: Any = None

    def at(self, places: Any) -> "Lit":
        """Return the light of some of the samples, to be rendered."""
        radius = None if self.exit_radius is None else self.exit_radius[places]
        return Lit(self.light[places], self.step, {}, {}, radius)
