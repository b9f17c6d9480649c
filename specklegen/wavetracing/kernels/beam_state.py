"""A beam on its way: its ray, and the cone about its mean; what an interaction makes of them.

The state is float64[STATE]: point and direction of the ray, then the packed cone (origin, x, e y, mean direction,
width, slope); its stretch e = a / b; and the product T of the tangents of its two half angles.
"""

import math

from specklegen.kernels import inlined, kernel
from specklegen.wavetracing.kernels.cones import silhouette

PX, PY, PZ, DX, DY, DZ = 0, 1, 2, 3, 4, 5
CONE_AT = 6
CX, CY, CZ, XX, XY, XZ, YX, YY, YZ, MX, MY, MZ, WIDTH, SLOPE = 6, 7, 8, 9, 10, 11, 12, 13, 14, 15, 16, 17, 18, 19
STRETCH, PRODUCT, STATE = 20, 21, 22


@inlined
def axes_about(dx, dy, dz):
    """Two unit vectors across a direction: x nearest to the coordinate axis that it is least along, y = d x x."""
    ax, ay, az = abs(dx), abs(dy), abs(dz)
    if ax <= ay and ax <= az:
        x, y, z = 1.0 - dx * dx, -dx * dy, -dx * dz
    elif ay <= az:
        x, y, z = -dy * dx, 1.0 - dy * dy, -dy * dz
    else:
        x, y, z = -dz * dx, -dz * dy, 1.0 - dz * dz
    n = 1.0 / math.sqrt(x * x + y * y + z * z)
    x, y, z = x * n, y * n, z * n
    return x, y, z, dy * z - dz * y, dz * x - dx * z, dx * y - dy * x


@kernel
def leave_region(state, depth, least, nx, ny, nz):
    """Give the beam the mean direction n behind a region at ``depth``: new origin, cross-section and tangents.

    least : ``81 / 4k^2``, the least product a b tan_a tan_b
    """
    a = state[WIDTH] + depth * state[SLOPE]
    e = state[STRETCH]
    b, c = a / e, a
    x, y, z, u, v, w = axes_about(nx, ny, nz)
    # Components of the two new axes along the old ones, the ellipsoid's.
    x0 = x * state[XX] + y * state[XY] + z * state[XZ]
    x1 = (x * state[YX] + y * state[YY] + z * state[YZ]) / e
    x2 = x * state[MX] + y * state[MY] + z * state[MZ]
    y0 = u * state[XX] + v * state[XY] + w * state[XZ]
    y1 = (u * state[YX] + v * state[YY] + w * state[YZ]) / e
    y2 = u * state[MX] + v * state[MY] + w * state[MZ]
    m00 = (a * x0) ** 2 + (b * x1) ** 2 + (c * x2) ** 2
    m01 = a * a * x0 * y0 + b * b * x1 * y1 + c * c * x2 * y2
    m11 = (a * y0) ** 2 + (b * y1) ** 2 + (c * y2) ** 2
    large, small, cosine, sine = silhouette(m00, m01, m11)
    product = state[PRODUCT]
    if large * small * product < least:
        grow = math.sqrt(least / (large * small * product))
        large, small = large * grow, small * grow
    e = large / small
    state[CX] += depth * state[MX]
    state[CY] += depth * state[MY]
    state[CZ] += depth * state[MZ]
    state[XX], state[XY], state[XZ] = cosine * x + sine * u, cosine * y + sine * v, cosine * z + sine * w
    state[YX], state[YY], state[YZ] = (
        e * (cosine * u - sine * x), e * (cosine * v - sine * y), e * (cosine * w - sine * z),
    )  # fmt: skip
    state[MX], state[MY], state[MZ] = nx, ny, nz
    state[WIDTH], state[STRETCH] = large, e
    state[SLOPE] = math.sqrt(product * e)


@kernel
def mirror(state, px, py, pz, nx, ny, nz):
    """Mirror ray directions and cone in the plane through p of unit normal n; the ray's point stays."""
    for first in (DX, XX, YX, MX):
        along = 2.0 * (state[first] * nx + state[first + 1] * ny + state[first + 2] * nz)
        state[first] -= along * nx
        state[first + 1] -= along * ny
        state[first + 2] -= along * nz
    along = 2.0 * ((state[CX] - px) * nx + (state[CY] - py) * ny + (state[CZ] - pz) * nz)
    state[CX] -= along * nx
    state[CY] -= along * ny
    state[CZ] -= along * nz


@inlined
def kicked(state, fx, fy):
    """Direction of the ray after adding (fx, fy), over k, to its transverse part; and whether there is one."""
    ye = state[STRETCH]
    u = state[XX] * state[DX] + state[XY] * state[DY] + state[XZ] * state[DZ] + fx
    v = (state[YX] * state[DX] + state[YY] * state[DY] + state[YZ] * state[DZ]) / ye + fy
    rest = 1.0 - u * u - v * v
    if not rest > 0.0:
        return 0.0, 0.0, 0.0, False
    w = math.sqrt(rest)
    return (
        u * state[XX] + v * state[YX] / ye + w * state[MX],
        u * state[XY] + v * state[YY] / ye + w * state[MY],
        u * state[XZ] + v * state[YZ] / ye + w * state[MZ],
        True,
    )
