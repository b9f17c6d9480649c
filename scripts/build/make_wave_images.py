"""Images of the benchmark's task "waves": writes models/data/waves.npz, in some five processor minutes.

Run it by itself: python scripts/build/make_wave_images.py [--out FILE]

Every lit pixel of an object is a plane wave of its own that goes from slice to slice through a slab of random phase
screens (:mod:`specklegen.oracles.multi_slice`); intensities are added. None of the samplers that draw this package's
data is asked: no path, no memory-effect curve. Behind each of 24 slabs are seen a character and a drawn shape. One bin
of the waves' transform, 1 / 256 in direction sine, is a pixel of the camera, half a grain, and a pixel of the object.

The camera sees the light of a square window half as wide as the grid, without what was not scattered, over the mean
brightness that the slab's lobe gives straight ahead (:func:`envelope`), as one who takes a flat field would; of an
object aside of the axis a slope is left. Images are normalised to mean 1 and kept in 65535 steps up to their maximum.
"""

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")

import argparse
from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy.fft import fft2

import specklegen as sg
from specklegen.datasets import load_recipe
from specklegen.datasets.objects import ObjectFamily
from specklegen.datasets.recipes.hidden_object import centre_of
from specklegen.memory_effects.correlation import estimate_correlation
from specklegen.models.judging.tasks import SEED
from specklegen.models.judging.waves import CHANGES
from specklegen.oracles.multi_slice import slice_coherence, slice_views

OUT = Path("models/data/waves.npz")
SLABS, CAMERA, SIDE = 24, 96, 28
GRID = {"wavelength": 1.0, "pitch": 1.0, "size": 256}
PITCH = 1 / 256  # direction sine of a bin
EXTENTS = 0.25, 3.0  # of objects over the memory-effect range, one slab after the other, evenly in the logarithm
DEPTHS, TRANSPORT = (4.0, 6.0), (0.011, 0.0155)  # optical depth; over transport mean free paths: the grid holds it
WINDOW = 128  # wavelengths
_PATHS = 100_000  # for the range that a thickness is chosen by


class Drawn(NamedTuple):
    """A slab, and the extent of the objects behind it over its memory-effect range."""

    slab: sg.Slab
    extent: float


def drawn_slab(number: int, seed: int = SEED) -> Drawn:
    """One of the slabs; its thickness follows from the range, which goes with its inverse."""
    rng = np.random.default_rng([seed, 4, number])
    depth, transport = rng.uniform(*DEPTHS), rng.uniform(*TRANSPORT)
    low, high = np.log(EXTENTS)
    extent = float(np.exp(low + (high - low) * (number + rng.random()) / SLABS))
    thin = slab(100.0, depth, depth / transport)
    reach = estimate_correlation(thin, _PATHS, 0, threads=1).half_range() / (2 * np.pi)
    return Drawn(slab(float(100.0 * reach * extent / (SIDE * PITCH)), depth, depth / transport), extent)


def slab(thickness: float, depth: float, concentration: float) -> sg.Slab:
    """Slab of forward scatterers."""
    scatterer = sg.media.VonMisesFisher(concentration)
    return sg.Slab(thickness=thickness, mean_free_path=thickness / depth, scatterer=scatterer)


def mean_light(medium: sg.Slab) -> np.ndarray:
    """Mean intensity of all bins for light straight ahead, float64[size, size]; of other light it is moved."""
    coherence = slice_coherence(medium, **GRID)
    away = np.abs(np.fft.fftfreq(GRID["size"], 1 / GRID["size"]))
    overlap = np.clip(WINDOW - away, 0, None)
    return np.asarray(fft2(coherence * overlap * overlap[:, None])).real


def envelope(medium: sg.Slab) -> np.ndarray:
    """Mean intensity of the camera's pixels for light straight ahead, over their mean: float64[CAMERA, CAMERA]."""
    mean = mean_light(medium)[np.ix_(_views(), _views())]
    return mean / mean.mean()


