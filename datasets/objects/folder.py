"""Folder: the user's own pictures as hidden objects, known by their contents (:mod:`.files`)."""

from functools import lru_cache
from pathlib import Path
from typing import ClassVar, Literal

import numpy as np

from specklegen.core.values import read_only
from specklegen.datasets.objects.family import Source
from specklegen.datasets.objects.files import FileFamily
from specklegen.datasets.objects.pictures import SUFFIXES, fitted, read_grey


class Folder(FileFamily):
    """Pictures of a folder and its subfolders, whole, centred, their aspect kept, dark around.

    Subfolders are classes where every picture lies in one: ``label`` among a sample's parameters is the number of its
    subfolder (``class_names``), -1 otherwise. ``file`` there is the number of the picture that it shows, in stores and
    streams too (``file_names``); ``file`` of a sample by itself is its name, such as "cats/7.png".
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
    _suffixes: ClassVar[tuple[str, ...]] = tuple(SUFFIXES)
    _noun: ClassVar[str] = "picture"
    _plural: ClassVar[str] = "pictures"

    def require_readable(self, path: Path) -> None:
        """Raise any error if a file holds no picture."""
        read_grey(path)

    def picture(self, source: Source, rng: np.random.Generator) -> np.ndarray:  # noqa: ARG002
        """Whole picture, brought into the frame; float32[h, w]."""
        return _fitted(self, source)


@lru_cache(maxsize=1024)
def _fitted(folder: Folder, source: Source) -> np.ndarray:
    path, _ = folder.unchanged(source)
    return read_only(fitted(read_grey(path), folder.shape))
