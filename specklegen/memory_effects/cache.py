"""Kernels kept on disk: what a material's kernel cost is paid once per user.

A file is named by the digest of everything that decides its content (material, paths, the sources of the
estimator) and starts with the digest of the rest of it. Readers see it whole or not at all, whoever else is
writing (:mod:`specklegen.core.whole_files`). A folder that cannot be written, or a file
that is damaged, costs an estimate and nothing else.
"""

import hashlib
import io
from functools import lru_cache
from pathlib import Path

import numpy as np

from specklegen.core.whole_files import sweep, write_whole
from specklegen.kernels.cache import cache_root, say_once
from specklegen.memory_effects.correlation import MemoryEffectCorrelation
from specklegen.scene.media import Slab

LIMIT = 2000  # files, about 0.2 MB each; the oldest go first
_SUFFIX = ".kernel"
_DIGEST = 32  # bytes of SHA-256
_SOURCES = ("kernels/*.py", "paths/*.py", "core/random_streams.py", "memory_effects/correlation.py")


def folder() -> Path:
    """Where kernels are kept: under SPECKLEGEN_CACHE, by default the user's cache directory."""
    return cache_root() / "memory-kernels"


def path_of(slab: Slab, paths: int) -> Path:
    """File of the kernel that ``paths`` paths give of a slab."""
    key = hashlib.sha256(f"{_sources_digest()} {slab.fingerprint()} {paths}".encode()).hexdigest()
    return folder() / (key + _SUFFIX)


def load(file: Path) -> MemoryEffectCorrelation | None:
    """Read a kernel; None where there is no file, or a damaged one."""
    try:
        content = file.read_bytes()
    except OSError:
        return None
    digest, payload = content[:_DIGEST], content[_DIGEST:]
    if hashlib.sha256(payload).digest() != digest:
        say_once(f"{file} is damaged, so its memory-effect correlation is estimated anew")
        return None
    with np.load(io.BytesIO(payload), allow_pickle=False) as data:
        return MemoryEffectCorrelation(
            data["radius"], data["weights"], int(data["paths"]), float(data["single_share"]), source="cache"
        )


def store(kernel: MemoryEffectCorrelation, file: Path) -> None:
    """Keep a kernel, if the folder can be written."""
    buffer = io.BytesIO()
    np.savez_compressed(
        buffer, radius=kernel.radius, weights=kernel.weights, paths=kernel.paths, single_share=kernel.single_share
    )
    payload = buffer.getvalue()
    try:
        file.parent.mkdir(parents=True, exist_ok=True)
        write_whole(file, hashlib.sha256(payload).digest() + payload)
        _make_room(file.parent)
    except OSError as error:
        say_once(f"memory-effect correlations cannot be kept in {file.parent}; each process estimates anew: {error}")


def _make_room(where: Path) -> None:
    sweep(where.glob("*.partial"))
    kept = list(where.glob("*" + _SUFFIX))
    if len(kept) > LIMIT:
        for file in sorted(kept, key=_age)[: len(kept) - LIMIT]:
            _remove(file)


def _age(file: Path) -> float:
    try:
        return file.stat().st_mtime
    except OSError:
        return 0.0


def _remove(file: Path) -> None:
    try:
        file.unlink(missing_ok=True)
    except OSError:
        pass


@lru_cache(maxsize=1)
def _sources_digest() -> str:
    root = Path(__file__).parents[1]
    digest = hashlib.sha256()
    for pattern in _SOURCES:
        found = sorted(root.glob(pattern))
        if not found:
            raise FileNotFoundError(f"no source matches {pattern} in {root}: name the files that the estimator now has")
        for file in found:
            digest.update(file.read_bytes())
    return digest.hexdigest()
