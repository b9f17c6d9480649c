"""Brute force: the mean scattered field over many media, both ways.

"transfer_matrix", the cheap one, solves the grid exactly in frequency and goes to time once, at the end;
"fdtd" marches every medium. Both see the same media for the same seed and agree to the Mur ends. The sums
are over chunks of fixed size in a fixed order, so that the result does not depend on the threads.
"""

from collections.abc import Callable
from typing import Literal

import numpy as np

from specklegen.core.arguments import whole_number
from specklegen.core.errors import reject
from specklegen.core.parallel import even_slices, map_blocks
from specklegen.fdtd.courant import check_courant
from specklegen.fdtd.incidence import MARGIN, Incidence, Pulse, illuminate
from specklegen.fdtd.layers import RandomLayer
from specklegen.fdtd.marching import march
from specklegen.fdtd.scattered import MeanField
from specklegen.kernels.fdtd import grid_scattering

_CHUNKS = 32
_BLOCK = 128  # media held in memory at a time, per thread


def monte_carlo_mean(
    layer: RandomLayer, n_realizations: int, method: Literal["transfer_matrix", "fdtd"] = "transfer_matrix", *,
    seed: int = 0, pulse: Pulse | None = None, courant: float | None = None, margin: int = MARGIN,
    threads: int | None = None,
) -> MeanField:  # fmt: skip
    """Average the scattered field over realizations 0 .. n - 1 of the layer.

    Parameters
    ----------
    layer
        The layer: its grid, its background, and the law of its index.
    n_realizations
        Media in the mean, whose error falls with the root of their number.
    method : {"transfer_matrix", "fdtd"}
        Exact frequency-domain solution of the grid, or a march for every medium (thirty times slower).
    seed
        Of the media, a whole number.
    pulse
        The light that comes in; by default the reference pulse, ``Pulse()``.
    courant
        Courant number of the background, at most 1; by default 1/n_b, which is 1 in vacuum. Smaller is slower.
    margin
        Of "fdtd": cells between the layer and each end of the grid; the transfer matrix has no ends.
    threads
        Threads, by default all cores that the process may run on; the result does not depend on them.

    Raises
    ------
    RuleError
        If ``n_realizations`` is less than 1, or the Courant number exceeds the limit of a medium drawn.

    Examples
    --------
    >>> from specklegen.fdtd import RandomLayer, monte_carlo_mean
    >>> found = monte_carlo_mean(RandomLayer(correlation_length=0.02, n_points=100), 16)
    >>> found.realizations
    16
    """
    whole_number("monte_carlo_mean n_realizations", n_realizations, 1)
    incidence = illuminate(layer, pulse, courant, margin)
    if method == "transfer_matrix":
        scattering, to_time = _grid_responses, incidence.basis()
    elif method == "fdtd":
        scattering, to_time = march, None
    else:
        reject("monte_carlo_mean.method", "one of 'transfer_matrix', 'fdtd'", method)

    def chunk(part: slice):
        return _sums(layer, incidence, seed, (part.start, part.stop), scattering, to_time is not None)

    sums = map_blocks(chunk, even_slices(n_realizations, _CHUNKS), threads)
    back, back_error = _mean_and_error([s[0] for s in sums], n_realizations, to_time)
    forward, forward_error = _mean_and_error([s[1] for s in sums], n_realizations, to_time)
    incident = incidence.series(np.ones(incidence.bins.size))
    return MeanField(incidence.time, incident, back, forward, back_error=back_error, forward_error=forward_error,
                     realizations=n_realizations)  # fmt: skip


def _grid_responses(kappa: np.ndarray, incidence: Incidence) -> tuple[np.ndarray, np.ndarray]:
    """Scattered responses at both faces, real and imaginary parts side by side: float64[R, 2F] each."""
    shape = (len(kappa), incidence.theta.size)
    back, forward = np.empty(shape, dtype=np.complex128), np.empty(shape, dtype=np.complex128)
    grid_scattering(kappa, incidence.theta, back, forward)
    forward -= 1
    forward *= np.exp(-1j * incidence.theta * (kappa.shape[1] - 1))
    return np.hstack([back.real, back.imag]), np.hstack([forward.real, forward.imag])


def _sums(
    layer: RandomLayer, incidence: Incidence, seed: int, bounds: tuple[int, int],
    scattering: Callable[[np.ndarray, Incidence], tuple[np.ndarray, np.ndarray]], products: bool,
) -> list[tuple[np.ndarray, np.ndarray]]:  # fmt: skip
    """Sum over media of the samples x, and of x x^T (``products``) or x^2, for back and forward."""
    blocks = []
    for first in range(bounds[0], bounds[1], _BLOCK):
        kappa = layer.sample(min(_BLOCK, bounds[1] - first), seed, first)
        check_courant(incidence.courant, kappa)
        sides = scattering(kappa, incidence)
        blocks.append([(x.sum(axis=0), x.T @ x if products else (x**2).sum(axis=0)) for x in sides])
    return [tuple(np.sum(parts, axis=0) for parts in zip(*side, strict=True)) for side in zip(*blocks, strict=True)]


def _mean_and_error(
    sums: list[tuple[np.ndarray, np.ndarray]], n: int, to_time: np.ndarray | None
) -> tuple[np.ndarray, np.ndarray]:
    """Mean and standard error in time; ``to_time`` float64[2F, T] maps responses to time series."""
    mean, second = (np.sum(parts, axis=0) / n for parts in zip(*sums, strict=True))
    if to_time is None:
        variance = second - mean**2
    else:
        covariance = second - np.outer(mean, mean)
        mean = mean @ to_time
        variance = np.einsum("ft,ft->t", to_time, covariance @ to_time)
    error = np.sqrt(np.maximum(variance, 0) / (n - 1)) if n > 1 else np.full(mean.shape, np.nan)
    return mean, error
