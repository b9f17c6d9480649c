"""How much memory this process holds, and this machine has."""

import os
from pathlib import Path

from specklegen.core.errors import reject

_STATUS, _RESET = Path("/proc/self/status"), Path("/proc/self/clear_refs")


def resident_memory() -> tuple[int, int]:
    """Bytes of this process resident now, and at the most since the last call.

    Raises
    ------
    OSError, KeyError
        Where the system does not tell; Linux does.
    """
    # Not getrusage: its maximum cannot be reset, and survives exec, so that a child would report its parent's.
    lines = dict(line.split(":", 1) for line in _STATUS.read_text().splitlines())
    _RESET.write_text("5")
    now, most = (int(lines[key].split()[0]) * 1024 for key in ("VmRSS", "VmHWM"))
    return now, most


def available_memory() -> int:
    """Bytes of memory of this machine."""
    return os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")


def require_memory(owner: str, rule: str, needed: float, what: str, remedy: str, *, share: float = 0.5) -> None:
    """Refuse what would not fit into a share of this machine's memory, before any of it is allocated.

    Parameters
    ----------
    owner, rule
        What must be how: "covariance", "held".
    needed
        Bytes.
    what
        What needs them, for the message.
    remedy
        What to do instead.
    share
        Of the machine's memory that may be taken.

    Raises
    ------
    RuleError
        With the bytes there are and the bytes it takes.
    """
    allowed = share * available_memory()
    if not needed <= allowed:
        reject(owner, f"{rule} within {_gibibytes(allowed)}", f"{_gibibytes(needed)} for {what}", remedy)


def _gibibytes(count: float) -> str:
    return f"{count / 2**30:.1f} GiB" if count < 2**50 else f"{count / 2**30:.1e} GiB"
