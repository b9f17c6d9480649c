"""Functions of others, each in a process of its own: on copies, within a limit of time and memory.

What such a function changes in place, seeds, leaves behind or breaks stays with it. One that raises, answers with what
is no answer, takes too long or too much memory, or dies, has failed for that batch and no other; the process is then
started anew.
"""

import multiprocessing
from collections.abc import Callable, Mapping
from multiprocessing.connection import Connection
from typing import Any

import numpy as np
import torch
from torch import Tensor

from specklegen.core.values import Positive, Value
from specklegen.datasets.workers import end_with_parent

Batch = Mapping[str, Any]


class Limits(Value):
    """Limits of time and memory for a function.

    Parameters
    ----------
    seconds
        For one batch.
    gibibytes
        Of memory, beside what its process starts with; enforced where the system can (Linux).
    """

    seconds: Positive = 600.0
    gibibytes: Positive = 8.0


class Failed(Exception):  # noqa: N818, it says what a function has done
    """A function did not answer; the text says why."""


class Isolated:
    """A function in a process of its own, which is started with the first batch and kept for the next ones.

    The process is forked where the system can, so that any function will do, closures and lambdas included; it computes
    on one thread, and on no CUDA device that this process has used already.

    Parameters
    ----------
    function
        Of a batch (a nested mapping of tensors) to real[B, n, n].
    check
        Turns what it returns to so many images into an answer, or raises; called in the process of the function.
    limits
        Of each batch.
    """

    def __init__(self, function: Callable[[Any], Any], check: Callable[[Any, int], Tensor], limits: Limits) -> None:
        self._function, self._check, self._limits = function, check, limits
        self._process: Any = None
        self._here: Connection | None = None

    def __call__(self, batch: Batch) -> Tensor:
        """Ask about a batch.

        Raise a `Failed` if there is no answer.
        """
        if self._here is None:
            self._start()
        assert self._here is not None
        try:
            self._here.send(arrays_of(batch))
            if not self._here.poll(self._limits.seconds):
                raise Failed(f"took longer than {self._limits.seconds:g} s")
            answered, outcome = self._here.recv()
        except (EOFError, OSError):
            self._process.join(1)
            code = self._process.exitcode
            self.close()
            raise Failed(f"its process died, exit code {code}") from None
        except Failed:
            self.close()
            raise
        if not answered:
            self.close()
            raise Failed(outcome)
        return torch.from_numpy(outcome)

    def close(self) -> None:
        """End the process, whatever it does."""
        if self._process is not None:
            self._process.kill()
            self._process.join()
            assert self._here is not None
            self._here.close()
        self._process = self._here = None

    def _start(self) -> None:
        forks = "fork" in multiprocessing.get_all_start_methods()
        context = multiprocessing.get_context("fork" if forks else "spawn")
        self._here, there = context.Pipe()
        serve = (there, self._function, self._check, self._limits.gibibytes)
        self._process = context.Process(target=_serve, args=serve, daemon=True)
        self._process.start()
        there.close()  # so that its end is heard of


def _serve(there: Connection, function: Callable, check: Callable, gibibytes: float) -> None:
    """Answer one batch after the other, until nobody asks."""
    end_with_parent()
    torch.set_num_threads(1)  # threads do not survive a fork
    _limit_memory(gibibytes)
    while True:
        try:
            batch = there.recv()
        except EOFError:
            return
        try:
            outcome = True, check(function(tensors_of(batch)), len(batch["object"])).numpy()
        except BaseException as error:  # noqa: BLE001, whatever it raises is its own
            outcome = False, f"{type(error).__name__}: {next(iter(str(error).splitlines()), '')}"
        there.send(outcome)


def _limit_memory(gibibytes: float) -> None:
    try:
        import resource

        with open("/proc/self/statm") as file:
            held = int(file.read().split()[0]) * resource.getpagesize()
        most = held + int(gibibytes * 2**30)
        resource.setrlimit(resource.RLIMIT_AS, (most, most))
    except (ImportError, OSError, ValueError):  # a system that has no such limit, or a stricter one
        pass


def arrays_of(batch: Any) -> Any:
    """Copy the tensors of a nested mapping into arrays; other things stay."""
    if isinstance(batch, Mapping):
        return {name: arrays_of(each) for name, each in batch.items()}
    return batch.detach().cpu().numpy().copy() if isinstance(batch, Tensor) else batch


def tensors_of(batch: Any) -> Any:
    """Turn the arrays of a nested mapping into tensors."""
    if isinstance(batch, Mapping):
        return {name: tensors_of(each) for name, each in batch.items()}
    return torch.from_numpy(batch) if isinstance(batch, np.ndarray) else batch


def copy_of(batch: Any) -> Any:
    """Copy a nested mapping of tensors to the host: nothing done in place to it reaches the original."""
    return tensors_of(arrays_of(batch))
