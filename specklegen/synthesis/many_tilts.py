"""Stacks of many tilts, at the cost of few: cells that the views alone decide, and moments of the noise within them.

    u_t(v) = sum_X e^(-ik(v - i_t) . X) b(X) sum_q p_q(v) G_tq(X)
    G_tq(X) = integral over the cell  c_q(s) e^(-ik(c - i_t) . s) g_t(X + s) ds,      e^(-ik(v - c) . s) = sum_q p_q c_q
    E[G_tq G_t'q'*] = K(i_t - i_t')  mean over the cell  c_q c_q'* e^(ik(i_t - i_t') . s),    white over cells

:mod:`specklegen.synthesis.stacks` has cells so small that all tilts are views of one far field: their number grows with
the reach of the tilts, and so does the cost of *each*. Here g_t is white within a cell as it is over them; views about
the middle one, c, look at so few of its moments that three or four say all (p and c are singular vectors of
e^(-ik(v - c) . s)), and the moments of different tilts have the covariance above, in closed form and the same in all
cells. Of evenly spaced tilts it depends on t - t' alone, and is drawn by Fourier transforms: circulant embedding
[Dietrich and Newsam, SIAM J. Sci. Comput. 18, 1088 (1997)], of blocks Q x Q. Tilts at even angles are a little off even
places: of d sines, which turns the phase within a cell by e^(ikd s). The moments after that turn are mixtures of the
moments before it. Other tilts share small cells.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.fft import next_fast_len

from specklegen.core.lazy import torch
from specklegen.core.parallel import one_torch_thread
from specklegen.core.random_streams import Seed
from specklegen.kernels.tilt_moments import fill_lit, fill_spectrum
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

_LEFT_OUT = 1e-3  # singular values of the phase within a cell, of the largest
_FAINT = 1e-4  # pivots of moments, of the largest
_UNSEEN = 1e-6  # singular values of the transforms to views, of the largest
_EMBEDDED = 2e-4  # largest error of a correlation by circulant embedding
_LONGER = (1.1, 1.3, 1.6, 2, 4, 8)  # lengths of the circle, in those of the tilts
_UNEVEN = 3e-4  # largest error of a correlation because K is that of even tilts; phases are those of the tilts
_TURNED = 3e-4  # largest turn of the phase within a cell for which moments are not mixed
_FEW = 8  # tilts that are never worth it
_PAYS = 0.7  # of the operations with small cells
_TOGETHER = 2**16  # moments of tilts that are transformed at a time
_CELLS = 256  # of which moments are drawn at a time


@dataclass(frozen=True)
class Circulant:
    """Roots of the spectrum of evenly spaced tilts.

    Attributes
    ----------
    roots : complex[n, Q, r]
        Root of each of n frequencies, of the circle on which the tilts lie.
    ranks : int64[n]
        Columns of it that are used.
    """

    tilts: int
    roots: torch.Tensor
    ranks: torch.Tensor

    @property
    def length(self) -> int:
        """Places on the circle."""
        return len(self.ranks)

    @property
    def rank(self) -> int:
        """Independent numbers a cell, of all frequencies together."""
        return int(self.ranks.sum())

    def moments(self, white: torch.Tensor) -> torch.Tensor:
        """Moments complex[T, Q, cells] of noise complex[rank, cells], by a transform along the tilts."""
        cells_ = white.shape[1]
        moments = white.new_empty((self.tilts, self.roots.shape[1], cells_))
        for first in range(0, cells_, _CELLS):  # few enough to stay in the caches
            some = moments[:, :, first : first + _CELLS]
            spectrum = white.new_empty((*self.roots.shape[:2], some.shape[2]))
            fill_spectrum(self.roots.numpy(), self.ranks.numpy(), white.numpy(), first, spectrum.numpy())
            some.copy_(torch.fft.ifft(spectrum, dim=0)[: self.tilts])
        return moments


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

    def mixtures(self, wavenumbers: np.ndarray) -> np.ndarray:
        """Return c_q e^(iks) as sums over c_q', complex128[n, Q, Q] at k float64[n]."""
        return self.overlaps(wavenumbers) / np.square(np.abs(self.basis)).sum(1)

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
    rows, columns : (complex[H, n], complex[n, Qy * y.count]), (complex[W, m], complex[m, Qx * x.count])
        Transforms from moments of cells to views, as two: to what n and m numbers tell, and to all views.
    face : complex[H, W] or None
        As of a stack sampler.
    mixtures : complex[T, Q, Q] or None
        Moments of each tilt from those of the even place beside it; None where they are as good as equal.
    """

    x: Axis
    y: Axis
    root: Circulant
    moments: tuple[int, int]
    window: torch.Tensor
    turned: tuple[torch.Tensor, torch.Tensor]
    rows: tuple[torch.Tensor, torch.Tensor]
    columns: tuple[torch.Tensor, torch.Tensor]
    face: torch.Tensor | None
    mixtures: torch.Tensor | None

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
        drawn = self._moments(complex_normals(seed, realization, shape, self.window.dtype, self.window.device))
        return drawn.reshape(len(drawn), *self.moments, self.y.count, self.x.count)

    def _moments(self, white: torch.Tensor) -> torch.Tensor:
        """Moments complex[T, Q, cells] of noise complex[rank, cells]."""
        drawn = self.root.moments(white)
        return drawn if self.mixtures is None else torch.bmm(self.mixtures, drawn)

    def _fields(self, noise: torch.Tensor, tilts: slice) -> torch.Tensor:
        chosen = range(len(noise))[tilts]
        step = max(1, _TOGETHER // max(noise[0].numel(), 1))
        (high, down), (wide, across) = self.rows, self.columns
        rows = high @ down
        fields = noise.new_empty((len(chosen), len(rows), len(wide)))
        for first in range(0, len(chosen), step):
            part = slice(chosen[first], chosen[first] + min(step, len(chosen) - first))
            some = noise[part]
            lit = some.new_empty((len(some), self.moments[0], self.y.count, self.moments[1], self.x.count))
            along_y, along_x = (each[part].numpy() for each in self.turned)
            fill_lit(some.numpy(), along_y, along_x, self.window.numpy(), lit.numpy())
            seen = (lit.flatten(3).flatten(0, 2) @ across.mT).view(len(some), -1, len(across))
            views = fields[first : first + len(some)]
            torch.matmul((rows @ seen).flatten(0, 1), wide.mT, out=views.view(-1, len(wide)))
            if self.face is not None:
                views *= self.face
        return fields


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
    if len(sines) < _FEW or not getattr(correlation, "isotropic", False):
        return None
    shared, (x, y) = stack_axes(scene), _within(scene)
    step, off = _even_steps(sines)
    if not _is_even(step, off, correlation, k):
        return None
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
    most_turned = k * sum(np.ptp(off, axis=0) * [np.abs(axis.nodes).max() for axis in (x, y)])
    mixtures = _kron(y.mixtures(k * off[:, 1]), x.mixtures(k * off[:, 0])) if most_turned > _TURNED else None
    return ManyTilts(
        x.axis, y.axis, root, (len(y.basis), len(x.basis)),
        tensor(scale * sampled_amplitude(x.axis, y.axis, beams.window)),
        (tensor(np.exp(1j * shifts[:, 1:] * y.axis.positions)), tensor(np.exp(1j * shifts[:, :1] * x.axis.positions))),
        _parts(y.views(k, grid.pitch), tensor), _parts(x.views(k, grid.pitch), tensor),
        None if np.abs(turned).max() < SMALL_PHASE else tensor(np.exp(1j * turned)),
        None if mixtures is None else tensor(mixtures),
    )  # fmt: skip


def _parts(views: np.ndarray, tensor: Any) -> tuple[torch.Tensor, torch.Tensor]:
    """A transform to views as a product through the numbers that tell them all: views are closer than grains."""
    left, values, right = np.linalg.svd(views, full_matrices=False)
    kept = values > _UNSEEN * values[0]
    return tensor(left[:, kept] * values[kept]), tensor(right[kept])


def _operations(x: _Within, y: _Within, shape: tuple[int, int], tilts: int, length: int, rank: int) -> float:
    """Operations of a stack, in those of products of matrices: of the noise, along the tilts, and to views."""
    points, cells_ = len(x.basis) * len(y.basis), float(x.axis.count * y.axis.count)
    along = 3 * 5.0 * length * np.log2(length) * points * cells_
    down, across = len(y.basis) * y.axis.count, len(x.basis) * x.axis.count
    views = 8.0 * (down * across * shape[1] + shape[0] * down * shape[1])
    return NORMAL_FLOPS * rank * cells_ + along + tilts * views


def _shared_operations(x: Axis, y: Axis, shape: tuple[int, int], tilts: int) -> float:
    """Copy with cells that all tilts share."""
    size = float(x.count * y.count)
    views = min(matrix_flops(x, y, shape), fft_flops(x, y))
    return tilts * (NORMAL_FLOPS * size + 8.0 * tilts * size + views)


def _within(scene: Scene) -> tuple[_Within, _Within]:
    """Cells along x and y for the views of one tilt, and what is seen within them."""
    beams, grid = scene.beams, scene.grid
    reach = np.ptp(beams.directions[:, :2], axis=0)
    axes = []
    for axis, (views, shared) in enumerate(zip(grid.sines, stack_axes(scene), strict=True)):
        coarse = cells(scene.wavelength, beams.width, beams.profile, grid.pitch, grid.pitch * (len(views) - 1))
        if shared.count < 2 * coarse.count:  # tilts have little reach along it: every cell is a point, as there
            axes.append(_Within(shared, np.zeros(1), np.ones((1, 1)), np.ones((len(views), 1))))
            continue
        cycles = reach[axis] * coarse.size / scene.wavelength
        nodes, weights = np.polynomial.legendre.leggauss(int(48 + 4 * cycles))
        nodes = nodes / 2 * coarse.size
        middle = grid.center_direction[axis]
        waves = np.exp(-1j * scene.wavenumber * np.multiply.outer(views - middle, nodes)) * np.sqrt(weights / 2)
        left, values, right = np.linalg.svd(waves, full_matrices=False)
        kept = values > _LEFT_OUT * values[0]
        axes.append(_Within(coarse, nodes, values[kept, None] / values[0] * right[kept], values[0] * left[:, kept]))
    return axes[0], axes[1]


def _even_steps(sines: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the step float64[2] of even places nearest to the tilts, and how far off each tilt is, float64[T, 2]."""
    number = np.arange(len(sines)) - (len(sines) - 1) / 2
    step = number @ sines / np.square(number).sum()
    return step, sines - sines.mean(0) - number[:, None] * step


