"""The picture of the README: speckle of one slab under five tilts, and an object found behind another one.

python scripts/reproduce_figures.py overview
"""

from pathlib import Path

import matplotlib as mpl
import numpy as np

mpl.use("Agg")
import matplotlib.pyplot as plt
from _command import run

import specklegen as sg
from specklegen.datasets import load_recipe
from specklegen.datasets.loading.stream import tensors
from specklegen.models import Retrieval, evaluate, load_pretrained, load_solver
from specklegen.models.judging.baselines import katz
from specklegen.models.judging.evaluation import Case
from specklegen.models.learning.measurement import measured

OUT = Path(__file__).parents[2] / "docs" / "images"
TILTS = np.array([0.0, 0.003, 0.006, 0.012, 0.024])
"""Degrees."""
SHOWN = 12
"""Sample of the test split that is shown: of a letter with straight strokes the camera image looks woven."""


def tilts() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Intensity float[5, 96, 96] of one slab behind a round aperture, the tilts in degrees, and C_I."""
    slab = sg.Slab(thickness=1000.0, mean_free_path=100.0, scatterer=sg.media.HenyeyGreenstein(g=0.9))
    beams = sg.light.CollimatedBeams.tilts(np.deg2rad(TILTS), width=12_000.0, profile="disc")
    views = sg.sensors.FarField.grid(shape=(96, 96), pitch=8e-6)
    scene = sg.Scene(wavelength=0.5, medium=slab, illumination=beams, sensor=views)
    curve = sg.memory_effect(slab, wavelength=0.5, tilts=np.deg2rad(TILTS), seed=0)
    return sg.render(scene, seed=0).intensity, TILTS, curve.intensity


def reconstructions() -> tuple[Case, float]:
    """An object behind an unknown slab with what three methods make of its camera image; the solver's confidence."""
    recipe = load_recipe("unknown-slab", {"window": {"profile": "disc"}})
    batch = tensors(recipe.batch(0, "test", range(SHOWN, SHOWN + 1)))
    solved = load_solver().solve(*measured(batch, recipe), seed=0)
    methods = {"Katz": katz(Retrieval(restarts=8)), "network": load_pretrained().reconstruct,
               "solver": lambda _: solved.image}  # fmt: skip
    return evaluate(methods, [batch], recipe.profile)[1][0], float(solved.probability[0])


def main(out: Path, quick: bool) -> None:
    """Draw; ``quick`` changes nothing, for it takes seconds."""
    case, confidence = reconstructions()
    figure, axes = plt.subplots(2, 5, figsize=(10, 6.7))
    for axis, image, degrees, shared in zip(axes[0], *tilts(), strict=True):
        axis.imshow(image, cmap="magma", vmax=4 * image.mean())
        _caption(axis, f"{degrees:g}°", f"corr. {shared:.2f}")
    side = len(case.object) // 2
    middle = [side - round((np.arange(2 * side) @ case.object.sum(n)) / case.object.sum()) for n in (1, 0)]
    shown = {"object\n(hidden)": case.object, "camera\nimage": case.image}
    shown |= {f"{name}\nr = {case.scores[name]:.2f}": image for name, image in case.reconstructions.items()}
    for axis, (words, image) in zip(axes[1], shown.items(), strict=True):
        camera = image is case.image
        axis.imshow(image if camera else np.roll(image, middle, (0, 1)), cmap="magma" if camera else "gray")
        _caption(axis, words, *[f"conf. {confidence:.2f}"] * words.startswith("solver"))
    for row, title in zip(axes, ("Five tilts of one slab", "One object behind another slab"), strict=True):
        row[0].set_title(title, loc="left", pad=9, fontsize=21)
    for axis in axes.ravel():
        axis.set(xticks=[], yticks=[])
    figure.subplots_adjust(0.01, 0.165, 0.99, 0.93, wspace=0.07, hspace=0.7)  # captions are wider than images
    figure.savefig(out / "overview.png", dpi=90, pil_kwargs={"optimize": True})


def _caption(axis: plt.Axes, *lines: str) -> None:
    """Write lines below an image, large enough for a screen of 390 pixels."""
    axis.set_xlabel("\n".join(lines), fontsize=20, labelpad=6)


if __name__ == "__main__":
    run(main, OUT, __doc__)
