"""How many paths an error or a time allows, decided before the run.

The count is chosen from a pilot on a random stream of its own and then simply run, so that stopping is never
decided by the numbers that are averaged: no bias. The result is that of the count alone, which its report
states; ``paths=`` that count gives the same bits on any machine of the type.
"""

import logging
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np

from specklegen.core.arguments import real_number, whole_number
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


@dataclass(frozen=True)
class Budget:
    """Cost that a result may have, and its seed: the arguments that the verbs share, checked once.

    Attributes
    ----------
    owner : str
        The verb that is asked, for messages.
    paths : int, optional
        Paths to trace; 100 000 unless ``rel_error`` or ``seconds`` sets their number.
    rel_error : float, optional
        Instead: trace what a pilot says the verb's error takes to fall to this. The count is fixed before the run, so
        the estimate stays unbiased; the result says what was reached.
    seconds : float, optional
        Instead, or as a limit to ``rel_error``: trace what this time allows on this machine.
    seed : int or sequence of them
        The result is a function of it, the number of paths and the verb's other arguments.
    threads : int, optional
        Threads, by default all cores that the process may run on; the result does not depend on it.
    reverse : bool or "auto"
        Whether reversed paths (coherent backscattering) take part; "auto" drops them where they add less than
        ``tolerance`` (physics.md 2).
    tolerance : float
        Relative intensity below which "auto" drops a part.
    least : int
        Paths that the verb's estimate takes at least.
    """

    owner: str
    paths: int | None = None
    rel_error: float | None = None
    seconds: float | None = None
    seed: Seed = 0
    threads: int | None = None
    reverse: Reverse = "auto"
    tolerance: float = 0.02
    least: int = 1

    def __post_init__(self) -> None:
        owner, paths, rel_error, seconds = self.owner, self.paths, self.rel_error, self.seconds
        if paths is not None and (rel_error is not None or seconds is not None):
            reject(f"{owner} paths", "left out where rel_error or seconds is given", paths)
        if paths is not None:
            # Python's int: one of NumPy would have every kernel compiled again, for its type.
            object.__setattr__(self, "paths", whole_number(f"{owner} paths", paths, self.least))
        for name, (least, most) in _BOUNDS.items():
            value = getattr(self, name)
            if value is None and name != "tolerance":
                continue
            number = real_number(f"{owner} {name}", value)
            if not least < number < most:
                reject(f"{owner} {name}", f"between {least:g} and {most:g}", value)
            object.__setattr__(self, name, number)
        stream_key(self.seed, Stream.PATHS)
        thread_count(self.threads)
        if not isinstance(self.reverse, str) or self.reverse != "auto":
            if not isinstance(self.reverse, bool | np.bool_):
                reject("reverse", 'True, False or "auto"', self.reverse)
            object.__setattr__(self, "reverse", bool(self.reverse))

    def count(self, pilot: Callable[[int], float]) -> int:
        """Paths that the budget allows: those of the error asked for, at most those of the time allowed.

        Parameters
        ----------
        pilot
            Runs a pilot of a number of paths, of which it is a pure function, and returns the error reached.
        """
        if self.paths is not None:
            return self.paths
        wanted = DEFAULT_PATHS
        if self.rel_error is not None:
            error = pilot(_PILOT_PATHS)
            wanted = _PILOT_PATHS if not error > 0 else round(MARGIN * _PILOT_PATHS * (error / self.rel_error) ** 2)
        if self.seconds is not None:
            allowed = paths_within(self.seconds, pilot)
            wanted = min(wanted, allowed) if self.rel_error is not None else allowed
        return max(wanted, _FEWEST, self.least)


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
    """Refuse work of more than a month of one core, and log work of a while, before it is begun.

    Raises
    ------
    RuleError
        With the days it takes, and what to do instead.
    """
    if not seconds <= MOST_SECONDS:
        reject(owner, f"done within {MOST_SECONDS / 86400:.0f} days", f"{seconds / 86400:.2g} days for {what}", remedy)
    if seconds > TOLD_SECONDS:
        _LOG.warning("%s: about %.2g s for %s. %s", owner, seconds, what, remedy)
