"""The stationary sampler: the memory-effect correlation once, then one transform per realization.

Where narrow lobes keep light about its beam, each field is multiplied by an envelope that turns with the tilt; the
image of a hidden object is a sum of images under maps that make up the envelope of every pixel.
"""

import hashlib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, NamedTuple, Self

import numpy as np

from specklegen.core.budgets import DEFAULT_PATHS
from specklegen.core.decision import Decision
from specklegen.core.errors import reject
from specklegen.core.parallel import one_torch_thread
from specklegen.core.random_streams import Seed, pilot_seed, seed_words
from specklegen.core.values import remembered
from specklegen.paths.axial_pilot import AxialPilot, axial_pilot
from specklegen.paths.endpoints import AXIS
from specklegen.paths.flows import drift_phases, drifted
from specklegen.paths.pilot import PILOT_PATHS, Pilot, scene_pilot
from specklegen.paths.steps import refracting_layers
from specklegen.samplers.sampler import (
    FIXED_BYTES,
    TORCH_BYTES,
    MediaRequest,
    Realization,
    Request,
    Sampler,
    Where,
    image_of,
)
from specklegen.samplers.stationary.envelope import Envelope
from specklegen.samplers.stationary.object_maps import ObjectMaps
from specklegen.samplers.stationary.rule import (
    Form,
    flow_obstacle,
    scene_envelope,
    scene_object_maps,
    stationary_decision,
)
from specklegen.scene.illumination import IncoherentObject, directions_of_sines, reference_direction
from specklegen.scene.motion import law_of
from specklegen.scene.scene import Scene
from specklegen.synthesis.exit_grid import fft_flops, matrix_flops, stack_axes

if TYPE_CHECKING:
    import torch

    from specklegen.memory_effects.correlation import MemoryEffectCorrelation
    from specklegen.memory_effects.film import FilmCorrelation
    from specklegen.memory_effects.oblique import ObliqueCorrelation
    from specklegen.memory_effects.polarised_fields import PolarisedCorrelation, PolarisedFields
    from specklegen.synthesis.imaging import Imaging
    from specklegen.synthesis.sight import Sight
    from specklegen.synthesis.stacks import StackSampler


BYTES_A_PIXEL = 400
"""Of a hidden object's pixels as values: their brightness, directions, and what they are known by, as text."""


