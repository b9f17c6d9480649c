"""How often intervals of ``sg.fit_setup`` hold range, grain and contrast, from photographs of a known target.

    python scripts/setup_coverage.py run --out setups.csv [--by waves | package | slices] [--runs 100] [--seed 41]
        [--workers 2] [--seconds 1800]
    python scripts/setup_coverage.py table setups.csv
    python scripts/setup_coverage.py falls
    python scripts/setup_coverage.py bound

Each set is 1, 4 or 16 photographs of a letter behind new places of one slab; the letter reaches .4 to 4 ranges.
Grains of 2.5 to 4 pixels, three irises, noise of 0 to 10 %. Nothing of the fit is used to draw. They are drawn by

- ``waves``: 288 x 288 pixels under a Gaussian beam, here: waves of two points of the letter have sqrt(C_I) in common,
  C_I that of the slab by paths (seven slabs, from an exponential to a Gaussian fall);
- ``package``: the same, of the recipe ``through-slab`` with that slab, window and letter;
- ``slices``: 192 x 192 pixels. Every lit point is a plane wave of its own, which goes from slice to slice through a
  forward slab of random phase screens (:mod:`specklegen.oracles.multi_slice`), its envelope that of the slab's lobe,
  left in the file. One photograph takes some 5 processor seconds. The range is read off patterns behind other slabs.

``falls`` prints how far the form of C_I that is fitted stays from C_I of slabs by paths, up to twice their range.

``bound`` prints the least error of the grain of one such photograph, 5 % noise, iris known: Fisher's information of the
likelihood that is fitted, as if intensities were Gaussian, in grain, contrast, noise, and of a letter range, bend and
power; and the same where all but the grain is known.
"""

import argparse
import csv
import itertools
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import NamedTuple

import numpy as np
from _rows import write_rows
from scipy import fft
from scipy.optimize import least_squares
from scipy.stats import binomtest

import specklegen as sg
from specklegen.datasets import load_recipe
from specklegen.datasets.objects.family import ListedFamily, Source
from specklegen.memory_effects.correlation import MemoryEffectCorrelation, estimate_correlation
from specklegen.models.calibration import setup_fit
from specklegen.models.calibration.target_range import BOUNDS, Fall, decay, target_of
from specklegen.oracles.multi_slice import slice_coherence, slice_views
from specklegen.scene.window import Profile

SLABS = {
    "OD 10, g .9": (10.0, 0.9), "OD 20, g .8": (20.0, 0.8), "OD 40, g 0": (40.0, 0.0), "OD 10, g .98": (10.0, 0.98),
    "OD 5, g 0": (5.0, 0.0), "OD 15, g .95": (15.0, 0.95), "OD 8, g .7": (8.0, 0.7),
}  # fmt: skip
COUNTS, SIDE = (1, 4, 16), 288
_SAMPLES = SIDE + 80
LETTER = np.kron([[1, 1, 1], [1, 0, 0], [1, 1, 0], [1, 0, 0], [1, 0, 0]], np.ones((3, 3)))
HEAD = ("material", "photographs", "run", "truth", "range", "low", "high", "grain", "grain_truth", "envelope", "iris",
        "iris_truth", "p")  # fmt: skip


@cache
def _correlation(name: str) -> MemoryEffectCorrelation:
    depth, g = SLABS[name]
    slab = sg.Slab(thickness=1000.0, mean_free_path=1000.0 / depth, scatterer=sg.HenyeyGreenstein(g))
    return estimate_correlation(slab, 400_000, seed=5)


