"""What a call costs: processor time, wall time, and by how much the process grew."""

import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

Result = TypeVar("Result")
_STATUS, _RESET = Path("/proc/self/status"), Path("/proc/self/clear_refs")


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
    before = _resident("VmRSS", reset=True)
    wall, cpu = time.perf_counter(), time.process_time()
    result = call()
    cpu, wall = time.process_time() - cpu, time.perf_counter() - wall
    most = _resident("VmHWM")
    grown = None if before is None or most is None else max(most - before, 0)
    return result, Cost(cpu, wall, grown)


def _resident(key: str, *, reset: bool = False) -> int | None:
    """Bytes that Linux reports under a key; the peak, VmHWM, counts from the last reset."""
    # Not getrusage: its maximum cannot be reset.
    try:
        if reset:
            _RESET.write_text("5")
        lines = dict(line.split(":", 1) for line in _STATUS.read_text().splitlines())
        return int(lines[key].split()[0]) * 1024
    except (OSError, KeyError):
        return None
