"""Verdicts on a scene from its pilot: what takes part in a render, and why."""

from dataclasses import replace
from typing import Literal

import numpy as np
from scipy.spatial import KDTree

from specklegen.evaluators import scene_evaluator
from specklegen.fields.ends import AXIS
from specklegen.fields.nufft import NufftEvaluator
from specklegen.gates import Sampler, Verdict, independence_doubt
from specklegen.illumination import (
    CollimatedBeams,
    IncoherentObject,
    PointSources,
    directions_of_sines,
    reference_direction,
)
from specklegen.mean import mean_field
from specklegen.pilots import Pilot, scene_pilot, scene_stationary_error
from specklegen.scene import Scene
from specklegen.sensors import FarField, FarFieldGrid, Sensor
from specklegen.stationary.criterion import StationaryError
from specklegen.values import RuleError, reject, remembered

SIMPLER = Verdict(
    "near-field terms, voxels and mixtures", False,
    "nothing is lost: the views are directions, the slab is homogeneous, and its particles are of one kind",
)  # fmt: skip
_BLOCK = 64  # nearest rows and columns in which the rings of a disc are looked for
Kernel = Literal["axial", "skewed"]
_KERNELS = {"axial": "kernel of the axis", "skewed": "kernel of its own direction"}
_MEAN = "mean (ballistic) field"
_NO_BALLISTIC_IMAGE = (
    "the object's ballistic image is not modelled, though each pixel's light reaches {:.2g} times its speckle's "
    "intensity at some view: a camera blocks it or looks beside it"
)
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
    if mean:
        return Verdict(_MEAN, True, "asked for")
    if not len(scene.beams.directions):
        return Verdict(_MEAN, False, "there is no light")
    ratio = _strongest_mean(scene) / max(scene_pilot(scene, False).intensity, 1e-300)
    verdict = _mean_left_out(ratio, tolerance)
    if ratio > tolerance and isinstance(scene.illumination, IncoherentObject):
        return replace(verdict, reason=_NO_BALLISTIC_IMAGE.format(ratio))
    return verdict


@remembered(64)
def _strongest_mean(scene: Scene) -> float:
    """Largest intensity of the nearest tilt's mean field over the views.

    Over a grid it is found without looking at every view. A window's diffraction pattern is the product of its
    sections (square, Gaussian), so that the best column and the best row of the cross through the nearest view have
    the maximum; or it falls off in rings (disc), so that a block about the nearest view holds it.
    """
    tilt = _nearest_tilt(scene)
    beam = scene.beams.replace(directions=tilt[None])

    def intensity(sensor: Sensor) -> np.ndarray:
        return np.square(np.abs(mean_field(scene.replace(illumination=beam, sensor=sensor))[0]))

    grid = scene.sensor
    if not isinstance(grid, FarFieldGrid):
        return float(intensity(grid).max(initial=0.0))

    def over(x: np.ndarray, y: np.ndarray) -> np.ndarray:
        sines = np.stack(np.meshgrid(x, y), axis=-1)
        return intensity(FarField(directions=directions_of_sines("view", sines, grid.sign)))

    near_x, near_y = (axis[np.argsort(np.abs(axis - sine))] for axis, sine in zip(grid.sines, tilt, strict=False))
    along, across = over(near_x, near_y[:1])[0], over(near_x[:1], near_y)[:, 0]
    best = over(near_x[[along.argmax()]], near_y[[across.argmax()]])
    return float(max(best.max(), over(near_x[:_BLOCK], near_y[:_BLOCK]).max()))


def volume_mean_verdict(scene: Scene, mean: bool, tolerance: float, speckle: float) -> Verdict:
    """The mean field in any geometry, judged at every view for at most eight of the lights, where that is cheap."""
    if mean:
        return Verdict(_MEAN, True, "asked for")
    if isinstance(scene.illumination, IncoherentObject) or not len(scene.lights) or not scene.views.size:
        return Verdict(_MEAN, False, "not asked for")
    try:
        strongest = float(np.square(np.abs(mean_field(few_lights(scene, 8), most_nodes=_CHEAP))).max(initial=0.0))
    except RuleError as refused:
        return Verdict(_MEAN, False, f"not asked for, and not judged: {refused}")
    return _mean_left_out(strongest / max(speckle, 1e-300), tolerance)


def _mean_left_out(ratio: float, tolerance: float) -> Verdict:
    """The verdict on a mean that was not asked for, by its intensity over the speckle's where it is strongest."""
    if ratio <= tolerance:
        reason = f"at most {ratio:.2g} of the speckle's intensity at any view"
    else:
        reason = (
            f"not asked for (mean=True adds it), though it reaches {ratio:.2g} times the speckle's intensity at some "
            "view: a camera blocks it or looks beside it"
        )
    return Verdict(_MEAN, False, reason)


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


def stationary_verdict(
    scene: Scene, reverse: bool, sampler: Sampler, tolerance: float
) -> tuple[Kernel | None, Verdict]:
    """The memory-effect kernel with which the stationary sampler serves a scene within the tolerance (physics.md 9).

    That of the axis wherever it is good enough; else the skewed one, about the middle of the beams and the views.
    """
    part = "stationary sampler"
    obstacle = _stationary_obstacle(scene, reverse)
    if obstacle:
        if sampler == "stationary":
            reject("sampler", '"paths" or "auto" for this scene', sampler, f"The stationary sampler {obstacle}.")
        return None, Verdict(part, False, obstacle)
    if sampler == "paths":
        return None, Verdict(part, False, "as asked")
    errors: dict[Kernel, StationaryError] = {}
    for kernel in _kernels(scene):
        errors[kernel] = scene_stationary_error(scene, tolerance, kernel == "skewed")
        if errors[kernel].accepts(tolerance):
            break
    best = min(errors, key=lambda kernel: (not errors[kernel].accepts(tolerance), errors[kernel].largest))
    said = "; ".join(
        f"with the {_KERNELS[kernel]} its correlations are off by {error.correlation:.2g} +- "
        f"{error.correlation_error:.1g} and its intensities by {error.intensity:.2g} +- {error.intensity_error:.1g}"
        for kernel, error in errors.items()
    )
    said += f", allowed {tolerance:g}"
    if sampler == "stationary":
        return best, Verdict(part, True, f"asked for; {said}")
    accepted = errors[best].accepts(tolerance)
    return best if accepted else None, Verdict(part, accepted, said)


def _stationary_obstacle(scene: Scene, reverse: bool) -> str | None:
    """What keeps the stationary sampler from serving a scene at all; None where it may."""
    if not isinstance(scene.sensor, FarFieldGrid):
        return "needs a regular far-field grid"
    if reverse:
        return "has no reversed paths"
    if scene.slab.albedo == 0 or scene.slab.thickness == 0:
        return "has nothing to do: nothing scatters"
    if not _kernels(scene):
        return "serves hidden objects in transmission only"
    return None


def _kernels(scene: Scene) -> list[Kernel]:
    """Kernels that may serve a scene, the one to prefer first.

    The kernel of the axis is that of transmission; a hidden object's modes need its symmetry. The skewed one is the
    same as it where beams and views are about the axis.
    """
    middle = [reference_direction(scene.beams.directions), scene.sensor.center_direction]  # type: ignore[union-attr]
    axial = scene.side > 0
    oblique = not np.allclose(middle, AXIS, rtol=0, atol=1e-9)
    skewed = oblique and not isinstance(scene.illumination, IncoherentObject)
    return [*(["axial"] if axial else []), *(["skewed"] if skewed else [])]  # type: ignore[list-item]


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