@dataclass(frozen=True)
class Stationary(Sampler, name="stationary"):
    """The stationary sampler of a scene, dimensioned; see :class:`specklegen.samplers.sampler.Sampler`.

    Attributes
    ----------
    scene : Scene
    paths : int
        Paths that estimate the memory-effect correlation, once.
    form : "axial" or "oblique"
        The correlation of the axis, or about the middle of the beams and views.
    pilot : Pilot or AxialPilot
        The latter of layers that refract.
    streamed : bool
        Whether the stack comes tilt by tilt.
    envelope : Envelope or None
        Of the intensities, where they are not the same everywhere.
    maps : ObjectMaps or None
        The same over a hidden object and its camera.
    """

    scene: Scene
    paths: int = field()  # given, whatever the base has
    form: Form
    pilot: Pilot | AxialPilot
    streamed: bool
    envelope: Envelope | None = None
    maps: ObjectMaps | None = None

    summation = "FFT or matrix products"
    error_of = "intensity scale"
    thin = False
    films = True
    reverse = False
    images = True
    from_face = True

    @classmethod
    def propose(cls, scene: Scene, request: Request) -> tuple[Self | None, list[Decision]]:
        """The stationary sampler for a scene, where its correlations are right within the tolerance."""
        obstacle = flow_obstacle(scene)
        if obstacle:
            if request.asked == cls.name:
                reject("sampler", '"paths" or "auto" for this scene', request.asked,
                       f"The stationary sampler {obstacle}.")  # fmt: skip
            return None, [Decision("stationary sampler", False, obstacle)]
        rest = scene.at_rest  # a film's tilts are judged without its times
        model, decision = stationary_decision(rest, request)
        if model is None:
            return None, [decision]
        envelope = scene_envelope(rest, model.form == "oblique") if model.enveloped else None
        pilot = axial_pilot(rest) if refracting_layers(rest.slab) else scene_pilot(rest, False)
        paths = request.paths
        if paths is None:
            paths = DEFAULT_PATHS if request.rel_error is None else pilot.moments.paths_for(request.rel_error)
        hidden = envelope is not None and not scene.illumination.images
        maps = scene_object_maps(rest) if hidden else None
        return cls(scene, paths, model.form, pilot, request.streamed, envelope, maps), [decision]

    @property
    def expected_error(self) -> float:
        """Relative standard error of the intensity scale."""
        return float(np.sqrt(self.pilot.moments.relative_variance / self.paths))

    @property
    def intensity(self) -> float:
        """Largest mean intensity among the pilot's lights and views."""
        return self.pilot.intensity

    @property
    def drift(self) -> np.ndarray | None:
        """How far along its faces a medium that moves as one has come at each beam, float64[T, 2]; None of others."""
        moved = drifted(self.scene)
        return None if moved is None else moved[:, :2]

    def _tracing(self) -> dict[str, float]:
        connections = self.paths * self.pilot.connections_per_path
        events = self.paths * self.pilot.events_per_path
        return {"path": self.paths, self.pilot.event: events, "connection": connections}

    def operations(self) -> Mapping[str, float]:
        """Operations of the correlation and of one stack, or of the image of an object by its modes."""
        if self.scene.hides_object:
            images = 1 if self.maps is None else self.maps.count  # each under its part of the envelope
            return self._tracing() | {n: images * x for n, x in _expected_image(self.scene).operations.items()}
        grid = self.scene.grid
        x, y = stack_axes(self.scene, self.drift)
        tilts, views = len(self.scene.beams.directions), np.prod(grid.shape)
        size = x.count * y.count
        phasors = self.paths * self.pilot.connections_per_path if self.form == "oblique" else 0.0
        return self._tracing() | {
            "normal": tilts * size,
            "flop": tilts * (8.0 * tilts * size + min(matrix_flops(x, y, grid.shape), fft_flops(x, y))),
            "stack view": tilts * ((1 if self.envelope is None else 2) * views + 4.0 * size),
            "phasor": tilts * phasors,
        }

    def alternatives(self) -> Mapping[str, Mapping[str, float]]:
        """Fresh paths for every realization."""
        return {f"tracing {self.paths} paths anew for every realization, all fields aside,": self._tracing()}

    def memory(self, threads: int) -> int:
        """Bytes by which the process grows at most."""
        views = float(np.prod(self.scene.sensor.shape))
        correlation = self.paths * self.pilot.connections_per_path * 160
        if self.maps is not None:
            correlation += views * self.maps.bytes
        if self.scene.hides_object:
            return int(correlation + _expected_image(self.scene).bytes + 8 * views + TORCH_BYTES + FIXED_BYTES)
        tilts = len(self.scene.beams.directions)
        if self.envelope is not None:
            correlation += views * (64 + 4 * (1 if self.streamed else tilts))
        if not self.streamed:
            return int(correlation + 8 * views * tilts * 4 + TORCH_BYTES + FIXED_BYTES)
        x, y = stack_axes(self.scene, self.drift)
        cells, period = float(x.count * y.count), float(x.period * y.period)
        return int(correlation + cells * (8 * tilts + 64) + 8 * 4 * period + 48 * views + TORCH_BYTES + FIXED_BYTES)

    def prepare_media(self, request: MediaRequest) -> "list[tuple[list[int], Imaging]]":
        """Make media ready, whose memory effect is known."""
        from specklegen.synthesis.imaging import imagings

        return imagings(
            request.sight, request.correlations, request.light, tolerance=request.tolerance, film=request.film
        )

    def prepare(self, seed: Seed, threads: int | None) -> "StationaryRenderer":
        """Make ready to draw; the memory-effect correlation is estimated at the first draw."""
        return StationaryRenderer(self, seed, threads)


class _ImageWork(NamedTuple):
    """Operations of the first image of an object, by their names, and bytes."""

    operations: Mapping[str, float]
    bytes: float


def polarised_seed(seed: Seed, scene: Scene) -> Seed:
    """Seed of the noise of a hidden object's modes: one for each light and analyser, whose speckle is then its own.

    Modes belong to what one analyser passes; under one seed those of two would be drawn with one noise.
    """
    if scene.polarisers is None:
        return seed
    fields = np.concatenate(scene.polarisers.fields).round(12) + 0.0
    return (*seed_words(seed), *np.frombuffer(hashlib.sha256(fields.tobytes()).digest()[:8], np.uint32).tolist())


