"""Verdicts on a scene from its pilot: what takes part in a render, and why."""

import numpy as np
from scipy.spatial import KDTree

from specklegen.evaluators import scene_evaluator
from specklegen.fields.nufft import NufftEvaluator
from specklegen.gates import Sampler, Verdict, independence_doubt
from specklegen.illumination import CollimatedBeams, IncoherentObject, PointSources
from specklegen.mean import ballistic_fraction, mean_field
from specklegen.pilots import Pilot, scene_pilot, scene_stationary_error
from specklegen.scene import Scene
from specklegen.sensors import FarFieldGrid
from specklegen.values import RuleError, reject

_CHEAP = 1e6  # quadrature nodes of a mean field that is only judged: a tenth of a second


def validity_verdicts(scene: Scene) -> list[Verdict]:
    """What the physics itself assumes of a scene, where it is doubtful."""
    found = []
    medium, wavelength = scene.medium, scene.wavelength
    limited = isinstance(scene.illumination, CollimatedBeams | IncoherentObject)
    width = scene.beams.width if limited else np.inf
    doubt = independence_doubt(medium.mean_free_path, wavelength)
    if doubt:
        found.append(Verdict("independent scattering", True, f"assumed, but doubtful: {doubt}"))
    if width**2 < 10 * wavelength * medium.thickness:
        found.append(
            Verdict(
                "diffraction of the beam inside the slab",
                False,
                f"not modelled, and doubtful here: width^2 / wavelength = {width**2 / wavelength:.3g} is not far "
                f"above the thickness {medium.thickness:g}",
            )  # fmt: skip
        )
    return found


def mean_verdict(scene: Scene, mean: bool, tolerance: float) -> Verdict:
    """The mean field is added only when asked; say where its intensity would exceed the speckle's tolerance."""
    part = "mean (ballistic) field"
    if mean:
        return Verdict(part, True, "asked for")
    if isinstance(scene.illumination, IncoherentObject) or not len(scene.beams.directions):
        return Verdict(part, False, f"its share of the light is {ballistic_fraction(scene):.2g}")
    few = scene.replace(illumination=scene.beams.replace(directions=_nearest_tilt(scene)[None]))
    strongest = float(np.square(np.abs(mean_field(few))).max(initial=0.0))
    speckle = scene_pilot(scene, False).intensity
    if strongest <= tolerance * speckle:
        return Verdict(
            part,
            False,
            f"at most {strongest / max(speckle, 1e-300):.2g} of the speckle's intensity at any view",
        )
    return Verdict(
        part, False,
        f"not asked for (mean=True adds it), though it reaches {strongest / max(speckle, 1e-300):.2g} times the "
        "speckle's intensity at some view",
    )  # fmt: skip


def volume_mean_verdict(scene: Scene, mean: bool, tolerance: float, speckle: float) -> Verdict:
    """The mean field in any geometry, judged at every view for at most eight of the lights, where that is cheap."""
    part = "mean (ballistic) field"
    if mean:
        return Verdict(part, True, "asked for")
    if isinstance(scene.illumination, IncoherentObject) or not len(scene.lights) or not scene.views.size:
        return Verdict(part, False, "not asked for")
    try:
        strongest = float(np.square(np.abs(mean_field(few_lights(scene, 8), most_nodes=_CHEAP))).max(initial=0.0))
    except RuleError as refused:
        return Verdict(part, False, f"not asked for, and not judged: {refused}")
    ratio = strongest / max(speckle, 1e-300)
    if ratio <= tolerance:
        return Verdict(part, False, f"at most {ratio:.2g} of the speckle's intensity at any view")
    return Verdict(
        part, False,
        f"not asked for (mean=True adds it), though it reaches {ratio:.2g} times the speckle's intensity at some view",
    )  # fmt: skip


def few_lights(scene: Scene, count: int) -> Scene:
    """The scene with at most ``count`` of its lights, spread over all."""
    light = scene.illumination
    chosen = np.unique(np.linspace(0, len(scene.lights) - 1, count).astype(int))
    if isinstance(light, PointSources):
        return scene.replace(illumination=light.replace(points=light.points[chosen]))
    assert not isinstance(light, IncoherentObject)
    return scene.replace(illumination=light.replace(directions=light.directions[chosen]))


def _nearest_tilt(scene: Scene) -> np.ndarray:
    """float64[3], the tilt that comes nearest to any view, where its mean field is strongest; ties to the axis."""
    directions, sensor = scene.beams.directions, scene.sensor
    if isinstance(sensor, FarFieldGrid):
        x, y = sensor.sines
        inside = np.clip(directions[:, :2], [x[0], y[0]], [x[-1], y[-1]])
        gap = np.linalg.norm(directions[:, :2] - inside, axis=1)
    else:
        gap, _ = KDTree(scene.views).query(directions)
    return directions[np.lexsort((-directions[:, 2], gap))[0]]


def stationary_verdict(scene: Scene, reverse: bool, sampler: Sampler, tolerance: float) -> Verdict:
    """Whether the stationary sampler serves a scene within the tolerance (physics.md 9)."""
    part = "stationary sampler"
    obstacle = None
    if not isinstance(scene.sensor, FarFieldGrid):
        obstacle = "needs a regular far-field grid"
    elif scene.sensor.side != "transmission":
        obstacle = "serves transmission only"
    elif reverse:
        obstacle = "has no reversed paths"
    elif scene.slab.albedo == 0 or scene.slab.thickness == 0:
        obstacle = "has nothing to do: nothing scatters"
    if obstacle:
        if sampler == "stationary":
            reject("sampler", '"paths" or "auto" for this scene', sampler, f"The stationary sampler {obstacle}.")
        return Verdict(part, False, obstacle)
    if sampler == "paths":
        return Verdict(part, False, "as asked")
    error = scene_stationary_error(scene, tolerance)
    said = (
        f"its correlations are off by {error.correlation:.2g} +- {error.correlation_error:.1g} and its intensities by "
        f"{error.intensity:.2g} +- {error.intensity_error:.1g}, allowed {tolerance:g}"
    )
    if sampler == "stationary":
        return Verdict(part, True, f"asked for; {said}")
    return Verdict(part, error.accepts(tolerance), said)


def evaluator_verdict(
    scene: Scene, pilot: Pilot, tolerance: float, reverse: bool
) -> tuple[NufftEvaluator | None, Verdict]:
    """The NUFFT evaluator where it is possible and cheaper than the direct sum, and why."""
    part = "NUFFT evaluator"
    if not isinstance(scene.sensor, FarFieldGrid):
        return None, Verdict(part, False, "needs a regular far-field grid; the direct sum serves any directions")
    if reverse:
        return None, Verdict(part, False, "reversed paths are summed directly")
    if len(pilot.bank) == 0:
        return None, Verdict(part, False, "nothing scatters")
    nufft = scene_evaluator(scene, reverse, tolerance)
    if nufft is None:
        rows, columns = scene.sensor.shape
        return None, Verdict(part, False, f"no tiles make it cheaper than {rows * columns} views summed directly")
    rows, columns = nufft.tiling.counts
    tiles = "" if nufft.tiles == 1 else f" in {rows}x{columns} tiles"
    return nufft, Verdict(
        part,
        True,
        f"rank {nufft.rank}{tiles} at a relative field error of {nufft.error:.1g} on held-out connections",
    )
