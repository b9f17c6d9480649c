"""Tracing: reproducible to the bit, unbiased thinning, energy, transmission, first vertices, bounds."""

from dataclasses import replace

import numpy as np
import pytest
from numba import njit
from paths_by_hand import connection_weights, entrance_power, phase_function, way_out
from references.slab import slab_transmission
from scenes import slab
from scipy.special import expn
from scipy.stats import chi2
from slab_sums import beam_layout
from zscore import FALSE_ALARM, assert_mean, assert_z, refute_mean

import specklegen as sg
from specklegen.kernels import footprints
from specklegen.paths.bank import BLOCK, concatenate
from specklegen.paths.endpoint_factors import contributions
from specklegen.paths.proposal import beam_proposal, plane_proposal
from specklegen.paths.slab_tracer import trace
from specklegen.scene.illumination import reference_direction
from specklegen.scene.window import Window

AXIS = np.array([0.0, 0.0, 1.0])
BATCHES = 64


def batch_means(bank, values: np.ndarray) -> np.ndarray:
    """Per-path means of ``values`` [M, ...] in 64 equal batches of paths, [64, ...]."""
    assert bank.count % BATCHES == 0
    first = np.searchsorted(bank.paths, np.arange(BATCHES) * (bank.count // BATCHES))
    padded = np.concatenate([values, np.zeros_like(values[:1])])
    sums = np.add.reduceat(padded, first, axis=0)
    empty = np.diff(np.append(first, len(values))) == 0
    sums[empty] = 0
    return sums / (bank.count // BATCHES)


def same(one, two) -> bool:
    return (
        one.records.tobytes() == two.records.tobytes()
        and (one.orders == two.orders).all()
        and (one.paths == two.paths).all()
        and (one.count, one.events, one.unfinished) == (two.count, two.events, two.unfinished)
    )


# ---- Purity --------------------------------------------------------------------------------------------
@pytest.mark.parametrize("albedo", [1.0, 0.7])
@pytest.mark.parametrize("threshold", [0.0, 1.0])
def test_the_bank_does_not_depend_on_threads_or_splits(albedo, threshold):
    medium = slab(4, 0.5, albedo)
    beams = sg.CollimatedBeams.tilts([0.0, 0.1], width=100.0)
    proposal = replace(beam_proposal(medium, beams, AXIS), threshold=threshold)
    count = 3 * BLOCK + 17
    whole = trace(medium, proposal, 5, count, threads=1)
    assert same(whole, trace(medium, proposal, 5, count, threads=2))
    edges = [0, 1, BLOCK - 3, BLOCK + 5, 2 * BLOCK, count]
    parts = [trace(medium, proposal, 5, b - a, first=a) for a, b in zip(edges, edges[1:], strict=False)]
    assert same(whole, concatenate(parts))
    for other in (trace(medium, proposal, 6, count), trace(medium, proposal, 5, count, sample=1)):
        assert not np.isin(other.entry[:, 0], whole.entry[:, 0]).any()


def test_paths_past_four_billion_are_their_own():
    medium, proposal = slab(2), plane_proposal(slab(2), AXIS, AXIS)
    near, far = trace(medium, proposal, 0, 10), trace(medium, proposal, 0, 10, first=2**32)
    assert not np.isin(near.entry[:, 2], far.entry[:, 2]).any()


def test_a_block_that_needs_more_room_is_traced_again():
    """At albedo 1 and a high threshold the first guess of room is small; nothing may be lost."""
    medium = slab(30)
    proposal = plane_proposal(medium, AXIS, AXIS)
    kept_all = replace(proposal, threshold=1e-300)
    assert same(trace(medium, kept_all, 1, 500), trace(medium, proposal, 1, 500))


# ---- Weights -------------------------------------------------------------------------------------------
@pytest.mark.parametrize("profile", ["square", "disc", "gaussian"])
@pytest.mark.parametrize("g", [-0.5, 0.0, 0.9])
def test_full_weights_are_those_of_the_formula(profile, g):
    medium = slab(3, g, albedo=0.8)
    beams = sg.CollimatedBeams.tilts([[0.3, -0.2], [0.35, -0.1]], width=60.0, profile=profile)
    bank = trace(medium, beam_proposal(medium, beams, AXIS), 1, 300)
    layout = beam_layout(0.5, medium, beams)
    for view in np.array([[0, 0, 1.0], [0.6, 0, 0.8], [0, 0.6, -0.8], [0.8, 0.6, 1e-9] / np.sqrt(1 + 1e-18)]):
        for light in beams.directions:
            expected = connection_weights(bank, medium, light, view, profile, 60.0)
            found = contributions(layout.at(light, view), bank)
            # Rounding, times the few hundred mean free paths that an exponent holds.
            np.testing.assert_allclose(found, expected, rtol=1e-11, atol=1e-290)
            if abs(view[2]) < 1e-6:
                assert found.max() < 1e-290  # grazing views see nothing of an infinite slab


@pytest.mark.parametrize("g", [0.0, 0.9])
@pytest.mark.parametrize("reverse", [False, True])
def test_thinning_is_unbiased(g, reverse):
    medium = slab(4, g)
    beams = sg.CollimatedBeams.tilts([0.1], width=300.0)
    views = np.array([[0, 0, 1.0], [0.3, 0, np.sqrt(0.91)], [-0.1, 0, -np.sqrt(0.99)]])
    proposal = beam_proposal(medium, beams, views, bidirectional=reverse)
    layout = beam_layout(0.5, medium, beams)
    count = 64 * 500
    sums = []
    for threshold, seed in ((0.0, 1), (None, 2)):
        if threshold is None:
            threshold = 10 * sums[0].mean(axis=0)[0]
        bank = trace(medium, replace(proposal, threshold=threshold), seed, count)
        weights = [contributions(layout.at(beams.directions[0], view), bank) for view in views]
        orders = np.stack([bank.orders == 1, bank.orders == 2, bank.orders > 5], 1)
        sums.append(batch_means(bank, np.stack([*weights, *(weights[0][:, None] * orders).T], 1)))
        kept = len(bank) / count
    assert kept < 0.5 * medium.optical_depth  # it does thin: unthinned banks hold several connections a path
    errors = [s.std(axis=0, ddof=1) / 8 for s in sums]
    assert_z(sums[1].mean(axis=0), sums[0].mean(axis=0), np.hypot(*errors), degrees=BATCHES - 1)


# ---- Energy --------------------------------------------------------------------------------------------
@njit
def _henyey_greenstein_around(axes, g, u, v, out):
    """Directions about ``axes`` by the textbook inversion, in the textbook frame: no code of the kernels."""
    for n in range(len(axes)):
        if abs(g) < 1e-9:
            cos = 2 * u[n] - 1
        else:
            cos = (1 + g * g - ((1 - g * g) / (1 - g + 2 * g * u[n])) ** 2) / (2 * g)
        sin = np.sqrt(max(0.0, 1 - cos * cos))
        x, y, z = axes[n]
        c, s = np.cos(2 * np.pi * v[n]), np.sin(2 * np.pi * v[n])
        flat = np.sqrt(1 - z * z)
        if flat < 1e-6:
            out[n, 0], out[n, 1], out[n, 2] = sin * c, sin * s, np.sign(z) * cos
        else:
            out[n, 0] = sin * (x * z * c - y * s) / flat + x * cos
            out[n, 1] = sin * (y * z * c + x * s) / flat + y * cos
            out[n, 2] = -sin * c * flat + z * cos


def outgoing_power(bank, medium, light, power: np.ndarray, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Power that each connection sends through the exit and the entrance face. Integral of rho(w . v) e^(-tau) over
    views, by one view a connection drawn from rho."""
    generator = np.random.default_rng(seed)
    axes = np.where(bank.orders[:, None] > 1, bank.exit_direction, light)
    views = np.empty_like(axes)
    _henyey_greenstein_around(axes, medium.scatterer.g, generator.random(len(bank)), generator.random(len(bank)), views)
    leaving = power * np.exp(-medium.extinction * way_out(bank.exit[:, 2], views[:, 2], medium.thickness))
    return np.where(views[:, 2] > 0, leaving, 0), np.where(views[:, 2] < 0, leaving, 0)


@pytest.mark.parametrize(("optical_depth", "g", "tilt", "profile"), [
    (0.1, 0.0, 0.0, "square"), (1.0, 0.0, 0.8, "disc"), (2.0, 0.9, 0.0, "gaussian"), (2.0, -0.5, 0.5, "square"),
    (5.0, 0.9, 0.8, "square"), (5.0, 0.0, 0.0, "gaussian"), (2.0, 0.99, 0.3, "disc"),
])  # fmt: skip
def test_scattered_light_is_what_left_the_beam(optical_depth, g, tilt, profile):
    """A02 in 3D: the integral of I over both hemispheres is A (1 - e^(-OD / i_z)) at albedo 1."""
    medium = slab(optical_depth, g)
    beams = sg.CollimatedBeams.tilts([tilt], width=70.0, profile=profile)
    light = beams.directions[0]
    bank = trace(medium, beam_proposal(medium, beams, AXIS), 11, 64 * 400)
    power = entrance_power(bank, medium, light, profile, 70.0)
    through, back = outgoing_power(bank, medium, light, power, 1)
    lost = -np.expm1(-optical_depth / light[2])
    assert_mean(batch_means(bank, through + back), Window(profile, 70.0).area * lost)


@pytest.mark.parametrize(("g", "tilt", "albedo"), [(0.0, 0.0, 0.9), (0.8, 0.4, 0.5), (0.0, 0.7, 0.99)])
def test_reflected_transmitted_absorbed_and_ballistic_light_add_up(g, tilt, albedo):
    medium = slab(3.0, g, albedo)
    light = np.array([np.sin(tilt), 0.0, np.cos(tilt)])
    bank = trace(medium, plane_proposal(medium, light, AXIS), 12, 64 * 1000)
    power = entrance_power(bank, medium, light, "plane", np.inf)
    through, back = outgoing_power(bank, medium, light, power, 2)
    # W counts what a collision scatters; it absorbs (1 - albedo)/albedo as much.
    absorbed = (1 - albedo) / albedo * power
    ballistic = np.exp(-medium.optical_depth / light[2])
    assert_mean(batch_means(bank, through + back + absorbed) + ballistic, 1.0)


def test_energy_test_has_power():
    """One per cent too much first weight is caught."""
    medium = slab(1.0)
    bank = trace(medium, plane_proposal(medium, AXIS, AXIS), 13, 64 * 8000)
    power = 1.01 * entrance_power(bank, medium, AXIS, "plane", np.inf)
    refute_mean(batch_means(bank, sum(outgoing_power(bank, medium, AXIS, power, 3))), -np.expm1(-1.0))


# ---- Transmission --------------------------------------------------------------------------------------
def transmittance(medium: sg.Slab, paths: int, seed: int) -> np.ndarray:
    """Batch means of the transmittance, isotropic scatterers: int_0^1 e^(-t/mu) dmu / 2 = E2(t)/2 a connection."""
    proposal = replace(plane_proposal(medium, AXIS, AXIS), threshold=slab_transmission(medium.optical_depth))
    bank = trace(medium, proposal, seed, paths)
    power = entrance_power(bank, medium, AXIS, "plane", np.inf)
    out = power * expn(2, medium.extinction * (medium.thickness - bank.exit[:, 2])) / 2
    return batch_means(bank, out) + np.exp(-medium.optical_depth)


@pytest.mark.parametrize(("optical_depth", "paths"), [
    (5, 64 * 24_000),
    *(pytest.param(depth, 64 * paths, marks=pytest.mark.slow) for depth, paths in ((10, 48_000), (20, 100_000))),
])  # fmt: skip
def test_transmission_of_a_slab(optical_depth, paths):
    found = transmittance(slab(optical_depth), paths, 21)
    expected = slab_transmission(optical_depth)
    assert_mean(found, expected, slack=0.002 * expected)
    # Power: the diffusion approximation's numerator is 1.9 % too high.
    refute_mean(found, expected * 1.7104 / 1.6788, slack=0.002 * expected)


def test_absorbing_coin_is_the_weight_it_replaces():
    """A coin a collision (albedo 0.6) against the weight albedo^B on paths that none absorbs."""
    medium, lossless = slab(4.0, 0.3, 0.6), slab(4.0, 0.3, 1.0)
    results = []
    for this, factor, seed in ((medium, 1.0, 1), (lossless, 0.6, 2)):
        bank = trace(this, plane_proposal(this, AXIS, AXIS), seed, 64 * 1500)
        power = entrance_power(bank, this, AXIS, "plane", np.inf) * factor**bank.orders
        through, back = outgoing_power(bank, this, AXIS, power, seed)
        results.append(batch_means(bank, np.stack([through, back], 1)))
    errors = [r.std(axis=0, ddof=1) / 8 for r in results]
    assert_z(results[0].mean(axis=0), results[1].mean(axis=0), np.hypot(*errors), degrees=BATCHES - 1)


# ---- First vertices ------------------------------------------------------------------------------------
@njit
def _footprint(code, extent, u, out):
    for n in range(len(u)):
        out[n, 0], out[n, 1], out[n, 2] = footprints.sample_footprint(code, extent, u[n, 0], u[n, 1])


@njit
def _density(code, extent, points, out):
    for n in range(len(points)):
        out[n] = footprints.footprint_density(code, extent, points[n, 0], points[n, 1])


PROFILES = {"square": footprints.SQUARE, "disc": footprints.DISC, "gaussian": footprints.GAUSSIAN}


@pytest.mark.parametrize("profile", PROFILES)
def test_first_points_follow_their_density(profile):
    code, extent, count = PROFILES[profile], 3.0, 200_000
    drawn, density = np.empty((count, 3)), np.empty(count)
    _footprint(code, extent, np.random.default_rng(5).random((count, 2)), drawn)
    _density(code, extent, drawn[:, :2], density)
    np.testing.assert_allclose(density * drawn[:, 2], 1, rtol=1e-12)
    # Bins of the plane, 3x3 quadrature points a fine cell; the curved edge of the disc is left to the slack below.
    edges = np.linspace(-12, 12, 49)
    fine = (np.arange(48 * 20) + 0.5) / 40 - 12
    grid = np.stack(np.meshgrid(fine, fine, indexing="ij"), -1).reshape(-1, 2)
    cells = np.empty(len(grid))
    _density(code, extent, grid, cells)
    share = cells.reshape(48, 20, 48, 20).sum(axis=(1, 3)) / 40**2
    # What may be missing: the disc's staircase, the Gaussian's 2 erfc(4 / sqrt 2) beyond four standard deviations.
    assert abs(share.sum() - 1) < {"square": 1e-12, "disc": 2e-3, "gaussian": 1.3e-4}[profile]
    found = np.histogram2d(drawn[:, 0], drawn[:, 1], [edges, edges])[0]
    if profile == "disc":  # ... so there only cells wholly inside or outside are compared
        corner = np.hypot(
            *np.meshgrid(np.maximum(np.abs(edges[:-1]), np.abs(edges[1:])),
                         np.maximum(np.abs(edges[:-1]), np.abs(edges[1:])))
        )  # fmt: skip
        assert (found[corner > 3 + np.sqrt(2)] == 0).all()
        use = corner <= 3
    else:
        use = count * share > 5
    score = ((found - count * share)[use] ** 2 / (count * share[use])).sum()
    assert score < chi2.isf(FALSE_ALARM, int(use.sum())), f"{score:.0f} for {use.sum()} cells"


@pytest.mark.parametrize("profile", PROFILES)
def test_depths_are_exponential_and_weights_carry_the_area(profile):
    """First weight times beam power has mean A (1 - e^(-OD/i_z)) for every tilt of one shared footprint."""
    medium = slab(0.7)
    beams = sg.CollimatedBeams.tilts([0.0, 0.2, -0.3], width=40.0, profile=profile)
    bank = trace(medium, beam_proposal(medium, beams, AXIS), 31, 64 * 3000).single
    for light in beams.directions:
        power = batch_means(bank, entrance_power(bank, medium, light, profile, 40.0))
        assert_mean(power, Window(profile, 40.0).area * -np.expm1(-0.7 / light[2]))
    reference = reference_direction(beams.directions)
    depth = medium.extinction * bank.entry[:, 2] / reference[2]
    uniform = np.expm1(-depth) / np.expm1(-0.7 / reference[2])
    found = np.histogram(uniform, 100, (0, 1))[0]
    assert ((found - len(bank) / 100) ** 2 / (len(bank) / 100)).sum() < chi2.isf(FALSE_ALARM, 99)


def test_single_scattering_has_its_closed_form():
    """Eq. 41: forward rho(1) sigma_s A L e^-OD, backward rho(-1) sigma_s A (1 - e^-2OD)/(2 sigma_t)."""
    medium = slab(1.5, 0.6, 0.8)
    beams = sg.CollimatedBeams.tilts([0.0], width=50.0)
    bank = trace(medium, beam_proposal(medium, beams, AXIS), 41, 64 * 1000).single
    layout = beam_layout(0.5, medium, beams)
    area, scattering = 2500.0, 0.8 * medium.extinction
    forward = phase_function(0.6, np.array(1.0)) * scattering * area * medium.thickness * np.exp(-1.5)
    backward = phase_function(0.6, np.array(-1.0)) * scattering * area * -np.expm1(-3.0) / (2 * medium.extinction)
    found = [batch_means(bank, contributions(layout.at(AXIS, view), bank)) for view in (AXIS, -AXIS)]
    assert_mean(np.stack(found, 1), [forward, backward])


# ---- Bounds --------------------------------------------------------------------------------------------
def test_paths_cut_by_max_order_are_reported():
    medium = slab(20)
    proposal = plane_proposal(medium, AXIS, AXIS)
    whole, cut = trace(medium, proposal, 51, 3000), trace(medium, replace(proposal, max_order=7), 51, 3000)
    long_paths = np.unique(whole.paths[whole.orders > 7])
    assert whole.unfinished == 0
    assert cut.unfinished == len(long_paths) > 0
    assert cut.orders.max() == 7
    short = whole.orders <= 7
    assert (whole.records[short] == cut.records).all()
    carried = whole.weight[(whole.orders == 8)]
    assert cut.unfinished_weight == pytest.approx(carried.sum(), rel=1e-12)


def test_path_length_is_the_sum_of_flights():
    """Second vertices lie one flight from the first; longer paths are at least as long as the straight line."""
    bank = trace(slab(3), plane_proposal(slab(3), AXIS, AXIS), 61, 5000).multiple
    straight = np.linalg.norm(bank.exit - bank.entry, axis=1)
    two = bank.orders == 2
    np.testing.assert_allclose(bank.length[two], straight[two], rtol=1e-9)
    assert (bank.length >= straight * (1 - 1e-9)).all()
    third = bank.orders > 2
    assert (bank.length[third] > straight[third]).all()
    np.testing.assert_allclose(bank.exit[two] - bank.entry[two], bank.length[two, None] * bank.entry_direction[two],
                               atol=1e-9)  # fmt: skip


def test_reversing_twice_is_the_identity():
    bank = trace(slab(3, 0.5), plane_proposal(slab(3, 0.5), AXIS, AXIS, bidirectional=True), 71, 500)
    assert same(bank.reversed().reversed(), bank.multiple)
    assert (bank.reversed().entry == bank.multiple.exit).all()
