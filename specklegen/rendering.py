"""Rendering: the whole pipeline on one page.

    scene -> plan -> sampler.prepare -> draw -> images

The planner asks every sampler (:mod:`specklegen.samplers`) and holds the one that serves; it is made ready once and
then draws one realization after the other.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, Unpack

import numpy as np

from specklegen.core.budgets import Budget, BudgetFields, budget_of, paths_within, require_time
from specklegen.core.decision import Decision
from specklegen.core.display.plot import Pictured, draw_stack
from specklegen.core.display.repr import summary
from specklegen.core.errors import reject, warn_user
from specklegen.core.labelled import ASKED, Labelled, Labels
from specklegen.core.memory import require_memory
from specklegen.core.parallel import one_blas_thread
from specklegen.core.random_streams import Seed, pilot_seed
from specklegen.core.shielded import shielded
from specklegen.mean.field import mean_field
from specklegen.memory_effects.cached import estimated_anew
from specklegen.paths.gaussianity import Gaussianity
from specklegen.planning.plan import Plan
from specklegen.planning.planning import Options, planned
from specklegen.samplers.sampler import AnySampler, image_of, require_finite
from specklegen.scene.scene import Scene


@dataclass(frozen=True)
class Report:
    """Report of a render.

    Attributes
    ----------
    sampler, summation : str
        As in :class:`specklegen.results.Plan`.
    paths : int
        Paths traced a realization (or once for a medium, for the stationary sampler's correlation; 0 where it is from
        the lookup table).
    connections : int
        Connections kept, over all realizations.
    unfinished : int
        Paths ended by ``max_order`` instead of leaving the medium; not 0 only in extreme media.
    expected_error : float
        As in the plan: for views far apart.
    image_error : float
        As in the plan: of intensity correlations within an image, over hundreds of grains; up to sqrt 2 times as large,
        since connections of one path share their entrance. ``rel_error=`` bounds this one.
    correlation_error : float
        As in the plan: of the correlations between tilts, which the stationary sampler estimates once for all seeds.
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
    image_error: float
    correlation_error: float
    gaussianity: Gaussianity
    mean_added: bool
    decisions: tuple[Decision, ...]


class SpeckleStack(Pictured, Labelled):
    """Rendered speckle: ``field`` complex64[(R,) T, *sensor], ``intensity`` float32, ``report``.

    The intensity of collimated beams is |field|^2, tilt by tilt; over an exposure it is the mean of that,
    float32[(R,) T, *sensor], and there is no field. An incoherent object has one intensity image,
    float32[(R,) *sensor], and no field.

    Attributes
    ----------
    field : complex64[(R,) T, *sensor] or None
        The field, in the square root of power per solid angle over irradiance (of points that of an irradiance ratio);
        asking for it raises a RuleError where there is none.
    intensity : float32
        |field|^2, or what there is without a field.
    report : Report
        How it was made: sampler, paths, expected errors, and what was left out, with reasons.
    scene : Scene or None
        The scene, whose coordinates pictures and tables have; None of a stack put together by hand.

    Examples
    --------
    >>> import specklegen as sg
    >>> slab = sg.Slab(thickness=100.0, mean_free_path=20.0, scatterer=sg.media.HenyeyGreenstein(0.9))
    >>> light = sg.light.CollimatedBeams.tilts([0.0, 1e-4], width=5000.0)
    >>> scene = sg.Scene(wavelength=0.5, medium=slab, illumination=light,
    ...                  sensor=sg.sensors.FarField.grid((16, 16), 2e-5))
    >>> stack = sg.render(scene, seed=0)
    >>> stack.field.shape, stack.intensity.dtype
    ((2, 16, 16), dtype('float32'))
    >>> stack.report.sampler
    'stationary'
    """

    _named = {"intensity": "intensity", "sampler": "report.sampler", "summation": "report.summation",
              "paths": "report.paths", "expected error": "report.expected_error", "speckle": "report.gaussianity",
              "mean field added": "report.mean_added"}  # fmt: skip
    _single = ("report.sampler", "report.summation", "report.paths", "report.expected_error", "report.image_error",
               "report.mean_added")  # fmt: skip

    def __init__(
        self, field: np.ndarray | None, intensity: np.ndarray | None, report: Report, scene: Scene | None = None
    ) -> None:
        self._field, self._intensity, self.report, self._scene = field, intensity, report, scene

    def __repr__(self) -> str:
        held: dict[str, Any] = {"intensity": self._intensity} if self._field is None else {"field": self._field}
        return summary(self, **held, sampler=self.report.sampler, paths=self.report.paths)

    def _arrays(self) -> Mapping[str, Labels]:
        """Name the images, with directions or points of their views and lights where the scene is known."""
        intensity, scene = self.intensity, self._scene
        lead, sensor = ("tilts",), 2
        if scene is not None:
            lead, sensor = lead[: len(scene.illumination.images)], len(scene.sensor.shape)
        seen = ("rows", "columns") if sensor == 2 else tuple(f"views_{n}" for n in range(sensor))
        axes = (*("realizations",)[: intensity.ndim - sensor - len(lead)], *lead, *seen)
        labels: dict[str, Labels] = {}
        if scene is not None:
            labels |= _seen(seen, scene.sensor)
            if lead:
                labels |= _placed("light_", lead, scene.lights, scene.illumination.near)
        near = scene is not None and (scene.sensor.near or scene.sensor.focused)  # else an area a steradian
        if self._field is not None:
            labels["field"] = Labels(axes, self._field, "1" if near else "length of the scene")
        return labels | {"intensity": Labels(axes, intensity, "1" if near else "squared length of the scene")}

    def _draw(self, axes: Any, label: str | None = None) -> None:
        alone = self._field is None and self.intensity.ndim == 2  # the one image of an incoherent object
        draw_stack(axes, self.intensity[None] if alone else self.intensity)

    @property
    def field(self) -> np.ndarray:
        """complex64[(R,) T, *sensor.shape]; |u|^2 is area per steradian for unit irradiance."""
        if self._field is None:
            reject("SpeckleStack.field", "asked of coherent illumination", "IncoherentObject, or an exposure",
                   "Its beams or instants are mutually incoherent, so intensities add and no one field exists: "
                   "use .intensity.")  # fmt: skip
        return self._field

    @property
    def intensity(self) -> np.ndarray:
        """float32, |field|^2, its mean over each exposure, or the image of an incoherent object."""
        if self._intensity is not None:
            return self._intensity
        return np.square(self.field.real) + np.square(self.field.imag)


