"""Light walked through a medium as it goes, collision after collision, to where it leaves.

Nothing is aimed at a view, so that sums over all views come without the variance of connections to narrow ones
(:mod:`specklegen.kernels.analog_walk`). All light here has entered the medium, through its face at the lower end of z.
"""

from typing import NamedTuple, Self

import numpy as np

from specklegen.core.budgets import require_time
from specklegen.core.memory import require_memory
from specklegen.core.nanoseconds import NANOSECONDS
from specklegen.core.parallel import Threads, map_blocks, slices
from specklegen.core.random_streams import Seed, Stream, stream_key
from specklegen.kernels import analog_walk
from specklegen.kernels.analog_walk import SEEN, SEEN_COLUMNS, SEEN_ONCE, SEEN_TURNED, SEEN_X, SEEN_Y, Ends, Steps
from specklegen.paths.endpoints import AXIS
from specklegen.paths.faces import reflectance
from specklegen.paths.phase_tables import phase_table
from specklegen.paths.slab_tracer import events_per_path, require_traceable
from specklegen.paths.steps import crossed, optics
from specklegen.paths.volumes import materials, volume_of
from specklegen.scene.media import Medium, PlaneMedium

_BLOCK = 4096  # paths
_BYTES = 300  # a path, with what is made of it


class Exits(NamedTuple):
    """End points of paths.

    Attributes
    ----------
    position, direction : float64[P, 3]
        On the medium's surface; of travel, inside.
    weight : float64[P]
        Share of the light of each path that absorption has left; 0 of those that roulette ended.
    collisions, face : int64[P]
        Scattering events; ENTRANCE, FAR, SIDE or ENDED of :mod:`specklegen.kernels.analog_walk`.
    transfer, doppler : float64[P]
        Momentum transfer Y and Doppler shift D (:mod:`specklegen.paths.momentum`); 0 of a medium at rest.
    seen : float64[P, SEEN_COLUMNS], or float64[0, SEEN_COLUMNS]
        What is seen of each path along the axis, where it is asked for.
    """

    position: np.ndarray
    direction: np.ndarray
    weight: np.ndarray
    collisions: np.ndarray
    face: np.ndarray
    transfer: np.ndarray
    doppler: np.ndarray
    seen: np.ndarray

    def scattered(self, face: int) -> np.ndarray:
        """Weights float64[P] of the light that was scattered and left by a face, 0 of all other."""
        return np.where((self.face == face) & (self.collisions > 0), self.weight, 0.0)

    def straight(self, face: int) -> np.ndarray:
        """Return whether a path left by a face without a collision, bool[P]."""
        return (self.face == face) & (self.collisions == 0)

    def select(self, chosen: np.ndarray) -> Self:
        """Return the light of the paths bool[P] alone."""
        seen = self.seen[chosen] if len(self.seen) else self.seen
        return type(self)(*(each[chosen] for each in self[:-1]), seen=seen)


def require_walkable(owner: str, medium: Medium, paths: int, beside: float = 0.0) -> None:
    """Refuse media whose light takes too many collisions to leave, and more paths than fit or than anybody waits for.

    Parameters
    ----------
    owner
        The verb that is asked, for messages.
    beside
        Seconds that the verb takes with what the paths find.
    """
    events = events_per_path(medium)
    require_traceable(medium, events)
    took = 1e-9 * NANOSECONDS["volume event"] * events * paths + beside
    require_memory(f"{owner} paths", "held", _BYTES * paths, f"{paths} paths", "Ask for fewer paths.")
    require_time(f"{owner} paths", took, f"{paths} paths", "Ask for fewer paths.")


def walk(
    medium: Medium, light: np.ndarray, paths: int, seed: Seed, *, axis: bool = False, stream: Stream = Stream.PATHS,
    threads: Threads = None,
) -> Exits:  # fmt: skip
    """Walk paths through a medium of three dimensions, from the direction float64[3] of the light in its first layer.

    ``axis`` asks what is seen of light along the axis, straight behind layers.
    """
    volume, table = volume_of(medium, 3), phase_table(materials(medium), 3)
    key = stream_key(seed, stream)
    exits = np.empty((paths, analog_walk.COLUMNS))
    collisions, face = np.empty((2, paths), np.int64)
    turned, shifts = np.zeros(paths if len(volume.mobility) else 0), np.zeros(paths if len(volume.flow) else 0)
    seen, steps = np.empty((paths if axis else 0, SEEN_COLUMNS)), None
    if medium.indices or axis:
        known = optics(medium)  # type: ignore[arg-type]
        steps = Steps(known.indices, known.edges, *known.walls, *crossed(known), seen)

    def block(part: slice) -> None:
        analog_walk.walk_analog(
            *key, part.start, volume, table, medium.faces.indices,
            None if steps is None else steps._replace(seen=seen[part]), light,
            Ends(exits[part], collisions[part], face[part], turned[part], shifts[part]),
        )  # fmt: skip

    map_blocks(block, slices(paths, _BLOCK), threads)
    transfer, shift = (each if len(each) else np.zeros(paths) for each in (turned, shifts))
    return Exits(exits[:, : analog_walk.DX], exits[:, analog_walk.DX : analog_walk.WEIGHT],
                 exits[:, analog_walk.WEIGHT], collisions, face, transfer, shift, seen)  # fmt: skip


def transmittance(slab: PlaneMedium, paths: int, seed: Seed) -> tuple[float, float]:
    """Share of a beam along the axis that leaves by the far face, unscattered light included; its standard error.

    Of a slab with faces, the share of the light that has entered it. The error is at least one path's, since none that
    was lost does not mean that none can be.
    """
    weights = walk(slab, AXIS, paths, seed).scattered(analog_walk.FAR)
    error = max(float(weights.std() / np.sqrt(paths)), 1 / paths)
    straight, back = np.exp(-slab.optical_depth), float(reflectance(slab.faces, np.ones(1))[0])
    return float((1 - back) * straight / (1 - (back * straight) ** 2) + weights.mean()), error


def walked(
    slab: PlaneMedium, paths: int, seed: Seed, threads: Threads = None
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Lateral walks float64[P, 2], directions float64[P, 2], weights float64[P], 0 of light that is not seen, Y and D.

    Of scattered light behind a slab, from a beam along the axis; directions as they are in ``faces.inside``.
    """
    exits = walk(slab, AXIS, paths, seed, threads=threads)
    ways = exits.direction[:, :2]
    if slab.indices:
        ways = ways * (slab.indices[-1] / slab.faces.inside)
    return exits.position[:, :2], ways, exits.scattered(analog_walk.FAR), exits.transfer, exits.doppler


class AxialLight(NamedTuple):
    """Light of each path along the axis behind layers.

    Attributes
    ----------
    displacement : float64[P, 2]
        R, the way of its light from where it came in to where it leaves.
    weight : float64[P]
        Whose mean is the intensity per unit area and steradian outside.
    once : float64[P]
        The part of it that was scattered once.
    transfer : float64[P]
        Momentum transfer Y.
    """

    displacement: np.ndarray
    weight: np.ndarray
    once: np.ndarray
    transfer: np.ndarray


def axial_light(medium: PlaneMedium, paths: int, seed: Seed, threads: Threads = None) -> AxialLight:
    """Walk a plane wave along the axis through layers, seen along the axis: also where they refract."""
    require_traceable(medium, events_per_path(medium))
    seen = walk(medium, AXIS, paths, seed, axis=True, threads=threads).seen
    return AxialLight(seen[:, [SEEN_X, SEEN_Y]], seen[:, SEEN], seen[:, SEEN_ONCE], seen[:, SEEN_TURNED])
