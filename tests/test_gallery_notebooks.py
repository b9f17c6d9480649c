"""Notebooks of the gallery: each installs what its script imports, and pages say what was not run."""

import importlib.util
import re
import sys
import tomllib

import pytest
from scenes import ROOT

sys.path.append(str(ROOT / "docs"))
import gallery_notebooks as notebooks

PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
CORE = {re.split(r"[<>=\[]", line)[0].lower() for line in PROJECT["dependencies"]} | {"specklegen", "torch"}
NAMED = {"pil": "pillow"}
SCRIPTS = notebooks.scripts()


@pytest.mark.parametrize("name", SCRIPTS)
def test_a_notebook_installs_all_that_its_script_imports(name):
    """Every import is of Python, of what the package requires, or of an extra that the first cell names."""
    found = notebooks.imports(SCRIPTS[name]) - set(sys.stdlib_module_names)
    assert found
    for each in found:
        known = NAMED.get(each.lower(), each.lower()) in CORE
        assert known or notebooks.EXTRAS.get(each) in notebooks.extras(SCRIPTS[name]), each
    assert set(notebooks.extras(SCRIPTS[name])) <= PROJECT["optional-dependencies"].keys()


def test_the_first_cell_installs_the_release_and_the_others_stay():
    made = notebooks.with_install({"cells": [{"source": ["1"]}], "nbformat": 4}, "import deepinv", "1.2.3")
    assert made["cells"][0]["source"] == ['%pip install --quiet "specklegen-torch[deepinv,torch]==1.2.3"']
    assert made["cells"][1:] == [{"source": ["1"]}]
    assert made["nbformat"] == 4


def test_a_badge_leads_to_colab_where_there_is_an_address(monkeypatch, tmp_path):
    lone = notebooks.head("plot_01_first_speckle", "import numpy", None)
    assert "colab" not in lone
    assert 'href="../../notebooks/plot_01_first_speckle.ipynb"' in lone
    address = "https://colab.research.google.com/github/owner/name/blob/gh-pages"
    there = notebooks.head("plot_01_first_speckle", "import numpy", address)
    assert f'href="{address}/notebooks/plot_01_first_speckle.ipynb"' in there
    stated = PROJECT["urls"]["Notebooks"]  # a placeholder, which the release check refuses, or what badges lead to
    assert notebooks.colab() == (None if "example.org" in stated else stated)
    (tmp_path / "pyproject.toml").write_text(f'[project.urls]\nNotebooks = "{address}"\n')
    monkeypatch.setattr(notebooks, "ROOT", tmp_path)
    assert notebooks.colab() == address


def test_a_page_whose_package_is_not_there_says_so_and_is_not_run(monkeypatch):
    monkeypatch.setattr(notebooks, "find_spec", lambda name: None)
    page = notebooks.head("plot_25_lightning", SCRIPTS["plot_25_lightning"], None)
    assert "Not run when this site was built: lightning was not there" in page
    assert "specklegen-torch[lightning,torch]" in page
    assert not re.search(notebooks.run_pattern(), "docs/gallery/train/plot_25_lightning.py")
    assert re.search(notebooks.run_pattern(), "docs/gallery/physics/plot_01_first_speckle.py")
    monkeypatch.setattr(notebooks, "find_spec", importlib.util.find_spec)
    if importlib.util.find_spec("lightning"):
        assert re.search(notebooks.run_pattern(), "docs/gallery/train/plot_25_lightning.py")


def test_the_head_stands_below_the_title():
    source = [".. _label:\n\nTitle\n=====\n\nText.\n\nMore\n====\n"]
    notebooks.insert_head(None, "auto_gallery/physics/plot_01_first_speckle", source)
    assert re.match(r"\.\. _label:\n\nTitle\n=====\n\n\.\. raw:: html\n", source[0])
    assert source[0].count("raw:: html") == 1
    other = ["Title\n=====\n"]
    notebooks.insert_head(None, "start", other)
    assert other == ["Title\n=====\n"]
