"""Tables of the posterior: families that its prior knows and does not know, beside the solver and phase retrieval.

    python scripts/posterior_table.py --out runs/posterior-table --images 32 --workers 2

Images are rendered as in ``any_object_table.py`` (*one-angular-size*: 128 x 128 pixels, 0.1 to 3 memory-effect ranges,
slabs of drawn material), C_I known; a part of the images has 10 photons a pixel. Scores are Pearson's r against the
sharp object, moved onto it. What was drawn is kept in one file a family, so that factors and certificate can be fitted
without drawing again (``--seed`` other than that of the judged images).
"""

import argparse
import multiprocessing
import os
import sys
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")

import numpy as np
import torch
from any_object_table import EXTENT, HELD_OUT, LAGS, draw_shapes
from PIL import Image

from specklegen.datasets import load_recipe
from specklegen.datasets.loading.stream import tensors
from specklegen.datasets.recipes.hidden_object import HiddenObject
from specklegen.models import load_solver
from specklegen.models.judging.evaluation import aligned_to
from specklegen.models.learning.feedback import Measured
from specklegen.models.learning.measurement import measured
from specklegen.models.learning.posterior import drawn, generator_of, load_prior, read_prior, starts_of, surprise
from specklegen.models.learning.reconstructor import centred
from specklegen.models.learning.solver import first_look
from specklegen.models.likelihood.third_order import turn_of
from specklegen.models.metrics import alignment, pearson

FOLDERS = ("own shapes", "points between pixels", "gratings", "faces", "grey pictures")
FAMILIES = {
    "held-out characters": {"type": "Glyphs", **HELD_OUT},
    "5 points": {"type": "Points"},
    "handwritten digits": {"type": "Digits"},
    "bars": {"type": "Bars"},
    "silhouettes": {"type": "Silhouettes"},
    "photographs": {"type": "Photographs"},
    **{name: {"type": "Folder"} for name in FOLDERS},
}
BATCH, DRAWS, PICTURES = 8, 8, 96


def draw_folder(family: str, folder: Path) -> None:
    """Write pictures of a family that no recipe has."""
    if family == "own shapes":
        return draw_shapes(folder)
    sys.path.insert(0, str(Path(__file__).parent / "build"))
    from object_mix import Mix  # pyright: ignore[reportMissingImports]

    folder.mkdir(parents=True, exist_ok=True)
    mix = Mix({})
    own = {"points between pixels": [mix.soft_points], "gratings": [mix.grating], "faces": [mix.face],
           "grey pictures": [mix.clouds, mix.leaves]}[family]  # fmt: skip
    for n in range(PICTURES):
        rng = np.random.default_rng([77, n])
        picture = own[n % len(own)](rng)
        Image.fromarray(np.round(255 * picture / picture.max()).clip(0, 255).astype(np.uint8)).save(
            folder / f"{n:03}.png"
        )
    return None


