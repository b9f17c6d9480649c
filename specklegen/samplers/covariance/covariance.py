"""Covariance of speckle between lights and views: Algorithms 1 and 3 of [Bar19].

    C_pq = E[ W a_p a_q* ],    p, q = (light, view)

A sum of outer products, so Hermitian and positive semidefinite by construction. The mean m is never part of it.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import partial
from itertools import chain
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from specklegen.core.arguments import instance
from specklegen.core.budgets import DEFAULT_PATHS, checked_budget, paths_for
from specklegen.core.decision import Decision
from specklegen.core.errors import DoubtWarning, reject
from specklegen.core.memory import require_memory
from specklegen.core.parallel import Threads, even_slices, in_turn, map_blocks, one_blas_thread, thread_count
from specklegen.core.picturing import Pictured
from specklegen.core.random_streams import Seed, Stream, pilot_seed, stream_key
from specklegen.core.showing import summary
from specklegen.core.statistics import BATCHES, tail_factor
from specklegen.kernels.rng import fill_normals
from specklegen.paths.bank import PathBank
from specklegen.paths.deep_absorption import dark_views, require_reach, unseen_variance
from specklegen.paths.endpoint_factors import multiple_amplitudes, single_amplitudes
from specklegen.paths.layout import Layout
from specklegen.paths.pilot import volume_pilot
from specklegen.paths.rare_paths import warn_of_rare_paths
from specklegen.paths.reversal import Reverse, scene_reversal
from specklegen.paths.slab_tracer import BLOCK
from specklegen.paths.tracer import Tracer, volume_tracer
from specklegen.samplers.covariance.single_scattering import Orders, all_quadruples, single_covariance, single_decision
from specklegen.scene.scene import Scene
from specklegen.scene.validity import warn_of_dependence

COVARIANCE_ELEMENTS = 2**22  # of the amplitudes held at a time
_ENTRIES = 2**17  # of batches in work that are not the only one, a thread
_BLOCK_ROWS = 256  # per block of parallel work
_PATHS_AT_ONCE = 8 * BLOCK  # so that the connections in memory do not grow with the number of paths


@dataclass(frozen=True)
class Covariance(Pictured):
    """Covariance of the field between every two of (light, view), or some of them.

    Attributes
    ----------
    value : complex128[T, V, T, V]
        C, in the units of |u|^2; views in C order of the sensor. complex128[P] for chosen pairs, and
        complex128[n, T, V] for a block of rows.
    standard_error : float64, of the same shape
        sqrt(E|error|^2) from independent batches; NaN where there are fewer than two. Where rare paths carry the error
        of the intensities, up to 1.42 times what the batches show (:func:`specklegen.core.statistics.tail_factor`).
    single, multiple : complex128, of the same shape
        The parts of single scattering and of more; they add up to ``value``.
    paths : int
        Paths traced.
    reverse : bool
        Whether reversed paths (coherent backscattering) took part.
    rel_error : float
        Largest standard error over sqrt(C_pp C_qq), which is what ``rel_error=`` asks for.
    unfinished : int
        Paths ended by the largest order allowed.
    decisions : tuple of Decision
        What took part, what was left out, and why.
    """

    value: np.ndarray
    standard_error: np.ndarray
    single: np.ndarray
    multiple: np.ndarray
    paths: int
    reverse: bool
    rel_error: float
    unfinished: int
    decisions: tuple[Decision, ...] = ()

    def __repr__(self) -> str:
        return summary(self, value=self.value, paths=self.paths, reverse=self.reverse, rel_error=self.rel_error)

    def _facts(self) -> Mapping[str, object]:
        return {
            "value": "x".join(map(str, self.value.shape)),
            "largest relative error": self.rel_error,
            "paths": self.paths,
            "reversed paths": "used" if self.reverse else "left out",
        } | {d.part: f"{'used' if d.needed else 'left out'}: {d.reason}" for d in self.decisions}

    def _draw(self, axes: Any, label: str | None = None) -> None:
        """|C|: a matrix of all (light, view), or a curve of the chosen pairs with bars of two standard errors."""
        axes.set_title(label or "")
        size = np.abs(self.value)
        if size.ndim == 1:
            axes.errorbar(np.arange(len(size)), size, 2 * self.standard_error, fmt="o-", ms=3, lw=1)
            axes.set_xlabel("pair")
            axes.set_ylabel("|C|")
            return
        rows = size.shape[0] * (size.shape[1] if size.ndim == 4 else 1)
        axes.imshow(size.reshape(rows, -1), cmap="magma", vmin=0, aspect="auto", interpolation="nearest")
        axes.set_xlabel("(light, view)")
        axes.set_ylabel("(light, view)")

    @property
    def intensity(self) -> np.ndarray:
        """float64[T, V], E|u - m|^2 of every light and view."""
        self._require_all("intensity")
        t, v = self.value.shape[:2]
        return self.value.reshape(t * v, t * v).diagonal().real.reshape(t, v).copy()

    def sample(self, realizations: int, seed: Seed = 0) -> np.ndarray:
        """Draw zero-mean circular Gaussian fields of this covariance, complex128[R, T, V].

        Through its eigenvectors; what noise makes negative among the eigenvalues (at most rounding) is 0, and
        duplicated lights or views come out equal. Field r of a seed does not depend on ``realizations``.
        """
        self._require_all("sample")
        if realizations < 1:
            reject("Covariance.sample realizations", "at least 1", realizations)
        t, v = self.value.shape[:2]
        values, vectors = np.linalg.eigh(self.value.reshape(t * v, t * v))
        root = vectors * np.sqrt(np.clip(values, 0, None) / 2)
        key = stream_key(seed, Stream.EIGEN)
        fields = np.empty((realizations, t * v), np.complex128)
        normals = np.empty((t * v, 2))
        for r, field in enumerate(fields):
            fill_normals(*key, r, normals)
            field[...] = root @ (normals[:, 0] + 1j * normals[:, 1])
        return fields.reshape(realizations, t, v)

    def reshaped(self, shape: tuple[int, ...]) -> "Covariance":
        """Return the same entries in another shape."""
        arrays = ("value", "standard_error", "single", "multiple")
        return replace(self, **{name: getattr(self, name).reshape(shape) for name in arrays})

    def _require_all(self, name: str) -> None:
        if self.value.ndim != 4:
            reject(f"Covariance.{name}", "asked of a covariance of all pairs", f"one of shape {self.value.shape}")


def covariance(
    scene: Scene,
    *,
    paths: int | None = None,
    rel_error: float | None = None,
    seconds: float | None = None,
    seed: Seed = 0,
    reverse: Reverse = "auto",
    pairs: ArrayLike | None = None,
    orders: Orders = "auto",
    tolerance: float = 0.02,
    threads: int | None = None,
) -> Covariance:
    """Estimate the covariance of the speckle field of a scene; the memory it takes does not grow with ``paths``.

    Parameters
    ----------
    scene
        Any medium, lights and sensor. An incoherent object's lights are its lit pixels' beams of unit irradiance.
    paths
        Number of paths; 100 000 unless ``rel_error`` or ``seconds`` sets it.
    rel_error
        Instead: trace what a pilot says the largest standard error over sqrt(C_pp C_qq) takes to fall to this. The
        count is fixed before the run, so the estimate stays unbiased; ``.rel_error`` says what was reached.
    seconds
        Instead, or as a limit to ``rel_error``: trace what this time allows on this machine.
    seed
        The result is a function of it, the number of paths and the other arguments.
    reverse
        Whether reversed paths (coherent backscattering) take part; "auto" drops them where they add less than
        ``tolerance`` at every light and view (physics.md 2).
    pairs
        int[P, 4], rows (light, view, light, view): only these entries. Default: all of them.
    orders
        "all", "single", or "auto": single scattering alone, in closed form (Eq. 41) instead of by Monte Carlo, where
        a pilot finds the rest below ``tolerance`` and the closed form cheaper. ``rel_error`` then is the share of the
        intensity left out, and ``standard_error`` is 0. For a homogeneous box, plane waves and far views.
    tolerance
        Relative intensity below which "auto" drops a part.
    threads
        Threads; the result does not depend on it.

    Raises
    ------
    RuleError
        For an argument out of range, a closed form that does not exist, or a result that does not fit into memory.

    Warns
    -----
    DoubtWarning
        Where the mean free path is below the wavelength: independent scattering is then doubtful. Where some lights
        and views are found at less than 1e-3 of the brightest ones: connections are kept by those. Where standard
        errors rest on next to no path.
    """
    instance("covariance scene", scene, Scene)
    warn_of_dependence(scene.medium.mean_free_path, scene.wavelength)
    checked_budget("covariance", paths, rel_error, seconds)
    t, v = len(scene.lights), len(scene.views)
    if pairs is None:
        _require_memory(t, v, t * v)  # before the pilot, whose time would be lost
    tracer, reversal = _prepare(scene, reverse, tolerance)
    reverse = reversal.needed
    if pairs is None:
        chosen, seen, entries = None, tracer.layout, _all_pairs(t * v)
    else:
        chosen = _checked_pairs(pairs, t, v)
        seen, entries = _chosen_pairs(tracer.layout, chosen)
    alone = single_decision(scene, orders, len(chosen) if chosen is not None else (t * v) ** 2, tolerance, reverse)
    decisions = (reversal, alone)
    if not alone.needed:
        value = single_covariance(scene, all_quadruples(t, v) if chosen is None else chosen)
        if chosen is None:
            value = value.reshape(t * v, t * v)
            _mirror(value)  # each half has a rounding of its own
            value = value.reshape(t, v, t, v)
        left_out = volume_pilot(scene, reverse).multiple_share
        zeros = np.zeros(value.shape)
        return Covariance(value, zeros, value, zeros.astype(np.complex128), 0, reverse, left_out, 0, decisions)
    run = partial(_estimate, tracer, seen, reverse=reverse, entries=entries, threads=threads)
    keyed = pilot_seed(scene.unitless_fingerprint())
    count = paths_for(
        DEFAULT_PATHS, paths, rel_error, seconds, lambda n: run(n, keyed, stream=Stream.PILOT)[0].rel_error
    )  # fmt: skip
    require_reach("covariance", unseen_variance(scene), count)
    found, powers = run(count, seed)
    _warn("covariance", scene, powers)
    found = replace(found, decisions=decisions)
    return found if pairs is not None else found.reshaped((t, v, t, v))


def covariance_blocks(
    scene: Scene,
    *,
    rows: int,
    paths: int = DEFAULT_PATHS,
    seed: Seed = 0,
    reverse: Reverse = "auto",
    tolerance: float = 0.02,
    threads: int | None = None,
) -> Iterator[tuple[slice, Covariance]]:
    """Yield the covariance by blocks of rows, for what does not fit into memory at once.

    Each item is (slice of rows, :class:`Covariance` with arrays [n, T, V]); row number = light * V + view. The same
    paths are traced anew for every block, so the blocks fit together, equal to rounding to the whole.

    Parameters
    ----------
    rows
        Rows at a time.
    scene, paths, seed, reverse, tolerance, threads
        As for :func:`covariance`.
    """
    if rows < 1:
        reject("covariance_blocks rows", "at least 1", rows)
    instance("covariance_blocks scene", scene, Scene)
    warn_of_dependence(scene.medium.mean_free_path, scene.wavelength)
    checked_budget("covariance_blocks", paths, None, None)
    tracer, reversal = _prepare(scene, reverse, tolerance)
    t, v = len(scene.lights), len(scene.views)
    _require_memory(t, v, rows)
    require_reach("covariance_blocks", unseen_variance(scene), paths)
    for start in range(0, t * v, rows):
        part = slice(start, min(start + rows, t * v))
        entries = _rows(part, t * v)
        found, powers = _estimate(
            tracer, tracer.layout, paths, seed, reverse=reversal.needed, entries=entries, threads=threads
        )  # fmt: skip
        if start == 0:
            _warn("covariance_blocks", scene, powers)
        yield part, found.reshaped((part.stop - part.start, t, v))


@dataclass(frozen=True)
class _Entries:
    """Which entries of C to estimate: their shape, how amplitudes [T * V, M] add to their sums on threads, their scale.

    ``scale`` maps C_pp, float64[T * V], to sqrt(C_pp C_qq) of the entries.
    """

    shape: tuple[int, ...]
    add: Callable[[np.ndarray, np.ndarray, Threads], None]
    scale: Callable[[np.ndarray], np.ndarray]
    symmetric: bool = False


def _all_pairs(n: int) -> _Entries:
    def lower_triangle(out: np.ndarray, a: np.ndarray, threads: Threads) -> None:
        conjugate = a.conj().T

        def rows(start: int) -> None:
            stop = start + _BLOCK_ROWS
            out[start:stop, :stop] += a[start:stop] @ conjugate[:, :stop]

        map_blocks(rows, range(0, n, _BLOCK_ROWS), threads)

    return _Entries((n, n), lower_triangle, lambda power: np.sqrt(np.outer(power, power)), symmetric=True)


def _chosen_pairs(layout: Layout, pairs: np.ndarray) -> tuple[Layout, _Entries]:
    """The chosen entries, and the layout with only the lights and views that they name: no other end is evaluated."""
    lights, light_numbers = np.unique(pairs[:, [0, 2]], return_inverse=True)
    views, view_numbers = np.unique(pairs[:, [1, 3]], return_inverse=True)
    left, right = (light_numbers.reshape(-1, 2) * len(views) + view_numbers.reshape(-1, 2)).T

    def entries(out: np.ndarray, a: np.ndarray, threads: Threads) -> None:
        out += np.einsum("pm,pm->p", a[left], a[right].conj())

    scale = _Entries((len(pairs),), entries, lambda power: np.sqrt(power[left] * power[right]))
    return layout.of_ends(lights, views), scale


def _rows(part: slice, n: int) -> _Entries:
    def rows(out: np.ndarray, a: np.ndarray, threads: Threads) -> None:
        out += a[part] @ a.conj().T

    return _Entries((part.stop - part.start, n), rows, lambda power: np.sqrt(np.outer(power[part], power)))


def _prepare(scene: Scene, reverse: Reverse, tolerance: float) -> tuple[Tracer, Decision]:
    if not 0 < tolerance < 1:
        reject("covariance tolerance", "between 0 and 1", tolerance)
    reversal = scene_reversal(scene, reverse, tolerance)
    return volume_tracer(scene, reversal.needed), reversal


def _estimate(
    tracer: Tracer,
    seen: Layout,
    paths: int,
    seed: Seed,
    *,
    reverse: bool,
    entries: _Entries,
    threads: int | None,
    stream: Stream = Stream.PATHS,
) -> tuple[Covariance, np.ndarray]:
    """Sum the outer products of amplitudes over batches of paths, and find the error from their scatter.

    Paths are those of ``tracer``; amplitudes are at the lights and views of ``seen``, all of them or some, whose
    intensities float64[batches, T * V], sums over the paths of each batch, are returned beside.
    """
    total, single = np.zeros((2, *entries.shape), np.complex128)
    squares = np.zeros(entries.shape)
    pairs = len(seen.lights) * len(seen.views)
    power, powers = np.zeros(pairs), []
    unfinished = 0
    batches = even_slices(paths, BATCHES)
    step = max(1, COVARIANCE_ELEMENTS // max(pairs, 1))
    members = thread_count(threads)
    ways = partial(_both_ways, seen, tracer.bidirectional, reverse)

    def batch(part: slice, threads: Threads) -> tuple[np.ndarray, np.ndarray, np.ndarray, int]:
        once, often = np.zeros((2, *entries.shape), np.complex128)
        lit, cut = np.zeros(pairs), 0
        for start in range(part.start, part.stop, _PATHS_AT_ONCE):
            count = min(_PATHS_AT_ONCE, part.stop - start)
            bank = tracer.trace(seed, count, first=start, stream=stream, threads=threads)
            cut += bank.unfinished
            amplitudes = chain(
                ((once, single_amplitudes(seen, piece, threads)) for piece in _pieces(bank.single, step)),
                ((often, ways(piece, threads)) for piece in _pieces(bank.multiple, step)),
            )
            for out, some in amplitudes:
                entries.add(out, some, threads)
                lit += np.einsum("pm,pm->p", some, some.conj()).real
        return once, often, lit, cut

    with one_blas_thread():
        for once, often, lit, cut in in_turn(batch, batches, members, batches_side_by_side(total.size, members)):
            single += once
            often += once
            total += often
            squares += np.square(often.real) + np.square(often.imag)
            power += lit
            powers.append(lit)
            unfinished += cut
    total /= paths
    single /= paths
    lit = np.array(powers)
    error = _standard_error(squares / paths**2, total, len(batches))
    error *= entries.scale(tail_factor(lit - lit.mean(axis=0)))
    if entries.symmetric:
        for matrix in (total, single, error):
            _mirror(matrix)
    scale = entries.scale(power / paths)
    relative = np.divide(error, scale, out=np.zeros_like(error), where=scale > 0).max(initial=0.0)
    found = Covariance(total, error, single, total - single, paths, reverse, float(relative), unfinished)
    return found, lit


def _both_ways(layout: Layout, bidirectional: bool, reverse: bool, bank: PathBank, threads: Threads) -> np.ndarray:
    return multiple_amplitudes(layout, bank, bidirectional=bidirectional, reverse=reverse, threads=threads)


def _standard_error(squares: np.ndarray, mean: np.ndarray, n: int) -> np.ndarray:
    """Error of a mean from the sum of |what each of n batches adds to it|^2; NaN where n < 2."""
    if n < 2:
        return np.full(mean.shape, np.nan)
    scatter = squares - (np.square(mean.real) + np.square(mean.imag)) / n
    return np.sqrt(np.clip(scatter, 0, None) * n / (n - 1))


def batches_side_by_side(entries: int, threads: int) -> int:
    """Batches of paths in work at a time: of large covariances one after the other."""
    return max(1, min(threads, threads * _ENTRIES // max(entries, 1)))


def _pieces(bank: PathBank, step: int) -> Iterator[PathBank]:
    return (bank.select(slice(start, start + step)) for start in range(0, len(bank), step))


def _mirror(matrix: np.ndarray) -> None:
    """Fill the upper triangle from the lower one."""
    for row in range(len(matrix)):
        matrix[row, row + 1 :] = matrix[row + 1 :, row].conj()
        matrix[row, row] = matrix[row, row].real


def _warn(owner: str, scene: Scene, powers: np.ndarray) -> None:
    """Warn of views that are dark beside others, and of errors that rest on few paths."""
    told = dark_views(scene, False, powers.sum(axis=0))
    if told:
        warnings.warn(f"dark views: {told}.", DoubtWarning, stacklevel=3)
    warn_of_rare_paths(owner, powers, stacklevel=4)


def _checked_pairs(pairs: ArrayLike, t: int, v: int) -> np.ndarray:
    chosen = np.asarray(pairs)
    if chosen.ndim != 2 or chosen.shape[1] != 4 or not np.issubdtype(chosen.dtype, np.integer):
        reject("covariance pairs", "whole numbers of shape (P, 4): light, view, light, view", chosen)
    if (chosen < 0).any() or (chosen >= np.array([t, v, t, v])).any():
        reject("covariance pairs", f"below {t} for lights and below {v} for views, and at least 0", chosen)
    return chosen


def _require_memory(t: int, v: int, rows: int) -> None:
    require_memory(
        "covariance", "held", rows * t * v * (16 * 6 + 8 * 3), f"{rows} rows of {t} lights x {v} views",
        "Choose entries with pairs=, or stream rows with covariance_blocks.",
    )  # fmt: skip
