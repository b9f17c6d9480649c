"""JSON for people, and what the system says when a store cannot be written."""

import contextlib
import errno
import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from specklegen.core.errors import ToldError, reject

FULL = (errno.ENOSPC, errno.EDQUOT, errno.EROFS, errno.EFBIG)
"""What the system says when nothing more can be written; the next shard would fare no better."""


def json_bytes(value: Any) -> bytes:
    """Write JSON for people, the same for equal values in the same order."""
    return json.dumps(value, indent=2).encode()


def no_room(error: BaseException | None) -> bool:
    """Return whether an error, or what caused it, is that nothing more can be written."""
    while error is not None:
        if isinstance(error, OSError) and error.errno in FULL:
            return True
        error = error.__cause__
    return False


def passing(error: BaseException) -> bool:
    """Return whether a further try may succeed: errors of file systems, and of the network as botocore names them."""
    return isinstance(error, OSError) or any(word in type(error).__name__ for word in ("Connect", "Timeout"))


@contextlib.contextmanager
def reaching(folder: Path) -> Iterator[None]:
    """Turn the error of a file system, or of the library of an address, that gives no answer into one of the folder.

    Raise a `RuleError` if it cannot be reached, or refuses: with the reason and the remedy.
    """
    try:
        yield
    except ToldError:
        raise
    except Exception as error:
        rule, remedy = _refusal(error)
        if not rule:
            raise
        told = f"{type(error).__name__}: {error}".strip().rstrip(".:")
        reject("store.folder", rule, str(folder), f"The system says: {told}. {remedy}")


def _refusal(error: Exception) -> tuple[str, str]:
    """Name what must be so, and the remedy, by the kind of error; those of botocore are known by their names alone."""
    kind = type(error).__name__
    if "Credential" in kind:
        return "at an address with credentials", "Set credentials in the environment, or as options of a UPath."
    if isinstance(error, PermissionError):
        return "readable by you", "Check the permissions of the folder, or the credentials of the address."
    if isinstance(error, TimeoutError) or "Timeout" in kind:
        return "at a server that answers in time", "Try again, or check the network."
    if isinstance(error, ConnectionError) or "Connect" in kind:
        return "at an address that can be reached", "Check the address and the network."
    if isinstance(error, ImportError):
        return "at an address of an installed file system", "Install the package that the system names."
    return ("readable", "Nothing was changed: try again.") if isinstance(error, OSError) else ("", "")


@contextlib.contextmanager
def writing(folder: Path) -> Iterator[None]:
    """Turn what the system says while a store is made or grown into an error that names the folder.

    Raise a `RuleError` if a file or folder could not be written.
    """
    try:
        yield
    except OSError as error:
        remedy = f"The system says: {error}."
        if no_room(error):
            remedy += " Make room, then run the same command again: stored samples are kept."
        reject("generate.folder", "a folder in which you can write", str(folder), remedy)
