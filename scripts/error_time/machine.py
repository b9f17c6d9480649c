"""The circumstances of a measurement: machine, load, commit."""

import json
import os
import platform
import subprocess
from pathlib import Path

_FILE = "runs.json"


def circumstances() -> dict[str, str | float]:
    """Of a measurement that ends now; the load is the mean over five minutes."""
    return {
        "machine": f"{_processor()}, {os.cpu_count()} cores",
        "load": round(os.getloadavg()[1], 1),
        "commit": commit(),
    }


def commit() -> str:
    """The checkout's commit, short."""
    found = subprocess.run(["git", "rev-parse", "--short", "HEAD"], capture_output=True, text=True)
    return found.stdout.strip() or "unknown"


def _processor() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
        return next(line.split(":", 1)[1].strip() for line in lines if line.startswith("model name"))
    except (OSError, StopIteration):
        return platform.machine()


def stored(folder: Path) -> dict[str, dict]:
    """Circumstances by scene."""
    path = folder / _FILE
    return json.loads(path.read_text()) if path.exists() else {}


def store(folder: Path, about: dict[str, dict]) -> None:
    """Write them."""
    (folder / _FILE).write_text(json.dumps(about, indent=1, sort_keys=True) + "\n")
