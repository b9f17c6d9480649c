"""The direct sum: the field of a bank at any lights and views. Slow, exact, the reference.

``u(t, v) = N^(-1/2) sum over connections of z sqrt(W) a_tv``, with ``z = e^(2 pi i zeta)`` the same for all t and v.
"""

import numpy as np

from specklegen.core.parallel import Threads, map_blocks, one_blas_thread
from specklegen.core.random_streams import Seed
from specklegen.kernels import sums
from specklegen.kernels.phase_table import HENYEY_3D, ISOTROPIC_3D
from specklegen.kernels.volume import VOXELS
from specklegen.paths.bank import PathBank
from specklegen.paths.displacements import Moved
from specklegen.paths.endpoint_factors import endpoint_factors, light_strengths, single_factors
from specklegen.paths.faces import crossing_factors
from specklegen.paths.kept_angles import each_light
from specklegen.paths.layout import Layout
from specklegen.paths.phases import random_phases, reversal_phases
from specklegen.paths.tracer import Tracer

FIELD_ELEMENTS = 2**21  # of the largest array of endpoint factors held at a time
VIEWS_AT_ONCE = 128  # per block of parallel work

Phases = tuple[np.ndarray, np.ndarray | None]
"""Unit phasors complex128[M] of the connections, and of the same paths walked backwards, where these take part."""


def path_phases(tracer: Tracer, bank: PathBank, seed: Seed, sample: int, reverse: bool, threads: Threads = 1) -> Phases:
    """Random phases of a bank, addressed by (path, order); both ways of a path share one where they interfere."""
    z = random_phases(bank, seed, sample, threads=threads)
    if not tracer.bidirectional:
        return z, None
    return z, z if reverse else random_phases(bank, seed, sample, backwards=True, threads=threads)


def direct_field(
    layout: Layout, bank: PathBank, phases: Phases, *, moved: Moved | None = None, threads: Threads = None
) -> np.ndarray:
    """Sum over the connections of a bank, complex128[T, V], divided by the root of the number of paths.

    Parameters
    ----------
    layout, bank
        The scene, and its connections.
    phases
        Of :func:`path_phases`; without those of the way backwards, only forward paths are summed.
    moved
        Displacements of the particles in one frame of a film, seen by all lights of the layout.
    threads
        The result does not depend on it: views are shared out, every view's sum keeps its order.
    """
    forward, backward = phases
    once = bank.orders == 1
    single, multiple = bank.select(once), bank.select(~once)
    field = np.zeros((len(layout.lights), len(layout.views)), np.complex128)
    add = _add_fused if is_plain_slab(layout) and moved is None else _add
    parts = [(single, forward[once], moved and moved.select(once))]
    parts.append((multiple, forward[~once], moved and moved.select(~once)))
    if backward is not None:
        back = moved and moved.select(~once).backwards()
        parts.append((multiple.reversed(), backward[~once] * reversal_phases(layout, multiple), back))
    with one_blas_thread():
        for some, factors, displaced in parts:
            for lights, own, seen, phased in each_light(layout, some, factors):
                if displaced is None:
                    add(own, seen, phased, field[lights], threads)
                else:
                    moving = phased * displaced.turns(seen, -own.lights.vectors[0])
                    _add(own, seen, moving, field[lights], threads, displaced.last)
    return field / np.sqrt(max(bank.count, 1))


