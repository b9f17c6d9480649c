"""Claims: which process works on which shard, as locked bytes of one file.

Byte n of the file is locked while piece n is being worked on. The operating system drops the lock with the
process, however it dies, so that no claim ever goes stale. Claims only save double work and tell orphaned
temporary files from live ones: correctness rests on whole files that appear by renaming. The file itself
holds nothing, and is made where it is missing.

On Linux the locks belong to the open file (OFD locks): they exclude processes, on one machine or over NFS with a lock
service, and threads of one process. Elsewhere they are POSIX record locks, which exclude processes alone: threads there
must not write one store at a time.
"""

import os
import struct
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Literal

try:
    import fcntl
except ImportError:  # Windows
    fcntl = None

_OWNED = sys.platform == "linux" and hasattr(fcntl, "F_OFD_SETLK") and sys.maxsize > 2**32
"""Whether locks that belong to the open file are there, laid out as on 64 bits."""

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
        if _OWNED:
            # struct flock: type, whence, start, length, process (0 for these locks)
            wanted = struct.pack("@hhqqi4x", fcntl.F_WRLCK, os.SEEK_SET, number, 1, 0)
            fcntl.fcntl(descriptor, fcntl.F_OFD_SETLKW if wait else fcntl.F_OFD_SETLK, wanted)
        else:
            fcntl.lockf(descriptor, fcntl.LOCK_EX | (0 if wait else fcntl.LOCK_NB), 1, number, os.SEEK_SET)
    except (BlockingIOError, PermissionError):
        return "busy"
    except OSError:
        return "unlockable"
    return "held"