@remembered(16)
def _expected_image(scene: Scene) -> _ImageWork:
    """What the image of a scene's object takes: its modes are counted with the K of a pilot's paths."""
    from specklegen.memory_effects.correlation import estimate_correlation
    from specklegen.memory_effects.polarised_fields import estimate_polarised_correlation
    from specklegen.synthesis.objects import expected_image

    light = scene.illumination
    assert isinstance(light, IncoherentObject)
    seed, lit = pilot_seed(scene.unitless_fingerprint()), int(np.count_nonzero(light.brightness))
    correlation = (
        estimate_correlation(scene.slab, PILOT_PATHS, seed, threads=1)
        if scene.polarisers is None
        else estimate_polarised_correlation(scene.slab, scene.polarisers, PILOT_PATHS, seed, threads=1)
    )
    held = BYTES_A_PIXEL * light.brightness.size
    if not correlation.weights.any():  # which says nothing of modes
        return _ImageWork({}, held)
    operations, taken = expected_image(correlation, _sight(scene), lit)
    return _ImageWork(operations, held + taken)


def _sight(scene: Scene) -> "Sight":
    """How a scene's object is seen."""
    from specklegen.synthesis.objects import object_sight

    light = scene.illumination
    assert isinstance(light, IncoherentObject)
    shape, profile = light.brightness.shape, light.profile
    return object_sight(scene.wavelength, shape, light.pitch, light.width, profile, scene.grid)  # type: ignore[arg-type]


