"""Planning: scene and budget -> Plan, from a pilot and counted operations, never from a clock.

Each rule stands beside its physics and returns a :class:`~specklegen.core.decision.Decision`; the planner asks every
sampler and folds what they say. A plan is a pure function of the scene and the arguments: pilots are keyed by the
scene's fingerprint. Predicted seconds may differ between machines, choices may not.
"""

from collections.abc import Callable

import numpy as np

from specklegen.core.arguments import instance, real_number
from specklegen.core.budgets import checked_budget
from specklegen.core.decision import Decision
from specklegen.core.errors import reject
from specklegen.core.memory import require_memory
from specklegen.core.nanoseconds import seconds
from specklegen.core.parallel import thread_count
from specklegen.mean.rule import mean_decision
from specklegen.paths.deep_absorption import require_reach
from specklegen.paths.reversal import Reverse, scene_reversal
from specklegen.paths.tracer import lock_step_obstacle
from specklegen.planning.plan import Plan
from specklegen.samplers.covariance import sampler as covariance
from specklegen.samplers.path_sums import sampler as path_sums
from specklegen.samplers.sampler import SamplerName, Wish, require_float32
from specklegen.samplers.screens import sampler as screens
from specklegen.samplers.stationary import sampler as stationary
from specklegen.scene.illumination import CollimatedBeams, IncoherentObject
from specklegen.scene.scene import Scene
from specklegen.scene.sensors import FarFieldGrid, require_resolved
from specklegen.scene.validity import validity_decisions

SAMPLERS = {
    "stationary": stationary.consider,
    "paths": path_sums.consider,
    "covariance": covariance.consider,
    "screens": screens.consider,
}
"""Every sampler by the name that one asks for it, and its rule."""

PREFERRED: tuple[SamplerName, ...] = ("stationary", "paths")
"""Those that "auto" asks of a volume of scatterers, the cheapest first."""
THIN: tuple[SamplerName, ...] = ("screens",)
"""And of thin screens."""

STATIONARY_TOLERANCE = 0.02


def _simple_terms(scene: Scene) -> list[Decision]:
    """What beams through a slab of one kind of particle need not be asked for."""
    if scene.thin is not None or lock_step_obstacle(scene) or len(scene.slab.scatterer.components) > 1:
        return []
    reason = "nothing is lost: the views are directions, the slab is homogeneous, and its particles are of one kind"
    return [Decision("near-field terms, voxels and mixtures", False, reason)]


SCENE_RULES: tuple[Callable[[Scene], list[Decision]], ...] = (validity_decisions, _simple_terms)
"""Rules that judge a scene alone, whatever renders it; those of a pilot are its ``decisions``."""


