"""Directions, phases and tilts at their extremes; backscattering and the forward direction."""

from collections.abc import Callable
from dataclasses import replace
from decimal import Decimal, localcontext

import numpy as np
from references.correlation_transfer import field_correlation
from references.slab_covariance import slab_covariance

import specklegen as sg
from specklegen.kernels.volume import exit_distance, optical_depth
from specklegen.paths.endpoint_factors import contributions, endpoint_factors
from specklegen.paths.layout import scene_layout
from specklegen.paths.proposal import beam_proposal
from specklegen.paths.slab_tracer import trace
from specklegen.paths.tracer import volume_tracer
from specklegen.paths.volumes import volume_of
from specklegen.theory.single_scattering import box_covariance

from .row import Row, measured, refused, within
from .scenes import AXIS, REQUIRED, beams, cube, exact_single, scene, slab, unit, views

PI = Decimal("3.14159265358979323846264338327950288419716939937510")


def axis_parallel() -> Row:
    """Single scattering of a cube with every light and view along an axis or in a face's plane, against Eq. 41."""
    directions = unit([0, 0, 1], [1, 0, 0], [0, -1, 0], [0, 0.6, 0.8], [-0.0, -0.0, -1])
    made = scene(cube(4.0, 4.0), sg.PlaneWaves(directions=directions), sg.FarField(directions=directions), 3.0)
    found = sg.covariance(made, paths=64 * 400, seed=1, reverse=False)
    i = directions
    right = box_covariance(made.medium.lower, made.medium.upper, extinction=0.25, wavelength=3.0,
                           amplitude=lambda cos: np.full(np.shape(cos), np.sqrt(1 / (4 * np.pi))),
                           lights=(i[:, None, None, None], i[None, None, :, None]),
                           views=(i[None, :, None, None], i[None, None, None]))  # fmt: skip
    return measured("axis-parallel lights and views", "Eq. 41", right, found.single, found.standard_error)


def distances() -> Row:
    """Distances out of a box along its axes, with zeros of both signs, and through the corners of its voxels."""
    box, corner = volume_of(cube(2.0, 1.0), 3), np.sqrt(1 / 3)
    grid = volume_of(
        sg.VoxelGrid(lower=[0, 0, 0], upper=[2, 2, 2], extinction=[[[1, 2], [3, 4]], [[5, 6], [7, 8]]],
                     scatterers=(sg.Isotropic(),)), 3)  # fmt: skip
    through = optical_depth(grid.bounds, grid.cells, grid.extinction, 0.0, 0.0, 0.0, corner, corner, corner, 0.0,
                            2 * np.sqrt(3))  # fmt: skip
    along = [exit_distance(box.bounds, 0.0, 0.0, 0.5, *d) for d in ((0, 0, 1.0), (-0.0, 0.0, -1.0), (1.0, -0.0, -0.0))]
    # By the corners light passes only the two voxels on the diagonal, sqrt(3) of each.
    return within("u_z = ±0, rays through voxel corners", "by hand", [1.5, 0.5, 1.0, 9 * np.sqrt(3)], [*along, through],
                  1e-15)  # fmt: skip


def grazing() -> Row:
    """An infinite slab sends nothing along itself."""
    sensor = sg.FarField(directions=[[1.0, 0.0, 0.0], [0.0, -1.0, -0.0], [np.sqrt(1 - 1e-24), 0.0, 1e-12]])
    made = scene(slab(2.0), sensor=sensor)
    found = sg.covariance(made, paths=6400, seed=2).value
    field = sg.render(made, paths=1000).field
    return within("grazing views of a slab", REQUIRED, 0.0, np.abs([*found.ravel(), *field.ravel()]), 1e-30,
                  relative=False)  # fmt: skip


