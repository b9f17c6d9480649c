"""Kept answers of `specklegen plan`: the same as without, to the same question alone, and no engine is loaded."""

import json
import os
import shutil
import subprocess
import sys
import warnings
from pathlib import Path

import pytest
from scenes import ROOT

from specklegen.cli import kept_plans
from specklegen.core import libraries
from specklegen.core.kept_files import cache_root, keep, kept_content
from specklegen.datasets.recipes.recipe_files import recipe_names, recipe_table
from specklegen.kernels import cache

ENGINES = ("numba", "torch", "scipy", "finufft", "zarr")
PROGRAM = f"""
import sys
from specklegen.cli.commands import main
try:
    main(sys.argv[1:])
finally:
    print(*[name for name in {ENGINES} if name in sys.modules], file=sys.stderr)
"""


def planned(folder: Path, *words: str) -> tuple[str, list[str]]:
    """What `plan` prints in a process of its own, and the engines that it has loaded."""
    done = subprocess.run(
        [sys.executable, "-c", PROGRAM, "plan", "material-regression", "--samples", "1", *words], cwd=ROOT,
        env=os.environ | {"SPECKLEGEN_CACHE": str(folder)}, capture_output=True, text=True, timeout=300,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    return done.stdout, done.stderr.split()


@pytest.fixture(scope="module")
def fresh(tmp_path_factory) -> tuple[Path, str]:
    """A cache whose kernels are those of this user, and what was answered first."""
    folder = tmp_path_factory.mktemp("cache")
    kernels = cache_root() / "kernels"
    kernels.mkdir(mode=0o700, parents=True, exist_ok=True)
    (folder / "kernels").symlink_to(kernels)
    said, engines = planned(folder, "--verbose")
    assert set(engines) == set(ENGINES)
    return folder, said


def kept_file(folder: Path) -> Path:
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
    assert {each["sampler"] for each in answer["plans"]} <= {"paths", "stationary", "covariance"}


@pytest.mark.parametrize("damage", ["flipped", "anew"])
def test_a_damaged_answer_is_made_anew_as_where_it_is_asked_for(fresh, tmp_path, damage):
    folder, said = fresh
    folder = shutil.copytree(folder, tmp_path / "cache", symlinks=True)
    file = kept_file(folder)
    whole = file.read_bytes()
    content = bytearray(whole)
    content[len(content) // 2] ^= 1
    file.write_bytes({"flipped": content, "anew": whole}[damage])
    words = ["--anew"] if damage == "anew" else []
    again, engines = planned(folder, "--verbose", *words)
    assert set(engines) == set(ENGINES)
    assert again.splitlines()[:-1] == said.splitlines()[:-1]  # the last one is measured
    assert kept_file(folder) == file
    assert planned(folder, "--verbose") == (again, [])


@pytest.fixture
def first_command(tmp_path, monkeypatch) -> Path:
    """As a process is that has made no recipe yet, with a cache of its own."""
    monkeypatch.setenv("SPECKLEGEN_CACHE", str(tmp_path))
    monkeypatch.delitem(sys.modules, "specklegen.datasets.recipes.registry", raising=False)
    monkeypatch.setattr(kept_plans, "EXTRAS", {"torch": "torch", "tried_extra": "tried"})
    return tmp_path


TABLE = {"kind": "tilt-stack", "material": {"g": 0.9}}
ANSWER = {"plans": [{"memory_bytes": 2**20}], "short": "ä"}


def test_an_answer_is_of_one_recipe_one_package_and_one_machine(first_command, monkeypatch):
    """A number written otherwise, 1 or 1.0, may be refused otherwise, and is another recipe here."""
    places = [kept_plans.place_of(TABLE, None) for _ in range(2)]
    assert places[0] == places[1]
    places += [
        kept_plans.place_of(TABLE, 1), kept_plans.place_of(TABLE, 2),
        kept_plans.place_of(TABLE | {"material": {"g": 0.8}}, None),
        kept_plans.place_of(TABLE | {"material": {"g": 1}}, None),
        kept_plans.place_of(TABLE | {"material": {"g": 1.0}}, None),
    ]  # fmt: skip
    for module, name, value in (
        (kept_plans, "package_digest", lambda: "another"),
        (kept_plans, "thread_count", lambda: 4096),
        (libraries, "get_host_cpu_name", lambda: "another"),
        (libraries, "library_versions", lambda: {"specklegen": "0.0"}),
    ):
        with monkeypatch.context() as context:
            context.setattr(module, name, value)
            places.append(kept_plans.place_of(TABLE, None))
    assert len(set(places)) == len(places) - 1


def test_every_packaged_recipe_has_a_place(first_command):
    assert len({kept_plans.place_of(recipe_table(name), None) for name in recipe_names()} - {None}) == len(
        recipe_names()
    )


def test_the_package_is_all_of_its_files(tmp_path, monkeypatch):
    monkeypatch.setattr(libraries, "__file__", str(tmp_path / "specklegen" / "core" / "libraries.py"))
    digest = libraries.package_digest.__wrapped__
    package, apart = tmp_path / "specklegen", tmp_path / "apart"
    for file in (package / "core/libraries.py", package / "data/table.npz", apart / "recipe.toml"):
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text("a")
    (package / "datasets").symlink_to(apart)
    digests = [digest()]
    for file in ("core/libraries.py", "data/table.npz", "datasets/recipe.toml"):
        (package / file).write_text("b")
        digests.append(digest())
    (package / "data/table.npz").rename(package / "data/other.npz")
    digests.append(digest())
    assert len(set(digests)) == 5
    (package / "core" / "__pycache__").mkdir()
    (package / "core" / "__pycache__" / "libraries.pyc").write_text("compiled")
    assert digest() == digests[-1]


@pytest.mark.parametrize(
    "outside",
    [
        {"objects": {"type": "Folder", "path": "pictures"}},
        {"objects": {"type": "Families", "families": [{"type": "Meshes", "path": "meshes"}]}},
        {"kind": "rings:Rings"}, {"objects": {"type": "shapes/rings:Rings"}},
    ],
)  # fmt: skip
def test_what_lies_outside_of_the_recipe_is_planned_each_time(first_command, outside):
    assert kept_plans.place_of(TABLE | outside, None) is None


def test_a_process_that_has_made_recipes_may_have_classes_of_its_own(first_command, monkeypatch):
    monkeypatch.setitem(sys.modules, "specklegen.datasets.recipes.registry", object())
    assert kept_plans.place_of(TABLE, None) is None


def kept_of(place: Path | None) -> dict | None:
    with kept_plans.keeping(place) as answer:
        answer.update(ANSWER)
    return kept_plans.kept_answer(place)


def test_an_answer_comes_back_as_it_was(first_command):
    assert kept_of(kept_plans.place_of(TABLE, None)) == ANSWER
    assert kept_plans.kept_answer(kept_plans.place_of(TABLE, 3)) is None
    assert kept_of(None) is None


def test_what_was_warned_of_failed_or_took_another_package_is_not_kept(first_command, monkeypatch):
    place = kept_plans.place_of(TABLE, None)
    shown = warnings.showwarning
    with pytest.warns(UserWarning, match="doubtful"), kept_plans.keeping(place):
        warnings.warn("doubtful", stacklevel=1)
    with pytest.raises(ValueError, match="broken"), kept_plans.keeping(place):
        raise ValueError("broken")
    monkeypatch.setitem(sys.modules, "tried_extra", object())
    assert kept_of(place) is None
    assert not (first_command / "plans").exists()
    monkeypatch.delitem(sys.modules, "tried_extra")
    assert kept_of(place) == ANSWER
    assert warnings.showwarning is shown


def test_a_plan_for_which_memory_has_become_too_little_is_made_anew(first_command, monkeypatch):
    place = kept_plans.place_of(TABLE, None)
    assert kept_of(place) == ANSWER
    monkeypatch.setattr(kept_plans, "available_memory", lambda: 2**20 / 0.9 - 1)
    assert kept_plans.kept_answer(place) is None


def test_a_folder_that_cannot_be_written_costs_nothing_else(first_command):
    (first_command / "plans").write_text("in the way")
    assert kept_of(kept_plans.place_of(TABLE, None)) is None


def test_the_oldest_answers_make_room(first_command, monkeypatch):
    monkeypatch.setattr(kept_plans, "_MOST", 3)
    for samples in range(1, 6):
        kept_of(kept_plans.place_of(TABLE, samples))
    assert len(list((first_command / "plans").iterdir())) == 3


@pytest.mark.parametrize("said", ["", "/somewhere"])
def test_kernels_lie_where_all_else_is_kept(monkeypatch, said):
    monkeypatch.setenv("SPECKLEGEN_CACHE", said)
    assert cache.cache_root() == cache_root()


def test_kept_files_read_what_was_kept(tmp_path):
    file = tmp_path / "folder" / "file"
    assert kept_content(file) is None
    for content in (b"", b"abc"):
        keep(file, content)
        assert kept_content(file) == content
    whole = file.read_bytes()
    for damaged in (b"", whole[:20], whole[:-1], whole + b"d", bytes([whole[0] ^ 1]) + whole[1:]):
        file.write_bytes(damaged)
        assert kept_content(file) is None