def _views() -> np.ndarray:
    return np.arange(-CAMERA // 2, CAMERA // 2)


def patterns(medium: sg.Slab, lit: np.ndarray, seed: int, tilt: int = 0) -> np.ndarray:
    """Return the camera's view of each lit pixel, bool[SIDE, SIDE], alone: float64[N, CAMERA, CAMERA].

    Light and camera turn together by ``tilt`` bins.
    """
    rows, columns = np.nonzero(lit)
    places = [(int(x) - SIDE // 2 + tilt, int(y) - SIDE // 2) for y, x in zip(rows, columns, strict=True)]
    (fields,) = slice_views(medium, bins=places, seed=seed, **GRID)
    size, seen = GRID["size"], np.empty((len(places), CAMERA, CAMERA))
    inside = np.zeros((size, size), np.float32)
    edge = (size - WINDOW) // 2
    inside[edge : edge + WINDOW, edge : edge + WINDOW] = 1
    for n, (field, (x, y)) in enumerate(zip(fields, places, strict=True)):
        field[y, x] = 0  # light that was not scattered
        seen[n] = np.square(np.abs(np.fft.fft2(np.fft.ifft2(field) * inside)[np.ix_(_views(), _views() + tilt)]))
    return seen


def families() -> tuple[ObjectFamily, ...]:
    """Characters and shapes, of the task's recipe."""
    return load_recipe("through-slab", CHANGES).objects.families


def objects() -> np.ndarray:
    """Objects of all samples, a character and a shape behind each slab, in steps of 1 / 255: uint8[2 SLABS, h, w]."""
    kinds = families()
    shown = [kinds[n % 2].image(SEED, "test", n // 2) for n in range(2 * SLABS)]
    return np.round(255 * np.stack(shown)).astype(np.uint8)


def images(number: int, hidden: np.ndarray, seed: int | None = None, tilt: int = 0) -> np.ndarray:
    """Images float64[N, CAMERA, CAMERA] of objects [N, h, w] behind one slab, each of mean 1; ``seed`` of its state."""
    medium, seed = drawn_slab(number).slab, 1000 + number if seed is None else seed
    lit = (hidden > 0).any(0)
    seen = np.tensordot(hidden[:, lit] / 255, patterns(medium, lit, seed, tilt), axes=1) / envelope(medium)
    return seen / seen.mean((1, 2), keepdims=True)


def parameters(number: int) -> dict[str, float]:
    """Return what a sample of the recipe says of a slab and its camera."""
    medium = drawn_slab(number).slab
    return {
        "thickness": medium.thickness, "optical_depth": medium.optical_depth,
        "mean_free_path": medium.mean_free_path, "g": medium.scatterer.mean_cosine(),
        "scatterer_concentration": medium.scatterer.concentration, "albedo": 1.0, "wavelength": 1.0,
        "width": float(WINDOW), "camera_pitch": PITCH, "object_pitch": PITCH, "medium": number,
    }  # fmt: skip


def main(out: Path) -> None:
    """Render all, slab by slab, and write the file."""
    hidden, counts, tops, rows = objects(), [], [], []
    kinds = families()
    for number in range(SLABS):
        both = hidden[2 * number : 2 * number + 2]
        drawn = drawn_slab(number)
        for n, image in enumerate(images(number, both)):
            tops.append(image.max())
            counts.append(np.round(image / image.max() * 65535).astype(np.uint16))
            family = kinds[n]
            told = family.labels(family.source(SEED, "test", number))
            row, column = centre_of(both[n])
            rows.append(parameters(number) | {
                "extent_over_range": drawn.extent, "family": n, "label": told.get("label", -1.0),
                "object_row": row, "object_column": column,
            })  # fmt: skip
        print(f"slab {number}: extent {drawn.extent:.2f}, contrast {image.std():.3f}", flush=True)
    table = {f"parameters/{name}": np.array([row[name] for row in rows], np.float64) for name in rows[0]}
    np.savez_compressed(out, counts=np.stack(counts), tops=np.array(tops), objects=hidden, **table)
    print(f"{out}: {out.stat().st_size} bytes")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, default=OUT)
    main(parser.parse_args().out)
