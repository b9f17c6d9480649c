"""When phase retrieval works: simulate a table of cells, fit the verdict on half of them, judge it on the other half.

    python scripts/build/fit_recoverability.py simulate --out tests/data/recoverability.csv [--cells 200] [--media 6]
    python scripts/build/fit_recoverability.py simulate --grid large --media 4 --out tests/data/recoverability_large.csv
    python scripts/build/fit_recoverability.py predict tests/data/recoverability.csv   (predicted columns anew; --grid)
    python scripts/build/fit_recoverability.py fit tests/data/recoverability.csv tests/data/recoverability_large.csv
    python scripts/build/fit_recoverability.py simulate --grid fresh --cells 220 --out tests/data/recoverability_fresh.csv
    python scripts/build/fit_recoverability.py judge tests/data/recoverability_fresh.csv      (the packaged verdict)
    python scripts/build/fit_recoverability.py recipes --out tests/data/recoverability_recipes.csv    (packaged recipes)

A cell is a scene drawn at random (objects and their size, camera, extent over the memory-effect range, photons,
saturation, envelope, polarisation, division by C_I or not); its success rate is the share of media behind which an
object of the test split comes back with a Pearson correlation above 0.8 to the diffraction-limited object. Predictions
see objects of the train split only. Even cells are fitted, odd cells judge: which is which was set before any was run.
The large grid has objects of 12 to 20 grains, like those of most packaged recipes. The fresh grids came when a verdict
was finished: other seeds, sizes and numbers of points; nothing is fitted to them.
"""  # noqa: E501

import argparse
import csv
import sys
import time
from pathlib import Path
from typing import Any, NamedTuple, cast

import numpy as np
import torch
from scipy.optimize import minimize
from scipy.special import logsumexp
from scipy.stats import binomtest
from torch import Tensor

from specklegen.core.errors import RuleError, reject
from specklegen.core.parallel import one_torch_thread
from specklegen.datasets import load_recipe, recipe_names
from specklegen.datasets.loading.stream import tensors
from specklegen.datasets.recipes.hidden_object import HiddenObject
from specklegen.instrument.camera import Camera, NoiseStreams, expose
from specklegen.models.judging.baselines import katz
from specklegen.models.judging.evaluation import evaluate
from specklegen.models.metrics import align, pearson
from specklegen.models.recoverability.autocorrelation_error import (
    GRID,
    REACH,
    Conditions,
    Residual,
    lag_size,
    residual,
)
from specklegen.models.recoverability.verdict import COEFFICIENTS, chances, conditions_of, logit, odds, share, total
from specklegen.models.retrieval.apodisation import diffraction_limited, transfer_function
from specklegen.models.retrieval.autocorrelation import autocorrelation, memory_effect_at_lags
from specklegen.models.retrieval.phase_retrieval import Retrieval, retrieve

SUCCESS = 0.8
RESTARTS = 4
SEED = 0
"""Of the images of packaged recipes."""
SCENE = ("objects", "side", "camera", "extent", "polarised", "compensation", "photons", "saturation", "beam", "removal")
FOUND = Residual._fields
HEAD = ("cell", *SCENE, *FOUND, "media", "successes", "mean_pearson")
FAMILIES: dict[str, dict[str, Any]] = {
    **{f"{count} points": {"type": "Points", "count": count} for count in (3, 4, 6, 8, 12, 16, 24)},
    "glyphs": {"type": "Glyphs"},
    "bars": {"type": "Bars"},
}


class Grid(NamedTuple):
    """What cells are drawn from: seed, families of objects, their sides and the camera's in pixels.

    ``apart``: every cell has media and objects of its own; else cells share them, medium by medium.
    """

    seed: int
    families: tuple[str, ...]
    sides: tuple[int, ...]
    cameras: tuple[float, float]
    apart: bool = True

    def media_seed(self, number: int) -> int:
        """Seed of the media, objects and photons of a cell."""
        return 1000 * self.seed + number if self.apart else 0


