"""Waves from edges in unpolarised light: what a local wave makes at an edge, and its intensity at a point.

A *local wave* is light about one ray: plane, spherical, or astigmatic behind an edge. As float64[WAVE] it is a point
and direction of the ray, a unit vector across it, and the radii of curvature R1 along that vector and R2 across it, at
the point. Where it meets an edge at Q, at the angle beta, a cone of rays leaves Q at that angle [Keller], and carries

    u_d = u_i(Q) D A e^{iks},   A = sqrt(re / (s (re + s))),   L = s (re + s) r1 r2 sin^2 beta / (re (r1 + s) (r2 + s))

with the coefficients of `specklegen.wavetracing.kernels.wedges`. D = D_direct -+ D_image (soft, hard). Power here is
the mean of soft and hard, and

    (|a - b|^2 + |a + b|^2) / 2 = |a|^2 + |b|^2:

the direct wave with all direct terms, and the images with all image terms, add as intensities, and interfere within
themselves. Images are weighed by the reflectance of their face, so that a black face has none: half of soft and hard.
For a lossy face this drops the real part of the mean of r_TE and r_TM, which is 0 for metal.

Sources: J. B. Keller, J. Opt. Soc. Am. 52, 116 (1962); Kouyoumjian and Pathak, Proc. IEEE 62, 1448 (1974);
S. Steinberg, M. Pharr, *Wave Tracing*, section on UTD.
"""

import math
from typing import NamedTuple

import numpy as np

from specklegen.kernels import inlined, kernel
from specklegen.wavetracing.kernels.ray_bvh import nearest
from specklegen.wavetracing.kernels.surfaces import reflectance
from specklegen.wavetracing.kernels.wedges import boundary_term

# A local wave, float64[WAVE]: point, direction, unit vector across, radii along that vector and across it.
WX, WY, WZ, WDX, WDY, WDZ, WEX, WEY, WEZ, R1, R2, WAVE = 0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11
# An edge, float64[EDGE]: start, unit vector along, length, n, unit normal of the 0-face, unit vector into that face.
START, ALONG, LENGTH, WEDGE, NORMAL, INWARD, EDGE = 0, 3, 6, 7, 8, 11, 14
_CLEAR = 1e-7  # of a leg's length or, if less, of the scene's size
_ROUNDED = 1e-6  # of a leg's length: a scene that is smaller counts as this large, for rounding's sake
_ROUNDING = 1e-9  # radians
_STEPS = 3  # of unfolding where the wave is astigmatic; one is exact for others


class EdgeTable(NamedTuple):
    """Edges that diffract.

    Attributes
    ----------
    at : int32[n, 3]
        Edge at each side of a place in the leaves, each edge once; -1 for none.
    edges : float64[E, EDGE]
        Start, unit vector along, length, n, unit normal of the 0-face, unit vector into that face.
    facets, rows : int32[E, 2]
        Plane facets of the two faces, of a boundary both sides of its one face; and their rows of materials.
    """

    at: np.ndarray
    edges: np.ndarray
    facets: np.ndarray
    rows: np.ndarray

    @property
    def shortest(self) -> float:
        """Length of the shortest edge; inf without any."""
        return float(self.edges[:, LENGTH].min(initial=math.inf))


@inlined
def along(edge, t):
    """The point at t along an edge."""
    return edge[START] + t * edge[ALONG], edge[START + 1] + t * edge[ALONG + 1], edge[START + 2] + t * edge[ALONG + 2]


@inlined
def local_wave(wave, x, y, z):
    """Direction of a wave at a point, path from its own point, and its radii there."""
    x, y, z = x - wave[WX], y - wave[WY], z - wave[WZ]
    dx, dy, dz = wave[WDX], wave[WDY], wave[WDZ]
    depth = x * dx + y * dy + z * dz
    a, b = wave[R1], wave[R2]
    if a == b:
        if a == math.inf:
            return dx, dy, dz, depth, a, b
        square = x * x + y * y + z * z
        x, y, z = x + a * dx, y + a * dy, z + a * dz
        r = math.sqrt(x * x + y * y + z * z)
        return x / r, y / r, z / r, (square + 2.0 * a * depth) / (r + a), r, r
    ex, ey, ez = wave[WEX], wave[WEY], wave[WEZ]
    fx, fy, fz = dy * ez - dz * ey, dz * ex - dx * ez, dx * ey - dy * ex
    u, v = x * ex + y * ey + z * ez, x * fx + y * fy + z * fz
    a, b = a + depth, b + depth
    x, y, z = dx + ex * u / a + fx * v / b, dy + ey * u / a + fy * v / b, dz + ez * u / a + fz * v / b
    r = 1.0 / math.sqrt(x * x + y * y + z * z)
    return x * r, y * r, z * r, depth + 0.5 * (u * u / a + v * v / b), a, b


