"""Rendering: the whole pipeline on one page.

Scene -> plan -> trace -> PathBank -> field sums -> fields           ("paths")
Scene -> plan -> memory-effect kernel -> stationary sampler -> fields    ("stationary")
Scene -> plan -> covariance -> eigenvectors -> fields                    ("covariance")

Beams through a slab have an engine of their own; any other geometry goes through ``specklegen.pathspace``.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from itertools import islice
from typing import TYPE_CHECKING

import numpy as np

from specklegen.core.arguments import instance, whole_number
from specklegen.core.budgets import checked_budget, paths_for
from specklegen.core.decision import Decision
from specklegen.core.errors import reject
from specklegen.core.parallel import Threads, in_turn, one_blas_thread, thread_count
from specklegen.core.random_streams import Seed, pilot_seed
from specklegen.core.showing import summary
from specklegen.mean.field import mean_field
from specklegen.paths.bank import PathBank
from specklegen.paths.gaussianity import Gaussianity
from specklegen.paths.reversal import Reverse
from specklegen.paths.slab_optics import Optics, random_phases
from specklegen.paths.slab_tracer import trace
from specklegen.paths.tracer import scene_tracer
from specklegen.planning.planning import Plan, plan
from specklegen.samplers.covariance.covariance import covariance
from specklegen.samplers.path_sums.direct import direct_field
from specklegen.samplers.path_sums.nufft import nufft_field
from specklegen.samplers.path_sums.volume_field import volume_field
from specklegen.samplers.sampler import Sampler
from specklegen.scene.illumination import IncoherentObject, reference_direction
from specklegen.scene.scene import Scene
from specklegen.scene.sensors import FarFieldGrid

if TYPE_CHECKING:
    from specklegen.samplers.stationary.correlation import MemoryEffectCorrelation
    from specklegen.samplers.stationary.oblique import ObliqueCorrelation
    from specklegen.samplers.stationary.stacks import StackSampler


@dataclass(frozen=True)
class Report:
    """What a render did.

    Attributes
    ----------
    sampler, summation : str
        As in :class:`specklegen.planning.planning.Plan`.
    paths : int
        Paths traced a realization (or once, for the stationary sampler's kernel).
    connections : int
        Connections kept, over all realizations.
    unfinished : int
        Paths ended by ``max_order`` instead of leaving the medium; not 0 only in extreme media.
    expected_error : float
        As in the plan.
    gaussianity : Gaussianity
        Whether the stack used enough paths to be Gaussian speckle, as in the plan.
    mean_added : bool
        Whether the mean field is part of ``field``.
    decisions : tuple of Decision
        What was used and what left out, with reasons.
    """

    sampler: str
    summation: str
    paths: int
    connections: int
    unfinished: int
    expected_error: float
    gaussianity: Gaussianity
    mean_added: bool
    decisions: tuple[Decision, ...]


class SpeckleStack:
    """Rendered speckle: ``field`` complex64[(R,) T, *sensor], ``intensity`` float32, ``report``.

    The intensity of collimated beams is |field|^2, tilt by tilt. An incoherent object has one intensity
    image, float32[(R,) *sensor], and no field.
    """

    def __init__(self, field: np.ndarray | None, intensity: np.ndarray | None, report: Report) -> None:
        self._field, self._intensity, self.report = field, intensity, report

    def __repr__(self) -> str:
        held = {"intensity": self._intensity} if self._field is None else {"field": self._field}
        return summary(self, **held, sampler=self.report.sampler, paths=self.report.paths)

    @property
    def field(self) -> np.ndarray:
        """complex64[(R,) T, *sensor.shape]; |u|^2 is area per steradian for unit irradiance."""
        if self._field is None:
            reject(
                "SpeckleStack.field",
                "asked of coherent illumination",
                "IncoherentObject",
                "Its beams are mutually incoherent, so intensities add and no one field exists: use .intensity.",
            )
        return self._field

    @property
    def intensity(self) -> np.ndarray:
        """float32, |field|^2 or the image of an incoherent object."""
        if self._intensity is not None:
            return self._intensity
        return np.square(self.field.real) + np.square(self.field.imag)


def render(
    scene: Scene,
    *,
    paths: int | None = None,
    rel_error: float | None = None,
    seconds: float | None = None,
    seed: Seed = 0,
    realizations: int | None = None,
    sampler: Sampler = "auto",
    reverse: Reverse = "auto",
    mean: bool = False,
    field_tolerance: float = 1e-3,
    threads: int | None = None,
) -> SpeckleStack:
    """Render correlated speckle of one medium (or of several) at every tilt and view of a scene.

    A pure function of its arguments but ``threads``. Realization r of seed s is medium (s, r), whatever
    their number. ``field`` is u - m unless ``mean``.

    Parameters
    ----------
    scene, paths, rel_error, sampler, reverse, field_tolerance
        See :func:`specklegen.plan`.
    seconds
        Instead of ``paths``, or as a limit to ``rel_error``: as many paths as this time allows here, planning left
        out. The count, which the report states, is fixed before the run and gives the same bits as ``paths=`` it.
    seed
        A whole number, or a sequence of them.
    realizations
        Number of media; None renders one and drops the axis.
    mean
        Add the mean field m.
    threads
        Threads; by default all cores this process may run on.

    Returns
    -------
    SpeckleStack
        ``.field``, ``.intensity``, ``.report``.

    Raises
    ------
    RuleError
        See :func:`specklegen.plan`.
    """
    instance("render scene", scene, Scene)
    if realizations is not None:
        whole_number("render realizations", realizations, 1)
    if mean and isinstance(scene.illumination, IncoherentObject):
        reject("mean", "False for an incoherent object", mean, "Its ballistic image is not modelled.")
    checked_budget("render", paths, rel_error, seconds)
    choose = partial(
        plan, scene, sampler=sampler, reverse=reverse, mean=mean, field_tolerance=field_tolerance, threads=threads
    )
    if seconds is not None:
        paths = _paths_within(choose, rel_error, seconds / (realizations or 1), threads)
        rel_error = None
    made = choose(paths=paths, rel_error=rel_error)
    images, connections, unfinished = _draw(made, seed, realizations or 1, threads)
    if mean:
        images = images + mean_field(scene).astype(np.complex64)
    if realizations is None:
        images = images[0]
    report = Report(
        made.sampler,
        made.summation,
        made.paths,
        connections,
        unfinished,
        made.expected_error,
        made.gaussianity,
        mean,
        made.decisions,
    )
    if isinstance(scene.illumination, IncoherentObject):
        return SpeckleStack(None, images, report)
    return SpeckleStack(images, None, report)


def _draw(made: Plan, seed: Seed, realizations: int, threads: int | None) -> tuple[np.ndarray, int, int]:
    """Images of every realization, connections kept and paths unfinished, by the sampler that was planned."""
    sampler = {"stationary": _stationary, "covariance": _covariance, "paths": _paths}[made.sampler]
    return sampler(made, seed, realizations, threads)


def _paths_within(
    choose: Callable[..., Plan], rel_error: float | None, seconds: float, threads: int | None
) -> int:
    """Paths that a time allows, or those of an error if they are fewer; pilots run under a seed of their own."""

    def pilot(count: int) -> float:
        made = choose(paths=count)
        _draw(made, pilot_seed(made.scene.fingerprint()), 1, threads)
        return made.expected_error

    allowed = paths_for(0, None, None, seconds, pilot)
    return allowed if rel_error is None else min(allowed, choose(rel_error=rel_error).paths)


def _paths(made: Plan, seed: Seed, realizations: int, threads: int | None) -> tuple[np.ndarray, int, int]:
    """Algorithms 2 and 4: fresh paths and phases for every realization, summed chunk by chunk in a fixed order."""
    scene, chunks = made.scene, made.chunks.slices
    chunk_field = _volume_chunk(made) if made.proposal is None else _slab_chunk(made)
    shape = (len(scene.lights), *scene.sensor.shape)
    jobs = ((r, chunk) for r in range(realizations) for chunk in chunks)
    members = thread_count(threads)
    beside = made.chunks.side_by_side(members, float(np.prod(shape)), realizations)
    images, connections, unfinished = [], 0, 0
    with one_blas_thread():
        parts = in_turn(lambda job, crew: chunk_field(seed, *job, crew), jobs, members, beside)
        for _ in range(realizations):
            field = np.zeros(shape, made.field_dtype)
            for part, bank in islice(parts, len(chunks)):
                field += part.reshape(shape)
                connections += len(bank)
                unfinished += bank.unfinished
            images.append(_image(scene, field))
    return np.stack(images), connections, unfinished


ChunkField = Callable[[Seed, int, slice, Threads], tuple[np.ndarray, PathBank]]
"""(seed, realization, paths, threads) -> what a chunk of paths adds to the field, and its connections."""


def _slab_chunk(made: Plan) -> ChunkField:
    """Chunks of beams through a slab."""
    scene, proposal = made.scene, made.proposal
    assert proposal is not None
    optics, views = Optics.of_scene(scene), scene.views

    def field(seed: Seed, sample: int, chunk: slice, threads: Threads) -> tuple[np.ndarray, PathBank]:
        count = chunk.stop - chunk.start
        bank = trace(scene.slab, proposal, seed, count, first=chunk.start, sample=sample, threads=threads)
        phases = random_phases(bank, seed, sample, threads=threads)
        if made.nufft:
            part = nufft_field(bank, optics, phases, made.nufft, threads=threads)
        else:
            part = direct_field(bank, optics, phases, views, reverse=made.reverse, threads=threads)
        return part * math.sqrt(count / made.paths), bank

    return field


def _volume_chunk(made: Plan) -> ChunkField:
    """Chunks in any geometry."""
    tracer = scene_tracer(made.scene, made.reverse)

    def field(seed: Seed, sample: int, chunk: slice, threads: Threads) -> tuple[np.ndarray, PathBank]:
        count = chunk.stop - chunk.start
        bank = tracer.trace(seed, count, first=chunk.start, sample=sample, threads=threads)
        part = volume_field(tracer, bank, seed, sample, reverse=made.reverse, threads=threads)
        return part * math.sqrt(count / made.paths), bank

    return field


def _covariance(made: Plan, seed: Seed, realizations: int, threads: int | None) -> tuple[np.ndarray, int, int]:
    """Algorithms 1 and 3 once, then every realization from the eigenvectors."""
    scene = made.scene
    if isinstance(scene.illumination, IncoherentObject):
        scene = scene.replace(illumination=scene.beams)  # whose intensities are added with their brightness
    found = covariance(scene, paths=made.paths, seed=seed, reverse=made.reverse, orders="all", threads=threads)
    return np.stack([_image(made.scene, field) for field in found.sample(realizations, seed)]), 0, found.unfinished


def _image(scene: Scene, field: np.ndarray) -> np.ndarray:
    """Field [T, ...] of one medium as complex64[T, *sensor], or the image float32[*sensor] of an incoherent object."""
    field = field.reshape(len(field), *scene.sensor.shape)
    if not isinstance(scene.illumination, IncoherentObject):
        return field.astype(np.complex64)
    brightness = scene.illumination.brightness
    power = np.square(field.real) + np.square(field.imag)
    return np.tensordot(brightness[brightness > 0], power, axes=1).astype(np.float32)


def _stationary(made: Plan, seed: Seed, realizations: int, threads: int | None) -> tuple[np.ndarray, int, int]:
    """The memory-effect kernel once, then one transform per realization."""
    from specklegen.samplers.stationary.correlation import MemoryEffectCorrelation
    from specklegen.samplers.stationary.objects import object_sampler

    scene, beams, grid = made.scene, made.scene.illumination, made.scene.sensor
    if isinstance(beams, IncoherentObject) and isinstance(grid, FarFieldGrid):
        kernel = stationary_correlation(made, seed, threads)
        assert isinstance(kernel, MemoryEffectCorrelation)  # an object's modes need the symmetry about the axis
        objects = object_sampler(
            kernel, wavelength=scene.wavelength, object_shape=beams.brightness.shape, object_pitch=beams.pitch,
            width=beams.width, profile=beams.profile, grid=grid,
        )  # fmt: skip
        images = [objects.image(objects.medium(seed, r), beams.brightness).numpy() for r in range(realizations)]
    else:
        stacks = stationary_stacks(made, seed, threads)
        images = [stacks.sample(seed, r).numpy() for r in range(realizations)]
    return np.stack(images), 0, 0


def stationary_stacks(made: Plan, seed: Seed, threads: int | None) -> "StackSampler":
    """The sampler of a plan's stacks; its memory-effect kernel is estimated here."""
    from specklegen.samplers.stationary.stacks import stack_sampler

    return stack_sampler(made.scene, stationary_correlation(made, seed, threads))


def stationary_correlation(
    made: Plan, seed: Seed, threads: int | None
) -> "MemoryEffectCorrelation | ObliqueCorrelation":
    """The memory-effect kernel of a plan: of the axis, or of the direction of its beams and views."""
    from specklegen.samplers.stationary.correlation import estimate_correlation
    from specklegen.samplers.stationary.oblique import estimate_oblique_correlation

    scene, grid = made.scene, made.scene.sensor
    if made.kernel == "oblique":
        assert isinstance(grid, FarFieldGrid)
        light = reference_direction(scene.beams.directions)
        return estimate_oblique_correlation(scene.slab, light, grid.center_direction, made.paths, seed, threads=threads)
    return estimate_correlation(scene.slab, made.paths, seed, threads=threads)
