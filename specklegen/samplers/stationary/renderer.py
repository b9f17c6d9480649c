"""Renderer of the stationary sampler: the memory effect of a medium, transforms, and then one seed after the other.

All seeds of a scene share everything but their noise, so that is found once and kept (:data:`PREPARED`).
"""

import hashlib
from collections.abc import Iterator
from dataclasses import dataclass, fields, replace
from functools import cached_property, lru_cache
from typing import TYPE_CHECKING, Any

import numpy as np

from specklegen.core.most_recent import MostRecent
from specklegen.core.parallel import one_torch_thread
from specklegen.core.random_streams import Seed, seed_words
from specklegen.memory_effects.atlas import atlas_correlation
from specklegen.memory_effects.cached import (
    axial_correlation,
    camera_correlation,
    estimated_under,
    oblique_correlation,
    polarised_correlation,
    polarised_fields,
)
from specklegen.paths.endpoints import AXIS
from specklegen.paths.flows import drift_phases, drifted
from specklegen.samplers.coherent_fields import CoherentRenderer
from specklegen.samplers.sampler import Realization, Where, image_of
from specklegen.samplers.stationary.envelope import Envelope
from specklegen.samplers.stationary.object_maps import ObjectMaps, object_of
from specklegen.samplers.stationary.rule import Form
from specklegen.samplers.stationary.stationarity import half_sides
from specklegen.scene.illumination import directions_of_sines, reference_direction
from specklegen.scene.motion import law_of
from specklegen.scene.scene import Scene

if TYPE_CHECKING:
    import torch

    from specklegen.memory_effects.correlation import MemoryEffectCorrelation
    from specklegen.memory_effects.film import FilmCorrelation
    from specklegen.memory_effects.oblique import ObliqueCorrelation
    from specklegen.memory_effects.polarised_fields import PolarisedCorrelation, PolarisedFields
    from specklegen.synthesis.imaging import Imaging
    from specklegen.synthesis.many_tilts import ManyTilts
    from specklegen.synthesis.stacks import StackSampler


