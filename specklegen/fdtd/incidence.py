"""Pulses, and the incident field that a pulse makes on the grid.

Times are lengths, c0 t. All methods share one incidence, so that they may be compared to rounding. On the
grid a plane wave of frequency omega (radians a step) advances by theta a cell,

    sin(omega/2) = S sin(theta/2),

and a soft source f that adds 2 S f to one cell emits f/cos(theta/2) half a step later. Sample n of a record
is the field after step n.

The ends of the grid are first-order Mur boundaries, ``e_0^{n+1} = e_1^n + c (e_1^{n+1} - e_0^n)``, which let one
frequency out exactly, ``c = sin((omega - theta)/2)/sin((omega + theta)/2)``. The textbook's ``(S - 1)/(S + 1)`` is
frequency 0; here it is the root mean square frequency of the pulse, which leaves an eighth of the echo.
"""

import math
from dataclasses import dataclass
from typing import Annotated

import numpy as np

from specklegen.core.display.repr import short
from specklegen.core.errors import reject
from specklegen.core.memory import require_memory
from specklegen.core.units import LENGTH, WAVELENGTH
from specklegen.core.values import Positive, Value
from specklegen.fdtd.layers import RandomLayer

MARGIN = 20
_SOURCE_DISTANCE = 10  # cells from the source to the layer
_FLOOR = 1e-8  # spectral lines weaker than this, relative to the strongest, are left out


class Pulse(Value):
    """A Gaussian pulse exp(-((t - t0)/tau)^2), times sin(omega0 (t - t0)) where it is modulated.

    Parameters
    ----------
    wavelength
        Of the carrier in vacuum, in the layer's unit of length.
    duration
        c0 tau, a length: how long the pulse is. A longer one has a narrower band.
    delay
        t0/tau; the pulse is cut off at its start, at exp(-delay^2) of its peak.
    modulated
        Whether there is a carrier; False leaves it out, so that the band reaches from 0.

    Examples
    --------
    >>> from specklegen.fdtd import Pulse
    >>> Pulse(wavelength=0.5, duration=1.0).delay
    4.0
    """

    wavelength: Annotated[Positive, WAVELENGTH] = 0.6
    duration: Annotated[Positive, LENGTH] = 1.69
    delay: Positive = 4.0
    modulated: bool = True

    def __call__(self, time: np.ndarray) -> np.ndarray:
        """Amplitude at ``time`` (c0 t, a length)."""
        t = np.asarray(time) - self.delay * self.duration
        with np.errstate(over="ignore"):  # times too far off for their square: dark
            envelope = np.exp(-((t / self.duration) ** 2))
        return envelope * np.sin(2 * math.pi / self.wavelength * t) if self.modulated else envelope


