"""What ``specklegen plan`` has answered, kept for the same question: neither planned nor measured twice.

An answer is named by the digest of everything that decides it: the recipe with all that it inherits and all changes,
the number of samples, every file of this package, the versions of libraries, the processor and the cores. What depends
on anything else (pictures in a folder, code or classes of a user's own, packages that are no part of every
installation, a warning that was said) is not kept. The words of a plan are the same to the letter; what it costs was
measured here, when it was answered first.
"""

import hashlib
import json
import sys
import warnings
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from specklegen.cli.output import json_text
from specklegen.core.extras import EXTRAS
from specklegen.core.kept_files import cache_root, keep, kept_content, make_room
from specklegen.core.libraries import arithmetic, package_digest
from specklegen.core.memory import available_memory
from specklegen.core.parallel import thread_count
from specklegen.core.registry import import_paths

_SUFFIX = ".plan"
_MOST, _MOST_BYTES = 500, 2**26
_EVERYWHERE = {"torch"}
"""Packages of an extra whose version every name holds."""


def place_of(table: Mapping[str, Any], samples: int | None) -> Path | None:
    """Return the file of an answer about a recipe's table; None where it could depend on more than its name says."""
    if "specklegen.datasets.recipes.registry" in sys.modules:
        return None  # classes of a user's own may have joined since, under any name
    if any(import_paths(table)) or _names_files(table):
        return None
    decided = [table, samples, package_digest(), arithmetic(), thread_count()]
    key = hashlib.sha256(json.dumps(decided, default=repr).encode())
    return cache_root() / "plans" / (key.hexdigest() + _SUFFIX)


def kept_answer(place: Path | None) -> dict[str, Any] | None:
    """What was answered; None where nothing whole is kept, or memory has become too little for its plans."""
    content = None if place is None else kept_content(place)
    if content is None:
        return None
    answer = json.loads(content)
    # As planning refuses it, which says so.
    return answer if max(each["memory_bytes"] for each in answer["plans"]) <= 0.9 * available_memory() else None


@contextmanager
def keeping(place: Path | None) -> Iterator[dict[str, Any]]:
    """Give an empty answer to fill, which is kept when the block ends, where nothing else than its name decided it."""
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
    if place is None or warned or any(name in sys.modules for name in EXTRAS.keys() - _EVERYWHERE):
        return
    with suppress(OSError):  # a folder that cannot be written costs a plan, and that is what it cost before
        keep(place, json_text(answer).encode())
        make_room(place.parent, _SUFFIX, _MOST, _MOST_BYTES)


def _names_files(table: Any) -> bool:
    """Whether a table has a path anywhere."""
    if isinstance(table, Mapping):
        return "path" in table or any(map(_names_files, table.values()))
    return isinstance(table, list) and any(map(_names_files, table))
