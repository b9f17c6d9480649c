"""Place of a store: in a folder of this machine, or at an address of any file system that fsspec knows.

An address, such as ``s3://bucket/a.zarr`` or ``memory://a.zarr``, is a ``UPath`` of universal-pathlib (extra
``remote``), which reads as a Path does. What is written there appears whole, as a put does; in a folder it does by
renaming. A put that must be the first of its name says whether it was (``If-None-Match`` of HTTP).
"""

import contextlib
import os
from pathlib import Path
from typing import Any, Protocol

from specklegen.core.errors import reject
from specklegen.core.whole_files import patiently, write_whole


class File(Protocol):
    """An open file, read in parts."""

    def part(self, start: int, length: int) -> bytes:
        """Bytes from ``start`` on."""
        ...

    def close(self) -> None:
        """Give back what it holds."""
        ...


def place_of(folder: str | os.PathLike) -> Path:
    """Return the Path of a folder, or the UPath of an address.

    Raise a `RuleError` if it is an address, and universal-pathlib is not installed.
    """
    if is_remote(folder):
        return folder  # type: ignore[return-value]
    if not isinstance(folder, str | os.PathLike):
        reject("store.folder", "a path, or an address", folder)
    if isinstance(folder, str) and "://" in folder:
        try:
            from upath import UPath
        except ImportError:
            reject("store.folder", "a folder, without the extra remote", folder,
                   "pip install 'specklegen-torch[remote]'")  # fmt: skip
        folder = UPath(folder)
        return folder if is_remote(folder) else Path(folder.path)  # type: ignore[return-value]
    return Path(folder).absolute()


def is_remote(folder: Any) -> bool:
    """Return whether it is a UPath that is no folder of this machine."""
    return getattr(folder, "protocol", "") not in ("", "file", "local")


def put(file: Any, data: bytes, *, sweeping: bool = True) -> None:
    """Write a file so that it is there whole, as it was before, or not at all; folders are made.

    ``sweeping`` looks for what the dead left of it, which takes a look through its folder.
    """
    if is_remote(file):
        file.fs.pipe_file(file.path, data)
    else:
        file.parent.mkdir(parents=True, exist_ok=True)
        write_whole(file, data, sweeping=sweeping)


def content(file: Any, *, expected: bool = True) -> bytes | None:
    """Return the bytes of a file, None where there is none; one that is expected is waited for, if but shortly.

    It is read, not looked for, and in one request: file systems of addresses answer from lists that other processes
    have made untrue, and refuse an object that is replaced after they opened it. There nothing is away while it is
    replaced, and so nothing is waited for.
    """

    def read() -> bytes:
        return file.fs.cat_file(file.path) if is_remote(file) else file.read_bytes()

    try:
        return patiently(read) if expected and not is_remote(file) else read()
    except (FileNotFoundError, IsADirectoryError, NotADirectoryError):
        return None


def put_new(file: Any, data: bytes) -> bool:
    """Write a file at an address, whole, if there is none; whether this call did.

    A file system that knows no such put looks first and then writes: of two at once both may be answered that they did.
    """
    try:
        file.fs.pipe_file(file.path, data, mode="create")
    except FileExistsError:
        return False
    except OSError as error:  # s3fs knows "precondition failed" by its words alone
        if "precondition" not in str(error).lower():
            raise
        return False
    return True


def delete(file: Any) -> None:
    """Delete a file, if it is there."""
    with contextlib.suppress(FileNotFoundError):
        file.unlink()


def listed(folder: Any, **options: Any) -> dict[str, Any]:
    """List the files under an address anew: its file system keeps lists, which other processes make untrue."""
    folder.fs.invalidate_cache()
    try:
        return folder.fs.find(folder.path, detail=True, **options)
    finally:
        folder.fs.invalidate_cache()


def stored_bytes(folder: Any) -> int:
    """Sum the lengths of the files under a folder or an address; files that vanish meanwhile count nothing."""
    if is_remote(folder):
        return sum(int(file["size"] or 0) for file in listed(folder).values())
    return sum(map(length, folder.rglob("*")))


def length(file: Any) -> int:
    """Bytes of a file; 0 where there is none."""
    try:
        return file.stat().st_size if file.is_file() else 0
    except FileNotFoundError:
        return 0


def opened_at_tail(file: Any, length: int) -> tuple[File, bytes]:
    """Open a file for reading in parts, and read its last bytes in one request; FileNotFoundError if there is none."""
    if is_remote(file):
        return RemoteFile(file), file.fs.cat_file(file.path, start=-length)
    local = LocalFile(file)
    return local, local.part(max(0, local.size - length), length)


class LocalFile:
    """A file of this machine; several threads may read it at once."""

    def __init__(self, file: Path) -> None:
        self._descriptor = os.open(file, os.O_RDONLY)
        self.size = os.fstat(self._descriptor).st_size

    def part(self, start: int, length: int) -> bytes:
        """Bytes from ``start`` on."""
        return os.pread(self._descriptor, length, start)

    def close(self) -> None:
        """Close the descriptor."""
        os.close(self._descriptor)


class RemoteFile:
    """A file of another file system; each part is one request, between which it may be replaced."""

    def __init__(self, file: Any) -> None:
        self._system, self._path = file.fs, file.path

    def part(self, start: int, length: int) -> bytes:
        """Bytes from ``start`` on."""
        return self._system.cat_file(self._path, start=start, end=start + length)

    def close(self) -> None:
        """Do nothing: no file is held open."""
