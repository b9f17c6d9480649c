"""How well speckle of a setup is told from what is none: true speckle of ten setups against seven kinds of pictures.

    python scripts/speckle_test_table.py --out runs/speckle-test.csv --rounds 20    # 200 of each kind; 40 minutes

Each round takes four images of each setup, and one picture of each kind, as large as the setup's camera, which is
given to `reconstruct_and_assess` with that setup. Blurred noise has a contrast of its own, as grey values have. The
pictures are those that scikit-image carries. What was scored is kept, and a run that was stopped goes on.
"""

import argparse
import csv
import io
from collections.abc import Callable
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np
import torch
from PIL import Image
from scipy.ndimage import gaussian_filter
from scipy.signal import fftconvolve

from specklegen.core.errors import reject
from specklegen.datasets import load_recipe
from specklegen.datasets.recipes.hidden_object import HiddenObject
from specklegen.models import reconstruct_and_assess
from specklegen.models.recoverability.speckle_test import REFUSED

Shape = tuple[int, int]
_SLAB = {"thickness": 1000.0, "optical_depth": 10.0, "g": 0.9}
_CAMERA = {"photons": 200.0, "read_noise": 2.0, "gain": 8.0, "bit_depth": 8}
SETUPS: dict[str, tuple[str, dict[str, Any]]] = {
    "through-slab": ("through-slab", {"media": "new"}),
    "through-slab-lab": ("through-slab-lab", {"media": "new"}),
    "ground-glass": ("ground-glass", {"media": "new"}),
    "one-angular-size, slab known": ("one-angular-size", {"material": _SLAB}),
    "one-angular-size": ("one-angular-size", {}),
    "any-object, 30 photons": ("any-object", {"material": _SLAB, "exposure": {"photons": 30.0, "bit_depth": None}}),
    "disc, 256 pixels, 8 bit": ("through-slab", {
        "media": "new", "window": {"profile": "disc"}, "camera": {"shape": [256, 256], "pixels_per_grain": 4.0},
        "exposure": _CAMERA,
    }),
    "isotropic, 480 x 600 pixels, 8 bit": ("through-slab", {
        "media": "new", "material": {"thickness": 200.0, "optical_depth": 20.0, "g": 0.0, "albedo": 1.0},
        "window": {"width": 12000.0}, "camera": {"shape": [480, 600], "pixels_per_grain": 5.0},
        "exposure": {**_CAMERA, "photons": 100.0},
    }),
    "points-beyond-range, unpolarised": ("points-beyond-range", {
        "material": {"thickness": 2000.0, "optical_depth": 15.0, "g": 0.8}, "light": {"polarised": False},
    }),
    "double-diffuser": ("double-diffuser", {
        "media": "new", "window": {"width": 9000.0}, "field": {"pixels": None},
        "material": {"gaps": [800.0], "screens": [{"type": "GroundGlass", "angle": a} for a in (0.1, 0.15)]},
    }),
}  # fmt: skip
TEXTURES = ("brick.png", "grass.png", "gravel.png", "cell.png", "coins.png", "ihc.png", "moon.png", "text.png")
SCENES = ("astronaut.png", "camera.png", "chelsea.png", "coffee.png", "rocket.jpg", "motorcycle_left.png", "retina.jpg",
          "hubble_deep_field.jpg", "page.png")  # fmt: skip
SCALES = (1, 2, 4, 6, 10, 16)
HEAD = ("kind", "setup", "round", "number", "score", "probability", "contrast", "law", "bispectrum", "deviance")


def resized(picture: np.ndarray, shape: Shape) -> np.ndarray:
    """Picture of another size, bicubic."""
    resampled = Image.fromarray(picture.astype(np.float32)).resize((shape[1], shape[0]), Image.Resampling.BICUBIC)
    return np.asarray(resampled, np.float64)


def carried(name: str) -> np.ndarray:
    """Grey values of a picture of scikit-image."""
    with (files("skimage") / "data" / name).open("rb") as file:
        return np.asarray(Image.open(file).convert("L"), np.float64)


