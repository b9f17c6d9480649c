"""Planning: scene and budget -> Plan, from a pilot and counted operations, never from a clock.

Each gate is a function beside its physics that returns a :class:`Verdict`; the planner folds them. A plan
is a pure function of the scene and the arguments: pilots are keyed by the scene's fingerprint. Predicted
seconds may differ between machines, choices may not.
"""

from dataclasses import dataclass

import numpy as np

from specklegen.costs import VolumeWork, Work, memory_bytes, seconds, volume_memory_bytes, volume_seconds
from specklegen.fields.nufft import SINGLE_PRECISION_FROM, NufftEvaluator
from specklegen.gates import Reverse, Sampler, Verdict, reversal_verdict
from specklegen.gaussianity import EXACT, Gaussianity
from specklegen.illumination import CollimatedBeams, IncoherentObject
from specklegen.mean import ballistic_fraction
from specklegen.media import Medium, VoxelGrid
from specklegen.parallel import thread_count
from specklegen.pathspace.gates import scene_reversal, slab_engine_obstacle
from specklegen.pathspace.pilots import volume_pilot
from specklegen.pathspace.tracing import scene_tracer
from specklegen.pilots import scene_pilot
from specklegen.scene import Scene
from specklegen.sensors import FarFieldGrid, require_resolved
from specklegen.tracing import Proposal
from specklegen.values import available_memory, reject
from specklegen.verdicts import (
    evaluator_verdict,
    mean_verdict,
    stationary_verdict,
    validity_verdicts,
    volume_mean_verdict,
)

DEFAULT_PATHS = 100_000
STATIONARY_TOLERANCE = 0.02


@dataclass(frozen=True)
class Plan:
    """What a render will do, what it leaves out and why, and what that costs.

    Attributes
    ----------
    scene : Scene
    paths : int
        Paths to trace a realization ("paths"), or once for the memory-effect kernel ("stationary").
    sampler, evaluator : str
        "paths" with "nufft" or "direct", "covariance" with "eigenvectors", or "stationary".
    reverse, mean : bool
        Whether reversed paths and the mean field take part.
    verdicts : tuple of Verdict
        Every gate, with its reason.
    proposal : Proposal or None
        How paths are drawn through a slab; None where the general engine serves (any geometry).
    nufft : NufftEvaluator or None
        The view factors, where the NUFFT is used.
    expected_error : float
        Root of the excess correlation of intensities from a finite number of paths, at the worst view
        ("paths"); relative standard error of the intensity scale ("stationary").
    gaussianity : Gaussianity
        Whether so many paths make Gaussian speckle.
    connections_per_path, events_per_path : float
        From the pilot.
    seconds : float
        Predicted for one realization on this many threads, the sampler's preparation included.
    memory_bytes : int
        Predicted peak growth of the process.
    """

    scene: Scene
    paths: int
    sampler: str
    evaluator: str
    reverse: bool
    mean: bool
    verdicts: tuple[Verdict, ...]
    proposal: Proposal | None
    nufft: NufftEvaluator | None
    expected_error: float
    gaussianity: Gaussianity
    connections_per_path: float
    events_per_path: float
    seconds: float
    memory_bytes: int

    @property
    def field_dtype(self) -> type:
        """Precision in which fields are summed."""
        return np.complex64 if self.nufft and self.nufft.tolerance >= SINGLE_PRECISION_FROM else np.complex128

    def explain(self) -> str:
        """Tell in words what will be done, what is left out and why, and what it will cost."""
        shape = "x".join(str(n) for n in self.scene.sensor.shape)
        lines = [
            f"{_described(self.scene.medium)}; {len(self.scene.lights)} "
            f"{_LIGHTS.get(type(self.scene.illumination).__name__, 'tilts')}, {shape} views.",
            f"Sampler: {self.sampler} ({self.evaluator}), {self.paths} paths.",
        ]
        lines += [f"- {v.part}: {'used' if v.needed else 'left out'}: {v.reason}." for v in self.verdicts]
        what = "intensity scale" if self.sampler == "stationary" else "false intensity correlation"
        lines += [
            f"Expected error ({what}, relative): {self.expected_error:.2g}.",
            f"Speckle: {self.gaussianity}",
            f"Cost: about {self.seconds:.2g} s for the first realization, {self.memory_bytes / 2**20:.0f} MiB.",
        ]
        if isinstance(self.scene.illumination, CollimatedBeams | IncoherentObject):
            lines.append(f"Ballistic fraction: {ballistic_fraction(self.scene):.2g}.")
        return "\n".join(lines)


