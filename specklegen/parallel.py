"""The one place where work is spread over threads.

Kernels are serial and release the interpreter lock; here blocks of them run side by side. Results come
back in the order of the blocks, so that every sum over them is the same for any number of threads.
"""

import os
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import AbstractContextManager, contextmanager
from functools import lru_cache
from typing import TYPE_CHECKING, TypeVar

if TYPE_CHECKING:
    from threadpoolctl import ThreadpoolController

A = TypeVar("A")
B = TypeVar("B")

_IN_WORKER = False


def run_serial_in_this_process() -> None:
    """Make one thread the default here: for data-loader workers, which are parallel among themselves."""
    global _IN_WORKER
    _IN_WORKER = True


def thread_count(threads: int | None = None) -> int:
    """Return ``threads``, or by default the cores that this process may run on (1 in a worker).

    Raises
    ------
    RuleError
        If ``threads`` is less than 1.
    """
    if threads is None:
        if _IN_WORKER:
            return 1
        return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    if threads < 1:
        from specklegen.values import reject

        reject("threads", "at least 1", threads, "Leave it out to use every core.")
    return threads


def slices(count: int, size: int) -> list[slice]:
    """Cut ``count`` things into blocks of ``size``, the last one shorter."""
    return [slice(first, min(first + size, count)) for first in range(0, count, size)]


def map_blocks(function: Callable[[A], B], blocks: Iterable[A], threads: int | None = None) -> list[B]:
    """Apply ``function`` to every block on ``threads`` threads; results in the order of the blocks."""
    blocks = list(blocks)
    workers = min(thread_count(threads), len(blocks))
    if workers <= 1:
        return [function(block) for block in blocks]
    with ThreadPoolExecutor(workers) as pool:
        return list(pool.map(function, blocks))


def in_turn(function: Callable[[A], B], jobs: Iterable[A], workers: int) -> Iterator[B]:
    """Apply ``function`` to every job on ``workers`` threads; yield results in the order of the jobs.

    For long jobs and large results: no more than twice ``workers`` are begun ahead of the one that is yielded.
    """
    if workers <= 1:
        yield from map(function, jobs)
        return
    with ThreadPoolExecutor(workers) as pool:
        ahead = deque()
        try:
            for job in jobs:
                ahead.append(pool.submit(function, job))
                if len(ahead) == 2 * workers:
                    yield ahead.popleft().result()
            while ahead:
                yield ahead.popleft().result()
        finally:
            for begun in ahead:
                begun.cancel()


def one_blas_thread() -> AbstractContextManager[object]:
    """Context in which NumPy's and SciPy's linear algebra runs on one thread.

    More would change its last bits, and cost more than they bring where matrices are small or blocks around them are
    parallel.
    """
    return _linear_algebra().limit(limits=1, user_api="blas")


@lru_cache(1)
def _linear_algebra() -> "ThreadpoolController":
    """Controller of the libraries in this process: looking for them takes milliseconds."""
    import scipy.linalg  # noqa: F401, whose library is another than NumPy's
    from threadpoolctl import ThreadpoolController

    return ThreadpoolController()


@contextmanager
def one_torch_thread() -> Iterator[None]:
    """Run torch on one thread, then restore what was set: its sums differ in the last bit between one and two."""
    import torch

    before = torch.get_num_threads()
    if before == 1:
        yield
        return
    torch.set_num_threads(1)
    try:
        yield
    finally:
        torch.set_num_threads(before)
