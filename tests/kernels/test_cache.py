"""The cache of compiled kernels: each test runs processes of its own, as the cache is chosen once in a process."""

import ast
import os
import shutil
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest
from scenes import ROOT

from specklegen.kernels import cache

PROGRAM = """
import sys, numba, numpy as np
before = numba.config.CACHE_DIR
import specklegen.kernels.cache as cache
{first}
from specklegen.kernels import rng
for _ in range(2):
    out = np.empty((1, 4), np.uint32)
    rng.philox_words(0, 0, np.zeros((1, 4), np.uint32), out)
assert numba.config.CACHE_DIR == before
stats = rng.philox_words.stats
print(hex(out[0, 0]), "hits", sum(stats.cache_hits.values()), "misses", sum(stats.cache_misses.values()))
"""
RIGHT = "0x6627e8d5"
KERNELS = sorted((ROOT / "specklegen").glob("**/kernels/*.py"))
FRESNEL = Path(cache.__file__).with_name("fresnel.py")
SHARED = {Path(cache.__file__), Path(cache.__file__).with_name("__init__.py")}


def run(folder: Path, first: str = "", checkout: Path = ROOT) -> tuple[str, str]:
    """What the program prints with its cache in a folder: (output, warnings)."""
    done = subprocess.run(
        [sys.executable, "-c", PROGRAM.format(first=first)], env=os.environ | {"SPECKLEGEN_CACHE": str(folder)},
        capture_output=True, text=True, timeout=120, cwd=checkout,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    return done.stdout.strip(), done.stderr


@pytest.fixture(scope="module")
def filled(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("filled")
    said, warned = run(folder)
    assert said.startswith(f"{RIGHT} hits 0")
    assert warned == ""
    return folder


def imports(file: Path) -> set[Path]:
    """Files of the package that a file imports, by the parser."""
    names = set()
    for node in ast.walk(ast.parse(file.read_text())):
        if isinstance(node, ast.ImportFrom):
            names |= {node.module, *(f"{node.module}.{alias.name}" for alias in node.names)}
        elif isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
    stems = [ROOT.joinpath(*name.split(".")) for name in names if name]
    tried = [path for stem in stems for path in (stem.with_suffix(".py"), stem / "__init__.py")]
    return {path for path in tried if path.is_file()}


def reached(file: Path) -> set[Path]:
    """What decides a file's compiled kernels: it, all that it imports, and how kernels are compiled and kept."""
    found, new = set(), {file, *SHARED}
    while new:
        found |= new
        new = {path for source in new for path in imports(source)} - found
    return found


@pytest.mark.parametrize("file", KERNELS, ids=lambda file: file.stem)
def test_sources_of_a_file_are_what_it_imports_and_nothing_else(file):
    assert cache.sources_of(file) == reached(file)
    assert cache.sources_of(file) <= set(KERNELS)


def test_digest_follows_every_source_and_no_other_file(tmp_path, monkeypatch):
    before = cache.source_digest(FRESNEL)
    folder = shutil.copytree(FRESNEL.parent, tmp_path / "specklegen" / "kernels")
    monkeypatch.setattr(cache, "__file__", str(folder / "cache.py"))
    assert cache.source_digest(folder / FRESNEL.name) == before
    for path in sorted(folder.glob("*.py")):
        with path.open("a") as source:
            source.write("# changed\n")
        after = cache.source_digest(folder / FRESNEL.name)
        assert (after != before) == (path.name in {source.name for source in reached(FRESNEL)}), path.name
        before = after


def test_a_whole_cache_is_used_in_silence(filled):
    assert run(filled) == (f"{RIGHT} hits 1 misses 0", "")


def test_what_is_read_needs_no_compiler_and_leaves_it_whole(filled):
    """Reading imports none of what Numba can translate; what compiles afterwards finds it, and calls what was read."""
    program = """
import sys, numpy as np
from specklegen.kernels import rng
out = np.empty((1, 4), np.uint32)
rng.philox_words(0, 0, np.zeros((1, 4), np.uint32), out)
assert sum(rng.philox_words.stats.cache_hits.values()) == 1
read = hex(out[0, 0]), [name for name in ("numba.np.linalg", "numba.np.npyimpl") if name in sys.modules]
from numba import njit
@njit
def compiled(matrix, words):
    rng.philox_words(0, 0, np.zeros((1, 4), np.uint32), words)
    return np.linalg.det(matrix) + np.sort(matrix.ravel())[-1]
out[:] = 0
print(*read, round(compiled(np.array([[2.0, 1.0], [1.0, 4.0]]), out), 9), hex(out[0, 0]))
"""
    done = subprocess.run(
        [sys.executable, "-c", program], env=os.environ | {"SPECKLEGEN_CACHE": str(filled)}, capture_output=True,
        text=True, timeout=300, cwd=ROOT,
    )  # fmt: skip
    assert done.stdout == f"{RIGHT} [] 11.0 {RIGHT}\n", done.stderr


def test_another_checkout_of_the_same_sources_uses_it(filled, tmp_path):
    """At another path, its files written later; a changed source compiles anew."""
    package, kernels = tmp_path / "specklegen", tmp_path / "specklegen" / "kernels"
    package.mkdir()
    for each in (ROOT / "specklegen").iterdir():
        if each.name not in ("kernels", "__pycache__"):
            (package / each.name).symlink_to(each)
    shutil.copytree(ROOT / "specklegen" / "kernels", kernels, copy_function=shutil.copyfile)
    first = f"assert cache.__file__.startswith({str(package)!r})"
    folder = shutil.copytree(filled, tmp_path / "cache")
    assert run(folder, first, tmp_path) == (f"{RIGHT} hits 1 misses 0", "")
    with (kernels / "rng.py").open("a") as source:
        source.write("# changed\n")
    assert run(folder, first, tmp_path)[0] == f"{RIGHT} hits 0 misses 1"


def test_what_two_processes_compile_at_a_time_is_kept_of_both(tmp_path):
    one, other = cache._CheckedFiles(tmp_path, "kernel"), cache._CheckedFiles(tmp_path, "kernel")
    assert one.load("int") is other.load("float") is None
    one.save("int", 1)
    other.save("float", 2.0)
    for files in (one, other):
        assert (files.load("int"), files.load("float")) == (1, 2.0)
    one._path("int").rename(one._path("bool"))  # as if both had one name
    assert one.load("bool") is None
    one.flush()
    assert list(tmp_path.iterdir()) == []


def test_a_place_that_is_no_folder_is_said_and_left_alone(tmp_path):
    blocked = tmp_path / "a file, not a folder"
    blocked.write_text("")
    said, warned = run(blocked)
    assert said == f"{RIGHT} hits 0 misses 1"
    assert warned.count("no compiled-kernel cache") == 1
    assert "SPECKLEGEN_CACHE" in warned
    assert blocked.read_text() == ""


@pytest.mark.parametrize("damage", ["half", "empty", "flipped"])
def test_a_damaged_file_is_compiled_anew_and_said_once(filled, tmp_path, damage):
    folder = shutil.copytree(filled, tmp_path / "cache")
    for file in folder.rglob("*.nbc"):
        content = bytearray(file.read_bytes())
        content[len(content) // 2] ^= 1
        file.write_bytes({"half": content[: len(content) // 2], "empty": b"", "flipped": content}[damage])
    said, warned = run(folder)
    assert said == f"{RIGHT} hits 0 misses 1"
    assert warned.count("cannot be read, so they compile anew") == 1
    assert run(folder) == (f"{RIGHT} hits 1 misses 0", "")  # and it is whole again


def test_a_folder_that_others_can_write_is_left_alone(filled, tmp_path):
    folder = shutil.copytree(filled, tmp_path / "cache")
    inner = next((folder / "kernels").iterdir())
    inner.chmod(0o777)
    said, warned = run(folder)
    assert said == f"{RIGHT} hits 0 misses 1"
    assert warned.count("can be written by other users") == 1


def test_a_new_folder_is_its_users_alone(filled):
    assert next((filled / "kernels").iterdir()).stat().st_mode & 0o077 == 0


@pytest.mark.parametrize(
    ("owner", "mode", "reason"),
    [
        (7, 0o700, None), (7, 0o755, None), (0, 0o755, None),  # the administrator is trusted
        (8, 0o755, "belongs to another user"), (7, 0o775, "can be written by other users"),
        (0, 0o777, "can be written by other users"),
    ],
)  # fmt: skip
def test_only_what_the_user_or_the_administrator_wrote_is_run(tmp_path, monkeypatch, owner, mode, reason):
    monkeypatch.setattr(os, "getuid", lambda: 7)
    monkeypatch.setattr(Path, "stat", lambda self: SimpleNamespace(st_uid=owner, st_mode=mode))
    assert cache.distrust(tmp_path) == reason


def test_a_readable_folder_that_cannot_be_written_is_used_in_silence(filled):
    before = {file: file.stat().st_mtime_ns for file in filled.rglob("*")}
    assert run(filled, "cache.can_write = lambda folder: False") == (f"{RIGHT} hits 1 misses 0", "")
    assert {file: file.stat().st_mtime_ns for file in filled.rglob("*")} == before


def test_a_full_disk_is_said_once(tmp_path):
    """The kernel works, and one line says why the next start is slow."""
    first = "def full(*_): raise OSError(28, 'No space left on device')\ncache._CheckedFiles.save = full"
    said, warned = run(tmp_path, first)
    assert said == f"{RIGHT} hits 0 misses 1"
    assert warned.count("No space left on device") == 1
