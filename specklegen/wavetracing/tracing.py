"""Light through a scene by beams: power on receivers, with a ledger that closes to the last count.

Weakly-local wave optics: a beam's cone finds the *regions* in which it interacts; inside a region everything
interferes, and between regions intensities add. Power splits by chance: each beam carries one ray of its Wigner
ensemble, which meets matter or passes, so that reflected, absorbed and diffracted shares are counts of beams. With UTD
rays alone are such counts, and edges send rays of their own, of signed weights
(`specklegen.wavetracing.kernels.edge_walk`).

Source: S. Steinberg, M. Pharr, *Wave Tracing: Generalizing the Path Integral to Wave Optics*. What is wrong by design:
light that reaches a point through two regions does not interfere; penumbrae widen by about a beam's cross-section; near
a region, at a Fresnel number above 0.1, the pattern is that of the far field. UTD knows the near field, but no corners.
"""

from collections.abc import Callable, Sequence
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
from specklegen.wavetracing.kernels.edge_walk import Sums, walk_edges
from specklegen.wavetracing.kernels.edge_waves import EdgeTable
from specklegen.wavetracing.kernels.receivers import RECEIVER, Receivers
from specklegen.wavetracing.kernels.regions import Facets
from specklegen.wavetracing.plane import Plane
from specklegen.wavetracing.wave_trace import Ledger, Statistics, WaveTrace

Mode = Literal["wave", "ballistic", "ray"]
Diffraction = Literal["fraunhofer", "utd"]
Amplitude = Literal["auto", "uniform", "gaussian"]

_MODES: dict[str, int] = {"wave": beam_walk.WAVE, "ballistic": beam_walk.BALLISTIC, "ray": beam_walk.RAY}
_AMPLITUDES: dict[str, int] = {
    "auto": beam_walk.AUTO, "uniform": beam_walk.UNIFORM_LIGHT, "gaussian": beam_walk.GAUSSIAN_LIGHT,
}  # fmt: skip
_ON_SURFACE = 1e-10  # of the scene's size, within which a receiver lies on a surface
_BLOCK, _BLOCKS = 2048, 64  # beams of a block at least; blocks at most

_Counts = tuple[np.ndarray, ...]
"""Of a block of beams: sums of w and w^2, of w / |cos| and its square, each float64[cells]; ends; statistics; area of
regions; what edge rays bring to received and absorbed."""


