"""Everything that can run on a GPU, on a device that is none of the host's: in a process, since torch has one such."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

HERE = Path(__file__).parent


@pytest.mark.parametrize("marked", ["not slow", pytest.param("slow", marks=pytest.mark.slow)])
def test_on_a_device_apart(marked):
    """Streams, inputs, targets, training, judging: nothing takes the device's memory for the host's."""
    asked = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "-m", marked, HERE / "apart_cases.py"]
    done = subprocess.run(
        asked, cwd=HERE.parent, env=os.environ | {"OMP_NUM_THREADS": "1"}, capture_output=True, text=True, check=False
    )
    said = "\n".join(line for line in done.stdout.splitlines() if "registered at" not in line)
    assert done.returncode == 0, said[-8000:]
    assert " passed" in said
