"""The samplers as a benchmark sees them: the work that is timed, and its results."""

from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

from specklegen.core.errors import RuleError, reject
from specklegen.error_time.estimates import (
    Estimate,
    covariance_estimate,
    eigen_estimate,
    paths_estimate,
    screens_estimate,
    single_estimate,
    stationary_estimate,
)
from specklegen.error_time.probes import Probes
from specklegen.memory_effects.cached import estimated_anew
from specklegen.planning.planning import plan
from specklegen.rendering import SpeckleStack, render
from specklegen.samplers.sampler import AnySampler
from specklegen.scene.scene import Scene
from specklegen.scene.sensors import FarField

_MOST_POINTS = 400  # lights times views whose covariance matrix is worth its eigenvectors


class Sampler(NamedTuple):
    """One way to a covariance.

    Attributes
    ----------
    name : str
    work : callable
        (scene, probes, count, seed) -> anything: the call that is timed.
    estimate : callable
        (scene, probes, count, seed, what work returned) -> :class:`Estimate`: what the call implies, found afterwards
        and not timed.
    check : callable
        (scene, probes), raising RuleError where the sampler cannot serve.
    first : int
        Smallest count worth running; 0 for a closed form.
    counted : bool
        Whether a larger count makes it better; a closed form has one error only.
    """

    name: str
    work: Callable[[Scene, Probes, int, int], Any]
    estimate: Callable[[Scene, Probes, int, int, Any], Estimate]
    check: Callable[[Scene, Probes], object] = lambda scene, probes: None
    first: int = 1024
    counted: bool = True

    def obstacle(self, scene: Scene, probes: Probes) -> str | None:
        """Why the sampler cannot serve a scene; None where it can."""
        try:
            self.check(scene, probes)
        except RuleError as error:
            return str(error)
        return None


def rendering(sampler: AnySampler, scene: Scene, probes: Probes, count: int, seed: int) -> SpeckleStack:
    """Render a scene by one sampler, on one thread."""
    with estimated_anew(seed):  # of the stationary sampler, which keeps what it knows of a medium
        return render(scene, paths=count, sampler=sampler, seed=seed, threads=1)


def finished(scene: Scene, probes: Probes, count: int, seed: int, done: Estimate) -> Estimate:
    """The estimate of work that ends in one."""
    return done


def _after(estimate: Callable[[Scene, Probes, int, int], Estimate]) -> Callable[..., Estimate]:
    """Estimates that a render implies, computed again from its seed: its images do not hold them."""
    return lambda scene, probes, count, seed, done: estimate(scene, probes, count, seed)


def _any_directions(scene: Scene) -> Scene:
    """Return the views as a list, which is summed directly."""
    return scene.replace(sensor=FarField(directions=scene.views))


def _render_directly(scene: Scene, probes: Probes, count: int, seed: int) -> SpeckleStack:
    return rendering("paths", _any_directions(scene), probes, count, seed)


def _direct_estimate(scene: Scene, probes: Probes, count: int, seed: int) -> Estimate:
    return paths_estimate(_any_directions(scene), probes, count, seed)


def _check_plan(sampler: AnySampler, scene: Scene, probes: Probes) -> None:
    plan(scene, paths=64, sampler=sampler, threads=1)


def _check_grid(scene: Scene, probes: Probes) -> None:
    if scene.sensor.regular_grid is None or plan(scene, paths=64, sampler="paths", threads=1).summation != "nufft":
        reject("sampler", '"paths", which is the direct sum for this scene', "paths, direct sum")


def _check_volume(scene: Scene, probes: Probes) -> None:
    if scene.thin is not None:
        reject("sampler", '"screens" for a thin medium', "covariance")


def _check_few(scene: Scene, probes: Probes) -> None:
    _check_volume(scene, probes)
    points = len(scene.lights) * len(scene.views)
    if points > _MOST_POINTS:
        reject("sampler", f"for at most {_MOST_POINTS} lights times views", f"eigen-sampling of {points}")


def _check_screens(scene: Scene, probes: Probes) -> None:
    screens_estimate(scene, probes, 0, 0)


def _check_single(scene: Scene, probes: Probes) -> None:
    single_estimate(scene, probes, 0, 0)


SAMPLERS = (
    Sampler("paths", partial(rendering, "paths"), _after(paths_estimate), partial(_check_plan, "paths")),
    Sampler("paths, direct sum", _render_directly, _after(_direct_estimate), _check_grid, 64),
    Sampler("stationary", partial(rendering, "stationary"), _after(stationary_estimate),
            partial(_check_plan, "stationary")),
    Sampler("covariance, few points", covariance_estimate, finished, _check_volume, 256),
    Sampler("covariance, eigen-sampling", partial(rendering, "covariance"), _after(eigen_estimate), _check_few, 256),
    Sampler("single scattering, closed form", single_estimate, finished, _check_single, 0, counted=False),
    Sampler("screens, closed form", screens_estimate, finished, _check_screens, 0, counted=False),
)  # fmt: skip
"""All samplers; which of them serve a scene, :meth:`Sampler.obstacle` says."""
