"""Masks as arrays: what each square pixel of a screen lets through, grey, of a phase, or as it was measured."""

from typing import Annotated, Literal, Self

import numpy as np
from pydantic import model_validator

from specklegen.core.errors import reject
from specklegen.core.quadrature import gauss_legendre
from specklegen.core.units import LENGTH
from specklegen.core.values import Array, ComplexArray, Positive, Value

MOST = 1 << 23
"""Nodes of the integral over a mask at most."""


class Mask(Value):
    """A mask in the plane z = 0: the light behind a pixel is its value times the light before it, dark around.

    Parameters
    ----------
    values
        complex128[h, w], the transmission of each pixel in amplitude: 0 dark, 1 open, e^{i phase}, or the root of a
        measured transmittance; rows y and columns x from the smallest.
    pitch
        Side of a pixel.
    center
        float64[2], the middle of the mask.

    Raises
    ------
    RuleError
        If values are not a grid, or nothing is let through.

    Examples
    --------
    >>> import numpy as np
    >>> from specklegen.wavetracing import Mask, Plane, PlaneWave, field_on_plane
    >>> lens = Mask(values=np.exp(1j * np.linspace(0, 3, 64).reshape(8, 8)), pitch=1.0)
    >>> window = Plane(center=[0, 0, 30], shape=(8, 8), pitch=1.0)
    >>> field_on_plane(lens, PlaneWave(wavelength=1.0), window, "spectrum").values.shape
    (8, 8)
    """

    type: Literal["Mask"] = "Mask"
    values: ComplexArray
    pitch: Annotated[Positive, LENGTH]
    center: Annotated[Array, LENGTH] = np.zeros(2)

    @model_validator(mode="after")
    def _check(self) -> Self:
        if self.values.ndim != 2 or not self.values.size:
            reject("Mask.values", "of shape (h, w)", self.values.shape)
        if not np.any(self.values):
            reject("Mask.values", "not 0 everywhere", 0.0, "A closed mask is dark.")
        if self.center.shape != (2,):
            reject("Mask.center", "a point float64[2]", self.center.shape)
        return self

    @property
    def starts(self) -> np.ndarray:
        """Its corners, float64[4, 2]."""
        rows, columns = self.values.shape
        signs = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
        return self.center + 0.5 * self.pitch * signs * [columns, rows]

    def quadrature(self, wavelength: float) -> tuple[np.ndarray, np.ndarray]:
        """Return nodes float64[P, 2] and weights complex128[P], pixels' values among them, for |xi| <= k.

        Gauss-Legendre in every pixel that is not dark, with more nodes than the phase has half turns.
        """
        count = 4 + int(np.ceil(7 * self.pitch / wavelength))
        row, column = np.nonzero(self.values)
        if len(row) * count**2 > MOST:
            reject("Mask.values", f"resolved by {MOST} nodes", len(row) * count**2, "Take fewer or smaller pixels.")
        x, w = gauss_legendre(count)
        along, across = np.meshgrid(x, x, indexing="ij")
        shape = np.array(self.values.shape[::-1])
        middle = self.center + self.pitch * (np.stack([column, row], axis=1) - (shape - 1) / 2)
        inside = 0.5 * self.pitch * np.stack([across.ravel(), along.ravel()], axis=1)
        weights = self.values[row, column][:, None] * np.outer(w, w).ravel() * (0.5 * self.pitch) ** 2
        return (middle[:, None] + inside).reshape(-1, 2), weights.ravel()
