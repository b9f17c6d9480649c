"""The stationary sampler: the memory-effect correlation once, then one transform per realization.

Where narrow lobes keep light about its beam, each field is multiplied by an envelope that turns with the tilt; the
image of a hidden object is a sum of images under maps that make up the envelope of every pixel.
"""

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, ClassVar, Self

import numpy as np

from specklegen.core.budgets import DEFAULT_PATHS
from specklegen.core.decision import Decision
from specklegen.core.errors import reject
from specklegen.core.kept_results import kept_result
from specklegen.core.random_streams import Seed, pilot_seed, seed_words
from specklegen.core.statistics import BATCHES
from specklegen.core.values import remembered
from specklegen.memory_effects.atlas import TOLERANCE, Errors, atlas_correlation, atlas_errors
from specklegen.paths.axial_pilot import AxialPilot, axial_pilot
from specklegen.paths.flows import drifted
from specklegen.paths.pilot import Pilot, scene_pilot
from specklegen.paths.steps import refracting_layers
from specklegen.samplers.sampler import (
    FIXED_BYTES,
    TORCH_BYTES,
    MediaRequest,
    Request,
    Sampler,
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
from specklegen.scene.illumination import IncoherentObject
from specklegen.scene.media import as_slab
from specklegen.scene.scene import Scene
from specklegen.synthesis.exit_grid import fft_flops, matrix_flops, stack_axes

if TYPE_CHECKING:
    from specklegen.memory_effects.correlation import MemoryEffectCorrelation
    from specklegen.memory_effects.polarised_fields import PolarisedCorrelation
    from specklegen.samplers.stationary.renderer import StationaryRenderer
    from specklegen.synthesis.imaging import Imaging
    from specklegen.synthesis.sight import Sight


_CORRELATION = "memory-effect correlation"
_PATHS = 6000  # that tell K where only the cost of an image is asked for
BYTES_A_PIXEL = 400
"""Of a hidden object's pixels as values: their brightness, directions, and what they are known by, as text."""


@dataclass(frozen=True)
class Stationary(Sampler, name="stationary"):
    """The stationary sampler of a scene, dimensioned; see :class:`specklegen.samplers.sampler.Sampler`.

    Attributes
    ----------
    scene : Scene
    paths : int
        Paths that estimate the memory-effect correlation, once for a medium; 0 where the atlas has it.
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
    tabulated : Errors or None
        What the atlas states of its correlation, where it is taken from there.
    """

    scene: Scene
    paths: int = field()  # given, whatever the base has
    form: Form
    pilot: Pilot | AxialPilot
    streamed: bool
    envelope: Envelope | None = None
    maps: ObjectMaps | None = None
    tabulated: Errors | None = None

    summation = "FFT or matrix products"
    error_of = "intensity scale"
    thin = False
    films = True
    reverse = False
    images = True
    from_face = True
    complete: ClassVar[bool] = False
    """Whether the memory effect over a hidden object is taken as complete, as by the convolution sampler."""

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
        paths, tabulated = request.paths, None
        if paths is None:
            tabulated = _tabulated(scene, model.form, request.tolerance)
            wanted = DEFAULT_PATHS if request.rel_error is None else pilot.moments.paths_for(request.rel_error)
            paths = wanted if tabulated is None else 0
        hidden = envelope is not None and not scene.illumination.images
        maps = scene_object_maps(rest) if hidden else None
        decisions = [decision, _source(paths, tabulated)]
        return cls(scene, paths, model.form, pilot, request.streamed, envelope, maps, tabulated), decisions

    @property
    def expected_error(self) -> float:
        """Relative standard error of the intensity scale; the bound that the atlas states, where it is from there."""
        if self.tabulated is not None:
            return self.tabulated.intensity
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

    def _estimate(self) -> dict[str, float]:
        return self._tracing() | {"correlation batch": min(BATCHES, self.paths)}

    def _tracing(self) -> dict[str, float]:
        connections = self.paths * self.pilot.connections_per_path
        events = self.paths * self.pilot.events_per_path
        return {"path": self.paths, self.pilot.event: events, "connection": connections}

    def operations(self) -> Mapping[str, float]:
        """Operations of the correlation and of one stack, or of the image of an object by its modes."""
        if self.scene.hides_object:
            images = 1 if self.maps is None else self.maps.count  # each under its part of the envelope
            each = _expected_image(self.scene, self.complete).operations
            return self._estimate() | {n: images * x for n, x in each}
        grid = self.scene.grid
        x, y = stack_axes(self.scene, self.drift)
        tilts, views = len(self.scene.beams.directions), np.prod(grid.shape)
        size = x.count * y.count
        phasors = self.paths * self.pilot.connections_per_path if self.form == "oblique" else 0.0
        return self._estimate() | {
            "normal": tilts * size,
            "flop": tilts * (8.0 * tilts * size + min(matrix_flops(x, y, grid.shape), fft_flops(x, y))),
            "stack view": tilts * ((1 if self.envelope is None else 2) * views + 4.0 * size),
            "phasor": tilts * phasors,
        }

    def setup(self) -> Mapping[str, float]:
        """Operations of the correlation, and of the modes of an object."""
        if self.scene.hides_object:
            drawn = ("normal", "image")
            return {name: count for name, count in self.operations().items() if name not in drawn}
        operations = self._estimate()
        if self.form == "oblique":
            operations["phasor"] = self.operations()["phasor"]
        return operations

    def alternatives(self) -> Mapping[str, Mapping[str, float]]:
        """Fresh paths for every realization."""
        if not self.paths:
            return {}
        return {f"tracing {self.paths} paths anew for every realization, all fields aside,": self._tracing()}

    def memory(self, threads: int) -> int:
        """Bytes by which the process grows at most."""
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
        """Make ready to draw; what all seeds share is found at the first draw of any."""
        from specklegen.samplers.stationary.renderer import stationary_renderer

        return stationary_renderer(self, seed, threads)


def _tabulated(scene: Scene, form: Form, tolerance: float) -> Errors | None:
    """What the atlas states of a scene's correlation, where it has it within the tolerance: half of it for C_I.

    The other half is that of the model.
    """
    slab = as_slab(scene.slab)
    if form != "axial" or scene.film or scene.polarisers is not None or slab is None:
        return None
    errors = atlas_errors(slab)
    if errors is None or errors.correlation > min(tolerance / 2, TOLERANCE) or errors.intensity > tolerance:
        return None
    return errors


def _source(paths: int, tabulated: Errors | None) -> Decision:
    """Where the memory effect comes from."""
    if tabulated is None:
        return Decision(_CORRELATION, True, f"estimated by {paths} paths under the medium's seed, once for all seeds")
    return Decision(
        _CORRELATION, True, f"from the atlas: |K|^2 within {tabulated.correlation:.2g}, intensities within "
        f"{tabulated.intensity:.2g}; paths= estimates it instead",
    )  # fmt: skip


@dataclass(frozen=True)
class _ImageWork:
    """Operations of the first image of an object, by their names, and bytes."""

    operations: tuple[tuple[str, float], ...]
    bytes: float


def polarised_seed(seed: Seed, scene: Scene) -> Seed:
    """Seed of the noise of a hidden object's modes: one for each light and analyser, whose speckle is then its own.

    Modes belong to what one analyser passes; under one seed those of two would be drawn with one noise.
    """
    if scene.polarisers is None:
        return seed
    fields = np.concatenate(scene.polarisers.fields).round(12) + 0.0
    return (*seed_words(seed), *np.frombuffer(hashlib.sha256(fields.tobytes()).digest()[:8], np.uint32).tolist())


def object_of(scene: Scene) -> IncoherentObject:
    """The object of a scene that hides one."""
    assert isinstance(scene.illumination, IncoherentObject)
    return scene.illumination


@remembered(16)
def _expected_image(scene: Scene, complete: bool) -> _ImageWork:
    """What the image of a scene's object takes: its modes are counted with K of the atlas or a pilot, or one."""
    return kept_result(_ImageWork, ("image of an object", scene, complete), lambda: _image_work(scene, complete))


def _image_work(scene: Scene, complete: bool) -> _ImageWork:
    """What :func:`_expected_image` finds."""
    from specklegen.memory_effects.correlation import estimate_correlation
    from specklegen.memory_effects.polarised_fields import estimate_polarised_correlation
    from specklegen.synthesis.objects import expected_image

    light = object_of(scene)
    seed, lit = pilot_seed(scene.unitless_fingerprint()), int(np.count_nonzero(light.brightness))
    correlation: MemoryEffectCorrelation | PolarisedCorrelation | None
    if scene.polarisers is not None:
        correlation = estimate_polarised_correlation(scene.slab, scene.polarisers, _PATHS, seed, threads=1)
    else:
        slab = as_slab(scene.slab)
        correlation = None if slab is None else atlas_correlation(slab)
        correlation = correlation or estimate_correlation(scene.slab, _PATHS, seed, threads=1)
    held = BYTES_A_PIXEL * light.brightness.size
    if not correlation.weights.any():  # which says nothing of modes
        return _ImageWork((), held)
    if complete:
        correlation = replace(correlation, radius=np.zeros_like(correlation.radius))
    operations, taken = expected_image(correlation, _sight(scene), lit)
    return _ImageWork(tuple(operations.items()), held + taken)


def _sight(scene: Scene) -> "Sight":
    """How a scene's object is seen."""
    from specklegen.synthesis.objects import object_sight

    light = object_of(scene)
    shape, profile = light.brightness.shape, light.profile
    return object_sight(scene.wavelength, shape, light.pitch, light.width, profile, scene.grid)  # type: ignore[arg-type]
