"""Amplitudes of connections: sqrt(W) a at every light and view, forward and reversed.

    a = A_i(x1, w1) B_v(x_B, w_(B-1)),    a^r = A_i(x_B, -w_(B-1)) B_v(x1, -w1)        physics.md 2

Single scattering is its own reverse; its s(i . v) joins both ends.
"""

from typing import Literal

import numpy as np

from specklegen.core.parallel import Threads, map_blocks
from specklegen.kernels import volume_ends, walk
from specklegen.paths.endpoints import Endpoints
from specklegen.paths.tracer import Tracer, VolumeBank

End = Literal["entry", "exit"]
# Position's column, the sign that makes the direction beside it arrive at the end, and the particle's column.
_COLUMNS = {"entry": (walk.ENTRY, -1.0, 0), "exit": (walk.EXIT, 1.0, 1)}
_VIEWS_AT_ONCE = 64


def endpoint_factors(
    tracer: Tracer, bank: VolumeBank, target: Endpoints, end: End, threads: Threads = 1
) -> np.ndarray:
    """complex128[n, M]: profile, attenuation, phase, decay and scattering between one end and each target."""
    column, sign, side = _COLUMNS[end]
    out = np.empty((len(target.vectors), len(bank)), np.complex128)

    def part(start: int) -> None:
        stop = start + _VIEWS_AT_ONCE
        volume_ends.ends(
            tracer.volume, tracer.table, bank.records, column, sign, bank.types, side, target.near,
            target.vectors[start:stop], target.wavelength, target.footprint, target.radius, out[start:stop],
        )  # fmt: skip

    map_blocks(part, range(0, len(out), _VIEWS_AT_ONCE), threads)
    return out


def single_factors(tracer: Tracer, bank: VolumeBank) -> np.ndarray:
    """complex128[T, V, M], s(i . v) of connections of single scattering; [T, V, 1] where all share it."""
    far = not (tracer.lights.near or tracer.views.near)
    if far and len(tracer.table.kinds) == 1:
        bank = bank.select(slice(0, 1))
    lights, targets = tracer.lights, tracer.views
    out = np.empty((len(lights.vectors), len(targets.vectors), len(bank)), np.complex128)
    volume_ends.single_amplitudes(
        tracer.table, bank.records, bank.types, lights.near, lights.vectors,
        targets.near, targets.vectors, out,
    )  # fmt: skip
    return out


def single_amplitudes(tracer: Tracer, bank: VolumeBank, threads: Threads = 1) -> np.ndarray:
    """Amplitudes sqrt(W) a of a bank of single scattering, complex128[T * V, M]."""
    lights = endpoint_factors(tracer, bank, tracer.lights, "entry", threads) * np.sqrt(bank.weight)
    views = endpoint_factors(tracer, bank, tracer.views, "exit", threads)
    pairs = _pairs(lights, views)
    return pairs * single_factors(tracer, bank).reshape(len(pairs), -1) if pairs.size else pairs


def multiple_amplitudes(tracer: Tracer, bank: VolumeBank, reverse: bool, threads: Threads = 1) -> np.ndarray:
    """Amplitudes sqrt(W) a of a bank of multiple scattering, complex128[T * V, n].

    Where paths serve both ways, ``reverse`` adds both amplitudes into one column; without it the two ways
    are columns of their own, incoherent with each other.
    """
    root = np.sqrt(bank.weight)
    forward = _pairs(
        endpoint_factors(tracer, bank, tracer.lights, "entry", threads) * root,
        endpoint_factors(tracer, bank, tracer.views, "exit", threads),
    )
    if not tracer.bidirectional:
        return forward
    backward = _pairs(
        endpoint_factors(tracer, bank, tracer.lights, "exit", threads) * root,
        endpoint_factors(tracer, bank, tracer.views, "entry", threads),
    )
    return forward + backward if reverse else np.concatenate([forward, backward], axis=1)


def _pairs(lights: np.ndarray, views: np.ndarray) -> np.ndarray:
    return (lights[:, None] * views).reshape(len(lights) * len(views), lights.shape[1])
