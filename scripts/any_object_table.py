"""Tables of the solver for any object: families that it knows and does not know, its certificate, and the range.

    python scripts/any_object_table.py --out runs/any-object-table                                # the packaged solver
    python scripts/any_object_table.py --out runs/other --solver runs/any-object/any-object.pt

Images are rendered. *one-angular-size*: 128 x 128 pixels, 0.1 to 3 memory-effect ranges behind slabs of drawn material,
with and without 10 photons a pixel; *unknown-slab*: half a range. C_I is known. Scores are against the sharp object,
moved onto it. Beside the solver stands the most probable of phase retrieval's answers, which it begins with. What has
been scored is kept in ``images.csv``, and a run that was stopped goes on.
"""

import argparse
import csv
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import torch
from PIL import Image, ImageDraw

from specklegen.core.errors import reject
from specklegen.datasets import load_recipe
from specklegen.datasets.loading.stream import tensors
from specklegen.datasets.objects import Glyphs
from specklegen.datasets.recipes.hidden_object import HiddenObject
from specklegen.models import load_solver
from specklegen.models.judging.evaluation import aligned_to
from specklegen.models.learning.measurement import measured, memory_effect_of
from specklegen.models.learning.networks.unrolled import ranked
from specklegen.models.learning.range_fit import fit_range
from specklegen.models.learning.solver import EXTENT, LAGS, MemoryEffect, Solver, first_look
from specklegen.models.likelihood.likelihood import Optics, SpeckleLikelihood
from specklegen.models.likelihood.periodogram import Periodogram
from specklegen.models.metrics import bootstrap, pearson
from specklegen.models.retrieval.autocorrelation import distances

HELD_OUT = {"disjoint": "character", "test": "569BFMTVWt", "validation": "2KPbq"}
FAMILIES: dict[str, dict[str, Any]] = {
    "known characters": {"type": "Glyphs", **HELD_OUT},
    "held-out characters": {"type": "Glyphs", **HELD_OUT},
    "5 points": {"type": "Points"},
    "own shapes": {"type": "Folder"},
    "bars": {"type": "Bars"},
    "handwritten digits": {"type": "Digits"},
    "silhouettes": {"type": "Silhouettes"},
    "photographs": {"type": "Photographs"},
}
UNSEEN = ("own shapes", "bars", "handwritten digits", "silhouettes", "photographs")
SCENES: dict[str, tuple[str, dict[str, Any]]] = {
    "one-angular-size": ("one-angular-size", {}),
    "10 photons a pixel": ("one-angular-size", {"exposure": {"photons": 10.0, "bit_depth": None}}),
    "unknown-slab": ("unknown-slab", {"mode_tolerance": 0.001}),
}
HEAD = ("scene", "family", "image", "extent", "katz", "solver", "deviance", "probability")
EXTENTS = (0.0, 0.5, 1.0, 2.0, 3.01)
SAID = (0.0, 0.1, 0.3, 0.5, 0.7, 0.9, 1.0)
GOOD = 0.8
SEED, BATCH, POSES, FINE = 11, 13, 8, 8
RANGES, LOOKS, RANGE_IMAGES = (1.0, 2.0, 3.0), (1.0, 9.0), 16


