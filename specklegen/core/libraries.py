"""The libraries that decide the last bits of a result, with their versions."""

import hashlib
import os
import platform
from functools import lru_cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

from llvmlite.binding import get_host_cpu_name

DISTRIBUTION = "specklegen-torch"
"""What pip knows this package as; on the package index ``specklegen`` is somebody else's."""
DECIDING = ("specklegen", "numpy", "scipy", "torch", "numba", "llvmlite", "finufft", "pillow", "matplotlib")
"""Arithmetic, transforms and compilers; Pillow and Matplotlib draw and resample the hidden objects."""
_version = lru_cache(version)  # reads a file, of a sixth of a megabyte for some


def library_versions() -> dict[str, str]:
    """Version of each library that is installed: kept with what was made, to explain a last bit that differs."""
    versions = {}
    for name in DECIDING:
        try:
            versions[name] = _version(DISTRIBUTION if name == "specklegen" else name)
        except PackageNotFoundError:  # specklegen itself, in a clone that is not installed
            continue
    return versions


def arithmetic() -> str:
    """What decides last bits beside sources: a home folder may be shared by machines, and outlives libraries."""
    chosen = [os.environ.get(name, "") for name in ("NUMBA_CPU_NAME", "NUMBA_CPU_FEATURES", "MKL_CBWR")]
    return f"{sorted(library_versions().items())} {platform.machine()} {get_host_cpu_name()} {chosen}"


@lru_cache(maxsize=2)
def package_digest(*left_out: str) -> str:
    """SHA-256, in hexadecimal, of every file of this package, of its data too, and of their names.

    Folders of the package that are ``left_out`` do not count.
    """
    root, digest = Path(__file__).parents[1], hashlib.sha256()
    for folder, inner, names in os.walk(root, followlinks=True):  # of a clone: two of its folders are links
        without = {"__pycache__", *(left_out if Path(folder) == root else ())}
        inner[:] = sorted(name for name in inner if name not in without)
        for file in (Path(folder, name) for name in sorted(names)):
            content = file.read_bytes()
            digest.update(f"{file.relative_to(root)} {len(content)} ".encode() + content)
    return digest.hexdigest()
