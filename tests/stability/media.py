"""Stiff and extreme media: thin, forward, absorbing, wide, empty, dense."""

import warnings
from collections.abc import Callable
from dataclasses import replace
from itertools import product

import numpy as np
from references.slab import double_to_single
from scipy.stats import chi2

import specklegen as sg
from specklegen.core.statistics import BATCHES, batch_sums
from specklegen.kernels import kernel
from specklegen.kernels.phase_table import sample
from specklegen.oracles.adding_doubling import adding_doubling
from specklegen.paths.endpoint_factors import contributions
from specklegen.paths.phase_tables import phase_table
from specklegen.paths.proposal import plane_proposal
from specklegen.paths.slab_tracer import trace
from specklegen.paths.tracer import plane_tracer, volume_tracer

from .row import FALSE_ALARM, Row, holds, measured, refused, within
from .scenes import AXIS, REQUIRED, beams, cube, exact_single, scene, slab, unit, views

_ANISOTROPIES = (-0.99, 0.0, 0.999, 0.99999)
_DRAWS = 200_000


def thin_covariance() -> Row:
    """All entries of C at optical depth 1e-6, whose multiple scattering is some 1e-5 of it."""
    made = scene(slab(1e-6), beams([0.0, 0.02]))
    right, ours = exact_single(made), sg.statistics.covariance(made, paths=64 * 200, seed=1, reverse=False)
    return measured("OD 1e-6: covariance", "Eq. 41, closed form", right, ours.value, ours.standard_error,
                    slack=2e-5 * np.abs(right).max())  # fmt: skip


def thin_error() -> Row:
    """The relative standard error of the same run does not grow as the medium thins."""
    errors = [
        sg.statistics.covariance(scene(slab(depth)), paths=64 * 200, seed=1, reverse=False).rel_error
        for depth in (1e-3, 1e-6)
    ]
    return within("OD 1e-6: relative standard error against that of OD 1e-3", REQUIRED, *errors, allowed=0.1)


def thin_orders() -> Row:
    """Scattered power of order two over that of order one: all paths weigh the same, so counts are Poisson."""
    depth, paths, chunk = 1e-5, 4_000_000, 500_000
    medium, double = slab(depth), 0
    for first in range(0, paths, chunk):
        double += int((trace(medium, plane_proposal(medium, AXIS, AXIS), 3, chunk, first=first).orders == 2).sum())
    right = double_to_single(depth)
    return measured("OD 1e-5: B2/B1", "OD/2 (ln(1/OD) + 0.92)", right, double / paths, np.sqrt(right / paths),
                    slack=1e-3 * right, batches=10**6)  # fmt: skip


def anisotropy() -> Row:
    """Mean cosines of what the engine draws; the standard deviation is sqrt((1 - g^2)/3)."""
    g = np.array(_ANISOTROPIES)
    drawn = np.array([1 - _drawn(sg.media.HenyeyGreenstein(g=float(each))).mean() for each in g])
    return measured("g = -0.99, 0, 0.999, 0.99999: mean cosine", "definition", g, drawn,
                    np.sqrt((1 - g**2) / 3 / _DRAWS), batches=_DRAWS)  # fmt: skip


def anisotropy_single() -> Row:
    """Single scattering by the sharpest lobes, forward and back, against Eq. 41."""
    rights, ours, errors = [], [], []
    for g in _ANISOTROPIES:
        made = scene(slab(1.0, g), beams([0.0, 0.01]))
        found = sg.statistics.covariance(made, paths=64 * 100, seed=2, reverse=False)
        diagonal = np.sqrt(np.einsum("tvtv->tv", exact_single(made)).real)
        scale = diagonal[:, :, None, None] * diagonal
        rights.append(exact_single(made) / scale)
        ours.append(found.single / scale)
        errors.append(found.standard_error / scale)
    return measured("the same: single scattering, OD 1", "Eq. 41", rights, ours, errors)


