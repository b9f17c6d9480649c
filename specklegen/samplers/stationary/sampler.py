"""The stationary sampler: the memory-effect correlation once, then one transform per realization.

Where narrow phase functions keep light about its beam, each field is multiplied by an envelope that turns with the
tilt; the image of a hidden object is a sum of images under maps that make up the envelope of every pixel.
"""

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, ClassVar, Self

import numpy as np

from specklegen.core.cached_results import cached_result
from specklegen.core.decision import Decision
from specklegen.core.nanoseconds import Cost
from specklegen.core.random_streams import Seed, pilot_seed
from specklegen.core.statistics import BATCHES
from specklegen.core.values import remembered
from specklegen.memory_effects.atlas import TOLERANCE, Errors, atlas_correlation, atlas_errors
from specklegen.paths.axial_pilot import AxialPilot, axial_pilot
from specklegen.paths.pilot import Pilot, scene_pilot
from specklegen.samplers.coherent_fields import CoherentRenderer, coherent_cost, coherent_memory
from specklegen.samplers.sampler import FIXED_BYTES, TORCH_BYTES, Abilities, MediaRequest, MediaSampler, Request
from specklegen.samplers.stationary.envelope import Envelope
from specklegen.samplers.stationary.object_maps import ObjectMaps, object_of
from specklegen.samplers.stationary.rule import (
    Form,
    exit_axes,
    obstacle_of,
    scene_envelope,
    scene_object_maps,
    stationary_decision,
)
from specklegen.scene.scene import Scene
from specklegen.synthesis.exit_grid import fft_flops, matrix_flops

if TYPE_CHECKING:
    from specklegen.memory_effects.correlation import MemoryEffectCorrelation
    from specklegen.memory_effects.polarised_fields import PolarisedCorrelation
    from specklegen.samplers.stationary.renderer import StationaryRenderer
    from specklegen.synthesis.imaging import Imaging
    from specklegen.synthesis.sight import Sight


_PATHS = 6000  # that tell K where only the cost of an image is asked for
BYTES_A_PIXEL = 400
"""Of a hidden object's pixels as values: their brightness, directions, and what they are known by, as text."""


