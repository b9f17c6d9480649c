"""Laboratory geometry: distances, pixels and an aperture, to and from the engine's directions and windows.

An incoherent object stands a distance u before the scattering layer; a camera without a lens stands v
behind it; or a lens focused at infinity images the far field onto the camera (v = focal length f), or an
objective images a plane near the layer, ``focus`` behind its exit face, by its magnification. An
aperture D limits the light on the layer. n is the refractive index of the layer, lambda_0 the wavelength
in vacuum, x_o a place on the object, X one on the camera:

    wavelength in the layer = lambda_0 / n       window width = D
    light sine = -x_o / (n sqrt(u**2 + x_o**2))  view sine = X / (n sqrt(v**2 + X**2))
    image of x_o at X = -(v / u) x_o             speckle = lambda_0 v / D
    view pitch = p / (n v)                       object pitch = (width of a cell) / (n u)

Spherical waves have quadratic phases on the layer that all object points and pixels share; they drop out
of every correlation, and a far-field scene is exact for the finite laboratory up to the next order. That
order is the phase, at the edge of the aperture, by which the pattern of an object's edge differs from the
shifted pattern of its centre; k_0 = 2 pi / lambda_0, s = (v / u) x_o, h half the camera's side:

    phi_1 = k_0 (D/2) / 2     max( 3/4 s**3, 3 h s (h - s) ) / v**3     shift: sines on a regular grid
    phi_3 = k_0 (D/2)**3 / 2  (x_o / u) |1 / u**2 - 1 / v**2|           coma
    phi_4 = k_0 (D/2)**2 3/4  ( x_o**2 / u**3 + s (2 h - s) / v**3 )    defocus over the field

(expansion of both distances to fourth order; behind a lens the terms in v vanish from phi_3 and phi_4). Each must be at
most 0.3 rad, which keeps the intensity correlation of the two patterns above 0.87. Where the image of the object fills
the camera (h = s), phi_4 is ``3/4 k_0 x_o**2 (D/2)**2 (1/u**3 + 1/(u**2 v))``.
"""

from __future__ import annotations

import math
from typing import Annotated, Literal, Self

from numpy.typing import ArrayLike
from pydantic import Field, model_validator

from specklegen.core.arguments import instance, real_array
from specklegen.core.errors import reject, warn_user
from specklegen.core.quantities import mark_of, nodes_of, with_units
from specklegen.core.units import LENGTH, WAVELENGTH, unit_of
from specklegen.core.values import Finite, NonNegative, Positive, PositiveInt, Value
from specklegen.scene.faces import Faces
from specklegen.scene.illumination import IncoherentObject
from specklegen.scene.imaging import Imaging
from specklegen.scene.media import Medium, Slab
from specklegen.scene.scene import Scene, require_range
from specklegen.scene.sensors import FarFieldGrid
from specklegen.scene.window import Profile

PHASE_LIMIT = 0.3
_ROUNDING = 1e-12  # a limit that was computed and handed back must pass


