"""Which way up: how often the third order of a camera image tells it, and with what right.

    python scripts/turn_table.py                     # with the objects themselves
    python scripts/turn_table.py --solver            # with the solver's images of them, too
    python scripts/turn_table.py --seed 5 --slope    # the slope, from other images

Images are made here, by no sampler of the package: every pixel of the object shines through fields of its own, mixtures
of independent ones whose correlation falls as a Gaussian (C_I is one half at one range); 128 x 128 pixels, 3 pixels a
grain, 2 an object pixel. Objects are characters of the test split of `any-object`. The solver's image is moved onto the
object before it is asked which way up it is, so that the right answer is known. A probability of 0.9 and more counts as
a claim.
"""

import argparse
from collections.abc import Callable

import numpy as np
import torch
from scipy.optimize import minimize_scalar
from torch import Tensor

from specklegen.datasets.objects import Glyphs
from specklegen.models import load_solver, turn_of
from specklegen.models.learning.measurement import seen_by_camera
from specklegen.models.likelihood.likelihood import Optics
from specklegen.models.likelihood.third_order import CLAIMED, SLOPE
from specklegen.models.metrics import align, bootstrap

CAMERA, GRAIN, STEP, SIDE = 128, 3, 2, 28
HELD_OUT = {"disjoint": "character", "test": "569BFMTVWt", "validation": "2KPbq"}
CELLS = ((0.0, None), (1.0, None), (2.0, None), (0.0, 20.0), (0.0, 5.0))
"""(extent in ranges, photons a pixel or no noise)."""


def correlated(extent: float) -> np.ndarray:
    """Mixtures along one axis of the object whose correlation squared is C_I, float64[28, r]."""
    apart = np.arange(SIDE)[:, None] - np.arange(SIDE)
    shares, parts = np.linalg.eigh(np.exp2(-0.5 * (apart * extent / SIDE) ** 2))
    kept = shares > 1e-3 * shares.max()
    return parts[:, kept] * np.sqrt(shares[kept])


def camera_image(brightness: np.ndarray, extent: float, rng: np.random.Generator) -> np.ndarray:
    """Image of an object float[28, 28], mean 1, float64[128, 128]."""
    mixtures = correlated(extent)
    side = -(-(CAMERA + SIDE * STEP) // GRAIN)
    fields = np.zeros((mixtures.shape[1] ** 2, side * GRAIN, side * GRAIN), np.complex64)
    fields[:, :side, :side] = rng.standard_normal((len(fields), side, side, 2)) @ [1, 1j]
    fields = np.fft.fft2(fields).astype(np.complex64)
    image = np.zeros((CAMERA, CAMERA))
    for row, column in np.argwhere(brightness > 0.02):
        shares = np.outer(mixtures[row], mixtures[column]).ravel().astype(np.complex64)
        y, x = STEP * row, STEP * column
        seen = np.tensordot(shares, fields[:, y : y + CAMERA, x : x + CAMERA], 1)
        image += brightness[row, column] * np.abs(seen) ** 2
    return image / image.mean()


def spreads(extent: float, photons: float | None, seed: int, images: int, solver: bool) -> list[np.ndarray]:
    """Difference of the third moments in spreads, above 0 where it is right: with the objects, with images of them."""
    rng = np.random.default_rng([seed, int(100 * extent)])
    glyphs = Glyphs.model_validate({**HELD_OUT, "shape": [SIDE, SIDE]})
    hidden = np.stack([glyphs.image(seed, "test", n) for n in range(images)])
    light = np.stack([camera_image(each, extent, rng) for each in hidden])
    if photons is not None:
        light = rng.poisson(light * photons) / photons
    seen, objects = torch.from_numpy(light).float()[:, None], torch.from_numpy(hidden).float()
    optics = Optics(float(STEP), float(GRAIN))
    power = seen_by_camera(seen, torch.full((images,), float(GRAIN)))
    found = [turn_of(seen, objects, optics, power.noise).spreads.numpy()]
    if solver:
        framed = torch.nn.functional.pad(objects, (4, 4, 4, 4))
        c_i: Callable[[np.ndarray], np.ndarray] = lambda d: np.exp2(-((np.asarray(d) * extent / SIDE) ** 2))  # noqa: E731
        made: Tensor = load_solver().solve(power, optics, [c_i] * images, seed=seed).image
        found.append(turn_of(seen, align(made, framed), optics, power.noise).spreads.numpy())
    return found


def slope_of(found: np.ndarray) -> float:
    """Slope of the logistic function of the spreads under which right answers are likeliest."""
    return float(minimize_scalar(lambda k: np.logaddexp(0, -k * found).sum(), bounds=(0.01, 20), method="bounded").x)


def told(found: np.ndarray) -> str:
    """Share of right answers, and of claims and the right ones of them, with 95 % intervals."""
    claims = 1 / (1 + np.exp(-SLOPE * np.abs(found))) >= CLAIMED
    right = (found > 0).astype(float)
    cells = [f"{right.mean():.2f}", f"{claims.mean():.2f}"]
    cells.append(f"{right[claims].mean():.3f}" if claims.any() else "-")
    return f"{' | '.join(cells)} | {np.median(found):.1f} ({found.min():.1f} to {found.max():.1f})"


def main() -> None:
    """Command line."""
    options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    options.add_argument("--seed", type=int, default=31)
    options.add_argument("--images", type=int, default=24, help="Of each cell.")
    options.add_argument("--solver", action="store_true")
    options.add_argument("--slope", action="store_true", help="Print the slope only.")
    given = options.parse_args()
    torch.set_num_threads(1)
    every: dict[str, list[np.ndarray]] = {}
    if not given.slope:
        print("| extent, ranges | photons | told with | right | claimed | right of those | spreads |")
        print("|---" * 7 + "|")
    for extent, photons in CELLS:
        found = spreads(extent, photons, given.seed, given.images, given.solver)
        for name, each in zip(("object", "solver's image"), found, strict=False):
            every.setdefault(name, []).append(each)
            if not given.slope:
                print(f"| {extent:g} | {photons or 'no noise'} | {name} | {told(each)} |", flush=True)
    for name, parts in every.items():
        together = np.concatenate(parts)
        if given.slope:
            print(f"slope, told with the {name}: {slope_of(together):.3f}")
            continue
        sure = 1 / (1 + np.exp(-SLOPE * np.abs(together)))
        for low, high in ((0.5, 0.7), (0.7, 0.9), (0.9, 0.99), (0.99, 1.01)):
            which = (sure >= low) & (sure < high)
            if which.sum() > 1:
                right = bootstrap((together[which] > 0).astype(float), np.arange(which.sum()))
                said = f"said {low} to {min(high, 1)}: {which.sum()} images, {sure[which].mean():.3f} in the mean"
                print(f"{name}, {said}, right {right.mean:.3f} [{right.low:.3f}, {right.high:.3f}]")


if __name__ == "__main__":
    main()
