"""Radio coverage: received power over a map, in dB over 1 mW.

The power flux E in a cell is the mean of |u|^2 over it, of the fields of all paths (`coherent_rays`). The cell is
divided into parts with a point each. At each point all paths are found, and within its part each counts as a plane wave
of the direction and amplitude that it has there, so that fringes are averaged in closed form. The standard error is
that of the mean over the parts. An antenna of gain G_r receives
P = E wavelength^2 G_r / 4 pi. Lengths in metres, frequencies in hertz, power in watts. In free space this is Friis'
formula, (wavelength / 4 pi R)^2 G_t G_r.

Method "ray" traces beams without diffraction instead: one of power w that crosses a cell of area A at the angle theta
adds w / (A |cos theta|). It knows diffuse surfaces, and any number of mirrors.

Source: S. Steinberg, M. Pharr, *Wave Tracing*, section on coverage; H. T. Friis, Proc. IRE 34, 254 (1946).
"""

from dataclasses import dataclass
from math import isqrt
from typing import Annotated, Any, Literal, Self

import numpy as np
from pydantic import Field, model_validator

from specklegen.core.arguments import choice, instance, positive_number, whole_number
from specklegen.core.display.plot import Pictured, draw_map
from specklegen.core.errors import reject, warn_user
from specklegen.core.parallel import Threads
from specklegen.core.quantities import mark_of, with_units
from specklegen.core.random_streams import Seed, Stream, stream_key
from specklegen.core.units import RADIAN, RATE
from specklegen.core.values import Array, Positive, Value
from specklegen.wavetracing.coherent_ray_sums import PathSearch
from specklegen.wavetracing.emitters import PointEmitter
from specklegen.wavetracing.geometry import Geometry
from specklegen.wavetracing.materials import LIGHT_SPEED, Diffuse
from specklegen.wavetracing.plane import Plane
from specklegen.wavetracing.tracing import trace
from specklegen.wavetracing.wave_trace import Ledger, Statistics


class Transmitter(Value):
    """An antenna that radiates evenly.

    Attributes
    ----------
    position : float64[3]
        Metres.
    power : float
        Watts; 1 mW by default, so that maps show the gain of the path in dB.
    beam_angle : float
        Half opening angle of beams, radians.

    Examples
    --------
    >>> from specklegen.wavetracing import Transmitter
    >>> Transmitter(position=[0, 0, 10]).power  # watts
    0.001
    """

    position: Array
    power: Positive = 1e-3
    beam_angle: Annotated[float, RADIAN] = Field(0.02, gt=0, lt=np.pi / 4, allow_inf_nan=False)

    def __init__(self, position, power=1e-3, beam_angle=0.02):
        super().__init__(position=position, power=power, beam_angle=beam_angle)

    @model_validator(mode="after")
    def _checked(self) -> Self:
        if self.position.shape != (3,):
            reject("Transmitter.position", "a point float64[3]", self.position.shape)
        return self


@dataclass(frozen=True, repr=False)
class Coverage(Pictured):
    """Received power over a map.

    Attributes
    ----------
    rss_dBm : masked float64[h, w]
        dB over 1 mW; -inf and masked where no path or beam comes by.
    error : masked float64[h, w]
        Standard error in dB, to first order; masked alike. 0 for "phase".
    ledger, statistics
        Of method "ray"; None for others, which trace no beams.

    Examples
    --------
    >>> from specklegen.wavetracing import Conductor, Geometry, Plane, Transmitter, coverage, perforated_screen
    >>> wall = perforated_screen([[-1, -3], [1, -3], [1, 3], [-1, 3]], material=Conductor())
    >>> plane = Plane(center=[0, 0, 5], shape=(4, 4), pitch=1.0)
    >>> found = coverage(Geometry([wall]), Transmitter(position=[0, 0, -5]), plane, 1e9, "ray", beams=2000)
    >>> found.rss_dBm.shape
    (4, 4)
    """

    rss_dBm: np.ma.MaskedArray
    error: np.ma.MaskedArray
    ledger: Ledger | None
    statistics: Statistics | None

    _named = {"received power, dB over 1 mW": "rss_dBm", "standard error, dB": "error"}

    def _draw(self, axes: Any, label: str | None = None) -> None:
        """Received power; cells without any are left white."""
        draw_map(axes, self.rss_dBm, "received power, dB over 1 mW", cmap="viridis")
        axes.set(xlabel="column of the map", ylabel="row")


