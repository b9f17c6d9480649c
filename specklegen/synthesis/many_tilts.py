"""Stacks of many tilts, at the cost of few: cells that the views alone decide, and moments of the noise within them.

    u_t(v) = sum_X e^(-ik(v - i_t) . X) b(X) sum_q p_q(v) G_tq(X)
    G_tq(X) = integral over the cell  c_q(s) e^(-ik(c - i_t) . s) g_t(X + s) ds,      e^(-ik(v - c) . s) = sum_q p_q c_q
    E[G_tq G_t'q'*] = K(i_t - i_t')  mean over the cell  c_q c_q'* e^(ik(i_t - i_t') . s),    white over cells

:mod:`specklegen.synthesis.stacks` has cells so small that all tilts are views of one far field: their number grows with
the reach of the tilts, and so does the cost of *each*. Here g_t is white within a cell as it is over them; views about
the middle one, c, look at so few of its moments that three or four say all (p and c are singular vectors of
e^(-ik(v - c) . s)), and the moments of different tilts have the covariance above, in closed form and the same in all
cells. Of evenly spaced tilts it depends on t - t' alone, and is drawn by Fourier transforms: circulant embedding
[Dietrich and Newsam, SIAM J. Sci. Comput. 18, 1088 (1997)], of blocks Q x Q. Other tilts share small cells.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.fft import next_fast_len

from specklegen.core.lazy import LazyModule
from specklegen.core.parallel import one_torch_thread
from specklegen.core.random_streams import Seed
from specklegen.scene.scene import Scene
from specklegen.synthesis.exit_grid import (
    NORMAL_FLOPS,
    Axis,
    cells,
    fft_flops,
    matrix_flops,
    sampled_amplitude,
    stack_axes,
)
from specklegen.synthesis.gaussian_noise import complex_normals
from specklegen.synthesis.stacks import SMALL_PHASE, face_phase, mean_intensity

if TYPE_CHECKING:
    import torch
else:
    torch = LazyModule("torch")

_LEFT_OUT = 1e-3  # singular values of the phase within a cell, of the largest
_FAINT = 1e-5  # eigenvalues of moments, of the largest
_EMBEDDED = 2e-4  # largest error of a correlation by circulant embedding
_LONGER = (1.1, 1.3, 1.6, 2, 4, 8)  # lengths of the circle, in those of the tilts
_EVEN = 2e-4  # of a step: K and what is seen within a cell are those of even tilts, all other phases those of each
_FEW = 8  # tilts that are never worth it
_PAYS = 0.7  # of the operations with small cells
_TOGETHER = 2**18  # moments of tilts that are transformed at a time


@dataclass(frozen=True)
class Circulant:
    """Roots of the spectrum of evenly spaced tilts.

    Attributes
    ----------
    tilts : int
    length : int
        Of the circle on which they lie.
    ranks : tuple of (int64[n], complex[n, Q, r])
        For each rank r the frequencies that have it, and their root there.
    """

    tilts: int
    length: int
    ranks: tuple[tuple[torch.Tensor, torch.Tensor], ...]

    @property
    def rank(self) -> int:
        """Independent numbers a cell, of all frequencies together."""
        return sum(roots.shape[0] * roots.shape[2] for _, roots in self.ranks)

    def moments(self, white: torch.Tensor) -> torch.Tensor:
        """Moments complex[T, Q, cells] of noise complex[rank, cells], by a transform along the tilts."""
        moments, cells_ = self.ranks[0][1].shape[1], white.shape[1]
        spectrum = white.new_zeros((self.length, moments, cells_))
        start = 0
        for frequencies, roots in self.ranks:
            count, _, rank = roots.shape
            some = white[start : start + count * rank].reshape(count, rank, cells_)
            spectrum[frequencies] = torch.bmm(roots, some)
            start += count * rank
        return torch.fft.ifft(spectrum, dim=0)[: self.tilts]


@dataclass(frozen=True)
class _Within:
    """Cells along one axis, and what views see of the noise within one."""

    axis: Axis
    nodes: np.ndarray
    """float64[S], places within a cell."""
    basis: np.ndarray
    """complex128[Q, S], c_q times the root of the weight of a place."""
    seen: np.ndarray
    """complex128[V, Q], p_q."""

    def overlaps(self, wavenumbers: np.ndarray) -> np.ndarray:
        """Mean of c_q c_q'* e^(iks) over a cell, complex128[n, Q, Q] at k float64[n]."""
        turned = np.exp(1j * np.multiply.outer(wavenumbers, self.nodes))
        return np.einsum("qs,ns,ps->nqp", self.basis, turned, self.basis.conj(), optimize=True)

    def views(self, wavenumber: float, pitch: float) -> np.ndarray:
        """Transform complex128[V, Q * count] from moments of cells to views, phases those of the first view."""
        views = len(self.seen)
        waves = np.exp(-1j * wavenumber * pitch * np.multiply.outer(np.arange(views), self.axis.positions))
        return (self.seen[:, :, None] * waves[:, None]).reshape(views, -1)


