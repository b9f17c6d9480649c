"""Compute the memory-effect atlas: specklegen/data/atlas-*.npz, and the maps of their errors for docs/atlas.md.

    python scripts/build/make_atlas.py                                    # all tables
    python scripts/build/make_atlas.py --table von-mises-fisher           # one of them

Every node (optical depth, g) of a family of lobes is traced once at albedo 1, until the standard error of C_I is
TARGET or the node has cost EVENTS scatterings; a path of B vertices weighs albedo^B, so the same paths serve every
albedo.
Nodes are kept in the work folder, so that a run that was stopped goes on where it was; every node has its
own seed, and the result does not depend on threads or restarts.
"""

import argparse
from collections.abc import Callable
from dataclasses import dataclass, fields, replace
from pathlib import Path

import numpy as np
from scipy.optimize import brentq
from scipy.special import j0
from tqdm import tqdm

from specklegen.core.statistics import BATCHES, jackknife
from specklegen.memory_effects.atlas import (
    FORWARD,
    HENYEY_GREENSTEIN,
    VON_MISES_FISHER,
    Atlas,
    loss_at,
    single_intensity,
    stencil,
)
from specklegen.memory_effects.correlation import MemoryEffectCorrelation, axial_tracer, lateral_distance
from specklegen.paths.endpoint_factors import contributions
from specklegen.paths.slab_tracer import trace
from specklegen.scene.media import Slab
from specklegen.scene.scatterers import HenyeyGreenstein, Scatterer, VonMisesFisher

VERSION = 1  # part of every node's seed: a change of it is a new, independent table
DEPTHS = 0.4 * 2 ** (np.arange(23) / 3)  # 0.4 ... 64.5
ABSORPTIONS = 0.4 * np.arange(11)
LEVELS = 96
LEAST, TARGET, EVENTS = 2**19, 0.0028, 2e8
CHUNK = BATCHES * 2048  # paths
BINS, LOWEST, HIGHEST = 2048, np.log(1e-6), np.log(1e3)  # of ln(r / thickness)
# Error of interpolation over that at twice the spacing, along each axis: cubics are of fourth order; along g, near
# its lower end, fresh nodes at centres of cells say 1/6.
SHRINK = np.array([1 / 16, 1 / 6, 1 / 16])
AVERAGED = 0.64  # noise at the centre of a cell over that of its nodes, which are independent along two axes
COMPARED = np.geomspace(0.05, 200, 60)  # q over the node's median radius


@dataclass(frozen=True)
class Family:
    """The lobes of a table.

    Attributes
    ----------
    drops : float64[G]
        Nodes of 1 - g. Seeds and files of nodes go by their order here.
    scatterer
        The lobe of a 1 - g.
    seed : (int, ...)
        First part of the seed of every node.
    """

    drops: np.ndarray
    scatterer: Callable[[float], Scatterer]
    seed: tuple[int, ...]


def henyey_greenstein(drop: float) -> Scatterer:
    """Henyey and Greenstein's lobe of a 1 - g."""
    return HenyeyGreenstein(g=1 - drop)


def von_mises_fisher(drop: float) -> Scatterer:
    """The lobe of von Mises and Fisher of a 1 - g, 1 - coth kappa + 1 / kappa = 1 - g."""
    log_kappa = brentq(lambda x: np.log((1 - VonMisesFisher(concentration=np.exp(x)).g) / drop), -10, 20, xtol=1e-13)
    return VonMisesFisher(concentration=float(np.exp(log_kappa)))


def about_isotropic(drops: np.ndarray) -> np.ndarray:
    """The same nodes, and three more about g = 0, where K of Henyey-Greenstein slabs turns fastest."""
    return np.append(drops, np.sqrt(drops[13:16] * drops[14:17]))


FAMILIES = {
    HENYEY_GREENSTEIN: Family(
        about_isotropic(0.0149 * (1.6 / 0.0149) ** (np.arange(17) / 16)), henyey_greenstein, (VERSION,)
    ),  # g = -0.6 ... 0.985
    FORWARD: Family(np.geomspace(0.001, 0.02, 9), henyey_greenstein, (VERSION, 1)),  # g = 0.98 ... 0.999
    VON_MISES_FISHER: Family(np.geomspace(0.001, 0.98, 16), von_mises_fisher, (VERSION, 2)),  # g = 0.02 ... 0.999
}
"""By the names of the tables. The forward one begins where the first ends, and overlaps it by a cell."""