def crop(rng: np.random.Generator, names: tuple[str, ...], shape: Shape) -> np.ndarray:
    """Part of one of some pictures, a quarter of it to all."""
    picture = carried(names[rng.integers(len(names))])
    scale = rng.uniform(0.25, 1) * min(n / m for n, m in zip(picture.shape, shape, strict=True))
    rows, columns = (int(scale * n) for n in shape)
    y, x = rng.integers(picture.shape[0] - rows + 1), rng.integers(picture.shape[1] - columns + 1)
    return resized(picture[y : y + rows, x : x + columns], shape)


def texture_of(rng: np.random.Generator, shape: Shape, sigma: float) -> np.ndarray:
    """Gaussian noise blurred by sigma pixels, of spread 1."""
    found = gaussian_filter(rng.standard_normal(shape), sigma)
    return found / found.std()


def blurred_noise(rng: np.random.Generator, shape: Shape) -> np.ndarray:
    """Of six scales, contrast .05 to .5, over a background."""
    return np.clip(50 + 100 * (1 + rng.uniform(0.05, 0.5) * texture_of(rng, shape, rng.choice(SCALES))), 0, None)


def portrait(rng: np.random.Generator, shape: Shape) -> np.ndarray:
    """One of a hundred small faces, or of two large ones."""
    if rng.random() < 0.3:
        name, top, left, side = (("astronaut.png", 0, 120, 200), ("camera.png", 70, 140, 160))[rng.integers(2)]
        y, x = rng.integers(30, size=2)
        face = carried(name)[top + y : top + y + side, left + x : left + x + side]
    else:
        with (files("skimage") / "data" / "lfw_subset.npy").open("rb") as file:
            face = 255 * np.load(file)[rng.integers(100)]
    return resized(face[:, ::-1] if rng.random() < 0.5 else face, shape) + rng.normal(0, 2, shape)


def chequerboard(rng: np.random.Generator, shape: Shape) -> np.ndarray:
    """Upright or turned, sharp or blurred, with some noise."""
    turn, side = rng.choice([0.0, rng.uniform(0, np.pi)]), rng.uniform(4, 40)
    y, x = np.mgrid[: shape[0], : shape[1]]
    u, v = np.cos(turn) * x + np.sin(turn) * y, -np.sin(turn) * x + np.cos(turn) * y
    board = 20 + rng.uniform(20, 200) * ((np.floor(u / side) + np.floor(v / side)) % 2)
    return gaussian_filter(board, rng.choice([0.0, rng.uniform(0.5, 3)])) + rng.normal(0, rng.uniform(0, 5), shape)


def gradient(rng: np.random.Generator, shape: Shape) -> np.ndarray:
    """A slope, a cone or a Gaussian, in whole grey values."""
    y, x = np.mgrid[: shape[0], : shape[1]] / max(shape)
    far = np.hypot(x - rng.random(), y - rng.random())
    found = (rng.normal() * x + rng.normal() * y, far, np.exp(-(far**2) / rng.uniform(0.05, 1)))[rng.integers(3)]
    light = (found - found.min()) / np.ptp(found) * rng.uniform(20, 200) + 20
    return np.round(light + rng.normal(0, rng.uniform(0, 5), shape))


def jpeg_blocks(rng: np.random.Generator, shape: Shape) -> np.ndarray:
    """A photograph or a texture at a JPEG quality of 2 to 19."""
    smooth = 128 + 60 * texture_of(rng, shape, rng.uniform(2, 10))
    light, file = crop(rng, SCENES, shape) if rng.random() < 0.7 else smooth, io.BytesIO()
    Image.fromarray(np.clip(light, 0, 255).astype(np.uint8)).save(file, "JPEG", quality=int(rng.integers(2, 20)))
    return np.asarray(Image.open(file), np.float64)


