"""The one place where work is spread over threads.

Kernels are serial and release the interpreter lock; here blocks of them run side by side. Results come
back in the order of the blocks, so that every sum over them is the same for any number of threads.
"""

import os
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from ctypes import CDLL
from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise
from threading import Condition, Lock, Thread
from typing import TYPE_CHECKING, Any, TypeVar

if TYPE_CHECKING:
    from threadpoolctl import ThreadpoolController

A = TypeVar("A")
B = TypeVar("B")

_IN_WORKER = False
MOST_THREADS = 4096


def run_serial_in_this_process() -> None:
    """Make one thread the default here: for data-loader workers, which are parallel among themselves."""
    global _IN_WORKER
    _IN_WORKER = True


def thread_count(threads: int | None = None) -> int:
    """Return ``threads``, or by default the cores that this process may run on (1 in a worker)."""
    if threads is None:
        if _IN_WORKER:
            return 1
        return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    from specklegen.core.arguments import whole_number

    return whole_number("threads", threads, 1, MOST_THREADS, remedy="Leave it out to use all cores.")


def slices(count: int, size: int) -> list[slice]:
    """Cut ``count`` things into blocks of ``size``, the last one shorter."""
    return [slice(first, min(first + size, count)) for first in range(0, count, size)]


def even_slices(count: int, parts: int) -> list[slice]:
    """Cut ``count`` things into ``parts`` blocks, or as many as there are things, whose sizes differ by one at most."""
    edges = [count * n // min(parts, count) for n in range(min(parts, count) + 1)] if count else []
    return [slice(*ends) for ends in pairwise(edges)]


def map_blocks(function: Callable[[A], B], blocks: Iterable[A], threads: "Threads" = None) -> list[B]:
    """Apply ``function`` to every block on ``threads`` threads, or a crew; results in the order of the blocks."""
    blocks = list(blocks)
    if isinstance(threads, Crew):
        return threads.map(function, blocks)
    workers = min(thread_count(threads), len(blocks))
    return list(in_turn(lambda block, _: function(block), blocks, workers))


def in_turn(
    function: Callable[[A, "Threads"], B], jobs: Iterable[A], threads: int, beside: int | None = None
) -> Iterator[B]:
    """Do jobs on ``threads`` threads, ``beside`` at a time (default: one a thread); yield results in the jobs' order.

    For long jobs and large results: no more than twice ``beside`` are begun ahead of the one that is yielded.
    ``function`` gets the job, and what it should pass on as ``threads`` to share its blocks with threads that have no
    job of their own.
    """
    if threads <= 1:
        yield from (function(job, 1) for job in jobs)
        return
    yield from Crew().in_turn(function, jobs, threads, beside or threads)


@dataclass(eq=False)
class _Map:
    """A function to be applied to blocks, some of which have begun and ended."""

    function: Callable[[Any], Any]
    blocks: list[Any]
    found: list[Any]
    begun: int = 0
    ended: int = 0
    error: BaseException | None = None


class Crew:
    """Threads that do jobs in turn; one without a job helps others with their blocks.

    So none is idle while the last jobs are done, or where there are fewer jobs than threads.
    """

    def __init__(self) -> None:
        self._changed = Condition()  # guards all that follows
        self._maps: list[_Map] = []  # not all of whose blocks have begun
        self._running = self._begun = self._yielded = 0  # jobs
        self._stopped = False
        self._results: dict[int, tuple[Any, BaseException | None]] = {}

    def map(self, function: Callable[[A], B], blocks: list[A]) -> list[B]:
        """Apply ``function`` to blocks, with the help of threads that have nothing else to do."""
        if len(blocks) <= 1:
            return [function(block) for block in blocks]
        work = _Map(function, blocks, [None] * len(blocks))
        with self._changed:
            self._maps.append(work)
            self._changed.notify_all()
        next_work: _Map | None = work
        while next_work is not None:
            self._help(next_work)
            with self._changed:  # while others end their blocks, help with what these, or others, have opened
                self._changed.wait_for(lambda: work.ended == work.begun or self._maps)
                next_work = None if work.ended == work.begun else self._maps[0]
        if work.error is not None:
            raise work.error
        return work.found

    def _help(self, work: _Map) -> None:
        """Do blocks until all have begun, or one has failed."""
        while True:
            with self._changed:
                n = work.begun
                if n == len(work.blocks) or work.error is not None:
                    if work in self._maps:
                        self._maps.remove(work)
                    return
                work.begun += 1
            error = None
            try:
                work.found[n] = work.function(work.blocks[n])
            except BaseException as caught:  # noqa: BLE001, raised again by the thread that waits for it
                error = caught
            with self._changed:
                work.error = work.error or error
                work.ended += 1
                self._changed.notify_all()

    def in_turn(
        self, function: Callable[[A, "Threads"], B], jobs: Iterable[A], threads: int, beside: int
    ) -> Iterator[B]:
        """Do jobs; yield results in their order."""
        jobs = list(jobs)
        members = [Thread(target=self._work, args=(function, jobs, beside), daemon=True) for _ in range(threads)]
        for member in members:
            member.start()
        try:
            for n in range(len(jobs)):
                with self._changed:
                    self._changed.wait_for(lambda n=n: n in self._results)
                    found, error = self._results.pop(n)
                    self._yielded += 1
                    self._changed.notify_all()
                if error is not None:
                    raise error
                yield found
        finally:
            with self._changed:
                self._stopped = True
                self._changed.notify_all()
            for member in members:
                member.join()

    def _work(self, function: Callable[[A, "Threads"], B], jobs: list[A], beside: int) -> None:
        """Work of each thread: begin the next job if it may, else help, until all jobs are done."""

        def no_more() -> bool:
            return self._stopped or self._begun == len(jobs)

        def may_begin() -> bool:
            return not no_more() and self._running < beside and self._begun - self._yielded < 2 * beside

        while True:
            with self._changed:
                self._changed.wait_for(lambda: may_begin() or self._maps or (no_more() and not self._running))
                n, helped = self._begun, None
                if may_begin():
                    self._begun += 1
                    self._running += 1
                elif self._maps:
                    helped = self._maps[0]
                else:
                    return
            if helped is not None:
                self._help(helped)
                continue
            found, error = None, None
            try:
                found = function(jobs[n], self)
            except BaseException as caught:  # noqa: BLE001, raised again where the result is taken
                error = caught
            with self._changed:
                self._results[n] = found, error
                self._running -= 1
                self._changed.notify_all()


Threads = int | Crew | None
"""Number of threads, or the crew that they belong to: None are all cores, a crew those of it that have no job."""


_BLAS = Lock()  # guards what follows
_ONE_BLAS_THREAD = 0  # contexts that are open, in whatever threads
_blas_before: Any = None


@contextmanager
def one_blas_thread() -> Iterator[None]:
    """Context in which NumPy's and SciPy's linear algebra runs on one thread.

    More would change its last bits, and cost more than they bring where matrices are small or blocks around them are
    parallel. The number belongs to the process: the first context that opens sets it, the last that closes restores it.
    """
    global _ONE_BLAS_THREAD, _blas_before
    with _BLAS:
        if not _ONE_BLAS_THREAD:
            _blas_before = _linear_algebra().limit(limits=1, user_api="blas")
        _ONE_BLAS_THREAD += 1
    try:
        yield
    finally:
        with _BLAS:
            _ONE_BLAS_THREAD -= 1
            if not _ONE_BLAS_THREAD:
                _blas_before.restore_original_limits()


def _forget_other_threads() -> None:
    """Forget the other threads in a forked process: a lock that one of them held is never given back."""
    global _BLAS
    _BLAS = Lock()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_forget_other_threads)


