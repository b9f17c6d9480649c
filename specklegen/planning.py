"""Planning: scene and budget -> Plan, from a pilot and counted operations, never from a clock.

Each gate is a function beside its physics that returns a :class:`Verdict`; the planner folds them. A plan
is a pure function of the scene and the arguments: pilots are keyed by the scene's fingerprint. Predicted
seconds may differ between machines, choices may not.
"""

import os
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Literal

import numpy as np
from scipy.spatial import KDTree

from specklegen.fields.ends import Optics, full_weights
from specklegen.fields.nufft import SINGLE_PRECISION_FROM, NufftEvaluator, build_evaluator
from specklegen.gates import Reverse, Verdict, reversal_verdict
from specklegen.illumination import IncoherentObject
from specklegen.mean import ballistic_fraction, mean_field
from specklegen.parallel import thread_count
from specklegen.scene import Scene
from specklegen.sensors import FarFieldGrid
from specklegen.stationary.criterion import StationaryError, stationary_error
from specklegen.stationary.kernel import keep_threshold
from specklegen.stationary.objects import require_resolved
from specklegen.streams import Stream, pilot_seed
from specklegen.tracing import PathBank, Proposal, beam_proposal, trace
from specklegen.values import reject

Sampler = Literal["auto", "paths", "stationary"]
PILOT_PATHS = 6000
CHUNK = 131072
"""Paths traced and summed at a time; fixed, so that sums do not depend on the machine's size."""
DEFAULT_PATHS = 100_000
STATIONARY_TOLERANCE = 0.02

# Nanoseconds on one core of the machine of docs/performance.md; they scale predictions, not choices.
_EVENT, _END, _TRANSFORM, _VIEW, _FFT_POINT, _NORMAL, _GEMM = 42.0, 30.0, 60.0, 14.0, 12.0, 25.0, 0.02


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


@dataclass(frozen=True)
class Pilot:
    """A scene's pilot: the proposal with its threshold, a bank, and what it says of weights and cost."""

    proposal: Proposal
    bank: PathBank
    relative_variance: float
    intensity: float


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
        number of paths leaves, at the worst view (physics.md 2). Also the tolerance of the criterion for
        the stationary sampler, which is 0.02 otherwise.
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
        scene.medium, scene.wavelength, scene.beams.directions, scene.sensor.directions, reverse, tolerance
    )
    verdicts += [reversal, mean_verdict(scene, mean, tolerance)]
    pilot = _pilot(scene, reversal.needed)
    if paths is None:
        paths = DEFAULT_PATHS if rel_error is None else max(1, int(np.ceil(pilot.relative_variance / rel_error**2)))
    stationary = stationary_verdict(scene, reversal.needed, sampler, tolerance)
    verdicts.append(stationary)

    nufft = None
    evaluator = "FFT or matrix products"
    if not stationary.needed:
        nufft, verdict = _evaluator(scene, pilot, field_tolerance, reversal.needed)
        verdicts.append(verdict)
        evaluator = "nufft" if nufft else "direct"
    per_path = len(pilot.bank) / max(pilot.bank.count, 1)
    events = pilot.bank.events / max(pilot.bank.count, 1)
    made = Plan(
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
        connections_per_path=per_path,
        events_per_path=events,
        seconds=0.0,
        memory_bytes=0,
    )
    made = replace(
        made, seconds=_seconds(made, thread_count(threads)), memory_bytes=_memory(made, thread_count(threads))
    )
    _require_memory(scene, made.memory_bytes)
    return made


def _require_memory(scene: Scene, needed: int) -> None:
    total = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    if needed > 0.9 * total:
        reject(
            "Scene",
            f"renderable within {0.9 * total / 2**30:.1f} GiB",
            f"{needed / 2**30:.1f} GiB for {len(scene.beams.directions)} tilts of {scene.sensor.shape} views",
            "Render fewer tilts at a time (the same seed gives the same medium), or fewer views.",
        )


def validity_verdicts(scene: Scene) -> list[Verdict]:
    """What the physics itself assumes of a scene, where it is doubtful."""
    found = []
    medium, wavelength = scene.medium, scene.wavelength
    width = scene.beams.width
    if medium.mean_free_path < wavelength:
        found.append(
            Verdict(
                "independent scattering",
                True,
                f"assumed, but doubtful: the mean free path {medium.mean_free_path:g} is below the wavelength {wavelength:g}",
            )  # fmt: skip
        )
    if width**2 < 10 * wavelength * medium.thickness:
        found.append(
            Verdict(
                "diffraction of the beam inside the slab",
                False,
                f"not modelled, and doubtful here: width^2 / wavelength = {width**2 / wavelength:.3g} is not far "
                f"above the thickness {medium.thickness:g}",
            )  # fmt: skip
        )
    return found