@dataclass(frozen=True)
class Stationary(MediaSampler, name="stationary"):
    """The stationary sampler of a scene, dimensioned; see :class:`specklegen.samplers.sampler.Sampler`.

    Attributes
    ----------
    paths : int
        Paths that estimate the memory-effect correlation, once for a medium; 0 where the lookup table has it.
    form : "axial", "oblique" or "averaged"
        The correlation of the axis, about the middle of the beams and views, or over the camera's directions; recipes
        are drawn under the brightness of each direction as well where it is the last.
    pilot : Pilot or AxialPilot
        The latter of layers that refract.
    streamed : bool
        Whether the stack comes tilt by tilt.
    envelope : Envelope or None
        Of the intensities, where they are not the same everywhere.
    maps : ObjectMaps or None
        The same over a hidden object and its camera.
    tabulated : Errors or None
        What the lookup table states of its correlation, where it is taken from there.
    phased : bool
        Whether phases over the views count, as over the pupil of a lens before coherent objects.
    """

    scene: Scene
    paths: int = field()  # given, whatever the base has
    form: Form
    pilot: Pilot | AxialPilot
    streamed: bool
    envelope: Envelope | None = None
    maps: ObjectMaps | None = None
    tabulated: Errors | None = None
    phased: bool = False

    summation = "FFT or matrix products"
    error_of = "intensity scale, correlations between tilts"
    abilities = Abilities(media="volumes", lens="face", films=True)
    reverse = False
    complete: ClassVar[bool] = False
    """Whether the memory effect over a hidden object is taken as complete, as by the convolution sampler."""

    @classmethod
    def obstacles(cls, scene: Scene) -> list[str]:
        """Say why it cannot draw a scene at all."""
        return super().obstacles(scene) or [each for each in (obstacle_of(scene),) if each]

    @classmethod
    def propose(cls, scene: Scene, request: Request) -> tuple[Self | None, list[Decision]]:
        """The stationary sampler for a scene, where its correlations are right within the tolerance."""
        rest = scene.at_rest  # a film's tilts are judged without its times
        obstacle = obstacle_of(scene) if scene.film else None
        if obstacle:
            return None, [Decision("stationary sampler", False, obstacle)]
        model, decision = stationary_decision(rest, request)
        if model is None:
            return None, [decision]
        envelope = scene_envelope(rest, model.form == "oblique") if model.enveloped else None
        pilot = axial_pilot(rest) if scene.refracts_inside else scene_pilot(rest, False)
        tabulated = None if request.paths is not None else _tabulated(scene, model.form, request.tolerance)
        if tabulated is None:
            moments = pilot.moments
            if len(scene.beams.directions) > 1 and request.rel_error is not None:  # of K too
                moments = replace(moments, relative_variance=moments.relative_variance + 1)
            paths = request.paths_by(moments)
            source = f"estimated by {paths} paths under the medium's seed, once for all seeds"
        else:
            paths = 0
            source = (
                f"from the lookup table: |K|^2 within {tabulated.correlation:.2g}, intensities within "
                f"{tabulated.intensity:.2g}; paths= estimates it instead"
            )
        hidden = envelope is not None and request.envelope and not scene.illumination.images
        maps = scene_object_maps(rest) if hidden else None
        decisions = [decision, Decision("memory-effect correlation", True, source)]
        return cls(scene, paths, model.form, pilot, request.streamed, envelope, maps, tabulated), decisions

    @property
    def expected_error(self) -> float:
        """Larger one of the relative standard errors of the intensity scale (or the lookup table's) and of K."""
        scale = 0.0 if self.tabulated is None else self.tabulated.intensity
        if self.tabulated is None:
            scale = float(np.sqrt(self.pilot.moments.relative_variance / self.paths))
        return max(scale, self.correlation_error)

    @property
    def correlation_error(self) -> float:
        """Standard error of the correlation of fields under two tilts, at most; 0 of one tilt.

        All seeds share K, a mean of phasors with the weights of so many paths: where it is next to 0, its variance is
        that of ``E w^2 / (N (E w)^2)``. The lookup table states what |K|^2 is off.
        """
        if self.complete or len(self.scene.beams.directions) < 2:
            return 0.0
        if self.tabulated is not None:
            return self.tabulated.correlation
        return float(np.sqrt((1 + self.pilot.moments.relative_variance) / self.paths))

    @property
    def intensity(self) -> float:
        """Largest mean intensity among the pilot's lights and views."""
        return self.pilot.intensity

    @property
    def by_direction(self) -> bool:
        """True under a wide camera: see :mod:`specklegen.samplers.stationary.wide_cameras`."""
        return self.form == "averaged"

    def cost(self) -> Cost:
        """Count the operations of the correlation, once, and of one stack, or of an object's image by its modes."""
        connections = self.paths * self.pilot.connections_per_path
        events = self.paths * self.pilot.events_per_path
        tracing = {"path": self.paths, self.pilot.event: events, "connection": connections}
        anew = f"{self.paths} new paths for every realization, without the fields"
        others = {anew: tracing} if self.paths else {}
        estimate = tracing | {"correlation batch": min(BATCHES, self.paths)}
        if self.scene.hides_object:
            images = 1 if self.maps is None else self.maps.count  # each under its part of the envelope
            each = _expected_image(self.scene, self.complete).operations
            first = estimate | {name: images * count for name, count in each}
            once = {name: count for name, count in first.items() if name not in ("normal", "image")}
            return Cost(first, once, others)
        if self.scene.illumination.focused:
            return coherent_cost(self.scene, estimate)
        grid, (x, y) = self.scene.grid, exit_axes(self.scene)
        tilts, views, size = len(self.scene.beams.directions), np.prod(grid.shape), x.count * y.count
        phasors = {"phasor": tilts * (connections if self.form == "oblique" else 0.0)}
        first = estimate | {
            "normal": tilts * size,
            "flop": tilts * (8.0 * tilts * size + min(matrix_flops(x, y, grid.shape), fft_flops(x, y))),
            "stack view": tilts * ((1 if self.envelope is None else 2) * views + 4.0 * size),
        }  # fmt: skip
        return Cost(first | phasors, estimate | (phasors if self.form == "oblique" else {}), others)

    def memory(self, threads: int) -> int:
        """Bytes by which the process grows at most."""
        if self.scene.illumination.focused:
            return coherent_memory(self.scene) + int(self.paths * self.pilot.connections_per_path * 160)
        views = float(np.prod(self.scene.sensor.shape))
        correlation = self.paths * self.pilot.connections_per_path * 160
        if self.maps is not None:
            correlation += views * self.maps.bytes
        if self.scene.hides_object:
            taken = _expected_image(self.scene, self.complete).bytes
            return int(correlation + taken + 8 * views + TORCH_BYTES + FIXED_BYTES)
        tilts = len(self.scene.beams.directions)
        if self.envelope is not None:
            correlation += views * (64 + 4 * (1 if self.streamed else tilts))
        if not self.streamed:
            return int(correlation + 8 * views * tilts * 4 + TORCH_BYTES + FIXED_BYTES)
        x, y = exit_axes(self.scene)
        cells, period = float(x.count * y.count), float(x.period * y.period)
        return int(correlation + cells * (8 * tilts + 64) + 8 * 4 * period + 48 * views + TORCH_BYTES + FIXED_BYTES)

    def prepare_media(self, request: MediaRequest) -> "list[tuple[list[int], Imaging]]":
        """Make media ready, whose memory effect is known."""
        if request.waves is not None:
            from specklegen.samplers.stationary.coherent import coherent_imagings

            return coherent_imagings(request)  # type: ignore[return-value]
        from specklegen.samplers.stationary.wide_cameras import wide_imagings
        from specklegen.synthesis.imaging import imagings

        if self.by_direction and request.sight.device.type != "meta":
            return wide_imagings(request, self.paths, complete=self.complete)
        return imagings(
            request.sight, request.correlations, request.light, tolerance=request.tolerance, film=request.film
        )

    def prepare(self, seed: Seed, threads: int | None) -> "StationaryRenderer | CoherentRenderer":
        """Make ready to draw; what all seeds share is found at the first draw of any."""
        from specklegen.samplers.stationary.renderer import Prepared, coherent_renderer, stationary_renderer

        prepared = Prepared(self.scene, self.paths, self.form, self.tabulated is not None, self.complete, self.streamed,
                            self.envelope, self.maps, threads, self.phased)  # fmt: skip
        if self.scene.illumination.focused:
            return coherent_renderer(prepared, seed)
        return stationary_renderer(prepared, seed)