@lru_cache(1)
def _linear_algebra() -> "ThreadpoolController":
    """Controller of the libraries in this process: looking for them takes milliseconds."""
    import scipy.linalg  # noqa: F401, whose library is another than NumPy's
    from threadpoolctl import ThreadpoolController

    return ThreadpoolController()


@contextmanager
def one_torch_thread() -> Iterator[None]:
    """Run torch on one thread, then restore what was set: its sums differ in the last bit between one and two.

    torch counts by OpenMP, its products (MKL) by a number of their own. torch sets both, but other libraries set the
    first alone: after ``threadpoolctl.threadpool_limits(1)`` torch says 1 and multiplies on two. So both are set here.
    """
    import torch

    before, products = torch.get_num_threads(), _threads_of_products()
    products_before = products(1) if products else 0
    if before != 1 or products is None:
        torch.set_num_threads(1)
    try:
        yield
    finally:
        if before != 1:
            torch.set_num_threads(before)
        if products:
            products(products_before)


@lru_cache(1)
def _threads_of_products() -> Callable[[int], int] | None:
    """Return what sets the threads of torch's MKL for the thread that calls, and returns those before (0: no own)."""
    import torch

    return getattr(CDLL(torch._C.__file__), "MKL_Set_Num_Threads_Local", None)
