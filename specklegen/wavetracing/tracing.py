"""Light through a scene by beams: power on receivers, with a ledger that closes to the last count.

Weakly-local wave optics: a beam's cone finds the *regions* in which it interacts; inside a region everything
interferes, and between regions intensities add. Power splits by chance: each beam carries one ray of its Wigner
ensemble, which meets matter or passes, so that reflected, absorbed and diffracted shares are counts of beams.

Source: S. Steinberg, M. Pharr, *Wave Tracing: Generalizing the Path Integral to Wave Optics*. What is wrong by design:
light that reaches a point through two regions does not interfere; penumbrae widen by about a beam's cross-section; near
a region, at a Fresnel number above 0.1, the pattern is that of the far field.
"""

import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from specklegen.core.errors import DoubtWarning, reject
from specklegen.core.parallel import Threads, in_turn, thread_count
from specklegen.core.random_streams import Seed, Stream, stream_key
from specklegen.core.showing import short
from specklegen.kernels import beam_walk
from specklegen.wavetracing.emitters import CollimatedEmitter, Emitter, PointEmitter
from specklegen.wavetracing.facets import Facets, facets_of
from specklegen.wavetracing.geometry import Geometry
from specklegen.wavetracing.plane import Plane

Mode = Literal["wave", "ballistic", "ray"]
Amplitude = Literal["auto", "uniform", "gaussian"]

_MODES: dict[str, int] = {"wave": beam_walk.WAVE, "ballistic": beam_walk.BALLISTIC, "ray": beam_walk.RAY}
_AMPLITUDES: dict[str, int] = {"auto": 0, "uniform": 1, "gaussian": 2}
_BLOCK, _BLOCKS = 2048, 64  # beams of a block at least; blocks at most


@dataclass(frozen=True)
class Ledger:
    """How beams ended: every beam once.

    Attributes
    ----------
    received : int
        Left the scene after crossing a receiver; receivers let light pass.
    absorbed, escaped : int
        On a surface; out of the scene without crossing a receiver.
    stopped : int
        After ``max_events`` interactions.
    failed : int
        No wavevector could be drawn: the opening has no area, or every try was refused.
    """

    received: int
    absorbed: int
    escaped: int
    stopped: int
    failed: int

    @property
    def total(self) -> int:
        """All beams."""
        return self.received + self.absorbed + self.escaped + self.stopped + self.failed


@dataclass(frozen=True)
class Statistics:
    """What beams met, in counts.

    Attributes
    ----------
    surface, open, matter, null : int
        Ordinary surface events; regions passed; regions in which matter was hit; regions that changed nothing: without
        edge or hit, or with nothing open as the mean of the beam sees them.
    restarts, plain_rays : int
        Stretches lengthened because the cone touched at once; beams that went on as a plain ray after 16 of them.
    uniform, gaussian, local_chirp : int
        Patterns of uniform and of Gaussian light; of the latter those whose phase, too curved for the
        grid, was taken out.
    trials, evanescent : int
        Proposals of the sampler of uniform patterns; draws above the wavenumber, drawn again.
    regions, region_triangles, crossings : int
        Regions looked at, triangles in them, and crossings of receivers.
    region_area : float
        Mean cross-section of a region (an area); 0 without any.
    """

    surface: int
    open: int
    matter: int
    null: int
    restarts: int
    plain_rays: int
    uniform: int
    gaussian: int
    trials: int
    evanescent: int
    region_triangles: int
    regions: int
    crossings: int
    local_chirp: int
    region_area: float

    @property
    def ballistic_share(self) -> float:
        """Share of interactions that were ordinary surface events, outside all regions."""
        return self.surface / max(1, self.surface + self.open + self.matter)


@dataclass(frozen=True)
class WaveTrace:
    """Power on receivers.

    Attributes
    ----------
    irradiance : list of float64[h, w]
        Power through each pixel over its area, one array a receiver.
    standard_error : list of float64[h, w]
        Of each value.
    fluence, fluence_error : list of float64[h, w]
        Power over the area across the light, the sum of w / (A |cos|): what a small sphere receives.
    ledger : Ledger
    statistics : Statistics
    """

    irradiance: list[np.ndarray]
    standard_error: list[np.ndarray]
    fluence: list[np.ndarray]
    fluence_error: list[np.ndarray]
    ledger: Ledger
    statistics: Statistics

    __repr__ = short


