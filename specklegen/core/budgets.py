"""Number of paths that an error or a time allows, decided before the run.

The count is chosen from a pilot on a random stream of its own and then simply run, so that stopping is never
decided by the numbers that are averaged: no bias. The result is that of the count alone, which its report
states; ``paths=`` that count gives the same bits on any machine of the type.
"""

import logging
import time
from collections.abc import Callable, Collection
from dataclasses import dataclass, replace
from typing import Literal, TypedDict

import numpy as np

from specklegen.core.arguments import instance, real_number, whole_number
from specklegen.core.errors import reject
from specklegen.core.parallel import thread_count
from specklegen.core.random_streams import Seed, Stream, stream_key

_LOG = logging.getLogger(__name__)

DEFAULT_PATHS = 100_000
"""Paths where neither a count nor an error nor a time is asked for."""
MARGIN = 1.1  # of paths over what the pilot asks: its own error is a few per cent
_PILOT_SHARE = 0.1  # of a time budget
TOLD_SECONDS = 10.0
"""Predicted time of one result above which it is logged before it is begun."""
_FEWEST = 64  # paths that a pilot may ask for: one a batch
_PILOT_PATHS = 4096  # from which an error is predicted
MOST_SECONDS = 30 * 86400.0
"""Predicted time of one result, on one core, above which it is refused: nobody waits for it."""

_BOUNDS = {"rel_error": (1e-9, 1.0), "seconds": (0.0, MOST_SECONDS), "tolerance": (0.0, 1.0)}
"""Both excluded."""

Reverse = bool | Literal["auto"]


@dataclass(frozen=True, kw_only=True)
class Budget:
    """Cost that the result of a verb may have, and its seed; most verbs take one as ``budget``.

    Any field may also be given to the verb by its name, and then replaces that of the budget:
    ``render(scene, paths=1000)``, ``render(scene, budget=budget, seed=3)``. A verb refuses fields that it does not use.

    Parameters
    ----------
    paths
        Random paths to trace; 100 000 by default, unless ``rel_error`` or ``seconds`` sets their number. Errors fall
        with the root of it.
    rel_error
        Instead of ``paths``: as many as a pilot says the verb's error takes to fall to this. What error it is stands
        with the verb, and its result states what was reached. The number is fixed before the run, so that the estimate
        stays unbiased.
    seconds
        Instead, or as a limit to ``rel_error``: as many paths as this time allows on this machine.
    seed
        A whole number, or a sequence of them. The result is a function of it, the number of paths and the verb's other
        arguments.
    threads
        Threads, by default all cores that the process may run on; the result does not depend on their number.
    reverse
        Whether paths count backwards too (coherent backscattering); "auto" leaves that out where it adds less than
        ``tolerance`` of the intensity.
    tolerance
        Share of the intensity below which "auto" leaves a part out; smaller is slower. Verbs that render take
        ``rel_error`` for it.

    Examples
    --------
    >>> import specklegen as sg
    >>> slab = sg.Slab(thickness=1000.0, mean_free_path=100.0, scatterer=sg.media.HenyeyGreenstein(0.9))
    >>> budget = sg.results.Budget(paths=2000, seed=1)
    >>> curve = sg.memory_effect(slab, wavelength=0.5, tilts=[0.0, 1e-4], budget=budget)
    >>> other = sg.memory_effect(slab, wavelength=0.5, tilts=[0.0, 1e-4], budget=budget, seed=2)
    >>> curve.paths, other.paths, bool((curve.intensity == other.intensity).all())
    (2000, 2000, False)
    """

    paths: int | None = None
    rel_error: float | None = None
    seconds: float | None = None
    seed: Seed = 0
    threads: int | None = None
    reverse: Reverse = "auto"
    tolerance: float = 0.02

    def __post_init__(self) -> None:
        if self.paths is not None:
            if self.rel_error is not None or self.seconds is not None:
                reject("Budget.paths", "left out if rel_error or seconds is given", self.paths)
            # Python's int: one of NumPy would have every kernel compiled again, for its type.
            object.__setattr__(self, "paths", whole_number("Budget.paths", self.paths, 1))
        for name, (least, most) in _BOUNDS.items():
            value = getattr(self, name)
            if value is None and name != "tolerance":
                continue
            number = real_number(f"Budget.{name}", value)
            if not least < number < most:
                reject(f"Budget.{name}", f"between {least:g} and {most:g}", value)
            object.__setattr__(self, name, number)
        stream_key(self.seed, Stream.PATHS)
        thread_count(self.threads)
        if isinstance(self.reverse, bool | np.bool_):
            object.__setattr__(self, "reverse", bool(self.reverse))
        elif not isinstance(self.reverse, str) or self.reverse != "auto":
            reject("Budget.reverse", 'True, False or "auto"', self.reverse)

    def count(self, pilot: Callable[[int], float], least: int = 1) -> int:
        """Paths that the budget allows: those of the error asked for, at most those of the time allowed.

        Parameters
        ----------
        pilot
            Runs a pilot of a number of paths, of which it is a pure function, and returns the error reached.
        least
            Paths that the estimate takes at least.
        """
        if self.paths is not None:
            return whole_number("Budget.paths", self.paths, least)
        wanted = DEFAULT_PATHS
        if self.rel_error is not None:
            error = pilot(_PILOT_PATHS)
            wanted = _PILOT_PATHS if not error > 0 else round(MARGIN * _PILOT_PATHS * (error / self.rel_error) ** 2)
        if self.seconds is not None:
            allowed = paths_within(self.seconds, pilot)
            wanted = allowed if self.rel_error is None else min(wanted, allowed)
        return max(wanted, _FEWEST, least)


