"""Count faults of style in pages, docstrings and messages, and compare them with the ceilings: ``make lint`` runs it.

Faults are private words, figures without a leading zero, sentences of more than 35 words or of more than two figures,
first words of docstrings, and words of a page above 1200 (README: 800). Code, shapes of arrays, tables, links, titles
(in italics) and places in journals do not count, nor many figures in notes. Ceilings stand in
``scripts/prose_ceilings.json`` and may only fall; those of the README are 0.

    python scripts/check_prose.py            # table; exit status 1 if a count is above its ceiling
    python scripts/check_prose.py --show README.md [FILE ...]
    python scripts/check_prose.py --lower    # lower every ceiling to the present count
"""

import ast
import json
import re
import sys
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

from count_code import LIBRARY, ROOT, python_files

CEILINGS = Path(__file__).parent / "prose_ceilings.json"
PRIVATE = (
    "lobes?", "iris(?:es)?", "certificates?", "verdicts?", "foretold", "foretells?", "whoever", "bench(?:es)?", "told",
    "thinning", "steering", "processor (?:seconds?|time|minutes?)", "photographs?", "twins?", "atlas(?:es)?",
)  # fmt: skip
"""Words of this project alone; a reader of the field expects: phase function, aperture, confidence, CPU seconds, ..."""
MOST_WORDS, MOST_FIGURES, MOST_PAGE, MOST_README = 35, 2, 1200, 800
_RULES = {
    "private word": re.compile(rf"\b(?:{'|'.join(PRIVATE)})\b", re.I),
    "figure without zero": re.compile(r"(?<![\w.\])])\.\d"),
    "first word": re.compile(r"(?:What|Whether|How|Where|The same|That)\b"),
}
_NO_PROSE = re.compile(
    r"```.*?```|~~~.*?~~~|^:::\{toctree\}.*?^:::$|^:{3,}.*?$|^ *\|.*?$|\$\$.*?\$\$|<!--.*?-->|^---\n.*?\n---$",
    re.S | re.M,
)
_FORMULA = re.compile(r"^\n(?: {4,}.*\n(?:\n(?= {4}))?)+", re.M)
"""Indented block of a docstring or a note: a formula, a table or code."""
_MARKS = re.compile(
    r"``.*?``|`[^`]*`|\bdocs/\w+\.md|\$[^$]*\$|!?\[([^\]]*)\]\([^)]*\)|\{[\w:-]+\}"
    r"|\d+(?:\(\d+\))?, \w+ \(\d{4}\)|(?:float|complex|u?int|real|bool)\d*\[[^\]]*\]"
    r"|(?<![\w*])\*[A-Z][^*]+\*(?![\w*])"
)
_FIGURE = re.compile(r"(?<![\w.])[\d.]*\d[\d.]*(?:e-?\d+)?")
_MESSAGES = ("reject", "_refuse", "warn", "RuleError", "ValueError", "OSError", "Failed")


def sentences(markdown: str) -> list[str]:
    """Return the sentences of a text without its code, tables, formulas and addresses."""
    text = _MARKS.sub(lambda match: match[1] or "code", _NO_PROSE.sub("\n\n", markdown))
    paragraphs = re.split(r"\n\s*\n|\n *(?:[-*#>]|\d+\.) ", text)
    return [each for part in paragraphs for each in re.split(r"(?<=[.!?:;])\s+", " ".join(part.split())) if each]


def faults(text: str) -> Iterator[tuple[str, str]]:
    """Yield each fault of a text with its sentence."""
    for sentence in sentences(text):
        for rule in ("private word", "figure without zero"):
            yield from ((rule, sentence) for _ in _RULES[rule].finditer(sentence))
        if len(sentence.split()) > MOST_WORDS:
            yield "long sentence", sentence
        if len(_FIGURE.findall(sentence)) > MOST_FIGURES:
            yield "many figures", sentence


def page_faults(file: Path) -> Iterator[tuple[str, str]]:
    """Yield the faults of a page; each word above the length of a page is one."""
    text = (ROOT / file).read_text()
    yield from faults(text)
    if file.parent.name == "docs" or file.name == "README.md":
        most = MOST_README if file.name == "README.md" else MOST_PAGE
        yield from (("word above 1200", str(file)) for _ in range(len(text.split()) - most))


def code_faults(file: Path) -> Iterator[tuple[str, str]]:
    """Yield the faults of a module's docstrings, and of texts in calls that refuse or warn."""
    for node in ast.walk(ast.parse((ROOT / file).read_text())):
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef) and (doc := ast.get_docstring(node)):
            if _RULES["first word"].match(doc):
                yield "first word", doc.splitlines()[0]
            yield from faults(_FORMULA.sub("\n\n", re.split(r"\n\w+\n-{4,}\n", doc)[0] + "\n"))
        elif isinstance(node, ast.Call) and getattr(node.func, "id", getattr(node.func, "attr", "")) in _MESSAGES:
            formats = {leaf for part in ast.walk(node) if isinstance(part, ast.FormattedValue) and part.format_spec
                       for leaf in ast.walk(part.format_spec)}  # fmt: skip
            formats |= set(ast.walk(node.args[0])) if len(node.args) > 1 else set()  # fields as users type them
            texts = (part.value for part in ast.walk(node) if isinstance(part, ast.Constant) and part not in formats)
            for text in texts:
                if isinstance(text, str):
                    rules, prose = ("private word", "figure without zero"), _MARKS.sub("code", text)
                    yield from (("message: " + rule, text) for rule in rules for _ in _RULES[rule].finditer(prose))


def all_faults() -> Iterator[tuple[str, Path, str, str]]:
    """Yield (group, file, rule, sentence) of the README, pages, notes, and the library."""
    pages = [path.relative_to(ROOT) for path in sorted((ROOT / "docs").glob("*.md"))]
    for group, files in (("README", [Path("README.md")]), ("pages", pages)):
        yield from ((group, file, *fault) for file in files for fault in page_faults(file))
    for file in (path.relative_to(ROOT) for path in sorted((ROOT / "docs" / "notes").glob("*.md"))):
        found = faults(_FORMULA.sub("\n\n", (ROOT / file).read_text()))
        yield from (("notes", file, *fault) for fault in found if fault[0] != "many figures")  # notes are for figures
    for file in (file for folder in LIBRARY for file in python_files(folder)):
        yield from (("library", file, *fault) for fault in code_faults(file))


def main(arguments: list[str]) -> int:
    """Print the table, or the faults of some files; return the exit status."""
    found = list(all_faults())
    if arguments[:1] == ["--show"]:
        for _, file, rule, sentence in found:
            if str(file) in arguments[1:]:
                print(f"{file}: {rule}: {sentence}")
        return 0
    counts = Counter(f"{group}: {rule}" for group, _, rule, _ in found)
    ceilings = json.loads(CEILINGS.read_text()) if CEILINGS.exists() else dict(counts)
    if arguments == ["--lower"]:
        least = {name: min(counts[name], ceiling) for name, ceiling in ceilings.items()}
        CEILINGS.write_text(json.dumps(dict(sorted(least.items())), indent=1) + "\n")
        return 0
    over = [name for name, count in counts.items() if count > ceilings.get(name, 0)]
    for name in sorted(counts | ceilings):
        print(f"{name:42s}{counts[name]:6d}{ceilings.get(name, 0):8d}")
    for name in over:
        print(f"{name}: {counts[name]} faults, at most {ceilings.get(name, 0)}. `--show FILE` lists those of a file.")
    return int(bool(over))


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
