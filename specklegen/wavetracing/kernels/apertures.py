"""The aperture operator Psi(xi) = int u(r) e^{-i xi.r} d^2r of polygons, and Rayleigh-Sommerfeld fields by their rims.

By edges, u = 1, counter-clockwise, v the midpoint of edge e, m = (e_y, -e_x):

    Psi = (i/|xi|^2) sum_e (xi.m_e) [e^{-i xi.v_e} sinc(xi.e/2) - 1]

The 1 changes nothing, since the m_e add to zero; without it the sum cancels like 1/|xi| at small xi.

By triangles, u linear between its corner values u_i, y_j = -i xi.p_j:

    Psi = 2A sum_i u_i exp[y_0, y_1, y_2, y_i]

Divided differences of exp are the corner of the exponential of the square matrix with diagonal y and superdiagonal 1,
which is regular where corners coincide.

By the rim, the first Rayleigh-Sommerfeld integral of a plane wave, or one of a point, as the sum of two of Kirchhoff's,
of the wave and of its mirror image in the screen: both have the same field there, and opposite slopes. At Q of an edge
of tangent t, s = P - Q, R = |s|, n the direction of the wave, n' of its image, r its radius of curvature:

    u(P) = (u_0(P)/2 pi) sum_e int l { q [e^{ikD}/(Rm) - (4ik/(m w)) e^{ikD/2} sinc(kD/2)] - q' e^{ikD}/(2R(R - n'.s)) }
    q = (s x n).t,  q' = (s x n').t,  l = (length from source to P)/r,  D = R + r - l r,
    m = (g + R)(2 + (g - R)/r),  g = r (l - 1),  w = 1 + l + R/r,

of which D = 4 |s x n|^2/(m w) is regular. The geometric wave is within: its angle about the ray to P makes the bracket
vanish where that ray meets the rim, so that nothing is singular there. For a plane wave l = 1, g = n.s, w = 2.
Sources: [Steinberg] Eqs. 22-24; McCurdy, Ng, Parlett, Math. Comp. 43, 501 (1984) (divided differences);
Maggi and Rubinowicz in Born and Wolf, *Principles of Optics*, section 8.9.
"""

import math

from specklegen.kernels import inlined, kernel

_TERMS = 17
_DARKEST = 1e-280  # |xi|^2, in any unit, below which it loses digits, and phases across an opening are none
_TWO_PI = 2.0 * math.pi


@inlined
def sinc(x):
    """Return sin(x) / x."""
    return math.sin(x) / x if abs(x) > 1e-4 else 1.0 - x * x / 6.0


@inlined
def sinc_less_one(x):
    """Return sin(x) / x - 1, to full relative precision."""
    if abs(x) > 0.5:
        return math.sin(x) / x - 1.0
    y = x * x
    return -y / 6.0 * (1 - y / 20 * (1 - y / 42 * (1 - y / 72 * (1 - y / 110 * (1 - y / 156 * (1 - y / 210))))))


@inlined
def polygon_transform(edges, area, x, y):
    """Return Psi at (x, y) of ``edges`` float64[N, 4]: midpoint, then vector to the end, about a point of the plane."""
    square = x * x + y * y
    if square < _DARKEST:
        return complex(area, 0.0)
    real = imag = 0.0
    for e in range(edges.shape[0]):
        across = x * edges[e, 3] - y * edges[e, 2]
        a = x * edges[e, 0] + y * edges[e, 1]
        b = 0.5 * (x * edges[e, 2] + y * edges[e, 3])
        s, half = sinc(b), math.sin(0.5 * a)
        # (e^{-ia} - 1) sinc b + (sinc b - 1)
        real += across * (-2.0 * half * half * s + sinc_less_one(b))
        imag += across * (-2.0 * half * math.cos(0.5 * a) * s)
    return complex(-imag, real) / square


