"""The pace of this machine, by a yardstick that is run once: its CPU seconds over those of the reference.

Three loops of about 5 ms, the best of three each: Python alone, transforms, and exponentials. Their mean ratio to the
times of the reference scales the seconds that plans state. No choice depends on it. It is cached beside other
results, and only there: without a cache on disk plans state the seconds of the reference.
"""

import time
from collections.abc import Callable, Mapping
from functools import lru_cache

import numpy as np

from specklegen.core import nanoseconds
from specklegen.core.libraries import arithmetic
from specklegen.disk_cache import folder_of, name_of, read, write

_REPEATS = 3
_SLOWEST = 50.0  # a machine that was busy beyond all measure


def _python() -> None:
    x = 0.3
    for _ in range(100_000):
        x = 3.7 * x * (1.0 - x)


def _transforms(waves: np.ndarray) -> None:
    for _ in range(3):
        np.fft.fft2(waves)


def _exponentials(turns: np.ndarray) -> None:
    for _ in range(6):
        np.exp(turns)


def loops() -> dict[str, Callable[[], None]]:
    """Return the loops of the yardstick by their names."""
    waves, turns = np.ones((256, 256), np.complex128), 1j * np.linspace(0, 6, 2**15)
    return {"python": _python, "transforms": lambda: _transforms(waves), "exponentials": lambda: _exponentials(turns)}


REFERENCE = {"python": 3.6e-3, "transforms": 4.2e-3, "exponentials": 2.9e-3}
"""CPU seconds of the loops where the nanoseconds of :mod:`specklegen.core.nanoseconds` hold."""


def measured_pace() -> float:
    """Run the yardstick: CPU seconds here over those of the reference, the geometric mean of all loops."""
    ratios = []
    for name, loop in loops().items():
        spent = []
        for _ in range(_REPEATS):
            start = time.process_time()
            loop()
            spent.append(time.process_time() - start)
        ratios.append(min(spent) / REFERENCE[name])
    return float(np.clip(np.exp(np.mean(np.log(ratios))), 1 / _SLOWEST, _SLOWEST))


@lru_cache(1)
def machine_pace() -> float:
    """Return the pace of this machine from the cache, or measured now and written there; 1 where nothing is cached.

    A process asks once.
    """
    if folder_of("pace") is None:
        return 1.0
    name = name_of("pace of a machine", sorted(REFERENCE.items()), arithmetic())
    content = read("pace", name)
    if content is not None:
        return float(content)
    pace = measured_pace()
    write("pace", name, repr(pace).encode())
    return pace


def seconds(operations: Mapping[str, float], threads: int) -> float:
    """Seconds that operations take on so many threads of this machine."""
    return machine_pace() * nanoseconds.seconds(operations, threads)
