"""Processes that render: how they are started, and how they behave.

Workers come from a fork server that has imported the slow modules once and never rendered: forking a
process that has used OpenMP or FINUFFT threads kills or hangs the children. One sample is rendered with
one torch thread everywhere, since some torch sums round differently with two.
"""

import multiprocessing
import os
import threading
from multiprocessing.context import BaseContext

from specklegen.core.parallel import run_serial_in_this_process

PRELOAD = [
    "torch", "numba", "specklegen.datasets.workers", "specklegen.datasets.store.generate",
    "specklegen.datasets.recipes.registry", "specklegen.datasets.recipes.generator",
    "specklegen.datasets.recipes.materials", "numba.np.arraymath", "numba.np.linalg", "numba.cpython.randomimpl",
]  # fmt: skip
"""What every worker of a recipe would import by itself; its only threads are those of OpenBLAS, ended before a fork."""


def worker_context() -> BaseContext:
    """Return the context that starts workers: fork server, or spawn where there is none.

    The start method of the program is left alone. As with every way of starting processes but a plain
    fork, a script needs ``if __name__ == "__main__":`` around what it does.
    """
    if getattr(multiprocessing.current_process(), "_inheriting", False):
        raise RuntimeError(
            "a worker process ran the script that started it, which would start workers again. Put the statements of "
            'the script under `if __name__ == "__main__":`'
        )
    if "forkserver" not in multiprocessing.get_all_start_methods():
        return multiprocessing.get_context("spawn")
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload(PRELOAD)
    return context


def prepare_worker() -> None:
    """Make this process render on one thread; for every worker, before its first sample."""
    import torch

    run_serial_in_this_process()
    torch.set_num_threads(1)


def end_with_parent() -> None:
    """End this worker when the process that started it is gone, even by kill -9."""
    parent = multiprocessing.parent_process()
    if parent is None:
        return

    def watch() -> None:
        parent.join()
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()