def _add(
    layout: Layout, bank: PathBank, factors: np.ndarray, field: np.ndarray, threads: Threads,
    last: np.ndarray | None = None,
) -> None:  # fmt: skip
    """Add the connections of a bank, of single or of multiple scattering, as products of matrices.

    ``last`` float64[M, 3] is how far the last particles have moved, times k.
    """
    lights, views = field.shape
    step = max(64, FIELD_ELEMENTS // max(lights + views, 1))
    for start in range(0, len(bank), step):
        some = bank.select(slice(start, start + step))
        lit = light_strengths(layout, some, factors[start : start + step])
        once = bool(some.orders[0] == 1)
        into = None
        if layout.polarised is not None and not once:
            into = layout.polarised.arriving(some, -layout.lights.vectors)

        def block(
            first: int, some: PathBank = some, lit: np.ndarray = lit, once: bool = once, start: int = start,
            into: np.ndarray | None = into,
        ) -> None:
            part = slice(first, first + VIEWS_AT_ONCE)
            few = layout.of_ends(slice(None), part)
            ends = endpoint_factors(few, some, few.views, "exit")
            if last is not None:
                ends *= np.exp(-1j * _along(few, some, last[start : start + step]))
            if into is not None and layout.polarised is not None:
                for arriving, passed in zip(into, layout.polarised.passing(some, few.views.vectors), strict=True):
                    field[:, part] += (lit * arriving) @ (ends * passed).T
                return
            if not once:
                field[:, part] += lit @ ends.T
                return
            s = single_factors(few, some)
            if s.shape[-1] == 1:
                field[:, part] += s[..., 0] * (lit @ ends.T)
            else:
                field[:, part] += np.einsum("tm,vm,tvm->tv", lit, ends, s)

        map_blocks(block, range(0, views, VIEWS_AT_ONCE), threads)


def _along(layout: Layout, bank: PathBank, last: np.ndarray) -> np.ndarray:
    """Displacement float64[V, M] of the last particles along the way to every view; to points to first order."""
    views = layout.views.vectors
    if not layout.views.near:
        return views @ last.T
    ways = views[:, None] - bank.exit
    return np.einsum("vmd,md->vm", ways, last) / np.linalg.norm(ways, axis=-1)


def is_plain_slab(layout: Layout) -> bool:
    """Return whether far views look at a homogeneous slab of one type of isotropic or Henyey-Greenstein particles."""
    volume, table = layout.volume, layout.table
    if layout.polarised is not None or layout.ways is not None:
        return False
    far = not (layout.views.near or layout.lights.near)
    infinite = bool(np.isinf(volume.bounds[0, 0])) and volume.dimension == 3
    plain = len(table.kinds) == 1 and table.kinds[0] in (ISOTROPIC_3D, HENYEY_3D)
    return far and infinite and plain and int(volume.cells[VOXELS].prod()) == 1


def _add_fused(layout: Layout, bank: PathBank, factors: np.ndarray, field: np.ndarray, threads: Threads) -> None:
    """Sum in one pass for a plain slab: factors of the views are computed and summed at once, never kept."""
    if len(bank) == 0 or field.size == 0:
        return
    if not layout.faces.matched and bank.bounces.any():
        kinds, which = np.unique(bank.bounces, axis=0, return_inverse=True)
        for n in range(len(kinds)):
            _add_like(layout, bank.select(which == n), factors[which == n], field, threads)
        return
    _add_like(layout, bank, factors, field, threads)


def _add_like(layout: Layout, bank: PathBank, factors: np.ndarray, field: np.ndarray, threads: Threads) -> None:
    """Sum connections of equal numbers of reflections."""
    single = bool(bank.orders[0] == 1)
    total = np.zeros(field.shape[::-1], np.complex128)
    strengths = np.ascontiguousarray(light_strengths(layout, bank, factors, threads).T)
    views, turns = np.ascontiguousarray(layout.views.vectors), layout.views.turns
    g = layout.table.parameters[0, 0] if layout.table.kinds[0] == HENYEY_3D else 0.0
    thickness, extinction = layout.volume.bounds[1, 2], layout.volume.extinction[0]

    def block(part: slice) -> None:
        sums.direct_sum(
            bank.records, int(single), g, extinction, thickness, strengths, views[part], turns[part], total[part]
        )

    step = max(1, min(256, len(views) // 8))
    map_blocks(block, [slice(a, a + step) for a in range(0, len(views), step)], threads)
    if not layout.faces.matched:
        total *= crossing_factors(layout.faces, views, bank.bounces[:1, 1])
    field += total.T * single_factors(layout, bank)[..., 0] if single else total.T
