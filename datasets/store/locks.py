"""Claims: which process works on which shard, as locked bytes of one file.

Byte n of the file is locked while piece n is being worked on. The operating system drops the lock with the
process, however it dies, so that no claim ever goes stale. Claims only save double work and tell orphaned
temporary files from live ones: correctness rests on whole files that appear by renaming.

The locks are POSIX record locks: they exclude processes, on one machine or over NFS with a lock service,
and not threads of one process. A process holds one claim on a file at a time.
"""

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Literal

try:
    import fcntl
except ImportError:  # Windows
    fcntl = None

LockState = Literal["held", "busy", "unlockable"]


@contextmanager
def claim(file: Path, number: int, wait: bool = False) -> Iterator[LockState]:
    """LockState piece ``number``; "busy" if another process has it, "unlockable" where there are no locks."""
    if fcntl is None:
        yield "unlockable"
        return
    descriptor = os.open(file, os.O_RDWR)
    try:
        yield _lock(descriptor, number, wait)
    finally:
        os.close(descriptor)


def _lock(descriptor: int, number: int, wait: bool) -> LockState:
    assert fcntl is not None
    try:
        fcntl.lockf(descriptor, fcntl.LOCK_EX | (0 if wait else fcntl.LOCK_NB), 1, number, os.SEEK_SET)
    except (BlockingIOError, PermissionError):
        return "busy"
    except OSError:
        return "unlockable"
    return "held"