@dataclass(frozen=True)
class Prepared:
    """Data that all seeds of a scene share; each part is computed at its first use.

    Attributes
    ----------
    scene, paths, form, complete, streamed, envelope, maps
        As of :class:`~specklegen.samplers.stationary.sampler.Stationary`.
    tabulated : bool
        Whether the lookup table has the memory-effect correlation.
    lens : bool
        Whether phases over the views count, as those of a pupil do.
    """

    scene: Scene
    paths: int
    form: Form
    tabulated: bool
    complete: bool
    streamed: bool
    envelope: Envelope | None
    maps: ObjectMaps | None
    threads: int | None
    lens: bool = False

    @cached_property
    def correlation(
        self,
    ) -> "MemoryEffectCorrelation | ObliqueCorrelation | FilmCorrelation | PolarisedFields | PolarisedCorrelation":
        """The memory-effect correlation, of a film that in time as well."""
        scene, paths = self.scene, self.paths
        if scene.polarisers is not None:
            return self._polarised_correlation if scene.hides_object else self._polarised_fields
        if scene.film:
            return self._film
        if self.tabulated:
            correlation = atlas_correlation(scene.slab, np.inf)
            assert correlation is not None, "the planner has seen it there"
            return correlation
        if self.form == "averaged":
            return camera_correlation(scene.slab, half_sides(scene), paths, threads=self.threads)
        if self.form == "axial":
            return axial_correlation(scene.slab, paths, threads=self.threads)
        light, view = reference_direction(scene.beams.directions), scene.grid.center_direction
        return oblique_correlation(scene.slab, light, view, paths, threads=self.threads)

    @cached_property
    def _polarised_fields(self) -> "PolarisedFields":
        """Both components of beams, of a film at its times."""
        scene = self.scene
        assert scene.polarisers is not None, "asked for"
        light, view = reference_direction(scene.at_rest.beams.directions), scene.grid.center_direction
        ends = (AXIS, AXIS) if self.form == "axial" else (light, view)
        fields = polarised_fields(
            scene.slab, scene.polarisers, *ends, self.paths, transfer=scene.film, threads=self.threads
        )
        if not scene.film:
            return fields
        law = law_of(scene.slab.motions)
        assert law is not None, "a film is of a medium that moves"
        return replace(fields, times=np.asarray(scene.beams.times), motion=law)

    @cached_property
    def _polarised_correlation(self) -> "PolarisedCorrelation":
        """K of a hidden object's pixels behind the analyser, which is not round."""
        scene = self.scene
        assert scene.polarisers is not None, "asked for"
        return polarised_correlation(scene.slab, scene.polarisers, self.paths, threads=self.threads)

    @property
    def _film(self) -> "FilmCorrelation":
        """Correlation of the light and view in the middle, as if at rest."""
        from specklegen.memory_effects.film import FilmCorrelation

        scene, axial = self.scene, self.form == "axial"
        light, view = reference_direction(scene.at_rest.beams.directions), scene.grid.center_direction
        ends = (AXIS, AXIS) if axial else (light, view)
        ways = oblique_correlation(scene.slab, *ends, self.paths, transfer=True, threads=self.threads)
        law = law_of(scene.slab.motions)
        assert law is not None, "a film is of a medium that moves"
        shifts = None if drifted(scene) is not None else ways.doppler
        return FilmCorrelation(ways, law, np.asarray(scene.beams.times), axial, shifts)

    @cached_property
    def stacks(self) -> "StackSampler | ManyTilts":
        """Sampler that draws stacks of tilted beams."""
        from specklegen.memory_effects.film import causal_root
        from specklegen.synthesis.many_tilts import many_tilts
        from specklegen.synthesis.stacks import stack_sampler, tilt_roots

        scene = self.scene
        roots = causal_root if scene.film else tilt_roots
        if scene.polarisers is not None:
            both: Any = self._polarised_fields
            return stack_sampler(scene, both, roots=lambda full: both.analysed(roots(full)), drift=self.drift)
        correlation: Any = self.correlation
        many = None if scene.film or self.drift is not None else many_tilts(scene, correlation)
        if many is not None:
            return many
        return stack_sampler(scene, correlation, roots=roots, drift=self.drift)

    @cached_property
    def imaging(self) -> "Imaging":
        """Imaging of an incoherent object."""
        import torch

        from specklegen.memory_effects.correlation import MemoryEffectCorrelation
        from specklegen.memory_effects.polarised_fields import PolarisedCorrelation
        from specklegen.synthesis.objects import object_imaging

        scene = self.scene
        beams, grid = object_of(scene), scene.grid
        # modes need a real K, which that of the axis is
        assert isinstance(self.correlation, MemoryEffectCorrelation | PolarisedCorrelation)
        correlation = self.correlation
        if self.complete:
            correlation = replace(correlation, radius=np.zeros_like(correlation.radius))
        imaging = object_imaging(
            correlation, wavelength=scene.wavelength, object_shape=beams.brightness.shape,
            object_pitch=beams.pitch, width=beams.width, profile=beams.profile, grid=grid,
        )  # fmt: skip
        if self.maps is None:
            return imaging
        gains, polynomials = (torch.from_numpy(each).to(imaging.envelope) for each in self.maps.arrays())
        return replace(imaging, gains=gains[None], polynomials=polynomials)

    @property
    def drift(self) -> np.ndarray | None:
        """Displacement along the faces of a medium in uniform motion at each beam, float64[T, 2]; None for others."""
        return None if self.moved is None else self.moved[:, :2]

    @cached_property
    def moved(self) -> np.ndarray | None:
        """Displacement of a medium in uniform motion at each beam, float64[T, 3]; None for others."""
        return drifted(self.scene)

    def turned(self, tilts: slice) -> np.ndarray:
        """Phasors complex64[T, H, W] of some tilts, by which a medium that moves as one turns the field of views."""
        scene, grid = self.scene, self.scene.grid
        assert self.moved is not None
        views = directions_of_sines("view", np.stack(np.meshgrid(*grid.sines), axis=-1), grid.sign)
        some = scene.replace(illumination=scene.beams.of(np.arange(len(scene.lights))[tilts]))
        return np.exp(1j * drift_phases(some, self.moved[tilts], views)).astype(np.complex64)

    @cached_property
    def gains(self) -> np.ndarray:
        """A of every tilt and view, float32[T, H, W]."""
        return np.stack([self.gain(t) for t in range(len(self.scene.beams.directions))])

    def gain(self, t: int) -> np.ndarray:
        """A of one tilt, float32[H, W]."""
        scene, envelope = self.scene, self.envelope
        assert envelope is not None
        views = np.stack(np.meshgrid(*scene.grid.sines), axis=-1)
        return np.sqrt(envelope.intensity(scene.beams.directions[t, :2], views)).astype(np.float32)


_Key = tuple[Scene, int, Form, bool, bool, bool, bool]
_GIVEN = {each.name for each in fields(Prepared)}
PREPARED: MostRecent[_Key, Prepared] = MostRecent(
    2**28, held=lambda kept: {name: each for name, each in vars(kept).copy().items() if name not in _GIVEN}
)
"""Scenes that were drawn last, by all that decides what is kept of them."""


def polarised_seed(seed: Seed, scene: Scene) -> Seed:
    """Seed of the noise of a hidden object's modes: one for each light and analyser, whose speckle is then its own.

    Modes belong to what one analyser passes; under one seed those of two would be drawn with one noise.
    """
    if scene.polarisers is None:
        return seed
    fields = np.concatenate(scene.polarisers.fields).round(12) + 0.0
    return (*seed_words(seed), *np.frombuffer(hashlib.sha256(fields.tobytes()).digest()[:8], np.uint32).tolist())