def shapes() -> dict[str, list[np.ndarray]]:
    """Loops of the own shapes, float[n, 2] each, within -1 to 1; of several the later ones are holes."""
    turn = np.linspace(0, 2 * np.pi, 49)[:-1]
    circle = np.stack([np.cos(turn), np.sin(turn)], axis=1)
    square = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
    spikes = np.linspace(0, 2 * np.pi, 11)[:-1]
    star = np.stack([np.cos(spikes), np.sin(spikes)], axis=1) * np.where(np.arange(10) % 2, 0.4, 1.0)[:, None]
    lobes = 13 * np.cos(turn) - 5 * np.cos(2 * turn) - 2 * np.cos(3 * turn)
    heart = np.stack([np.sin(turn) ** 3, -lobes / 16], axis=1)
    return {
        "star": [star],
        "ring": [circle, 0.6 * circle],
        "arrow": [np.array([[-1, -0.25], [0.1, -0.25], [0.1, -0.7], [1, 0], [0.1, 0.7], [0.1, 0.25], [-1, 0.25]])],
        "cross": [np.array([[-0.3, -1], [0.3, -1], [0.3, -0.3], [1, -0.3], [1, 0.3], [0.3, 0.3], [0.3, 1], [-0.3, 1],
                            [-0.3, 0.3], [-1, 0.3], [-1, -0.3], [-0.3, -0.3]])],
        "heart": [heart],
        "crescent": [circle, 0.75 * circle + [0.45, 0]],
        "frame": [square, 0.65 * square],
        "house": [np.array([[-0.8, 1], [-0.8, -0.1], [0, -1], [0.8, -0.1], [0.8, 1], [0.3, 1], [0.3, 0.3], [-0.2, 0.3],
                            [-0.2, 1]])],
        "lightning": [np.array([[0.2, -1], [-0.6, 0.1], [0, 0.1], [-0.3, 1], [0.6, -0.2], [0.05, -0.2], [0.5, -1]])],
        "hourglass": [np.array([[-0.8, -1], [0.8, -1], [-0.8, 1], [0.8, 1]])],
    }  # fmt: skip


def draw_shapes(folder: Path, side: int = EXTENT) -> None:
    """Write pictures of the own shapes, each in several poses."""
    folder.mkdir(parents=True, exist_ok=True)
    rng = np.random.default_rng(SEED)
    for name, loops in shapes().items():
        for pose in range(POSES):
            angle, size = rng.uniform(0, 2 * np.pi), rng.uniform(0.3, 0.45) * side * FINE
            turn = size * np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
            picture = Image.new("L", (side * FINE, side * FINE))
            for n, loop in enumerate(loops):
                points = [(float(x), float(y)) for x, y in loop @ turn.T + side * FINE / 2]
                ImageDraw.Draw(picture).polygon(points, fill=0 if n else 255)
            picture.reduce(FINE).save(folder / f"{name}-{pose}.png")


def recipe_of(scene: str, family: str, folder: Path) -> HiddenObject:
    """Recipe of a cell."""
    name, changes = SCENES[scene]
    own = {"path": str(folder)} if family == "own shapes" else {}
    found = load_recipe(name, {**changes, "objects": {"shape": [EXTENT, EXTENT], **FAMILIES[family], **own}})
    if not isinstance(found, HiddenObject):
        reject("recipe_of scene", "one with hidden objects", scene)
    return found


def scored(solver: Solver, recipe: HiddenObject, family: str, images: int) -> list[dict[str, float]]:
    """Scores of the images of a cell."""
    split = "test" if family == "held-out characters" else "train"
    rows = []
    for first in range(0, images, BATCH):
        batch = recipe.batch(SEED, split, range(first, min(first + BATCH, images)))
        seen, optics, memory = measured(batch, recipe)
        found = solver.solve(seen, optics, memory, seed=SEED)
        objects = tensors(batch)["object"].float()
        scores = [pearson(aligned_to(made, framed, objects.shape[-2:]), objects)
                  for framed in [torch.nn.functional.pad(objects, (0, LAGS - EXTENT, 0, LAGS - EXTENT))]
                  for made in (first_answer(solver, seen, optics, memory), found.image)]  # fmt: skip
        extents = batch["parameters"]["extent_over_range"]
        columns = zip(extents, *scores, found.deviance, found.probability, strict=True)
        rows += [dict(zip(HEAD[2:], (first + n, *map(float, each)), strict=True)) for n, each in enumerate(columns)]
    return rows


def first_answer(solver: Solver, seen: Periodogram, optics: Optics, memory: list[MemoryEffect]) -> torch.Tensor:
    """Most probable of phase retrieval's answers, float[B, n, n]."""
    n = solver.network.frame
    likelihood = SpeckleLikelihood(seen, (n, n), optics)
    steps = np.arange(1 - n, n)
    between, lags = (
        torch.from_numpy(np.stack([np.asarray(c(d), np.float32) for c in memory]))
        for d in (np.hypot(steps[:, None], steps), distances(LAGS))
    )
    answers = first_look(likelihood, lags, n, SEED).answers
    return ranked(answers, lambda objects: likelihood(objects, between[:, None]))[0][:, 0]


