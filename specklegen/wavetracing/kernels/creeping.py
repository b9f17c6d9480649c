"""Waves at smooth convex bodies: waves reflected, and waves that creep around them into their shadow.

A body is a mesh with smooth sides. If it hides P from S, a string is drawn tight around it in each half plane that ends
at the line from S to P; strings of stationary length are the creeping rays. At each side that a string touches it turns
by an angle theta, where the body has the radius R along it. If the body does not hide P, the reflected ray is
the shortest way that touches it. Both waves are half of the incident one on the boundary of the shadow.
"""

# With m = (k R / 2)^{1/3} at a touch, the wave by a string is
#
#     xi = sum of m theta,   X = xi^2 / 4 eta,   eta = m1 m2 (s1 + s2) / (2 k s1 s2),
#     u = -sqrt(m1 m2) sqrt(2/k) e^{i pi/4} [ p(xi) - F(X) / (2 sqrt(pi) xi) ] e^{i k length} / sqrt(s1 s2 J),
#
# 1 and 2 the first and the last touch, s1 and s2 the straight legs. J is how far apart neighbouring strings through S
# are at P, for unit angle: J'' = -K J, K the Gauss curvature. The reflected wave has the geometric spread, and the same
# bracket at xi = -2 m cos(angle of incidence):
#
#     -sqrt(-4 / xi) e^{i xi^3 / 12} e^{i pi/4} [ p(xi) - F(X) / (2 sqrt(pi) xi) ].
#
# p is one of `specklegen.wavetracing.fock`, soft or hard; other surfaces are a mixture, (1 - r) / 2 and (1 + r) / 2, r
# Fresnel's coefficient (at grazing incidence for what creeps). Where the two strings around a body of revolution meet,
# on the axis of its shadow, Bessel functions join them.
#
# Source: P. H. Pathak, W. D. Burnside, R. J. Marhefka, IEEE Trans. Antennas Propag. 28, 631 (1980), conjugated;
# D. Ludwig, Commun. Pure Appl. Math. 19, 215 (1966) (uniform caustics).

import cmath
import math
from typing import NamedTuple

import numpy as np

from specklegen.kernels import inlined, kernel
from specklegen.wavetracing.kernels.wedges import transition

STRINGS, WAYS = 2, 3
"""Most strings around one body, and ways by it, its reflection included."""
KIND, TOUCH, OUTWARD, SIDE, COSINE, REACH, FIELD, WAY = 0, 1, 7, 13, 15, 16, 17, 21
"""A way: 1 reflected, 2 creeping; two points, and unit normals there; sides; cos of incidence; length; soft, hard."""
_PLANES, _REFINED = 24, 22  # half planes that are tried, and steps of refining a stationary one
_ASIDE = 1e-3  # radians
_COS = math.cos(math.pi / 6.0)
_GOLD = 0.6180339887498949
_NEAR_AXIS = 20.0  # half the difference of two strings' phases, from which they are two rays


class Bodies(NamedTuple):
    """Smooth bodies of a scene at a wavelength; vertices, faces and sides of body b are those from starts[b] on.

    Attributes
    ----------
    starts : int64[B + 1, 3]
        First vertex, face and side of each body.
    balls : float64[B, 4]
        Centre and radius of a ball around each.
    vertices, faces : float64[V, 3], int64[F, 3]
    sides : int64[N, 2]
        Vertices at the ends of all sides that turn.
    smooth : bool[N]
    curved : float64[N, 7]
        Second fundamental form at a side (xx, xy, xz, yy, yz, zz) and Gauss curvature.
    outward : float64[N, 3]
        Unit normals.
    places : int64[N]
        A place in the leaves beside each side.
    near, far : complex128[T, 6], float64[*, 4]
        p and its derivatives, and (q, w) of both sums: `specklegen.wavetracing.fock.fock_tables`.
    steps : float64[3]
        Pitch, begin and end of the table of p.
    """

    starts: np.ndarray
    balls: np.ndarray
    vertices: np.ndarray
    faces: np.ndarray
    sides: np.ndarray
    smooth: np.ndarray
    curved: np.ndarray
    outward: np.ndarray
    places: np.ndarray
    near: np.ndarray
    far: np.ndarray
    steps: np.ndarray


