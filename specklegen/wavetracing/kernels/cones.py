"""Elliptic cones against triangles and boxes.

A cone of frame (x, y, d) is { |(x, e y)| <= a + t z, a + t z >= 0 } in the coordinates of its origin: circular once y
is multiplied by e = a / b. All helpers here work in these *scaled local* coordinates. The cone is convex, so what a
triangle has in it is convex too, and its depths are one interval [least, most]. The ends of that interval are found
among the ends of what each edge has in the cone, the two points of the triangle's plane where the plane's conic has
its least and greatest depth; and the apex, where rounding may lose either. A slab [near, far] then needs no clipping:
the part meets it if least <= far and most >= near, and begins at max(near, least).

Source: S. Steinberg, M. Pharr, *Wave Tracing*, section on elliptic cones; the interval argument is our own.
"""

import math

from specklegen.kernels import inlined, spliced

# What a kernel knows of a cone, float64[CONE]: origin, three rows (x, e y, d), half-width a, slope t.
ORIGIN, AXIS_X, AXIS_Y, AXIS_Z, WIDTH, SLOPE, CONE = 0, 3, 6, 9, 12, 13, 14
_FLAT = 1e-24  # of the squared area over the fourth power of the length, below which a triangle is a line
_APEX = 1e-14  # of sizes, within which a triangle passes through the apex
_ACROSS = 1e-24  # of the squared slope of a plane, below which its section lies at one depth: 1e-12 of the width


@inlined
def edge_interval(t, x0, y0, z0, w0, r0, x1, y1, z1, w1, r1):
    """Least and greatest depth of a segment's part in the cone; (inf, -inf) where there is none.

    w = a + t z and r = hypot(x, y) belong to each end. With the form ``x^2 + y^2 - w^2``, the discriminant is written
    by cross products (Lagrange's identity), which keep their digits where ``B^2 - A C`` cancels.
    """
    in0, in1 = r0 <= w0, r1 <= w1
    if in0 and in1:
        return min(z0, z1), max(z0, z1)
    if w0 < 0.0 and w1 < 0.0:
        return math.inf, -math.inf
    dx, dy, dz, dw = x1 - x0, y1 - y0, z1 - z0, t * (z1 - z0)
    square = dx * dx + dy * dy - dw * dw
    half = x0 * dx + y0 * dy - w0 * dw
    rest = (r0 - w0) * (r0 + w0)
    u, v, k = x0 * dw - w0 * dx, y0 * dw - w0 * dy, x0 * dy - y0 * dx
    disc = u * u + v * v - k * k
    if not in0 and not in1:
        # Both ends outside: the part in between is bounded, so the line is not steeper than the cone.
        if square <= 0.0 or disc < 0.0 or half >= 0.0 or half <= -square:
            return math.inf, -math.inf
        if w0 - dw * half / square < 0.0:  # the other nappe
            return math.inf, -math.inf
        root = math.sqrt(disc)
        q = -half + root  # half < 0
        s0 = min(max(rest / q, 0.0), 1.0)
        s1 = min(max(q / square, 0.0), 1.0)
        return min(z0 + s0 * dz, z0 + s1 * dz), max(z0 + s0 * dz, z0 + s1 * dz)
    # One end inside: one crossing in [0, 1], where w >= 0.
    root = math.sqrt(max(disc, 0.0))
    q = -half - root if half > 0.0 else -half + root
    far = q / square  # infinite where the direction is a generator of the cone
    near = rest / q
    least = -1e-9 * max(abs(w0), abs(w1))  # an end at the apex may lie beyond it by its rounding
    fits_far = -1e-9 <= far <= 1.0 + 1e-9 and w0 + far * dw >= least
    fits_near = -1e-9 <= near <= 1.0 + 1e-9 and w0 + near * dw >= least
    if fits_far and fits_near:
        # Rounding put a root of the outer end next to it, or on the other nappe: the true one changes the sign here.
        s = max(far, near) if in0 else min(far, near)
    elif fits_near:
        s = near
    elif fits_far:
        s = far
    else:
        s = 0.0 if in0 else 1.0  # the inner end touches the surface
    s = min(max(s, 0.0), 1.0)
    z = z0 + s * dz
    end = z0 if in0 else z1
    return min(z, end), max(z, end)