def steep_lights() -> Row:
    """Lights close to grazing: a beam is as bright, per area of the face, at any tilt."""
    made = scene(slab(1.0), beams([1.5, -1.57, 1.5707]), views([0, 0, 1]))
    found = sg.covariance(made, paths=64 * 1000, seed=3, reverse=False)
    i = made.lights
    right = slab_covariance(100.0, extinction=0.01, wavelength=1.0, width=30.0, amplitude=made.slab.scatterer.amplitude,
                            lights=(i, i), views=(AXIS, AXIS))  # fmt: skip
    return measured("beams tilted by up to 89.995°: single scattering", "Eq. 41", right.real,
                    np.einsum("tvtv->tv", found.single)[:, 0].real,
                    np.einsum("tvtv->tv", found.standard_error)[:, 0])  # fmt: skip


def _turned(dot: Callable[[], Decimal], wavelength: float) -> float:
    """Phase 2 pi d / wavelength in (-pi, pi], from exact decimals of the floats."""
    with localcontext() as context:
        context.prec = 60
        turns = dot() / Decimal(wavelength)
        return float(2 * PI * (turns - turns.to_integral_value()))


def _dot(a: np.ndarray, b: np.ndarray) -> Decimal:
    return sum((Decimal(float(x)) * Decimal(float(y)) for x, y in zip(a, b, strict=True)), Decimal(0))


def _gap(found: np.ndarray, right: list) -> float:
    """Largest error of the phases of what is not dark."""
    lit = found != 0
    return float(np.abs(np.angle(found * np.exp(-1j * np.array(right))))[lit].max())


_LONG = 1e8 / (2 * np.pi)  # wavelengths: k L = 1e8


def phases_far() -> Row:
    """Both engines' phases of plane waves on vertices as far as 1e8/k, against exact arithmetic."""
    made = scene(slab(1.0, thickness=_LONG), beams([0.0, 0.3], width=_LONG / 2))
    tracer = volume_tracer(made, False)
    bank, layout = tracer.trace(1, 16).single, tracer.layout
    absolute = replace(layout.lights, reference=np.zeros(3))
    general = endpoint_factors(layout, bank, absolute, "entry")
    right = [[_turned(lambda i=i, x=x: _dot(i, x), 1.0) for x in bank.entry] for i in made.lights]
    fast = trace(made.slab, beam_proposal(made.slab, made.beams, AXIS[None]), 1, 16).single
    ends = endpoint_factors(layout, fast, layout.lights, "entry")
    tilts = [_turned(lambda x=x: _dot(made.lights[1] - AXIS, x), 1.0) for x in fast.entry]
    error = max(_gap(general, right), _gap(ends[1] / np.where(ends[0] == 0, 1, ends[0]), tilts))
    return within("k L = 1e8: phases of plane waves, rad", "60-digit arithmetic", 0.0, error, 2e-7, relative=False)


def phases_near() -> Row:
    """The same for distances to points."""
    made = scene(slab(1.0, thickness=_LONG), beams([0.0], width=1e3), sg.NearField(points=[[1e3, 0, 1.5 * _LONG]]))
    tracer = volume_tracer(made, False)
    bank = tracer.trace(1, 16).single
    found = endpoint_factors(tracer.layout, bank, tracer.layout.views, "exit")[0]

    def distance(x: np.ndarray) -> Decimal:
        gap = [Decimal(float(a)) - Decimal(float(b)) for a, b in zip(made.views[0], x, strict=True)]
        return sum((g * g for g in gap), Decimal(0)).sqrt()

    right = [_turned(lambda x=x: distance(x), 1.0) for x in bank.exit]
    return within("k L = 1e8: phases of point sensors, rad", "60-digit arithmetic", 0.0, _gap(found, right), 2e-7,
                  relative=False)  # fmt: skip


def tiny_tilt() -> Row:
    """1 - C_I at 1e-9 rad, and its parabola from the transfer equation at q = 0.05."""
    depth, tilt, q = 10.0, 1e-9, 0.05
    curve = sg.memory_effect(slab(depth), wavelength=1.0, tilts=[0.0, tilt], paths=64 * 1000, seed=1)
    right = float(1 - field_correlation(q, depth) ** 2) / q**2
    scale = curve.q[1] ** 2
    # The curve bends away from its parabola by q^2 at most.
    return measured("tilt 1e-9 rad: (1 - C_I)/(k θ L)²", "correlation transfer equation", right,
                    curve.decorrelation[1] / scale, curve.standard_error[1] / scale, slack=q**2 * right)  # fmt: skip


