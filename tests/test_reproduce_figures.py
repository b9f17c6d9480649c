"""Every set of figures can be imported and drawn by its name."""

import importlib.util
import inspect
from pathlib import Path

import pytest

SCRIPT = Path(__file__).parents[1] / "scripts" / "reproduce_figures.py"


@pytest.fixture(scope="module")
def script():
    spec = importlib.util.spec_from_file_location("reproduce_figures", SCRIPT)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_names_are_those_of_figures(script):
    assert "prahl09" in script.names()
    assert not any(name.startswith("_") for name in script.names())


def test_every_set_is_drawn_by_out_and_quick(script):
    for name in script.names():
        assert list(inspect.signature(script.load(name).main).parameters) == ["out", "quick"], name
