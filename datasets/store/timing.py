"""Time of samples on this machine, from a few rendered now; and the number of processes that pays."""

import time

from specklegen.core.parallel import thread_count
from specklegen.datasets.sample_schema import Renderable

START = 3.5
"""Seconds until a worker renders: it imports what this process has imported, and loads the same kernels."""


def sample_seconds(recipe: Renderable, seed: int, split: str, samples: int) -> tuple[int, float, float]:
    """Media of so many samples, and seconds for a sample of a new medium and for another one of the same."""
    counted = getattr(recipe, "media_of", None)
    media = counted(samples) if counted else samples
    recipe.sample(seed, split, 0)  # imports and compilation
    fresh = _timed(recipe, seed, split, 1)
    return media, fresh, min(fresh, _timed(recipe, seed, split, 1)) if media < samples else fresh


def processes_for(recipe: Renderable, seed: int, split: str, samples: int) -> int:
    """Processes by which samples are there soonest: all cores where they gain more than their start, else one."""
    cores = thread_count(None)
    if cores == 1:
        return 1
    try:
        media, fresh, again = sample_seconds(recipe, seed, split, samples)
    except Exception:  # noqa: BLE001 - whoever renders these samples tells which of them fails
        return cores
    seconds = min(media, samples) * fresh + max(samples - media, 0) * again
    return cores if seconds * (1 - 1 / cores) > START else 1


def _timed(recipe: Renderable, seed: int, split: str, index: int) -> float:
    begin = time.perf_counter()
    recipe.sample(seed, split, index)
    return time.perf_counter() - begin
