"""Three newcomers' first ten minutes, as they would type them; what each types, how long it takes, what comes out.

    python scripts/newcomers.py --out newcomers                  # all three, some ten minutes on two cores
    python scripts/newcomers.py --out newcomers --only curve

images      a folder of pictures -> a network trained on what a camera sees of them, judged beside phase retrieval
photograph  a TIFF of one's own setup -> what is hidden there, with the probability that it is right
curve       a material -> memory effect with error bars, as CSV and as a figure

What a newcomer would bring along (pictures, a photograph and the setup's file) is made first, and not counted. Every
line stands in the README or in docs/start.md, but for names of files; the first that fails ends the role. So does a
network that is no better than the mean image, or than the network that it started from.
"""

import argparse
import csv
import re
import shlex
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import numpy as np
import tifffile
from PIL import Image, ImageDraw

SECONDS = 240
"""Of training, by the clock."""
SETUP = """\
inherits = "through-slab-lab"
name = "my-setup"

[lab]
object_distance = 300.0
aperture = 3.0
object_extent = 0.45

[material]
thickness = 0.1
optical_depth = 8.0
g = 0.92
"""


class Role(NamedTuple):
    """What is there before, what is typed, the files that shall be there then, and what else is asked of them."""

    brings: Callable[[Path], None]
    typed: list[str]
    made: list[str]
    asked: Callable[[Path], None]


def pictures(folder: Path) -> None:
    """Sixty pictures of one's own: arrows, rings and stairs."""
    (folder / "my-images").mkdir()
    rng = np.random.default_rng(0)
    for n in range(60):
        picture = Image.new("L", (64, 64))
        draw = ImageDraw.Draw(picture)
        x, y, size = rng.integers(12, 24), rng.integers(12, 24), int(rng.integers(18, 30))
        if n % 3 == 0:
            draw.line([(x, y + size), (x + size, y)], fill=255, width=6)
            draw.polygon([(x + size, y), (x + size - 14, y + 2), (x + size - 2, y + 14)], fill=255)
        elif n % 3 == 1:
            draw.ellipse([x, y, x + size, y + size], outline=255, width=6)
        else:
            for left, right in ((0, 1), (1, 2), (2, 3)):
                top, bottom = y + left * size // 3, y + right * size // 3
                draw.rectangle([x + left * size // 3, top, x + size, bottom], fill=255)
        picture.save(folder / "my-images" / f"{n:03d}.png")


def photograph(folder: Path) -> None:
    """A setup's file, and a frame of its camera with a letter behind the slab."""
    from specklegen.datasets import load_recipe

    (folder / "setup.toml").write_text(SETUP)
    sample = load_recipe(str(folder / "setup.toml")).sample(7, "test", 0)
    tifffile.imwrite(folder / "frame.tif", sample["image"].astype(np.uint16))


def nothing(folder: Path) -> None:
    """Nothing."""


def learned(folder: Path) -> None:
    """Ask that the network is better than the mean image in the evaluation, and than it was before its training.

    Raises
    ------
    SystemExit
        If it is not.
    """
    with (folder / "judged" / "summary.csv").open(newline="") as file:
        score = {
            row["method"]: float(row["mean"]) for row in csv.DictReader(file)
            if (row["target"], row["score"]) == ("sharp", "pearson")
        }  # fmt: skip
    (least,) = re.findall(r"network at the start .*\| \S+ \[(\S+),", (folder / "runs/mine/summary.md").read_text())
    if not (score["mine"] > score["mean image"] and float(least) > 0):
        raise SystemExit(f"the network learned nothing: {score}, at least {least} over its start")


ROLES = {
    "images": Role(pictures, [
        "specklegen recoverable through-slab --images my-images",
        "specklegen preview through-slab --images my-images --out sheet.png",
        f"specklegen train through-slab --images my-images --start packaged --out runs/mine --seconds {SECONDS}",
        "specklegen evaluate runs/mine/best.pt --recipe through-slab --images my-images --samples 16 --out judged",
    ], ["sheet.png", "runs/mine/best.pt", "judged"], learned),
    "photograph": Role(photograph, [
        "specklegen plan setup.toml",
        "specklegen recoverable setup.toml",
        "specklegen reconstruct frame.tif --setup setup.toml --out seen",
    ], ["seen"], nothing),
    "curve": Role(nothing, [
        "specklegen memory-effect --material skin --wavelength 0.806 --thickness 300 --out curves",
        "specklegen memory-effect --g 0.9 --g 0.95 --out fogs",
    ], ["curves/memory-effect.csv", "curves/memory-effect.png", "fogs/memory-effect.png"], nothing),
}  # fmt: skip


def played(role: Role, folder: Path) -> list[tuple[str, float]]:
    """Type the lines of a role in a folder; each with its seconds by the clock.

    Raises
    ------
    SystemExit
        If a line fails, or leaves a file out.
    """
    folder.mkdir(parents=True)
    role.brings(folder)
    took = []
    for line in role.typed:
        begun = time.perf_counter()
        print(f"$ {line}", flush=True)
        words = shlex.split(line)
        program = str(Path(sys.executable).with_name(words[0]))
        if subprocess.run([program, *words[1:]], cwd=folder, check=False).returncode:
            raise SystemExit(f"failed: {line}")
        took.append((line, time.perf_counter() - begun))
    missing = [name for name in role.made if not (folder / name).exists()]
    if missing:
        raise SystemExit(f"not made: {missing}")
    role.asked(folder)
    return took


def main() -> None:
    """Command line."""
    options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    options.add_argument("--out", type=Path, required=True, help="A folder that is not there yet.")
    options.add_argument("--only", choices=ROLES)
    given = options.parse_args()
    every = {name: played(ROLES[name], given.out / name) for name in ([given.only] if given.only else ROLES)}
    print("\n| role | lines | characters | seconds by the clock |\n|---|---|---|---|")
    for name, took in every.items():
        print(f"| {name} | {len(took)} | {sum(len(line) for line, _ in took)} | {sum(s for _, s in took):.0f} |")


if __name__ == "__main__":
    main()
