"""Planning: scene and budget -> Plan, from a pilot and counted operations, never from a clock.

Each gate is a function beside its physics that returns a :class:`Verdict`; the planner folds them. A plan
is a pure function of the scene and the arguments: pilots are keyed by the scene's fingerprint. Predicted
seconds may differ between machines, choices may not.
"""

import os
from dataclasses import dataclass

import numpy as np

from specklegen.costs import Work, memory_bytes, seconds
from specklegen.fields.nufft import SINGLE_PRECISION_FROM, NufftEvaluator
from specklegen.gates import Reverse, Sampler, Verdict, reversal_verdict
from specklegen.mean import ballistic_fraction
from specklegen.parallel import thread_count
from specklegen.pilots import scene_pilot
from specklegen.scene import Scene
from specklegen.sensors import FarFieldGrid, require_resolved
from specklegen.tracing import Proposal
from specklegen.values import reject
from specklegen.verdicts import evaluator_verdict, mean_verdict, stationary_verdict, validity_verdicts

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
        "paths" with "nufft" or "direct", or "stationary".
    reverse, mean : bool
        Whether reversed paths and the mean field take part.
    verdicts : tuple of Verdict
        Every gate, with its reason.
    proposal : Proposal
        How paths are drawn.
    nufft : NufftEvaluator or None
        The view factors, where the NUFFT is used.
    expected_error : float
        Root of the excess correlation of intensities from a finite number of paths, at the worst view
        ("paths"); relative standard error of the intensity scale ("stationary").
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
    proposal: Proposal
    nufft: NufftEvaluator | None
    expected_error: float
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
        medium = self.scene.medium
        shape = "x".join(str(n) for n in self.scene.sensor.shape)
        lines = [
            f"Slab of optical depth {medium.optical_depth:.4g}, anisotropy {medium.scatterer.g:g}, albedo "
            f"{medium.albedo:g}; {len(self.scene.beams.directions)} tilts, {shape} views.",
            f"Sampler: {self.sampler} ({self.evaluator}), {self.paths} paths.",
        ]
        lines += [f"- {v.part}: {'used' if v.needed else 'left out'}: {v.reason}." for v in self.verdicts]
        what = "false intensity correlation" if self.sampler == "paths" else "intensity scale"
        lines += [
            f"Expected error ({what}, relative): {self.expected_error:.2g}.",
            f"Cost: about {self.seconds:.2g} s for the first realization, {self.memory_bytes / 2**20:.0f} MiB.",
            f"Ballistic fraction: {ballistic_fraction(self.scene):.2g}.",
        ]
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
        "auto", or one of "paths", "stationary".
    reverse
        Coherent backscattering: True, False or "auto".
    mean
        Whether the mean field will be added.
    field_tolerance
        Relative error of the NUFFT evaluator against the direct sum.
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
    if paths is not None and paths < 1:
        reject("paths", "at least 1", paths)
    if rel_error is not None and not 0 < rel_error < 1:
        reject("rel_error", "between 0 and 1", rel_error)
    if not 0 < field_tolerance < 1:
        reject("field_tolerance", "between 0 and 1", field_tolerance)
    if sampler not in ("auto", "paths", "stationary"):
        reject("sampler", 'one of "auto", "paths", "stationary"', sampler)
    tolerance = rel_error if rel_error is not None else STATIONARY_TOLERANCE
    grid = scene.sensor
    if isinstance(grid, FarFieldGrid):
        require_resolved("FarFieldGrid.pitch", scene.wavelength, scene.beams.width, grid.pitch)

    # The stack and its views alone, before the gates below build an array of all views.
    _require_memory(scene, int(np.prod(scene.sensor.shape, dtype=float)) * (8 * len(scene.beams.directions) + 48))
    verdicts = list(validity_verdicts(scene))
    reversal = reversal_verdict(
        scene.medium.mean_free_path, scene.wavelength, scene.lights, scene.views, reverse, tolerance
    )
    verdicts += [reversal, mean_verdict(scene, mean, tolerance)]
    pilot = scene_pilot(scene, reversal.needed)
    if paths is None:
        paths = DEFAULT_PATHS if rel_error is None else max(1, int(np.ceil(pilot.relative_variance / rel_error**2)))
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
        expected_error=float(np.sqrt(pilot.relative_variance / paths)),
        connections_per_path=work.connections_per_path,
        events_per_path=work.events_per_path,
        seconds=seconds(work, thread_count(threads)),
        memory_bytes=needed,
    )


def _require_memory(scene: Scene, needed: int) -> None:
    total = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    if needed > 0.9 * total:
        reject(
            "Scene",
            f"renderable within {0.9 * total / 2**30:.1f} GiB",
            f"{needed / 2**30:.1f} GiB for {len(scene.beams.directions)} tilts of {scene.sensor.shape} views",
            "Render fewer tilts or fewer views at a time.",
        )
