"""The cylindrical focus: its Green's function by physical optics and by Monte Carlo ray tracing.

A line source on [-a, a] in the plane of a cylindrical lens of focal length f sends a wave converging
on (x, z) = (0, 0); Z = f + z is the distance from the lens. G[i, j] carries the field of source element
j to detector pixel i, and U = G U0 where U0 are the fields of the elements.

    physical optics   G  = (i pi / lambda) e^{-ik s0} (Z / s) H1(ks)                    [Prahl09] Eq. 3
    Monte Carlo       G' = mean over rays of (range of angles) e^{ik(s - s0)}
    with              s^2 = Z^2 + (x - x')^2,  s0^2 = f^2 + x'^2,  H1 the Hankel function of the first kind

(exp(-i omega t); Eq. 3 is the exact two-dimensional Rayleigh-Sommerfeld integrand of the first kind.)
Three remarks on the paper, all tested:

* A bundle of rays falls off like 1/s and not like Eq. 3; it converges to Eq. 3 times sqrt(cos theta),
  cos theta = Z / s, which is what a detector of flux measures (`flux_weighted_csd`) to 0.2 % at f/1.
* ``e^{-i pi/4} sqrt(Z / lambda) / (pixel width)`` turns G' into the amplitude and phase of Eq. 3. The
  paper leaves it out, which off the focal plane is wrong by Z / f in intensity.
* The axial coordinate z grows away from the lens (the paper's Eq. 18 has it towards the lens).

All lengths are in the unit of the wavelength. See docs/coherence.md.
"""

import math
import warnings
from dataclasses import dataclass
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import model_validator
from scipy.special import hankel1e

from specklegen.core.arguments import choice, finite_numbers, flag, real_number, whole_number
from specklegen.core.display.plot import Pictured, draw_map
from specklegen.core.errors import reject
from specklegen.core.parallel import map_blocks
from specklegen.core.quantities import with_units
from specklegen.core.units import INVERSE_LENGTH, LENGTH, WAVELENGTH
from specklegen.core.values import Array, Positive, PositiveInt, Value
from specklegen.kernels import rays

_FINEST = 1e-11
"""Of a way, that a wavelength may be: its phase then has four digits."""


class TransverseDetector(Value):
    """``n_pixels`` adjoining pixels on [-half_width, half_width] of the focal plane.

    Parameters
    ----------
    half_width
        Half the width of the row of pixels, in the unit of all lengths.
    n_pixels
        How many pixels share it.

    Examples
    --------
    >>> from specklegen.coherence import TransverseDetector
    >>> TransverseDetector(half_width=2.5, n_pixels=5).x
    array([-2., -1.,  0.,  1.,  2.])
    """

    half_width: Annotated[Positive, LENGTH]
    n_pixels: PositiveInt

    @property
    def pixel_width(self) -> float:
        """Width of a pixel."""
        return 2 * self.half_width / self.n_pixels

    @property
    def edges(self) -> np.ndarray:
        """Edges of the pixels, float64[n_pixels + 1]; they are half-open, and the last one is closed."""
        return np.linspace(-self.half_width, self.half_width, self.n_pixels + 1)

    @property
    def x(self) -> np.ndarray:
        """Centres of the pixels, float64[n_pixels]."""
        return (np.arange(self.n_pixels) - (self.n_pixels - 1) / 2) * self.pixel_width

    @property
    def z(self) -> np.ndarray:
        """Distances of the pixels behind the focal plane: zeros."""
        return np.zeros(self.n_pixels)


class AxialDetector(Value):
    """Pixels of one width centred on the axis, ``z`` behind the focal plane (away from the lens).

    Parameters
    ----------
    z
        Places of the pixels' middles behind the focal plane, away from the lens, float64[P], in the unit of all
        lengths.
    pixel_width
        Width of each, across the axis, in the same unit.

    Examples
    --------
    >>> from specklegen.coherence import AxialDetector
    >>> AxialDetector(z=[0.0, 5.0, 10.0], pixel_width=0.1).z
    array([ 0.,  5., 10.])
    """

    z: Annotated[Array, LENGTH]
    pixel_width: Annotated[Positive, LENGTH]

    @model_validator(mode="after")
    def _line(self):
        if self.z.ndim != 1 or not self.z.size:
            reject("AxialDetector.z", "a list of at least one distance", self.z)
        return self

    @property
    def x(self) -> np.ndarray:
        """Centres of the pixels: zeros."""
        return np.zeros(self.z.size)


