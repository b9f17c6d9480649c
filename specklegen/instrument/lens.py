"""A lens as a linear map: the far field over its pupil in, the field on the plane in focus out.

    E(x) = (ds^2 / lambda) sum over s of P(s) u(s) / sqrt(cos cos_out) e^(i phase)
    phase = k [s . x + (cos - 1) d] + k_out (cos_out - 1) f

on a square grid of sines. u belongs to z = 0, so that d is the way from there to the face that the lens looks at: the
thickness of a slab seen in transmission, and 0 in reflection; where u belongs to the face, d is 0. Behind a refracting
face the angle outside is cos_out, and k_out f is what the light gathers there; without one it is 1 / cos and (L + f).
Power is kept: the flux of E through the plane, sum |E|^2 cos_out, is that of |u|^2 per steradian inside.

The grid repeats the image every lambda / ds; edges of the pupil count by the share of each cell inside them. The sum
is two matrix products, for any pixels (Soummer, Pueyo, Sivaramakrishnan, Vanderbei, Opt. Express 15, 15935 (2007)).
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from specklegen.core.nanoseconds import WAVE
from specklegen.scene.imaging import Imaging
from specklegen.scene.scene import Scene
from specklegen.scene.sensors import FarFieldGrid, Sensor

FLAT = 0.75
"""Share of its aperture over which the pupil of :class:`Points` is flat."""


@dataclass(frozen=True)
class Lens:
    """A lens before a scene.

    Attributes
    ----------
    scene : Scene
        As the lens images it.
    camera : Imaging
        Its sensor.
    grid : FarFieldGrid
        Directions that the field is summed over.
    """

    scene: Scene
    camera: Imaging
    grid: FarFieldGrid

    @property
    def pupil_scene(self) -> Scene:
        """Return the scene in the far field over the pupil, with beams that interfere: an object's beams one by one."""
        light = self.scene.illumination if self.scene.illumination.coherent else self.scene.beams
        return self.scene.replace(sensor=self.grid, illumination=light)

    @property
    def period(self) -> float:
        """Length after which the image repeats."""
        return self.scene.wavelength / self.grid.pitch

    @cached_property
    def pupil(self) -> np.ndarray:
        """P complex128[N, N] over the grid."""
        return self.camera.pupil.cells(self.grid.shape[0], 2 / self.grid.shape[0])

    def weights(self, from_face: bool = False, focus: float | None = None) -> np.ndarray:
        """Factor of the far field, complex128[N, N]; ``from_face`` if its phases refer to the face.

        ``focus`` is that of the camera by default.
        """
        scene, faces = self.scene, self.scene.medium.faces
        x, y = self.grid.sines
        square, index = np.square(x) + np.square(y)[:, None], faces.inside / faces.outside
        inside, outside = np.sqrt(1 - square), np.sqrt(1 - index**2 * square)
        way = 0.0 if from_face else scene.side * scene.exit_depth
        focus = self.camera.focus if focus is None else focus
        # cos - 1 = -s^2 / (1 + cos), without cancellation; k_out (cos_out - 1) as much, with n s for s and k / n for k
        length = square * (way / (1 + inside) + index * focus / (1 + outside))
        if way and scene.refracts_inside:  # u is that of light carried back through all layers
            length = scene.slab.lag(square) + square * index * focus / (1 + outside)
        scale = self.grid.pitch**2 / scene.wavelength
        return scale * self.pupil / np.sqrt(inside * outside) * np.exp(-1j * scene.wavenumber * length)

    def image(self, fields: np.ndarray, *, from_face: bool = False) -> np.ndarray:
        """Fields complex[T, H, W] on the plane in focus of far fields complex[T, N, N], in their precision."""
        places = zip(self.grid.sines, self.camera.positions, strict=True)
        columns, rows = (np.exp(1j * self.scene.wavenumber * np.outer(place, sines)) for sines, place in places)
        weights, kind = self.weights(from_face).astype(fields.dtype), fields.dtype
        rows, columns = rows.astype(kind), np.ascontiguousarray(columns.T.astype(kind))
        images = np.empty((len(fields), *self.camera.shape), kind)
        for field, image in zip(fields, images, strict=True):
            image[...] = rows @ (weights * field) @ columns
        return images

    def flops(self, lights: int) -> float:
        """Real operations of the two products under so many lights, and of the waves that they share."""
        views, (rows, columns) = float(self.grid.shape[0]), self.camera.shape
        waves = WAVE * views * (2 * views + rows + columns)
        return waves + lights * 8 * rows * views * (views + columns)

    @property
    def memory(self) -> float:
        """Bytes held beside the far fields, under all lights."""
        views, (rows, columns) = float(self.grid.shape[0]), self.camera.shape
        return 80 * views**2 + 48 * views * (rows + columns) + 16.0 * len(self.scene.lights) * rows * columns

    @cached_property
    def grain_area(self) -> float:
        """Area of a point's image in focus, ``(int |h|^2)^2 / int |h|^4``: ``lambda^2 / (pi NA^2)`` and more."""
        power = np.square(np.abs(self.pupil)).sum()
        side = 2 * self.grid.shape[0]
        spread = np.square(np.abs(np.fft.fft2(self.pupil, (side, side))))
        return float(power**2 / np.square(spread).mean()) * self.period**2


