"""By how much more the scores of literal speckle images scatter than Fisher information says: docs/notes/bound.md.

    python scripts/score_scatter.py            # five sizes of objects, twenty objects each: a processor minute

Images are sums of one speckle pattern, moved; their likelihood takes periodograms for independent gamma variables,
which intensities, not being Gaussian, are not quite.
"""

import argparse

import numpy as np
import torch

from specklegen.models import Optics, SpeckleLikelihood, periodogram
from specklegen.models.likelihood.fisher import fisher_information

CAMERA, GRAIN, STEP = 96, 2.5, 3
_FEWEST, _DIRECTIONS = 9, 12  # pixels of an object that has fewer directions than so many


def drawn_object(side: int, seed: int) -> np.ndarray:
    """Object float64[side, side], half of its pixels dark."""
    light = np.random.default_rng([seed, side]).random((side, side))
    light[light < 0.5] = 0
    return light


def whitened_scores(side: int, seed: int, count: int, camera: int = CAMERA) -> np.ndarray:
    """Scores float64[count, K] of images of an object that a seed draws, each of variance 1 were the law exact."""
    light, rng = drawn_object(side, seed), np.random.default_rng([seed, side, 1])
    wide = 2 * -(-(camera + STEP * side) // int(2 * GRAIN))  # of the field's window; even: the grain is exact
    images = np.zeros((count, camera, camera))
    for image in images:
        field = rng.normal(size=(wide, wide)) + 1j * rng.normal(size=(wide, wide))
        pattern = np.abs(np.fft.fft2(field, (int(wide * GRAIN),) * 2)) ** 2
        for y, x in np.argwhere(light):
            image += light[y, x] * pattern[STEP * y : STEP * y + camera, STEP * x : STEP * x + camera]
    seen = periodogram(torch.from_numpy(images)[:, None])
    likelihood = SpeckleLikelihood(seen, (side, side), Optics(float(STEP), GRAIN))
    number = 4 if side**2 <= _FEWEST else _DIRECTIONS
    along = torch.from_numpy(np.random.default_rng(2).normal(size=(number, side, side)))
    objects = torch.from_numpy(light).expand(count, side, side)
    information = fisher_information(likelihood.select(slice(1)), objects[:1], along[None])[0]
    theta = torch.zeros(count, number, dtype=torch.float64, requires_grad=True)
    likely = likelihood.log_likelihood(objects + torch.einsum("bk,khw->bhw", theta, along)).sum()
    (score,) = torch.autograd.grad(likely, theta)
    root = torch.linalg.cholesky(information)
    return torch.linalg.solve_triangular(root, score.T, upper=False).T.numpy()


def main() -> None:
    """Print the table in Markdown."""
    asked = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    asked.add_argument("--objects", type=int, default=20)
    asked.add_argument("--images", type=int, default=100)
    asked.add_argument("--first", type=int, default=200, help="seed of the first object")
    given = asked.parse_args()
    torch.set_num_threads(1)
    head = "| object, camera, pixels | lit | mean over objects | from object to object | own error |"
    print(f"{head}\n{'|---' * 5}|")
    for side, camera in ((3, 96), (5, 96), (7, 96), (10, 96), (14, 96), (7, 48), (7, 192)):
        seeds = range(given.first, given.first + given.objects)
        each = [np.square(whitened_scores(side, seed, given.images, camera)).mean(1) for seed in seeds]
        factors = np.array([scatter.mean() for scatter in each])
        own = np.mean([scatter.std(ddof=1) for scatter in each]) / given.images**0.5
        lit = np.mean([np.count_nonzero(drawn_object(side, seed)) for seed in seeds])
        error = factors.std(ddof=1) / len(factors) ** 0.5
        print(f"| {side} x {side}, {camera} | {lit:.0f} | {factors.mean():.3f} ± {error:.3f} "
              f"| {factors.min():.2f} to {factors.max():.2f} | {own:.3f} |", flush=True)  # fmt: skip


if __name__ == "__main__":
    main()
