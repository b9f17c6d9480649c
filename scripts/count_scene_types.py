"""Count the lines of the library that ask of which type a part of a scene is: ``make lint`` prints it.

Whoever asks has to be found again by whoever adds a medium, a light or a sensor; a part that says what it is like need
not be. The number may only fall.

    python scripts/count_scene_types.py [--lines]
"""

import ast
import sys
from collections import Counter
from pathlib import Path

MOST = 25
"""Lines there are; a test holds the library to it. Lower it with them."""
ROOT = Path(__file__).parents[1]
FOLDERS = ("specklegen", "datasets", "models")
PARTS = ("media", "illumination", "sensors", "screens", "scatterers")
"""Modules and folders of specklegen/scene that define parts."""


def part_names() -> set[str]:
    """Names of the classes and unions that parts of a scene are made of."""
    names = set()
    for file in (ROOT / "specklegen/scene").rglob("*.py"):
        if file.stem in PARTS or file.parent.name in PARTS:
            for node in ast.parse(file.read_text(encoding="utf-8")).body:
                if isinstance(node, ast.ClassDef):
                    names.add(node.name)
                if isinstance(node, ast.Assign) and "discriminator" in ast.unparse(node.value):
                    names |= {target.id for target in node.targets if isinstance(target, ast.Name)}
    return names | {"ThinMedium"}


def asks(tree: ast.AST, parts: set[str]) -> set[int]:
    """Lines of a syntax tree that ask whether something is one of the parts."""
    return {
        node.lineno
        for node in ast.walk(tree)
        if isinstance(node, ast.Call) and ast.unparse(node.func) in ("isinstance", "instance")
        and parts & {name.id for name in ast.walk(node.args[-1]) if isinstance(name, ast.Name)}
    }  # fmt: skip


def lines_that_ask() -> list[tuple[str, int, str]]:
    """File, number and text of every line of the library that does."""
    parts, found = part_names(), []
    for file in sorted(file for folder in FOLDERS for file in (ROOT / folder).rglob("*.py")):
        text = file.read_text(encoding="utf-8")
        lines = text.splitlines()
        found += [(str(file.relative_to(ROOT)), n, lines[n - 1].strip()) for n in sorted(asks(ast.parse(text), parts))]
    return found


if __name__ == "__main__":
    lines = lines_that_ask()
    if "--lines" in sys.argv:
        print(*(f"{file}:{n}: {text}" for file, n, text in lines), sep="\n")
    rooms = Counter("/".join(file.split("/")[:2]) for file, _, _ in lines)
    print(f"{len(lines)} lines ask for the type of a part of a scene, at most {MOST} may:",
          ", ".join(f"{room} {count}" for room, count in rooms.most_common()))  # fmt: skip