GRIDS = {
    "fitted": Grid(
        6, ("3 points", "6 points", "12 points", "24 points", "glyphs", "bars"), (12, 18, 28), (96, 480), False
    ),
    "large": Grid(31, ("6 points", "12 points", "glyphs", "bars"), (36, 48, 60), (120, 320)),
    "fresh": Grid(19, ("4 points", "8 points", "16 points", "24 points", "glyphs", "bars"), (14, 21, 26), (104, 460)),
    "fresh-large": Grid(37, ("4 points", "8 points", "glyphs", "bars"), (34, 42, 56), (120, 320)),
}


class CellScene(NamedTuple):
    """One line of the table: side and camera in pixels (3 a grain), the rest as in :class:`Conditions`.

    ``photons`` and ``saturation`` are a pixel's, in electrons and over the mean.
    """

    objects: str
    side: int
    camera: int
    extent: float
    polarised: bool
    compensation: bool
    photons: float = float("inf")
    saturation: float = float("inf")
    beam: float = float("inf")
    removal: float = 0.0

    def words(self) -> list[str]:
        """As the table has it."""
        return [value if isinstance(value, str) else f"{float(value):g}" for value in self]

    def recipe(self) -> HiddenObject:
        """Scene with object and camera of one pitch."""
        base = load_recipe("through-slab")
        slab = base.material.extremes()[0]
        pitch = self.extent * base.material.known(slab).range_sine(0.5) / self.side
        changes = {
            "media": 10_000,
            "window": {"width": 0.5 / (GRID * pitch)},
            "camera": {"shape": [self.camera, self.camera], "pixels_per_grain": float(GRID)},
            "field": {"extent_over_range": self.extent},
            "light": {"polarised": self.polarised},
            "objects": {**FAMILIES[self.objects], "shape": [self.side, self.side]},
        }
        return cast(HiddenObject, load_recipe("through-slab", changes))

    def conditions(self) -> Conditions:
        """What the prediction knows of it."""
        found = conditions_of(self.recipe(), compensation=self.compensation, beam=self.beam, removal=self.removal)
        return found.replace(electrons=self.photons * GRID**2, saturation=self.saturation)


def drawn(number: int, grid: Grid = GRIDS["fitted"]) -> CellScene:
    """Scene of a cell, a pure function of its number and the grid."""
    rng = np.random.default_rng(np.random.SeedSequence([grid.seed, number]))

    def hazard(share: float, low: float, high: float, none: float = float("inf")) -> float:
        value = float(np.exp(rng.uniform(np.log(low), np.log(high))))
        return value if rng.random() < share else none

    side = int(rng.choice(grid.sides))
    beam = hazard(0.25, 0.15, 0.6)
    kept = rng.random() < 0.5
    return CellScene(
        objects=str(rng.choice(grid.families)),
        side=side,
        camera=2 * round(hazard(1, *grid.cameras) / 2),
        extent=round(hazard(0.6, 0.3, 3.0, 0.1), 3),
        polarised=bool(rng.random() < 0.7),
        compensation=bool(rng.random() < 0.6),
        photons=round(hazard(0.2, 0.02, 3.0), 4),
        saturation=round(hazard(0.2, 0.1, 1.5), 3),
        beam=round(beam, 3),
        removal=0.0 if np.isinf(beam) or kept else 0.125,
    )


def exposed(image: np.ndarray, scene: CellScene, medium: int, seed: int) -> np.ndarray:
    """What the camera makes of an expected intensity of mean 1: the beam, the photons, the full well."""
    x = (np.arange(scene.camera) - (scene.camera - 1) / 2) / (scene.beam * scene.camera)
    image = np.clip(image, 0, None) * np.exp(-0.5 * (x[:, None] ** 2 + x**2))
    if np.isinf(scene.photons):
        return np.minimum(image, scene.saturation)
    well = None if np.isinf(scene.saturation) else scene.saturation * scene.photons
    camera = Camera(photons=scene.photons, full_well=well, bit_depth=None)
    return expose(camera, image, NoiseStreams.of([6 + seed, medium])) / scene.photons