class Table(NamedTuple):
    """Columns of images.csv."""

    scene: np.ndarray
    family: np.ndarray
    image: np.ndarray
    extent: np.ndarray
    katz: np.ndarray
    solver: np.ndarray
    deviance: np.ndarray
    probability: np.ndarray

    def part(self, chosen: np.ndarray) -> "Table":
        """Some of the images."""
        return Table(*(column[chosen] for column in self))

    def mean(self, name: str) -> str:
        """Mean of a column with its 95 % interval; every image has a medium of its own."""
        return "{:.3f} [{:.3f}, {:.3f}]".format(*bootstrap(getattr(self, name), np.arange(len(self.image))))


def read(path: Path) -> Table:
    """Read what has been scored."""
    with path.open() as file:
        rows = list(csv.DictReader(file))
    columns = [np.array([row[name] for row in rows]) for name in HEAD]
    return Table(*columns[:2], *(column.astype(float) for column in columns[2:]))


def area(probability: np.ndarray, good: np.ndarray) -> float:
    """Area under the receiver's curve: how often a good image is rated above one that is not."""
    above, below = probability[good], probability[~good]
    return float((np.sign(above[:, None] - below).mean() + 1) / 2) if len(above) and len(below) else float("nan")


def area_between(table: Table) -> str:
    """AUC with its 95 % interval by resampling images."""
    rng = np.random.default_rng(0)
    drawn = [rng.integers(len(table.image), size=len(table.image)) for _ in range(1000)]
    values = [area(table.probability[each], good(table)[each]) for each in drawn]
    low, high = np.nanquantile(values, [0.025, 0.975])
    return f"{area(table.probability, good(table)):.3f} [{low:.3f}, {high:.3f}]"


def row(*cells: object) -> str:
    """Line of a Markdown table."""
    return "| " + " | ".join(map(str, cells)) + " |"


def report(table: Table) -> str:
    """All tables as Markdown."""
    every, known = np.isfinite(table.probability), ~np.isin(table.family, UNSEEN)  # where the certificate is silent
    lines = [row("scene", "family", "images", "Wiener-Katz", "solver", "above 0.8"), "|---" * 6 + "|"]
    for scene in SCENES:
        for family in [*FAMILIES, "mean"]:
            part = table.part((table.scene == scene) & ((table.family == family) | (family == "mean")))
            lines += [row(scene, family, *means(part), f"{good(part).mean():.2f}")] if len(part.image) > 1 else []
    lines += ["", row("extent, ranges", "family", "images", "Wiener-Katz", "solver"), "|---" * 5 + "|"]
    for low, high in zip(EXTENTS[:-1], EXTENTS[1:], strict=True):
        inside = (table.scene != "unknown-slab") & (table.extent >= low) & (table.extent < high)
        for family in ("held-out characters", "5 points", "all"):
            part = table.part(inside & ((table.family == family) | (family == "all")))
            lines += [row(f"{low:g} to {min(high, 3):g}", family, *means(part))] if len(part.image) > 1 else []
    parts = {"all": every, "families of training": known, "families never seen": ~known}
    lines += ["", f"certificate silent: {1 - every.mean():.3f}"]
    lines += [f"AUC, {name}: {area_between(table.part(which & every))}" for name, which in parts.items()]
    lines += ["", row("said", "images", "mean said", "above 0.8"), "|---" * 4 + "|"]
    for low, high in zip(SAID[:-1], SAID[1:], strict=True):
        part = table.part((table.probability >= low) & (table.probability <= high))
        told = f"{part.probability.mean():.2f}", f"{good(part).mean():.2f}"
        lines += [row(f"{low:g} to {high:g}", len(part.image), *told)] if len(part.image) else []
    return "\n".join(lines)


def good(table: Table) -> np.ndarray:
    """Images that the solver has reconstructed, bool[n]."""
    return table.solver > GOOD


def means(table: Table) -> tuple[object, ...]:
    """How many images, and the means of both methods."""
    return len(table.image), table.mean("katz"), table.mean("solver")


