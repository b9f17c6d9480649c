"""Count the code lines of every room, and compare them with the ceilings: ``make lint`` prints and enforces it.

A code line holds code: no blank line, no comment, no docstring. A room is a folder of the library; tests and scripts
are a room each. Whoever raises a ceiling in ``scripts/code_ceilings.json`` says in the commit what was taken out
instead, or why nothing could be.

    python scripts/count_code.py            # table; exit status 1 if a room is above its ceiling
    python scripts/count_code.py --lower    # lower every ceiling to the present count
"""

import ast
import io
import json
import sys
import tokenize
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).parents[1]
CEILINGS = Path(__file__).parent / "code_ceilings.json"
LIBRARY = ("specklegen", "datasets", "models")
SINGLE_ROOMS = ("tests", "scripts")
"""Folders that are one room; each folder of the library is divided into its subfolders."""
_LAYOUT = (tokenize.COMMENT, tokenize.NL, tokenize.NEWLINE, tokenize.INDENT, tokenize.DEDENT, tokenize.ENDMARKER)


def docstring_lines(tree: ast.Module) -> set[int]:
    """Return the lines of all docstrings, and of strings that document the assignment above them."""
    statements = (node for node in ast.walk(tree) if isinstance(node, ast.Expr))
    texts = (node for node in statements if isinstance(getattr(node.value, "value", None), str))
    return {line for node in texts for line in range(node.lineno, (node.end_lineno or node.lineno) + 1)}


def code_lines(source: str) -> int:
    """Count the lines of a program that hold code."""
    lines = {
        line
        for token in tokenize.generate_tokens(io.StringIO(source).readline) if token.type not in _LAYOUT
        for line in range(token.start[0], token.end[0] + 1)
    }  # fmt: skip
    return len(lines - docstring_lines(ast.parse(source)))


def python_files(folder: str) -> Iterator[Path]:
    """List the Python files of a folder once each, without following the links inside the package."""
    for file in sorted((ROOT / folder).rglob("*.py")):
        below = file.relative_to(ROOT)
        if not any((ROOT / parent).is_symlink() for parent in below.parents):
            yield below


def room_of(file: Path) -> str:
    """Return the room of a file: tests, scripts, or the folder of the library that holds it."""
    parts = file.parts
    return parts[0] if parts[0] in SINGLE_ROOMS or len(parts) < 3 else "/".join(parts[:2])


def count_rooms() -> tuple[Counter[str], Counter[str]]:
    """Return the code lines and the lines of every room."""
    code, total = Counter[str](), Counter[str]()
    for folder in (*LIBRARY, *SINGLE_ROOMS):
        for file in python_files(folder):
            source = (ROOT / file).read_text(encoding="utf-8")
            code[room_of(file)] += code_lines(source)
            total[room_of(file)] += len(source.splitlines())
    return code, total


def excess(code: Counter[str], ceilings: dict[str, int]) -> list[str]:
    """Name the rooms above their ceilings, and the rooms that have none."""
    return [
        f"{room} has {count} code lines; its ceiling is {ceilings.get(room, 'not set')}"
        for room, count in sorted(code.items()) if count > ceilings.get(room, 0)
    ]  # fmt: skip


def main() -> int:
    """Print the table; return 1 if a room is above its ceiling."""
    code, total = count_rooms()
    ceilings = json.loads(CEILINGS.read_text(encoding="utf-8")) if CEILINGS.exists() else dict(code)
    if "--lower" in sys.argv:
        ceilings = {room: min(count, ceilings.get(room, count)) for room, count in sorted(code.items())}
        CEILINGS.write_text(json.dumps(ceilings, indent=1) + "\n", encoding="utf-8")
    print(f"{'room':26} {'lines':>7} {'code':>7} {'ceiling':>8}")
    for room, count in sorted(code.items()):
        print(f"{room:26} {total[room]:7} {count:7} {ceilings.get(room, 0):8}")
    for name, rooms in [("library", [room for room in code if room not in SINGLE_ROOMS]), ("all", list(code))]:
        print(f"{name:26} {sum(total[room] for room in rooms):7} {sum(code[room] for room in rooms):7} "
              f"{sum(ceilings.get(room, 0) for room in rooms):8}")  # fmt: skip
    problems = excess(code, ceilings)
    for problem in problems:
        print(f"{problem}. Remove code elsewhere in the room, or raise its ceiling in scripts/code_ceilings.json and "
              "say in the commit what was removed instead.", file=sys.stderr)  # fmt: skip
    return 1 if problems else 0


if __name__ == "__main__":
    sys.exit(main())
