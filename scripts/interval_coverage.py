"""How often 1.96 standard errors of C_I hold the truth behind narrow phase functions (docs/notes/trust.md).

    python scripts/interval_coverage.py                       # the whole table: half an hour of one core
    python scripts/interval_coverage.py 0.98,20 --paths 4000  # one slab

Of each slab 200 runs; tilts are those at which C_I is 0.99, 0.9, 0.5 and 0.1 of the way from 1 to its floor. The truth
is the mean of other, longer runs. ``warned`` is the share of runs, of all four tilts, that issue a DoubtWarning; behind
"unwarned" stand the runs that issue none, where these are a fifth at least.
"""

import argparse
import warnings

import numpy as np

import specklegen as sg
from specklegen.memory_effects.correlation import estimate_correlation

ANISOTROPIES, DEPTHS, PATHS = (0.9, 0.95, 0.98, 0.99), (5, 10, 20, 50), (4000, 16_000, 64_000)
LEVELS = (0.99, 0.9, 0.5, 0.1)
THICKNESS = 100.0
WAVELENGTH = 1e-5  # so short that tilts are small beside every lobe
TRUE_PATHS = 1_000_000


def slab_of(g: float, depth: float) -> sg.Slab:
    """Make a slab of the table."""
    return sg.Slab(thickness=THICKNESS, mean_free_path=THICKNESS / depth, scatterer=sg.media.HenyeyGreenstein(g))


def truth_of(slab: sg.Slab, runs: int) -> tuple[np.ndarray, np.ndarray]:
    """Tilts at the levels, and C_I there, float64[levels] each."""
    first = estimate_correlation(slab, TRUE_PATHS, 10**6, threads=1)
    q = np.array([first.half_range(level) for level in LEVELS])
    true = [first, *(estimate_correlation(slab, TRUE_PATHS, 10**6 + 1 + n, threads=1) for n in range(runs - 1))]
    lit = sum(each.weights.sum() for each in true)
    lost = sum((1 - each(q)) * each.weights.sum() for each in true) / lit
    return np.arcsin(q * WAVELENGTH / (2 * np.pi)), np.square(1 - lost)


def coverage(slab: sg.Slab, tilts: np.ndarray, truth: np.ndarray, paths: int, runs: int):
    """Whether each run holds the truth bool[runs, tilts], its errors float64[runs, tilts], and whether it warns."""
    held, errors, warned = np.empty((runs, len(tilts)), bool), np.empty((runs, len(tilts))), np.empty(runs, bool)
    for run in range(runs):
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always", sg.DoubtWarning)
            curve = sg.memory_effect(slab, wavelength=WAVELENGTH, tilts=tilts, paths=paths, seed=run, threads=1)
        held[run] = np.abs(curve.intensity - truth) <= 1.96 * curve.standard_error
        errors[run], warned[run] = curve.standard_error, bool(caught)
    return held, errors, warned


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("slabs", nargs="*", help="g,OD of slabs; by default all")
    parser.add_argument("--paths", type=int, nargs="+", default=PATHS)
    parser.add_argument("--runs", type=int, default=200)
    parser.add_argument("--truth", type=int, default=8, help="long runs of a million paths")
    arguments = parser.parse_args()
    slabs = [tuple(map(float, each.split(","))) for each in arguments.slabs]
    print(f"| g | OD | paths | coverage at {', '.join(map(str, LEVELS))} | warned | median error at 0.5 |")
    print("|---|---|---|---|---|---|")
    for g, depth in slabs or [(g, depth) for g in ANISOTROPIES for depth in DEPTHS]:
        slab = slab_of(g, depth)
        tilts, truth = truth_of(slab, arguments.truth)
        for paths in arguments.paths:
            held, errors, warned = coverage(slab, tilts, truth, paths, arguments.runs)
            shares = [held] + ([held[~warned]] if 0.2 <= 1 - warned.mean() < 1 else [])
            text = "; unwarned ".join(" ".join(f"{share:.2f}" for share in some.mean(axis=0)) for some in shares)
            row = f"| {g:g} | {depth:g} | {paths} | {text} | {warned.mean():.2f} | {np.median(errors[:, 2]):.3f} |"
            print(row, flush=True)


if __name__ == "__main__":
    main()
