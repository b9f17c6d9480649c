"""Best possible correlation with an object from one image, and how near methods come.

Draws bound.png, and prints its table: some three processor minutes.

Run it by itself: python scripts/figures/bound.py --out docs/images [--quick]

Fisher information of held-out characters (``specklegen.models.likelihood.fisher``), beside what solver, posterior,
phase retrieval and packaged network make of the same rendered images. The prior's tangent at an object is read off the
packaged net that takes noise off pictures: the covariance of what a noisy picture may have been is the derivative of
the net's answer, times the noise (Efron, J. Amer. Stat. Assoc. 106, 1602 (2011), section 2); directions of which more
than half is left are the tangent.
"""

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")

from pathlib import Path
from typing import Any, NamedTuple

import matplotlib.pyplot as plt
import numpy as np
import torch
from _command import run, save
from torch import Tensor

from specklegen.datasets import load_recipe
from specklegen.datasets.loading.stream import tensors
from specklegen.datasets.recipes.hidden_object import HiddenObject
from specklegen.models import Retrieval, bootstrap, load_pretrained, load_solver
from specklegen.models.judging import baselines
from specklegen.models.judging.evaluation import aligned_to
from specklegen.models.learning.measurement import measured
from specklegen.models.learning.posterior import load_prior
from specklegen.models.likelihood.fisher import fisher_information, least_error
from specklegen.models.likelihood.likelihood import SpeckleLikelihood
from specklegen.models.metrics import pearson
from specklegen.models.retrieval.apodisation import framed
from specklegen.models.retrieval.autocorrelation import at_distances

OUT = Path("docs/images")
SEED, SPLIT, FRAME = 31, "test", 36
LEVEL = 0.8  # t of the prior's net: a picture is 0.8 of what it sees, the rest is noise
STEP = 0.01  # of the derivative of its answer
LEFT = 0.5  # share of a direction's noise that is left: above, it is the tangent
GOOD = 0.8
METHODS = ("Katz", "packaged network", "solver", "posterior")
BOUNDS = ("lit pixels", "prior's tangent")


class Condition(NamedTuple):
    """A row of the table."""

    extent: float  # memory-effect ranges
    camera: int  # pixels, 3 a grain
    photons: float  # a pixel

    def __str__(self) -> str:
        return f"{self.extent:g} | {self.camera // 3} | {self.photons:g}"

    def recipe(self) -> HiddenObject:
        """Characters 14 grains wide behind slabs of drawn material."""
        exposure = {} if np.isinf(self.photons) else {"exposure": {"photons": self.photons, "bit_depth": None}}
        recipe = load_recipe("unknown-slab", {
            "objects": {"disjoint": "character", "test": "569BFMTVWt", "validation": "2KPbq"},
            "field": {"extent_over_range": self.extent, "pixels": 42.0}, "mode_tolerance": 0.001,
            "camera": {"shape": [self.camera, self.camera]}, **exposure,
        })  # fmt: skip
        assert isinstance(recipe, HiddenObject)
        return recipe


NONE = float("inf")
CONDITIONS = (Condition(0.3, 128, NONE), Condition(1, 128, NONE), Condition(3, 128, NONE), Condition(1, 256, NONE),
              Condition(1, 128, 100), Condition(1, 128, 10))  # fmt: skip


class Row(NamedTuple):
    """What is possible and what is reached under a condition, by image."""

    bounds: dict[str, np.ndarray]  # r
    reached: dict[str, np.ndarray]  # r
    agreement: np.ndarray  # of the posterior's draws
    rivals: np.ndarray  # whether a draw explains the image as well as the true object, and is another picture
    tangent: np.ndarray  # directions


def tangent_of(picture: Tensor) -> Tensor:
    """Directions float32[K, n, n], orthonormal, that the prior leaves open at a picture float32[n, n], 0 to 1."""
    net, size = load_prior(), picture.numel()
    x = LEVEL * (2 * picture - 1)
    columns = []
    with torch.no_grad():
        middle = net(x[None], torch.tensor([LEVEL]))
        for part in torch.eye(size).unflatten(1, picture.shape).split(108):
            moved = net(x + STEP * part, torch.full((len(part),), LEVEL))
            columns.append((moved - middle).flatten(1) / STEP)
    slope = torch.cat(columns)
    values, vectors = torch.linalg.eigh(LEVEL * (slope + slope.T) / 2)
    return vectors.T[values > LEFT].unflatten(1, picture.shape)


def told_apart(directions: Tensor, picture: Tensor) -> Tensor:
    """Orthonormal directions that span those given, less what scores forget: brightness, offset, shifts."""
    flat = directions.flatten(1).double()
    down, across = torch.gradient(picture.double())
    forgotten = torch.stack([picture.double(), torch.ones_like(picture).double(), down, across]).flatten(1)
    forgotten = torch.linalg.qr(forgotten.T)[0]
    flat = flat - flat @ forgotten @ forgotten.T
    left, values, right = torch.linalg.svd(flat, full_matrices=False)
    return right[values > 1e-3 * values.max()].unflatten(1, picture.shape)


def best_correlation(likelihood: SpeckleLikelihood, picture: Tensor, c_i: Tensor, directions: Tensor) -> float:
    """Largest r of an unbiased estimate, whose error lies along directions, with the object float32[n, n]."""
    open_ = told_apart(directions, picture)[None]
    information = fisher_information(likelihood, picture[None].clamp_min(1e-3), open_, c_i)
    power = (picture - picture.mean()).square().sum().double()
    return float((1 + least_error(information, open_)[0] / power) ** -0.5)


