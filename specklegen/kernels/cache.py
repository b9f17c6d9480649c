"""Where compiled kernels are kept between processes, and who may have put them there.

Compiled code is run as it is found, so a folder that others can write is left alone. Each file starts with the SHA-256
of the rest of it: one that was written by half, or damaged since, is compiled anew. What cannot be used is said once in
a process, and costs a compilation and nothing else.

A file's kernels lie in ``kernels/<digest>`` under SPECKLEGEN_CACHE, by default the user's cache directory. The digest
is that of the file and of all that it imports from this package, and so on: Numba notices a change in the file of a
function, but not in the files of the functions that it calls. It also asks for the same path and the same time of the
last change, so that every checkout compiled all anew; here the digest alone decides. What was compiled for one set of
argument types is one file, which names them: two processes that write at a time do not overwrite each other's list.
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
from numba.core.caching import CompileResultCacheImpl, FunctionCache
from numba.core.runtime import rtsys
from numba.core.serialize import dumps

_DIGEST = 32  # bytes of SHA-256
_IMPORT = re.compile(r"^[ \t]*(?:from|import) (specklegen[\w.]*)(?: import (\([^)]*\)|.*))?", re.MULTILINE)


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
    if can_write(folder) or any(folder.glob("*.nbc")):
        return str(folder)
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


class _Place:
    """Where Numba is told to keep a function."""

    def __init__(self, function: Any) -> None:
        self._file = Path(function.__code__.co_filename)
        self._line = function.__code__.co_firstlineno

    @classmethod
    def from_function(cls, function: Any, _: str) -> "_Place":
        return cls(function)

    def get_cache_path(self) -> str | None:
        return cache_folder(self._file)

    def get_source_stamp(self) -> None:
        """Nothing: the folder's name is the digest of the sources."""

    def get_disambiguator(self) -> str:
        return str(self._line)

    def ensure_cache_path(self) -> None:
        """Nothing: the folder is there, or the kernel is not kept."""


class _Kept(CompileResultCacheImpl):
    _locator_classes = (_Place,)


class _CheckedFiles:
    """What was compiled of one kernel: a file for each set of argument types, which it names, after its SHA-256."""

    def __init__(self, folder: Path, name: str) -> None:
        self._folder, self._name = folder, name

    def _path(self, key: Any) -> Path:
        return self._folder / f"{self._name}.{hashlib.sha256(repr(key).encode()).hexdigest()[:16]}.nbc"

    def load(self, key: Any) -> Any:
        try:
            kept, data = _checked(self._path(key))
        except FileNotFoundError:
            return None
        return data if kept == key else None

    def save(self, key: Any, data: Any) -> None:
        if not can_write(self._folder):
            return  # one of the administrator's, to be read
        content = dumps((key, data))
        with tempfile.NamedTemporaryFile(dir=self._folder, suffix=".part", delete=False) as file:
            try:
                file.write(hashlib.sha256(content).digest() + content)
                file.close()
                os.replace(file.name, self._path(key))
            except BaseException:
                Path(file.name).unlink(missing_ok=True)
                raise

    def flush(self) -> None:
        for path in self._folder.glob(f"{self._name}.*.nbc"):
            path.unlink(missing_ok=True)


def _checked(path: Path) -> Any:
    content = path.read_bytes()
    if hashlib.sha256(content[_DIGEST:]).digest() != content[:_DIGEST]:
        raise DamagedCacheError(f"{path} is damaged")
    return pickle.loads(content[_DIGEST:])


class KernelCache(FunctionCache):
    """The cache of one kernel: an unreadable file is compiled anew, an unwritable one left out; either is said."""

    _impl_class = _Kept

    def __init__(self, function: Any) -> None:
        super().__init__(function)
        self._cache_file = _CheckedFiles(Path(self._cache_path), self._impl.filename_base)

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """Read a compiled kernel; None where there is none that is whole.

        Numba imports here all that it can translate, .4 s of a process, of which machine code needs the addresses of
        the runtime alone; who compiles imports it then.
        """
        try:
            rtsys.initialize(target_context)
            return self._load_overload(sig, target_context)
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
