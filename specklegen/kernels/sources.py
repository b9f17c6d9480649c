"""Where paths through a volume start: a mixture of densities for the first vertex and the first direction.

    p(x, w) = sum_r share_r p_r(x) h_r(w | x)

Each source is one way in: along a plane wave, along a beam, away from a point (whose 1/r^(d-1) then cancels
the near-field singularity there, at light and sensor points alike), or anywhere. Along a ray that enters
the volume the depth of the first vertex is exponential, forced to lie inside:

    p_r(x) = S_r(ray) sigma_t(x) e^(-depth before x) / (1 - e^(-depth of the whole ray))

with S the density of rays across the beam: 1 / projected area, the footprint's density over the obliquity, or
1 / (solid angle r^(d-1)).
"""

import math
from typing import NamedTuple

import numpy as np

from specklegen.kernels import inlined
from specklegen.kernels.geometry import deflect
from specklegen.kernels.phase_functions import (
    henyey_greenstein,
    henyey_greenstein_2d,
    sample_henyey_greenstein,
    sample_henyey_greenstein_2d,
)
from specklegen.kernels.rng import uniforms
from specklegen.kernels.trigonometry import sincos_turns
from specklegen.kernels.volume import chord, exit_distance, march, optical_depth, voxel
from specklegen.kernels.walk import GAUSSIAN, footprint_density, sample_footprint

UNIFORM, PLANE, BEAM, POINT = 0, 1, 2, 3
_ISOTROPIC_SHARE = 0.1  # of a lobe: bounds the weights where the medium's lobe has broader tails
_TAU = 2.0 * math.pi
_SLACK = 1.0 + 1e-12  # rounding of a cosine at the rim of a full sphere


class Sources(NamedTuple):
    """The mixture, as the kernels know it (R sources).

    Attributes
    ----------
    kinds : int64[R]
        UNIFORM, PLANE, BEAM or POINT.
    vectors : float64[R, 3]
        Direction of travel, or the point.
    shares, cumulative : float64[R]
        Probability of each source, and the running sum.
    lobes : float64[R]
        Anisotropy of the first direction's lobe about the ray.
    axes, apertures, solid_angles : float64[R, 3], float64[R], float64[R]
        Of a point: the cone of rays that may meet the volume, its aperture as 1 - cos of the half angle in
        space and as the half angle in turns in flatland.
    footprints, extents : int64[R], float64[R]
        Of a beam: kind and size of the sampled footprint on the entrance plane.
    """

    kinds: np.ndarray
    vectors: np.ndarray
    shares: np.ndarray
    cumulative: np.ndarray
    lobes: np.ndarray
    axes: np.ndarray
    apertures: np.ndarray
    solid_angles: np.ndarray
    footprints: np.ndarray
    extents: np.ndarray


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
def _size(volume, axis):
    """Width of the volume along an axis; 1 for flatland's y, which has no width."""
    return 1.0 if axis == 1 and volume.dimension == 2 else volume.upper[axis] - volume.lower[axis]


@inlined
def projected_area(volume, dx, dy, dz):
    """Cross-section of the volume across a direction (a length in flatland)."""
    sx, sy, sz = _size(volume, 0), _size(volume, 1), _size(volume, 2)
    area = abs(dx) * sy * sz + abs(dz) * sx * sy
    return area if volume.dimension == 2 else area + abs(dy) * sx * sz


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
def sample_ray(volume, sources, r, k0, k1, sample, path):
    """Draw a ray of source r: origin, direction; for a source of no ray, a point of the volume and no direction."""
    a, b, c, d = uniforms(k0, k1, sample, path, np.uint64(1))
    # Two words a coordinate: 32 bits alone would put wide media on a lattice.
    u, v = a + (b - 0.5) * 2.0**-32, c + (d - 0.5) * 2.0**-32
    kind = sources.kinds[r]
    px, py, pz = sources.vectors[r, 0], sources.vectors[r, 1], sources.vectors[r, 2]
    flat = volume.dimension == 2
    if kind == POINT:
        if flat:
            sine, cosine = sincos_turns(sources.apertures[r] * (2.0 * u - 1.0))
            ax, az = sources.axes[r, 0], sources.axes[r, 2]
            return px, py, pz, ax * cosine + az * sine, 0.0, az * cosine - ax * sine
        sine, cosine = sincos_turns(v)
        dx, dy, dz = deflect(
            sources.axes[r, 0], sources.axes[r, 1], sources.axes[r, 2], sources.apertures[r] * u, cosine, sine
        )
        return px, py, pz, dx, dy, dz
    if kind == BEAM:
        x, y = _sample_face(sources.footprints[r], sources.extents[r], volume.dimension, u, v)
        return x, y, volume.lower[2], px, py, pz
    lx, ly, lz = volume.lower[0], 0.0 if flat else volume.lower[1], volume.lower[2]
    sx, sy, sz = _size(volume, 0), _size(volume, 1), _size(volume, 2)
    e, f, _, _ = uniforms(k0, k1, sample, path, np.uint64(2))
    if kind == UNIFORM:
        w = e + (f - 0.5) * 2.0**-32
        return lx + u * sx, 0.0 if flat else ly + v * sy, lz + w * sz, 0.0, 0.0, 0.0
    # A plane wave enters through up to three faces, each in proportion to its projection.
    face = e * projected_area(volume, px, py, pz)
    x_face = abs(px) * sy * sz
    z_face = abs(pz) * sx * sy
    if face < x_face:
        x = lx if px > 0.0 else volume.upper[0]
        return x, 0.0 if flat else ly + v * sy, lz + u * sz, px, py, pz
    if face < x_face + z_face or flat:
        z = lz if pz > 0.0 else volume.upper[2]
        return lx + u * sx, 0.0 if flat else ly + v * sy, z, px, py, pz
    y = ly if py > 0.0 else volume.upper[1]
    return lx + u * sx, y, lz + v * sz, px, py, pz


