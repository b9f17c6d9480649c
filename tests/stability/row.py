"""One row of the stability report: a case, its right answer, ours, and a verdict that follows from the two."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.stats import t as student

from specklegen.core.errors import RuleError
from specklegen.core.statistics import BATCHES

FALSE_ALARM = 1e-6  # chance that a right build fails a row, shared by the row's comparisons


@dataclass(frozen=True)
class Row:
    """What was asked of the engine, and what it said.

    Attributes
    ----------
    case, right, source : str
        What is run; the right answer; where that comes from.
    ours, error : str
        What the engine said; how far off it is, with what is allowed.
    refused : str
        Message of the error, for a case that is to be refused.
    passed : bool
        Whether the error is within what is allowed, or the refusal names what it must.
    """

    case: str
    right: str
    source: str
    ours: str
    error: str
    passed: bool
    refused: str = ""

    @property
    def verdict(self) -> str:
        """One of "pass", "refused: why" and "FAIL"."""
        if not self.passed:
            return "**FAIL**"
        return f"refused: {self.refused}" if self.refused else "pass"


def within(case: str, source: str, right: Any, ours: Any, allowed: float, *, relative: bool = True) -> Row:
    """A deterministic comparison: the largest |ours - right| (over the largest |right|) is at most ``allowed``."""
    right_, ours_ = np.broadcast_arrays(np.asarray(right), np.asarray(ours))
    scale = float(np.abs(right_).max()) if relative else 1.0
    gaps = np.abs(ours_ - right_) / scale
    worst = int(gaps.argmax()) if gaps.size else 0
    error = float(gaps.max(initial=0.0))
    return Row(case, _number(right_.flat[worst]), source, _number(ours_.flat[worst]),
               f"{error:.2g}{' relative' if relative else ''}, allowed {allowed:.2g}",
               bool(error <= allowed))  # fmt: skip


def measured(
    case: str, source: str, right: Any, ours: Any, standard_error: Any, *, slack: Any = 0.0, batches: int = BATCHES
) -> Row:
    """A Monte Carlo comparison: every |ours - right| - slack is below Student's bound at FALSE_ALARM. A row whose right
    answers all lie within what it allows could not fail, if ours were 0: such a row does not pass. Of the others the
    worst one that stands above its noise is shown, with the largest z of all."""
    right_, ours_, error, loose = np.broadcast_arrays(*map(np.asarray, (right, ours, standard_error, slack)))
    bound = float(student.isf(FALSE_ALARM / (2 * ours_.size), batches - 1))
    excess = np.maximum(np.abs(ours_ - right_) - loose, 0.0)
    z = np.divide(excess, error, out=np.where(excess == 0, 0.0, np.inf), where=error > 0)
    able = np.abs(right_) > bound * error + loose
    worst = int(np.where(able, z, -1.0).argmax())
    count = f"; {able.sum()} of {able.size} stand above their noise" if able.size > 1 else ""
    return Row(case, _number(right_.flat[worst]), source, f"{_number(ours_.flat[worst])} ± {error.flat[worst]:.2g}",
               f"{z.max():.2f} standard errors, limit {bound:.2f}{count}" if able.any() else "all of it noise",
               bool(able.any() and np.isfinite(error).all() and np.isfinite(z).all() and z.max() < bound))  # fmt: skip


def holds(case: str, source: str, right: str, checks: dict[str, bool]) -> Row:
    """Facts that are true or not."""
    wrong = [name for name, true in checks.items() if not true]
    return Row(case, right, source, "; ".join(checks), ", ".join(wrong) or "none", not wrong)


def refused(case: str, source: str, calls: Iterable[tuple[Callable[[], Any], Iterable[str]]]) -> Row:
    """Every call must raise the house error, and its message must hold the words given; the first one is shown."""
    messages, wrong = [], []
    for call, words in calls:
        try:
            call()
        except RuleError as error:
            messages.append(str(error))
            wrong += [f"does not say {word!r}: {error}" for word in words if word not in str(error)]
        else:
            wrong.append(f"accepted, without {' or '.join(words)}")
    said = "; ".join(wrong) or "none"
    first = messages[0] if messages else ""
    return Row(case, "an error that names field, rule and value", source, f"{len(messages)} refused", said, not wrong,
               first)  # fmt: skip


def _number(value: Any) -> str:
    value = complex(value)
    return f"{value.real:.6g}" if value.imag == 0 else f"{value:.4g}"
