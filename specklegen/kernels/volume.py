"""Geometry of a scattering volume: an axis-parallel box, some sides of which may lie at infinity.

A slab is a box without sides, a flatland box one without y faces: vectors always have three components
here, and in flatland every y is 0. The box is homogeneous, or divided into equal voxels.

Optical depths are exact (voxel traversal after Amanatides and Woo, *A fast voxel traversal algorithm*,
Eurographics 1987); free flights through voxels are delta tracking under the majorants of blocks of voxels
(Woodcock et al. 1965), so that a dense corner slows nobody elsewhere. Layers are voxels without sides, as thick as
they please; flights through them are exact.
"""

import math
from typing import NamedTuple

import numpy as np
from numba.extending import overload

from specklegen.kernels import inlined
from specklegen.kernels.arithmetic import minus_log
from specklegen.kernels.rng import uniforms

_ONE = np.uint64(1)


# Rows of ``cells``.
VOXELS, BLOCKS, EXTRA = 0, 1, 2
# Types of ``cells``, which say what a medium is made of when a kernel is compiled: each has a walk of its own, in which
# nothing of the others' stands.
HOMOGENEOUS, LAYERS, GRID = np.int16, np.int32, np.int64


def is_homogeneous(cells):
    """Return whether a volume is one cell."""
    return cells.dtype == HOMOGENEOUS


def is_layered(cells):
    """Return whether the cells of a volume are layers."""
    return cells.dtype == LAYERS


@overload(is_homogeneous)
def _is_homogeneous(cells):
    answer = str(cells.dtype) == "int16"
    return lambda cells: answer


@overload(is_layered)
def _is_layered(cells):
    answer = str(cells.dtype) == "int32"
    return lambda cells: answer


class Volume(NamedTuple):
    """A medium as the kernels know it.

    Helpers take single arrays of it: passing the tuple on would count a reference to each, at every call.

    Attributes
    ----------
    bounds : float64[2, 3], or float64[n + 1, 3] of n layers
        Lower and upper corner; infinite where the medium has no side, and in y in flatland. Then, of layers, the depths
        between them in the last column, going up.
    cells : int16[3, 3] of one cell, int32[3, 3] of layers, int64[3, 3] of voxels
        VOXELS: number along x, y, z; BLOCKS: number of blocks of one majorant along x, y, z; EXTRA: dimension (2 or 3),
        voxels along the side of a block, 0.
    extinction, albedo, material : float64[n], float64[n], int64[n]
        Of each voxel, x fastest, z slowest.
    majorant : float64[m]
        Largest extinction in each block.
    per_length : float64[3]
        Voxels per length along x, y, z; 0 where there is one.
    mobility : float64[n], or float64[0] at rest
        How fast the particles of each voxel move beside the fastest.
    flow : float64[n, 12], or float64[0, 12] where nothing flows
        V = V_0 + A x of each voxel: V_0, then A row after row.
    """

    bounds: np.ndarray
    cells: np.ndarray
    extinction: np.ndarray
    albedo: np.ndarray
    material: np.ndarray
    majorant: np.ndarray
    per_length: np.ndarray
    mobility: np.ndarray
    flow: np.ndarray

    @property
    def dimension(self) -> int:
        """2 or 3."""
        return int(self.cells[EXTRA, 0])


@inlined
def _axis_exit(position, direction, lower, upper):
    distance = ((upper if direction > 0.0 else lower) - position) / direction
    return distance if direction != 0.0 else math.inf


@inlined
def corners(bounds):
    """The two corners as six numbers: a loop that hands on an array counts a reference to it at every turn."""
    return bounds[0, 0], bounds[0, 1], bounds[0, 2], bounds[1, 0], bounds[1, 1], bounds[1, 2]


@inlined
def escape_distance(box, x, y, z, dx, dy, dz):
    """Distance from a point inside the :func:`corners` to the surface along a direction.

    0 on the way out, never negative.
    """
    t = min(
        _axis_exit(x, dx, box[0], box[3]),
        _axis_exit(y, dy, box[1], box[4]),
        _axis_exit(z, dz, box[2], box[5]),
    )
    return max(t, 0.0)


