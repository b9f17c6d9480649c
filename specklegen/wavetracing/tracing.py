"""Light through a scene by beams: power on receivers, with a ledger that closes to the last count.

Weakly-local wave optics: a beam's cone finds the *regions* in which it interacts; inside a region everything
interferes, and between regions intensities add. Power splits by chance: each beam carries one ray of its Wigner
ensemble, which meets matter or passes, so that reflected, absorbed and diffracted shares are counts of beams.

Source: S. Steinberg, M. Pharr, *Wave Tracing: Generalizing the Path Integral to Wave Optics*. What is wrong by design:
light that reaches a point through two regions does not interfere; penumbrae widen by about a beam's cross-section; near
a region, at a Fresnel number above 0.1, the pattern is that of the far field.
"""

from collections.abc import Sequence
from typing import Literal

import numpy as np

from specklegen.core.arguments import choice, several, whole_number
from specklegen.core.errors import reject, warn_user
from specklegen.core.parallel import Threads, in_turn, thread_count
from specklegen.core.random_streams import Seed, Stream, stream_key
from specklegen.wavetracing.edge_table import edge_table
from specklegen.wavetracing.emitters import Emitter, GaussianLaser
from specklegen.wavetracing.facets import facets_of, openings_of
from specklegen.wavetracing.geometry import Geometry
from specklegen.wavetracing.kernels import beam_walk
from specklegen.wavetracing.kernels.receivers import RECEIVER, Receivers
from specklegen.wavetracing.kernels.regions import Facets
from specklegen.wavetracing.plane import Plane
from specklegen.wavetracing.smooth_bodies import smooth_parts
from specklegen.wavetracing.wave_trace import Ledger, Statistics, WaveTrace

Mode = Literal["wave", "ballistic", "ray"]
Amplitude = Literal["auto", "uniform", "gaussian"]

_MODES: dict[str, int] = {"wave": beam_walk.WAVE, "ballistic": beam_walk.BALLISTIC, "ray": beam_walk.RAY}
_AMPLITUDES: dict[str, int] = {
    "auto": beam_walk.AUTO, "uniform": beam_walk.UNIFORM_LIGHT, "gaussian": beam_walk.GAUSSIAN_LIGHT,
}  # fmt: skip
_ON_SURFACE = 1e-10  # of the scene's size, within which a receiver lies on a surface
_BLOCK, _BLOCKS = 2048, 64  # beams of a block at least; blocks at most


