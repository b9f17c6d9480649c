"""Rows of a table from many tasks, by several processes, kept as soon as each is there."""

import csv
import multiprocessing
import time
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any


def write_rows(
    one: Callable[[Any], list[Any] | None], tasks: Iterable[Any], out: Path, workers: int, seconds: float,
    head: Sequence[str] | None = None,
) -> None:  # fmt: skip
    """Write a row for each task, in their order, until all are done or the time is over; None is no row."""
    begun = time.time()
    with multiprocessing.get_context("fork").Pool(workers) as pool, out.open("w", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        if head is not None:
            writer.writerow(head)
        for row in pool.imap(one, tasks):
            if row is not None:
                writer.writerow(row)
                file.flush()
            if time.time() - begun > seconds:
                break
        pool.terminate()
