"""The wave solver, placement by placement: against treams, against conservation laws and symmetries."""

import numpy as np
import pytest
from refusals import assert_refused
from scenes import DATA
from scipy.spatial.distance import pdist

from specklegen.core.errors import RuleError
from specklegen.oracles import wave_solver
from specklegen.oracles.cylinder import Cylinder
from specklegen.oracles.wave_solver import LineSources, PlaneLights, directions_of, scatter

ROUNDING = 1e-13  # systems of a few dozen unknowns with fields of order 1; measured up to 1e-14
KINDS = [  # radius, index, orders kept: thin and resonant, thin, thick
    (0.02, 7.3, 0), (0.02, 7.277, 1), (0.1, 1.8, 4), (0.25, 2.5, 6),
]  # fmt: skip
TURNS = directions_of(np.array([0.0, 0.3, 2.0, 4.4]))


def cluster(radius, number=9, half=2.0):
    """Centres that do not overlap."""
    rng = np.random.default_rng(5)
    centres = rng.uniform(-half, half, (number, 2))
    while pdist(centres).min() < 2 * radius:
        centres = rng.uniform(-half, half, (number, 2))
    return centres


def clear_points(centres, radius, number=4):
    points = np.random.default_rng(6).uniform(-3, 3, (200, 2))
    return points[np.linalg.norm(points[:, None] - centres, axis=2).min(axis=1) > 1.1 * radius][:number]


def total_field(solved, points):
    """Incident plus scattered field, complex128[L, P]."""
    return solved.light.field(solved.cylinder.wavenumber, points) + solved.near_field(points)


def scattered_power(solved):
    """Integral of |u|^2 over all directions, float64[L]: exact, since u has finitely many harmonics to rounding."""
    extent = solved.cylinder.wavenumber * (np.ptp(solved.centres, axis=0).max() if len(solved.centres) else 0.0)
    count = 2 * int(extent + 6 * np.cbrt(extent) + 2 * solved.cylinder.order + 20)
    views = directions_of(np.linspace(0, 2 * np.pi, count, endpoint=False))
    return np.sum(np.abs(solved.far_field(views)) ** 2, axis=1) * (2 * np.pi / count)


@pytest.fixture(scope="module")
def oracle():
    return np.load(DATA / "wave_solver_2d_od2.npz")


def test_the_resonant_cylinder_is_the_oracles(oracle):
    cylinder = Cylinder.resonant(float(oracle["radius"]))
    assert cylinder.index == pytest.approx(float(oracle["index"]), rel=1e-14)
    assert cylinder.cross_section == pytest.approx(float(oracle["c_s"]), rel=1e-14)
    assert np.abs(cylinder.t_matrix - oracle["t_coeffs"]).max() < 1e-14
    degrees, real, imaginary = np.loadtxt(DATA / "cylinder_amplitude.csv", delimiter=",", skiprows=1).T
    assert np.abs(cylinder.amplitude(np.deg2rad(degrees)) - (real + 1j * imaginary)).max() < 1e-14


def test_orders_above_the_first_do_not_matter_for_a_thin_cylinder():
    orders = Cylinder.resonant(0.02, order=3).t_matrix
    assert np.abs(orders[[0, 1, -2, -1]]).max() < 1e-6  # (ka)^4: 8.8e-7
    assert np.abs(orders[[2, 4]]).min() > 1e-3  # while those of order 1 do


@pytest.mark.parametrize(("radius", "index", "order"), KINDS)
def test_one_cylinder(radius, index, order):
    cylinder = Cylinder(radius, index, order=order)
    assert np.abs(np.abs(1 + 2 * cylinder.t_matrix) - 1).max() < ROUNDING  # nothing absorbed
    theta = np.linspace(0, 2 * np.pi, 64, endpoint=False)
    s = cylinder.amplitude(theta)
    assert np.mean(np.abs(s) ** 2) * 2 * np.pi == pytest.approx(1, rel=ROUNDING)
    angle, centre = 0.7, np.array([1.3, -0.4])
    light = directions_of(np.array([angle]))
    solved = scatter(cylinder, centre[None], PlaneLights(light))
    phase = np.exp(2j * np.pi * (light - directions_of(theta)) @ centre)
    expected = np.sqrt(cylinder.cross_section) * cylinder.amplitude(theta - angle) * phase
    assert np.abs(solved.far_field(directions_of(theta))[0] - expected).max() < ROUNDING


def test_lengths_scale():
    """u has the dimension of the root of a length in the far field, none in the near field."""
    for factor in (1e-3, 7.0):
        small, large = (Cylinder(0.1 * f, 1.8, wavelength=f, order=3) for f in (1, factor))
        centres = cluster(0.1)
        one = scatter(small, centres, PlaneLights(TURNS))
        other = scatter(large, centres * factor, PlaneLights(TURNS))
        assert np.abs(one.far_field(TURNS) * np.sqrt(factor) - other.far_field(TURNS)).max() < ROUNDING * factor**0.5
        points = clear_points(centres, 0.1)
        assert np.abs(one.near_field(points) - other.near_field(points * factor)).max() < ROUNDING


@pytest.mark.parametrize(("radius", "index", "order"), KINDS[1:])
def test_treams_agrees(radius, index, order):
    treams = pytest.importorskip("treams")
    cylinder, centres = Cylinder(radius, index, order=order), cluster(radius)
    k, points = cylinder.wavenumber, clear_points(centres, radius, 20)
    flat = lambda x: np.column_stack([x[:, 1], x[:, 0], 0 * x[:, 0]])  # noqa: E731 (its axis is z; its x our z)
    one = treams.TMatrixC.cylinder([0], order, k, radius, [index**2, 1])
    many = treams.TMatrixC.cluster([one] * len(centres), flat(centres))
    solved = many.interaction.solve()
    ours = scatter(cylinder, centres, PlaneLights(TURNS)).near_field(points)
    for light, field in zip(k * flat(TURNS), ours, strict=True):
        wave = treams.plane_wave(light, [0, 0, 1], k0=k, material=1)
        theirs = np.asarray((solved @ wave.expand(many.basis)).efield(flat(points)))
        assert np.abs(field - theirs[:, 2]).max() < ROUNDING
        assert np.abs(theirs[:, 2]).max() > 0.1


