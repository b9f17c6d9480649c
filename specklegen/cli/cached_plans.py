"""Answers of ``specklegen plan``, cached for the same question: neither planned nor measured twice.

An answer is named by everything that decides it: the recipe with all that it inherits and all changes, the number of
samples, the sources, the versions of libraries, the processor and the cores. What depends on anything else (pictures in
a folder, code or classes of a user's own, packages that are no part of every installation, a warning that was given) is
not cached. The words of a plan are the same to the letter; what it costs was measured here, when it was answered first.
"""

import json
import sys
import warnings
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from specklegen.cli.output import json_text
from specklegen.core.extras import EXTRAS
from specklegen.core.libraries import arithmetic
from specklegen.core.memory import available_memory
from specklegen.core.parallel import thread_count
from specklegen.core.registry import import_paths
from specklegen.disk_cache import name_of, read, source_digest, write

FOLDER = "plans"
_EVERYWHERE = {"torch"}
"""Packages of an extra whose version every name holds."""


def name_of_answer(tables: Any, samples: int | None) -> str | None:
    """Return the file name of an answer about a recipe's tables; None where it could depend on anything else."""
    if "specklegen.datasets.recipes.registry" in sys.modules:
        return None  # classes of a user's own may have joined since, under any name
    if any(import_paths(tables)) or _names_files(tables):
        return None
    sources = source_digest(Path(__file__).with_name("recipes.py"))
    return name_of(sources, arithmetic(), thread_count(), samples, json.dumps(tables, default=repr))


def cached_answer(name: str | None) -> dict[str, Any] | None:
    """Return what was answered; None where nothing is cached, or memory has become too little for its plans."""
    content = read(FOLDER, name) if name else None
    if content is None:
        return None
    answer = json.loads(content)
    # As planning refuses it, which says so.
    return answer if max(plan["memory_bytes"] for plan in answer["plans"]) <= 0.9 * available_memory() else None


@contextmanager
def caching(name: str | None) -> Iterator[dict[str, Any]]:
    """Give an empty answer to fill, which is cached when the block ends, where nothing but its name decided it."""
    answer: dict[str, Any] = {}
    warned, show = [], warnings.showwarning

    def noted(*arguments: Any, **named: Any) -> None:
        warned.append(arguments)
        show(*arguments, **named)

    warnings.showwarning = noted
    try:
        yield answer
    finally:
        warnings.showwarning = show
    if name and not warned and not any(package in sys.modules for package in EXTRAS.keys() - _EVERYWHERE):
        write(FOLDER, name, json_text(answer).encode())


def _names_files(table: Any) -> bool:
    """Return whether a table has a path anywhere."""
    if isinstance(table, Mapping):
        return "path" in table or any(map(_names_files, table.values()))
    return isinstance(table, list) and any(map(_names_files, table))