def _seen(axes: tuple[str, ...], sensor: Any) -> dict[str, Labels]:
    """Name where the views are: directions, points, or places on the plane in focus."""
    if not sensor.focused:
        return _placed("", axes, sensor.vectors, sensor.near)
    x, y = sensor.positions
    unit = "length of the scene"
    return {"x": Labels(axes[1:], x, unit, coordinate=True), "y": Labels(axes[:1], y, unit, coordinate=True)}


def _placed(whose: str, axes: tuple[str, ...], vectors: np.ndarray, near: bool) -> dict[str, Labels]:
    """Name the components of directions, or of points, float64[..., d]."""
    letters = "xyz" if vectors.shape[-1] == 3 else "xz"
    unit = "length of the scene" if near else "1"
    names = [f"{whose}{letter}" if near else f"{whose}direction_{letter}" for letter in letters]
    return {name: Labels(axes, vectors[..., n], unit, coordinate=True) for n, name in enumerate(names)}


@shielded()
def render(
    scene: Scene, *, budget: Budget | None = None, realizations: int | None = None, sampler: AnySampler = "auto",
    mean: bool = False, field_tolerance: float = 1e-3, **fields: Unpack[BudgetFields],
) -> SpeckleStack:  # fmt: skip
    """Render correlated speckle of one medium (or of several) at every tilt and view of a scene.

    A pure function of its arguments but ``threads``: the same call gives the same bits, and realization r of a sampler
    does not depend on how many there are. "auto" may take another sampler for more of them. ``field`` is u - m unless
    ``mean``.

    A seed names a medium only within one scene and plan: tilts and views that shall see the same medium belong into
    one call. Under another set of tilts or views the same seed draws nearly the same medium by path sums (0.985
    to 0.999 correlated with one tilt more, as pilots choose other connections); it draws an unrelated one by the
    stationary sampler (0.05), whose random numbers are mixed over all tilts together.

    Parameters
    ----------
    scene
        Medium, light and sensor, in one unit of length.
    budget
        Paths of each realization or an error, time for all of them, seed, threads and reversed paths
        (:class:`specklegen.results.Budget`). ``rel_error`` is the root of the excess correlation of intensities that
        too few paths leave in an image (:func:`specklegen.plan`), and the tolerance of "auto", which is 0.02
        otherwise. By default 100 000 paths.
    realizations
        Number of media; None renders one and drops the axis.
    sampler
        "auto" takes the cheapest that is right within the tolerance; "paths", "stationary", "covariance", "screens"
        or one of your own, where you know better (:func:`specklegen.plan` says what each serves).
    mean
        Add the mean field m: what is not scattered, and the mean of what is.
    field_tolerance
        Relative error of the NUFFT against the direct sum, between 0 and 1: smaller is slower.
    fields
        Fields of the budget by name, such as ``paths=10_000, seed=1``, in place of those of ``budget``.

    Returns
    -------
    SpeckleStack
        ``.field``, ``.intensity``, ``.report``.

    Raises
    ------
    RuleError
        For an argument out of range, a grid that undersamples the speckle, a sampler that cannot serve the scene, a
        render that would not fit into memory, or fewer paths than carry light through an absorbing slab.

    Examples
    --------
    >>> import specklegen as sg
    >>> slab = sg.Slab(thickness=100.0, mean_free_path=20.0, scatterer=sg.media.HenyeyGreenstein(0.9))
    >>> light = sg.light.CollimatedBeams.tilts([0.0, 1e-4], width=5000.0)
    >>> scene = sg.Scene(wavelength=0.5, medium=slab, illumination=light,
    ...                  sensor=sg.sensors.FarField.grid((16, 16), 2e-5))
    >>> stack = sg.render(scene, seed=0, realizations=3)
    >>> stack.field.shape  # media, tilts, rows, columns
    (3, 2, 16, 16)
    """
    budget = budget_of("render", budget, fields, unused=("tolerance",))
    options = Options(sampler, mean, field_tolerance, realizations=realizations, owner="render")
    stack = rendered(scene, budget, options)
    vars(stack)[ASKED] = {"scene": scene, "budget": budget, "mean": mean, "realizations": realizations}
    return stack


