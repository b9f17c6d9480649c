"""Variance of memory effects of layers of unlike phase functions, beside a literal walk's (docs/physics.md 2).

    python scripts/layer_variance.py rows.csv [upper g,lower g ...]  # half an hour of one core for all pairs

The walk is written from [Bar19] sec. 6 and docs/polarisation.md alone: photons of one weight, one after the other, that
are connected to the view at every collision. Its polarised light is a real vector, whose part along each new direction
is taken away; angles are drawn by rejection. Both give C_I along the axis at q = 1 over the thickness. Prints variance
times paths of the walk, times how much ours is, the standard error of this factor, and z of the difference. Variances
are means over eight seeds of what a jackknife says. Behind phase functions of g = 0.95 and more they rest on single
connections: rows above 3 are measured again by 32 other seeds. Rows go to a file, and those that it has are not
measured again. Last comes the table of docs/notes/physics.md: the largest factor of each pair.
"""

import argparse
import csv
import math
from itertools import permutations, product
from pathlib import Path

import numpy as np
from numba import njit
from scipy.special import j0

import specklegen as sg
from specklegen.core import statistics
from specklegen.core.statistics import BATCHES, jackknife
from specklegen.paths import rare_paths

ANISOTROPIES = (-0.3, 0.0, 0.5, 0.8, 0.95, 0.98)
DEPTHS = ((0.5, 0.5), (3.0, 4.0), (10.0, 1.0), (1.0, 10.0))
THICKNESS = 1e5  # of each layer, in wavelengths: so many that lobes are wide beside tilts
PATHS, SEEDS, MORE_SEEDS = BATCHES * 150, 8, 32
DOUBTFUL = 3.0
MODES, LIGHTS = ("transmission", "reflection"), ("scalar", "polarised")


