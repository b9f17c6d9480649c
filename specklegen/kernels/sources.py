"""Starts of paths through a volume: a mixture of densities for the first vertex and the first direction.

    p(x, w) = sum_r share_r p_r(x) h_r(w | x)

Each source is one way in: along a plane wave, along a beam, away from a point (whose 1/r^(d-1) then cancels
the near-field singularity there, at light and sensor points alike), or anywhere. Along a ray that enters
the volume the depth of the first vertex is exponential, forced to lie inside:

    p_r(x) = S_r(ray) sigma_t(x) e^(-depth before x) / (1 - e^(-depth of the whole ray))

with S the density of rays across the beam: ``1 / projected area``, the footprint's density over the obliquity, or
``1 / (solid angle r^(d-1))``. First directions spread about the ray as the material at the vertex scatters: the phase
function of another would leave the ratio of both in the weights, hundreds where one is narrow.
"""

import math
from typing import NamedTuple

import numpy as np

from specklegen.kernels import folded, inlined
from specklegen.kernels.arithmetic import exponential
from specklegen.kernels.footprints import GAUSSIAN, footprint_density, sample_footprint
from specklegen.kernels.frames import deflect
from specklegen.kernels.lanes import LANES
from specklegen.kernels.phase_functions import (
    henyey_greenstein,
    henyey_greenstein_2d,
    sample_henyey_greenstein,
    sample_henyey_greenstein_2d,
)
from specklegen.kernels.rng import uniforms
from specklegen.kernels.trigonometry import sincos_turns
from specklegen.kernels.volume import EXTRA, chord, corners, escape_distance, march, optical_depth

UNIFORM, PLANE, BEAM, POINT = 0, 1, 2, 3
_ISOTROPIC_SHARE = 0.1  # of a lobe: bounds the weights where the medium's lobe has broader tails
_TAU = 2.0 * math.pi
_CLOSEST = 1e-150  # of a vertex to a point, whatever the unit: its square is a number still
_ROUNDING = 1e-13  # of a coordinate: closer vertices lie where rounding puts them, not where they were drawn
_SLACK = 1.0 + 1e-12  # rounding of a cosine at the rim of a full sphere


# Columns of a source.
VECTOR = 0  # direction of travel, or the point
SHARE, CUMULATIVE = 3, 4  # probability of the source, and the running sum
AXIS, APERTURE, SOLID_ANGLE = 5, 8, 9  # of a point: the cone of rays that may meet the volume; its aperture is
# 1 - cos of the half angle in space, and the half angle in turns in flatland
EXTENT = 10  # of a beam: size of the sampled footprint on the entrance plane
COLUMNS = 11

# Uniforms of a start: the source, the depth, the first direction (2); across the ray (2 x 2); the face or the third
# coordinate (2, and 2 unused); whether single scattering is kept, and the type of the first particle (and 2 unused).
SOURCE, DEPTH, TURN, ACROSS, FACE, KEPT, TYPE, WORDS = 0, 1, 2, 4, 8, 12, 13, 16


class Sources(NamedTuple):
    """The mixture, as the kernels know it (R sources).

    Attributes
    ----------
    kinds : int64[R, 2]
        UNIFORM, PLANE, BEAM or POINT; kind of footprint of a beam.
    rows : float64[R, COLUMNS]
    lobes : float64[materials]
        Anisotropy of first directions about the ray, of a vertex in each material.
    """

    kinds: np.ndarray
    rows: np.ndarray
    lobes: np.ndarray


@inlined
def lobe_density(dimension, g, one_minus_cos):
    """Density of a first direction about its ray: Henyey-Greenstein with a tenth spread evenly."""
    if dimension == 2:
        even, lobe = 1.0 / _TAU, henyey_greenstein_2d(g, 1.0 - one_minus_cos)
    else:
        even, lobe = 0.5 / _TAU, henyey_greenstein(g, 1.0 - one_minus_cos)
    return lobe if g == 0.0 else _ISOTROPIC_SHARE * even + (1.0 - _ISOTROPIC_SHARE) * lobe


