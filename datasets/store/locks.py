"""Claims: which process works on which shard, as locked bytes of one file.

Byte n of the file is locked while piece n is being worked on. The operating system drops the lock with the
process, however it dies, so that no claim ever goes stale. Claims only save double work and tell orphaned
temporary files from live ones: correctness rests on whole files that appear by renaming. The file itself
holds nothing, and is made where it is missing.

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
    """Lock piece ``number``; "busy" if another process has it, "unlockable" where there are no locks.

    Raises
    ------
    OSError
        If the file is not there and cannot be made.
    """
    if fcntl is None:
        yield "unlockable"
        return
    descriptor, state = _opened(file, number, wait)
    try:
        yield state
    finally:
        os.close(descriptor)


def _opened(file: Path, number: int, wait: bool) -> tuple[int, LockState]:
    """Lock the file that has this name once the lock is held: it may have been deleted during the wait."""
    while True:
        descriptor = os.open(file, os.O_RDWR | os.O_CREAT, 0o666)
        try:
            state = _lock(descriptor, number, wait)
            if state == "busy" or os.path.samestat(os.fstat(descriptor), os.stat(file)):
                return descriptor, state
        except FileNotFoundError:
            pass
        except BaseException:
            os.close(descriptor)
            raise
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
