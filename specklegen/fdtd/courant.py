"""The largest stable time step of the Yee scheme in a random medium.

S = c_b dt/dx is the Courant number of the *background*. The explicit scheme in the medium is stable for

    S < 2 / sqrt(lambda_max(D^{-1/2} L D^{-1/2})),   D = diag(1 + kappa),  L = tridiag(-1, 2, -1),

of which S <= min(n)/n_b (the local Courant number nowhere above 1) is a sufficient bound. A zero-mean index
fluctuation therefore always forbids S = 1. The single-realization march has background coefficients only,
so S = 1 is legal for it; compared with brute force, both must share the smaller S.
"""

from typing import Literal

import numpy as np
from scipy.linalg import eigh_tridiagonal

from specklegen.core.errors import reject

_PAD = 8  # background cells on either side: the mode of the largest eigenvalue may leak out of the layer


def courant_limit(kappa: np.ndarray, method: Literal["bound", "eigen"] = "bound") -> float:
    """Return the largest background Courant number that is stable for every medium in ``kappa``.

    Parameters
    ----------
    kappa : float64[N] or float64[R, N]
        (n/n_b)^2 - 1 at the cells.
    method : {"bound", "eigen"}
        "bound" is min(n)/n_b, sufficient and O(N); "eigen" the exact limit, one eigenvalue a medium.

    Examples
    --------
    >>> import numpy as np
    >>> from specklegen.fdtd import courant_limit
    >>> round(courant_limit(np.array([0.0, 0.2, -0.1])), 3)
    0.949
    """
    kappa = np.atleast_2d(check_kappa(kappa))
    if method == "bound":
        return min(1.0, float(np.sqrt(1 + kappa.min())))
    if method == "eigen":
        return min(1.0, min(_eigen_limit(row) for row in kappa))
    reject("courant_limit.method", "one of 'bound', 'eigen'", method)


def _eigen_limit(kappa: np.ndarray) -> float:
    permittivity = np.pad(1 + kappa, _PAD, constant_values=1.0)
    last = permittivity.size - 1
    largest = eigh_tridiagonal(2 / permittivity, -1 / np.sqrt(permittivity[1:] * permittivity[:-1]), eigvals_only=True,
                               select="i", select_range=(last, last))  # fmt: skip
    return float(2 / np.sqrt(largest[0]))


def check_kappa(kappa: np.ndarray) -> np.ndarray:
    """Return ``kappa`` as contiguous float64, refusing permittivities that are not positive and finite."""
    kappa = np.ascontiguousarray(kappa, dtype=np.float64)
    if kappa.size == 0:
        reject("kappa", "an array of at least one cell", kappa.shape)
    if not np.isfinite(kappa).all() or kappa.min() <= -1:
        worst = kappa[~np.isfinite(kappa) | (kappa <= -1)][0]
        reject("kappa", "finite and above -1 (a positive permittivity) in every cell", float(worst))
    return kappa


def check_courant(courant: float, kappa: np.ndarray, method: Literal["bound", "eigen"] = "bound") -> float:
    """Return ``courant`` if the march in ``kappa`` is stable with it."""
    limit = courant_limit(kappa, method)
    # a vacuum Courant number of 1 written as S = 1/n_b may sit a rounding above min(n)/n_b = 1/n_b
    if not 0 < courant <= limit * (1 + 4 * np.finfo(float).eps):
        reject("courant", f"greater than 0 and at most {limit:.6g}, the largest that is stable in this medium", courant,
               f"Use courant={np.floor(limit * 1e6) / 1e6:.6f} or less.")  # fmt: skip
    return courant