class BudgetFields(TypedDict, total=False):
    """Fields of a :class:`Budget`, as verbs take them by name."""

    paths: int | None
    rel_error: float | None
    seconds: float | None
    seed: Seed
    threads: int | None
    reverse: Reverse
    tolerance: float


def budget_of(owner: str, budget: Budget | None, given: BudgetFields, unused: Collection[str] = ()) -> Budget:
    """Return the budget of a verb: fields given by name in place of those of the budget.

    Raise a `RuleError` for a field that the verb does not use and a `TypeError` for a name that is no field.
    """
    result = Budget(**given) if budget is None else replace(instance(f"{owner} budget", budget, Budget), **given)
    for name in unused:
        if getattr(result, name) != getattr(Budget, name):
            reject(f"{owner} {name}", f"left out: {owner} does not use it", getattr(result, name))
    return result


def paths_within(seconds: float, pilot: Callable[[int], float]) -> int:
    """Paths that take a given time here, from pilots of growing size that take a tenth of it together."""
    pilot(_FEWEST)  # compiles
    started = time.perf_counter()
    count, fixed = _FEWEST, 0.0
    while True:
        before = time.perf_counter()
        pilot(count)
        took = time.perf_counter() - before
        spent = time.perf_counter() - started
        if spent + 2 * took >= _PILOT_SHARE * seconds or count >= 2**30:
            # What the pilot before took, half as large, shows how much of it grows with the count.
            growing = max(2 * (took - fixed), 0.2 * took) if fixed else took
            return max(_FEWEST, int(0.9 * count * max(seconds - spent - (took - growing), 0.0) / max(growing, 1e-9)))
        count, fixed = 2 * count, took


def require_time(owner: str, seconds: float, what: str, remedy: str) -> None:
    """Refuse work of more than a month of one core, and log work of a while, before it is begun."""
    if not seconds <= MOST_SECONDS:
        reject(owner, f"done within {MOST_SECONDS / 86400:.0f} days", f"{seconds / 86400:.2g} days for {what}", remedy)
    if seconds > TOLD_SECONDS:
        _LOG.warning("%s: about %.2g s for %s. %s", owner, seconds, what, remedy)
