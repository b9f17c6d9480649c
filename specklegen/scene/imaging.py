"""A camera with a lens: the pupil that limits its light, and the plane that it is focused on.

A lens sees the light that leaves a medium within its aperture, direction by direction. On the plane in focus it makes

    E(x) = (1 / lambda) int over |s| <= NA of P(s) u(s) / cos(theta) e^(ik [s . x + (cos(theta) - 1) (L + f)]) d^2s

of the far field u, for the phases of u belong to z = 0; :mod:`specklegen.instrument.lens` sums it. P is the pupil.
Goodman, *Introduction to Fourier Optics* (2005): chapters 5 and 6; Zernike polynomials as numbered and normalised by
Noll, J. Opt. Soc. Am. 66, 207 (1976).
"""

import math
from typing import Annotated, ClassVar, Literal, NoReturn, Self

import numpy as np
from pydantic import Field, model_validator

from specklegen.core.errors import reject
from specklegen.core.memory import require_memory
from specklegen.core.units import OTHER_LENGTH, SINE
from specklegen.core.values import ComplexArray, Finite, Positive, PositiveInt, Value
from specklegen.scene.illumination import directions_of_sines
from specklegen.scene.sensors import FarFieldGrid, Sensor, Side

MOST_TERMS = 231
"""Zernike polynomials up to the twentieth radial order: more oscillate faster than a pupil is sampled."""
_FINE = 8  # points along each side of a cell that an edge of the pupil cuts


class Pupil(Value):
    """Pupil of a lens over its aperture: a disc by default. All given factors multiply.

    Parameters
    ----------
    stop
        Radius of a dark disc in the middle over that of the aperture: a ring.
    waist
        Radius at which a Gaussian amplitude has fallen to 1/e, over that of the aperture, which still ends it; by
        default the amplitude is even.
    zernike
        Aberrations: coefficients in waves rms, in Noll's order from 1 (piston, tilt along x, tilt along y, defocus,
        two of astigmatism, two of coma, ...). The phase is 2 pi times their sum.
    measured
        complex128[n, m], amplitude transmission in cells over the square around the aperture, rows along y, from
        negative sines to positive ones; straight lines between the middles of cells. By default nothing was measured:
        1.

    Examples
    --------
    >>> import specklegen as sg
    >>> ring = sg.sensors.Pupil(stop=0.5)
    >>> blurred = sg.sensors.Pupil(zernike=[0.0, 0.0, 0.0, 0.25])  # a quarter of a wave of defocus, rms
    >>> bool(ring.transmission(0.0, 0.1)), round(float(abs(blurred.transmission(0.0, 0.1))), 6)  # near the middle
    (False, 1.0)
    """

    stop: Annotated[float, Field(ge=0, lt=1)] = 0.0
    waist: Positive | None = None
    zernike: tuple[Finite, ...] = ()
    measured: ComplexArray | None = None

    @model_validator(mode="after")
    def _check(self) -> Self:
        if len(self.zernike) > MOST_TERMS:
            reject("Pupil.zernike", f"at most {MOST_TERMS} coefficients", len(self.zernike))
        if self.measured is not None and (self.measured.ndim != 2 or min(self.measured.shape) < 2):
            reject("Pupil.measured", "an array of shape (n, m), both at least 2", self.measured.shape)
        if self.measured is not None and not self.measured.any():
            reject("Pupil.measured", "bright somewhere", "zeros alone", "No light would come through.")
        return self

    def transmission(self, x: np.ndarray, y: np.ndarray) -> np.ndarray:
        """P complex128[...] at places that broadcast, in units of the aperture's radius; 0 outside of it."""
        x, y = np.broadcast_arrays(np.asarray(x, float), np.asarray(y, float))
        inside = self._open(np.hypot(x, y))
        return (inside * self._smooth(x, y))[()]

    def cells(self, side: int, size: float) -> np.ndarray:
        """P complex128[side, side] in square cells about the middle, of ``size`` in units of the aperture's radius.

        Cells that an edge cuts count by the share of 8 x 8 points inside it.
        """
        axis = (np.arange(side) - (side - 1) / 2) * size
        radius = np.hypot(axis, axis[:, None])
        inside = self._open(radius).astype(float)
        cut = (np.abs(radius - 1) < size) | ((np.abs(radius - self.stop) < size) & (self.stop > 0))
        rows, columns = np.nonzero(cut)
        fine = ((np.arange(_FINE) + 0.5) / _FINE - 0.5) * size
        points = np.hypot((axis[columns, None] + fine)[:, None], (axis[rows, None] + fine)[:, :, None])
        inside[rows, columns] = self._open(points).mean(axis=(1, 2))
        return inside * self._smooth(*np.broadcast_arrays(axis, axis[:, None]))

    def _open(self, radius: np.ndarray) -> np.ndarray:
        return (radius <= 1) & (radius >= self.stop)

    def _smooth(self, x: np.ndarray, y: np.ndarray) -> np.ndarray:
        """All but the edges, which go on outside as they are at the rim."""
        radius = np.hypot(x, y)
        over = np.maximum(radius, 1.0)
        x, y, radius = x / over, y / over, radius / over
        amplitude = np.ones(x.shape, complex)
        if self.waist is not None:
            amplitude *= np.exp(-np.square(radius / self.waist))
        if any(self.zernike):
            angle, turns = np.arctan2(y, x), np.zeros(x.shape)
            for j, coefficient in enumerate(self.zernike, start=1):
                if coefficient:
                    turns += coefficient * zernike(j, radius, angle)
            amplitude *= np.exp(2j * np.pi * turns)
        return amplitude if self.measured is None else amplitude * _between(self.measured, x, y)