@with_units
def coverage(
    geometry: Geometry,
    transmitter: Transmitter,
    plane: Plane,
    frequency: Annotated[float, RATE],
    method: Literal["wave", "ray", "phase"] = "wave",
    *,
    gain: float = 1.0,
    reflections: int = 1,
    diffractions: int = 2,
    floor_db: float = 60.0,
    samples: int = 4,
    beams: int = 200_000,
    max_events: int = 16,
    seed: Seed = 0,
    threads: Threads = None,
) -> Coverage:
    """Map the power that an antenna would receive.

    Parameters
    ----------
    geometry
        The scene, in metres; building materials take their properties at ``frequency``.
    transmitter
        Where the waves come from.
    plane
        The map: one value a cell.
    frequency
        Hertz.
    method
        "wave": mean over each cell of the power of all paths by mirrors and edges, of TE and TM; "phase": the same at
        the middles of the cells alone; "ray": beams without diffraction.
    gain
        G_r of the receiving antenna, as a factor.
    reflections, diffractions
        Most reflections and edges of a path of "wave" and "phase".
    floor_db
        Of "wave" and "phase": paths past two edges are left out once all that are left are together this many dB below
        those that were found.
    samples
        Points in each cell of "wave"; errors fall with the root of their number and faster. Parts of a cell are
        squares where this is a square number.
    beams
        Of "ray": how many leave the transmitter. Beam n is the same for any number of beams and threads.
    max_events
        Of "ray": interactions after which a beam is stopped, and counted as such.
    seed
        Of points and beams, a whole number or a sequence of them.
    threads
        Threads, by default all cores that the process may run on; the result does not depend on them.

    Raises
    ------
    RuleError
        For an argument out of range, or the middle of a cell within wavelength / 2 pi of the transmitter.

    A `DoubtWarning` says where paths leave out light from diffuse surfaces, where corners matter, and where edges are
    too near.

    Examples
    --------
    >>> from specklegen.wavetracing import Conductor, Geometry, Plane, Transmitter, coverage, perforated_screen
    >>> wall = perforated_screen([[-1, -3], [1, -3], [1, 3], [-1, 3]], material=Conductor())
    >>> plane = Plane(center=[0, 0, 5], shape=(4, 4), pitch=1.0)
    >>> coverage(Geometry([wall]), Transmitter(position=[0, 0, -5]), plane, 1e9, "ray", beams=2000).rss_dBm.shape
    (4, 4)
    """
    frequency = positive_number("coverage frequency", frequency)
    gain = positive_number("coverage gain", gain)
    samples = whole_number("coverage samples", samples, 2, 4096)
    choice("coverage method", method, ("wave", "ray", "phase"))
    instance("coverage transmitter", transmitter, Transmitter)
    instance("coverage plane", plane, Plane)
    for part in (plane, *(mesh.material for mesh in geometry.meshes)):
        mark = mark_of(part)
        if mark is not None and mark.lengths:
            reject(f"coverage {type(part).__name__}", "in metres", f"lengths in units of {mark.metres:g} m",
                   "Write its lengths as bare numbers in metres.")  # fmt: skip
    wavelength = LIGHT_SPEED / frequency
    nearest = float(np.linalg.norm(plane.points - transmitter.position, axis=-1).min())
    if nearest < wavelength / (2 * np.pi):
        reject(
            "coverage plane", f"at least wavelength / 2 pi = {wavelength / (2 * np.pi):.3g} m from the transmitter",
            nearest, "Nearer by an antenna receives no wave: Friis' formula would give more power than is sent.",
        )  # fmt: skip
    source = PointEmitter(transmitter.position, wavelength, transmitter.power, transmitter.beam_angle)
    if method == "ray":
        traced = trace(geometry, source, plane, beams, seed, "ray", max_events=max_events, threads=threads)
        return _coverage(traced.fluence[0], traced.fluence_error[0], wavelength, gain, traced.ledger, traced.statistics)
    search = PathSearch("coverage", geometry, source, reflections, diffractions, "material", floor_db)
    if any(isinstance(mesh.material, Diffuse) for mesh in geometry.meshes):
        warn_user(f'coverage: method "{method}" has no light of diffuse surfaces; use "ray" for it')
    if method == "phase":
        flux = np.square(np.abs(search.found(plane.points.reshape(-1, 3).copy(), threads)[0]))
        return _coverage(flux.mean(axis=1).reshape(plane.shape), np.zeros(plane.shape), wavelength, gain)
    # Each cell is divided into rows and columns of parts, with a point at random in each.
    rows = max(n for n in range(1, isqrt(samples) + 1) if samples % n == 0)
    columns, middles = samples // rows, plane.points.reshape(-1, 3)
    half = plane.axes[:2] * plane.pitch / 2 / np.array([[columns], [rows]])
    column, row = np.arange(samples) % columns, np.arange(samples) // columns
    steps = np.stack([2 * column + 1 - columns, 2 * row + 1 - rows], axis=1)
    parts = (middles + (steps @ half)[:, None]).reshape(-1, 3)
    aside = np.random.Generator(np.random.Philox(key=stream_key(seed, Stream.BEAMS))).uniform(-1, 1, (len(parts), 2))
    flux = search.found(parts + aside @ half, threads, parts, half)[1].mean(axis=1).reshape(samples, -1)
    error = flux.std(axis=0, ddof=1) / np.sqrt(samples)
    return _coverage(flux.mean(axis=0).reshape(plane.shape), error.reshape(plane.shape), wavelength, gain)


def _coverage(flux, error, wavelength: float, gain: float, ledger=None, statistics=None) -> Coverage:
    """Return a map of power fluxes float64[h, w] and their errors."""
    power = received_power(flux, wavelength, gain)
    none = power <= 0
    relative = np.divide(error, flux, out=np.zeros_like(power), where=~none)
    return Coverage(
        np.ma.array(decibel_milliwatt(power), mask=none), np.ma.array(10 / np.log(10) * relative, mask=none),
        ledger, statistics,
    )  # fmt: skip


def received_power(flux: np.ndarray, wavelength: float, gain: float = 1.0) -> np.ndarray:
    """Return ``E wavelength^2 G_r / 4 pi`` in watts, of power fluxes in W/m^2."""
    return np.asarray(flux) * wavelength**2 * gain / (4 * np.pi)


def decibel_milliwatt(power: np.ndarray) -> np.ndarray:
    """Return powers in watts as dB over 1 mW; -inf for none."""
    power = np.asarray(power, float)
    return 10 * np.log10(1e3 * power, out=np.full(power.shape, -np.inf), where=power > 0)
