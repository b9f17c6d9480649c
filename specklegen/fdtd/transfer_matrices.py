"""Exact frequency-domain solution of the Yee grid.

Each E node obeys ``e_{k-1} + e_{k+1} = (2 - 4 sin^2(theta/2)(1 + kappa_k)) e_k``, which is solved backwards from an
outgoing wave at the far side; no approximation beyond the grid itself. It is the cheap brute force: one pass over the
cells gives every frequency of a pulse.
"""

import numpy as np

from specklegen.fdtd.courant import check_kappa
from specklegen.fdtd.incidence import phase_per_cell
from specklegen.kernels.fdtd import grid_scattering


def transfer_matrix(kappa: np.ndarray, omega: np.ndarray, courant: float = 1.0) -> tuple[np.ndarray, np.ndarray]:
    """Reflect and transmit plane waves by the layers ``kappa`` on the grid.

    Parameters
    ----------
    kappa : float64[N] or float64[R, N]
        (n/n_b)^2 - 1 at the cells.
    omega : float64[F]
        Angular frequencies, radians a time step.
    courant : float
        Courant number S of the background; with S = 1 ``omega`` is also the phase a cell.

    Returns
    -------
    reflected, transmitted : complex128[F] or complex128[R, F]
        The scattered field at the first cell over the incident one there; the total field at the last cell
        over the incident one there. At omega = 0 they are 0 and 1.

    Raises
    ------
    RuleError
        If a permittivity is not positive, or the grid does not carry a frequency.

    Examples
    --------
    >>> import numpy as np
    >>> from specklegen.fdtd import transfer_matrix
    >>> reflected, transmitted = transfer_matrix(np.full(10, 0.2), np.array([0.03]))
    >>> (abs(reflected) ** 2 + abs(transmitted) ** 2).round(9)
    array([1.])
    """
    kappa = check_kappa(kappa)
    omega = np.atleast_1d(np.asarray(omega, dtype=float))
    theta = phase_per_cell(omega, courant)
    media = np.atleast_2d(kappa)
    reflected = np.zeros((len(media), omega.size), dtype=complex)
    transmitted = np.ones((len(media), omega.size), dtype=complex)
    moving = theta > 0
    shape = (len(media), int(moving.sum()))
    r, t = np.empty(shape, dtype=complex), np.empty(shape, dtype=complex)
    grid_scattering(media, theta[moving], r, t)
    reflected[:, moving], transmitted[:, moving] = r, t
    return (reflected[0], transmitted[0]) if kappa.ndim == 1 else (reflected, transmitted)
