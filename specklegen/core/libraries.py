"""The libraries that decide the last bits of a result, with their versions."""

import os
import platform
from functools import lru_cache
from importlib.metadata import PackageNotFoundError, version

from llvmlite.binding import get_host_cpu_name

DISTRIBUTION = "specklegen-torch"
"""Name of this package for pip; on the package index ``specklegen`` is somebody else's."""
DECIDING = ("specklegen", "numpy", "scipy", "torch", "numba", "llvmlite", "finufft", "pillow", "matplotlib")
"""Arithmetic, transforms and compilers; Pillow and Matplotlib draw and resample the hidden objects."""
_version = lru_cache(version)  # reads a file, of a sixth of a megabyte for some


def library_versions() -> dict[str, str]:
    """Version of each library that is installed: stored with what was made, to explain a last bit that differs."""
    versions = {}
    for name in DECIDING:
        try:
            versions[name] = _version(DISTRIBUTION if name == "specklegen" else name)
        except PackageNotFoundError:  # specklegen itself, in a clone that is not installed
            continue
    return versions


@lru_cache(maxsize=1)
def arithmetic() -> str:
    """Return what decides last bits beside sources: machines may share a home folder, which outlives libraries."""
    chosen = [os.environ.get(name, "") for name in ("NUMBA_CPU_NAME", "NUMBA_CPU_FEATURES", "MKL_CBWR")]
    return f"{sorted(library_versions().items())} {platform.machine()} {get_host_cpu_name()} {chosen}"
