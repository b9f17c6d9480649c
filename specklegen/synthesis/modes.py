"""Modes of the memory effect: few independent fields for the many correlated beams of an object.

    K(i_j - i_l) = sum_r phi_r(j) phi_r(l)

The beams lie on a lattice, the object's pixels, under a few base tilts. With B discrete orthonormal polynomials on the
lattice, those of total degree d at most in the order of their degree, the coefficients of K are A = B^T K B. K depends
on differences alone, so that A is two small products with the correlations of the polynomials in one dimension. Its
Cholesky factor L gives the modes phi = B L, and its strongest columns are kept, in their order. No pivot, eigenvector
or root is chosen by rounding: neighbours in power stay together, and the order is that of the polynomials.

The degree is 6, that of all polynomials where there are few beams, and rises where the polynomials leave out more
than half of the tolerance. At a quarter to one memory-effect range that takes at most a quarter more modes than the
exact expansion needs at the same tolerance (tests/synthesis/test_modes.py).
Source of the recurrence: Gautschi, *Orthogonal Polynomials* (2004), section 2.2.3, with every step orthogonalised anew.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from specklegen.core.lazy import torch
from specklegen.core.memory import require_memory
from specklegen.kernels.modes import fill_factors, fill_mode_values, fill_round_coefficients, fill_tilt_coefficients

if TYPE_CHECKING:
    from specklegen.synthesis.correlations import Correlations, Places

FIRST_DEGREE, FEW = 6, 16
POLYNOMIAL_SHARE = 0.5
"""Share of the tolerance that the polynomials may leave out."""
_TOGETHER = 0.999  # ratio of the powers of two columns that are kept together
_SAME_GAP = 1e-12  # of the largest gap: rounding is less
_JITTER = 1e-11  # on the diagonal, over the number of beams: far above rounding, far below any tolerance


@dataclass(frozen=True)
class Lattice:
    """Beams of an object's pixels under base tilts, of M media.

    Attributes
    ----------
    shape : (h, w)
        Pixels.
    step : float64[M]
        Lateral wavevector between neighbours.
    base : float64[M, T, 2]
        Lateral wavevectors (x, y) of the base tilts.
    kept : float64[M, T, T] or None
        What K between beams of two base tilts is multiplied by, where the medium changes between them.
    """

    shape: tuple[int, int]
    step: torch.Tensor
    base: torch.Tensor
    kept: torch.Tensor | None = None

    @property
    def tilts(self) -> int:
        """Number of base tilts, T."""
        return self.base.shape[1]

    @property
    def full(self) -> tuple[int, ...]:
        """Points along each axis: those of the pixels, after those of several tilts."""
        return self.shape if self.tilts == 1 else (self.tilts, *self.shape)

    @property
    def size(self) -> int:
        """Number of beams, T h w."""
        return math.prod(self.full)

    def thinned(self, side: int) -> Lattice:
        """A lattice of the same extent with at most ``side`` points along each axis: it has about as many modes."""
        apart = max(1.0, *((n - 1) / (side - 1) for n in self.shape))
        rows, columns = (round((n - 1) / apart) + 1 for n in self.shape)
        return Lattice((rows, columns), self.step * apart, self.base, self.kept)

    def at(self, places: Places) -> Lattice:
        """Return the modes of some of the media."""
        kept = None if self.kept is None else self.kept[places]
        return Lattice(self.shape, self.step[places], self.base[places], kept)


@dataclass(frozen=True)
class Modes:
    """Modes of M media over a lattice of beams.

    Attributes
    ----------
    degree : int
        Highest total degree of the polynomials.
    columns : float64[M, N, N]
        Cholesky factor of each, its kept columns first, the others 0.
    rank : int64[M]
        Kept columns.
    """

    lattice: Lattice
    degree: int
    columns: torch.Tensor
    rank: torch.Tensor

    def at(self, places: Places) -> Modes:
        """Return the modes of some of the media."""
        return Modes(self.lattice.at(places), self.degree, self.columns[places], self.rank[places])

    def values(self, rank: int) -> torch.Tensor:
        """Modes phi float64[M, T h w, rank], the squares of each beam of sum 1; beams by (tilt, row, column)."""
        modes = basis(self.lattice.full, self.degree, self.columns.device) @ self.columns[:, :, :rank]
        return modes / torch.linalg.vector_norm(modes, dim=2, keepdim=True)

    def maps(self, rank: int, real: torch.dtype) -> torch.Tensor:
        """:meth:`values` by tilts and modes, real[M, T, rank, h w]."""
        tilts = self.lattice.tilts
        if not by_kernels(self.columns):
            return self.values(rank).unflatten(1, (tilts, -1)).mT.contiguous().to(real)
        maps = torch.empty((len(self.columns), tilts, rank, math.prod(self.lattice.shape)), dtype=real)
        points = _basis_by_polynomial(self.lattice.full, self.degree)
        for columns, own in zip(self.columns.numpy(), maps.numpy(), strict=True):
            fill_mode_values(points, columns, own)
        return maps

    def mixing(self, rank: int, correlations: Correlations) -> torch.Tensor:
        """Roots float64[M, rank, rank] that turn these modes into those of other K: phi A A^T phi^T is their matrix.

        Found among the polynomials by least squares, and right where the other K's modes lie in the span of these.
        """
        values, vectors = torch.linalg.eigh(self.covariance(rank, correlations))
        return (vectors * values.clamp(min=0).sqrt()[:, None]) @ vectors.mT  # symmetric: the only one

    def covariance(self, rank: int, correlations: Correlations) -> torch.Tensor:
        """Other K in terms of these modes, M float64[M, rank, rank] with phi M phi^T near its matrix; see above."""
        matrix = coefficients(memory(correlations, self.lattice), self.lattice, self.degree)
        back = torch.linalg.pinv(self.columns[:, :, :rank])
        return back @ matrix @ back.mT


def first_degree(shape: tuple[int, ...]) -> int:
    """Degree to begin with: all polynomials of few beams, else 6."""
    return sum(shape) - len(shape) if math.prod(shape) <= FEW else FIRST_DEGREE


@lru_cache(maxsize=64)
def polynomials(count: int, degree: int) -> np.ndarray:
    """Orthonormal polynomials on ``count`` points, float64[count, min(count, degree + 1)], by degree."""
    x = np.linspace(-1, 1, count) if count > 1 else np.zeros(1)
    columns = np.full((count, 1), count**-0.5)
    for _ in range(min(count - 1, degree)):
        new = x * columns[:, -1]
        for _ in range(2):  # once leaves rounding that grows with the degree
            new = new - columns @ (columns.T @ new)
        columns = np.column_stack([columns, new / np.linalg.norm(new)])
    return columns


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
    """Return the place of A[i, j] in the product (row degrees) x (column degrees), flat: int64[N, N]."""
    rows, columns = graded(shape, degree).T
    m, n = (min(count, degree + 1) for count in shape)
    flat = (rows[:, None] * m + rows) * n * n + columns[:, None] * n + columns
    return torch.from_numpy(flat)


@lru_cache(maxsize=64)
def places_of_tilts(shape: tuple[int, int, int], degree: int) -> torch.Tensor:
    """Return places of tilts, rows and columns in (tilt degrees) x (row degrees) x (column degrees)."""
    over, down, across = torch.from_numpy(graded(shape, degree).T)
    t, m, n = (min(count, degree + 1) for count in shape)
    return ((over[:, None] * t + over) * m * m + down[:, None] * m + down) * n * n + across[:, None] * n + across


@lru_cache(maxsize=64)
def distances(shape: tuple[int, int]) -> tuple[np.ndarray, np.ndarray]:
    """Different distances of two points of a lattice float64[d], ascending, and which it is, int64[h, w]."""
    squares = np.square(np.arange(shape[0]))[:, None] + np.square(np.arange(shape[1]))
    unique, which = np.unique(squares, return_inverse=True)
    return np.sqrt(unique), which.reshape(shape)


def on_differences(correlations: Correlations, shape: tuple[int, int], step: torch.Tensor) -> torch.Tensor:
    """K float64[M, h, w] at the differences (row, column) of two pixels, neither below 0; step float64[M]."""
    distance, which = distances(shape)
    device = step.device
    return correlations(step[:, None] * torch.from_numpy(distance).to(device))[:, torch.from_numpy(which).to(device)]


def on_signed_differences(correlations: Correlations, shape: tuple[int, int], step: torch.Tensor) -> torch.Tensor:
    """Any K, float64[M, 2h - 1, 2w - 1], at the differences of two pixels ``0, 1, ..., -2, -1`` along either axis."""
    h, w = (torch.cat([torch.arange(n), torch.arange(1 - n, 0)]).double().to(step.device) for n in shape)
    dy, dx = (step[:, None] * n for n in (h, w))
    return correlations.planar(*torch.broadcast_tensors(dx[:, None], dy[:, :, None]))


def memory(correlations: Correlations, lattice: Lattice) -> torch.Tensor:
    """K at the differences of all beams: float64[M, h, w] of one tilt, else float64[M, T, T, 2h - 1, 2w - 1].

    The latter, too, of one tilt where K is not the same in all directions.
    """
    if lattice.tilts == 1 and correlations.isotropic:
        return on_differences(correlations, lattice.shape, lattice.step)
    if correlations.isotropic and lattice.step.device.type == "cpu" and lattice.size > FEW:
        sides = [2 * side - 1 for side in lattice.shape]
        values = lattice.step.new_empty(len(lattice.step), lattice.tilts, lattice.tilts, *sides)
        for n, own in enumerate(values):
            _fill_between_tilts(correlations.at([n]), lattice.at([n]), own)
        return values if lattice.kept is None else values.mul_(lattice.kept[..., None, None])
    gap = lattice.base[:, :, None] - lattice.base[:, None]
    dx, dy = _apart(lattice, gap)
    if correlations.isotropic:
        distance = torch.hypot(dy[..., :, None], dx[..., None, :])
        values = correlations(distance.flatten(1)).view_as(distance)
    else:
        values = correlations.planar(*torch.broadcast_tensors(dx[..., None, :], dy[..., :, None]))
    return values if lattice.kept is None else values * lattice.kept[..., None, None]


def _apart(lattice: Lattice, gap: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
    """Differences along x and y float64[M, ..., 2n - 1] of pixels under tilts that are ``gap`` [M, ..., 2] apart."""
    step = lattice.step.reshape(-1, *[1] * (gap.ndim - 1))
    along = [torch.arange(1 - n, n, dtype=torch.float64, device=step.device) for n in lattice.shape]
    dy, dx = (gap[..., axis, None] - step * n for axis, n in ((1, along[0]), (0, along[1])))
    return dx, dy


def _fill_between_tilts(correlations: Correlations, lattice: Lattice, whole: torch.Tensor) -> None:
    """Write K of one medium at the differences of all beams, float64[T, T, 2h - 1, 2w - 1], each gap asked once.

    Of tilts that are evenly spaced few gaps differ, and gaps the other way are turned.
    """
    base, tilts = lattice.base[0], lattice.tilts
    first, second = torch.triu_indices(tilts, tilts)
    gap = base[first] - base[second]
    grain = _SAME_GAP * max(float(gap.abs().max()), float(lattice.step[0]))
    _, kinds, which = np.unique((gap / (grain or 1.0)).round().numpy(), axis=0, return_index=True, return_inverse=True)
    which = torch.from_numpy(which.reshape(-1))
    dx, dy = _apart(lattice, gap[torch.from_numpy(kinds)][None])
    correlation = correlations.on_grid(dx[0], dy[0])
    whole[first, second] = correlation[which]
    whole[second, first] = correlation[which].flip(1, 2)


def coefficients(known: torch.Tensor, lattice: Lattice, degree: int) -> torch.Tensor:
    """A = B^T K B, float64[M, N, N], of the polynomials of a lattice, from K on its differences (:func:`memory`)."""
    (h, w), tilts, device = lattice.shape, lattice.tilts, known.device
    if known.ndim == 3:
        rows, columns = (folded(count, degree).to(device) for count in (h, w))
        return (rows @ known @ columns.T).flatten(1)[:, places((h, w), degree).to(device)]
    between = known  # [M, T, T, m_y^2, m_x^2]; the one polynomial of one beam is 1
    if (h, w) != (1, 1):
        rows, columns = (products(count, degree).to(device) for count in (h, w))
        between = rows @ known @ columns.T
    turns = torch.from_numpy(polynomials(tilts, degree)).to(device)
    squares = (tilts, tilts, between.shape[-2] * between.shape[-1])
    matrix = (turns.T @ between.reshape(-1, tilts, squares[1] * squares[2])).unflatten(2, squares[1:])
    matrix = (matrix.transpose(2, 3) @ turns).transpose(2, 3)  # [M, t, t, m_y^2 m_x^2]
    return matrix.flatten(1)[:, places_of_tilts((tilts, h, w), degree).to(device)]


def factor(matrix: torch.Tensor, size: int) -> torch.Tensor:
    """Cholesky factor L of A, float64[..., N, N], which rounding may have left a little short of definite."""
    jitter = _JITTER * size * torch.eye(matrix.shape[-1], dtype=matrix.dtype, device=matrix.device)
    return torch.linalg.cholesky_ex(matrix + jitter)[0]


def kept(power: torch.Tensor, size: int, tolerance: float) -> torch.Tensor:
    """Which columns of L to keep, bool[..., N], so that at most ``tolerance`` of the intensity is left out.

    Of powers float64[..., N], sums of the squares of columns. The strongest are kept, as few as will do; columns of
    nearly one power are kept or left out together.
    """
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


@lru_cache(maxsize=16)
def basis(shape: tuple[int, ...], degree: int, device: torch.device | str = "cpu") -> torch.Tensor:
    """Products of polynomials over the points of all axes, float64[points, N]."""
    values = np.ones((1, len(graded(shape, degree))))
    for count, degrees in zip(shape, graded(shape, degree).T, strict=True):
        values = (values[:, None] * polynomials(count, degree)[:, degrees]).reshape(-1, len(degrees))
    return torch.from_numpy(values).to(device)


@lru_cache(maxsize=16)
def _basis_by_polynomial(shape: tuple[int, ...], degree: int) -> np.ndarray:
    """:func:`basis`, float64[N, points]."""
    return np.ascontiguousarray(basis(shape, degree).numpy().T)


def polynomial_count(shape: tuple[int, ...], degree: int) -> int:
    """Products of polynomials of total degree at most ``degree``: the columns of :func:`graded`."""
    by_degree = np.ones(1)
    for count in shape:
        by_degree = np.convolve(by_degree, np.ones(min(count, degree + 1)))[: degree + 1]
    return int(by_degree.sum())


def sum_of_squares(correlations: Correlations, lattice: Lattice) -> float:
    """Squared Frobenius norm of the K of one medium over all pairs of beams, or more.

    A block of it between two base tilts is no larger than their own blocks, since K is positive semidefinite.
    """
    h, w = (torch.arange(n, dtype=torch.float64) for n in lattice.shape)
    pairs = torch.outer(*(torch.where(n > 0, 2.0, 1.0) * (len(n) - n) for n in (h, w)))
    if not correlations.isotropic:
        signed = [torch.cat([n, n[1:].flip(0)]) for n in (h, w)]
        pairs = torch.outer(*(len(n) - each for n, each in zip((h, w), signed, strict=True)))
        squares = on_signed_differences(correlations, lattice.shape, lattice.step)[0].square().cpu()
        return lattice.tilts**2 * float((pairs * squares).sum())
    squares = on_differences(correlations, lattice.shape, lattice.step)[0].square().cpu()
    return lattice.tilts**2 * float((pairs * squares).sum())


def fewest(matrix: torch.Tensor, squares: float, wanted: float) -> float:
    """Polynomials without which no degree reaches a trace, float: a lower bound, from those of a lower degree.

    ``matrix`` are the coefficients of K there, a block of K in a larger basis. n more columns add the trace of another
    block of n rows: at most sqrt(n) times the root of the sum of its squares, and those of all K are ``squares``.
    """
    left = squares - float(matrix.square().sum())
    missing = max(wanted - float(matrix.trace()), 0.0)
    return len(matrix) + missing**2 / (max(left, 0.0) + 1e-9 * squares)


def polynomial_bytes(lattice_shape: tuple[int, ...], degree: int) -> int:
    """Memory that polynomials take while modes are made of them."""
    count, beams = polynomial_count(lattice_shape, degree), math.prod(lattice_shape)
    per_axis = [min(n, degree + 1) for n in lattice_shape]
    # K between all products of polynomials, twice; its matrix, factor and index, with what they are made from; values.
    return 8 * (2 * math.prod(n**2 for n in per_axis) + 8 * count**2 + 3 * beams * count)


def require_room(lattice_shape: tuple[int, ...], degree: int) -> None:
    """Refuse polynomials that would not fit into memory."""
    count, beams = polynomial_count(lattice_shape, degree), math.prod(lattice_shape)
    require_memory(
        "object_imaging", "held", polynomial_bytes(lattice_shape, degree), f"{count} modes of {beams} beams",
        "Use a smaller field of view in memory-effect ranges, fewer pixels, a longer coherence length, or a larger "
        "mode_tolerance.",
    )  # fmt: skip


def one_by_one(device: torch.device) -> bool:
    """Return whether media are made one by one: on the CPU, where products of several matrices have other last bits."""
    return device.type == "cpu"


def by_kernels(tensor: torch.Tensor) -> bool:
    """Return whether kernels may take a tensor: on the CPU, where no derivative is asked for."""
    from specklegen.synthesis.fused import tracked

    return one_by_one(tensor.device) and not tensor.requires_grad and not tracked(tensor)


def karhunen_loeve(
    correlations: Correlations, lattice: Lattice, tolerance: float, known: torch.Tensor | None = None
) -> list[tuple[list[int], Modes]]:
    """Modes of lattices of beams, one a medium: the media of each degree together, and which they are.

    What the modes of a medium leave out adds up to at most ``tolerance`` of the intensity, and every beam's intensity
    is then restored to 1. Where K on the lattice is ``known`` (:func:`memory`), it is not asked for again. On "meta",
    where there are no numbers, the first degree is enough. Raise a `RuleError` if beams are so many, and so
    independent, that their modes would not fit into memory.
    """
    degree = first_degree(lattice.full)
    require_room(lattice.full, degree)
    known = memory(correlations, lattice) if known is None else known
    if by_kernels(known):
        made, reach = _factored(known, lattice, degree, tolerance)
    else:
        made, reach = _expanded(coefficients(known, lattice, degree), lattice, degree, tolerance)
    enough = _enough(reach, lattice, degree, tolerance)
    groups = []
    if at := [n for n, yes in enumerate(enough) if yes]:
        groups.append((at, made if all(enough) else made.at(at)))
    for n, yes in enumerate(enough):
        if not yes:
            one = slice(n, n + 1)
            groups.append(([n], _raised(correlations.at(one), known[one], lattice.at(one), degree, tolerance)))
    return groups


def _enough(reach: torch.Tensor, lattice: Lattice, degree: int, tolerance: float) -> list[bool]:
    """Return whether polynomials of a degree that reach these shares will do for each medium; on "meta" they do."""
    if degree >= sum(lattice.full) - len(lattice.full) or reach.device.type == "meta":
        return [True] * len(reach)
    return (1 - reach <= POLYNOMIAL_SHARE * tolerance).tolist()


def _factored(known: torch.Tensor, lattice: Lattice, degree: int, tolerance: float) -> tuple[Modes, torch.Tensor]:
    """Modes of a degree, and the share of the intensity that its polynomials reach: :func:`_expanded` on the CPU."""
    (h, w), values = lattice.shape, known.numpy()
    count = polynomial_count(lattice.full, degree)
    matrices = np.empty((len(known), count, count))
    if known.ndim == 3:
        m, n = (min(side, degree + 1) for side in (h, w))
        rows, columns = folded(h, degree).view(m, m, h).numpy(), folded(w, degree).view(n, n, w).numpy()
        fill_round_coefficients(values, rows, columns, graded((h, w), degree), matrices)
    elif (h, w) == (1, 1):
        fill_tilt_coefficients(values[..., 0, 0], polynomials(lattice.tilts, degree), matrices)
    else:  # one by one: products of several have other last bits
        for n, own in enumerate(matrices):
            own[:] = coefficients(known[n : n + 1], lattice.at(slice(n, n + 1)), degree)[0].numpy()
    triangles, rank, reach = np.empty_like(matrices), np.empty(len(known), np.int64), np.empty(len(known))
    size = lattice.size
    fill_factors(matrices, size, _JITTER * size, tolerance, _TOGETHER, triangles, rank, reach)
    return Modes(lattice, degree, torch.from_numpy(triangles), torch.from_numpy(rank)), torch.from_numpy(reach)


def _expanded(matrix: torch.Tensor, lattice: Lattice, degree: int, tolerance: float) -> tuple[Modes, torch.Tensor]:
    """Modes of coefficients A, and the share of the intensity that the polynomials of a degree reach, float64[M]."""
    triangle = factor(matrix, lattice.size)
    chosen = kept(triangle.square().sum(-2), lattice.size, tolerance)
    first = torch.sort((~chosen).to(torch.int8), dim=-1, stable=True)[1]
    rank = chosen.sum(-1)
    ordered = triangle.gather(2, first[:, None].expand_as(triangle))
    ordered = ordered * (torch.arange(ordered.shape[-1], device=rank.device) < rank[:, None])[:, None]
    return Modes(lattice, degree, ordered, rank), reached(triangle, lattice.size)


def _raised(correlations: Correlations, known: torch.Tensor, lattice: Lattice, degree: int, tolerance: float) -> Modes:
    """Modes of one medium, of the first degree after ``degree`` that is enough: of ``6, 9, 13, 19, ...``."""
    squares = sum_of_squares(correlations, lattice)
    while True:
        matrix = coefficients(known, lattice, degree)
        made, reach = _expanded(matrix, lattice, degree, tolerance)
        if _enough(reach, lattice, degree, tolerance)[0]:
            return made
        least = fewest(matrix[0], squares, (1 - POLYNOMIAL_SHARE * tolerance) * lattice.size)
        degree = degree * 3 // 2
        while degree < sum(lattice.full) - len(lattice.full) and polynomial_count(lattice.full, degree) < least:
            degree = degree * 3 // 2
        require_room(lattice.full, degree)
