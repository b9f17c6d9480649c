"""Planning: scene and budget -> Plan, from a pilot and counted operations, never from a clock.

Each gate is a function beside its physics that returns a :class:`Decision`; the planner folds them. A plan
is a pure function of the scene and the arguments: pilots are keyed by the scene's fingerprint. Predicted
seconds may differ between machines, choices may not.
"""

from dataclasses import replace

import numpy as np

from specklegen.core.arguments import instance, real_number
from specklegen.core.budgets import DEFAULT_PATHS, checked_budget
from specklegen.core.decision import Decision
from specklegen.core.errors import reject
from specklegen.core.memory import available_memory
from specklegen.core.nanoseconds import seconds
from specklegen.core.parallel import thread_count
from specklegen.mean.rule import mean_decision, volume_mean_decision
from specklegen.paths.gaussianity import EXACT
from specklegen.paths.pilot import scene_pilot
from specklegen.paths.reversal import Reverse, scene_reversal, slab_engine_obstacle
from specklegen.paths.tracer import scene_tracer
from specklegen.paths.volume_pilot import volume_pilot
from specklegen.planning.costs import (
    VolumeWork,
    Work,
    memory_bytes,
    operations,
    tracing_operations,
    volume_memory_bytes,
    volume_operations,
)
from specklegen.planning.plan import Plan
from specklegen.samplers.path_sums.summation import summation_decision
from specklegen.samplers.sampler import Sampler
from specklegen.samplers.stationary.rule import stationary_decision
from specklegen.scene.illumination import CollimatedBeams, IncoherentObject
from specklegen.scene.scene import Scene
from specklegen.scene.sensors import FarFieldGrid, require_resolved
from specklegen.scene.validity import validity_verdicts

STATIONARY_TOLERANCE = 0.02
SIMPLER = Decision(
    "near-field terms, voxels and mixtures", False,
    "nothing is lost: the views are directions, the slab is homogeneous, and its particles are of one kind",
)  # fmt: skip


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
        number of paths leaves, at the worst view: sqrt(Var w / (N (E w)^2)), w the contribution of a path. This
        is for views far apart; within a grain of each other the connections of one path, which share their
        entrance, add up to as much again (:func:`specklegen.coherence.partially_coherent.finite_path_excess`). Also
        the tolerance of the criterion for the stationary sampler, which is 0.02 otherwise.
    sampler
        "auto", or one of "paths", "covariance", "stationary". "covariance" (few lights and views) estimates
        the covariance once and draws every realization from its eigenvectors.
    reverse
        Coherent backscattering: True, False or "auto".
    mean
        Whether the mean field will be added.
    field_tolerance
        Relative error of the NUFFT summation against the direct sum.
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
    instance("plan scene", scene, Scene)
    checked_budget("plan", paths, rel_error, None)
    if not 0 < real_number("field_tolerance", field_tolerance) < 1:
        reject("field_tolerance", "between 0 and 1", field_tolerance)
    if sampler not in ("auto", "paths", "covariance", "stationary"):
        reject("sampler", 'one of "auto", "paths", "covariance", "stationary"', sampler)
    tolerance = rel_error if rel_error is not None else STATIONARY_TOLERANCE
    grid = scene.sensor
    if isinstance(grid, FarFieldGrid) and isinstance(scene.illumination, CollimatedBeams | IncoherentObject):
        require_resolved("FarFieldGrid.pitch", scene.wavelength, scene.beams.width, grid.pitch)

    obstacle = slab_engine_obstacle(scene)
    if not streamed:  # the stack and its views alone, before any pilot, whose time would be lost
        _require_memory(scene, int(np.prod(scene.sensor.shape, dtype=float)) * (8 * len(scene.lights) + 48))
    if obstacle or sampler == "covariance":
        return _plan_volume(scene, obstacle, paths, rel_error, sampler, reverse, mean, tolerance, threads)

    return _plan_slab(scene, paths, rel_error, sampler, reverse, mean, tolerance, field_tolerance, streamed, threads)