def _is_even(step: np.ndarray, off: np.ndarray, correlation: Any, wavenumber: float) -> bool:
    """Return whether K between any two tilts is that between their even places."""
    length = float(np.hypot(*step))
    if not length > 0:
        return False
    between = length * np.arange(len(off))
    apart = np.array([np.hypot(*(off[lag:] - off[: len(off) - lag]).T).max() for lag in range(len(off))])
    near, at, far = (correlation(wavenumber * each) for each in (np.abs(between - apart), between, between + apart))
    return bool(max(np.abs(near - at).max(), np.abs(far - at).max()) <= _UNEVEN)


def _kron(y: np.ndarray, x: np.ndarray) -> np.ndarray:
    """Products complex128[n, Qy Qx, Qy Qx] of matrices of moments along y and along x."""
    moments = y.shape[1] * x.shape[1]
    return np.einsum("nab,ncd->nacbd", y, x).reshape(-1, moments, moments)


def _blocks(between: np.ndarray, apart: np.ndarray, x: _Within, y: _Within) -> np.ndarray:
    """Covariance complex128[n, Q, Q] of moments of tilts ``apart`` float64[n, 2] of correlation ``between``."""
    return between[:, None, None] * _kron(y.overlaps(apart[:, 1]), x.overlaps(apart[:, 0]))


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
            roots = np.sqrt(length) * np.take_along_axis(roots, order[:, None], axis=2)[:, :, : max(held.max(), 1)]
            put = torch.as_tensor(np.ascontiguousarray(roots)).to(dtype)
            return Circulant(tilts, put, torch.as_tensor(held.astype(np.int64)))
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