@dataclass(frozen=True)
class StationaryRenderer:
    """Media of the stationary sampler under a seed."""

    shared: Prepared
    seed: Seed

    def media(self, count: int) -> Iterator[Realization]:
        """One transform each."""
        shared = self.shared
        scene = shared.scene
        hidden = scene.hides_object
        for number in range(count):
            with one_torch_thread():  # the white noise as well
                drawn = (self._image(number) if hidden else shared.stacks.sample(self.seed, number)).numpy()
            drawn = drawn if hidden or shared.envelope is None else drawn * shared.gains
            drawn = drawn if shared.moved is None else drawn * shared.turned(slice(None))
            if number == count - 1:
                PREPARED.trim()
            yield Realization(drawn if hidden or scene.illumination.coherent else image_of(scene, drawn))

    def fields(self, number: int) -> Iterator[tuple[Where, np.ndarray]]:
        """Tilt by tilt: the noise is held, no stack."""
        shared = self.shared
        rows, columns = shared.scene.sensor.shape
        for t, drawn in enumerate(shared.stacks.one_by_one(self.seed, number)):
            field = drawn.numpy()
            if shared.envelope is not None:
                field = field * shared.gain(t)
            if shared.moved is not None:
                field = field * shared.turned(slice(t, t + 1))
            if t == len(shared.scene.beams.directions) - 1:
                PREPARED.trim()
            yield (slice(t, t + 1), slice(0, rows), slice(0, columns)), field

    def _image(self, number: int) -> "torch.Tensor":
        from specklegen.synthesis.objects import object_media
        from specklegen.synthesis.stacks import mean_intensity

        shared = self.shared
        beams = shared.scene.illumination
        light = object_media(shared.imaging, polarised_seed(self.seed, shared.scene), number)
        seen = light.seen(shared.imaging.modes.new_tensor(beams.brightness)[None])[0, 0]
        return seen * mean_intensity(shared.correlation, beams.window.area)  # type: ignore[union-attr]


def stationary_renderer(prepared: Prepared, seed: Seed) -> StationaryRenderer:
    """Return media under a seed, with what is there already from other seeds of the same scene."""
    if estimated_under() is not None:
        return StationaryRenderer(prepared, seed)
    key = (
        prepared.scene, prepared.paths, prepared.form, prepared.tabulated, prepared.envelope is not None,
        prepared.streamed, prepared.complete,
    )  # fmt: skip
    return StationaryRenderer(PREPARED.get(key, lambda: prepared), seed)


def coherent_renderer(prepared: Prepared, seed: Seed) -> CoherentRenderer:
    """Return media behind which coherent objects are seen: of one object its light that has walked, of more modes.

    Through a lens, in films and behind analysers noise is mixed cell by cell.
    """
    from specklegen.memory_effects.correlation import MemoryEffectCorrelation
    from specklegen.memory_effects.walks import walks_of
    from specklegen.synthesis.coherent import (
        JointObjects,
        ManyObjects,
        OneObject,
        joint_objects,
        one_object,
        radial,
        wave_grid,
        wave_modes,
    )  # fmt: skip
    from specklegen.synthesis.correlations import Tabulated
    from specklegen.synthesis.stacks import mean_intensity

    def drawing(scene: Scene) -> tuple[OneObject | ManyObjects | JointObjects, np.ndarray]:
        grid, amplitudes = wave_grid(scene.illumination, scene.wavelength, scene.grid)
        correlation: Any = prepared.correlation
        intensity = mean_intensity(correlation, 1.0)
        if isinstance(correlation, MemoryEffectCorrelation) and not prepared.lens:
            if len(amplitudes) == 1:
                walk = radial(correlation, grid.lateral) if intensity else np.ones(grid.lateral.shape)
                return one_object(grid, amplitudes[0], walk, intensity), amplitudes
            modes = wave_modes(Tabulated([correlation]), grid)
            return ManyObjects(grid, modes, float(np.sqrt(intensity * grid.area))), amplitudes
        if isinstance(correlation, MemoryEffectCorrelation):
            whole = grid.around
            return joint_objects(grid, amplitudes, lambda *_: radial(correlation, whole), intensity), amplitudes
        walks, times = walks_of(correlation), getattr(scene.illumination, "times", None)
        lags = np.zeros((len(amplitudes),) * 2) if times is None else np.abs(np.subtract.outer(times, times))
        reduced, size = walks.reduced(scene.wavelength, lags), (grid.axes[0].size, grid.axes[1].size)
        spectrum = lru_cache(2 * len(amplitudes))(lambda x: walks.spectrum(grid.period, size, x))
        return joint_objects(grid, amplitudes, lambda t, o: spectrum(float(reduced[t, o])), intensity), amplitudes

    return CoherentRenderer(prepared.scene, drawing, seed)
