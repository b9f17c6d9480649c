"""Which sampler "auto" takes: of those that are within the tolerance the quickest to draw what is asked for.

    seconds = set-up + realizations x draw,    predicted on one thread by counted operations

The one that is cheapest as a rule is asked first, and others only where a bound from below leaves them a chance, by
pilots that are there already: to look into the sums of a scene costs as much as to render a small one. So does a
longer pilot, where a first one leaves open whether the stationary sampler serves; it is traced where the paths that it
may save take longer.
"""

from collections.abc import Mapping
from dataclasses import replace

from specklegen.core.budgets import DEFAULT_PATHS
from specklegen.core.decision import Decision
from specklegen.core.errors import reject
from specklegen.core.nanoseconds import seconds
from specklegen.paths.pilot import Pilot, scene_pilot
from specklegen.paths.steps import refracting_layers
from specklegen.paths.tracer import lock_step_obstacle
from specklegen.samplers.covariance.sampler import Eigenfields, unasked_obstacle
from specklegen.samplers.covariance.sampler import least_operations as least_of_covariance
from specklegen.samplers.path_sums.sampler import PathSums
from specklegen.samplers.path_sums.sampler import least_operations as least_of_sums
from specklegen.samplers.sampler import Request, Sampler
from specklegen.samplers.stationary.convolution import Convolution
from specklegen.samplers.stationary.sampler import Stationary
from specklegen.samplers.stationary.stationarity import MOST_PATHS
from specklegen.scene.scene import Scene

_CLEARLY = 0.8
"""Share of another's seconds below which a covariance is drawn from, whose error all realizations have in common."""
_JUDGED = 8e-6  # seconds that a connection of a stationary pilot takes

Others = dict[str, Mapping[str, float]]
"""Operations of all realizations by the ways that are not taken, by what they are."""


def cheapest(scene: Scene, request: Request) -> tuple[Sampler, list[Decision], Others]:
    """The sampler of a volume, what is said of all that were asked, and the operations of others."""
    refracts = lock_step_obstacle(scene) is None and refracting_layers(scene.slab)  # whose paths are not summed
    if refracts or not request.envelope:  # a recipe's probe stands for many samples, which the stationary sampler draws
        first = () if request.envelope else (Convolution,)
        return *served(scene, request, (*first, Stationary, PathSums)), {}
    pilot = scene_pilot(scene, request.reverse)
    least = times(least_of_sums(scene, pilot, _paths(pilot, request)), request.realizations)
    longer = MOST_PATHS * pilot.connections_per_path * _JUDGED
    request = replace(request, thorough=seconds(least, 1) > longer)
    stationary, decisions = Stationary.propose(scene, request)
    if stationary is not None and _seconds(stationary, request) <= seconds(least, 1):
        return stationary, decisions, {"path sums, their least,": least}
    sums, sums_decisions = served(scene, request, (PathSums,) if stationary is not None else (Stationary, PathSums))
    best, others = sums, Others()
    if stationary is None:
        decisions = sums_decisions
        if _lost(sums_decisions) > request.tolerance or sums.name != PathSums.name:
            return sums, decisions, others
    elif _lost(sums_decisions) > request.tolerance or _seconds(stationary, request) <= _seconds(sums, request):
        best, others = stationary, {"path sums": all_operations(sums, request)}
    else:
        others = {"the stationary sampler": all_operations(stationary, request)}
        decisions = [*(_left_out(each, "path sums") for each in decisions), *sums_decisions]
    return _or_covariance(scene, request, pilot, best, decisions, others)


def _or_covariance(
    scene: Scene, request: Request, pilot: Pilot, best: Sampler, said: list[Decision], others: Others
) -> tuple[Sampler, list[Decision], Others]:
    """The same, or the covariance where that is clearly quicker."""
    bound = _CLEARLY * _seconds(best, request)
    if unasked_obstacle(scene, request) or (
        seconds(least_of_covariance(scene, pilot, _paths(pilot, request)), 1) > bound
    ):
        return best, said, others
    drawn, decisions = Eigenfields.propose(scene, request)
    if drawn is None or _lost(decisions) > request.tolerance or any(each.doubt for each in drawn.pilot.decisions):
        return best, said, others  # rare paths would leave their mark on every realization
    if _seconds(drawn, request) > bound:
        return best, said, others | {"the covariance": all_operations(drawn, request)}
    name = "path sums" if best.name == PathSums.name else "the stationary sampler"
    taken = Decision(
        "covariance", True, f"of {len(scene.lights)} lights at {len(scene.views)} views, estimated once from "
        f"{drawn.paths} paths: quicker than {name}; its error is common to all {request.realizations} realizations, "
        "more of which do not lower it",
    )  # fmt: skip
    said = [each if best.name == PathSums.name else _left_out(each, "the covariance") for each in said]
    kept = [each for each in said if each.part != "paths in lock step and NUFFT" and each.part != "views one by one"]
    return drawn, [*kept, taken, *decisions], others | {name: all_operations(best, request)}


def served(
    scene: Scene, request: Request, kinds: tuple[type[Sampler], ...]
) -> tuple[Sampler, list[Decision]]:
    """The first sampler that serves, and what all that were asked say; one before it where that states less error."""
    decisions: list[Decision] = []
    for n, kind in enumerate(kinds):
        chosen, own_decisions = kind.propose(scene, request)
        decisions += own_decisions
        if chosen is None:
            continue
        lost = _lost(own_decisions)
        if lost <= request.tolerance:
            return chosen, decisions
        for other in kinds[:n]:
            surer, own_decisions = other.propose(scene, replace(request, beside=lost, thorough=True))
            if surer is not None:
                return surer, own_decisions
        return chosen, decisions
    reject(  # one of a user's own: path sums serve every scene
        "sampler", "one that serves the scene", request.asked, "; ".join(each.reason for each in decisions)
    )


def all_operations(sampler: Sampler, request: Request) -> Mapping[str, float]:
    """Operations of all realizations."""
    first, once = sampler.operations(), sampler.setup()
    count = request.realizations
    return {name: once.get(name, 0.0) + count * (n - once.get(name, 0.0)) for name, n in first.items()}


def times(operations: Mapping[str, float], count: int) -> Mapping[str, float]:
    """So many times the operations."""
    return {name: count * n for name, n in operations.items()}


def _seconds(sampler: Sampler, request: Request) -> float:
    return sampler.seconds(request.realizations)


def _paths(pilot: Pilot, request: Request) -> int:
    """Paths of path sums."""
    if request.paths is not None:
        return request.paths
    error = request.rel_error
    return DEFAULT_PATHS if error is None else pilot.moments.paths_for(error, within_image=True)


def _lost(told: list[Decision]) -> float:
    """The largest error that a sampler states beyond its rule."""
    return max([0.0, *(each.error for each in told if each.doubt)])


def _left_out(said: Decision, name: str) -> Decision:
    """What was said for a sampler that would serve, and is left out for its time."""
    if not said.needed:
        return said
    return replace(said, needed=False, doubt=False, reason=f"{said.reason}; but {name} take less time")
