"""The stationary sampler: the memory-effect correlation once, then one transform per realization.

Where narrow lobes keep light about its beam, each field is multiplied by an envelope that turns with the tilt.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Self

import numpy as np

from specklegen.core.budgets import DEFAULT_PATHS
from specklegen.core.decision import Decision
from specklegen.core.parallel import one_torch_thread
from specklegen.core.random_streams import Seed
from specklegen.paths.endpoints import AXIS
from specklegen.paths.pilot import Pilot, scene_pilot
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
from specklegen.samplers.stationary.rule import Kernel, scene_envelope, stationary_decision
from specklegen.scene.illumination import IncoherentObject, reference_direction
from specklegen.scene.motion import fastest
from specklegen.scene.scene import Scene
from specklegen.synthesis.exit_grid import fft_flops, matrix_flops, stack_axes

if TYPE_CHECKING:
    import torch

    from specklegen.memory_effects.correlation import MemoryEffectCorrelation
    from specklegen.memory_effects.film import FilmCorrelation
    from specklegen.memory_effects.oblique import ObliqueCorrelation
    from specklegen.synthesis.imaging import Imaging
    from specklegen.synthesis.stacks import StackSampler


@dataclass(frozen=True)
class Stationary(Sampler, name="stationary"):
    """The stationary sampler of a scene, dimensioned; see :class:`specklegen.samplers.sampler.Sampler`.

    Attributes
    ----------
    scene : Scene
    paths : int
        Paths that estimate the memory-effect correlation, once.
    kernel : "axial" or "oblique"
        The correlation of the axis, or about the middle of the beams and views.
    pilot : Pilot
    streamed : bool
        Whether the stack comes tilt by tilt.
    envelope : Envelope or None
        Of the intensities, where they are not the same everywhere.
    """

    scene: Scene
    paths: int = field()  # given, whatever the base has
    kernel: Kernel
    pilot: Pilot
    streamed: bool
    envelope: Envelope | None = None

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
        rest = scene.at_rest  # a film's tilts are judged without its times
        model, decision = stationary_decision(rest, request)
        if model is None:
            return None, [decision]
        envelope = scene_envelope(rest, model.kernel == "oblique") if model.enveloped else None
        pilot = scene_pilot(rest, False)
        paths = request.paths
        if paths is None:
            paths = DEFAULT_PATHS if request.rel_error is None else pilot.moments.paths_for(request.rel_error)
        return cls(scene, paths, model.kernel, pilot, request.streamed, envelope), [decision]

    @property
    def expected_error(self) -> float:
        """Relative standard error of the intensity scale."""
        return float(np.sqrt(self.pilot.moments.relative_variance / self.paths))

    @property
    def intensity(self) -> float:
        """Largest mean intensity among the pilot's lights and views."""
        return self.pilot.intensity

    def _tracing(self) -> dict[str, float]:
        connections = self.paths * self.pilot.connections_per_path
        return {"path": self.paths, "event": self.paths * self.pilot.events_per_path, "connection": connections}

    def operations(self) -> Mapping[str, float]:
        """Of the correlation and of one stack; an object's modes are fewer than its beams, at most these."""
        grid = self.scene.grid
        x, y = stack_axes(self.scene)
        tilts, views = len(self.scene.beams.directions), np.prod(grid.shape)
        size = x.count * y.count
        phasors = self.paths * self.pilot.connections_per_path if self.kernel == "oblique" else 0.0
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
        tilts, views = len(self.scene.beams.directions), float(np.prod(self.scene.sensor.shape))
        kernel = self.paths * self.pilot.connections_per_path * 160
        if self.envelope is not None:
            kernel += views * (64 + 4 * (1 if self.streamed else tilts))
        if not self.streamed:
            return int(kernel + 8 * views * tilts * 4 + TORCH_BYTES + FIXED_BYTES)
        x, y = stack_axes(self.scene)
        cells, period = float(x.count * y.count), float(x.period * y.period)
        return int(kernel + cells * (8 * tilts + 64) + 8 * 4 * period + 48 * views + TORCH_BYTES + FIXED_BYTES)

    def prepare_media(self, request: MediaRequest) -> "list[tuple[list[int], Imaging]]":
        """Make media ready, whose memory effect is known."""
        from specklegen.synthesis.imaging import imagings

        return imagings(
            request.sight, request.correlations, request.light, tolerance=request.tolerance, film=request.film
        )

    def prepare(self, seed: Seed, threads: int | None) -> "StationaryRenderer":
        """Make ready to draw; the memory-effect correlation is estimated at the first draw."""
        return StationaryRenderer(self, seed, threads)


