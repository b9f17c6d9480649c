"""The picture of docs/recoverability.md: one scene that works, and every way to fail; the verdicts checked.

python scripts/build/recoverability_picture.py --out docs/images/recoverability.png
"""

import argparse
from pathlib import Path

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
import torch
from fit_recoverability import CellScene, observed, read, retrieved

from specklegen.models.metrics import pearson
from specklegen.models.recoverability.verdict import COEFFICIENTS, Verdict, judge, odds, share

TABLE = Path(__file__).parents[2] / "tests/data/recoverability.csv"
GOOD = CellScene("glyphs", 28, 420, 0.3, True, True)
POINTS = CellScene("6 points", 18, 420, 2.0, True, True)
SCENES = {
    "as it should be": GOOD,
    "small camera": GOOD._replace(camera=72),
    "two ranges wide,\nno division by C_I": POINTS._replace(compensation=False),
    "two ranges wide,\ndivided by C_I": POINTS,
    "overexposed": GOOD._replace(saturation=0.4),
    "beam left in": GOOD._replace(beam=0.2),
    "dim": GOOD._replace(photons=0.03),
    "complex object": GOOD._replace(objects="24 points", side=28, camera=160),
}
MEDIUM = 5


def column(panels, title: str, scene: CellScene) -> Verdict:
    """Camera, object, what came back; the verdict below."""
    lags, objects, _ = observed(scene, MEDIUM + 1)
    _, _, image = observed(scene, 1)
    found, target = retrieved(scene, lags[MEDIUM:], objects[MEDIUM:], restarts=8)
    verdict = judge(scene.conditions())
    margin = (target.shape[-1] - scene.side) // 2
    centred = [torch.roll(x[0], (margin, margin), (0, 1)) for x in (target, found)]
    shown = [np.clip(image, 0, np.quantile(image, 0.999)), *centred]
    for panel, picture in zip(panels, shown, strict=True):
        panel.imshow(picture, cmap="inferno", vmin=0)
        panel.set_xticks([]), panel.set_yticks([])
    reason = verdict.reasons[0].name if verdict.reasons else ""
    word = "works" if verdict.works else "fails"
    panels[0].set_title(title, fontsize=9)
    panels[2].set_xlabel(
        f"correlation {pearson(found, target)[0]:.2f}\npredicted: {word},\np = {verdict.probability:.2f}\n"
        f"{reason.replace('memory-effect range', 'range')}",
        fontsize=7.5,
    )
    return verdict


def calibration(panel) -> None:
    """Predicted probability against measured rate, cells of either half."""
    table = read(TABLE)
    coefficients = np.array(list(COEFFICIENTS.values()))
    for odd, colour, name in ((False, "0.7", "fitted"), (True, "crimson", "held out")):
        half = table.half(odd)
        z = odds(half, coefficients)
        rate = half.successes / half.media
        offset = (half.cell % 7 - 3) * 0.006  # so that equal rates do not hide one another
        panel.scatter(z, rate + offset, s=14, color=colour, label=name, zorder=1 + odd)
    z = np.linspace(-9, 6, 200)
    panel.plot(z, share(z, coefficients[-1]), "k", lw=1, label="predicted")
    panel.set_xlim(-9, 6)
    panel.axvline(0, color="k", lw=0.5, ls=":")
    panel.set_xlabel("logarithm of the predicted odds of success")
    panel.set_ylabel("share of media that succeed")
    panel.legend(loc="upper left", fontsize=8)


def main() -> None:
    """Read the command line, draw."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--out", type=Path, required=True)
    chosen = parser.parse_args()
    figure = plt.figure(figsize=(1.75 * len(SCENES), 9))
    grid = figure.add_gridspec(4, len(SCENES), height_ratios=[1, 1, 1, 1.6], hspace=0.12, wspace=0.08)
    for n, (title, scene) in enumerate(SCENES.items()):
        panels = [figure.add_subplot(grid[row, n]) for row in range(3)]
        verdict = column(panels, title, scene)
        print(title.replace("\n", " "), scene, verdict.explain(), sep="\n", end="\n\n")
        if n == 0:
            for panel, name in zip(panels, ("camera", "object", "retrieved"), strict=True):
                panel.set_ylabel(name, fontsize=9)
    place = grid[3, 1:-1].get_position(figure)
    calibration(figure.add_axes((place.x0, place.y0 - 0.03, place.width, place.height * 0.72)))
    figure.savefig(chosen.out, dpi=80, bbox_inches="tight")


if __name__ == "__main__":
    main()
