"""When the stationary sampler may serve a scene, with which memory-effect correlation, and under which envelope."""

from typing import Literal, NamedTuple

import numpy as np

from specklegen.core.cached_results import cached_result
from specklegen.core.decision import Decision
from specklegen.core.errors import RuleError, reject
from specklegen.core.values import remembered
from specklegen.paths.endpoints import AXIS
from specklegen.paths.flows import drifted, uneven_turn
from specklegen.paths.tracer import slab_tracer
from specklegen.samplers.sampler import Request
from specklegen.samplers.stationary.envelope import Envelope
from specklegen.samplers.stationary.object_maps import ObjectMaps, object_maps
from specklegen.samplers.stationary.refracting import refracting_decision
from specklegen.samplers.stationary.stationarity import (
    FIRST_PATHS,
    MOST_PATHS,
    StationaryError,
    pilot_envelope,
    stationary_error,
)
from specklegen.scene.illumination import reference_direction
from specklegen.scene.scene import Scene
from specklegen.scene.sensors import FarFieldGrid
from specklegen.synthesis.exit_grid import Axis, stack_axes

Form = Literal["axial", "oblique", "averaged"]
_FORMS = {"axial": "on-axis approximation", "oblique": "oblique correlation", "averaged": "average over the camera"}
_PART = "stationary sampler"
_MOST_TURN = 0.1  # radians, of which a correlation keeps .995


class Model(NamedTuple):
    """Data with which the stationary sampler draws.

    Attributes
    ----------
    form : "axial", "oblique" or "averaged"
        Its memory-effect correlation: of the axis, about a direction of its own, or over all directions of the camera.
    enveloped : bool
        Whether intensities change with view and tilt (:func:`scene_envelope`); else they are the same everywhere.
    """

    form: Form
    enveloped: bool = False

    def __str__(self) -> str:
        return _FORMS[self.form] + (" under an envelope" if self.enveloped else "")


def stationary_decision(scene: Scene, request: Request) -> tuple[Model | None, Decision]:
    """The model with which the stationary sampler serves a scene within the tolerance.

    The correlation of the axis wherever it is good enough; else the oblique one, about the middle of the beams and the
    views; and where nothing but intensities are off, one of them under an envelope.
    See docs/physics.md 9.
    """
    obstacle = obstacle_of(scene) or ("has no reversed paths" if request.reverse else None)
    if scene.refracts_inside:
        decision = refracting_decision(scene, request, obstacle)
        return (Model("axial") if decision.needed else None), decision
    asked, models = request.asked == "stationary", list[Model]()
    if obstacle is None and request.envelope:
        models = [Model(form, enveloped) for enveloped in (False, True) for form in _forms(scene)]
    elif obstacle is None:  # of a recipe's media that of the axis alone; in reflection coherent objects have another
        back = request.walked and scene.side < 0
        models = [Model(form) for form in _forms(scene) if form == "axial" or back]
    if asked and models and scene.hides_object and _about_axis(scene) and (request.merged or request.envelope):
        models.append(Model("averaged", enveloped=True))
    if scene.polarisers is not None:  # envelopes are those of light that is the same whichever way it is turned
        models = [model for model in models if not model.enveloped]
    if not models:
        obstacle = obstacle or (
            "serves media of recipes in transmission only" if scene.side < 0 else
            "draws polarised light of coherent objects and recipes only before a camera centred on the axis"
        )  # fmt: skip
        if asked:
            reject("sampler", '"paths" or "auto" for this scene', request.asked, f"The stationary sampler {obstacle}.")
        return None, Decision(_PART, False, obstacle)
    allowed = max(request.tolerance, request.beside)
    glance = not (asked or request.beside)  # else what is found too large may be drawn with, and is stated as its error
    errors: dict[Model, StationaryError] = {}
    for model in models:
        if model.form == "averaged" and not errors[models[0]].uneven(request.tolerance):
            continue  # a narrow camera
        if model.form != "averaged" and model.enveloped and errors[Model(model.form)].uncorrelated(allowed):
            continue  # an envelope leaves correlations as they are
        if model.enveloped and not _carried(scene, model, request.envelope):
            continue
        errors[model] = scene_stationary_error(
            scene, request.tolerance, model.form, model.enveloped, request.thorough, glance, request.walked
        )
        if errors[model].accepts(request.tolerance):
            break
    best = min(
        errors, key=lambda m: (not errors[m].accepts(request.tolerance), m.enveloped, errors[m].largest)
    )  # fmt: skip
    directed = [model for model in errors if model.form == "averaged"]
    if directed and not errors[best].accepts(request.tolerance):
        best = directed[0]
    reason = "; ".join(
        f"{model}: correlation error {error.correlation:.2g} ± {error.correlation_error:.1g}, "
        f"intensity error {error.intensity:.2g} ± {error.intensity_error:.1g}"
        for model, error in errors.items()
    )
    reason += f" (limit {request.tolerance:g})"
    accepted = errors[best].accepts(request.tolerance)
    if not (accepted or request.thorough):
        reason += "; tracing more pilot paths would take longer than path sums"
    if asked:
        return best, Decision(_PART, True, f"asked for; {reason}", doubt=not accepted)
    least = min(errors, key=lambda model: errors[model].largest)
    if not accepted and errors[least].accepts(request.beside):
        lost = errors[least].largest
        reason += f"; {least} chosen: its error {lost:.2g} is below that of path sums, {request.beside:.2g}"
        return least, Decision(_PART, True, reason, doubt=True, error=lost)
    return best if accepted else None, Decision(_PART, accepted, reason)