@dataclass(frozen=True)
class StationaryRenderer:
    """Media of the stationary sampler under a seed."""

    sampler: Stationary
    seed: Seed
    threads: int | None

    @cached_property
    def correlation(self) -> "MemoryEffectCorrelation | ObliqueCorrelation | FilmCorrelation":
        """The memory-effect correlation, of a film that in time as well."""
        from specklegen.memory_effects.correlation import estimate_correlation
        from specklegen.memory_effects.oblique import estimate_oblique_correlation

        scene, paths = self.sampler.scene, self.sampler.paths
        if scene.film:
            return self._film
        if self.sampler.kernel == "axial":
            return estimate_correlation(scene.slab, paths, self.seed, threads=self.threads)
        light, view = reference_direction(scene.beams.directions), scene.grid.center_direction
        return estimate_oblique_correlation(scene.slab, light, view, paths, self.seed, threads=self.threads)

    @property
    def _film(self) -> "FilmCorrelation":
        """Of the light and view in the middle, as if at rest."""
        from specklegen.memory_effects.film import FilmCorrelation
        from specklegen.memory_effects.oblique import estimate_oblique_correlation

        scene, axial = self.sampler.scene, self.sampler.kernel == "axial"
        light, view = reference_direction(scene.at_rest.beams.directions), scene.grid.center_direction
        ends = (AXIS, AXIS) if axial else (light, view)
        ways = estimate_oblique_correlation(
            scene.slab, *ends, self.sampler.paths, self.seed, transfer=True, threads=self.threads
        )
        found = fastest(scene.slab.motions)
        assert found is not None, "a film is of a medium that moves"
        return FilmCorrelation(ways, found[0], np.asarray(scene.beams.times), axial)

    @cached_property
    def stacks(self) -> "StackSampler":
        """What draws stacks of tilted beams."""
        from specklegen.memory_effects.film import causal_root
        from specklegen.synthesis.stacks import stack_sampler, tilt_roots

        scene = self.sampler.scene
        return stack_sampler(scene, self.correlation, roots=causal_root if scene.film else tilt_roots)

    @cached_property
    def imaging(self) -> "Imaging":
        """What images an incoherent object."""
        from specklegen.memory_effects.correlation import MemoryEffectCorrelation
        from specklegen.synthesis.objects import object_imaging

        scene = self.sampler.scene
        beams, grid = scene.illumination, scene.grid
        assert isinstance(beams, IncoherentObject)
        assert isinstance(self.correlation, MemoryEffectCorrelation)  # modes need the symmetry about the axis
        return object_imaging(
            self.correlation, wavelength=scene.wavelength, object_shape=beams.brightness.shape,
            object_pitch=beams.pitch, width=beams.width, profile=beams.profile, grid=grid,
        )  # fmt: skip

    def media(self, count: int) -> Iterator[Realization]:
        """One transform each."""
        scene = self.sampler.scene
        hidden = scene.illumination.images == ()
        for number in range(count):
            with one_torch_thread():  # the white noise as well
                found = (self._image(number) if hidden else self.stacks.sample(self.seed, number)).numpy()
            found = found if self.sampler.envelope is None else found * self._gains
            yield Realization(found if hidden or scene.illumination.coherent else image_of(scene, found))

    def fields(self, number: int) -> Iterator[tuple[Where, np.ndarray]]:
        """Tilt by tilt: the noise is held, no stack."""
        rows, columns = self.sampler.scene.sensor.shape
        for t, drawn in enumerate(self.stacks.one_by_one(self.seed, number)):
            found = drawn.numpy()
            if self.sampler.envelope is not None:
                found = found * self._gain(t)
            yield (slice(t, t + 1), slice(0, rows), slice(0, columns)), found

    def _image(self, number: int) -> "torch.Tensor":
        from specklegen.synthesis.objects import object_media
        from specklegen.synthesis.stacks import mean_intensity

        beams = self.sampler.scene.illumination
        light = object_media(self.imaging, self.seed, number)
        seen = light.seen(self.imaging.modes.new_tensor(beams.brightness)[None])[0, 0]
        return seen * mean_intensity(self.correlation, beams.window.area)  # type: ignore[union-attr]

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