@dataclass(frozen=True, eq=False, repr=False)
class GreensMatrix(Pictured):
    """A Green's function with its error: fields at the pixels = ``value`` @ fields of the sources.

    Attributes
    ----------
    value : complex128[pixels, modes]
    standard_error : float64[pixels, modes]
        sqrt(E |value - its mean|^2), estimated from the samples themselves; inf where that cannot be
        done (fewer than two samples, or none of them arrived).

    Examples
    --------
    >>> from specklegen.coherence import CylindricalFocus, TransverseDetector
    >>> camera = TransverseDetector(half_width=2.5, n_pixels=11)
    >>> focus = CylindricalFocus(half_aperture=100, focal_length=200, wavelength=1, n_source=51, detector=camera)
    >>> found = focus.monte_carlo(n_rays=2000, seed=0)
    >>> found.value.shape == found.standard_error.shape
    True
    """

    value: np.ndarray
    standard_error: np.ndarray

    _named = {"|G| of pixels and modes": "value", "standard error": "standard_error"}

    def _draw(self, axes: Any, label: str | None = None) -> None:
        """Its magnitude."""
        draw_map(axes, np.abs(self.value), "|G|", low=0)
        axes.set(xlabel="mode of the source", ylabel="pixel", aspect="auto")


class CylindricalFocus(Value):
    """A line source of width 2 ``half_aperture`` focused by a cylindrical lens onto a detector.

    The source is ``n_source`` elements of equal width. With ``n_source=1`` physical optics makes it a
    point, while the rays of `monte_carlo` still leave from the whole element and come to a focus.

    Parameters
    ----------
    half_aperture
        Half the width of the source and of the lens, in the unit of all lengths.
    focal_length
        Distance from the lens to the focal plane, in the same unit.
    wavelength
        In the medium of the light, in the same unit.
    n_source
        Elements of the source: more where the field must be right further from the axis.
    detector
        Pixels across the focal plane (:class:`TransverseDetector`) or along the axis (:class:`AxialDetector`).

    Examples
    --------
    >>> import numpy as np
    >>> from specklegen.coherence import CylindricalFocus, TransverseDetector
    >>> camera = TransverseDetector(half_width=2.5, n_pixels=11)
    >>> focus = CylindricalFocus(half_aperture=100, focal_length=200, wavelength=1, n_source=51, detector=camera)
    >>> np.abs(focus.physical_optics()).shape  # pixels, elements of the source
    (11, 51)
    """

    half_aperture: Annotated[Positive, LENGTH]
    focal_length: Annotated[Positive, LENGTH]
    wavelength: Annotated[Positive, WAVELENGTH]
    n_source: PositiveInt
    detector: TransverseDetector | AxialDetector

    @model_validator(mode="after")
    def _detector_behind_the_lens(self):
        nearest = float(self.detector.z.min())
        if nearest <= -self.focal_length:
            rule = f"greater than -focal_length = {-self.focal_length:g}"
            reject("CylindricalFocus.detector.z", rule, nearest, "Place every pixel behind the lens.")
        farthest = self.half_aperture + self.focal_length + float(np.abs(self.detector.z).max())
        if self.wavelength < _FINEST * farthest:
            rule = f"at least {_FINEST:g} of the longest distance, {_FINEST * farthest:.3g}"
            reject("CylindricalFocus.wavelength", rule, self.wavelength,
                   "Phases of longer distances lose their precision.")
        return self

    @property
    def source_width(self) -> float:
        """Width of a source element."""
        return 2 * self.half_aperture / self.n_source

    @property
    def source_x(self) -> np.ndarray:
        """Centres of the source elements, float64[n_source]."""
        return (np.arange(self.n_source) - (self.n_source - 1) / 2) * self.source_width

    @property
    def wavenumber(self) -> float:
        """Wavenumber k = 2 pi / wavelength, radians per unit length."""
        return 2 * np.pi / self.wavelength

    def on_axis(self) -> "CylindricalFocus":
        """Return the same focus with one pixel at x = z = 0: the reference of a normalised profile.

        (A detector with an even number of pixels has none there.)
        """
        width = self.detector.pixel_width
        return self.replace(detector=TransverseDetector(half_width=width / 2, n_pixels=1))

    def physical_optics(self, derivative: bool = False, measurement: bool = False) -> np.ndarray:
        """Return the Green's function between element and pixel centres.

        Parameters
        ----------
        derivative : bool
            Return dG/dZ instead, the rate of change as the detector moves away from the lens.
        measurement : bool
            Return G sqrt(cos theta) instead, what Monte Carlo converges to, whose intensity is the flux
            through the detector (`flux_weighted_csd` is the exact form).

        Returns
        -------
        complex128[pixels, n_source]

        Source: [Prahl09] Eq. 3, with the phase of `specklegen.kernels.rays`.
        """
        derivative = flag("CylindricalFocus.physical_optics derivative", derivative)
        measurement = flag("CylindricalFocus.physical_optics measurement", measurement)
        if derivative and measurement:
            remedy = "Set one of the two to False; flux_weighted_csd needs measurement=False in both."
            reject("CylindricalFocus.physical_optics measurement", "False with derivative=True", True, remedy)
        k, f, xs = self.wavenumber, self.focal_length, self.source_x
        x, z = self.detector.x[:, None], self.detector.z[:, None]
        distance = f + z
        s = np.hypot(distance, x - xs)
        path_difference = (z * (2 * f + z) + x * (x - 2 * xs)) / (s + np.hypot(f, xs))
        h1, phasor = hankel1e(1, k * s), np.exp(1j * k * path_difference)
        if derivative:
            h0, cosine = hankel1e(0, k * s), distance / s
            slope = h1 / s * (1 - cosine**2) + cosine**2 * (k * h0 - h1 / s)
            return 1j * np.pi / self.wavelength * phasor * slope
        field = 1j * np.pi / self.wavelength * (distance / s) * h1 * phasor
        return field * np.sqrt(distance / s) if measurement else field

    def monte_carlo(
        self, n_rays: int, sampling: Literal["stratified", "uniform"] = "stratified", *, seed: int,
        calibrated: bool = True, threads: int | None = None,
    ) -> GreensMatrix:  # fmt: skip
        """Estimate the Green's function by tracing rays.

        Parameters
        ----------
        n_rays : int
            Rays in all. They are dealt out one by one over the source elements (uniform) or over the
            pairs of element and pixel (stratified), so that the counts differ by one at most.
        sampling : {"stratified", "uniform"}
            "uniform" spreads the rays of an element over the whole detector and bins them, as in
            [Prahl09] for the focal plane: relative error sqrt((pixels - 1) n_source / n_rays), all of it
            in the number of hits. "stratified" aims at every pixel, as in [Prahl09] for the axis, and
            needs some 440 times fewer rays at 201 pixels and 51 elements.
        seed : int
            The result is a pure function of it, whatever ``threads``.
        calibrated : bool
            Give the amplitude and phase of ``physical_optics(measurement=True)``; else the bare mean of
            (range of angles) e^{ik(s - s0)} that [Prahl09] prints.
        threads : int, optional
            Threads, by default all cores that the process may run on; the result does not depend on them.

        Raises
        ------
        RuleError
            If ``n_rays`` is less than 1, ``sampling`` is unknown, or "uniform" meets an axial detector.

        Warns
        -----
        UserWarning
            If there are fewer rays than pairs of element and pixel: empty entries are 0, their error inf.
        """
        pixels, elements = self.detector.x.size, self.n_source
        self._check_rays(n_rays, sampling)
        seed = whole_number("CylindricalFocus.monte_carlo seed", seed)
        flag("CylindricalFocus.monte_carlo calibrated", calibrated)
        key0, key1 = np.random.SeedSequence([seed]).generate_state(2).astype(np.uint64)
        half, width = self.detector.pixel_width / 2, self.source_width
        lower, upper = self.detector.x - half, self.detector.x + half
        f, k, z = self.focal_length, self.wavenumber, self.detector.z

        def column(j: int) -> tuple[np.ndarray, np.ndarray]:
            element = rays.Element(j, self.source_x[j] - width / 2, width)
            total, square = np.zeros(pixels, complex), np.zeros(pixels)
            if sampling == "uniform":
                count = _dealt(n_rays, elements)[j]
                rays.uniform_rays(key0, key1, element, count, lower, upper, f, k, total, square)
            else:
                count = _dealt(n_rays, elements * pixels).reshape(pixels, elements)[:, j]
                rays.stratified_rays(key0, key1, element, count, lower, upper, z, f, k, total, square)
            return _mean_and_error(total, square, count)

        columns = map_blocks(column, range(elements), threads)
        value, error = (np.stack(part, axis=1) for part in zip(*columns, strict=True))
        if not calibrated:
            return GreensMatrix(value, error)
        distance = f + z[:, None]
        scale = np.sqrt(distance / self.wavelength) / self.detector.pixel_width
        return GreensMatrix(np.exp(-0.25j * np.pi) * scale * value, scale * error)

    def _check_rays(self, n_rays: int, sampling: str) -> None:
        choice("CylindricalFocus.monte_carlo sampling", sampling, ("stratified", "uniform"))
        if sampling == "uniform" and isinstance(self.detector, AxialDetector):
            rule = "'stratified' for an AxialDetector, whose pixels lie in different planes"
            reject("CylindricalFocus.monte_carlo sampling", rule, sampling)
        whole_number("CylindricalFocus.monte_carlo n_rays", n_rays, 1, 2**62)
        pairs = self.detector.x.size * self.n_source
        if n_rays < pairs:
            warnings.warn(
                f"{n_rays} rays for {pairs} pairs of source element and pixel: entries without a ray are 0 "
                "and their standard_error is inf; use more rays",
                stacklevel=3,
            )


