"""Partially coherent illumination of a scene: the Gaussian Schell-model source, as tilted beams.

Light of coherence length sigma_g under a window of amplitude b(x) has the cross-spectral density

    W0(x, x') = b(x) b(x') exp{-|x - x'|^2 / (2 sigma_g^2)} = sum_j p_j [b(x) e^{ik s_j . x}] [b(x') e^{ik s_j . x'}]*

where p is a Gaussian of standard deviation 1 / (k sigma_g) in direction sines s: it *is* an incoherent
superposition of beams through the window, whatever the window's width. A lattice of sines repeats the
coherence at distances of one wavelength over its pitch, which has to fall outside the window; with that the
sum is as good as the integral. So a source is an `IncoherentObject` of Gaussian brightness, and every sampler
of the engine renders it, the stationary one without ever forming its beams.

The contrast at a pixel comes from the source alone. Two beams reach one view v with the correlation

    <u_j(v) u_l(v)*> / I = W^(s_j - s_l),     W^ = Fourier transform of b^2 over its integral     (physics.md 4)

without the memory effect, which correlates beams at views moved with them. Hence

    contrast^2 = sum_jl p_j p_l W^(s_j - s_l)^2 / (sum p)^2 = tr W0^2 / (tr W0)^2 = 1 / N_eff,

the law of independent entries (`specklegen.coherence.cross_spectral_density`), since points of the entrance face do
scatter independently into one direction. What the memory effect decides is the *shape* of the speckle: inside its range
images of two beams are shifted copies and partially coherent light blurs the speckle, beyond it grains keep their size.
With K of `MemoryEffectCorrelation` and A(s) the autocorrelation of p over (sum p)^2,

    cov(I(v), I(v + d)) / I^2 = K(k d)^2 sum_s A(s) W^(d - s)^2.
"""

import math
from typing import Annotated, Unpack, get_args

import numpy as np

from specklegen.core.arguments import choice, instance, positive_number, real_number, whole_number
from specklegen.core.budgets import Budget, BudgetFields, budget_of
from specklegen.core.errors import reject
from specklegen.core.labelled import recorded
from specklegen.core.memory import require_memory
from specklegen.core.quantities import with_units
from specklegen.core.random_streams import Stream, pilot_seed
from specklegen.core.shielded import shielded
from specklegen.core.units import LENGTH, SINE, WAVELENGTH
from specklegen.paths.endpoint_factors import contributions
from specklegen.paths.endpoints import AXIS
from specklegen.paths.tracer import slab_tracer
from specklegen.planning.planning import Options
from specklegen.rendering import SpeckleStack, rendered
from specklegen.samplers.sampler import AnySampler
from specklegen.scene.illumination import CollimatedBeams, IncoherentObject, directions_of_sines, object_sines
from specklegen.scene.scene import Scene, require_no_film, require_no_focus, require_range, require_unpolarised
from specklegen.scene.window import Profile, Window

REACH = 4.0
"""Standard deviations kept of the angular spectrum, and of the coherence beyond the window: exp(-8) = 0.03 %."""
_LIT = 8.0  # decay of the intensity up to which a point of the window counts as lit: 2 widths of a Gaussian
COHERENT = 100.0
"""Widths of coherence length from which light counts as coherent: 1 - abs(mu) <= 1e-4."""
_FINEST = 800.0  # coherence lengths a width may hold


@with_units
def source_lattice(
    wavelength: Annotated[float, WAVELENGTH], width: Annotated[float, LENGTH], profile: Profile,
    shortest: Annotated[float, LENGTH], longest: Annotated[float, LENGTH],
) -> tuple[int, float]:  # fmt: skip
    """Return a square lattice of sines that serves all coherence lengths of a range.

    Raise a `RuleError` if a coherence length is NaN, below the wavelength (the beams would leave the paraxial range),
    or below width / 800 (a million beams).

    Parameters
    ----------
    wavelength
        Inside the medium, in the unit of all lengths.
    width
        Of the window on the entrance face, in the same unit: full side ("square"), diameter ("disc") or 1/e^2 intensity
        diameter ("gaussian").
    profile
        Its shape.
    shortest, longest
        Coherence lengths at the ends, in the same unit.

    Returns
    -------
    count, pitch
        Directions along each axis, and the direction sine between neighbours.

    Examples
    --------
    >>> from specklegen.coherence import source_lattice
    >>> count, pitch = source_lattice(0.5, 1000.0, "square", shortest=200.0, longest=1000.0)
    >>> count
    33
    """
    wavelength, width = positive_number("wavelength", wavelength), positive_number("width", width)
    choice("profile", profile, get_args(Profile))
    shortest, longest = (real_number("coherence_length", each) for each in (shortest, longest))
    least = max(wavelength, width / _FINEST)
    if not shortest >= least:
        remedy = "Shorter ones are incoherent light: the contrast is below 0.002, or the beams reach 90 degrees."
        reject("coherence_length", f"at least {least:.4g} (wavelength, and width / {_FINEST:g})", shortest, remedy)
    if not longest >= shortest:
        reject("coherence_length", f"at least {shortest:.4g}, the shortest of the range", longest)
    pitch = wavelength / (Window(profile, width).support(_LIT) + REACH * min(longest, COHERENT * width))
    spread = _angular_spread(wavelength, min(shortest, COHERENT * width))
    return 1 + 2 * math.ceil(REACH * spread / pitch), pitch


