"""The cases of :mod:`apart_cases` in a process of their own, since torch has one such device in a process."""

import os
import subprocess
import sys
from pathlib import Path

HERE = Path(__file__).parent
STREAMS = "streams_of or shown or asked or host"


def ended(which, marked):
    """Run the cases whose names match, with a mark or without: the exit status, and what was said."""
    asked = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "-m", marked, "-k", which]
    done = subprocess.run(
        [*asked, HERE / "apart_cases.py"], cwd=HERE.parent, env=os.environ | {"OMP_NUM_THREADS": "1"},
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    return done.returncode, "\n".join(line for line in done.stdout.splitlines() if "registered at" not in line)
