"""Results cached on disk: a plan, and what is drawn by it, has the same bits with them and without."""

import ast
import dataclasses
import os
import subprocess
import sys
import threading
from pathlib import Path

import numpy as np
import own_scatterers
import pytest
from cached import link_kernels
from forgotten import forget
from hypothesis import given, settings
from hypothesis import strategies as st
from scenes import ROOT, flat_box, views

import specklegen as sg
from specklegen import disk_cache
from specklegen.core import cached_results, libraries, pace
from specklegen.core.cached_results import file_name, packed, unpacked

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
SCENES = {"stack": (STACK, {}), "path sums": (STACK, {"sampler": "paths"}), "hidden": (HIDDEN, {}),
          "convolution": (HIDDEN, {"sampler": "convolution"}), "narrow lobes": (NARROW, {}), "steps": (STEPS, {}),
          "box": (BOX, {})}  # fmt: skip


@pytest.fixture
def cache(tmp_path, monkeypatch) -> Path:
    """A cache of its own, whose kernels are those of this user; this process may write any number of files."""
    monkeypatch.setenv("SPECKLEGEN_CACHE", str(link_kernels(tmp_path)))
    monkeypatch.setattr(disk_cache, "_written", {})
    monkeypatch.setattr(disk_cache, "_warned", set())
    monkeypatch.setattr(disk_cache, "MOST_OF_A_PROCESS", 10**6)
    monkeypatch.setattr(pace, "machine_pace", lambda: 1.0)  # without a cache plans state the reference's seconds
    yield tmp_path
    forget()


def files(cache: Path) -> list[Path]:
    return sorted((cache / "pilots").glob("*"))


def outcome(name: str) -> tuple[str, bytes]:
    """What is said of a scene, and its first stack, as a process finds them that knows nothing yet."""
    forget()
    scene, asked = SCENES[name]
    made = sg.plan(scene, paths=500, **asked)
    stack = sg.render(scene, paths=500, seed=3, **asked)
    drawn = stack.field if scene.illumination.coherent else stack.intensity
    told = f"{made.explain()} {made.seconds!r} {made.memory_bytes} {dict(made.alternatives)!r} {made.doubts}"
    return told, np.asarray(drawn).tobytes()


def questions() -> set[str]:
    """Names of all questions whose answers are cached as pilots: the first of what each is ``about``."""
    names = []
    for file in (ROOT / "specklegen").rglob("*.py"):
        for node in ast.walk(ast.parse(file.read_text())):
            about = node.args[1:2] if isinstance(node, ast.Call) and ast.unparse(node.func) == "cached_result" else []
            if isinstance(node, ast.Assign) and ast.unparse(node.targets[0]) == "about":
                about = [node.value]
            first = [part.elts[0] for part in about if isinstance(part, ast.Tuple)]
            names += [part.value for part in first if isinstance(part, ast.Constant)]
    assert len(names) == len(set(names)) >= 14, "two questions of one name"
    return set(names)


@pytest.mark.parametrize("name", SCENES)
def test_plans_and_draws_have_the_same_bits_with_an_empty_cache_a_full_one_and_none(cache, monkeypatch, name):
    first, number = outcome(name), len(files(cache))
    assert number > 2
    again = outcome(name)
    assert len(files(cache)) == number
    for file in files(cache)[::2]:  # other processes have computed a part of it
        file.unlink()
    left = len(files(cache))
    partly = outcome(name)
    assert left < len(files(cache)) <= number  # what only cached results had asked for is not asked again
    monkeypatch.setenv("SPECKLEGEN_CACHE", "off")
    assert first == again == partly == outcome(name)


def test_all_that_runs_for_a_result_is_among_its_sources(cache, monkeypatch):
    """Of every question: the files of the package whose functions run while it is answered."""
    running, missing, asked = [], set(), set()

    def begin(about, source):
        running.append((about[0], disk_cache.sources_of(source)))
        return "name"

    def end(result):
        asked.add(running.pop()[0])
        return b""

    def watch(frame, event, _):
        if event == "call" and running and frame.f_code.co_name != "<module>":
            file = Path(frame.f_code.co_filename)
            missing.update((name, file) for name, sources in running if file in package and file not in sources)

    package = {*(ROOT / "specklegen").rglob("*.py")}
    monkeypatch.setattr(cached_results, "file_name", begin)
    monkeypatch.setattr(cached_results, "read", lambda *_: None)
    monkeypatch.setattr(cached_results, "write", lambda *_: None)
    monkeypatch.setattr(cached_results, "packed", end)
    threading.setprofile(watch)
    sys.setprofile(watch)
    try:
        for name in SCENES:
            outcome(name)
    finally:
        sys.setprofile(None)
        threading.setprofile(None)
    assert not missing
    assert asked >= questions()


