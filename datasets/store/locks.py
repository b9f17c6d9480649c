"""Claims: which process works on which shard, as locked bytes of one file, or as objects of an object store.

Byte n of the file is locked while piece n is being worked on. The operating system drops the lock with the
process, however it dies, so that no claim ever goes stale. Claims only save double work and tell orphaned
temporary files from live ones: correctness rests on whole files that appear by renaming. The file itself
holds nothing, and is made where it is missing.

An object store has no locks. There a claim is an object of its own, put if there is none, dated anew while the work
goes on, and deleted at its end. After a kill it stays, and counts no more once it is old.

On Linux the locks belong to the open file (OFD locks): they exclude processes, on one machine or over NFS with a lock
service, and threads of one process. Elsewhere they are POSIX record locks, which exclude processes alone: threads there
must not write one store at a time.
"""

import logging
import os
import socket
import struct
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, Literal

from specklegen.datasets.store.places import content, delete, put, put_new

try:
    import fcntl
except ImportError:  # Windows
    fcntl = None

_OWNED = sys.platform == "linux" and hasattr(fcntl, "F_OFD_SETLK") and sys.maxsize > 2**32
"""Whether locks that belong to the open file are there, laid out as on 64 bits."""

_LOG = logging.getLogger(__name__)

LockState = Literal["held", "busy", "unlockable"]

BEAT = 30.0
"""Seconds after which a claim at an address is dated anew."""

OLD = 150.0
"""Seconds after which one that nobody has dated anew counts no more."""

LOOK = 1.0
"""Seconds between two looks at another's claim."""


@contextmanager
def claim(file: Path, number: int, wait: bool = False) -> Iterator[LockState]:
    """Lock piece ``number``; "busy" if another process has it, "unlockable" where there are no locks.

    Raise an `OSError` if the file is not there and cannot be made.
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


@contextmanager
def claim_object(file: Any, wait: bool = False) -> Iterator[LockState]:
    """Claim what an object of this name stands for; "busy" if another process has it.

    A process that waits gets it once the other one is done, or its claim is old: its date is, or it has not changed
    while it was watched for as long, whatever the clock of a machine that was killed. An old claim is not deleted,
    since two may see that it is old: the first to put the next generation of it, ``NAME.1``, holds it, and deletes both
    in the end. Two may hold one claim where a clock is minutes late, a living process is stopped for longer than its
    claim lasts, or the file system knows no conditional put. Then work is done twice, with the same bytes, and a length
    of the store may be stated late (see :class:`~specklegen.datasets.store.metadata.Metadata`); nothing is lost.
    """
    watched: dict[Any, tuple[bytes, float]] = {}
    old: list[tuple[Any, bytes]] = []  # generations before, as they were when they were seen to be old
    while True:
        mine = file.with_name(f"{file.name}.{len(old)}") if old else file
        if put_new(mine, _dated()):
            if all(content(before, expected=False) == dated for before, dated in old):
                break
            delete(mine)  # whoever held the generations before has ended meanwhile
            old = []
            continue
        dated = content(mine, expected=False)
        if dated is None:
            old = []
            continue
        last, since = watched.get(str(mine), (b"", 0.0))
        if dated != last:
            if wait and not last:
                _LOG.warning("waiting for %s, claimed by another process (%s)", mine, dated.decode(errors="replace"))
            since = time.monotonic()
            watched[str(mine)] = dated, since
        if _is_old(dated) or time.monotonic() - since > OLD:
            old.append((mine, dated))
        elif wait:
            time.sleep(LOOK)
            old = []
        else:
            yield "busy"
            return
    ended = threading.Event()

    def beat() -> None:
        while not ended.wait(BEAT):
            with suppress(OSError):
                put(mine, _dated())

    heart = threading.Thread(target=beat, daemon=True, name=f"heartbeat of {mine.name}")
    heart.start()
    try:
        yield "held"
    finally:
        ended.set()
        heart.join()
        for before, _ in old:
            delete(before)
        delete(mine)


def _dated() -> bytes:
    """Content of a claim: the date, and who claims."""
    return f"{time.time():.3f} process {os.getpid()} of {socket.gethostname()}".encode()


def _is_old(dated: bytes) -> bool:
    """Return whether nobody has dated a claim anew for long."""
    try:
        return float(dated.split()[0]) < time.time() - OLD
    except (ValueError, IndexError):  # no date: of whoever was killed while it was written, where puts are not whole
        return True