def mean_verdict(scene: Scene, mean: bool, tolerance: float) -> Verdict:
    """The mean field is added only when asked; say where its intensity would exceed the speckle's tolerance."""
    part = "mean (ballistic) field"
    if mean:
        return Verdict(part, True, "asked for")
    if isinstance(scene.illumination, IncoherentObject) or not len(scene.beams.directions):
        return Verdict(part, False, f"its share of the light is {ballistic_fraction(scene):.2g}")
    few = scene.replace(illumination=scene.beams.replace(directions=_nearest_tilt(scene)[None]))
    strongest = float(np.square(np.abs(mean_field(few))).max(initial=0.0))
    speckle = _pilot(scene, False).intensity
    if strongest <= tolerance * speckle:
        return Verdict(
            part,
            False,
            f"at most {strongest / max(speckle, 1e-300):.2g} of the speckle's intensity at any view",
        )
    return Verdict(
        part, False,
        f"not asked for (mean=True adds it), though it reaches {strongest / max(speckle, 1e-300):.2g} times the "
        "speckle's intensity at some view",
    )  # fmt: skip


def _nearest_tilt(scene: Scene) -> np.ndarray:
    """float64[3], the tilt that comes nearest to any view, where its mean field is strongest; ties to the axis."""
    directions, sensor = scene.beams.directions, scene.sensor
    if isinstance(sensor, FarFieldGrid):
        x, y = sensor.sines
        inside = np.clip(directions[:, :2], [x[0], y[0]], [x[-1], y[-1]])
        gap = np.linalg.norm(directions[:, :2] - inside, axis=1)
    else:
        gap, _ = KDTree(sensor.directions.reshape(-1, 3)).query(directions)
    return directions[np.lexsort((-directions[:, 2], gap))[0]]


def stationary_verdict(scene: Scene, reverse: bool, sampler: Sampler, tolerance: float) -> Verdict:
    """Whether the stationary sampler serves a scene within the tolerance (design.md 3)."""
    part = "stationary sampler"
    obstacle = None
    if not isinstance(scene.sensor, FarFieldGrid):
        obstacle = "needs a regular far-field grid"
    elif scene.sensor.side != "transmission":
        obstacle = "serves transmission only"
    elif reverse:
        obstacle = "has no reversed paths"
    elif scene.medium.albedo == 0 or scene.medium.thickness == 0:
        obstacle = "has nothing to do: nothing scatters"
    if obstacle:
        if sampler == "stationary":
            reject("sampler", '"paths" or "auto" for this scene', sampler, f"The stationary sampler {obstacle}.")
        return Verdict(part, False, obstacle)
    if sampler == "paths":
        return Verdict(part, False, "as asked")
    error = _judge(scene, tolerance)
    said = (
        f"its correlations are off by {error.correlation:.2g} +- {error.correlation_error:.1g} and its intensities by "
        f"{error.intensity:.2g} +- {error.intensity_error:.1g}, allowed {tolerance:g}"
    )
    if sampler == "stationary":
        return Verdict(part, True, f"asked for; {said}")
    return Verdict(part, error.accepts(tolerance), said)


@lru_cache(maxsize=64)
def _pilot(scene: Scene, reverse: bool) -> Pilot:
    medium = scene.medium
    views = probe_views(scene)
    proposal = beam_proposal(medium, scene.beams, views, reverse=reverse)
    optics = Optics.of_scene(scene)
    seed = pilot_seed(scene.fingerprint())
    if len(views) and len(scene.beams.directions):
        threshold = keep_threshold(medium, proposal, optics, proposal.reference, seed)
        proposal = replace(proposal, threshold=threshold)
    bank = trace(medium, proposal, seed, PILOT_PATHS, stream=Stream.PILOT)
    worst = intensity = 0.0
    for view in views:
        w = np.bincount(bank.paths, full_weights(bank, optics, proposal.reference, view), bank.count)
        if w.any():
            worst = max(worst, float(w.var() / w.mean() ** 2))
            intensity = max(intensity, float(w.mean()))
    return Pilot(proposal, bank, worst, intensity)


