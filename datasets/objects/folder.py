"""Folder: the user's own pictures as hidden objects.

A picture is known by the SHA-256 of its bytes, never by its name or place: renaming, sorting into
subfolders or moving the folder changes nothing, and a file that is there twice counts once, so that its
copy cannot leak into another split. (Two different files of one subject can: that is the user's to know.)
"""

import hashlib
from functools import cached_property, lru_cache
from pathlib import Path
from typing import Literal

import numpy as np

from specklegen.core.errors import reject
from specklegen.datasets.objects.family import ListedFamily, Source
from specklegen.datasets.objects.pictures import SUFFIXES, fitted, read_grey


class Folder(ListedFamily):
    """Pictures of a folder and its subfolders, whole, centred, their aspect kept, dark around.

    PNG, JPEG, TIFF and NPY (one array [h, w] or [h, w, 3] a file) are read; colours become grey.
    Each file is read once, when the first picture is asked for, so that a broken one is found before
    hours of rendering.

    Parameters
    ----------
    shape
        (rows, columns) of an object.
    path
        The folder.
    """

    type: Literal["Folder"] = "Folder"
    path: str

    @cached_property
    def files(self) -> dict[str, str]:
        """Path of each picture by the SHA-256 of its bytes.

        Raises
        ------
        RuleError
            If the folder does not exist, holds no picture, or holds one that cannot be read.
        """
        folder = Path(self.path).expanduser()
        if not folder.is_dir():
            reject("Folder.path", "a folder that exists", self.path)
        paths = sorted(p for p in folder.rglob("*") if p.suffix.lower() in SUFFIXES and p.is_file())
        if not paths:
            reject("Folder.path", f"a folder with pictures ({', '.join(SUFFIXES)})", self.path)
        found: dict[str, str] = {}
        for path in paths:
            found.setdefault(_digest(path), str(path))
        return found

    def sources(self) -> tuple[Source, ...]:
        """(SHA-256,) of each different picture."""
        return tuple((digest,) for digest in self.files)

    def identity(self) -> dict:
        """Fields less the path, and one hash of all the pictures instead."""
        pictures = hashlib.sha256("".join(sorted(self.files)).encode()).hexdigest()
        return {**self.model_dump(mode="json", exclude={"path"}), "pictures": pictures}

    def picture(self, source: Source, rng: np.random.Generator) -> np.ndarray:  # noqa: ARG002
        """Whole picture, brought into the frame; float32[h, w]."""
        return _fitted(self.files[str(source[0])], str(source[0]), self.shape)


def _digest(path: Path) -> str:
    """SHA-256 of a file that proves to be a readable picture."""
    try:
        content = path.read_bytes()
        read_grey(path)
    except Exception as error:  # each reader has errors of its own kind
        reject("Folder picture", "readable", str(path), f"{_first_line(error)}: mend or remove the file.")
    return hashlib.sha256(content).hexdigest()


def _first_line(error: Exception) -> str:
    return next(iter(str(error).splitlines()), "") or type(error).__name__


@lru_cache(maxsize=1024)
def _fitted(path: str, digest: str, shape: tuple[int, int]) -> np.ndarray:
    """Picture of a file, checked again: a folder that changes under a running data set must not go unseen."""
    try:
        unchanged = hashlib.sha256(Path(path).read_bytes()).hexdigest() == digest
    except OSError:
        unchanged = False
    if not unchanged:
        reject("Folder picture", "as it was when the folder was first read", path, "Make the data set anew.")
    return fitted(read_grey(Path(path)), shape)