@dataclass(frozen=True)
class StationaryRenderer:
    """Media of the stationary sampler under a seed."""

    sampler: Stationary
    seed: Seed
    threads: int | None

    @cached_property
    def correlation(
        self,
    ) -> "MemoryEffectCorrelation | ObliqueCorrelation | FilmCorrelation | PolarisedFields | PolarisedCorrelation":
        """The memory-effect correlation, of a film that in time as well."""
        from specklegen.memory_effects.correlation import estimate_correlation
        from specklegen.memory_effects.oblique import estimate_oblique_correlation

        scene, paths = self.sampler.scene, self.sampler.paths
        if scene.polarisers is not None:
            return self._polarised_correlation if scene.hides_object else self._polarised_fields
        if scene.film:
            return self._film
        if self.sampler.form == "axial":
            return estimate_correlation(scene.slab, paths, self.seed, threads=self.threads)
        light, view = reference_direction(scene.beams.directions), scene.grid.center_direction
        return estimate_oblique_correlation(scene.slab, light, view, paths, self.seed, threads=self.threads)

    @cached_property
    def _polarised_fields(self) -> "PolarisedFields":
        """Both components of beams, of a film at its times."""
        from specklegen.memory_effects.polarised_fields import estimate_polarised_fields

        scene = self.sampler.scene
        assert scene.polarisers is not None, "asked for"
        light, view = reference_direction(scene.at_rest.beams.directions), scene.grid.center_direction
        ends = (AXIS, AXIS) if self.sampler.form == "axial" else (light, view)
        found = estimate_polarised_fields(
            scene.slab, scene.polarisers, *ends, self.sampler.paths, self.seed, transfer=scene.film,
            threads=self.threads,
        )  # fmt: skip
        if not scene.film:
            return found
        law = law_of(scene.slab.motions)
        assert law is not None, "a film is of a medium that moves"
        return replace(found, times=np.asarray(scene.beams.times), motion=law)

    @cached_property
    def _polarised_correlation(self) -> "PolarisedCorrelation":
        """K of a hidden object's pixels behind the analyser, which is not round."""
        from specklegen.memory_effects.polarised_fields import estimate_polarised_correlation

        scene = self.sampler.scene
        assert scene.polarisers is not None, "asked for"
        return estimate_polarised_correlation(
            scene.slab, scene.polarisers, self.sampler.paths, self.seed, threads=self.threads
        )

    @property
    def _film(self) -> "FilmCorrelation":
        """Correlation of the light and view in the middle, as if at rest."""
        from specklegen.memory_effects.film import FilmCorrelation
        from specklegen.memory_effects.oblique import estimate_oblique_correlation

        scene, axial = self.sampler.scene, self.sampler.form == "axial"
        light, view = reference_direction(scene.at_rest.beams.directions), scene.grid.center_direction
        ends = (AXIS, AXIS) if axial else (light, view)
        ways = estimate_oblique_correlation(
            scene.slab, *ends, self.sampler.paths, self.seed, transfer=True, threads=self.threads
        )
        law = law_of(scene.slab.motions)
        assert law is not None, "a film is of a medium that moves"
        shifts = None if drifted(scene) is not None else ways.doppler
        return FilmCorrelation(ways, law, np.asarray(scene.beams.times), axial, shifts)

    @cached_property
    def stacks(self) -> "StackSampler":
        """What draws stacks of tilted beams."""
        from specklegen.memory_effects.film import causal_root
        from specklegen.synthesis.stacks import stack_sampler, tilt_roots

        scene = self.sampler.scene
        roots = causal_root if scene.film else tilt_roots
        if scene.polarisers is not None:
            both: Any = self._polarised_fields
            return stack_sampler(
                scene, both, roots=lambda full: both.analysed(roots(full)), drift=self.sampler.drift
            )
        correlation: Any = self.correlation
        return stack_sampler(scene, correlation, roots=roots, drift=self.sampler.drift)

    @cached_property
    def imaging(self) -> "Imaging":
        """What images an incoherent object."""
        import torch

        from specklegen.memory_effects.correlation import MemoryEffectCorrelation
        from specklegen.memory_effects.polarised_fields import PolarisedCorrelation
        from specklegen.synthesis.objects import object_imaging

        scene = self.sampler.scene
        beams, grid = scene.illumination, scene.grid
        assert isinstance(beams, IncoherentObject)
        # modes need a real K, which that of the axis is
        assert isinstance(self.correlation, MemoryEffectCorrelation | PolarisedCorrelation)
        found = object_imaging(
            self.correlation, wavelength=scene.wavelength, object_shape=beams.brightness.shape,
            object_pitch=beams.pitch, width=beams.width, profile=beams.profile, grid=grid,
        )  # fmt: skip
        if self.sampler.maps is None:
            return found
        gains, polynomials = (torch.from_numpy(each).to(found.envelope) for each in self.sampler.maps.arrays())
        return replace(found, gains=gains[None], polynomials=polynomials)

    def media(self, count: int) -> Iterator[Realization]:
        """One transform each."""
        scene = self.sampler.scene
        hidden = scene.hides_object
        for number in range(count):
            with one_torch_thread():  # the white noise as well
                found = (self._image(number) if hidden else self.stacks.sample(self.seed, number)).numpy()
            found = found if hidden or self.sampler.envelope is None else found * self._gains
            found = found if self._moved is None else found * self._turned(slice(None))
            yield Realization(found if hidden or scene.illumination.coherent else image_of(scene, found))

    def fields(self, number: int) -> Iterator[tuple[Where, np.ndarray]]:
        """Tilt by tilt: the noise is held, no stack."""
        rows, columns = self.sampler.scene.sensor.shape
        for t, drawn in enumerate(self.stacks.one_by_one(self.seed, number)):
            found = drawn.numpy()
            if self.sampler.envelope is not None:
                found = found * self._gain(t)
            if self._moved is not None:
                found = found * self._turned(slice(t, t + 1))
            yield (slice(t, t + 1), slice(0, rows), slice(0, columns)), found

    def _image(self, number: int) -> "torch.Tensor":
        from specklegen.synthesis.objects import object_media
        from specklegen.synthesis.stacks import mean_intensity

        beams = self.sampler.scene.illumination
        light = object_media(self.imaging, polarised_seed(self.seed, self.sampler.scene), number)
        seen = light.seen(self.imaging.modes.new_tensor(beams.brightness)[None])[0, 0]
        return seen * mean_intensity(self.correlation, beams.window.area)  # type: ignore[union-attr]

    @cached_property
    def _moved(self) -> np.ndarray | None:
        return drifted(self.sampler.scene)

    def _turned(self, tilts: slice) -> np.ndarray:
        """Phasors complex64[T, H, W] of some tilts, by which a medium that moves as one turns the field of views."""
        scene, grid = self.sampler.scene, self.sampler.scene.grid
        assert self._moved is not None
        views = directions_of_sines("view", np.stack(np.meshgrid(*grid.sines), axis=-1), grid.sign)
        some = scene.replace(illumination=scene.beams.of(np.arange(len(scene.lights))[tilts]))
        return np.exp(1j * drift_phases(some, self._moved[tilts], views)).astype(np.complex64)

    @cached_property
    def _gains(self) -> np.ndarray:
        """A of every tilt and view, float32[T, H, W]."""
        return np.stack([self._gain(t) for t in range(len(self.sampler.scene.beams.directions))])

    def _gain(self, t: int) -> np.ndarray:
        """A of one tilt, float32[H, W]."""
        scene, envelope = self.sampler.scene, self.sampler.envelope
        assert envelope is not None
        views = np.stack(np.meshgrid(*scene.grid.sines), axis=-1)
        return np.sqrt(envelope.intensity(scene.beams.directions[t, :2], views)).astype(np.float32)