@inlined
def _form(curved, n, d):
    """Second fundamental form at side n along a direction."""
    a = curved[n]
    return (
        a[0] * d[0] * d[0] + a[3] * d[1] * d[1] + a[5] * d[2] * d[2]
        + 2.0 * (a[1] * d[0] * d[1] + a[2] * d[0] * d[2] + a[4] * d[1] * d[2])
    )  # fmt: skip


@inlined
def _between(table, first, step, x, p):
    """A table's value at x, by a cubic through four nodes."""
    t = (x - first) / step + 2.0
    i = min(max(int(t), 1), table.shape[0] - 3)
    t -= i
    return (
        -t * (t - 1.0) * (t - 2.0) / 6.0 * table[i - 1, p] + (t + 1.0) * (t - 1.0) * (t - 2.0) / 2.0 * table[i, p]
        - (t + 1.0) * t * (t - 2.0) / 2.0 * table[i + 1, p] + (t + 1.0) * t * (t - 1.0) / 6.0 * table[i + 2, p]
    )  # fmt: skip


@kernel
def bracket(x, root, eta, bodies, p):
    """Return p(x) - F(root^2) / (2 sqrt(pi) x), soft or hard, of light whose source and point are near: eta."""
    step, first, middle = bodies.steps[0], bodies.steps[1], bodies.steps[2]
    if x > middle:
        total = complex(0.0, 0.0)
        for n in range(bodies.far.shape[0]):
            q = bodies.far[n, 2 * p]
            if 0.8 * q * (x + eta * q) > 40.0:
                break
            fall = x * q * complex(-_COS, 0.5) - eta * q * q * complex(_COS, 0.5)
            total += bodies.far[n, 2 * p + 1] * cmath.exp(fall)
        return complex(-_COS, 0.5) / (2.0 * math.sqrt(math.pi)) * total
    if abs(x) < 1e-9:
        x = 1e-9 if x >= 0.0 else -1e-9
    value = _between(bodies.near, first, step, x, p)
    near = eta * max(min(1.0 + x, 1.0), 0.0) ** 2  # in the light, rays know of it
    if near > 0.0:
        value -= 1j * near * _between(bodies.near, first, step, x, 2 + p)
        value -= 0.5 * near * near * _between(bodies.near, first, step, x, 4 + p)
    return value - transition(root) / (2.0 * math.sqrt(math.pi) * x)


@kernel
def _local(start, end, bodies, b, local):
    """Fill ``local`` with a body's vertices in axes along the line from start to end and across; return them."""
    x, y, z = end[0] - start[0], end[1] - start[1], end[2] - start[2]
    size = math.sqrt(x * x + y * y + z * z)
    x, y, z = x / size, y / size, z / size
    if abs(x) <= abs(y) and abs(x) <= abs(z):
        u = (0.0, -z, y)
    elif abs(y) <= abs(z):
        u = (z, 0.0, -x)
    else:
        u = (-y, x, 0.0)
    r = math.sqrt(u[0] * u[0] + u[1] * u[1] + u[2] * u[2])
    u = (u[0] / r, u[1] / r, u[2] / r)
    v = (y * u[2] - z * u[1], z * u[0] - x * u[2], x * u[1] - y * u[0])
    first = bodies.starts[b, 0] if b >= 0 else 0
    for n in range(first, first + local.shape[0]):
        p = bodies.vertices[n]
        a, c, d = p[0] - start[0], p[1] - start[1], p[2] - start[2]
        local[n - first, 0] = a * x + c * y + d * z
        local[n - first, 1] = a * u[0] + c * u[1] + d * u[2]
        local[n - first, 2] = a * v[0] + c * v[1] + d * v[2]
    return size, (x, y, z), u, v