def anisotropy_refused() -> Row:
    """The limits themselves have no density."""
    return refused("g = -1, 1", REQUIRED,
                   [(lambda g=g: sg.media.HenyeyGreenstein(g=g), ["HenyeyGreenstein.g"])
                    for g in (1.0, -1.0)])  # fmt: skip


def albedo_zero() -> Row:
    """A medium that only absorbs."""
    made = scene(slab(2.0, albedo=0.0))
    box = scene(cube(50.0, 20.0, albedo=0.0), sg.light.PlaneWaves(directions=[AXIS]))
    stack = sg.render(made, paths=1000, mean=True)
    return holds(
        "albedo 0", REQUIRED, "the field is the mean, nothing is traced",
        {"render = mean field": np.array_equal(stack.field, sg.statistics.mean_field(made).astype(np.complex64)),
         "C = 0 in a slab and in a box": not any(sg.statistics.covariance(s, paths=100).value.any()
                                                 for s in (made, box)),
         "no scattering event": volume_tracer(box, False).trace(0, 1000).events == 0},
    )  # fmt: skip


def albedo_tiny() -> Row:
    """Single scattering is proportional to the albedo, and nothing else is left at 1e-12."""
    right = exact_single(scene(slab(1.0, albedo=1e-12)))
    found = sg.statistics.covariance(scene(slab(1.0, albedo=1e-12)), paths=64 * 200, seed=3, reverse=False)
    return measured("albedo 1e-12: C", "Eq. 41", right, found.value, found.standard_error)


def _light_behind(depth: float, albedo: float, g: float) -> tuple[float, float, float]:
    """Light along the axis behind a slab per area and steradian: exact, ours, and its standard error. Ten times the
    paths where none is drawn across: of 6400 some would err by a sixth, and could not fail."""
    medium = slab(depth, g, albedo)
    tracer = plane_tracer(medium, 1.0, AXIS[None], AXIS[None], False)
    exact = adding_doubling(depth, albedo=albedo, g=g).transmitted
    paths = 64 * (100 if tracer.across else 1000)
    bank = tracer.trace(5, paths)
    found = batch_sums(contributions(tracer.layout, bank), bank.paths, paths).real * BATCHES / paths
    return exact, float(found.mean()), float(found.std(ddof=1) / np.sqrt(BATCHES))


def deep(case: str, depths: tuple[float, ...], anisotropies: tuple[float, ...]) -> Row:
    """Depth times absorption times g, each within its error of the exact light, which spans 1 to 1e-43."""
    found = [_light_behind(*each) for each in product(depths, (0.5, 0.9, 0.99), anisotropies)]
    exact, ours, error = np.array(found).T
    row = measured(case, "adding and doubling", np.ones(len(exact)), ours / exact, error / exact)
    largest = float((error / exact).max())
    # An error that grew with the depth would let any light pass; every one of these can fail, some seven errors from 0.
    return replace(row, passed=row.passed and largest < 0.14, ours=f"{row.ours}; errors up to {largest:.2g}")


def deep_isotropic() -> Row:
    """Optical depths to 100 behind absorbing slabs."""
    return deep("OD 10, 30, 100, albedo 0.5, 0.9, 0.99: light behind over the exact", (10.0, 30.0, 100.0), (0.0,))


def deep_anisotropic() -> Row:
    """The same for forward and backward lobes."""
    return deep("OD 10, 100 × albedo 0.5, 0.9, 0.99 × g -0.5, 0.5, 0.9: the same", (10.0, 100.0), (-0.5, 0.5, 0.9))


def deep_refused() -> Row:
    """Paths that are not drawn across: reversed ones, and those of any geometry."""
    medium = slab(40.0, albedo=0.5)
    words = ["enough that light crosses", "reverse=False"]
    return refused(
        "OD 40, albedo 0.5, paths that are not drawn across", REQUIRED,
        [
            (lambda: sg.plan(scene(medium, sensor=views(AXIS)), paths=10**6, reverse=True), words),
            (lambda: sg.statistics.covariance(scene(medium, sensor=views(AXIS)), paths=1000), words),
            (lambda: sg.memory_effect(medium, wavelength=1.0, tilts=[0.0], reverse=True), words),
            (lambda: sg.plan(scene(cube(100.0, 2.5, albedo=0.5), sg.light.PlaneWaves(directions=[AXIS]), views(AXIS)),
                             paths=10**6), words),
        ],
    )  # fmt: skip


