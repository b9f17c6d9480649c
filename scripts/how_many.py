"""Table and figure of docs/howmany.md: what more states of a medium, tilts and photons are worth, judged on waves.

    python scripts/how_many.py images --out FILE       # 45 CPU minutes: the waves
    python scripts/how_many.py judge FILE              # 10 CPU minutes: table, docs/images/how_many.png

Images are those of ``scripts/build/make_wave_images.py``, of other objects behind six of its slabs: waves that go from
slice to slice, drawn by no sampler of this package. A state of the medium is another seed of the same slab. A tilt
turns light and camera together. Both methods know C_I of the slab, and no light is divided out.
"""

import argparse
import sys
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
import torch

from specklegen.datasets import load_recipe
from specklegen.memory_effects.correlation import estimate_correlation
from specklegen.models import load_solver
from specklegen.models.judging.baselines import Batch, any_object, katz
from specklegen.models.judging.evaluation import aligned_to, targets_of
from specklegen.models.judging.tasks import SEED
from specklegen.models.judging.waves import CHANGES
from specklegen.models.metrics import Interval, bootstrap, pearson
from specklegen.models.recoverability.autocorrelation_error import Conditions
from specklegen.models.recoverability.verdict import judge as decide

sys.path.insert(0, str(Path(__file__).parent / "build"))
import make_wave_images as waves  # noqa: E402

PICTURE = Path("docs/images/how_many.png")
SLABS = (3, 7, 11, 14, 18, 22)  # of 24, which objects of 0.25 to 3 ranges are behind
OBJECTS, FIRST, STATES = 4, 200, 16
SPACINGS = (0.25, 0.5, 1.0)  # of four tilts, ranges; where the grid holds them
COUNTS = (1, 2, 4, 8, 16)  # of states
PHOTONS = (1.0, 3.0, 10.0, 30.0, 100.0)  # mean of a pixel
_WIDEST = 42  # bins of a tilt


