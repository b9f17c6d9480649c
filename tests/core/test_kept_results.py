"""Results that are kept between processes: a plan, and what is drawn by it, has the same bits with them and without."""

import ast
import dataclasses
import errno
import hashlib
import json
import multiprocessing
import os
import shutil
import subprocess
import sys
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import own_scatterers
import pytest
from forgotten import forget
from hypothesis import given, settings
from hypothesis import strategies as st
from scenes import ROOT, flat_box, views

import specklegen as sg
from specklegen.core import kept_files, kept_results, libraries
from specklegen.core.kept_files import cache_root, keep, kept_content
from specklegen.core.kept_results import SWITCH, from_plain, kept_result, to_plain

SLAB = sg.Slab(thickness=100.0, mean_free_path=20.0, scatterer=sg.HenyeyGreenstein(0.9))
BEAMS = sg.CollimatedBeams.tilts([0.0, 1e-4, 3e-4], width=5000.0)
STACK = sg.Scene(wavelength=0.5, medium=SLAB, illumination=BEAMS, sensor=sg.FarField.grid((16, 16), 2e-5))
HIDDEN = STACK.replace(illumination=sg.IncoherentObject(brightness=np.ones((6, 6)), pitch=1e-4, width=5000.0))
NARROW = sg.Scene(
    wavelength=1.0, medium=sg.Slab(thickness=2000.0, mean_free_path=400.0, scatterer=sg.VonMisesFisher(1000.0)),
    illumination=sg.CollimatedBeams.tilts([0.0, 0.001], width=2000.0), sensor=sg.FarField.grid((101, 101), 1 / 6000),
)  # fmt: skip
UPPER = sg.Layer(thickness=50.0, mean_free_path=20.0, scatterer=sg.HenyeyGreenstein(0.8), index=1.33)
STEPS = STACK.replace(medium=sg.Layers([UPPER, UPPER.replace(index=1.5)]))
BOX = flat_box([0.0, 5.0], views(np.arange(90.0, 270.0, 10.0)), half=5.0)
BOX_BEAMS = BOX.replace(illumination=sg.CollimatedBeams.tilts([0.0], width=4.0, dimensions=2))
SCENES = {
    "stack": (STACK, {}),
    "path sums": (STACK, {"sampler": "paths"}),
    "hidden": (HIDDEN, {}),
    "convolution": (HIDDEN, {"sampler": "convolution"}),
    "narrow lobes": (NARROW, {}),
    "steps": (STEPS, {}),
    "box": (BOX, {}),
}


@pytest.fixture
def cache(tmp_path, monkeypatch) -> Path:
    """A cache of its own, whose kernels are those of this user; this process may write what it likes."""
    kernels = cache_root() / "kernels"
    kernels.mkdir(mode=0o700, parents=True, exist_ok=True)
    (tmp_path / "kernels").symlink_to(kernels)
    monkeypatch.setenv("SPECKLEGEN_CACHE", str(tmp_path))
    monkeypatch.delenv(SWITCH)
    monkeypatch.setattr(kept_results._Room, "left", 10**6)
    yield tmp_path
    forget()


def files(cache: Path) -> list[Path]:
    return sorted((cache / "pilots").rglob("*.result"))


def outcome(name: str) -> tuple[str, bytes]:
    """What is said of a scene, and its first stack, as a process finds them that knows nothing yet."""
    forget()
    scene, asked = SCENES[name]
    made = sg.plan(scene, paths=500, **asked)
    stack = sg.render(scene, paths=500, seed=3, **asked)
    drawn = stack.field if scene.illumination.coherent else stack.intensity
    told = f"{made.explain()} {made.seconds!r} {made.memory_bytes} {dict(made.alternatives)!r} {made.doubts}"
    return told, np.asarray(drawn).tobytes()


def questions() -> list[str]:
    """Names of all questions whose results are kept: the first of what is told ``about`` each."""
    names = []
    for file in (ROOT / "specklegen").rglob("*.py"):
        for node in ast.walk(ast.parse(file.read_text())):
            told = node.args[1:2] if isinstance(node, ast.Call) and ast.unparse(node.func) == "kept_result" else []
            if isinstance(node, ast.Assign) and ast.unparse(node.targets[0]) == "about":
                told = [node.value]
            names += [each.elts[0].value for each in told if isinstance(each, ast.Tuple)]
    return names


