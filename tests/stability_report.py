"""Run every stiff and extreme case and write docs/notes/stability.md.

    python tests/stability_report.py [--slow] [--out docs/notes/stability.md]

Each row is a function of tests/stability/; tests/test_stability.py runs the same ones. Without ``--slow`` the
rows that take minutes are named as not run.
"""

import argparse
import platform
import sys
import time
from collections.abc import Callable
from pathlib import Path

from stability import FAST, SLOW
from stability.row import FALSE_ALARM, Row
from tqdm import tqdm

INTRODUCTION = """# Numerical stability: all rows

The rows behind [stability.md](../stability.md).

Stiff and extreme cases, each with the right answer and where it comes from. A Monte Carlo row passes within
Student's bound at a false-alarm rate of {alarm:g}, shared by the row's comparisons; the worst of them is shown. A row
whose right answers all lie within its noise could not fail, and does not pass.
Written by `python tests/stability_report.py{options}` on {machine}; times are those of that machine, busy with
other work. The same functions (`tests/stability/`) are the tests of `tests/test_stability.py`.

{passed} of {run} rows pass or are refused with the reason{rest}.

| case | right answer | source | ours | error | result | s |
|---|---|---|---|---|---|---|
"""


def timed(function: Callable[[], Row]) -> tuple[Row, float]:
    """A row and its seconds; an exception is a failed row."""
    started = time.perf_counter()
    try:
        row = function()
    except Exception as error:
        row = Row(function.__name__, "a result", "", f"{type(error).__name__}: {error}", "exception", False)
    return row, time.perf_counter() - started


def line(row: Row, seconds: float) -> str:
    """One line of the table."""
    cells = (row.case, row.right, row.source, row.ours, row.error, row.verdict, f"{seconds:.1f}")
    return "| " + " | ".join(" ".join(cell.replace("|", "\\|").split()) for cell in cells) + " |"


def main(arguments: list[str] | None = None) -> int:
    """Read the command line, run, write; return 1 where a row fails."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--slow", action="store_true", help="also the rows that take minutes")
    parser.add_argument("--out", type=Path, default=Path("docs/notes/stability.md"), help="the page to write")
    chosen = parser.parse_args(arguments)
    functions = (*FAST, *SLOW) if chosen.slow else FAST
    found = [timed(function) for function in tqdm(functions, unit="row")]
    passed = sum(row.passed for row, _ in found)
    rest = "" if chosen.slow else f"; not run (`--slow`): {', '.join(f.__name__ for f in SLOW)}"
    page = INTRODUCTION.format(alarm=FALSE_ALARM, options=" --slow" if chosen.slow else "", machine=platform.machine(),
                               passed=passed, run=len(found), rest=rest)  # fmt: skip
    chosen.out.write_text(page + "\n".join(line(*each) for each in found) + "\n", encoding="utf-8")
    return int(passed < len(found))


if __name__ == "__main__":
    sys.exit(main())
