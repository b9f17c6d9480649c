"""The cache on disk: kernels, correlations, pilots, plans, the machine's pace, each computed once for all of a user.

Layout: one folder for each kind of result (:data:`LIMITS`) in ``specklegen`` of the user's cache directory, one file
for each result. The environment variable SPECKLEGEN_CACHE changes that:

- ``SPECKLEGEN_CACHE=FOLDER``: another folder,
- ``SPECKLEGEN_CACHE=off``: nothing is read or written,
- ``SPECKLEGEN_CACHE=kernels:FOLDER``: compiled kernels alone; ``kernels:`` for those in the user's cache directory.

A file is named by the SHA-256 of everything that decides its content. The sources count by :func:`source_digest`: the
file that computes a result and all files of this package that it imports, directly or not. A file starts with the
SHA-256 of the rest, and appears whole by a rename, whichever processes write at the same time.

Compiled code is run as it is read, and other results are used as they are. So a file is read only if nobody but this
user and the administrator could have written it: owner and mode are checked of the open file and of every folder above
it. Files that are damaged, cannot be read or cannot be written cost a warning and the computation of their content.

Only Python's own library is imported here: kernels and values, which do not know each other, both use this module.
"""

import hashlib
import os
import re
import stat
import tempfile
import warnings
from functools import lru_cache
from pathlib import Path

SETTING = "SPECKLEGEN_CACHE"
LIMITS = {
    "kernels": (5000, 2**30), "correlations": (2000, 2**30), "pilots": (4096, 2**28), "plans": (500, 2**26),
    "pace": (16, 2**16),
}  # fmt: skip
"""Most files and bytes of each folder; the oldest files go first. No file takes more than 1/16 of the bytes."""
MOST_OF_A_PROCESS = 1000
"""Files that one process writes into a folder: media that are planned once each are not worth their files."""
PACKAGE = Path(__file__).parent
_DIGEST = 32  # bytes of SHA-256
_SWEEP = 16  # files that a process writes between two sweeps of a folder
_IMPORT = re.compile(r"^[ \t]*(?:from|import) (specklegen[\w.]*|\.[\w.]*)(?: import (\([^)]*\)|.*))?", re.MULTILINE)
_DATA = re.compile(r'files\("specklegen"\)')  # how a source names the folder of data files

_written: dict[str, int] = {}
"""Files that this process has written, by folder."""
_warned: set[str] = set()
"""Kinds of warnings that this process has given."""


def folder_of(kind: str) -> Path | None:
    """Return the folder of a kind of results; None where they are not cached."""
    setting = os.environ.get(SETTING, "")
    folder = setting.removeprefix("kernels:")
    if setting == "off" or (folder != setting and kind != "kernels"):
        return None
    if not folder:
        import platformdirs

        folder = platformdirs.user_cache_dir("specklegen")
    return Path(os.path.abspath(folder), kind)


def name_of(*about: object) -> str:
    """Return the name of a file: the SHA-256, in hexadecimal, of all that decides its content, as text."""
    return hashlib.sha256("\n".join(map(str, about)).encode()).hexdigest()


def read(kind: str, name: str) -> bytes | None:
    """Return the content of a file; None where there is none that is whole and can be trusted."""
    folder = folder_of(kind)
    if folder is None:
        return None
    path = folder / name
    try:
        with path.open("rb") as file:
            if not _is_trusted(folder, path, os.fstat(file.fileno())):
                return None
            written = file.read()
    except OSError:
        return None
    content = written[_DIGEST:]
    if hashlib.sha256(content).digest() != written[:_DIGEST]:
        _warn_once("damaged", f"{path} in the cache is damaged: its content is computed again, and replaced.")
        return None
    return content


def write(kind: str, name: str, content: bytes) -> None:
    """Write a file, if that can be done; delete the oldest files beyond the limits of its folder."""
    folder = folder_of(kind)
    if folder is None or 16 * len(content) > LIMITS[kind][1]:
        return
    number = _written.get(str(folder), 0)
    if number >= MOST_OF_A_PROCESS:
        return
    try:
        _make(folder)
        if not _is_trusted(folder):
            return
        with tempfile.NamedTemporaryFile(dir=folder, delete=False) as file:
            try:
                file.write(hashlib.sha256(content).digest() + content)
                file.close()
                os.replace(file.name, folder / name)
            except BaseException:
                Path(file.name).unlink(missing_ok=True)
                raise
        if number % _SWEEP == 0:
            _sweep(folder, *LIMITS[kind])
        _written[str(folder)] = number + 1
    except OSError as error:
        _written[str(folder)] = MOST_OF_A_PROCESS  # not tried again
        if not folder.is_dir() or os.access(folder, os.W_OK):  # else the administrator writes it
            _warn_once("unwritable", f"{folder} cannot be written ({error.strerror}), so each process computes its "
                       f"content again. Set {SETTING} to a folder that you can write, or to off.")  # fmt: skip


def _make(folder: Path) -> None:
    """Make a folder and those above it that are missing, for this user alone."""
    for place in (*reversed(folder.parents), folder):
        if not place.exists():
            place.mkdir(mode=0o700, exist_ok=True)