@pytest.mark.parametrize("name", SCENES)
def test_plans_and_draws_have_the_same_bits_with_an_empty_cache_a_full_one_and_none(cache, monkeypatch, name):
    first, number = outcome(name), len(files(cache))
    assert number > 2
    again = outcome(name)
    assert len(files(cache)) == number
    for file in files(cache)[::2]:  # other processes have found a part of it
        file.unlink()
    left = len(files(cache))
    partly = outcome(name)
    assert left < len(files(cache)) <= number  # what only what is kept had asked for is not asked again
    monkeypatch.setenv(SWITCH, "anew")
    assert first == again == partly == outcome(name)


def test_whatever_is_kept_is_looked_at_by_some_of_these_scenes(cache, monkeypatch):
    asked = []
    monkeypatch.setattr(kept_results, "_file", lambda about: asked.append(about[0]))
    for name in SCENES:
        outcome(name)
    names = questions()
    assert len(names) == len(set(names)) >= 14, "two questions of one name"
    assert set(asked) == set(names)


def test_what_is_kept_is_what_is_used(cache):
    """Else the bits above would be the same for no merit."""
    _, drawn = outcome("path sums")
    (file,) = {kept_results._file(("threshold of a slab", STACK, False, turned)) for turned in (False, True)} & {
        *files(cache)
    }
    keep(file, json.dumps(json.loads(kept_content(file)) * 3).encode())
    assert outcome("path sums")[1] != drawn


PROGRAM = """
import hashlib, sys
from specklegen.datasets import load_recipe
recipe = load_recipe("unknown-slab")
sample = recipe.sample(0, "train", 0)
digest = hashlib.sha256(repr([each.explain() for each in recipe.plans()]).encode())
for name in sorted(sample):
    digest.update(f"{name} {sample[name]!r}".encode() if name == "parameters" else sample[name].tobytes())
print(digest.hexdigest())
"""


def test_a_sample_of_another_process_has_the_same_bits(cache):
    """Of sixteen plans: in a process that finds all, in one that reads all, and in one that is told to keep nothing."""
    told = []
    for switch in ("", "", "anew"):
        done = subprocess.run(
            [sys.executable, "-c", PROGRAM], cwd=ROOT, env=os.environ | {SWITCH: switch}, capture_output=True,
            text=True, timeout=600,
        )  # fmt: skip
        assert done.returncode == 0, done.stderr
        told.append((done.stdout, len(files(cache))))
    assert told[0] == told[1] == told[2]
    assert told[0][1] > 16


def test_a_damaged_result_is_found_anew(cache):
    first, whole = outcome("stack"), {file: file.read_bytes() for file in files(cache)}
    for n, file in enumerate(files(cache)):
        content = bytearray(whole[file])
        content[n * 7 % len(content)] ^= 1
        file.write_bytes(content if n % 2 else content[:-1])
    assert outcome("stack") == first
    assert {file: file.read_bytes() for file in files(cache)} == whole


def refused(*_):
    raise OSError(errno.ENOSPC, "no space left")


@pytest.mark.parametrize("way", ["a file in the way", "full"])
def test_a_folder_that_cannot_be_written_changes_nothing(cache, monkeypatch, way):
    monkeypatch.setenv(SWITCH, "anew")
    expected = outcome("stack")
    monkeypatch.delenv(SWITCH)
    if way == "full":
        monkeypatch.setattr(kept_files, "write_whole", refused)
    else:
        (cache / "pilots").write_text("in the way")
    assert outcome("stack") == expected
    assert kept_results._Room.left == 0


def test_many_threads_keep_one_result(cache):
    numbers = np.linspace(0.0, 1.0, 2000) ** 0.5

    def ask(_: int) -> np.ndarray:
        return kept_result(np.ndarray, ("tried",), lambda: numbers.copy())

    with ThreadPoolExecutor(8) as pool:
        found = list(pool.map(ask, range(200)))
    assert all(np.array_equal(each, numbers) for each in found)
    assert len(files(cache)) == 1
    assert not list(cache.rglob("*.partial"))


RACERS, RACED = 4, 200


def raced(wait: Callable[[], object] = lambda: None) -> tuple[str, int]:
    """Digest of all that a process finds, and how many results it may still write: none after a write that failed."""

    def find(n: int) -> np.ndarray:
        wait()  # for the others, which are about to write the same
        return np.full(500, n / 7)

    found = [kept_result(np.ndarray, ("raced", n), lambda n=n: find(n)).tobytes() for n in range(RACED)]
    told = hashlib.sha256(repr([*found, outcome("path sums"), outcome("hidden")]).encode()).hexdigest()
    return told, kept_results._Room.left


