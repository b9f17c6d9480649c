"""The scene: what is simulated, in one frozen value."""

from collections.abc import Mapping
from functools import cached_property
from typing import Annotated, Any, Self, cast

import numpy as np
from pydantic import Field, model_validator

from specklegen.core.display.plot import Pictured
from specklegen.core.errors import reject
from specklegen.core.units import WAVELENGTH
from specklegen.core.values import Positive, Value
from specklegen.scene.coherent import CoherentObject
from specklegen.scene.focused import FocusedBeams
from specklegen.scene.illumination import CollimatedBeams, IncoherentObject, PlaneWaves, PointSources
from specklegen.scene.imaging import Imaging
from specklegen.scene.layers import PlaneParallel
from specklegen.scene.media import AnyMedium, Medium, Slab, as_slab, require_medium
from specklegen.scene.motion import flow_rows, law_of, reduced_time
from specklegen.scene.polarisation import Polarisers
from specklegen.scene.schematic import draw_scene
from specklegen.scene.screens import ScreenStack, require_thin
from specklegen.scene.sensors import AnySensor, FarFieldGrid
from specklegen.scene.unitless import unitless_fingerprint

NEAREST = 0.01
"""Wavelengths between a sensor point and a source inside the medium, at least."""
LARGEST = 1e60
"""Largest length, in any unit, and the inverse of the smallest one: what is squared twice is still a float64."""
Illumination = Annotated[
    PlaneWaves | CollimatedBeams | FocusedBeams | CoherentObject | PointSources | IncoherentObject,
    Field(discriminator="type"),
]
_TOUCHING = 1e-9  # of an exposure: one may end where the next begins, up to rounding


