"""Where compiled kernels are kept between processes, and who may have put them there.

Compiled code is run as it is found, so a folder that others can write is left alone. Each file starts with the SHA-256
of the rest of it: one that was written by half, or damaged since, is compiled anew. What cannot be used is said once in
a process, and costs a compilation and nothing else.

A file's kernels lie in ``kernels/<digest>`` under SPECKLEGEN_CACHE, by default the user's cache directory. The digest
is that of the file and of all that it imports from this package, and so on: Numba notices a change in the file of a
function, but not in the files of the functions that it calls. A folder that can be read and not written is used through
a temporary folder of links to its files.
"""

import hashlib
import os
import pickle
import re
import tempfile
import warnings
from functools import lru_cache
from pathlib import Path
from typing import Any

import numba
from numba.core.caching import FunctionCache, IndexDataCacheFile

_DIGEST = 32  # bytes of SHA-256
_IMPORT = re.compile(r"^[ \t]*(?:from|import) (specklegen[\w.]*)(?: import (\([^)]*\)|.*))?", re.MULTILINE)
_KEPT: list[tempfile.TemporaryDirectory] = []  # until the process ends


class DamagedCacheError(Exception):
    """A file of the cache that is not as it was written."""


def cache_root() -> Path:
    """Folder of everything that is kept between processes."""
    root = os.environ.get("SPECKLEGEN_CACHE")
    if root:
        return Path(root)
    import platformdirs

    return Path(platformdirs.user_cache_dir("specklegen"))


@lru_cache
def imported_files(file: Path) -> frozenset[Path]:
    """Return the files of this package that a file imports by itself, anywhere in it."""
    package = Path(__file__).parent.parent
    found = set()
    for module, names in _IMPORT.findall(file.read_text(encoding="utf-8")):
        base = package.joinpath(*module.split(".")[1:])
        tried = [base, base / "__init__", *(base / name for name in re.findall(r"\w+", names))]
        found.update(path for path in (name.with_suffix(".py") for name in tried) if path.is_file())
    return frozenset(found)


@lru_cache
def sources_of(file: Path) -> frozenset[Path]:
    """Return the files that decide a file's compiled kernels: it, all that it imports, how kernels are compiled."""
    found, new = set(), {file, Path(__file__), Path(__file__).with_name("__init__.py")}
    while new:
        found |= new
        new = {path for source in new for path in imported_files(source)} - found
    return frozenset(found)


def source_digest(file: Path) -> str:
    """Digest of the sources of a file's kernels and of their compiler."""
    digest = hashlib.sha256(numba.__version__.encode())
    for source in sorted(sources_of(file)):
        content = source.read_bytes()
        digest.update(f"{source.name} {len(content)} ".encode() + content)
    return digest.hexdigest()[:16]


@lru_cache
def cache_folder(file: Path) -> str | None:
    """Folder for this process's kernels of a file; None where there is none to use, which is said."""
    root = cache_root() / "kernels"
    folder = root / source_digest(file)
    try:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
    except OSError as error:
        return _without(f"no folder can be made in {root} ({error.strerror})")
    reason = distrust(folder)
    if reason:
        return _without(f"a folder in {root} {reason}")
    if can_write(folder):
        return str(folder)
    if any(folder.rglob("*.nbi")):
        return _linked(folder)
    return _without(f"a folder in {root} is not writable")


def distrust(folder: Path) -> str | None:
    """Why a folder may hold what neither this user nor the administrator put there; None where it may not."""
    if not hasattr(os, "getuid"):
        return None
    status = folder.stat()
    if status.st_uid not in (os.getuid(), 0):
        return "belongs to another user"
    return "can be written by other users" if status.st_mode & 0o022 else None


def can_write(folder: Path) -> bool:
    """Whether files can be made in a folder."""
    try:
        with tempfile.TemporaryFile(dir=folder):
            return True
    except OSError:
        return False


def _without(reason: str) -> None:
    say_once(
        f"no compiled-kernel cache: {reason}, so kernels compile in every process; set SPECKLEGEN_CACHE to a folder of "
        "your own"
    )


@lru_cache
def say_once(text: str) -> None:
    """Warn of something once in a process."""
    warnings.warn(text, stacklevel=3)


def _linked(folder: Path) -> str | None:
    """A temporary folder with links to the files of one that cannot be written: Numba insists on writing."""
    made = tempfile.TemporaryDirectory(prefix="specklegen-kernels-")
    _KEPT.append(made)
    for file in folder.rglob("*.nb[ic]"):
        link = Path(made.name) / file.relative_to(folder)
        link.parent.mkdir(parents=True, exist_ok=True)
        link.symlink_to(file.absolute())
    return made.name


class _CheckedFiles(IndexDataCacheFile):
    """Numba's index and data files, each after its SHA-256."""

    def _dump(self, obj: Any) -> bytes:
        content = super()._dump(obj)
        return hashlib.sha256(content).digest() + content

    def _load_index(self) -> dict:
        try:
            version, stamp, overloads = _checked(Path(self._index_path))
        except FileNotFoundError:
            return {}
        return overloads if (version, stamp) == (self._version, self._source_stamp) else {}

    def _save_index(self, overloads: dict) -> None:
        with self._open_for_write(self._index_path) as file:
            file.write(self._dump((self._version, self._source_stamp, overloads)))

    def _load_data(self, name: str) -> Any:
        return _checked(Path(self._data_path(name)))


def _checked(path: Path) -> Any:
    content = path.read_bytes()
    if hashlib.sha256(content[_DIGEST:]).digest() != content[:_DIGEST]:
        raise DamagedCacheError(f"{path} is damaged")
    return pickle.loads(content[_DIGEST:])


class KernelCache(FunctionCache):
    """The cache of one kernel: an unreadable file is compiled anew, an unwritable one left out; either is said."""

    def __init__(self, function: Any) -> None:
        super().__init__(function)
        self._cache_file = _CheckedFiles(
            cache_path=self._cache_path,
            filename_base=self._impl.filename_base,
            source_stamp=self._impl.locator.get_source_stamp(),
        )

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """Read a compiled kernel; None where there is none that is whole."""
        try:
            return super().load_overload(sig, target_context)
        except (DamagedCacheError, OSError, pickle.UnpicklingError, EOFError, AttributeError, ImportError) as error:
            say_once(f"compiled kernels in {self._cache_path} cannot be read, so they compile anew: {error}")
            self._attempt(self.flush)
            return None

    def save_overload(self, sig: Any, data: Any) -> None:
        """Write a compiled kernel, if that can be done."""
        self._attempt(lambda: super(KernelCache, self).save_overload(sig, data))

    def _attempt(self, write: Any) -> None:
        try:
            write()
        except (OSError, DamagedCacheError) as error:
            say_once(f"compiled kernels cannot be kept in {self._cache_path}: {error}")
