"""When the stationary sampler serves layers that refract.

Its K is that of light along the axis (:mod:`specklegen.paths.analog_walk`), and is judged in two parts. Its
correlations at the window's mismatches kappa are judged by the ways R of that light,

    C_exact = W^(kappa) E[w e^(-ik (t + kappa) . R)] / E[w],     C_model = W^(kappa) K(t),

at tilts as small as the memory effect knows (:mod:`specklegen.samplers.stationary.stationarity`). The evenness of its
intensities over views and tilts is judged by the same layers without steps, whose paths are quicker: faces that
reflect make light more even. In a layer of a lower index than that of the tilts light is steeper, by the ratio m of
both, and intensities are off by m^2 times as much.
"""

from dataclasses import replace

import numpy as np

from specklegen.core.cached_results import cached_result
from specklegen.core.decision import Decision
from specklegen.core.errors import reject
from specklegen.core.statistics import batch_sums, jackknife
from specklegen.core.values import remembered
from specklegen.memory_effects.curve import small_tilts
from specklegen.paths.axial_pilot import axial_pilot
from specklegen.paths.far_field import SLANT, steepest
from specklegen.paths.steps import without_steps
from specklegen.paths.tracer import slab_tracer
from specklegen.samplers.sampler import Request
from specklegen.samplers.stationary.stationarity import (
    StationaryError,
    probe_mismatches,
    probe_tilts,
    probe_views,
    stationary_error,
)
from specklegen.scene.scene import Scene


def refracting_decision(scene: Scene, request: Request, obstacle: str | None) -> Decision:
    """Decide on a scene of layers that refract: served with the correlation of the axis, or left to path sums."""
    obstacle = obstacle or _beyond_axis(scene)
    if obstacle and request.asked == "stationary":
        reject("sampler", '"paths" or "auto" for this scene', request.asked, f"The stationary sampler {obstacle}.")
    if obstacle:
        return Decision("stationary sampler", False, obstacle)
    error = scene_error(scene, request.tolerance)
    reason = (
        f"refracting layers near the axis: correlation error {error.correlation:.2g} ± {error.correlation_error:.1g}, "
        f"intensity error without index steps {error.intensity:.2g} ± {error.intensity_error:.1g} "
        f"(limit {request.tolerance:g})"
    )
    accepted = error.accepts(request.tolerance)
    asked = request.asked == "stationary"
    return Decision("stationary sampler", accepted or asked, reason, doubt=asked and not accepted)


def _beyond_axis(scene: Scene) -> str | None:
    """Part of a scene that is too far from the axis, or None."""
    if scene.side < 0:
        return "supports only layers that refract"
    sines = np.concatenate([np.zeros((1, 2)), scene.beams.directions[:, :2]])
    tilts = np.arcsin(np.hypot(*sines.T))
    if not small_tilts(scene.slab, scene.wavelength, tilts) or steepest(scene.slab, tilts) ** 2 > SLANT:
        return (
            f"supports small tilts behind layers that refract: {tilts.max():.3g} rad is not small compared with their "
            "phase function"
        )
    views = np.arcsin(np.hypot(*probe_views(scene).T))
    if steepest(scene.slab, views) ** 2 > SLANT:
        return f"supports views near the axis behind layers that refract: {views.max():.3g} rad is not near"
    return None


@remembered(64)
def scene_error(scene: Scene, tolerance: float) -> StationaryError:
    """Distance of the model from light along the axis, and its evenness from that of layers without steps."""
    about = ("stationary error of layers", scene, tolerance)
    return cached_result(StationaryError, about, lambda: _scene_error(scene, tolerance))


def _scene_error(scene: Scene, tolerance: float) -> StationaryError:
    """Result of :func:`scene_error`."""
    light = axial_pilot(scene).light
    paths = len(light.weight)
    # What was scattered once goes straight: both parts of a path, one after the other.
    weight = np.concatenate([light.once, light.weight - light.once])
    way, owner = np.tile(light.displacement, (2, 1)), np.tile(np.arange(paths), 2)
    orders = np.repeat([1, 2], paths)

    def sums(values: np.ndarray) -> np.ndarray:
        return batch_sums(values, owner, paths)

    if not weight.any():
        reject(scene.slab.type, "a medium that transmits light", scene.slab,
               f"None of {paths} pilot paths carried light. Use a thinner medium.")
    rows, gains = [], []
    for tilt in probe_tilts(scene, orders, weight, way):
        for kappa, gain in probe_mismatches(scene):
            exact, model = (sums(weight * np.exp(-1j * scene.wavenumber * (way @ q))) for q in (tilt + kappa, tilt))
            rows += [exact, model]
            gains.append(gain)
    table, gain = np.array([*rows, sums(weight)]).T, np.array(gains)

    def differences(total: np.ndarray) -> np.ndarray:
        exact, model = np.square(np.abs(total[:-1] / total[-1])).reshape(-1, 2).T
        return gain**2 * (exact - model)

    value, error = jackknife(table, differences)
    worst = np.abs(value).argmax()
    even = scene.replace(medium=without_steps(scene.slab))
    even_error = stationary_error(even, slab_tracer(even, False, aside=False), tolerance)
    inside = scene.slab.faces.inside
    wider = max(1.0, inside / min((*scene.slab.indices, inside))) ** 2
    return replace(
        even_error, correlation=float(abs(value[worst])), correlation_error=float(error[worst]),
        intensity=wider * even_error.intensity, intensity_error=wider * even_error.intensity_error,
    )  # fmt: skip