@kernel
def _hidden(bodies, b, size, local):
    """Return whether a face of the body crosses the line."""
    first = bodies.starts[b, 0]
    for f in range(bodies.starts[b, 1], bodies.starts[b + 1, 1]):
        p, q, r = (
            local[bodies.faces[f, 0] - first],
            local[bodies.faces[f, 1] - first],
            local[bodies.faces[f, 2] - first],
        )
        one, two, three = q[1] * r[2] - q[2] * r[1], r[1] * p[2] - r[2] * p[1], p[1] * q[2] - p[2] * q[1]
        if (one < 0.0 or two < 0.0 or three < 0.0) and (one > 0.0 or two > 0.0 or three > 0.0):
            continue
        total = one + two + three
        if total != 0.0 and 0.0 < (one * p[0] + two * q[0] + three * r[0]) / total < size:
            return True
    return False


@kernel
def _string(bodies, b, size, local, angle, touched, at):
    """Draw a string tight around a body in a half plane: its length, and how many sides it touches, -1 for an edge.

    touched, at : int64[n], float64[n, 2], filled with the sides, and where: along the line, and away from it
    """
    c, s, count = math.cos(angle), math.sin(angle), 0
    first, low, high = bodies.starts[b, 0], bodies.starts[b, 2], bodies.starts[b + 1, 2]
    which, points, keys = np.empty(high - low, np.int64), np.empty((high - low, 2)), np.empty(high - low)
    for n in range(low, high):
        p, q = local[bodies.sides[n, 0] - first], local[bodies.sides[n, 1] - first]
        g, h = p[2] * c - p[1] * s, q[2] * c - q[1] * s
        if (g < 0.0) == (h < 0.0):
            continue
        t = g / (g - h)
        x, y, z = p[0] + t * (q[0] - p[0]), p[1] + t * (q[1] - p[1]), p[2] + t * (q[2] - p[2])
        away = y * c + z * s
        if away > 0.0:
            which[count], points[count, 0], points[count, 1] = n, x, away
            keys[count] = math.atan2(away, 0.5 * size - x)
            count += 1
    kept, length = 0, 0.0
    for i in np.argsort(keys[:count]):
        x, y = points[i, 0], points[i, 1]
        if kept > 0 and math.hypot(x - at[kept - 1, 0], y - at[kept - 1, 1]) < 1e-9 * size:
            continue
        while kept > 0:
            ax, ay = (at[kept - 2, 0], at[kept - 2, 1]) if kept > 1 else (0.0, 0.0)
            bx, by = at[kept - 1, 0], at[kept - 1, 1]
            if (bx - ax) * (y - by) - (by - ay) * (x - bx) < 0.0:
                break
            kept -= 1
        touched[kept], at[kept, 0], at[kept, 1] = which[i], x, y
        kept += 1
    while kept > 0:
        ax, ay = (at[kept - 2, 0], at[kept - 2, 1]) if kept > 1 else (0.0, 0.0)
        bx, by = at[kept - 1, 0], at[kept - 1, 1]
        if (bx - ax) * -by - (by - ay) * (size - bx) < 0.0:
            break
        kept -= 1
    x, y, smooth = 0.0, 0.0, kept > 0
    for i in range(kept):
        length += math.hypot(at[i, 0] - x, at[i, 1] - y)
        x, y, smooth = at[i, 0], at[i, 1], smooth and bodies.smooth[touched[i]]
    return length + math.hypot(size - x, y), kept if smooth else -1


