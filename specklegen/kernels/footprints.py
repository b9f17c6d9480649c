"""Entrance of light: points drawn on the illuminated face, the density of the draw, and the beam's profile there."""

import math

from specklegen.kernels import inlined
from specklegen.kernels.trigonometry import sincos_turns

# UNLIMITED is a plane wave on an infinite slab: all entry points are alike, so the walk starts at the
# origin and every quantity is per unit area.
SQUARE, DISC, GAUSSIAN, UNLIMITED = 0, 1, 2, 3


@inlined
def sample_footprint(footprint, extent, u, v):
    """Draw a point of the illuminated face and return it with the inverse of its density (an area).

    ``extent``: half side of the square, radius of the disc, or standard deviation of the Gaussian density.
    """
    if footprint == SQUARE:
        return extent * (2.0 * u - 1.0), extent * (2.0 * v - 1.0), 4.0 * extent * extent
    if footprint == UNLIMITED:
        return 0.0, 0.0, 1.0
    sine, cosine = sincos_turns(v)
    if footprint == DISC:
        radius = extent * math.sqrt(u)
        return radius * cosine, radius * sine, math.pi * extent * extent
    r2 = -2.0 * math.log(u)
    radius = extent * math.sqrt(r2)
    return radius * cosine, radius * sine, 2.0 * math.pi * extent * extent * math.exp(0.5 * r2)


@inlined
def footprint_density(footprint, extent, x, y):
    """Density per area with which :func:`sample_footprint` draws the point (x, y)."""
    if footprint == SQUARE:
        return 1.0 / (4.0 * extent * extent) if abs(x) <= extent and abs(y) <= extent else 0.0
    if footprint == UNLIMITED:
        return 1.0
    r2 = x * x + y * y
    if footprint == DISC:
        return 1.0 / (math.pi * extent * extent) if r2 <= extent * extent else 0.0
    s2 = extent * extent
    return math.exp(-0.5 * r2 / s2) / (2.0 * math.pi * s2)


@inlined
def profile(footprint, radius, x, y):
    """Amplitude profile b at a point of the entrance face, 1 at its peak.

    ``radius``: half side, radius, or the 1/e^2 intensity radius.
    """
    if footprint == SQUARE:
        return 1.0 if abs(x) <= radius and abs(y) <= radius else 0.0
    if footprint == UNLIMITED:
        return 1.0
    r2 = x * x + y * y
    if footprint == DISC:
        return 1.0 if r2 <= radius * radius else 0.0
    return math.exp(-r2 / (radius * radius))
