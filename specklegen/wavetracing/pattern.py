"""Diffraction patterns as distributions: wavevectors drawn from |Psi(xi)|^2 of slits and polygons.

Light that passes an opening leaves with the wavevector xi added in the plane of the opening; the power in d^2xi is
|Psi|^2 d^2xi / (4 pi^2 A). Draws are exact (`specklegen.wavetracing.kernels.patterns`), each at its own address, so
that results are the same for any number of threads.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Annotated, Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from specklegen.core.arguments import choice, positive_number, real_array, whole_number
from specklegen.core.display.plot import Pictured
from specklegen.core.errors import reject
from specklegen.core.memory import require_memory
from specklegen.core.parallel import map_blocks, slices
from specklegen.core.quantities import with_units
from specklegen.core.random_streams import Seed, Stream, stream_key
from specklegen.core.units import LENGTH, WAVELENGTH
from specklegen.wavetracing.angular_spectrum import quadrature
from specklegen.wavetracing.aperture import Amplitude, aperture_transform
from specklegen.wavetracing.kernels.patterns import draw_polygons, draw_slits, draw_table, fill_alias
from specklegen.wavetracing.opening import Opening, Rim, doubt_narrow, rim_of

Method = Literal["rejection", "table"]

BLOCK = 1 << 14
"""Draws that a thread takes at once."""

CELLS = 16
"""Cells of a table for each 2 pi / size, the width of the finest structure of a pattern."""

MOST_CELLS = 1 << 24
"""Cells of a table at most: 256 MiB."""


@dataclass(frozen=True, repr=False)
class Pattern(Pictured):
    """Wavevectors drawn from a diffraction pattern.

    Attributes
    ----------
    xi : float64[n, 2], or float64[n] for slits
        Radians per unit length; NaN where every try failed.
    trials : int
        Proposals tried for all draws together, kept ones included.
    evanescent : int
        Draws of |xi| above the wave number, which carry no power away: each was drawn again. Of all light that leaves
        the opening, evanescent / (evanescent + n) is the share of them.
    failed : int
        Draws given up after 1024 tries for each edge or slit.

    Examples
    --------
    >>> from specklegen.wavetracing import sample_slits
    >>> sample_slits([1.0, 1.0], [-2.0, 2.0], [0.0, 0.0], 100, seed=0, wavelength=None).xi.shape
    (100,)
    """

    xi: np.ndarray
    trials: int
    evanescent: int
    failed: int

    _named = {"wavevectors drawn": "xi", "trials": "trials", "evanescent": "evanescent", "failed": "failed"}

    def _draw(self, axes: Any, label: str | None = None) -> None:
        """Histogram of the draws, without the outermost of their long tails."""
        found = self.xi[np.isfinite(self.xi).reshape(len(self.xi), -1).all(axis=1)]
        reach = np.quantile(np.abs(found), 0.97) if len(found) else 1.0  # the tails are long
        if found.ndim == 1:
            axes.hist(found, bins=200, range=(-reach, reach), histtype="step", label=label)
            axes.set(xlabel="wavevector ξ", ylabel="draws")
            return
        axes.hist2d(*found.T, bins=100, range=[[-reach, reach]] * 2, cmap="magma")
        axes.set(xlabel="wavevector ξ along x", ylabel="along y", aspect="equal")


@with_units
def sample_slits(
    widths: Annotated[ArrayLike, LENGTH],
    centres: Annotated[ArrayLike, LENGTH],
    phases: ArrayLike,
    count: int,
    seed: Seed,
    *,
    wavelength: Annotated[float, WAVELENGTH] | None = 1.0,
    threads: int | None = None,
) -> Pattern:
    """Draw from the pattern of slits in flatland, |sum_l w_l sinc(xi w_l/2) e^{-i xi c_l + i phase_l}|^2.

    Parameters
    ----------
    widths, centres, phases
        float64[N] each; phases in radians, of the light in each slit.
    count
        Number of draws.
    seed
        A whole number or a sequence of them.
    wavelength
        In the unit of the slits' lengths: draws with |xi| > 2 pi / wavelength are drawn again and counted; None: none
        are.
    threads
        Threads, by default all cores that the process may run on; they do not change the draws.

    Returns
    -------
    Pattern
        ``xi`` float64[count]. Trials a draw: N for slits apart, 1 for slits on each other.

    Raises
    ------
    RuleError
        If there are no slits, a width is not positive, or something is not finite.

    Examples
    --------
    >>> from specklegen.wavetracing import sample_slits
    >>> drawn = sample_slits([4.0, 4.0], [-10.0, 10.0], [0.0, 0.0], 100, seed=0)
    >>> drawn.xi.shape, drawn.trials
    ((100,), 226)
    """
    given = {"widths": widths, "centres": centres, "phases": phases}
    arrays = [real_array(f"sample_slits {name}", each).copy() for name, each in given.items()]
    wavelength = None if wavelength is None else positive_number("sample_slits wavelength", wavelength)
    if any(a.ndim != 1 or a.shape != arrays[0].shape or not np.isfinite(a).all() for a in arrays) or not arrays[0].size:
        reject("sample_slits", "given one finite width, centre and phase a slit", [a.shape for a in arrays])
    if not (arrays[0] > 0).all():
        reject("sample_slits widths", "greater than 0", arrays[0])
    if wavelength is not None:
        doubt_narrow("sample_slits widths: the narrowest", float(arrays[0].min()), wavelength)
    arrays[1] = arrays[1] - arrays[1].mean()
    draw = partial(_fill, draw_slits, (*arrays, np.cumsum(arrays[0]), _longest(wavelength)))
    return _draw(draw, (_count(count),), seed, threads)


@with_units
def sample_pattern(
    opening: Opening,
    count: int,
    seed: Seed,
    method: Method = "rejection",
    *,
    amplitude: Amplitude = 1.0,
    wavelength: Annotated[float, WAVELENGTH] | None = 1.0,
    threads: int | None = None,
) -> Pattern:
    """Draw from |Psi(xi)|^2 of an opening under uniform light, or by a table under any.

    Parameters
    ----------
    opening
        A loop float64[n, 2], or several: outer ones counter-clockwise, holes clockwise; of positive area.
    count
        Number of draws.
    seed
        A whole number or a sequence of them.
    wavelength
        In the unit of the opening's lengths: draws with |xi| > 2 pi / wavelength are drawn again and counted. None:
        none are.
    threads
        Threads, by default all cores that the process may run on; they do not change the draws.
    method
        "rejection": exact, for uniform light; its work grows with the square of the number of edges.
        "table": |Psi|^2 on square cells of 2 pi / (16 size) out to the wave number, bilinear within a cell. Then
        ``evanescent`` counts the corners of the square that the table covers and no more.
    amplitude
        For the table: the field in the opening, one number for all of it (1 by default), or a function of points
        float64[P, 2], which is taken at Gauss nodes an eighth of a wavelength apart.

    Returns
    -------
    Pattern
        ``xi`` float64[count, 2].

    Raises
    ------
    RuleError
        If the opening has no area, a table would need more than 2^24 cells, rejection is asked for other light.

    Examples
    --------
    >>> from specklegen.wavetracing import sample_pattern
    >>> square = [[-5, -5], [5, -5], [5, 5], [-5, 5]]
    >>> sample_pattern(square, 100, seed=0).xi.shape
    (100, 2)
    """
    rim = rim_of("sample_pattern opening", opening)
    if not rim.area > 0:
        reject("sample_pattern opening", "of positive area", rim.area, "No light passes: there is no pattern.")
    choice("sample_pattern method", method, ("rejection", "table"))
    wavelength = None if wavelength is None else positive_number("sample_pattern wavelength", wavelength)
    longest = _longest(wavelength)
    if wavelength is not None:
        doubt_narrow("sample_pattern opening", rim.breadth, wavelength)
    if method == "table":
        arguments = _table(rim, amplitude, longest)
        return _draw(partial(_fill, draw_table, (*arguments, longest)), (_count(count), 2), seed, threads)
    if callable(amplitude):
        reject("sample_pattern amplitude", "a number for rejection", amplitude, 'Use method="table".')
    arguments = (rim.about_centre, rim.area, longest)
    return _draw(partial(_fill, draw_polygons, arguments), (_count(count), 2), seed, threads)


def _longest(wavelength: float | None) -> float:
    if wavelength is None:
        return np.inf
    if not (np.isfinite(wavelength) and wavelength > 0):
        reject("wavelength", "finite and greater than 0, or None", wavelength)
    return 2 * np.pi / wavelength


def _count(count: int) -> int:
    count = whole_number("count", count)
    require_memory("count", "held", 16.0 * count, f"{count} draws", "Draw fewer at a time.", share=0.9)
    return count


def _fill(
    kernel: Callable[..., None], arguments: tuple, key: tuple[int, int], xi: np.ndarray, block: slice
) -> np.ndarray:
    counts = np.zeros(3, np.int64)
    kernel(*key, block.start, *arguments, xi[block], counts)
    return counts


def _draw(
    fill: Callable[[tuple[int, int], np.ndarray, slice], np.ndarray], shape: tuple[int, ...], seed: Seed,
    threads: int | None,
) -> Pattern:  # fmt: skip
    xi = np.empty(shape)
    key = stream_key(seed, Stream.DIFFRACTION)
    counts = map_blocks(lambda block: fill(key, xi, block), slices(shape[0], BLOCK), threads)
    trials, evanescent, failed = (int(n) for n in np.sum(counts, axis=0)) if counts else (0, 0, 0)
    return Pattern(xi, trials, evanescent, failed)


def _table(rim: Rim, amplitude: Amplitude, longest: float) -> tuple:
    if not np.isfinite(longest):
        reject("sample_pattern wavelength", "given for a table", None, "The table ends at the wave number.")
    size = float(np.ptp(rim.starts, axis=0).max())
    half = max(4, int(np.ceil(CELLS * longest * size / (2 * np.pi))))
    if 4 * half**2 > MOST_CELLS:
        need = f"It needs {4 * half**2} cells."
        reject("sample_pattern method", "'rejection' for so large an opening", "table", need)
    step = longest / half
    corners, middles = _lattice(rim, amplitude, half, step, 2 * np.pi / longest)
    # The mean over a cell to the fourth order in its width: 2/3 of the middle, 1/12 of each corner.
    power = 2 / 3 * middles + (corners[1:, 1:] + corners[1:, :-1] + corners[:-1, 1:] + corners[:-1, :-1]) / 12
    if not power.sum() > 0:
        reject("sample_pattern amplitude", "not 0 all over the opening", amplitude)
    share = power.ravel() * (power.size / power.sum())
    probability, alias = np.ones(share.size), np.arange(share.size)
    fill_alias(share, np.argsort(share), probability, alias)
    return probability, alias, corners, -longest, step


def _lattice(rim: Rim, amplitude: Amplitude, half: int, step: float, wavelength: float) -> list[np.ndarray]:
    """|Psi|^2 at the corners float64[2 half + 1, 2 half + 1] and middles float64[2 half, 2 half] of the cells."""
    if not callable(amplitude):
        lattices = (np.arange(-half, half + 1) * step, (np.arange(2 * half) - half + 0.5) * step)
        points = (np.stack(np.meshgrid(along, along), axis=-1) for along in lattices)
        return [np.square(np.abs(aperture_transform(rim, xi, amplitude))) for xi in points]
    from finufft import nufft2d1

    nodes, weights = quadrature(rim.triangles, wavelength)
    values = np.asarray(amplitude(nodes), dtype=np.complex128)
    if values.shape != weights.shape or not np.isfinite(values).all():
        reject("sample_pattern amplitude", "finite, one value a point", values)
    x, y = np.ascontiguousarray(((nodes - rim.centre) * (step / 2)).T)
    count = 4 * half + 1
    psi = np.asarray(nufft2d1(y, x, weights * values, (count, count), isign=-1, eps=1e-10, nthreads=1))
    return [np.square(np.abs(psi[first::2, first::2])) for first in (0, 1)]