@kernel
def _stationary(bodies, b, size, local, rough, angles, touched, at):
    """Fill ``angles`` float64[STRINGS] with half planes of strings of stationary length.

    rough : least difference of length of two strings that are two

    Return how many are shortest, and how many there are with those that are longest.
    """
    lengths, step, count, shortest = np.empty(_PLANES), 2.0 * math.pi / _PLANES, 0, 0
    for n in range(_PLANES):
        lengths[n], _ = _string(bodies, b, size, local, n * step, touched, at)
    alike = lengths.max() - lengths.min() < rough
    for sign in (1.0, -1.0):
        before = count
        for n in np.argsort(sign * lengths):
            known = count == STRINGS or (alike and count > before) or lengths[n] <= size * (1.0 + 1e-12)
            for i in range(before, count):
                known = known or math.cos(n * step - angles[i]) > 0.5
            here = sign * lengths[n]
            if known or here > sign * lengths[(n + 1) % _PLANES] or here > sign * lengths[n - 1]:
                continue
            a, c = (n - 1) * step, (n + 1) * step
            for _ in range(_REFINED):
                p, q = c - _GOLD * (c - a), a + _GOLD * (c - a)
                one, _ = _string(bodies, b, size, local, p, touched, at)
                two, _ = _string(bodies, b, size, local, q, touched, at)
                if sign * one < sign * two:
                    c = q
                else:
                    a = p
            # Where a string leaves the body on one side, its length jumps: it is not stationary.
            one, _ = _string(bodies, b, size, local, 0.5 * (a + c) - _ASIDE, touched, at)
            two, _ = _string(bodies, b, size, local, 0.5 * (a + c) + _ASIDE, touched, at)
            here, touches = _string(bodies, b, size, local, 0.5 * (a + c), touched, at)
            if touches > 0 and sign * min(sign * one, sign * two) > here - 0.2 * rough and max(one, two) < here + rough:
                angles[count] = 0.5 * (a + c)
                count += 1
        shortest = count if sign > 0.0 else shortest
    return shortest, count


@kernel
def _creeping(bodies, size, axes, angle, kept, touched, at, k, way):
    """Fill a way by a string that touches ``kept`` sides: all but its caustic; return J, J' and its last slope."""
    along, u, v = axes
    c, s = math.cos(angle), math.sin(angle)
    across = (c * u[0] + s * v[0], c * u[1] + s * v[1], c * u[2] + s * v[2])
    x, y, length, xi, spread, slope, first, last = 0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0
    for i in range(kept):
        n = touched[i]
        dx, dy = at[i, 0] - x, at[i, 1] - y
        x, y = at[i, 0], at[i, 1]
        ahead, up = (at[i + 1, 0] - x, at[i + 1, 1] - y) if i + 1 < kept else (size - x, -y)
        before, behind = math.hypot(dx, dy), math.hypot(ahead, up)
        turn = math.atan2(dy * ahead - dx * up, dx * ahead + dy * up)
        tx, ty = dx / before + ahead / behind, dy / before + up / behind
        r = math.hypot(tx, ty)
        tx, ty = tx / r, ty / r
        d = (tx * along[0] + ty * across[0], tx * along[1] + ty * across[1], tx * along[2] + ty * across[2])
        bent = max(_form(bodies.curved, n, d), 1e-9 * k)
        m = (0.5 * k / bent) ** (1.0 / 3.0)
        xi += m * turn
        length += before
        spread += slope * before
        slope -= bodies.curved[n, 6] / bent * turn * spread
        if i == 0:
            first, way[SIDE] = m, n
        last, way[SIDE + 1] = m, n
        for e in range(3):
            p = x * along[e] + y * across[e]
            out = -ty * along[e] + tx * across[e]
            if i == 0:
                way[TOUCH + e], way[OUTWARD + e] = p, out
            way[TOUCH + 3 + e], way[OUTWARD + 3 + e] = p, out
    one, two = math.hypot(at[0, 0], at[0, 1]), math.hypot(size - x, y)
    spread += slope * two
    length += two
    eta = 0.5 * first * last / k * (one + two) / (one * two)
    root = 0.5 * xi / math.sqrt(eta)
    scale = -math.sqrt(first * last * 2.0 / k / (one * two)) * cmath.exp(0.25j * math.pi)
    for p in range(2):
        value = scale * bracket(xi, root, eta, bodies, p)
        way[FIELD + 2 * p], way[FIELD + 2 * p + 1] = value.real, value.imag
    way[KIND], way[COSINE], way[REACH] = 2.0, 0.0, length
    return spread, slope, y / two