@inlined
def _inside(px, py, pz, corners, nx, ny, nz):
    """True if a point of the triangle's plane lies in the triangle, by the axis along which it is seen largest."""
    x0, y0, z0, x1, y1, z1, x2, y2, z2 = corners
    ax, ay, az = abs(nx), abs(ny), abs(nz)
    if az >= ax and az >= ay:
        u, v, u0, v0, u1, v1, u2, v2, n = px, py, x0, y0, x1, y1, x2, y2, nz
    elif ax >= ay:
        u, v, u0, v0, u1, v1, u2, v2, n = py, pz, y0, z0, y1, z1, y2, z2, nx
    else:
        u, v, u0, v0, u1, v1, u2, v2, n = pz, px, z0, x0, z1, x1, z2, x2, ny
    c0 = (u1 - u0) * (v - v0) - (v1 - v0) * (u - u0)
    c1 = (u2 - u1) * (v - v1) - (v2 - v1) * (u - u1)
    c2 = (u0 - u2) * (v - v2) - (v0 - v2) * (u - u2)
    if n > 0.0:
        return c0 >= 0.0 and c1 >= 0.0 and c2 >= 0.0
    return c0 <= 0.0 and c1 <= 0.0 and c2 <= 0.0


@inlined
def _holds(z, x0, y0, z0, x1, y1, z1, x2, y2, z2):
    """True if a triangle holds the point (0, 0, z) to rounding: at the apex edges and plane may all miss the cone."""
    ux, uy, uz, vx, vy, vz = x1 - x0, y1 - y0, z1 - z0, x2 - x0, y2 - y0, z2 - z0
    nx, ny, nz = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
    square = nx * nx + ny * ny + nz * nz
    length = max(ux * ux + uy * uy + uz * uz, vx * vx + vy * vy + vz * vz)
    px, py, pz = -x0, -y0, z - z0
    reach = math.sqrt(length) + math.sqrt(px * px + py * py + pz * pz)
    off = nx * px + ny * py + nz * pz
    if square <= _FLAT * length * length or off * off > square * (_APEX * reach) ** 2:
        return False
    # Barycentric coordinates of its foot, by n . (u x p) and n . (p x v), against n . n.
    second = nx * (uy * pz - uz * py) + ny * (uz * px - ux * pz) + nz * (ux * py - uy * px)
    first = nx * (py * vz - pz * vy) + ny * (pz * vx - px * vz) + nz * (px * vy - py * vx)
    least = -_APEX * math.sqrt(square * length) * reach
    return first >= least and second >= least and square - first - second >= least


@inlined
def triangle_interval(a, t, x0, y0, z0, x1, y1, z1, x2, y2, z2):
    """Least and greatest depth of a triangle's part in the cone; (inf, -inf) where there is none. Touching counts."""
    w0, w1, w2 = a + t * z0, a + t * z1, a + t * z2
    r0, r1, r2 = math.sqrt(x0 * x0 + y0 * y0), math.sqrt(x1 * x1 + y1 * y1), math.sqrt(x2 * x2 + y2 * y2)
    if r0 <= w0 and r1 <= w1 and r2 <= w2:
        return min(z0, z1, z2), max(z0, z1, z2)
    low, high = edge_interval(t, x0, y0, z0, w0, r0, x1, y1, z1, w1, r1)
    other_low, other_high = edge_interval(t, x1, y1, z1, w1, r1, x2, y2, z2, w2, r2)
    low, high = min(low, other_low), max(high, other_high)
    other_low, other_high = edge_interval(t, x2, y2, z2, w2, r2, x0, y0, z0, w0, r0)
    low, high = min(low, other_low), max(high, other_high)
    ux, uy, uz, vx, vy, vz = x1 - x0, y1 - y0, z1 - z0, x2 - x0, y2 - y0, z2 - z0
    nx, ny, nz = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
    square = nx * nx + ny * ny + nz * nz
    length = max(ux * ux + uy * uy + uz * uz, vx * vx + vy * vy + vz * vz)
    if square <= _FLAT * length * length:
        return low, high
    d = nx * x0 + ny * y0 + nz * z0
    across = nx * nx + ny * ny
    triangle = (x0, y0, z0, x1, y1, z1, x2, y2, z2)
    if across <= _ACROSS * square:
        # A plane across the axis, whose section is all at one depth. NaN and infinity fail every comparison.
        z = d / nz
        if a + t * z >= 0.0 and _inside(0.0, 0.0, z, triangle, nx, ny, nz):
            low, high = min(low, z), max(high, z)
        return low, high
    h = math.sqrt(across)
    for side in range(2):
        sign = 1.0 if side == 0 else -1.0
        z = (d - sign * h * a) / (nz + sign * t * h)
        w = a + t * z
        if w >= 0.0 and w < math.inf:
            px, py = sign * w * nx / h, sign * w * ny / h
            if _inside(px, py, z, triangle, nx, ny, nz):
                low, high = min(low, z), max(high, z)
    return low, high


