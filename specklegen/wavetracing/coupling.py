"""Light from openings into the engine: a field on the window of a medium becomes beams and their amplitudes.

A field on n x n pixels of a square window, of side W = n pitch, is a Fourier series of n^2 collimated beams of the
direction sines m lambda / W (`specklegen.coherence.face_beams`, `face_modes`); a scene's transmission matrix T answers
for each, and the field behind the medium is T a for the amplitudes a. So

    beams, modes = illumination_of(field)
    T = transmission_matrix(scene with illumination=beams, modes, mean=True)     # all in one medium
    intensity = sum over columns j of |T_j|^2

Fields that interfere are one field; fields that do not (modes of partially coherent light) are several columns of one
call, since only beams of one call share the medium. The field must fall to 0 towards the rim of the window, or agree on
opposite sides: the series is periodic. What beams do not carry is stated by `window_losses`.

A path of wave tracing carries power, not a field. Its irradiance may be the brightness of an `IncoherentObject`; fields
come from `specklegen.wavetracing.field_on_plane`. This module alone knows the engine.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated

import numpy as np

from specklegen.coherence.transmission import face_modes
from specklegen.core.arguments import complex_array, positive_number, real_number, several
from specklegen.core.errors import reject, warn_user
from specklegen.core.quantities import with_units
from specklegen.core.units import WAVELENGTH
from specklegen.scene.illumination import CollimatedBeams, directions_of_sines
from specklegen.scene.sensors import FarFieldGrid
from specklegen.wavetracing.light import WaveSum
from specklegen.wavetracing.plane import PlaneField

DOUBTFUL = 0.01
"""Share of power at the seam, evanescent or unresolved above which `illumination_of` warns."""


@dataclass(frozen=True)
class WindowLosses:
    """Shares of the power of fields on a window that beams carry wrongly, or not at all.

    Attributes
    ----------
    rim : float
        In the outermost pixels. Small: the field ends within the window.
    seam : float
        |u - u'|^2 of neighbours across opposite sides, which the series joins, above that of neighbours inside, against
        the power. 0 for uniform light, whose rim is not.
    evanescent : float
        At direction sines of 1 and more. No beam carries it.
    unresolved : float
        In the upper quarter of the frequencies of the grid along x or y, as far as they travel. Where it is not small,
        the field is finer than its grid, and what is finer comes back at wrong angles: take a finer pitch, down to
        half a wavelength, which resolves every field.

    Examples
    --------
    >>> from specklegen.wavetracing import Plane, PlaneWave, field_on_plane, window_losses
    >>> window = Plane(center=[0, 0, 1], shape=(16, 16), pitch=0.5)
    >>> uniform = field_on_plane(None, PlaneWave(wavelength=1.0), window)
    >>> window_losses(uniform).seam
    0.0
    """

    rim: float
    seam: float
    evanescent: float
    unresolved: float


def window_losses(fields: PlaneField | Sequence[PlaneField]) -> WindowLosses:
    """Return what a window loses of the fields on it, before they are turned into beams.

    Parameters
    ----------
    fields
        On planes before the window, as :func:`illumination_of` takes them: one, or several of one plane.

    Examples
    --------
    >>> from specklegen.wavetracing import Plane, PlaneWave, field_on_plane, window_losses
    >>> window = Plane(center=[0, 0, 1], shape=(16, 16), pitch=0.5)
    >>> uniform = field_on_plane(None, PlaneWave(wavelength=1.0), window)
    >>> window_losses(uniform).rim  # of uniform light: 60 of 256 pixels
    0.234375
    """
    stack, first = _window(fields)
    power = np.square(np.abs(stack)).sum()
    inner = np.square(np.abs(stack[:, 1:-1, 1:-1])).sum()
    seam = _seam(stack) + _seam(stack.swapaxes(1, 2))
    amplitudes, sines = _series(stack, first)
    each = np.square(np.abs(amplitudes)).sum(axis=1)
    travels = _travels(sines)
    upper = np.abs(sines).max(axis=1) > 0.75 * first.wavelength / (2 * first.pitch)
    shares = (power - inner) / power, seam / power, each[~travels].sum() / each.sum()
    rim, joined, evanescent = map(float, shares)
    return WindowLosses(rim, joined, evanescent, float(each[travels & upper].sum() / each.sum()))


def illumination_of(
    fields: PlaneField | Sequence[PlaneField], power: float = 0.9999
) -> tuple[CollimatedBeams, np.ndarray]:
    """Return the beams that carry fields on the window of a medium, and their amplitudes.

    Parameters
    ----------
    fields
        One field, or K fields that do not interfere with each other, on one square grid at the entrance face; their
        wavelength is that inside the medium. All beams of a partially coherent source belong into one call.
    power
        Share of the power of all fields together that the beams carry at least, of what travels. Only the strongest
        are kept: idle beams cost time, and make another scene of it, with other pilots.

    Returns
    -------
    beams : CollimatedBeams
        Through a square window as wide as the grid, in the order of `specklegen.coherence.face_beams`.
    modes : complex128[beams, K]
        For `specklegen.coherence.transmission_matrix`; field k of the window is the sum of beams times column k.

    Raises
    ------
    RuleError
        If the grid is not square, the fields do not share grid and wavelength, nothing travels, or power is not
        between 0 and 1.

    Warns
    -----
    DoubtWarning
        Where more than 1 % of the power lies at the seam of the window, is evanescent, or is not resolved by the grid.

    Examples
    --------
    >>> from specklegen.wavetracing import Plane, PlaneWave, field_on_plane, illumination_of
    >>> window = Plane(center=[0, 0, 1], shape=(16, 16), pitch=0.5)
    >>> uniform = field_on_plane(None, PlaneWave(wavelength=1.0), window)
    >>> beams, amplitudes = illumination_of(uniform)
    >>> len(beams.directions)  # uniform light is one beam
    1
    """
    power = real_number("illumination_of power", power)
    if not 0 < power <= 1:
        reject("illumination_of power", "above 0 and at most 1", power)
    stack, first = _window(fields)
    losses = window_losses(fields)
    for share, problem in (
        (losses.seam, "lies at the seam of the window, where the series joins opposite sides: widen the window"),
        (losses.evanescent, "is evanescent, and no beam carries it: move the window away from the mask"),
        (losses.unresolved, "lies at the finest waves of the grid, so finer ones are aliased: take a finer pitch"),
    ):
        if share > DOUBTFUL:
            warn_user(f"illumination_of: {share:.1%} of the power {problem}.")
    amplitudes, sines = _series(stack, first)
    share = np.where(_travels(sines), np.square(np.abs(amplitudes)).sum(axis=1), 0.0)
    order = np.argsort(-share, kind="stable")
    carried = np.cumsum(share[order])
    if not carried[-1] > 0:
        reject("illumination_of fields", "of some power that travels", float(carried[-1]),
               "The mask is closed, or its field varies within a wavelength: open or widen it.")  # fmt: skip
    kept = np.sort(order[: 1 + int(np.searchsorted(carried, power * carried[-1]))])
    kept = kept[share[kept] > 0]
    directions = directions_of_sines("illumination_of fields", sines[kept])
    return CollimatedBeams(directions=directions, width=first.pitch * len(stack[0])), amplitudes[kept]


@with_units
def light_behind(values: np.ndarray, sensor: FarFieldGrid, wavelength: Annotated[float, WAVELENGTH]) -> WaveSum:
    """Return the light behind a medium, from its far field: on the way to an aperture, a mask, a camera.

    A far field f(s), |f|^2 power per solid angle, is that of ``u = (ik / 2 pi) sum_s ds^2 f(s) / cos(s) e^{ik s.r}``
    (Goodman, *Introduction to Fourier Optics*, section 3.10); z is counted from the plane where the light leaves.

    Parameters
    ----------
    values
        complex128[h, w] or [h w], the field in each view: a column of `transmission_matrix`.
    sensor
        Views of one grid, fine enough for the light: it repeats sideways with the period wavelength / pitch, which must
        hold the place where light leaves and what it moves aside on its way.
    wavelength
        Inside the medium, in the unit of all lengths.

    Returns
    -------
    WaveSum
        A light for `field_on_plane`.

    Raises
    ------
    RuleError
        For values that are not one a view, or views against z.

    Examples
    --------
    >>> import numpy as np, specklegen as sg
    >>> from specklegen.wavetracing import light_behind
    >>> views = sg.sensors.FarField.grid((3, 3), 0.1)
    >>> light_behind(np.ones((3, 3)), views, wavelength=0.5).amplitudes.shape
    (9,)
    """
    wavelength = positive_number("light_behind wavelength", wavelength)
    grid = getattr(sensor, "regular_grid", None)
    if grid is None:
        reject("light_behind sensor", "views on a grid, as sg.sensors.FarField.grid makes", sensor)
    directions = grid.directions.reshape(-1, 3)
    values = complex_array("light_behind values", values).ravel()
    if len(values) != len(directions):
        reject("light_behind values", f"one for each of {len(directions)} views", len(values))
    if not directions[:, 2].min() > 0:
        reject("light_behind sensor", "views of transmitted light, towards +z", sensor.side)
    amplitudes = 1j / wavelength * grid.pitch**2 * values / directions[:, 2]
    return WaveSum(directions=directions, amplitudes=amplitudes, wavelength=wavelength)


def _window(fields: PlaneField | Sequence[PlaneField]) -> tuple[np.ndarray, PlaneField]:
    """The fields complex128[K, n, n], and the first of them."""
    given = several("illumination_of fields", fields, PlaneField)
    first = given[0]
    rows, columns = first.values.shape
    if rows != columns:
        reject("illumination_of fields", "on a square grid", first.values.shape, "A window has one width.")
    for field in given[1:]:
        if (field.values.shape, field.pitch, field.wavelength) != (first.values.shape, first.pitch, first.wavelength):
            reject("illumination_of fields", "on one grid, of one wavelength", (field.values.shape, field.pitch))
    stack = np.stack([field.values for field in given])
    if not np.abs(stack).max() > 0:
        reject("illumination_of fields", "not 0 everywhere", 0.0, "A closed mask is dark.")
    return stack, first


def _series(stack: np.ndarray, first: PlaneField) -> tuple[np.ndarray, np.ndarray]:
    """Amplitudes complex128[n * n, K] and direction sines float64[n * n, 2] of the series of a window."""
    count = stack.shape[-1]
    along = np.fft.fftfreq(count, 1 / count) * first.wavelength / (count * first.pitch)
    sines = np.stack(np.meshgrid(along, along), axis=-1).reshape(-1, 2)
    return face_modes(stack.reshape(len(stack), -1).T), sines


def _seam(stack: np.ndarray) -> float:
    """Power of the step from the last row to the first, above that of the mean step from row to row."""
    inside = np.square(np.abs(np.diff(stack, axis=1))).sum() / max(stack.shape[1] - 1, 1)
    return float(max(0.0, np.square(np.abs(stack[:, 0] - stack[:, -1])).sum() - inside))


def _travels(sines: np.ndarray) -> np.ndarray:
    return np.square(sines).sum(axis=1) < 1
