"""Memory that this process holds, and may hold: the machine's, a cgroup's, Slurm's and ``ulimit``'s bounds."""

import contextlib
import os
import re
from collections.abc import Callable, Mapping
from functools import cache
from pathlib import Path

import numpy as np

from specklegen.core.errors import reject

_SMALL = 2**24  # bytes: fewer are on any machine, and asking the system takes as long as small media do
_PACKAGE = __name__.partition(".")[0]
_STATUS, _RESET = Path("/proc/self/status"), Path("/proc/self/clear_refs")


def resident_memory() -> tuple[int, int]:
    """Bytes of this process resident now, and at the most since the last call.

    Raises
    ------
    OSError, KeyError
        Where the system does not tell; Linux does.
    """
    # Not getrusage: its maximum cannot be reset, and survives exec, so that a child would report its parent's.
    lines = _lines(_STATUS)
    _RESET.write_text("5")
    return lines["VmRSS"], lines["VmHWM"]


@cache
def memory_limit() -> int:
    """Bytes that this process may ever hold: the least of the machine's memory, its cgroups' limits and Slurm's."""
    return min([os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES"), *_cgroup_limits(), *_slurm_limits()])


def available_memory() -> int:
    """Bytes that this process may hold now: the least of its limit, the free memory, and the rest of ``ulimit -v``.

    Other programs change it while one looks: refusals alone may depend on it, never a result.
    """
    return max(0, min([memory_limit(), *_bounds_now()]))


def _cgroup_limits(root: Path = Path("/sys/fs/cgroup"), groups: Path = Path("/proc/self/cgroup")) -> list[int]:
    """Limits of the process's control groups, of version 1 and 2, and of all groups that hold them."""
    limits = []
    try:
        lines = [line.split(":", 2) for line in groups.read_text().splitlines()]
    except OSError:
        return []
    for _, controllers, path in (line for line in lines if len(line) == 3):
        if controllers and "memory" not in controllers.split(","):
            continue
        base, name = (root / "memory", "memory.limit_in_bytes") if controllers else (root, "memory.max")
        here = base / path.strip("/")
        # In a container the group's path may not be visible: its limit then stands at the root.
        for folder in [here, *(above for above in here.parents if above.is_relative_to(base))]:
            with contextlib.suppress(OSError, ValueError):  # "max" where there is no limit
                limits.append(int((folder / name).read_text()))
    return limits


def _slurm_limits() -> list[int]:
    """Return what a job of Slurm asked for on this machine, MiB in the environment; 0 there means all of it."""
    requests = [os.environ.get("SLURM_MEM_PER_NODE", "")]
    per_core, cores = (os.environ.get(f"SLURM_{name}", "") for name in ("MEM_PER_CPU", "CPUS_ON_NODE"))
    if per_core.isdecimal() and cores.isdecimal():
        requests.append(str(int(per_core) * int(cores)))
    return [int(request) * 2**20 for request in requests if request.isdecimal() and int(request) > 0]


def _bounds_now() -> list[int]:
    """Bytes that the system could give without swapping, and that ``ulimit -v`` leaves to this process."""
    bounds = []
    with contextlib.suppress(OSError, KeyError):
        bounds.append(_lines(Path("/proc/meminfo"))["MemAvailable"])
    with contextlib.suppress(ImportError):  # Windows has no such limits
        import resource

        limit, _ = resource.getrlimit(resource.RLIMIT_AS)
        if limit != resource.RLIM_INFINITY:
            bounds.append(limit)
            with contextlib.suppress(OSError, KeyError):
                bounds.append(limit - _lines(_STATUS)["VmSize"])
    return bounds


def _lines(file: Path) -> dict[str, int]:
    """Bytes by name, from a file of the system that states them in kB."""
    stated = re.findall(r"^(\w+):\s*(\d+) kB$", file.read_text(), re.MULTILINE)
    return {name: int(kibibytes) * 1024 for name, kibibytes in stated}


def array_bytes(value: object) -> int:
    """Bytes of all arrays and tensors within a value of this library, or within lists and tables, each once."""
    sizes: dict[object, int] = {}
    visited: set[int] = set()
    left = [value]
    while left:
        thing = left.pop()
        if id(thing) in visited:
            continue
        visited.add(id(thing))  # what holds them is held by the caller: no number comes twice
        if isinstance(thing, np.ndarray):
            while isinstance(thing.base, np.ndarray):
                thing = thing.base
            sizes[id(thing)] = thing.nbytes
        elif hasattr(thing, "untyped_storage"):
            storage = thing.untyped_storage()
            sizes[storage.data_ptr() or id(thing)] = storage.nbytes()
        elif isinstance(thing, Mapping):
            left += thing.values()
        elif isinstance(thing, list | tuple | set | frozenset):
            left += thing
        elif type(thing).__module__.startswith(_PACKAGE) and not isinstance(thing, type):
            left += getattr(thing, "__dict__", {}).values()
    return sum(sizes.values())


def require_memory(
    owner: str, rule: str, needed: float, what: str, remedy: str | Callable[[], str], *, share: float = 0.5
) -> None:
    """Refuse what would not fit into a share of the memory there is, before any of it is allocated.

    Parameters
    ----------
    owner, rule
        What must be how: "covariance", "held".
    needed
        Bytes.
    what
        What needs them, for the message.
    remedy
        What to do instead, or what says it, asked where it is needed.
    share
        Of :func:`available_memory` that may be taken.
    """
    if needed <= _SMALL:
        return
    allowed = share * available_memory()
    if not needed <= allowed:
        instead = remedy if isinstance(remedy, str) else remedy()
        reject(owner, f"{rule} within {_gibibytes(allowed)}", f"{_gibibytes(needed)} for {what}", instead)


def _gibibytes(count: float) -> str:
    return f"{count / 2**30:.1f} GiB" if count < 2**50 else f"{count / 2**30:.1e} GiB"