class Scene(Value, Pictured):
    """A medium, its illumination and a sensor. Every length is in one unit, which the wavelength fixes.

    Parameters
    ----------
    wavelength
        Inside the medium, in the unit of length of the scene.
    medium
        What scatters: :class:`Slab`, :class:`Layers`, :class:`Box`, :class:`VoxelGrid`; or thin, :class:`PhaseScreen`,
        :class:`GroundGlass`, :class:`ScreenStack`, which are lit by collimated beams or an object, and seen by a
        far-field grid in transmission; a coherent object behind them by any sensor.
    illumination
        What lights it: :class:`PlaneWaves`, :class:`CollimatedBeams`, :class:`FocusedBeams`, :class:`CoherentObject`,
        :class:`PointSources`, or an :class:`IncoherentObject`, which is hidden behind it.
    sensor
        Where its light is seen: :class:`FarField`, :class:`FarFieldGrid`, :class:`NearField`, :class:`Imaging`. Medium,
        light and sensor are all in space, or all in flatland: the length of their vectors says which.
    polarisers
        Light and analyser before and behind a medium whose ``polarisation`` is not "scalar" (:class:`Polarisers`); of
        others none.

    Examples
    --------
    >>> import specklegen as sg
    >>> slab = sg.Slab(thickness=100.0, mean_free_path=20.0, scatterer=sg.media.HenyeyGreenstein(0.9))
    >>> light = sg.light.CollimatedBeams.tilts([0.0, 1e-4], width=5000.0)
    >>> scene = sg.Scene(wavelength=0.5, medium=slab, illumination=light,
    ...                  sensor=sg.sensors.FarField.grid((16, 16), 2e-5))
    >>> scene.optical_depth, scene.speckle_size
    (5.0, 0.0001)
    >>> sg.Scene.from_toml(scene.to_toml()) == scene
    True
    """

    wavelength: Annotated[Positive, WAVELENGTH]
    medium: AnyMedium
    illumination: Illumination
    sensor: AnySensor
    polarisers: Polarisers | None = None

    @model_validator(mode="after")
    def _finite_power(self) -> Self:
        dimensions = {
            "medium": self.medium.dimension,
            "illumination": self.illumination.vectors.shape[-1],
            "sensor": self.sensor.dimension,
        }
        known = {name: d for name, d in dimensions.items() if d is not None}
        if len(set(known.values())) > 1:
            reject("Scene", "all in space or all in flatland",
                   ", ".join(f"{name} of {d} coordinates" for name, d in known.items()),
                   "Flatland vectors are (x, z), those of space (x, y, z).")  # fmt: skip
        self._require_polarisers()
        if getattr(self.illumination, "times", None) is not None:  # beams alone have any
            moves = self.medium.moves if self.thin is None else self.thin.velocities is not None
            if not moves:
                reject(f"{self.illumination.type}.times", "left out for a medium at rest", "times",
                       "Give the medium a motion, or a ScreenStack velocities.")  # fmt: skip
            if self.thin is None:
                self._require_film()
        if self.illumination.focused:
            self._require_focus()
        if self.sensor.focused:
            self._require_lens()
        if self.thin is not None:
            self._require_thin()
            return self
        light = self.illumination
        if not light.limited and not light.near and not self.medium.has_sides and not self.sensor.near:
            reject(
                "Scene.illumination",
                "limited sideways, for a slab seen from the far field",
                "PlaneWaves",
                "An unlimited wave on an infinite slab scatters infinite power: use CollimatedBeams with a width.",
            )
        if light.near and self.sensor.near:
            self._require_apart(self.lights, self.views)
        self._require_wavelength()
        self._require_lengths()
        self._require_crossing()
        return self

    def _require_polarisers(self) -> None:
        """Refuse polarised media without an analyser, analysers before others, and what no polarised scene is for."""
        polarisation = getattr(self.medium, "polarisation", "scalar")
        if polarisation == "scalar":
            if self.polarisers is not None and self.thin is not None:
                reject("Scene.polarisers", f"left out behind a {self.medium.type}", self.polarisers,
                       "A thin screen leaves the polarisation as it is: parallel polarisers change nothing, and "
                       "crossed ones pass no light.")  # fmt: skip
            if self.polarisers is not None:
                reject("Scene.polarisers", "left out for scalar light", self.polarisers,
                       f'Give the {self.medium.type} polarisation = "projector" or "vector".')  # fmt: skip
            return
        if self.polarisers is None:
            reject("Scene.polarisers", "given for polarised light", None,
                   "Use Polarisers.parallel() or crossed(). For an image without analyser, add both images "
                   "of one seed.")  # fmt: skip
        if self.sensor.near:
            reject("Scene.sensor", "a far field or a lens, behind polarisers", self.sensor.type,
                   "An analyser passes one component of light of one direction, and a point is met by light of all: "
                   "look through a lens.")  # fmt: skip
        served = self.illumination.limited and (self.illumination.gridded or not self.illumination.focused)
        served = served and (self.illumination.coherent or not self.sensor.focused)
        if not served or getattr(self.illumination, "exposure", None) is not None:
            reject("Scene.medium", 'of polarisation = "scalar" in this scene', polarisation,
                   "Polarised light is supported for beams and objects in the far field, at single times, "
                   "and through a lens if they are coherent.")  # fmt: skip

    def _require_lens(self) -> None:
        """Refuse a lens before what it does not serve, an aperture that nothing fills, and pixels too large."""
        seen = self.thin is None or self.illumination.gridded
        if not seen or not self.illumination.limited:
            reject("Scene.sensor", "FarField or NearField for this medium and light", self.sensor.type,
                   "A camera with a lens needs scatterers in a volume, and CollimatedBeams or an object; of thin "
                   "screens a CoherentObject.")  # fmt: skip
        camera = cast(Imaging, self.sensor)
        require_range({"Imaging.focus": abs(camera.focus), "Imaging.pitch": camera.pitch})
        medium = self.medium
        crossing = medium if isinstance(medium, PlaneParallel) else medium.faces
        camera.require_lens(self.wavelength, crossing.largest_sine)

    def _require_focus(self) -> None:
        """Refuse focused light before thin screens, and what its window or its medium does not let in."""
        light = cast(FocusedBeams | CoherentObject, self.illumination)
        if self.thin is not None and not light.gridded:
            reject("Scene.illumination", f"CollimatedBeams or an object in front of a {self.medium.type}", light.type,
                   "Superpose the fields of collimated beams.")  # fmt: skip
        largest = 1.0 if self.thin is not None else self.medium.faces.largest_sine
        light.require_focus(self.wavelength, largest)

    def _require_film(self) -> None:
        """Refuse times that fall, a motion that they make infinite, and sensors that no film is drawn for."""
        times, instants = np.asarray(self.illumination.times), np.asarray(self.beams.times)
        if (times[1:] < times[:-1]).any():
            reject("CollimatedBeams.times", "increasing, since the medium moves", times)
        if not self.illumination.coherent:
            exposure, apart = np.asarray(self.illumination.exposure), np.diff(times)
            if (apart < (1 - _TOUCHING) * exposure[:-1]).any():
                shortest = (apart / exposure[:-1]).argmin()
                reject("CollimatedBeams.times", "at least one exposure apart, since the medium moves",
                       float(apart[shortest]),
                       f"Exposures of {exposure[shortest]:g} must not overlap.")  # fmt: skip
            times = np.concatenate([instants[:1], times + exposure])
        if self.sensor.near and not self.illumination.coherent:
            reject("Scene.sensor", "in the far field, for exposures of a moving medium", self.sensor.type)
        flow_rows(self.volume.motions, self.dimension)  # of another dimension they are refused
        law = law_of(self.volume.motions)
        if law is not None:
            with np.errstate(over="ignore"):
                since = times - times[:1]
            reduced_time("CollimatedBeams.times", law, self.wavelength, since)

    def _require_crossing(self) -> None:
        """Refuse what a slab with refracting faces does not serve, and directions that do not cross them."""
        if not self.medium.refracts:
            return
        indices = self.volume.indices
        if not self.illumination.limited or self.dimension == 2:
            reject(f"{self.medium.type}.{'layers' if indices else 'faces'}",
                   f"{'of one index' if indices else 'matched'}, unless beams light it in space",
                   indices or self.medium.faces,
                   "Refracting faces are modelled in three dimensions: leave faces out, or use "
                   "CollimatedBeams or an object.")  # fmt: skip
        light = self.illumination
        if light.focused and not light.gridded and self.refracts_inside:
            reject(f"{self.medium.type}.{'layers' if indices else 'faces'}", "of one index, for focused beams",
                   indices or self.medium.faces, "Use a Slab, or a CoherentObject with focus=.")  # fmt: skip
        self.slab.require_crossing(f"{self.illumination.type}.directions", self.lights)
        if self.sensor.near:
            behind = self.side * (self.views[:, -1] - self.exit_depth)
            if (behind <= 0).any():
                reject("NearField.points", "all on one side of a slab with refracting faces, outside of it",
                       self.views[behind.argmin()], "Light inside meets both faces again and again, which is modelled "
                       "for light that leaves only. For both sides make two scenes: the same seed gives the same "
                       "light.")  # fmt: skip
            return
        seen = self.sensor.corners
        if seen[..., 2].min(initial=0.0) < 0 < seen[..., 2].max(initial=0.0):
            reject(f"{self.sensor.type}.directions", "all on one side of a slab with refracting faces", "views on both",
                   "Make one scene for each side: the same seed gives the same light.")  # fmt: skip
        self.slab.require_crossing(f"{self.sensor.type}.directions", seen)

    def _require_thin(self) -> None:
        """Refuse a thin medium where its model does not hold, and lights and sensors that it does not serve."""
        medium, light = self.medium, self.illumination
        if not light.limited:
            reject("Scene.illumination", f"CollimatedBeams or an object in front of a {medium.type}", light.type)
        if self.side < 0:
            reject("Scene.sensor", f"in transmission, behind a {medium.type}", self.sensor.type,
                   "A thin screen reflects no light.")  # fmt: skip
        if self.sensor.near and not light.gridded:
            reject("Scene.sensor", f"in the far field, behind a {medium.type} lit by beams", self.sensor.type,
                   "Use FarField.grid(...), or an even CoherentObject in place of the beam.")  # fmt: skip
        stack = require_thin(medium, self.wavelength)  # type: ignore[arg-type]
        if self.sensor.near and self.views[:, -1].min(initial=np.inf) < sum(stack.gaps):
            reject("Scene.sensor", f"at depths of at least {sum(stack.gaps):.4g}, behind the last screen",
                   float(self.views[:, -1].min()),
                   "For a plane between screens leave out the screens behind it.")  # fmt: skip
        lengths = {"Scene.wavelength": self.wavelength, f"{light.type}.width": self.beams.width}
        lengths |= {f"{medium.type}.correlation_length": length for length in stack.correlation_lengths}
        require_range(lengths | {f"{medium.type}.gaps": gap for gap in (*stack.gaps, stack.behind)})

    def _require_lengths(self) -> None:
        """Refuse lengths whose fourth powers leave the range of floats: results would be 0, NaN or without error."""
        medium, light = self.volume, self.illumination
        lengths: dict[str, float] = {"Scene.wavelength": self.wavelength}
        if isinstance(medium, PlaneParallel):
            lengths[f"{medium.type}.thickness"] = medium.thickness
        else:
            # A corner may lie as near to 0 as it likes; a side may not be as short.
            lengths[f"{medium.type}.upper - lower"] = float((medium.upper - medium.lower).min())
            lengths[f"{medium.type}.lower"] = max(float(np.abs(medium.lower).max()), 1 / LARGEST)
            lengths[f"{medium.type}.upper"] = max(float(np.abs(medium.upper).max()), 1 / LARGEST)
        if light.limited:
            lengths[f"{light.type}.width"] = self.beams.width
        if np.isfinite(medium.mean_free_path):
            lengths[f"{medium.type}.mean_free_path"] = medium.mean_free_path
        require_range(lengths)

    def _require_apart(self, sources: np.ndarray, sensors: np.ndarray) -> None:
        """Refuse a sensor point beside a source inside the medium: single scattering there diverges with 1/distance."""
        gaps = np.linalg.norm(sources[:, None] - sensors, axis=-1).min(axis=1, initial=np.inf)
        close = self.volume.contains(sources) & (gaps < NEAREST * self.wavelength)
        if close.any():
            reject(
                "Scene.sensor",
                f"at least {NEAREST:g} wavelengths from every source inside the medium",
                sources[close][0],
                "At shorter distances the few scatterers between them dominate, and no number of paths resolves them.",
            )

    def _require_wavelength(self) -> None:
        """Refuse spheres made for another wavelength."""
        for particle in (p for scatterer in self.volume.scatterers for p, _ in scatterer.components):
            made = particle.made_for
            if made is not None and abs(made / self.wavelength - 1) > 1e-9:
                reject(f"{particle.type}.wavelength", f"the wavelength of the scene, {self.wavelength:g}", made,
                       "Both are the wavelength inside the medium.")  # fmt: skip

    def _facts(self) -> Mapping[str, object]:
        about = {
            "wavelength": self.wavelength,
            "medium": f"{self.medium.type}, {self.thickness:.4g} thick",
            "optical depth": self.optical_depth,
        }
        if self.thin is None:
            about["medium"] += f", mean free path {self.volume.mean_free_path:.4g}"
            if len(self.volume.scatterers) == 1:
                (scatterer,) = self.volume.scatterers
                g = scatterer.mean_cosine(2 if self.dimension == 2 else 3)
                about |= {"scatterer": f"{scatterer.type}, g = {g:.4g}"}
        light, sensor = self.illumination, self.sensor
        about |= {"illumination": f"{light.type}, {len(light.vectors)} in all"}
        if light.limited:
            width = self.beams.width
            about |= {"window": f"{light.profile}, {width:.4g}"}
            about |= {"speckle size (sine)": self.wavelength / width}
        return about | {"sensor": f"{sensor.type}, {'x'.join(map(str, sensor.shape))}"}

    def _draw(self, axes: Any, label: str | None = None) -> None:
        draw_scene(axes, self)

    def unitless_fingerprint(self) -> str:
        """SHA-256 of the scene with every length in wavelengths, to 9 digits: the same in any unit, on any processor.

        Of scatterers that move it is that of the scene at rest: their paths are the same.
        """
        return self._unitless_fingerprint

    @cached_property
    def _unitless_fingerprint(self) -> str:
        return unitless_fingerprint(self.at_rest, self.wavelength)  # seconds, of millions of pixels as text

    @property
    def imaged(self) -> bool:
        """True if fields are sums over directions: those of a lens, and at points behind refracting faces."""
        return self.sensor.focused or (self.sensor.near and self.thin is None and self.medium.refracts)

    @cached_property
    def film(self) -> bool:
        """True if the beams see scatterers move between their times, or during their exposures."""
        times = getattr(self.illumination, "times", None)  # beams alone have any
        if self.thin is not None or times is None or not len(times):
            return False
        return not self.illumination.coherent or bool(np.ptp(times))

    @property
    def at_rest(self) -> Self:
        """The scene that decides how a film's paths are drawn: every direction of its beams, once and at no time.

        The motion of its medium is then nobody's business. A film with more frames, or longer exposures, has the same.
        """
        timed = self.thin is None and getattr(self.illumination, "times", None) is not None
        return self._at_rest if timed else self  # a value that cached itself would outlive its last user

    @cached_property
    def _at_rest(self) -> Self:
        if self.illumination.gridded:
            return self.replace(illumination=self.illumination.replace(times=None))
        directions = self.illumination.vectors
        if self.film:
            first = np.unique(directions, axis=0, return_index=True)[1]
            directions = directions[np.sort(first)]
        return self.replace(illumination=self.beams.replace(directions=directions, times=None))

    @property
    def dimension(self) -> int:
        """3 in space, 2 in flatland."""
        return self.sensor.dimension

    @property
    def wavenumber(self) -> float:
        """K = 2 pi / wavelength, radians per unit length."""
        return 2 * np.pi / self.wavelength

    @cached_property
    def hides_object(self) -> bool:
        """True if an incoherent object lights the medium: one image comes of all its points."""
        return not self.illumination.coherent and self.illumination.images == ()

    @cached_property
    def beams(self) -> CollimatedBeams:
        """The coherent beams that carry light: the illumination's own, those of an object's lit pixels, or instants.

        Of focused light, those that every focus is a sum of.
        """
        if self.illumination.focused:
            return cast(FocusedBeams | CoherentObject, self.illumination).modes(self.wavelength)
        if not self.illumination.coherent:
            return self.illumination.beams
        if not isinstance(self.illumination, CollimatedBeams):  # plane waves, points
            kind = type(self.illumination).__name__
            reject("Scene.illumination", "CollimatedBeams or an IncoherentObject here", kind)
        return self.illumination

    @property
    def thin(self) -> ScreenStack | None:
        """A thin medium as a stack of screens; None where the medium is a volume."""
        return self.medium.stack

    @cached_property
    def volume(self) -> Medium:
        """The medium of a scene whose medium is a volume of scatterers."""
        return require_medium("Scene.medium", self.medium, "Thin screens have no volume.")

    @property
    def optical_depth(self) -> float:
        """Mean number of events straight through: e^-OD is the unscattered share of the light."""
        return self.volume.optical_depth if self.thin is None else self.thin.optical_depth(self.wavelength)

    @property
    def thickness(self) -> float:
        """Thickness of the medium along the optical axis."""
        return self.volume.thickness if self.thin is None else self.thin.thickness

    @cached_property
    def slab(self) -> Slab:
        """The medium of a scene whose medium is a slab, or layers, which have all that a slab has."""
        if not isinstance(self.medium, PlaneParallel):
            reject("Scene.medium", "a Slab or Layers here", type(self.medium).__name__)
        return self.medium  # type: ignore[return-value]

    @cached_property
    def grid(self) -> FarFieldGrid:
        """The sensor of a scene that is seen by a regular far-field grid."""
        if self.sensor.regular_grid is None:
            reject("Scene.sensor", "a FarFieldGrid here", self.sensor.type)
        return self.sensor.regular_grid

    @cached_property
    def lights(self) -> np.ndarray:
        """float64[T, d]: directions of travel of the coherent lights, or the points of point sources."""
        own = self.illumination.coherent and not self.illumination.focused
        return self.illumination.vectors if own else self.beams.directions

    @property
    def views(self) -> np.ndarray:
        """float64[V, d]: the sensor's directions or points, flattened in C order."""
        vectors = self.sensor.vectors
        return vectors.reshape(-1, vectors.shape[-1])

    @cached_property
    def lock_step_obstacle(self) -> str | None:
        """Why paths in lock step, those of beams between two planes seen from afar, do not serve it; or None."""
        if not isinstance(self.medium, PlaneParallel):
            return f"the medium is a {type(self.medium).__name__}"
        if self.dimension == 2:
            return "the scene is in flatland"
        if not self.illumination.limited:
            return f"the light is {type(self.illumination).__name__}"
        return "the sensor is in the near field" if self.sensor.near else None

    @cached_property
    def refracts_inside(self) -> bool:
        """True if layers of other refractive indices than their neighbours' lie in it: aimed light knows no steps."""
        return self.thin is None and self.volume.refracts and as_slab(self.slab) is None

    @property
    def side(self) -> float:
        """Sign of z on the side that most of a far-field sensor's views look from; a grid's has one."""
        if self.sensor.focused:
            return self.sensor.sign  # type: ignore[attr-defined]
        if self.sensor.regular_grid is not None:
            return self.sensor.regular_grid.sign
        return 1.0 if np.sum(self.views[:, -1]) >= 0 else -1.0

    @property
    def exit_depth(self) -> float:
        """Depth z of the face through which light leaves to the sensor's side."""
        first = float(self.volume.lower[-1]) if self.medium.has_sides else 0.0  # type: ignore[union-attr]
        return first + self.thickness if self.side > 0 else first

    @property
    def speckle_size(self) -> float:
        """Direction sine over which far-field speckle changes: wavelength / window width."""
        return self.wavelength / self.beams.width


