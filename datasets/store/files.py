"""JSON for people, and what the system says when a store cannot be written."""

import contextlib
import errno
import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from specklegen.core.errors import reject

FULL = (errno.ENOSPC, errno.EDQUOT, errno.EROFS, errno.EFBIG)
"""What the system says when nothing more can be written; the next shard would fare no better."""


def json_bytes(value: Any) -> bytes:
    """Write JSON for people, the same for equal values in the same order."""
    return json.dumps(value, indent=2).encode()


def no_room(error: BaseException | None) -> bool:
    """Whether an error, or what caused it, is that nothing more can be written."""
    while error is not None:
        if isinstance(error, OSError) and error.errno in FULL:
            return True
        error = error.__cause__
    return False


@contextlib.contextmanager
def writing(folder: Path) -> Iterator[None]:
    """Turn what the system says while a store is made or grown into an error that names the folder.

    Raises
    ------
    RuleError
        If a file or folder could not be written.
    """
    try:
        yield
    except OSError as error:
        remedy = f"The system says: {error}."
        if no_room(error):
            remedy += " Make room, then run the same command again: what is stored is kept."
        reject("generate.folder", "in a place where you can write", str(folder), remedy)