def photographs(
    rng: np.random.Generator, count: int, field_correlation: np.ndarray, grain: float, profile: str
) -> np.ndarray:
    """Photographs float64[count, SIDE, SIDE] of mean 1, the correlation of waves float64[n, n] between lit points."""
    points = np.argwhere(LETTER > 0)
    shares, modes = np.linalg.eigh(field_correlation)
    kept = shares > 1e-4 * shares.max()
    modes = modes[:, kept] * np.sqrt(shares[kept])
    side = _SAMPLES
    x = np.abs(np.fft.fftfreq(side)) * grain * 2
    iris = {
        "square": np.maximum(x[:, None], x) < 1, "disc": np.hypot(x[:, None], x) < 1,
        "gaussian": np.exp(-(x[:, None] ** 2 + x**2)),
    }[profile].astype(np.float32)  # fmt: skip
    found = np.zeros((count, SIDE, SIDE))
    for image in found:
        white = rng.standard_normal((modes.shape[1], side, side, 2), dtype=np.float32).view(np.complex64)[..., 0]
        waves = fft.ifft2(iris * white, overwrite_x=True).reshape(len(white), -1)
        for (y, x0), wave in zip(points, modes.astype(np.float32) @ waves, strict=True):
            at = wave.reshape(side, side)[LETTER.shape[0] - y :, LETTER.shape[1] - x0 :][:SIDE, :SIDE]
            image += at.real**2 + at.imag**2
        image /= image.mean()
    return found


class Drawn(NamedTuple):
    """Photographs of a letter before noise.

    Attributes
    ----------
    light : float64[count, side, side]
        Of mean 1 where the envelope is.
    truth, grain : float
        Memory-effect range and grain, pixels.
    envelope : float64[side, side]
        What is left to be found of it.
    """

    light: np.ndarray
    truth: float
    grain: float
    envelope: np.ndarray


class Set(NamedTuple):
    """What is asked of those who draw: the number of a slab, of photographs, and the set's own numbers."""

    slab: int
    count: int
    profile: Profile
    grain: float
    extent: float
    seed: int


def by_waves(rng: np.random.Generator, asked: Set) -> Drawn:
    """Draw waves of points that have sqrt(C_I) in common."""
    correlation = _correlation(list(SLABS)[asked.slab])
    grain = _SAMPLES / (2 * round((_SAMPLES / asked.grain - 1) / 2) + 1)  # an odd number of samples: edges and all
    truth = max(LETTER.shape) / asked.extent
    half = _half(correlation)
    points = np.argwhere(LETTER > 0)
    apart = np.hypot(*(points[:, None] - points[None]).transpose(2, 0, 1)) / truth * half
    c_i = np.interp(apart, np.linspace(0, apart.max() + 1e-9, 500), _curve(correlation, apart.max() + 1e-9))
    light, beam = photographs(rng, asked.count, np.sqrt(c_i), grain, asked.profile), _beam(rng)
    return Drawn(beam * light, truth, grain, beam)


def _beam(rng: np.random.Generator) -> np.ndarray:
    line = np.linspace(-1, 1, SIDE) * rng.uniform(0, 1)
    return np.exp(-np.square(line)[:, None] - np.square(line))


class Letter(ListedFamily):
    """The letter, as a family of objects."""

    def sources(self) -> tuple[Source, ...]:
        """As many as splits need."""
        return tuple((str(n),) for n in range(20))

    def picture(self, source: Source, rng: np.random.Generator) -> np.ndarray:  # noqa: ARG002
        """It never changes."""
        return np.asarray(LETTER, np.float64)


def by_package(rng: np.random.Generator, asked: Set) -> Drawn:
    """Draw as the recipe ``through-slab`` does."""
    name = list(SLABS)[asked.slab]
    depth, g = SLABS[name]
    truth, wavelength = max(LETTER.shape) / asked.extent, 0.5
    pitch = _half(_correlation(name)) * wavelength / (2 * np.pi) / truth  # direction sine of a pixel
    recipe = load_recipe("through-slab", {
        "media": "new", "sampler": "stationary",
        "material": {"wavelength": wavelength, "thickness": 1000.0, "optical_depth": depth, "g": g},
        "window": {"width": wavelength / pitch / asked.grain, "profile": asked.profile},
        "camera": {"shape": [SIDE, SIDE], "pixels_per_grain": asked.grain},
        "field": {"pitch": pitch, "extent_over_range": None},
        "objects": {"type": "Letter", "shape": list(LETTER.shape)},
    })  # fmt: skip
    light = np.asarray(recipe.batch(asked.seed, "train", range(asked.count))["image"], np.float64)
    beam = _beam(rng)
    return Drawn(beam * light, truth, asked.grain, beam)


