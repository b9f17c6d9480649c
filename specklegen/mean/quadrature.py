"""Quadrature nodes in a finite medium, along the rays of one light.

A ray is known by where it meets the medium's entrance plane. Across the rays, panels end at the edges of the beam
and where rays begin to meet other faces; along a ray, at the faces of voxels. Between those the integrand is smooth
but for kinks where rays from a node begin to leave through another face.
"""

from typing import NamedTuple

import numpy as np

from specklegen.core.quadrature import gauss_legendre
from specklegen.paths.volumes import spatial
from specklegen.scene.illumination import CollimatedBeams
from specklegen.scene.media import Box, VoxelGrid
from specklegen.scene.scene import Scene
from specklegen.scene.window import Window

_X, _W = gauss_legendre(4)
_X, _W = (_X + 1) / 2, _W / 2
_RADIANS = 8.0  # a panel at level 0; half of it at level 1, where four nodes are good to 4e-5
_MOST_HELD = 4_000_000  # nodes held at a time, 40 bytes each
_FAINT = 72.0  # decay of the intensity at which a Gaussian window is cut: 6 radii, an amplitude of e^-36


class Nodes(NamedTuple):
    """Points float64[J, 3], weights float64[J] (of b sigma_t / 2 dx) and the material int64[J] at each."""

    points: np.ndarray
    weights: np.ndarray
    kinds: np.ndarray


class _Axis(NamedTuple):
    """Breaks float64[K + 1] of one axis across the rays, and radians per length between them, float64[K]."""

    breaks: np.ndarray
    rates: np.ndarray

    @classmethod
    def across(cls, edges: np.ndarray, drift: float, rate: float, phase: float) -> "_Axis":
        """Nodes across faces at ``edges``, for rays that move sideways by ``drift`` and turn by up to ``phase``."""
        # Behind a tilted ray's voxels the integrand only bends, and halving catches that; at the sides it ends.
        breaks = np.unique(np.concatenate([edges, edges[[0, -1]] - drift]))
        middle = (breaks[1:] + breaks[:-1]) / 2
        low, high = np.minimum(middle, middle + drift), np.maximum(middle, middle + drift)
        through = (low >= edges[0]) & (high <= edges[-1])
        # Rays through a side have their other end there: it runs the whole phase over the width of the drift.
        width = max(abs(drift), float(np.spacing(np.abs(edges).max())))  # smaller ones are rounding
        return cls(breaks, np.where(through, rate, rate + phase / width))


def beam_nodes(scene: Scene, light: np.ndarray, level: int, most: float) -> Nodes | None:
    """Nodes for one light, panels doubled ``level`` times along each axis; None where there are more than ``most``."""
    medium = scene.volume
    assert isinstance(medium, Box | VoxelGrid)
    fineness = 2.0**level / _RADIANS
    beams = scene.beams if scene.illumination.limited else None
    main = len(light) - 1 if beams else int(np.abs(light).argmax())
    across = [a for a in range(len(light)) if a != main]
    edges = _edges(medium)
    ray_length = (medium.upper - medium.lower)[main] / abs(light[main])
    # Radians per length at most, attenuation included: at a fixed distance along the rays, and along one.
    difference = 2 * np.pi / scene.wavelength * (light - scene.views)
    rates = np.abs(difference).max(axis=0) + 0.5 / medium.mean_free_path
    rate = np.abs(difference @ light).max() + 0.5 / medium.mean_free_path
    axes = [_Axis.across(edges[a], light[a] * ray_length, rates[a], rate * ray_length) for a in across]
    lateral = _window(beams, axes, fineness, min(most, _MOST_HELD))
    if lateral is None:
        return None
    origins = np.empty((len(lateral[1]), len(light)))
    origins[:, across] = lateral[0]
    origins[:, main] = medium.lower[main] if light[main] > 0 else medium.upper[main]
    ends = _crossings(edges, origins, light)
    length = np.diff(ends, axis=1)
    pieces = np.ceil(length * rate * fineness + (2.0**level - 1) * (length > 0)).astype(int)
    if pieces.sum() * len(_X) > min(most, _MOST_HELD):
        return None
    ray, distance, weight = _along(ends, pieces)
    points = origins[ray] + distance[:, None] * light
    weights = lateral[1][ray] * weight * abs(light[main])
    if beams:
        weights /= np.sqrt(light[main])  # unit irradiance per area of the face
    return _lit(medium, points, weights)


def _edges(medium: Box | VoxelGrid) -> list[np.ndarray]:
    """Faces of the medium and of its voxels along each axis."""
    sides = zip(medium.lower, medium.upper, medium.voxel_counts, strict=True)
    return [np.linspace(low, high, n + 1) for low, high, n in sides]


