"""Which sampler "auto" takes: of those that are within the tolerance the quickest to draw what is asked for.

    seconds = set-up + realizations x draw,    predicted on one thread by counted operations

The one that is cheapest as a rule is asked first, and others only where a bound from below leaves them a chance, by
pilots that are there already: to look into the sums of a scene costs as much as to render a small one. So does a
longer pilot, where a first one leaves open whether the stationary sampler serves; it is traced where the paths that it
may save take longer.
"""

from dataclasses import replace

from specklegen.core.decision import Decision
from specklegen.core.errors import reject
from specklegen.core.nanoseconds import Cost
from specklegen.paths.pilot import Pilot, scene_pilot
from specklegen.samplers.covariance.sampler import Eigenfields, unasked_obstacle
from specklegen.samplers.covariance.sampler import least_operations as least_of_covariance
from specklegen.samplers.path_sums.cost import least_operations as least_of_sums
from specklegen.samplers.path_sums.sampler import PathSums
from specklegen.samplers.sampler import Request, Sampler
from specklegen.samplers.stationary.convolution import Convolution
from specklegen.samplers.stationary.sampler import Stationary
from specklegen.samplers.stationary.stationarity import MOST_PATHS
from specklegen.scene.scene import Scene

_CLEARLY = 0.8
"""Share of another's seconds below which a covariance is drawn from, whose error all realizations have in common."""
_JUDGED = 8e-6  # seconds that a connection of a stationary pilot takes

Others = dict[str, dict[str, float]]
"""Operations of all realizations by the ways that are not taken, by what they are."""


def cheapest(scene: Scene, request: Request) -> tuple[Sampler, list[Decision], Others]:
    """The sampler of a volume, what is said of all that were asked, and the operations of others."""
    # Through layers that refract no paths are summed; a recipe's probe stands for many samples, which the stationary
    # sampler draws.
    if scene.refracts_inside or not request.envelope:
        first = () if request.envelope else (Convolution,)
        return *served(scene, request, (*first, Stationary, PathSums)), {}
    pilot = scene_pilot(scene, request.reverse)
    count, paths = request.realizations, request.paths_by(pilot.moments, within_image=True)
    least = Cost(least_of_sums(scene, pilot, paths))
    longer = MOST_PATHS * pilot.connections_per_path * _JUDGED
    request = replace(request, thorough=least.seconds(count) > longer)
    stationary, decisions = Stationary.propose(scene, request)
    if stationary is not None and stationary.cost().seconds(count) <= least.seconds(count):
        return stationary, decisions, {"path sums, at least": least.of(count)}
    sums, sums_decisions = served(scene, request, (PathSums,) if stationary is not None else (Stationary, PathSums))
    best, others = sums, Others()
    if stationary is None:
        decisions = sums_decisions
        if _lost(sums_decisions) > request.tolerance or sums.name != PathSums.name:
            return sums, decisions, others
    elif _lost(sums_decisions) > request.tolerance or stationary.cost().seconds(count) <= sums.cost().seconds(count):
        best, others = stationary, {"path sums": sums.cost().of(count)}
    else:
        others = {"the stationary sampler": stationary.cost().of(count)}
        decisions = [*(_left_out(each, "path sums") for each in decisions), *sums_decisions]
    return _or_covariance(scene, request, pilot, best, decisions, others)


def _or_covariance(
    scene: Scene, request: Request, pilot: Pilot, best: Sampler, said: list[Decision], others: Others
) -> tuple[Sampler, list[Decision], Others]:
    """Return this sampler, or the covariance if that is clearly faster."""
    count, paths = request.realizations, request.paths_by(pilot.moments, within_image=True)
    bound = _CLEARLY * best.cost().seconds(count)
    if unasked_obstacle(scene, request) or Cost(least_of_covariance(scene, pilot, paths)).seconds(1) > bound:
        return best, said, others
    drawn, decisions = Eigenfields.propose(scene, request)
    if drawn is None or _lost(decisions) > request.tolerance or any(each.doubt for each in drawn.pilot.decisions):
        return best, said, others  # rare paths would leave their mark on every realization
    if drawn.cost().seconds(count) > bound:
        return best, said, others | {"the covariance": drawn.cost().of(count)}
    name = "path sums" if best.name == PathSums.name else "the stationary sampler"
    taken = Decision(
        "covariance", True, f"of {len(scene.lights)} lights at {len(scene.views)} views, estimated once from "
        f"{drawn.paths} paths: quicker than {name}; its error is common to all {request.realizations} realizations, "
        "more of which do not lower it",
    )  # fmt: skip
    said = [each if best.name == PathSums.name else _left_out(each, "the covariance") for each in said]
    kept = [each for each in said if each.part != "paths in lock step and NUFFT" and each.part != "views one by one"]
    return drawn, [*kept, taken, *decisions], others | {name: best.cost().of(count)}


def served(scene: Scene, request: Request, kinds: tuple[type[Sampler], ...]) -> tuple[Sampler, list[Decision]]:
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
        "sampler", "a sampler that supports the scene", request.asked, "; ".join(each.reason for each in decisions)
    )


def _lost(told: list[Decision]) -> float:
    """The largest error that a sampler states beyond its rule."""
    return max([0.0, *(each.error for each in told if each.doubt)])


def _left_out(said: Decision, name: str) -> Decision:
    """Decision about a suitable sampler that is left out for its time."""
    if not said.needed:
        return said
    return replace(said, needed=False, doubt=False, reason=f"{said.reason}; but {name} take less time")
