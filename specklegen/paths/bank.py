"""The path bank: connections of random paths to the sensor, as a struct of arrays."""

from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from specklegen.core.parallel import Threads, map_blocks
from specklegen.kernels import walk

BLOCK = 4096
"""Paths per block: the unit of parallel work, and of every fixed-order sum."""


@dataclass(frozen=True)
class PathBank:
    """Connections of traced paths to the sensor, in path order (struct of arrays over M connections).

    Attributes
    ----------
    records : float64[M, walk.RECORD], or of one or two columns more
        Vertices, directions, weights and path lengths, where they were asked for the momentum transfer, and the Doppler
        shift of what flows; the properties below name the columns.
    orders : int32[M]
        Number of vertices, B.
    paths : int64[M]
        Number of the path.
    types : int32[M, 2]
        Types of the first and of the last particle; 0 where there is one.
    bounces : int8[M, 2], or int16[M, 2] of layers that refract
        Reflections by the faces of a slab, of the first leg before x1 and of the last one behind x_B. Vertices are then
        unfolded: the images from which the leg is straight, with directions to match. 0 where faces are matched. Of
        layers that refract, the numbers of both legs (:mod:`specklegen.paths.legs`); nothing is then unfolded.
    count : int
        Paths traced.
    events : int
        Scattering events simulated.
    unfinished : int
        Paths ended by ``max_order``.
    unfinished_weight : float
        Sum of the weights W that these carried.
    jones : complex128[M, 2, 2] or None
        Of polarised light, what x2 ... x_(B-1) do to it, between the frames of both directions
        (:mod:`specklegen.paths.jones`); without a meaning where light is scattered once.
    """

    records: np.ndarray
    orders: np.ndarray
    paths: np.ndarray
    types: np.ndarray
    bounces: np.ndarray
    count: int
    events: int = 0
    unfinished: int = 0
    unfinished_weight: float = 0.0
    jones: np.ndarray | None = None

    def __len__(self) -> int:
        return len(self.records)

    @property
    def entry(self) -> np.ndarray:
        """float64[M, 3], first vertex x1."""
        return self.records[:, walk.ENTRY : walk.ENTRY + 3]

    @property
    def entry_direction(self) -> np.ndarray:
        """float64[M, 3], direction leaving x1; zero for single scattering."""
        return self.records[:, walk.ENTRY_DIRECTION : walk.ENTRY_DIRECTION + 3]

    @property
    def exit(self) -> np.ndarray:
        """float64[M, 3], last vertex x_B."""
        return self.records[:, walk.EXIT : walk.EXIT + 3]

    @property
    def exit_direction(self) -> np.ndarray:
        """float64[M, 3], direction arriving at x_B; zero for single scattering."""
        return self.records[:, walk.EXIT_DIRECTION : walk.EXIT_DIRECTION + 3]

    @property
    def weight(self) -> np.ndarray:
        """float64[M], W over the probability of keeping."""
        return self.records[:, walk.WEIGHT]

    @property
    def length(self) -> np.ndarray:
        """float64[M], sum of the free flights from x1 to x_B."""
        return self.records[:, walk.LENGTH]

    @property
    def transfer(self) -> np.ndarray:
        """float64[M], sum of 1 - cos theta over x2 ... x_(B-1), each times the mobility of its particle."""
        return self.records[:, walk.TRANSFER]

    @property
    def doppler(self) -> np.ndarray:
        """float64[M], sum of (w_(b-1) - w_b) . V(x_b) over x2 ... x_(B-1): length per unit of time."""
        return self.records[:, walk.FLOW]

    @property
    def single(self) -> Self:
        """The connections of single scattering."""
        return self.select(self.orders == 1)

    @property
    def multiple(self) -> Self:
        """The connections of two and more scatterings."""
        return self.select(self.orders > 1)

    def select(self, mask: np.ndarray | slice) -> Self:
        """Return the connections chosen by a mask, their numbers or a slice."""
        if isinstance(mask, np.ndarray) and mask.dtype == bool:
            mask = np.flatnonzero(mask)  # looked through once, not for every array
        return replace(self, **{name: a[mask] for name, a in vars(self).items() if isinstance(a, np.ndarray)})

    def reversed(self) -> Self:
        """Return the same paths walked backwards; single scattering, its own reverse, is left out."""
        bank = self.multiple
        records = np.empty_like(bank.records)
        records[:, walk.ENTRY : walk.ENTRY + 3] = bank.exit
        records[:, walk.ENTRY_DIRECTION : walk.ENTRY_DIRECTION + 3] = -bank.exit_direction
        records[:, walk.EXIT : walk.EXIT + 3] = bank.entry
        records[:, walk.EXIT_DIRECTION : walk.EXIT_DIRECTION + 3] = -bank.entry_direction
        records[:, walk.WEIGHT :] = bank.records[:, walk.WEIGHT :]
        jones = None if bank.jones is None else backwards(bank.jones, bank.entry_direction, bank.exit_direction)
        # In C order as they were found: another order is another type, for which all kernels compile anew.
        types, bounces = (np.ascontiguousarray(each[:, ::-1]) for each in (bank.types, bank.bounces))
        return replace(bank, records=records, types=types, bounces=bounces, jones=jones)