def _window(
    beams: CollimatedBeams | None, axes: list[_Axis], fineness: float, most: float
) -> tuple[np.ndarray, np.ndarray] | None:
    """Positions float64[R, d - 1] on the entrance plane and their weights with the beam's profile."""
    window = beams.window if beams else Window("square", np.inf)
    radius, reach = window.width / 2, window.support(_FAINT) / 2
    if not window.sharp:  # b bends within its radius
        axes = [_Axis(breaks, rates + 2 / radius) for breaks, rates in axes]
    if not window.separable and len(axes) == 2:  # x = r sin(angle): smooth where the chord across shrinks to nothing
        angles = np.arcsin(np.clip(axes[0].breaks / radius, -1, 1))
        rule = _panels(_Axis(angles, axes[0].rates * radius), np.inf, fineness, most)
        if rule is None:
            return None
        angle, weight = rule
        reaches = radius * np.cos(angle)
        first, weight = radius * np.sin(angle), weight * reaches
    else:
        rule = _panels(axes[0], reach, fineness, most)
        if rule is None:
            return None
        first, weight = rule
        reaches = np.full(len(first), reach)
    if len(axes) == 1:
        positions, weights = first[:, None], weight
    else:
        rows, total = [], 0
        for x, w, half in zip(first, weight, reaches, strict=True):
            rule = _panels(axes[1], half, fineness, most - total)
            if rule is None:
                return None
            y, v = rule
            total += len(y)
            rows.append((np.stack([np.full_like(y, x), y], axis=1), w * v))
        if not rows:
            return np.empty((0, 2)), np.empty(0)
        positions, weights = (np.concatenate(part) for part in zip(*rows, strict=True))
    if not window.sharp:
        weights = weights * window.amplitude(*positions.T)
    return (positions, weights) if len(weights) <= most else None


def _panels(axis: _Axis, reach: float, fineness: float, most: float) -> tuple[np.ndarray, np.ndarray] | None:
    """Gauss-Legendre nodes and weights between breaks, no farther from 0 than ``reach``; None of more than ``most``."""
    ends = np.clip(axis.breaks, -reach, reach)
    width = np.diff(ends)
    pieces = np.ceil(fineness * (width * axis.rates + _RADIANS * (width > 0)))
    if pieces.sum() * len(_X) > most:  # before any of them is made
        return None
    pieces = pieces.astype(int)
    _, at, weight = _along(ends[None], pieces[None])
    return at, weight


def _along(ends: np.ndarray, pieces: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Row, position and weight of the nodes of intervals float64[R, K + 1], each in some equal pieces int[R, K]."""
    width = np.diff(ends, axis=1) / np.maximum(pieces, 1)
    count = pieces.ravel()
    interval = np.repeat(np.arange(count.size), count)
    number = np.arange(count.sum()) - np.repeat(np.cumsum(count) - count, count)
    step = width.ravel()[interval, None]
    at = ends[:, :-1].ravel()[interval, None] + (number[:, None] + _X) * step
    row = np.repeat(interval // max(ends.shape[1] - 1, 1), len(_X))
    return row, at.ravel(), (step * _W).ravel()


def _crossings(edges: list[np.ndarray], origins: np.ndarray, light: np.ndarray) -> np.ndarray:
    """Distances float64[R, K] at which rays cross faces inside the medium, rising; all the same where they miss it."""
    near, far = np.full(len(origins), -np.inf), np.full(len(origins), np.inf)
    crossings = []
    for axis, faces in enumerate(edges):
        position = origins[:, axis, None]
        if light[axis] == 0:
            outside = (position[:, 0] < faces[0]) | (position[:, 0] > faces[-1])
            far[outside] = -np.inf
            continue
        with np.errstate(over="ignore"):  # of light all but along the faces: at infinity
            crossed = (faces - position) / light[axis]
        near = np.maximum(near, crossed.min(axis=1))
        far = np.minimum(far, crossed.max(axis=1))
        crossings.append(crossed)
    missed = near >= far
    near, far = np.where(missed, 0.0, near), np.where(missed, 0.0, far)
    return np.sort(np.clip(np.concatenate(crossings, axis=1), near[:, None], far[:, None]), axis=1)


def _lit(medium: Box | VoxelGrid, points: np.ndarray, weights: np.ndarray) -> Nodes:
    """Weigh points by sigma_t / 2 and drop those in empty voxels."""
    if medium.homogeneous:
        sigma, kinds = np.full(len(points), medium.extinction), np.zeros(len(points), np.int64)
    else:
        shape = np.array(medium.extinction.shape[::-1])
        cell = ((points - medium.lower) / (medium.upper - medium.lower) * shape).astype(np.int64)
        cell = tuple(np.clip(cell, 0, shape - 1).T[::-1])
        sigma = np.asarray(medium.extinction)[cell]
        kinds = np.broadcast_to(medium.material, medium.extinction.shape)[cell].astype(np.int64)
    lit = (sigma > 0) & (weights > 0)
    return Nodes(spatial(points[lit]), 0.5 * sigma[lit] * weights[lit], kinds[lit])
