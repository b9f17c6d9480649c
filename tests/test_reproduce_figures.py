"""Every set of figures can be imported and drawn by its name."""

import inspect
import re
import sys
from pathlib import Path

import pytest
from scenes import ROOT, script_at


@pytest.fixture(scope="module")
def script():
    return script_at("scripts/reproduce_figures.py")


def test_every_set_is_drawn_by_out_and_quick(script):
    for name in script.names():
        assert list(inspect.signature(script.load(name).main).parameters) == ["out", "quick"], name


def test_every_set_goes_by_default_where_the_documents_show_it(script):
    for name in script.names():
        module = script.load(name)
        drawn = set(re.findall(r"[\w-]+\.png", inspect.getsource(module)))
        assert drawn, name
        assert not [each for each in drawn if not (ROOT / module.OUT / each).is_file()], name


@pytest.mark.parametrize(("words", "out"), [([], Path("docs/images")), (["--out", "x"], Path("x"))])
def test_the_folder_is_the_commands(script, monkeypatch, words, out):
    """Both ways to draw a set: by its name, and its script by itself."""
    called = []
    module = script.load("bar19_rows")
    module.main = lambda *given: called.append(given)
    monkeypatch.setattr(script, "load", lambda name: module)
    script.main(["bar19_rows", *words, "--quick"])
    monkeypatch.setattr(sys, "argv", ["bar19_rows.py", *words])
    module.run(module.main, module.OUT, module.__doc__)
    assert called == [(out, True), (out, False)]
