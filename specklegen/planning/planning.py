"""Planning: scene and budget -> Plan, from a pilot and counted operations, never from a clock.

Each rule stands beside its physics and returns a :class:`~specklegen.core.decision.Decision`; the planner asks every
sampler and folds what they say. A plan is a pure function of the scene and the arguments: pilots are keyed by the
scene's fingerprint. Predicted seconds may differ between machines, choices may not.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Unpack

import numpy as np

from specklegen.core.arguments import flag, instance, real_number, whole_number
from specklegen.core.budgets import Budget, BudgetFields, budget_of
from specklegen.core.decision import Decision
from specklegen.core.errors import RuleError, reject
from specklegen.core.memory import require_memory
from specklegen.core.pace import seconds
from specklegen.core.parallel import thread_count
from specklegen.core.shielded import shielded
from specklegen.core.values import remembered
from specklegen.instrument.lens import Lens
from specklegen.mean.rule import mean_decision
from specklegen.paths.deep_absorption import require_reach
from specklegen.paths.focused_light import focus_moments, narrow_lobes
from specklegen.paths.lit_plane import LitPlane, lens_of, lit_plane
from specklegen.paths.rare_paths import rare_paths_decision
from specklegen.paths.reversal import scene_reversal
from specklegen.planning.choosing import Others, cheapest, served
from specklegen.planning.exposure import with_sub_frames
from specklegen.planning.plan import Plan
from specklegen.samplers.coherent_fields import (
    coherent_decision,
    coherent_mean,
    coherent_obstacle,
    coherent_probe,
)
from specklegen.samplers.covariance.sampler import Eigenfields
from specklegen.samplers.path_sums.sampler import PathSums
from specklegen.samplers.sampler import AnySampler, Request, Sampler, asked_sampler, require_float32
from specklegen.samplers.screens.drawn import always_drawn, drawn_decision
from specklegen.samplers.screens.sampler import Screens
from specklegen.samplers.stationary.convolution import Convolution
from specklegen.samplers.stationary.sampler import Stationary
from specklegen.scene.motion import fastest, reduced_time
from specklegen.scene.scene import Scene
from specklegen.scene.sensors import require_resolved
from specklegen.scene.validity import idealisations, validity_decisions

PACKAGED: tuple[type[Sampler], ...] = (Stationary, PathSums, Eigenfields, Screens, Convolution)
"""Samplers of this library; they are known, as those of users are, by being defined."""
THIN: tuple[type[Sampler], ...] = (Screens,)
"""Those that "auto" asks of thin screens; of volumes of scatterers see :mod:`specklegen.planning.choosing`."""

STATIONARY_TOLERANCE = 0.02


def _simple_terms(scene: Scene) -> list[Decision]:
    """Parts that are zero for beams through a slab of one kind of particle."""
    if scene.thin is not None or scene.lock_step_obstacle or len(scene.slab.scatterer.components) > 1:
        return []
    reason = "zero for far-field views, a homogeneous slab and one kind of particle"
    return [Decision("near-field terms, voxels and mixtures", False, reason)]


def _motion(scene: Scene) -> list[Decision]:
    """Decisions on the motion of the particles of a medium."""
    if scene.thin is not None or not scene.medium.moves:
        return []
    if not scene.film:
        return [Decision("motion", False, "all beams are on at one time (CollimatedBeams.times)")]
    decisions = [Decision(
        "flow", True, "Doppler phases k (w_(b-1) - w_b) . V(x_b) t along every path: exact while particles move little "
        "compared with the mean free path, or all equally",
    )] if scene.volume.flows else []  # fmt: skip
    law, _ = fastest(scene.volume.motions) or (None, None)
    if law is None:
        return decisions
    x = float(reduced_time("CollimatedBeams.times", law, scene.wavelength, np.ptp(np.asarray(scene.beams.times))))
    return [*decisions, Decision(
        "motion", True, f"a film of {len(scene.lights)} frames up to x = k^2 <Dr^2> / 6 = {x:.3g}, after which a path "
        "of momentum transfer Y keeps e^(-2 x Y) of its amplitude (temporal_correlation)",
    )]  # fmt: skip


_SceneRule = Callable[[Scene], list[Decision]]
SCENE_RULES: tuple[_SceneRule, ...] = (_motion, validity_decisions, _simple_terms, idealisations)
"""Rules that judge a scene alone, whatever renders it; those of a pilot are its ``decisions``."""


@remembered(64)
def scene_decisions(scene: Scene) -> tuple[Decision, ...]:
    """Ask the rules that judge a scene alone, once a scene."""
    return tuple(decision for rule in SCENE_RULES for decision in rule(scene))


@shielded()
def plan(
    scene: Scene, *, budget: Budget | None = None, sampler: AnySampler = "auto", mean: bool = False,
    field_tolerance: float = 1e-3, streamed: bool = False, envelope: bool = True, realizations: int = 1,
    **fields: Unpack[BudgetFields],
) -> Plan:  # fmt: skip
    """Choose how to render a scene, and predict what it costs.

    Parameters
    ----------
    scene
        What to simulate: medium, light and sensor.
    budget
        Paths of each realization or an error, threads for which seconds are predicted, and reversed paths,
        which a view close to exact backscattering asks for (:class:`specklegen.results.Budget`). By default 100 000
        paths. ``rel_error`` is the square root of the excess correlation between intensities that a finite
        number of paths leaves within an image, at the worst view: of (2 E w^2 - (E w)^2 - E sum_B w_B^2) / (N
        (E w)^2), w the contribution of a path and w_B of one of its connections, which share their entrance.
        Between views far apart it is sqrt(Var w / (N (E w)^2)), up to sqrt 2 times less
        (:func:`specklegen.coherence.partially_coherent.finite_path_excess`). Also the tolerance of the
        criterion for the stationary sampler, which is 0.02 otherwise.
    sampler
        "auto", or one of "paths", "covariance", "stationary", and of thin media "screens". "covariance" (few lights
        and views) estimates the covariance once and draws every realization from its eigenvectors. "convolution" images
        hidden objects by one pattern a medium, as if C_I were 1 between all their pixels. Or one of your own:
        its name, its import path "module:Name", which is run, or its class
        (:class:`specklegen.samplers.sampler.Sampler`). A sampler that is
        asked for serves even where its rule is against it, if it can; the plan's ``doubts`` say so.
    mean
        Whether the mean field will be added, as where light that is not scattered is seen too.
    field_tolerance
        Relative error of the NUFFT against the direct sum, between 0 and 1; 0.001 by default. Smaller is slower.
    streamed
        State, and hold against the memory there is, what :func:`specklegen.results.render_tiles` holds at a time.
    envelope
        Whether the stationary sampler may draw fields under an envelope that turns with the tilt, and by the
        correlation about another direction than the axis; False of recipes, whose modes know neither.
    realizations
        How many media will be drawn. "auto" takes the sampler that is quickest to draw so many: what is found once
        for all of them counts once.
    fields
        Fields of the budget by name, such as ``paths=10_000, seed=1``, in place of those of ``budget``.

    Raises
    ------
    RuleError
        For an argument out of range, a grid that undersamples the speckle, a sampler that cannot serve
        the scene, a render that would not fit into memory, or fewer paths than it takes for any to carry light
        through an absorbing slab.

    Examples
    --------
    >>> import specklegen as sg
    >>> slab = sg.Slab(thickness=100.0, mean_free_path=20.0, scatterer=sg.media.HenyeyGreenstein(0.9))
    >>> light = sg.light.CollimatedBeams.tilts([0.0, 1e-4], width=5000.0)
    >>> scene = sg.Scene(wavelength=0.5, medium=slab, illumination=light,
    ...                  sensor=sg.sensors.FarField.grid((16, 16), 2e-5))
    >>> sg.plan(scene).sampler
    'stationary'
    >>> sg.plan(scene, sampler="paths", rel_error=0.1).paths
    443
    """
    budget = budget_of("plan", budget, fields, unused=("seconds", "tolerance"))
    return planned(scene, budget, Options(sampler, mean, field_tolerance, streamed, envelope, realizations, "plan"))


@dataclass(frozen=True)
class Options:
    """Request to a plan beside its scene and budget, checked once; :func:`plan` describes each.

    Attributes
    ----------
    asked : type of Sampler or None
        Class of the sampler that is asked for; None of "auto".
    mean, field_tolerance, streamed, envelope, realizations
        As of :func:`plan`.
    walked : bool
        As of a :class:`~specklegen.samplers.sampler.Request`.
    merged : bool
        Whether images may be drawn under the mean envelope of an object, as those of recipes are.
    media : int
        Realizations, 1 where no number is given.
    owner : str
        The verb that is asked, for messages.
    """

    sampler: AnySampler = "auto"
    mean: bool = False
    field_tolerance: float = 1e-3
    streamed: bool = False
    envelope: bool = True
    realizations: int | None = 1
    owner: str = "plan"
    walked: bool = False
    merged: bool = False
    asked: type[Sampler] | None = field(init=False, default=None)
    media: int = field(init=False, default=1)

    def __post_init__(self) -> None:
        media = 1 if self.realizations is None else whole_number(f"{self.owner} realizations", self.realizations, 1)
        tolerance = real_number("field_tolerance", self.field_tolerance)
        if not 0 < tolerance < 1:
            reject("field_tolerance", "between 0 and 1", tolerance,
                   "It is the relative error of the nonuniform FFT; 0.001 is the default.")  # fmt: skip
        checked = {name: flag(name, getattr(self, name)) for name in ("mean", "streamed", "envelope")}
        asked = asked_sampler("sampler", self.sampler)
        for name, value in {**checked, "media": media, "field_tolerance": tolerance, "asked": asked}.items():
            object.__setattr__(self, name, value)


def planned(scene: Scene, budget: Budget, options: Options) -> Plan:
    """Plan within a budget, or refuse: every verb that renders asks here; see :func:`plan`."""
    instance(f"{options.owner} scene", scene, Scene)
    if options.mean and not scene.illumination.coherent:
        reject("mean", "False for an incoherent object, and for exposures", options.mean,
               "Unscattered light is not modelled there.")  # fmt: skip
    if scene.illumination.gridded:
        return _planned_object(scene, budget, options)
    if scene.illumination.focused:
        return _planned_focus(scene, budget, options)
    if scene.imaged:
        return _planned_image(scene, budget, options)
    grid = scene.sensor.regular_grid
    if grid is not None and scene.illumination.limited:
        require_resolved("FarFieldGrid.pitch", scene.wavelength, scene.beams.width, grid.pitch)
    return _planned(scene, budget, options)


def _planned(scene: Scene, budget: Budget, options: Options) -> Plan:
    """Plan what is seen from afar, on a grid of any pitch, or at points."""
    asked, tolerance = options.asked, budget.rel_error if budget.rel_error is not None else STATIONARY_TOLERANCE
    scene, decisions = (scene, []) if scene.illumination.coherent else with_sub_frames(scene, tolerance)
    if asked is not None:
        for obstacle in asked.obstacles(scene):
            others = '"auto" or "screens"' if scene.thin is not None else '"paths" or "auto"'
            reject("sampler", f"{others} for this scene", asked.name, f"The {asked.name} sampler {obstacle}.")
    if not options.streamed:  # the images and their views alone, before any pilot, whose time would be lost
        light = scene.illumination
        each = 8 * len(scene.lights) if light.coherent else 4 * math.prod(light.images)
        _require_memory(scene, int(np.prod(scene.sensor.shape, dtype=float)) * (each + 48))

    reversal = scene_reversal(scene, budget.reverse, tolerance)
    request = Request(
        budget.paths, budget.rel_error, reversal.needed, tolerance, options.field_tolerance,
        "auto" if asked is None else asked.name, options.streamed, options.envelope, options.media,
        walked=options.walked, merged=options.merged,
    )  # fmt: skip
    chosen, of_sampler, others = _proposed(scene, request, asked)
    pilot = getattr(chosen, "pilot", None)  # a sampler without paths has none
    if pilot is not None and chosen.paths:
        require_reach(options.owner, pilot.missed_variance, chosen.paths)
    require_float32(chosen.intensity)
    threads, cost = thread_count(budget.threads), chosen.cost()
    needed = chosen.memory(threads)
    _require_memory(scene, needed, chosen.paths)
    decisions += [*scene_decisions(scene), reversal]
    decisions += [mean_decision(scene, options.mean, tolerance, reversal.needed), *of_sampler]
    if asked is PathSums:
        decisions.append(Decision("stationary sampler", False, "as asked"))
    return Plan(
        scene=scene,
        chosen=chosen,
        reverse=reversal.needed,
        mean=options.mean,
        decisions=(*decisions, *(pilot.decisions if pilot is not None else ())),
        operations=dict(cost.first),
        seconds=seconds(cost.first, threads),
        memory_bytes=needed,
        alternatives={way: seconds(counts, threads) for way, counts in {**cost.alternatives, **others}.items()},
        realizations=options.media,
        setup_seconds=seconds(cost.once, threads),
    )


@remembered(16)
def _proposed(scene: Scene, request: Request, asked: type[Sampler] | None) -> tuple[Sampler, list[Decision], Others]:
    """The sampler of a scene, what is said of those that were asked, and the operations of the others."""
    if asked is None and scene.thin is None:
        return cheapest(scene, request)
    return *served(scene, request, THIN if asked is None else (asked,)), {}


def _planned_object(scene: Scene, budget: Budget, options: Options) -> Plan:
    """Plan coherent objects: by the memory effect between their plane waves, where it serves the outermost of them.

    Else by path sums of every plane wave.
    """
    light, asked = scene.illumination, options.asked
    if asked not in (None, PathSums, Stationary, Screens):
        reject("sampler", '"auto", "stationary", "screens" or "paths" for coherent objects', asked.name,
               "Other samplers do not support sums of beams.")  # fmt: skip
    if scene.thin is not None and asked not in (None, Screens):
        reject("sampler", '"auto" or "screens" for this scene', asked.name, "Thin screens have no paths.")
    if scene.thin is not None and always_drawn(scene):
        return _drawn_plan(scene, budget, options)
    kept_out = None if scene.thin is not None else coherent_obstacle(scene)
    if kept_out is not None and asked is Stationary:
        reject("sampler", '"auto" or "paths" for this scene', asked.name, f"The stationary sampler {kept_out}.")
    lens = few = None
    if kept_out is None and asked is not PathSums and scene.thin is None:
        kept_out = _backscattering(scene, budget)
        if kept_out is not None and asked is Stationary:
            reject("sampler", '"auto" or "paths" for this scene', asked.name, f"The stationary sampler {kept_out}.")
    if kept_out is None and asked is not PathSums and (scene.sensor.focused or scene.sensor.near):
        try:
            lens = lens_of(scene)
        except RuleError as refused:
            if asked is Stationary or scene.imaged:
                raise
            kept_out = f"sums over directions: {refused}"
    if lens is not None:
        turned = lit_plane(lens.scene).turned
        allowed = budget.rel_error if budget.rel_error is not None else STATIONARY_TOLERANCE
        few = _turned(turned, allowed, asked is Stationary) if turned > allowed else None
        kept_out = few.reason if few is not None and not few.needed else None
    if kept_out is not None or asked is PathSums:
        summed = _planned_focus(scene, budget, options)
        left = () if kept_out is None else (Decision("stationary sampler", False, kept_out),)
        return replace(summed, decisions=(*summed.decisions, *left))
    seen = scene if lens is None else lens.pupil_scene
    judged = replace(
        options,
        envelope=False,
        merged=False,
        mean=False,
        walked=True,
        sampler="auto" if scene.thin is None else Screens,
    )
    if asked is not None:
        judged = replace(judged, sampler=asked)
    probe = seen.replace(illumination=coherent_probe(seen))
    made = planned(probe, budget, judged) if lens is None else _planned(probe, budget, judged)
    if made.sampler == PathSums.name:
        summed = _planned_focus(scene, budget, options)
        said = [each for each in made.decisions if each.part == "stationary sampler"]
        return replace(summed, decisions=(*summed.decisions, *said))
    chosen = replace(made.chosen, scene=seen)  # type: ignore[type-var]
    if lens is not None:
        chosen = replace(chosen, phased=True)  # type: ignore[call-arg]
    kept = [each for each in made.decisions if each.part != "mean (ballistic) field"]
    drawn = drawn_decision(scene, kept) if scene.thin is not None else None
    if drawn is not None:
        chosen = replace(chosen, drawn=True)  # type: ignore[call-arg]
        kept = [drawn, *(each for each in kept if each.part != drawn.part)]
    cost, threads = chosen.cost(), thread_count(budget.threads)
    operations, needed = dict(cost.first), chosen.memory(threads)
    if lens is not None:
        operations["flop"] = operations.get("flop", 0.0) + lens.flops(len(light.vectors))
        needed += int(lens.memory)
        kept = [*([] if few is None else [few]), _seen(lens, lit_plane(lens.scene).extent), *kept]
    _require_memory(scene, needed, chosen.paths)
    area = scene.beams.window.area
    ratio = coherent_mean(seen, chosen.intensity / area, scene.optical_depth)
    return replace(
        made, scene=scene, chosen=chosen, mean=options.mean, lens=lens,
        decisions=(*coherent_decision(scene, ratio, options.mean), *kept), operations=operations,
        seconds=seconds(operations, threads), setup_seconds=seconds(cost.once, threads), memory_bytes=needed,
        alternatives={},
    )  # fmt: skip


def _backscattering(scene: Scene, budget: Budget) -> str | None:
    """Say why reversed paths keep the stationary sampler from an object; None where they contribute next to nothing.

    Both ways of a path interfere about exact backscattering of each wave. Fields at different places of the face are
    then no longer uncorrelated, which that sampler takes them for.
    """
    if scene.side > 0:
        return None
    allowed = budget.rel_error if budget.rel_error is not None else STATIONARY_TOLERANCE
    reversal = scene_reversal(scene.replace(illumination=scene.beams), budget.reverse, allowed)
    if budget.reverse is True:
        return "has no reversed paths, which reverse=True asks for"
    return f"has no reversed paths, which {reversal.reason}; look aside of the axis" if reversal.needed else None


def _drawn_plan(scene: Scene, budget: Budget, options: Options) -> Plan:
    """Plan objects behind screens whose phases are drawn: what a lens sees, points, or screens that move."""
    said = drawn_decision(scene)
    assert said is not None
    chosen = Screens(scene, options.streamed, drawn=True)
    cost, needed = chosen.cost(), chosen.memory(thread_count(budget.threads))
    _require_memory(scene, needed)
    asked = "asked for" if options.mean else "not asked for (mean=True adds it)"
    mean = Decision("mean (ballistic) field", options.mean, asked)
    waves = Decision(
        "coherent objects", True, f"the field of {len(scene.illumination.vectors)} over an illuminated width "
        f"{scene.beams.width:.4g}",
    )  # fmt: skip
    return Plan(
        scene=scene, chosen=chosen, reverse=False, mean=options.mean,
        decisions=(waves, mean, said, *scene_decisions(scene)), operations=dict(cost.first),
        seconds=seconds(cost.first, 1), memory_bytes=needed, alternatives={}, realizations=options.media,
    )  # fmt: skip


def _planned_focus(scene: Scene, budget: Budget, options: Options) -> Plan:
    """Plan light that a lens focuses: the fields of its collimated beams, by one bank of paths, and their sums."""
    asked = options.asked
    if asked not in (None, PathSums):
        reject("sampler", '"auto" or "paths" for focused beams', asked.name,
               "Other samplers have light under the illuminated area only, or do not support "
               "sums of beams.")  # fmt: skip
    lit, options = scene.replace(illumination=scene.beams), replace(options, sampler=PathSums, envelope=True)
    beam_plan = planned(lit, budget, options)
    afar = (scene if beam_plan.lens is None else scene.replace(sensor=beam_plan.lens.grid)).at_rest
    moments, lobes = focus_moments(afar, beam_plan.reverse, beam_plan.lens), narrow_lobes(afar, beam_plan.reverse)
    if budget.rel_error is not None:
        paths = moments.paths_for(budget.rel_error, within_image=True)
        if paths > beam_plan.paths:
            beam_plan = planned(lit, replace(budget, paths=paths, rel_error=None), options)
    beams = len(lit.lights)
    judged = beam_plan.chosen.pilot.decisions  # type: ignore[attr-defined] # of each beam alone
    left = {"stationary sampler", "stationary image"}
    kept = [d for d in beam_plan.decisions if d not in judged and d.part not in left | {each.part for each in lobes}]
    focused = Decision(
        "focused light", True, f"{len(scene.illumination.vectors)} foci as sums of {beams} collimated beams of "
        f"width {lit.beams.width:.4g}, from one set of paths",
    )  # fmt: skip
    rare = rare_paths_decision(moments.effective_paths)
    operations = dict(beam_plan.operations)
    sums = 8.0 * len(scene.illumination.vectors) * beams * np.prod(lit.sensor.shape, dtype=float)
    operations["flop"] = operations.get("flop", 0.0) + sums
    return replace(beam_plan, scene=scene, pixel=moments,
                   decisions=(focused, *lobes, *((rare,) if rare else ()), *kept), operations=operations,
                   seconds=seconds(operations, thread_count(budget.threads)))  # fmt: skip


def _planned_image(scene: Scene, budget: Budget, options: Options) -> Plan:
    """Plan what a lens sees: the far field over its pupil, and the image made of that."""
    asked = options.asked
    if asked is not None and asked.abilities.lens == "none":
        reject("sampler", '"auto", "paths" or "stationary" for a camera with a lens', asked.name)
    tolerance = budget.rel_error if budget.rel_error is not None else STATIONARY_TOLERANCE
    scene, exposed = (scene, []) if scene.sensor.near else _with_sub_frames(scene, tolerance)
    lens = lens_of(scene)
    lit = lit_plane(lens.scene)
    few = _too_narrow(lens.scene, lit, asked)
    at_faces = asked is not None and asked.abilities.lens == "face"
    if few is None and lit.turned > tolerance:
        few = _turned(lit.turned, tolerance, at_faces)
    options = replace(options, streamed=False, envelope=True)
    if few is not None and asked is None:
        options = replace(options, sampler=PathSums)
    pupil_plan = _planned(lens.pupil_scene, budget, options)
    pixel = lit.moments if pupil_plan.chosen.abilities.medium_by_medium else None
    pilot = getattr(pupil_plan.chosen, "pilot", None)  # it judges views up to the corners of the square about the pupil
    judged = () if pilot is None or pixel is None else pilot.decisions
    kept = [
        d for d in pupil_plan.decisions
        if d not in judged and d.part != "pupil" and (d.reason != "as asked" or asked is not None)
    ]  # fmt: skip
    rare = None if pixel is None else rare_paths_decision(pixel.effective_paths)
    if pixel is not None and budget.rel_error is not None:
        paths = pixel.paths_for(budget.rel_error, within_image=True)
        if paths > pupil_plan.paths:
            budget = replace(budget, paths=paths, rel_error=None)
            pupil_plan = _planned(lens.pupil_scene, budget, replace(options, sampler=PathSums))
    operations = dict(pupil_plan.operations)
    operations["flop"] = operations.get("flop", 0.0) + lens.flops(len(lens.pupil_scene.lights))
    memory = int(pupil_plan.memory_bytes + lens.memory)
    _require_memory(scene, memory, pupil_plan.paths)
    seen = _seen(lens, lit.extent)
    return replace(pupil_plan, scene=scene, lens=lens, pixel=pixel,
                   decisions=(*exposed, seen, *(d for d in (few, rare) if d), *kept), operations=operations,
                   seconds=seconds(operations, thread_count(budget.threads)), memory_bytes=memory)  # fmt: skip


def _turned(turned: float, allowed: float, asked: bool) -> Decision:
    """Say that the pattern moves with the beam, against which the stationary sampler may be asked for."""
    return Decision(
        "stationary image", asked, f"between the middle of the pupil and its rim its correlation under "
        f"a tilt turns by {turned:.2g}, for the pattern moves with the beam, allowed {allowed:g}", doubt=asked,
    )  # fmt: skip


def _seen(lens: Lens, extent: float) -> Decision:
    """Say over what directions an image is summed."""
    views = lens.grid.shape[0]
    return Decision(
        "lens", True, f"{views}x{views} directions around sines up to {lens.camera.aperture:.3g}; its plane, "
        f"{lens.camera.focus:.4g} behind the face, is lit over {extent:.4g} and repeats after {lens.period:.4g}",
    )  # fmt: skip


def _with_sub_frames(scene: Scene, tolerance: float) -> tuple[Scene, list[Decision]]:
    """The scene with instants for every exposure, as many as views over the pupil ask for; and what is said of them."""
    afar = scene.replace(sensor=scene.sensor.pupil_grid(3))  # type: ignore[attr-defined]
    exposed, decisions = with_sub_frames(afar, tolerance)
    return scene.replace(illumination=exposed.illumination), decisions


def _too_narrow(scene: Scene, lit: LitPlane, asked: type[Sampler] | None) -> Decision | None:
    """Why the stationary sampler cannot draw an image: its light ends where the window does, and has no halo."""
    window, reach = scene.beams.window, scene.sensor.reach  # type: ignore[attr-defined]
    if reach + lit.halo <= window.flat:
        return None
    width = (reach + lit.halo) / window.flat * window.width if window.flat else np.inf
    reason = f"95 % of the light come from up to {lit.halo:.4g} aside, and the image reaches {reach:.4g}"
    remedy = (
        f"use an illuminated area at least {width:.4g} wide, or an image at most "
        f"{max(2 * (window.flat - lit.halo), 0):.4g} across"
        if window.flat else "use a square or a round illuminated area, which is even in its middle"
    )  # fmt: skip
    if asked is not None and asked.abilities.lens == "face":
        reject("sampler", '"paths" or "auto" for this image', asked.name,
               f"The stationary sampler has light under the illuminated area only: {reason}; {remedy}.")  # fmt: skip
    return Decision("stationary image", False, f"it has light under the illuminated area only, and {reason}")


def streaming_obstacle(scene: Scene) -> str | None:
    """Why :func:`specklegen.results.render_tiles` does not serve a scene; None where it does."""
    if scene.illumination.focused:
        return "focused beams, whose fields are sums over other beams"
    if scene.sensor.regular_grid is not None and getattr(scene.illumination, "exposure", None) is not None:
        return "beams with an exposure, whose images have no field"
    if scene.sensor.regular_grid is None or not (scene.illumination.limited and scene.illumination.coherent):
        return f"{type(scene.illumination).__name__} seen by {type(scene.sensor).__name__}"
    return scene.lock_step_obstacle


def _require_memory(scene: Scene, needed: int, paths: int = 0) -> None:
    def remedy() -> str:
        stream = ", or stream the stack by render_tiles." if streaming_obstacle(scene) is None else "."
        return f"Render fewer tilts or fewer views{' or paths' if paths else ''} at a time{stream}"

    traced = f", {paths} paths" if paths else ""
    what = f"{len(scene.lights)} tilts of {scene.sensor.shape} views{traced}"
    require_memory("Scene", "renderable", needed, what, remedy, share=0.9)