def albedo_one() -> Row:
    """Without absorption paths still leave, far below the bound on their length."""
    medium = slab(20.0)
    proposal = plane_proposal(medium, AXIS, AXIS)
    bank = trace(medium, proposal, 4, 2000)
    return holds(
        "albedo 1, OD 20: paths are bounded", REQUIRED, "none reaches max_order = max(1000, 10 OD²)",
        {f"longest path {bank.orders.max()} of {proposal.max_order} scatterings": bank.unfinished == 0,
         f"{bank.events / bank.count / 20:.2f} OD scatterings a path": 2 <= bank.events / bank.count / 20 <= 2.6},
    )  # fmt: skip


def dense() -> Row:
    """A mean free path below the wavelength breaks the model's assumption, not the program."""
    made = scene(slab(20.0, thickness=10.0))
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        found = sg.statistics.covariance(made, paths=64, seed=5)
        curve = sg.memory_effect(made.slab, wavelength=1.0, tilts=[0.0, 0.01], paths=64)
    return holds(
        "mean free path below the wavelength", REQUIRED, "a warning, and finite results",
        {"plan().explain() warns": "independent scattering: used: assumed, but doubtful" in sg.plan(made).explain(),
         "covariance and memory_effect warn": sum("below the wavelength" in str(w.message) for w in said) == 2,
         "results are finite": bool(np.isfinite(found.value).all() and np.isfinite(curve.intensity).all())},
    )  # fmt: skip


def _refused(call) -> bool:
    try:
        call()
    except sg.RuleError:
        return True
    return False


def zero_thickness() -> Row:
    """A slab of no depth."""
    made = scene(slab(1.0).replace(thickness=0.0))
    found = sg.statistics.covariance(made, paths=640)
    return holds(
        "zero thickness", REQUIRED, "C = 0; no 0/0",
        {
            "C = 0 with an error of 0": not found.value.any() and not found.standard_error.any(),
            "the field is 0": not sg.render(made, paths=100).field.any(),
            "the correlation of no light is refused": _refused(
                lambda: sg.memory_effect(made.slab, wavelength=1.0, tilts=[0.0, 1e-3], paths=640)
            ),
            "the plan is finite": np.isfinite(sg.plan(made).seconds),
        },
    )  # fmt: skip


def _voxels(extinction, *, albedo=1.0) -> sg.media.VoxelGrid:
    return sg.media.VoxelGrid(lower=[-10, -10, 0], upper=[10, 10, 20], extinction=extinction, albedo=albedo,
                        scatterers=(sg.media.Isotropic(),))  # fmt: skip


def voxels_vacuum() -> Row:
    """Light crosses empty voxels: a grid filled in its lower half only is a box half as high."""
    extinction = np.zeros((4, 2, 2))
    extinction[:2] = 0.1
    light = sg.light.PlaneWaves(directions=unit([0, 0, 1], [0.1, 0, 1]))
    sensor = views([0, 0, 1], [0.2, 0, 1], [0, 0.1, -1])
    box = sg.media.Box(lower=[-10, -10, 0], upper=[10, 10, 10], mean_free_path=10.0, scatterer=sg.media.Isotropic())
    one, two = (
        sg.statistics.covariance(scene(medium, light, sensor), paths=64 * 500, seed=seed, reverse=False)
        for medium, seed in ((_voxels(extinction), 1), (box, 2))
    )
    error = np.hypot(one.standard_error, two.standard_error)
    return measured("voxels, the upper half empty", "the box without it", two.value, one.value, error)


