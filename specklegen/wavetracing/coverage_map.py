"""Radio coverage: received power over a map, in dB over 1 mW.

A beam of power w that crosses a cell of area A at the angle theta adds w / (A |cos theta|) to the power flux E there;
an antenna of gain G_r then receives P = E wavelength^2 G_r / 4 pi. Lengths in metres, frequencies in hertz, power in
watts. In free space this is Friis' formula, (wavelength / 4 pi R)^2 G_t G_r.

Source: S. Steinberg, M. Pharr, *Wave Tracing*, section on coverage; H. T. Friis, Proc. IRE 34, 254 (1946).
"""

from dataclasses import dataclass
from typing import Any, Literal, Self

import numpy as np
from pydantic import Field, model_validator

from specklegen.core.arguments import choice, instance, positive_number
from specklegen.core.display.plot import Pictured, draw_map
from specklegen.core.errors import reject, warn_user
from specklegen.core.parallel import Threads
from specklegen.core.random_streams import Seed
from specklegen.core.values import Array, Positive, Value
from specklegen.wavetracing.coherent_ray_sums import coherent_rays
from specklegen.wavetracing.emitters import PointEmitter
from specklegen.wavetracing.geometry import Geometry
from specklegen.wavetracing.materials import DIFFUSE, LIGHT_SPEED, WALL
from specklegen.wavetracing.plane import Plane
from specklegen.wavetracing.tracing import Diffraction, trace
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
    beam_angle: float = Field(0.02, gt=0, lt=np.pi / 4, allow_inf_nan=False)

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
        dB over 1 mW; -inf and masked where no beam came by.
    error : masked float64[h, w]
        Standard error in dB, to first order; masked alike.
    ledger, statistics
        Of the trace; None for "phase", which traces no beams.

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


def coverage(
    geometry: Geometry,
    transmitter: Transmitter,
    plane: Plane,
    frequency: float,
    method: Literal["wave", "ray", "phase"] = "wave",
    *,
    gain: float = 1.0,
    beams: int = 200_000,
    seed: Seed = 0,
    max_events: int = 16,
    diffraction: Diffraction = "fraunhofer",
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
        The map: one value a pixel, the mean over it; for "phase" at its middle.
    frequency
        Hertz.
    method
        "wave" (with diffraction), "ray", or "phase": all paths of one reflection and two edges at most, with their
        phases, without chance (`coherent_rays`; mean power of TE and TM, surfaces by their material).
    gain
        G_r of the receiving antenna, as a factor.
    beams
        Of "wave" and "ray": how many leave the transmitter; errors fall with the root of their number.
    seed
        Of these, a whole number or a sequence of them. Beam n is the same for any number of beams and threads.
    max_events
        Interactions after which a beam is stopped, and counted as such.
    diffraction
        Of "wave" alone. "fraunhofer": directions from the far-field pattern of each region. "utd": rays from edges by
        the uniform theory; noise may leave cells below 0, which are masked.
    threads
        Threads, by default all cores that the process may run on; the result does not depend on them.

    Raises
    ------
    RuleError
        For an argument out of range, or the middle of a cell within wavelength / 2 pi of the transmitter.

    A `DoubtWarning` says where "phase" leaves out light through walls or from diffuse surfaces.

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
    choice("coverage method", method, ("wave", "ray", "phase"))
    choice("coverage diffraction", diffraction, ("fraunhofer", "utd"))
    instance("coverage transmitter", transmitter, Transmitter)
    instance("coverage plane", plane, Plane)
    wavelength = LIGHT_SPEED / frequency
    nearest = float(np.linalg.norm(plane.points - transmitter.position, axis=-1).min())
    if nearest < wavelength / (2 * np.pi):
        reject(
            "coverage plane", f"at least wavelength / 2 pi = {wavelength / (2 * np.pi):.3g} m from the transmitter",
            nearest, "Nearer by an antenna receives no wave: Friis' formula would give more power than is sent.",
        )  # fmt: skip
    source = PointEmitter(transmitter.position, wavelength, transmitter.power, transmitter.beam_angle)
    if method == "phase":
        kinds = {int(mesh.material.row(wavelength)[0]) for mesh in geometry.meshes}
        if kinds & {WALL, DIFFUSE}:
            warn_user(
                'coverage: method "phase" has no light through walls and none of diffuse surfaces; use "wave" for it',
            )
        points = plane.points.copy()  # kernels are compiled for arrays that may be written into
        both = [
            coherent_rays(geometry, source, points, polarisation=name, surfaces="material") for name in ("soft", "hard")
        ]
        power = received_power(np.mean(np.square(np.abs(both)), axis=0), wavelength, gain)
        none = power == 0
        return Coverage(
            np.ma.array(decibel_milliwatt(power), mask=none), np.ma.array(np.zeros_like(power), mask=none), None, None
        )
    bent: Diffraction = diffraction if method == "wave" else "fraunhofer"
    traced = trace(geometry, source, plane, beams, seed, method, bent, max_events=max_events, threads=threads)
    power = received_power(np.maximum(traced.fluence[0], 0.0), wavelength, gain)
    none = power == 0
    relative = np.divide(traced.fluence_error[0], traced.fluence[0], out=np.zeros_like(power), where=~none)
    return Coverage(
        rss_dBm=np.ma.array(decibel_milliwatt(power), mask=none),
        error=np.ma.array(10 / np.log(10) * relative, mask=none),
        ledger=traced.ledger,
        statistics=traced.statistics,
    )


def received_power(flux: np.ndarray, wavelength: float, gain: float = 1.0) -> np.ndarray:
    """Return E wavelength^2 G_r / 4 pi in watts, of power fluxes in W/m^2."""
    return np.asarray(flux) * wavelength**2 * gain / (4 * np.pi)


def decibel_milliwatt(power: np.ndarray) -> np.ndarray:
    """Return powers in watts as dB over 1 mW; -inf for none."""
    power = np.asarray(power, float)
    return 10 * np.log10(1e3 * power, out=np.full(power.shape, -np.inf), where=power > 0)