def walk_frame(directions: np.ndarray) -> np.ndarray:
    """Frames float64[..., 2, 3] across directions float64[..., 3], in which matrices of a walk stand: the kernels'."""
    x, y, z = np.moveaxis(directions, -1, 0)
    sign = np.copysign(1.0, z)
    a = -1.0 / (sign + z)
    b = x * y * a
    first = np.stack([1.0 + sign * x * x * a, sign * b, -sign * x], axis=-1)
    return np.stack([first, np.stack([b, sign + y * y * a, -y], axis=-1)], axis=-2)


def backwards(matrices: np.ndarray, first: np.ndarray, last: np.ndarray) -> np.ndarray:
    """Matrices complex128[M, 2, 2] of paths walked backwards, whose directions float64[M, 3] were first and last."""
    into = walk_frame(last) @ np.swapaxes(walk_frame(-last), -1, -2)
    outof = walk_frame(-first) @ np.swapaxes(walk_frame(first), -1, -2)
    return outof @ np.swapaxes(matrices, -1, -2) @ into


def concatenate(banks: list[PathBank], threads: Threads = 1) -> PathBank:
    """Join banks in the order given; one alone is itself."""
    if len(banks) == 1:
        return banks[0]
    ends = np.cumsum([0, *map(len, banks)])
    total = ends[-1]
    columns = banks[0].records.shape[1] if banks else walk.RECORD
    records, orders, paths = np.empty((total, columns)), np.empty(total, np.int32), np.empty(total, np.int64)
    types = np.empty((total, 2), np.int32)
    bounces = np.empty((total, 2), banks[0].bounces.dtype if banks else np.int8)
    jones = np.empty((total, 2, 2), np.complex128) if banks and banks[0].jones is not None else None

    def copy(n: int) -> None:
        to, bank = slice(ends[n], ends[n + 1]), banks[n]
        records[to], orders[to], paths[to], types[to] = bank.records, bank.orders, bank.paths, bank.types
        bounces[to] = bank.bounces
        if jones is not None:
            jones[to] = bank.jones

    map_blocks(copy, range(len(banks)), threads)
    return PathBank(
        records=records,
        orders=orders,
        paths=paths,
        types=types,
        bounces=bounces,
        count=sum(b.count for b in banks),
        events=sum(b.events for b in banks),
        unfinished=sum(b.unfinished for b in banks),
        unfinished_weight=sum(b.unfinished_weight for b in banks),
        jones=jones,
    )


def columns_of(transfer: bool, flows: bool = False) -> int:
    """Columns of a record, with or without the momentum transfer, and then the Doppler shift of what flows."""
    return (walk.FLOW if flows else walk.TRANSFER) + 1 if transfer else walk.RECORD


def empty_bank(count: int, columns: int = walk.RECORD) -> PathBank:
    """A bank of ``count`` paths without connections."""
    return replace(concatenate([]), count=count, records=np.empty((0, columns)))
