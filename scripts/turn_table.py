"""How often the turn is told, and how often rightly: ``python scripts/turn_table.py --out runs/turns --images 24``.

Images are rendered as in ``posterior_table.py``, of thinner slabs and never of few photons, and reconstructed by the
packaged solver; the turn of its image is told by the third order of the camera image. The truth is the turn that moves
the image onto the object best. Objects that are nearly their own turn (r above .9) have none, and are left out. What
was found is kept in a file a batch; ``--seed`` odd: validation splits, to which the slope was fitted, even: test ones.
"""

import argparse
import multiprocessing
import os
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")

import numpy as np
import torch
from any_object_table import EXTENT
from posterior_table import BATCH, FAMILIES, FOLDERS, draw_folder
from scipy.optimize import minimize_scalar

from specklegen.datasets import load_recipe
from specklegen.datasets.loading.stream import tensors
from specklegen.datasets.recipes.hidden_object import HiddenObject
from specklegen.models import load_solver, turn_of
from specklegen.models.learning.measurement import measured
from specklegen.models.metrics import align, alignment, pearson

KINDS = ("held-out characters", "own shapes", "handwritten digits", "points between pixels", "grey pictures", "bars")
EXTENTS = (0.0, 0.5, 1.0, 4.0)
CLAIMED = 0.9


def found(job: tuple[str, int, int, Path]) -> Path:
    """Turns of a batch of images of a family."""
    family, seed, first, out = job
    file = out / f"turns-{family.replace(' ', '-')}-{seed}-{first:04}.npz"
    if file.exists():
        return file
    torch.set_num_threads(1)
    solver = load_solver()
    solver.points = None
    own = {"path": str(out / family.replace(" ", "-"))} if family in FOLDERS else {}
    changes = {
        "objects": {"shape": [EXTENT, EXTENT], **FAMILIES[family], **own},
        "material": {"thickness": {"log_uniform": [600.0, 1500.0]}, "g": {"uniform": [0.85, 0.95]}},
    }  # thinner slabs than the recipe's: most objects lie within a range, where there is something to tell
    recipe = load_recipe("one-angular-size", changes)
    if not isinstance(recipe, HiddenObject):
        raise TypeError("a recipe with hidden objects")
    batch = recipe.batch(seed, "validation" if seed % 2 else "test", range(BATCH * first, BATCH * (first + 1)))
    seen, optics, memory = measured(batch, recipe)
    solved = solver.solve(seen, optics, memory, seed=seed)
    objects = torch.nn.functional.pad(tensors(batch)["object"].float(), (4, 4, 4, 4))
    images = torch.as_tensor(np.asarray(batch["image"], np.float64))[:, None]
    spreads = turn_of(images, solved.image.double(), optics, seen.noise).spreads
    true = turn_of(images, objects.double(), optics, seen.noise).spreads
    best = alignment(solved.image, objects)
    half = objects.flip((-2, -1))
    np.savez(
        file, spreads=spreads.numpy(), true=true.numpy(), flipped=best.flipped.numpy(),
        even=_unturned(objects, half).numpy(), r=pearson(align(solved.image, objects), objects).numpy(),
        probability=solved.probability.numpy(), extent=np.asarray(batch["parameters"]["extent_over_range"]),
    )  # fmt: skip
    return file


def _unturned(image: torch.Tensor, target: torch.Tensor) -> torch.Tensor:
    """Largest correlation by shifts alone, float[B]."""
    one, other = (torch.fft.rfft2(x - x.mean((-2, -1), keepdim=True)) for x in (image, target))
    lags = torch.fft.irfft2(one.conj() * other, s=image.shape[-2:]).flatten(1).amax(1)
    return lags / (image.var((-2, -1), correction=0) * target.var((-2, -1), correction=0)).sqrt() / image[0].numel()


def report(out: Path, seed: int, slope: float | None) -> str:
    """Table of what was found."""
    files = sorted(out.glob(f"turns-*-{seed}-*.npz"))
    parts = [np.load(file) for file in files]
    names = np.concatenate([
        np.full(len(part["r"]), file.name[6:].rsplit(f"-{seed}-", 1)[0])
        for part, file in zip(parts, files, strict=True)
    ])
    data = {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}
    turns = data["even"] < 0.9
    right = (data["spreads"] < 0) == data["flipped"]
    size = np.abs(data["spreads"])
    fitted = minimize_scalar(
        lambda k: np.log1p(np.exp(-k * np.where(right, size, -size)[turns])).sum(), bounds=(0.01, 3), method="bounded"
    )
    slope = float(fitted.x) if slope is None else slope
    told = 1 / (1 + np.exp(-slope * size))
    lines = [f"slope fitted to seed {seed}: {float(fitted.x):.2f}; used below: {slope:.2f}", "",
             "| objects | extent, ranges | images | right, all | claimed | of these right | by the object itself |",
             "|---|---|---|---|---|---|---|"]  # fmt: skip
    for name in [*dict.fromkeys(names), ""]:
        for low, high in zip(EXTENTS[:-1], EXTENTS[1:], strict=True):
            part = turns & (data["extent"] >= low) & (data["extent"] < high) & ((names == name) | (name == ""))
            if not part.any():
                continue
            sure = part & (told >= CLAIMED) & (data["probability"] >= 0.5)
            itself = (data["true"] > 0)[part].mean()
            share = f"{right[sure].mean():.2f}" if sure.any() else ""
            lines.append(f"| {name or 'all'} | {low} to {high} | {part.sum()} | {right[part].mean():.2f} | "
                         f"{sure.sum() / part.sum():.2f} | {share} ({sure.sum()}) | {itself:.2f} |")  # fmt: skip
    edges = (0.5, 0.6, 0.7, 0.8, 0.9, 0.97, 1.01)
    lines += ["", "| probability said | images | mean said | right |", "|---|---|---|---|"]
    for low, high in zip(edges[:-1], edges[1:], strict=True):
        part = turns & (told >= low) & (told < high)
        if part.any():
            means = f"{told[part].mean():.2f} | {right[part].mean():.2f}"
            lines.append(f"| {low} to {min(high, 1)} | {part.sum()} | {means} |")
    return "\n".join(lines)


def main() -> None:
    """Command line."""
    options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    options.add_argument("--out", type=Path, default=Path("runs/turns"))
    options.add_argument("--images", type=int, default=24, help="Of each family.")
    options.add_argument("--seed", type=int, default=41)
    options.add_argument("--slope", type=float, default=None, help="By default the one that fits best.")
    options.add_argument("--workers", type=int, default=1)
    options.add_argument("--families", nargs="*", default=list(KINDS))
    given = options.parse_args()
    given.out.mkdir(parents=True, exist_ok=True)
    for family in set(FOLDERS) & set(given.families):
        if not (given.out / family.replace(" ", "-")).exists():
            draw_folder(family, given.out / family.replace(" ", "-"))
    jobs = [(f, given.seed, n, given.out) for n in range(given.images // BATCH) for f in given.families]
    with multiprocessing.get_context("spawn").Pool(given.workers) as pool:
        list(pool.imap(found, jobs))
    print(report(given.out, given.seed, given.slope))


if __name__ == "__main__":
    main()
