"""Docstrings: first lines begin with a noun or a verb; sections Raises say more than that arguments have rules."""

import ast
import re
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
FOLDERS = ("specklegen", "datasets", "models")
WITHOUT_SUBJECT = frozenset("As At By For From In Nothing Of On That Those To With".split())
RULE_ERRORS = re.compile(r"^RuleError\n((?: {4}.*\n?)+)(?!\n*[A-Z]\w+\n {4})", re.MULTILINE)
REPEATS = re.compile(
    r"(?i)((as|see) [^,;]*|(naming|with|always)\b.*|(if|for|where) [^,;:]*(range|rule|none|something else))\."
)


def reason(first: str) -> str | None:
    """Say what is wrong with a first line; None where nothing is."""
    if first.split()[0] in WITHOUT_SUBJECT:
        return "begins with neither a noun nor a verb"
    if len(re.findall(r"\bwhat\b", first, re.IGNORECASE)) > 1:
        return 'says "what" twice'
    return None


@cache
def docstrings(folder: str) -> list[tuple[str, str]]:
    """List place and text of every docstring of a folder."""
    files = [file for file in (ROOT / folder).rglob("*.py") if ROOT / folder in file.resolve().parents]
    return [(f"{file.relative_to(ROOT)}:{line}", text) for file in files for line, text in texts(file)]


def texts(file: Path):
    """Yield line number and text of every docstring of a file."""
    for node in ast.walk(ast.parse(file.read_text())):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef | ast.Module):
            text = ast.get_docstring(node)
            if text:
                yield getattr(node, "lineno", 1), text


@pytest.mark.parametrize("folder", FOLDERS)
def test_first_lines_have_a_subject(folder):
    lines = [(place, text.splitlines()[0]) for place, text in docstrings(folder)]
    assert lines
    assert [f"{place} {reason(first)}: {first}" for place, first in lines if reason(first)] == []


@pytest.mark.parametrize("folder", FOLDERS)
def test_sections_raises_say_more_than_the_rules_of_arguments(folder):
    """A limit of memory or time, a file, a sampler, another error; not that a field has a range."""
    repeated = [
        f"{place} {' '.join(entry[1].split())}"
        for place, text in docstrings(folder) for entry in RULE_ERRORS.finditer(text)
        if REPEATS.fullmatch(" ".join(entry[1].split()))
    ]  # fmt: skip
    assert repeated == []


@pytest.mark.parametrize("first", ["Of all lights.", "Those of the media.", "What it does, and what it costs."])
def test_lines_without_subject_are_seen(first):
    assert reason(first)