class LabSetup(Value):
    """A laboratory. Every length is in one unit, which the wavelength fixes: here, say, millimetres. Or every one that
    is not 0 is written with its unit, as "5 mm", and then kept in micrometres.

    Parameters
    ----------
    wavelength
        In vacuum, the middle of the band.
    object_distance
        From the object to the layer, u.
    object_extent
        Full side of the object, in its longer direction.
    aperture
        Full side or diameter of the illuminated part of the layer, D.
    camera_distance
        From the layer to the camera, v. Give this, or else ``focal_length``, or ``focus``.
    focal_length
        Instead: of a lens in front of the camera, focused at infinity.
    focus, magnification, numerical_aperture
        Of an objective, instead: how far behind the exit face the plane lies that it images (negative: inside the
        layer, as it looks from outside), how large its image is on the camera over the plane, and its aperture in air.
        What the far field alone has (view_distance, view_pitch, image_position, ...) is refused then.
    pixel_pitch
        Distance between neighbouring pixels, p.
    pixels
        (rows, columns) of the camera.
    oversampling
        Views along each side of a pixel, which the camera averages (`Camera.oversampling`);
        more than 1 where a pixel is larger than half a speckle.
    bandwidth
        Full width of the spectrum in vacuum wavelength, as a length.
    refractive_index
        Of the layer, n.
    faces
        What the step from n to the air does at the layer's faces: "fresnel" reflects, "matched" (a layer between index
        oil, say) does not.
    wall
        Refractive index of thin plates over both faces; None for a bare layer.

    Raises
    ------
    RuleError
        If the speckle is undersampled, the image of the object is larger than the camera, the aperture too
        large for the far-field mapping, the band so wide that it smears the pattern, or not exactly one of
        camera_distance, focal_length and focus is given; of an objective, if it has no magnification or aperture, or
        the light a bandwidth.

    Examples
    --------
    >>> from specklegen.instrument import LabSetup
    >>> lab = LabSetup(wavelength=532e-6, object_distance=500.0, object_extent=1.0, aperture=5.0,
    ...                camera_distance=200.0, pixel_pitch=0.0065, pixels=(512, 512))  # millimetres
    >>> round(lab.speckle_size, 4), round(lab.magnification, 2)
    (0.0213, -0.4)
    >>> LabSetup(wavelength="532 nm", object_distance="50 cm", object_extent="1 mm", aperture="5 mm",
    ...          camera_distance="200 mm", pixel_pitch="6.5 um", pixels=(512, 512)).aperture
    5000.0
    >>> microscope = LabSetup(wavelength=0.532, object_distance=5e5, object_extent=100.0, aperture=50.0, focus=-20.0,
    ...                       magnification=20.0, numerical_aperture=0.25, pixel_pitch=6.5, pixels=(64, 64))
    >>> round(microscope.speckle_size, 2)  # on the camera, micrometres
    21.28
    """

    wavelength: Annotated[Positive, WAVELENGTH]
    object_distance: Annotated[Positive, LENGTH]
    object_extent: Annotated[Positive, LENGTH]
    aperture: Annotated[Positive, LENGTH]
    camera_distance: Annotated[Positive, LENGTH] | None = None
    focal_length: Annotated[Positive, LENGTH] | None = None
    focus: Annotated[Finite, LENGTH] | None = None
    objective: Positive | None = Field(default=None, alias="magnification")
    numerical_aperture: Annotated[float, Field(gt=0, lt=1)] | None = None
    pixel_pitch: Annotated[Positive, LENGTH]
    pixels: tuple[PositiveInt, PositiveInt]
    oversampling: PositiveInt = 1
    bandwidth: Annotated[NonNegative, LENGTH] = 0.0
    refractive_index: Positive = 1.0
    faces: Literal["fresnel", "matched"] = "fresnel"
    wall: Positive | None = None

    @model_validator(mode="after")
    def _check(self) -> Self:
        given = (self.camera_distance, self.focal_length, self.focus)
        if sum(each is not None for each in given) != 1:
            reject("LabSetup.camera_distance", "the only one given of itself, focal_length and focus", given)
        lens = {"magnification": self.objective, "numerical_aperture": self.numerical_aperture}
        for name, number in lens.items():
            if (number is None) != (self.focus is None):
                reject(f"LabSetup.{name}", "given if focus is given, else left out", number)
        lengths = [name for name in nodes_of(LabSetup) if name != "bandwidth"]  # which may be 0
        require_range({f"LabSetup.{name}": abs(getattr(self, name) or 0.0) for name in lengths})
        self._check_sampling()
        if self.focus is not None:
            if self.bandwidth:
                reject("LabSetup.bandwidth", "0 with a focus", self.bandwidth, "A lens images one wavelength.")
            return self
        self._check_field()
        self._check_aperture()
        self._check_bandwidth()
        return self

    def _check_sampling(self) -> None:
        largest = self.speckle_size / 2
        excess = self.pixel_pitch / largest
        if excess > self.oversampling * (1 + _ROUNDING):
            reject("LabSetup.pixel_pitch", f"at most {_down(largest * self.oversampling)}, half a speckle a view",
                   self.pixel_pitch, f"Set oversampling to {math.ceil(excess * (1 - _ROUNDING))} or more, "
                   f"or the aperture to at most {_down(self.aperture * self.oversampling / excess)}.")  # fmt: skip

    def _check_field(self) -> None:
        largest = min(self.pixels) * self.pixel_pitch / abs(self.magnification)
        if self.object_extent > largest * (1 + _ROUNDING):
            reject("LabSetup.object_extent", f"at most {_down(largest)}, whose image fills the camera",
                   self.object_extent, "Use a smaller object, more pixels or a shorter camera distance.")  # fmt: skip

    def _check_aperture(self) -> None:
        if self.aperture > self.largest_aperture * (1 + _ROUNDING):
            phases = ", ".join(f"{name} = {phase:.3g} rad" for name, phase in self.phase_errors.items())
            reject("LabSetup.aperture", f"at most {_down(self.largest_aperture)}, so that the far-field mapping holds",
                   self.aperture,
                   f"Its phase errors are {phases}, each at most {PHASE_LIMIT} rad: lower the aperture D, "
                   "the object or the camera's side, or increase the distances.")  # fmt: skip

    def _check_bandwidth(self) -> None:
        if self.bandwidth > self.largest_bandwidth * (1 + _ROUNDING):
            reject("LabSetup.bandwidth",
                   f"at most {_down(self.largest_bandwidth)}, which moves the pattern by one speckle", self.bandwidth,
                   "Use a narrower filter, a smaller aperture or fewer pixels.")  # fmt: skip

    @property
    def view_distance(self) -> float:
        """Distance v from the layer to the camera, or the focal length of the lens.

        Raises
        ------
        RuleError
            Of an objective, and with it all that only the far field has.
        """
        if self.focus is not None:
            reject("LabSetup.focus", "left out for the far field", self.focus,
                   "An objective images a plane near the layer: use scene().")  # fmt: skip
        return self.camera_distance or self.focal_length or math.nan

    @property
    def metres(self) -> float:
        """Metres in its unit of length: as it was written, or by its wavelength: that of light is 0.15 to 25
        micrometres.
        """
        mark = mark_of(self)
        unit = mark.metres if mark is not None else unit_of(self.wavelength)
        if unit is not None:
            return unit
        rule = "that of light, in nanometres, micrometres, millimetres or metres"
        reject("LabSetup.wavelength", rule, self.wavelength,
               "A material given by name needs the unit of length.")  # fmt: skip

    @property
    def layer_faces(self) -> Faces:
        """Faces of the layer, towards the air."""
        if self.faces == "matched":
            return Faces()
        return Faces(inside=self.refractive_index, wall=self.wall)

    @property
    def medium_wavelength(self) -> float:
        """Wavelength inside the layer: that of the scene."""
        return self.wavelength / self.refractive_index

    @property
    def view_pitch(self) -> float:
        """Direction sine between neighbouring views, in the layer: the pitch of the far-field grid."""
        return self.pixel_pitch / (self.oversampling * self.refractive_index * self.view_distance)

    @property
    def view_shape(self) -> tuple[int, int]:
        """(rows, columns) of the far-field grid: the camera's pixels times the oversampling."""
        return self.pixels[0] * self.oversampling, self.pixels[1] * self.oversampling

    def object_pitch(self, shape: tuple[int, int]) -> float:
        """Direction sine, in the layer, between neighbouring cells of an object of ``shape`` cells."""
        return self.object_extent / (max(shape) * self.refractive_index * self.object_distance)

    @property
    def magnification(self) -> float:
        """Image over object, -v / u: the image is inverted. Of an objective, image over the plane that it images."""
        if self.objective is not None:
            return self.objective
        return -self.view_distance / self.object_distance

    @property
    def speckle_size(self) -> float:
        """Size of a speckle on the camera, lambda_0 v / D; of an objective, lambda_0 / (2 NA) by its magnification."""
        if self.objective is not None and self.numerical_aperture is not None:
            return self.wavelength / (2 * self.numerical_aperture) * self.objective
        return self.wavelength * self.view_distance / self.aperture

    @property
    def wavenumber_bandwidth(self) -> float:
        """Full width of the spectrum in wavenumber inside the layer, 2 pi n bandwidth / lambda_0**2."""
        return 2 * math.pi * self.refractive_index * self.bandwidth / self.wavelength**2

    @property
    def largest_bandwidth(self) -> float:
        """Bandwidth over which the pattern moves by one speckle where it moves most.

        It scales with the wavelength about the image of each object point; the camera's edge is farthest
        from the image of the object's opposite edge.
        """
        farthest = 0.5 * (max(self.pixels) * self.pixel_pitch + self.object_extent * abs(self.magnification))
        return self.wavelength * self.speckle_size / farthest

    @property
    def phase_errors(self) -> dict[str, float]:
        """Largest phase errors phi_1, phi_3, phi_4 of the far-field mapping, radians."""
        return {name: factor * self.aperture**power for name, (factor, power) in self._phase_factors().items()}

    @property
    def largest_aperture(self) -> float:
        """Aperture at which the first phase error reaches the limit of 0.3 rad."""
        return min(
            (PHASE_LIMIT / factor) ** (1 / power) if factor > 0 else math.inf
            for factor, power in self._phase_factors().values()
        )

    def _phase_factors(self) -> dict[str, tuple[float, int]]:
        """Each phase error over its power of the aperture, and that power."""
        k = 2 * math.pi / self.wavelength
        u, v, x = self.object_distance, self.view_distance, self.object_extent / 2
        s, h = abs(self.magnification) * x, max(self.pixels) * self.pixel_pitch / 2
        lensless = 0.0 if self.camera_distance is None else 1.0
        shift = max(0.75 * s**3, 3 * h * s * (h - s)) / v**3
        coma = x / u * abs(1 / u**2 - lensless / v**2)
        defocus = x**2 / u**3 + lensless * s * (2 * h - s) / v**3
        return {"phi_1": (k / 4 * shift, 1), "phi_3": (k / 16 * coma, 3), "phi_4": (k * 3 / 16 * defocus, 2)}

    @with_units
    def scene(self, medium: Medium, brightness: ArrayLike, profile: Profile = "square") -> Scene:
        """Scene of an object, float[h, w], behind a layer, as the engine sees it.

        Its views are the pixels times the oversampling; :func:`specklegen.instrument.camera.expose` brings them
        together. A slab gets the faces of :attr:`layer_faces`, unless it has faces of its own.

        Parameters
        ----------
        medium
            What lies between object and camera, of wavelengths and lengths in the setup's unit.
        brightness
            Of the object, float[h, w], at least 0; its longer side is ``object_extent``.
        profile
            Shape of the illuminated part of the layer: "square", "disc" or "gaussian".

        Warns
        -----
        DoubtWarning
            For another medium between indices that differ: it has no faces that reflect.
        """
        instance("LabSetup.scene medium", medium, Value)
        if isinstance(medium, Slab):
            medium = medium.replace(faces=self.layer_faces) if medium.faces.matched else medium
        elif not self.layer_faces.matched:
            warn_user(
                f"LabSetup.scene: at the refractive index {self.refractive_index:g} refraction is modelled, but "
                f'not reflection, for a {medium.type}. Use a Slab, or faces="matched".',
            )  # fmt: skip
        cells = real_array("LabSetup.scene brightness", brightness)
        if cells.ndim != 2:
            reject("LabSetup.scene brightness", "of shape (h, w)", cells.shape)
        return Scene(
            wavelength=self.medium_wavelength,
            medium=medium,
            illumination=IncoherentObject(
                brightness=cells,
                pitch=self.object_pitch((cells.shape[0], cells.shape[1])),
                width=self.aperture,
                profile=profile,
            ),
            sensor=self._sensor,
        )

    @property
    def _sensor(self) -> FarFieldGrid | Imaging:
        """The camera, a pixel a view."""
        if self.focus is None or self.objective is None or self.numerical_aperture is None:
            return FarFieldGrid(shape=self.view_shape, pitch=self.view_pitch)
        return Imaging(shape=self.view_shape, pitch=self.pixel_pitch / self.oversampling, magnification=self.objective,
                       aperture=self.numerical_aperture / self.refractive_index, focus=self.focus)  # fmt: skip


def _down(value: float) -> float:
    """Round down to four significant digits, so that the value printed still obeys the rule."""
    if not 0 < value < math.inf:
        return value
    digit = 10.0 ** (math.floor(math.log10(value)) - 3)
    return float(f"{math.floor(value / digit) * digit:.4g}")
