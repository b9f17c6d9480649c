"""Draw the figures of a paper anew, and print its tables.

    python scripts/reproduce_figures.py prahl09 [--out DIR] [--quick]

A name is that of a file in scripts/figures/ with a function ``main(out, quick)`` and its own folder ``OUT``.
"""

import argparse
import importlib.util
import sys
from pathlib import Path
from types import ModuleType

FIGURES = Path(__file__).parent / "figures"


def names() -> list[str]:
    """Sets of figures that there are."""
    return sorted(path.stem for path in FIGURES.glob("*.py") if not path.stem.startswith("_"))


def load(name: str) -> ModuleType:
    """Import scripts/figures/NAME.py, which may import the ``_`` modules beside it."""
    if str(FIGURES) not in sys.path:
        sys.path.insert(0, str(FIGURES))
    spec = importlib.util.spec_from_file_location(name, FIGURES / f"{name}.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def main(arguments: list[str] | None = None) -> None:
    """Read the command line and draw."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("name", choices=names(), help="which figures")
    parser.add_argument("--out", type=Path, help="folder for them; by default the one in docs/ that shows them")
    parser.add_argument("--quick", action="store_true", help="a rough version in seconds")
    chosen = parser.parse_args(arguments)
    module = load(chosen.name)
    module.main(chosen.out or module.OUT, chosen.quick)


if __name__ == "__main__":
    main()