def ranges(solver: Solver, sets: int) -> str:
    """Ranges fitted to sets of 16 images of held-out characters, drawn from the law; logarithms.

    Each set is behind a slab of its own, one of `unknown-slab` that no network was trained on.
    """
    head = "extent, ranges", "looks", "sets", "bias", "spread", "root mean square", "within 10 %", "interval holds"
    lines = [row(*head), "|---" * len(head) + "|"]
    recipe = load_recipe("unknown-slab")
    for looks in LOOKS:
        for extent in RANGES:
            fits = []
            for n in range(sets):
                known = recipe.material_of(0, "test", n)
                c_i = memory_effect_of(known.correlation, 1.0, extent * known.half_range / (2 * np.pi) / EXTENT)
                seen, optics = drawn_from_law(c_i, 100 + n, looks)
                fits.append(fit_range(solver, seen, optics, [c_i] * RANGE_IMAGES))
            error = np.log([fit.factor for fit in fits])
            held = sum(fit.low < 1 < fit.high for fit in fits)
            told = [f"{x:.2f}" for x in (error.mean(), error.std(), np.sqrt(np.square(error).mean()))]
            lines.append(row(f"{extent:g}", f"{looks:g}", sets, *told, int((np.abs(error) < 0.1).sum()), held))
    return "\n".join(lines)


def drawn_from_law(
    c_i: MemoryEffect, seed: int, looks: float = 1.0, camera: int = 128, step: float = 1.5
) -> tuple[Periodogram, Optics]:
    """Periodograms of held-out characters behind one slab, S(f) times a gamma variable."""
    glyphs = Glyphs.model_validate({**HELD_OUT, "shape": [EXTENT, EXTENT]})
    objects = torch.from_numpy(np.stack([glyphs.image(seed, "test", n) for n in range(RANGE_IMAGES)]))
    power = torch.ones(RANGE_IMAGES, camera, camera // 2 + 1)
    seen, optics = Periodogram(power, torch.zeros(RANGE_IMAGES), looks, (camera, camera)), Optics(step, 3.0)
    likelihood = SpeckleLikelihood(seen, (EXTENT, EXTENT), optics)
    steps = np.arange(1 - EXTENT, EXTENT)
    spectrum = likelihood.object_spectrum(objects, torch.from_numpy(c_i(np.hypot(steps[:, None], steps))))
    noise = np.random.default_rng(seed).standard_gamma(looks, spectrum.shape, dtype=np.float32) / np.float32(looks)
    reach = spectrum.shape[1] // 2
    power[:, np.arange(-reach, reach + 1) % camera, : spectrum.shape[2]] = spectrum * torch.from_numpy(noise)
    return seen, optics


def main() -> None:
    """Command line."""
    options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    options.add_argument("--out", type=Path, default=Path("runs/any-object-table"))
    options.add_argument("--solver", type=Path, help="By default the packaged one.")
    options.add_argument("--images", type=int, default=26, help="Images of a cell.")
    options.add_argument("--sets", type=int, default=32, help="Sets of images for each range; 0 for none.")
    given = options.parse_args()
    torch.set_num_threads(1)
    solver = load_solver() if given.solver is None else Solver.load(given.solver)
    folder, path = given.out / "shapes", given.out / "images.csv"
    draw_shapes(folder)
    begun = path.exists()
    done = set(zip(*read(path)[:2], strict=True)) if begun else set()
    with path.open("a", newline="") as file:
        writer: csv.DictWriter[str] = csv.DictWriter(file, HEAD, lineterminator="\n")
        if not begun:
            writer.writeheader()
        for scene in SCENES:
            for family in FAMILIES:
                if (scene, family) not in done:
                    rows = scored(solver, recipe_of(scene, family, folder), family, given.images)
                    writer.writerows({"scene": scene, "family": family, **row} for row in rows)
                    file.flush()
                    print(scene, family, f"{np.mean([row['solver'] for row in rows]):.3f}", flush=True)
    tables = report(read(path)) + ("\n\n" + ranges(solver, given.sets) if given.sets else "")
    (given.out / "tables.md").write_text(tables + "\n")
    print(tables)


if __name__ == "__main__":
    main()