def test_cached_results_are_used(cache):
    """Else the bits above would be the same for no merit."""
    _, drawn = outcome("path sums")
    source = ROOT / "specklegen" / "paths" / "tracer.py"
    names = {file_name(("threshold of a slab", STACK, False, turned), source) for turned in (False, True)}
    (name,) = names & {file.name for file in files(cache)}
    disk_cache.write("pilots", name, packed(unpacked(float, disk_cache.read("pilots", name)) * 3))
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


@pytest.mark.slow
def test_a_sample_of_another_process_has_the_same_bits(cache):
    """Of sixteen plans: in a process that computes all, in one that reads all, and in one without a cache."""
    outputs = []
    for setting in (cache, cache, f"kernels:{cache}"):
        done = subprocess.run([sys.executable, "-c", PROGRAM], cwd=ROOT,
                              env=os.environ | {"SPECKLEGEN_CACHE": str(setting)}, capture_output=True, text=True,
                              timeout=600)  # fmt: skip
        assert done.returncode == 0, done.stderr
        outputs.append((done.stdout, len(files(cache))))
    assert outputs[0] == outputs[1] == outputs[2]
    assert outputs[0][1] > 16


RACERS, RACED = 4, 200


def test_a_result_is_of_one_question_one_package_and_one_machine(monkeypatch):
    """A home folder is shared by machines, and outlives libraries."""
    source = ROOT / "specklegen" / "paths" / "tracer.py"

    def name(*about: object, source: Path = source) -> str | None:
        libraries.arithmetic.cache_clear()
        return file_name(about, source)

    names = [name("a", SLAB, 1.0), name("a", SLAB, 1.0)]
    assert names[0] == names[1]
    near = SLAB.replace(thickness=np.nextafter(100.0, 101.0))
    names += [name("b", SLAB, 1.0), name("a", SLAB, 1.5), name("a", SLAB), name("a", near, 1.0)]
    names.append(name("a", SLAB, 1.0, source=source.with_name("pilot.py")))
    for module, attribute, value in (
        (cached_results, "source_digest", lambda _: "another"),
        (libraries, "get_host_cpu_name", lambda: "another"),
        (libraries, "library_versions", lambda: {"specklegen": "0.0"}),
    ):
        with monkeypatch.context() as context:
            context.setattr(module, attribute, value)
            names.append(name("a", SLAB, 1.0))
    with monkeypatch.context() as context:
        context.setenv("NUMBA_CPU_NAME", "a kind that this process does not run for")
        names.append(name("a", SLAB, 1.0))
    libraries.arithmetic.cache_clear()
    assert len(set(names)) == len(names) - 1


def test_parts_of_a_users_own_are_not_cached():
    lobe, _ = own_scatterers.defined("(1 + cos) ** self.power")
    source = Path(cached_results.__file__)
    try:
        assert file_name(("a", SLAB.replace(scatterer=lobe())), source) is None
        assert file_name(("a", SLAB), source) is not None
    finally:
        own_scatterers.forgotten()


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
    read = unpacked(Outer, packed(result))
    assert packed(read) == packed(result)
    assert type(read) is Outer
    assert type(read.inner) is Inner
    for one, other in zip((read.inner, *read.many), (result.inner, *result.many), strict=True):
        assert np.float64(one.number).tobytes() == np.float64(other.number).tobytes() or np.isnan(one.number)
        assert (one.array.dtype, one.array.shape) == (other.array.dtype, other.array.shape)
        assert one.array.tobytes() == other.array.tobytes()
        assert not one.array.flags.writeable
        assert one.perhaps == other.perhaps
    assert read.pair == result.pair
