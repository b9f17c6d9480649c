"""Why not plain convolution? One network, trained on speckle of several makers, judged on waves new to all of them.

Draws why.png, and prints its tables: some 20 processor minutes.

Run it by itself: python scripts/figures/why.py --out docs/images [--quick]

How thick are the beads of a row of light behind a slab (four diameters)? The row is as wide behind all slabs, and a
part, some, or many memory-effect ranges wide behind a thin, a middle and a thick one. And how far does the memory
effect of an unknown slab reach, and how thick is it, by six tilts? And how fast is the light behind an unknown slab
forgotten, and how fast are its particles, by the contrast of four exposures? The network, its inputs (correlations) and
its steps are the same for all; either the number of images is, or the processor time to make them and their inputs.
Seeds stand for new images and a new network each. Intervals are of waves' media and seeds together.
"""

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")

import tempfile
import time
from collections.abc import Callable, Iterator
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

import matplotlib.pyplot as plt
import numpy as np
import torch
from _command import run, save
from _why import (
    DIAMETERS,
    FIELD,
    SIDE,
    by_convolution,
    by_waves,
    keep_rows,
    lags,
    of_the_stream,
    registered,
    slab,
    stack_by_waves,
    stacks_by_a_curve,
    stacks_of_the_stream,
)
from _why_motion import contrasts, exposures_by_a_law, exposures_by_waves, exposures_of_the_stream
from matplotlib.axes import Axes

from specklegen.memory_effects.correlation import estimate_correlation
from specklegen.models.metrics import bootstrap

OUT = Path("docs/images")
BATCH, WIDTH = 64, 64  # samples a step, numbers in a layer
MAKERS = {"specklegen": "C0", "convolution, a new pattern each": "C1", "convolution, one pattern": "C2",
          "independent patterns": "C4", "the waves, other media": "0.5"}  # fmt: skip
KINDS = dict(zip(list(MAKERS)[1:4], ("fresh", "one", "independent"), strict=True))
TOLD = ["range", "thickness"]
SOURCES = {"specklegen": "C0", "patterns of a curve by hand": "C3", "no answer but the mean": "0.7"}
MOVING = {"specklegen": "C0", "one exponential by hand": "C3", "no answer but the mean": "0.7"}
TIMES = ["light's time to 1/e", "particles' time"]


class Size(NamedTuple):
    """How much is run."""

    thicknesses: tuple[float, ...] = (8.0, 40.0, 240.0)  # wavelengths
    seeds: int = 3
    images: int = 1000  # that the stream makes; others make as many, and as many as its time allows
    media: int = 12  # that waves judge by, and as many others that they train by
    rows: int = 40  # behind each of them
    slabs: int = 60  # whose tilts waves judge by
    films: int = 24  # of slabs whose exposures waves judge by
    steps: int = 1000  # of networks


QUICK = Size((240.0,), 2, 60, 2, 12, 4, 2, 100)


class Images(NamedTuple):
    """Inputs of a network and answers."""

    seen: np.ndarray  # float32[N, features]
    told: np.ndarray  # int[N] or float[N, targets]


def made(samples: Iterator, inputs: Callable, count: int, seconds: float) -> tuple[Images, int, float]:
    """Take ``count`` samples, and more until ``seconds`` of the processor are over; how many these made, and the end.

    Inputs are worked out within that time.
    """
    begun, found, within, spent = time.process_time(), [], 0, 0.0
    for image, told in samples:
        found.append((inputs(image), told))
        spent = time.process_time() - begun
        within += spent <= seconds
        if len(found) >= count and spent > seconds:
            break
    return Images(*map(np.array, zip(*found, strict=True))), max(within, 1), spent


def trained(sets: list[Images], outputs: int, count: int) -> Callable[[np.ndarray], np.ndarray]:
    """Networks of two hidden layers, one for each set of images, trained side by side; answers are [sets, N, ...].

    They tell classes where answers are whole numbers, else numbers; an answer that is NaN is not asked for.
    """
    draws = torch.Generator().manual_seed(0)
    seen, told = ([torch.from_numpy(x) for x in each] for each in zip(*sets, strict=True))
    middle = torch.stack([x.mean(0) for x in seen])[:, None]
    spread = torch.stack([x.std(0) for x in seen])[:, None] + 1e-6
    classes = told[0].ndim == 1
    shift = torch.stack([torch.zeros(outputs) if classes else x.float().nanmean(0).nan_to_num() for x in told])[:, None]
    sizes = [middle.shape[2], WIDTH, WIDTH, outputs]
    weights = [(torch.rand(len(sets), n, m, generator=draws) * 2 - 1) / n**0.5 for n, m in pairwise(sizes)]
    weights += [torch.zeros(len(sets), 1, m) for m in sizes[1:]]
    weights = [x.requires_grad_() for x in weights]

    def answer(inputs: torch.Tensor, kept: float) -> torch.Tensor:
        found = (inputs - middle) / spread
        for n in range(3):
            found = torch.baddbmm(weights[3 + n], found, weights[n])
            if n < 2:
                found = torch.nn.functional.gelu(found)
            if n == 0 and kept < 1:
                found = found * (torch.rand(found.shape, generator=draws) < kept) / kept
        return found + shift

    steps = torch.optim.AdamW(weights, 2e-3, weight_decay=0.02)
    slower = torch.optim.lr_scheduler.CosineAnnealingLR(steps, count)
    for _ in range(count):
        some = [torch.randint(len(x), (BATCH,), generator=draws) for x in seen]
        found = answer(torch.stack([x[n] for x, n in zip(seen, some, strict=True)]), 0.9)
        truth = torch.stack([x[n] for x, n in zip(told, some, strict=True)])
        if classes:
            loss = torch.nn.functional.cross_entropy(found.flatten(0, 1), truth.flatten()) * len(sets)
        else:
            asked = torch.where(truth.isnan(), found.detach(), truth.float())
            loss = (found - asked).square().mean() * len(sets)
        steps.zero_grad()
        loss.backward()
        steps.step()
        slower.step()

    def answers(inputs: np.ndarray) -> np.ndarray:
        with torch.no_grad():
            found = answer(torch.from_numpy(inputs).expand(len(sets), -1, -1), 1)
        return (found.argmax(2) if classes else found).numpy()

    return answers