@dataclass(frozen=True)
class Incidence:
    """A pulse on the grid of a layer: the march's parameters, and the spectrum at the layer's first cell.

    Attributes
    ----------
    courant : float
        S, of the background.
    dt : float
        Time step times c0, a length.
    mur : float
        Coefficient of the ends.
    margin : int
        Cells between the layer and each end of the grid.
    source : float64[T]
        The soft source.
    n_fft : int
        Length of the discrete Fourier transform.
    bins : int[F]
        Its lines that the pulse occupies.
    omega, theta : float64[F]
        Phase a step and phase a cell, radians.
    spectrum : complex128[F]
        Of the incident field at the first cell.

    Examples
    --------
    >>> from specklegen.fdtd import RandomLayer, illuminate
    >>> found = illuminate(RandomLayer(correlation_length=0.02))
    >>> found.spectrum.shape == found.omega.shape
    True
    """

    courant: float
    dt: float
    mur: float
    margin: int
    source: np.ndarray
    n_fft: int
    bins: np.ndarray
    omega: np.ndarray
    theta: np.ndarray
    spectrum: np.ndarray

    __repr__ = short

    @property
    def steps(self) -> int:
        """Number of time steps T."""
        return self.source.size

    @property
    def time(self) -> np.ndarray:
        """Times of the records, c0 t, float64[T]."""
        return self.dt * np.arange(1, self.steps + 1)

    @property
    def source_cell(self) -> int:
        """The cell of the source."""
        return self.margin - _SOURCE_DISTANCE

    @property
    def wavenumber(self) -> np.ndarray:
        """Vacuum wave number omega/c0 of every line, float64[F]."""
        return self.omega / self.dt

    def series(self, response: np.ndarray) -> np.ndarray:
        """Time series float64[..., T] of ``response`` complex128[..., F] times the incident spectrum."""
        lines = np.asarray(response) * self.spectrum
        full = np.zeros((*lines.shape[:-1], self.n_fft // 2 + 1), dtype=complex)
        full[..., self.bins] = lines
        return np.fft.irfft(full, self.n_fft, axis=-1)[..., : self.steps]

    def basis(self) -> np.ndarray:
        """Real matrix float64[2F, T]: a response (Re, Im) times it is its time series."""
        identity = np.eye(self.bins.size)
        return np.concatenate([self.series(identity), self.series(1j * identity)])


def _background_courant(courant: float) -> float:
    if not 0 < courant <= 1:
        reject("courant", "greater than 0 and at most 1, the stability limit of a uniform background", courant,
               "The default is 1/n_background: below an index of 1, give a smaller one.")  # fmt: skip
    return courant


def phase_per_cell(omega: np.ndarray, courant: float) -> np.ndarray:
    """Phase theta that a background wave of ``omega`` radians a step gains in one cell."""
    omega = np.asarray(omega, dtype=float)
    highest = 2 * math.asin(_background_courant(courant))
    if omega.size and not (omega.min() >= 0 and omega.max() <= highest):
        reject("omega", f"in [0, 2 asin(S)] = [0, {highest:.4g}] radians a step", omega)
    return 2 * np.arcsin(np.sin(omega / 2) / courant)


def illuminate(
    layer: RandomLayer, pulse: Pulse | None = None, courant: float | None = None, margin: int = MARGIN
) -> Incidence:
    """Put ``pulse`` (by default the reference pulse) on the grid of ``layer``.

    The run lasts until the pulse has left after a round trip of the layer, with a tenth to spare.
    ``courant`` defaults to 1/n_b, a Courant number of 1 in vacuum.

    Parameters
    ----------
    layer
        The layer: its grid, its background, and the law of its index.
    pulse
        The light that comes in; by default the reference pulse, ``Pulse()``.
    courant
        Courant number of the background, at most 1; by default 1/n_b, which is 1 in vacuum. Smaller is slower.
    margin
        Cells between the layer and each end of the grid, at least as many as the source takes.

    Raises
    ------
    RuleError
        If the Courant number is not in (0, 1], the margin is too small for the source, the grid is too
        coarse for the pulse, or so fine that its steps do not fit into memory.

    Examples
    --------
    >>> from specklegen.fdtd import RandomLayer, illuminate
    >>> illuminate(RandomLayer(correlation_length=0.02)).courant
    0.6896551724137931
    """
    pulse = pulse or Pulse()
    courant = _background_courant(1 / layer.n_background if courant is None else courant)
    if margin < _SOURCE_DISTANCE + 2:
        reject("margin", f"at least {_SOURCE_DISTANCE + 2} cells", margin)
    dt = courant * layer.dx * layer.n_background
    crossing = (layer.n_points + MARGIN) / courant
    lasts = 2 * pulse.delay * pulse.duration / dt + 2.2 * crossing
    require_memory("single_realization", "run", 200 * lasts, f"{lasts:.3g} steps of {dt:.3g} each",
                   "Use a shorter pulse, or larger cells (dx).")  # fmt: skip
    steps = math.ceil(lasts)
    source = pulse(dt * np.arange(steps))
    n_fft = 1 << (steps + math.ceil(2 * layer.n_points / courant)).bit_length()  # no wrap: run + round trip
    lines = np.fft.rfft(source, n_fft)
    kept = np.abs(lines) > _FLOOR * np.abs(lines).max()
    kept[0] = False  # at zero frequency nothing scatters: r = 0, t = 1
    bins = np.flatnonzero(kept)
    omega = 2 * math.pi * bins / n_fft
    if np.sin(omega[-1] / 2) > courant * math.sin(math.pi / 8):
        coarsest = layer.dx * math.pi / 4 * courant / omega[-1]
        reject("RandomLayer.dx", "an eighth or less of the shortest wavelength of the pulse in the background",
               layer.dx, f"Use dx <= {coarsest:.3g}.")  # fmt: skip
    theta = phase_per_cell(omega, courant)
    emitted = np.exp(1j * (omega / 2 - theta * _SOURCE_DISTANCE)) / np.cos(theta / 2)
    spectrum = lines[bins] * emitted
    centre = math.sqrt(np.average(omega**2, weights=np.abs(spectrum) ** 2))
    advance = float(phase_per_cell(np.array(centre), courant))
    mur = math.sin((centre - advance) / 2) / math.sin((centre + advance) / 2)
    return Incidence(courant, dt, mur, margin, source, n_fft, bins, omega, theta, spectrum)
