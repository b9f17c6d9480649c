"""Tracing block after block, into room that grows until the connections of a block fit."""

from collections.abc import Callable
from typing import Any

import numpy as np

from specklegen.core.parallel import Threads, map_blocks
from specklegen.kernels import walk
from specklegen.kernels.jones import CARRIED, ENTRIES, STEP, Jones
from specklegen.paths.bank import BLOCK, PathBank, concatenate, empty_bank


def trace_blocks(
    run: Callable[..., tuple[int, int, int, float]], first: int, count: int, *, capacity: float, columns: int,
    threads: Threads, bounces: Any = np.int8, matrices: np.ndarray | None = None,
    finish: Callable[[PathBank], PathBank] = lambda bank: bank,
) -> PathBank:  # fmt: skip
    """Trace paths ``first`` ... ``first + count - 1``, in the order of their numbers whatever the threads.

    ``run`` is a kernel of (first path, paths), its output, the types int32[room, 2] of both particles and the
    ``matrices`` of polarised light. It returns the connections, events, paths that were ended, and their weight. Memory
    is for ``capacity`` connections a path; a block of more is traced twice. Both legs have numbers of the type
    ``bounces``. ``finish`` completes the bank of a block.
    """

    def block(start: int) -> PathBank:
        size = min(BLOCK, first + count - start)
        room = int(capacity * size) + 1
        while True:
            found = walk.Found(np.empty((room, columns)), np.empty(room, np.int32), np.empty(room, np.int64),
                               np.zeros((room, 2), bounces), np.empty(room, np.int64))  # fmt: skip
            types = np.zeros((room, 2), np.int32)
            jones = None
            if matrices is not None:
                jones = Jones(matrices, np.empty((2, CARRIED)), np.empty(STEP), np.zeros((room, ENTRIES)))
            connections, events, unfinished, unfinished_weight = run((start, size), found, types, jones)
            if connections <= room:
                break
            room = connections
        order = found.ranks[:connections]
        records, orders, paths, types, legs = (
            values.take(order, axis=0) for values in (found.records, found.orders, found.paths, types, found.bounces)
        )
        turned = jones and jones.found.take(order, axis=0).view(np.complex128).reshape(-1, 2, 2)
        bank = PathBank(records, orders, paths, types, legs, size, events, unfinished, unfinished_weight, turned)
        return finish(bank)

    banks = map_blocks(block, range(first, first + count, BLOCK), threads)
    return concatenate(banks, threads) if banks else empty_bank(count, columns)
