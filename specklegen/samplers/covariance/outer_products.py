"""Sums of outer products of the amplitudes of paths, over batches, and their standard errors.

C_pq = E[ W a_p a_q* ] for all p and q, some rows, or chosen pairs            [Bar19], Algorithms 1 and 3
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from itertools import chain
from typing import NamedTuple

import numpy as np

from specklegen.core.parallel import Threads, even_slices, in_turn, map_blocks, one_blas_thread, thread_count
from specklegen.core.random_streams import Seed, Stream
from specklegen.core.statistics import BATCHES, tail_factor
from specklegen.paths.bank import BLOCK, PathBank
from specklegen.paths.endpoint_factors import multiple_amplitudes, single_amplitudes
from specklegen.paths.layout import Layout
from specklegen.paths.tracer import Tracer

AMPLITUDES = 2**22  # held at a time
_ENTRIES = 2**17  # of batches in work that are not the only one, a thread
_BLOCK_ROWS = 256  # per block of parallel work
_PATHS_AT_ONCE = 8 * BLOCK  # so that the connections in memory do not grow with the number of paths


@dataclass(frozen=True)
class Entries:
    """Which entries of C to estimate: their shape, how amplitudes [T * V, M] add to their sums on threads, their scale.

    ``scale`` maps C_pp, float64[T * V], to sqrt(C_pp C_qq) of the entries.
    """

    shape: tuple[int, ...]
    add: Callable[[np.ndarray, np.ndarray, Threads], None]
    scale: Callable[[np.ndarray], np.ndarray]
    symmetric: bool = False


def all_pairs(n: int) -> Entries:
    """The whole matrix, of n pairs of a light and a view; its upper triangle is mirrored."""

    def lower_triangle(out: np.ndarray, a: np.ndarray, threads: Threads) -> None:
        conjugate = a.conj().T

        def rows(start: int) -> None:
            stop = start + _BLOCK_ROWS
            out[start:stop, :stop] += a[start:stop] @ conjugate[:, :stop]

        map_blocks(rows, range(0, n, _BLOCK_ROWS), threads)

    return Entries((n, n), lower_triangle, lambda power: np.sqrt(np.outer(power, power)), symmetric=True)


def chosen_pairs(layout: Layout, pairs: np.ndarray) -> tuple[Layout, Entries]:
    """The chosen entries, and the layout with only the lights and views that they name: no other end is evaluated."""
    lights, light_numbers = np.unique(pairs[:, [0, 2]], return_inverse=True)
    views, view_numbers = np.unique(pairs[:, [1, 3]], return_inverse=True)
    left, right = (light_numbers.reshape(-1, 2) * len(views) + view_numbers.reshape(-1, 2)).T

    def entries(out: np.ndarray, a: np.ndarray, threads: Threads) -> None:
        out += np.einsum("pm,pm->p", a[left], a[right].conj())

    scale = Entries((len(pairs),), entries, lambda power: np.sqrt(power[left] * power[right]))
    return layout.of_ends(lights, views), scale


def some_rows(part: slice, n: int) -> Entries:
    """Some rows of the whole matrix."""

    def rows(out: np.ndarray, a: np.ndarray, threads: Threads) -> None:
        out += a[part] @ a.conj().T

    return Entries((part.stop - part.start, n), rows, lambda power: np.sqrt(np.outer(power[part], power)))


class Sums(NamedTuple):
    """An estimate of entries of C: of all light and of single scattering, and its standard error.

    Attributes
    ----------
    total, single : complex128[...]
    error : float64[...]
    relative : float
        Largest error over sqrt(C_pp C_qq).
    unfinished : int
        Paths cut short.
    powers : float64[batches, T * V]
        Sums over the paths of each batch of what makes C_pp.
    """

    total: np.ndarray
    single: np.ndarray
    error: np.ndarray
    relative: float
    unfinished: int
    powers: np.ndarray


def outer_products(
    tracer: Tracer, seen: Layout, paths: int, seed: Seed, *, reverse: bool, entries: Entries, threads: int | None,
    stream: Stream = Stream.PATHS,
) -> Sums:  # fmt: skip
    """Sum the outer products of amplitudes over batches of paths, and find the error from their scatter.

    Paths are those of ``tracer``; amplitudes are at the lights and views of ``seen``, all of them or some, whose
    intensities in each batch are returned beside.
    """
    total, single = np.zeros((2, *entries.shape), np.complex128)
    squares = np.zeros(entries.shape)
    pairs = len(seen.lights) * len(seen.views)
    powers: list[np.ndarray] = []
    unfinished = 0
    batches = even_slices(paths, BATCHES)
    step = max(1, AMPLITUDES // max(pairs, 1))
    members = thread_count(threads)
    ways = partial(_both_ways, seen, tracer.bidirectional, reverse)

    def batch(part: slice, threads: Threads) -> tuple[np.ndarray, np.ndarray, np.ndarray, int]:
        once, often = np.zeros((2, *entries.shape), np.complex128)
        lit, cut = np.zeros(pairs), 0
        for start in range(part.start, part.stop, _PATHS_AT_ONCE):
            count = min(_PATHS_AT_ONCE, part.stop - start)
            bank = tracer.trace(seed, count, first=start, stream=stream, threads=threads)
            cut += bank.unfinished
            amplitudes = chain(
                ((once, single_amplitudes(seen, piece, threads)) for piece in _pieces(bank.single, step)),
                ((often, ways(piece, threads)) for piece in _pieces(bank.multiple, step)),
            )
            for out, some in amplitudes:
                entries.add(out, some, threads)
                lit += np.einsum("pm,pm->p", some, some.conj()).real
        return once, often, lit, cut

    with one_blas_thread():
        for once, often, lit, cut in in_turn(batch, batches, members, batches_side_by_side(total.size, members)):
            single += once
            often += once
            total += often
            squares += np.square(often.real) + np.square(often.imag)
            powers.append(lit)
            unfinished += cut
    total /= paths
    single /= paths
    lit = np.array(powers)
    error = _standard_error(squares / paths**2, total, len(batches))
    error *= entries.scale(tail_factor(lit - lit.mean(axis=0)))
    if entries.symmetric:
        for matrix in (total, single, error):
            mirror(matrix)
    scale = entries.scale(lit.sum(axis=0) / paths)
    relative = np.divide(error, scale, out=np.zeros_like(error), where=scale > 0).max(initial=0.0)
    return Sums(total, single, error, float(relative), unfinished, lit)


def _both_ways(layout: Layout, bidirectional: bool, reverse: bool, bank: PathBank, threads: Threads) -> np.ndarray:
    return multiple_amplitudes(layout, bank, bidirectional=bidirectional, reverse=reverse, threads=threads)


def _standard_error(squares: np.ndarray, mean: np.ndarray, n: int) -> np.ndarray:
    """Error of a mean from the sum of |what each of n batches adds to it|^2; NaN where n < 2."""
    if n < 2:
        return np.full(mean.shape, np.nan)
    scatter = squares - (np.square(mean.real) + np.square(mean.imag)) / n
    return np.sqrt(np.clip(scatter, 0, None) * n / (n - 1))


def batches_side_by_side(entries: int, threads: int) -> int:
    """Batches of paths in work at a time: of large covariances one after the other."""
    return max(1, min(threads, threads * _ENTRIES // max(entries, 1)))


def _pieces(bank: PathBank, step: int) -> Iterator[PathBank]:
    return (bank.select(slice(start, start + step)) for start in range(0, len(bank), step))


def mirror(matrix: np.ndarray) -> None:
    """Fill the upper triangle from the lower one."""
    for row in range(len(matrix)):
        matrix[row, row + 1 :] = matrix[row + 1 :, row].conj()
        matrix[row, row] = matrix[row, row].real
