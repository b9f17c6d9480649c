"""Steps of the walk through a slab: first vertices, first directions, and what a vertex is worth at the views."""

import math
from typing import NamedTuple

import numpy as np

from specklegen.kernels import inlined
from specklegen.kernels.arithmetic import minus_log1m
from specklegen.kernels.footprints import GAUSSIAN, footprint_density, profile, sample_footprint
from specklegen.kernels.lanes import (
    AMOUNT,
    AZIMUTH,
    COIN,
    DENSITY,
    DOPPLER,
    FLIGHT,
    FLOWN,
    KEEP,
    ORDER,
    OX,
    OY,
    OZ,
    PATH,
    POLAR,
    POWER,
    SHAPE,
    TURNED,
    WX,
    WY,
    WZ,
    X1,
    Y1,
    Z1,
    X,
    Y,
    Z,
    draw,
    fly,
    scatter,
    scatter_by_table,
)
from specklegen.kernels.lobes import judged_phase_function, phase_function
from specklegen.kernels.phase_functions import henyey_greenstein, sample_henyey_greenstein
from specklegen.kernels.reflections import unfolded
from specklegen.kernels.stretching import fly_stretched, steer

_ONE = np.uint64(1)


class Address(NamedTuple):
    """Address of random numbers: two words of the key, the number of the realization."""

    key0: int | np.uint64
    key1: int | np.uint64
    sample: int | np.uint64


class Layer(NamedTuple):
    """A homogeneous layer: thickness (length), sigma_t (1/length), albedo."""

    thickness: float
    sigma_t: float
    albedo: float


class FlowingLayer(NamedTuple):
    """A :class:`Layer`, and the flow float64[1, 12] of its particles (or float64[0, 12]), as of a volume."""

    thickness: float
    sigma_t: float
    albedo: float
    flow: np.ndarray


class Light(NamedTuple):
    """Light that paths start with: unit direction, kind of beam, size of the sampled footprint and of the profile."""

    x: float
    y: float
    z: float
    footprint: int
    extent: float
    radius: float


class Leg(NamedTuple):
    """A leg of a connection that ends at a vertex: the vertex, and the unit direction beside it."""

    x: float
    y: float
    z: float
    wx: float
    wy: float
    wz: float


@inlined
def contribution(power, g, rows, places, leg, probes, first, last):
    """Largest contribution at the views ``first`` ... ``last - 1`` of a vertex that light of ``power`` reaches."""
    best = 0.0
    for n in range(first, last):
        t = probes[n, 3] + probes[n, 4] * leg.z
        if t < 700.0:
            cos = leg.wx * probes[n, 0] + leg.wy * probes[n, 1] + leg.wz * probes[n, 2]
            best = max(best, power * judged_phase_function(g, rows, places, cos) * math.exp(-t))
    return best


@inlined
def start(where, first, count, layer, rate, light, state, address):
    """Put the first vertices of paths ``first`` ... into the lanes, light arriving along the reference direction."""
    thickness, sigma_t, albedo = layer.thickness, layer.sigma_t, layer.albedo
    spared = 1.0 - rate * light.z
    chance = -math.expm1(-sigma_t * spared * thickness / light.z)  # to collide at all
    for i in range(count):
        address[PATH + i], address[ORDER + i] = np.uint64(first + i), np.uint64(0)
    draw(where.key0, where.key1, where.sample, np.uint64(0), address, state, count)
    for i in range(count):
        # Two words a coordinate: 32 bits alone would put wide beams on a lattice.
        u = state[KEEP + i] + (state[POLAR + i] - 0.5) * 2.0**-32
        v = state[AZIMUTH + i] + (state[FLIGHT + i] - 0.5) * 2.0**-32
        fx, fy, area = sample_footprint(light.footprint, light.extent, u, v)
        # Points that only other tilts light are judged as if this one did, else they would never be kept.
        beam = profile(light.footprint, light.radius, fx, fy) if light.footprint == GAUSSIAN else 1.0
        state[X1 + i], state[Y1 + i] = fx, fy
        state[AMOUNT + i], state[POWER + i] = albedo * area * light.z * chance / spared, beam * beam / light.z
    draw(where.key0, where.key1, where.sample, _ONE, address, state, count)
    for i in range(count):
        collided = state[KEEP + i] * chance
        depth = minus_log1m(collided) / (sigma_t * spared)
        state[X1 + i] += depth * light.x
        state[Y1 + i] += depth * light.y
        state[Z1 + i] = min(depth * light.z, thickness)
        # sigma_s / p1, where p1 = (1/area) sigma_t e^(-sigma_t depth) / chance / iz per volume; sigma_t is spared both.
        state[AMOUNT + i] /= 1.0 - collided
        state[POWER + i] *= 1.0 - collided
        state[X + i], state[Y + i], state[Z + i] = state[X1 + i], state[Y1 + i], state[Z1 + i]
        state[WX + i], state[WY + i], state[WZ + i] = light.x, light.y, light.z
        state[KEEP + i] = state[FLIGHT + i]
        state[FLOWN + i] = state[TURNED + i] = state[DOPPLER + i] = state[COIN + i] = 0.0
        address[ORDER + i] = _ONE
    if rate > 0.0:
        for i in range(count):
            state[POWER + i] *= math.exp(-rate * sigma_t * state[Z + i])


