"""Images that judge the solver's certificates: shapes of our own, and images that waves draw.

Waves go slice by slice (``specklegen.oracles.multi_slice``) and know nothing of this package's samplers: every object
pixel is a plane wave of its own through the same screens, a square window lies behind them, and intensities add.
"""

from pathlib import Path

import numpy as np
from PIL import Image, ImageDraw
from scipy.ndimage import gaussian_filter

import specklegen as sg
from specklegen.models import Optics, measured_memory_effect
from specklegen.models.learning.solver import EXTENT
from specklegen.models.retrieval.autocorrelation import MemoryEffect
from specklegen.oracles.multi_slice import multi_slice, slice_views

SHAPES_SEED, POSES, FINE = 11, 8, 8
SIZE, SIDE, CAMERA = 384, 16, 96  # of the waves' grid, of objects, and of the camera: bins of the grid's transform
WAVES = Optics(step=1.0, grain=2.0)


def shapes() -> dict[str, list[np.ndarray]]:
    """Loops of the own shapes, float[n, 2] each, within -1 to 1; of several the later ones are holes."""
    turn = np.linspace(0, 2 * np.pi, 49)[:-1]
    circle = np.stack([np.cos(turn), np.sin(turn)], axis=1)
    square = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
    spikes = np.linspace(0, 2 * np.pi, 11)[:-1]
    star = np.stack([np.cos(spikes), np.sin(spikes)], axis=1) * np.where(np.arange(10) % 2, 0.4, 1.0)[:, None]
    lobes = 13 * np.cos(turn) - 5 * np.cos(2 * turn) - 2 * np.cos(3 * turn)
    heart = np.stack([np.sin(turn) ** 3, -lobes / 16], axis=1)
    return {
        "star": [star],
        "ring": [circle, 0.6 * circle],
        "arrow": [np.array([[-1, -0.25], [0.1, -0.25], [0.1, -0.7], [1, 0], [0.1, 0.7], [0.1, 0.25], [-1, 0.25]])],
        "cross": [np.array([[-0.3, -1], [0.3, -1], [0.3, -0.3], [1, -0.3], [1, 0.3], [0.3, 0.3], [0.3, 1], [-0.3, 1],
                            [-0.3, 0.3], [-1, 0.3], [-1, -0.3], [-0.3, -0.3]])],
        "heart": [heart],
        "crescent": [circle, 0.75 * circle + [0.45, 0]],
        "frame": [square, 0.65 * square],
        "house": [np.array([[-0.8, 1], [-0.8, -0.1], [0, -1], [0.8, -0.1], [0.8, 1], [0.3, 1], [0.3, 0.3], [-0.2, 0.3],
                            [-0.2, 1]])],
        "lightning": [np.array([[0.2, -1], [-0.6, 0.1], [0, 0.1], [-0.3, 1], [0.6, -0.2], [0.05, -0.2], [0.5, -1]])],
        "hourglass": [np.array([[-0.8, -1], [0.8, -1], [-0.8, 1], [0.8, 1]])],
    }  # fmt: skip


def draw_shapes(folder: Path, side: int = EXTENT) -> None:
    """Write pictures of the own shapes, each in several poses."""
    folder.mkdir(parents=True, exist_ok=True)
    rng = np.random.default_rng(SHAPES_SEED)
    for name, loops in shapes().items():
        for pose in range(POSES):
            angle, size = rng.uniform(0, 2 * np.pi), rng.uniform(0.3, 0.45) * side * FINE
            turn = size * np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
            picture = Image.new("L", (side * FINE, side * FINE))
            for n, loop in enumerate(loops):
                points = [(float(x), float(y)) for x, y in loop @ turn.T + side * FINE / 2]
                ImageDraw.Draw(picture).polygon(points, fill=0 if n else 255)
            picture.reduce(FINE).save(folder / f"{name}-{pose}.png")


def memory_of_waves(slab: sg.Slab, seed: int) -> MemoryEffect:
    """C_I of waves over object pixels, made positive definite."""
    bins = np.arange(SIDE)
    curve = multi_slice(
        slab, wavelength=1.0, pitch=0.5, size=SIZE, bins=bins.tolist(), realizations=2, seed=seed, reach=0.25
    )  # fmt: skip
    c_i = curve.on_axis.mean(0) / curve.on_axis.mean(0)[0]
    return measured_memory_effect(bins, np.minimum.accumulate(c_i))


def wave_patterns(slab: sg.Slab, seed: int) -> np.ndarray:
    """What the camera sees of every object pixel behind a slab, float32[SIDE^2, CAMERA, CAMERA]."""
    places = np.arange(SIDE) - SIDE // 2
    tilts = [(int(x), int(y)) for y in places for x in places]
    window = np.zeros((SIZE, SIZE), bool)
    window[SIZE // 4 : 3 * SIZE // 4, SIZE // 4 : 3 * SIZE // 4] = True
    some = np.arange(-CAMERA // 2, CAMERA // 2)
    (fields,) = slice_views(slab, wavelength=1.0, pitch=0.5, size=SIZE, bins=tilts, realizations=1, seed=seed)
    patterns = np.empty((len(tilts), CAMERA, CAMERA), np.float32)
    for n, ((x, y), field) in enumerate(zip(tilts, fields, strict=True)):
        field[y, x] = 0  # light that was not scattered
        inside = np.fft.fft2(np.fft.ifft2(field) * window)
        patterns[n] = np.square(np.abs(inside[some][:, some]))
    return patterns


def images_of_waves(patterns: np.ndarray, objects: np.ndarray) -> np.ndarray:
    """Images float64[N, CAMERA, CAMERA] of objects float[N, SIDE, SIDE] through one medium, over their envelope.

    A pixel's light goes along its tilt: the camera would show objects upright, samples of a recipe are turned.
    """
    images = np.tensordot(objects.reshape(len(objects), -1)[:, ::-1].astype(np.float64), patterns, axes=1)
    return images / gaussian_filter(images.mean(0), 16, mode="nearest")
