"""A camera whose pixels stand behind four linear polarisers, two by two: what they see, and Stokes parameters of it.

    I(alpha) = ((1 + 1/e) S0 + (1 - 1/e) (S1 cos 2 alpha + S2 sin 2 alpha)) / 2

behind a polariser at an angle alpha from x that passes 1 of light along it and 1/e of light across it. A pixel has one
of the four angles; what it would see behind the others is interpolated between its neighbours. Source: Goldstein,
*Polarized Light* (2011), section 5.3; Tyo, LaCharite and Ratliff, Optics Letters 34, 3187 (2009), on what interpolation
leaves out: detail finer than two pixels.
"""

from __future__ import annotations

from typing import Annotated, Self

import numpy as np
from numpy.typing import ArrayLike
from pydantic import Field, model_validator
from scipy.ndimage import correlate1d

from specklegen.core.arguments import instance, real_array, whole_number
from specklegen.core.errors import reject
from specklegen.core.values import Value
from specklegen.scene.scene import Scene

ANGLES = (0, 45, 90, 135)
"""Of the four polarisers from x, degrees, in the order of images that a mosaic takes."""
_AXES = np.array([[1.0, 1, 0], [1, 0, 1], [1, -1, 0], [1, 0, -1]])  # cos and sin of twice the angles, beside 1


class PolarisationMosaic(Value):
    """Linear polarisers in front of the pixels of a camera, four angles 45 degrees apart in cells of two by two.

    Parameters
    ----------
    pattern
        Angles from x of the cell's pixels, degrees, row by row: a permutation of 0, 45, 90, 135. By default that of
        common sensors.
    extinction
        Of each polariser, light along it over light across it that it passes, above 1; None of ideal ones.

    Examples
    --------
    >>> import numpy as np
    >>> from specklegen.instrument import Camera, NoiseStreams, PolarisationMosaic, expose
    >>> mosaic = PolarisationMosaic()
    >>> along_x = np.broadcast_to([[[1.0]], [[0.5]], [[0.0]], [[0.5]]], (4, 64, 64))
    >>> mosaic.pixels(along_x)[:2, :2]
    array([[0. , 0.5],
           [0.5, 1. ]])
    >>> counts = expose(Camera(photons=1000.0), mosaic.pixels(along_x), NoiseStreams.of(7))
    >>> (mosaic.stokes(counts).mean(axis=(1, 2)) / 1000).round(1) + 0.0
    array([1., 1., 0.])
    """

    pattern: tuple[int, int, int, int] = (90, 45, 135, 0)
    extinction: Annotated[float, Field(gt=1)] | None = None

    @model_validator(mode="after")
    def _check(self) -> Self:
        if sorted(self.pattern) != [*ANGLES]:
            reject("PolarisationMosaic.pattern", f"a permutation of {ANGLES}", self.pattern)
        return self

    @property
    def _leak(self) -> float:
        return 0.0 if self.extinction is None else 1 / self.extinction

    def scenes(self, scene: Scene) -> tuple[Scene, Scene, Scene, Scene]:
        """Four scenes, one behind each angle; their images under one seed, stacked, are what :meth:`pixels` takes.

        Raises
        ------
        RuleError
            If light is a scalar in the scene.
        """
        polarisers = instance("PolarisationMosaic.scenes scene", scene, Scene).polarisers
        if polarisers is None:
            reject("PolarisationMosaic.scenes scene", "one of polarised light", scene.medium,
                   'Give the Slab polarisation = "projector" or "vector", and the Scene its polarisers.')  # fmt: skip
        turned = np.radians(ANGLES)
        fields = np.stack([np.cos(turned), np.sin(turned)], axis=-1)
        return tuple(scene.replace(polarisers=polarisers.replace(analyser=each)) for each in fields)  # type: ignore[return-value]

    def pixels(self, images: ArrayLike, oversampling: int = 1) -> np.ndarray:
        """Light float64[..., H m, W m] that reaches the pixels, for a camera of that oversampling m.

        Parameters
        ----------
        images
            Intensities float[..., 4, H m, W m] behind ideal polarisers at 0, 45, 90 and 135 degrees, at least 0.
        oversampling
            Image points along each side of a pixel.
        """
        seen = real_array("PolarisationMosaic.pixels images", images)
        points = whole_number("PolarisationMosaic.pixels oversampling", oversampling, 1)
        if seen.ndim < 3 or seen.shape[-3] != 4:
            reject("PolarisationMosaic.pixels images", "of shape (..., 4, rows, columns)", seen.shape)
        self._require_cells("PolarisationMosaic.pixels images", seen, 2 * points)
        if not np.isfinite(seen).all() or (seen < 0).any():
            reject("PolarisationMosaic.pixels images", "finite and at least 0 everywhere", images)
        mixed = self.mixture(seen.shape[-2] // points, seen.shape[-1] // points).repeat(points, 1).repeat(points, 2)
        return (seen * mixed).sum(axis=-3)

    def stokes(self, pixels: ArrayLike) -> np.ndarray:
        """S0, S1 and S2 float64[..., 3, H, W] of light or counts (less their offset) float[..., H, W] of the pixels.

        Each is interpolated linearly between the pixels of one angle, and the four of them are fitted together.
        """
        seen = real_array("PolarisationMosaic.stokes pixels", pixels)
        if seen.ndim < 2:
            reject("PolarisationMosaic.stokes pixels", "of shape (..., rows, columns)", seen.shape)
        self._require_cells("PolarisationMosaic.stokes pixels", seen, 2)
        masks = self._masks(*seen.shape[-2:])
        spread = _between(seen[..., None, :, :] * masks) / _between(masks)
        analysers = _AXES * np.array([1 + self._leak, 1 - self._leak, 1 - self._leak]) / 2
        return np.einsum("sa,...ahw->...shw", np.linalg.pinv(analysers), spread)

    def mixture(self, rows: int, columns: int) -> np.ndarray:
        """Share float64[4, H, W] that pixels see of images behind ideal polarisers, from 0 in steps of 45 degrees."""
        masks = self._masks(rows, columns)
        return masks + self._leak * np.roll(masks, 2, axis=0)  # the polariser across is two further

    def _masks(self, rows: int, columns: int) -> np.ndarray:
        """Which pixels have each of the four angles, float64[4, H, W]."""
        cell = np.array([[np.array(self.pattern) == angle] for angle in ANGLES], dtype=np.float64).reshape(4, 2, 2)
        return np.tile(cell, (1, rows // 2, columns // 2))

    @staticmethod
    def _require_cells(field: str, images: np.ndarray, side: int) -> None:
        rows, columns = images.shape[-2:]
        if rows % side or columns % side or not rows * columns:
            reject(field, f"of sides that are multiples of {side}, cells of two by two pixels", (rows, columns))


def _between(values: np.ndarray) -> np.ndarray:
    """Linear interpolation along both axes of images that are 0 at every other row and column, up to a factor."""
    for axis in (-2, -1):
        values = correlate1d(values, [0.5, 1.0, 0.5], axis=axis, mode="constant")
    return values