@pytest.mark.parametrize(("radius", "index", "order"), KINDS)
def test_energy_and_optical_theorem(radius, index, order):
    cylinder, centres = Cylinder(radius, index, order=order), cluster(radius)
    k = cylinder.wavenumber
    for light in (PlaneLights(TURNS), LineSources(clear_points(centres, radius))):
        solved = scatter(cylinder, centres, light)
        assert solved.extinction() == pytest.approx(scattered_power(solved), rel=ROUNDING)
    forward = np.diag(scatter(cylinder, centres, PlaneLights(TURNS)).far_field(TURNS))
    theorem = -np.sqrt(8 * np.pi / k) * (np.exp(0.25j * np.pi) * forward).real
    assert theorem == pytest.approx(scattered_power(scatter(cylinder, centres, PlaneLights(TURNS))), rel=ROUNDING)


@pytest.mark.parametrize(("radius", "index", "order"), KINDS)
def test_reciprocity(radius, index, order):
    """Source and sensor may be swapped, in the far field with both directions reversed."""
    cylinder, centres = Cylinder(radius, index, order=order), cluster(radius)
    points = clear_points(centres, radius)
    waves, sources = (scatter(cylinder, centres, light) for light in (PlaneLights(TURNS), LineSources(points)))
    far, near = waves.far_field(-TURNS), sources.near_field(points)
    assert np.abs(far - far.T).max() < ROUNDING
    assert np.abs(near - near.T).max() < ROUNDING
    assert np.abs(sources.far_field(-TURNS) - waves.near_field(points).T).max() < ROUNDING


def test_moving_everything_turns_the_phase():
    cylinder, centres, shift = Cylinder.resonant(0.02), cluster(0.02), np.array([0.37, -1.1])
    here, there = (scatter(cylinder, c, PlaneLights(TURNS)).far_field(TURNS) for c in (centres, centres + shift))
    phase = np.exp(2j * np.pi * (TURNS[:, None] - TURNS[None]) @ shift)
    assert np.abs(there - here * phase).max() < ROUNDING


def test_near_field_becomes_the_far_field():
    centres = cluster(0.1)
    solved, r = scatter(Cylinder(0.1, 1.8, order=4), centres, PlaneLights(TURNS)), 1e6
    limit = solved.near_field(r * TURNS) * np.sqrt(r) * np.exp(-2j * np.pi * r)
    size = np.linalg.norm(centres, axis=1).max()
    bound = 2 * np.pi * size**2 / (2 * r) * np.abs(limit).max() * len(centres) ** 0.5  # the next term of |r v - x|
    assert np.abs(limit - solved.far_field(TURNS)).max() < bound


def test_field_is_continuous_through_a_surface():
    """And so is its slope, as closely as the orders kept allow: the light's own higher orders are 0.1^n apart."""
    centres, radius = cluster(0.1), 0.1
    normal = directions_of(np.linspace(0, 6, 9))
    step, jumps = 1e-4 * radius, []
    for order in (1, 3, 5, 7):
        solved = scatter(Cylinder(radius, 1.8, order=order), centres, PlaneLights(TURNS))
        at = lambda f, s=solved: total_field(s, centres[3] + (radius + f * step) * normal)  # noqa: E731
        value = np.abs(at(1e-6) - at(-1e-6)).max()
        slope = np.abs(at(2) - 2 * at(1) + 2 * at(-1) - at(-2)).max() / step  # second order, curvature jumps alone
        jumps.append((value, slope))
    values, slopes = np.array(jumps).T
    assert (values[1:] < values[:-1] / 10).all()
    assert values[-1] < 1e-6
    assert slopes[-1] < slopes[0] / 100


def test_points_are_taken_in_pieces(monkeypatch):
    centres = cluster(0.1)
    solved = scatter(Cylinder(0.1, 1.8), centres, PlaneLights(TURNS))
    points = np.random.default_rng(0).uniform(-2, 2, (50, 2))
    whole = solved.near_field(points)
    monkeypatch.setattr(wave_solver, "CHUNK", 4 * len(centres))
    assert np.abs(solved.near_field(points) - whole).max() < ROUNDING


def test_bad_input_is_refused():
    thin = Cylinder(0.1, 1.8)
    for wrong in ({"radius": 0}, {"index": -1}, {"wavelength": np.nan}, {"order": 1.5}, {"order": -1}):
        with pytest.raises(RuleError, match=f"Cylinder.{next(iter(wrong))} must be"):
            Cylinder(**({"radius": 0.1, "index": 1.5} | wrong))
    assert_refused(lambda: Cylinder.resonant(0.15), r"0\.142")
    assert_refused(lambda: scatter(thin, np.array([[0, 0], [0.19, 0]]), PlaneLights(TURNS)), "two radii apart")
    assert_refused(lambda: scatter(thin, np.zeros((1, 2)), LineSources(np.array([[0.05, 0]]))), "outside all cylinders")
    assert_refused(lambda: PlaneLights(np.ones((1, 2))), "unit vectors")
    for shape in (np.zeros(2), np.zeros((1, 3)), np.full((1, 2), np.nan)):
        with pytest.raises(RuleError, match="shape"):
            scatter(thin, shape, PlaneLights(TURNS))