def backscattering() -> Row:
    """At v = -i every multiple path interferes with its reverse; single scattering has none."""
    made = scene(cube(20.0, 10.0), sg.PlaneWaves(directions=[AXIS]), views([0, 0, -1]))
    off, on = (sg.covariance(made, paths=64 * 500, seed=s, reverse=r) for s, r in ((1, False), (2, True)))
    entry = (0, 0, 0, 0)
    error = np.hypot(2 * off.standard_error[entry], on.standard_error[entry])
    return measured("v = −i: S + 2M", "S and M without reversed paths", (off.single + 2 * off.multiple)[entry].real,
                    on.value[entry].real, error)  # fmt: skip


def backscattering_single() -> Row:
    """B = 1 is its own reverse and is never doubled."""
    made = scene(slab(1.0), sensor=views([0, 0, -1]))
    found = sg.covariance(made, paths=64 * 500, seed=3, reverse=True)
    return measured("v = −i: single scattering with reversed paths", "Eq. 41", exact_single(made), found.single,
                    found.standard_error)  # fmt: skip


def narrow_beam() -> Row:
    """A beam narrower than the transport length: only paths that end inside it have a reverse."""
    medium, width, batches = slab(2.0), 20.0, 64
    made = scene(medium, beams([0.0], width), views([0, 0, -1]))
    bank = trace(medium, beam_proposal(medium, made.beams, -AXIS[None]), 4, batches * 1000)
    w = contributions(scene_layout(made), bank)
    back = (bank.orders > 1) & (np.abs(bank.exit[:, :2]) <= width / 2).all(axis=1)
    sums = np.bincount(bank.paths // 1000, w * (1.0 + back), batches) / bank.count
    right, error = sums.sum(), np.sqrt(batches) * sums.std(ddof=1)
    found = sg.covariance(made, paths=64 * 1000, seed=5, reverse=True)
    return measured("v = −i, beam of 0.4 ℓ*: S + M + M_in", "paths of the other engine, ends inside counted twice",
                    right, found.value.item().real, np.hypot(error, found.standard_error.item()))  # fmt: skip


def forward_mean() -> Row:
    """V = i: the spike is in the mean, (k/2π) A (1 − e^{−OD/2}) for a box, and C knows nothing of it."""
    side, depth = 20.0, 2.0
    made = scene(cube(side, side / depth), sg.PlaneWaves(directions=[AXIS]), views([0, 0, 1]))
    return within("v = i: mean field of a box", "(k/2π) A (1 − e^{−OD/2})", side**2 * -np.expm1(-depth / 2),
                  abs(sg.mean_field(made).item()), 1e-9)  # fmt: skip


def forward_covariance() -> Row:
    """Single scattering at v = i is the incoherent sum, without the spike."""
    side, depth = 20.0, 2.0
    made = scene(cube(side, side / depth), sg.PlaneWaves(directions=[AXIS]), views([0, 0, 1]))
    found = sg.covariance(made, paths=64 * 200, seed=6)
    right = side**2 * depth * np.exp(-depth) / (4 * np.pi)
    return measured("v = i: covariance, single scattering", "ρ σ_s A L e^{−OD}", right, found.single.item(),
                    found.standard_error.item())  # fmt: skip


def infinite_power() -> Row:
    """A slab and a wave without limits."""
    return refused(
        "infinite slab, unlimited plane wave, far field", REQUIRED,
        [(lambda: scene(slab(1.0), sg.PlaneWaves(directions=[AXIS])), ["Scene.illumination", "CollimatedBeams"])],
    )  # fmt: skip


ROWS = (axis_parallel, distances, grazing, steep_lights, phases_far, phases_near, tiny_tilt, backscattering,
        backscattering_single, narrow_beam, forward_mean, forward_covariance, infinite_power)  # fmt: skip
