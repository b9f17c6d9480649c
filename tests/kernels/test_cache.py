"""The cache of compiled kernels: each test runs processes of its own."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from scenes import ROOT

from specklegen.kernels import rng

PROGRAM = """
import numpy as np
{first}
from specklegen.kernels import rng
for _ in range(2):
    out = np.empty((1, 2))
    rng.fill_normals(0, 0, 0, out)
stats = rng.fill_normals.stats
print(out[0, 0].hex(), "hits", sum(stats.cache_hits.values()), "misses", sum(stats.cache_misses.values()))
"""
DRAWN = np.empty((1, 2))
rng.fill_normals(0, 0, 0, DRAWN)
RIGHT = DRAWN[0, 0].hex()


def run(folder: Path, first: str = "", checkout: Path = ROOT, **settings: str) -> tuple[str, str]:
    """Run the program with its cache in a folder; return its output and warnings."""
    done = subprocess.run([sys.executable, "-c", PROGRAM.format(first=first)], capture_output=True, text=True,
                          timeout=120, cwd=checkout,
                          env=os.environ | {"SPECKLEGEN_CACHE": str(folder)} | settings)  # fmt: skip
    assert done.returncode == 0, done.stderr
    return done.stdout.strip(), done.stderr


@pytest.fixture(scope="module")
def filled(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("filled")
    said, warned = run(folder)
    assert said.startswith(f"{RIGHT} hits 0")
    assert warned == ""
    return folder


def test_a_whole_cache_is_used_in_silence(filled):
    assert run(filled) == (f"{RIGHT} hits 1 misses 0", "")


def test_what_is_read_needs_no_compiler_and_leaves_it_whole(filled):
    """Reading imports none of what Numba can translate; what compiles afterwards finds it, and calls what was read."""
    program = """
import sys, numpy as np
from specklegen.kernels import rng
out = np.empty((1, 2))
rng.fill_normals(0, 0, 0, out)
assert sum(rng.fill_normals.stats.cache_hits.values()) == 1
read = out[0, 0].hex(), [name for name in ("numba.np.linalg", "numba.np.npyimpl") if name in sys.modules]
from numba import njit
@njit
def compiled(matrix, normals):
    rng.fill_normals(0, 0, 0, normals)
    return np.linalg.det(matrix) + np.sort(matrix.ravel())[-1]
out[:] = 0
print(*read, round(compiled(np.array([[2.0, 1.0], [1.0, 4.0]]), out), 9), out[0, 0].hex())
"""
    done = subprocess.run([sys.executable, "-c", program], env=os.environ | {"SPECKLEGEN_CACHE": str(filled)},
                          capture_output=True, text=True, timeout=300, cwd=ROOT)  # fmt: skip
    assert done.stdout == f"{RIGHT} [] 11.0 {RIGHT}\n", done.stderr


def test_another_checkout_of_the_same_sources_uses_it(filled, tmp_path):
    """At another path, its files written later; a changed source compiles anew."""
    package = tmp_path / "specklegen"
    package.mkdir()
    for path in (ROOT / "specklegen").iterdir():
        if path.name not in ("kernels", "disk_cache.py", "__pycache__"):
            (package / path.name).symlink_to(path)
    shutil.copytree(ROOT / "specklegen" / "kernels", package / "kernels", copy_function=shutil.copyfile)
    shutil.copyfile(ROOT / "specklegen" / "disk_cache.py", package / "disk_cache.py")
    first = f"import specklegen.kernels.cache as cache; assert cache.__file__.startswith({str(package)!r})"
    folder = shutil.copytree(filled, tmp_path / "cache")
    assert run(folder, first, tmp_path) == (f"{RIGHT} hits 1 misses 0", "")
    with (package / "kernels" / "rng.py").open("a") as source:
        source.write("# changed\n")
    assert run(folder, first, tmp_path)[0] == f"{RIGHT} hits 0 misses 1"


def test_kernels_that_others_could_have_written_are_not_run(filled, tmp_path):
    folder = shutil.copytree(filled, tmp_path / "cache")
    folder.chmod(0o777)
    said, warned = run(folder)
    assert said == f"{RIGHT} hits 0 misses 1"
    assert warned.count("since other users could have changed it") == 1


def test_kernels_of_no_optimisation_work_and_are_not_cached(tmp_path):
    """Their code holds addresses of the process."""
    assert run(tmp_path, NUMBA_OPT="0") == (f"{RIGHT} hits 0 misses 1", "")
    assert not [path for path in tmp_path.rglob("*") if path.is_file()]