@inlined
def leave(where, g, rows, places, aim_rows, guide, mean_free_path, pull, importance, state, address, count):
    """Send the paths of :func:`start` off, their first directions drawn from the phase function that they aim with."""
    if pull.rate > 0.0:
        for i in range(count):
            state[OX + i], state[OY + i], state[OZ + i] = state[WX + i], state[WY + i], state[WZ + i]
        steer(where, g, aim_rows, guide, pull, importance, state, address, count)
        for i in range(count):
            cos = state[OX + i] * state[WX + i] + state[OY + i] * state[WY + i] + state[OZ + i] * state[WZ + i]
            state[POLAR + i] = state[SHAPE + i] * (0.5 / math.pi) / pull.aimed
            state[POWER + i] *= judged_phase_function(g, rows, places, cos)
    elif aim_rows.shape[0] == 0:
        scatter(g, state, count)
        for i in range(count):
            state[POLAR + i] = henyey_greenstein(g, 1.0 - sample_henyey_greenstein(g, state[POLAR + i]))
            state[POWER + i] *= state[POLAR + i]
    else:
        for i in range(count):
            state[OX + i], state[OY + i], state[OZ + i] = state[WX + i], state[WY + i], state[WZ + i]
        scatter_by_table(aim_rows, guide, state, count)
        for i in range(count):
            cos = state[OX + i] * state[WX + i] + state[OY + i] * state[WY + i] + state[OZ + i] * state[WZ + i]
            state[POLAR + i] = state[SHAPE + i] * (0.5 / math.pi)
            state[POWER + i] *= judged_phase_function(g, rows, places, cos)
    for i in range(count):
        density = state[POLAR + i]
        state[OX + i], state[OY + i], state[OZ + i] = state[WX + i], state[WY + i], state[WZ + i]
        state[DENSITY + i] = density / state[AMOUNT + i]  # p1 p_omega / sigma_s
        state[AMOUNT + i] /= density
    draw(where.key0, where.key1, where.sample, _ONE, address, state, count)
    if pull.rate > 0.0:
        fly_stretched(mean_free_path, pull.rate, state, count)
    else:
        fly(mean_free_path, state, count)


@inlined
def survivor_weight(weight, w, threshold, u):
    """``weight`` over the probability min(1, w / threshold) that a connection of contribution w survives; else 0."""
    if w <= 0.0 or (w < threshold and u * threshold >= w):
        return 0.0
    return weight if w >= threshold else weight * threshold / w


@inlined
def weigh_both_ways(state, i, m, layer, light, mirror, g, rows, places, aim_rows, aim_places, probes):
    """W of a connection of m reflections drawn either way, and its largest contribution of both directions.

    Both ends lie behind the lower face: behind faces that reflect, reversed paths interfere in reflection alone.
    """
    x, y, z, wx, wy, wz = state[X + i], state[Y + i], state[Z + i], state[WX + i], state[WY + i], state[WZ + i]
    thickness, views = layer.thickness, mirror.views
    depth = unfolded(z, thickness, m, False) / light.z
    fx, fy = x - depth * light.x, y - depth * light.y
    back = -(wx * light.x + wy * light.y + (-wz if m % 2 else wz) * light.z)
    passed = math.exp(-layer.sigma_t * depth) / light.z
    if m > 0:
        passed *= mirror.again**m
    # p1 p_omega / sigma_s of the path walked backwards: the balance heuristic adds both densities.
    density = footprint_density(light.footprint, light.extent, fx, fy) * passed / (layer.albedo * mirror.chance)
    weight = 1.0 / (state[DENSITY + i] + density * phase_function(g, aim_rows, aim_places, back))
    beam = profile(light.footprint, light.radius, fx, fy)
    power = weight * beam * beam * passed * mirror.crossing * judged_phase_function(g, rows, places, back)
    z1, oz = state[Z1 + i], state[OZ + i]
    first = max(0, min(int(z1 / thickness), mirror.images))
    if first > 0:
        z1 -= first * thickness
        if first % 2:
            z1, oz = thickness - z1, -oz
    there, here = Leg(x, y, z, wx, wy, wz), Leg(0.0, 0.0, z1, -state[OX + i], -state[OY + i], -oz)
    forward = contribution(weight * state[POWER + i], g, rows, places, there, probes, m * views, (m + 1) * views)
    reversed_ = contribution(power, g, rows, places, here, probes, first * views, (first + 1) * views)
    return weight, max(forward, reversed_)