@inlined
def turn(dimension, dx, dy, dz, one_minus_cos, azimuth):
    """Deflect a direction; in flatland the azimuth (uniform in (0, 1)) only chooses the side."""
    if dimension == 2:
        return deflect(dx, dy, dz, one_minus_cos, 1.0 if azimuth < 0.5 else -1.0, 0.0)
    sine, cosine = sincos_turns(azimuth)
    return deflect(dx, dy, dz, one_minus_cos, cosine, sine)


@inlined
def sample_lobe(dimension, g, dx, dy, dz, u, v):
    """Draw a first direction about a ray and return it."""
    lobe = g
    if g != 0.0:
        if u < _ISOTROPIC_SHARE:
            lobe = 0.0
            u = u / _ISOTROPIC_SHARE
        else:
            u = (u - _ISOTROPIC_SHARE) / (1.0 - _ISOTROPIC_SHARE)
    if dimension == 2:
        one_minus_cos = sample_henyey_greenstein_2d(lobe, u)
    else:
        one_minus_cos = sample_henyey_greenstein(lobe, u)
    return turn(dimension, dx, dy, dz, one_minus_cos, v)


@inlined
def _size(bounds, cells, axis):
    """Width of the volume along an axis; 1 for flatland's y, which has no width."""
    return 1.0 if axis == 1 and cells[EXTRA, 0] == 2 else bounds[1, axis] - bounds[0, axis]


@inlined
def projected_area(bounds, cells, dx, dy, dz):
    """Cross-section of the volume across a direction (a length in flatland)."""
    sx, sy, sz = _size(bounds, cells, 0), _size(bounds, cells, 1), _size(bounds, cells, 2)
    area = abs(dx) * sy * sz + abs(dz) * sx * sy
    return area if cells[EXTRA, 0] == 2 else area + abs(dy) * sx * sz


@inlined
def _face_density(footprint, extent, dimension, x, y):
    """Density per area (length in flatland) of a footprint's points."""
    if dimension == 3:
        return footprint_density(footprint, extent, x, y)
    if footprint == GAUSSIAN:
        return math.exp(-0.5 * x * x / (extent * extent)) / (extent * math.sqrt(_TAU))
    return 0.5 / extent if abs(x) <= extent else 0.0


@inlined
def _sample_face(footprint, extent, dimension, u, v):
    if dimension == 3:
        x, y, _ = sample_footprint(footprint, extent, u, v)
        return x, y
    if footprint == GAUSSIAN:
        sine, _ = sincos_turns(v)
        return extent * math.sqrt(-2.0 * math.log(u)) * sine, 0.0
    return extent * (2.0 * u - 1.0), 0.0


