"""Families whose sources are the user's own files in a folder.

A file is known by the SHA-256 of its bytes, never by its name or place: renaming, sorting into subfolders or moving the
folder changes nothing, and a file that is there twice counts once, so that its copy cannot leak into another split.
(Two different files of one subject can: that is the user's to know.)
"""

import hashlib
from abc import abstractmethod
from functools import cached_property
from pathlib import Path
from typing import ClassVar

from specklegen.core.errors import reject
from specklegen.datasets.objects.family import ListedFamily, Source

_PATH = "objects.path"
"""Where a recipe's file has the folder."""


class FileFamily(ListedFamily):
    """Files of a folder and its subfolders, of some suffixes.

    Each file is read once, when the first object is asked for, so that a broken one is found before hours of
    rendering.

    Parameters
    ----------
    path
        The folder.
    """

    path: str
    _suffixes: ClassVar[tuple[str, ...]] = ()
    _noun: ClassVar[str] = "file"
    _plural: ClassVar[str] = "files"

    @abstractmethod
    def require_readable(self, path: Path) -> None:
        """Raise any error if a file holds nothing of this family."""

    @cached_property
    def files(self) -> dict[str, str]:
        """Path of each file by the SHA-256 of its bytes.

        Raises
        ------
        RuleError
            If the folder does not exist, holds no such file, or holds one that cannot be read.
        """
        name, folder = type(self).__name__, Path(self.path).expanduser()
        if not folder.is_dir():
            reject(f"{name}.path", "a folder that exists", self.path, in_tables=_PATH)
        paths = sorted(p for p in folder.rglob("*") if p.suffix.lower() in self._suffixes and p.is_file())
        if not paths:
            kinds = f"a folder with {self._plural} ({', '.join(self._suffixes)})"
            reject(f"{name}.path", kinds, self.path, in_tables=_PATH)
        found: dict[str, str] = {}
        for path in paths:
            found.setdefault(self._digest(path), str(path))
        return found

    def sources(self) -> tuple[Source, ...]:
        """(SHA-256,) of each different file."""
        return tuple((digest,) for digest in self.files)

    def identity(self) -> dict:
        """Fields less the path, and one hash of all the files instead."""
        contents = hashlib.sha256("".join(sorted(self.files)).encode()).hexdigest()
        return {**self.model_dump(mode="json", exclude={"path"}), self._plural: contents}

    def unchanged(self, source: Source) -> tuple[Path, str]:
        """Path and digest of a file, checked again: a folder that changes under a running data set is not unseen."""
        digest = str(source[0])
        path = Path(self.files[digest])
        try:
            same = hashlib.sha256(path.read_bytes()).hexdigest() == digest
        except OSError:
            same = False
        if not same:
            what = f"{type(self).__name__} {self._noun}"
            reject(what, "as it was when the folder was first read", str(path), "Make the data set anew.")
        return path, digest

    def _digest(self, path: Path) -> str:
        """SHA-256 of a file that proves to be readable."""
        try:
            content = path.read_bytes()
            self.require_readable(path)
        except Exception as error:  # each reader has errors of its own kind
            why = next(iter(str(error).splitlines()), "") or type(error).__name__
            what = f"{type(self).__name__} {self._noun}"
            reject(what, "readable", str(path), f"{why}: mend or remove the file.")
        return hashlib.sha256(content).hexdigest()