def _tabulated(scene: Scene, form: Form, tolerance: float) -> Errors | None:
    """Return the correlation of a scene from the lookup table, if its error is below half the tolerance for C_I.

    The other half is that of the model.
    """
    if form != "axial" or scene.film or scene.polarisers is not None:
        return None
    errors = atlas_errors(scene.slab)
    if errors is None or errors.correlation > min(tolerance / 2, TOLERANCE) or errors.intensity > tolerance:
        return None
    return errors


@dataclass(frozen=True)
class _ImageWork:
    """Operations of the first image of an object, by their names, and bytes."""

    operations: tuple[tuple[str, float], ...]
    bytes: float


@remembered(16)
def _expected_image(scene: Scene, complete: bool) -> _ImageWork:
    """Cost of the image of a scene's object: its modes are counted with K of the lookup table or a pilot, or one."""
    return cached_result(_ImageWork, ("image of an object", scene, complete), lambda: _image_work(scene, complete))


def _image_work(scene: Scene, complete: bool) -> _ImageWork:
    """Result of :func:`_expected_image`."""
    from specklegen.memory_effects.correlation import estimate_correlation
    from specklegen.memory_effects.polarised_fields import estimate_polarised_correlation
    from specklegen.synthesis.objects import expected_image

    light = object_of(scene)
    seed, lit = pilot_seed(scene.unitless_fingerprint()), int(np.count_nonzero(light.brightness))
    correlation: MemoryEffectCorrelation | PolarisedCorrelation | None
    if scene.polarisers is not None:
        correlation = estimate_polarised_correlation(scene.slab, scene.polarisers, _PATHS, seed, threads=1)
    else:
        correlation = atlas_correlation(scene.slab)
        correlation = correlation or estimate_correlation(scene.slab, _PATHS, seed, threads=1)
    held = BYTES_A_PIXEL * light.brightness.size
    if not correlation.weights.any():  # which says nothing of modes
        return _ImageWork((), held)
    if complete:
        correlation = replace(correlation, radius=np.zeros_like(correlation.radius))
    operations, taken = expected_image(correlation, _sight(scene), lit)
    return _ImageWork(tuple(operations.items()), held + taken)


def _sight(scene: Scene) -> "Sight":
    """Optics that image a scene's object."""
    from specklegen.synthesis.objects import object_sight

    light = object_of(scene)
    shape, profile = light.brightness.shape, light.profile
    return object_sight(scene.wavelength, shape, light.pitch, light.width, profile,
                        scene.grid)  # type: ignore[arg-type]
