"""What a user does on a device that is none of the host's; torch has one such device a process."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

HERE = Path(__file__).parent


@pytest.mark.parametrize("marked", ["not slow", pytest.param("slow", marks=pytest.mark.slow)])
def test_on_a_device_apart(marked):
    """Nothing of :mod:`apart_cases` takes the device's memory for the host's."""
    done = subprocess.run(
        [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "-m", marked, HERE / "apart_cases.py"],
        cwd=HERE.parent, env=os.environ | {"OMP_NUM_THREADS": "1"}, capture_output=True, text=True, check=False,
    )  # fmt: skip
    lines = "\n".join(line for line in done.stdout.splitlines() if "registered at" not in line)
    assert done.returncode == 0, lines[-8000:]
    assert " passed" in lines
