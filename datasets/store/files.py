"""Files that appear whole: written under a temporary name, then renamed; and what killed processes leave of them.

A temporary name is ``<name>.<32 hexadecimal digits>.partial``, as zarr gives its own. Only such names, and only
where a store writes, are ever deleted: other files in the folder of a store belong to its user.
"""

import contextlib
import errno
import json
import re
import uuid
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from specklegen.core.errors import reject

_TEMPORARY = re.compile(r".+\.[0-9a-f]{32}\.partial")

FULL = (errno.ENOSPC, errno.EDQUOT, errno.EROFS, errno.EFBIG)
"""What the system says when nothing more can be written; the next shard would fare no better."""


def write_whole(file: Path, data: bytes) -> None:
    """Write a file so that it is there whole, as it was before, or not at all."""
    temporary = file.with_name(f"{file.name}.{uuid.uuid4().hex}.partial")
    try:
        temporary.write_bytes(data)
        temporary.replace(file)
    except BaseException:
        temporary.unlink(missing_ok=True)
        raise


def json_bytes(value: Any) -> bytes:
    """Write JSON for people, the same for equal values in the same order."""
    return json.dumps(value, indent=2).encode()


def is_temporary(file: Path) -> bool:
    """Whether a name is one that a writer of stores gives to a file that is not yet whole."""
    return _TEMPORARY.fullmatch(file.name) is not None


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
        said = f"The system says: {error}."
        if no_room(error):
            said += " Make room, then run the same command again: what is stored is kept."
        reject("generate.folder", "in a place where you can write", str(folder), said)
