"""Families whose sources are the user's own files in a folder.

A file is known by the SHA-256 of its bytes, never by its name or place: renaming or moving the folder changes nothing,
and a file that is there twice counts once, so that its copy cannot leak into another split. (Two different files of one
subject can: that is the user's to know.)

Where every file lies in a subfolder, and there are two at least, the subfolders are classes, as in an ImageFolder of
torchvision: a label is the number of a subfolder among all, by their names. It comes with every sample, so that sorting
files into classes is another data set.

A file's number is its place among the different files by their SHA-256, so that it says nothing of names; it comes with
every sample, in stores and streams too. Its name is looked up where somebody reads it (``file_names``).
"""

import hashlib
from abc import abstractmethod
from functools import cached_property
from pathlib import Path
from typing import Any, ClassVar

from specklegen.core.errors import reject
from specklegen.core.values import IDENTITY
from specklegen.datasets.objects.family import ListedFamily, Source
from specklegen.datasets.split import Split

_LISTED = 5
"""Unreadable files that an error lists beside the first, at most."""
_PATH = "objects.path"
"""Where a recipe's file has the folder."""


class FileFamily(ListedFamily):
    """Files of a folder and its subfolders, of some suffixes; a tree of classes gives labels.

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
    label_names: ClassVar[tuple[str, ...]] = ("label", "file")

    @abstractmethod
    def require_readable(self, path: Path) -> None:
        """Raise any error if a file holds nothing of this family."""

    @cached_property
    def files(self) -> dict[str, str]:
        """Path of each file by the SHA-256 of its bytes.

        Raise a `RuleError` if the folder does not exist, holds no such file, or holds one that cannot be read.
        """
        name, folder = type(self).__name__, Path(self.path).expanduser()
        if not folder.is_dir():
            reject(f"{name}.path", "an existing folder", self.path, "Check the path.", _PATH)
        paths = self._paths()
        if not paths:
            kinds = f"a folder with {self._plural} ({', '.join(self._suffixes)})"
            reject(f"{name}.path", kinds, self.path, in_tables=_PATH)
        by_digest: dict[str, str] = {}
        unreadable: list[tuple[Path, str]] = []
        for path in paths:
            try:
                content = path.read_bytes()
                self.require_readable(path)
                by_digest.setdefault(hashlib.sha256(content).hexdigest(), str(path))
            except Exception as error:  # each reader has errors of its own kind
                unreadable.append((path, next(iter(str(error).splitlines()), "") or type(error).__name__))
        if unreadable:
            (first, why), *others = unreadable
            shown = "".join(f"; {path}: {reason}" for path, reason in others[:_LISTED])
            more = f"; and {len(others) - _LISTED} more" if len(others) > _LISTED else ""
            remedy = f"{why}{shown}{more}. Repair or remove {'these files' if others else 'the file'}."
            reject(f"{name} {self._noun}", "readable", str(first), remedy)
        return by_digest

    @property
    def file_names(self) -> tuple[str, ...]:
        """Name of each different file within the folder, with "/", by its number."""
        return self._names

    @cached_property
    def _names(self) -> tuple[str, ...]:
        folder = Path(self.path).expanduser()
        return tuple(Path(self.files[digest]).relative_to(folder).as_posix() for digest in sorted(self.files))

    @cached_property
    def _numbers(self) -> dict[str, int]:
        return {digest: number for number, digest in enumerate(sorted(self.files))}

    @cached_property
    def class_names(self) -> tuple[str, ...]:
        """Names of the subfolders that are classes, in the order of their labels; empty where they are none."""
        places = [path.relative_to(Path(self.path).expanduser()).parts for path in self._paths()]
        names = sorted({place[0] for place in places})
        return tuple(names) if len(names) > 1 and all(len(place) > 1 for place in places) else ()

    @cached_property
    def _labels(self) -> dict[str, int]:
        """Label of each file of a tree of classes, by the SHA-256 of its bytes."""
        if not self.class_names:
            return {}
        folder = Path(self.path).expanduser()
        numbers = {digest: self._class_of(Path(path), folder) for digest, path in self.files.items()}
        if len(self.files) < len(self._paths()):
            for path in self._paths():
                if numbers[digest := hashlib.sha256(path.read_bytes()).hexdigest()] != self._class_of(path, folder):
                    both = f"{self.files[digest]}, {path}"
                    reject(f"{type(self).__name__}.path", "a folder that has each image in one class only", both,
                           in_tables=_PATH)  # fmt: skip
        return numbers

    def _class_of(self, path: Path, folder: Path) -> int:
        return self.class_names.index(path.relative_to(folder).parts[0])

    def _paths(self) -> list[Path]:
        folder = Path(self.path).expanduser()
        return sorted(p for p in folder.rglob("*") if p.suffix.lower() in self._suffixes and p.is_file())

    def labels(self, source: Source) -> dict[str, float]:
        """Number of the class that a file lies in, -1 where the folder is no tree of classes; number of the file."""
        digest = str(source[0])
        return {"label": float(self._labels.get(digest, -1)), "file": float(self._numbers[digest])}

    def file(self, seed: int, split: Split, index: int) -> Path:
        """Path of the file that a sample shows."""
        return Path(self.files[str(self.source(seed, split, index)[0])])

    def sources(self) -> tuple[Source, ...]:
        """(SHA-256,) of each different file."""
        return tuple((digest,) for digest in self.files)

    def identity(self, context: dict[str, bool] | None = IDENTITY) -> dict[str, Any]:
        """Fields less the path, and one hash of all the files instead; of a tree, one of their labels too."""
        contents = hashlib.sha256("".join(sorted(self.files)).encode()).hexdigest()
        stated = {**self.model_dump(mode="json", exclude={"path"}, context=context), self._plural: contents}
        if self._labels:
            listing = "".join(f"{digest} {self._labels[digest]}\n" for digest in sorted(self._labels))
            stated["labels"] = hashlib.sha256(listing.encode()).hexdigest()
        return stated

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
            reject(what, "unchanged since the folder was first read", str(path),
                   "Restore the file, or generate the data set again in a new folder.")
        return path, digest