@inlined
def radius_along(wave, edge, dx, dy, dz, a, b):
    """Radius re of a wave in the plane of its direction and an edge, and the cosine of their angle."""
    cosine = dx * edge[ALONG] + dy * edge[ALONG + 1] + dz * edge[ALONG + 2]
    if a == b:
        return a, cosine
    x, y, z = edge[ALONG] - cosine * dx, edge[ALONG + 1] - cosine * dy, edge[ALONG + 2] - cosine * dz
    part = x * wave[WEX] + y * wave[WEY] + z * wave[WEZ]
    share = min(part * part / max(x * x + y * y + z * z, 1e-300), 1.0)
    return 1.0 / (share / a + (1.0 - share) / b), cosine


@inlined
def grown(r, s):
    """The ratio r / (r + s), 1 for a plane wave."""
    return 1.0 if r == math.inf else r / (r + s)


@inlined
def leaving_point(wave, edge, x, y, z):
    """Where along an edge the ray to a point leaves it (a length, maybe beyond its ends)."""
    ux, uy, uz = x - edge[START], y - edge[START + 1], z - edge[START + 2]
    foot = ux * edge[ALONG] + uy * edge[ALONG + 1] + uz * edge[ALONG + 2]
    distance = math.sqrt(max(ux * ux + uy * uy + uz * uz - foot * foot, 0.0))
    t = min(max(foot, 0.0), edge[LENGTH])
    for _ in range(_STEPS if wave[R1] != wave[R2] else 1):
        qx, qy, qz = along(edge, t)
        dx, dy, dz, _, a, b = local_wave(wave, qx, qy, qz)
        r, cosine = radius_along(wave, edge, dx, dy, dz, a, b)
        sine = math.sqrt(max(1.0 - cosine * cosine, 1e-24))
        if r == math.inf:
            t = foot - distance * cosine / sine
        else:
            source = t - r * cosine
            t = source + (foot - source) * r * sine / (r * sine + distance)
    return t


@inlined
def turn(edge, dx, dy, dz):
    """Angle of a direction about an edge, from the 0-face, in [0, 2 pi]."""
    phi = math.atan2(
        dx * edge[NORMAL] + dy * edge[NORMAL + 1] + dz * edge[NORMAL + 2],
        dx * edge[INWARD] + dy * edge[INWARD + 1] + dz * edge[INWARD + 2],
    )
    return phi if phi >= 0.0 else phi + 2.0 * math.pi


@inlined
def from_the_air(edge, dx, dy, dz):
    """Whether light of a direction comes to an edge through the air: not from within a wedge, as in a hollow solid."""
    phi = turn(edge, -dx, -dy, -dz)
    return phi <= edge[WEDGE] * math.pi + _ROUNDING or phi >= 2.0 * math.pi - _ROUNDING


@inlined
def edge_angle(edge, dx, dy, dz):
    """Angle of a direction about an edge, from the 0-face through the air; within rounding of a face, on it."""
    phi = turn(edge, dx, dy, dz)
    top = edge[WEDGE] * math.pi
    if phi > top:
        phi = top if phi - top < 2.0 * math.pi - phi else 0.0
    return phi


@inlined
def _ends(length, tree):
    """Length at both ends of a leg in which nothing blocks it: a source far away makes no surface transparent."""
    boxes = tree[0]
    size = 2.0 * max(boxes[0, 3], boxes[0, 4], boxes[0, 5])
    return _CLEAR * min(length, max(size, _ROUNDED * length))


