"""The fork server: what it has imported is what workers need, and starts no other threads."""

import subprocess
import sys

import pytest
from scenes import ROOT

PROGRAM = """
import os, sys
from importlib import import_module
from specklegen.datasets.workers import PRELOAD

def threads():
    return len(os.listdir("/proc/self/task"))

import numpy, scipy.linalg, torch  # their OpenBLAS has threads, and ends them before a fork
before = threads()
for name in PRELOAD:
    import_module(name)
known = set(sys.modules)
from specklegen.datasets import load_recipe, recipe_names
made = [load_recipe(name) for name in recipe_names()]
more = sorted(name for name in sys.modules if name not in known and name.startswith(("specklegen", "scipy")))
print(len(made) > 20, more, threads() - before)
"""


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="counts threads as Linux lists them")
def test_a_worker_imports_nothing_more_to_make_a_packaged_recipe():
    done = subprocess.run([sys.executable, "-c", PROGRAM], cwd=ROOT, capture_output=True, text=True, check=True,
                          timeout=300)  # fmt: skip
    assert done.stdout == "True [] 0\n"