def trace(
    geometry: Geometry,
    emitter: Emitter,
    planes: Plane | Sequence[Plane],
    beams: int,
    seed: Seed,
    mode: Mode = "wave",
    diffraction: Diffraction = "fraunhofer",
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
        A `CollimatedEmitter`, a `PointEmitter` or a `GaussianLaser` (not with UTD).
    planes
        Receivers. Light passes them; a beam that crosses several, or one twice, counts in each. One that lies on a
        surface is taken a little off it, on the side of the source: there light counts as it comes and as it leaves.
    beams
        How many.
    seed
        A whole number, or a sequence of them. Beam n is the same for any number of beams and threads.
    mode
        "wave"; "ballistic": the mean ray finds what is met, which injects energy behind openings; "ray": geometrical
        optics.
    diffraction
        "fraunhofer": directions from the far-field pattern of each region. "utd": rays from edges by the uniform
        theory, for the mean of soft and hard, right from a wavelength behind an edge on; edges must be long, and
        corners send nothing. Mode "wave" only.
    amplitude
        Light in a hole, or on a plate. "uniform": u = 1 over all holes that the source sees as one, and the pattern's
        wavevector added to the ray's. "gaussian": the beam's own field, added to the mean. Both are right for even
        light. "auto": one of both for all beams of an opening: uniform where the source lights all its corners, or its
        beams are as wide as the largest hole; for a plate, where they are as wide as it is; else gaussian. Past other
        edges it is the beam's own field in any case.
    max_events
        Interactions after which a beam is stopped, and counted as such.
    threads
        Threads, by default all cores that the process may run on; they do not change the result by a bit.

    Returns
    -------
    WaveTrace

    A `DoubtWarning` says where edges are shorter than the wavelength, for which Fraunhofer's pattern is no model, or
    than their Fresnel zone towards the nearest receiver, where UTD would need rays from corners.

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
    _check(geometry, emitter, mode, diffraction, amplitude)
    facets = facets_of(geometry)
    planes = [_raised(plane, facets, geometry, emitter) for plane in planes]
    sizes = [plane.shape[0] * plane.shape[1] for plane in planes]
    first_cell = np.concatenate([[0], np.cumsum(sizes)]).astype(np.int64)
    walked = _by_edges if diffraction == "utd" else _by_patterns
    walk = walked(geometry, facets, emitter, planes, first_cell, seed, _MODES[mode], _AMPLITUDES[amplitude], max_events)
    # Sums of floats depend on the blocks, so these depend on the number of beams alone.
    size = max(_BLOCK, -(-beams // _BLOCKS))
    parts = [(first, min(size, beams - first)) for first in range(0, beams, size)]
    workers = min(thread_count(threads) if threads is None or isinstance(threads, int) else thread_count(), len(parts))
    total = None
    for sums in in_turn(lambda part, _: walk(*part), parts, workers):
        total = sums if total is None else tuple(a + b for a, b in zip(total, sums, strict=True))
    assert total is not None
    return _found(total, planes, first_cell, emitter.power / beams, beams)


def _check(geometry, emitter, mode, diffraction, amplitude) -> None:
    """Refuse arguments of `trace` that are out of range."""
    if not isinstance(geometry, Geometry):
        reject("trace geometry", "a Geometry", geometry)
    if not isinstance(emitter, Emitter):
        reject("trace emitter", "a CollimatedEmitter, a PointEmitter or a GaussianLaser", emitter)
    choice("trace mode", mode, _MODES)
    choice("trace diffraction", diffraction, ("fraunhofer", "utd"))
    choice("trace amplitude", amplitude, _AMPLITUDES)
    if diffraction == "utd" and mode != "wave":
        reject("trace diffraction", "'fraunhofer' in the modes 'ballistic' and 'ray'", diffraction)
    if isinstance(emitter, GaussianLaser) and (diffraction == "utd" or amplitude == "uniform"):
        reject("trace emitter", "even light, parallel or of a point, with UTD and for 'uniform'", emitter)
    if diffraction == "utd" and amplitude != "auto":
        reject("trace amplitude", "'auto' with UTD", amplitude, "Its light is each ray's: plane, or of a point.")


def _by_patterns(
    geometry: Geometry, facets: Facets, emitter: Emitter, planes, first_cell, seed, mode, amplitude, max_events
) -> Callable[[int, int], _Counts]:
    """How a block of beams is walked with Fraunhofer's patterns; each weighs 1."""
    if mode != beam_walk.RAY:
        _doubt_short_edges(facets, emitter.wavelength)
    key, materials = stream_key(seed, Stream.BEAMS), _materials(geometry, emitter)
    receivers = Receivers(_packed(planes), first_cell)
    source, cells, rules = emitter.packed(), int(first_cell[-1]), beam_walk.Rules(mode, amplitude, max_events)
    table = edge_table(geometry, facets)
    openings = openings_of(facets, table, emitter)

    def walk(first: int, count: int) -> _Counts:
        tally = beam_walk.Tally(np.zeros(cells, np.int64), np.zeros(cells), np.zeros(cells), *_ledger(), np.zeros(1))
        beam_walk.walk_beams(
            key, (first, count), rules, source, emitter.wavelength, geometry.tree, facets, openings, table, materials,
            receivers, tally,
        )  # fmt: skip
        return tally.counts, *tally, np.zeros(2)

    return walk


def _by_edges(
    geometry: Geometry, facets: Facets, emitter: Emitter, planes, first_cell, seed, mode, amplitude, max_events
) -> Callable[[int, int], _Counts]:
    """How a block of beams is walked with UTD."""
    table = edge_table(geometry, facets)
    _doubt_corners(table, emitter.wavelength, planes)
    key, materials = stream_key(seed, Stream.BEAMS), _materials(geometry, emitter)
    receivers = Receivers(_packed(planes), first_cell)
    source, cells = emitter.packed(), int(first_cell[-1])

    def walk(first: int, count: int) -> _Counts:
        power, power_squares, fluence, fluence_squares = np.zeros((4, cells))
        sums = Sums(power, power_squares, fluence, fluence_squares, *_ledger(), np.zeros(2))
        walk_edges(
            key, first, count, max_events, source, emitter.wavelength, geometry.tree, facets, table, materials,
            receivers, sums,
        )  # fmt: skip
        return *sums[:-1], np.zeros(1), sums.balance

    return walk


def _ledger() -> tuple[np.ndarray, np.ndarray]:
    """Ends and statistics of no beam."""
    return np.zeros(beam_walk.ENDS, np.int64), np.zeros(beam_walk.STATISTICS, np.int64)


def _found(total: _Counts, planes: list[Plane], first_cell: np.ndarray, share: float, beams: int) -> WaveTrace:
    """Images and ledger of summed counts; ``share`` is the power of a beam."""
    power, power_squares, fluence, fluence_squares, ends, statistics, areas, balance = total
    images: list[list[np.ndarray]] = [[], [], [], []]
    for plane, start in zip(planes, first_cell, strict=False):
        part = slice(start, start + plane.shape[0] * plane.shape[1])
        scale = share / plane.pitch**2
        for n, values, second in (
            (0, power[part], power_squares[part]), (2, fluence[part], fluence_squares[part]),
        ):  # fmt: skip
            # Crossings of one beam in one pixel are taken as independent.
            deviation = np.sqrt(np.maximum(second - values * (values / beams), 0.0))
            images[n].append((scale * values).reshape(plane.shape))
            images[n + 1].append((scale * deviation).reshape(plane.shape))
    area = float(areas[0]) / max(1, int(statistics[beam_walk.REGIONS]))
    ledger = Ledger(*ends.tolist(), *balance.tolist())
    met = Statistics(*statistics.tolist(), region_area=area)
    return WaveTrace(images[0], images[1], images[2], images[3], ledger, met)


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


def _doubt_short_edges(facets: Facets, wavelength: float) -> None:
    length = np.linalg.norm(facets.rim_ends[:, 3:] - facets.rim_ends[:, :3], axis=1)
    short = int((length < wavelength).sum())
    if short:
        warn_user(
            f"{short} of {len(length)} edges are shorter than a wavelength: Fraunhofer diffraction is no model of them",
        )


def _doubt_corners(table: EdgeTable, wavelength: float, planes: list[Plane]) -> None:
    """Warn where corners matter: an edge shorter than its Fresnel zone as the nearest receiver sees it."""
    start, along, length = table.edges[:, :3], table.edges[:, 3:6], table.edges[:, 6]
    middle = start + along * (length / 2)[:, None]
    distance = np.min([np.linalg.norm(middle - plane.center, axis=1) for plane in planes], axis=0)
    short = int((length < 2 * np.sqrt(wavelength * distance)).sum())
    if short:
        warn_user(
            f"{short} of {len(length)} edges are shorter than the Fresnel zone of the nearest receiver: corners "
            'matter, from which UTD has no rays here; use diffraction="fraunhofer" there',
        )
