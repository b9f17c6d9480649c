"""Sensors in the near field: inside the medium, on its boundary, on a vertex, outside."""

import numpy as np
from references.correlation_transfer import collision_density

import specklegen as sg
from specklegen.paths.endpoint_factors import endpoint_factors, single_amplitudes
from specklegen.paths.tracer import volume_tracer

from .row import Row, holds, measured, refused, within
from .scenes import AXIS, REQUIRED, beams, cube, scene, slab


def fluence(optical_depth: float) -> tuple[np.ndarray, np.ndarray]:
    """Depths float64[N] in mean free paths, and the fluence of scattered light there, by Schwarzschild and Milne."""
    half = np.concatenate([[0.0], optical_depth / 2 * np.geomspace(1e-4, 1.0, 12)])
    edges = np.concatenate([half, (optical_depth - half)[-2::-1]])
    x, _ = np.polynomial.legendre.leggauss(8)
    nodes = (edges[:-1, None] + np.diff(edges)[:, None] / 2 * (1 + x)).ravel()
    return nodes, np.real(collision_density(0.0, edges, np.exp(-nodes), 1.0)) - np.exp(-nodes)


def near_slab() -> Row:
    """E|u - m|² at points is the fluence of scattered light; outside it is that of the face."""
    depth = 2.0
    nodes, right = fluence(depth)
    inner = [len(nodes) // 4, len(nodes) // 2]
    places = np.array([-0.7, 0.0, *nodes[inner], depth, depth + 3.0]) * 50.0
    right = right[[0, 0, *inner, -1, -1]]
    points = np.stack([0 * places, 0 * places, places], axis=1)
    made = scene(slab(depth), sg.PlaneWaves(directions=[AXIS]), sg.NearField(points=points))
    found = sg.covariance(made, paths=64 * 1000, seed=1, reverse=False)
    # The first and last nodes lie 2e-6 mean free paths below the faces, where the fluence bends like z log z.
    return measured("point sensors before, on, inside and behind a slab, OD 2", "Milne's equation, 8-point panels",
                    right, found.intensity[0], np.einsum("tvtv->tv", found.standard_error)[0], slack=1e-4)  # fmt: skip


def near_mean() -> Row:
    """The mean is attenuated along the part of the ray inside the medium."""
    depths = np.array([-30.0, 0.0, 25.0, 100.0, 170.0])
    points = np.stack([0 * depths, 0 * depths, depths], axis=1)
    made = scene(slab(2.0), sg.PlaneWaves(directions=[AXIS]), sg.NearField(points=points))
    return within("the same: mean field", "e^{−OD inside/2}", np.exp(-np.clip(depths, 0, 100) / 100),
                  np.abs(sg.mean_field(made)[0]), 1e-12)  # fmt: skip


def near_vertex() -> Row:
    """A sensor on a vertex, and a hair away from one."""
    made = scene(cube(50.0, 25.0), sg.PlaneWaves(directions=[AXIS]), sg.NearField(points=[[0.0, 0.0, 0.0]]))
    x = volume_tracer(made, False).trace(1, 64).entry[7]
    hair = np.nextafter(x, np.inf)
    tracer = volume_tracer(made.replace(sensor=sg.NearField(points=[x, hair])), False)
    bank = volume_tracer(made, False).trace(1, 64)
    ends = endpoint_factors(tracer.layout, bank, tracer.layout.views, "exit")
    single = single_amplitudes(tracer.layout, bank.single)
    found = sg.covariance(made.replace(sensor=sg.NearField(points=[x, hair])), paths=6400, seed=1)
    return holds(
        "sensor on a vertex, and 1e-15 away", "measure zero: left out, without bias", "finite",
        {"on it the contribution is 0": bool((ends[0] == 0).any()),
         "amplitudes finite": bool(np.isfinite(ends).all() and np.isfinite(single).all()),
         "covariance finite": bool(np.isfinite(found.value).all() and np.isfinite(found.standard_error).all())},
    )  # fmt: skip


def near_boundary() -> Row:
    """Sensors on faces, edges and corners of a box: the limit from just outside."""
    places = np.array([[0, 0, 50.0], [25.0, 0, 50.0], [25.0, 25.0, 50.0], [25.0, -25.0, 0.0]])
    made = scene(cube(50.0, 25.0), beams([0.0], 40.0), sg.NearField(points=np.concatenate([places, 1.00001 * places])))
    # The same sources serve both sets, so they share their paths and differ by rounding's cousin, the shift itself.
    power = sg.covariance(made, paths=64 * 500, seed=1, reverse=False)
    error = np.einsum("tvtv->tv", power.standard_error)[0]
    return measured("sensors on a face, an edge and corners of a box", "just outside", power.intensity[0, 4:],
                    power.intensity[0, :4], np.hypot(error[:4], error[4:]))  # fmt: skip


def shared_point() -> Row:
    """A sensor on a source inside the medium would be infinitely bright."""
    point = [[0.0, 0.0, 10.0]]
    return refused(
        "a sensor on a source inside the medium", "single scattering diverges there",
        [(lambda: scene(cube(50.0, 25.0), sg.PointSources(points=point), sg.NearField(points=point)),
          ["Scene.sensor", "from every source"])],
    )  # fmt: skip


def point_sources() -> Row:
    """Sources inside and outside a cube, sensors too: reciprocal."""
    a, b = [[0.0, 0.0, 10.0]], [[30.0, 5.0, 60.0]]
    one, two = (
        sg.covariance(scene(cube(50.0, 25.0), sg.PointSources(points=p), sg.NearField(points=q)), paths=64 * 500,
                      seed=s) for s, p, q in ((1, a, b), (2, b, a))
    )  # fmt: skip
    return measured("a source inside, a sensor outside, and exchanged", "reciprocity; " + REQUIRED,
                    two.value, one.value, np.hypot(one.standard_error, two.standard_error))  # fmt: skip


ROWS = (near_slab, near_mean, near_vertex, near_boundary, shared_point, point_sources)