def observed(scene: CellScene, media: int, seed: int = 0) -> tuple[Tensor, Tensor, np.ndarray]:
    """Autocorrelations [B, n, n], objects [B, h, w] and the first camera image."""
    recipe, found, objects, first = scene.recipe(), [], [], None
    window = lag_size(scene.side)
    for medium in range(media):
        brightness = recipe.objects.image(seed, "test", medium)
        image = exposed(recipe.prepare(seed, "test", medium).images(brightness)[0], scene, medium, seed)
        first = image if first is None else first
        sigma = scene.removal * scene.camera or None
        with one_torch_thread():
            lags = autocorrelation(torch.from_numpy(image)[None], window, sigma=sigma, electrons=scene.photons)
        found.append(lags)
        objects.append(torch.from_numpy(brightness))
    assert first is not None
    return torch.stack(found), torch.stack(objects), first


def retrieved(scene: CellScene, lags: Tensor, objects: Tensor, restarts: int = RESTARTS) -> tuple[Tensor, Tensor]:
    """Images aligned with their targets, and the targets, float[B, n, n]."""
    recipe, window = scene.recipe(), lags.shape[-1]
    transfer = transfer_function(window, GRID)
    c_i = None
    if scene.compensation:
        correlation = recipe.material.known(recipe.material.extremes()[0]).correlation
        c_i = memory_effect_at_lags(correlation, 0.5, recipe.geometry.grid.pitch, window)
    options = Retrieval(restarts=restarts, extent=REACH * scene.side)
    found = retrieve(lags, options, memory_effect=c_i, transfer=transfer, threads=1)
    with one_torch_thread():
        target = diffraction_limited(objects, transfer).to(found.image)
        return align(found.image, target), target


def scores(scene: CellScene, media: int, seed: int) -> Tensor:
    """Pearson correlations of a cell's media; 0 where noise leaves nothing to retrieve from."""
    lags, objects, _ = observed(scene, media, seed)
    result = torch.zeros(media)
    for n in range(media):
        try:
            result[n] = pearson(*retrieved(scene, lags[n : n + 1], objects[n : n + 1]))[0]
        except RuleError:  # no frequency has power above the noise
            continue
    return result