def plan(
    scene: Scene,
    *,
    paths: int | None = None,
    rel_error: float | None = None,
    sampler: Sampler = "auto",
    reverse: Reverse = "auto",
    mean: bool = False,
    field_tolerance: float = 1e-3,
    streamed: bool = False,
    threads: int | None = None,
) -> Plan:
    """Choose how to render a scene, and predict what it costs.

    Parameters
    ----------
    scene
        What to simulate.
    paths
        Paths a realization; 100 000 unless ``rel_error`` sets it.
    rel_error
        Instead of ``paths``: the square root of the excess correlation between intensities that a finite
        number of paths leaves, at the worst view: sqrt(Var w / (N (E w)^2)), w the full weight of a path. This
        is for views far apart; within a grain of each other the connections of one path, which share their
        entrance, add up to as much again (:func:`specklegen.partially_coherent.finite_path_excess`). Also
        the tolerance of the criterion for the stationary sampler, which is 0.02 otherwise.
    sampler
        "auto", or one of "paths", "covariance", "stationary". "covariance" (few lights and views) estimates
        the covariance once and draws every realization from its eigenvectors.
    reverse
        Coherent backscattering: True, False or "auto".
    mean
        Whether the mean field will be added.
    field_tolerance
        Relative error of the NUFFT evaluator against the direct sum.
    streamed
        State, and hold against the memory there is, what :func:`specklegen.render_tiles` holds at a time.
    threads
        Threads for the prediction of seconds.

    Raises
    ------
    RuleError
        For an argument out of range, a grid that undersamples the speckle, a sampler that cannot serve
        the scene, or a render that would not fit into memory.
    """
    if paths is not None and rel_error is not None:
        reject("plan paths", "left out where rel_error is given", paths)
    if paths is not None and not isinstance(paths, int | np.integer):
        reject("paths", "a whole number", paths)
    if paths is not None and paths < 1:
        reject("paths", "at least 1", paths)
    if rel_error is not None and not 0 < rel_error < 1:
        reject("rel_error", "between 0 and 1", rel_error)
    if not 0 < field_tolerance < 1:
        reject("field_tolerance", "between 0 and 1", field_tolerance)
    if sampler not in ("auto", "paths", "covariance", "stationary"):
        reject("sampler", 'one of "auto", "paths", "covariance", "stationary"', sampler)
    tolerance = rel_error if rel_error is not None else STATIONARY_TOLERANCE
    grid = scene.sensor
    if isinstance(grid, FarFieldGrid) and isinstance(scene.illumination, CollimatedBeams | IncoherentObject):
        require_resolved("FarFieldGrid.pitch", scene.wavelength, scene.beams.width, grid.pitch)

    obstacle = slab_engine_obstacle(scene)
    if obstacle or sampler == "covariance":
        return _plan_volume(scene, obstacle, paths, rel_error, sampler, reverse, mean, tolerance, threads)

    # The stack and its views alone, before the gates below build an array of all views.
    if not streamed:
        _require_memory(scene, int(np.prod(scene.sensor.shape, dtype=float)) * (8 * len(scene.lights) + 48))
    verdicts = list(validity_verdicts(scene))
    reversal = reversal_verdict(
        scene.medium.mean_free_path, scene.wavelength, scene.lights, scene.views, reverse, tolerance
    )
    verdicts += [reversal, mean_verdict(scene, mean, tolerance)]
    pilot = scene_pilot(scene, reversal.needed)
    if paths is None:
        paths = DEFAULT_PATHS if rel_error is None else pilot.moments.paths_for(rel_error)
    stationary = stationary_verdict(scene, reversal.needed, sampler, tolerance)
    verdicts.append(stationary)

    nufft = None
    evaluator = "FFT or matrix products"
    if not stationary.needed:
        nufft, verdict = evaluator_verdict(scene, pilot, field_tolerance, reversal.needed)
        verdicts.append(verdict)
        evaluator = "nufft" if nufft else "direct"
    work = Work(
        scene=scene,
        paths=paths,
        events_per_path=pilot.bank.events / max(pilot.bank.count, 1),
        connections_per_path=len(pilot.bank) / max(pilot.bank.count, 1),
        stationary=stationary.needed,
        nufft=nufft,
        reverse=reversal.needed,
        streamed=streamed,
    )
    needed = memory_bytes(work, thread_count(threads))
    _require_memory(scene, needed)
    return Plan(
        scene=scene,
        paths=paths,
        sampler="stationary" if stationary.needed else "paths",
        evaluator=evaluator,
        reverse=reversal.needed,
        mean=mean,
        verdicts=tuple(verdicts),
        proposal=pilot.proposal,
        nufft=nufft,
        expected_error=float(np.sqrt(pilot.moments.relative_variance / paths)),
        gaussianity=EXACT if stationary.needed else pilot.moments.gaussianity(paths),
        connections_per_path=work.connections_per_path,
        events_per_path=work.events_per_path,
        seconds=seconds(work, thread_count(threads)),
        memory_bytes=needed,
    )