@inlined
def rounding(cone, boxes):
    """Bound of the rounding of a change to the frame of a cone, for points in the box of the root."""
    size = abs(cone[0]) + abs(cone[1]) + abs(cone[2])
    for c in range(3):
        size += abs(boxes[0, c]) + boxes[0, 3 + c]
    return 1e-15 * size


@spliced
def box_depth(cone, slack, slack_y, near, far, boxes, node):
    """Least depth at which a box may meet the cone; inf where it surely does not. Conservative.

    cone           : its CONE components as a tuple, which stays in registers where an array does not
    slack, slack_y : rounding of x and z, and of the scaled y
    boxes          : float64[m, 6], centre and half extents
    """
    ox, oy, oz, xx, xy, xz, yx, yy, yz, zx, zy, zz, a, t = cone
    x, y, z = boxes[node, 0] - ox, boxes[node, 1] - oy, boxes[node, 2] - oz
    hx, hy, hz = boxes[node, 3], boxes[node, 4], boxes[node, 5]
    depth = zx * x + zy * y + zz * z
    half = abs(zx) * hx + abs(zy) * hy + abs(zz) * hz + slack
    if depth - half > far or depth + half < near:
        return math.inf
    gap_x = abs(xx * x + xy * y + xz * z) - (abs(xx) * hx + abs(xy) * hy + abs(xz) * hz + slack)
    gap_y = abs(yx * x + yy * y + yz * z) - (abs(yx) * hx + abs(yy) * hy + abs(yz) * hz + slack_y)
    gap_x, gap_y = max(0.0, gap_x), max(0.0, gap_y)
    r = a + t * min(depth + half, far)
    if r < 0.0 or gap_x * gap_x + gap_y * gap_y > r * r * (1.0 + 1e-14):
        return math.inf
    return max(near, depth - half)


@inlined
def triangle_in_cone(cone, near, far, corners, f):
    """Least and greatest depth of triangle ``f`` in the cone; (inf, -inf) where it misses the slab [near, far].

    cone : its components, as of :func:`box_depth`;  corners : float64[n, 9]
    """
    ox, oy, oz, xx, xy, xz, yx, yy, yz, zx, zy, zz, a, t = cone
    px, py, pz = corners[f, 0] - ox, corners[f, 1] - oy, corners[f, 2] - oz
    qx, qy, qz = corners[f, 3] - ox, corners[f, 4] - oy, corners[f, 5] - oz
    rx, ry, rz = corners[f, 6] - ox, corners[f, 7] - oy, corners[f, 8] - oz
    z0, z1, z2 = zx * px + zy * py + zz * pz, zx * qx + zy * qy + zz * qz, zx * rx + zy * ry + zz * rz
    top = max(z0, z1, z2)
    if min(z0, z1, z2) > far or top < near:
        return math.inf, -math.inf
    x0, x1, x2 = xx * px + xy * py + xz * pz, xx * qx + xy * qy + xz * qz, xx * rx + xy * ry + xz * rz
    r = a + t * min(top, far)
    if r < 0.0 or min(x0, x1, x2) > r or max(x0, x1, x2) < -r:
        return math.inf, -math.inf
    y0, y1, y2 = yx * px + yy * py + yz * pz, yx * qx + yy * qy + yz * qz, yx * rx + yy * ry + yz * rz
    if min(y0, y1, y2) > r or max(y0, y1, y2) < -r:
        return math.inf, -math.inf
    low, high = triangle_interval(a, t, x0, y0, z0, x1, y1, z1, x2, y2, z2)
    if t > 0.0 and a + t * near <= _APEX * a and _holds(-a / t, x0, y0, z0, x1, y1, z1, x2, y2, z2):
        low, high = min(low, -a / t), max(high, -a / t)
    if low > far or high < near:
        return math.inf, -math.inf
    return max(low, near), min(high, far)


@inlined
def silhouette(m00, m01, m11):
    """Semi-axes (larger first) and unit vector of the larger one, of the ellipse of the symmetric matrix m."""
    mean, half = 0.5 * (m00 + m11), 0.5 * (m00 - m11)
    root = math.sqrt(half * half + m01 * m01)
    large = mean + root
    small = (m00 * m11 - m01 * m01) / large if large > 0.0 else 0.0
    angle = 0.5 * math.atan2(m01, half)
    return math.sqrt(large), math.sqrt(max(small, 0.0)), math.cos(angle), math.sin(angle)
