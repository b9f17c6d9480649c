"""The envelope over a hidden object and its camera, in products of maps of both: what images are drawn under."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, cast

import numpy as np

from specklegen.scene.illumination import IncoherentObject, object_sines
from specklegen.synthesis.object_envelope import Squared, degree_of, gains_of, over_object, product_count

if TYPE_CHECKING:
    from specklegen.samplers.stationary.envelope import Envelope
    from specklegen.scene.scene import Scene


def object_of(scene: Scene) -> IncoherentObject:
    """The object of a scene that hides one."""
    assert isinstance(scene.illumination, IncoherentObject)
    return scene.illumination


@dataclass(frozen=True, eq=False)
class ObjectMaps:
    """A^2 over the pixels that shine, and those among them.

    Attributes
    ----------
    scene : Scene
        Of an incoherent object before a regular grid.
    box : (slice, slice)
        Rows and columns of the object that hold all pixels that shine.
    degree : int
        Of the polynomials over it.
    """

    scene: Scene
    envelope: Envelope
    box: tuple[slice, slice]
    degree: int

    @property
    def count(self) -> int:
        """Products."""
        return product_count(self.degree)

    @property
    def bytes(self) -> int:
        """Held of each view while maps are made, and while images are added up under them."""
        return 8 * (self.count + 10 * (self.degree + 1) ** 2) + 8 * self.count

    def arrays(self) -> tuple[np.ndarray, np.ndarray]:
        """Maps of the camera float64[T, P, H, W], T = 1, and of the object float64[P, h, w], 0 outside of the box."""
        polynomials = np.zeros((self.count, *_lit(self.scene).shape))
        inside = polynomials[:, *self.box]
        inside[...] = over_object(inside.shape[1:], self.degree)
        return gains_of(_squared(self.scene, self.envelope, self.box), *self.scene.grid.sines, self.degree), polynomials


def object_maps(scene: Scene, envelope: Envelope) -> ObjectMaps | None:
    """Find as few products as hold the envelope over object and camera; None where they would be too many."""
    lit = _lit(scene)
    ends = [np.flatnonzero(lit.any(axis))[[0, -1]] if lit.any() else (0, 0) for axis in (1, 0)]
    box = slice(int(ends[0][0]), int(ends[0][1]) + 1), slice(int(ends[1][0]), int(ends[1][1]) + 1)
    squared, (x, y) = _squared(scene, envelope, box), scene.grid.sines
    with np.errstate(over="ignore", invalid="ignore"):  # an envelope that grows without bound has no degree
        largest = squared(np.linspace(x[0], x[-1], 5), np.linspace(y[0], y[-1], 5), np.linspace(-1, 1, 5)).max()
        degree = degree_of(lambda *at: squared(*at) / largest, x, y, point=lit[box].size == 1)
    return None if degree is None else ObjectMaps(scene, envelope, box, degree)


def _lit(scene: Scene) -> np.ndarray:
    """Return whether each pixel of the object shines, bool[h, w]."""
    return cast(IncoherentObject, scene.illumination).brightness > 0


def _squared(scene: Scene, envelope: Envelope, box: tuple[slice, slice]) -> Squared:
    """A^2 over the box; the first row and column of an object have the largest sines."""
    pixels = cast(IncoherentObject, scene.illumination)
    sines = object_sines("IncoherentObject", pixels.brightness.shape, pixels.pitch)
    corners = sines.reshape(*pixels.brightness.shape, 2)[box]
    first, last = corners[0, 0], corners[-1, -1]

    def squared(x: np.ndarray, y: np.ndarray, points: np.ndarray) -> np.ndarray:
        at = np.stack(np.meshgrid(points, points), axis=-1).reshape(-1, 1, 1, 2)
        lights = (first + last) / 2 + at * (first - last) / 2
        return envelope.intensity(lights, np.stack(np.meshgrid(x, y), axis=-1))[None]

    return squared
