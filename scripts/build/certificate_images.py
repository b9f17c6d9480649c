"""Shapes of our own, of which images judge the solver's confidence."""

from pathlib import Path

import numpy as np
from PIL import Image, ImageDraw

from specklegen.models.learning.solver import EXTENT

SHAPES_SEED, POSES, FINE = 11, 8, 8


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
