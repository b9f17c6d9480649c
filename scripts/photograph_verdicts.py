"""Verdicts on photographs of unknown benches, and what became of their objects: drawn, retrieved, judged.

    python scripts/photograph_verdicts.py truth --out photographs.csv [--first 0] [--count 330] [--workers 16] [--seconds 140]
    python scripts/photograph_verdicts.py judge photographs.csv [--pictures 20] [--seed 12]

A photograph is a clean bench or one of ten perturbed ones (``perturbed_benches.py``), its camera of 96 to 288 pixels and
2.2 to 6 a grain, its objects characters, bars, points, polygons or blobs of 6 to 24 grains, with 2 to 3000 electrons a
pixel, 8 to 16 bits and now and then pixels that saturate: a pure function of its number. What became of it: the Pearson correlation of
phase retrieval of four restarts, over the fitted envelope, which is told the grain, the object's side and pitch, with the diffraction-limited object.
``judge`` draws the photographs of a table again, and says how often their verdicts were right; with ``--pictures`` also
how well as many blank walls, frames of noise and pictures of each kind of ``speckle_test_table.py`` are told from them.
"""  # noqa: E501

import argparse
import csv
import multiprocessing
import time
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import torch
from _rows import write_rows
from perturbed_benches import BENCHES, bench
from scipy.stats import binomtest
from speckle_test_table import PICTURES, Shape, area

from specklegen.core.errors import RuleError
from specklegen.datasets.loading.stream import tensors
from specklegen.datasets.recipes.hidden_object import HiddenObject
from specklegen.measured import read_measurement
from specklegen.models import judge_photograph
from specklegen.models.judging.baselines import katz
from specklegen.models.judging.evaluation import aligned_to, targets_of
from specklegen.models.metrics import pearson
from specklegen.models.retrieval.phase_retrieval import Retrieval

SEED = 11
FAMILIES = (
    {"type": "Glyphs", "disjoint": "character", "test": "569BFMTVWt", "validation": "2KPbq"}, {"type": "Bars"},
    {"type": "Polygons"}, {"type": "Blobs"}, *({"type": "Points", "count": n} for n in (3, 4, 6, 9, 14)),
)  # fmt: skip
HEAD = ("number", "bench", "family", "camera", "pixels_per_grain", "photons", "saturated", "side", "r")
WORKED = 0.8
CLEAR = 0.9


class Scene(NamedTuple):
    """One photograph: its bench and what else was drawn."""

    name: str
    family: dict[str, Any]
    camera: int
    pixels_per_grain: float
    photons: float
    saturated: bool
    side: float

    def recipe(self, *, noise: bool = True) -> HiddenObject:
        """Recipe of the photograph; without noise, of its light alone."""
        limit = (1.2 if self.saturated else 20.0) * self.photons
        bits = 8 if limit < 2000 else 12 if limit < 20_000 else 16
        camera = {"photons": self.photons, "gain": limit / 2**bits, "read_noise": 2.0, "bit_depth": bits}
        more = {
            "objects": {**self.family, "shape": [28, 28]},
            "camera": {"shape": [self.camera, self.camera], "pixels_per_grain": self.pixels_per_grain},
            "field": {"pixels": self.side * self.pixels_per_grain},
            "exposure": camera if noise else {"photons": 1e6, "bit_depth": None},
        }
        return bench(self.name, more)


def drawn(number: int) -> Scene:
    """Scene of a photograph."""
    rng = np.random.default_rng([SEED, number])
    names = [*BENCHES]
    grain = float(np.exp(rng.uniform(np.log(2.2), np.log(6.0))))
    camera = 2 * int(rng.uniform(48, 144))
    side = min(float(np.exp(rng.uniform(np.log(6.0), np.log(24.0)))), 0.8 * camera / grain)
    return Scene(
        names[number % len(names)], FAMILIES[rng.integers(len(FAMILIES))], camera, round(grain, 3),
        float(np.exp(rng.uniform(np.log(2.0), np.log(3000.0)))), bool(rng.random() < 0.12), round(side, 2),
    )  # fmt: skip


def photograph(number: int, *, noise: bool = True) -> dict[str, Any]:
    """A sample: counts, object and parameters."""
    return drawn(number).recipe(noise=noise).batch(SEED, "test", [number])