@inlined
def clear(x, y, z, dx, dy, dz, length, skip, facet, tree):
    """Whether nothing stands on a leg, but close to its ends."""
    end = _ends(length, tree)
    _, place, _ = nearest(x, y, z, dx, dy, dz, end, length - end, skip, skip, facet, tree)
    return place < 0


@inlined
def comes_from_start(wave, skip, x, y, z, dx, dy, dz, path, normals, facet, tree):
    """Whether the way back from a point leads free to where the wave's leg began: the facet ``skip``, or its own point.

    A mirror that ends before the way back meets its plane sends no light there.
    """
    if skip < 0:
        return clear(x, y, z, -dx, -dy, -dz, path, -1, facet, tree)
    nx, ny, nz = normals[skip, 0], normals[skip, 1], normals[skip, 2]
    way = ((x - wave[WX]) * nx + (y - wave[WY]) * ny + (z - wave[WZ]) * nz) / (dx * nx + dy * ny + dz * nz)
    if not 0.0 < way < math.inf:
        return False
    end = _ends(way, tree)
    _, place, _ = nearest(x, y, z, -dx, -dy, -dz, end, way + end, -1, -1, facet, tree)
    return place >= 0 and facet[place] == skip


@kernel
def lights(wave, skip, x, y, z, normals, facet, tree):
    """Whether a wave's light reaches a point, with nothing on the way back to where its leg began."""
    dx, dy, dz, path, a, b = local_wave(wave, x, y, z)
    if not (path > 0.0 and a > 0.0 and b > 0.0):
        return False
    return comes_from_start(wave, skip, x, y, z, dx, dy, dz, path, normals, facet, tree)


@inlined
def _thinned(a, b):
    """Amplitude of a wave of radii a and b, but for a factor that is the same along each ray."""
    return 1.0 / math.sqrt((a if a < math.inf else 1.0) * (b if b < math.inf else 1.0))


@inlined
def _phasor(size, phase):
    return complex(size * math.cos(phase), size * math.sin(phase))


@kernel
def image_wave(wave, skip, face, k, x, y, z, facets, materials, tree):
    """Field at a point of a wave's image in the plane facet ``face``; 0 where it is not seen."""
    normals, facet = facets.normals, facets.facet
    nothing = complex(0.0, 0.0)
    nx, ny, nz = normals[face, 0], normals[face, 1], normals[face, 2]
    origin = facets.rim_ends[facets.rims[face]]
    height = (x - origin[0]) * nx + (y - origin[1]) * ny + (z - origin[2]) * nz
    dx, dy, dz, path, a, b = local_wave(wave, x - 2.0 * height * nx, y - 2.0 * height * ny, z - 2.0 * height * nz)
    rate = dx * nx + dy * ny + dz * nz
    # Towards the facet, on the side on which the point lies; the image itself runs on behind it.
    if not (path > 0.0 and a > 0.0 and b > 0.0 and rate * height < 0.0):
        return nothing
    step = -height / rate
    rx, ry, rz = dx - 2.0 * rate * nx, dy - 2.0 * rate * ny, dz - 2.0 * rate * nz
    end = _ends(step, tree)
    _, place, _ = nearest(x, y, z, -rx, -ry, -rz, end, step + end, skip, skip, facet, tree)
    if place < 0 or facet[place] != face or path <= step:
        return nothing
    x, y, z = x - step * rx, y - step * ry, z - step * rz
    if not comes_from_start(wave, skip, x, y, z, dx, dy, dz, path - step, normals, facet, tree):
        return nothing
    return _phasor(_thinned(a, b) * math.sqrt(reflectance(materials, facets.material[place], abs(rate))), k * path)


