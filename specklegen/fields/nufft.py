"""Fields on a regular far-field grid by type-1 non-uniform FFTs.

    u_t(v) = sum_m c_t(m) F(m; v) e^(-ik(v_x x_m + v_y y_m)),    F = s(omega . v) tau(x, v) e^(-ik(v_z - 1)z)

F varies slowly with v. An interpolative decomposition writes it through its values at a few skeleton
views, F(m; v) = sum_r F(m; v_r) P_r(v), so that the field is a sum over r of P_r times one transform of
strengths with the exact F at v_r. The decomposition is found on training connections
at Chebyshev nodes in v, from which P_r is interpolated to the grid, and judged on held-out connections at
views of its own: the rank grows until that error is below what was asked, or the evaluator is refused.
"""

from dataclasses import dataclass, replace

import finufft
import numpy as np
from scipy.linalg import qr, solve_triangular

from specklegen.fields import ends
from specklegen.fields.ends import AXIS, Optics
from specklegen.illumination import directions_of_sines
from specklegen.kernels import sums, walk
from specklegen.parallel import map_blocks, slices
from specklegen.sensors import FarFieldGrid
from specklegen.tracing import PathBank

MAX_RANK = 128
TILTS_AT_ONCE = 2
_SORT_FROM = 2**19  # bytes of a transform that no longer stays in the cache: finufft then sorts the points first
_NODES = (3, 5, 9, 17, 25)
_HELD_OUT_VIEWS = 48
SINGLE_PRECISION_FROM = 1e-4  # complex64 carries tolerances down to here


@dataclass(frozen=True)
class ViewFactor:
    """F(m; v) = sum_r F(m; views_r) patterns_r(v) on a grid.

    Attributes
    ----------
    views : float64[R, 3]
        Skeleton views.
    mix : complex128[R, nodes, nodes]
        P_r at Chebyshev nodes; :meth:`pattern` spreads one over the grid.
    rows, columns : float64[H, nodes], float64[W, nodes]
        Interpolation from the nodes to the grid.
    error : float
        Relative root mean square error of F on held-out connections and views, weighted as in the field.
    """

    views: np.ndarray
    mix: np.ndarray
    rows: np.ndarray
    columns: np.ndarray
    error: float

    @property
    def rank(self) -> int:
        """Number of skeleton views."""
        return len(self.views)

    def pattern(self, r: int) -> np.ndarray:
        """P_r on the grid, complex128[H, W]."""
        return self.rows @ self.mix[r] @ self.columns.T


def multiple_factor(bank: PathBank, optics: Optics, grid: FarFieldGrid, tolerance: float) -> ViewFactor | None:
    """Decompose the view factor of multiple scattering; None where no rank up to 128 is good enough.

    Parameters
    ----------
    bank
        Multiple-scattering connections of a pilot; even ones train, odd ones judge.
    tolerance
        Relative root mean square error allowed on the held-out half.
    """
    tilt = optics.tilts.mean(axis=0) if len(optics.tilts) else AXIS
    power = np.zeros(len(bank))
    if len(bank):
        power = ends.full_weights(bank, optics, tilt / np.linalg.norm(tilt), grid.center_direction)
    used = power > 0
    bank, power = bank.select(used), power[used]
    # Weights relative to F at the centre, so that rows weigh what their connections weigh in the field.
    centre = np.abs(ends.sensor_ends(bank, optics, grid.center_direction[None], single=False)[0])
    return _decompose(bank, optics, grid, tolerance, np.sqrt(power) / np.maximum(centre, 1e-300), single=False)


def single_factor(optics: Optics, grid: FarFieldGrid, tolerance: float) -> ViewFactor | None:
    """Decompose the view factor of single scattering, which depends on the depth alone."""
    depth = optics.medium.thickness * (np.arange(64) + 0.5) / 64
    bank = PathBank(np.zeros((64, walk.RECORD)), np.ones(64, np.int32), np.arange(64), 64)
    bank.exit[:, 2] = depth
    return _decompose(bank, optics, grid, tolerance, np.ones(64), single=True)