def _plan_volume(
    scene: Scene,
    obstacle: str | None,
    paths: int | None,
    rel_error: float | None,
    sampler: Sampler,
    reverse: Reverse,
    mean: bool,
    tolerance: float,
    threads: int | None,
) -> Plan:
    """Plan for the general engine: paths summed directly, or a covariance."""
    if sampler == "stationary":
        reject("sampler", '"paths", "covariance" or "auto" for this scene', sampler, f"Here {obstacle}.")
    reversal = scene_reversal(scene, reverse, tolerance)
    pilot = volume_pilot(scene, reversal.needed)
    if paths is None:
        paths = DEFAULT_PATHS if rel_error is None else pilot.moments.paths_for(rel_error)
    use_covariance = sampler == "covariance"
    work = VolumeWork(
        scene=scene,
        paths=paths,
        events_per_path=pilot.events_per_path,
        connections_per_path=pilot.connections_per_path,
        ways=2 if scene_tracer(scene, reversal.needed).two_way else 1,
        covariance=use_covariance,
    )
    needed = volume_memory_bytes(work)
    _require_memory(scene, needed)
    verdicts = [
        *validity_verdicts(scene),
        reversal,
        volume_mean_verdict(scene, mean, tolerance, pilot.intensity),
        Verdict("fast engine for beams through a slab", False, obstacle or "the covariance serves any geometry"),
    ]
    return Plan(
        scene=scene,
        paths=paths,
        sampler="covariance" if use_covariance else "paths",
        evaluator="eigenvectors" if use_covariance else "direct",
        reverse=reversal.needed,
        mean=mean,
        verdicts=tuple(verdicts),
        proposal=None,
        nufft=None,
        expected_error=float(np.sqrt(pilot.moments.relative_variance / paths)),
        gaussianity=EXACT if use_covariance else pilot.moments.gaussianity(paths),
        connections_per_path=pilot.connections_per_path,
        events_per_path=pilot.events_per_path,
        seconds=volume_seconds(work, thread_count(threads)),
        memory_bytes=needed,
    )


_LIGHTS = {"PlaneWaves": "plane waves", "PointSources": "point sources"}


def _described(medium: Medium) -> str:
    """One line about a medium."""
    if isinstance(medium, VoxelGrid):
        shape = "x".join(str(n) for n in medium.extinction.shape)
        return (
            f"Grid of {shape} voxels of {len(medium.scatterers)} materials, optical depth at most "
            f"{medium.optical_depth:.4g}"
        )  # fmt: skip
    return (
        f"{type(medium).__name__} of optical depth {medium.optical_depth:.4g}, anisotropy {medium.scatterer.g:.4g}, "
        f"albedo {medium.albedo:g}"
    )  # fmt: skip


def _require_memory(scene: Scene, needed: int) -> None:
    total = available_memory()
    if needed > 0.9 * total:
        reject(
            "Scene",
            f"renderable within {0.9 * total / 2**30:.1f} GiB",
            f"{needed / 2**30:.1f} GiB for {len(scene.lights)} tilts of {scene.sensor.shape} views",
            "Render fewer tilts or fewer views at a time, or stream the stack by render_tiles.",
        )