def require_unpolarised(owner: str, scene: Scene) -> None:
    """Refuse scenes of polarised light where nothing is known of it."""
    if scene.polarisers is not None:
        reject(f"{owner} scene", "a scene without polarisers", scene.polarisers,
               "Use render or covariance for polarised light.")  # fmt: skip


def require_no_focus(owner: str, scene: Scene) -> None:
    """Refuse focused light where every light is a beam of its own."""
    if scene.illumination.focused:
        reject(f"{owner} scene", "lit by collimated beams", scene.illumination.type,
               "Use render, mean_field or transmission_matrix, or the collimated beams, scene.beams.")  # fmt: skip


def require_no_film(owner: str, scene: Scene) -> None:
    """Refuse films of media that move where nothing of time is known."""
    if scene.film or not (scene.illumination.coherent or scene.hides_object):
        reject(f"{owner} scene", "a scene without times of beams", "CollimatedBeams.times",
               "Render its film, or compute the correlation in time by temporal_correlation.")  # fmt: skip


def require_range(lengths: dict[str, float]) -> None:
    """Refuse lengths, by their names, whose fourth powers leave the range of floats."""
    for name, length in lengths.items():
        if length and not 1 / LARGEST <= length <= LARGEST:
            reject(name, f"between {1 / LARGEST:g} and {LARGEST:g}", length,
                   "Give every length in a unit near the wavelength: only ratios of lengths matter.")  # fmt: skip
