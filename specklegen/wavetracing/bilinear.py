"""Intensity from sampled amplitudes: bilinear, with or without its bias.

Rays that carry amplitudes f_1 ... f_n, drawn independently, estimate a field u = E f. Their naive intensity
|sum f / n|^2 is too large by Var f / n. Over pairs of different rays it is not,

    I = (|S|^2 - sum |f_j|^2) / (n (n - 1)),   S = sum f_j,

but it can be negative. Source: S. Steinberg, M. Pharr, *Wave Tracing*, Eqs. 2-5. Deviation: the three properties that
the paper asks of the bilinear form do not make I >= 0 (F of three paths, positive on the diagonal and as negative off
it, has a negative sum); F must be positive semidefinite.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from specklegen.core.arguments import complex_array, flag
from specklegen.core.errors import reject


def bilinear_intensity(contributions: ArrayLike, unbiased: bool = True) -> tuple[np.ndarray, np.ndarray]:
    """Estimate |E f|^2 from independent contributions.

    Parameters
    ----------
    contributions : complex128[n, ...]
        One amplitude a ray; n at least 3.
    unbiased
        Sum over pairs of different rays; it may be negative. Otherwise |mean|^2, which is too large by Var f / n.

    Returns
    -------
    intensity, standard_error : float64[...]
        The error by the jackknife: from the estimates without each ray in turn.

    Raises
    ------
    RuleError
        For fewer than three rays, or amplitudes that are not finite.

    Examples
    --------
    >>> import numpy as np
    >>> from specklegen.wavetracing import bilinear_intensity
    >>> intensity, error = bilinear_intensity(np.full(100, 1 + 1j))
    >>> round(float(intensity), 6)
    2.0
    """
    flag("bilinear_intensity unbiased", unbiased)
    f = complex_array("bilinear_intensity contributions", contributions)
    if f.ndim < 1 or len(f) < 3:
        reject("bilinear_intensity contributions", "of at least 3 rays", np.shape(contributions))
    if not np.isfinite(f).all():
        reject("bilinear_intensity contributions", "finite everywhere", contributions)
    n = len(f)
    total, power = f.sum(axis=0), (np.abs(f) ** 2).sum(axis=0)
    without, rest = np.abs(total - f) ** 2, power - np.abs(f) ** 2
    if unbiased:
        intensity = (np.abs(total) ** 2 - power) / (n * (n - 1))
        left_out = (without - rest) / ((n - 1) * (n - 2))
    else:
        intensity = np.abs(total / n) ** 2
        left_out = without / (n - 1) ** 2
    spread = ((left_out - left_out.mean(axis=0)) ** 2).sum(axis=0)
    return intensity, np.sqrt((n - 1) / n * spread)