@njit(cache=True)
def _walk(depths, g, back, polarised, each, seed):
    """Batch, place beside the first vertex and weight of every connection; lengths in thicknesses of a layer."""
    np.random.seed(seed)  # noqa: NPY002 (Numba's own generator)
    batch, aside, along, weight = [0.0], [0.0], [0.0], [0.0]
    for number in range(each * 64):
        x = y = z = x1 = y1 = 0.0
        wx, wy, wz = 0.0, 0.0, 1.0
        ex, ey, ez = 1.0, 0.0, 0.0
        first = True
        layer = 0
        while True:
            left = -math.log(1.0 - np.random.random())  # noqa: NPY002
            while layer >= 0 and layer <= 1:
                way = (layer + (1.0 if wz > 0.0 else 0.0) - z) / wz if wz != 0.0 else math.inf
                step = min(left / depths[layer], way)
                x, y, z = x + wx * step, y + wy * step, z + wz * step
                if step < way:
                    break
                left -= step * depths[layer]
                layer += 1 if wz > 0.0 else -1
            if layer < 0 or layer > 1:
                break
            if first:
                x1, y1, first = x, y, False
            h = g[layer]
            depth = z * depths[0] if layer == 0 else depths[0] + (z - 1.0) * depths[1]
            cos = -wz if back else wz
            w = (1.0 - h * h) / (1.0 + h * h - 2.0 * h * cos) ** 1.5 / (4.0 * math.pi)
            w *= math.exp(-depth if back else depth - depths[0] - depths[1])
            if polarised:
                w *= 2.0 / (1.0 + cos * cos) * ex * ex
            batch.append(number // each)
            aside.append(x - x1)
            along.append(y - y1)
            weight.append(w)
            while True:
                c = 2.0 * np.random.random() - 1.0  # noqa: NPY002
                if h != 0.0:
                    c = (1.0 + h * h - ((1.0 - h * h) / (1.0 + h * c)) ** 2) / (2.0 * h)
                s, phi = math.sqrt(max(0.0, 1.0 - c * c)), 2.0 * math.pi * np.random.random()  # noqa: NPY002
                if abs(wz) < 0.9:
                    ux, uy, uz = wy, -wx, 0.0
                else:
                    ux, uy, uz = 0.0, wz, -wy
                n = math.sqrt(ux * ux + uy * uy + uz * uz)
                ux, uy, uz = ux / n, uy / n, uz / n
                vx, vy, vz = wy * uz - wz * uy, wz * ux - wx * uz, wx * uy - wy * ux
                a, b = s * math.cos(phi), s * math.sin(phi)
                nx, ny, nz = a * ux + b * vx + c * wx, a * uy + b * vy + c * wy, a * uz + b * vz + c * wz
                out = ex * nx + ey * ny + ez * nz
                if not polarised:
                    break
                if np.random.random() * (1.0 + c * c) < 1.0 - out * out:  # noqa: NPY002
                    ex, ey, ez = ex - out * nx, ey - out * ny, ez - out * nz
                    n = math.sqrt(ex * ex + ey * ey + ez * ez)
                    ex, ey, ez = ex / n, ey / n, ez / n
                    break
            n = math.sqrt(nx * nx + ny * ny + nz * nz)
            wx, wy, wz = nx / n, ny / n, nz / n
    return np.array(batch), np.array(aside), np.array(along), np.array(weight)


def literal(depths, g, mode: str, polarised: bool, seed: int) -> tuple[float, float]:
    """C_I at q = 1 over the thickness, which has two layers, and its standard error."""
    batch, x, y, w = _walk(np.array(depths), np.array(g), mode == "reflection", polarised, PATHS // BATCHES, seed)
    kernel = np.cos(x / 2) if polarised else j0(np.hypot(x, y) / 2)  # the tilt lies along the field
    sums = np.stack([np.bincount(batch.astype(int), each, BATCHES) for each in (w, w * kernel)], axis=1)
    value, error = jackknife(sums, lambda total: (total[1:] / total[0]) ** 2)
    return float(value[0]), float(error[0])


def ours(depths, g, mode: str, polarised: bool, seed: int) -> tuple[float, float]:
    """The same of the engine."""
    layers = [
        sg.media.Layer(thickness=THICKNESS, mean_free_path=THICKNESS / depth, scatterer=sg.media.HenyeyGreenstein(each))
        for depth, each in zip(depths, g, strict=True)
    ]
    medium = sg.Layers(layers, polarisation="projector" if polarised else "scalar")
    found = sg.memory_effect(medium, wavelength=1.0, tilts=[math.asin(1 / (4 * math.pi * THICKNESS))], paths=PATHS,
                             mode=mode, channel="co" if polarised else "none", reverse=False, seed=seed,
                             threads=1)  # fmt: skip
    return float(found.intensity[0]), float(found.standard_error[0])


def compared(depths, g, mode: str, polarised: bool, seeds: range) -> tuple[float, float, float, float]:
    """Variance times paths of the walk, times how much ours is, its standard error, and z of the difference."""
    walk, own = (np.array([f(depths, g, mode, polarised, seed) for seed in seeds]).T for f in (literal, ours))
    variances = [PATHS * np.square(errors) for _, errors in (walk, own)]
    literally, found = (each.mean() for each in variances)
    noise = math.hypot(*(each.std(ddof=1) / each.mean() / math.sqrt(len(seeds)) for each in variances))
    spread = math.sqrt((walk[0].var(ddof=1) + own[0].var(ddof=1)) / len(seeds))
    return literally, found / literally, noise * found / literally, (own[0] - walk[0]).mean() / spread


def measured(rows: Path) -> dict[tuple[str, ...], list[float]]:
    """Return what a file holds: factor, error, walk's variance and z, by pair, split, side and kind of light."""
    if not rows.exists():
        return {}
    with rows.open(newline="") as lines:
        return {tuple(line[:6]): [float(each) for each in line[6:]] for line in csv.reader(lines)}


def print_table(found: dict[tuple[str, ...], list[float]]) -> None:
    """Print the largest factor of the splits of each pair and both kinds of light, upper g down, lower g across.

    Of rows whose error is at most half of the factor: the others rest on single connections.
    """
    for side in MODES:
        of_side = {key: row for key, row in found.items() if key[4] == side}
        known = {key: row for key, row in of_side.items() if row[2] <= row[1] / 2}
        medians = (f"{light} {np.median([row[1] for key, row in known.items() if key[5] == light]):.1f}"
                   for light in LIGHTS)  # fmt: skip
        print(f"\n{side}: {len(known)} of {len(of_side)} rows are known to a half; medians: {', '.join(medians)}\n")
        print("| g above, below | " + " | ".join(f"{g:g}" for g in ANISOTROPIES) + " |\n" + "|---" * 7 + "|")
        for above in ANISOTROPIES:
            worst = [max((row[1:3] for key, row in known.items() if key[:2] == (str(above), str(g))), default=None)
                     for g in ANISOTROPIES]  # fmt: skip
            cells = ("{:.1f} ± {:.1f}".format(*each) if each else "" for each in worst)
            print(f"| {above:g} | " + " | ".join(cells) + " |")


def main() -> None:
    """Measure the rows that a file lacks, and once more those that are too large to believe; print the table."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("rows", type=Path, help="CSV file of rows; new ones are added")
    parser.add_argument("pairs", nargs="*", help="upper g,lower g; by default all; none: the table alone")
    arguments = parser.parse_args()
    # As the batches scatter: no allowance for heavy tails, none for what rare paths are expected to carry.
    statistics.tail_factor, statistics._BEND, rare_paths.FEW = (lambda left: 1.0), 0.0, 0.0
    pairs = [tuple(map(float, each.split(","))) for each in arguments.pairs if each != "none"]
    pairs = pairs or ([] if arguments.pairs else list(permutations(ANISOTROPIES, 2)))
    found = measured(arguments.rows)
    for seeds in (range(1, 1 + SEEDS), range(1 + SEEDS, 1 + SEEDS + MORE_SEEDS)):
        for g, depths, mode, light in product(pairs, DEPTHS, MODES, LIGHTS):
            key = tuple(map(str, (*g, *depths, mode, light)))
            if key in found and not (found[key][1] > DOUBTFUL and found[key][4] < len(seeds)):
                continue
            found[key] = [*compared(depths, g, mode, light == "polarised", seeds), len(seeds)]
            with arguments.rows.open("a") as lines:
                lines.write(",".join((*key, *(f"{each:.3g}" for each in found[key]))) + "\n")
    print_table(found)


if __name__ == "__main__":
    main()
