"""How often 1.96 standard errors of C_I hold the truth behind narrow phase functions (docs/notes/trust.md).

    python scripts/interval_coverage.py                       # the whole table: half an hour of one core
    python scripts/interval_coverage.py 0.98,20 --paths 4000  # one slab
    python scripts/interval_coverage.py --others "temporal" --paths 4000 --runs 60  # polarised light, times, layers ...

Of each slab 200 runs; tilts are those at which C_I is 0.99, 0.9, 0.5 and 0.1 of the way from 1 to its floor. The truth
is the mean of other, longer runs. ``warned`` is the share of runs, of all four tilts, that issue a DoubtWarning; behind
"unwarned" stand the runs that issue none, where these are a fifth at least.
"""

import argparse
import warnings
from functools import partial

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


def layers_of(*parts: tuple[float, float, float | None]) -> sg.Layers:
    """Make layers of g, optical depth and index."""
    share = THICKNESS / len(parts)
    return sg.Layers([
        sg.media.Layer(thickness=share, mean_free_path=share / depth, scatterer=sg.media.HenyeyGreenstein(g), index=n)
        for g, depth, n in parts
    ])  # fmt: skip


def curve_of(verb, name: str, places: np.ndarray, medium, **options):
    """Return what gives C_I and errors at places of a curve, and places to choose from."""

    def run(at: np.ndarray, paths: int, seed: int) -> tuple[np.ndarray, np.ndarray]:
        found = verb(medium, wavelength=WAVELENGTH, paths=paths, seed=seed, threads=1, **{name: at}, **options)
        return found.intensity, found.standard_error

    return run, places


def balance_of(medium):
    """Return what gives R and T."""

    def run(_, paths: int, seed: int) -> tuple[np.ndarray, np.ndarray]:
        found = sg.statistics.reflectance_transmittance(medium, paths=paths, seed=seed, threads=1)
        return (np.array([found.reflectance, found.transmittance]),
                np.array([found.reflectance_error, found.transmittance_error]))  # fmt: skip

    return run, None


def others() -> dict:
    """Curves of polarised light, of reversed paths, in time and of layers that refract; R and T of layers."""
    k = 2 * np.pi / WAVELENGTH
    tilts, lags = np.geomspace(1e-2, 1e3, 50) / (k * THICKNESS), np.geomspace(1e-6, 1e2, 50) / k**2
    tilted = partial(curve_of, sg.memory_effect, "tilts", tilts)
    later = partial(curve_of, sg.statistics.temporal_correlation, "lags", lags)
    back, moving = {"mode": "reflection", "view": [0, 0, -1.0], "reverse": True}, sg.media.Brownian(diffusion=1.0)
    found = {}
    for g, depth in ((0.9, 10), (0.95, 20), (0.98, 20)):
        slab, name = slab_of(g, depth), f"g {g:g}, OD {depth}"
        polarised = slab.replace(polarisation="projector")
        found |= {f"{channel} {name}": tilted(polarised, channel=channel) for channel in ("co", "crossed", "circular")}
        found[f"sent back, co {name}"] = tilted(polarised, channel="co", mode="reflection")
        found[f"reversed {name}"] = tilted(slab, **back)
        found[f"temporal {name}"] = later(slab.replace(motion=moving))
        found[f"temporal, sent back {name}"] = later(slab.replace(motion=moving), mode="reflection")
        found[f"temporal, co {name}"] = later(polarised.replace(motion=moving), channel="co")
    for parts in (
        ((0.9, 5, 1.33), (0.7, 5, 1.5)), ((0.98, 10, 1.33), (0.95, 10, 1.5)), ((0.98, 10, None), (0.5, 1, None)),
    ):  # fmt: skip
        found[f"layers {parts}"] = tilted(layers_of(*parts))
    for parts in (
        ((0.9, 2, None), (0.5, 1, None)), ((0.98, 1, 1.33), (0.9, 1, 1.5)), ((0.98, 0.2, None), (0.95, 0.1, None)),
    ):  # fmt: skip
        found[f"R and T {parts}"] = balance_of(layers_of(*parts))
    return found


def print_others(chosen: str, arguments: argparse.Namespace) -> None:
    """Print rows of those whose names hold a text."""
    print("| | paths | coverage | warned | median error over scatter |\n|---|---|---|---|---|")
    for name, (run, places) in others().items():
        if chosen not in name:
            continue
        at = None
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", sg.DoubtWarning)
            if places is not None:
                value, _ = run(places, 20_000, 10**6)
                level = (value - np.nanmin(value)) / (1 - np.nanmin(value))
                at = np.array([places[np.nanargmin(np.abs(level - each))] for each in LEVELS])
            truth = np.mean([run(at, 200_000, 10**6 + 1 + n)[0] for n in range(arguments.truth)], axis=0)
        for paths in arguments.paths:
            values, errors, warned = [], [], []
            for seed in range(arguments.runs):
                with warnings.catch_warnings(record=True) as caught:
                    warnings.simplefilter("always", sg.DoubtWarning)
                    value, error = run(at, paths, seed)
                values.append(value)
                errors.append(error)
                warned.append(bool(caught))
            held = (np.abs(np.array(values) - truth) <= 1.96 * np.array(errors)).mean(axis=0)
            ratio = np.median(errors, axis=0) / np.std(values, axis=0)
            shown = (" ".join(f"{each:.2f}" for each in some) for some in (held, ratio))
            print(f"| {name} | {paths} | {next(shown)} | {np.mean(warned):.2f} | {next(shown)} |", flush=True)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("slabs", nargs="*", help="g,OD of slabs; by default all")
    parser.add_argument("--paths", type=int, nargs="+", default=PATHS)
    parser.add_argument("--runs", type=int, default=200)
    parser.add_argument("--truth", type=int, default=8, help="long runs of a million paths")
    parser.add_argument("--others", metavar="TEXT", help="curves whose names hold this, in place of slabs; '' for all")
    arguments = parser.parse_args()
    if arguments.others is not None:
        print_others(arguments.others, arguments)
        return
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
