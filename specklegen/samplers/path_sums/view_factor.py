"""The view factor of a connection, through its values at a few skeleton views.

Seen from the middle v_c of a tile of views, a connection that leaves x = (x, y, z) along omega contributes

    s(omega . v) tau(x, v) e^(-ik(v - v_c) . x) = F(m; v) e^(-ik(v - v_c)_xy . (x_xy - z v_c,xy / v_c,z))

with F = s tau e^(ikz |v - v_c|^2 / (2 v_c,z)): projected along v_c, depths leave a phase of second order only (the
identity is exact for unit vectors). Measured from the face where the light comes out, z is a few mean free paths.

F varies slowly with v. An interpolative decomposition, F(m; v) = sum_r F(m; v_r) P_r(v - v_c), is found from
training connections at Chebyshev nodes, from which P_r is interpolated to the views; one set of v_r and P_r serves
all tiles. It is judged on held-out connections and views: the rank grows until the error of the worst tile is
below what was asked, or the tiles are too wide.
"""

from bisect import bisect_left
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cache

import numpy as np
from scipy.linalg import qr, solve_triangular

from specklegen.kernels import walk
from specklegen.kernels.walk import EXIT
from specklegen.paths.bank import PathBank
from specklegen.paths.endpoint_factors import contributions, endpoint_factors, single_factors
from specklegen.paths.endpoints import AXIS, offsets
from specklegen.paths.kept_angles import spread_exits
from specklegen.paths.layout import Layout
from specklegen.samplers.path_sums.tiling import Tile, Tiling

MAX_RANK = 128
_NODES = (3, 5, 7, 9, 13)
_TILES = 4  # along each axis, on which a decomposition is trained
_FEW, _SOME = slice(0, 64), 8
_HELD_OUT_VIEWS = 48
_HELD_OUT_CONNECTIONS = 2**15  # over all tiles
_GRAZING = 0.1
_DEPTHS = 64
_TILTS = 16


@dataclass(frozen=True)
class ViewFactor:
    """F(m; v) = sum_r F(m; v_r) P_r(v - v_c) on every tile of a grid.

    Attributes
    ----------
    steps : float64[R, 2]
        Direction sines (x, y) of the skeleton views relative to a tile's middle.
    mix : complex128[R, nodes, nodes]
        P_r at Chebyshev nodes; :meth:`pattern` spreads one over a tile.
    rows, columns : float64[h, nodes], float64[w, nodes]
        Interpolation from the nodes to a tile.
    error : float
        Relative root mean square error of F on held-out connections and views of the worst tile, weighted as in the
        field.
    """

    steps: np.ndarray
    mix: np.ndarray
    rows: np.ndarray
    columns: np.ndarray
    error: float

    @property
    def rank(self) -> int:
        """Number of skeleton views."""
        return len(self.steps)

    def pattern(self, r: int) -> np.ndarray:
        """P_r on a tile, complex128[h, w]."""
        return self.rows @ self.mix[r] @ self.columns.T


def sagitta(steps: np.ndarray, middle: np.ndarray) -> np.ndarray:
    """|v - v_c|^2 / (2 v_c,z), float64[...], for sines float64[..., 2] relative to v_c, without cancellation."""
    z = np.sign(middle[2]) * np.sqrt(np.clip(1 - np.square(middle[:2] + steps).sum(-1), 0, None))
    along = -(steps * (2 * middle[:2] + steps)).sum(-1) / (z + middle[2])
    return (np.square(steps).sum(-1) + np.square(along)) / (2 * middle[2])


def factor_values(layout: Layout, bank: PathBank, tile: Tile, steps: np.ndarray) -> np.ndarray:
    """F of the connections of a bank at views given relative to a tile's middle, complex128[R, M]."""
    views, middle = tile.views(steps), tile.middle
    if layout.ways is not None:
        return _refracted_values(layout, bank, views, steps, middle)
    turns = np.zeros_like(views)
    turns[:, 2] = -sagitta(steps, middle) / layout.wavelength
    values = endpoint_factors(layout, bank, layout.views.at(views), "exit", turns=turns)
    values *= np.exp(2j * np.pi * turns[:, 2:] * layout.exit_face)
    return values


