"""Cached answers of `specklegen plan`: the same as without, to the same question alone, and no engine is loaded."""

import json
import os
import shutil
import subprocess
import sys
import warnings
from pathlib import Path

import pytest
from cached import link_kernels
from scenes import ROOT

from specklegen.cli import cached_plans
from specklegen.cli.cached_plans import cached_answer, caching, name_of_answer
from specklegen.core import libraries

ENGINES = ("numba", "torch", "scipy", "finufft")
PROGRAM = f"""
import sys
from pathlib import Path
from specklegen.cli import recipes
from specklegen.cli.commands import main
from specklegen.disk_cache import PACKAGE, sources_of
try:
    main(sys.argv[1:])
finally:
    loaded = {{Path(module.__file__) for name, module in sys.modules.items() if name.startswith("specklegen.")}}
    others = {{file for file in loaded - sources_of(Path(recipes.__file__)) if file.name != "__init__.py"}}
    assert all(file.parent == PACKAGE / "cli" for file in others - {{PACKAGE / "core/interrupts.py"}}), others
    print(*[name for name in {ENGINES} if name in sys.modules], file=sys.stderr)
"""
"""What an answer depends on is among its sources; other commands and the handling of signals are not."""


def planned(folder: Path, *words: str) -> tuple[str, list[str]]:
    """What `plan` prints in a process of its own, and the engines that it has loaded."""
    done = subprocess.run([sys.executable, "-c", PROGRAM, "plan", "material-regression", "--samples", "1", *words],
                          cwd=ROOT, env=os.environ | {"SPECKLEGEN_CACHE": str(folder)}, capture_output=True, text=True,
                          timeout=300)  # fmt: skip
    assert done.returncode == 0, done.stderr
    return done.stdout, done.stderr.splitlines()[-1].split()


@pytest.fixture(scope="module")
def fresh(tmp_path_factory) -> tuple[Path, str]:
    """A cache whose kernels are those of this user, and what was answered first."""
    folder = link_kernels(tmp_path_factory.mktemp("cache"))
    said, engines = planned(folder, "--verbose")
    assert set(engines) == set(ENGINES)
    return folder, said


def cached_file(folder: Path) -> Path:
    (file,) = (folder / "plans").iterdir()
    return file


def test_the_second_answer_is_the_first_to_the_letter_and_loads_no_engine(fresh):
    folder, said = fresh
    assert planned(folder, "--verbose") == (said, [])
    short, engines = planned(folder)
    assert engines == []
    assert short.splitlines()[-1] == said.splitlines()[-1]  # what it costs
    answer = json.loads(planned(folder, "--json")[0])
    assert answer["cost"]["samples"] == 1
    assert {plan["sampler"] for plan in answer["plans"]} <= {"paths", "stationary", "covariance"}


def test_an_answer_is_made_anew_where_it_is_asked_for(fresh, tmp_path):
    folder, said = fresh
    folder = shutil.copytree(folder, tmp_path / "cache", symlinks=True)
    file = cached_file(folder)
    again, engines = planned(folder, "--verbose", "--anew")
    assert set(engines) == set(ENGINES)
    assert again.splitlines()[:-1] == said.splitlines()[:-1]  # the last one is measured
    assert cached_file(folder) == file
    assert planned(folder, "--verbose") == (again, [])


@pytest.fixture
def first_command(tmp_path, monkeypatch) -> Path:
    """As a process is that has made no recipe yet, with a cache of its own."""
    monkeypatch.setenv("SPECKLEGEN_CACHE", str(tmp_path))
    monkeypatch.delitem(sys.modules, "specklegen.datasets.recipes.registry", raising=False)
    monkeypatch.setattr(cached_plans, "EXTRAS", {"torch": "torch", "tried_extra": "tried"})
    return tmp_path


TABLE = {"kind": "tilt-stack", "material": {"g": 0.9}}
ANSWER = {"plans": [{"memory_bytes": 2**20}], "short": "ä"}


def test_an_answer_is_of_one_recipe_one_package_and_one_machine(first_command, monkeypatch):
    """A number written otherwise, 1 or 1.0, may be refused otherwise, and is another recipe here."""
    names = [name_of_answer(TABLE, None) for _ in range(2)]
    assert names[0] == names[1]
    names += [
        name_of_answer(TABLE, 1), name_of_answer(TABLE, 2), name_of_answer(TABLE | {"material": {"g": 0.8}}, None),
        name_of_answer(TABLE | {"material": {"g": 1}}, None), name_of_answer(TABLE | {"material": {"g": 1.0}}, None),
    ]  # fmt: skip
    for module, name, value in (
        (cached_plans, "source_digest", lambda _: "another"),
        (cached_plans, "thread_count", lambda: 4096),
        (libraries, "get_host_cpu_name", lambda: "another"),
        (libraries, "library_versions", lambda: {"specklegen": "0.0"}),
    ):
        with monkeypatch.context() as context:
            context.setattr(module, name, value)
            libraries.arithmetic.cache_clear()
            names.append(name_of_answer(TABLE, None))
    libraries.arithmetic.cache_clear()
    assert len(set(names)) == len(names) - 1


@pytest.mark.parametrize("outside", [
    {"objects": {"type": "Folder", "path": "pictures"}},
    {"objects": {"type": "Families", "families": [{"type": "Meshes", "path": "meshes"}]}}, {"kind": "rings:Rings"},
    {"objects": {"type": "shapes/rings:Rings"}},
])  # fmt: skip
def test_what_lies_outside_of_the_recipe_is_planned_each_time(first_command, outside):
    assert name_of_answer(TABLE | outside, None) is None


def test_a_process_that_has_made_recipes_may_have_classes_of_its_own(first_command, monkeypatch):
    monkeypatch.setitem(sys.modules, "specklegen.datasets.recipes.registry", object())
    assert name_of_answer(TABLE, None) is None


def written(name: str | None) -> dict | None:
    """Return what is read of an answer that was written."""
    with caching(name) as answer:
        answer.update(ANSWER)
    return cached_answer(name)


def test_an_answer_comes_back_as_it_was(first_command):
    assert written(name_of_answer(TABLE, None)) == ANSWER
    assert cached_answer(name_of_answer(TABLE, 3)) is None
    assert written(None) is None


def test_what_was_warned_of_failed_or_took_another_package_is_not_cached(first_command, monkeypatch):
    name = name_of_answer(TABLE, None)
    shown = warnings.showwarning
    with pytest.warns(UserWarning, match="doubtful"), caching(name):
        warnings.warn("doubtful", stacklevel=1)
    with pytest.raises(ValueError, match="broken"), caching(name):
        raise ValueError("broken")
    monkeypatch.setitem(sys.modules, "tried_extra", object())
    assert written(name) is None
    assert not (first_command / "plans").exists()
    monkeypatch.delitem(sys.modules, "tried_extra")
    assert written(name) == ANSWER
    assert warnings.showwarning is shown


def test_a_plan_for_which_memory_has_become_too_little_is_made_anew(first_command, monkeypatch):
    name = name_of_answer(TABLE, None)
    assert written(name) == ANSWER
    monkeypatch.setattr(cached_plans, "available_memory", lambda: 2**20 / 0.9 - 1)
    assert cached_answer(name) is None
