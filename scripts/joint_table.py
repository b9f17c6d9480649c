"""What five objects through one medium gain from each other: ``python scripts/joint_table.py --groups 8 --waves 2``.

Each image is reconstructed alone by the packaged solver, then all five together (``joint_objects``), by what their
images have in common. Images are rendered (``unknown-slab``, five characters a medium, half a range wide), or drawn by
waves, slice by slice (``specklegen.oracles.multi_slice``), which know nothing of this package's samplers: every object
pixel a plane wave of its own through the same screens, a square window behind them, intensities added.
"""

import argparse
import os

os.environ.setdefault("OMP_NUM_THREADS", "1")

import numpy as np
import torch
from scipy.ndimage import gaussian_filter

import specklegen as sg
from specklegen.datasets import load_recipe
from specklegen.datasets.recipes.hidden_object import HiddenObject
from specklegen.models import Optics, joint_objects, load_solver, measured_memory_effect, periodogram
from specklegen.models.learning.measurement import measured
from specklegen.models.metrics import align, alignment, bootstrap, pearson
from specklegen.models.retrieval.autocorrelation import MemoryEffect
from specklegen.oracles.multi_slice import multi_slice, slice_views

TOGETHER, FRAME = 5, 44
SIZE, SIDE, CAMERA = 384, 16, 96  # of the waves' grid, of objects, and of the camera: bins of the grid's transform
SLAB = sg.Slab(thickness=6.0, mean_free_path=2.6, scatterer=sg.VonMisesFisher(12.0))


def framed(images: torch.Tensor) -> torch.Tensor:
    """Images on a frame that holds them all."""
    before = (FRAME - images.shape[-1]) // 2
    after = FRAME - images.shape[-1] - before
    return torch.nn.functional.pad(images.float(), (before, after, before, after))


def scored(images: torch.Tensor, objects: torch.Tensor, alone: torch.Tensor, optics: Optics) -> np.ndarray:
    """Correlations alone and together float64[N], and whether each came out upright: float64[3, N]."""
    found, target = joint_objects(images, alone.double(), optics), framed(objects)
    one, both = (pearson(align(framed(x), target), target).numpy() for x in (alone, found.image))
    return np.array([one, both, ~alignment(framed(found.image), target).flipped.numpy()])


def rendered(seed: int, groups: int) -> list[np.ndarray]:
    """Scores of groups of images through one slab each."""
    recipe, solver = load_recipe("unknown-slab", {"media_group": TOGETHER}), load_solver()
    if not isinstance(recipe, HiddenObject):
        raise TypeError("a recipe with hidden objects")
    solver.points, found = None, []
    for group in range(groups):
        batch = recipe.batch(seed, "test", range(TOGETHER * group, TOGETHER * (group + 1)))
        seen, optics, memory = measured(batch, recipe)
        alone = solver.solve(seen, optics, memory, seed=seed).image
        images, objects = torch.from_numpy(batch["image"]), torch.from_numpy(batch["object"])
        found.append(scored(images, objects, alone, optics))
    return found


def drawn_by_waves(seed: int, groups: int) -> list[np.ndarray]:
    """The same of images that waves draw."""
    recipe, solver = load_recipe("unknown-slab", {"objects": {"shape": [SIDE, SIDE]}}), load_solver()
    if not isinstance(recipe, HiddenObject):
        raise TypeError("a recipe with hidden objects")
    places = np.arange(SIDE) - SIDE // 2
    tilts = [(int(x), int(y)) for y in places for x in places]
    bins = np.arange(SIDE)
    curve = multi_slice(
        SLAB, wavelength=1.0, pitch=0.5, size=SIZE, bins=bins.tolist(), realizations=2, seed=seed, reach=0.25
    )  # fmt: skip
    c_i = np.minimum.accumulate(curve.on_axis.mean(0) / curve.on_axis.mean(0)[0])
    solver.points, found = None, []
    window = np.zeros((SIZE, SIZE), bool)
    window[SIZE // 4 : 3 * SIZE // 4, SIZE // 4 : 3 * SIZE // 4] = True
    some = np.arange(-CAMERA // 2, CAMERA // 2)
    for group in range(groups):
        (fields,) = slice_views(
            SLAB, wavelength=1.0, pitch=0.5, size=SIZE, bins=tilts, realizations=1, seed=1000 * seed + group
        )  # fmt: skip
        patterns = []
        for (x, y), field in zip(tilts, fields, strict=True):
            field[y, x] = 0  # light that was not scattered
            inside = np.fft.fft2(np.fft.ifft2(field) * window)
            patterns.append(np.square(np.abs(inside[some][:, some])))
        objects = np.stack([recipe.objects.image(seed, "test", TOGETHER * group + n) for n in range(TOGETHER)])
        # A pixel's light goes along its tilt: the camera shows objects upright, samples of a recipe turned.
        images = np.tensordot(objects.reshape(TOGETHER, -1)[:, ::-1], np.array(patterns, np.float64), axes=1)
        envelope = gaussian_filter(images.mean(0), 16, mode="nearest")
        seen = torch.from_numpy(images / envelope)
        optics = Optics(step=1.0, grain=2.0)
        memory = [known(bins, c_i)] * TOGETHER
        alone = solver.solve(periodogram(seen[:, None]), optics, memory, seed=seed).image
        found.append(scored(seen, torch.from_numpy(objects), alone, optics))
    return found


def known(distances: np.ndarray, values: np.ndarray) -> MemoryEffect:
    """C_I of waves at distances in object pixels, made positive definite."""
    return measured_memory_effect(distances, values)


def report(name: str, found: list[np.ndarray]) -> str:
    """One row of the table."""
    alone, both, upright = np.concatenate(found, axis=1)
    media = np.repeat(np.arange(len(found)), TOGETHER)
    cells = ["{:.3f} [{:.3f}, {:.3f}]".format(*bootstrap(x, media)) for x in (alone, both)]
    gain = "{:+.3f} [{:+.3f}, {:+.3f}]".format(*bootstrap(both - alone, media))
    return f"| {name} | {len(alone)} | {cells[0]} | {cells[1]} | {gain} | {upright.mean():.2f} |"


def main() -> None:
    """Command line."""
    options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    options.add_argument("--groups", type=int, default=8, help="Media of rendered images.")
    options.add_argument("--waves", type=int, default=2, help="Media of images that waves draw.")
    options.add_argument("--seed", type=int, default=7)
    given = options.parse_args()
    print("| images | number | each alone | together | gain, paired | upright |\n|---|---|---|---|---|---|", flush=True)
    if given.waves:
        print(report("by waves", drawn_by_waves(given.seed, given.waves)), flush=True)
    if given.groups:
        print(report("rendered", rendered(given.seed, given.groups)), flush=True)


if __name__ == "__main__":
    main()