def defocused(rng: np.random.Generator, shape: Shape) -> np.ndarray:
    """A photograph under a disc of 2 to 15 pixels, in whole grey values."""
    y, x = np.mgrid[-16:17, -16:17]
    disc = (np.hypot(x, y) <= rng.uniform(2, 15)).astype(float)
    light = fftconvolve(np.pad(crop(rng, SCENES, shape), 16, mode="reflect"), disc / disc.sum(), mode="valid")
    return np.round(light + rng.normal(0, rng.uniform(0, 3), shape))


PICTURES: dict[str, Callable[[np.random.Generator, Shape], np.ndarray]] = {
    "blurred noise": blurred_noise,
    "portraits": portrait,
    "textures": lambda rng, shape: crop(rng, TEXTURES, shape),
    "chequerboards": chequerboard,
    "gradients": gradient,
    "JPEG blocks": jpeg_blocks,
    "defocused photographs": defocused,
}


def recipe_of(setup: str) -> HiddenObject:
    """Recipe of a setup."""
    found = load_recipe(*SETUPS[setup])
    if not isinstance(found, HiddenObject):
        reject("recipe_of setup", "one with hidden objects", setup)
    return found


def scored(setup: str, turn: int, seed: int) -> list[dict[str, object]]:
    """Scores of one round of a setup: four images of its own, and one picture of each kind."""
    recipe, rng = recipe_of(setup), np.random.default_rng([seed, turn, list(SETUPS).index(setup)])
    own = recipe.batch(seed, "test", range(4 * turn, 4 * turn + 4))["image"].astype(np.float32)
    others = [draw(rng, recipe.camera_shape).clip(0, None).astype(np.float32) for draw in PICTURES.values()]
    found = reconstruct_and_assess(torch.from_numpy(np.stack([*own, *others]))[:, None], recipe, fit=False)
    return [
        dict(zip(HEAD, (kind, setup, turn, n, one.speckle.score, one.probability, *one.speckle.evidence), strict=True))
        for n, (kind, one) in enumerate(zip(["speckle"] * len(own) + list(PICTURES), found.each, strict=True))
    ]


def area(above: np.ndarray, below: np.ndarray) -> float:
    """Area under the receiver's curve."""
    return float((np.sign(above[:, None] - below).mean() + 1) / 2)


def report(path: Path) -> str:
    """Table of areas, of the shares that are refused, as Markdown."""
    with path.open() as file:
        rows = list(csv.DictReader(file))
    kind, score = np.array([row["kind"] for row in rows]), np.array([float(row["score"]) for row in rows])
    true = score[kind == "speckle"]
    lines = ["| kind | images | AUC | refused |", "|---|---|---|---|"]
    for name in ("speckle", *PICTURES):
        one = score[kind == name]
        told = "" if name == "speckle" else f"{area(one, true):.4f}"
        lines.append(f"| {name} | {len(one)} | {told} | {np.mean(one >= REFUSED):.3f} |")
    every = score[kind != "speckle"]
    told = f"{area(every, true):.4f} | {np.mean(every >= REFUSED):.3f}"
    return "\n".join([*lines, f"| all but speckle | {len(every)} | {told} |"])


def main() -> None:
    """Command line."""
    options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    options.add_argument("--out", type=Path, default=Path("runs/speckle-test.csv"))
    options.add_argument("--rounds", type=int, default=20)
    options.add_argument("--seed", type=int, default=12)
    given = options.parse_args()
    torch.set_num_threads(1)
    given.out.parent.mkdir(parents=True, exist_ok=True)
    done: set[tuple[str, str]] = set()
    if given.out.exists():
        with given.out.open() as file:
            done = {(row["setup"], row["round"]) for row in csv.DictReader(file)}
    with given.out.open("a", newline="") as file:
        writer: csv.DictWriter[str] = csv.DictWriter(file, HEAD, lineterminator="\n")
        if not done:
            writer.writeheader()
        for turn in range(given.rounds):
            for setup in SETUPS:
                if (setup, str(turn)) not in done:
                    writer.writerows(scored(setup, turn, given.seed))
                    file.flush()
    print(report(given.out))


if __name__ == "__main__":
    main()