@kernel
def edge_transform(edges, area, centre_x, centre_y, xi, out):
    """Fill ``out`` complex128[M] at ``xi`` float64[M, 2]; the edges stand about the point (centre_x, centre_y)."""
    for m in range(xi.shape[0]):
        turn = centre_x * xi[m, 0] + centre_y * xi[m, 1]
        value = polygon_transform(edges, area, xi[m, 0], xi[m, 1])
        out[m] = value * complex(math.cos(turn), -math.sin(turn))


@inlined
def divided_difference(y0, y1, y2, y3):
    """Return exp[i y0, i y1, i y2, i y3] for real y: scaled to norm 1, 17 terms of Taylor, squared back."""
    mean = 0.25 * (y0 + y1 + y2 + y3)
    d0, d1, d2, d3 = y0 - mean, y1 - mean, y2 - mean, y3 - mean
    size = max(max(abs(d0), abs(d1)), max(abs(d2), abs(d3)))
    squarings = 0
    while size > 1.0:
        size *= 0.5
        squarings += 1
    h = 0.5**squarings
    d0, d1, d2, d3 = d0 * h, d1 * h, d2 * h, d3 * h
    # Upper triangle of the sum; Horner: E <- 1 + (M / n) E with M = i diag(d) + superdiagonal h.
    one, zero = complex(1.0, 0.0), complex(0.0, 0.0)
    a, f, m, s = one, one, one, one
    b = c = d = g = n = r = zero  # rows (a b c d), (f g n), (m r), (s)
    for term in range(_TERMS, 0, -1):
        q = 1.0 / term
        d = q * (complex(0.0, d0) * d + h * n)
        c = q * (complex(0.0, d0) * c + h * g)
        b = q * (complex(0.0, d0) * b + h * f)
        a = 1.0 + q * complex(0.0, d0) * a
        n = q * (complex(0.0, d1) * n + h * r)
        g = q * (complex(0.0, d1) * g + h * m)
        f = 1.0 + q * complex(0.0, d1) * f
        r = q * (complex(0.0, d2) * r + h * s)
        m = 1.0 + q * complex(0.0, d2) * m
        s = 1.0 + q * complex(0.0, d3) * s
    for _ in range(squarings):
        d = a * d + b * n + c * r + d * s
        c = a * c + b * g + c * m
        b = a * b + b * f
        n = f * n + g * r + n * s
        g = f * g + g * m
        r = m * r + r * s
        a, f, m, s = a * a, f * f, m * m, s * s
    return d * complex(math.cos(mean), math.sin(mean))


@kernel
def triangle_transform(triangles, amplitudes, xi, out):
    """Add to ``out`` complex128[M] the transforms of ``triangles`` float64[T, 3, 2].

    amplitudes : complex128[T, 3]   u at the corners, linear between them
    """
    for t in range(triangles.shape[0]):
        ux, uy = triangles[t, 1, 0] - triangles[t, 0, 0], triangles[t, 1, 1] - triangles[t, 0, 1]
        vx, vy = triangles[t, 2, 0] - triangles[t, 0, 0], triangles[t, 2, 1] - triangles[t, 0, 1]
        double_area = abs(ux * vy - uy * vx)
        for m in range(xi.shape[0]):
            y0 = -(xi[m, 0] * triangles[t, 0, 0] + xi[m, 1] * triangles[t, 0, 1])
            y1 = -(xi[m, 0] * triangles[t, 1, 0] + xi[m, 1] * triangles[t, 1, 1])
            y2 = -(xi[m, 0] * triangles[t, 2, 0] + xi[m, 1] * triangles[t, 2, 1])
            value = amplitudes[t, 0] * divided_difference(y0, y1, y2, y0)
            value += amplitudes[t, 1] * divided_difference(y0, y1, y2, y1)
            value += amplitudes[t, 2] * divided_difference(y0, y1, y2, y2)
            out[m] += double_area * value


@inlined
def _onto(source, x, y):
    """Direction of the wave that meets (x, y, 0), and one over its radius of curvature.

    source : float64[4]   a direction, and 0, of a plane wave; a point, and 1
    """
    if source[3] == 0.0:
        return source[0], source[1], source[2], 0.0
    u, v, w = x - source[0], y - source[1], -source[2]
    curved = 1.0 / math.sqrt(u * u + v * v + w * w)
    return u * curved, v * curved, w * curved, curved