def trace(
    geometry: Geometry,
    emitter: Emitter,
    planes: Plane | Sequence[Plane],
    beams: int,
    seed: Seed,
    mode: Mode = "wave",
    amplitude: Amplitude = "auto",
    max_events: int = 32,
    threads: Threads = None,
) -> WaveTrace:
    """Trace beams from a source through a scene to receivers.

    Parameters
    ----------
    geometry
        The scene.
    emitter
        A `CollimatedEmitter`, a `PointEmitter` or a `GaussianLaser`.
    planes
        Receivers. Light passes them; a beam that crosses several, or one twice, counts in each. Where a beam meets a
        matt surface it is sent to each receiver besides, so that small and distant ones are reached (not if mode is
        "ballistic"). A receiver on a surface is taken a little off it, on the side of the source: there light counts
        as it comes and as it leaves.
    beams
        How many.
    seed
        A whole number, or a sequence of them. Beam n is the same for any number of beams and threads.
    mode
        "wave"; "ballistic": the mean ray finds what is met, which injects energy behind openings; "ray": geometrical
        optics.
    amplitude
        Light in a hole, or on a plate. "uniform": u = 1 over all holes that the source sees as one, and the pattern's
        wavevector added to the ray's. "gaussian": the beam's own field, added to the mean. Both are right for even
        light. "auto": one of both for all beams of an opening: uniform where the source lights all its corners, or its
        beams are as wide as the largest hole; for a plate, where they are as wide as it is; else gaussian. Past other
        edges it is the beam's own field in any case.
    max_events
        Interactions after which a beam is stopped at the next one, and counted as such.
    threads
        Threads, by default all cores that the process may run on; they do not change the result by a bit.

    Returns
    -------
    WaveTrace

    A `DoubtWarning` says where edges are shorter than the wavelength, for which Fraunhofer's pattern is no model, and
    where bodies are smooth, which beams know by their flat facets alone.

    Examples
    --------
    >>> from specklegen.wavetracing import CollimatedEmitter, Geometry, Plane, perforated_screen, trace
    >>> outline, hole = [[-99, -99], [99, -99], [99, 99], [-99, 99]], [[-2, -2], [2, -2], [2, 2], [-2, 2]]
    >>> screen = perforated_screen(outline, [hole])
    >>> light = CollimatedEmitter([-4, -4, -10], [4, 4, -10], [0, 0, 1], beam_radius=20.0, wavelength=1.0)
    >>> found = trace(Geometry([screen]), light, Plane(center=[0, 0, 500], shape=(8, 8), pitch=50.0), beams=500, seed=1)
    >>> found.irradiance[0].shape, found.ledger.total
    ((8, 8), 500)
    """
    planes = list(several("trace planes", planes, Plane))
    beams = whole_number("trace beams", beams, 1, 2**48 - 1)
    max_events = whole_number("trace max_events", max_events, 0, 2**31 - 1)
    _check(geometry, emitter, mode, amplitude)
    facets = facets_of(geometry)
    planes = [_raised(plane, facets, geometry, emitter) for plane in planes]
    sizes = [plane.shape[0] * plane.shape[1] for plane in planes]
    first_cell = np.concatenate([[0], np.cumsum(sizes)]).astype(np.int64)
    if mode != "ray":
        _doubt_edges(geometry, facets, emitter.wavelength)
    key, materials = stream_key(seed, Stream.BEAMS), _materials(geometry, emitter)
    receivers, table = Receivers(_packed(planes), first_cell), edge_table(geometry, facets)
    source, openings = emitter.packed(), openings_of(facets, table, emitter)
    rules = beam_walk.Rules(_MODES[mode], _AMPLITUDES[amplitude], max_events)

    def walk(part: tuple[int, int], _) -> beam_walk.Tally:
        tally = beam_walk.Tally(
            np.zeros((first_cell[-1], 4)), np.zeros(beam_walk.ENDS, np.int64), np.zeros(beam_walk.STATISTICS, np.int64),
            np.zeros(1),
        )  # fmt: skip
        beam_walk.walk_beams(
            key, part, rules, source, emitter.wavelength, geometry.tree, facets, openings, table, materials, receivers,
            tally,
        )  # fmt: skip
        return tally

    # Sums of floats depend on the blocks, so these depend on the number of beams alone.
    size = max(_BLOCK, -(-beams // _BLOCKS))
    parts = [(first, min(size, beams - first)) for first in range(0, beams, size)]
    workers = min(thread_count(threads) if threads is None or isinstance(threads, int) else thread_count(), len(parts))
    tallies = list(in_turn(walk, parts, workers))
    total = beam_walk.Tally(*(np.sum(columns, axis=0) for columns in zip(*tallies, strict=True)))
    return _result(total, planes, first_cell, emitter.power / beams, beams)


def _check(geometry, emitter, mode, amplitude) -> None:
    """Refuse arguments of `trace` that are out of range."""
    if not isinstance(geometry, Geometry):
        reject("trace geometry", "a Geometry", geometry)
    if not isinstance(emitter, Emitter):
        reject("trace emitter", "a CollimatedEmitter, a PointEmitter or a GaussianLaser", emitter)
    choice("trace mode", mode, _MODES)
    choice("trace amplitude", amplitude, _AMPLITUDES)
    if isinstance(emitter, GaussianLaser) and amplitude == "uniform":
        reject("trace emitter", "even light, parallel or of a point, for 'uniform'", emitter)


def _result(total: beam_walk.Tally, planes: list[Plane], first_cell, share: float, beams: int) -> WaveTrace:
    """Images and ledger of a tally; ``share`` is the power of a beam."""
    images: list[list[np.ndarray]] = [[], [], [], []]
    for plane, start in zip(planes, first_cell, strict=False):
        sums = total.sums[start : start + plane.shape[0] * plane.shape[1]].T
        for n, (values, second) in enumerate(zip(sums[::2], sums[1::2], strict=True)):
            deviation = np.sqrt(np.maximum(second - values * (values / beams), 0.0))
            images[2 * n].append((share / plane.pitch**2 * values).reshape(plane.shape))
            images[2 * n + 1].append((share / plane.pitch**2 * deviation).reshape(plane.shape))
    area = float(total.areas[0]) / max(1, int(total.statistics[beam_walk.REGIONS]))
    met = Statistics(*total.statistics.tolist(), region_area=area)
    return WaveTrace(images[0], images[1], images[2], images[3], Ledger(*total.ends.tolist()), met)


def _materials(geometry: Geometry, emitter: Emitter) -> np.ndarray:
    """Return float64[M, 4], what kernels know of the material of each mesh."""
    return np.array([mesh.material.row(emitter.wavelength) for mesh in geometry.meshes])


def _packed(planes: list[Plane]) -> np.ndarray:
    """Return float64[R, RECEIVER], what kernels know of receivers: centre, axes, pitch, rows, columns."""
    rows = [np.concatenate([plane.center, plane.axes.ravel(), [plane.pitch, *plane.shape]]) for plane in planes]
    return np.array(rows).reshape(-1, RECEIVER)


def _raised(plane: Plane, facets: Facets, geometry: Geometry, emitter: Emitter) -> Plane:
    """Return the receiver; one on a surface a little off it, towards the source, so that no rounding decides."""
    if not len(facets.normals):
        return plane
    normal = plane.axes[2]
    size = float(np.ptp(np.vstack([geometry.vertices, plane.center[None]]), axis=0).max())
    parallel = np.linalg.norm(np.cross(facets.normals, normal), axis=1) < 1e-9
    corner = facets.rim_ends[np.minimum(facets.rims[:-1], len(facets.rim_ends) - 1), :3]
    height = ((corner - plane.center) * normal).sum(axis=1)
    if not (parallel & (np.abs(height) <= _ON_SURFACE * size)).any():
        return plane
    side = float((emitter.origin - plane.center) @ normal)
    return plane.replace(center=plane.center + (1.0 if side >= 0 else -1.0) * 2 * _ON_SURFACE * size * normal)


def _doubt_edges(geometry: Geometry, facets: Facets, wavelength: float) -> None:
    """Warn of edges and bodies for which beams have no pattern."""
    length = np.linalg.norm(facets.rim_ends[:, 3:] - facets.rim_ends[:, :3], axis=1)
    short = int((length < wavelength).sum())
    if short:
        warn_user(
            f"{short} of {len(length)} edges are shorter than a wavelength: Fraunhofer diffraction is no model of them",
        )
    bodies = len(smooth_parts(geometry, 2 * np.pi / wavelength).bodies.starts) - 1
    if bodies:
        warn_user(
            f"trace reflects beams at the flat facets of {bodies} smooth bodies and sends none around them, so that "
            'their shadows are black: use coherent_rays or coverage(method="wave")',
        )
