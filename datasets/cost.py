"""What a data set will cost, before anything is rendered: bytes, seconds, memory.

Seconds come from rendering a few samples of media of their own, so they hold for the machine at hand.
"""

import resource
import time
from dataclasses import dataclass

import numpy as np

from specklegen.datasets.protocol import stored_arrays
from specklegen.datasets.recipe import Recipe
from specklegen.parallel import thread_count

_PROBES = 3
_COUNTS_RATIO = 1.6  # zstd with bit shuffling on camera counts
_WORKER_BYTES = 400 * 2**20  # interpreter, torch, compiled kernels


@dataclass(frozen=True)
class Cost:
    """Predicted cost of a data set on this machine."""

    samples: int
    bytes: int
    seconds: float
    memory_bytes: int

    def explain(self) -> str:
        """In one sentence."""
        return (
            f"{self.samples} samples: about {self.bytes / 2**20:.0f} MiB on disk, {self.seconds:.0f} s on "
            f"{thread_count()} cores, {self.memory_bytes / 2**20:.0f} MiB of memory."
        )


def sample_bytes(recipe: Recipe) -> float:
    """Bytes a stored sample takes."""
    total = 0.0
    for spec in stored_arrays(recipe).values():
        size = float(np.prod(spec.shape))
        total += size * 2 / _COUNTS_RATIO if spec.counts else size * np.dtype(spec.dtype).itemsize
    return total + 400


def cost(recipe: Recipe, samples: int, seed: int = 0) -> Cost:
    """Predict the cost of ``samples`` samples of the train split."""
    recipe.sample(seed, "train", 0)
    probes = [n * recipe.media_group for n in range(1, _PROBES + 1)]  # each with a medium of its own
    fresh = _seconds(recipe, seed, probes)
    again = [n + (recipe.media or recipe.media_group - 1) for n in probes]
    shared = fresh if again == probes else _seconds(recipe, seed, again)
    media = recipe.media_of(samples)
    seconds = (media * fresh + (samples - media) * shared) / thread_count()
    used = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024
    return Cost(samples, int(samples * sample_bytes(recipe)), seconds, used + thread_count() * _WORKER_BYTES)


def _seconds(recipe: Recipe, seed: int, indices: list[int]) -> float:
    begin = time.process_time()
    for index in indices:
        recipe.sample(seed, "train", index)
    return (time.process_time() - begin) / len(indices)
