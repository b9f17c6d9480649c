"""The transmission matrix of a scattering scene: its own Green's function, illumination modes by pixels.

    T[p, m] = u_{i_m}(v_p) = N^(-1/2) sum over paths of  z sqrt(W) A_{i_m} B_{v_p}        (physics.md 2)

Every column comes from the same medium: the same paths and the same random phases. The basis is that of the
engine, collimated beams of unit irradiance through one window of the entrance face (tilts). It is complete: an
amplitude on the face of a window of side W is a Fourier series in beams whose sines are whole multiples of
wavelength / W (`face_beams`, `face_modes`); coherent modes of a source of beams are superpositions of
them (`source_modes`). A partially coherent image is

    I = sum_k lambda_k |T phi_k|^2 = intensity_from_modes(T.value, modes, eigenvalues).
"""

from typing import Annotated, Unpack

import numpy as np

from specklegen.coherence.cross_spectral_density import coherent_modes
from specklegen.coherence.cylindrical_focus import GreensMatrix
from specklegen.core.arguments import finite_numbers, instance, positive_number, whole_number
from specklegen.core.budgets import Budget, BudgetFields, budget_of
from specklegen.core.errors import reject
from specklegen.core.quantities import with_units
from specklegen.core.shielded import shielded
from specklegen.core.units import LENGTH, WAVELENGTH
from specklegen.planning.planning import Options
from specklegen.rendering import rendered
from specklegen.samplers.sampler import AnySampler
from specklegen.scene.illumination import CollimatedBeams, IncoherentObject, directions_of_sines
from specklegen.scene.scene import Scene, require_no_film, require_unpolarised

_NULL = 1e-12  # of the trace: power below which a mode is rounding


@shielded()
def transmission_matrix(
    scene: Scene, modes: np.ndarray | None = None, *, budget: Budget | None = None, sampler: AnySampler | None = None,
    mean: bool = False, **fields: Unpack[BudgetFields],
) -> GreensMatrix:  # fmt: skip
    """Return the transmission matrix of one medium, sensor pixels x illumination modes.

    Parameters
    ----------
    scene
        Its beams are the columns: those of `CollimatedBeams`, or of the shining pixels of an
        `IncoherentObject` (in C order, at unit irradiance); or the foci of `FocusedBeams`, each of unit power. Seen by
        `Imaging`, the rows are pixels on the plane in focus.
    modes : complex128[beams, K], optional
        Amplitudes over the beams; then the columns are these superpositions.
    budget
        Paths or an error, time, seed, threads and reversed paths (:class:`specklegen.results.Budget`), as of
        :func:`specklegen.render`. By default 100 000 paths. Two calls with one seed see the same medium where
        the scenes are the same; otherwise only about, since each scene has its own pilot.
    sampler
        "paths", "stationary", "covariance", "screens", one of your own, or "auto", the cheapest that is right within
        the tolerance (:func:`specklegen.plan` says what each serves). By default "paths", and "screens" of thin media.
    mean
        Add the mean field: what is not scattered, and the mean of what is.
    fields
        Fields of the budget by name, such as ``paths=10_000, seed=1``, in place of those of ``budget``.

    Returns
    -------
    GreensMatrix
        ``value`` complex128[pixels, K], pixels of the sensor in C order; |value|^2 is area per steradian for
        unit irradiance. The entries are a realization of the medium, so with more paths they do not settle:
        what the number of paths decides is how well the *scale* of their statistics is known. |T|^2 has
        the relative standard error ``report.expected_error``, common to all entries, and
        ``standard_error`` is half of it times |value|.

    Examples
    --------
    >>> import specklegen as sg
    >>> slab = sg.Slab(thickness=10.0, mean_free_path=5.0, scatterer=sg.media.Isotropic())
    >>> light = sg.light.CollimatedBeams.tilts([0.0, 1e-3], width=100.0)
    >>> scene = sg.Scene(wavelength=0.5, medium=slab, illumination=light, sensor=sg.sensors.FarField.grid((4, 4), 1e-3))
    >>> sg.statistics.transmission_matrix(scene, paths=1000, seed=0).value.shape  # pixels, beams
    (16, 2)
    """
    require_no_film("transmission_matrix", instance("transmission_matrix scene", scene, Scene))
    require_unpolarised("transmission_matrix", scene)
    beams = scene.illumination if scene.illumination.focused else scene.beams
    count = len(beams.vectors)
    modes = None if modes is None else finite_numbers("transmission_matrix modes", modes)
    if modes is not None and (modes.ndim != 2 or modes.shape[0] != count):
        reject("transmission_matrix modes", f"of shape ({count}, K), one row a beam", modes.shape)
    budget = budget_of("transmission_matrix", budget, fields, unused=("tolerance",))
    sampler = sampler or ("paths" if scene.thin is None else "screens")
    stack = rendered(scene.replace(illumination=beams), budget, Options(sampler, mean, owner="transmission_matrix"))
    value = stack.field.reshape(count, -1).T.astype(np.complex128)
    if modes is not None:
        value = value @ modes
    return GreensMatrix(value, 0.5 * stack.report.expected_error * np.abs(value))


