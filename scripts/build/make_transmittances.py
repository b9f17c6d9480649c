"""Make the packaged table of transmittance: what share of the light leaves a slab behind, at the atlas's own nodes.

By adding and doubling (van de Hulst, *Multiple Light Scattering*, 1980, ch. 4), the forward peak of the lobe taken for
light that goes straight on (delta-M: Wiscombe, J. Atmos. Sci. 34, 1408 (1977)). It writes
``specklegen/data/transmittance-henyey-greenstein.npz``: ln(transmittance) float32[D, G, A], unscattered light included,
and the nodes of absorption, closer than the atlas's where there is little.

    python scripts/build/make_transmittances.py --out specklegen/data
"""

import argparse
from pathlib import Path

import numpy as np
from numpy.polynomial import legendre

from specklegen.core.quadrature import gauss_legendre
from specklegen.memory_effects.atlas import HENYEY_GREENSTEIN, load, loss_at

NODES = 20
THINNEST = 1e-8
ABSORPTIONS = np.array([0, 0.05, 0.1, 0.15, 0.2, 0.3, 0.4, 0.6, 0.8, 1.2, 1.6, 2.4, 3.2, 4.0])


def transmittance(depth: float, albedos: np.ndarray, g: float) -> np.ndarray:
    """Share of the light that leaves behind, unscattered light included, float64[A] at albedos float64[A]."""
    order = np.arange(2 * NODES)
    peak = float(g) ** (2 * NODES)
    lobe = (float(g) ** order - peak) / (1 - peak)
    depths = depth * (1 - albedos * peak)
    albedos = albedos * (1 - peak) / (1 - albedos * peak)
    x, w = gauss_legendre(NODES)
    mu, w = np.append((1 + x) / 2, 1.0), np.append(w / 2, 0.0)
    ahead, back = (
        (legendre.legvander(side, len(order) - 1) * (order + 0.5) * lobe) @ legendre.legvander(mu, len(order) - 1).T
        for side in (mu, -mu)
    )
    lost = w @ (ahead + back)
    halvings = int(np.ceil(np.log2(depths.max() / THINNEST)))
    thin = depths[:, None] / 2**halvings
    straight = np.exp(-thin / mu)
    scattered = (-albedos[:, None] * np.expm1(-thin / mu))[:, None, :]
    through, returned = ahead / lost * scattered, back / lost * scattered
    for _ in range(halvings):
        twice = (returned * w) @ returned
        again = np.linalg.solve(np.eye(len(w)) - twice * w, twice)
        onward = straight[:, None, :]
        down = through + (again * w) @ through + again * onward
        up = (returned * w) @ down + returned * onward
        through, returned = (
            (through * w) @ down + through * onward + straight[:, :, None] * down,
            returned + (through * w) @ up + straight[:, :, None] * up,
        )
        straight = straight * straight
    return (w @ through)[:, -1] + straight[:, -1]


def main() -> None:
    """Write the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, required=True)
    atlas, out = load(HENYEY_GREENSTEIN), parser.parse_args().out
    found = np.empty((len(atlas.depths), len(atlas.drops), len(ABSORPTIONS)), np.float32)
    for j, drop in enumerate(atlas.drops.tolist()):
        for i, depth in enumerate(atlas.depths.tolist()):
            albedos = np.exp([-loss_at(coordinate, depth, drop) for coordinate in ABSORPTIONS])
            found[i, j] = np.log(transmittance(depth, albedos, 1 - drop))
    np.savez_compressed(out / "transmittance-henyey-greenstein.npz", table=found, absorptions=ABSORPTIONS)


if __name__ == "__main__":
    main()