def became(number: int) -> list[Any] | None:
    """A line of the table; None, and a word, where a part of the photograph is dark: it has no envelope to take off."""
    torch.set_num_threads(1)
    scene = drawn(number)
    batch = tensors(photograph(number))
    try:
        seen = read_measurement(batch["image"][0].numpy().astype(np.float64), envelope="fit", hot_pixels=False)
    except RuleError as error:
        if "envelope" not in str(error):
            raise
        print(f"photograph {number} ({scene.name}, {scene.photons:.3g} electrons) left out: {error}", flush=True)
        return None
    batch["image"] = torch.from_numpy(seen.images).float()
    target = targets_of(batch)["diffraction-limited"]
    try:
        made = katz(Retrieval(restarts=4), apodise=True)(batch)
        r = float(pearson(aligned_to(made, target, (28, 28)), target[..., :28, :28])[0])
    except ValueError:  # no frequency has power above the noise
        r = 0.0
    family = scene.family["type"] + (f" {scene.family['count']}" if "count" in scene.family else "")
    return [number, scene.name, family, scene.camera, scene.pixels_per_grain, f"{scene.photons:.4g}",
            int(scene.saturated), scene.side, f"{r:.4f}"]  # fmt: skip


def truth(out: Path, numbers: range, workers: int, seconds: float) -> None:
    """Write the table, a line as soon as it is there, until the time is over."""
    begun = time.time()
    torch.set_num_threads(1)
    for number in range(len(BENCHES)):  # compiled, and memory effects found, before there are several of us
        photograph(number)
    became(0)
    print(f"ready after {time.time() - begun:.0f} s", flush=True)
    write_rows(became, numbers, out, workers, seconds, HEAD)
    print(f"{sum(1 for _ in out.open()) - 1} photographs after {time.time() - begun:.0f} s", flush=True)


class Judged(NamedTuple):
    """An answer, the probability that is stated, what speaks against speckle, and the first reason."""

    answer: str
    probability: float
    score: float
    reason: str


def verdict(counts: np.ndarray) -> Judged:
    """Verdict on a photograph."""
    torch.set_num_threads(1)
    found = judge_photograph(counts)
    reason = found.reasons[0].name if found.reasons else ""
    return Judged(found.answer, found.probability, found.score, reason)


def judged(number: int) -> Judged:
    """Verdict on a photograph of a table."""
    return verdict(photograph(number)["image"][0])


def wall(rng: np.random.Generator, shape: Shape) -> np.ndarray:
    """A wall in light that falls off to one side, 20 to 2000 electrons."""
    y, x = np.mgrid[: shape[0], : shape[1]] / max(shape)
    a, b, c = rng.uniform(0, 0.5, 3)
    return rng.poisson(np.exp(rng.uniform(np.log(20), np.log(2000))) * (1 + a * x + b * y + c * x * (y - x)))


def noise(rng: np.random.Generator, shape: Shape) -> np.ndarray:
    """Of photons, or of electronics."""
    if rng.random() < 0.5:
        return rng.poisson(rng.uniform(5, 500), shape)
    return rng.normal(1000, rng.uniform(20, 200), shape)


OTHERS = {"noise": noise, "walls": wall, **PICTURES}


def refused(task: tuple[str, int, int]) -> Judged:
    """Verdict on a picture of a kind, number and seed that is no speckle, as large as photographs are."""
    kind, number, seed = task
    rng = np.random.default_rng([seed, number, list(OTHERS).index(kind)])
    side = 2 * int(rng.uniform(48, 144))
    return verdict(np.rint(np.clip(OTHERS[kind](rng, (side, side)), 0, None)))


