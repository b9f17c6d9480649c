"""Images of a row of beads, and tilt stacks, as figures/why.py trains networks on them and judges them.

An image comes from this package's stream, from a speckle pattern moved with every point (convolution), or, to judge
by, from waves that go through a slab slice by slice (:mod:`specklegen.oracles.multi_slice`) and know of no sampler.
Lengths are in wavelengths. One bin, 1 / 192 in direction sine, is a pixel of the camera, half a grain, and a pixel of
the row.
"""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
from scipy.ndimage import gaussian_filter

import specklegen as sg
from specklegen.datasets import load_recipe
from specklegen.memory_effects.correlation import estimate_correlation
from specklegen.oracles.multi_slice import slice_views

DIAMETERS = (2, 3, 4, 6)  # of the beads, bins
FIELD, CAMERA, SIDE = 32, 64, 192  # bins of the row and of the camera; bins in a sine of 1: the waves' grid is as wide
LAGS = 3, 25  # of the autocorrelation, across the row and along it
TILTS = 2 * np.arange(6)  # bins
DEPTHS, LOBES, THICKNESSES = (5.0, 8.0), (230.0, 700.0), (40.0, 400.0)  # drawn slabs: all within the waves' domain
RANGES = 1.0, 30.0  # bins: of patterns that a curve by hand makes
GRID = {"wavelength": 1.0, "pitch": 2 / 3, "size": 288}
_VIEWS = np.arange(-CAMERA // 2, CAMERA // 2)
_WINDOW = np.zeros((GRID["size"], GRID["size"]), bool)
_WINDOW[72:216, 72:216] = True  # half as wide as the grid, so that a grain is two bins
_BENCH = {
    "mode_tolerance": 0.001, "sampler": "stationary", "window": {"width": SIDE / 2.0},
    "camera": {"shape": [CAMERA, CAMERA], "pixels_per_grain": 2.0},
}  # fmt: skip


def slab(thickness: float, depth: float = 8.0, lobe: float = 240.0) -> sg.Slab:
    """Slab of forward scatterers."""
    return sg.Slab(thickness=thickness, mean_free_path=thickness / depth, scatterer=sg.media.VonMisesFisher(lobe))


def row(rng: np.random.Generator, diameter: int) -> np.ndarray:
    """Beads of one diameter with gaps of random lengths between them, as long on average; float32[FIELD]."""
    beads = np.zeros(FIELD + 40, np.float32)
    place = int(rng.integers(0, 2 * diameter))
    while place < FIELD + 20:
        beads[place : place + diameter] = 1
        place += diameter + 1 + int(rng.exponential(diameter))
    found = beads[20 : 20 + FIELD]
    return found if found.any() else row(rng, diameter)


def lags(image: np.ndarray) -> np.ndarray:
    """Autocorrelation of an image about its smooth brightness, without its peak; float32[3 * 25 - 1]."""
    seen = image / gaussian_filter(image, 12.0, mode="nearest")
    seen = seen - seen.mean()
    power = np.square(np.abs(np.fft.rfft2(seen, (2 * CAMERA, 2 * CAMERA))))
    found = np.fft.irfft2(power)
    rows, columns = LAGS
    both = (found[:rows, :columns] + found[:rows, -np.arange(columns)]) / 2
    y, x = np.arange(rows)[:, None], np.arange(columns)
    return (both / both[0, 0] / ((1 - y / CAMERA) * (1 - x / CAMERA))).ravel()[1:].astype(np.float32)


def of_the_stream(folder: Path, thickness: float, seed: int, count: int) -> Iterator[tuple[np.ndarray, int]]:
    """Images of this package's recipe of the slab and what class each is; a new medium each, rows from ``folder``."""
    material = {"wavelength": 1.0, "thickness": thickness, "optical_depth": 8.0, "kernel_paths": 20_000,
                "scatterer": {"type": "VonMisesFisher", "concentration": 240.0}}  # fmt: skip
    objects = {"type": "Folder", "shape": [1, FIELD], "path": str(folder)}
    pitch = {"pitch": 1 / SIDE, "extent_over_range": None}
    recipe = load_recipe("through-slab", _BENCH | {
        "media": "new", "material": material, "objects": objects, "field": pitch})  # fmt: skip
    for start in range(0, count, 50):
        batch = recipe.batch(seed, "train", range(start, min(start + 50, count)))
        yield from zip(batch["image"], batch["parameters"]["label"].astype(int), strict=True)


def keep_rows(folder: Path, seed: int, count: int) -> None:
    """Write rows for the stream, a subfolder for each class; of a bead's end alone nobody can tell whose it is."""
    rng, classes = np.random.default_rng([seed, 1]), {}
    for number, diameter in enumerate(DIAMETERS):
        (folder / str(number)).mkdir(parents=True)
        for n in range(count):
            found = row(rng, diameter)
            while classes.setdefault(found.tobytes(), number) != number:
                found = row(rng, diameter)
            np.save(folder / str(number) / f"{n}.npy", found[None])


def pattern(rng: np.random.Generator, count: int = 1) -> np.ndarray:
    """Speckle behind a square window, two pixels a grain, float[count, CAMERA, CAMERA + FIELD]."""
    side = CAMERA + FIELD
    field = np.zeros((count, side, side), np.complex64)
    field[:, : side // 2, : side // 2] = _normal(rng, count, side // 2, side // 2)
    return np.square(np.abs(np.fft.ifft2(field)))[:, :CAMERA] * side**2


def _normal(rng: np.random.Generator, *shape: int) -> np.ndarray:
    real, imaginary = rng.standard_normal((2, *shape), dtype=np.float32)
    return real + 1j * imaginary


def by_convolution(kind: str, seed: int) -> Iterator[tuple[np.ndarray, int]]:
    """Images without end: a "fresh" pattern each, "one" pattern for all, or an "independent" one for every point."""
    rng = np.random.default_rng([seed, 2])
    kept = pattern(rng)[0]
    while True:
        number = int(rng.integers(len(DIAMETERS)))
        points = row(rng, DIAMETERS[number])
        if kind == "independent":
            lit = np.flatnonzero(points)
            yield pattern(rng, len(lit))[:, :, :CAMERA].sum(0), number
            continue
        moved = np.lib.stride_tricks.sliding_window_view(pattern(rng)[0] if kind == "fresh" else kept, FIELD, axis=1)
        yield moved[:, :CAMERA] @ points, number


def by_waves(thickness: float, seed: int, count: int) -> list[tuple[np.ndarray, int]]:
    """Images of ``count`` rows, classes in turn, through one medium, point by point."""
    rng = np.random.default_rng([seed, 3])
    bins = [(n - FIELD // 2, 0) for n in range(FIELD)]
    (fields,) = slice_views(slab(thickness), bins=bins, seed=seed, **GRID)
    patterns = np.array([_seen(field, *place) for field, place in zip(fields, bins, strict=True)])
    numbers = np.arange(count) % len(DIAMETERS)
    return [(np.tensordot(row(rng, DIAMETERS[n]), patterns, axes=1), int(n)) for n in numbers]


def _seen(field: np.ndarray, x: int, y: int) -> np.ndarray:
    """What a camera sees of a transform, behind a window and without the light that was not scattered."""
    field[y, x] = 0
    inside = np.fft.fft2(np.fft.ifft2(field) * _WINDOW)
    return np.square(np.abs(inside[np.ix_(_VIEWS, _VIEWS)]))


def registered(stack: np.ndarray, along: int) -> np.ndarray:
    """Correlations of images moved over one another, as tilts move them, and a pixel beside; float32[3 * (T - 1)].

    ``along`` is the way, 1 or -1, that a pattern goes with its tilt.
    """
    seen = np.array([image / gaussian_filter(image, 12.0, mode="nearest") for image in stack])
    found = []
    for gap in range(1, len(stack)):
        for beside in (-1, 0, 1):
            shift = int(TILTS[gap]) * along + beside
            one, other = seen[:-gap, :, max(0, -shift) : CAMERA - max(0, shift)], seen[gap:, :, max(0, shift) :]
            other = other[:, :, : one.shape[2]]
            one, other = (x - x.mean((1, 2), keepdims=True) for x in (one, other))
            norm = np.sqrt(np.square(one).mean((1, 2)) * np.square(other).mean((1, 2)))
            found.append(((one * other).mean((1, 2)) / norm).mean())
    return np.array(found, np.float32)


def stacks_of_the_stream(seed: int, count: int) -> Iterator[tuple[np.ndarray, tuple[float, float]]]:
    """Tilt stacks of drawn slabs, with log10 of the range in bins and of the thickness."""
    material = {"wavelength": 1.0, "thickness": {"log_uniform": list(THICKNESSES)}, "kernel": "atlas",
                "optical_depth": {"uniform": list(DEPTHS)},
                "scatterer": {"type": "VonMisesFisher", "concentration": {"log_uniform": list(LOBES)}}}  # fmt: skip
    tilts = {"count": len(TILTS), "step": float(np.arcsin(TILTS[1] / SIDE))}
    recipe = load_recipe("tilt-stack", _BENCH | {"material": material, "tilts": tilts})
    for start in range(0, count, 50):
        batch = recipe.batch(seed, "train", range(start, min(start + 50, count)))
        told = batch["parameters"]
        wide = np.log10(np.sin(told["memory_effect_range"]) * SIDE)
        yield from zip(batch["stack"], zip(wide, np.log10(told["thickness"]), strict=True), strict=True)


def stacks_by_a_curve(seed: int) -> Iterator[tuple[np.ndarray, tuple[float, float]]]:
    """Tilt stacks without end whose C_I is 2^-(tilt / range)^2, as one would write by hand; no slab is behind them."""
    rng = np.random.default_rng([seed, 4])
    side, apart = CAMERA + FIELD, TILTS[:, None] - TILTS
    while True:
        wide = float(np.exp(rng.uniform(*np.log(RANGES))))
        factor = np.linalg.cholesky(2.0 ** (-np.square(apart / wide) / 2) + 1e-6 * np.eye(len(TILTS)))
        field = np.zeros((len(TILTS), side, side), np.complex64)
        field[:, : side // 2, : side // 2] = np.tensordot(factor, _normal(rng, len(TILTS), side // 2, side // 2), 1)
        images = np.square(np.abs(np.fft.ifft2(field)))[:, :CAMERA]
        moved = [image[:, FIELD - tilt : FIELD - tilt + CAMERA] for image, tilt in zip(images, TILTS, strict=True)]
        yield np.array(moved), (np.log10(wide), np.nan)


def stack_by_waves(seed: int) -> tuple[np.ndarray, tuple[float, float]]:
    """One tilt stack of a drawn slab; its range is that of this package's paths, its thickness is its own."""
    rng = np.random.default_rng([seed, 5])
    (low, high), (few, most) = np.log(THICKNESSES), np.log(LOBES)
    thickness, depth, lobe = np.exp(rng.uniform(low, high)), rng.uniform(*DEPTHS), np.exp(rng.uniform(few, most))
    medium = slab(float(thickness), float(depth), float(lobe))
    bins = [(int(tilt), 0) for tilt in TILTS]
    (fields,) = slice_views(medium, bins=bins, seed=seed, **GRID)
    images = np.array([_seen(field, *place) for field, place in zip(fields, bins, strict=True)])
    half = estimate_correlation(medium, 20_000, seed).half_range()
    return images, (float(np.log10(half / (2 * np.pi) * SIDE)), float(np.log10(medium.thickness)))