def rendered(scene: Scene, budget: Budget, options: Options) -> SpeckleStack:
    """Render within a budget, for the verb that owns it; see :func:`render`."""
    count, alone = options.media, options.realizations is None
    if budget.seconds is not None:
        options = replace(options, realizations=1)
        budget = _within_seconds(scene, budget, options, count)
    plan = planned(scene, budget, options)
    light = scene.illumination
    each = math.prod(light.images) * (8 if light.coherent else 4)  # bytes of a view
    held = (2 if options.mean else 1) * count * math.prod(scene.sensor.shape) * each
    require_memory(f"{options.owner} realizations", "held", held, f"{count} media",
                   "Render fewer at a time, each range under a seed of its own.", share=0.9)  # fmt: skip
    require_time(f"{options.owner} paths", plan.seconds_of(count), f"{plan.paths} paths, {count} media",
                 "Ask for fewer paths, or for a larger rel_error.")  # fmt: skip
    remedy = "" if options.asked is None else ' Use sampler="auto".'
    for doubt in plan.doubts:
        warn_user(f"{doubt}.{remedy}")
    images, connections, unfinished = _drawn(plan, budget.seed, count, budget.threads)
    if options.mean:
        images = images + mean_field(scene).astype(np.complex64)
    require_finite(images)
    report = Report(
        sampler=plan.sampler,
        summation=plan.summation,
        paths=plan.paths,
        connections=connections,
        unfinished=unfinished,
        expected_error=plan.expected_error,
        image_error=plan.image_error,
        correlation_error=plan.correlation_error,
        gaussianity=plan.gaussianity,
        mean_added=options.mean,
        decisions=plan.decisions,
    )
    images = images[0] if alone else images
    return SpeckleStack(images, None, report, scene) if light.coherent else SpeckleStack(None, images, report, scene)


def _drawn(made: Plan, seed: Seed, realizations: int, threads: int | None) -> tuple[np.ndarray, int, int]:
    """Every realization [R, ...] by the sampler that was planned, and their connections and unfinished paths."""
    images, connections, unfinished = np.empty(0), 0, 0
    light = made.scene.illumination
    summed = light.focused and not made.chosen.scene.illumination.focused  # else the sampler has added the fields
    focus = light.amplitudes(made.scene.wavelength) if summed else None  # type: ignore[attr-defined]
    with one_blas_thread():
        for r, each in enumerate(made.chosen.prepare(seed, threads).media(realizations)):
            image = each.image
            if focus is not None:
                image = np.tensordot(focus.astype(image.dtype), image, axes=1)
            if made.lens is not None:
                image = image_of(made.scene, made.lens.image(image, from_face=made.chosen.abilities.lens == "face"))
            if realizations == 1:
                images = image[None]
            else:
                images = images if r else np.empty((realizations, *image.shape), image.dtype)
                images[r] = image
            connections += each.connections
            unfinished += each.unfinished
    return images, connections, unfinished


def _within_seconds(scene: Scene, budget: Budget, options: Options, realizations: int) -> Budget:
    """Return the budget with the paths that its time allows, or those of its error if they are fewer.

    Pilots run under a seed of their own.
    """
    assert budget.seconds is not None

    def pilot(count: int) -> float:
        plan = planned(scene, replace(budget, paths=count, rel_error=None, seconds=None), options)
        seed = pilot_seed(plan.scene.unitless_fingerprint())
        with estimated_anew(seed):
            _drawn(plan, seed, 1, budget.threads)
        return plan.expected_error

    wanted = None
    if budget.rel_error is not None:
        wanted = planned(scene, replace(budget, seconds=None), options).paths
        if not wanted:  # nothing is left to be traced
            return replace(budget, seconds=None)
    paths = paths_within(budget.seconds / realizations, pilot)
    paths = paths if wanted is None else min(paths, wanted)
    return replace(budget, paths=paths, rel_error=None, seconds=None)