def objects() -> np.ndarray:
    """Return characters and shapes that no other set of waves shows, in turn, uint8[OBJECTS, h, w]."""
    shown = [waves.families()[n % 2].image(SEED, "test", FIRST + n // 2) for n in range(OBJECTS)]
    return np.round(255 * np.stack(shown)).astype(np.uint8)


def tilts(number: int, spacing: float) -> list[int]:
    """Return four tilts of a slab at a spacing in memory-effect ranges, bins; none off the grid."""
    reach = waves.SIDE / waves.drawn_slab(number).extent
    bins = [round(reach * spacing * step) for step in (-1.5, -0.5, 0.5, 1.5)]
    return bins if bins[-1] <= _WIDEST else []


def render(out: Path) -> None:
    """Write images of all slabs, states and tilts, with the objects."""
    hidden, found = objects(), {}
    for number in SLABS:
        seen = [waves.images(number, hidden, seed=50_000 + 100 * number + state) for state in range(STATES)]
        found[f"states {number}"] = np.stack(seen, 1).astype(np.float32)
        for spacing in SPACINGS:
            seen = [waves.images(number, hidden, 50_000 + 100 * number, tilt) for tilt in tilts(number, spacing)]
            if seen:
                found[f"tilts {spacing} {number}"] = np.stack(seen, 1).astype(np.float32)
        print(f"slab {number} done", flush=True)
        np.savez_compressed(out, objects=hidden, **found)


def batch(number: int, frames: np.ndarray, hidden: np.ndarray) -> Batch:
    """Lay frames [OBJECTS, F, H, W] of one slab out as a recipe does."""
    drawn = {name: torch.full((len(frames),), float(value)) for name, value in waves.parameters(number).items()}
    shown = torch.from_numpy(hidden / np.float32(255))
    return {"frames": torch.from_numpy(frames), "object": shown, "parameters": drawn}


def scores(name: str, number: int, frames: np.ndarray, hidden: np.ndarray, methods: dict) -> list[dict]:
    """Return a row for each object and method, with r to the object and to its diffraction-limited image."""
    asked, rows, side = batch(number, frames, hidden), [], hidden.shape[1:]
    for method, function in methods.items():
        made = function(asked)
        found = [pearson(aligned_to(made, target, side), target[:, : side[0], : side[1]]).tolist()
                 for target in targets_of(asked).values()]  # fmt: skip
        rows += [dict(what=name, slab=number, object=n, method=method, r=r, blurred=blurred)
                 for n, (r, blurred) in enumerate(zip(*found, strict=True))]  # fmt: skip
    return rows


def conditions(content: dict, number: int) -> dict[str, np.ndarray]:
    """Return frames of one slab by what is asked of them."""
    every, rng = content[f"states {number}"], np.random.default_rng([SEED, number])
    found = {f"states {count}": every[:, :count] for count in COUNTS}
    found |= {f"photons {mean:g}": rng.poisson(mean * every[:, :1]).astype(np.float32) for mean in PHOTONS}
    found |= {f"photons 3, states {count}": rng.poisson(3.0 * every[:, :count]).astype(np.float32) for count in (4, 16)}
    tilted = {f"tilts {spacing}": content.get(f"tilts {spacing} {number}") for spacing in SPACINGS}
    return found | {name: frames for name, frames in tilted.items() if frames is not None}


def predicted(number: int, frames: int, hidden: np.ndarray) -> float:
    """Return the probability of r above 0.8 that the feasibility model gives phase retrieval behind one slab."""
    slab = waves.drawn_slab(number).slab
    at = 2 * np.pi * waves.PITCH * np.arange(2 * waves.SIDE)
    c_i = np.square(estimate_correlation(slab, 100_000, 0, threads=1)(at)).clip(0, 1)
    asked = Conditions(objects=hidden / 255, object_pitch=waves.PITCH * waves.WINDOW, memory_effect=[1.0, *c_i[1:]],
                       camera=waves.CAMERA * waves.PITCH * waves.WINDOW, frames=frames)  # fmt: skip
    return decide(asked).probability


def gains(table: pd.DataFrame, name: str) -> str:
    """Return the cells of what is gained over one state, in pairs of the same slab and object, by method."""
    keys, cells = ["slab", "object"], ""
    for _, own in table.groupby("method", sort=False):
        one, more = (own[own["what"] == what].set_index(keys)["r"] for what in ("states 1", name))
        gain = (more - one).dropna().reset_index()
        cells += " {:+.3f} [{:+.3f}, {:+.3f}] |".format(*bootstrap(*(gain[x].to_numpy() for x in ("r", *keys))))
    return cells


def judge(file: Path) -> None:
    """Print the table as it stands on the page, and draw the figure."""
    recipe = load_recipe("through-slab", CHANGES)
    methods = {"solver": any_object(load_solver(), recipe), "Katz": katz(recipe=recipe)}
    with np.load(file) as opened:
        content = dict(opened)
    hidden = content.pop("objects")
    rows = [
        row for number in SLABS for name, frames in conditions(content, number).items()
        for row in scores(name, number, frames, hidden, methods)
    ]  # fmt: skip
    table = pd.DataFrame(rows)
    table.to_csv(file.with_suffix(".csv"), index=False)
    names = list(dict.fromkeys(table["what"]))
    intervals = {
        (name, method): bootstrap(own["r"].to_numpy(), own["slab"].to_numpy(), own["object"].to_numpy())
        for (name, method), own in table.groupby(["what", "method"])
    }
    for name in names:
        own = table[table["what"] == name]
        shares = own.groupby("method")["blurred"].apply(lambda r: (r > 0.8).mean())
        cells = [f"{mean:.3f} [{low:.3f}, {high:.3f}]" for mean, low, high in (intervals[name, m] for m in methods)]
        print(f"| {name} | {own['slab'].nunique()} | {' | '.join(cells)} | {shares['Katz']:.2f} |{gains(table, name)}")
    for count in COUNTS:
        print(f"predicted for {count} states: {np.mean([predicted(n, count, hidden) for n in SLABS]):.2f}")
    draw(names, intervals)


def draw(names: list[str], intervals: dict[tuple[str, str], Interval]) -> None:
    """Draw r against states, and against photons of one state and of more."""
    figure, (left, right) = plt.subplots(1, 2, figsize=(8, 3.4), sharey=True, layout="constrained")
    for method, colour in {"solver": "C0", "Katz": "C1"}.items():
        for axes, head, values in [(left, "states ", COUNTS), (right, "photons ", PHOTONS)]:
            means, low, high = np.array([intervals[f"{head}{value:g}", method] for value in values]).T
            axes.errorbar(values, means, [means - low, high - means], fmt="o-", color=colour, label=method, capsize=2)
    left.set(xscale="log", xlabel="states of the medium", ylabel="correlation with the object", xticks=COUNTS)
    left.set_xticklabels([str(count) for count in COUNTS])
    left.minorticks_off()
    right.set(xscale="log", xlabel="photons a pixel, one state")
    left.legend(frameon=False)
    figure.savefig(PICTURE, dpi=150)


def main() -> None:
    """Do what the command line names."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    commands = parser.add_subparsers(dest="command", required=True)
    commands.add_parser("images").add_argument("--out", type=Path, required=True)
    commands.add_parser("judge").add_argument("file", type=Path)
    asked = parser.parse_args()
    if asked.command == "images":
        render(asked.out)
    else:
        judge(asked.file)


if __name__ == "__main__":
    main()
