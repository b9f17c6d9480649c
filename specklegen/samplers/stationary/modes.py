"""Modes of the memory effect: few independent fields for the many correlated beams of an object.

    K(i_j - i_l) = sum_r phi_r(j) phi_r(l)

The beams lie on a lattice, the object's pixels, under a few base tilts. With B discrete orthonormal polynomials on the
lattice, those of total degree d at most in the order of their degree, the coefficients of K are A = B^T K B. K depends
on differences alone, so that A is two small products with the correlations of the polynomials in one dimension. Its
Cholesky factor L gives the modes phi = B L, and its strongest columns are kept, in their order. No pivot, eigenvector
or root is chosen by rounding: neighbours in power stay together, and the order is that of the polynomials.

The degree is 6, that of all polynomials where there are few beams, and rises where the polynomials leave out more
than half of the tolerance. At a quarter to one memory-effect range that takes at most a quarter more modes than the
exact expansion needs at the same tolerance (tests/samplers/stationary/test_modes.py).
Source of the recurrence: Gautschi, *Orthogonal Polynomials* (2004), section 2.2.3, with every step orthogonalised anew.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from specklegen.core.lazy import LazyModule
from specklegen.core.memory import require_memory
from specklegen.core.parallel import one_torch_thread
from specklegen.samplers.stationary.correlation import MemoryEffectCorrelation

if TYPE_CHECKING:
    import torch
else:
    torch = LazyModule("torch")

FIRST_DEGREE, FEW = 6, 16
POLYNOMIAL_SHARE = 0.5
"""Share of the tolerance that the polynomials may leave out."""
_TOGETHER = 0.999  # ratio of the powers of two columns that are kept together
_JITTER = 1e-11  # on the diagonal, over the number of beams: far above rounding, far below any tolerance


@dataclass(frozen=True)
class Lattice:
    """Beams of an object's pixels under base tilts.

    Attributes
    ----------
    shape : (h, w)
        Pixels.
    step : float
        Lateral wavevector between neighbours.
    base : float64[T, 2]
        Lateral wavevectors (x, y) of the base tilts.
    kept : float64[T, T] or None
        What K between beams of two base tilts is multiplied by, where the medium changes between them.
    """

    shape: tuple[int, int]
    step: float
    base: np.ndarray
    kept: np.ndarray | None = None

    @property
    def size(self) -> int:
        """Number of beams, T h w."""
        return len(self.base) * self.shape[0] * self.shape[1]


@dataclass(frozen=True)
class Modes:
    """Modes over a lattice of beams.

    Attributes
    ----------
    values : float64[P, R]
        phi, each beam's intensity (the sum of its squares) 1; beams in the order (tilt, row, column).
    coefficients : float64[N, R]
        Kept columns of the Cholesky factor.
    degree : int
        Highest total degree of the polynomials.
    lattice : Lattice
    """

    values: np.ndarray
    coefficients: np.ndarray
    degree: int
    lattice: Lattice

    def mixing(self, kernel: MemoryEffectCorrelation) -> np.ndarray:
        """Root float64[R, R] that turns these modes into those of another K: phi A A^T phi^T is its matrix.

        Found among the polynomials by least squares, and right where the other K's modes lie in the span of these.
        """
        with one_torch_thread():
            matrix = coefficients(kernel, self.lattice, self.degree)
            back = torch.linalg.pinv(torch.from_numpy(self.coefficients))
            values, vectors = torch.linalg.eigh(back @ matrix @ back.T)
            return ((vectors * values.clamp(min=0).sqrt()) @ vectors.T).numpy()  # symmetric: the only one


def first_degree(shape: tuple[int, ...]) -> int:
    """Degree to begin with: all polynomials of few beams, else 6."""
    return sum(shape) - len(shape) if math.prod(shape) <= FEW else FIRST_DEGREE


@lru_cache(maxsize=64)
def polynomials(count: int, degree: int) -> np.ndarray:
    """Orthonormal polynomials on ``count`` points, float64[count, min(count, degree + 1)], by degree."""
    x = np.linspace(-1, 1, count) if count > 1 else np.zeros(1)
    found = np.full((count, 1), count**-0.5)
    for _ in range(min(count - 1, degree)):
        new = x * found[:, -1]
        for _ in range(2):  # once leaves rounding that grows with the degree
            new = new - found @ (found.T @ new)
        found = np.column_stack([found, new / np.linalg.norm(new)])
    return found


@lru_cache(maxsize=64)
def graded(shape: tuple[int, ...], degree: int) -> np.ndarray:
    """Degrees int64[N, axes] along each axis of the products of polynomials of total degree at most ``degree``."""
    degrees = np.indices([min(n, degree + 1) for n in shape]).reshape(len(shape), -1).T
    total = degrees.sum(axis=1)
    kept = degrees[total <= degree]
    return kept[np.lexsort((*kept.T[::-1], kept.sum(axis=1)))]


@lru_cache(maxsize=64)
def products(count: int, degree: int) -> torch.Tensor:
    """Correlations float64[m * m, 2 count - 1] of two of the m polynomials, by the difference of their points."""
    basis = polynomials(count, degree)
    return torch.from_numpy(np.stack([np.correlate(a, b, "full") for a in basis.T for b in basis.T]))


@lru_cache(maxsize=64)
def folded(count: int, degree: int) -> torch.Tensor:
    """:func:`products` for a K that is even: differences 0, 1, ..., float64[m * m, count]."""
    full = products(count, degree)
    half = full[:, count - 1 :].clone()
    half[:, 1:] += full[:, : count - 1].flip(1)
    return half


@lru_cache(maxsize=64)
def places(shape: tuple[int, int], degree: int) -> torch.Tensor:
    """Where A[i, j] lies in the product (row degrees) x (column degrees), flat: int64[N, N]."""
    rows, columns = graded(shape, degree).T
    m, n = (min(count, degree + 1) for count in shape)
    flat = (rows[:, None] * m + rows) * n * n + columns[:, None] * n + columns
    return torch.from_numpy(flat)


@lru_cache(maxsize=64)
def distances(shape: tuple[int, int]) -> tuple[np.ndarray, np.ndarray]:
    """Different distances of two points of a lattice float64[d], ascending, and which it is, int64[h, w]."""
    squares = np.square(np.arange(shape[0]))[:, None] + np.square(np.arange(shape[1]))
    unique, which = np.unique(squares, return_inverse=True)
    return np.sqrt(unique), which.reshape(shape)


def on_differences(kernel: MemoryEffectCorrelation, shape: tuple[int, int], step: float) -> np.ndarray:
    """K float64[h, w] at the differences (row, column) of two pixels, neither below 0."""
    distance, which = distances(shape)
    return _memory(kernel, step * distance)[which]


def _memory(kernel: MemoryEffectCorrelation, q: np.ndarray) -> np.ndarray:
    """K; 1 where there is no light."""
    return kernel(q) if kernel.weights.any() else np.ones_like(q)


def coefficients(kernel: MemoryEffectCorrelation, lattice: Lattice, degree: int) -> torch.Tensor:
    """A = B^T K B, float64[N, N], of the polynomials of a lattice."""
    shape, tilts = lattice.shape, len(lattice.base)
    if tilts == 1:
        memory = torch.from_numpy(on_differences(kernel, shape, lattice.step))
        return lattice_coefficients(memory, shape, degree)
    h, w = shape
    gap = lattice.base[:, None] - lattice.base
    dy = -lattice.step * np.arange(1 - h, h) + gap[..., 1, None]
    dx = -lattice.step * np.arange(1 - w, w) + gap[..., 0, None]
    distance, which = np.unique(np.hypot(dy[..., :, None], dx[..., None, :]), return_inverse=True)
    memory = torch.from_numpy(_memory(kernel, distance)[which].reshape(tilts, tilts, 2 * h - 1, 2 * w - 1))
    if lattice.kept is not None:
        memory = memory * torch.from_numpy(lattice.kept)[..., None, None]
    between = products(h, degree) @ memory @ products(w, degree).T  # [T, T, m_y^2, m_x^2]
    turns = torch.from_numpy(polynomials(tilts, degree))
    m, n, t = min(h, degree + 1), min(w, degree + 1), turns.shape[1]
    full = torch.einsum("st,ui,suabcd->tiabcd", turns, turns, between.reshape(tilts, tilts, m, m, n, n))
    over, rows, columns = torch.from_numpy(graded((tilts, h, w), degree).T)
    flat = ((over[:, None] * t + over) * m * m + rows[:, None] * m + rows) * n * n + columns[:, None] * n + columns
    return full.reshape(-1)[flat]


def lattice_coefficients(memory: torch.Tensor, shape: tuple[int, int], degree: int) -> torch.Tensor:
    """A of one base tilt, float64[..., N, N], from K on differences float64[..., h, w]."""
    device = memory.device
    rows, columns = (folded(count, degree).to(device) for count in shape)
    between = rows @ memory @ columns.T
    return between.flatten(-2)[..., places(shape, degree).to(device)]


def factor(matrix: torch.Tensor, size: int) -> torch.Tensor:
    """Cholesky factor L of A, float64[..., N, N], which rounding may have left a little short of definite."""
    jitter = _JITTER * size * torch.eye(matrix.shape[-1], dtype=matrix.dtype, device=matrix.device)
    return torch.linalg.cholesky_ex(matrix + jitter)[0]


def kept(triangle: torch.Tensor, size: int, tolerance: float) -> torch.Tensor:
    """Which columns of L to keep, bool[..., N], so that at most ``tolerance`` of the intensity is left out.

    The strongest are, as few as will do; columns of nearly one power are kept or left out together.
    """
    power = triangle.square().sum(-2)
    descending = power.sort(dim=-1, descending=True)[0]
    left = size - descending.cumsum(-1)
    following = torch.nn.functional.pad(descending[..., 1:], (0, 1))
    enough = (left <= tolerance * size) & (following <= _TOGETHER * descending)
    enough[..., -1] = True
    least = descending.gather(-1, enough.to(torch.int8).argmax(-1, keepdim=True))
    return power >= least


def reached(triangle: torch.Tensor, size: int) -> torch.Tensor:
    """Share of the intensity that the polynomials reach, float64[...]."""
    return triangle.square().sum((-2, -1)) / size


def basis(shape: tuple[int, int], degree: int) -> torch.Tensor:
    """Polynomials of one base tilt over the pixels, float64[h * w, N]."""
    return torch.from_numpy(_basis(shape, degree))


@lru_cache(maxsize=16)
def _basis(shape: tuple[int, ...], degree: int) -> np.ndarray:
    values = np.ones((1, len(graded(shape, degree))))
    for count, degrees in zip(shape, graded(shape, degree).T, strict=True):
        values = (values[:, None] * polynomials(count, degree)[:, degrees]).reshape(-1, len(degrees))
    return values


def polynomial_count(shape: tuple[int, ...], degree: int) -> int:
    """Products of polynomials of total degree at most ``degree``: the columns of :func:`graded`."""
    by_degree = np.ones(1)
    for count in shape:
        by_degree = np.convolve(by_degree, np.ones(min(count, degree + 1)))[: degree + 1]
    return int(by_degree.sum())


def sum_of_squares(kernel: MemoryEffectCorrelation, lattice: Lattice) -> float:
    """Squared Frobenius norm of K over all pairs of beams, or more.

    A block of it between two base tilts is no larger than their own blocks, since K is positive semidefinite.
    """
    h, w = lattice.shape
    pairs = np.outer(*(np.where(np.arange(n) > 0, 2.0, 1.0) * (n - np.arange(n)) for n in (h, w)))
    squares = np.square(on_differences(kernel, lattice.shape, lattice.step))
    return len(lattice.base) ** 2 * float((pairs * squares).sum())


def fewest(matrix: torch.Tensor, squares: float, wanted: float) -> float:
    """Polynomials without which no degree reaches a trace, float: a lower bound, from those of a lower degree.

    ``matrix`` are the coefficients of K there, a block of K in a larger basis. n more columns add the trace of another
    block of n rows: at most sqrt(n) times the root of the sum of its squares, and those of all K are ``squares``.
    """
    left = squares - float(matrix.square().sum())
    missing = max(wanted - float(matrix.trace()), 0.0)
    return len(matrix) + missing**2 / (max(left, 0.0) + 1e-9 * squares)


def require_room(lattice_shape: tuple[int, ...], degree: int) -> None:
    """Refuse polynomials that would not fit into memory.

    Raises
    ------
    RuleError
        With the bytes they take.
    """
    count, beams = polynomial_count(lattice_shape, degree), math.prod(lattice_shape)
    per_axis = [min(n, degree + 1) for n in lattice_shape]
    # K between all products of polynomials, twice; its matrix, factor and index, with what they are made from; values.
    held = 8 * (2 * math.prod(n**2 for n in per_axis) + 8 * count**2 + 3 * beams * count)
    require_memory(
        "object_sampler", "held", held, f"{count} modes of {beams} beams",
        "Use a smaller field of view in memory-effect ranges, fewer pixels, a longer coherence length, or a larger "
        "mode_tolerance.",
    )  # fmt: skip


def karhunen_loeve(kernel: MemoryEffectCorrelation, lattice: Lattice, tolerance: float) -> Modes:
    """Modes of a lattice of beams.

    What they leave out adds up to at most ``tolerance`` of the intensity, and every beam's intensity is
    then restored to 1.

    Raises
    ------
    RuleError
        If the beams are so many, and so independent, that their modes would not fit into memory.
    """
    tilts = len(lattice.base)
    shape = lattice.shape if tilts == 1 else (tilts, *lattice.shape)
    complete = sum(shape) - len(shape)
    degree, squares = first_degree(shape), 0.0
    with one_torch_thread():
        while True:
            require_room(shape, degree)
            matrix = coefficients(kernel, lattice, degree)
            triangle = factor(matrix, lattice.size)
            if degree >= complete or 1 - reached(triangle, lattice.size) <= POLYNOMIAL_SHARE * tolerance:
                break
            squares = squares or sum_of_squares(kernel, lattice)
            least = fewest(matrix, squares, (1 - POLYNOMIAL_SHARE * tolerance) * lattice.size)
            degree = degree * 3 // 2
            while degree < complete and polynomial_count(shape, degree) < least:
                degree = degree * 3 // 2
        columns = triangle[:, kept(triangle, lattice.size, tolerance)]
        values = torch.from_numpy(_basis(shape, degree)) @ columns
        values = values / values.norm(dim=1, keepdim=True)
    return Modes(values.numpy(), columns.numpy(), degree, lattice)
