"""Files and folders that appear whole: made under a temporary name, then renamed; and what killed processes leave.

A writer may be killed at it, on this machine or on another one that shares the folder. Locks do not tell the
dead from the living: some network folders have none, others keep them to each machine. Age does. A file is written in
one go, and who fills a folder, however long it takes, dates it anew every ``BEAT`` seconds. What nobody has touched for
``AGE`` seconds is dead. Both dates are the file server's, whose clock differs from ours. Who sleeps through that time
all the same writes its file again, or learns that its folder is gone.

A temporary name is ``NAME.<32 hexadecimal digits>.partial`` of a file, and ``.NAME.<32 hexadecimal digits>.creating``
of a folder. Nothing of another name is ever deleted.
"""

import contextlib
import errno
import glob
import os
import re
import shutil
import tempfile
import threading
import time
import uuid
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import TypeVar

BEAT = 60.0
"""Seconds after which who fills a folder dates it anew."""

AGE = 3600.0
"""Seconds after which what nobody has dated anew is dead: many beats, and more than a server takes for one file."""

WAITS = tuple(0.002 * 2**n for n in range(7))
"""Seconds between looks at what may be away for a moment, a quarter of one in all."""

_TEMPORARY = re.compile(r".+\.[0-9a-f]{32}\.(partial|creating)")

Read = TypeVar("Read")


def patiently(act: Callable[[], Read]) -> Read:
    """Do what takes a file that must be there, and again for a quarter of a second while it is away.

    A network folder may not show a file for some milliseconds while another process replaces it. Raise an `OSError` as
    ``act`` does, where it still does, or where the file is there.
    """
    for wait in WAITS:
        try:
            return act()
        except OSError as error:
            if error.errno not in (errno.ENOENT, errno.ESTALE):
                raise
            time.sleep(wait)
    return act()


def write_whole(file: Path, data: bytes, *, sweeping: bool = True) -> None:
    """Write a file so that it is there whole, as it was before, or not at all; sweep what the dead left of it."""

    def write() -> None:
        temporary = _named(file, "partial")
        try:
            temporary.write_bytes(data)
            temporary.replace(file)
        except BaseException:
            temporary.unlink(missing_ok=True)
            raise

    if sweeping:
        sweep(unfinished(file))
    patiently(write)  # again where it was swept while this process slept


@contextlib.contextmanager
def making(folder: Path) -> Iterator[Path]:
    """Give a temporary folder to fill, which gets its name when the block ends well, and is deleted when it does not.

    Raises
    ------
    FileExistsError
        If there is something of that name by then: another process was faster.
    FileNotFoundError
        If this process slept for so long that another one took it for dead.
    """
    sweep(unfinished(folder))
    temporary = _named(folder.with_name(f".{folder.name}"), "creating")
    temporary.mkdir(parents=True)
    identity = temporary.stat()
    try:
        with _beating(temporary):
            yield temporary
        if not os.path.samestat(identity, temporary.stat()):
            raise FileNotFoundError(errno.ENOENT, "swept while this process slept", str(temporary))
        temporary.rename(folder)
    except OSError as error:
        if error.errno in (errno.ENOTEMPTY, errno.ENOTDIR) and folder.exists():
            raise FileExistsError(errno.EEXIST, os.strerror(errno.EEXIST), str(folder)) from error
        raise
    finally:
        shutil.rmtree(temporary, ignore_errors=True)


@contextlib.contextmanager
def _beating(folder: Path) -> Iterator[None]:
    """Date a folder anew every so often, by the server's clock."""
    ended = threading.Event()

    def beat() -> None:
        while not ended.wait(BEAT):
            with contextlib.suppress(OSError):
                os.utime(folder)

    heart = threading.Thread(target=beat, daemon=True, name=f"heartbeat of {folder.name}")
    heart.start()
    try:
        yield
    finally:
        ended.set()
        heart.join()


def unfinished(path: Path) -> list[Path]:
    """Return what is being made under temporary names to become this file or folder, by the living and the dead."""
    name = glob.escape(path.name)
    return [*path.parent.glob(f"{name}.*.partial"), *path.parent.glob(f".{name}.*.creating")]


def is_temporary(path: Path) -> bool:
    """Return whether a name is one that is given to what is not yet whole."""
    return _TEMPORARY.fullmatch(path.name) is not None


def dead(paths: Iterable[Path]) -> list[Path]:
    """Return those temporary files and folders that nobody has touched for too long, in the order of their names."""
    candidates = sorted(path for path in paths if is_temporary(path))
    clocks = {folder: _time_in(folder) for folder in {path.parent for path in candidates}}
    return [path for path in candidates if _dated(path) < clocks[path.parent] - AGE]


def sweep(paths: Iterable[Path]) -> list[Path]:
    """Delete those temporary files and folders that are :func:`dead`; return those that it deleted."""
    swept = dead(paths)
    for path in swept:
        with contextlib.suppress(OSError):
            path.unlink(missing_ok=True) if path.is_file() else shutil.rmtree(path, ignore_errors=True)
    return [path for path in swept if not path.exists()]


def _named(path: Path, kind: str) -> Path:
    return path.with_name(f"{path.name}.{uuid.uuid4().hex}.{kind}")


def _time_in(folder: Path) -> float:
    """Read the clock of a folder's server from the date of a file made there; ours where none can be made."""
    try:
        with tempfile.TemporaryFile(dir=folder) as probe:
            return os.fstat(probe.fileno()).st_mtime
    except OSError:
        return time.time()


def _dated(path: Path) -> float:
    try:
        return path.stat().st_mtime
    except OSError:  # gone, so nobody's to delete
        return float("inf")