@dataclass(frozen=True)
class Node:
    """What the paths of one (optical depth, g) say about multiple scattering, for every absorption.

    Attributes
    ----------
    share, square : float64[A, BINS]
        Weight, and weight times (r / thickness)^2, per path in each bin of ln(r / thickness).
    errors : float64[A, 3]
        Standard errors of C_I (at the worst q), of ln intensity, of ln half range.
    paths, events : int
    """

    share: np.ndarray
    square: np.ndarray
    errors: np.ndarray
    paths: int
    events: int

    @classmethod
    def load(cls, file: Path) -> "Node":
        """Read a node."""
        with np.load(file) as data:
            return cls(data["share"], data["square"], data["errors"], int(data["paths"]), int(data["events"]))

    def save(self, file: Path) -> None:
        """Write a node; a file is whole or absent."""
        draft = file.with_suffix(".part")
        with draft.open("wb") as out:
            np.savez_compressed(out, **vars(self))
        draft.replace(file)


def levels() -> np.ndarray:
    """Cumulative shares float64[LEVELS + 1] between which radii are kept: dense at both ends."""
    return 0.5 * (1 - np.cos(np.pi * np.arange(LEVELS + 1) / LEVELS))


def radii_of(share: np.ndarray, square: np.ndarray) -> np.ndarray:
    """Ln rms radius between consecutive levels, of a histogram: weight and weight times r^2 in each bin."""
    cumulative = np.concatenate([[0], np.cumsum(share)]) / share.sum()
    second = np.concatenate([[0], np.cumsum(square)]) / share.sum()
    used = np.concatenate([[True], np.diff(cumulative) > 0])
    mean = np.diff(np.interp(levels(), cumulative[used], second[used])) / np.diff(levels())
    return 0.5 * np.log(mean)


def estimate(depth: float, drop: float, scatterer: Scatterer, seed: tuple[int, ...]) -> Node:
    """Trace one node."""
    slab = Slab(thickness=1.0, mean_free_path=1 / depth, scatterer=scatterer)
    tracer = axial_tracer(slab)
    proposal = replace(tracer.proposal, threshold=0.3 * tracer.proposal.threshold)
    loss = loss_at(ABSORPTIONS, depth, drop)  # -ln albedo
    share, square = np.zeros((len(loss), BATCHES, BINS)), np.zeros((len(loss), BINS))
    paths, spent = 0, 0
    while True:
        bank = trace(slab, proposal, seed, CHUNK, first=paths, threads=1)
        spent += bank.events
        batch = (bank.paths - paths) // (CHUNK // BATCHES)
        many = bank.orders > 1
        radius, weight = lateral_distance(bank)[many], contributions(tracer.layout, bank)[many]
        place = (np.log(radius) - LOWEST) * (BINS / (HIGHEST - LOWEST))
        place = np.clip(place, 0, BINS - 1).astype(np.int64)
        cell = batch[many] * BINS + place
        orders = bank.orders[many].astype(np.float64)
        for n, rate in enumerate(loss):
            w = weight * np.exp(-rate * orders)
            share[n] += np.bincount(cell, w, BATCHES * BINS).reshape(BATCHES, BINS)
            square[n] += np.bincount(place, w * radius**2, BINS)
        paths += CHUNK
        if spent >= EVENTS or (
            paths >= LEAST and errors_of(depth, scatterer, loss[0], share[0], square[0], paths)[0] <= TARGET
        ):
            break
    return Node(
        share=share.sum(axis=1) / paths,
        square=square / paths,
        errors=np.array([errors_of(depth, scatterer, *part, paths) for part in zip(loss, share, square, strict=True)]),
        paths=paths,
        events=spent,
    )


