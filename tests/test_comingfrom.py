"""The page for those who come from another tool: what it says that a thing is called here has that name here."""

import importlib.util
import re

import pytest
from scenes import ROOT

from specklegen import SUBJECTS
from specklegen.datasets import recipe_names

PAGE = (ROOT / "docs/comingfrom.md").read_text(encoding="utf-8")
PACKAGES = ["", *(f".{name}" for name in SUBJECTS), ".datasets", ".models", ".instrument", ".measured", ".wavetracing"]
ADAPTER = (ROOT / "specklegen/datasets/loading/deepinverse.py").read_text(encoding="utf-8")  # deepinv need not be here
TOOLS = ["mcspeckle", "temporalSpecklesCode", "MCX", "deepinv", "DeepTrack2", "TorchOptics", "Chromatix", "Sionna RT",
         "PyLSCI"]  # fmt: skip
ROWS = [line.strip("| ").split(" | ") for line in PAGE.splitlines() if line.startswith("| ")]
BEGINS = re.compile(r"[A-Z]\w+|specklegen\.|[a-z_]+\(")
"""How code begins that names something of this project."""
HERE = sorted({code for row in ROWS for code in re.findall(r"`([^`]+)`", row[-1])} - {"here"})
OTHERS = {"True", "False", "None", "auto"}


def names_in(code: str) -> list[str]:
    """Names of this project in a piece of code: what is called or stands alone, less words and fields of values."""
    code = re.sub(r'"[^"]*"', "", code)
    return [name for name in re.findall(r"[A-Za-z_][\w.]*", re.sub(r"\w+(?==)", "", code)) if name not in OTHERS]


def known(name: str) -> bool:
    """Whether a public package has it, or it is a module."""
    if name.startswith("specklegen."):
        parent, _, last = name.rpartition(".")
        return bool(importlib.util.find_spec(name) or hasattr(importlib.import_module(parent), last))
    first, *fields = name.split(".")
    packages = [importlib.import_module(f"specklegen{package}") for package in PACKAGES]
    found = [getattr(package, first) for package in packages if hasattr(package, first)]
    return any(all(hasattr(each, field) for field in fields) for each in found) or f"class {first}(" in ADAPTER


@pytest.mark.parametrize("tool", TOOLS)
def test_a_tool_has_a_section_that_says_what_is_missing(tool):
    (section,) = [part for part in re.split(r"^## ", PAGE, flags=re.MULTILINE)[1:] if tool in part.splitlines()[0]]
    assert "Missing here" in section or "not here" in section


@pytest.mark.parametrize("code", [code for code in HERE if names_in(code) and BEGINS.match(code)])
def test_a_name_of_the_page_is_one_of_ours(code):
    (first, *_) = names_in(code)
    assert known(first), first


@pytest.mark.parametrize("code", [code for code in HERE if re.fullmatch(r"[a-z]+(-[a-z]+)+", code)])
def test_a_recipe_of_the_page_is_packaged(code):
    assert code in [*recipe_names(), "hidden-object"]


def test_a_name_that_is_not_ours_is_told():
    assert not known("NoSuchThing")
    assert not known("specklegen.theory.no_such_thing")
