"""Starts of the paths of a scene: from its lights, from sensor points near the medium, or from anywhere in it."""

import math

import numpy as np

from specklegen.kernels import sources as kernel
from specklegen.kernels.footprints import GAUSSIAN, SQUARE
from specklegen.kernels.sources import Sources
from specklegen.kernels.volume import Volume
from specklegen.paths.volumes import footprint_code, materials, spatial, volume_of
from specklegen.scene.media import Medium
from specklegen.scene.scatterers import Dimensions
from specklegen.scene.scene import Scene

_REFERENCES = 8  # lights that paths start from at most; others are covered by their neighbours
_MISSING = 4.0  # times the cross-section of a medium that a beam may have, and be drawn whole
_EVENLY = 0.1  # share of paths that start anywhere in a finite medium: bounds every weight; at most one mean free
# path over the thickness, since a path from the middle of a thick medium scatters OD^2 times, not OD times


def scene_sources(scene: Scene) -> Sources:
    """The mixture of path starts that covers every light and every sensor point of a scene.

    Half of the paths start from sensor points where there are any within two mean free paths of the medium:
    their 1/r^(d-1) is then part of the density, and no connection to them is ever too bright.
    """
    volume = volume_of(scene.volume, scene.dimension)
    rows = _light_rows(scene, volume)
    points = close_points(scene, volume)
    share = 0.5 if points and rows else 1.0
    rows = [(share / len(rows), row) for row in rows]
    rows += [(share / len(points), _point_row(volume, point)) for point in points]
    if np.isfinite(np.diff(volume.bounds, axis=0)[0, [0, 2]]).all():
        evenly = min(_EVENLY, 1 / max(scene.volume.optical_depth, 1.0)) if rows else 1.0
        rows = [(weight * (1 - evenly), row) for weight, row in rows]
        rows.append((evenly, {"kind": kernel.UNIFORM}))
    return _laid_out(rows, scene.volume, scene.dimension)


def beam_sources(medium: Medium, reference: np.ndarray, footprint: int, extent: float) -> Sources:
    """Starts of one beam along a unit vector float64[3], which holds the footprints of all lights."""
    row = {"kind": kernel.BEAM, "vector": reference, "footprint": footprint, "extent": extent}
    return _laid_out([(1.0, row)], medium, 3)


def _laid_out(rows: list[tuple[float, dict]], medium: Medium, dimension: int) -> Sources:
    """Sources of (share, description) as the kernels read them."""
    dimensions: Dimensions = 2 if dimension == 2 else 3
    lobes = np.clip([each.mean_cosine(dimensions) for each in materials(medium)], -0.99, 0.99)
    kinds = np.zeros((len(rows), 2), np.int64)
    table = np.zeros((len(rows), kernel.COLUMNS))
    for out, kind, (weight, row) in zip(table, kinds, rows, strict=True):
        kind[:] = row["kind"], row.get("footprint", SQUARE)
        out[kernel.VECTOR : kernel.VECTOR + 3] = row.get("vector", 0.0)
        out[kernel.AXIS : kernel.AXIS + 3] = row.get("axis", 0.0)
        out[kernel.SHARE] = weight
        out[kernel.APERTURE] = row.get("aperture", 0.0)
        out[kernel.SOLID_ANGLE] = row.get("solid_angle", 1.0)
        out[kernel.EXTENT] = row.get("extent", 1.0)
    table[:, kernel.CUMULATIVE] = np.cumsum(table[:, kernel.SHARE])
    return Sources(kinds, table, lobes)


def _light_rows(scene: Scene, volume: Volume) -> list[dict]:
    lights = spatial(scene.lights)
    if len(lights) == 0:
        return []
    if scene.illumination.near:
        return [_point_row(volume, point) for point in lights]
    if not scene.illumination.limited:
        if not scene.medium.has_sides:
            return []  # infinitely wide: paths start from the sensor's side
        return [{"kind": kernel.PLANE, "vector": lights[i]} for i in _spread(lights)]
    references = lights[_spread(lights)]
    nearest = np.linalg.norm(lights[:, None] - references, axis=2).argmin(axis=1)
    return [_beam_row(scene, reference, lights[nearest == n]) for n, reference in enumerate(references)]


