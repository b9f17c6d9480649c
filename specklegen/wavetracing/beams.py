"""Gaussian beams: their field, their moments, and the ensemble of rays that each one is.

With time e^{-i omega t} and k = 2 pi / wavelength, a beam of transverse matrix Sigma and correlation rho has, n = 2,

    psi = (det Sigma^-1 / pi^n)^(1/4) det(1 + i rho Sigma^-1)^(-1/2) exp(ikz - x^T (Sigma + i rho)^-1 x / 2),

    Var x = (Sigma + rho^2 Sigma^-1) / 2,   Var q = Sigma^-1 / 2,   Cov(x, q) = rho Sigma^-1 / 2,

and free space adds z / k to rho. Its Wigner function is a Gaussian, so positive: the beam is also an ensemble of
straight rays, ``x = x0 + rho q`` with ``x0 ~ N(0, Sigma / 2)`` and ``q ~ N(0, Sigma^-1 / 2)``.

Source: S. Steinberg, M. Pharr, *Wave Tracing*, Eqs. 12-20. Deviations: the power of the normalisation in Eq. 12 is
``1/4``; it is the width that grows linearly with distance, not the variance; the cone is an upper bound of three
standard deviations, larger by a factor between 1 and sqrt 2, most where z tan(alpha) equals the half-width.

The beam is paraxial: after 300 wavelengths the true variance deviates by 0.6 % (tan(alpha) is 0.135 there; 22 % where
it is 0.68). Above PARAXIAL a `DoubtWarning` says so.
"""

from typing import Annotated, Self

import numpy as np
from pydantic import model_validator

from specklegen.core.errors import reject, warn_user
from specklegen.core.units import AREA, LENGTH, WAVELENGTH
from specklegen.core.values import Array, NonNegative, Positive, Value, unit_vectors
from specklegen.wavetracing.cones import Cone, transverse_frame

PARAXIAL = 0.3
"""Tangent of the half opening angle above which a beam is no longer paraxial."""


class GaussianBeam(Value):
    """A coherent Gaussian beam.

    Attributes
    ----------
    origin : float64[3]
        Centre of the cross-section (a length).
    direction : float64[3]
        Unit vector of travel.
    sigma : float64[2, 2]
        Transverse matrix Sigma (an area), in the first two rows of ``frame``; symmetric, positive definite.
    wavelength : float
        In the unit of lengths.
    rho : float
        Correlation of position and wavevector at the origin (an area), at least 0; distance from the waist over k.

    Raises
    ------
    RuleError
        For a matrix that is not symmetric and positive definite, or a direction that is no unit vector.

    Examples
    --------
    >>> import numpy as np
    >>> from specklegen.wavetracing import GaussianBeam
    >>> beam = GaussianBeam(origin=[0, 0, 0], direction=[0, 0, 1], sigma=100.0 * np.eye(2), wavelength=1.0)
    >>> beam.propagated(500.0).sigma.round(2)
    array([[100.,   0.],
           [  0., 100.]])
    """

    origin: Annotated[Array, LENGTH]
    direction: Array
    sigma: Annotated[Array, AREA]
    wavelength: Annotated[Positive, WAVELENGTH]
    rho: NonNegative = 0.0

    def __init__(self, origin, direction, sigma, wavelength, rho=0.0):
        super().__init__(origin=origin, direction=direction, sigma=sigma, wavelength=wavelength, rho=rho)

    @model_validator(mode="after")
    def _checked(self) -> Self:
        if self.origin.shape != (3,):
            reject("GaussianBeam.origin", "a point float64[3]", self.origin.shape)
        if self.direction.shape != (3,):
            reject("GaussianBeam.direction", "a unit vector float64[3]", self.direction.shape)
        unit_vectors("GaussianBeam.direction", self.direction)
        if self.sigma.shape != (2, 2) or not np.allclose(self.sigma, self.sigma.T, rtol=1e-12, atol=0):
            reject("GaussianBeam.sigma", "a symmetric matrix float64[2, 2]", self.sigma)
        if np.linalg.eigvalsh(self.sigma)[0] <= 0:
            reject("GaussianBeam.sigma", "positive definite", self.sigma)
        if self.tangents.max() > PARAXIAL:
            warn_user(
                f"a beam of half opening angle atan({self.tangents.max():.3g}) is not paraxial: the variance is off "
                "by 4 % at .34 and 22 % at .68; use a larger sigma",
            )
        return self

    @property
    def k(self) -> float:
        """Wavenumber 2 pi / wavelength."""
        return 2 * np.pi / self.wavelength

    @property
    def frame(self) -> np.ndarray:
        """float64[3, 3], rows (x, y, d) in which ``sigma`` is given: `transverse_frame` of the direction."""
        return transverse_frame(self.direction)

    @property
    def tangents(self) -> np.ndarray:
        """float64[2], ``3 / (k sqrt(2 lambda))`` for the eigenvalues lambda of sigma, larger eigenvalue first."""
        return 3 / (self.k * np.sqrt(2 * np.linalg.eigvalsh(self.sigma)[::-1]))

    @property
    def var_position(self) -> np.ndarray:
        """float64[2, 2], variance of position about the axis (an area)."""
        return (self.sigma + self.rho**2 * np.linalg.inv(self.sigma)) / 2

    @property
    def var_wavevector(self) -> np.ndarray:
        """float64[2, 2], variance of the transverse wavevector about its mean (an inverse area)."""
        return np.linalg.inv(self.sigma) / 2

    @property
    def covariance(self) -> np.ndarray:
        """float64[4, 4] of (x, y, q_x, q_y); its determinant is 4^-2 at any distance."""
        cross = self.rho * np.linalg.inv(self.sigma) / 2
        return np.block([[self.var_position, cross], [cross, self.var_wavevector]])

    def propagated(self, z: float) -> "GaussianBeam":
        """Return the beam a distance ``z`` further: the origin moves, rho grows by z / k, the phase kz is dropped."""
        return self.replace(origin=self.origin + z * self.direction, rho=self.rho + z / self.k)

    @property
    def cone(self) -> Cone:
        """The envelope at three standard deviations; a tan_a = b tan_b = 9 / (2k) at the waist."""
        values, vectors = np.linalg.eigh(self.sigma)
        b, a = 3 * np.sqrt(values / 2)
        tan_a, tan_b = self.tangents
        x = vectors[:, 1] @ self.frame[:2]
        rows = np.array([x, np.cross(self.direction, x), self.direction])
        travelled = self.rho * self.k
        least = 81 / (4 * self.k**2)
        return Cone(self.origin, rows, a + travelled * tan_a, b + travelled * tan_b, tan_a, tan_b, least)

    def field(self, points: np.ndarray) -> np.ndarray:
        """Return the field at points float64[..., 3] as complex128[...], of unit power through any plane across.

        The phase is 0 on the axis at the origin of a beam with rho = 0.
        """
        x, y, z = np.moveaxis((np.asarray(points, float) - self.origin) @ self.frame.T, -1, 0)
        values, vectors = np.linalg.eigh(self.sigma)
        rho = self.rho + z / self.k
        along = np.stack([x, y], axis=-1) @ vectors
        psi = np.exp(1j * self.k * z) / np.sqrt(np.pi * np.sqrt(values.prod()))
        for n in range(2):
            # One root for each axis: the root of the product would jump where its argument passes pi.
            psi = psi * np.exp(-0.5 * along[..., n] ** 2 / (values[n] + 1j * rho)) / np.sqrt(1 + 1j * rho / values[n])
        return psi