def trace(
    geometry: Geometry,
    emitter: Emitter,
    planes: Plane | Sequence[Plane],
    beams: int,
    seed: Seed,
    mode: Mode = "wave",
    diffraction: Literal["fraunhofer"] = "fraunhofer",
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
        A `CollimatedEmitter` or a `PointEmitter`.
    planes
        Receivers. Light passes them; a beam that crosses several, or one twice, counts in each.
    beams
        How many.
    seed
        A whole number, or a sequence of them. Beam n is the same for any number of beams and threads.
    mode
        "wave"; "ballistic": the mean ray finds what is met, which injects energy behind openings; "ray": geometrical
        optics.
    diffraction
        "fraunhofer": directions from the far-field pattern of each region.
    amplitude
        Light in an opening. "uniform": u = 1 over all holes of the screen met, and the pattern's wavevector added to
        the ray's. "gaussian": the beam's own field, added to the mean. "auto": uniform where all edges in the region
        border holes that lie in it wholly, else gaussian.
    max_events
        Interactions after which a beam is stopped, and counted as such.
    threads
        Does not change the result by a bit.

    Returns
    -------
    WaveTrace

    Raises
    ------
    RuleError
        For an argument out of range.

    A `DoubtWarning` says where edges are shorter than the wavelength, for which Fraunhofer's pattern is no model.
    """
    planes = [planes] if isinstance(planes, Plane) else list(planes)
    if not isinstance(geometry, Geometry):
        reject("trace geometry", "a Geometry", geometry)
    if not isinstance(emitter, CollimatedEmitter | PointEmitter):
        reject("trace emitter", "a CollimatedEmitter or a PointEmitter", emitter)
    if isinstance(beams, bool) or not isinstance(beams, int | np.integer) or not 1 <= beams < 2**48:
        reject("trace beams", "a whole number of at least 1", beams)
    for name, value, allowed in (("mode", mode, _MODES), ("amplitude", amplitude, _AMPLITUDES)):
        if value not in allowed:
            reject(f"trace {name}", f"one of {', '.join(allowed)}", value)
    if diffraction != "fraunhofer":
        reject("trace diffraction", "'fraunhofer'", diffraction)
    if isinstance(max_events, bool) or not isinstance(max_events, int | np.integer) or max_events < 0:
        reject("trace max_events", "a whole number of at least 0", max_events)
    facets = facets_of(geometry)
    if mode != "ray":
        _doubt_short_edges(facets, emitter.wavelength)

    key = stream_key(seed, Stream.BEAMS)
    materials = np.array([mesh.material.row(emitter.wavelength) for mesh in geometry.meshes])
    packed = np.array([_packed(plane) for plane in planes]).reshape(-1, 15)
    sizes = [plane.shape[0] * plane.shape[1] for plane in planes]
    first_cell = np.concatenate([[0], np.cumsum(sizes)]).astype(np.int64)
    cells = int(first_cell[-1])
    source = emitter.packed()

    def block(part: tuple[int, int], _: Threads) -> tuple[np.ndarray, ...]:
        counts, fluence, squares = np.zeros(cells, np.int64), np.zeros(cells), np.zeros(cells)
        ends, statistics = np.zeros(beam_walk.ENDS, np.int64), np.zeros(beam_walk.STATISTICS, np.int64)
        areas = np.zeros(1)
        beam_walk.walk_beams(
            *key, part[0], part[1], _MODES[mode], _AMPLITUDES[amplitude], max_events, source, emitter.wavelength,
            geometry.boxes, geometry.link, geometry.corners, *facets[:10], facets.most_edges,
            facets.material, materials, packed, first_cell, counts, fluence, squares, ends, statistics, areas,
        )  # fmt: skip
        return counts, fluence, squares, ends, statistics, areas

    # Sums of floats depend on the blocks, so these depend on the number of beams alone.
    size = max(_BLOCK, -(-int(beams) // _BLOCKS))
    parts = [(first, min(size, beams - first)) for first in range(0, beams, size)]
    workers = min(thread_count(threads) if threads is None or isinstance(threads, int) else thread_count(), len(parts))
    total = None
    for found in in_turn(block, parts, workers):
        total = found if total is None else tuple(a + b for a, b in zip(total, found, strict=True))
    assert total is not None
    counts, fluence, squares, ends, statistics, areas = total
    share = emitter.power / beams
    images: list[list[np.ndarray]] = [[], [], [], []]
    for plane, start in zip(planes, first_cell, strict=False):
        part = slice(start, start + plane.shape[0] * plane.shape[1])
        scale = share / plane.pitch**2
        for n, values, second in ((0, counts[part], counts[part]), (2, fluence[part], squares[part])):
            # Crossings of one beam in one pixel are taken as independent.
            deviation = np.sqrt(np.maximum(second - values * (values / beams), 0.0))
            images[n].append((scale * values).reshape(plane.shape))
            images[n + 1].append((scale * deviation).reshape(plane.shape))
    area = float(areas[0]) / max(1, int(statistics[beam_walk.REGIONS]))
    found = Statistics(*statistics.tolist(), region_area=area)
    return WaveTrace(images[0], images[1], images[2], images[3], Ledger(*ends.tolist()), found)


def _packed(plane: Plane) -> np.ndarray:
    """Return float64[15], what kernels know of a receiver: centre, axes, pitch, rows, columns."""
    return np.concatenate([plane.center, plane.axes.ravel(), [plane.pitch, *plane.shape]])


def _doubt_short_edges(facets: Facets, wavelength: float) -> None:
    length = np.linalg.norm(facets.rim_ends[:, 3:] - facets.rim_ends[:, :3], axis=1)
    short = int((length < wavelength).sum())
    if short:
        warnings.warn(
            f"{short} of {len(length)} edges are shorter than a wavelength: Fraunhofer diffraction is no model of them",
            DoubtWarning,
            stacklevel=3,
        )
