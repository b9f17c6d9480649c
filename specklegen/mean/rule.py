"""Decision whether the ballistic (mean) field matters beside the speckle."""

from dataclasses import replace

import numpy as np

from specklegen.core.cached_results import cached_result
from specklegen.core.decision import Decision
from specklegen.core.errors import RuleError
from specklegen.core.values import remembered
from specklegen.mean.field import mean_field
from specklegen.paths.pilot import scene_pilot
from specklegen.scene.illumination import directions_of_sines
from specklegen.scene.scene import Scene
from specklegen.scene.sensors import FarField, Sensor
from specklegen.theory.phase_screens import scattered_intensity

_BLOCK = 64  # nearest rows and columns in which the rings of a disc are looked for
_MEAN = "mean (ballistic) field"
_NO_BALLISTIC_IMAGE = (
    "{} light reaches {:.2g} times its speckle's intensity at some view: block it, or use views beside it"
)
_WHOSE = {
    "IncoherentObject": "the ballistic image of the object is not modelled, only that of each pixel",
    "CollimatedBeams": "unscattered light is not in an exposure, but in that of each beam",
}
_CHEAP = 1e6  # quadrature nodes of a mean field that is only judged: a tenth of a second


@remembered(64)
def mean_decision(scene: Scene, mean: bool, tolerance: float, reverse: bool = False) -> Decision:
    """The mean field is added only when asked; say where its intensity would exceed the speckle's tolerance."""
    if mean:
        return Decision(_MEAN, True, "asked for")
    if not len(scene.lights) or not np.prod(scene.sensor.shape):
        return Decision(_MEAN, False, "there is no light, or no view")
    if scene.thin is not None:
        return _mean_left_out(strongest_mean(scene) / max(scattered_intensity(scene), 1e-300), tolerance)
    if scene.lock_step_obstacle:
        return _volume_mean_decision(scene, tolerance, reverse)
    pilot = scene_pilot(scene.at_rest, False)
    ratio = strongest_mean(scene) / max(pilot.intensity, 1e-300)
    decision = _mean_left_out(ratio, tolerance)
    if ratio > tolerance and not scene.illumination.coherent:
        return replace(decision, reason=_NO_BALLISTIC_IMAGE.format(_WHOSE[scene.illumination.type], ratio))
    return decision


@remembered(64)
def strongest_mean(scene: Scene) -> float:
    """Return the largest intensity of the nearest tilt's mean field over the views."""
    return cached_result(float, ("strongest mean", scene), lambda: _strongest_mean(scene))


def _strongest_mean(scene: Scene) -> float:
    """Find what :func:`strongest_mean` returns.

    Over a grid it is found without looking at every view. A window's diffraction pattern is the product of its
    sections (square, Gaussian), so that the best column and the best row of the cross through the nearest view have
    the maximum; or it falls off in rings (disc), so that a block about the nearest view holds it.
    """
    tilt = _nearest_tilt(scene)
    beam = scene.beams.replace(directions=tilt[None], times=None)

    def intensity(sensor: Sensor) -> np.ndarray:
        return np.square(np.abs(mean_field(scene.replace(illumination=beam, sensor=sensor))[0]))

    grid = scene.sensor
    if grid.regular_grid is None:
        return float(intensity(grid).max(initial=0.0))

    def over(x: np.ndarray, y: np.ndarray) -> np.ndarray:
        sines = np.stack(np.meshgrid(x, y), axis=-1)
        return intensity(FarField(directions=directions_of_sines("view", sines, grid.sign)))

    near_x, near_y = (axis[np.argsort(np.abs(axis - sine))] for axis, sine in zip(grid.sines, tilt, strict=False))
    if beam.profile == "disc":
        return float(over(near_x[:_BLOCK], near_y[:_BLOCK]).max())
    along, across = over(near_x, near_y[:1])[0], over(near_x[:1], near_y)[:, 0]
    return float(over(near_x[[along.argmax()]], near_y[[across.argmax()]]).max())


def _volume_mean_decision(scene: Scene, tolerance: float, reverse: bool) -> Decision:
    """Judge any geometry at every view for at most eight of the lights, if that is cheap."""
    if not scene.illumination.coherent:
        return Decision(_MEAN, False, "not asked for")

    def at_few_lights() -> float:
        return float(np.square(np.abs(mean_field(few_lights(scene, 8), most_nodes=_CHEAP))).max(initial=0.0))

    try:
        strongest = cached_result(float, ("strongest mean in a volume", scene), at_few_lights)
    except RuleError as refused:
        return Decision(_MEAN, False, f"not requested, and not estimated: {refused}")
    return _mean_left_out(strongest / max(scene_pilot(scene, reverse).intensity, 1e-300), tolerance)


def _mean_left_out(ratio: float, tolerance: float) -> Decision:
    """The decision on a mean that was not asked for, by its intensity over the speckle's where it is strongest."""
    if ratio <= tolerance:
        reason = f"at most {ratio:.2g} of the speckle's intensity at any view"
    else:
        reason = (
            "not included (mean=True adds it, or --mean of `specklegen physics render`), but it reaches "
            f"{ratio:.2g} times the speckle's intensity at some "
            "view: block it, or use views beside it"
        )
    return Decision(_MEAN, False, reason)


def few_lights(scene: Scene, count: int) -> Scene:
    """The scene with at most ``count`` of its lights, spread over all."""
    chosen = np.unique(np.linspace(0, len(scene.lights) - 1, count).astype(int))
    return scene.replace(illumination=scene.illumination.of(chosen))


def _nearest_tilt(scene: Scene) -> np.ndarray:
    """float64[3], the tilt that comes nearest to any view, where its mean field is strongest; ties to the axis."""
    directions, sensor = scene.beams.directions, scene.sensor
    if sensor.regular_grid is not None:
        x, y = sensor.sines
        inside = np.clip(directions[:, :2], [x[0], y[0]], [x[-1], y[-1]])
        gap = np.linalg.norm(directions[:, :2] - inside, axis=1)
    else:
        from scipy.spatial import KDTree

        gap, _ = KDTree(scene.views).query(directions)
    return directions[np.lexsort((-directions[:, 2], gap))[0]]
