"""Print the tests of the rooms that a change touches, for ``make quick``.

    pytest $(python scripts/changed_rooms.py)

A change is what differs from main, in commits or not. It touches the rooms of the changed files and the rooms whose
modules import a changed module, directly or by others of its room: the graph of imports is that of import-linter. Where
nothing has changed, a fixed selection is printed: values, kernels and the one program that draws.
"""

import re
import subprocess
import sys
from collections.abc import Callable, Iterable
from pathlib import Path

import grimp

ROOT = Path(__file__).parents[1]
TESTS = ROOT / "tests"
ALWAYS = ("tests/test_closed_lists.py", "tests/test_scene_types.py", "tests/test_code_size.py")
FIXED = (
    "tests/core", "tests/scene", "tests/instrument", "tests/kernels", "tests/theory", "tests/synthesis",
    "tests/planning/test_units.py", "tests/planning/test_before_allocation.py", "tests/datasets/test_split.py",
    "tests/datasets/test_random_words.py", "tests/datasets/objects", "tests/datasets/loading/test_stream.py", *ALWAYS,
)  # fmt: skip
OF_FOLDERS = {"docs": ("tests/test_docs.py", "tests/test_site.py"), "packaging": ("tests/test_packaging.py",)}
"""Tests of files that are no Python modules, by their folder; of all others, those of the package."""


def changed_files() -> list[str]:
    """Return the paths that differ from main, those that git does not know yet included."""
    main = next((name for name in ("origin/main", "main") if _lines("rev-parse", "--verify", "--quiet", name)), "HEAD")
    (base,) = _lines("merge-base", "HEAD", main)
    return sorted({*_lines("diff", "--name-only", base), *_lines("ls-files", "--others", "--exclude-standard")})


def _lines(*words: str) -> list[str]:
    return subprocess.run(["git", *words], cwd=ROOT, capture_output=True, text=True, check=False).stdout.splitlines()


def module_of(path: str) -> str | None:
    """Return the module of the library that a file is, None for any other file."""
    parts = Path(path).with_suffix("").parts
    if not path.endswith((".py", ".pyi")) or parts[0] not in ("specklegen", "datasets", "models"):
        return None
    parts = parts if parts[0] == "specklegen" else ("specklegen", *parts)
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


def tests_of_module(module: str) -> str:
    """Return the folder of tests of a module's room, or the file of tests of a module that stands alone."""
    parts = module.split(".")[1:]
    for depth in range(len(parts), 0, -1):
        folder = TESTS.joinpath(*parts[:depth])
        if folder.is_dir():
            return str(folder.relative_to(ROOT))
    file = TESTS / f"test_{parts[0] if parts else 'rendering'}.py"
    return str(file.relative_to(ROOT)) if file.exists() else "tests/test_rendering.py"


def tests_with(pattern: str) -> set[str]:
    """Return the files of tests in whose text a regular expression is found."""
    files = (file for file in TESTS.rglob("test_*.py") if re.search(pattern, file.read_text()))
    return {str(file.relative_to(ROOT)) for file in files}


def rooms(module: str, importers: Callable[[str], Iterable[str]]) -> set[str]:
    """Return the tests of a module's room, and of the rooms that import it or what the room makes of it."""
    room, waiting, touched = tests_of_module(module), [module], {module}
    while waiting:
        found = set(importers(waiting.pop())) - touched
        touched |= found
        waiting += [name for name in found if tests_of_module(name) == room]
    return {tests_of_module(name) for name in touched}


def selection(files: Iterable[str], importers: Callable[[str], Iterable[str]]) -> list[str]:
    """Return the folders and files of tests of a change, none inside another.

    Parameters
    ----------
    files : iterable of str
        Changed paths below the root.
    importers : callable
        Returns the modules that import a module directly.
    """
    chosen = set(ALWAYS)
    for path in files:
        module, file = module_of(path), Path(path)
        if module is not None:
            chosen |= rooms(module, importers)
        elif file.suffix != ".py":
            chosen |= set(OF_FOLDERS.get(file.parts[0], ("tests/test_packaging.py",)))
        elif file.name.startswith("test_"):
            chosen |= {path} if (ROOT / path).exists() else set()
        else:
            chosen |= tests_with(rf"\b(import|from) {file.stem}\b" if file.parts[0] == "tests" else file.stem)
    return sorted(path for path in chosen if not any(str(parent) in chosen for parent in Path(path).parents))


def main() -> None:
    """Print the selection, and on standard error what it was made from."""
    files = changed_files()
    if not files:
        print("nothing differs from main: the fixed selection of tests", file=sys.stderr)
        print(*FIXED)
        return
    graph = grimp.build_graph("specklegen")

    def importers(module: str) -> set[str]:
        return graph.find_modules_that_directly_import(module) if module in graph.modules else set()

    chosen = selection(files, importers)
    print(f"{len(files)} files differ from main: tests of {' '.join(chosen)}", file=sys.stderr)
    print(*chosen)


if __name__ == "__main__":
    main()