def pictures(count: int, seed: int, workers: int, speckle: np.ndarray, lit: np.ndarray) -> list[str]:
    """How well pictures are told from speckle of scores float64[n], and from that with light enough, in Markdown."""
    tasks = [(kind, number, seed) for number in range(count) for kind in OTHERS]
    with multiprocessing.get_context("spawn").Pool(workers) as pool:
        every = pool.map(refused, tasks, chunksize=1)
    lines = ["", "| no speckle | pictures | refused | above .9 | AUC | with light enough |", "|---|" + 5 * "---|"]
    hard = [kind for kind in OTHERS if kind != "blurred noise"]
    for name, kinds in {kind: [kind] for kind in OTHERS} | {"all": [*OTHERS], "all but blurred noise": hard}.items():
        own = [each for task, each in zip(tasks, every, strict=True) if task[0] in kinds]
        told = sum(each.answer == "no speckle" for each in own)
        above = sum(each.probability > CLEAR for each in own)
        score = np.minimum([each.score for each in own], 1e300)
        areas = " | ".join(f"{area(score, np.minimum(each, 1e300)):.3f}" for each in (speckle, speckle[lit]))
        lines.append(f"| {name} | {len(own)} | {told} | {above} | {areas} |")
    return lines


def judge(file: Path, count: int, workers: int, others: int = 0, seed: int = 12) -> str:
    """How often verdicts on the first photographs of a table were right, in Markdown."""
    with file.open(newline="") as read:
        rows = [*csv.DictReader(read)][:count]
    worked = np.array([float(row["r"]) > WORKED for row in rows])
    with multiprocessing.get_context("spawn").Pool(workers) as pool:
        every = pool.map(judged, [int(row["number"]) for row in rows], chunksize=1)
    answers, stated, scores, reasons = zip(*every, strict=True)
    told, stated = np.array(answers), np.array(stated)
    parts = {name: told == name for name in dict.fromkeys(answers)}
    for name, part in (("above .9", stated > CLEAR), (".1 to .9", (stated >= 1 - CLEAR) & (stated <= CLEAR)),
                       ("below .1", stated < 1 - CLEAR)):  # fmt: skip
        parts[f"probability {name}"] = part & (told != "no speckle")
    lines = ["| verdict | photographs | phase retrieval above .8 | mean probability |", "|---|---|---|---|"]
    for name, part in parts.items():
        mean = f"{stated[part].mean():.2f}" if part.any() else ""
        lines.append(f"| {name} | {part.sum()} | {worked[part].sum()} | {mean} |")
    taken = told != "no speckle"
    clear = taken & ((stated > CLEAR) | (stated < 1 - CLEAR))
    right = int((worked == (stated > 0.5))[clear].sum())
    low, high = binomtest(right, int(clear.sum())).proportion_ci(method="wilson") if clear.any() else (0.0, 1.0)
    lines += ["", f"Clear cases right: {right} of {clear.sum()}, {low:.2f} to {high:.2f} (Wilson, 95 %). "
              f"Sum of squares of probability less outcome: {np.square(stated - worked)[taken].sum():.1f} "
              f"of {taken.sum()}."]  # fmt: skip
    for row, answer, reason, score in zip(rows, answers, reasons, scores, strict=True):
        if answer == "no speckle":
            lines.append(f"refused: {row['number']} ({row['bench']}, {row['family']}, {row['photons']} electrons, "
                         f"r {row['r']}): {reason}, {score:.3g}")  # fmt: skip
    if others:
        lines += pictures(others, seed, workers, np.array(scores), np.array(reasons) != "nothing but noise")
    return "\n".join(lines)


def main() -> None:
    """Read the command line."""
    asked = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    tasks = asked.add_subparsers(dest="task", required=True)
    making = tasks.add_parser("truth")
    making.add_argument("--out", type=Path, default=Path("photographs.csv"))
    making.add_argument("--first", type=int, default=0)
    making.add_argument("--count", type=int, default=330)
    making.add_argument("--workers", type=int, default=16)
    making.add_argument("--seconds", type=float, default=1e9)
    judging = tasks.add_parser("judge")
    judging.add_argument("file", type=Path)
    judging.add_argument("--count", type=int, default=330)
    judging.add_argument("--workers", type=int, default=16)
    judging.add_argument("--pictures", type=int, default=0, help="of each kind that is no speckle")
    judging.add_argument("--seed", type=int, default=12, help="of those")
    given = asked.parse_args()
    if given.task == "judge":
        print(judge(given.file, given.count, given.workers, given.pictures, given.seed))
        return
    truth(given.out, range(given.first, given.first + given.count), given.workers, given.seconds)


if __name__ == "__main__":
    main()
