"""Files that outlive a process: where they lie, read whole or not at all, the oldest first to go.

A file starts with the SHA-256 of the rest of it. What cannot be read, written or trusted to be whole costs its making
and nothing else.
"""

import hashlib
import os
from contextlib import suppress
from pathlib import Path

from specklegen.core.whole_files import sweep, write_whole

_DIGEST = 32  # bytes of SHA-256


def cache_root() -> Path:
    """Folder of everything that is kept between processes; kernels, which know nothing of this, say it of their own."""
    root = os.environ.get("SPECKLEGEN_CACHE")
    if root:
        return Path(root)
    import platformdirs

    return Path(platformdirs.user_cache_dir("specklegen"))


def kept_content(file: Path) -> bytes | None:
    """Content of a file as it was kept; None where there is none, or it is damaged."""
    try:
        written = file.read_bytes()
    except OSError:
        return None
    content = written[_DIGEST:]
    return content if hashlib.sha256(content).digest() == written[:_DIGEST] else None


def keep(file: Path, content: bytes) -> None:
    """Write a file whole, for :func:`kept_content`.

    Raises
    ------
    OSError
        Where it cannot be written.
    """
    file.parent.mkdir(parents=True, exist_ok=True)
    write_whole(file, hashlib.sha256(content).digest() + content)


def make_room(folder: Path, suffix: str, most: int, most_bytes: int) -> None:
    """Delete the oldest files of a suffix beyond a number and a size of all together; the newest stays."""
    sweep(folder.glob("*.partial"))
    newest_first = sorted((_age_and_size(file) for file in folder.glob("*" + suffix)), reverse=True)
    held = 0
    for number, (_, size, file) in enumerate(newest_first):
        held += size
        if number >= most or (held > most_bytes and number):
            with suppress(OSError):
                file.unlink(missing_ok=True)


def _age_and_size(file: Path) -> tuple[float, int, Path]:
    try:
        status = file.stat()
    except OSError:
        return 0.0, 0, file
    return status.st_mtime, status.st_size, file
