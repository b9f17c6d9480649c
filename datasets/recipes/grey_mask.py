"""Grey masks of recipes: pictures or arrays of what each pixel of a mask lets through, and the waves behind them.

Light behind a pixel is its transmission in amplitude times the light before it. A pixel of side p about the place c,
turned by an angle, adds

    t p^2 sinc(xi'_x p / 2) sinc(xi'_y p / 2) e^{-i xi . c},   xi' = xi in the mask's axes,

to the transform Psi(xi) of even light: exactly. Under a Gaussian laser each pixel is integrated by Gauss-Legendre.
"""

import hashlib
from collections.abc import Mapping
from functools import cached_property, lru_cache
from pathlib import Path
from typing import Annotated, Any, Literal, Self

import numpy as np
from pydantic import model_validator

from specklegen.core.errors import reject
from specklegen.core.parallel import slices
from specklegen.core.quadrature import gauss_legendre
from specklegen.core.units import RADIAN
from specklegen.core.values import IDENTITY, Array, Value
from specklegen.datasets.distributions import Draw, drawn, ends, require_above
from specklegen.datasets.objects.pictures import SUFFIXES, read_shares

MOST = 1 << 18
"""Pixels of a grey mask at most."""
_FINE = 8  # places along each side of a pixel of its picture
_AT_ONCE = 1 << 20  # waves times nodes