@inlined
def exit_distance(bounds, x, y, z, dx, dy, dz):
    """:func:`escape_distance` of the volume's bounds."""
    return escape_distance(corners(bounds), x, y, z, dx, dy, dz)


@inlined
def _axis_chord(position, direction, lower, upper):
    if direction == 0.0:
        return (-math.inf, math.inf) if lower <= position <= upper else (math.inf, -math.inf)
    a = (lower - position) / direction
    b = (upper - position) / direction
    return min(a, b), max(a, b)


@inlined
def chord(bounds, x, y, z, dx, dy, dz):
    """Distances (near, far) between which the ray ahead of a point is inside; near >= far where it misses."""
    x0, x1 = _axis_chord(x, dx, bounds[0, 0], bounds[1, 0])
    y0, y1 = _axis_chord(y, dy, bounds[0, 1], bounds[1, 1])
    z0, z1 = _axis_chord(z, dz, bounds[0, 2], bounds[1, 2])
    return max(0.0, x0, y0, z0), min(x1, y1, z1)


@inlined
def inside(box, x, y, z):
    """Return whether a point lies between the :func:`corners`, which belong to the volume."""
    return box[0] <= x <= box[3] and box[1] <= y <= box[4] and box[2] <= z <= box[5]


@inlined
def _cell(bounds, axis, position, count):
    """Cell number along an axis, and the cell's width; one infinite cell where the axis has no sides."""
    if count == 1:
        return 0, bounds[1, axis] - bounds[0, axis]
    width = (bounds[1, axis] - bounds[0, axis]) / count
    return min(max(int((position - bounds[0, axis]) / width), 0), count - 1), width


@inlined
def _place(bounds, cells, per_length, axis, position):
    """Number of the voxel along an axis, by a multiplication; any in range for a point outside."""
    count = cells[VOXELS, axis]
    return 0 if count == 1 else min(max(int((position - bounds[0, axis]) * per_length[axis]), 0), count - 1)


@inlined
def voxel(bounds, cells, per_length, x, y, z):
    """Number of the voxel that holds a point."""
    if is_homogeneous(cells):
        return 0
    if is_layered(cells):
        return _layer(bounds, z)
    nx, ny = cells[VOXELS, 0], cells[VOXELS, 1]
    i = _place(bounds, cells, per_length, 0, x)
    j = _place(bounds, cells, per_length, 1, y)
    return (_place(bounds, cells, per_length, 2, z) * ny + j) * nx + i


@inlined
def _layer(bounds, z):
    """Number of the layer at a depth, the lower one's at a face between two."""
    k = 0
    while k < bounds.shape[0] - 2 and z >= bounds[k + 2, 2]:
        k += 1
    return k


@inlined
def _march_layers(bounds, extinction, z, dz, near, far, target):
    """:func:`march` through layers."""
    last = bounds.shape[0] - 2
    k = _layer(bounds, z + near * dz)
    depth, t = 0.0, near
    while True:
        face = (bounds[1, 2] if k == last else bounds[k + 2, 2]) if dz > 0.0 else bounds[0 if k == 0 else k + 1, 2]
        end = min((face - z) / dz, far) if dz != 0.0 else far
        step = extinction[k] * max(end - t, 0.0)
        if depth + step >= target:
            return target, t + (target - depth) / extinction[k]
        depth += step
        t = max(end, t)
        k += 1 if dz > 0.0 else -1
        if t >= far or k < 0 or k > last:
            return depth, far


@inlined
def _first_crossing(bounds, axis, position, direction, number, count, width):
    """Distance to the next cell face along an axis, the distance between faces, and the step."""
    if count == 1 or direction == 0.0:
        return math.inf, math.inf, 0
    if direction > 0.0:
        return (bounds[0, axis] + (number + 1) * width - position) / direction, width / direction, 1
    return (bounds[0, axis] + number * width - position) / direction, -width / direction, -1


