"""The direct sum: the field of a bank at any far-field directions. Slow, exact, the reference."""

import numpy as np

from specklegen.core.parallel import Threads, map_blocks
from specklegen.kernels import sums
from specklegen.paths.bank import PathBank
from specklegen.paths.slab_optics import (
    Optics,
    illumination_ends,
    offsets,
    reversal_phases,
    single_amplitudes,
)


def direct_field(
    bank: PathBank,
    optics: Optics,
    phases: np.ndarray,
    views: np.ndarray,
    *,
    reverse: bool = False,
    threads: Threads = None,
) -> np.ndarray:
    """Sum over the connections of a bank, complex128[T, V], divided by the root of the number of paths.

    Parameters
    ----------
    bank, optics
        Connections, and the scene's optics.
    phases
        complex128[M], one phasor per connection (:func:`specklegen.paths.slab_optics.random_phases`).
    views
        float64[V, 3], unit vectors.
    reverse
        Add each path's reversal, with the same phase; the bank must have been traced for it.
    threads
        The result does not depend on it: views are shared out, every view's sum keeps its order.
    """
    is_single = bank.orders == 1
    singles, multiples = bank.select(is_single), bank.select(~is_single)
    field = _sum(singles, optics, phases[is_single], views, single=True, threads=threads)
    field *= single_amplitudes(optics, views)
    field += _sum(multiples, optics, phases[~is_single], views, single=False, threads=threads)
    if reverse:
        factors = phases[~is_single] * reversal_phases(bank, optics)
        field += _sum(bank.reversed(), optics, factors, views, single=False, threads=threads)
    return field / np.sqrt(max(bank.count, 1))


def _sum(
    bank: PathBank,
    optics: Optics,
    factors: np.ndarray,
    views: np.ndarray,
    *,
    single: bool,
    threads: Threads,
) -> np.ndarray:
    field = np.zeros((len(views), len(optics.tilts)), np.complex128)
    if len(bank) == 0 or field.size == 0:
        return field.T
    ends = np.ascontiguousarray(illumination_ends(bank, optics, factors, single=single).T)
    views = np.ascontiguousarray(views)
    turns = offsets(views, optics.view_reference, optics.wavelength)
    medium = optics.medium

    def block(part: slice) -> None:
        sums.direct_sum(
            bank.records, int(single), medium.scatterer.g, medium.extinction, medium.thickness,
            ends, views[part], turns[part], field[part],
        )  # fmt: skip

    step = max(1, min(256, len(views) // 8))
    map_blocks(block, [slice(a, a + step) for a in range(0, len(views), step)], threads)
    return field.T
