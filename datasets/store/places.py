"""Where a store lies: in a folder of this machine, or at an address of any file system that fsspec knows.

Stores are written in folders, whose locks share out the work. What is finished may be copied to an object store and
read there: an address, such as ``s3://bucket/a.zarr`` or ``memory://a.zarr``, is a ``UPath`` of universal-pathlib
(extra ``remote``), which reads as a Path does.
"""

import os
from pathlib import Path
from typing import Any, Protocol

from specklegen.core.errors import reject


class File(Protocol):
    """An open file, read in parts."""

    size: int

    def part(self, start: int, length: int) -> bytes:
        """Bytes from ``start`` on."""
        ...

    def close(self) -> None:
        """Give back what it holds."""
        ...


def place_of(folder: str | os.PathLike) -> Path:
    """Return the Path of a folder, or the UPath of an address.

    Raises
    ------
    RuleError
        If it is an address, and universal-pathlib is not installed.
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
    """Whether it is a UPath that is no folder of this machine."""
    return getattr(folder, "protocol", "") not in ("", "file", "local")


def opened(file: Any) -> File:
    """Open a file for reading in parts; FileNotFoundError if there is none."""
    return RemoteFile(file) if is_remote(file) else LocalFile(file)


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
    """A file of another file system; each part is one request."""

    def __init__(self, file: Any) -> None:
        self._system, self._path = file.fs, file.path
        self.size = int(self._system.size(self._path))

    def part(self, start: int, length: int) -> bytes:
        """Bytes from ``start`` on."""
        return self._system.cat_file(self._path, start=start, end=start + length)

    def close(self) -> None:
        """Do nothing: no file is held open."""