@inlined
def march(bounds, cells, extinction, x, y, z, dx, dy, dz, near, far, target):
    """Walk from distance ``near`` to ``far`` until the optical depth reaches ``target``; (depth, distance) there.

    The part of the ray between the two must be inside.
    """
    if far <= near:
        return 0.0, near
    if is_homogeneous(cells):
        sigma = extinction[0]
        depth = sigma * (far - near)
        return (depth, far) if depth < target else (target, near + target / sigma)
    if is_layered(cells):
        return _march_layers(bounds, extinction, z, dz, near, far, target)
    nx, ny, nz = cells[VOXELS, 0], cells[VOXELS, 1], cells[VOXELS, 2]
    i, wx = _cell(bounds, 0, x + near * dx, nx)
    j, wy = _cell(bounds, 1, y + near * dy, ny)
    k, wz = _cell(bounds, 2, z + near * dz, nz)
    tx, sx, ax = _first_crossing(bounds, 0, x, dx, i, nx, wx)
    ty, sy, ay = _first_crossing(bounds, 1, y, dy, j, ny, wy)
    tz, sz, az = _first_crossing(bounds, 2, z, dz, k, nz, wz)
    depth = 0.0
    t = near
    while True:
        end = min(tx, ty, tz, far)
        sigma = extinction[(k * ny + j) * nx + i]
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
def optical_depth(bounds, cells, extinction, x, y, z, dx, dy, dz, near, far):
    """Optical depth of the part of a ray between two distances, all of it inside; infinite to infinity."""
    depth, _ = march(bounds, cells, extinction, x, y, z, dx, dy, dz, near, far, math.inf)
    return depth


@inlined
def free_flight(bounds, cells, extinction, majorants, per_length, ray, first, second, key, path, dimension):
    """Distance through voxels to the next collision (infinite where the path leaves), and the next unused dimension.

    The uniforms ``first`` and ``second`` serve the first tentative collision; each block of four that is drawn, the
    next two. What is left of an optical depth at the border of two majorants serves behind it.

    ray, key : x, y, z and direction; two words of the key and the number of the realization
    """
    x, y, z, dx, dy, dz = ray
    k0, k1, sample = key
    far = exit_distance(bounds, x, y, z, dx, dy, dz)
    if is_layered(cells):
        target = minus_log(first)
        reached, t = _march_layers(bounds, extinction, z, dz, 0.0, far, target)
        return (t if reached >= target else math.inf), dimension
    nx, ny, nz = cells[BLOCKS, 0], cells[BLOCKS, 1], cells[BLOCKS, 2]
    i = j = k = ax = ay = az = 0
    tx = ty = tz = sx = sy = sz = math.inf
    if nx * ny * nz > 1:
        # Blocks tile the grid from its lower corner; the last one along an axis may be cut.
        wx = (bounds[1, 0] - bounds[0, 0]) / cells[VOXELS, 0] * cells[EXTRA, 1]
        wy = (bounds[1, 1] - bounds[0, 1]) / cells[VOXELS, 1] * cells[EXTRA, 1]
        wz = (bounds[1, 2] - bounds[0, 2]) / cells[VOXELS, 2] * cells[EXTRA, 1]
        i = 0 if nx == 1 else min(max(int((x - bounds[0, 0]) / wx), 0), nx - 1)
        j = 0 if ny == 1 else min(max(int((y - bounds[0, 1]) / wy), 0), ny - 1)
        k = 0 if nz == 1 else min(max(int((z - bounds[0, 2]) / wz), 0), nz - 1)
        tx, sx, ax = _first_crossing(bounds, 0, x, dx, i, nx, wx)
        ty, sy, ay = _first_crossing(bounds, 1, y, dy, j, ny, wy)
        tz, sz, az = _first_crossing(bounds, 2, z, dz, k, nz, wz)
    t = 0.0
    depth, accept = minus_log(first), second
    spare = False
    next_depth = next_accept = 0.0
    while True:
        end = min(tx, ty, tz, far)
        majorant = majorants[(k * ny + j) * nx + i]
        ahead = max(majorant * (end - t), 0.0)
        while depth < ahead:
            t += depth / majorant
            ahead -= depth
            sigma = extinction[voxel(bounds, cells, per_length, x + t * dx, y + t * dy, z + t * dz)]
            if accept * majorant < sigma:
                return t, dimension
            if spare:
                depth, accept = next_depth, next_accept
            else:
                a, accept, c, next_accept = uniforms(k0, k1, sample, path, dimension)
                dimension += _ONE
                depth, next_depth = minus_log(a), minus_log(c)
            spare = not spare
        depth -= ahead
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