def errors_of(depth, scatterer, loss, share, square, paths) -> np.ndarray:
    """Standard errors of C_I (worst q), ln intensity and ln half range from the batches of one histogram."""
    total = share.sum(axis=0)
    radius = np.sqrt(np.divide(square, total, out=np.zeros_like(total), where=total > 0))
    single = single_intensity(depth, np.exp(-loss), scatterer) * paths / BATCHES  # in each batch
    weights = np.append(single * BATCHES, total)
    correlation = MemoryEffectCorrelation(np.append(0.0, radius), weights[None], paths, weights[0] / weights.sum())
    half = correlation.half_range()
    q = COMPARED / np.exp(np.interp(0.5, np.cumsum(total) / total.sum(), np.log(np.maximum(radius, 1e-12))))
    q = np.append(q, half * np.array([0.98, 1.0, 1.02]) if np.isfinite(half) else np.zeros(3))
    light = share.sum(axis=1) + single
    sums = np.column_stack([share @ j0(np.outer(radius, q)) + single, light])
    value, error = jackknife(sums, lambda s: (s[:-1] / s[-1]) ** 2)
    slope = (value[-1] - value[-3]) / 0.04
    bright = jackknife(share.sum(axis=1), np.log)[1]
    return np.array([error.max(), bright, error[-2] / abs(slope) if slope else 0.0])


def nodes(folder: Path, depths: np.ndarray, family: Family) -> list[list[Node]]:
    """Nodes of a whole table, those missing computed; the cheap ones first. Seeds and files go by position."""
    folder.mkdir(parents=True, exist_ok=True)
    table: list[list[Node]] = []
    with tqdm(total=len(depths) * len(family.drops), unit="node") as progress:
        for i, depth in enumerate(depths):
            table.append([])
            for j, drop in enumerate(family.drops.tolist()):
                file = folder / f"node-{i:02d}-{j:02d}.npz"
                if not file.exists():
                    estimate(float(depth), drop, family.scatterer(drop), (*family.seed, i, j)).save(file)
                table[-1].append(Node.load(file))
                progress.update()
    return table


def rows_of(node: Node, depth: float, drop: float) -> np.ndarray:
    """Rows of the table of one node, float64[A, LEVELS + 1]."""
    light = np.log(node.share.sum(axis=1)) + 2 * loss_at(ABSORPTIONS, depth, drop)
    radii = np.array([radii_of(*pair) for pair in zip(node.share, node.square, strict=True)])
    return np.column_stack([radii, light])


def left_out(table: np.ndarray, axis: int, nodes: np.ndarray) -> np.ndarray:
    """Rows predicted by the cubic through the nodes of the other parity along an axis; NaN at its ends."""
    table = np.moveaxis(table, axis, 0)
    out = np.full_like(table, np.nan)
    n = len(table)
    for i in range(1, n - 1):
        others = np.arange((i + 1) % 2, n, 2)
        first, weights = stencil(nodes[i], nodes[others])
        out[i] = np.tensordot(weights, table[others[first : first + 4]], 1)
    return np.moveaxis(out, 0, axis)


def describe(row: np.ndarray, depth: float, scatterer: Scatterer, loss: float, q: np.ndarray):
    """C_I at q, ln intensity and ln half range that a row of the table stands for."""
    shares, albedo = np.diff(levels()), np.exp(-loss)
    single, multiple = single_intensity(depth, albedo, scatterer), albedo**2 * np.exp(row[-1])
    weights = np.append(single, multiple * shares)
    correlation = MemoryEffectCorrelation(np.append(0.0, np.exp(row[:-1])), weights[None], 1, single / weights.sum())
    return correlation(q) ** 2, np.log(weights.sum()), np.log(correlation.half_range())