def plan(
    scene: Scene,
    *,
    paths: int | None = None,
    rel_error: float | None = None,
    sampler: SamplerName = "auto",
    reverse: Reverse = "auto",
    mean: bool = False,
    field_tolerance: float = 1e-3,
    streamed: bool = False,
    envelope: bool = True,
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
        Instead of ``paths``: the square root of the excess correlation between intensities that a finite number of
        paths leaves within an image, at the worst view: of (2 E w^2 - (E w)^2 - E sum_B w_B^2) / (N (E w)^2), w the
        contribution of a path and w_B of one of its connections, which share their entrance. Between views far apart
        it is sqrt(Var w / (N (E w)^2)), up to sqrt 2 times less
        (:func:`specklegen.coherence.partially_coherent.finite_path_excess`). Also
        the tolerance of the criterion for the stationary sampler, which is 0.02 otherwise.
    sampler
        "auto", or one of "paths", "covariance", "stationary", and of thin media "screens". "covariance" (few lights
        and views) estimates the covariance once and draws every realization from its eigenvectors. A sampler that is
        asked for serves even where its rule is against it, if it can; the plan's ``doubts`` say so.
    reverse
        Coherent backscattering: True, False or "auto".
    mean
        Whether the mean field will be added.
    field_tolerance
        Relative error of the NUFFT against the direct sum.
    streamed
        State, and hold against the memory there is, what :func:`specklegen.render_tiles` holds at a time.
    envelope
        Whether the stationary sampler may draw fields under an envelope that turns with the tilt; False of recipes,
        whose modes have none.
    threads
        Threads for the prediction of seconds.

    Raises
    ------
    RuleError
        For an argument out of range, a grid that undersamples the speckle, a sampler that cannot serve
        the scene, a render that would not fit into memory, or fewer paths than it takes for any to carry light
        through an absorbing slab.

    Examples
    --------
    >>> import specklegen as sg
    >>> slab = sg.Slab(thickness=100.0, mean_free_path=20.0, scatterer=sg.HenyeyGreenstein(0.9))
    >>> light = sg.CollimatedBeams.tilts([0.0, 1e-4], width=5000.0)
    >>> scene = sg.Scene(wavelength=0.5, medium=slab, illumination=light, sensor=sg.FarField.grid((16, 16), 2e-5))
    >>> sg.plan(scene).sampler
    'stationary'
    >>> sg.plan(scene, sampler="paths", rel_error=0.1).paths
    388
    """
    _check(scene, paths, rel_error, sampler, field_tolerance)
    tolerance = rel_error if rel_error is not None else STATIONARY_TOLERANCE
    grid = scene.sensor
    if isinstance(grid, FarFieldGrid) and isinstance(scene.illumination, CollimatedBeams | IncoherentObject):
        require_resolved("FarFieldGrid.pitch", scene.wavelength, scene.beams.width, grid.pitch)
    if not streamed:  # the stack and its views alone, before any pilot, whose time would be lost
        _require_memory(scene, int(np.prod(scene.sensor.shape, dtype=float)) * (8 * len(scene.lights) + 48))

    reversal = scene_reversal(scene, reverse, tolerance)
    wish = Wish(paths, rel_error, reversal.needed, tolerance, field_tolerance, sampler, streamed, envelope)
    decisions = [decision for rule in SCENE_RULES for decision in rule(scene)]
    decisions += [reversal, mean_decision(scene, mean, tolerance, reversal.needed)]
    chosen, told = None, []
    preferred = PREFERRED if scene.thin is None else THIN
    for name in preferred if sampler == "auto" else (sampler,):
        chosen, told = SAMPLERS[name](scene, wish)
        decisions += told
        if chosen is not None:
            break
    assert chosen is not None, "path sums serve every scene"
    if sampler == "paths":
        decisions.append(Decision("stationary sampler", False, "as asked"))
    pilot = getattr(chosen, "pilot", None)  # a sampler without paths has none
    if pilot is not None:
        require_reach("plan", pilot.unseen, chosen.paths)
        decisions += pilot.decisions
    require_float32(chosen.intensity)
    threads = thread_count(threads)
    needed = chosen.memory(threads)
    _require_memory(scene, needed)
    counted = dict(chosen.operations())
    return Plan(
        scene=scene,
        chosen=chosen,
        reverse=reversal.needed,
        mean=mean,
        decisions=tuple(decisions),
        operations=counted,
        seconds=seconds(counted, threads),
        memory_bytes=needed,
        alternatives={way: seconds(some, threads) for way, some in chosen.alternatives().items()},
    )


def _check(
    scene: Scene, paths: int | None, rel_error: float | None, sampler: SamplerName, field_tolerance: float
) -> None:
    """Refuse what :func:`plan` cannot mean."""
    instance("plan scene", scene, Scene)
    checked_budget("plan", paths, rel_error, None)
    if not 0 < real_number("field_tolerance", field_tolerance) < 1:
        reject("field_tolerance", "between 0 and 1", field_tolerance)
    if sampler != "auto" and sampler not in SAMPLERS:
        known = ", ".join(f'"{name}"' for name in ("auto", *SAMPLERS))
        reject("sampler", f"one of {known}", sampler)
    if scene.thin is not None and sampler not in ("auto", *THIN):
        reject("sampler", '"auto" or "screens" for a thin medium', sampler)
    if scene.thin is None and sampler in THIN:
        reject("sampler", "another one for a medium of scatterers", sampler, "It draws thin screens alone.")


def streaming_obstacle(scene: Scene) -> str | None:
    """Why :func:`specklegen.render_tiles` does not serve a scene; None where it does."""
    if not isinstance(scene.sensor, FarFieldGrid) or not isinstance(scene.illumination, CollimatedBeams):
        return f"{type(scene.illumination).__name__} seen by {type(scene.sensor).__name__}"
    return lock_step_obstacle(scene)


def _require_memory(scene: Scene, needed: int) -> None:
    stream = ", or stream the stack by render_tiles." if streaming_obstacle(scene) is None else "."
    require_memory(
        "Scene", "renderable", needed, f"{len(scene.lights)} tilts of {scene.sensor.shape} views",
        "Render fewer tilts or fewer views at a time" + stream, share=0.9,
    )  # fmt: skip
