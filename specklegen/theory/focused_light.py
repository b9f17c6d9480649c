"""Focused light in closed form: Gaussian beams that are not paraxial, and what a first scatterer makes of them.

Plane waves of amplitude e^(kappa (i . i0 - 1)) about the direction i0, in phase at the point p, add up to

    U(x) = kappa / (1 - e^(-2 kappa)) (e^(c - kappa) - e^(-c - kappa)) / c,    c = sqrt(c . c), Re c >= 0
    c = kappa i0 + ik (x - p)

an exact solution of Helmholtz' equation of value 1 at p, waist w0 = sqrt(2 kappa) / k and Rayleigh length kappa / k. A
particle at x whose amplitude is that of a von Mises-Fisher phase function, e^(m (i . w - 1)), sends along w the same
integral with m w added to c. Bar, Alterman, Gkioulekas, Levin, *Rendering Near-Field Speckle Statistics in Scattering
Media*, ACM Trans. Graph. 39(6), 187 (2020).
"""

from typing import Annotated

import numpy as np

from specklegen.core.arguments import positive_number, real_array
from specklegen.core.errors import reject
from specklegen.core.quantities import with_units
from specklegen.core.units import LENGTH, WAVELENGTH

_AXIS = np.array([0.0, 0.0, 1.0])


@with_units
def gaussian_focus(
    places: Annotated[np.ndarray, LENGTH], focus: Annotated[np.ndarray, LENGTH], waist: Annotated[float, LENGTH],
    wavelength: Annotated[float, WAVELENGTH], *, direction: np.ndarray | None = None, sharpness: float = 0.0,
) -> np.ndarray:  # fmt: skip
    """Field complex128[P] of a Gaussian beam of unit power along z at places float64[P, 3], over e^(ik (z - p_z)).

    Parameters
    ----------
    places, focus
        Lengths; the focus float64[3].
    waist
        1/e^2 radius of the intensity in focus, in the paraxial approximation; at least half a wavelength.
    wavelength
        Inside the medium.
    direction, sharpness
        Unit vectors float64[P, 3] w, and m: instead, what particles of amplitude e^(m (i . w - 1)) at the places send
        along w.

    Examples
    --------
    >>> import numpy as np
    >>> from specklegen.theory.focused_light import gaussian_focus
    >>> beam = gaussian_focus([[0, 0, 0], [0, 0, np.pi * 25.0]], [0, 0, 0], waist=5.0, wavelength=1.0)
    >>> np.round(abs(beam[1] / beam[0]), 3)  # a Rayleigh length on
    np.float64(0.707)
    """
    places, focus = real_array("gaussian_focus places", places), real_array("gaussian_focus focus", focus)
    waist, wavelength = positive_number("waist", waist), positive_number("wavelength", wavelength)
    if places.ndim != 2 or places.shape[1] != 3 or focus.shape != (3,):
        reject("gaussian_focus places", "of shape (P, 3), and focus of shape (3,)", (places.shape, focus.shape))
    if waist < wavelength / 2:
        reject("gaussian_focus waist", f"at least half a wavelength, {wavelength / 2:g}", waist,
               "Tighter beams have backward waves.")  # fmt: skip
    if not sharpness >= 0 or (sharpness > 0 and direction is None):
        reject("gaussian_focus sharpness", "at least 0, and 0 without a direction", sharpness)
    k = 2 * np.pi / wavelength
    kappa = (k * waist) ** 2 / 2
    vector = kappa * _AXIS + 1j * k * (places - focus)
    if sharpness and direction is not None:
        vector = vector + sharpness * real_array("gaussian_focus direction", direction)
    c = np.sqrt((vector * vector).sum(axis=-1))  # of Re c >= 0
    whole = kappa + sharpness
    scale = np.sqrt(4 * np.pi * np.tanh(kappa) / kappa) / wavelength  # of the root of the power through any plane
    sums = (np.exp(c - whole) - np.exp(-c - whole)) / c
    return scale * kappa / -np.expm1(-2 * kappa) * sums * np.exp(-1j * k * (places[:, 2] - focus[2]))