@remembered(64)
def exit_axes(scene: Scene) -> tuple[Axis, Axis]:
    """Return the cells of the exit plane for a scene, wider where its medium moves as one."""
    moved = drifted(scene)
    return stack_axes(scene, None if moved is None else moved[:, :2])


@remembered(64)
def obstacle_of(scene: Scene) -> str | None:
    """Say what keeps the stationary sampler from drawing a scene at all; None where nothing does."""
    other = scene.lock_step_obstacle
    if other:
        return f"needs beams through a slab, seen from afar: {other}"
    if scene.film and scene.volume.flows:
        obstacle = _flow_obstacle(scene)
        if obstacle:
            return obstacle
    if not isinstance(scene.sensor, FarFieldGrid):
        return "needs a regular far-field grid"
    if scene.slab.albedo == 0 or scene.slab.thickness == 0:
        return "needs a medium that scatters"
    if not _forms(scene):
        return "serves hidden objects in transmission only"
    try:
        exit_axes(scene)
    except RuleError as error:
        return f"cannot draw it: {error}"
    return None


def _flow_obstacle(scene: Scene) -> str | None:
    """Say what of a flow keeps the stationary sampler from drawing a film; None where nothing does."""
    moved = drifted(scene)
    if moved is not None:
        return "draws no medium that moves along the axis" if moved[:, 2].any() else None
    turn = uneven_turn(scene)
    if turn <= _MOST_TURN:
        return None
    return (
        f"supports flows near the middle of beams and views: at the outer ones the phase of paths differs by up to "
        f"{turn:.2g} rad (limit {_MOST_TURN:g})"
    )


@remembered(64)
def _forms(scene: Scene) -> tuple[Form, ...]:
    """Forms of the correlation that may serve a scene, the one to prefer first.

    That of the axis is for transmission; a hidden object's modes need its symmetry. The oblique one is the
    same as it where beams and views are about the axis. Polarised beams aside of it have that one alone, whatever the
    analyser is: a seed is one medium behind all of them.
    """
    middle = [reference_direction(scene.beams.directions), scene.sensor.center_direction]  # type: ignore[union-attr]
    axial = scene.side > 0
    oblique = not np.allclose(middle, AXIS, rtol=0, atol=1e-9)
    oblique = oblique and not scene.hides_object
    axial = axial and not (oblique and scene.polarisers is not None)
    return (*(("axial",) if axial else ()), *(("oblique",) if oblique else ()))


def _about_axis(scene: Scene) -> bool:
    """Return whether a scene's camera is about the axis, and its light one that it sees through a slab."""
    return scene.side > 0 and bool(np.allclose(scene.grid.center_direction, AXIS, rtol=0, atol=1e-9))


def _carried(scene: Scene, model: Model, exact: bool) -> bool:
    """Return whether there is an envelope, which a hidden object's images can be drawn under, ``exact`` or merged."""
    if scene_envelope(scene, model.form == "oblique") is None:
        return False
    return not exact or bool(scene.illumination.images) or scene_object_maps(scene) is not None


@remembered(64)
def scene_stationary_error(
    scene: Scene, tolerance: float, form: Form, enveloped: bool = False, thorough: bool = True, glance: bool = True,
    walked: bool = False,
) -> StationaryError:  # fmt: skip
    """Distance of the stationary model with one of its correlations from pilot paths."""
    oblique, averaged = form == "oblique", form == "averaged"
    envelope = scene_envelope(scene, oblique) if enveloped else None
    tracer = slab_tracer(scene, False, aside=False)
    most = MOST_PATHS if thorough else FIRST_PATHS
    return cached_result(
        StationaryError,
        ("stationary error", scene, tolerance, form, enveloped, thorough, glance, *(["walked"] if walked else [])),
        lambda: stationary_error(
            scene, tracer, tolerance, oblique=oblique, averaged=averaged, envelope=envelope, most=most, glance=glance,
            walked=walked,
        ),
    )  # fmt: skip


@remembered(64)
def scene_envelope(scene: Scene, oblique: bool) -> Envelope | None:
    """The envelope of a scene about the axis, or about the middle of its beams and views."""
    tracer = slab_tracer(scene, False, aside=False)
    return cached_result(
        Envelope | None, ("envelope", scene, oblique), lambda: pilot_envelope(scene, tracer, oblique=oblique)
    )


def scene_object_maps(scene: Scene) -> ObjectMaps | None:
    """The envelope of a hidden object's scene in maps of both; None without one, or where it is too narrow for few."""
    envelope = scene_envelope(scene, False)
    return None if envelope is None else object_maps(scene, envelope)
