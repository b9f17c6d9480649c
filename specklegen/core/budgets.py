"""How many paths an error or a time allows, decided before the run.

The count is chosen from a pilot on a random stream of its own and then simply run, so that stopping is never
decided by the numbers that are averaged: no bias. The result is that of the count alone, which its report
states; ``paths=`` that count gives the same bits on any machine of the type.
"""

import time
from collections.abc import Callable

from specklegen.core.arguments import real_number, whole_number
from specklegen.core.errors import reject

DEFAULT_PATHS = 100_000
"""Paths where neither a count nor an error nor a time is asked for."""
MARGIN = 1.1  # of paths over what the pilot asks: its own error is a few per cent
_PILOT_SHARE = 0.1  # of a time budget
MOST_SECONDS = 30 * 86400.0
"""Predicted time of one result, on one core, above which it is refused: nobody waits for it."""


def checked_budget(owner: str, paths: int | None, rel_error: float | None, seconds: float | None) -> None:
    """Refuse a budget out of range.

    Raises
    ------
    RuleError
        Naming the argument.
    """
    if paths is not None and (rel_error is not None or seconds is not None):
        reject(f"{owner} paths", "left out where rel_error or seconds is given", paths)
    if paths is not None:
        whole_number(f"{owner} paths", paths, 1)
    if rel_error is not None and not 0 < real_number(f"{owner} rel_error", rel_error) < 1:
        reject(f"{owner} rel_error", "between 0 and 1", rel_error)
    if seconds is not None and not real_number(f"{owner} seconds", seconds) > 0:
        reject(f"{owner} seconds", "greater than 0", seconds)


def paths_for(
    default: int,
    paths: int | None,
    rel_error: float | None,
    seconds: float | None,
    pilot: Callable[[int], float],
    pilot_paths: int = 4096,
) -> int:
    """Paths that a budget allows: those of the error asked for, at most those of the time allowed.

    Parameters
    ----------
    default, paths, rel_error, seconds
        As asked for; ``default`` where nothing is.
    pilot
        Runs a pilot of a number of paths, of which it is a pure function, and returns the relative error reached.
    pilot_paths
        Size of the pilot from which an error is predicted.
    """
    if paths is not None:
        return paths
    wanted = default
    if rel_error is not None:
        error = pilot(pilot_paths)
        wanted = max(64, round(MARGIN * pilot_paths * (error / rel_error) ** 2)) if error > 0 else pilot_paths
    if seconds is not None:
        allowed = _paths_within(seconds, pilot)
        wanted = min(wanted, allowed) if rel_error is not None else allowed
    return wanted


def _paths_within(seconds: float, pilot: Callable[[int], float]) -> int:
    """Paths that take a given time here, from pilots of growing size that take a tenth of it together."""
    pilot(64)  # compiles
    started = time.perf_counter()
    count, fixed = 64, 0.0
    while True:
        before = time.perf_counter()
        pilot(count)
        took = time.perf_counter() - before
        spent = time.perf_counter() - started
        if spent + 2 * took >= _PILOT_SHARE * seconds or count >= 2**30:
            # What the pilot before took, half as large, shows how much of it grows with the count.
            growing = max(2 * (took - fixed), 0.2 * took) if fixed else took
            return max(64, int(0.9 * count * max(seconds - spent - (took - growing), 0.0) / max(growing, 1e-9)))
        count, fixed = 2 * count, took


def require_time(owner: str, seconds: float, what: str, remedy: str) -> None:
    """Refuse what would take more than a month of one core, before it is begun.

    Raises
    ------
    RuleError
        With the days it takes, and what to do instead.
    """
    if not seconds <= MOST_SECONDS:
        reject(owner, f"done within {MOST_SECONDS / 86400:.0f} days", f"{seconds / 86400:.2g} days for {what}", remedy)
