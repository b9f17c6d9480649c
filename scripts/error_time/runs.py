"""Run every method on a scene at growing budgets, and judge each run by the frozen reference."""

from collections.abc import Iterator
from dataclasses import asdict, dataclass, fields
from functools import partial

import numpy as np

from specklegen.error_time import FACTOR, Estimate, Probes, Sampler, measured, serving

from .comparisons import COMPARISONS
from .references import Reference, load
from .scenes import Case

BUDGETS = 5
"""At least so many, as far apart as those of ``compare``."""
_REPEATS = 16
_FIRST_SEED = 1000


@dataclass(frozen=True)
class Row:
    """One method at one budget, judged on one quantity.

    Attributes
    ----------
    scene, method : str
    quantity : str
        "intensity" (of the points) or "tilt covariance" (between points).
    count : int
        Paths, or placements of the wave solver; 0 for a closed form.
    repeats : int
        Runs with seeds of their own.
    error : float
        Root mean square of |C - reference| over sqrt(C_pp C_qq), over runs and entries.
    reported : float
        The same of the standard errors that the runs report.
    floor : float
        The same of the reference's own standard error: no error below it can be seen.
    cpu_seconds, wall_seconds : float
        Medians over the runs.
    memory_bytes : int
        Largest growth of the process; -1 where unknown.
    """

    scene: str
    method: str
    quantity: str
    count: int
    repeats: int
    error: float
    reported: float
    floor: float
    cpu_seconds: float
    wall_seconds: float
    memory_bytes: int

    @property
    def efficiency(self) -> float:
        """1 / (variance x processor seconds), by the variance that the runs report."""
        return 1 / max(self.reported**2 * self.cpu_seconds, 1e-300)

    @classmethod
    def read(cls, table: dict[str, str]) -> "Row":
        """From a line of the CSV."""
        return cls(**{field.name: field.type(table[field.name]) for field in fields(cls)})

    def written(self) -> dict[str, object]:
        """For a line of the CSV."""
        return asdict(self) | {"efficiency": self.efficiency}


def methods(case: Case) -> list[Sampler]:
    """All samplers that serve a scene, and the comparisons that apply."""
    return serving(case.scene, case.probes) + [COMPARISONS[name] for name in case.comparisons]


def run(name: str, case: Case, longest: float, *, budgets: int = BUDGETS) -> Iterator[Row]:
    """Judge every method that applies to a scene.

    Parameters
    ----------
    name, case
        The scene.
    longest
        Processor seconds of one run up to which a method gets another budget; a quarter of it for comparisons.
    budgets
        So many each has in any case.
    """
    reference = load(name)
    for method in methods(case):
        share = longest / 4 if method.name in COMPARISONS else longest
        yield from _method(name, case, reference, method, share, budgets)


def _method(
    name: str, case: Case, reference: Reference, method: Sampler, longest: float, budgets: int
) -> Iterator[Row]:
    """Budgets of one method, repeated with other seeds while that takes less than the longest run."""
    method.work(case.scene, case.probes, method.first, 0)  # compiles, and fills the caches of pilots
    count, budget = method.first, 0
    while True:
        found, costs = [], []
        while not found or (len(found) < _REPEATS and sum(c.cpu_seconds for c in costs) < longest):
            seed = _FIRST_SEED * (budget + 1) + len(found)
            done, cost = measured(partial(method.work, case.scene, case.probes, count, seed))
            found.append(method.estimate(case.scene, case.probes, count, seed, done))
            costs.append(cost)
            if not method.counted:
                break
        cpu, wall = (float(np.median([getattr(c, key) for c in costs])) for key in ("cpu_seconds", "wall_seconds"))
        memory = max(-1 if c.memory_bytes is None else c.memory_bytes for c in costs)
        for quantity, entries in quantities(case.probes).items():
            error, reported, floor = judged(case.probes, entries, found, reference)
            yield Row(name, method.name, quantity, count, len(found), error, reported, floor, cpu, wall, memory)
        budget += 1
        if not method.counted or (budget >= budgets and FACTOR * cpu > longest):
            return
        count *= FACTOR


def quantities(probes: Probes) -> dict[str, slice]:
    """Name to the entries that it is judged on."""
    n = len(probes.points)
    return {"intensity": slice(0, n), "tilt covariance": slice(n, None)}


def judged(
    probes: Probes, entries: slice, found: list[Estimate], reference: Reference
) -> tuple[float, float, float]:
    """Root mean squares over the reference's sqrt(C_pp C_qq): of the true, the reported and the reference's error."""
    scale = probes.scale(reference.value)[entries]

    def rms(parts: list[np.ndarray]) -> float:
        return float(np.sqrt(np.mean(np.square(np.abs(np.array(parts)[:, entries] / scale)))))

    return (
        rms([each.value - reference.value for each in found]),
        rms([each.standard_error for each in found]),
        rms([reference.standard_error]),
    )