@lru_cache(maxsize=64)
def _nufft(scene: Scene, reverse: bool, tolerance: float) -> NufftEvaluator | None:
    assert isinstance(scene.sensor, FarFieldGrid)
    return build_evaluator(_pilot(scene, reverse).bank, Optics.of_scene(scene), scene.sensor, tolerance)


@lru_cache(maxsize=64)
def _judge(scene: Scene, tolerance: float) -> StationaryError:
    return stationary_error(scene, _pilot(scene, False).proposal, tolerance)


def probe_views(scene: Scene) -> np.ndarray:
    """Views that stand for all in weights and errors: centre and corners of a grid, at most nine others."""
    sensor = scene.sensor
    if not isinstance(sensor, FarFieldGrid):
        flat = sensor.directions.reshape(-1, 3)
        return flat[np.unique(np.linspace(0, len(flat) - 1, 9).astype(int))] if len(flat) else flat
    narrow = np.ptp(sensor.corner_directions, axis=0).max() < 0.05 * (1 - abs(scene.medium.scatterer.g))
    return (
        sensor.center_direction[None]
        if narrow
        else np.concatenate([sensor.center_direction[None], sensor.corner_directions])
    )


def _evaluator(scene: Scene, pilot: Pilot, tolerance: float, reverse: bool) -> tuple[NufftEvaluator | None, Verdict]:
    part = "NUFFT evaluator"
    if not isinstance(scene.sensor, FarFieldGrid):
        return None, Verdict(part, False, "needs a regular far-field grid; the direct sum serves any directions")
    if reverse:
        return None, Verdict(part, False, "reversed paths are summed directly")
    if len(pilot.bank) == 0:
        return None, Verdict(part, False, "nothing scatters")
    nufft = _nufft(scene, reverse, tolerance)
    views = int(np.prod(scene.sensor.shape))
    tilts = len(scene.beams.directions)
    if nufft is None:
        return None, Verdict(part, False, "the field of view is too wide for a low-rank view factor; summed directly")
    transforms = _nufft_ns(nufft, tilts, 1000.0, views) / 1000
    direct = views * (_VIEW + 2.0 * tilts)
    if transforms > direct:
        return None, Verdict(part, False, f"rank {nufft.rank} makes it dearer than {views} views summed directly")
    return nufft, Verdict(
        part,
        True,
        f"rank {nufft.rank} at a relative field error of {nufft.error:.1g} on held-out connections",
    )


def _nufft_ns(nufft: NufftEvaluator, tilts: int, connections: float, views: int) -> float:
    width = np.ceil(-np.log10(0.3 * nufft.tolerance)) + 1
    spread = _TRANSFORM * (width / 5) ** 2 * (1 if nufft.tolerance >= 1e-4 else 2)
    return nufft.rank * tilts * (spread * connections + _FFT_POINT * 4 * views) + connections * _END * (
        tilts + nufft.rank
    )


def _seconds(made: Plan, threads: int) -> float:
    views = float(np.prod(made.scene.sensor.shape))
    tilts = len(made.scene.beams.directions)
    connections = made.paths * made.connections_per_path
    ns = made.paths * made.events_per_path * _EVENT
    if made.sampler == "stationary":
        grains = np.prod([n * made.scene.sensor.pitch / made.scene.speckle_size + 10 for n in made.scene.sensor.shape])  # type: ignore[union-attr]
        return 1e-9 * (ns / threads + tilts * (grains * _NORMAL + views * 3.0)) + 5e-3
    if made.nufft:
        ns += _nufft_ns(made.nufft, tilts, connections, int(views))
    else:
        ns += connections * (views * (_VIEW + 2.0 * tilts) + _END * tilts) * (2 if made.reverse else 1)
    return 1e-9 * ns / threads


def _memory(made: Plan, threads: int) -> int:
    views = float(np.prod(made.scene.sensor.shape))
    tilts = len(made.scene.beams.directions)
    connections = min(made.paths, CHUNK) * made.connections_per_path
    bank = connections * (14 * 8 + 12) * 2
    if made.sampler == "stationary":
        return int(min(made.paths, 1e9) * made.connections_per_path * 160 + 8 * views * tilts * 4 + 2**24)
    if made.nufft:
        single = made.nufft.tolerance >= 1e-4
        per = 8 if single else 16
        field = tilts * views * per * (2 + made.nufft.rank + 4 * threads)
        return int(bank + connections * (16 * (tilts + made.nufft.rank) + per * tilts * threads) + field + 2**24)
    return int(bank + connections * 16 * 2 * tilts + tilts * views * 16 * 3 + 2**24)
