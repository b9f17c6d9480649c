"""The momentum that light gives to the particles of a path, by which their motion turns its phase.

    Y = sum_b m_b (1 - cos theta_b) = Y_interior + m_1 (1 - i . w_1) + m_B (1 - w_(B-1) . v);    B = 1: m_1 (1 - i . v)

and the Doppler shift that a flow V(x) gives to a path, k D of radians per unit of time,

    D = sum_b (w_(b-1) - w_b) . V(x_b) = D_interior + (i - w_1) . V(x_1) + (w_(B-1) - v) . V(x_B);
    B = 1: (i - v) . V(x_1)

(:mod:`specklegen.scene.motion`), of which banks hold D_interior; of one velocity V for all it is (i - v) . V.

m_b is how fast the particles move there beside the fastest ones. Banks hold Y_interior; both ends follow for every
light and view. The way back of a path has the same interior, and a face at rest gives no particle anything.
"""

import numpy as np

from specklegen.paths.bank import PathBank
from specklegen.paths.endpoint_factors import turned_over
from specklegen.paths.layout import Layout
from specklegen.paths.volumes import drift_of, mobility_at, velocity_at

CLASSES = 2049
_STILL = 1e-12  # of the largest Doppler shift: what rounding leaves of a sum that is 0
_WIDEST = 1e-7  # of the largest Y: below it, connections are at rest but for times that nobody waits


def momentum_transfer(layout: Layout, bank: PathBank) -> np.ndarray:
    """Y float64[M] of a bank with the column ``transfer``, for the one far light and view of a layout."""
    if not len(layout.volume.mobility):  # nothing moves at random
        return np.zeros(len(bank))
    light, view = -layout.lights.vectors[0], layout.views.vectors[0]
    first, last = mobility_at(layout.volume, bank.entry), mobility_at(layout.volume, bank.exit)
    seen = view
    if bank.bounces.any():
        seen = np.where(turned_over(bank)[:, None], view * np.array([1.0, 1.0, -1.0]), view)
    once = first * _drop(light, seen)
    more = bank.transfer + first * _drop(light, bank.entry_direction) + last * _drop(bank.exit_direction, view)
    return np.where(bank.orders == 1, once, more)


def doppler_shift(layout: Layout, bank: PathBank) -> np.ndarray:
    """D float64[M], length per unit of time, of a bank with the column ``doppler`` if its flow needs it.

    For the one far light and view of a layout, whose faces are matched.
    """
    light, view = -layout.lights.vectors[0], layout.views.vectors[0]
    drift = drift_of(layout.volume)
    if drift is not None:
        return np.full(len(bank), (light - view) @ drift)
    first, last = velocity_at(layout.volume, bank.entry), velocity_at(layout.volume, bank.exit)
    more = interior_doppler(layout, bank) + _along(light - bank.entry_direction, first)
    more = more + _along(bank.exit_direction - view, last)
    return np.where(bank.orders == 1, _along(light - view, first), more)


def interior_doppler(layout: Layout, bank: PathBank) -> np.ndarray:
    """Contribution to D of the particles between the first and the last, float64[M]."""
    drift = drift_of(layout.volume)
    return bank.doppler if drift is None else (bank.entry_direction - bank.exit_direction) @ drift


def at_rest(transfer: np.ndarray, doppler: np.ndarray | None) -> np.ndarray:
    """Which connections nothing turns, bool[M]: no momentum transfer float64[M], and of Doppler shifts but rounding."""
    if doppler is None:
        return transfer == 0
    return (transfer == 0) & (np.abs(doppler) <= _STILL * np.abs(doppler).max(initial=0.0))


def momentum_classes(transfer: np.ndarray) -> np.ndarray:
    """Class int64[M] of each connection's Y, of ``CLASSES``, so narrow that nobody sees them; class 0 is at rest.

    Each is 0.8 % wide. With the mean Y of a class for that of each, E[w e^(-2 x Y)] / E[w] is off by less than 2e-6.
    """
    return geometric_classes(transfer, CLASSES)


def geometric_classes(values: np.ndarray, count: int) -> np.ndarray:
    """Class int64[M] of numbers float64[M] of at least 0, on a geometric grid up to the largest; class 0 is for 0."""
    least = _WIDEST * values.max(initial=1e-300)
    place = np.log(np.maximum(values, least) / least) / -np.log(_WIDEST) * (count - 2)
    return np.where(values > 0, place.astype(np.int64) + 1, 0)


def _along(directions: np.ndarray, velocities: np.ndarray) -> np.ndarray:
    """W . V of each."""
    return np.einsum("...i,...i", directions, velocities)


def _drop(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    """1 - cos of the angle between unit vectors, exactly 0 between equal ones."""
    apart = one - other
    return np.einsum("...i,...i", apart, apart) / 2
