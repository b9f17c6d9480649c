"""How figures are written."""

from pathlib import Path

import matplotlib.pyplot as plt


def save(figure: plt.Figure, path: Path, dpi: int = 80) -> None:
    """Write a figure, small enough for a repository, and close it."""
    figure.tight_layout()
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=dpi, pil_kwargs={"optimize": True})
    plt.close(figure)