@inlined
def draw_starts(key0, key1, sample, first, count, words):
    """Fill ``words`` float64[WORDS * LANES] with the uniforms of the starts of so many paths, word after word."""
    for block in range(WORDS // 4):
        place = 4 * block * LANES
        for i in range(count):
            a, b, c, d = uniforms(key0, key1, sample, np.uint64(first + i), np.uint64(block))
            words[place + i], words[place + LANES + i] = a, b
            words[place + 2 * LANES + i], words[place + 3 * LANES + i] = c, d


@inlined
def _finely(words, word, n):
    """A uniform of two words: 32 bits alone would put wide media on a lattice."""
    return words[LANES * word + n] + (words[LANES * (word + 1) + n] - 0.5) * 2.0**-32


@folded
def sample_ray(bounds, cells, kinds, rows, r, words, n):
    """Draw a ray of source r: origin, direction; for a source of no ray, a point of the volume and any direction."""
    u, v = _finely(words, ACROSS, n), _finely(words, ACROSS + 2, n)
    kind = kinds[r, 0]
    px, py, pz = rows[r, VECTOR], rows[r, VECTOR + 1], rows[r, VECTOR + 2]
    flat = cells[EXTRA, 0] == 2
    if kind == POINT:
        if flat:
            sine, cosine = sincos_turns(rows[r, APERTURE] * (2.0 * u - 1.0))
            ax, az = rows[r, AXIS], rows[r, AXIS + 2]
            return px, py, pz, ax * cosine + az * sine, 0.0, az * cosine - ax * sine
        sine, cosine = sincos_turns(v)
        dx, dy, dz = deflect(rows[r, AXIS], rows[r, AXIS + 1], rows[r, AXIS + 2], rows[r, APERTURE] * u, cosine, sine)
        return px, py, pz, dx, dy, dz
    if kind == BEAM:
        x, y = _sample_face(kinds[r, 1], rows[r, EXTENT], cells[EXTRA, 0], u, v)
        return x, y, bounds[0, 2], px, py, pz
    lx, ly, lz = bounds[0, 0], 0.0 if flat else bounds[0, 1], bounds[0, 2]
    sx, sy, sz = _size(bounds, cells, 0), _size(bounds, cells, 1), _size(bounds, cells, 2)
    if kind == UNIFORM:
        w = _finely(words, FACE, n)
        return lx + u * sx, 0.0 if flat else ly + v * sy, lz + w * sz, 0.0, 0.0, 1.0
    # A plane wave enters through up to three faces, each in proportion to its projection.
    face = words[LANES * FACE + n] * projected_area(bounds, cells, px, py, pz)
    x_face = abs(px) * sy * sz
    z_face = abs(pz) * sx * sy
    if face < x_face:
        x = lx if px > 0.0 else bounds[1, 0]
        return x, 0.0 if flat else ly + v * sy, lz + u * sz, px, py, pz
    if face < x_face + z_face or flat:
        z = lz if pz > 0.0 else bounds[1, 2]
        return lx + u * sx, 0.0 if flat else ly + v * sy, z, px, py, pz
    y = ly if py > 0.0 else bounds[1, 1]
    return lx + u * sx, y, lz + v * sz, px, py, pz


@folded
def sample_start(bounds, cells, extinction, kinds, rows, words, n):
    """Draw the first vertex of path n of ``words``; (found, whether along a ray, x, y, z, direction of its ray).

    Not found where the ray meets nothing.
    """
    a, b = words[LANES * SOURCE + n], words[LANES * DEPTH + n]
    r = 0
    while r < kinds.shape[0] - 1 and a >= rows[r, CUMULATIVE]:
        r += 1
    x, y, z, dx, dy, dz = sample_ray(bounds, cells, kinds, rows, r, words, n)
    if kinds[r, 0] == UNIFORM:
        return True, False, x, y, z, dx, dy, dz
    near, far = chord(bounds, x, y, z, dx, dy, dz)
    if near >= far:
        return False, True, x, y, z, dx, dy, dz
    whole = optical_depth(bounds, cells, extinction, x, y, z, dx, dy, dz, near, far)
    if whole == 0.0:
        return False, True, x, y, z, dx, dy, dz
    _, t = march(bounds, cells, extinction, x, y, z, dx, dy, dz, near, far, -math.log1p(b * math.expm1(-whole)))
    if kinds[r, 0] == POINT and t <= _CLOSEST + _ROUNDING * max(abs(x), abs(y), abs(z)):
        # Within rounding of the point, or so near that squares underflow: next to nothing of its light, left out.
        return False, True, x, y, z, dx, dy, dz
    x, y, z = x + t * dx, y + t * dy, z + t * dz
    # Rounding may put the vertex a bit outside.
    x = min(max(x, bounds[0, 0]), bounds[1, 0])
    z = min(max(z, bounds[0, 2]), bounds[1, 2])
    y = min(max(y, bounds[0, 1]), bounds[1, 1])
    return True, True, x, y, z, dx, dy, dz


@folded
def source_density(bounds, cells, extinction, sigma, kinds, rows, r, x, y, z):
    """Density p_r(x) of a first vertex where the extinction is ``sigma``, and the direction of source r's ray there."""
    kind = kinds[r, 0]
    if kind == UNIFORM:
        sizes = _size(bounds, cells, 0) * _size(bounds, cells, 1) * _size(bounds, cells, 2)
        return 1.0 / sizes, 0.0, 0.0, 1.0
    dx, dy, dz = rows[r, VECTOR], rows[r, VECTOR + 1], rows[r, VECTOR + 2]
    reach = math.inf
    if kind == POINT:
        px, py, pz = dx, dy, dz
        dx, dy, dz = x - px, y - py, z - pz
        reach = math.sqrt(dx * dx + dy * dy + dz * dz)
        if reach == 0.0:
            return 0.0, 0.0, 0.0, 1.0
        dx, dy, dz = dx / reach, dy / reach, dz / reach
        cosine = dx * rows[r, AXIS] + dy * rows[r, AXIS + 1] + dz * rows[r, AXIS + 2]
        if cells[EXTRA, 0] == 2:
            across = dx * rows[r, AXIS + 2] - dz * rows[r, AXIS]
            if abs(math.atan2(across, cosine)) > rows[r, APERTURE] * _TAU * _SLACK:
                return 0.0, dx, dy, dz
            rays = 1.0 / (rows[r, SOLID_ANGLE] * reach)
        else:
            if 1.0 - cosine > rows[r, APERTURE] * _SLACK:
                return 0.0, dx, dy, dz
            rays = 1.0 / (rows[r, SOLID_ANGLE] * reach * reach)
    elif kind == PLANE:
        rays = 1.0 / projected_area(bounds, cells, dx, dy, dz)
    else:
        t = (z - bounds[0, 2]) / dz
        rays = _face_density(
            kinds[r, 1], rows[r, EXTENT], cells[EXTRA, 0], x - t * dx, y - t * dy
        ) / abs(dz)  # fmt: skip
    if rays == 0.0:
        return 0.0, dx, dy, dz
    box = corners(bounds)
    back = min(reach, escape_distance(box, x, y, z, -dx, -dy, -dz))
    ahead = escape_distance(box, x, y, z, dx, dy, dz)
    if extinction.shape[0] == 1:
        before, after = sigma * back, sigma * ahead
    else:
        before = optical_depth(bounds, cells, extinction, x, y, z, -dx, -dy, -dz, 0.0, back)
        after = optical_depth(bounds, cells, extinction, x, y, z, dx, dy, dz, 0.0, ahead)
    if before + after == 0.0:
        return 0.0, dx, dy, dz
    return rays * sigma * exponential(-before) / -math.expm1(-(before + after)), dx, dy, dz


@folded
def start_densities(bounds, cells, extinction, here, kinds, rows, x, y, z, wx, wy, wz):
    """Densities of the mixture: (of the first vertex alone, of the first vertex and direction).

    ``here``: extinction at the vertex, and anisotropy of the phase function about its ray.
    """
    sigma, lobe = here
    vertex = joint = 0.0
    for r in range(kinds.shape[0]):
        p, dx, dy, dz = source_density(bounds, cells, extinction, sigma, kinds, rows, r, x, y, z)
        if p > 0.0:
            p *= rows[r, SHARE]
            ex, ey, ez = wx - dx, wy - dy, wz - dz
            # 1 - cos from the difference of the unit vectors, precise for sharp lobes.
            one_minus_cos = 0.5 * (ex * ex + ey * ey + ez * ez)
            vertex += p
            g = 0.0 if kinds[r, 0] == UNIFORM else lobe
            joint += p * lobe_density(cells[EXTRA, 0], g, one_minus_cos)
    return vertex, joint
