"""Covariance of speckle between lights and views: Algorithms 1 and 3 of [Bar19].

    C_pq = E[ W a_p a_q* ],    p, q = (light, view)

A sum of outer products, so Hermitian and positive semidefinite by construction. The mean m is never part of it.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, Unpack

import numpy as np
from numpy.typing import ArrayLike

from specklegen.core.arguments import instance, real_array, whole_number
from specklegen.core.budgets import Budget, BudgetFields, budget_of
from specklegen.core.decision import Decision
from specklegen.core.display.plot import Pictured, decided, draw_curve
from specklegen.core.errors import reject, warn_user
from specklegen.core.labelled import Labelled, Labels, recorded
from specklegen.core.memory import require_memory
from specklegen.core.random_streams import Seed, Stream, pilot_seed, stream_key
from specklegen.core.shielded import shielded
from specklegen.kernels.rng import fill_normals
from specklegen.paths.deep_absorption import crossing_variances, dark_views, require_reach
from specklegen.paths.layout import Layout
from specklegen.paths.pilot import volume_pilot
from specklegen.paths.rare_paths import warn_of_rare_paths
from specklegen.paths.reversal import scene_reversal
from specklegen.paths.tracer import Tracer, volume_tracer
from specklegen.samplers.covariance.cost import require_covariance_time
from specklegen.samplers.covariance.outer_products import (
    Entries,
    all_pairs,
    chosen_pairs,
    mirror,
    outer_products,
    some_rows,
)
from specklegen.samplers.covariance.single_scattering import Orders, all_quadruples, single_covariance, single_decision
from specklegen.scene.scene import Scene, require_no_film, require_no_focus
from specklegen.scene.validity import warn_of_doubts


@dataclass(frozen=True, repr=False)
class Covariance(Pictured, Labelled):
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

    Examples
    --------
    >>> import specklegen as sg
    >>> slab = sg.Slab(thickness=10.0, mean_free_path=5.0, scatterer=sg.media.Isotropic())
    >>> light = sg.light.CollimatedBeams.tilts([0.0, 1e-3], width=100.0)
    >>> scene = sg.Scene(wavelength=0.5, medium=slab, illumination=light, sensor=sg.sensors.FarField.grid((1, 3), 1e-3))
    >>> found = sg.statistics.covariance(scene, paths=1000)
    >>> found.intensity.shape  # of every light and view
    (2, 3)
    >>> found.sample(4, seed=0).shape  # Gaussian fields of this covariance
    (4, 2, 3)
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

    _named = {"|C|": "value", "paths": "paths", "reversed paths": "reverse", "largest relative error": "rel_error"}
    _single = ("paths", "reverse", "rel_error", "unfinished")

    def _facts(self) -> Mapping[str, object]:
        return {**super()._facts(), **decided(self.decisions)}

    def _arrays(self) -> Mapping[str, Labels]:
        axes = {1: ("pair",), 3: ("row", "other_light", "other_view"),
                4: ("light", "view", "other_light", "other_view")}[self.value.ndim]  # fmt: skip
        unit = "squared length of the scene"
        names = ("value", "standard_error", "single", "multiple")
        return {name: Labels(axes, getattr(self, name), unit) for name in names}

    def _draw(self, axes: Any, label: str | None = None) -> None:
        """|C|: a matrix of all (light, view), or a curve of the chosen pairs with bars of two standard errors."""
        size = np.abs(self.value)
        if size.ndim == 1:
            draw_curve(axes, np.arange(len(size)), size, self.standard_error, label, xlabel="pair", ylabel="|C|")
            return
        rows = size.shape[0] * (size.shape[1] if size.ndim == 4 else 1)
        axes.imshow(size.reshape(rows, -1), cmap="magma", vmin=0, aspect="auto", interpolation="nearest")
        axes.set(xlabel="(light, view)", ylabel="(light, view)")

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
        realizations = whole_number("Covariance.sample realizations", realizations, 1)
        t, v = self.value.shape[:2]
        held = 16.0 * t * v * realizations
        amount = f"{realizations} fields"
        require_memory("Covariance.sample realizations", "held", held, amount, "Draw fewer realizations at a time.",
                       share=0.9)
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
            reject(f"Covariance.{name}", "computed for a covariance of all pairs",
                   f"a covariance of shape {self.value.shape}")


@recorded
@shielded()
def covariance(
    scene: Scene, *, budget: Budget | None = None, pairs: ArrayLike | None = None, orders: Orders = "auto",
    **fields: Unpack[BudgetFields],
) -> Covariance:  # fmt: skip
    """Estimate the covariance of the speckle field of a scene; the memory it takes does not grow with ``paths``.

    Parameters
    ----------
    scene
        Any medium, lights and sensor. An incoherent object's lights are its lit pixels' beams of unit irradiance.
    budget
        Paths, an error or a time, seed, threads and reversed paths (:class:`specklegen.results.Budget`). ``rel_error``
        is the largest standard error over sqrt(C_pp C_qq). By default 100 000 paths.
    pairs
        int[P, 4], rows (light, view, light, view): only these entries. Default: all of them.
    orders
        "all", "single", or "auto": single scattering alone, in closed form (Eq. 41) instead of by Monte Carlo, where
        a pilot finds the rest below ``tolerance`` and the closed form cheaper. ``rel_error`` then is the share of the
        intensity left out, and ``standard_error`` is 0. For a homogeneous box, plane waves and far views.
    fields
        Fields of the budget by name, such as ``paths=10_000, seed=1``, in place of those of ``budget``.

    Raises
    ------
    RuleError
        For an argument out of range, a closed form that does not exist, or a result that does not fit into memory.

    Warns
    -----
    DoubtWarning
        Where the mean free path is below the wavelength: independent scattering is then doubtful. Where beams are so
        narrow that diffraction widens them inside the medium, which is not modelled. Where some lights and views are
        found at less than 1e-3 of the brightest ones: connections are kept by those. Where standard errors rest on
        next to no path.

    Examples
    --------
    >>> import specklegen as sg
    >>> slab = sg.Slab(thickness=10.0, mean_free_path=5.0, scatterer=sg.media.Isotropic())
    >>> light = sg.light.CollimatedBeams.tilts([0.0, 1e-3], width=100.0)
    >>> scene = sg.Scene(wavelength=0.5, medium=slab, illumination=light, sensor=sg.sensors.FarField.grid((1, 3), 1e-3))
    >>> sg.statistics.covariance(scene, paths=1000).value.shape  # light, view, light, view
    (2, 3, 2, 3)
    """
    budget = budget_of("covariance", budget, fields)
    _require_volume("covariance", scene)
    t, v = len(scene.lights), len(scene.views)
    if pairs is None:
        _require_memory(t, v, t * v)  # before the pilot, whose time would be lost
    reversal = scene_reversal(scene, budget.reverse, budget.tolerance)
    tracer, reverse = volume_tracer(scene, reversal.needed), reversal.needed
    if pairs is None:
        chosen, seen, entries = None, tracer.layout, all_pairs(t * v)
    else:
        chosen = _checked_pairs(pairs, t, v)
        seen, entries = chosen_pairs(tracer.layout, chosen)
    wanted = len(chosen) if chosen is not None else (t * v) ** 2
    alone = single_decision(scene, orders, wanted, budget.tolerance, reverse)
    decisions = (reversal, alone)
    if not alone.needed:
        value = single_covariance(scene, all_quadruples(t, v) if chosen is None else chosen)
        if chosen is None:
            value = value.reshape(t * v, t * v)
            mirror(value)  # each half has a rounding of its own
            value = value.reshape(t, v, t, v)
        left_out = volume_pilot(scene, reverse).multiple_share
        zeros = np.zeros(value.shape)
        return Covariance(value, zeros, value, zeros.astype(np.complex128), 0, reverse, left_out, 0, decisions)
    run = partial(_estimate, tracer, seen, reverse=reverse, entries=entries, threads=budget.threads)
    keyed = pilot_seed(scene.unitless_fingerprint())
    count = budget.count(lambda n: run(n, keyed, stream=Stream.PILOT)[0].rel_error)
    variances = crossing_variances(scene)
    require_reach("covariance", min(variances, default=0.0), count)
    asked = (t * v) ** 2 / 2 if chosen is None else float(len(chosen))
    require_covariance_time("covariance", scene, reverse, count, asked)
    estimate, powers = run(count, budget.seed)
    _warn("covariance", variances, powers)
    estimate = replace(estimate, decisions=decisions)
    return estimate if pairs is not None else estimate.reshaped((t, v, t, v))


def covariance_blocks(
    scene: Scene, *, rows: int, budget: Budget | None = None, **fields: Unpack[BudgetFields]
) -> Iterator[tuple[slice, Covariance]]:
    """Return the covariance by blocks of rows, for what does not fit into memory at once.

    Each item is (slice of rows, :class:`Covariance` with arrays [n, T, V]); row number = light * V + view. The same
    paths are traced anew for every block, so the blocks fit together, equal to rounding to the whole.

    Parameters
    ----------
    scene
        Medium, lights and views, whose every pair is a row.
    rows
        Rows at a time: memory grows with their number, and paths are traced anew for each block.
    budget
        Paths, seed, threads and reversed paths (:class:`specklegen.results.Budget`). By default 100 000 paths.
    fields
        Fields of the budget by name, such as ``paths=10_000, seed=1``, in place of those of ``budget``.

    Examples
    --------
    >>> import specklegen as sg
    >>> slab = sg.Slab(thickness=10.0, mean_free_path=5.0, scatterer=sg.media.Isotropic())
    >>> light = sg.light.CollimatedBeams.tilts([0.0, 1e-3], width=100.0)
    >>> scene = sg.Scene(wavelength=0.5, medium=slab, illumination=light, sensor=sg.sensors.FarField.grid((1, 3), 1e-3))
    >>> for rows, block in sg.statistics.covariance_blocks(scene, rows=4, paths=1000):
    ...     print(rows, block.value.shape)
    slice(0, 4, None) (4, 2, 3)
    slice(4, 6, None) (2, 2, 3)
    """
    rows = whole_number("covariance_blocks rows", rows, 1)
    budget = budget_of("covariance_blocks", budget, fields, unused=("rel_error", "seconds"))
    _require_volume("covariance_blocks", scene)
    reversal = scene_reversal(scene, budget.reverse, budget.tolerance)
    tracer, paths = volume_tracer(scene, reversal.needed), budget.count(lambda n: 0.0)
    t, v = len(scene.lights), len(scene.views)
    _require_memory(t, v, rows)
    variances = crossing_variances(scene)
    require_reach("covariance_blocks", min(variances, default=0.0), paths)
    require_covariance_time("covariance_blocks", scene, reversal.needed, paths, (t * v) ** 2 / 2)
    return _blocks(tracer, t, v, rows, replace(budget, paths=paths, reverse=reversal.needed), variances)


def _blocks(
    tracer: Tracer, t: int, v: int, rows: int, budget: Budget, variances: tuple[float, ...]
) -> Iterator[tuple[slice, Covariance]]:
    assert budget.paths is not None
    for start in range(0, t * v, rows):
        part = slice(start, min(start + rows, t * v))
        entries = some_rows(part, t * v)
        with shielded():
            estimate, powers = _estimate(tracer, tracer.layout, budget.paths, budget.seed, reverse=bool(budget.reverse),
                                         entries=entries, threads=budget.threads)  # fmt: skip
        if start == 0:
            _warn("covariance_blocks", variances, powers)
        yield part, estimate.reshaped((part.stop - part.start, t, v))


def _estimate(
    tracer: Tracer, seen: Layout, paths: int, seed: Seed, *, reverse: bool, entries: Entries, threads: int | None,
    stream: Stream = Stream.PATHS,
) -> tuple[Covariance, np.ndarray]:  # fmt: skip
    """The covariance, and the intensities float64[batches, T * V] of each batch; see :func:`outer_products`."""
    sums = outer_products(
        tracer, seen, paths, seed, reverse=reverse, entries=entries, threads=threads, stream=stream
    )  # fmt: skip
    total, single = sums.total, sums.single
    estimate = Covariance(total, sums.error, single, total - single, paths, reverse, sums.relative, sums.unfinished)
    return estimate, sums.powers


def _warn(owner: str, variances: tuple[float, ...], powers: np.ndarray) -> None:
    """Warn of views that are dark beside others, and of errors that rest on few paths."""
    dark = dark_views(variances, powers.sum(axis=0))
    if dark:
        warn_user(f"dark views: {dark}.")
    warn_of_rare_paths(owner, powers)


def _require_volume(owner: str, scene: Scene) -> None:
    """Refuse thin screens, whose correlations are closed forms, and warn of what the model doubts of the others."""
    instance(f"{owner} scene", scene, Scene)
    if scene.thin is not None:
        reject(f"{owner} scene", "of a medium of scatterers", scene.medium.type,
               "Use memory_effect or joint_correlation, which are exact for thin screens.")  # fmt: skip
    require_no_film(owner, scene)
    require_no_focus(owner, scene)
    warn_of_doubts(scene)


def _checked_pairs(pairs: ArrayLike, t: int, v: int) -> np.ndarray:
    real_array("covariance pairs", pairs)
    chosen = np.asarray(pairs)
    if chosen.ndim != 2 or chosen.shape[1] != 4 or not np.issubdtype(chosen.dtype, np.integer):
        reject("covariance pairs", "whole numbers of shape (P, 4): light, view, light, view", chosen)
    if (chosen < 0).any() or (chosen >= np.array([t, v, t, v])).any():
        reject("covariance pairs", f"below {t} for lights and below {v} for views, and at least 0", chosen)
    return chosen


def _require_memory(t: int, v: int, rows: int) -> None:
    require_memory("covariance", "held", rows * t * v * (16 * 6 + 8 * 3), f"{rows} rows of {t} lights x {v} views",
                   "Choose entries with pairs=, or stream rows with covariance_blocks.")  # fmt: skip