class GreyMask(Value):
    """A mask of square grey pixels about the middle of the window; its size and turn may vary from sample to sample.

    Parameters
    ----------
    path
        A picture (PNG, JPEG, TIFF, NPY): whole numbers over the largest of their type, others from 0 to 1. It counts by
        its content, not by its path.
    values
        float64[h, w] from 0 to 1, instead of a picture; rows y and columns x from the smallest.
    transmission
        Meaning of the numbers: shares of the "amplitude", or of the "intensity".
    size
        Of the longer side of the mask, in sides of the window.
    turn
        Angle from the x axis to the rows, radians.
    """

    path: str | None = None
    values: Array | None = None
    transmission: Literal["amplitude", "intensity"]
    size: Draw = 1.0
    turn: Annotated[Draw, RADIAN] = 0.0

    @model_validator(mode="after")
    def _check(self) -> Self:
        if (self.path is None) == (self.values is None):
            reject("GreyMask", "a path, or values", {"path": self.path, "values": self.values})
        if self.values is not None:
            _require_shares("GreyMask.values", self.values)
        require_above("GreyMask.size", self.size, 0)
        turned = any(ends(self.turn))
        if not ends(self.size)[1] <= (np.sqrt(0.5) if turned else 1):
            rule = "at most 0.7071, within the illuminated area at any rotation" if turned else "at most 1"
            reject("GreyMask.size", rule, self.size)
        return self

    def identity(self, context: dict[str, bool] | None = IDENTITY) -> dict[str, Any]:
        """Fields, with the hash of the picture instead of its path."""
        written = self.model_dump(mode="json", exclude={"path"}, context=context)
        return written if self.path is None else written | {"picture": self._content}

    @cached_property
    def _content(self) -> str:
        """SHA-256 of the file."""
        assert self.path is not None
        path = Path(self.path).expanduser()
        if not path.is_file() or path.suffix.lower() not in SUFFIXES:
            kinds = f"an existing file ({', '.join(SUFFIXES)})"
            reject("GreyMask.path", kinds, self.path, "Check the path.", "mask.path")
        return hashlib.sha256(path.read_bytes()).hexdigest()

    @property
    def amplitudes(self) -> np.ndarray:
        """Transmission of each pixel in amplitude, float64[h, w]."""
        shares = _read(self.path, self._content) if self.path is not None else np.asarray(self.values)
        return shares if self.transmission == "amplitude" else np.sqrt(shares)

    def drawn(self, rng: np.random.Generator) -> dict[str, float]:
        """One mask's numbers."""
        return {f"mask_{name}": float(drawn(getattr(self, name), rng)) for name in ("size", "turn")}

    def area(self, numbers: Mapping[str, float]) -> float:
        """Share of the power of even light on the window that passes."""
        return float(np.square(self.amplitudes).sum()) * self._pitch(numbers) ** 2

    def waves(
        self, numbers: Mapping[str, float], order: np.ndarray, waist: float | None
    ) -> tuple[np.ndarray, float]:
        """Transform complex128[n, n] at 2 pi (order, order), rows y, and the power that passes; lengths in windows.

        waist : of a Gaussian laser; None for even light
        """
        amplitudes, pitch, turn = self.amplitudes, self._pitch(numbers), _turned(numbers["mask_turn"])
        row, column = np.nonzero(amplitudes)
        t, shape = amplitudes[row, column], np.array(amplitudes.shape[::-1])
        middles = (np.stack([column, row], axis=1) - (shape - 1) / 2) * pitch
        xi = 2 * np.pi * np.stack(np.meshgrid(order, order), axis=-1)
        if waist is None:
            inside, weights = np.zeros((1, 2)), np.ones(1)
            shape_of_pixel = np.sinc(xi @ turn.T * pitch / (2 * np.pi)).prod(axis=-1)
        else:
            phase = np.pi * pitch * np.sqrt(2) * np.abs(order).max()
            x, w = gauss_legendre(3 + int(np.ceil(phase + pitch / waist)))
            inside = np.stack(np.meshgrid(x, x), axis=-1).reshape(-1, 2) * pitch / 2
            weights, shape_of_pixel = np.outer(w, w).ravel() / 4, 1.0
        total, passed = np.zeros(xi.shape[:2], complex), 0.0
        for aside, weight in zip(inside, weights, strict=True):
            for part in slices(len(t), max(1, _AT_ONCE // len(order))):
                points = (middles[part] + aside) @ turn
                beam = 1.0 if waist is None else np.exp(-np.square(points / waist).sum(axis=1))
                x, y = np.exp(-2j * np.pi * order[None, :, None] * points.T[:, None])
                total += (y * (weight * t[part] * beam)) @ x.T
                passed += weight * float(np.square(t[part] * beam).sum())
        return pitch**2 * shape_of_pixel * total, pitch**2 * passed

    def picture(self, numbers: Mapping[str, float], pixels: int) -> np.ndarray:
        """Share of the intensity that each pixel of the window lets through, float32[pixels, pixels].

        A mean over 8 x 8 places.
        """
        amplitudes, fine = self.amplitudes, pixels * _FINE
        x = (np.arange(fine) + 0.5) / fine - 0.5
        places = np.stack(np.meshgrid(x, x), axis=-1) @ _turned(numbers["mask_turn"]).T
        at = np.floor(places / self._pitch(numbers) + np.array(amplitudes.shape[::-1]) / 2).astype(int)[..., ::-1]
        within = np.all((at >= 0) & (at < amplitudes.shape), axis=-1)
        row, column = np.where(within[..., None], at, 0).transpose(2, 0, 1)
        shares = np.where(within, np.square(amplitudes[row, column]), 0.0)
        return shares.reshape(pixels, _FINE, pixels, _FINE).mean(axis=(1, 3)).astype(np.float32)

    def _pitch(self, numbers: Mapping[str, float]) -> float:
        """Side of a pixel of the mask, in sides of the window."""
        return numbers["mask_size"] / max(self.amplitudes.shape)


def _turned(angle: float) -> np.ndarray:
    """Axes float64[2, 2] of a turned mask: places in it times this are those on the window."""
    return np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])


@lru_cache(maxsize=4)
def _read(path: str, content: str) -> np.ndarray:  # noqa: ARG001 - another content is another picture
    try:
        shares = read_shares(Path(path).expanduser())
    except (OSError, ValueError) as error:
        reject("GreyMask.path", "a readable picture", path, f"{error}.", "mask.path")
    _require_shares("GreyMask.path", shares)
    shares.flags.writeable = False
    return shares


def _require_shares(field: str, shares: np.ndarray) -> None:
    if shares.ndim != 2 or not 0 < shares.size <= MOST:
        reject(field, f"of shape (h, w), of {MOST} pixels at most", shares.shape, "Average neighbouring pixels.")
    if not (shares.min() >= 0 and shares.max() <= 1):
        reject(field, "from 0 to 1", (float(shares.min()), float(shares.max())), "Divide by what an open pixel shows.")
    if not shares.any():
        reject(field, "not 0 everywhere", 0.0, "A closed mask is dark.")