def _plan_slab(
    scene: Scene,
    paths: int | None,
    rel_error: float | None,
    sampler: Sampler,
    reverse: Reverse,
    mean: bool,
    tolerance: float,
    field_tolerance: float,
    streamed: bool,
    threads: int | None,
) -> Plan:
    """Plan for beams through a slab: the stationary sampler, or paths by NUFFT or summed directly."""
    reversal = scene_reversal(scene, reverse, tolerance)
    pilot = scene_pilot(scene, reversal.needed)
    if paths is None:
        paths = DEFAULT_PATHS if rel_error is None else pilot.moments.paths_for(rel_error)
    kernel, stationary = stationary_decision(scene, reversal.needed, sampler, tolerance)
    decisions = [*validity_verdicts(scene), reversal, mean_decision(scene, mean, tolerance), SIMPLER, stationary]
    nufft, summation = None, "FFT or matrix products"
    if not stationary.needed:
        nufft, decision = summation_decision(scene, pilot, field_tolerance, reversal.needed)
        decisions.append(decision)
        summation = "nufft" if nufft else "direct"
    work = Work(
        scene=scene,
        paths=paths,
        events_per_path=pilot.bank.events / max(pilot.bank.count, 1),
        connections_per_path=len(pilot.bank) / max(pilot.bank.count, 1),
        stationary=stationary.needed,
        nufft=nufft,
        reverse=reversal.needed,
        oblique=kernel == "oblique",
        streamed=streamed,
    )
    needed = memory_bytes(work, thread_count(threads))
    _require_memory(scene, needed)
    counted = operations(work)
    return Plan(
        scene=scene,
        paths=paths,
        sampler="stationary" if stationary.needed else "paths",
        summation=summation,
        reverse=reversal.needed,
        mean=mean,
        decisions=tuple(decisions),
        proposal=pilot.proposal,
        nufft=nufft,
        kernel=kernel,
        expected_error=float(np.sqrt(pilot.moments.relative_variance / paths)),
        gaussianity=EXACT if stationary.needed else pilot.moments.gaussianity(paths),
        connections_per_path=work.connections_per_path,
        events_per_path=work.events_per_path,
        chunks=work.chunks,
        operations=counted,
        seconds=seconds(counted, thread_count(threads)),
        memory_bytes=needed,
        alternatives=_alternatives(work, thread_count(threads)),
    )


def _alternatives(work: Work, threads: int) -> dict[str, float]:
    """Seconds of the ways not taken through a slab, for the same paths."""
    direct = replace(work, stationary=False, nufft=None)
    found = {}
    if work.stationary:
        found[f"tracing {work.paths} paths anew for every realization, all fields aside,"] = seconds(
            tracing_operations(work), threads
        )
    if work.nufft:
        found["the direct sum"] = seconds(operations(direct), threads)
    if not work.stationary and not work.reverse:
        found["adding reversed paths (reverse=True)"] = seconds(operations(replace(direct, reverse=True)), threads)
    return found


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
        ways=2 if scene_tracer(scene, reversal.needed).bidirectional else 1,
        covariance=use_covariance,
    )
    needed, counted = volume_memory_bytes(work, thread_count(threads)), volume_operations(work)
    _require_memory(scene, needed)
    decisions = [
        *validity_verdicts(scene),
        reversal,
        volume_mean_decision(scene, mean, tolerance, pilot.intensity),
        Decision("fast engine for beams through a slab", False, obstacle or "the covariance serves any geometry"),
    ]
    return Plan(
        scene=scene,
        paths=paths,
        sampler="covariance" if use_covariance else "paths",
        summation="eigenvectors" if use_covariance else "direct",
        reverse=reversal.needed,
        mean=mean,
        decisions=tuple(decisions),
        proposal=None,
        nufft=None,
        kernel=None,
        expected_error=float(np.sqrt(pilot.moments.relative_variance / paths)),
        gaussianity=EXACT if use_covariance else pilot.moments.gaussianity(paths),
        connections_per_path=pilot.connections_per_path,
        events_per_path=pilot.events_per_path,
        chunks=work.chunks,
        operations=counted,
        seconds=seconds(counted, thread_count(threads)),
        memory_bytes=needed,
        alternatives={},
    )


def streaming_obstacle(scene: Scene) -> str | None:
    """Why :func:`specklegen.render_tiles` does not serve a scene; None where it does."""
    if not isinstance(scene.sensor, FarFieldGrid) or not isinstance(scene.illumination, CollimatedBeams):
        return f"{type(scene.illumination).__name__} seen by {type(scene.sensor).__name__}"
    return slab_engine_obstacle(scene)


def _require_memory(scene: Scene, needed: int) -> None:
    total = available_memory()
    if needed > 0.9 * total:
        reject(
            "Scene",
            f"renderable within {0.9 * total / 2**30:.1f} GiB",
            f"{needed / 2**30:.1f} GiB for {len(scene.lights)} tilts of {scene.sensor.shape} views",
            "Render fewer tilts or fewer views at a time"
            + (", or stream the stack by render_tiles." if streaming_obstacle(scene) is None else "."),
        )