def scored(job: tuple[str, int, int, Path, Path | None]) -> Path:
    """Draw for a batch of images of a family, and keep everything."""
    family, seed, first, out, weights = job
    file = out / f"{family.replace(' ', '-')}-{seed}-{first:04}.npz"
    if file.exists():
        return file
    torch.set_num_threads(1)
    net, solver = load_prior() if weights is None else read_prior(weights), load_solver()
    solver.points = None  # few points on pixels have a search of their own, which takes long
    folder = out / family.replace(" ", "-")
    own = {"path": str(folder)} if family in FOLDERS else {}
    changes = {"objects": {"shape": [EXTENT, EXTENT], **FAMILIES[family], **own}}
    if first % 4 == 3:
        changes["exposure"] = {"photons": 10.0, "bit_depth": None}
    recipe = load_recipe("one-angular-size", changes)
    split = "validation" if seed % 2 else "test"
    if not isinstance(recipe, HiddenObject):
        raise TypeError("a recipe with hidden objects")
    batch = recipe.batch(seed, split, range(BATCH * first, BATCH * (first + 1)))
    seen, optics, memory = measured(batch, recipe)
    objects = tensors(batch)["object"].float()
    framed = torch.nn.functional.pad(objects, (0, LAGS - EXTENT, 0, LAGS - EXTENT))
    seen, likelihood, between, at_lags = solver._measured("table", seen, optics, memory)
    shown = first_look(likelihood, at_lags, solver.network.frame, seed)
    solved = solver._solved(seen, likelihood, between, at_lags, shown)
    hints = Measured.of(likelihood, between, at_lags)
    generator = generator_of([seed, first])
    starts, kept = starts_of(hints, solved.image, shown.answers, DRAWS)
    made = centred(drawn(net, hints, starts, kept, generator))
    known = centred(shown.answers / shown.answers.amax((-2, -1), keepdim=True).clamp_min(1e-6))
    pictures = torch.cat([made, centred(solved.image)[:, None], known], dim=1)
    with torch.no_grad():
        excess = likelihood.excess(pictures.clamp_min(1e-3), between[:, None])
        placed = torch.nn.functional.pad(objects, (4, 4, 4, 4))[:, None]
        true = likelihood.excess(placed.clamp_min(1e-3), between[:, None])
    prior = surprise(net, pictures, generator)
    scores = torch.stack([pearson(aligned_to(x, framed, objects.shape[-2:]), objects) for x in pictures.unbind(1)], 1)
    images = torch.as_tensor(np.asarray(batch["image"], np.float64))[:, None]
    turns = torch.stack([turn_of(images, x.double(), optics, seen.noise).spreads for x in pictures.unbind(1)], 1)
    placed = placed.expand_as(pictures)
    flipped = alignment(pictures, placed).flipped
    flat = torch.fft.rfft2(placed[:, 0] - placed[:, 0].mean((-2, -1), keepdim=True))
    even = torch.fft.irfft2(flat.square(), s=(36, 36)).flatten(1).amax(1)
    even = even / torch.fft.irfft2(flat.abs().square(), s=(36, 36))[:, 0, 0]
    np.savez_compressed(
        file, turns=turns.numpy(), flipped=flipped.numpy(), even=even.numpy(),
        pictures=pictures.half().numpy(), objects=objects.half().numpy(), excess=excess.numpy(),
        prior=prior.numpy(), scores=scores.numpy(), true=true[:, 0].numpy(), probability=solved.probability.numpy(),
        spread=likelihood.spread.numpy(), extent=np.asarray(batch["parameters"]["extent_over_range"]),
        photons=np.full(len(objects), 10.0 if first % 4 == 3 else np.inf), deviance=solved.deviance.numpy(),
    )  # fmt: skip
    return file


def main() -> None:
    """Command line."""
    options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    options.add_argument("--out", type=Path, default=Path("runs/posterior-table"))
    options.add_argument("--images", type=int, default=32, help="Of each family.")
    options.add_argument("--seed", type=int, default=22, help="Even: test splits; odd: validation splits.")
    options.add_argument("--workers", type=int, default=1)
    options.add_argument("--prior", type=Path, default=None, help="Weights; by default the packaged ones.")
    options.add_argument("--families", nargs="*", default=list(FAMILIES))
    given = options.parse_args()
    given.out.mkdir(parents=True, exist_ok=True)
    for family in FOLDERS:
        if not (given.out / family.replace(" ", "-")).exists():
            draw_folder(family, given.out / family.replace(" ", "-"))
    jobs = [
        (family, given.seed, first, given.out, given.prior)
        for first in range(given.images // BATCH) for family in given.families
    ]  # fmt: skip
    with multiprocessing.get_context("spawn").Pool(given.workers) as pool:
        for file in pool.imap(scored, jobs):
            print(file.name, flush=True)


if __name__ == "__main__":
    main()
