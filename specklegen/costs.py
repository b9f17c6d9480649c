"""What a plan costs: counted operations times nanoseconds, and bytes.

The nanoseconds are those of one core of the machine of the README's table. They scale predictions; a choice
between samplers never rests on a clock.
"""

from dataclasses import dataclass

import numpy as np

from specklegen.fields.nufft import SINGLE_PRECISION_FROM, NufftEvaluator
from specklegen.fields.tiling import MOST_VIEWS
from specklegen.scene import Scene
from specklegen.stationary.cells import stack_axes
from specklegen.tracing import CHUNK

_EVENT = 12.5  # a scattering event
_END = 10.0  # one end of a connection at one tilt or view
_TRANSFORM = 42.0  # spreading one strength, at a tolerance of 1e-3
_VIEW = 3.4  # a connection at a view, summed directly
_FFT_POINT = 12.0
_NORMAL = 20.0  # a complex normal
_VOLUME_EVENT = 150.0  # a scattering event in any geometry
_VOLUME_END = 60.0  # one end of a connection there, at one light or view
_PRODUCT = 0.25  # a complex multiplication and addition within a matrix product
TILTS_STREAMED = 16  # whose fields on one tile are held at a time
_FIXED = 64 * 2**20  # what compiled kernels, libraries and the plan itself take at the first render


@dataclass(frozen=True)
class Work:
    """What there is to do: the scene, the paths and how many events and connections each has, and the way."""

    scene: Scene
    paths: int
    events_per_path: float
    connections_per_path: float
    stationary: bool
    nufft: NufftEvaluator | None
    reverse: bool
    streamed: bool = False


def nufft_nanoseconds(nufft: NufftEvaluator, tilts: int, connections: float) -> float:
    """Nanoseconds to evaluate connections by NUFFT on all tiles."""
    width = np.ceil(-np.log10(0.3 * nufft.tolerance)) + 1
    spread = _TRANSFORM * (width / 5) ** 2 * (1 if nufft.tolerance >= SINGLE_PRECISION_FROM else 2)
    spreads = nufft.tiles * nufft.spreads * connections * (spread * tilts + _END)
    points = nufft.tiles * nufft.rank * tilts * _FFT_POINT * 4 * np.prod(nufft.tiling.shape)
    return float(spreads + points + connections * _END * tilts)


def direct_nanoseconds(tilts: int, connections: float, views: int) -> float:
    """Nanoseconds to evaluate connections by the direct sum."""
    return connections * (views * (_VIEW + 2.0 * tilts) + _END * tilts)


def seconds(work: Work, threads: int) -> float:
    """Seconds for one realization of a render, its preparation included."""
    views = int(np.prod(work.scene.sensor.shape))
    tilts = len(work.scene.beams.directions)
    connections = work.paths * work.connections_per_path
    tracing = work.paths * work.events_per_path * _EVENT / threads
    if work.stationary:
        pitch = work.scene.sensor.pitch / work.scene.speckle_size  # type: ignore[union-attr]
        cells = np.prod([n * pitch + 10 for n in work.scene.sensor.shape])
        return float(1e-9 * (tracing + tilts * (cells * _NORMAL + views * 6.0)) + 5e-3)
    if work.nufft:
        return 1e-9 * (tracing + nufft_nanoseconds(work.nufft, tilts, connections) / threads)
    return 1e-9 * (tracing + direct_nanoseconds(tilts, connections, views) * (2 if work.reverse else 1) / threads)


def memory_bytes(work: Work, threads: int) -> int:
    """Bytes by which the process grows at most in a render."""
    views = float(np.prod(work.scene.sensor.shape))
    tilts = len(work.scene.beams.directions)
    if work.streamed:
        return _streamed_bytes(work, tilts)
    connections = min(work.paths, CHUNK) * work.connections_per_path
    bank = connections * (14 * 8 + 12) * 2
    if work.stationary:
        return int(work.paths * work.connections_per_path * 160 + 8 * views * tilts * 4 + _FIXED)
    if work.nufft:
        per = 8 if work.nufft.tolerance >= SINGLE_PRECISION_FROM else 16
        beside = 1 if work.nufft.tiles == 1 else threads  # tiles held at a time
        tile = tilts * float(np.prod(work.nufft.tiling.shape)) * per
        field = 2 * tilts * views * per + tile * (work.nufft.rank / 4 + 1 + threads) * beside
        strengths = 16 * (tilts + beside * work.nufft.rank) + per * tilts * threads
        return int(bank * 1.5 + connections * strengths + field + _FIXED)
    return int(bank + connections * 16 * 2 * tilts + tilts * views * 16 * 3 + _FIXED)


def _streamed_bytes(work: Work, tilts: int) -> int:
    """Bytes by which the process grows where one tile, or one tilt, is in work at a time."""
    connections = min(work.paths, CHUNK) * work.connections_per_path
    if work.stationary:
        x, y = stack_axes(work.scene)
        cells, period = float(x.count * y.count), float(x.period * y.period)
        kernel = work.paths * work.connections_per_path * 160
        return int(kernel + cells * (8 * tilts + 64) + 8 * 4 * period + _FIXED)
    bank = connections * ((14 * 8 + 12) * 3 + 16)
    together = min(tilts, TILTS_STREAMED)
    side = np.minimum(work.scene.sensor.shape, MOST_VIEWS)
    tile = float(np.prod(side)) * together * 16
    rank = work.nufft.rank if work.nufft else 0
    return int(bank + connections * 16 * (2 * together + rank) + tile * (3 + rank / 4) + _FIXED)


@dataclass(frozen=True)
class VolumeWork:
    """What there is to do in any geometry."""

    scene: Scene
    paths: int
    events_per_path: float
    connections_per_path: float
    ways: int
    covariance: bool


def volume_seconds(work: VolumeWork, threads: int) -> float:
    """Seconds for the first realization of a scene of any geometry."""
    lights, views = len(work.scene.lights), len(work.scene.views)
    connections = work.paths * work.connections_per_path * work.ways
    pairs = float(lights * views)
    products = pairs * (pairs / 2 if work.covariance else 1.0)
    ends = connections * (lights + views) * _VOLUME_END
    events = work.paths * work.events_per_path * _VOLUME_EVENT
    return 1e-9 / threads * (events + ends + connections * products * _PRODUCT)


def volume_memory_bytes(work: VolumeWork) -> int:
    """Bytes by which the process grows at most."""
    pairs = float(len(work.scene.lights) * len(work.scene.views))
    paths = work.paths / 64 if work.covariance else min(work.paths, CHUNK)
    bank = paths * work.connections_per_path * (14 * 8 + 20) * 2
    matrices = pairs**2 * (16 * 6 + 8 * 3) if work.covariance else pairs * 16 * 3
    return int(bank + matrices + 2**26 + _FIXED)