def voxels_dense() -> Row:
    """One black voxel 1e6 times denser: what is behind it is dark, the rest is a box, and no walk is slowed."""
    extinction, albedo = np.full((2, 2, 2), 1e-3), np.ones((2, 2, 2))
    extinction[0, 0, 0], albedo[0, 0, 0] = 1e3, 0.0
    light, sensor = sg.light.PlaneWaves(directions=[AXIS]), views([0, 0, 1], [0.1, 0.3, 1])
    made = scene(_voxels(extinction, albedo=albedo), light, sensor, 1e-4)
    found = sg.statistics.covariance(made, paths=64 * 500, seed=1, reverse=False)
    # Along the axis the shadow is one of four columns; its voxel scatters nothing, nor does what lies above it.
    right = 3 * 10 * 10 * 20 * 1e-3 * np.exp(-0.02) / (4 * np.pi)
    return measured("one voxel 1e6 times denser, black", "Eq. 41 of the three open columns", right,
                    found.single[0, 0, 0, 0].real, found.standard_error[0, 0, 0, 0])  # fmt: skip


@kernel
def _draw(table, u, v, out):
    for n in range(u.size):
        out[n] = sample(table, 0, u[n], v[n])


def _drawn(scatterer, seed: int = 7) -> np.ndarray:
    """1 - cos of scattering angles in space."""
    generator, out = np.random.default_rng(seed), np.empty(_DRAWS)
    _draw(phase_table((scatterer,), 3), generator.random(_DRAWS), generator.random(_DRAWS), out)
    return out


def _table(amplitude: Callable = lambda s: s) -> sg.media.Tabulated:
    """A spike of a hundredth of a milliradian, and nothing between 1 and 2 radians."""
    theta = [0.0, 0.5, 0.50001, 0.50002, 1.0, 2.0, np.pi]
    return sg.media.Tabulated(theta=theta, amplitude=amplitude(np.array([1.0, 0.5, 300.0, 0.5, 0.0, 0.0, 1j])))


def tabulated_sampler() -> Row:
    """Chi-square of the draws over the table's bins, the dark ones apart."""
    table = _table()
    bins = table.bins(3)
    theta = 2 * np.arcsin(np.sqrt(_drawn(table) / 2))
    lit = bins.power > 0
    found = np.histogram(theta, bins.theta)[0]
    score = float((np.square(found - _DRAWS * bins.power)[lit] / (_DRAWS * bins.power[lit])).sum())
    limit = float(chi2.isf(FALSE_ALARM, lit.sum() - 1))
    return holds(
        "tabulated phase function: a spike, zero bins, complex amplitude", "its own table", "density and phase kept",
        {f"chi-square {score:.0f} below {limit:.0f}": score < limit, "zero bins never drawn": not found[~lit].any(),
         "phase kept": bool(np.angle(table.amplitude(-1.0)) == np.pi / 2)},
    )  # fmt: skip


def tabulated_refused() -> Row:
    """Tables that are none."""
    theta, ones = np.linspace(0, np.pi, 4), np.ones(4)
    calls = [
        (lambda: sg.media.Tabulated(theta=theta - 0.1, amplitude=ones), ["Tabulated.theta", "at least 0"]),
        (lambda: sg.media.Tabulated.from_power(theta, -ones), ["power", "at least 0"]),
        (lambda: sg.media.Tabulated(theta=theta, amplitude=ones * np.nan), ["Tabulated.amplitude", "finite"]),
        (lambda: sg.media.Tabulated(theta=theta[[0, 2, 1, 3]], amplitude=ones), ["Tabulated.theta", "rising"]),
        (lambda: sg.media.Tabulated(theta=theta, amplitude=0 * ones), ["Tabulated.amplitude", "other than 0"]),
    ]
    return refused("tables: negative angle or density, NaN, unsorted, dark", REQUIRED, calls)


ROWS = (thin_covariance, thin_error, thin_orders, anisotropy, anisotropy_single, anisotropy_refused, albedo_zero,
        albedo_tiny, deep_isotropic, deep_anisotropic, deep_refused, albedo_one, dense, zero_thickness, voxels_vacuum,
        voxels_dense, tabulated_sampler, tabulated_refused)  # fmt: skip