def _dealt(n_rays: int, strata: int) -> np.ndarray:
    """Deal ``n_rays`` out over strata, one by one: int64[strata]."""
    return n_rays // strata + (np.arange(strata) < n_rays % strata)


def _mean_and_error(total: np.ndarray, square: np.ndarray, count) -> tuple[np.ndarray, np.ndarray]:
    """Mean of ``count`` samples from their sum and the sum of their squared moduli, and its error."""
    with np.errstate(divide="ignore", invalid="ignore"):
        mean = np.where(count > 0, total / count, 0)
        variance = np.maximum(square / count - np.abs(mean) ** 2, 0) / (count - 1)
    return mean, np.where((count > 1) & (square > 0), np.sqrt(variance), np.inf)


@with_units
def flux_weighted_csd(G: np.ndarray, dG: np.ndarray, W0: np.ndarray, k: Annotated[float, INVERSE_LENGTH]) -> np.ndarray:
    """Return the cross-spectral density as a detector of flux sees it (the measurement function).

    W_M = [D W0 G^H - G W0 D^H] / (2ik), D = dG/dZ: on its diagonal the flux through the pixel. Off
    the diagonal it is the paper's obliquity weight, about (cos theta_1 + cos theta_2) / 2; W_M is
    Hermitian but, unlike W, not exactly positive.

    Parameters
    ----------
    G, dG : complex128[pixels, n_source]
        ``physical_optics()`` and ``physical_optics(derivative=True)``.
    W0 : complex128[n_source, n_source]
        Cross-spectral density of the source.
    k : float
        2 pi / wavelength, radians per unit length.

    Returns
    -------
    complex128[pixels, pixels]

    Source: [Prahl09], measurement function, with the derivative taken analytically.

    Examples
    --------
    >>> import numpy as np
    >>> from specklegen.coherence import CylindricalFocus, TransverseDetector, flux_weighted_csd, gaussian_schell_model
    >>> camera = TransverseDetector(half_width=2.5, n_pixels=11)
    >>> focus = CylindricalFocus(half_aperture=100, focal_length=200, wavelength=1, n_source=51, detector=camera)
    >>> W0 = gaussian_schell_model(focus.source_x, coherence_length=60)
    >>> flux_weighted_csd(focus.physical_optics(), focus.physical_optics(derivative=True), W0, k=2 * np.pi).shape
    (11, 11)
    """
    k = real_number("flux_weighted_csd k", k)
    if not 0 < k < math.inf:
        reject("flux_weighted_csd k", "greater than 0 and finite", k)
    parts = {"G": G, "dG": dG, "W0": W0}
    G, dG, W0 = (finite_numbers(f"flux_weighted_csd {name}", each, 2) for name, each in parts.items())
    if not (G.shape == dG.shape and W0.shape == (G.shape[1],) * 2):
        reject("flux_weighted_csd", "given G and dG of one shape (pixels, points) and W0 of (points, points)",
               (G.shape, dG.shape, W0.shape))  # fmt: skip
    half = dG @ W0 @ G.conj().T
    return (half - half.conj().T) / (2j * k)