@with_units
def gaussian_brightness(
    count: int, pitch: Annotated[float, SINE], wavelength: Annotated[float, WAVELENGTH],
    coherence_length: Annotated[float, LENGTH],
) -> np.ndarray:  # fmt: skip
    """Return the angular spectrum of a Gaussian Schell-model source: float64[count, count], of sum 1.

    Parameters
    ----------
    count
        Directions along either axis.
    pitch
        Direction sine between neighbours.
    wavelength
        In the medium of the light, in the unit of all lengths.
    coherence_length
        sigma_g, in the same unit: the spectrum is the wider the shorter it is.

    Examples
    --------
    >>> from specklegen.coherence import gaussian_brightness
    >>> gaussian_brightness(9, pitch=1e-3, wavelength=0.5, coherence_length=40.0).shape
    (9, 9)
    """
    count = whole_number("gaussian_brightness count", count, 1)
    pitch = positive_number("gaussian_brightness pitch", pitch)
    wavelength = positive_number("gaussian_brightness wavelength", wavelength)
    coherence_length = positive_number("gaussian_brightness coherence_length", coherence_length)
    steps = (np.arange(count) - (count - 1) / 2) * pitch / _angular_spread(wavelength, coherence_length)
    square = steps[:, None] ** 2 + steps**2
    brightness = np.where(square <= REACH**2, np.exp(-square / 2), 0.0)
    return brightness / brightness.sum()


def _angular_spread(wavelength: float, coherence_length: float) -> float:
    return wavelength / (2 * np.pi * coherence_length)


@with_units
def gaussian_schell_object(
    wavelength: Annotated[float, WAVELENGTH], coherence_length: Annotated[float, LENGTH],
    width: Annotated[float, LENGTH], profile: Profile = "square",
) -> IncoherentObject:
    """Return partially coherent light along the axis, as illumination of a `Scene`.

    Parameters
    ----------
    wavelength
        Inside the medium, in the unit of all lengths.
    coherence_length
        sigma_g on the entrance face, in the same unit: at least a wavelength and width / 800; infinity
        (in fact 100 widths) is coherent light.
    width
        Of the window on the entrance face, in the same unit: full side ("square"), diameter ("disc") or 1/e^2 intensity
        diameter ("gaussian").
    profile
        Its shape; the peak irradiance is 1.

    Returns
    -------
    IncoherentObject
        Its degree of coherence is the Gaussian to 0.1 % between any two points of the window.

    Examples
    --------
    >>> from specklegen.coherence import gaussian_schell_object
    >>> light = gaussian_schell_object(0.5, 200.0, width=1000.0)
    >>> light.brightness.shape
    (13, 13)
    """
    coherence_length = real_number("coherence_length", coherence_length)
    count, pitch = source_lattice(wavelength, width, profile, coherence_length, coherence_length)
    brightness = gaussian_brightness(count, pitch, wavelength, min(coherence_length, COHERENT * width))
    return IncoherentObject(brightness=brightness, pitch=pitch, width=width, profile=profile)