@dataclass(frozen=True)
class Points(Lens):
    """Points behind a face as a lens sees them whose pupil takes all light that comes to them.

    Attributes
    ----------
    sensor : NearField
        Its P points.
    """

    sensor: Sensor

    @property
    def points(self) -> np.ndarray:
        """float64[P, 3]."""
        return self.sensor.vectors.reshape(-1, 3)

    @cached_property
    def pupil(self) -> np.ndarray:
        """P float64[N, N]: 1 up to ``FLAT`` of the aperture, then softly down to 0, for a hard edge would diffract."""
        x, y = self.grid.sines
        beyond = (np.hypot(x, y[:, None]) / self.camera.aperture - FLAT) / (1 - FLAT)
        return np.square(np.cos(np.pi / 2 * np.clip(beyond, 0, 1)))

    @cached_property
    def _depths(self) -> np.ndarray:
        """float64[P], how far behind the face."""
        return self.scene.side * (self.points[:, 2] - self.scene.exit_depth)

    def image(self, fields: np.ndarray, *, from_face: bool = False) -> np.ndarray:
        """Fields complex[T, P] at the points of far fields complex[T, N, N], in their precision.

        Unlike on a plane in focus, the phase along the axis is included: points may lie at several depths.
        """
        kind, out = fields.dtype, np.empty((len(fields), len(self.points)), fields.dtype)
        faces = self.scene.medium.faces
        for depth in np.unique(self._depths):
            here = self._depths == depth
            columns, rows = (
                np.exp(1j * self.scene.wavenumber * np.outer(places, sines)).astype(kind)
                for places, sines in zip(self.points[here, :2].T, self.grid.sines, strict=True)
            )
            turn = np.exp(1j * self.scene.wavenumber * faces.outside / faces.inside * depth)
            weights = (turn * self.weights(from_face, float(depth))).astype(kind)
            for field, seen in zip(fields, out, strict=True):
                seen[here] = ((rows @ (weights * field)) * columns).sum(axis=1)
        return out

    def flops(self, lights: int) -> float:
        """Real operations of a product for each depth under so many lights, and of the waves that they share."""
        views, points, planes = float(self.grid.shape[0]), len(self.points), len(np.unique(self._depths))
        waves = WAVE * views * (planes * views + 2 * points)
        return waves + lights * 8 * views * (points * (views + 1) + planes * views)

    @property
    def memory(self) -> float:
        """Bytes held beside the far fields, under all lights."""
        views, points = float(self.grid.shape[0]), len(self.points)
        return 80 * views**2 + 48 * views * points + 16.0 * len(self.scene.lights) * points
