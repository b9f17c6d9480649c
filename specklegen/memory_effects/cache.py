"""Correlations kept on disk: what a material's correlation cost is paid once per user.

A file is named by the digest of everything that decides its content (material, paths, the sources of the
estimator; of its last bits the versions of libraries and the processor) and starts with the digest of the rest
of it. Readers see it whole or not at all, whoever else is writing (:mod:`specklegen.core.whole_files`). A folder
that cannot be written, or a file that is damaged, costs an estimate and nothing else.
"""

import dataclasses
import hashlib
import io
from collections.abc import Callable
from functools import lru_cache
from pathlib import Path
from typing import TypeVar

import numpy as np

from specklegen.core.kept_files import cache_root, keep, kept_content, make_room
from specklegen.core.libraries import arithmetic
from specklegen.core.values import read_only
from specklegen.kernels.cache import say_once
from specklegen.scene.media import PlaneMedium

LIMIT = 2000  # files; the oldest go first ...
LIMIT_BYTES = 2**30  # ... and of all files together
MOST_BYTES = 2**26  # of one: a larger one, of millions of paths, is for a process
_SUFFIX = ".kernel"
_SOURCES = (
    "kernels/*.py", "paths/*.py", "scene/*.py", "scene/scatterers/*.py", "core/random_streams.py", "core/quadrature.py",
    "core/statistics.py", "memory_effects/correlation.py", "memory_effects/oblique.py",
    "memory_effects/polarised_fields.py",
)  # fmt: skip

Correlation = TypeVar("Correlation")
"""A dataclass of arrays and numbers."""


def folder() -> Path:
    """Where correlations are kept: under SPECKLEGEN_CACHE, by default the user's cache directory."""
    return cache_root() / "memory-kernels"


def path_of(medium: PlaneMedium, paths: int, *about: object) -> Path:
    """File of what ``paths`` paths tell of a medium; ``about`` is all else that decides it."""
    key = hashlib.sha256(f"{_sources_digest()} {arithmetic()} {medium.fingerprint()} {paths}".encode())
    for each in about:
        key.update(f" {each!r}".encode())
    return folder() / (key.hexdigest() + _SUFFIX)


def found(
    kind: type[Correlation], medium: PlaneMedium, paths: int, about: tuple, estimate: Callable[[], Correlation]
) -> tuple[Correlation, bool]:
    """What is on disk, or estimated now and kept there, and whether it was there; nobody can write into its arrays."""
    file = path_of(medium, paths, kind.__name__, *about)
    read = load(file, kind)
    if read is not None:
        return read, True
    estimated = estimate()
    for value in vars(estimated).values():
        if isinstance(value, np.ndarray):
            read_only(value)
    store(estimated, file)
    return estimated, False


def load(file: Path, kind: type[Correlation]) -> Correlation | None:
    """Read a correlation; None where there is no file, or a damaged one."""
    payload = kept_content(file)
    if payload is None:
        if file.exists():
            say_once(f"{file} is damaged, so its memory-effect correlation is estimated anew")
        return None
    with np.load(io.BytesIO(payload), allow_pickle=False) as data:
        read = {name: data[name] for name in data.files}
    return kind(**{name: read_only(each) if each.ndim else each.item() for name, each in read.items()})


def store(correlation: object, file: Path) -> None:
    """Keep a correlation, if the folder can be written and it is not huge."""
    buffer = io.BytesIO()
    fields = {each.name: getattr(correlation, each.name) for each in dataclasses.fields(correlation)}  # type: ignore[arg-type]
    np.savez(buffer, **{name: each for name, each in fields.items() if each is not None})
    payload = buffer.getvalue()
    if len(payload) > MOST_BYTES:
        return
    try:
        keep(file, payload)
        make_room(file.parent, _SUFFIX, LIMIT, LIMIT_BYTES)
    except OSError as error:
        say_once(f"memory-effect correlations cannot be kept in {file.parent}; each process estimates anew: {error}")


@lru_cache(maxsize=1)
def _sources_digest() -> str:
    root = Path(__file__).parents[1]
    digest = hashlib.sha256()
    for pattern in _SOURCES:
        sources = sorted(root.glob(pattern))
        if not sources:
            raise FileNotFoundError(f"no source matches {pattern} in {root}: name the files that the estimator now has")
        for file in sources:
            digest.update(file.read_bytes())
    return digest.hexdigest()
