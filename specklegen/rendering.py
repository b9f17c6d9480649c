"""Rendering: the whole pipeline on one page.

    scene -> plan -> sampler.prepare -> draw -> images

The planner asks every sampler (:mod:`specklegen.samplers`) and holds the one that serves; it is made ready once and
then draws one realization after the other.
"""

import warnings
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from specklegen.core.arguments import instance, whole_number
from specklegen.core.budgets import checked_budget, paths_for
from specklegen.core.decision import Decision
from specklegen.core.errors import DoubtWarning, reject
from specklegen.core.parallel import one_blas_thread
from specklegen.core.picturing import Pictured, draw_stack
from specklegen.core.random_streams import Seed, pilot_seed
from specklegen.core.showing import summary
from specklegen.mean.field import mean_field
from specklegen.paths.gaussianity import Gaussianity
from specklegen.paths.reversal import Reverse
from specklegen.planning.plan import Plan
from specklegen.planning.planning import plan
from specklegen.samplers.sampler import SamplerName, require_finite
from specklegen.scene.illumination import IncoherentObject
from specklegen.scene.scene import Scene


@dataclass(frozen=True)
class Report:
    """What a render did.

    Attributes
    ----------
    sampler, summation : str
        As in :class:`specklegen.Plan`.
    paths : int
        Paths traced a realization (or once, for the stationary sampler's kernel).
    connections : int
        Connections kept, over all realizations.
    unfinished : int
        Paths ended by ``max_order`` instead of leaving the medium; not 0 only in extreme media.
    expected_error : float
        As in the plan: for views far apart.
    image_error : float
        As in the plan: of intensity correlations within an image, over hundreds of grains; up to sqrt 2 times as large,
        since connections of one path share their entrance. ``rel_error=`` bounds this one.
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
    gaussianity: Gaussianity
    mean_added: bool
    decisions: tuple[Decision, ...]


class SpeckleStack(Pictured):
    """Rendered speckle: ``field`` complex64[(R,) T, *sensor], ``intensity`` float32, ``report``.

    The intensity of collimated beams is |field|^2, tilt by tilt. An incoherent object has one intensity
    image, float32[(R,) *sensor], and no field.

    Examples
    --------
    >>> import specklegen as sg
    >>> slab = sg.Slab(thickness=100.0, mean_free_path=20.0, scatterer=sg.HenyeyGreenstein(0.9))
    >>> light = sg.CollimatedBeams.tilts([0.0, 1e-4], width=5000.0)
    >>> scene = sg.Scene(wavelength=0.5, medium=slab, illumination=light, sensor=sg.FarField.grid((16, 16), 2e-5))
    >>> stack = sg.render(scene, seed=0)
    >>> stack.field.shape, stack.intensity.dtype
    ((2, 16, 16), dtype('float32'))
    >>> stack.report.sampler
    'stationary'
    """

    def __init__(self, field: np.ndarray | None, intensity: np.ndarray | None, report: Report) -> None:
        self._field, self._intensity, self.report = field, intensity, report

    def __repr__(self) -> str:
        held = {"intensity": self._intensity} if self._field is None else {"field": self._field}
        return summary(self, **held, sampler=self.report.sampler, paths=self.report.paths)

    def _facts(self) -> Mapping[str, object]:
        report = self.report
        return {
            "intensity": "x".join(map(str, self.intensity.shape)),
            "sampler": f"{report.sampler} ({report.summation})",
            "paths": report.paths,
            "expected error": report.expected_error,
            "speckle": report.gaussianity,
            "mean field": "added" if report.mean_added else "left out",
        }

    def _draw(self, axes: Any, label: str | None = None) -> None:
        alone = self._field is None and self.intensity.ndim == 2  # the one image of an incoherent object
        draw_stack(axes, self.intensity[None] if alone else self.intensity)
        axes.set_title(label or "")

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
    sampler: SamplerName = "auto",
    reverse: Reverse = "auto",
    mean: bool = False,
    field_tolerance: float = 1e-3,
    threads: int | None = None,
) -> SpeckleStack:
    """Render correlated speckle of one medium (or of several) at every tilt and view of a scene.

    A pure function of its arguments but ``threads``: the same call gives the same bits, and realization r does not
    depend on how many there are. ``field`` is u - m unless ``mean``.

    A seed names a medium only within one scene and plan: tilts and views that shall see the same medium belong into
    one call. Under another set of tilts or views the same seed draws nearly the same medium by path sums (0.985
    to 0.999 correlated with one tilt more, as pilots choose other connections), and an unrelated one by the stationary
    sampler (0.05), whose random numbers are mixed over all tilts together.

    Parameters
    ----------
    scene, paths, rel_error, sampler, reverse, field_tolerance
        See :func:`specklegen.plan`.
    seconds
        Instead of ``paths``, or as a limit to ``rel_error``: as many paths as this time allows here, planning left
        out. The count, which the report states, is fixed before the run and gives the same bits as ``paths=`` it.
    seed
        A whole number, or a sequence of them; see above for what it fixes.
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

    Examples
    --------
    >>> import specklegen as sg
    >>> slab = sg.Slab(thickness=100.0, mean_free_path=20.0, scatterer=sg.HenyeyGreenstein(0.9))
    >>> light = sg.CollimatedBeams.tilts([0.0, 1e-4], width=5000.0)
    >>> scene = sg.Scene(wavelength=0.5, medium=slab, illumination=light, sensor=sg.FarField.grid((16, 16), 2e-5))
    >>> stack = sg.render(scene, seed=0, realizations=3)
    >>> stack.field.shape  # media, tilts, rows, columns
    (3, 2, 16, 16)
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
    remedy = "" if sampler == "auto" else ' Leave the choice to sampler="auto".'
    for doubt in made.doubts:
        warnings.warn(f"{doubt}.{remedy}", DoubtWarning, stacklevel=2)
    images, connections, unfinished = _drawn(made, seed, realizations or 1, threads)
    if mean:
        images = images + mean_field(scene).astype(np.complex64)
    require_finite(images)
    if realizations is None:
        images = images[0]
    report = Report(
        sampler=made.sampler,
        summation=made.summation,
        paths=made.paths,
        connections=connections,
        unfinished=unfinished,
        expected_error=made.expected_error,
        image_error=made.image_error,
        gaussianity=made.gaussianity,
        mean_added=mean,
        decisions=made.decisions,
    )
    if isinstance(scene.illumination, IncoherentObject):
        return SpeckleStack(None, images, report)
    return SpeckleStack(images, None, report)


def _drawn(made: Plan, seed: Seed, realizations: int, threads: int | None) -> tuple[np.ndarray, int, int]:
    """Every realization [R, ...] by the sampler that was planned, and their connections and unfinished paths."""
    images, connections, unfinished = np.empty(0), 0, 0
    with one_blas_thread():
        for r, each in enumerate(made.chosen.prepare(seed, threads).images(realizations)):
            if r == 0:
                images = np.empty((realizations, *each.image.shape), each.image.dtype)
            images[r] = each.image
            connections += each.connections
            unfinished += each.unfinished
    return images, connections, unfinished


def _paths_within(
    choose: Callable[..., Plan], rel_error: float | None, seconds: float, threads: int | None
) -> int:
    """Paths that a time allows, or those of an error if they are fewer; pilots run under a seed of their own."""

    def pilot(count: int) -> float:
        made = choose(paths=count)
        _drawn(made, pilot_seed(made.scene.unitless_fingerprint()), 1, threads)
        return made.expected_error

    allowed = paths_for(0, None, None, seconds, pilot)
    return allowed if rel_error is None else min(allowed, choose(rel_error=rel_error).paths)
