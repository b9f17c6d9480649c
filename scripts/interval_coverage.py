"""How often 1.96 standard errors of memory effects hold the truth (tables of docs/notes/trust.md).

    python scripts/interval_coverage.py --paths 4000 16000         # every slab: an hour of one core
    python scripts/interval_coverage.py "g 0.98, OD 20" temporal   # the curves whose names hold one of these texts

Of each curve 200 runs, at four tilts or lags: where C is 0.99, 0.9, 0.5 and 0.1 of the way from 1 to its floor. The
truth is the mean of other, longer runs. ``warned`` is the share of runs that issue a DoubtWarning; behind "unwarned"
stand the runs that issue none, where these are a fifth at least. The last column is the median standard error over the
scatter.
"""

import argparse
import warnings
from collections.abc import Callable
from functools import partial

import numpy as np

import specklegen as sg

LEVELS = (0.99, 0.9, 0.5, 0.1)
THICKNESS = 100.0
WAVELENGTH = 1e-5  # so short that tilts are small beside every phase function
Run = Callable[[np.ndarray | None, int, int], tuple[np.ndarray, np.ndarray]]
"""Values and standard errors at places, of a number of paths, under a seed."""


def layers_of(*parts: tuple[float, float, float | None]) -> sg.Layers:
    """Make layers of g, optical depth and index."""
    share = THICKNESS / len(parts)
    return sg.Layers([
        sg.media.Layer(thickness=share, mean_free_path=share / depth, scatterer=sg.media.HenyeyGreenstein(g), index=n)
        for g, depth, n in parts
    ])  # fmt: skip


def curve_of(verb: Callable, name: str, places: np.ndarray, medium, **options) -> tuple[Run, np.ndarray]:
    """Return a run of a curve, and places to choose from."""

    def run(at: np.ndarray | None, paths: int, seed: int) -> tuple[np.ndarray, np.ndarray]:
        curve = verb(medium, wavelength=WAVELENGTH, paths=paths, seed=seed, threads=1, **{name: at}, **options)
        return curve.intensity, curve.standard_error

    return run, places


def balance_of(medium) -> tuple[Run, None]:
    """Return a run of R and T."""

    def run(_: np.ndarray | None, paths: int, seed: int) -> tuple[np.ndarray, np.ndarray]:
        made = sg.statistics.reflectance_transmittance(medium, paths=paths, seed=seed, threads=1)
        return (np.array([made.reflectance, made.transmittance]),
                np.array([made.reflectance_error, made.transmittance_error]))  # fmt: skip

    return run, None


def curves() -> dict[str, tuple[Run, np.ndarray | None]]:
    """Return runs by name: slabs; polarised light, reversed paths, time, layers that refract; R and T of layers."""
    k = 2 * np.pi / WAVELENGTH
    tilts, lags = np.geomspace(1e-2, 1e3, 50) / (k * THICKNESS), np.geomspace(1e-6, 1e2, 50) / k**2
    tilted = partial(curve_of, sg.memory_effect, "tilts", tilts)
    later = partial(curve_of, sg.statistics.temporal_correlation, "lags", lags)
    back, moving = {"mode": "reflection", "view": [0, 0, -1.0], "reverse": True}, sg.media.Brownian(diffusion=1.0)
    made = {}
    for g, depth in ((g, depth) for g in (0.9, 0.95, 0.98, 0.99) for depth in (5, 10, 20, 50)):
        name, scatterer = f"g {g:g}, OD {depth}", sg.media.HenyeyGreenstein(g)
        slab = sg.Slab(thickness=THICKNESS, mean_free_path=THICKNESS / depth, scatterer=scatterer)
        made[name] = tilted(slab)
        if (g, depth) not in ((0.9, 10), (0.95, 20), (0.98, 20)):
            continue
        polarised = slab.replace(polarisation="projector")
        made |= {f"{channel} {name}": tilted(polarised, channel=channel) for channel in ("co", "crossed", "circular")}
        made[f"sent back, co {name}"] = tilted(polarised, channel="co", mode="reflection")
        made[f"reversed {name}"] = tilted(slab, **back)
        made[f"temporal {name}"] = later(slab.replace(motion=moving))
        made[f"temporal, sent back {name}"] = later(slab.replace(motion=moving), mode="reflection")
        made[f"temporal, co {name}"] = later(polarised.replace(motion=moving), channel="co")
    for parts in (
        ((0.9, 5, 1.33), (0.7, 5, 1.5)), ((0.98, 10, 1.33), (0.95, 10, 1.5)), ((0.98, 10, None), (0.5, 1, None)),
    ):  # fmt: skip
        made[f"layers {parts}"] = tilted(layers_of(*parts))
    for parts in (
        ((0.9, 2, None), (0.5, 1, None)), ((0.98, 1, 1.33), (0.9, 1, 1.5)), ((0.98, 0.2, None), (0.95, 0.1, None)),
    ):  # fmt: skip
        made[f"R and T {parts}"] = balance_of(layers_of(*parts))
    return made


def row(run: Run, at: np.ndarray | None, truth: np.ndarray, paths: int, runs: int) -> str:
    """Return the cells of one curve and number of paths."""
    values, errors, warned = [], [], np.empty(runs, bool)
    for seed in range(runs):
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always", sg.DoubtWarning)
            value, error = run(at, paths, seed)
        values.append(value)
        errors.append(error)
        warned[seed] = bool(caught)
    is_held = np.abs(np.array(values) - truth) <= 1.96 * np.array(errors)
    shares = [is_held] + ([is_held[~warned]] if 0.2 <= 1 - warned.mean() < 1 else [])
    text = "; unwarned ".join(" ".join(f"{share:.2f}" for share in some.mean(axis=0)) for some in shares)
    ratios = " ".join(f"{ratio:.2f}" for ratio in np.median(errors, axis=0) / np.std(values, axis=0))
    return f"{paths} | {text} | {warned.mean():.2f} | {ratios}"


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("names", nargs="*", help="texts; by default the slabs; '' for all")
    parser.add_argument("--paths", type=int, nargs="+", default=[4000])
    parser.add_argument("--runs", type=int, default=200)
    parser.add_argument("--truth", type=int, nargs=2, default=(8, 10**6), help="runs and their paths")
    asked = parser.parse_args()
    print("| | paths | coverage | warned | median error over scatter |\n|---|---|---|---|---|")
    for name, (run, places) in curves().items():
        if not (any(text in name for text in asked.names) if asked.names else name.startswith("g ")):
            continue
        runs, long = asked.truth
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", sg.DoubtWarning)
            at = None
            if places is not None:
                value, _ = run(places, long // 10, 10**6)
                level = (value - np.nanmin(value)) / (1 - np.nanmin(value))
                at = np.array([places[np.nanargmin(np.abs(level - each))] for each in LEVELS])
            truth = np.mean([run(at, long, 10**6 + 1 + n)[0] for n in range(runs)], axis=0)
        for paths in asked.paths:
            print(f"| {name} | {row(run, at, truth, paths, asked.runs)} |", flush=True)


if __name__ == "__main__":
    main()