def _beam_row(scene: Scene, reference: np.ndarray, covered: np.ndarray) -> dict:
    """A beam along ``reference`` whose footprint holds, at every depth, those of the lights it covers.

    Of a beam wider than a finite medium only rays that meet it are drawn, as of a plane wave: nearly all others miss.
    """
    beams = scene.beams
    drift = covered[:, :2] / covered[:, 2:] - reference[:2] / reference[2]
    margin = float(np.abs(drift).max(initial=0.0)) * scene.medium.thickness
    code = footprint_code(beams.profile)
    # The Gaussian density follows the intensity, whose standard deviation is a quarter of the width.
    extent = (beams.width / (4 if code == GAUSSIAN else 2)) + margin * (1 if code == SQUARE else math.sqrt(2))
    medium = scene.volume
    if medium.has_sides:
        sides = medium.upper - medium.lower
        cosines = np.abs(reference if len(sides) == 3 else reference[[0, 2]])
        met = float((cosines * sides.prod() / sides).sum())
        if (2 * extent) ** (len(sides) - 1) * cosines[-1] > _MISSING * met:
            return {"kind": kernel.PLANE, "vector": reference}
    return {"kind": kernel.BEAM, "vector": reference, "footprint": code, "extent": extent}


def _spread(directions: np.ndarray) -> list[int]:
    """Choose at most _REFERENCES indices, each the farthest from those before: all of few, the extremes of many."""
    chosen = [0]
    distance = np.linalg.norm(directions - directions[0], axis=1)
    while len(chosen) < _REFERENCES and distance.max() > 1e-3:
        chosen.append(int(distance.argmax()))
        distance = np.minimum(distance, np.linalg.norm(directions - directions[chosen[-1]], axis=1))
    return chosen


def _point_row(volume: Volume, point: np.ndarray) -> dict:
    """A point, and the cone around it that holds the volume."""
    flat = volume.dimension == 2
    axis, half_angle = _cone(volume, point)
    if flat:
        return {
            "kind": kernel.POINT, "vector": point, "axis": axis,
            "aperture": half_angle / (2 * np.pi), "solid_angle": 2 * half_angle,
        }  # fmt: skip
    aperture = 2 * np.sin(half_angle / 2) ** 2
    return {
        "kind": kernel.POINT, "vector": point, "axis": axis,
        "aperture": aperture, "solid_angle": 2 * np.pi * aperture,
    }  # fmt: skip


def _cone(volume: Volume, point: np.ndarray) -> tuple[np.ndarray, float]:
    """Axis and half angle of a cone at a point that holds the volume's bounding sphere, or a slab's half space."""
    axis = np.array([0.0, 0.0, 1.0])
    lower, upper = volume.bounds[:2].copy()
    if not np.isfinite(lower[0]):
        if point[2] <= lower[2]:
            return axis, np.pi / 2
        return (-axis, np.pi / 2) if point[2] >= upper[2] else (axis, np.pi)
    if volume.dimension == 2:
        lower[1] = upper[1] = 0.0
    center, radius = (lower + upper) / 2, float(np.linalg.norm(upper - lower)) / 2
    away = center - point
    distance = float(np.linalg.norm(away))
    if distance <= radius * (1 + 1e-9):
        return axis, np.pi
    return away / distance, float(np.arcsin(radius / distance)) * (1 + 1e-9)


def close_points(scene: Scene, volume: Volume) -> list[np.ndarray]:
    """Sensor points at which paths start: float64[3] each.

    Those in the medium or within two mean free paths of it; all of them where no light can start paths.
    """
    if not scene.sensor.near:
        return []
    points = spatial(scene.views)
    light = scene.illumination
    if not light.limited and not light.near and not scene.medium.has_sides:
        return list(points)
    reach = 2 * scene.medium.mean_free_path
    gap = np.linalg.norm(np.maximum(np.maximum(volume.bounds[0] - points, points - volume.bounds[1]), 0), axis=1)
    return list(points[gap <= reach])