def _refracted_values(
    layout: Layout, bank: PathBank, views: np.ndarray, steps: np.ndarray, middle: np.ndarray
) -> np.ndarray:
    """View factor of layers that refract: the sensor's end without the phases of the grid."""
    values = endpoint_factors(layout, bank, layout.views.at(views), "exit")
    exits, slope = seen_exits(layout, bank, middle)[:, EXIT : EXIT + 3], middle[:2] / middle[2]
    turns = (steps / layout.wavelength) @ (exits[:, :2] - exits[:, 2:] * slope).T
    turns += exits @ offsets(middle.copy(), layout.views.reference, layout.wavelength)
    turns -= layout.exit_face * sagitta(steps, middle)[:, None] / layout.wavelength
    values *= np.exp(2j * np.pi * (turns - np.rint(turns)))
    return values


def seen_exits(layout: Layout, bank: PathBank, middle: np.ndarray) -> np.ndarray:
    """Records of a bank whose exits lie where straight light puts them that leaves towards the middle of a tile.

    Behind layers that refract, light comes from the depth at which it would have to start without a step.
    """
    if layout.ways is None:
        return bank.records
    way = layout.ways.views.lateral_ways(middle, bank.bounces[:, 1], bank.exit[:, 2])
    records = bank.records.copy()
    records[:, EXIT + 2] = layout.exit_face - way * middle[2]
    return records


def multiple_factor(
    layout: Layout, bank: PathBank, tiling: Tiling, tolerance: float, most: int = MAX_RANK
) -> ViewFactor | None:
    """Decompose the view factor of multiple scattering; None where no rank up to 128 is good enough.

    Parameters
    ----------
    bank
        Multiple-scattering connections of a pilot; even ones train, odd ones judge.
    tolerance
        Relative root mean square error allowed on the held-out half.
    most
        The largest rank of use: None, too, where it takes more by two as some of the held-out half tell.
    """
    tilts = -layout.lights.vectors
    tilt = tilts.mean(axis=0) if len(tilts) else AXIS
    bank = spread_exits(layout, bank)
    centre = tiling.grid.center_direction
    power = np.zeros(len(bank))
    if len(bank):
        power = contributions(layout.at(tilt / np.linalg.norm(tilt), centre), bank)
    used = power > 0
    bank, power = bank.select(used), power[used]
    # Weights relative to F at the centre, so that rows weigh what their connections weigh in the field.
    at_centre = np.abs(endpoint_factors(layout, bank, layout.of_views(centre[None]).views, "exit")[0])
    return _decompose(layout, bank, tiling, tolerance, np.sqrt(power) / np.maximum(at_centre, 1e-300), most)


def single_factor(layout: Layout, tiling: Tiling, tolerance: float) -> ViewFactor | None:
    """Decompose the view factor of single scattering, which depends on the depth alone."""
    return _decompose(layout, _depths(layout), tiling, tolerance, np.ones(_DEPTHS))


def error_of_single(layout: Layout, factor: ViewFactor, tiling: Tiling, bank: PathBank | None = None) -> float:
    """Relative root mean square error of single scattering, s(i . v) included, by the view factor of another light.

    Of the worst of a few tiles and of the types of particle, over depths and at most 16 tilts; or of the connections
    of a ``bank``.
    """
    spots = _held_out_steps(tiling)
    if bank is None:
        bank = _depths(layout)
        seen = [replace(bank, types=np.full_like(bank.types, kind)) for kind in range(len(layout.table.kinds))]
    else:
        seen = [bank.select(_FEW)]
    count = len(layout.lights)
    some = np.unique(np.linspace(0, count - 1, min(count, _TILTS)).round().astype(int))
    layout = layout.of_lights(some)
    nodes = factor.mix.shape[-1]
    patterns = _Lattice(tiling, nodes).at(factor.mix.reshape(factor.rank, nodes**2), spots)

    def values(tile: Tile, steps: np.ndarray, own: PathBank) -> np.ndarray:
        s = single_factors(layout.of_views(tile.views(steps)), own if layout.ways else own.select(slice(0, 1)))
        return np.swapaxes(s * factor_values(layout, own, tile, steps), 1, 2)

    cases = [(tiling.tiles[n], own) for n in _outline(tiling) for own in seen]
    at_nodes = [values(tile, factor.steps, own) for tile, own in cases]
    return _worst(at_nodes, patterns, [values(tile, spots, own) for tile, own in cases])


