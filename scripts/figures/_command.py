"""The command line that the scripts of figures share, and how they write figures."""

import argparse
import sys
from collections.abc import Callable
from pathlib import Path

import matplotlib.pyplot as plt

sys.path.append(str(Path(__file__).parents[2] / "tests"))  # right values: tests/references


def run(main: Callable[[Path, bool], None], out: Path, description: str | None) -> None:
    """Call ``main(out, quick)`` with what the command line says; ``out`` is the folder by default."""
    parser = argparse.ArgumentParser(description=(description or "").partition("\n\n")[0])
    parser.add_argument("--out", type=Path, default=out, help="folder for the figures (default: %(default)s)")
    parser.add_argument("--quick", action="store_true", help="a rough version")
    chosen = parser.parse_args()
    main(chosen.out, chosen.quick)


def save(figure: plt.Figure, path: Path, dpi: int = 80) -> None:
    """Write a figure, small enough for a repository, and close it."""
    figure.tight_layout()
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=dpi, pil_kwargs={"optimize": True})
    plt.close(figure)
