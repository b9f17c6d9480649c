"""Fields drawn from the covariance between lights and views, estimated once. For few lights and views of any scene."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from specklegen.core.budgets import DEFAULT_PATHS
from specklegen.core.decision import Decision
from specklegen.core.errors import reject
from specklegen.core.random_streams import Seed
from specklegen.core.statistics import BATCHES
from specklegen.paths.far_field import far_field_decision
from specklegen.paths.gaussianity import EXACT, Gaussianity
from specklegen.paths.pilot import Pilot, volume_pilot
from specklegen.paths.slab_tracer import BLOCK
from specklegen.samplers.covariance.covariance import Covariance, covariance
from specklegen.samplers.covariance.outer_products import AMPLITUDES, batches_side_by_side
from specklegen.samplers.sampler import FIXED_BYTES, RECORD_BYTES, Drawn, Where, Wish, image_of
from specklegen.scene.illumination import IncoherentObject, PointSources
from specklegen.scene.media import VoxelGrid
from specklegen.scene.scene import Scene
from specklegen.scene.sensors import NearField


def consider(scene: Scene, wish: Wish) -> tuple["Eigenfields", list[Decision]]:
    """Fields drawn from their covariance, for a scene that asks for it."""
    pilot = volume_pilot(scene, wish.reverse)
    paths = wish.paths
    if paths is None:
        paths = DEFAULT_PATHS if wish.rel_error is None else pilot.moments.paths_for(wish.rel_error)
    doubt = far_field_decision(scene)
    return Eigenfields(scene, paths, pilot, wish.reverse), [doubt] if doubt else []


@dataclass(frozen=True)
class Eigenfields:
    """Fields from the eigenvectors of a covariance; see :class:`specklegen.samplers.sampler.Sampler`."""

    scene: Scene
    paths: int
    pilot: Pilot
    reverse: bool

    name = "covariance"
    summation = "eigenvectors"
    error_of = "false intensity correlation"

    @property
    def expected_error(self) -> float:
        """Relative standard error of intensities, at the worst light and view."""
        return float(np.sqrt(self.pilot.moments.relative_variance / self.paths))

    @property
    def intensity(self) -> float:
        """Largest mean intensity among the pilot's lights and views."""
        return self.pilot.intensity

    @property
    def gaussianity(self) -> Gaussianity:
        """Gaussian by construction."""
        return EXACT

    def operations(self) -> Mapping[str, float]:
        """Of the covariance."""
        scene, ways = self.scene, 2 if self.pilot.tracer.bidirectional else 1
        lights, views = len(scene.lights), len(scene.views)
        connections = self.paths * self.pilot.connections_per_path
        pairs, both = float(lights * views), connections * ways
        near = both * (lights if isinstance(scene.illumination, PointSources) else 0)
        near += both * (views if isinstance(scene.sensor, NearField) else 0)
        events = self.paths * self.pilot.events_per_path
        crossed = max(scene.medium.extinction.shape) / 2 if isinstance(scene.medium, VoxelGrid) else 0.0
        return {
            "volume path": self.paths,
            "volume event": events,
            "voxel": (events + both * (lights + views)) * crossed,
            "volume connection": connections,
            "volume end": both * (lights + views) - near,
            "near end": near,
            "product": both * pairs * pairs / 2,
            "amplitude": both * pairs,
            "batch": min(BATCHES, self.paths),
        }

    def alternatives(self) -> Mapping[str, Mapping[str, float]]:
        """None that is comparable: the covariance itself is what costs."""
        return {}

    def memory(self, threads: int) -> int:
        """Bytes by which the process grows at most."""
        pairs = float(len(self.scene.lights) * len(self.scene.views))
        capacity = threads * 8 * min(self.paths, BLOCK) * RECORD_BYTES
        paths = min(self.paths / BATCHES, 8 * BLOCK) * self.pilot.connections_per_path
        amplitudes = min(paths * pairs, AMPLITUDES)
        beside = batches_side_by_side(int(pairs) ** 2, threads)
        waiting = 32 * pairs**2 * (1 if beside == 1 else 3 * beside)
        held = 3 * 16 * amplitudes + paths * RECORD_BYTES
        return int(capacity + held * beside + waiting + pairs**2 * (16 * 4 + 8 * 3) + FIXED_BYTES)

    def prepare(self, seed: Seed, threads: int | None) -> "EigenDraws":
        """Make ready to draw; the covariance is estimated at the first draw."""
        return EigenDraws(self, seed, threads)


@dataclass(frozen=True)
class EigenDraws:
    """Realizations drawn from a covariance under a seed."""

    sampler: Eigenfields
    seed: Seed
    threads: int | None

    @cached_property
    def covariance(self) -> Covariance:
        """Of all lights and views; an object's lights are its lit pixels, of unit brightness."""
        scene = self.sampler.scene
        if isinstance(scene.illumination, IncoherentObject):
            scene = scene.replace(illumination=scene.beams)
        return covariance(
            scene, paths=self.sampler.paths, seed=self.seed, reverse=self.sampler.reverse, orders="all",
            threads=self.threads,
        )  # fmt: skip

    def images(self, realizations: int) -> Iterator[Drawn]:
        """Drawn from the eigenvectors."""
        fields = self.covariance.sample(realizations, self.seed)
        unfinished = self.covariance.unfinished
        for n, field in enumerate(fields):
            yield Drawn(image_of(self.sampler.scene, field), 0, unfinished if n == 0 else 0)

    def pieces(self, realization: int) -> Iterator[tuple[Where, np.ndarray]]:
        """Refuse: what fits into a covariance needs no pieces."""
        reject("render_tiles sampler", '"paths" or "stationary"', self.sampler.name, "Use render.")
