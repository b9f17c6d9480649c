"""The picture of the landing page: a photograph of a setup, what is found in it, what was hidden, and other answers.

    python scripts/landing_picture.py                 # docs/images/photograph.png; a minute on one core

It is the figure of the gallery's page about a TIFF of one's own (docs/gallery/plot_28_your_own_tiff.py).
"""

import argparse
import runpy
from pathlib import Path

import matplotlib as mpl

mpl.use("agg")
from matplotlib import pyplot as plt  # noqa: E402

ROOT = Path(__file__).resolve().parents[1]


def main() -> None:
    """Command line."""
    options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    options.add_argument("--out", type=Path, default=ROOT / "docs/images/photograph.png")
    given = options.parse_args()
    runpy.run_path(str(ROOT / "docs/gallery/plot_28_your_own_tiff.py"))
    plt.gcf().savefig(given.out, dpi=110, bbox_inches="tight")


if __name__ == "__main__":
    main()
