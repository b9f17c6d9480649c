"""Coverage of the intervals of :func:`specklegen.fit_material`, and how often chi squared tells a wrong model.

Synthetic benches of four materials, whose curves come from paths (not from the tables that the fit reads): C_I at 25
tilts to 3 half ranges, +- .01, and the transmittance, +- 2 %. A profile interval holds the truth where chi squared,
with the truth held, has risen by less than its quantile. Wilson's limits are those of 99 %.

    python scripts/material_coverage.py sphere --benches 30
    python scripts/material_coverage.py exact --benches 100 --workers 16 --out first.csv     # truths of the tables
    python scripts/material_coverage.py exact --first 100 --benches 100 --out second.csv     # a hundred others
    python scripts/material_coverage.py told first.csv second.csv                            # what they say together

does it. Truths of six million paths gave for thickness, mean free path and g, where 68 % intervals should hold .68, and
95 % ones .95 (100 benches of the first, 40 of the others):

    OD 5, g .9                .55 .62 .45     .95 .95 .92
    OD 10, g .9               .75 .72 .75     .92 .90 .95
    OD 3, g .6, albedo .99    .72 .72 .68     1   .98 .98
    OD 20, g .8               .62 .70 .72     .82 .98 .98

Truths of one million paths err by as much as the tables, .0015 of C_I: with them, the thickness at OD 20 had seemed to
be held in .37. The benches of a material share its truth, and so are not independent.
"""

import argparse
import csv
import multiprocessing
import time
from collections.abc import Iterable
from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy.stats import binomtest, chi2

import specklegen as sg
from specklegen.measured import MemoryCurve, Transmittance
from specklegen.memory_effects.atlas import correlation_for
from specklegen.memory_effects.correlation import estimate_correlation
from specklegen.models.calibration.prediction import covariance_of_tables, predict

WAVELENGTH, THICKNESS = 0.5, 1000.0
FREE = ("thickness", "mean_free_path", "g")
LEVELS = 0.68, 0.95
_AT_ONCE, TRUTH = 1_000_000, 6_000_000
"""Paths of an estimate, and of a truth."""
MATERIALS = {
    "OD 5, g .9": (5.0, 0.9, 1.0), "OD 10, g .9": (10.0, 0.9, 1.0), "OD 3, g .6, albedo .99": (3.0, 0.6, 0.99),
    "OD 20, g .8": (20.0, 0.8, 1.0),
}  # fmt: skip


class Bench(NamedTuple):
    """A slab, its tilts float64[25], and what is exact: C_I float64[25] and the transmittance."""

    slab: sg.Slab
    tilts: np.ndarray
    c_i: np.ndarray
    transmittance: float

    def measured(self, rng: np.random.Generator, sphere: bool = True, error: float = 0.01) -> list:
        """Noisy observations, with the transmittance if it was measured too."""
        curve = MemoryCurve(self.tilts, self.c_i + error * rng.normal(size=len(self.tilts)), error)
        light = self.transmittance * (1 + 0.02 * rng.normal())
        return [curve, Transmittance(light, 0.02 * self.transmittance)] if sphere else [curve]


