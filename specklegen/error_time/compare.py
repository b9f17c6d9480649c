"""Error against run time in one's own scene: every sampler that serves it, at growing counts, within a time."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial

import numpy as np

from specklegen.core.errors import reject
from specklegen.error_time.estimates import Estimate
from specklegen.error_time.measuring import Cost, measured
from specklegen.error_time.probes import Probes, probes_of
from specklegen.error_time.samplers import SAMPLERS, Sampler
from specklegen.scene.scene import Scene

FACTOR = 4
_WITH_ESTIMATE = 2  # finding what a run implies takes about as long as the run


@dataclass(frozen=True)
class Row:
    """One run of one sampler.

    Attributes
    ----------
    sampler : str
    count : int
        Paths; 0 for a closed form.
    cost : Cost
    standard_error : float
        Root mean square over the probes of the standard error that the run reports, over sqrt(C_pp C_qq).
    """

    sampler: str
    count: int
    cost: Cost
    standard_error: float

    @property
    def efficiency(self) -> float:
        """1 / (variance x CPU seconds): the same at every count where nothing but paths costs time."""
        return 1 / max(self.standard_error**2 * self.cost.cpu_seconds, 1e-300)


def relative_error(probes: Probes, estimate: Estimate) -> float:
    """Root mean square of the standard errors over sqrt(C_pp C_qq), of the estimate itself; NaN where it is dark."""
    scale = probes.scale(estimate.value)
    if not scale.all():
        return float("nan")
    return float(np.sqrt(np.mean(np.square(estimate.standard_error / scale))))


def serving(scene: Scene, probes: Probes) -> list[Sampler]:
    """The samplers that serve a scene."""
    return [sampler for sampler in SAMPLERS if sampler.obstacle(scene, probes) is None]


def compare(
    scene: Scene, *, seconds: float = 20.0, seed: int = 0,
    progress: Callable[[str, int], None] = lambda sampler, count: None,
) -> Iterator[Row]:  # fmt: skip
    """Run every sampler that serves a scene at counts a factor 4 apart, each for its share of a time.

    Parameters
    ----------
    scene
        Any scene.
    seconds
        Processor time for all samplers together; each has two runs at least, so that slow ones may exceed it.
    seed
        Of every run.
    progress
        Called with sampler and count before each run.

    Yields
    ------
    Row
        In the order of the samplers and of their counts. What is compiled or cached once is not counted.
    """
    if not seconds > 0:
        reject("compare seconds", "greater than 0", seconds)
    if not len(scene.lights) or not len(scene.views):
        reject("compare scene", "a scene with lights and views",
               f"{len(scene.lights)} lights, {len(scene.views)} views")
    probes = probes_of(scene)
    samplers = serving(scene, probes)
    for sampler in samplers:
        progress(sampler.name, 64)
        sampler.work(scene, probes, 64, seed)  # compiles, and fills the caches of pilots
        left, count, runs = seconds / len(samplers), sampler.first, 0
        while True:
            progress(sampler.name, count)
            done, cost = measured(partial(sampler.work, scene, probes, count, seed))
            estimate = sampler.estimate(scene, probes, count, seed, done)
            yield Row(sampler.name, count, cost, relative_error(probes, estimate))
            left -= _WITH_ESTIMATE * cost.cpu_seconds
            runs += 1
            if not sampler.counted or (runs > 1 and _WITH_ESTIMATE * FACTOR * cost.cpu_seconds > left):
                break
            count *= FACTOR
