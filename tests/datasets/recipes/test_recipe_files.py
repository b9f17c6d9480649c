"""Recipes as tables: whose paths they are, what they inherit, and what is wrong with a file."""

import os
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from refusals import assert_refused

from specklegen.core.errors import RuleError
from specklegen.datasets import load_recipe
from specklegen.datasets.recipes.recipe_files import LONGEST_CHAIN, recipe_table


@pytest.fixture
def setup(tmp_path, monkeypatch) -> Path:
    """A folder with pictures and a recipe for them, and a working folder that is another."""
    (tmp_path / "setup" / "pictures").mkdir(parents=True)
    for n in range(10):
        Image.fromarray(np.full((9, 9 + n), 20 * n + 9, np.uint8)).save(tmp_path / "setup" / "pictures" / f"{n}.png")
    write(tmp_path / "setup" / "own.toml", 'inherits = "through-slab"\n[objects]\ntype = "Folder"\npath = "pictures"\n')
    (tmp_path / "elsewhere").mkdir()
    monkeypatch.chdir(tmp_path / "elsewhere")
    return tmp_path / "setup"


def write(path: Path, text: str) -> Path:
    path.write_text(text)
    return path


def pictures(recipe) -> int:
    return len(recipe.objects.files)


def test_a_path_in_a_file_is_relative_to_the_file(setup):
    assert pictures(load_recipe(setup / "own.toml")) == 10
    assert pictures(load_recipe(os.path.relpath(setup / "own.toml"))) == 10
    lit = write(setup / "lit.toml", 'inherits = "through-slab"\n[objects]\ntype = "LitMesh"\nscene = "a.ply"\n')
    assert recipe_table(lit)["objects"]["scene"] == str(setup / "a.ply")


def test_an_heir_keeps_the_paths_of_what_it_inherits(setup):
    heir = write(setup.parent / "heir.toml", 'inherits = "setup/own.toml"\nname = "heir"\n')
    assert pictures(load_recipe(heir)) == 10
    moved = write(setup.parent / "moved.toml", 'inherits = "setup/own.toml"\n[objects]\npath = "setup/pictures"\n')
    assert pictures(load_recipe(moved)) == 10


def test_a_path_from_the_caller_is_relative_to_the_working_folder(setup):
    changes = {"objects": {"type": "Folder", "path": "../setup/pictures"}}
    assert pictures(load_recipe("through-slab", changes)) == 10
    with pytest.raises(RuleError, match=r"Folder\.path must be an existing folder; got 'pictures'"):
        pictures(load_recipe(setup / "own.toml", {"objects": {"path": "pictures"}}))


def test_a_file_may_bear_the_name_of_a_packaged_recipe(setup):
    """Inside a file a packaged name is the packaged recipe; its path, written as one, is the file."""
    write(setup / "through-slab", 'inherits = "tilt-stack"\n')
    assert recipe_table(setup / "own.toml")["kind"] == "hidden-object"
    heir = write(setup / "heir.toml", 'inherits = "./through-slab"\n')
    assert recipe_table(heir)["kind"] == "tilt-stack"


@pytest.mark.parametrize(("files", "says"), [
    ({"a": 'inherits = "a.toml"'}, "recipe.inherits must be free of circles"),
    ({"a": 'inherits = "../setup/./a.toml"'}, "recipe.inherits must be free of circles"),
    ({"a": 'inherits = "b.toml"', "b": 'inherits = "link.toml"'}, "recipe.inherits must be free of circles"),
    ({"a": "inherits = 7"}, "recipe.inherits must be the name of a recipe or .*, or a list of them; got 7"),
    ({"a": "[inherits]\nx = 1"}, "recipe.inherits must be the name of a recipe or the path of a TOML file"),
    ({"a": 'inherits = "nothing"'}, "recipe must be .*nothing"),
    ({"a": 'inherits = "tilt-stak"'}, "Did you mean tilt-stack?"),
    ({"a": 'inherits = "\\u0000"'}, "recipe must be "),
    ({"a": "a = " + "[" * 5000}, "nested at most 64 levels deep"),
    ({"a": "a" + ".a" * 5000 + " = 1"}, "nested at most 64 levels deep"),
    ({"a": "a = " + "9" * 5000}, "must be valid TOML"),
    ({"a": "a = é".encode("latin-1")}, "recipe must be a text file in UTF-8"),
    ({"a": "kind = []"}, "recipe.kind must be one of"), ({"a": ""}, "recipe.kind must be given"),
])  # fmt: skip
def test_a_file_that_cannot_serve_is_refused_with_the_reason(setup, files, says):
    (setup / "link.toml").symlink_to("a.toml")
    for name, text in files.items():
        (setup / f"{name}.toml").write_bytes(text if isinstance(text, bytes) else text.encode())
    assert_refused(lambda: load_recipe(setup / "a.toml"), says)


def test_a_row_of_heirs_has_an_end(setup):
    """As long as is allowed, and one longer."""
    for n in range(LONGEST_CHAIN):
        parent = f"{n + 1}.toml" if n + 2 < LONGEST_CHAIN else "through-slab"
        write(setup / f"{n}.toml", f'inherits = "{parent}"\n')
    assert recipe_table(setup / "0.toml")["kind"] == "hidden-object"
    write(setup / "first.toml", 'inherits = "0.toml"\n')
    assert_refused(lambda: recipe_table(setup / "first.toml"), f"a chain of at most {LONGEST_CHAIN} recipes")


@pytest.mark.parametrize(("changes", "says"), [
    ({"material": {"kernel_paths": 1}}, "Material.kernel_paths must be at least 64"),
    ({"material": {"thickness": 1e300}}, "Material.thickness must be between"),
    ({"material": {"g": 10**400}}, "Material.g must be finite"),
    ({"mode_tolerance": 1e4}, "HiddenObject.mode_tolerance must be less than 0.5"),
    ({"exposure": {"photons": 1e300}}, r"Camera.photons must be at most 1e\+15"),
    ({"exposure": {"photons": 1e-12}}, "Camera.photons must be at least 6.1e-05, one photon in an image"),
    ({"exposure": {"photons": 1.0, "gain": 1000.0}}, "Camera.photons must be enough for a count"),
    ({"objects": "x"}, "HiddenObject.objects must be a table of fields; got 'x'"),
    ({"samples": 3}, "HiddenObject.samples must be a table of the fields of Samples; got 3"),
    ("x", "load_recipe changes must be a table"),
])  # fmt: skip
def test_a_field_that_cannot_serve_is_named(changes, says):
    assert_refused(lambda: load_recipe("through-slab", changes), says)