@kernel
def _reflected(start, end, bodies, b, k, way):
    """Fill a way by the shortest path that touches a smooth side; return whether there is one."""
    best, side, x, y, z = math.inf, -1, 0.0, 0.0, 0.0
    for n in range(bodies.starts[b, 2], bodies.starts[b + 1, 2]):
        p, q = bodies.vertices[bodies.sides[n, 0]], bodies.vertices[bodies.sides[n, 1]]
        dx, dy, dz = q[0] - p[0], q[1] - p[1], q[2] - p[2]
        size = math.sqrt(dx * dx + dy * dy + dz * dz)
        dx, dy, dz = dx / size, dy / size, dz / size
        ax, ay, az = start[0] - p[0], start[1] - p[1], start[2] - p[2]
        bx, by, bz = end[0] - p[0], end[1] - p[1], end[2] - p[2]
        g, h = ax * dx + ay * dy + az * dz, bx * dx + by * dy + bz * dz
        r = math.sqrt(max(ax * ax + ay * ay + az * az - g * g, 0.0))
        s = math.sqrt(max(bx * bx + by * by + bz * bz - h * h, 0.0))
        t = min(max(g + (h - g) * r / (r + s) if r + s > 0.0 else g, 0.0), size)
        length = math.sqrt(r * r + (t - g) ** 2) + math.sqrt(s * s + (t - h) ** 2)
        if length < best:
            best, side = length, n
            x, y, z = p[0] + t * dx, p[1] + t * dy, p[2] + t * dz
    if side < 0 or not bodies.smooth[side]:
        return False
    ax, ay, az, bx, by, bz = x - start[0], y - start[1], z - start[2], end[0] - x, end[1] - y, end[2] - z
    r, s = math.sqrt(ax * ax + ay * ay + az * az), math.sqrt(bx * bx + by * by + bz * bz)
    ax, ay, az, bx, by, bz = ax / r, ay / r, az / r, bx / s, by / s, bz / s
    nx, ny, nz = bx - ax, by - ay, bz - az
    bent = math.sqrt(nx * nx + ny * ny + nz * nz)
    cosine = max(0.5 * bent, 1e-9)
    out = bodies.outward[side]
    if nx * out[0] + ny * out[1] + nz * out[2] <= 0.0:
        return False
    nx, ny, nz = nx / bent, ny / bent, nz / bent
    tx, ty, tz = ax + bx, ay + by, az + bz  # along the surface in the plane of incidence, and across it
    size = math.sqrt(tx * tx + ty * ty + tz * tz)
    if size < 1e-9:
        tx, ty, tz = (0.0, -nz, ny) if abs(nx) < 0.7 else (nz, 0.0, -nx)
        size = math.sqrt(tx * tx + ty * ty + tz * tz)
    tx, ty, tz = tx / size, ty / size, tz / size
    one, two = (tx, ty, tz), (ny * tz - nz * ty, nz * tx - nx * tz, nx * ty - ny * tx)
    inner, outer = max(_form(bodies.curved, side, one), 1e-9 * k), max(_form(bodies.curved, side, two), 0.0)
    mixed = 0.5 * _form(bodies.curved, side, (one[0] + two[0], one[1] + two[1], one[2] + two[2])) - 0.5 * (
        inner + outer
    )
    m = (0.5 * k / inner) ** (1.0 / 3.0)
    xi, root = -2.0 * m * cosine, cosine * math.sqrt(2.0 * k * r * s / (r + s))
    eta = 0.5 * m * m / k * (r + s) / (r * s)
    # The reflected wave widens by the square root of this; a factor cos of it cancels that of the coefficient.
    wide = (cosine * (1.0 + s / r) + 2.0 * s * inner) * (1.0 + s / r + 2.0 * s * outer * cosine)
    wide = max(wide - 4.0 * s * s * mixed * mixed * cosine, 1e-300)
    for p in range(2):
        sign = 1.0 if p == 0 else -1.0
        if xi > bodies.steps[1]:
            value = -math.sqrt(2.0 / m) * cmath.exp(1j * (xi**3 / 12.0 + 0.25 * math.pi))
            value *= bracket(xi, root, eta, bodies, p)
        else:
            value = -sign * complex(1.0, -2.0 * sign / xi**3) * math.sqrt(cosine)
        value /= r * math.sqrt(wide)
        way[FIELD + 2 * p], way[FIELD + 2 * p + 1] = value.real, value.imag
    way[KIND], way[SIDE], way[SIDE + 1], way[COSINE], way[REACH] = 1.0, side, side, cosine, r + s
    way[TOUCH], way[TOUCH + 1], way[TOUCH + 2], way[OUTWARD], way[OUTWARD + 1], way[OUTWARD + 2] = x, y, z, nx, ny, nz
    return True