def zernike(j: int, radius: np.ndarray, angle: np.ndarray) -> np.ndarray:
    """Zernike polynomial Z_j float64[...] in Noll's order, of mean square 1 over the unit disc."""
    n = 0
    while (n + 1) * (n + 2) // 2 < j:
        n += 1
    among = j - n * (n + 1) // 2 - 1  # of those of the radial order n, from 0
    m = 2 * ((among + 1) // 2) if n % 2 == 0 else 2 * (among // 2) + 1
    radial = np.zeros(np.shape(radius))
    for k in range((n - m) // 2 + 1):
        factor = math.comb(n - k, k) * math.comb(n - 2 * k, (n - m) // 2 - k)
        radial += (-1) ** k * factor * radius ** (n - 2 * k)
    if m == 0:
        return math.sqrt(n + 1) * radial
    return math.sqrt(2 * (n + 1)) * radial * (np.cos(m * angle) if j % 2 == 0 else np.sin(m * angle))


def _between(cells: np.ndarray, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Bilinear interpolation of complex128[n, m] over the square from -1 to 1; the outer half cells are flat."""
    shares = []
    for place, count in ((y, cells.shape[0]), (x, cells.shape[1])):
        at = np.clip((place + 1) / 2 * count - 0.5, 0, count - 1)
        low = np.minimum(at.astype(int), count - 2)
        shares.append((low, at - low))
    (row, down), (column, along) = shares
    top = cells[row, column] * (1 - along) + cells[row, column + 1] * along
    bottom = cells[row + 1, column] * (1 - along) + cells[row + 1, column + 1] * along
    return top * (1 - down) + bottom * down


class Imaging(Sensor):
    """A camera with a lens: points on the plane in focus, seen through a pupil. Fields are those on that plane.

    |u|^2 is then an irradiance ratio, the image of a medium, and no longer its far field. A scene with it is rendered
    by path sums, or by the stationary sampler where only the middle of a wide window is looked at.

    Parameters
    ----------
    shape
        (rows, columns) = (y, x) of the pixels, about the axis.
    pitch
        Between neighbouring pixels, on the camera: at ``magnification`` times what lies in the plane in focus.
    aperture
        Largest direction sine inside the medium that the lens takes, as all sines here: outside a medium of index n
        it is n times as large (the numerical aperture in air).
    focus
        How far behind the face the plane in focus lies, a length of what is outside; negative: inside, where the light
        is seen as if nothing scattered it between there and the face. 0: the face itself.
    magnification
        Of the image on the camera; irradiances stay those on the plane in focus.
    pupil
        What the lens lets through.
    side
        "transmission" looks at the face where z = thickness, "reflection" at z = 0.
    views
        Directions across the aperture that the field is a sum of. None: as many as the lit part of the plane asks for.

    Examples
    --------
    >>> import specklegen as sg
    >>> slab = sg.Slab(thickness=50.0, mean_free_path=25.0, scatterer=sg.media.HenyeyGreenstein(0.9))
    >>> light = sg.light.CollimatedBeams.tilts([0.0, 1e-3], width=60.0)
    >>> camera = sg.sensors.Imaging(shape=(32, 32), pitch=1.0, aperture=0.2, focus=-10.0)
    >>> scene = sg.Scene(wavelength=1.0, medium=slab, illumination=light, sensor=camera)
    >>> sg.render(scene, paths=2000, seed=0).field.shape
    (2, 32, 32)
    """

    focused: ClassVar[bool] = True
    type: Literal["Imaging"] = "Imaging"
    shape: tuple[PositiveInt, PositiveInt]  # type: ignore[assignment]
    pitch: Annotated[Positive, OTHER_LENGTH]
    aperture: Annotated[float, Field(gt=0, lt=1), SINE]
    focus: Annotated[Finite, OTHER_LENGTH] = 0.0
    magnification: Positive = 1.0
    pupil: Pupil = Pupil()
    side: Side = "transmission"
    views: PositiveInt | None = None

    @model_validator(mode="after")
    def _check(self) -> Self:
        require_memory(
            "Imaging.shape", "held", 48.0 * self.shape[0] * self.shape[1], f"{self.shape} pixels", "Use fewer."
        )
        return self

    @property
    def dimension(self) -> int:
        """3: images are in space."""
        return 3

    @property
    def directions(self) -> NoReturn:
        """None: what is seen is a sum over directions."""
        reject("Scene.sensor", "directions or points for this function", "Imaging",
               "Only plan and render support a camera with a lens; use FarField or NearField here.")  # fmt: skip

    @property
    def sign(self) -> float:
        """Sign of z on the side that it looks from."""
        return 1.0 if self.side == "transmission" else -1.0

    @property
    def corners(self) -> np.ndarray:
        """float64[4, 3], the corners of the square around the aperture."""
        ends = self.aperture * np.array([(x, y) for y in (-1, 1) for x in (-1, 1)])
        return directions_of_sines("Imaging.aperture", ends, self.sign)

    @property
    def positions(self) -> tuple[np.ndarray, np.ndarray]:
        """Places of the pixels on the plane in focus (x of the columns, y of the rows), float64[W] and float64[H]."""
        step = self.pitch / self.magnification
        rows, columns = self.shape
        return (np.arange(columns) - (columns - 1) / 2) * step, (np.arange(rows) - (rows - 1) / 2) * step

    @property
    def reach(self) -> float:
        """Half the longer side of the image on the plane in focus."""
        return max(self.shape) * self.pitch / self.magnification / 2

    def pupil_grid(self, views: int) -> FarFieldGrid:
        """The directions that the lens takes, ``views`` across the aperture, on the square around it."""
        return FarFieldGrid(shape=(views, views), pitch=2 * self.aperture / views, side=self.side)

    def require_lens(self, wavelength: float, largest_sine: float) -> None:
        """Refuse an aperture that no light fills, and pixels that do not resolve the speckle."""
        most = largest_sine / math.sqrt(2)
        if self.aperture >= most:
            reject(
                "Imaging.aperture", f"below {most:.4g}", self.aperture,
                f"Light leaves with sines inside below {largest_sine:.4g}, and a lens is a square of directions, whose "
                f"corners are root 2 times as steep as the aperture: use {0.99 * most:.3g}.",
            )  # fmt: skip
        grain, step = wavelength / (2 * self.aperture), self.pitch / self.magnification
        if step > grain / 2 * (1 + 1e-9):
            passing = grain / 2 * self.magnification
            reject(
                "Imaging.pitch",
                f"at most half a grain on the camera (wavelength / (2 aperture) = {grain:.4g} in the plane in focus)",
                self.pitch, f"Use a pitch <= {passing:.4g}, or an aperture <= {wavelength / (4 * step):.4g}.",
            )  # fmt: skip
