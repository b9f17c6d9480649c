"""Fields drawn from the covariance between lights and views, estimated once. For few lights and views of any scene."""

import math
from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Self

import numpy as np

from specklegen.core.decision import Decision
from specklegen.core.errors import reject
from specklegen.core.nanoseconds import Cost
from specklegen.core.random_streams import Seed
from specklegen.core.statistics import BATCHES
from specklegen.paths.bank import BLOCK
from specklegen.paths.far_field import far_field_decision
from specklegen.paths.pilot import Pilot, volume_pilot
from specklegen.samplers.covariance.cost import MOST_PAIRS, covariance_operations, eigen_operations, field_operations
from specklegen.samplers.covariance.covariance import Covariance, covariance
from specklegen.samplers.covariance.outer_products import AMPLITUDES, batches_side_by_side
from specklegen.samplers.sampler import (
    FIXED_BYTES,
    RECORD_BYTES,
    Abilities,
    Realization,
    Request,
    Sampler,
    Where,
    image_of,
)
from specklegen.scene.scene import Scene, require_no_film, require_no_focus


def unasked_obstacle(scene: Scene, request: Request) -> str | None:
    """Why nobody thinks of a covariance who does not ask for it; None where one may."""
    if scene.film or scene.illumination.focused or scene.sensor.focused:
        return "films and lenses need path sums or the stationary sampler"
    if request.streamed or not request.envelope:
        return "pieces and media of recipes are not drawn from a covariance"
    if len(scene.lights) * math.prod(scene.sensor.shape) > MOST_PAIRS:
        return f"more than {MOST_PAIRS} lights times views"
    return None


def least_operations(scene: Scene, pilot: Pilot, paths: int) -> Mapping[str, float]:
    """Operations of a covariance as any pilot of a scene predicts them, before one of its own is traced."""
    pairs = float(len(scene.lights) * math.prod(scene.sensor.shape))
    operations = Counter(covariance_operations(scene, pilot, paths))
    operations.update(eigen_operations(pairs))
    return operations


@dataclass(frozen=True)
class Eigenfields(Sampler, name="covariance"):
    """Fields from the eigenvectors of a covariance; see :class:`specklegen.samplers.sampler.Sampler`."""

    scene: Scene
    paths: int = field()  # given, whatever the base has
    pilot: Pilot
    reverse: bool

    summation = "eigenvectors"
    error_of = "false intensity correlation"
    abilities = Abilities(media="volumes")

    @classmethod
    def propose(cls, scene: Scene, request: Request) -> tuple[Self | None, list[Decision]]:
        """Fields drawn from their covariance, for a scene that asks for it, or of few lights and views."""
        if request.asked != cls.name and unasked_obstacle(scene, request):
            return None, []
        require_no_film("covariance", scene)
        require_no_focus("covariance", scene)
        pilot = volume_pilot(scene, request.reverse)
        doubt = far_field_decision(scene)
        return cls(scene, request.paths_by(pilot.moments), pilot, request.reverse), [doubt] if doubt else []

    @property
    def expected_error(self) -> float:
        """Relative standard error of intensities, at the worst light and view."""
        return float(np.sqrt(self.pilot.moments.relative_variance / self.paths))

    @property
    def intensity(self) -> float:
        """Largest mean intensity among the pilot's lights and views."""
        return self.pilot.intensity

    def cost(self) -> Cost:
        """Count the operations of the covariance and its eigenvectors, once, and of one field."""
        pairs = float(len(self.scene.lights) * len(self.scene.views))
        once = covariance_operations(self.scene, self.pilot, self.paths) | eigen_operations(pairs)
        first = Counter(once)
        first.update(field_operations(pairs))
        return Cost(first, once)

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

    def prepare(self, seed: Seed, threads: int | None) -> "EigenRenderer":
        """Make ready to draw; the covariance is estimated at the first draw."""
        return EigenRenderer(self, seed, threads)


@dataclass(frozen=True)
class EigenRenderer:
    """Media drawn from a covariance under a seed."""

    sampler: Eigenfields
    seed: Seed
    threads: int | None

    @cached_property
    def covariance(self) -> Covariance:
        """Covariance of all lights and views; an object's lights are its lit pixels, of unit brightness."""
        scene = self.sampler.scene
        if not scene.illumination.coherent:
            scene = scene.replace(illumination=scene.beams)
        return covariance(scene, paths=self.sampler.paths, seed=self.seed, reverse=self.sampler.reverse, orders="all",
                          threads=self.threads)  # fmt: skip

    def media(self, count: int) -> Iterator[Realization]:
        """Drawn from the eigenvectors."""
        unfinished = self.covariance.unfinished
        for n, drawn in enumerate(self.covariance.sample(count, self.seed)):
            yield Realization(image_of(self.sampler.scene, drawn), 0, unfinished if n == 0 else 0)

    def fields(self, number: int) -> Iterator[tuple[Where, np.ndarray]]:
        """Refuse: what fits into a covariance needs no pieces."""
        reject("render_tiles sampler", '"paths" or "stationary"', self.sampler.name, "Use render.")
