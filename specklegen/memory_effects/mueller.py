"""Mean Mueller matrix of the scattered light of a slab: intensities of every channel, and how far light is polarised.

    M_ij = E[ tr(s_i F s_j F^+) ] / 2,    s = 1, sigma_z, sigma_x, sigma_y

F the field of a connection, as a matrix from that of the light (:mod:`specklegen.memory_effects.polarised`): both ways
of a path together where they interfere. Van de Hulst, *Light Scattering by Small Particles* (1957), sec. 5.14.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Annotated, Any, Literal, Unpack, get_args

import numpy as np
from numpy.typing import ArrayLike

from specklegen.core.arguments import choice, complex_array
from specklegen.core.budgets import Budget, BudgetFields, budget_of
from specklegen.core.display.plot import Pictured
from specklegen.core.errors import reject, warn_user
from specklegen.core.parallel import Threads, even_slices, in_turn, thread_count
from specklegen.core.quantities import with_units
from specklegen.core.random_streams import Seed, pilot_seed
from specklegen.core.shielded import shielded
from specklegen.core.statistics import BATCHES, jackknife
from specklegen.core.units import WAVELENGTH
from specklegen.memory_effects.curve import Mode, aimed, require_traced
from specklegen.memory_effects.polarised import interfering, pair_ways
from specklegen.paths.endpoints import AXIS
from specklegen.paths.jones import require_ends
from specklegen.paths.rare_paths import warn_of_rare_paths
from specklegen.paths.tracer import plane_tracer
from specklegen.scene.media import PlaneMedium

_SPINS = np.array([[[1, 0], [0, 1]], [[1, 0], [0, -1]], [[0, 1], [1, 0]], [[0, -1j], [1j, 0]]])
"""Matrices of I, Q, U and V."""
_MIRRORED = np.array([1.0, 1.0, -1.0, -1.0])[:, None]
"""Signs of I, Q, U and V after a mirror image that keeps x."""
Frame = Literal["laboratory", "travelling"]


@dataclass(frozen=True, repr=False)
class MuellerMatrix(Pictured):
    """Mueller matrix of a slab for light along its axis, for Stokes vectors (I, Q, U, V), averaged over the particles.

    Attributes
    ----------
    matrix : float64[4, 4]
        From light of unit irradiance to scattered intensity, per area of the face and steradian. Q is what lies along x
        minus what lies along y, x and y tilted the shortest way until they are across the direction of light or view:
        the same x and y for light that comes and light that is sent back.
    standard_error : float64[4, 4]
        Of it, from 64 independent batches.
    linear, circular : float
        Degree of polarisation (I_co - I_crossed) / (I_co + I_crossed) of light that was polarised along x, and of
        circular light: M_QQ / M_II (on the axis, behind the slab), M_VV / M_II.
    linear_error, circular_error : float
        Standard errors.
    paths : int
    reverse : bool
        Whether reversed paths took part.
    frame : str
        "laboratory", as above. In "travelling" x, y and the direction of travel are right-handed for light sent back
        too, as textbooks have it: y turns round, and with it the signs of U and V, of the degree ``circular`` as well.

    Examples
    --------
    >>> import specklegen as sg
    >>> air = sg.Slab(thickness=1000.0, mean_free_path=1000.0, scatterer=sg.media.Rayleigh(), polarisation="vector")
    >>> found = sg.statistics.mueller_matrix(air, wavelength=0.5, paths=4000)
    >>> round(found.linear, 1), round(found.contrast, 1)
    (0.7, 0.9)
    """

    matrix: np.ndarray
    standard_error: np.ndarray
    linear: float
    linear_error: float
    circular: float
    circular_error: float
    paths: int
    reverse: bool
    frame: Frame = "laboratory"

    _named = {"degree of polarisation, linear": "linear", "degree of polarisation, circular": "circular",
              "paths": "paths", "reversed paths": "reverse", "frame": "frame"}  # fmt: skip

    @property
    def contrast(self) -> float:
        """Contrast of speckle without an analyser, of light polarised along x: ``sqrt((1 + P^2) / 2)`` on the axis."""
        _, q, u, v = self.matrix[:, 0] + self.matrix[:, 1]
        intensity = self.matrix[0, 0] + self.matrix[0, 1]
        return float(np.sqrt((1 + (q * q + u * u + v * v) / intensity**2) / 2))

    def intensity(self, light: ArrayLike, seen: ArrayLike | None = None) -> float:
        """Intensity of light of a field complex128[2] along x and y, behind an analyser that passes another.

        Both fields are along the x and y of the matrix' own frame.
        """
        field = _field("light", light)
        stokes = np.einsum("a,iab,b->i", field.conj(), _SPINS, field).real
        if seen is None:
            return float(self.matrix[0] @ stokes)
        passed = _field("seen", seen)
        analyser = np.einsum("a,iab,b->i", passed.conj(), _SPINS, passed).real
        return float(analyser @ self.matrix @ stokes) / 2

    def _draw(self, axes: Any, label: str | None = None) -> None:
        """The matrix over its first element."""
        shown = axes.imshow(self.matrix / self.matrix[0, 0], cmap="RdBu", vmin=-1, vmax=1)
        axes.figure.colorbar(shown, ax=axes)
        axes.set_xticks(range(4), ["I", "Q", "U", "V"])
        axes.set_yticks(range(4), ["I", "Q", "U", "V"])


def _field(name: str, value: ArrayLike) -> np.ndarray:
    """A field complex128[2]."""
    field = complex_array(f"MuellerMatrix.intensity {name}", value)
    if field.shape != (2,) or not np.isfinite(field).all():
        reject(f"MuellerMatrix.intensity {name}", "two finite numbers, of the fields along x and y", value)
    return field


@with_units
@shielded()
def mueller_matrix(
    medium: PlaneMedium, *, wavelength: Annotated[float, WAVELENGTH], budget: Budget | None = None,
    mode: Mode = "transmission", view: ArrayLike | None = None, frame: Frame = "laboratory",
    **fields: Unpack[BudgetFields],
) -> MuellerMatrix:  # fmt: skip
    """Estimate the mean Mueller matrix of the light that a slab scatters into one direction, at normal incidence.

    Parameters
    ----------
    medium
        A slab or layers with a ``polarisation``.
    wavelength
        Inside the medium, in its unit of length.
    mode
        "transmission" looks along the axis; "reflection" back through the entrance face.
    view
        float64[3], direction in which light is seen. By default the axis in transmission, and in reflection 5 degrees
        off exact backscattering, away from its enhancement.
    frame
        "laboratory": x and y are the same for light that comes and light that is sent back. "travelling": right-handed
        with the direction of travel, as is usual (van de Hulst 1957; Bohren and Huffman 1983): of light sent back U and
        V have the other sign. In transmission both are one.
    budget
        Paths, an error or a time, seed, threads and reversed paths (:class:`specklegen.results.Budget`). ``rel_error``
        is the largest standard error of the degrees of polarisation. By default 100 000 paths.
    fields
        Fields of the budget by name, such as ``paths=10_000, seed=1``, in place of those of ``budget``.

    Raises
    ------
    RuleError
        As :func:`specklegen.memory_effect`; for a medium in which light is a scalar.

    Warns
    -----
    DoubtWarning
        As :func:`specklegen.memory_effect`.

    Examples
    --------
    >>> import specklegen as sg
    >>> tissue = sg.Slab(
    ...     thickness=1000.0, mean_free_path=200.0, scatterer=sg.media.HenyeyGreenstein(0.9), polarisation="projector"
    ... )
    >>> sg.statistics.mueller_matrix(tissue, wavelength=0.5, paths=4000).linear > 0.95
    True
    """
    owner = "mueller_matrix"
    budget = budget_of(owner, budget, fields)
    choice(f"{owner} frame", frame, get_args(Frame))
    aim = aimed(owner, medium, wavelength, np.zeros(1), mode, view, budget.reverse, budget.tolerance)
    if medium.polarisation == "scalar":
        reject(f"{owner} medium", 'a medium with polarisation = "projector" or "vector"', medium.polarisation,
               "For scalar light the polarisation does not change.")  # fmt: skip
    both = aim.reversal.needed

    def run(count: int, seed: Seed) -> MuellerMatrix:
        found = _estimate(medium, float(wavelength), aim.view, count, seed, budget.threads, both)
        if frame == "laboratory" or aim.side > 0:
            return replace(found, frame=frame)
        return replace(found, frame=frame, matrix=_MIRRORED * found.matrix, circular=-found.circular)

    def worst(count: int) -> float:
        matrix = run(count, pilot_seed(medium.unitless_fingerprint()))
        return float(np.nan_to_num(max(matrix.linear_error, matrix.circular_error)))

    count = budget.count(worst)
    require_traced(owner, medium, aim, count, budget.threads)
    return run(count, budget.seed)


def _estimate(
    medium: PlaneMedium, wavelength: float, view: np.ndarray, paths: int, seed: Seed, threads: int | None, reverse: bool
) -> MuellerMatrix:
    tracer = plane_tracer(medium, wavelength, AXIS[None], view[None], reverse)
    ends = require_ends(medium)

    def batch(part: slice, crew: Threads) -> np.ndarray:
        bank = tracer.trace(seed, part.stop - part.start, first=part.start, threads=crew)
        ways = pair_ways(ends, tracer.layout, tracer.layout, bank, reverse)
        fields = np.concatenate(interfering([way.fields for way in ways])[:2])
        pairs = np.einsum("mac,mbd->abcd", fields, fields.conj())  # E[F_ac F_bd*]
        return np.einsum("iba,abcd,jcd->ij", _SPINS, pairs, _SPINS).real / 2

    parts = even_slices(paths, BATCHES)
    sums = np.array(list(in_turn(batch, parts, thread_count(threads)))) / max(paths, 1)
    matrix = sums.sum(axis=0)
    if not matrix[0, 0] > 0:
        warn_user(f"mueller_matrix: none of {paths} paths carried light, so the result is unknown. Trace more paths.")
    warn_of_rare_paths("mueller_matrix", sums[:, 0, 0])
    error = sums.std(axis=0, ddof=1) * np.sqrt(len(parts)) if len(parts) > 1 else np.full((4, 4), np.nan)
    with np.errstate(invalid="ignore"):
        degrees, spread = jackknife(sums, lambda total: total.diagonal()[1:] / total[0, 0])
    linear, _, circular = degrees
    return MuellerMatrix(
        matrix, error, float(linear), float(spread[0]), float(circular), float(spread[2]), paths, reverse
    )  # fmt: skip