def bench_of(slab: sg.Slab, paths: int = TRUTH) -> Bench:
    """A bench of a slab, by paths, a million at a time."""
    estimates = [estimate_correlation(slab, min(paths, _AT_ONCE), seed=11 + n) for n in range(-(-paths // _AT_ONCE))]
    tilts = np.arcsin(estimates[0].half_range() * np.arange(1, 26) * (3 / 25) * WAVELENGTH / (2 * np.pi))
    light = sg.reflectance_transmittance(slab, paths=min(paths, _AT_ONCE), seed=2)
    c_i = [each.intensity(2 * np.pi / WAVELENGTH * np.sin(tilts))[0] for each in estimates]
    return Bench(slab, tilts, np.mean(c_i, axis=0), light.transmittance)


def exact_bench(slab: sg.Slab) -> Bench:
    """A bench whose truth are the tables that the fit reads."""
    x = np.array([[np.log(slab.thickness), np.log(slab.optical_depth), np.log(1 - slab.scatterer.mean_cosine()),
                   -np.log(slab.albedo), 0.0]])  # fmt: skip
    half = correlation_for(slab, paths=100_000, tolerance=1.0).half_range()
    tilts = np.arcsin(half * np.arange(1, 26) * (3 / 25) * WAVELENGTH / (2 * np.pi))
    seen = [MemoryCurve(tilts, np.full(25, 0.5), 0.01), Transmittance(0.5, 0.01)]
    shown = predict(seen, WAVELENGTH, x, ()).values[0]
    return Bench(slab, tilts, shown[:25], float(shown[25]))


def drawn(bench: Bench, rng: np.random.Generator) -> list:
    """Observations with the errors of data and of tables, both as the fit takes them to be."""
    plain = [MemoryCurve(bench.tilts, bench.c_i, 0.01), Transmittance(bench.transmittance, 0.02 * bench.transmittance)]
    moved = []
    for each in plain:
        wrong = np.linalg.cholesky(covariance_of_tables(each) + np.diag(np.square(each.errors)))
        moved.append(each.values + wrong @ rng.normal(size=len(each.values)))
    return [MemoryCurve(bench.tilts, moved[0], 0.01), Transmittance(float(moved[1][0]), 0.02 * bench.transmittance)]


def one(task: tuple[str, int]) -> list:
    """A line of the table: rises of chi squared at the truth, and drawn ones that intervals of two levels end at."""
    name, number = task
    bench = exact_bench(slab_of(*MATERIALS[name]))
    rng = np.random.default_rng([23, [*MATERIALS].index(name), number])
    fit = fitted(bench, drawn(bench, rng))
    at = rises(bench, fit)
    ends = [fit.rises[n, int(np.ceil(level * 100 - 1e-9)) - 1] for level in LEVELS for n in range(len(FREE))]
    return [name, number, *(f"{value:.4f}" for value in [*at, *ends, fit.p_value])]


def run(out: Path, numbers: range, workers: int, seconds: float) -> None:
    """Write the table of exact truths, a line as soon as it is there, until the time is over; print what it says."""
    one(("OD 5, g .9", 0))
    begun = time.time()
    with multiprocessing.get_context("fork").Pool(workers) as pool, out.open("w", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        for row in pool.imap(one, [(name, number) for number in numbers for name in MATERIALS]):
            writer.writerow(row)
            file.flush()
            if time.time() - begun > seconds:
                break
    print(told([out]))


def told(files: Iterable[Path]) -> str:
    """What tables of exact truths say together; a bench that stands in two of them counts once."""
    rows = [*{tuple(row[:2]): row for file in files for row in csv.reader(file.read_text().splitlines())}.values()]
    lines = []
    for name in [*MATERIALS, ""]:
        own = np.array([[float(x) for x in row[2:]] for row in rows if name in ("", row[0])])
        if not len(own):
            continue
        for n, level in enumerate(LEVELS):
            drawn_ends, at = own[:, 3 + 3 * n : 6 + 3 * n], own[:, :3]
            plain = np.full_like(at, chi2.ppf(level, 1))
            kinds = {"drawn": drawn_ends, "chi squared": plain, "the larger": np.maximum(drawn_ends, plain)}
            for kind, ends in kinds.items():
                counts = (at <= ends).sum(axis=0)
                shares = counts / len(own)
                limits = [binomtest(int(count), len(own)).proportion_ci(0.99, "wilson") for count in counts]
                words = [f"{free} {share:.3f} ({low:.3f} to {high:.3f}){'' if low <= level <= high else ' !'}"
                         for free, share, (low, high) in zip(FREE, shares, limits, strict=True)]  # fmt: skip
                lines.append(f"{name or 'all'}, {len(own)}, {level:.0%}, {kind}: {'; '.join(words)}")
    return "\n".join(lines)


def slab_of(depth: float, g: float, albedo: float = 1.0) -> sg.Slab:
    """A slab of Henyey-Greenstein scatterers."""
    return sg.Slab(
        thickness=THICKNESS, mean_free_path=THICKNESS / depth, albedo=albedo, scatterer=sg.HenyeyGreenstein(g)
    )


def fitted(bench: Bench, observations: list, free: tuple[str, ...] = FREE) -> sg.MaterialFit:
    """Fit one bench; what is not free is known."""
    slab = bench.slab
    known = {"thickness": slab.thickness, "mean_free_path": slab.mean_free_path, "g": slab.scatterer.mean_cosine()}
    known = {name: value for name, value in known.items() if name not in free} | {"albedo": slab.albedo}
    return sg.fit_material(observations, wavelength=WAVELENGTH, known=known, free=free)


def rises(bench: Bench, fit: sg.MaterialFit) -> np.ndarray:
    """Rise of chi squared, float64[free], with each free number in turn held at the truth."""
    slab = bench.slab
    truth = {"thickness": slab.thickness, "mean_free_path": slab.mean_free_path, "g": slab.scatterer.mean_cosine()}
    return np.array([fit.profile(name, [truth[name]])[0] for name in fit.free])


def coverage(count: int, paths: int, sphere: bool) -> None:
    """Print how often intervals hold the truth."""
    rng = np.random.default_rng(11)
    found, chances = [], []
    for name, numbers in MATERIALS.items():
        bench = bench_of(slab_of(*numbers), paths)
        fits = [fitted(bench, bench.measured(rng, sphere)) for _ in range(count)]
        own = np.array([rises(bench, fit) for fit in fits])
        chances += [fit.p_value for fit in fits]
        shares = [(own < chi2.ppf(level, 1)).mean(axis=0).round(3).tolist() for level in LEVELS]
        print(name, dict(zip(LEVELS, shares, strict=True)), flush=True)
        found.append(own)
    for n, name in enumerate(FREE):
        every = np.concatenate(found)[:, n]
        for level in LEVELS:
            count = int((every < chi2.ppf(level, 1)).sum())
            share = count / len(every)
            low, high = binomtest(count, len(every)).proportion_ci(0.99, "wilson")
            told = "holds" if low <= level <= high else "DOES NOT HOLD"
            print(f"{name}: {level:.0%} interval holds {share:.3f} ({low:.3f} to {high:.3f}): {told}", flush=True)
    print(f"p < .05 in {np.mean(np.array(chances) < 0.05):.3f}", flush=True)


def wrong_models(count: int, paths: int) -> None:
    """Print how often chi squared tells that a slab is not of the model."""
    fisher, glass = sg.VonMisesFisher(concentration=10.0), sg.Faces(inside=1.33, outside=1.0)
    wrong = {
        "vMF, OD 10, g .9": slab_of(10, 0.9).replace(scatterer=fisher),
        "vMF, OD 5, g .9": slab_of(5, 0.9).replace(scatterer=fisher),
        "faces of 1.33, OD 10, g .9": slab_of(10, 0.9).replace(faces=glass),
        "faces of 1.33, OD 5, g .9": slab_of(5, 0.9).replace(faces=glass),
    }
    rng = np.random.default_rng(2)
    for name, slab in wrong.items():
        bench = bench_of(slab, paths)
        for sphere in (True, False):
            for free in (FREE, FREE[1:]):
                told = np.mean([fitted(bench, bench.measured(rng, sphere), free).p_value < 0.05 for _ in range(count)])
                what = f"{'C_I and T' if sphere else 'C_I'}, free {', '.join(free)}"
                print(f"{name}, {what}: told by chi squared (p < .05) in {told:.2f}", flush=True)


def main() -> None:
    """Print a table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("what", choices=("sphere", "alone", "wrong", "exact", "told"),
                        help="C_I and T, C_I alone, wrong models, or truths of the tables")  # fmt: skip
    parser.add_argument("files", nargs="*", type=Path, help="tables that `told` reads")
    parser.add_argument("--benches", type=int, default=100, help="of each material")
    parser.add_argument("--first", type=int, default=0, help="number of the first bench of each material")
    parser.add_argument("--paths", type=int, default=TRUTH)
    parser.add_argument("--out", type=Path, default=Path("coverage.csv"))
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--seconds", type=float, default=1e9)
    arguments = parser.parse_args()
    if arguments.what == "exact":
        numbers = range(arguments.first, arguments.first + arguments.benches)
        run(arguments.out, numbers, arguments.workers, arguments.seconds)
    elif arguments.what == "told":
        print(told(arguments.files or [arguments.out]))
    elif arguments.what == "wrong":
        wrong_models(arguments.benches, arguments.paths)
    else:
        coverage(arguments.benches, arguments.paths, arguments.what == "sphere")


if __name__ == "__main__":
    main()
