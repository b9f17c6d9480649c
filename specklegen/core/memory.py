"""How much memory this process holds, and this machine has."""

import os
from pathlib import Path

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