@dataclass(frozen=True)
class ManyTilts:
    """Draws stacks as :class:`specklegen.synthesis.stacks.StackSampler` does. Made by :func:`many_tilts`.

    Attributes
    ----------
    x, y : Axis
        Cells of the exit plane.
    root : Circulant
        Of the moments of all tilts.
    moments : (int, int)
        Of a cell along y and x.
    window : complex[y.count, x.count]
        b(X) and the root of the intensity.
    turned : (complex[T, y.count], complex[T, x.count])
        Phases of each tilt, from the first view.
    rows, columns : complex[H, Qy * y.count], complex[W, Qx * x.count]
        Transforms from moments of cells to views.
    face : complex[H, W] or None
        As of a stack sampler.
    """

    x: Axis
    y: Axis
    root: Circulant
    moments: tuple[int, int]
    window: torch.Tensor
    turned: tuple[torch.Tensor, torch.Tensor]
    rows: torch.Tensor
    columns: torch.Tensor
    face: torch.Tensor | None

    def sample(self, seed: Seed, realization: int = 0) -> torch.Tensor:
        """One stack, complex[T, H, W]; a pure function of (seed, realization)."""
        with one_torch_thread():
            return self._fields(self._noise(seed, realization), slice(None))

    def one_by_one(self, seed: Seed, realization: int = 0) -> Iterator[torch.Tensor]:
        """The stack of :meth:`sample` within rounding, tilt by tilt, complex[1, H, W]: moments are held, no stack."""
        with one_torch_thread():
            noise = self._noise(seed, realization)
        for t in range(len(noise)):
            with one_torch_thread():
                yield self._fields(noise, slice(t, t + 1))

    def _noise(self, seed: Seed, realization: int) -> torch.Tensor:
        """Moments complex[T, Qy, Qx, y.count, x.count]."""
        shape = (self.root.rank, self.y.count * self.x.count)
        white = complex_normals(seed, realization, shape, self.rows.dtype, self.rows.device)
        drawn = self.root.moments(white)
        return drawn.reshape(len(drawn), *self.moments, self.y.count, self.x.count)

    def _fields(self, noise: torch.Tensor, tilts: slice) -> torch.Tensor:
        chosen = range(len(noise))[tilts]
        step = max(1, _TOGETHER // max(noise[0].numel(), 1))
        found = noise.new_empty((len(chosen), len(self.rows), len(self.columns)))
        down, across = self.moments
        for first in range(0, len(chosen), step):
            part = slice(chosen[first], chosen[first] + min(step, len(chosen) - first))
            along_y, along_x = (each[part] for each in self.turned)
            lit = noise[part] * (along_y[:, :, None] * along_x[:, None] * self.window)[:, None, None]
            lit = lit.permute(0, 1, 3, 2, 4).reshape(-1, across * self.x.count) @ self.columns.T
            views = self.rows @ lit.reshape(-1, down * self.y.count, len(self.columns))
            found[first : first + len(views)] = views if self.face is None else views * self.face
        return found


def many_tilts(scene: Scene, correlation: Any, *, dtype: torch.dtype | None = None) -> ManyTilts | None:
    """Prepare the sampler of a scene with collimated beams and a far-field grid; None where small cells are as quick.

    Parameters
    ----------
    scene, correlation
        As of :func:`specklegen.synthesis.stacks.stack_sampler`.
    dtype
        complex64 (by default) or complex128; the random numbers are the same.
    """
    dtype = dtype or torch.complex64
    beams, grid, k = scene.beams, scene.grid, scene.wavenumber
    sines = beams.directions[:, :2]
    step = _step(sines)
    if step is None or not getattr(correlation, "isotropic", False):
        return None
    shared, (x, y) = stack_axes(scene), _within(scene)
    least = _operations(x, y, grid.shape, len(sines), len(sines), len(sines))
    most = _PAYS * _shared_operations(*shared, grid.shape, len(sines))
    if least > most:
        return None
    root = _circulant(correlation, len(sines), step, k, x, y, dtype)
    if root is None or _operations(x, y, grid.shape, len(sines), root.length, root.rank) > most:
        return None
    scale = np.sqrt(mean_intensity(correlation, beams.window.area))
    first = np.array([axis[0] for axis in grid.sines])
    tensor = lambda a: torch.as_tensor(np.ascontiguousarray(a)).to(dtype)  # noqa: E731
    turned = face_phase(scene.thickness if grid.side == "transmission" else 0.0, k, grid)
    shifts = k * (sines - first)
    return ManyTilts(
        x.axis, y.axis, root, (len(y.basis), len(x.basis)),
        tensor(scale * sampled_amplitude(x.axis, y.axis, beams.window)),
        (tensor(np.exp(1j * shifts[:, 1:] * y.axis.positions)), tensor(np.exp(1j * shifts[:, :1] * x.axis.positions))),
        tensor(y.views(k, grid.pitch)), tensor(x.views(k, grid.pitch)),
        None if np.abs(turned).max() < SMALL_PHASE else tensor(np.exp(1j * turned)),
    )  # fmt: skip


def _operations(x: _Within, y: _Within, shape: tuple[int, int], tilts: int, length: int, rank: int) -> float:
    """Operations of a stack, in those of products of matrices: of the noise, along the tilts, and to views."""
    points, cells_ = len(x.basis) * len(y.basis), float(x.axis.count * y.axis.count)
    along = 3 * 5.0 * length * np.log2(length) * points * cells_
    down, across = len(y.basis) * y.axis.count, len(x.basis) * x.axis.count
    views = 8.0 * (down * across * shape[1] + shape[0] * down * shape[1])
    return NORMAL_FLOPS * rank * cells_ + along + tilts * views


def _shared_operations(x: Axis, y: Axis, shape: tuple[int, int], tilts: int) -> float:
    """The same with cells that all tilts share."""
    size = float(x.count * y.count)
    views = min(matrix_flops(x, y, shape), fft_flops(x, y))
    return tilts * (NORMAL_FLOPS * size + 8.0 * tilts * size + views)


def _within(scene: Scene) -> tuple[_Within, _Within]:
    """Cells along x and y for the views of one tilt, and what is seen within them."""
    beams, grid = scene.beams, scene.grid
    reach = np.ptp(beams.directions[:, :2], axis=0)
    found = []
    for axis, (views, shared) in enumerate(zip(grid.sines, stack_axes(scene), strict=True)):
        coarse = cells(scene.wavelength, beams.width, beams.profile, grid.pitch, grid.pitch * (len(views) - 1))
        if shared.count < 2 * coarse.count:  # tilts have little reach along it: every cell is a point, as there
            found.append(_Within(shared, np.zeros(1), np.ones((1, 1)), np.ones((len(views), 1))))
            continue
        cycles = reach[axis] * coarse.size / scene.wavelength
        nodes, weights = np.polynomial.legendre.leggauss(int(48 + 4 * cycles))
        nodes = nodes / 2 * coarse.size
        middle = grid.center_direction[axis]
        waves = np.exp(-1j * scene.wavenumber * np.multiply.outer(views - middle, nodes)) * np.sqrt(weights / 2)
        left, values, right = np.linalg.svd(waves, full_matrices=False)
        kept = values > _LEFT_OUT * values[0]
        found.append(_Within(coarse, nodes, values[kept, None] / values[0] * right[kept], values[0] * left[:, kept]))
    return found[0], found[1]


def _step(sines: np.ndarray) -> np.ndarray | None:
    """Step float64[2] between tilts that are evenly spaced along a line; None of others, and of few."""
    if len(sines) < _FEW:
        return None
    step = (sines[-1] - sines[0]) / (len(sines) - 1)
    even = sines[0] + np.arange(len(sines))[:, None] * step
    return step if np.hypot(*step) > 0 and np.abs(sines - even).max() <= _EVEN * np.hypot(*step) else None


def _blocks(between: np.ndarray, apart: np.ndarray, x: _Within, y: _Within) -> np.ndarray:
    """Covariance complex128[n, Q, Q] of moments of tilts ``apart`` float64[n, 2] of correlation ``between``."""
    kron = np.einsum("nab,ncd->nacbd", y.overlaps(apart[:, 1]), x.overlaps(apart[:, 0]))
    moments = len(y.basis) * len(x.basis)
    return between[:, None, None] * kron.reshape(len(between), moments, moments)


def _circulant(
    correlation: Any, tilts: int, step: np.ndarray, wavenumber: float, x: _Within, y: _Within, dtype: torch.dtype
) -> Circulant | None:
    """The root on a circle so long that its correlations are right; None where none is."""
    for longer in _LONGER:  # where tilts far apart are independent, the circle closes behind the last of them
        length = int(next_fast_len(int(longer * tilts)))  # type: ignore[arg-type]
        lags = np.arange(max(length // 2 + 1, tilts))
        line = np.multiply.outer(lags, step)
        between = correlation(wavenumber * np.hypot(*line.T))
        blocks = _blocks(between, wavenumber * line, x, y)
        half = (length - 1) // 2 + 1
        circle = np.zeros((length, *blocks.shape[1:]), np.complex128)
        circle[:half] = blocks[:half]
        circle[length - half + 1 :] = blocks[1:half][::-1].conj().swapaxes(1, 2)
        if length % 2 == 0:
            circle[half] = (blocks[half] + blocks[half].conj().T) / 2
        roots, kept = _triangles(np.fft.fft(circle, axis=0))
        drawn = np.fft.ifft(roots @ roots.conj().swapaxes(1, 2), axis=0)
        if np.abs(drawn[:tilts] - blocks[:tilts]).max() <= _EMBEDDED * np.abs(blocks[0]).max():
            order, held = np.argsort(~kept, axis=1, kind="stable"), kept.sum(axis=1)
            roots = np.sqrt(length) * np.take_along_axis(roots, order[:, None], axis=2)
            ranks = [
                (torch.as_tensor(np.flatnonzero(held == n)), torch.as_tensor(roots[held == n, :, :n]).to(dtype))
                for n in np.unique(held[held > 0]).tolist()
            ]
            return Circulant(tilts, length, tuple(ranks))
    return None


def _triangles(blocks: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Cholesky's roots complex128[n, Q, Q] of Hermitian blocks, and which columns are not 0, bool[n, Q].

    Columns of faint pivots are left out. Unlike eigenvectors these roots are no other for a rounding more or less.
    """
    left, roots = blocks.copy(), np.zeros_like(blocks)
    kept = np.zeros(blocks.shape[:2], bool)
    faint = _FAINT * np.abs(blocks).max()
    for q in range(blocks.shape[1]):
        pivot = left[:, q, q].real
        kept[:, q] = pivot > faint
        column = np.where(kept[:, q, None], left[:, :, q] / np.sqrt(np.maximum(pivot, faint))[:, None], 0.0)
        roots[:, :, q] = column
        left -= column[:, :, None] * column[:, None].conj()
    return roots, kept