def pooled(scores: list[np.ndarray], media: np.ndarray) -> str:
    """Mean score and its interval over media and seeds, of scores of each seed."""
    return "{:.3f} [{:.3f}, {:.3f}]".format(*interval(scores, media))


def interval(scores: list[np.ndarray], media: np.ndarray) -> tuple[float, float, float]:
    """Mean of scores of each seed, and its ends; media and seeds are drawn anew."""
    seeds = np.repeat(np.arange(len(scores)), len(media))
    found = bootstrap(np.concatenate(scores).astype(float), np.tile(media, len(scores)), seeds)
    return found.mean, found.low, found.high


class Beads(NamedTuple):
    """How wide the row is, in ranges; right answers of makers, with as many images and in as much time.

    Answers are lists of bool[N], one for each seed. Then the medium of each, and how many images a maker made.
    """

    wide: float
    right: dict[str, tuple[list[np.ndarray], list[np.ndarray]]]
    media: np.ndarray
    number: dict[str, float]


def beads(thickness: float, size: Size) -> Beads:
    """Train on images of every maker behind one slab, and ask for the beads' diameters by waves."""
    half = estimate_correlation(slab(thickness), 20_000, 0).half_range() / (2 * np.pi) * SIDE
    judged = [by_waves(thickness, 1000 + n, size.rows) for n in range(size.media)]
    other = [by_waves(thickness, 2000 + n, max(size.images // size.media, 4)) for n in range(size.media)]
    media = np.repeat(np.arange(size.media), size.rows)
    test, own = (
        Images(np.array([lags(x) for m in some for x, _ in m]), np.array([n for m in some for _, n in m]))
        for some in (judged, other)
    )
    names, sets = [], []
    number = dict.fromkeys(MAKERS, 0.0)
    first, *others, waves = MAKERS
    for seed in range(size.seeds):
        with tempfile.TemporaryDirectory() as folder:
            keep_rows(Path(folder) / "rows", seed, 300)
            stream = of_the_stream(Path(folder) / "rows", thickness, seed, size.images)
            images, _, seconds = made(stream, lags, size.images, np.inf)
        names += [(first, 0), (first, 1), (waves, 0)]
        sets += [images, images, own]
        for name in others:
            images, within, _ = made(by_convolution(KINDS[name], seed), lags, size.images, seconds)
            names += [(name, 0), (name, 1)]
            sets += [Images(*(x[:count] for x in images)) for count in (size.images, within)]
            number[name] += within / size.seeds
    number |= {first: size.images, waves: len(own.told)}
    right: dict[str, tuple[list[np.ndarray], list[np.ndarray]]] = {name: ([], []) for name in MAKERS}
    for (name, which), told in zip(names, trained(sets, len(DIAMETERS), size.steps)(test.seen), strict=True):
        right[name][which].append(told == test.told)
    return Beads(FIELD / half, right, media, number)


Errors = dict[str, tuple[list[np.ndarray], list[np.ndarray]]]
"""Absolute errors of the first answer and of the second, a list of seeds each, by maker."""


def tilts(size: Size) -> Errors:
    """Errors of log10 of range and thickness, by waves' tilts."""
    stacks = [stack_by_waves(3000 + n) for n in range(size.slabs)]
    return two_numbers(list(SOURCES), stacks, _registered, stacks_of_the_stream, stacks_by_a_curve, size)


def exposures(size: Size) -> Errors:
    """Errors of log10 of the light's time to 1/e and of the particles' own, by waves' exposures."""
    stacks = [exposures_by_waves(4000 + n) for n in range(size.films)]
    return two_numbers(list(MOVING), stacks, contrasts, exposures_of_the_stream, exposures_by_a_law, size)


def two_numbers(
    names: list[str], judged: list, inputs: Callable, stream: Callable, by_hand: Callable, size: Size
) -> Errors:
    """Train on the stream and on what is made by hand in its time, which knows of the first number alone."""
    test = Images(np.array([inputs(x) for x, _ in judged]), np.array([told for _, told in judged]))
    found: Errors = {name: ([], []) for name in names}
    sets = []
    for seed in range(size.seeds):
        images, _, seconds = made(stream(seed, size.images), inputs, size.images, np.inf)
        hand, within, _ = made(by_hand(seed), inputs, size.images, seconds)
        sets += [images, Images(*(x[:within] for x in hand))]
    answers = trained(sets, 2, size.steps)(test.seen)
    answers[1::2, :, 1] = np.nan
    for images, ours, hand in zip(sets[::2], answers[::2], answers[1::2], strict=True):
        for name, told in zip(found, (ours, hand, images.told.mean(0)), strict=True):
            for kept, errors in zip(found[name], np.abs(told - test.told).T, strict=True):
                kept.append(errors)
    return found


def _registered(stack: np.ndarray) -> np.ndarray:
    return registered(stack, 1)


def rows(found: Beads) -> list[str]:
    """Rows of the table of beads."""
    lines = []
    for name, (alike, in_time) in found.right.items():
        cells = [pooled(each, found.media) if each else "" for each in (alike, in_time)]
        lines.append(f"| {found.wide:.1f} ranges | {name} | {' | '.join(cells)} | {found.number[name]:.0f} |")
    ours, others = (found.right[name][1] for name in list(MAKERS)[:2])
    gain = [one.astype(float) - other for one, other in zip(ours, others, strict=True)]
    lines.append(f"| {found.wide:.1f} ranges | gain on new patterns | | {pooled(gain, found.media)} | |")
    return lines


def points(found: Beads) -> dict[str, tuple[float, ...]]:
    """Width and share told rightly of each maker, in equal time where there is one, with the ends of its interval."""
    return {name: (found.wide, *interval(b or a, found.media)) for name, (a, b) in found.right.items()}


Bars = dict[tuple[str, str], tuple[float, ...]]
"""Mean errors by (what, who), with the ends of their intervals."""


def bars(found: Errors, told: list[str]) -> Bars:
    """Mean errors of what was ``told``."""
    by_name = {(what, name): errors for name, both in found.items() for what, errors in zip(told, both, strict=True)}
    media = {key: np.arange(len(errors[0])) for key, errors in by_name.items()}
    return {key: interval(errors, media[key]) for key, errors in by_name.items() if np.isfinite(errors[0]).all()}


def draw(out: Path, beads: list[dict[str, tuple[float, ...]]], tilts: Bars, exposures: Bars) -> None:
    """Draw why.png of points and bars."""
    figure, axes = plt.subplots(1, 3, figsize=(14, 4.2), width_ratios=[1.5, 1, 1])
    for n, (name, color) in enumerate(MAKERS.items()):
        wide, mean, low, high = np.array([each[name] for each in beads]).T
        axes[0].errorbar(wide * 1.04 ** (n - 2), mean, (mean - low, high - mean), fmt="o-", ms=4, capsize=2,
                         color=color, label=name)  # fmt: skip
    axes[0].axhline(1 / len(DIAMETERS), color="0.8", ls=":", label="chance")
    axes[0].set_xscale("log")
    axes[0].set_xlabel("width of the object, memory-effect ranges")
    axes[0].set_ylabel("diameter of beads told rightly")
    axes[0].legend(fontsize=7, loc=(0.02, 0.1))
    draw_bars(axes[1], tilts, SOURCES, TOLD)
    axes[1].set_ylabel("error of log10, by six tilts")
    draw_bars(axes[2], exposures, MOVING, TIMES)
    axes[2].set_ylabel("error of log10, by four exposures")
    save(figure, out / "why.png")


def draw_bars(axes: Axes, found: Bars, colors: dict[str, str], told: list[str]) -> None:
    """Draw the errors of two numbers."""
    for (what, name), (mean, low, high) in found.items():
        n, place = list(colors).index(name), told.index(what)
        axes.bar(place + 0.27 * (n - 1), mean, 0.25, yerr=[[mean - low], [high - mean]], capsize=2,
                 color=colors[name], label=name if place == 0 else None)  # fmt: skip
    axes.set_xticks(range(len(told)), told)
    axes.margins(y=0.35)
    axes.legend(fontsize=8, loc="upper center")


def main(out: Path, quick: bool) -> None:
    """Draw the figure into a folder, and print the tables."""
    torch.set_num_threads(1)
    size, points_of = QUICK if quick else Size(), []
    for thickness in size.thicknesses:
        found = beads(thickness, size)
        print(*rows(found), sep="\n", flush=True)
        points_of.append(points(found))
    errors = [bars(tilts(size), TOLD), bars(exposures(size), TIMES)]
    for of, each in zip(("tilts", "exposures"), errors, strict=True):
        for (what, name), error in each.items():
            print("| {}: {} | {} | {:.3f} [{:.3f}, {:.3f}] |".format(of, what, name, *error), flush=True)
    draw(out, points_of, *errors)


if __name__ == "__main__":
    run(main, OUT, __doc__)