@inlined
def _bessel(x, order):
    """Bessel function of order 0 or 1, up to `_NEAR_AXIS`."""
    total = 0.0
    for n in range(64):
        a = math.pi * (n + 0.5) / 64.0
        total += math.cos(order * a - x * math.sin(a))
    return total / 64.0


@kernel
def ways_by(start, end, bodies, b, k, mirror, creep, ways):
    """Fill ``ways`` float64[WAYS, WAY] with the ways from a point to another by a smooth body; return their number.

    mirror, creep : whether reflected ways are wanted, and creeping ones

    Fields are those of a source of e^{ikr} / r, soft and hard.
    """
    ball = bodies.balls[b]
    x, y, z = end[0] - start[0], end[1] - start[1], end[2] - start[2]
    ax, ay, az = ball[0] - start[0], ball[1] - start[1], ball[2] - start[2]
    t = min(max((ax * x + ay * y + az * z) / max(x * x + y * y + z * z, 1e-300), 0.0), 1.0)
    ax, ay, az = ax - t * x, ay - t * y, az - t * z
    within = ax * ax + ay * ay + az * az <= ball[3] * ball[3]
    high, low, ends, angles = bodies.starts[b + 1], bodies.starts[b], np.empty((STRINGS, 3)), np.empty(STRINGS)
    local, touched = np.empty((high[0] - low[0], 3)), np.empty(high[2] - low[2], np.int64)
    at, count, shortest, first = np.empty((high[2] - low[2], 2)), 0, 0, 0
    size, along, u, v = _local(start, end, bodies, b, local)
    if not (within and _hidden(bodies, b, size, local)) and mirror and _reflected(start, end, bodies, b, k, ways[0]):
        first = 1
        for p in range(2):
            value = complex(ways[0, FIELD + 2 * p], ways[0, FIELD + 2 * p + 1]) * cmath.exp(1j * k * ways[0, REACH])
            ways[0, FIELD + 2 * p], ways[0, FIELD + 2 * p + 1] = value.real, value.imag
    if creep:
        shortest, count = _stationary(bodies, b, size, local, 0.5 / k, angles, touched, at)
    for n in range(count):
        _, kept = _string(bodies, b, size, local, angles[n], touched, at)
        ends[n, 0], ends[n, 1], ends[n, 2] = _creeping(
            bodies, size, (along, u, v), angles[n], kept, touched, at, k, ways[first + n]
        )
        for e in range(6):
            ways[first + n, TOUCH + e] += start[e % 3]
    one, two = ways[first, REACH], ways[first + 1, REACH]
    x, mean = 0.5 * k * (two - one), 0.5 * k * (one + two)
    for n in range(count):
        way, spread = ways[first + n], ends[n, 0]
        factor = cmath.exp(1j * k * way[REACH]) / math.sqrt(abs(spread))
        factor *= complex(0.0, -1.0) if spread < 0.0 else complex(1.0, 0.0)
        if count == 2 and shortest == 1 and x < _NEAR_AXIS:
            # Two strings that meet on the axis. There x / |J| is that of the angle of arrival and the slope of J.
            share = k * ends[n, 2] ** 2 / abs(ends[n, 1]) if x < 0.5 else 2.0 * x / abs(ends[0, 0] - ends[1, 0])
            factor = math.sqrt(0.5 * math.pi * share) * cmath.exp(1j * (mean - 0.25 * math.pi))
            factor *= complex(_bessel(max(x, 0.0), 0.0), (2.0 * n - 1.0) * _bessel(max(x, 0.0), 1.0))
        for p in range(2):
            value = complex(way[FIELD + 2 * p], way[FIELD + 2 * p + 1]) * factor
            way[FIELD + 2 * p], way[FIELD + 2 * p + 1] = value.real, value.imag
    return first + count
