"""The stationary sampler: the memory-effect correlation once, then one transform per realization.

Where narrow lobes keep light about its beam, each field is multiplied by an envelope that turns with the tilt.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from specklegen.core.budgets import DEFAULT_PATHS
from specklegen.core.decision import Decision
from specklegen.core.parallel import one_torch_thread
from specklegen.core.random_streams import Seed
from specklegen.paths.gaussianity import EXACT, Gaussianity
from specklegen.paths.pilot import Pilot, scene_pilot
from specklegen.samplers.sampler import FIXED_BYTES, Drawn, Where, Wish
from specklegen.samplers.stationary.envelope import Envelope
from specklegen.samplers.stationary.exit_grid import fft_flops, matrix_flops, stack_axes
from specklegen.samplers.stationary.rule import Kernel, scene_envelope, stationary_decision
from specklegen.scene.illumination import IncoherentObject, reference_direction
from specklegen.scene.scene import Scene
from specklegen.scene.sensors import FarFieldGrid

if TYPE_CHECKING:
    from specklegen.samplers.stationary.correlation import MemoryEffectCorrelation
    from specklegen.samplers.stationary.objects import ObjectSampler
    from specklegen.samplers.stationary.oblique import ObliqueCorrelation
    from specklegen.samplers.stationary.stacks import StackSampler

_TORCH_BYTES = 197 * 2**20  # what importing torch takes


def consider(scene: Scene, wish: Wish) -> tuple["Stationary | None", list[Decision]]:
    """The stationary sampler for a scene, where its correlations are right within the tolerance."""
    model, decision = stationary_decision(scene, wish)
    if model is None:
        return None, [decision]
    envelope = scene_envelope(scene, model.kernel == "oblique") if model.enveloped else None
    pilot = scene_pilot(scene, False)
    paths = wish.paths
    if paths is None:
        paths = DEFAULT_PATHS if wish.rel_error is None else pilot.moments.paths_for(wish.rel_error)
    return Stationary(scene, paths, model.kernel, pilot, wish.streamed, envelope), [decision]


@dataclass(frozen=True)
class Stationary:
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
    paths: int
    kernel: Kernel
    pilot: Pilot
    streamed: bool
    envelope: Envelope | None = None

    name = "stationary"
    summation = "FFT or matrix products"
    error_of = "intensity scale"
    reverse = False

    @property
    def expected_error(self) -> float:
        """Relative standard error of the intensity scale."""
        return float(np.sqrt(self.pilot.moments.relative_variance / self.paths))

    @property
    def intensity(self) -> float:
        """Largest mean intensity among the pilot's lights and views."""
        return self.pilot.intensity

    @property
    def gaussianity(self) -> Gaussianity:
        """Gaussian by construction."""
        return EXACT

    def _tracing(self) -> dict[str, float]:
        connections = self.paths * self.pilot.connections_per_path
        return {"path": self.paths, "event": self.paths * self.pilot.events_per_path, "connection": connections}

    def operations(self) -> Mapping[str, float]:
        """Of the correlation and of one stack; an object's modes are fewer than its beams, at most these."""
        grid = self.scene.sensor
        assert isinstance(grid, FarFieldGrid)
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
            return int(kernel + 8 * views * tilts * 4 + _TORCH_BYTES + FIXED_BYTES)
        x, y = stack_axes(self.scene)
        cells, period = float(x.count * y.count), float(x.period * y.period)
        return int(kernel + cells * (8 * tilts + 64) + 8 * 4 * period + 48 * views + _TORCH_BYTES + FIXED_BYTES)

    def prepare(self, seed: Seed, threads: int | None) -> "StationaryDraws":
        """Make ready to draw; the memory-effect correlation is estimated at the first draw."""
        return StationaryDraws(self, seed, threads)


@dataclass(frozen=True)
class StationaryDraws:
    """Realizations of the stationary sampler under a seed."""

    sampler: Stationary
    seed: Seed
    threads: int | None

    @cached_property
    def correlation(self) -> "MemoryEffectCorrelation | ObliqueCorrelation":
        """The memory-effect correlation."""
        from specklegen.samplers.stationary.correlation import estimate_correlation
        from specklegen.samplers.stationary.oblique import estimate_oblique_correlation

        scene, paths = self.sampler.scene, self.sampler.paths
        if self.sampler.kernel == "axial":
            return estimate_correlation(scene.slab, paths, self.seed, threads=self.threads)
        assert isinstance(scene.sensor, FarFieldGrid)
        light, view = reference_direction(scene.beams.directions), scene.sensor.center_direction
        return estimate_oblique_correlation(scene.slab, light, view, paths, self.seed, threads=self.threads)

    @cached_property
    def stacks(self) -> "StackSampler":
        """What draws stacks of tilted beams."""
        from specklegen.samplers.stationary.stacks import stack_sampler

        return stack_sampler(self.sampler.scene, self.correlation)

    @cached_property
    def objects(self) -> "ObjectSampler":
        """What draws images of an incoherent object."""
        from specklegen.samplers.stationary.correlation import MemoryEffectCorrelation
        from specklegen.samplers.stationary.objects import object_sampler

        scene = self.sampler.scene
        beams, grid = scene.illumination, scene.sensor
        assert isinstance(beams, IncoherentObject)
        assert isinstance(grid, FarFieldGrid)
        assert isinstance(self.correlation, MemoryEffectCorrelation)  # modes need the symmetry about the axis
        return object_sampler(
            self.correlation, wavelength=scene.wavelength, object_shape=beams.brightness.shape,
            object_pitch=beams.pitch, width=beams.width, profile=beams.profile, grid=grid,
        )  # fmt: skip

    def images(self, realizations: int) -> Iterator[Drawn]:
        """One transform each."""
        light = self.sampler.scene.illumination
        for r in range(realizations):
            with one_torch_thread():  # the white noise as well
                if isinstance(light, IncoherentObject):
                    image = self.objects.image(self.objects.medium(self.seed, r), light.brightness)
                else:
                    image = self.stacks.sample(self.seed, r)
            found = image.numpy()
            yield Drawn(found if self.sampler.envelope is None else found * self._gains)

    def pieces(self, realization: int) -> Iterator[tuple[Where, np.ndarray]]:
        """Tilt by tilt: the noise is held, no stack."""
        rows, columns = self.sampler.scene.sensor.shape
        for t, field in enumerate(self.stacks.one_by_one(self.seed, realization)):
            found = field.numpy()
            if self.sampler.envelope is not None:
                found = found * self._gain(t)
            yield (slice(t, t + 1), slice(0, rows), slice(0, columns)), found

    @cached_property
    def _gains(self) -> np.ndarray:
        """A of every tilt and view, float32[T, H, W]."""
        return np.stack([self._gain(t) for t in range(len(self.sampler.scene.beams.directions))])

    def _gain(self, t: int) -> np.ndarray:
        """A of one tilt, float32[H, W]."""
        scene, envelope = self.sampler.scene, self.sampler.envelope
        assert envelope is not None
        assert isinstance(scene.sensor, FarFieldGrid)
        views = np.stack(np.meshgrid(*scene.sensor.sines), axis=-1)
        return np.sqrt(envelope.intensity(scene.beams.directions[t, :2], views)).astype(np.float32)