GRID = {"wavelength": 1.0, "pitch": 1.0, "size": 448}
SLICED, DEPTHS, TRANSPORT = 192, (4.0, 6.0), 0.0133  # pixels a side; optical depths; thickness in transport lengths
_THIN = 100.0  # wavelengths
_VIEWS = np.arange(-SLICED // 2, SLICED // 2)
_APART = range(0, 27, 2)  # bins


@cache
def _sliced(slab: int) -> tuple[float, float]:
    """Of a slab _THIN thick: its optical depth, and the range in bins of the grid, by waves through four others.

    What correlates over all of the camera, less than on its axis: light far aside was scattered more often.
    """
    low, high = DEPTHS
    depth = low + (high - low) * slab / (len(SLABS) - 1)
    medium, iris = _forward(_THIN, depth), _iris("square", 3.0)
    mean, joint = _lobe(medium, iris)[np.ix_(_VIEWS, _VIEWS)], np.zeros(len(_APART))
    for seed in range(900, 904):
        seen = np.array([each[np.ix_(_VIEWS, _VIEWS + x)] for x, each in zip(
            _APART, _patterns(medium, [(x, 0) for x in _APART], iris, seed), strict=True)]) / mean  # fmt: skip
        left = seen / seen.mean((1, 2), keepdims=True) - 1
        joint += (left[0] * left).mean((1, 2))
    return depth, float(np.interp(-0.5, -joint / joint[0], _APART))


def _forward(thickness: float, depth: float) -> sg.Slab:
    lobe = sg.VonMisesFisher(depth / TRANSPORT)
    return sg.Slab(thickness=thickness, mean_free_path=thickness / depth, scatterer=lobe)


def _iris(profile: Profile, grain: float) -> np.ndarray:
    size = GRID["size"]
    x = (np.arange(size) - size // 2) / size * grain
    r2 = np.add.outer(x**2, x**2)
    shape = {
        "square": np.maximum.outer(np.abs(x), np.abs(x)) < 0.5, "disc": r2 < 0.25, "gaussian": np.exp(-4 * r2),
    }[profile]  # fmt: skip
    return shape.astype(np.float32)


def _patterns(slab: sg.Slab, points: list[tuple[int, int]], iris: np.ndarray, seed: int) -> Iterator[np.ndarray]:
    """Brightness of all views of each point, without the light that was not scattered: float32[size, size]."""
    (fields,) = slice_views(slab, bins=points, seed=seed, **GRID)
    for field, (x, y) in zip(fields, points, strict=True):
        field[y, x] = 0
        yield np.square(np.abs(np.asarray(fft.fft2(np.asarray(fft.ifft2(field)) * iris))))


def by_slices(rng: np.random.Generator, asked: Set) -> Drawn:  # noqa: ARG001
    """Let every lit point's wave go from slice to slice through a slab, and add intensities."""
    truth = max(LETTER.shape) / asked.extent
    depth, reach = _sliced(asked.slab)
    slab, iris = _forward(_THIN * reach / truth, depth), _iris(asked.profile, asked.grain)
    points = [(int(x), int(y)) for y, x in np.argwhere(LETTER > 0) - np.array(LETTER.shape) // 2]
    seen = np.ix_(_VIEWS, _VIEWS)
    light = np.array([sum(each[seen].astype(float) for each in _patterns(slab, points, iris, asked.seed + n))
                      for n in range(asked.count)])  # fmt: skip
    brightness = _lobe(slab, iris)
    mean = np.sum([brightness[np.ix_(_VIEWS - y, _VIEWS - x)] for x, y in points], axis=0)
    return Drawn(light / light.mean(), truth, asked.grain, mean / mean.mean())


def _lobe(slab: sg.Slab, iris: np.ndarray) -> np.ndarray:
    """Mean brightness of all views of light straight ahead: the lobe's coherence times the iris' own, transformed."""
    overlap = np.asarray(fft.ifft2(np.square(np.abs(fft.fft2(iris.astype(np.float64)))))).real
    return np.asarray(fft.fft2(slice_coherence(slab, **GRID) * overlap)).real


DRAWN = {"waves": by_waves, "package": by_package, "slices": by_slices}


def one(task: tuple[str, int, str, int, int]) -> list:
    """A line of the table."""
    by, seed, name, count, run = task
    rng = np.random.default_rng([seed, list(SLABS).index(name), count, run])
    profile: Profile = ("square", "disc", "gaussian")[rng.integers(3)]
    grain = _SAMPLES / (2 * rng.integers(46, 74) + 1)
    extent, noise = np.exp(rng.uniform(np.log(0.4), np.log(4))), rng.uniform(0, 0.1)
    own = int(np.random.default_rng([seed, list(SLABS).index(name), count, run, 1]).integers(2**31))
    asked = Set(list(SLABS).index(name), count, profile, grain, extent, own)
    drawn = DRAWN[by](rng, asked)
    light = drawn.light + drawn.envelope * noise * rng.normal(size=drawn.light.shape)
    fit = sg.fit_setup(light.clip(1e-9), target=LETTER, pixel_integration=False)
    low, high = fit.interval(0.95)["range"]
    shape = fit.measured.envelope
    ratio = np.broadcast_to(shape if shape is not None else 1.0, drawn.envelope.shape) / drawn.envelope
    off = float((ratio / ratio.mean()).std())
    numbers = [drawn.truth, fit.range, low, high, fit.grain, drawn.grain, off]
    return [name, count, run, *(f"{x:.5g}" for x in numbers), fit.profile, profile, f"{fit.p_value:.3g}"]


def _curve(correlation: MemoryEffectCorrelation, most: float) -> np.ndarray:
    return np.asarray(correlation.intensity(np.linspace(0, most, 500))[0]).clip(0, 1)


def _half(correlation: MemoryEffectCorrelation) -> float:
    """Sine at which C_I is one half."""
    sines = np.geomspace(0.1, 10, 400) * correlation.half_range()
    return float(np.interp(-0.5, -correlation.intensity(sines)[0], sines))


def falls() -> str:
    """What the fitted form leaves of C_I of slabs, in Markdown."""
    lines = ["| optical depth, g | C_I off, largest | range off, % | bend, power |", "|---|---|---|---|"]
    apart = np.linspace(0.05, 2, 40)
    low, high = np.array([*BOUNDS, (-0.3, 0.3)]).T
    for depth, g in itertools.product((3.0, 5.0, 8.0, 10.0, 15.0, 20.0, 40.0), (0.0, 0.5, 0.8, 0.9, 0.95, 0.98)):
        slab = sg.Slab(thickness=1000.0, mean_free_path=1000.0 / depth, scatterer=sg.HenyeyGreenstein(g))
        correlation = estimate_correlation(slab, 200_000, seed=5)
        seen = np.asarray(correlation.intensity(apart * _half(correlation))[0])

        def off(at: np.ndarray, seen: np.ndarray = seen) -> np.ndarray:
            return decay(apart * np.exp(at[2]), Fall(np.exp(at[0]), at[1])) - seen

        starts = ([np.log(bend), power, 0.0] for bend, power in ((0.3, 1.0), (1.0, 1.0), (2.0, 0.5)))
        best = min((least_squares(off, start, bounds=(low, high)) for start in starts), key=lambda found: found.cost)
        lines.append(f"| {depth:g}, {g:g} | {np.abs(best.fun).max():.3f} | {100 * np.expm1(-best.x[2]):+.1f} "
                     f"| {np.exp(best.x[0]):.2f}, {best.x[1]:.2f} |")  # fmt: skip
    return "\n".join(lines)


def bound() -> str:
    """Least error of the grain of one photograph, in Markdown."""
    frame = np.random.default_rng(0).exponential(size=(1, SIDE, SIDE)) - 1  # only its size counts
    shown = {"a point": setup_fit._POINT, **{
        f"the letter, of {extent:g} ranges": target_of("bound target", LETTER, 1.0).behind(15 / extent, Fall(1.0, 1.0))
        for extent in (0.7, 1.5)
    }}  # fmt: skip
    lines = ["| grain, iris | " + " | ".join(f"{name}: all unknown, grain alone" for name in shown) + " |",
             "|---" * (1 + len(shown)) + "|"]  # fmt: skip
    for grain, profile in itertools.product((2.5, 3.2, 4.0), ("square", "disc", "gaussian")):
        cells = []
        for target in shown.values():
            tiles = setup_fit._tiles(frame, 0.6 * grain, target)
            spectrum = setup_fit._alone(tiles, profile, np.log(grain), False) + 0.05**2
            at = setup_fit._Fitted(profile, float(np.log(grain)), 1.0, 0.05**2, spectrum, 0.0)
            slopes = setup_fit._slopes(tiles, at, False)
            information = len(tiles.power) * slopes @ slopes.T
            least = np.linalg.pinv(information, hermitian=True)[0, 0] ** 0.5, information[0, 0] ** -0.5
            cells.append(" ".join(f"{100 * each:.2f} %" for each in least))
        lines.append(f"| {grain:g}, {profile} | " + " | ".join(cells) + " |")
    return "\n".join(lines)


def table(file: Path) -> str:
    """What the lines say, in Markdown."""
    with file.open() as read:
        rows = list(csv.DictReader(read))
    lines = ["| photographs, slab | sets | range held (95 %) | open above | ln(range) off, rms | grain off, rms % | "
             "envelope off, median % | iris right |", "|---|---|---|---|---|---|---|---|"]  # fmt: skip
    groups = {f"{count}, all slabs": [row for row in rows if row["photographs"] == str(count)] for count in COUNTS}
    groups |= {f"all, {name}": [row for row in rows if row["material"] == name] for name in SLABS} | {"all": rows}
    for name, own in groups.items():
        if own:
            number = {key: np.array([float(row[key]) for row in own])
                      for key in ("truth", "range", "low", "high", "grain", "grain_truth", "envelope")}  # fmt: skip
            held = (number["low"] <= number["truth"]) & (number["truth"] <= number["high"])
            closed = np.isfinite(number["high"]) & (number["low"] > 0)
            off = np.log(number["range"] / number["truth"])[closed]
            low, high = binomtest(int(held.sum()), len(own)).proportion_ci(method="wilson")
            open_above = np.isinf(number["high"]).sum()
            wrong = 100 * (number["grain"] / number["grain_truth"] - 1)
            right = sum(row["iris"] == row["iris_truth"] for row in own)
            lines.append(
                f"| {name} | {len(own)} | {held.mean():.3f} ({low:.2f} to {high:.2f}) | {open_above} "
                f"| {np.sqrt(np.square(off).mean()):.3f} | {np.sqrt(np.square(wrong).mean()):.2f} "
                f"| {100 * np.median(number['envelope']):.1f} | {right} |"
            )
    return "\n".join(lines)


def main() -> None:
    """Read the command line."""
    asked = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    asked.add_argument("task", choices=("run", "table", "falls", "bound"))
    asked.add_argument("file", nargs="?", type=Path)
    asked.add_argument("--out", type=Path, default=Path("setups.csv"))
    asked.add_argument("--by", choices=tuple(DRAWN), default="waves")
    asked.add_argument("--runs", type=int, default=100)
    asked.add_argument("--seed", type=int, default=41)
    asked.add_argument("--workers", type=int, default=2)
    asked.add_argument("--seconds", type=float, default=1e9)
    given = asked.parse_args()
    if given.task == "table":
        print(table(given.file or given.out))
        return
    if given.task in ("falls", "bound"):
        print(falls() if given.task == "falls" else bound())
        return
    names = list(SLABS)
    sets = [(names[run % len(names)], count, run) for run in range(given.runs) for count in COUNTS]
    tasks = [(given.by, given.seed, *each) for each in sets]
    write_rows(one, tasks, given.out, given.workers, given.seconds, HEAD)
    print(table(given.out))


if __name__ == "__main__":
    main()
