"""What a sampler is to those who choose among them and run one.

Every sampler is a room of its own: it says whether it may serve a scene and why not (its rule), what it would cost, and
how it draws. The planner asks each, folds the decisions, and obeys the cheapest that may; nothing else knows which
sampler it is. A new one is a folder, and a line in :data:`specklegen.planning.planning.SAMPLERS`.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Literal, NamedTuple, NoReturn, Protocol

import numpy as np

from specklegen.core.errors import reject
from specklegen.core.random_streams import Seed
from specklegen.paths.gaussianity import Gaussianity
from specklegen.scene.illumination import IncoherentObject
from specklegen.scene.scene import Scene

SamplerName = Literal["auto", "paths", "covariance", "stationary", "screens"]

Where = tuple[slice, slice, slice]
"""Tilts, rows and columns of a piece in its stack."""

FIXED_BYTES = 58 * 2**20  # what compiled kernels, libraries and the plan itself take at the first render
RECORD_BYTES = 14 * 8 + 28  # of a connection
TILTS_STREAMED = 16  # whose fields on one tile are held at a time where a stack comes piece by piece

LEAST_FLOAT32, MOST_FLOAT32 = 1e-34, 1e35
"""Mean intensities that float32 holds with their dark grains and bright ones."""


@dataclass(frozen=True)
class Wish:
    """What is asked of the sampler of a scene.

    Attributes
    ----------
    paths : int or None
        Paths a realization; None leaves them to ``rel_error`` or the default.
    rel_error : float or None
        Error of intensity correlations that a finite number of paths may leave.
    reverse : bool
        Whether reversed paths take part.
    tolerance : float
        Error within which a sampler must be.
    field_tolerance : float
        Relative error of fields against their direct sum.
    asked : str
        Name of the sampler that must serve, or "auto".
    streamed : bool
        Whether the stack comes piece by piece.
    envelope : bool
        Whether fields may be drawn under an envelope that turns with the tilt.
    """

    paths: int | None
    rel_error: float | None
    reverse: bool
    tolerance: float
    field_tolerance: float = 1e-3
    asked: SamplerName = "auto"
    streamed: bool = False
    envelope: bool = True


class Drawn(NamedTuple):
    """One realization: complex64[T, *sensor], or the image float32[*sensor] of an incoherent object; its paths."""

    image: np.ndarray
    connections: int = 0
    unfinished: int = 0


class Draws(Protocol):
    """A sampler made ready: what is found once is found."""

    def images(self, realizations: int) -> Iterator[Drawn]:
        """Realizations 0, 1, ..., in their order."""
        ...

    def pieces(self, realization: int) -> Iterator[tuple[Where, np.ndarray]]:
        """One realization piece by piece, complex64[t, h, w]: together the stack of :meth:`images`."""
        ...


class Sampler(Protocol):
    """A way to render a scene, chosen and dimensioned."""

    @property
    def name(self) -> str:
        """As one asks for it."""
        ...

    @property
    def summation(self) -> str:
        """How its fields come about, in a word or two."""
        ...

    @property
    def paths(self) -> int:
        """Paths that it traces, for each realization or once."""
        ...

    @property
    def intensity(self) -> float:
        """Largest mean intensity among a few lights and views."""
        ...

    @property
    def expected_error(self) -> float:
        """Relative error that so many paths leave."""
        ...

    @property
    def error_of(self) -> str:
        """What that is an error of."""
        ...

    @property
    def gaussianity(self) -> Gaussianity:
        """Whether so many paths make Gaussian speckle."""
        ...

    def operations(self) -> Mapping[str, float]:
        """Counted operations of the first realization, by the names of :mod:`specklegen.core.nanoseconds`."""
        ...

    def alternatives(self) -> Mapping[str, Mapping[str, float]]:
        """Operations that other ways to the same would take, by what they are."""
        ...

    def memory(self, threads: int) -> int:
        """Bytes by which the process grows at most in its first plan and render, of one realization."""
        ...

    def prepare(self, seed: Seed, threads: int | None) -> Draws:
        """Do once what all realizations share."""
        ...


def require_float32(intensity: float) -> None:
    """Refuse a scene whose mean intensity, a float64, float32 does not hold with its dark grains and bright ones.

    Raises
    ------
    RuleError
        With the remedy.
    """
    if intensity and not LEAST_FLOAT32 <= intensity <= MOST_FLOAT32:
        _reject_range(intensity)


def require_finite(images: np.ndarray) -> np.ndarray:
    """Return fields complex64 or intensities float32, unless their intensities overflow.

    Raises
    ------
    RuleError
        With the remedy.
    """
    if images.size:
        parts = np.ascontiguousarray(images).view(np.float32)  # whose extremes are found without a copy
        highest = max(float(parts.max()), -float(parts.min()))
        power = 2 * highest**2 if np.iscomplexobj(images) else highest
        if not power < float(np.finfo(np.float32).max):
            _reject_range(power)
    return images


def _reject_range(intensity: float) -> NoReturn:
    reject(
        "Scene intensity", f"between {LEAST_FLOAT32:g} and {MOST_FLOAT32:g}, for images are float32", intensity,
        "Intensities are areas: give every length in a unit near the wavelength, or ask covariance, which is float64.",
    )  # fmt: skip


def image_of(scene: Scene, field: np.ndarray) -> np.ndarray:
    """Field [T, ...] of one medium as complex64[T, *sensor], or the image float32[*sensor] of an incoherent object."""
    field = field.reshape(len(field), *scene.sensor.shape)
    if not isinstance(scene.illumination, IncoherentObject):
        return field.astype(np.complex64)
    brightness = scene.illumination.brightness
    power = np.square(field.real) + np.square(field.imag)
    return np.tensordot(brightness[brightness > 0], power, axes=1).astype(np.float32)