def _decompose(
    bank: PathBank, optics: Optics, grid: FarFieldGrid, tolerance: float, weight: np.ndarray, *, single: bool
) -> ViewFactor | None:
    if len(bank) < 2:
        return _constant(grid)

    def factor(part: PathBank, views: np.ndarray) -> np.ndarray:
        return ends.sensor_ends(part, optics, views, single=single, axial_only=True).T

    train, test = bank.select(slice(0, None, 2)), bank.select(slice(1, None, 2))
    train_weight, test_weight = weight[0::2, None], weight[1::2, None]
    spots = _held_out_views(grid)
    truth = factor(test, spots.directions) * test_weight
    scale = np.linalg.norm(truth)
    for nodes in _NODES:
        lattice = _Lattice(grid, nodes)
        size = min(len(train), 6 * nodes * nodes + 64)
        values = factor(train.select(slice(0, size)), lattice.directions) * train_weight[:size]
        _, r, pivots = qr(values, mode="economic", pivoting=True)  # type: ignore[misc]
        tails = np.sqrt(np.cumsum(np.square(np.abs(r)).sum(axis=1)[::-1])[::-1])
        # A finer lattice only asks for more; pivoting comes within a factor 2 of the least rank.
        if (tails > tolerance * tails[0]).sum() > 2 * MAX_RANK:
            return None
        # The tails bound the rank from above, generously; the held-out error decides.
        enough = int((tails > 0.2 * tolerance * tails[0]).sum())
        for rank in _ranks(enough, min(MAX_RANK, len(r), size // 2 + 1)):
            mix = np.zeros((rank, nodes * nodes), np.complex128)
            mix[:, pivots] = np.hstack([np.eye(rank), solve_triangular(r[:rank, :rank], r[:rank, rank:])])
            views = lattice.directions[pivots[:rank]]
            guess = (factor(test, views) * test_weight) @ lattice.at(mix, spots.x, spots.y)
            error = float(np.linalg.norm(guess - truth) / scale)
            if error <= tolerance:
                return ViewFactor(views, lattice.cube(mix), *lattice.to_grid(), error)
    return None


def _ranks(enough: int, most: int) -> range:
    """Ranks to try: from the smallest where few are enough, else from a little below."""
    return range(max(1, enough - max(4, enough // 3)), min(enough + 8, most) + 1)


def _constant(grid: FarFieldGrid) -> ViewFactor:
    rows, columns = (np.ones((n, 1)) for n in grid.shape)
    return ViewFactor(grid.center_direction[None], np.ones((1, 1, 1), complex), rows, columns, 0.0)


@dataclass(frozen=True)
class _Spots:
    x: np.ndarray
    y: np.ndarray
    directions: np.ndarray


def _held_out_views(grid: FarFieldGrid) -> _Spots:
    """Views of the grid to judge at: the corners, the centre and a fixed scatter in between."""
    x, y = grid.sines
    scatter = np.random.default_rng(0).random((_HELD_OUT_VIEWS, 2))
    u = np.concatenate([[0, 0, 1, 1, 0.5], scatter[:, 0]])
    v = np.concatenate([[0, 1, 0, 1, 0.5], scatter[:, 1]])
    x, y = x[0] + u * (x[-1] - x[0]), y[0] + v * (y[-1] - y[0])
    return _Spots(x, y, directions_of_sines("view", np.stack([x, y], -1), grid.sign))


class _Lattice:
    """Chebyshev nodes over the grid's rectangle of sines, and interpolation from them."""

    def __init__(self, grid: FarFieldGrid, nodes: int) -> None:
        self.nodes = nodes
        self.x, self.y = grid.sines
        t = np.cos(np.pi * (np.arange(nodes) + 0.5) / nodes)
        self._t = t
        x, y = (_stretch(axis, t) for axis in (self.x, self.y))
        yy, xx = np.meshgrid(y, x, indexing="ij")
        self.directions = directions_of_sines("view", np.stack([xx.ravel(), yy.ravel()], -1), grid.sign)

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

    def at(self, mix: np.ndarray, x: np.ndarray, y: np.ndarray) -> np.ndarray:
        """Interpolate complex128[R, nodes * nodes] to scattered sines: complex128[R, n]."""
        rows, columns = self._matrix(self.y, y), self._matrix(self.x, x)
        return np.einsum("rab,na,nb->rn", self.cube(mix), rows, columns, optimize=True)

    def to_grid(self) -> tuple[np.ndarray, np.ndarray]:
        """Interpolation matrices to the whole grid, float64[H, nodes] and float64[W, nodes]."""
        return self._matrix(self.y, self.y), self._matrix(self.x, self.x)


def _stretch(axis: np.ndarray, t: np.ndarray) -> np.ndarray:
    return 0.5 * (axis[-1] + axis[0]) + 0.5 * (axis[-1] - axis[0]) * t


@dataclass(frozen=True)
class NufftEvaluator:
    """All that the NUFFT needs to know before the run: both view factors and the tolerance."""

    grid: FarFieldGrid
    single: ViewFactor
    multiple: ViewFactor
    tolerance: float

    @property
    def rank(self) -> int:
        """Transforms a tilt."""
        return self.single.rank + self.multiple.rank

    @property
    def error(self) -> float:
        """Relative field error to expect: the decomposition's, measured, and the transform's, asked."""
        return float(np.hypot(self.multiple.error, 0.3 * self.tolerance))


def build_evaluator(bank: PathBank, optics: Optics, grid: FarFieldGrid, tolerance: float) -> NufftEvaluator | None:
    """Decompose a scene's view factors on a pilot bank; None where the field of view is too wide."""
    multiple = multiple_factor(bank.multiple, optics, grid, 0.7 * tolerance)
    single = None if multiple is None else single_factor(optics, grid, 0.7 * tolerance)
    return None if multiple is None or single is None else NufftEvaluator(grid, single, multiple, tolerance)


def nufft_field(
    bank: PathBank,
    optics: Optics,
    phases: np.ndarray,
    evaluator: NufftEvaluator,
    *,
    threads: int | None = None,
) -> np.ndarray:
    """Sum over the connections of a bank, complex[T, H, W], divided by the root of the number of paths.

    complex64 for tolerances of 1e-4 and above, complex128 below. Every transform runs on one thread
    (finufft with more is not reproducible); transforms of different skeleton views run side by side.
    """
    loads = [_load(bank, optics, phases, evaluator, single, threads) for single in (False, True)]
    # A fixed number of tilts a transform, whatever the number of threads: the bits must not depend on it.
    groups = slices(len(optics.tilts), TILTS_AT_ONCE)
    parts = [
        (load, r, group) for load in loads if load.strengths.size for r in range(load.factor.rank) for group in groups
    ]
    transforms = map_blocks(lambda part: _transform(*part, evaluator), parts, threads)
    field = np.zeros((len(optics.tilts), *evaluator.grid.shape), _dtype(evaluator))

    def gather(group: slice) -> None:
        for load in loads:
            mine = [t for part, t in zip(parts, transforms, strict=True) if part[0] is load and part[2] == group]
            if not mine:
                continue
            total = mine[0]
            for transform in mine[1:]:
                total += transform
            if load.single:
                s = ends.single_amplitudes(replace(optics, tilts=optics.tilts[group]), evaluator.grid.directions)
                total *= s.astype(total.real.dtype)
            field[group] += total
        field[group] *= 1 / np.sqrt(max(bank.count, 1))

    map_blocks(gather, groups, threads)
    return field


def _dtype(evaluator: NufftEvaluator) -> type:
    return np.complex64 if evaluator.tolerance >= SINGLE_PRECISION_FROM else np.complex128


@dataclass(frozen=True)
class _Load:
    """Single or multiple scattering, ready to be transformed: M connections, T tilts, R skeleton views.

    Attributes
    ----------
    points : float[2, M]
        Phases a step of the grid along (y, x).
    strengths : complex128[T, M]
        Illumination ends, with all that is common to the views.
    sensor : complex128[R, M]
        Sensor ends at the skeleton views.
    """

    single: bool
    factor: ViewFactor
    points: np.ndarray
    strengths: np.ndarray
    sensor: np.ndarray


def _load(
    bank: PathBank, optics: Optics, phases: np.ndarray, evaluator: NufftEvaluator, single: bool, threads: int | None
) -> _Load:
    grid = evaluator.grid
    factor = evaluator.single if single else evaluator.multiple
    chosen = np.flatnonzero((bank.orders == 1) == single)
    points = np.empty((2, len(chosen)), _dtype(evaluator)().real.dtype)
    strengths = np.empty((len(optics.tilts), len(chosen)), np.complex128)
    sensor = np.empty((factor.rank, len(chosen)), np.complex128)
    # finufft's modes are whole numbers; an even grid is centred between two.
    middle = [c + (0 if n % 2 else grid.pitch / 2) for c, n in zip(grid.center, reversed(grid.shape), strict=True)]

    def fill(part: slice) -> None:
        some, common = bank.select(chosen[part]), np.empty(part.stop - part.start, np.complex128)
        sums.grid_points(
            some.records, grid.pitch / optics.wavelength, np.array(middle) / optics.wavelength, phases[chosen[part]],
            points[0, part], points[1, part], common,
        )  # fmt: skip
        strengths[:, part] = ends.illumination_ends(some, optics, common, single=single)
        sensor[:, part] = ends.sensor_ends(some, optics, factor.views, single=single, axial_only=True)

    map_blocks(fill, slices(len(chosen), ends.BLOCK), threads)
    return _Load(single, factor, points, strengths, sensor)


def _transform(load: _Load, r: int, tilts: slice, evaluator: NufftEvaluator) -> np.ndarray:
    """Term r of the field of some tilts, complex[tilts, H, W]."""
    dtype = np.dtype(_dtype(evaluator))
    ready = (load.strengths[tilts] * load.sensor[r]).astype(dtype)
    plan = finufft.Plan(
        1, evaluator.grid.shape, n_trans=len(ready), eps=0.3 * evaluator.tolerance, isign=-1, dtype=dtype.name,
        nthreads=1, spread_sort=int(np.prod(evaluator.grid.shape) * dtype.itemsize > _SORT_FROM),
    )  # fmt: skip
    plan.setpts(*load.points)
    transform = plan.execute(ready).reshape(len(ready), *evaluator.grid.shape)
    transform *= load.factor.pattern(r).astype(dtype)
    return transform
