"""Geometry of a scattering volume: an axis-parallel box, some sides of which may lie at infinity.

A slab is a box without sides, a flatland box one without y faces: vectors always have three components
here, and in flatland every y is 0. The box is homogeneous, or divided into equal voxels.

Optical depths are exact (voxel traversal after Amanatides and Woo, *A fast voxel traversal algorithm*,
Eurographics 1987); free flights through voxels are delta tracking under the majorants of blocks of voxels
(Woodcock et al. 1965), so that a dense corner slows nobody elsewhere.
"""

import math
from typing import NamedTuple

import numpy as np

from specklegen.kernels import inlined
from specklegen.kernels.rng import uniforms

_ONE = np.uint64(1)


class Volume(NamedTuple):
    """A medium as the kernels know it.

    Attributes
    ----------
    dimension : int
        2 or 3.
    lower, upper : float64[3]
        Corners; infinite where the medium has no side, and in y in flatland.
    shape : int64[3]
        Voxels along x, y, z; (1, 1, 1) is homogeneous.
    extinction, albedo, material : float64[n], float64[n], int64[n]
        Of each voxel, x fastest, z slowest.
    block : int
        Voxels along the side of a block of one majorant.
    blocks : int64[3]
        Blocks along x, y, z.
    majorant : float64[m]
        Largest extinction in each block.
    """

    dimension: int
    lower: np.ndarray
    upper: np.ndarray
    shape: np.ndarray
    extinction: np.ndarray
    albedo: np.ndarray
    material: np.ndarray
    block: int
    blocks: np.ndarray
    majorant: np.ndarray


@inlined
def _axis_exit(position, direction, lower, upper):
    if direction > 0.0:
        return (upper - position) / direction
    if direction < 0.0:
        return (lower - position) / direction
    return math.inf


@inlined
def exit_distance(volume, x, y, z, dx, dy, dz):
    """Distance from a point inside the volume to its surface along a direction; 0 on the way out, never negative."""
    t = min(
        _axis_exit(x, dx, volume.lower[0], volume.upper[0]),
        _axis_exit(y, dy, volume.lower[1], volume.upper[1]),
        _axis_exit(z, dz, volume.lower[2], volume.upper[2]),
    )
    return max(t, 0.0)


@inlined
def _axis_chord(position, direction, lower, upper):
    if direction == 0.0:
        return (-math.inf, math.inf) if lower <= position <= upper else (math.inf, -math.inf)
    a = (lower - position) / direction
    b = (upper - position) / direction
    return min(a, b), max(a, b)


@inlined
def chord(volume, x, y, z, dx, dy, dz):
    """Distances (near, far) between which the ray ahead of a point is inside; near >= far where it misses."""
    x0, x1 = _axis_chord(x, dx, volume.lower[0], volume.upper[0])
    y0, y1 = _axis_chord(y, dy, volume.lower[1], volume.upper[1])
    z0, z1 = _axis_chord(z, dz, volume.lower[2], volume.upper[2])
    return max(0.0, x0, y0, z0), min(x1, y1, z1)


@inlined
def inside(volume, x, y, z):
    """Whether a point lies in the closed volume."""
    return (
        volume.lower[0] <= x <= volume.upper[0]
        and volume.lower[1] <= y <= volume.upper[1]
        and volume.lower[2] <= z <= volume.upper[2]
    )


@inlined
def _cell(volume, axis, position, cells):
    """Cell number along an axis, and the cell's width; one infinite cell where the axis has no sides."""
    if cells == 1:
        return 0, volume.upper[axis] - volume.lower[axis]
    width = (volume.upper[axis] - volume.lower[axis]) / cells
    return min(max(int((position - volume.lower[axis]) / width), 0), cells - 1), width


@inlined
def voxel(volume, x, y, z):
    """Number of the voxel that holds a point."""
    nx, ny, nz = volume.shape[0], volume.shape[1], volume.shape[2]
    if nx * ny * nz == 1:
        return 0
    i, _ = _cell(volume, 0, x, nx)
    j, _ = _cell(volume, 1, y, ny)
    k, _ = _cell(volume, 2, z, nz)
    return (k * ny + j) * nx + i


@inlined
def _first_crossing(volume, axis, position, direction, number, cells, width):
    """Distance to the next cell face along an axis, the distance between faces, and the step."""
    if cells == 1 or direction == 0.0:
        return math.inf, math.inf, 0
    if direction > 0.0:
        return (volume.lower[axis] + (number + 1) * width - position) / direction, width / direction, 1
    return (volume.lower[axis] + number * width - position) / direction, -width / direction, -1