@with_units
def effective_source_modes(
    brightness: np.ndarray, pitch: Annotated[float, SINE], wavelength: Annotated[float, WAVELENGTH],
    width: Annotated[float, LENGTH], profile: Profile = "square",
) -> float:  # fmt: skip
    """Return N_eff = (tr W0)^2 / tr W0^2 of a lattice of mutually incoherent beams through one window.

    The intensity contrast of the speckle that it makes is N_eff^(-1/2), behind any slab that scatters into
    directions far wider than the source.

    Parameters
    ----------
    brightness
        Of the beams of each direction, float64[h, w], at least 0 and not all 0.
    pitch
        Difference of direction sines between neighbours.
    wavelength
        Inside the medium, in the unit of all lengths.
    width
        Of the window through which all beams come, in the same unit: full side, diameter or 1/e^2 diameter.
    profile
        Shape of the window: "square" (the default), "disc" or "gaussian".

    Examples
    --------
    >>> from specklegen.coherence import effective_source_modes, gaussian_schell_object
    >>> source = gaussian_schell_object(0.5, 200.0, width=1000.0)
    >>> round(effective_source_modes(source.brightness, source.pitch, 0.5, source.width), 1)
    10.1
    """
    source = IncoherentObject(brightness=brightness, pitch=pitch, width=width, profile=profile)
    brightness, pitch, width = source.brightness, source.pitch, source.width
    wavelength = positive_number("effective_source_modes wavelength", wavelength)
    require_range({"effective_source_modes wavelength": wavelength, "effective_source_modes width": width})
    from scipy.signal import correlate  # half a second, which a plan does not need

    lags = np.maximum(correlate(brightness, brightness, method="fft"), 0)
    shared = shared_speckle(brightness.shape, pitch, wavelength, width, profile)
    return float(brightness.sum() ** 2 / (lags * shared).sum())


def shared_speckle(
    shape: tuple[int, ...], pitch: float, wavelength: float, width: float, profile: Profile
) -> np.ndarray:
    """Return W^(s)^2 at the differences (row, column) of two beams of a lattice, float64[2h - 1, 2w - 1]."""
    y, x = (np.arange(1 - n, n) * pitch / wavelength for n in shape)
    return np.square(Window(profile, width).coherence(*np.meshgrid(x, y)))


@recorded
@with_units
@shielded()
def render_partially_coherent(
    scene: Scene, coherence_length: Annotated[float, LENGTH], *, budget: Budget | None = None,
    realizations: int | None = None,
    sampler: AnySampler = "auto", field_tolerance: float = 1e-3, **fields: Unpack[BudgetFields],
) -> SpeckleStack:  # fmt: skip
    """Render a scene whose beams are partially coherent instead of coherent.

    Parameters
    ----------
    scene
        With `CollimatedBeams`; every beam becomes a Gaussian Schell-model beam of its direction, window and
        irradiance.
    coherence_length
        sigma_g on the entrance face, in the scene's unit of length: at least a wavelength and width / 800; infinity is
        coherent light.
    budget
        Paths of each realization or an error, time for all of them, seed, threads and reversed paths
        (:class:`specklegen.results.Budget`), as of :func:`specklegen.render`. A finite number of paths raises
        contrast^2 by `finite_path_excess`, however small the contrast is. By default 100 000 paths.
    realizations
        Number of media; None renders one and drops the axis.
    sampler
        "auto" takes the cheapest that is right within the tolerance; "paths", "stationary", "covariance", "screens"
        or one of your own, where you know better (:func:`specklegen.plan` says what each serves).
    field_tolerance
        Relative error of the NUFFT against the direct sum, between 0 and 1: smaller is slower.
    fields
        Fields of the budget by name, such as ``paths=10_000, seed=1``, in place of those of ``budget``.

    Returns
    -------
    SpeckleStack
        ``.intensity`` float32[(R,) T, *sensor], sum_j p_j |u_j|^2; all beams of all tilts see one medium.
        It has no ``.field``.

    Examples
    --------
    >>> import specklegen as sg
    >>> slab = sg.Slab(thickness=100.0, mean_free_path=20.0, scatterer=sg.media.HenyeyGreenstein(0.9))
    >>> light = sg.light.CollimatedBeams.tilts([0.0], width=5000.0)
    >>> scene = sg.Scene(wavelength=0.5, medium=slab, illumination=light,
    ...                  sensor=sg.sensors.FarField.grid((16, 16), 2e-5))
    >>> stack = sg.coherence.render_partially_coherent(scene, coherence_length=1000.0, seed=0)
    >>> stack.intensity.shape
    (1, 16, 16)
    """
    light = instance("render_partially_coherent scene", scene, Scene).illumination
    if not (light.limited and light.coherent):
        reject("render_partially_coherent scene.illumination", "CollimatedBeams", light.type)
    require_no_film("render_partially_coherent", scene)
    require_unpolarised("render_partially_coherent", scene)
    beams = scene.beams
    source = gaussian_schell_object(scene.wavelength, coherence_length, beams.width, beams.profile)
    on_axis = len(beams.directions) == 1 and not beams.directions[0, :2].any()
    lit = scene.replace(illumination=source if on_axis else _spread(beams, source))
    owner = "render_partially_coherent"
    budget = budget_of(owner, budget, fields, unused=("tolerance",))
    options = Options(sampler, field_tolerance=field_tolerance, realizations=realizations, owner=owner)
    stack = rendered(lit, budget, options)
    tilt_axis = 0 if realizations is None else 1
    if on_axis:
        return SpeckleStack(None, np.expand_dims(stack.intensity, tilt_axis), stack.report, scene)
    powers = source.brightness[source.brightness > 0].astype(np.float32)
    power = stack.intensity
    lead, sensor = power.shape[:tilt_axis], power.shape[tilt_axis + 1 :]
    power = power.reshape(*lead, len(beams.directions), len(powers), *sensor)
    return SpeckleStack(None, np.tensordot(power, powers, (tilt_axis + 1, 0)), stack.report, scene)


