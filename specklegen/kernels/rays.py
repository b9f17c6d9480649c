"""Rays from one element of a line source to the pixels of a detector: sums of their phasors.

A ray leaves x' (uniform in the element) at an angle theta (uniform between two limits) and lands at
x = x' + Z tan(theta). It carries (theta range) exp{ik (s - s0)}, s = |ray|, s0 = sqrt(f^2 + x'^2), and
the phase is taken in the form without cancellation

    s - s0 = (Z^2 - f^2 + x^2 - 2 x x') / (s + s0),   Z^2 - f^2 = z (2 f + z),

because s and s0 may each be 1e5 wavelengths. A ray is addressed by (seed; element, pixel, number), so
that it does not depend on the order of the work.
"""

import math
from typing import NamedTuple

import numpy as np

from specklegen.kernels import inlined, kernel
from specklegen.kernels.rng import uniforms


class Element(NamedTuple):
    """Element [start, start + width] of a line source, and its number."""

    number: int
    start: float
    width: float


@inlined
def landing(xs, lower, upper, distance, unit):
    """Aim from ``xs`` at [lower, upper], ``distance`` away: landing point and range of angles.

    The difference of the two arctangents is taken as one, and the tangent is advanced from the lower
    limit, so that narrow pixels keep their digits; the clip guards angles near pi/2.
    """
    low = (lower - xs) / distance
    span = math.atan2((upper - lower) * distance, distance * distance + (lower - xs) * (upper - xs))
    step = math.tan(span * unit)
    x = xs + distance * (low + step) / (1.0 - low * step)
    return min(max(x, lower), upper), span


@inlined
def path_difference(x, xs, focal_length, z):
    """Return s - s0 for a ray from ``xs`` to ``x`` in the plane ``focal_length + z``."""
    distance = focal_length + z
    s = math.sqrt(distance * distance + (x - xs) * (x - xs))
    s0 = math.sqrt(focal_length * focal_length + xs * xs)
    return (z * (2.0 * focal_length + z) + x * (x - 2.0 * xs)) / (s + s0)


@kernel
def uniform_rays(key0, key1, element, n_rays, lower, upper, focal_length, k, total, square):
    """Trace ``n_rays`` over the whole line [lower[0], upper[-1]] of the focal plane and bin them.

    element      : Element
    lower, upper : float64[N]      edges of adjoining pixels of one width
    total        : complex128[N]   sum of the phasors of the rays in each pixel, added to
    square       : float64[N]      sum of their squared moduli, added to
    """
    pixels = lower.size
    first, last = lower[0], upper[pixels - 1]
    per_length = pixels / (last - first)
    for ray in range(n_rays):
        u, v, _, _ = uniforms(key0, key1, np.uint64(element.number), np.uint64(ray), np.uint64(0))
        xs = element.start + element.width * u
        x, span = landing(xs, first, last, focal_length, v)
        # Half-open pixels, the last one closed: no ray on an edge is lost.
        pixel = min(int((x - first) * per_length), pixels - 1)
        phase = k * path_difference(x, xs, focal_length, 0.0)
        total[pixel] += complex(span * math.cos(phase), span * math.sin(phase))
        square[pixel] += span * span


@kernel
def stratified_rays(key0, key1, element, n_rays, lower, upper, z, focal_length, k, total, square):
    """Trace ``n_rays[i]`` to each pixel [lower[i], upper[i]] of the plane ``focal_length + z[i]``.

    Other arguments as in `uniform_rays`; here the range of angles is that of the pixel.
    """
    for pixel in range(lower.size):
        distance, number = focal_length + z[pixel], np.uint64(pixel) + np.uint64(1)
        for ray in range(n_rays[pixel]):
            u, v, _, _ = uniforms(key0, key1, np.uint64(element.number), np.uint64(ray), number)
            xs = element.start + element.width * u
            x, span = landing(xs, lower[pixel], upper[pixel], distance, v)
            phase = k * path_difference(x, xs, focal_length, z[pixel])
            total[pixel] += complex(span * math.cos(phase), span * math.sin(phase))
            square[pixel] += span * span