@inlined
def march(volume, x, y, z, dx, dy, dz, near, far, target):
    """Walk from distance ``near`` to ``far`` until the optical depth reaches ``target``; (depth, distance) there.

    The part of the ray between the two must be inside.
    """
    nx, ny, nz = volume.shape[0], volume.shape[1], volume.shape[2]
    if far <= near:
        return 0.0, near
    if nx * ny * nz == 1:
        sigma = volume.extinction[0]
        depth = sigma * (far - near)
        return (depth, far) if depth < target else (target, near + target / sigma)
    i, wx = _cell(volume, 0, x + near * dx, nx)
    j, wy = _cell(volume, 1, y + near * dy, ny)
    k, wz = _cell(volume, 2, z + near * dz, nz)
    tx, sx, ax = _first_crossing(volume, 0, x, dx, i, nx, wx)
    ty, sy, ay = _first_crossing(volume, 1, y, dy, j, ny, wy)
    tz, sz, az = _first_crossing(volume, 2, z, dz, k, nz, wz)
    depth = 0.0
    t = near
    while True:
        end = min(tx, ty, tz, far)
        sigma = volume.extinction[(k * ny + j) * nx + i]
        step = sigma * max(end - t, 0.0)
        if depth + step >= target:
            return target, t + (target - depth) / sigma
        depth += step
        t = max(end, t)
        if t >= far:
            return depth, far
        if tx <= ty and tx <= tz:
            i += ax
            tx += sx
            if i < 0 or i >= nx:
                return depth, far
        elif ty <= tz:
            j += ay
            ty += sy
            if j < 0 or j >= ny:
                return depth, far
        else:
            k += az
            tz += sz
            if k < 0 or k >= nz:
                return depth, far


@inlined
def optical_depth(volume, x, y, z, dx, dy, dz, near, far):
    """Optical depth of the part of a ray between two distances, all of it inside; infinite to infinity."""
    depth, _ = march(volume, x, y, z, dx, dy, dz, near, far, math.inf)
    return depth


@inlined
def free_flight(volume, x, y, z, dx, dy, dz, k0, k1, sample, path, dimension):
    """Distance to the next collision (infinite where the path leaves), and the next unused random dimension."""
    far = exit_distance(volume, x, y, z, dx, dy, dz)
    if volume.shape[0] * volume.shape[1] * volume.shape[2] == 1:
        _, _, _, d = uniforms(k0, k1, sample, path, dimension)
        t = -math.log(d) / volume.extinction[0]
        return (t if t < far else math.inf), dimension + _ONE
    nx, ny, nz = volume.blocks[0], volume.blocks[1], volume.blocks[2]
    # Blocks tile the grid from its lower corner; the last one along an axis may be cut.
    wx = (volume.upper[0] - volume.lower[0]) / volume.shape[0] * volume.block
    wy = (volume.upper[1] - volume.lower[1]) / volume.shape[1] * volume.block
    wz = (volume.upper[2] - volume.lower[2]) / volume.shape[2] * volume.block
    i = 0 if nx == 1 else min(max(int((x - volume.lower[0]) / wx), 0), nx - 1)
    j = 0 if ny == 1 else min(max(int((y - volume.lower[1]) / wy), 0), ny - 1)
    k = 0 if nz == 1 else min(max(int((z - volume.lower[2]) / wz), 0), nz - 1)
    tx, sx, ax = _first_crossing(volume, 0, x, dx, i, nx, wx)
    ty, sy, ay = _first_crossing(volume, 1, y, dy, j, ny, wy)
    tz, sz, az = _first_crossing(volume, 2, z, dz, k, nz, wz)
    t = 0.0
    while True:
        end = min(tx, ty, tz, far)
        majorant = volume.majorant[(k * ny + j) * nx + i]
        while majorant > 0.0:
            a, b, _, _ = uniforms(k0, k1, sample, path, dimension)
            dimension += _ONE
            t -= math.log(a) / majorant
            if t >= end:
                break
            sigma = volume.extinction[voxel(volume, x + t * dx, y + t * dy, z + t * dz)]
            if b * majorant < sigma:
                return t, dimension
        t = end
        if t >= far:
            return math.inf, dimension
        if tx <= ty and tx <= tz:
            i += ax
            tx += sx
            if i < 0 or i >= nx:
                return math.inf, dimension
        elif ty <= tz:
            j += ay
            ty += sy
            if j < 0 or j >= ny:
                return math.inf, dimension
        else:
            k += az
            tz += sz
            if k < 0 or k >= nz:
                return math.inf, dimension