def looked_at(condition: Condition, images: int, draws: int, tangents: list[Tensor]) -> Row:
    """Bounds and scores of the first images of a condition; tangents of the objects are kept for the next one."""
    recipe, solver = condition.recipe(), load_solver()
    batch = tensors(recipe.batch(SEED, SPLIT, range(images)))
    seen, optics, memory = measured(batch, recipe)
    steps = np.arange(1 - FRAME, FRAME)
    between = torch.stack([at_distances(c, np.hypot(steps[:, None], steps)).float() for c in memory])
    likelihood = SpeckleLikelihood(seen._replace(power=seen.power.float(), noise=seen.noise.float()), (FRAME, FRAME),
                                   optics)  # fmt: skip
    objects = framed(batch["object"], FRAME)
    bounds: dict[str, list[float]] = {name: [] for name in BOUNDS}
    pixels = torch.eye(FRAME * FRAME).unflatten(1, (FRAME, FRAME))
    for n, picture in enumerate(objects):
        if n == len(tangents):
            tangents.append(tangent_of(picture))
        spans = (pixels[(picture > 0).flatten()], tangents[n])
        own = likelihood.select(slice(n, n + 1))
        for name, directions in zip(BOUNDS, spans, strict=True):
            bounds[name].append(best_correlation(own, picture, between[n : n + 1], directions))
    posterior = solver.posterior(seen, optics, memory, draws=draws, seed=SEED)
    katz = baselines.katz(Retrieval(restarts=10), recipe=recipe, seed=SEED)
    made = {"Katz": katz(batch), "packaged network": baselines.network(load_pretrained())(batch),
            "solver": solver.solve(seen, optics, memory, seed=SEED).image, "posterior": posterior.mean}  # fmt: skip
    scored = {name: score(image, batch) for name, image in made.items()}
    each = torch.stack([score(image, batch) for image in posterior.draws.unbind(1)], 1)
    with torch.no_grad():
        true = likelihood.excess(objects.clamp_min(1e-3), between)
    rivals = ((posterior.excess <= true[:, None]) & (each < GOOD)).any(1)
    return Row({name: np.array(x) for name, x in bounds.items()}, {name: x.numpy() for name, x in scored.items()},
               posterior.agreement.numpy(), rivals.numpy(), np.array([len(x) for x in tangents[:images]]))  # fmt: skip


def score(image: Tensor, batch: Any) -> Tensor:
    """Pearson correlation with the objects after the best shift and turn, float32[B]."""
    target = framed(batch["object"].float(), 64)
    return pearson(aligned_to(image, target, (64, 64)), target)


def cell(values: np.ndarray) -> str:
    """Mean and its 95 % interval over images."""
    return "{:.3f} [{:.3f}, {:.3f}]".format(*bootstrap(values.astype(float), np.arange(len(values))))


def efficiency(row: Row, name: str) -> float:
    """Mean of 1 - r^2 at the bound of the prior's tangent, over that of a method."""
    return float((1 - row.bounds[BOUNDS[1]] ** 2).mean() / (1 - row.reached[name] ** 2).mean())


def lines_of(condition: Condition, row: Row) -> str:
    """Row of the table."""
    bounds = " | ".join(f"{row.bounds[name].mean():.3f}" for name in BOUNDS)
    reached = " | ".join(f"{cell(row.reached[name])}, {efficiency(row, name):.3f}" for name in METHODS)
    return f"| {condition} | {bounds} | {reached} | {row.agreement.mean():.2f} | {row.rivals.mean():.2f} |"


def draw(out: Path, rows: dict[Condition, Row]) -> None:
    """Draw bound.png."""
    figure, axes = plt.subplots(figsize=(8.5, 4.2))
    at = np.arange(len(rows))
    for n, name in enumerate(BOUNDS):
        axes.plot(at, [row.bounds[name].mean() for row in rows.values()], "_", ms=34, mew=2,
                  color=["0.6", "k"][n], label=f"bound, {name}")  # fmt: skip
    for n, name in enumerate(METHODS):
        found = np.array([bootstrap(row.reached[name].astype(float), np.arange(len(row.agreement)))[:3]
                          for row in rows.values()]).T  # fmt: skip
        axes.errorbar(at + 0.12 * (n - 1.5), found[0], np.abs(found[1:] - found[0]), fmt="o", ms=4, capsize=2,
                      label=name)  # fmt: skip
    names = [f"{c.extent:g} ranges\n{c.camera // 3} grains"
             + ("" if np.isinf(c.photons) else f"\n{c.photons:g} photons") for c in rows]  # fmt: skip
    axes.set_xticks(at, names, fontsize=8)
    axes.set_ylabel("correlation with the object")
    axes.legend(fontsize=8, loc="lower left")
    save(figure, out / "bound.png")


def main(out: Path, quick: bool) -> None:
    """Draw the figure into a folder, and print the table."""
    torch.set_num_threads(1)
    tangents: list[Tensor] = []
    rows = {}
    head = ["extent", "grains a side", "photons", *(f"bound, {x}" for x in BOUNDS), *METHODS, "agreement", "rivals"]
    print(f"| {' | '.join(head)} |\n{'|---' * len(head)}|", flush=True)
    for condition in CONDITIONS[:1] if quick else CONDITIONS:
        row = rows[condition] = looked_at(condition, 2 if quick else 6, 2 if quick else 4, tangents)
        print(lines_of(condition, row), flush=True)
    some = np.array([len(x) for x in tangents])
    print(f"directions of the prior's tangent: {some.mean():.0f} ({some.min()} to {some.max()})")
    draw(out, rows)


if __name__ == "__main__":
    run(main, OUT, __doc__)
