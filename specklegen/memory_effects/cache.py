"""Correlations kept on disk: what a material's correlation cost is paid once per user.

A file is named by the digest of everything that decides its content (material, paths, the sources of the
estimator; of its last bits the versions of libraries and the processor) and starts with the digest of the rest
of it. Readers see it whole or not at all, whoever else is writing (:mod:`specklegen.core.whole_files`). A folder
that cannot be written, or a file that is damaged, costs an estimate and nothing else.
"""

import hashlib
import io
import os
import platform
from functools import lru_cache
from pathlib import Path

import numpy as np
from llvmlite.binding import get_host_cpu_name

from specklegen.core.libraries import library_versions
from specklegen.core.whole_files import sweep, write_whole
from specklegen.kernels.cache import cache_root, say_once
from specklegen.memory_effects.correlation import MemoryEffectCorrelation
from specklegen.scene.media import Slab

LIMIT = 2000  # files, about 0.2 MB each; the oldest go first
_SUFFIX = ".kernel"
_DIGEST = 32  # bytes of SHA-256
_SOURCES = (
    "kernels/*.py", "paths/*.py", "scene/*.py", "scene/scatterers/*.py", "core/random_streams.py", "core/quadrature.py",
    "memory_effects/correlation.py",
)  # fmt: skip


def folder() -> Path:
    """Where correlations are kept: under SPECKLEGEN_CACHE, by default the user's cache directory."""
    return cache_root() / "memory-kernels"


def path_of(slab: Slab, paths: int) -> Path:
    """File of the correlation that ``paths`` paths give of a slab."""
    key = hashlib.sha256(f"{_sources_digest()} {_arithmetic()} {slab.fingerprint()} {paths}".encode()).hexdigest()
    return folder() / (key + _SUFFIX)


def load(file: Path) -> MemoryEffectCorrelation | None:
    """Read a correlation; None where there is no file, or a damaged one."""
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


def store(correlation: MemoryEffectCorrelation, file: Path) -> None:
    """Keep a correlation, if the folder can be written."""
    buffer = io.BytesIO()
    np.savez_compressed(
        buffer,
        radius=correlation.radius,
        weights=correlation.weights,
        paths=correlation.paths,
        single_share=correlation.single_share,
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


def _arithmetic() -> str:
    """What decides last bits besides: a home folder may be shared by machines, and outlives libraries."""
    chosen = [os.environ.get(name, "") for name in ("NUMBA_CPU_NAME", "NUMBA_CPU_FEATURES", "MKL_CBWR")]
    return f"{sorted(library_versions().items())} {platform.machine()} {get_host_cpu_name()} {chosen}"


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
