"""The Yee scheme in one dimension, in total-field and in scattered-field form, with Mur ends.

Total field ([Tan13] Eq. 15): eps dt E = -dx H, mu0 dt H = -dx E; the scattered field is what is left when
the incident field of the same grid is subtracted. Scattered form (Eq. 17): the incident field, marched
beside it, drives the scattered one through (eps - eps_b) dt E_inc. Both agree to rounding.

The ends are first-order Mur boundaries tuned to the pulse: exact for S = 1, and otherwise a floor under
the scattered field (`incidence`). ``margin`` moves them away; with a margin of half the number of steps
nothing returns in time.
"""

from typing import Literal

import numpy as np

from specklegen.core.errors import reject
from specklegen.fdtd.courant import check_courant, check_kappa
from specklegen.fdtd.incidence import MARGIN, Incidence, Pulse, illuminate
from specklegen.fdtd.layers import RandomLayer
from specklegen.fdtd.scattered import ScatteredField
from specklegen.kernels.fdtd import march_scattered, march_total

Form = Literal["total", "scattered"]


def yee(
    layer: RandomLayer, courant: float | None = None, pulse: Pulse | None = None, *, kappa: np.ndarray | None = None,
    seed: int = 0, form: Form = "total", margin: int = MARGIN, stability: Literal["bound", "eigen"] = "bound",
) -> ScatteredField:  # fmt: skip
    """March a pulse through media of a layer and record what they scatter.

    Parameters
    ----------
    layer : RandomLayer
        Gives the grid and the background.
    courant : float, optional
        Background Courant number; by default 1/n_b, a Courant number of 1 in vacuum.
    pulse : Pulse, optional
        By default the reference pulse.
    kappa : float64[N] or float64[R, N], optional
        The media; by default realization 0 of ``seed``.
    seed : int
        Of the medium, where ``kappa`` names none.
    form : {"total", "scattered"}
        Which equations are marched; the total form is twice as fast.
    margin : int
        Cells between the layer and each end.
    stability : {"bound", "eigen"}
        Which limit of `courant_limit` is enforced.

    Returns
    -------
    ScatteredField
        ``back`` and ``forward`` are [T] for one medium [N], else [R, T].

    Raises
    ------
    RuleError
        If the Courant number exceeds the stability limit of a medium (the message names the limit), a
        permittivity is not positive, or ``kappa`` does not fit the layer.

    Examples
    --------
    >>> from specklegen.fdtd import RandomLayer, yee
    >>> yee(RandomLayer(correlation_length=0.02, n_points=100), seed=3).forward.shape
    (7143,)
    """
    media = check_kappa(layer.sample(1, seed)[0] if kappa is None else kappa)
    if media.shape[-1] != layer.n_points or media.ndim > 2:
        reject("yee.kappa", f"of shape [{layer.n_points}] or [R, {layer.n_points}]", media.shape)
    incidence = illuminate(layer, pulse, courant, margin)
    check_courant(incidence.courant, media, stability)
    back, forward = march(np.atleast_2d(media), incidence, form)
    incident = _incident(incidence, layer.n_points)[0][0]
    shape = (*media.shape[:-1], incidence.steps)
    return ScatteredField(incidence.time, incident, back.reshape(shape), forward.reshape(shape))


def march(kappa: np.ndarray, incidence: Incidence, form: Form = "total") -> tuple[np.ndarray, np.ndarray]:
    """March media float64[R, N] unchecked; scattered records float64[R, T] at the first and last cell."""
    if form == "scattered":
        return _records(march_scattered, kappa, incidence)
    if form == "total":
        first, last = _records(march_total, kappa, incidence)
        incident_first, incident_last = _incident(incidence, kappa.shape[1])
        return first - incident_first, last - incident_last
    reject("yee.form", "one of 'total', 'scattered'", form)


def _incident(incidence: Incidence, cells: int) -> tuple[np.ndarray, np.ndarray]:
    return _records(march_total, np.zeros((1, cells)), incidence)


def _records(kernel, kappa: np.ndarray, incidence: Incidence) -> tuple[np.ndarray, np.ndarray]:
    first, last = np.empty((2, len(kappa), incidence.steps))
    grid = incidence.courant, incidence.mur, incidence.margin
    kernel(kappa, *grid, incidence.source, incidence.source_cell, first, last)
    return first, last
