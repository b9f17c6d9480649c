"""Phases of connections: random ones, addressed by (path, order), and those that reference directions leave out."""

import numpy as np

from specklegen.core.parallel import Threads, map_blocks, slices
from specklegen.core.random_streams import Seed, Stream, stream_key
from specklegen.kernels import sums
from specklegen.paths.bank import PathBank
from specklegen.paths.layout import Layout

_BLOCK = 16384
_IMAGE = 27  # bits of an address below the number of reflections: more than the vertices of any path
_LEG = 20  # and below the number of the last leg through layers: it has up to 1024


def random_phases(
    bank: PathBank, seed: Seed, sample: int = 0, *, backwards: bool = False, threads: Threads = 1
) -> np.ndarray:
    """complex128[M], one unit phasor z per (path, order, reflections), the same for every light and view.

    ``backwards`` gives those of the same paths walked backwards, where the two ways are incoherent.
    """
    z = np.empty(len(bank), np.complex128)
    key = stream_key(seed, Stream.PHASES)
    # A path has one first leg; its last ones by their reflections. Orders are positive: negative ones are other draws.
    below = _IMAGE if bank.bounces.dtype == np.int8 else _LEG
    orders = bank.orders + (bank.bounces[:, 1].astype(np.int32) << below)
    orders = -orders if backwards else orders
    map_blocks(lambda part: sums.random_phases(*key, sample, orders[part], bank.paths[part], z[part]),
               slices(len(bank), _BLOCK), threads)  # fmt: skip
    return z


def reversal_phases(layout: Layout, bank: PathBank) -> np.ndarray:
    """complex128[M], what the amplitude of a path walked backwards needs beside that of the path.

    Both ways leave out different phases of the reference directions: with r_l and r_v away from the medium, the
    backward one must take e^(-ik (r_l - r_v) . (x_B - x1)) with it. 1 where references are absolute.
    """
    difference = layout.lights.reference - layout.views.reference
    if not difference.any():
        return np.ones(len(bank), np.complex128)
    turns = (bank.exit - bank.entry) @ (difference / layout.wavelength)
    return np.exp(-2j * np.pi * (turns - np.rint(turns)))
