"""The coherent field: attenuated rays, and volume integrals of what the particles scatter in phase.

Lights are targets as in :mod:`specklegen.kernels.volume_walk`: points, or the direction -i of a wave along i.
Optical depths count half, for they are those of amplitudes.
"""

import math

import numpy as np

from specklegen.kernels import inlined, kernel
from specklegen.kernels.endpoints import face_profile
from specklegen.kernels.trigonometry import sincos_turns
from specklegen.kernels.volume import EXTRA, chord, exit_distance, optical_depth

# Gauss-Legendre with 32 nodes: to rounding for exponentials through up to 54 radians (or e-folds).
NODES, REACH = 32, 50.0
_X, _W = np.polynomial.legendre.leggauss(NODES)
_X, _W = (_X + 1) / 2, _W / 2
DEEPEST = 80.0  # optical depth beyond which nothing is seen: amplitude e^-40


@kernel
def rays(volume, near_light, lights, near_view, views, wavelength, footprint, radius, out):
    """Fill ``out`` complex128[T, V] with tau xi b between lights and views, at least one of the two near.

    Returns the number t V + v of a pair whose points coincide, which has no field, or -1.
    """
    bounds, cells, extinction = volume.bounds, volume.cells, volume.extinction
    for t in range(lights.shape[0]):
        lx, ly, lz = lights[t, 0], lights[t, 1], lights[t, 2]
        for v in range(views.shape[0]):
            vx, vy, vz = views[v, 0], views[v, 1], views[v, 2]
            reach, strength = math.inf, 1.0
            if near_light and near_view:
                x, y, z = lx, ly, lz
                dx, dy, dz = vx - x, vy - y, vz - z
                reach = math.sqrt(dx * dx + dy * dy + dz * dz)
                if reach == 0.0:
                    return t * views.shape[0] + v
                dx, dy, dz = dx / reach, dy / reach, dz / reach
                strength = 1.0 / math.sqrt(reach) if cells[EXTRA, 0] == 2 else 1.0 / reach
                turns = reach / wavelength
            else:
                x, y, z = (lx, ly, lz) if near_light else (vx, vy, vz)
                dx, dy, dz = (vx, vy, vz) if near_light else (lx, ly, lz)
                turns = -(dx * x + dy * y + dz * z) / wavelength
                if radius > 0.0:
                    strength = face_profile(bounds, footprint, radius, lx, ly, lz, x, y, z)
            near, far = chord(bounds, x, y, z, dx, dy, dz)
            depth = optical_depth(bounds, cells, extinction, x, y, z, dx, dy, dz, near, min(far, reach))
            sine, cosine = sincos_turns(turns)
            out[t, v] = strength * math.exp(-0.5 * depth) * complex(cosine, sine)
    return -1


@inlined
def longest(sides, view, half):
    """Largest s for which a box and itself moved by s ``view`` overlap and something is seen through s."""
    s = DEEPEST / (2.0 * half)
    for a in range(len(sides)):
        if view[a] != 0.0:
            s = min(s, sides[a] / abs(view[a]))
    return s


@inlined
def panels_of(sides, light, view, wavelength, half):
    """Quadrature panels that the overlap integral takes."""
    rate = half
    for a in range(len(sides)):
        rate += 2.0 * math.pi * abs((light[a] - view[a]) * view[a]) / wavelength
    return int(rate * longest(sides, view, half) / REACH) + 1


@kernel
def overlap_panels(sides, lights, views, wavelength, half):
    """Quadrature panels over all lights and views."""
    total = 0
    for t in range(lights.shape[0]):
        for v in range(views.shape[0]):
            total += panels_of(sides, lights[t], views[v], wavelength, half)
    return total


@inlined
def _shifted(sides, light, view, wavelength, s):
    """Integral of e^(ik(i - v).x) over the x of a box centred at 0 for which x + s v is inside too."""
    value = 1.0 + 0.0j
    for a in range(len(sides)):
        width = max(sides[a] - s * abs(view[a]), 0.0)
        q = (light[a] - view[a]) / wavelength
        sine, _ = sincos_turns(0.5 * q * width)
        x = math.pi * q * width
        sinc = 1.0 if x == 0.0 else sine / x
        sine, cosine = sincos_turns(-0.5 * q * s * view[a])
        value *= width * sinc * complex(cosine, sine)
    return value


@kernel
def overlap(sides, lights, views, wavelength, half, out):
    """Fill ``out`` complex128[T, V] with the integral of h e^(ik(i - v).x) e^(-h t(x, v)) over a box centred at 0.

    sides : float64[d]; half : h = sigma_t / 2; lights, views : directions of travel; t : distance from x to the
    surface along v

    Points deeper than s below the surface form the box's overlap with itself moved by -s v, another box, whose
    transform Phi(s) is a product of sincs. Summed by layers the integral is h int h e^(-h s) (Phi(0) - Phi(s)) ds:
    one dimension instead of d. The difference costs thick media OD roundings.
    """
    for t in range(lights.shape[0]):
        for v in range(views.shape[0]):
            light, view = lights[t], views[v]
            panels = panels_of(sides, light, view, wavelength, half)
            step = longest(sides, view, half) / panels
            whole, layers = _shifted(sides, light, view, wavelength, 0.0), 0.0 + 0.0j
            for n in range(panels):
                for j in range(NODES):
                    s = (n + _X[j]) * step
                    layers += _W[j] * math.exp(-half * s) * (whole - _shifted(sides, light, view, wavelength, s))
            out[t, v] = half * (half * step * layers + math.exp(-half * step * panels) * whole)


@kernel
def scattered(volume, points, weights, kinds, light, views, wavelength, shapes, out, bound):
    """Fill ``out`` complex128[V] with the sum of w f e^(ik(i - v).x) tau(x, v), ``bound`` with that of its moduli.

    points, weights, kinds : float64[J, 3], float64[J], int64[J]   quadrature nodes and their materials
    shapes : complex128[M, V]   f = s(i . v) / s(1) of each material
    """
    bounds, cells, extinction = volume.bounds, volume.cells, volume.extinction
    for v in range(views.shape[0]):
        vx, vy, vz = views[v, 0], views[v, 1], views[v, 2]
        qx, qy, qz = (light[0] - vx) / wavelength, (light[1] - vy) / wavelength, (light[2] - vz) / wavelength
        total = 0.0 + 0.0j
        size = 0.0
        for j in range(points.shape[0]):
            x, y, z = points[j, 0], points[j, 1], points[j, 2]
            far = exit_distance(bounds, x, y, z, vx, vy, vz)
            depth = optical_depth(bounds, cells, extinction, x, y, z, vx, vy, vz, 0.0, far)
            f = weights[j] * math.exp(-0.5 * depth) * shapes[kinds[j], v]
            sine, cosine = sincos_turns(qx * x + qy * y + qz * z)
            total += f * complex(cosine, sine)
            size += abs(f)
        out[v] = total
        bound[v] = size
