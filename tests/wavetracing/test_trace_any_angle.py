"""Openings at any angle, near and far from the source, in any orientation: power, and patterns in their own plane."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from scipy.stats import chi2
from wavetracing.screens import OUTLINE, slit
from zscore import FALSE_ALARM, assert_z

from specklegen.wavetracing import CollimatedEmitter, Geometry, Plane, perforated_screen, trace

K = 2 * np.pi
SIGMA, WIDTH, LENGTH, APART = 98.0, 5.0, 20.0, 14.0
HOLES = [slit(-APART / 2), slit(APART / 2)]
BINS, DRAWS = 120, 600_000


def source_before(corners, normal, direction, distance, sigma):
    """Parallel light over a rectangle across the axis nearest to it, ``distance`` before the screen at least.

    Return also its area, seen along the light. Rays spread by up to 5.5 deviations on their way.
    """
    axis = int(np.abs(direction).argmax())
    others = np.arange(3) != axis
    start = direction[axis] * ((corners[:, axis] / direction[axis]).min() - distance)
    for _ in range(50):
        way = (start - corners[:, axis]) / direction[axis]
        lit = corners + way[:, None] * direction
        margin = 5.5 * np.abs(way).max() / (K * np.sqrt(2 * sigma)) / abs(direction[axis])
        low, high = lit.min(axis=0) - margin, lit.max(axis=0) + margin
        low[axis] = high[axis] = start
        ends = np.stack(np.meshgrid(*np.stack([low, high], axis=1)), axis=-1).reshape(-1, 3)
        nearest = (-(ends @ normal) / (direction @ normal)).min()
        if nearest >= distance * (1 - 1e-9):
            light = CollimatedEmitter(low, high, direction, 3 * np.sqrt(sigma / 2), 1.0)
            return light, np.prod((high - low)[others]) * abs(direction[axis])
        start -= direction[axis] * (distance - nearest)
    raise AssertionError("no rectangle before the screen")


def expected(angle, half, sigma=SIGMA):
    """Shares of light in columns of a far receiver across the incident light, |tangent| < half, and their number.

    Drawn: the wavevector's part in the screen is that of the ensemble plus that of |Psi|^2 of the slits.
    """
    rng = np.random.default_rng(5)
    xi = np.linspace(-40, 40, 400_001)
    across = np.cumsum(np.sinc(WIDTH * xi / K) ** 2 * np.cos(APART / 2 * xi) ** 2)
    along = np.cumsum(np.sinc(10 * xi / K) ** 2)  # of xi * length / 10
    x, y = (np.interp(rng.random(DRAWS), c / c[-1], xi) for c in (across, along))
    u, v = rng.normal(size=(2, DRAWS)) / np.sqrt(2 * sigma) / K
    sine, cosine = np.sin(np.deg2rad(angle)), np.cos(np.deg2rad(angle))
    a = np.sqrt(1 - u * u - v * v) * sine + u * cosine + x / K
    b = v + y * 10 / LENGTH / K
    real = a * a + b * b < 1
    a, b = a[real], b[real]
    c = np.sqrt(1 - a * a - b * b)
    ahead, aside = a * sine + c * cosine, a * cosine - c * sine
    inside = (ahead > 0) & (np.abs(b) < half * ahead)
    return np.histogram(aside[inside] / ahead[inside], BINS, (-half, half))[0] / real.sum()


def passing(angle, distance, turn, beams, amplitude="auto", seed=1, sigma=SIGMA):
    """Trace; counts in the columns, and what was found, the share of light that rays say passes, half the tangent."""
    incidence, half = np.deg2rad(angle), 0.3
    light = turn @ [np.sin(incidence), 0, np.cos(incidence)]
    screen = perforated_screen(OUTLINE, HOLES).placed(rotation=turn)
    corners = np.concatenate(HOLES)
    source, area = source_before(np.c_[corners, 0 * corners[:, 0]] @ turn.T, turn[:, 2], light, distance, sigma)
    plane = Plane(center=1e6 * light, normal=light, up=turn[:, 1], shape=(BINS, BINS), pitch=2e6 * half / BINS)
    found = trace(Geometry(screen), source, plane, beams, seed, amplitude=amplitude)
    counts = found.irradiance[0].sum(axis=0) * plane.pitch**2 * beams
    return counts, found, len(HOLES) * WIDTH * LENGTH * np.cos(incidence) / area, half


def excess(counts, total, shares):
    """Chi-square over columns of 20 expected counts and more, the reference's own noise included; and their number.

    Where few beams pass, columns are taken together until a third of them have so many.
    """
    for together in (1, 2, 4, 8, 24, BINS):
        seen, share = (values.reshape(-1, together).sum(axis=1) for values in (counts, shares))
        mean = share * total
        use = mean > 20
        if use.mean() > 0.3:
            break
    variance = mean + mean**2 / (share * DRAWS).clip(1)
    return ((seen - mean)[use] ** 2 / variance[use]).sum(), use.sum()


CASES = [(0, 1), (45, 1), (60, 10), (75, 1)]


@pytest.mark.parametrize(("angle", "distance"), CASES)
def test_slits_pass_what_rays_say_and_bend_it_once(angle, distance):
    """Two slits of 5, 14 apart, turned at random, lit at an angle, a wavelength and more from the source."""
    turn = Rotation.random(random_state=angle + distance).as_matrix()
    counts, found, share, half = passing(angle, distance, turn, 60_000)
    total = found.ledger.total
    assert_z(found.statistics.open / total, share, np.sqrt(share * (1 - share) / total))
    assert found.statistics.open + found.ledger.absorbed == total  # each beam that passes is bent once
    assert found.ledger.failed == found.statistics.null == 0
    value, degrees = excess(counts, found.statistics.open, expected(angle, half))
    assert degrees > 40
    assert value < chi2.isf(FALSE_ALARM, degrees)


def test_the_check_of_patterns_has_power():
    """A pattern that is not that of a screen aslant, and a spread counted twice, are noticed."""
    for angle, wrong in ((45, {"angle": 0}), (0, {"angle": 0, "sigma": SIGMA / 2})):
        counts, found, _, half = passing(angle, 5, np.eye(3), 40_000)
        value, degrees = excess(counts, found.statistics.open, expected(half=half, **wrong))
        assert value > chi2.isf(FALSE_ALARM, degrees)


@pytest.mark.parametrize(("angle", "sigma", "beams"), [(30, 98.0, 40_000), (45, 24.5, 20_000)])
def test_the_beams_own_field_agrees(angle, sigma, beams):
    """The other rule, the field of each beam on a grid: narrow beams in a screen aslant, 3 wavelengths off.

    A grid of all that a beam lights, not of what is open, had a chi^2 of twice its degrees here.
    """
    turn = Rotation.random(random_state=2).as_matrix()
    counts, found, share, half = passing(angle, 3, turn, beams, "gaussian", sigma=sigma)
    total = found.ledger.total
    assert found.statistics.gaussian == found.statistics.open
    assert_z(found.statistics.open / total, share, np.sqrt(share * (1 - share) / total))
    value, degrees = excess(counts, found.statistics.open, expected(angle, half, sigma))
    assert value < chi2.isf(FALSE_ALARM, degrees)


@pytest.mark.slow
@pytest.mark.parametrize("angle", [0, 30, 45, 60, 70, 75])
@pytest.mark.parametrize("distance", [1, 10, 1000])
def test_a_million_beams(angle, distance):
    """Power within 1 % where enough beams pass, chi-square per degree below 1.5."""
    turn = Rotation.random(random_state=7 * angle + distance).as_matrix()
    counts, found, share, half = passing(angle, distance, turn, 1_000_000)
    if found.statistics.open > 100_000:
        assert found.statistics.open / 1e6 == pytest.approx(share, rel=0.01)
    assert found.statistics.open + found.ledger.absorbed == found.ledger.total
    value, degrees = excess(counts, found.statistics.open, expected(angle, half))
    assert value < (1.5 * degrees if degrees > 40 else chi2.isf(1e-4, degrees))
