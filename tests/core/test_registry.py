"""Names, import paths and contents of what users define."""

import importlib
import sys
import textwrap

import pytest
from refusals import assert_refused

from specklegen.core.errors import RuleError
from specklegen.core.registry import Registry, anchored, import_paths, imported, is_import_path


@pytest.fixture
def write(tmp_path, monkeypatch):
    """Write a module into a folder; what is imported and where one looks are as before afterwards."""
    monkeypatch.setattr(sys, "path", [*sys.path])
    before = set(sys.modules)

    def module(name, text, folder=tmp_path):
        folder.mkdir(exist_ok=True)
        (folder / f"{name}.py").write_text(textwrap.dedent(text))
        importlib.invalidate_caches()
        return folder

    yield module
    for name in set(sys.modules) - before:
        del sys.modules[name]


def registry():
    return Registry("thing", callable, {"known": len})


def test_a_name_that_is_not_known_gets_the_list_of_those_that_are():
    with pytest.raises(RuleError, match=r"field must be one of known; got 'unknown'.*module:Name"):
        registry().find("field", "unknown")


def test_two_things_of_one_name_are_refused_and_one_defined_anew_is_not():
    things = registry()

    def first(): ...

    def again():
        def first(): ...

        return first

    things.add("own", first)
    things.add("own", first)
    assert_refused(lambda: things.add("own", again()), "thing name must be unique among names of thing")


@pytest.mark.parametrize("text", ["a:B", "a.b:C", "./a:B", "../x y/a:B", "/abs/a.b:C", "a.py:B", "~/a:B"])
def test_import_paths(text):
    assert is_import_path(text)


@pytest.mark.parametrize("text", ["a", "a:", ":B", "a:B:C", "a b:C", "a:B()", "1a:B", "", 3, None, "http://a"])
def test_other_texts(text):
    assert not is_import_path(text)


@pytest.mark.parametrize("path", ["registry_shapes:own", "registry_shapes.py:own"])
def test_a_module_is_found_in_its_folder_and_workers_find_it_there(write, path):
    folder = write("registry_shapes", "def own(): return 3\n")
    found = registry().find("field", f"{folder}/{path}")
    assert found() == 3
    assert str(folder) in sys.path


def test_the_working_folder_is_looked_into(write, monkeypatch):
    monkeypatch.chdir(write("registry_here", "own = len\n"))
    assert imported("field", "registry_here:own") is len


@pytest.mark.parametrize(("path", "rule"), [("registry_none:own", "the path of a module that can be imported"),
                                            ("{}/registry_none:own", "the path of a module in"),
                                            ("{}/registry_broken:own", "the path of a module that can be imported"),
                                            ("{}/registry_shapes:other", "a name that registry_shapes defines"),
                                            ("{}/registry_shapes:number", "the import path of a thing")])  # fmt: skip
def test_a_path_that_leads_nowhere_is_refused(write, path, rule):
    write("registry_shapes", "number = 3\n")
    folder = write("registry_broken", "1 / 0\n")
    assert_refused(lambda: registry().find("field", path.format(folder)), f"field must be {rule}")


def test_a_module_of_a_name_that_is_taken_is_refused_and_not_mistaken(write, tmp_path):
    """Two recipes in two folders with a module of one name each would otherwise share the first."""
    one = write("registry_twice", "def own(): return 1\n", tmp_path / "one")
    two = write("registry_twice", "def own(): return 2\n", tmp_path / "two")
    assert imported("field", f"{one}/registry_twice:own")() == 1
    with pytest.raises(RuleError, match=r"field must be the path of a module with a unique name.*rename"):
        imported("field", f"{two}/registry_twice:own")


def test_a_table_is_anchored_to_its_folder_without_an_import(write):
    folder = write("registry_shapes", "raise SystemExit('imported')\n")
    table = {
        "kind": "registry_shapes:Kind", "objects": {"type": "registry_shapes:Rings", "name": "registry_shapes:Rings"},
        "list": [{"type": "elsewhere:Rings"}, {"type": "sub/registry_shapes:Rings"}], "type": "Glyphs",
    }  # fmt: skip
    assert anchored(table, folder) == {
        "kind": f"{folder}/registry_shapes:Kind",
        "objects": {"type": f"{folder}/registry_shapes:Rings", "name": "registry_shapes:Rings"},
        "list": [{"type": "elsewhere:Rings"}, {"type": f"{folder}/sub/registry_shapes:Rings"}], "type": "Glyphs",
    }  # fmt: skip
    assert [*import_paths(anchored(table, folder))] == [
        f"{folder}/registry_shapes:Kind", f"{folder}/registry_shapes:Rings", "elsewhere:Rings",
        f"{folder}/sub/registry_shapes:Rings",
    ]  # fmt: skip
    assert "registry_shapes" not in sys.modules