def simulate(out: Path, cells: int, media: int, grid: Grid) -> None:
    """Write the table, a line as soon as it is there; a table that was begun is gone on with."""
    out.parent.mkdir(parents=True, exist_ok=True)
    done = len(out.read_text().splitlines()) - 1 if out.exists() else -1
    begin = time.process_time()
    with out.open("a", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        if done < 0:
            writer.writerow(HEAD)
        for number in range(max(done, 0), cells):
            scene = drawn(number, grid)
            predicted, found = residual(scene.conditions()), scores(scene, media, grid.media_seed(number))
            good = int((found > SUCCESS).sum())
            features = [f"{value:.6g}" for value in predicted]
            writer.writerow([number, *scene.words(), *features, media, good, f"{found.mean():.4f}"])
            file.flush()
            print(f"{number}: {scene} {good}/{media}, {time.process_time() - begin:.0f} CPU s", file=sys.stderr)


def predict_again(path: Path, grid: Grid) -> None:
    """Replace the predicted columns of a table: they follow from the scenes, which are drawn by number.

    Raises
    ------
    RuleError
        If the table's scenes are not the grid's; the table is left as it is.
    """
    with path.open() as file:
        rows = list(csv.DictReader(file))
    for row in rows:
        scene = drawn(int(row["cell"]), grid)
        if scene.words() != [row[name] for name in SCENE]:
            reject("predict --grid", "that of the table", f"another one (cell {row['cell']})")
        row |= {name: f"{value:.6g}" for name, value in residual(scene.conditions())._asdict().items()}
    with path.open("w", newline="") as file:
        writer = csv.DictWriter(file, HEAD, lineterminator="\n", extrasaction="ignore")
        writer.writeheader()
        writer.writerows(rows)


class Table(NamedTuple):
    """Columns of the CSV that the fit uses, float64[cells] each."""

    cell: np.ndarray
    noise: np.ndarray
    distortion: np.ndarray
    complexity: np.ndarray
    bright_area: np.ndarray
    media: np.ndarray
    successes: np.ndarray

    def chosen(self, which: np.ndarray) -> "Table":
        """Some of the cells."""
        return Table(*(column[which] for column in self))

    def half(self, odd: bool) -> "Table":
        """Cells of odd numbers, or of even ones."""
        return self.chosen(self.cell % 2 == odd)


def measured(name: str, images: int) -> dict[bool, int]:
    """Images of a packaged recipe retrieved above the threshold of so many, divided by C_I or not."""
    recipe = cast(HiddenObject, load_recipe(name))
    methods = {
        str(divided): katz(
            Retrieval(restarts=RESTARTS), recipe, division="floor" if divided else "none", apodise=True
        ) for divided in (True, False)
    }  # fmt: skip
    found, _ = evaluate(methods, [tensors(recipe.batch(SEED, "test", range(images)))], recipe.profile)
    scores = {divided: found.values[str(divided)]["diffraction-limited"]["pearson"] for divided in (True, False)}
    return {divided: int((values > SUCCESS).sum()) for divided, values in scores.items()}


def measure_recipes(out: Path, images: int) -> None:
    """Write how often the objects of every packaged recipe come back; a table that was begun is gone on with."""
    done = {row["recipe"] for row in csv.DictReader(out.open())} if out.exists() else set()
    with out.open("a", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        if not done:
            writer.writerow(("recipe", "compensation", "images", "successes"))
        for name in recipe_names():
            if name in done or not isinstance(load_recipe(name), HiddenObject):
                continue
            try:
                found = measured(name, images)
            except RuleError as refused:  # no single image, or grains too small to read the camera's noise off it
                print(name, refused, file=sys.stderr)
                continue
            for divided, good in found.items():
                writer.writerow((name, int(divided), images, good))
            file.flush()
            print(name, file=sys.stderr)


def compared(path: Path, media: int = 12) -> str:
    """What is said of packaged recipes, the mean of so many media, beside what was measured; Markdown."""
    lines = ["| recipe | divided by C_I | said | measured | |", "|---|---|---|---|---|"]
    with path.open() as file:
        rows = list(csv.DictReader(file))
    for name in dict.fromkeys(row["recipe"] for row in rows):
        recipe = cast(HiddenObject, load_recipe(name))
        count = 1 if recipe.media_alike else media
        each = [conditions_of(recipe, medium=n) for n in range(count)]
        for row in (row for row in rows if row["recipe"] == name):
            divided, images, good = bool(int(row["compensation"])), int(row["images"]), int(row["successes"])
            told = [chances(logit(residual(c.replace(compensation=divided)))) for c in each]
            said, low, high = np.mean(told, axis=0)
            rate, ends = good / images, binomtest(good, images).proportion_ci(method="wilson")
            apart = "overlaps" if ends[0] <= high and low <= ends[1] else "outside"
            inside = "inside" if low <= rate <= high else apart
            lines.append(
                f"| {name} | {'yes' if divided else 'no'} | {said:.2f} ({low:.2f}-{high:.2f}) | "
                f"{rate:.2f} ({ends[0]:.2f}-{ends[1]:.2f}) | {inside} |"
            )
    return "\n".join(lines)


def read(*paths: Path) -> Table:
    """Read the CSVs, one below the other."""
    rows: list[dict[str, str]] = []
    for path in paths:
        with path.open() as file:
            rows += csv.DictReader(file)
    return Table(*(np.array([float(row[name]) for row in rows]) for name in Table._fields))


def fitted(table: Table) -> np.ndarray:
    """Coefficients of the greatest likelihood of the successes, float64[6]; a weak prior keeps them finite.

    Success rates of scenes of the same numbers differ: their logits scatter as a Gaussian number does, which is
    integrated out.
    """
    nodes, weights = np.polynomial.hermite_e.hermegauss(31)
    weights = np.log(weights / weights.sum())
    failures = table.media - table.successes

    def loss(c: np.ndarray) -> float:
        z = odds(table, c)[:, None] + c[-1] * nodes
        each = -table.successes[:, None] * np.logaddexp(0, -z) - failures[:, None] * np.logaddexp(0, z)
        return float(-logsumexp(each + weights, axis=1).sum() + 1e-3 * np.square(c).sum())

    found = minimize(loss, [0.0, -1.0, -1.0, 0.0, 1.0, 1.0], method="BFGS", options={"gtol": 1e-4}).x
    found[-1] = abs(found[-1])
    return found


class Confusion(NamedTuple):
    """Verdicts on cells whose measured rate lies outside 0.3 to 0.7."""

    works_right: int
    works_wrong: int
    fails_right: int
    fails_wrong: int

    @property
    def right(self) -> int:
        """Verdicts that were right."""
        return self.works_right + self.fails_right

    @property
    def n(self) -> int:
        """Verdicts."""
        return sum(self)


def confusion(table: Table, coefficients: np.ndarray) -> Confusion:
    """Count verdicts: works where the predicted probability is at least a half."""
    rate = table.successes / table.media
    clear = (rate < 0.3) | (rate > 0.7)
    works, worked = (odds(table, coefficients) >= 0)[clear], (rate > 0.5)[clear]
    pairs = ((works & worked), (works & ~worked), (~works & ~worked), (~works & worked))
    return Confusion(*(int(x.sum()) for x in pairs))


def spans(table: Table, coefficients: np.ndarray) -> dict[str, tuple[float, float]]:
    """Smallest and largest residual, complexity and bright area."""
    residuals = total(table.noise, table.distortion, coefficients[4])
    columns = {"residual": residuals, "complexity": table.complexity, "bright_area": table.bright_area}
    return {name: (float(x.min()), float(x.max())) for name, x in columns.items()}


def judged(name: str, table: Table, coefficients: np.ndarray) -> str:
    """How the verdicts on a table came out."""
    found = confusion(table, coefficients)
    low, high = binomtest(found.right, found.n).proportion_ci(method="wilson")
    rate, said = table.successes / table.media, share(odds(table, coefficients), coefficients[-1])
    spread = np.sqrt(np.mean(np.square(rate - said)))
    return (
        f"{name}: {len(table.cell)} cells, {found.n} outside 0.3 to 0.7; right {found.right} of {found.n}, "
        f"{100 * found.right / found.n:.0f} % ({100 * low:.0f}-{100 * high:.0f}); "
        f"rms error of the probability {spread:.3f}\n"
        f"  says works: {found.works_right} worked, {found.works_wrong} failed; "
        f"says fails: {found.fails_right} failed, {found.fails_wrong} worked"
    )


def report(table: Table) -> str:
    """Coefficients from the even cells, and the confusion tables."""
    even = table.half(odd=False)
    coefficients = fitted(even)
    named = {name: round(float(c), 4) for name, c in zip(COEFFICIENTS, coefficients, strict=True)}
    ranges = {name: tuple(round(x, 4) for x in ends) for name, ends in spans(even, coefficients).items()}
    lines = [f"COEFFICIENTS = {named}", f"FITTED = {ranges}"]
    halves = {
        name: judged(name, table.half(odd), coefficients) for name, odd in (("fitted", False), ("held out", True))
    }
    return "\n".join([*lines, *halves.values()])


def main(arguments: list[str] | None = None) -> None:
    """Read the command line."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    commands = parser.add_subparsers(required=True, dest="command")
    simulating = commands.add_parser("simulate")
    simulating.add_argument("--out", type=Path, required=True)
    simulating.add_argument("--cells", type=int, default=200)
    simulating.add_argument("--media", type=int, default=6)
    reading = {name: commands.add_parser(name) for name in ("predict", "fit", "judge")}
    for command in reading.values():
        command.add_argument("tables", type=Path, nargs="+")
    measuring = commands.add_parser("recipes")
    measuring.add_argument("--out", type=Path, required=True)
    measuring.add_argument("--images", type=int, default=24)
    for command in (simulating, reading["predict"]):
        command.add_argument("--grid", choices=GRIDS, default="fitted", help="what the cells are drawn from")
    chosen = parser.parse_args(arguments)
    if chosen.command == "simulate":
        simulate(chosen.out, chosen.cells, chosen.media, GRIDS[chosen.grid])
    elif chosen.command == "recipes":
        measure_recipes(chosen.out, chosen.images)
        print(compared(chosen.out))
    elif chosen.command == "predict":
        for table in chosen.tables:
            predict_again(table, GRIDS[chosen.grid])
    elif chosen.command == "judge":
        print(judged("all", read(*chosen.tables), np.array(list(COEFFICIENTS.values()))))
    else:
        print(report(read(*chosen.tables)))


if __name__ == "__main__":
    main()