@kernel
def rim_field(edges, k, source, points, nodes, weights, out):
    """Fill ``out`` complex128[M] with the field at ``points`` float64[M, 3], z > 0, over the light's own.

    edges          : float64[N, 4]   start and end, the opening on the left
    source         : float64[4]      a unit vector of travel, and 0; or a point at z < 0, and 1
    nodes, weights : float64[G]      Gauss-Legendre on [-1, 1], 16 of them for 1e-13

    A panel is at most as long as 3/4 of the distance R of its start, times the cosine of incidence; so
    singularities lie at least 1.6 half lengths from its middle, and holds at most 8 radians of phase. It never passes
    over the foot.
    """
    for m in range(points.shape[0]):
        px, py, z = points[m, 0], points[m, 1], points[m, 2]
        total = complex(0.0, 0.0)
        for e in range(edges.shape[0]):
            ax, ay = edges[e, 0] - px, edges[e, 1] - py
            tx, ty = edges[e, 2] - edges[e, 0], edges[e, 3] - edges[e, 1]
            length = math.sqrt(tx * tx + ty * ty)
            if length == 0.0:
                continue
            tx, ty = tx / length, ty / length
            start = ax * tx + ay * ty
            end = start + length
            base = z * z + (ax * ty - ay * tx) ** 2
            x, y, steep, curved = _onto(source, edges[e, 0], edges[e, 1])
            u, v, w, bent = _onto(source, edges[e, 2], edges[e, 3])
            # Along an edge the light's own phase changes fastest at one of its ends.
            rate = max(abs(x * tx + y * ty), abs(u * tx + v * ty))
            steep, curved = min(steep, w), max(curved, bent)
            reach = 8.0 / k if rate == 0.0 else 4.0 / k
            at = start
            while at < end:
                here = math.sqrt(base + at * at)
                # Up to the foot, or to where R has changed by the reach.
                if at < 0.0:
                    near = here - reach
                    step = -at - math.sqrt(max(near * near - base, 0.0)) if near > 0.0 else -at
                else:
                    step = math.sqrt((here + reach) ** 2 - base) - at
                step = min(step, 0.75 * here * steep)
                if rate > 0.0:
                    step = min(step, reach / rate)
                if curved > 0.0:
                    step = min(step, 0.75 * steep / curved)
                if at + 1.0001 * step >= end:
                    step = end - at
                half = 0.5 * step
                for g in range(nodes.size):
                    s = at - start + half * (1.0 + nodes[g])
                    sx, sy = -ax - s * tx, -ay - s * ty
                    u, v, w, bent = _onto(source, edges[e, 0] + s * tx, edges[e, 1] + s * ty)
                    # s x n and (s x n').t: what lies along z, and within the screen.
                    cx, cy, cz = sy * w - z * v, z * u - sx * w, sx * v - sy * u
                    flat = sx * u + sy * v
                    here = math.sqrt(sx * sx + sy * sy + z * z)
                    more = here * here * bent + 2.0 * (flat + z * w)
                    long = math.sqrt(1.0 + bent * more)
                    grown = more / (long + 1.0)
                    wide = (grown + here) * (2.0 + (grown - here) * bent)
                    both = 1.0 + long + here * bent
                    d = 2.0 * k * (cx * cx + cy * cy + cz * cz) / (wide * both)  # half of k D
                    sine, cosine = math.sin(d), math.cos(d)
                    across, image = cx * tx + cy * ty, (-sy * w - z * v) * tx + (z * u + sx * w) * ty
                    far = across / (here * wide) - 0.5 * image / (here * (here - flat + z * w))
                    wave = 4.0 * k * across * (sine / d if d > 1e-4 else 1.0 - d * d / 6.0) / (wide * both)
                    size = half * weights[g] * long
                    total += size * complex(
                        far * (1.0 - 2.0 * sine * sine) + wave * sine, 2.0 * far * sine * cosine - wave * cosine
                    )
                at += step
        out[m] = total / _TWO_PI