def interpolation_errors(atlas: Atlas, family: Family) -> np.ndarray:
    """Errors float64[3 axes, D, G, A, 3] at every node when it is left out along an axis: twice the spacing."""
    table, lobes = atlas.table, [family.scatterer(drop) for drop in atlas.drops.tolist()]
    out = np.full((3, *table.shape[:3], 3), np.nan)
    for axis in range(3):
        guess = left_out(table, axis, atlas.axes[axis])
        for place in tqdm(np.argwhere(np.isfinite(guess[..., 0])), unit="node", desc=f"left out along axis {axis}"):
            i, j, k = place
            depth, drop = float(atlas.depths[i]), float(atlas.drops[j])
            loss, lobe = loss_at(atlas.absorptions[k], depth, drop), lobes[j]
            q = COMPARED / np.exp(table[i, j, k, LEVELS // 2])
            true_curve, true_light, true_half = describe(table[i, j, k], depth, lobe, loss, q)
            curve, light, half = describe(guess[i, j, k], depth, lobe, loss, q)
            both = np.isfinite(half) and np.isfinite(true_half)
            out[axis, i, j, k] = (
                np.abs(curve - true_curve).max(), abs(light - true_light), abs(half - true_half) if both else 0.0,
            )  # fmt: skip
    return out


def cells(values: np.ndarray) -> np.ndarray:
    """Largest value at the corners of each cell of the three axes before the last; NaN is left out."""
    for axis in range(-4, -1):
        n = values.shape[axis]
        values = np.fmax(np.take(values, range(n - 1), axis), np.take(values, range(1, n), axis))
    return values


def assemble(grid: list[list[Node]], family: Family) -> Atlas:
    """Table with its bounds: two standard errors at the nodes; or between them, plus the error of interpolation."""
    drops, order = family.drops, np.argsort(family.drops)
    table = np.array(
        [[rows_of(line[j], float(DEPTHS[i]), float(drops[j])) for j in order] for i, line in enumerate(grid)]
    )
    paths = cells(np.array([[line[j].errors for j in order] for line in grid]))
    atlas = Atlas(DEPTHS, drops[order], ABSORPTIONS, np.diff(levels()), table, 2 * paths)
    between = np.tensordot(SHRINK, cells(interpolation_errors(atlas, family)), 1)
    bounds = np.maximum(2 * paths, 2 * AVERAGED * paths + between).astype(np.float32)
    return replace(atlas, table=table.astype(np.float32), bounds=bounds)


def main() -> None:
    """Make the tables and the pictures of their errors."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--table", choices=FAMILIES, action="append", help="which; all without it")
    parser.add_argument("--work", type=Path, default=Path("build/atlas"), help="folder that keeps the nodes")
    parser.add_argument("--out", type=Path, default=Path("specklegen/data"))
    parser.add_argument("--figures", type=Path, default=Path("docs/atlas"))
    arguments = parser.parse_args()
    for name in arguments.table or FAMILIES:
        make(name, arguments.work / name, arguments.out / f"atlas-{name}.npz", arguments.figures / f"{name}.png")


def make(name: str, work: Path, out: Path, picture: Path) -> None:
    """Make one table and the picture of its errors."""
    family = FAMILIES[name]
    grid = nodes(work, DEPTHS, family)
    events = sum(node.events for line in grid for node in line)
    paths = sum(node.paths for line in grid for node in line)
    print(f"{name}: {sum(map(len, grid))} nodes, {paths:.3g} paths, {events:.3g} scatterings")
    table = assemble(grid, family)
    out.parent.mkdir(parents=True, exist_ok=True)
    np.savez_compressed(out, **{field.name: getattr(table, field.name) for field in fields(table)})
    print(f"{out}: {out.stat().st_size / 1e6:.2f} MB")
    for limit in (0.005, 0.01, 0.02):
        share = (table.bounds[..., 0] <= limit).mean(axis=(0, 1))
        print(f"cells with an error of C_I up to {limit}, by absorption: " + " ".join(f"{s:.0%}" for s in share))
    figure(table, picture)


def figure(atlas: Atlas, file: Path) -> None:
    """Map of the bound on C_I, at three absorptions."""
    import matplotlib.pyplot as plt
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import LogNorm

    shown = (0, 3, 6)
    canvas, axes = plt.subplots(1, len(shown), figsize=(12, 3.8), sharey=True, layout="constrained")
    colours = ScalarMappable(LogNorm(1e-3, 0.1))
    for ax, k in zip(axes, shown, strict=True):
        bound = atlas.bounds[:, :, k, 0].T
        ax.pcolormesh(atlas.depths, atlas.drops, bound, norm=colours.norm, cmap=colours.cmap)
        middles = [np.sqrt(nodes[1:] * nodes[:-1]) for nodes in (atlas.depths, atlas.drops)]
        ax.contour(*middles, bound, levels=[0.01], colors="white", linewidths=1)
        title = f"a = {atlas.absorptions[k]:.1f} ... {atlas.absorptions[k + 1]:.1f}"
        ax.set(xscale="log", yscale="log", xlabel="optical depth", title=title)
    axes[0].set_ylabel("1 - g")
    canvas.colorbar(colours, ax=axes, label="bound on the error of |K|²; white: 0.01")
    file.parent.mkdir(parents=True, exist_ok=True)
    canvas.savefig(file, dpi=110)


if __name__ == "__main__":
    main()