@kernel
def bent_wave(wave, edge, rows, t, k, x, y, z, materials):
    """Fields at a point of the ray that leaves an edge at t along it: (direct term, image terms, the distance s).

    rows : int32[2], of ``materials``, of the edge's faces.  0 within 1 / k of the edge, where there is no ray.
    """
    qx, qy, qz = along(edge, t)
    dx, dy, dz, path, a, b = local_wave(wave, qx, qy, qz)
    r, cosine = radius_along(wave, edge, dx, dy, dz, a, b)
    sine = math.sqrt(max(1.0 - cosine * cosine, 1e-24))
    ux, uy, uz = x - qx, y - qy, z - qz
    s = math.sqrt(ux * ux + uy * uy + uz * uz)
    nothing = complex(0.0, 0.0)
    if not (k * s >= 1.0 and path > 0.0 and a > 0.0 and b > 0.0):
        return nothing, nothing, s
    n = edge[WEDGE]
    phi, incidence = edge_angle(edge, ux, uy, uz), edge_angle(edge, -dx, -dy, -dz)
    root = math.sqrt(k * s * grown(a, s) * grown(b, s) / grown(r, s)) * sine
    below, above = phi - incidence, phi + incidence
    first = reflectance(materials, rows[0], abs(math.sin(min(phi, incidence))) * sine)
    last = reflectance(materials, rows[1], abs(math.sin(n * math.pi - max(phi, incidence))) * sine)
    direct = boundary_term(n, below, 1.0, root) + boundary_term(n, below, -1.0, root)
    image = math.sqrt(first) * boundary_term(n, above, -1.0, root)
    image += math.sqrt(last) * boundary_term(n, above, 1.0, root)
    size = _thinned(a, b) * math.sqrt(grown(r, s) / s) / (2.0 * n * math.sqrt(2.0 * math.pi * k) * sine)
    scale = _phasor(-size, 0.25 * math.pi + k * (path + s))
    return scale * direct, scale * image, s


@kernel
def bent_power(wave, skip, own, t_own, near_edges, count, table, k, point, facets, materials, tree):
    """What the ray of one edge adds at a point to the power of the geometric light, over that of the wave at the edge.

    Of |g + sum u_e|^2 - |g|^2, direct waves and images apart, the part of edge ``own``: Re u_own* (2g + sum u_e).

    own, t_own      : its number, and where along it the ray left; the ray runs free to the point
    near_edges      : int64[room], whose first ``count`` edges meet the same wave
    table           : EdgeTable
    """
    x, y, z = point
    normals, facet, edges, edge_rows = facets.normals, facets.facet, table.edges, table.rows
    edge = edges[own]
    direct, image, s = bent_wave(wave, edge, edge_rows[own], t_own, k, x, y, z, materials)
    if s * k < 1.0:
        return 0.0
    direct_sum, image_sum = direct, image
    for n in range(count):
        e = near_edges[n]
        if e == own:
            continue
        t = leaving_point(wave, edges[e], x, y, z)
        if not 0.0 < t < edges[e, LENGTH]:
            continue
        qx, qy, qz = along(edges[e], t)
        ux, uy, uz, _, _, _ = local_wave(wave, qx, qy, qz)
        if not from_the_air(edges[e], ux, uy, uz):
            continue
        if not lights(wave, skip, qx, qy, qz, normals, facet, tree):
            continue
        ux, uy, uz = x - qx, y - qy, z - qz
        length = math.sqrt(ux * ux + uy * uy + uz * uz)
        if not clear(qx, qy, qz, ux / length, uy / length, uz / length, length, -1, facet, tree):
            continue
        one, two, _ = bent_wave(wave, edges[e], edge_rows[e], t, k, x, y, z, materials)
        direct_sum += one
        image_sum += two
    if lights(wave, skip, x, y, z, normals, facet, tree):
        _, _, _, path, a, b = local_wave(wave, x, y, z)
        direct_sum += _phasor(2.0 * _thinned(a, b), k * path)
    power = direct.real * direct_sum.real + direct.imag * direct_sum.imag
    if image.real != 0.0 or image.imag != 0.0:
        for n in range(count):
            e = near_edges[n]
            for side in range(2):
                face, seen = table.facets[e, side], False
                for m in range(2 * n + side):  # a facet of several edges has one image
                    seen = seen or table.facets[near_edges[m // 2], m % 2] == face
                if face != skip and not seen:
                    image_sum += 2.0 * image_wave(wave, skip, face, k, x, y, z, facets, materials, tree)
        power += image.real * image_sum.real + image.imag * image_sum.imag
    qx, qy, qz = along(edge, t_own)
    _, _, _, _, a, b = local_wave(wave, qx, qy, qz)
    return power / _thinned(a, b) ** 2
