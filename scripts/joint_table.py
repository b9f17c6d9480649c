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
EVEN = 0.9  # correlation with its own turn, from which on an object has none
SIZE, SIDE, CAMERA = 384, 16, 96  # of the waves' grid, of objects, and of the camera: bins of the grid's transform
WAVES = Optics(step=1.0, grain=2.0)
SLAB = sg.Slab(thickness=6.0, mean_free_path=2.6, scatterer=sg.VonMisesFisher(12.0))


def framed(images: torch.Tensor) -> torch.Tensor:
    """Images on a frame that holds them all."""
    before = (FRAME - images.shape[-1]) // 2
    after = FRAME - images.shape[-1] - before
    return torch.nn.functional.pad(images.float(), (before, after, before, after))


def scored(images: torch.Tensor, objects: torch.Tensor, alone: torch.Tensor, optics: Optics) -> np.ndarray:
    """Correlations alone and together, and whether each came out upright, NaN where it has no turn: float64[3, N]."""
    found, target = joint_objects(images, alone.double(), optics), framed(objects)
    one, both = (pearson(align(framed(x), target), target).numpy() for x in (alone, found.image))
    wave = torch.fft.rfft2(target - target.mean((-2, -1), keepdim=True))
    lags = torch.fft.irfft2(wave.square(), s=target.shape[-2:]).flatten(1).amax(1)  # with its own turn, at any shift
    even = lags / torch.fft.irfft2(wave.abs().square(), s=target.shape[-2:])[:, 0, 0] > EVEN
    upright = (~alignment(framed(found.image), target).flipped).double().where(~even, float("nan"))
    return np.array([one, both, upright.numpy()])


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
    memory = [memory_of_waves(SLAB, seed)] * TOGETHER
    solver.points, found = None, []
    for group in range(groups):
        objects = np.stack([recipe.objects.image(seed, "test", TOGETHER * group + n) for n in range(TOGETHER)])
        images = torch.from_numpy(images_of_waves(wave_patterns(SLAB, 1000 * seed + group), objects))
        alone = solver.solve(periodogram(images[:, None]), WAVES, memory, seed=seed).image
        found.append(scored(images, torch.from_numpy(objects), alone, WAVES))
    return found


def memory_of_waves(slab: sg.Slab, seed: int) -> MemoryEffect:
    """C_I of waves over object pixels, made positive definite."""
    bins = np.arange(SIDE)
    curve = multi_slice(
        slab, wavelength=1.0, pitch=0.5, size=SIZE, bins=bins.tolist(), realizations=2, seed=seed, reach=0.25
    )  # fmt: skip
    c_i = curve.on_axis.mean(0) / curve.on_axis.mean(0)[0]
    return measured_memory_effect(bins, np.minimum.accumulate(c_i))


def wave_patterns(slab: sg.Slab, seed: int) -> np.ndarray:
    """What the camera sees of every object pixel behind a slab, float32[SIDE^2, CAMERA, CAMERA]."""
    places = np.arange(SIDE) - SIDE // 2
    tilts = [(int(x), int(y)) for y in places for x in places]
    window = np.zeros((SIZE, SIZE), bool)
    window[SIZE // 4 : 3 * SIZE // 4, SIZE // 4 : 3 * SIZE // 4] = True
    some = np.arange(-CAMERA // 2, CAMERA // 2)
    (fields,) = slice_views(slab, wavelength=1.0, pitch=0.5, size=SIZE, bins=tilts, realizations=1, seed=seed)
    patterns = np.empty((len(tilts), CAMERA, CAMERA), np.float32)
    for n, ((x, y), field) in enumerate(zip(tilts, fields, strict=True)):
        field[y, x] = 0  # light that was not scattered
        inside = np.fft.fft2(np.fft.ifft2(field) * window)
        patterns[n] = np.square(np.abs(inside[some][:, some]))
    return patterns


def images_of_waves(patterns: np.ndarray, objects: np.ndarray) -> np.ndarray:
    """Images float64[N, CAMERA, CAMERA] of objects float[N, SIDE, SIDE] through one medium, over their envelope.

    A pixel's light goes along its tilt: the camera would show objects upright, samples of a recipe are turned.
    """
    images = np.tensordot(objects.reshape(len(objects), -1)[:, ::-1].astype(np.float64), patterns, axes=1)
    return images / gaussian_filter(images.mean(0), 16, mode="nearest")


def report(name: str, found: list[np.ndarray]) -> str:
    """One row of the table."""
    alone, both, upright = np.concatenate(found, axis=1)
    media = np.repeat(np.arange(len(found)), TOGETHER)
    cells = ["{:.3f} [{:.3f}, {:.3f}]".format(*bootstrap(x, media)) for x in (alone, both)]
    gain = "{:+.3f} [{:+.3f}, {:+.3f}]".format(*bootstrap(both - alone, media))
    turns = f"{np.nanmean(upright):.3f} of {np.isfinite(upright).sum()}"
    return f"| {name} | {len(alone)} | {cells[0]} | {cells[1]} | {gain} | {turns} |"


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