@with_units
def finite_path_excess(
    scene: Scene, paths: int, *, shift: Annotated[float, LENGTH] = 0.0, samples: int = 50_000,
    threads: int | None = None,
) -> float:  # fmt: skip
    """Return what a finite number of paths adds to contrast^2, or to the covariance over the squared mean.

    ``{(E[w^2] - E[w]^2) + (E|sum_B w_B e^{-ik d x_B}|^2 - E[sum_B w_B^2])} / (N E[w]^2)``, w = sum_B w_B the full
    weight of one path. The first part, ``Plan.expected_error`` squared, is the fluctuation of a bank's
    intensity. The second is speckle between connections of different length on one path, which beams at one
    view share, since all of them begin at the same point; it is as large where paths connect more than once.

    Parameters
    ----------
    scene
        What the path sampler renders, reversed paths left out.
    paths
        N, the paths of one bank.
    shift
        Direction sine d between the two views, along x from the axis of transmission; 0 by default, the excess of one
        view.
    samples
        Paths from which the weights are known, drawn by a seed that the scene decides: more know them better.
    threads
        Threads, by default all cores that the process may run on; the result does not depend on them.

    Examples
    --------
    >>> import specklegen as sg
    >>> from specklegen.coherence import finite_path_excess
    >>> slab = sg.Slab(thickness=10.0, mean_free_path=5.0, scatterer=sg.media.Isotropic())
    >>> light = sg.light.CollimatedBeams.tilts([0.0], width=100.0)
    >>> scene = sg.Scene(wavelength=0.5, medium=slab, illumination=light, sensor=sg.sensors.FarField.grid((4, 4), 1e-3))
    >>> 0 < finite_path_excess(scene, paths=1000, samples=2000) < 0.1
    True
    """
    require_no_focus("finite_path_excess", instance("finite_path_excess scene", scene, Scene))
    paths = whole_number("finite_path_excess paths", paths, 1)
    samples = whole_number("finite_path_excess samples", samples, 1)
    shift = real_number("finite_path_excess shift", shift)
    if not math.isfinite(shift):
        reject("finite_path_excess shift", "finite", shift)
    require_memory("finite_path_excess samples", "held", 500 * samples, f"{samples} paths", "Use fewer.", share=0.9)
    tracer = slab_tracer(scene, False)
    seed = pilot_seed(scene.unitless_fingerprint())
    bank = tracer.trace(seed, samples, stream=Stream.PILOT, threads=threads)
    each = contributions(tracer.layout.at(tracer.proposal.reference, AXIS), bank)
    path = np.bincount(bank.paths, each, samples)
    phase = scene.wavenumber * shift * bank.exit[:, 0]
    real, imaginary = (np.bincount(bank.paths, each * part, samples) for part in (np.cos(phase), np.sin(phase)))
    between = (real**2 + imaginary**2).sum() - (each**2).sum()
    return float((path.var() + between / samples) / path.mean() ** 2 / paths)


def _spread(beams: CollimatedBeams, source: IncoherentObject) -> CollimatedBeams:
    """Beams of the source about every tilt, tilt by tilt."""
    lit = source.brightness.ravel() > 0
    offsets = object_sines("source", source.brightness.shape, source.pitch)[lit]
    sines = beams.directions[:, None, :2] + offsets
    return beams.replace(directions=directions_of_sines("CollimatedBeams.directions", sines.reshape(-1, 2)))
