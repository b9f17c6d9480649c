"""A uniform slab in closed form: Fresnel's coefficients and Airy's sum over the two faces."""

import math
from typing import Annotated

import numpy as np

from specklegen.core.arguments import finite_numbers, real_array, real_number
from specklegen.core.errors import reject
from specklegen.core.quantities import with_units
from specklegen.core.units import INVERSE_LENGTH, LENGTH


@with_units
def slab_fresnel(
    n_slab: float, n_background: float, thickness: Annotated[float, LENGTH], wavenumber: Annotated[np.ndarray
, INVERSE_LENGTH]) -> tuple[np.ndarray, np.ndarray]:
    """Reflection and transmission of a uniform slab at normal incidence.

    Time goes as exp(+i omega t), as in the rest of this package: a wave to the right is exp(-i k x).

    Parameters
    ----------
    n_slab, n_background : float
        Indices inside and on both sides.
    thickness : float
        Of the slab, in the unit of length whose inverse the wave numbers have.
    wavenumber : float64[F]
        Vacuum wave numbers k0 = 2 pi/lambda0.

    Returns
    -------
    reflected, transmitted : complex128[F]
        At the entrance face, and at the exit face over the wave that would be there without the slab.

    Examples
    --------
    >>> import numpy as np
    >>> from specklegen.fdtd import slab_fresnel
    >>> reflected, transmitted = slab_fresnel(1.5, 1.0, thickness=1.0, wavenumber=np.array([1.0, 10.0]))
    >>> (abs(reflected) ** 2 + abs(transmitted) ** 2).round(12)  # nothing is absorbed
    array([1., 1.])
    """
    for name, value in {"n_slab": n_slab, "n_background": n_background, "thickness": thickness}.items():
        number = real_number(f"slab_fresnel {name}", value)
        if not (math.isfinite(number) and (number > 0 or name == "thickness" and number == 0)):
            reject(f"slab_fresnel {name}", "finite and " + ("at least 0" if name == "thickness" else "above 0"), value)
    k0 = finite_numbers("slab_fresnel wavenumber", real_array("slab_fresnel wavenumber", wavenumber))
    face = (n_background - n_slab) / (n_background + n_slab)
    once = np.exp(-1j * k0 * n_slab * thickness)
    airy = 1 - face**2 * once**2
    without = np.exp(-1j * k0 * n_background * thickness)
    return face * (1 - once**2) / airy, (1 - face**2) * once / airy / without
