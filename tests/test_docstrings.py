"""First lines of docstrings: each begins with a noun or a verb, and says "what" at most once."""

import ast
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
FOLDERS = ("specklegen", "datasets", "models")
WITHOUT_SUBJECT = frozenset("As At By For From In Nothing Of On That Those To With".split())


def reason(first: str) -> str | None:
    """Say what is wrong with a first line; None where nothing is."""
    if first.split()[0] in WITHOUT_SUBJECT:
        return "begins with neither a noun nor a verb"
    if len(re.findall(r"\bwhat\b", first, re.IGNORECASE)) > 1:
        return 'says "what" twice'
    return None


def first_lines(file: Path):
    """Yield line number and first line of every docstring of a file."""
    for node in ast.walk(ast.parse(file.read_text())):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef | ast.Module):
            text = ast.get_docstring(node)
            if text:
                yield getattr(node, "lineno", 1), text.splitlines()[0]


@pytest.mark.parametrize("folder", FOLDERS)
def test_first_lines_have_a_subject(folder):
    files = [file for file in (ROOT / folder).rglob("*.py") if ROOT.joinpath(folder) in file.resolve().parents]
    found = [
        f"{file.relative_to(ROOT)}:{line} {reason(first)}: {first}"
        for file in files for line, first in first_lines(file) if reason(first)
    ]  # fmt: skip
    assert files
    assert not found, "\n".join(found)


@pytest.mark.parametrize("first", ["Of all lights.", "Those of the media.", "What it does, and what it costs."])
def test_lines_without_subject_are_seen(first):
    assert reason(first)