def _depths(layout: Layout) -> PathBank:
    """Single scattering at depths spread over a slab."""
    bank = PathBank(np.zeros((_DEPTHS, walk.RECORD)), np.ones(_DEPTHS, np.int32), np.arange(_DEPTHS),
                    np.zeros((_DEPTHS, 2), np.int32), np.zeros((_DEPTHS, 2), np.int8), _DEPTHS)  # fmt: skip
    thickness = layout.volume.bounds[1, 2]
    bank.exit[:, 2] = thickness * (np.arange(_DEPTHS) + 0.5) / _DEPTHS
    if not layout.faces.matched:  # one in eight seen after one reflection
        bank.bounces[::8, 1] = 1
        bank.exit[::8, 2] = 2 * (thickness - layout.exit_face) - bank.exit[::8, 2]
    return bank


def _decompose(
    layout: Layout, bank: PathBank, tiling: Tiling, tolerance: float, weight: np.ndarray, dear: int = MAX_RANK
) -> ViewFactor | None:
    if len(bank) < 2:
        return constant_factor(tiling)
    tiles = tiling.tiles
    if min(abs(tile.middle[2]) for tile in tiles) < _GRAZING:
        return None  # the projection along such a view would throw connections far aside
    train, test = bank.select(slice(0, None, 2)), bank.select(slice(1, None, 2))
    train_weight, test_weight = weight[0::2], weight[1::2]
    spots = _held_out_steps(tiling)
    shares = [_share(test, test_weight, n, len(tiles), _HELD_OUT_CONNECTIONS // len(tiles)) for n in range(len(tiles))]
    judges = [(tile, *share) for tile, share in zip(tiles, shares, strict=True)]
    few = [(tile, part.select(_FEW), weights[_FEW]) for tile, part, weights in (judges[n] for n in _outline(tiling))]

    def values(tile: Tile, part: PathBank, weights: np.ndarray, steps: np.ndarray) -> np.ndarray:
        return factor_values(layout, part, tile, steps).T * weights[:, None]

    rough = [values(*judge, spots) for judge in few]
    held_out = _HeldOut(values, judges, spots)
    for nodes in _NODES:
        lattice = _Lattice(tiling, nodes)
        at_nodes = [values(*judge, lattice.steps) for judge in few]
        if _worst(at_nodes, lattice.at(np.eye(nodes**2), spots), rough) > tolerance:
            continue  # no rank helps where the lattice itself does not resolve F
        training = _training_values(train, train_weight, tiling, lattice, values)
        r, pivots = pivoted(training)
        tails = np.sqrt(np.cumsum(np.square(np.abs(r)).sum(axis=1)[::-1])[::-1])
        # A finer lattice only asks for more; pivoting comes within a factor 2 of the least rank.
        if (tails > tolerance * tails[0]).sum() > 2 * MAX_RANK:
            return None
        # The tails bound the rank from above, generously; the held-out error decides.
        regular = int((np.abs(np.diagonal(r)) > 1e-13 * np.abs(r[0, 0])).sum())
        most = min(int((tails > 0.2 * tolerance * tails[0]).sum()) + 8, MAX_RANK, regular, len(training) // 2 + 1)
        some, all_of_them = (held_out.errors(lattice, r[:most], pivots, every) for every in (_SOME, 1))
        guess = bisect_left(range(1, most), -tolerance, key=lambda rank: -some(rank)) + 1
        if guess > dear + 1:
            return None
        factor = _least_rank(lattice, r, pivots, (guess, most), all_of_them, tolerance)
        if factor is not None:
            return factor
    return None


def pivoted(columns: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """R and the pivots of a QR decomposition whose first column leaves the least of all others.

    Pivoting alone starts with the largest column, which often is a corner of the views. The best one lies near their
    middle; where one column is enough, its error is about 0.6 of that from a corner.
    """
    gram = columns.conj().T @ columns
    power = np.diagonal(gram).real
    first = int(np.argmax(np.square(np.abs(gram)).sum(axis=0) / np.maximum(power, 1e-300)))
    others = np.delete(np.arange(len(gram)), first)
    size = np.sqrt(power[first])
    unit = columns[:, [first]] / max(size, 1e-300)
    along = unit.conj().T @ columns[:, others]
    _, r, pivots = qr(columns[:, others] - unit @ along, mode="economic", pivoting=True)  # type: ignore[misc]
    top = np.hstack([[[size]], along[:, pivots]])
    return np.vstack([top, np.pad(r, ((0, 0), (1, 0)))]), np.concatenate([[first], others[pivots]])


def _least_rank(
    lattice: "_Lattice", r: np.ndarray, pivots: np.ndarray, ranks: tuple[int, int], error: Callable[[int], float],
    tolerance: float,
) -> ViewFactor | None:  # fmt: skip
    """The least rank within the tolerance, looked for from the first of ``ranks`` on; None if the second is too low."""
    rank, most = ranks
    while rank < most and error(rank) > tolerance:
        rank += 1
    while rank > 1 and error(rank - 1) <= tolerance:
        rank -= 1
    if error(rank) > tolerance:
        return None
    mix = _mix(r, pivots, rank)
    return ViewFactor(lattice.steps[pivots[:rank]], lattice.cube(mix), *lattice.to_tile(), error(rank))


@dataclass(frozen=True)
class _HeldOut:
    """Data to judge ranks by: ``values`` of F of the connections of all ``judges``, one a tile, at the ``spots``."""

    values: Callable[[Tile, PathBank, np.ndarray, np.ndarray], np.ndarray]
    judges: list[tuple[Tile, PathBank, np.ndarray]]
    spots: np.ndarray
    truths: dict[int, list[np.ndarray]] = field(default_factory=dict)

    def at(self, steps: np.ndarray, every: int) -> list[np.ndarray]:
        """F of every so-manieth connection at some views, complex128[M, n] of each tile."""
        few = slice(None, None, every)
        return [self.values(tile, part.select(few), weights[few], steps) for tile, part, weights in self.judges]

    def errors(self, lattice: "_Lattice", r: np.ndarray, pivots: np.ndarray, every: int) -> Callable[[int], float]:
        """Error by rank; F is found at as many skeleton views as it takes."""
        if every not in self.truths:
            self.truths[every] = self.at(self.spots, every)
        seen = [np.empty((len(truth), 0), np.complex128, order="F") for truth in self.truths[every]]

        def error(rank: int) -> float:
            more = lattice.steps[pivots[seen[0].shape[1] : rank]]
            if len(more):
                seen[:] = [np.hstack(both) for both in zip(seen, self.at(more, every), strict=True)]
            mix = lattice.at(_mix(r, pivots, rank), self.spots)
            return _worst([some[:, :rank] for some in seen], mix, self.truths[every])

        return cache(error)


def _mix(r: np.ndarray, pivots: np.ndarray, rank: int) -> np.ndarray:
    """P_r at the nodes, complex128[rank, nodes * nodes], of a pivoted QR decomposition."""
    mix = np.zeros((rank, r.shape[1]), np.complex128)
    mix[:, pivots] = np.hstack([np.eye(rank), solve_triangular(r[:rank, :rank], r[:rank, rank:])])
    return mix


def _worst(skeletons: list[np.ndarray], mix: np.ndarray, truths: list[np.ndarray]) -> float:
    """Largest relative root mean square error, over tiles, of ``skeletons @ mix``."""
    return max(
        float(np.linalg.norm(some @ mix - truth) / max(np.linalg.norm(truth), 1e-300))
        for some, truth in zip(skeletons, truths, strict=True)
    )


def _share(bank: PathBank, weight: np.ndarray, n: int, of: int, most: int) -> tuple[PathBank, np.ndarray]:
    """Connections that judge tile n: every one in turn, at least 64."""
    stride = max(1, len(bank) // max(most, 64))
    chosen = slice(n % stride if of > 1 else 0, None, stride)
    return bank.select(chosen), weight[chosen]


def _training_values(train: PathBank, weight: np.ndarray, tiling: Tiling, lattice: "_Lattice", values) -> np.ndarray:
    """F at the nodes, complex128[rows, nodes * nodes]: a few tiles spread over the grid, each of equal power."""
    size = min(len(train), 6 * len(lattice.steps) + 64)
    chosen, tiles, rows = _outline(tiling), tiling.tiles, []
    for n, tile in enumerate(tiles[c] for c in chosen):
        part = slice(n, size, len(chosen)) if size > len(chosen) else slice(0, size)
        some = values(tile, train.select(part), weight[part], lattice.steps)
        rows.append(some / max(np.linalg.norm(some), 1e-300))
    return np.concatenate(rows)


def _outline(tiling: Tiling) -> list[int]:
    """Numbers of at most 16 tiles that stand for all: spread over the grid, the corners among them."""
    rows, columns = (np.unique(np.linspace(0, n - 1, _TILES).round().astype(int)) for n in tiling.counts)
    return (rows[:, None] * tiling.counts[1] + columns).ravel().tolist()


def constant_factor(tiling: Tiling) -> ViewFactor:
    """The simplest view factor: the same at all views of a tile."""
    rows, columns = (np.ones((n, 1)) for n in tiling.shape)
    return ViewFactor(np.zeros((1, 2)), np.ones((1, 1, 1), complex), rows, columns, 0.0)


def _held_out_steps(tiling: Tiling) -> np.ndarray:
    """Views to judge a tile at: its corners, its middle and a fixed scatter in between, float64[n, 2] from v_c."""
    x, y = tiling.steps
    scatter = np.random.default_rng(0).random((_HELD_OUT_VIEWS, 2))
    u = np.concatenate([[0, 0, 1, 1, 0.5], scatter[:, 0]])
    v = np.concatenate([[0, 1, 0, 1, 0.5], scatter[:, 1]])
    return np.stack([x[0] + u * (x[-1] - x[0]), y[0] + v * (y[-1] - y[0])], -1)


class _Lattice:
    """Chebyshev nodes over a tile's rectangle of sines, relative to its middle, and interpolation from them."""

    def __init__(self, tiling: Tiling, nodes: int) -> None:
        self.nodes = nodes
        self.x, self.y = tiling.steps
        self._t = np.cos(np.pi * (np.arange(nodes) + 0.5) / nodes)
        x, y = (0.5 * (s[-1] + s[0]) + 0.5 * (s[-1] - s[0]) * self._t for s in (self.x, self.y))
        yy, xx = np.meshgrid(y, x, indexing="ij")
        self.steps = np.stack([xx.ravel(), yy.ravel()], -1)

    def _matrix(self, axis: np.ndarray, points: np.ndarray) -> np.ndarray:
        """Interpolation float64[points, nodes] by Chebyshev polynomials on the nodes."""
        half = max(0.5 * (axis[-1] - axis[0]), 1e-300)
        s = np.clip((points - 0.5 * (axis[-1] + axis[0])) / half, -1, 1)
        order = np.arange(self.nodes)
        weights = np.where(order == 0, 1.0, 2.0) / self.nodes
        return np.cos(np.arccos(s)[:, None] * order) * weights @ np.cos(np.arccos(self._t)[:, None] * order).T

    def cube(self, mix: np.ndarray) -> np.ndarray:
        """View complex128[R, nodes * nodes] as [R, rows, columns]."""
        return mix.reshape(len(mix), self.nodes, self.nodes)

    def at(self, mix: np.ndarray, steps: np.ndarray) -> np.ndarray:
        """Interpolate complex128[R, nodes * nodes] to sines float64[n, 2] from the middle: complex128[R, n]."""
        rows, columns = self._matrix(self.y, steps[:, 1]), self._matrix(self.x, steps[:, 0])
        return np.einsum("rnb,nb->rn", rows @ self.cube(mix), columns)  # in this order: no search for a better one

    def to_tile(self) -> tuple[np.ndarray, np.ndarray]:
        """Interpolation matrices to a whole tile, float64[h, nodes] and float64[w, nodes]."""
        return self._matrix(self.y, self.y), self._matrix(self.x, self.x)
