"""What the figures of [Bar19] share: scenes, reference data, CPU clocks, rows of the table, their folder."""

import os
import sys
import time
from collections.abc import Iterable
from contextlib import contextmanager
from pathlib import Path
from typing import NamedTuple

sys.path.append(str(Path(__file__).parents[2] / "tests"))  # right values: tests/references
for variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(variable, "1")

import matplotlib  # noqa: E402

matplotlib.use("Agg")
import matplotlib.pyplot as plt  # noqa: E402
import numpy as np  # noqa: E402
from PIL import Image  # noqa: E402

import specklegen as sg  # noqa: E402

OUT = Path("docs/images")
REFERENCE = Path(__file__).parents[2] / "tests" / "data"
LIGHTS = (0.0, 1.0, 4.0, 20.0)
"""Lights of Figs. 2, 8 and 9, degrees."""


class Row(NamedTuple):
    """A row of the table of docs/notes/validation.md; ``verdict`` holds the z-score or the limit."""

    row: str
    what: str
    measured: str
    expected: str
    verdict: str
    seconds: float


class Clock:
    """CPU seconds of this process, all its threads together."""

    seconds = 0.0


@contextmanager
def clock():
    """Time the block in CPU seconds."""
    spent, start = Clock(), time.process_time()
    yield spent
    spent.seconds = time.process_time() - start


def report(rows: Iterable[Row], script: str) -> None:
    """Print rows as Markdown."""
    for row in rows:
        texts = (cell.replace("|", r"\|") for cell in row[:-1])
        cells = (*texts, f"{row.seconds:.1f}", f"`scripts/figures/{script}.py`")
        print("| " + " | ".join(cells) + " |", flush=True)


def flatland_box(half: float, mean_free_path: float, scatterer=None) -> sg.media.Box:
    """A square of side 2 ``half`` around the origin."""
    return sg.media.Box(
        lower=(-half, -half), upper=(half, half), mean_free_path=mean_free_path,
        scatterer=scatterer or sg.media.Isotropic()
    )


def flatland_scene(box: sg.media.Box, views: np.ndarray, lights=LIGHTS) -> sg.Scene:
    """Plane waves and far-field views, degrees."""
    return sg.Scene(
        wavelength=1.0,
        medium=box,
        illumination=sg.light.PlaneWaves.tilts(np.deg2rad(lights), dimensions=2),
        sensor=sg.sensors.FarField.angles(np.deg2rad(views)),
    )


def diagonal_pairs(lights: int, views: int) -> np.ndarray:
    """Pairs of every (light, view) with itself, int64[lights * views, 4]: the intensities."""
    t, v = (n.ravel() for n in np.indices((lights, views)))
    return np.stack([t, v, t, v], axis=1)


def relative(part: np.ndarray, whole: float) -> np.ndarray:
    """Frobenius norms of the matrices [V, L, V] over a trace, float64[L]."""
    return np.sqrt(np.square(np.abs(part)).sum(axis=(0, 2))) / whole


def save(figure: plt.Figure, path: Path, dpi: int = 80) -> None:
    """Write a figure in 256 colours, small enough for a repository, and close it."""
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.set_dpi(dpi)
    figure.canvas.draw()
    pixels = np.asarray(figure.canvas.buffer_rgba())  # pyright: ignore[reportAttributeAccessIssue]
    Image.fromarray(pixels).convert("RGB").quantize(256, Image.Quantize.MAXCOVERAGE).save(path, optimize=True)
    plt.close(figure)
