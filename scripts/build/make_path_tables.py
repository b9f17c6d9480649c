"""Make the packaged tables of path lengths and momentum transfers, at the nodes of the Henyey-Greenstein atlas.

Every node (optical depth, g) is traced once at albedo 1; a path of B vertices weighs albedo^B, so that the same paths
serve every albedo. As the atlas does with distances, a table keeps the distributions of multiply scattered light as
their quantiles: ln(mean) in bins of fixed shares, narrow at both ends, of the momentum transfer Y and of the length
beyond the thickness, in thicknesses. It writes ``specklegen/data/paths-henyey-greenstein.npz``.

    python scripts/build/make_path_tables.py --out specklegen/data --work build/paths
"""

import argparse
from dataclasses import replace
from pathlib import Path

import numpy as np

from specklegen.memory_effects.atlas import HENYEY_GREENSTEIN, load, loss_at
from specklegen.memory_effects.correlation import axial_tracer
from specklegen.paths.endpoint_factors import contributions
from specklegen.paths.momentum import momentum_transfer
from specklegen.paths.slab_tracer import trace
from specklegen.scene.media import Slab
from specklegen.scene.motion import Brownian
from specklegen.scene.scatterers import HenyeyGreenstein

VERSION = 1  # part of every node's seed
LEVELS = 48
CHUNK, MOST = 2**16, 1_500_000


def levels() -> np.ndarray:
    """Cumulative shares float64[LEVELS + 1] between which means are kept: dense at both ends."""
    return 0.5 * (1 - np.cos(np.pi * np.arange(LEVELS + 1) / LEVELS))


def quantiles(values: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """Ln mean between consecutive levels, of values that rise."""
    share = np.append(0.0, np.cumsum(weights))
    mean = np.append(0.0, np.cumsum(weights * values)) / share[-1]
    return np.log(np.diff(np.interp(levels(), share / share[-1], mean)) / np.diff(levels()))


def node(depth: float, drop: float, seed: tuple[int, ...]) -> np.ndarray:
    """Rows of one node, float64[A, 2 LEVELS]: of Y, of the excess length over the thickness."""
    slab = Slab(
        thickness=1.0, mean_free_path=1 / depth, scatterer=HenyeyGreenstein(g=1 - drop), motion=Brownian(diffusion=1.0)
    )
    tracer = axial_tracer(slab)
    proposal = replace(tracer.proposal, threshold=0.3 * tracer.proposal.threshold, transfer=True)
    parts: list[np.ndarray] = []
    paths = events = held = 0
    least, enough = (2**18, 3e7) if depth < 7 else (2**17, 1e7)  # thick slabs are slow, and their paths well mixed
    while (paths < least or events < enough) and held < MOST and paths < 2**21:
        bank = trace(slab, proposal, seed, CHUNK, first=paths, threads=1)
        paths, events = paths + CHUNK, events + bank.events
        bank = bank.multiple
        excess = bank.entry[:, 2] + bank.length - bank.exit[:, 2]
        parts.append(np.stack([
            momentum_transfer(tracer.layout, bank), excess, contributions(tracer.layout, bank), bank.orders,
        ]))  # fmt: skip
        held += len(bank)
    *values, weight, orders = np.concatenate(parts, axis=1)
    sorts = [np.argsort(value) for value in values]
    found = []
    for coordinate in load(HENYEY_GREENSTEIN).absorptions:
        w = weight * np.exp(-loss_at(coordinate, depth, drop) * orders)
        found.append(np.concatenate([quantiles(v[s], w[s]) for v, s in zip(values, sorts, strict=True)]))
    return np.array(found)


def main() -> None:
    """Write the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--work", type=Path, required=True, help="folder that keeps the nodes of a stopped run")
    parser.add_argument("--deepest", type=float, default=21.0, help="optical depth of the last node")
    arguments = parser.parse_args()
    arguments.work.mkdir(parents=True, exist_ok=True)
    atlas = load(HENYEY_GREENSTEIN)
    rows = []
    depths = atlas.depths[atlas.depths <= arguments.deepest]
    for i, depth in enumerate(depths):
        for j, drop in enumerate(atlas.drops):
            file = arguments.work / f"{i:02d}-{j:02d}.npy"
            if not file.exists():
                np.save(file, node(float(depth), float(drop), (VERSION, 3, i, j)))
            rows.append(np.load(file))
        print(f"optical depth {depth:.3g}", flush=True)
    table = np.array(rows).reshape(len(depths), len(atlas.drops), len(atlas.absorptions), 2, LEVELS)
    np.savez_compressed(
        arguments.out / "paths-henyey-greenstein.npz", shares=np.diff(levels()),
        transfer=table[..., 0, :].astype(np.float32), excess=table[..., 1, :].astype(np.float32),
    )  # fmt: skip


if __name__ == "__main__":
    main()