@inlined
def sample_start(volume, sources, k0, k1, sample, path):
    """Draw a first vertex and direction; (found, x, y, z, wx, wy, wz), not found where the ray meets nothing."""
    a, b, c, d = uniforms(k0, k1, sample, path, np.uint64(0))
    r = 0
    while r < sources.kinds.shape[0] - 1 and a >= sources.cumulative[r]:
        r += 1
    x, y, z, dx, dy, dz = sample_ray(volume, sources, r, k0, k1, sample, path)
    if sources.kinds[r] == UNIFORM:
        wx, wy, wz = sample_lobe(volume.dimension, 0.0, 0.0, 0.0, 1.0, c, d)
        return True, x, y, z, wx, wy, wz
    wx, wy, wz = sample_lobe(volume.dimension, sources.lobes[r], dx, dy, dz, c, d)
    near, far = chord(volume, x, y, z, dx, dy, dz)
    if near >= far:
        return False, x, y, z, wx, wy, wz
    whole = optical_depth(volume, x, y, z, dx, dy, dz, near, far)
    if whole == 0.0:
        return False, x, y, z, wx, wy, wz
    _, t = march(volume, x, y, z, dx, dy, dz, near, far, -math.log1p(b * math.expm1(-whole)))
    x, y, z = x + t * dx, y + t * dy, z + t * dz
    # Rounding may put the vertex a bit outside.
    x = min(max(x, volume.lower[0]), volume.upper[0])
    z = min(max(z, volume.lower[2]), volume.upper[2])
    y = min(max(y, volume.lower[1]), volume.upper[1])
    return True, x, y, z, wx, wy, wz


@inlined
def source_density(volume, sources, r, x, y, z):
    """Density p_r(x) of a first vertex inside the volume, and the direction of source r's ray there."""
    kind = sources.kinds[r]
    if kind == UNIFORM:
        sizes = _size(volume, 0) * _size(volume, 1) * _size(volume, 2)
        return 1.0 / sizes, 0.0, 0.0, 1.0
    dx, dy, dz = sources.vectors[r, 0], sources.vectors[r, 1], sources.vectors[r, 2]
    reach = math.inf
    if kind == POINT:
        px, py, pz = dx, dy, dz
        dx, dy, dz = x - px, y - py, z - pz
        reach = math.sqrt(dx * dx + dy * dy + dz * dz)
        if reach == 0.0:
            return 0.0, 0.0, 0.0, 1.0
        dx, dy, dz = dx / reach, dy / reach, dz / reach
        cosine = dx * sources.axes[r, 0] + dy * sources.axes[r, 1] + dz * sources.axes[r, 2]
        if volume.dimension == 2:
            across = dx * sources.axes[r, 2] - dz * sources.axes[r, 0]
            if abs(math.atan2(across, cosine)) > sources.apertures[r] * _TAU * _SLACK:
                return 0.0, dx, dy, dz
            rays = 1.0 / (sources.solid_angles[r] * reach)
        else:
            if 1.0 - cosine > sources.apertures[r] * _SLACK:
                return 0.0, dx, dy, dz
            rays = 1.0 / (sources.solid_angles[r] * reach * reach)
    elif kind == PLANE:
        rays = 1.0 / projected_area(volume, dx, dy, dz)
    else:
        t = (z - volume.lower[2]) / dz
        rays = _face_density(
            sources.footprints[r], sources.extents[r], volume.dimension, x - t * dx, y - t * dy
        ) / abs(dz)  # fmt: skip
    if rays == 0.0:
        return 0.0, dx, dy, dz
    back = min(reach, exit_distance(volume, x, y, z, -dx, -dy, -dz))
    before = optical_depth(volume, x, y, z, -dx, -dy, -dz, 0.0, back)
    after = optical_depth(volume, x, y, z, dx, dy, dz, 0.0, exit_distance(volume, x, y, z, dx, dy, dz))
    if before + after == 0.0:
        return 0.0, dx, dy, dz
    sigma = volume.extinction[voxel(volume, x, y, z)]
    return rays * sigma * math.exp(-before) / -math.expm1(-(before + after)), dx, dy, dz


@inlined
def start_densities(volume, sources, x, y, z, wx, wy, wz):
    """Densities of the mixture: (of the first vertex alone, of the first vertex and direction)."""
    vertex = joint = 0.0
    for r in range(sources.kinds.shape[0]):
        p, dx, dy, dz = source_density(volume, sources, r, x, y, z)
        if p > 0.0:
            p *= sources.shares[r]
            ex, ey, ez = wx - dx, wy - dy, wz - dz
            # 1 - cos from the difference of the unit vectors, precise for sharp lobes.
            one_minus_cos = 0.5 * (ex * ex + ey * ey + ez * ez)
            vertex += p
            g = 0.0 if sources.kinds[r] == UNIFORM else sources.lobes[r]
            joint += p * lobe_density(volume.dimension, g, one_minus_cos)
    return vertex, joint