@with_units
def source_modes(
    source: IncoherentObject, wavelength: Annotated[float, WAVELENGTH], n_modes: int | None = None, energy: float = 0.99
) -> tuple[np.ndarray, np.ndarray]:
    """Return the coherent modes of a source of mutually incoherent beams, as amplitudes over its beams.

    The beams p_j overlap under the window, so fewer modes than beams carry the light. With the overlaps
    W^ of `specklegen.scene.window.Window.coherence`, the matrix sqrt(p_j p_l) W^(s_j - s_l) has the
    eigenvalues of W0, and an eigenvector v gives the mode of amplitudes sqrt(p_j / lambda) v_j.

    Parameters
    ----------
    source
        Such as `specklegen.coherence.partially_coherent.gaussian_schell_object`.
    wavelength
        Inside the medium, in the unit of all lengths.
    n_modes
        How many; by default the fewest that hold the share ``energy`` of the power. Modes of less than 1e-12 of it are
        left out.
    energy
        Between 0 and 1, 0.99 by default; more asks for more modes.

    Returns
    -------
    eigenvalues : float64[K]
        Power of each mode, falling; the sum of all is that of the brightness.
    modes : float64[beams, K]
        For `transmission_matrix` or `specklegen.coherence.cross_spectral_density.intensity_from_modes`; of unit norm on
        the window, relative to that of a beam.

    Examples
    --------
    >>> from specklegen.coherence import gaussian_schell_object, source_modes
    >>> power, modes = source_modes(gaussian_schell_object(0.5, 500.0, width=1000.0), wavelength=0.5)
    >>> modes.shape  # amplitudes over the beams
    (45, 8)
    """
    instance("source_modes source", source, IncoherentObject)
    wavelength = positive_number("source_modes wavelength", wavelength)
    power = source.brightness[source.brightness > 0]
    x, y = source.beams.directions[:, :2].T / wavelength
    overlap = source.window.coherence(x[:, None] - x, y[:, None] - y)
    eigenvalues, vectors = coherent_modes(np.sqrt(power[:, None] * power) * overlap, n_modes, energy)
    kept = eigenvalues > _NULL * power.sum()
    return eigenvalues[kept], np.sqrt(power)[:, None] * vectors[:, kept] / np.sqrt(eigenvalues[kept])


@with_units
def face_beams(
    wavelength: Annotated[float, WAVELENGTH], width: Annotated[float, LENGTH], count: int,
) -> CollimatedBeams:  # fmt: skip
    """Return the beams of a Fourier series on a square window: count^2 sines, whole multiples of wavelength / width.

    Parameters
    ----------
    wavelength
        Inside the medium, in the unit of all lengths.
    width
        Full side of the window, in the same unit.
    count
        Beams along either axis: as many as pixels of a wavelength or more are to be distinguished on the window.

    Raises
    ------
    RuleError
        If the sines leave the unit circle: ``count`` pixels of at least a wavelength fit into any width.

    Examples
    --------
    >>> from specklegen.coherence import face_beams
    >>> face_beams(0.5, width=20.0, count=8).directions.shape
    (64, 3)
    """
    wavelength, width = positive_number("face_beams wavelength", wavelength), positive_number("face_beams width", width)
    count = whole_number("face_beams count", count, 1, int(min(2 * width / wavelength, 2**12)) + 1)
    along = np.fft.fftfreq(count, 1 / count) * wavelength / width
    sines = np.stack(np.meshgrid(along, along), axis=-1).reshape(-1, 2)  # y outside, x fastest
    return CollimatedBeams(directions=directions_of_sines("face_beams count", sines), width=width)


def face_modes(amplitudes: np.ndarray) -> np.ndarray:
    """Return the amplitudes over `face_beams` that make given amplitudes on the pixels of the window.

    Parameters
    ----------
    amplitudes : complex128[count * count, K]
        Columns over the window's count x count pixels, row y and column x, both from the smallest position,
        in C order: as `specklegen.coherence.cross_spectral_density.separable_coherent_modes` gives them.

    Returns
    -------
    complex128[count * count, K]
        Between pixel centres the field is the trigonometric interpolation, which joins opposite edges.

    Examples
    --------
    >>> import numpy as np
    >>> from specklegen.coherence import face_modes
    >>> uniform = np.ones((64, 1))  # on 8 x 8 pixels: one beam, straight on
    >>> int((abs(face_modes(uniform)) > 1e-12).sum())
    1
    """
    amplitudes = finite_numbers("face_modes amplitudes", amplitudes)
    count = round(amplitudes.shape[0] ** 0.5) if amplitudes.ndim else 0
    if amplitudes.ndim != 2 or count**2 != len(amplitudes) or not count:
        reject("face_modes amplitudes", "of shape (n * n, K), a square of pixels", amplitudes.shape)
    series = np.fft.fft2(amplitudes.reshape(count, count, -1), axes=(0, 1), norm="forward")
    # A transform counts positions from its first pixel, a beam from the middle of the window.
    shift = np.exp(1j * np.pi * np.fft.fftfreq(count, 1 / count) * (count - 1) / count)
    return (series * shift[:, None, None] * shift[:, None]).reshape(count * count, -1)
