"""Every public name has an example in its docstring, which runs and prints what it says."""

import doctest
import inspect

import pytest
from public_names import NAMES, public

LONG = ("benchmark", "load_pretrained", "load_solver", "reconstruct", "train")
"""These take seconds each."""
OPTIONS = doctest.ELLIPSIS | doctest.NORMALIZE_WHITESPACE


def example(name: str) -> doctest.DocTest:
    """The example of a public name; its text need not begin at the left margin."""
    text = inspect.getdoc(public(name)) or ""
    return doctest.DocTestParser().get_doctest(text, {"__name__": "__main__"}, name, None, 0)


def is_long(name: str) -> bool:
    return name.rpartition(".")[2] in LONG


def run(test: doctest.DocTest) -> doctest.TestResults:
    said: list[str] = []
    found = doctest.DocTestRunner(verbose=False, optionflags=OPTIONS).run(test, out=said.append)
    assert not found.failed, "".join(said)
    return found


@pytest.mark.parametrize("name", [name for name in NAMES if not is_long(name)])
def test_an_example_says_what_is_so(name):
    assert run(example(name)).attempted >= 2, "it has none"


@pytest.mark.slow
@pytest.mark.parametrize("name", [name for name in NAMES if is_long(name)])
def test_a_long_example_says_what_is_so(name, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert run(example(name)).attempted >= 2


def test_every_name_has_an_example():
    """Those that take seconds, too."""
    assert [name for name in NAMES if not example(name).examples] == []
    assert len(NAMES) > 150


def test_an_example_that_says_something_else_is_noticed():
    test = doctest.DocTestParser().get_doctest(">>> 1 + 1\n3\n", {}, "wrong", None, 0)
    with pytest.raises(AssertionError, match=r"Expected:\s+3\s+Got:\s+2\s"):
        run(test)