def _sweep(folder: Path, most: int, most_bytes: int) -> None:
    """Delete the oldest files beyond a number and a size of all together; also what killed processes left half done."""
    files = []
    with os.scandir(folder) as entries:
        for entry in entries:
            try:
                status = entry.stat(follow_symlinks=False)
            except OSError:  # another process has deleted it
                continue
            if stat.S_ISREG(status.st_mode):
                files.append((status.st_mtime_ns, status.st_size, entry.path))
    total = 0
    for number, (_, size, path) in enumerate(sorted(files, reverse=True)):
        total += size
        if number >= most or total > most_bytes:
            Path(path).unlink(missing_ok=True)


def _is_trusted(folder: Path, path: Path | None = None, status: os.stat_result | None = None) -> bool:
    """Return whether only this user and the administrator could have written into a folder, and an open file of it."""
    reason = distrust(folder)
    if reason is None and status is not None and _suspicion(status) is not None:
        reason = f"{path} {_suspicion(status)}"
    if reason is not None:
        _warn_once("distrust", f"the cache {folder.parent} is not used, since other users could have changed it: "
                   f"{reason}. Forbid them to write there (chmod go-w), or set {SETTING} to a folder that only you can "
                   "write, as well as the folders above it.")  # fmt: skip
    return reason is None


def distrust(folder: Path) -> str | None:
    """Say which folder or link on the way to a folder others could have changed, and why; None where there is none."""
    places = [os.path.abspath(folder)]
    for place in places:  # which grows: by the folders above, and by where links lead
        status = os.lstat(place)
        reason = _suspicion(status)
        if reason is not None:
            return f"{place} {reason}"
        further = [os.path.dirname(place)]
        if stat.S_ISLNK(status.st_mode):
            further.append(os.path.abspath(os.path.join(further[0], os.readlink(place))))
        places += [place for place in further if place not in places]
    return None


def _suspicion(status: os.stat_result) -> str | None:
    """Say why others could write a file, or exchange what lies in a folder; None where they could not."""
    if not hasattr(os, "getuid"):
        return None
    mode = status.st_mode
    if status.st_uid not in (os.getuid(), 0):
        return "belongs to another user"
    if stat.S_ISLNK(mode) or (stat.S_ISDIR(mode) and mode & stat.S_ISVTX):
        return None  # in a sticky folder, as /tmp is, a file can be exchanged by its owner alone
    if mode & stat.S_IWOTH or (mode & stat.S_IWGRP and not _is_private(status.st_gid)):
        return "can be written by other users"
    return None


@lru_cache
def _is_private(group: int) -> bool:
    """Return whether a group is that of this user alone, as many systems make one for each user."""
    import grp
    import pwd

    try:
        user, members = pwd.getpwuid(os.getuid()), grp.getgrgid(group)
    except KeyError:
        return False
    return members.gr_name == user.pw_name and group == user.pw_gid and {user.pw_name} >= set(members.gr_mem)


def _warn_once(kind: str, text: str) -> None:
    """Warn of something once in a process."""
    if kind not in _warned:
        _warned.add(kind)
        warnings.warn(text, stacklevel=3)


@lru_cache(maxsize=None)
def source_digest(file: Path) -> str:
    """Return the SHA-256, in hexadecimal, of the sources of a file's results."""
    digests = [f"{os.path.relpath(source, PACKAGE)} {_examined(source)[0]}" for source in sorted(sources_of(file))]
    return name_of(*digests)


def sources_of(file: Path) -> frozenset[Path]:
    """Return the files that decide a file's results: it, all that it imports from this package, and so on."""
    sources, new = set(), {file}
    while new:
        sources |= new
        new = {path for source in new for path in _examined(source)[1]} - sources
    return frozenset(sources)


@lru_cache(maxsize=None)
def _examined(file: Path) -> tuple[str, frozenset[Path]]:
    """Return the digest of a file, and the files of this package that it imports by itself or reads as data."""
    content, used = file.read_bytes(), set()
    if file.suffix in (".py", ".pyi"):
        text = content.decode()
        for module, names in _IMPORT.findall(text):
            folder = file.parent if module.startswith(".") else PACKAGE
            used |= _imported(folder.joinpath(*module.split(".")[1:]), re.findall(r"\w+", names))
        if _DATA.search(text):
            used |= {path for path in (PACKAGE / "data").iterdir() if path.is_file()}
    return hashlib.sha256(content).hexdigest(), frozenset(used)


def _imported(base: Path, names: list[str]) -> set[Path]:
    """Return the files of a module, or of a package and of what is imported from it by name."""
    module, package, stub = base.with_suffix(".py"), base / "__init__.py", base / "__init__.pyi"
    if module.is_file() or not package.is_file():
        return {module} & set(filter(Path.is_file, [module]))
    inner = [path for name in names for path in (base / f"{name}.py", base / name / "__init__.py") if path.is_file()]
    lazy = [stub] if len(inner) < max(len(names), 1) and stub.is_file() else []
    return {package, *inner, *lazy}
