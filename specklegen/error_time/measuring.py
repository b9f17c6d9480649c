"""Cost of a call: CPU time, wall time, and by how much the process grew."""

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeVar

from specklegen.core.memory import resident_memory

Result = TypeVar("Result")


@dataclass(frozen=True)
class Cost:
    """Cost of one call.

    Attributes
    ----------
    cpu_seconds : float
        Processor time of this process, all its threads together; what other programs do hardly matters to it.
    wall_seconds : float
    memory_bytes : int or None
        Largest growth of the resident memory during the call; None where the system does not tell (Linux does).
    """

    cpu_seconds: float
    wall_seconds: float
    memory_bytes: int | None


def measured(call: Callable[[], Result]) -> tuple[Result, Cost]:
    """Make a call; its result and its cost."""
    before = _memory()
    wall, cpu = time.perf_counter(), time.process_time()
    result = call()
    cpu, wall = time.process_time() - cpu, time.perf_counter() - wall
    after = _memory()
    return result, Cost(cpu, wall, max(after[1] - before[0], 0) if before and after else None)


def _memory() -> tuple[int, int] | None:
    try:
        return resident_memory()
    except (OSError, KeyError):
        return None