def kept_bytes(cache: Path) -> dict[str, bytes]:
    return {str(file.relative_to(cache)): file.read_bytes() for file in (cache / "pilots").rglob("*") if file.is_file()}


def test_processes_that_write_into_one_empty_folder_at_once_leave_what_one_leaves(cache):
    """The same plans, stacks and files to the byte, none half written; and no write of any process failed."""
    alone, _ = raced()
    written = kept_bytes(cache)
    shutil.rmtree(cache / "pilots")
    fork = multiprocessing.get_context("fork")  # kernels are loaded
    start, told = fork.Barrier(RACERS, timeout=120), fork.Queue()
    processes = [fork.Process(target=lambda: told.put(raced(start.wait)), daemon=True) for _ in range(RACERS)]
    for each in processes:
        each.start()
    results = [told.get(timeout=300) for _ in processes]
    for each in processes:
        each.join()
    assert [digest for digest, _ in results] == [alone] * RACERS
    assert min(left for _, left in results) > 0
    assert len(written) > RACED
    assert kept_bytes(cache) == written


def test_a_result_is_of_one_question_one_package_and_one_machine(cache, monkeypatch):
    def place(*about: object) -> Path | None:
        kept_results._code.cache_clear()
        return kept_results._file(about)

    places = [place("a", SLAB, 1.0), place("a", SLAB, 1.0)]
    assert places[0] == places[1]
    near = SLAB.replace(thickness=np.nextafter(100.0, 101.0))
    places += [place("b", SLAB, 1.0), place("a", SLAB, 1.5), place("a", SLAB), place("a", near, 1.0)]
    for module, name, value in (
        (kept_results, "package_digest", lambda *_: "another"),
        (libraries, "get_host_cpu_name", lambda: "another"),
        (libraries, "library_versions", lambda: {"specklegen": "0.0"}),
    ):
        with monkeypatch.context() as context:
            context.setattr(module, name, value)
            places.append(place("a", SLAB, 1.0))
    kept_results._code.cache_clear()
    assert len(set(places)) == len(places) - 1


def test_parts_of_a_users_own_are_not_kept(cache):
    lobe, _ = own_scatterers.defined("(1 + cos) ** self.power")
    try:
        assert kept_results._file(("a", SLAB.replace(scatterer=lobe()))) is None
        assert kept_results._file(("a", SLAB)) is not None
    finally:
        own_scatterers.forgotten()


def test_the_oldest_results_make_room_and_a_process_keeps_so_many(cache, monkeypatch):
    monkeypatch.setattr(kept_results, "_MOST", 2)
    for n in range(600):
        assert kept_result(int, ("tried", n), lambda n=n: n) == n
    assert 256 < len(files(cache)) <= 512
    monkeypatch.setattr(kept_results._Room, "left", 3)
    before = {file: file.stat().st_mtime_ns for file in files(cache)}
    for n in range(1000, 1020):
        kept_result(int, ("tried", n), lambda n=n: n)
    assert len(set(files(cache)) - before.keys()) <= 3


@dataclasses.dataclass(frozen=True)
class Inner:
    number: float
    array: np.ndarray
    perhaps: int | None


@dataclasses.dataclass(frozen=True)
class Outer:
    inner: Inner
    many: tuple[Inner, ...]
    pair: tuple[str, bool]
    absent: Inner | None


numbers = st.floats(width=64)
pairs = st.lists(st.complex_numbers(), min_size=2, max_size=2)
arrays = (st.lists(numbers, max_size=4) | pairs).map(np.array)
inner = st.builds(Inner, numbers, arrays, st.none() | st.integers())


@given(st.builds(Outer, inner, st.lists(inner, max_size=2).map(tuple), st.tuples(st.text(), st.booleans()), st.none()))
@settings(deadline=None, max_examples=100)
def test_what_is_written_reads_as_it_was(result):
    read = from_plain(Outer, json.loads(json.dumps(to_plain(result))))
    assert json.dumps(to_plain(read)) == json.dumps(to_plain(result))
    assert type(read) is Outer
    assert type(read.inner) is Inner
    for one, other in zip((read.inner, *read.many), (result.inner, *result.many), strict=True):
        assert np.float64(one.number).tobytes() == np.float64(other.number).tobytes() or np.isnan(one.number)
        assert (one.array.dtype, one.array.shape) == (other.array.dtype, other.array.shape)
        assert one.array.tobytes() == other.array.tobytes()
        assert not one.array.flags.writeable
        assert one.perhaps == other.perhaps
    assert read.pair == result.pair
