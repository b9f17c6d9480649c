"""Images that a camera took: eight shapes behind four ground glasses, of another laboratory.

Their authors state no licence, so nothing of them comes with the package: a user fetches them by ``specklegen check
measured get hidden-shapes``, and every file is held against its digest. Nobody has said how large the shapes are on the
camera, nor which way up; so a score is of the best of all sizes, quarter turns and mirror images of the shape as it is
printed in DejaVu Sans; chance has the same choice. It is of the whole frame: what an answer shows beside a small shape
counts.
"""

import hashlib
import json
import re
from collections.abc import Sequence
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor

from specklegen.datasets.objects.glyph_batches import coverage
from specklegen.datasets.objects.outlines import outline
from specklegen.measured import public_data, read_measurement
from specklegen.models.judging.baselines import FRAME
from specklegen.models.judging.evaluation import PERFECT, on_frame
from specklegen.models.metrics import SCORES, align

SET = "hidden-shapes"
"""Name among ``specklegen.measured.public_data_names()``."""
SHAPES = ("2", "5", "7", "J", "T", "X", "pi", "◇")
GRITS = (120, 220, 600, 1500)
SAMPLES = len(SHAPES) * len(GRITS)
"""Sample n shows shape n % 8 through glass n // 8."""
SIDE = 320
"""Of the middle of a frame, in pixels."""
OBJECT = (36, 36)
HEIGHTS = tuple(range(8, 35, 2))
"""Longest sides of printed shapes, in pixels of the camera."""
GRAIN = 1.8
"""Pixels of the camera, measured from the frames, a disc assumed (docs/benchmark.md)."""
CHANGES = {
    "pixels": {"grain": 2.0, "object_pixel": 1.0, "shape": [SIDE, SIDE]}, "objects": {"shape": list(OBJECT)},
}  # fmt: skip
"""Over the recipe ``ground-glass``, which takes no finer grain than 2 pixels; distances are not known."""
_PI = (
    (3.6, 54.7), (56.0, 54.7), (56.0, 45.7), (49.1, 45.7), (49.1, 12.1), (49.4, 8.6), (50.3, 7.1), (52.0, 5.9),
    (54.2, 5.5), (57.4, 5.8), (57.4, -0.7), (53.9, -1.6), (50.3, -1.9), (46.5, -1.1), (42.2, 1.3), (40.5, 5.9),
    (39.9, 13.1), (39.9, 45.7), (19.8, 45.7), (19.8, 0.0), (10.6, 0.0), (10.6, 45.7), (3.6, 45.7),
)  # fmt: skip
_DIAMOND = (
    ((7.7, 26.0), (38.4, -4.9), (69.2, 26.0), (38.4, 56.8)), ((0.3, 26.0), (38.4, 64.3), (76.6, 26.0), (38.4, -12.3)),
)  # fmt: skip


def missing(folder: Path | str | None) -> bool:
    """Return whether a folder, if any, is no clone of the set with every file as it should be."""
    return folder is None or bool(public_data(SET).broken(folder))


def digest() -> str:
    """SHA-256 of what decides a pixel or a score: digests of the files, the part that is shown, shapes, the frame."""
    shapes = [np.round(one, 6).tolist() for shape in SHAPES for one in _contours(shape)]
    content = [public_data(SET).files, SIDE, OBJECT, HEIGHTS, CHANGES, SHAPES, GRITS, shapes, FRAME, GRAIN]
    return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()


def images(numbers: Sequence[int], folder: Path | str) -> Tensor:
    """Middle of frames over their fitted envelope, float32[B, SIDE, SIDE]."""
    seen = []
    for number in numbers:
        file = Path(folder) / _file(SHAPES[number % len(SHAPES)], GRITS[number // len(SHAPES)])
        frame = read_measurement(file, envelope="fit", hot_pixels=False).images[0]
        top, left = ((side - SIDE) // 2 for side in frame.shape)
        seen.append(np.asarray(frame[top : top + SIDE, left : left + SIDE], np.float32))
    return torch.from_numpy(np.stack(seen))


def batch(numbers: Sequence[int], folder: Path | str, setup: dict[str, np.ndarray]) -> dict[str, Any]:
    """Samples of some numbers, laid out as those of a recipe.

    ``setup`` has the parameters of one of its samples, of which the window's width is made that of :data:`GRAIN`.
    """
    some = np.asarray(numbers)
    known = {name: torch.full((len(some),), float(values[0]), dtype=torch.float64) for name, values in setup.items()}
    known["width"] = known["wavelength"] / (GRAIN * known["camera_pitch"])
    drawn = {"label": some % len(SHAPES), "medium": some // len(SHAPES)}
    return {
        "image": images(numbers, folder), "object": torch.zeros(len(some), *OBJECT),
        "index": torch.from_numpy(some.astype(np.int64)),
        "parameters": known | {name: torch.from_numpy(values.astype(np.float64)) for name, values in drawn.items()},
    }  # fmt: skip


def _file(shape: str, grit: int) -> str:
    (found,) = [
        name for name in public_data(SET).files
        if re.match(rf"pic/{re.escape(shape)}（1号）/{grit}(?!\d)[^/]*/[^/]*\.tif", name)
    ]  # fmt: skip
    return found


def _contours(shape: str) -> list[np.ndarray]:
    """Edges float64[n, 4] of a shape's closed contours."""
    if shape in ("pi", "◇"):
        closed = [np.array(one) for one in ([_PI] if shape == "pi" else _DIAMOND)]
        return [np.hstack([one, np.roll(one, -1, axis=0)]) for one in closed]
    return [outline("DejaVuSans.ttf", shape)]


@cache
def printed(shape: str) -> Tensor:
    """A shape in every size, at two quarter turns, and their mirror images: float32[K, *OBJECT].

    A turn by 180 degrees is tried by the function that aligns.
    """
    edges = np.vstack(_contours(shape))
    ends = edges.reshape(-1, 2)
    low, high = ends.min(0), ends.max(0)
    made = []
    for height in HEIGHTS:
        drawn = (edges - np.tile(low, 2)) * (height / (high - low).max())
        cells = coverage(torch.from_numpy(drawn)[None], height, height)[0]
        for side in (cells, cells.flip(1)):
            for turned in (side, side.T):
                frame = torch.zeros(OBJECT)
                frame[:height, :height] = turned
                made.append(frame)
    return torch.stack(made)


def scores(answers: Tensor, shapes: Sequence[int]) -> dict[str, np.ndarray]:
    """Scores float64[n] by name, of answers real[n, h, w] for shapes of some numbers, at the size that suits best.

    They are of all FRAME x FRAME pixels: cut to the shape, an answer would lose what it shows beside it, and a small J
    would be found in most letters.
    """
    found: dict[str, list[float]] = {name: [] for name in SCORES}
    for answer, shape in zip(answers, shapes, strict=True):
        bank = on_frame(printed(SHAPES[shape]), dark=False)
        moved = align(on_frame(answer).expand_as(bank), bank)
        best = int(SCORES["pearson"](moved, bank).argmax())
        for name, score in SCORES.items():
            found[name].append(float(score(moved[best], bank[best]).clamp(max=PERFECT)))
    return {name: np.array(values) for name, values in found.items()}


def named(answers: Tensor, shapes: Sequence[int]) -> np.ndarray:
    """Return whether each answer is most like its own of the eight shapes, bool[n]."""
    alike = np.stack([scores(answers, [one] * len(answers))["pearson"] for one in range(len(SHAPES))])
    return alike.argmax(0) == np.asarray(shapes)
