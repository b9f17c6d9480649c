"""Fields behind openings: by the rim against the surface integral, the other methods against it and exact slits."""

import warnings

import numpy as np
import pytest
from references.rayleigh_sommerfeld import disc_axis, surface_field

from specklegen.core.errors import DoubtWarning, RuleError
from specklegen.oracles.slit_screen import slit_screen
from specklegen.wavetracing import (
    Plane,
    PlaneField,
    PlaneWave,
    PointEmitter,
    edge_rays,
    field_on_plane,
    sample_pattern,
    sample_slits,
)
from specklegen.wavetracing.facing_edges import facing_edges
from specklegen.wavetracing.opening import rim_of

LIGHT = PlaneWave(wavelength=1.0)
TILTED = PlaneWave(wavelength=1.0, direction=[0.3, 0.1, np.sqrt(0.9)], amplitude=2j)


def box(width, height, at=(0.0, 0.0)):
    return np.array([[-width, -height], [width, -height], [width, height], [-width, height]]) / 2 + at


def hexagram():
    angle, radius = np.arange(12) * np.pi / 6, np.tile([6.0, 12**0.5], 6)
    return np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=1)


def at(point, opening, **options):
    plane = Plane(center=point, shape=(1, 1), pitch=1.0)
    return field_on_plane(opening, options.pop("light", LIGHT), plane, **options).values[0, 0]


def distance(a, b):
    return np.linalg.norm(a - b) / np.linalg.norm(b)


class Given:
    """Any light, by its field alone."""

    def __init__(self, field, wavelength=1.0):
        self.field, self.wavelength = field, wavelength


class TestBoundary:
    @pytest.mark.parametrize(("point", "intensity"), [((0, 0), 2.538887), ((3, 2), 0.509031), ((8, 1), 0.170115)])
    def test_square(self, point, intensity):
        assert abs(at([*point, 50.0], box(10, 10))) ** 2 == pytest.approx(intensity, abs=6e-7)

    def test_hexagram(self):
        assert abs(at([2, 1, 100.0], hexagram())) ** 2 == pytest.approx(0.329221, abs=6e-7)

    @pytest.mark.slow
    def test_discs(self):
        """A polygon of 20 000 sides and the disc's area; the stop is a hole in a screen so wide that it is not seen."""
        turn = np.arange(20_000) * 2 * np.pi / 20_000
        disc = 20 * np.sqrt(turn[1] / np.sin(turn[1])) * np.stack([np.cos(turn), np.sin(turn)], axis=1)
        found = at([0, 0, 400.0], disc)
        assert found == pytest.approx(disc_axis(20.0, 400.0), abs=1e-8)
        assert abs(found) ** 2 == pytest.approx(3.995007, abs=6e-7)
        # Babinet: light without the disc is light less the disc's; its modulus on the axis is z/R.
        stopped = LIGHT.field(np.array([0, 0, 400.0])) - found
        assert abs(stopped) ** 2 == pytest.approx((400 / np.hypot(20, 400)) ** 2, abs=1e-8)

    def test_against_the_surface_integral(self):
        """Near, far, over the rim, on it and beside: 1e-11 is what the surface integral is good for."""
        opening = [hexagram(), box(3, 2, (0.5, 0))[::-1]]
        near = [[0, 0, 3.0], [6, 0, 3], [0.5, 1.0, 4], [0.5, 1 + 1e-9, 4]]
        points = np.array([*near, [9, -4, 5], [2, 0.3, 30], [60, 5, 90]])
        exact = surface_field(rim_of("opening", opening).triangles, points, order=70)
        found = np.array([at(point, opening) for point in points])
        assert np.abs(found - exact).max() < 1e-10

    @pytest.mark.parametrize("light", [
        TILTED, PlaneWave(wavelength=1.0, direction=[np.sin(1.3), 0, np.cos(1.3)]), PointEmitter([0.4, -3, -2.0], 1.0),
        PointEmitter([30, -3, -200.0], 1.0, power=1e6),
    ])  # fmt: skip
    def test_oblique_and_spherical_light(self, light):
        """At 18 and 74 degrees, of a point near and far, against the surface integral over the light's own field."""
        opening = [hexagram(), box(3, 2, (0.5, 0))[::-1]]
        points = np.array([[0, 0, 3.0], [6, 0, 3], [0.5, 1.0, 4], [9, -4, 5], [2, 0.3, 30], [60, 5, 90], [-20, 3, 2]])
        exact = surface_field(rim_of("opening", opening).triangles, points, order=70, light=light.field)
        found = np.array([at(point, opening, light=light) for point in points])
        assert np.abs(found - exact).max() < 1e-10 * np.abs(exact).max()

    def test_a_far_point_is_a_plane_wave(self):
        """1e9 away: the same field over the light's own, to what the curvature is."""
        direction, far, point = np.array([0.6, 0.0, 0.8]), 1e9, np.array([12.0, 1.0, 15.0])
        wave, lamp = PlaneWave(wavelength=1.0, direction=direction), PointEmitter(-far * direction, 1.0)
        ratios = [at(point, hexagram(), light=light) / light.field(point) for light in (wave, lamp)]
        assert ratios[1] == pytest.approx(ratios[0], abs=1e-6)

    def test_nothing_jumps_over_the_rim(self):
        """A wavelength behind it: steps of 1e-9 to both sides of an edge and of a corner move u by its slope only."""
        shifted = [1.0 * TILTED.direction[c] / TILTED.direction[2] for c in (0, 1)]  # where its shadow's rim falls
        for light, (x, y) in ((LIGHT, (5.0, 0.3)), (LIGHT, (5.0, 5.0)), (TILTED, (5 + shifted[0], 5 + shifted[1]))):
            values = [at([x + step, y, 1.0], box(10, 10), light=light) for step in (-1e-9, 0.0, 1e-9)]
            assert np.ptp(np.real(values)) + np.ptp(np.imag(values)) < 2e-8

    def test_near_the_opening_light_is_light_and_dark_is_dark(self):
        assert at([1.0, 1.0, 1e-6], box(10, 10)) == pytest.approx(1, abs=1e-5)
        assert abs(at([7.0, 1.0, 1e-6], box(10, 10))) < 1e-5

    def test_threads_and_place_do_not_matter(self):
        plane = Plane(center=[1, 2, 30.0], shape=(70, 80), pitch=0.5)
        one = field_on_plane(box(10, 6), LIGHT, plane, threads=1).values
        assert np.array_equal(one, field_on_plane(box(10, 6), LIGHT, plane, threads=2).values)
        moved = field_on_plane(box(10, 6, (100, 50)), LIGHT, plane.replace(center=[101, 52, 30.0]), threads=1).values
        assert np.abs(one - moved).max() < 1e-11

    def test_other_units(self):
        """All lengths times 0.5, the field stays."""
        small = at([1.5, 1, 25.0], box(5, 5), light=PlaneWave(wavelength=0.5))
        assert small == pytest.approx(at([3, 2, 50.0], box(10, 10)), abs=1e-13)


class TestSpectrum:
    PLANE = Plane(center=[0.3, 0.2, 50.0], shape=(48, 64), pitch=0.5)

    def test_against_the_rim(self):
        """What is left is the light that moves sideways by more than the window, which the smooth step ends."""
        exact = field_on_plane(box(10, 10), LIGHT, self.PLANE).values
        for padding, bound in ((2.0, 1e-3), (4.0, 2e-4)):  # measured 1.8e-4 and 4.5e-5
            found = field_on_plane(box(10, 10), LIGHT, self.PLANE, "spectrum", padding=padding).values
            assert distance(found, exact) < bound
        shifted = field_on_plane(box(10, 10, (0.02, 0)), LIGHT, self.PLANE, "spectrum").values
        assert distance(shifted, exact) > 2e-3  # a fiftieth of a wavelength is seen

    def test_coarse_pixels_fold(self):
        """A pitch of three wavelengths samples the same field."""
        coarse = self.PLANE.replace(shape=(20, 20), pitch=3.0, center=[0, 0, 80.0])
        exact = field_on_plane(box(10, 10), LIGHT, coarse).values
        assert distance(field_on_plane(box(10, 10), LIGHT, coarse, "spectrum").values, exact) < 1e-3

    def test_any_light_is_the_plane_wave(self):
        """By quadrature and NUFFT on one hand, by the edges on the other; a tilted, turned, shifted plane."""
        turned = Plane(center=[15.0, 5, 50], up=[0.3, 0.8, 0], shape=(40, 48), pitch=0.7)
        edges = field_on_plane([box(9, 9), box(3, 3)[::-1]], TILTED, turned, "spectrum").values
        nodes = field_on_plane([box(9, 9), box(3, 3)[::-1]], Given(TILTED.field), turned, "spectrum").values
        assert distance(nodes, edges) < 1e-10  # measured 1e-14; NUFFT to 1e-12
        assert np.abs(edges).max() > 2

    def test_a_gaussian_beam(self):
        """A waist well inside the opening: the paraxial beam, whose error is (1/kw)^2 = 3e-4 in the field at most."""
        waist, z = 9.0, 150.0
        beam = Given(lambda p: np.exp(-np.square(p[..., :2]).sum(axis=-1) / waist**2))
        plane = Plane(center=[0, 0, z], shape=(64, 64), pitch=0.6)
        found = field_on_plane(box(60, 60), beam, plane, "spectrum").values
        q = 1 + 1j * z / (np.pi * waist**2)
        exact = np.exp(2j * np.pi * z - np.square(plane.points[..., :2]).sum(axis=-1) / (waist**2 * q)) / q
        assert distance(found, exact) < 2e-3

    def test_at_the_screen(self):
        """At z = 0 the lattice holds the opening's spectrum up to its Nyquist frequency: the mean over it is exact."""
        plane = Plane(shape=(64, 64), pitch=0.25)
        found = field_on_plane(box(8, 8), LIGHT, plane, "spectrum")
        assert found.power == pytest.approx(64, rel=0.02)
        inside = np.abs(plane.points[..., :2]).max(axis=-1) < 3
        assert np.abs(found.values[inside] - 1).max() < 0.1


class TestEdgeRays:
    @pytest.mark.parametrize(("polarisation", "z", "figure"), [
        ("hard", 50.0, 1.2e-5), ("hard", 500.0, 1.5e-5), ("soft", 50.0, 5.3e-6), ("soft", 500.0, 6.8e-6),
    ])  # fmt: skip
    def test_a_long_slit(self, polarisation, z, figure):
        """Against the exact slit, l2 of |u|^2: neither more nor less than the error that the theory has.

        The ends are 4e13 wavelengths away, so that their waves are 1e-7.
        """
        long = box(10, 8e13)
        plane = Plane(center=[0.0137, 0, z], shape=(1, 241), pitch=0.3 if z < 100 else 2.5)
        found = np.abs(field_on_plane(long, LIGHT, plane, "utd", polarisation=polarisation).values[0]) ** 2
        exact = slit_screen([(-5, 5)], boundary=polarisation).field(plane.points[0][:, [0, 2]])
        error = distance(found, np.abs(exact) ** 2)
        assert figure / 1.5 < error < figure * 1.5

    @pytest.mark.parametrize(("polarisation", "figure"), [("hard", 6.3e-4), ("soft", 7.2e-5)])
    def test_a_long_slit_lit_aslant(self, polarisation, figure):
        """At 50 degrees, l2 of u against the exact slit: light along the screen no longer cancels if it is hard."""
        angle, z = np.deg2rad(50), 50.0
        light = PlaneWave(wavelength=1.0, direction=[np.sin(angle), 0, np.cos(angle)])
        plane = Plane(center=[z * np.tan(angle), 0, z], shape=(1, 121), pitch=0.6)
        exact = slit_screen([(-5, 5)], boundary=polarisation, angle=angle).field(plane.points[0][:, [0, 2]])
        error = distance(field_on_plane(box(10, 8e13), light, plane, "utd", polarisation=polarisation).values[0], exact)
        assert figure / 1.5 < error < figure * 1.5

    @pytest.mark.parametrize(("width", "single", "all_orders"), [(10.0, 5.3e-3, 5.3e-6), (1.0, 9.2e-2, 2.7e-3)])
    def test_light_from_edge_to_edge(self, monkeypatch, width, single, all_orders):
        """A soft slit without the waves across it, and with them: the claim of the theory, and what it lacks alone."""
        plane = Plane(center=[0.0137, 0, 50.0], shape=(1, 241), pitch=0.25)
        exact = slit_screen([(-width / 2, width / 2)], boundary="soft").field(plane.points[0][:, [0, 2]])
        with_them = field_on_plane(box(width, 8e13), LIGHT, plane, "utd").values[0]
        monkeypatch.setattr(edge_rays, "facing_edges", lambda rim, light: [])
        without = field_on_plane(box(width, 8e13), LIGHT, plane, "utd").values[0]
        for field, figure in ((with_them, all_orders), (without, single)):
            error = distance(np.abs(field) ** 2, np.abs(exact) ** 2)
            assert figure / 1.5 < error < figure * 1.5

    def test_two_slits(self):
        """Waves along the metal between slits are left out: they fall like 1/sqrt(gap) if hard, faster if soft."""
        plane = Plane(center=[0.0137, 0, 50.0], shape=(1, 241), pitch=0.3)
        errors = {}
        for gap in (4.0, 16.0):
            left, right = (-gap / 2 - 3, -gap / 2), (gap / 2, gap / 2 + 5)
            slits = [box(b - a, 8e13, ((a + b) / 2, 0)) for a, b in (left, right)]
            for polarisation in ("soft", "hard"):
                found = field_on_plane(slits, LIGHT, plane, "utd", polarisation=polarisation).values[0]
                exact = slit_screen([left, right], boundary=polarisation).field(plane.points[0][:, [0, 2]])
                errors[polarisation, gap] = distance(found, exact)
        assert errors["soft", 4.0] < 4e-3  # measured 2.5e-3
        assert errors["soft", 16.0] < errors["soft", 4.0] / 3
        assert errors["hard", 4.0] < 2e-2  # measured 1.5e-2
        assert errors["hard", 4.0] / errors["hard", 16.0] == pytest.approx(2, rel=0.15)

    def test_which_edges_face(self):
        """Both pairs of a rectangle; of two slits each its own; not through what stands between; not beside."""
        pairs = [(f.edge, f.width) for f in facing_edges(rim_of("", box(4, 6)), LIGHT)]
        assert pairs == [(0, 6), (1, 4), (2, 6), (3, 4)]
        apart = facing_edges(rim_of("", [box(4, 6), box(2, 6, (8, 0))]), LIGHT)
        assert {f.width for f in apart if f.edge in (1, 3)} == {4.0}
        assert {f.width for f in apart if f.edge in (5, 7)} == {2.0}
        assert facing_edges(rim_of("", np.array([[0, 0], [3, 0], [0, 2.0]])), LIGHT) == []

    def test_a_shadow_boundary_is_no_place(self):
        """Straight behind an edge, and 1e-12 beside, the field is one and the same: no light is lost to rounding.

        (The ends of the slit are 5e21 away: rays from them end at corners, with steps that the theory has.)
        """
        for light in (LIGHT, PlaneWave(wavelength=1.0, direction=[0.28, 0, 0.96])):
            edge = 5 + 30 * light.direction[0] / light.direction[2]
            values = [
                at([edge + step, 0.3, 30.0], box(10, 1e22), light=light, method="utd")
                for step in (-1e-12, -1e-15, 0, 1e-15, 1e-12)
            ]
            assert np.ptp(np.real(values)) + np.ptp(np.imag(values)) < 1e-9

    def test_oblique_to_the_edges(self):
        """A wave with a part along the slit: k across it, and e^{i k_y y} along it, as the half plane has."""
        cosine = 0.4
        light = PlaneWave(wavelength=1.0, direction=[0, cosine, np.sqrt(1 - cosine**2)])
        plane = Plane(center=[0.01, 3.0, 50.0], shape=(1, 101), pitch=0.5)
        for polarisation in ("soft", "hard"):
            # 1e6 long: at 8e13 the phase along the slit would be rounding. Its ends send 1 / sqrt(5e5) and less.
            found = field_on_plane(box(10, 1e6), light, plane, "utd", polarisation=polarisation).values[0]
            across = slit_screen([(-5, 5)], wavelength=1 / light.direction[2], boundary=polarisation)
            exact = across.field(plane.points[0][:, [0, 2]]) * np.exp(2j * np.pi * cosine * 3.0)
            assert distance(found, exact) < 1e-3

    def test_nearer_than_the_theory(self):
        """A square at two of its sizes: edge rays and Kirchhoff's rim describe different screens, within 10 %."""
        plane = Plane(center=[0.01, 0.02, 20.0], shape=(9, 9), pitch=0.4)
        opening = box(10, 10)
        soft, hard = (field_on_plane(opening, LIGHT, plane, "utd", polarisation=p).values for p in ("soft", "hard"))
        assert distance((soft + hard) / 2, field_on_plane(opening, LIGHT, plane).values) < 0.1

    def test_edges_shorter_than_their_fresnel_zone(self):
        """A square of 10 wavelengths at 200: the four edge rays miss nearly every receiver, and a warning says so."""
        plane = Plane(center=[0, 0, 200.0], shape=(16, 16), pitch=2.0)
        with pytest.warns(DoubtWarning, match="corners matter"):
            found = field_on_plane(box(10, 10), LIGHT, plane, "utd").values
        assert distance(found, field_on_plane(box(10, 10), LIGHT, plane).values) > 0.5
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            field_on_plane(box(100, 100), LIGHT, plane, "utd")


class TestFraunhofer:
    FAR = Plane(center=[1e3, 300, 5e4], shape=(20, 20), pitch=300.0)

    def test_is_the_far_field(self):
        exact = field_on_plane(box(10, 10), LIGHT, self.FAR).values
        assert distance(field_on_plane(box(10, 10), LIGHT, self.FAR, "fraunhofer").values, exact) < 2e-3  # k a^2 / 2z
        nearer = self.FAR.replace(center=[0, 0, 50.0], pitch=1.0)
        near = field_on_plane(box(10, 10), LIGHT, nearer).values
        assert distance(field_on_plane(box(10, 10), LIGHT, nearer, "fraunhofer").values, near) > 0.3

    def test_any_light_and_place(self):
        shifted = box(10, 10, (40.0, -20.0))
        edges = field_on_plane(shifted, TILTED, self.FAR, "fraunhofer").values
        nodes = field_on_plane(shifted, Given(TILTED.field), self.FAR, "fraunhofer").values
        assert distance(nodes, edges) < 1e-8


def test_openings_below_a_wavelength_are_doubted():
    plane = Plane(center=[0, 0, 50.0], shape=(1, 1), pitch=1.0)
    for width in (1e-3, 0.9):
        with pytest.warns(DoubtWarning, match="field_on_plane opening is .* wavelengths wide in the mean"):
            field_on_plane(box(width, 100), LIGHT, plane)
        with pytest.warns(DoubtWarning, match="sample_slits"):
            sample_slits([3.0, width], [0.0, 9.0], [0.0, 0.0], 10, 0)
        with pytest.warns(DoubtWarning, match="sample_pattern"):
            sample_pattern(box(width, width), 10, 0)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        field_on_plane(box(1.1, 100), LIGHT, plane)
        sample_pattern(box(2.1, 2.1), 10, 0)


def test_phases_of_1e8_radians():
    """On the axis of a disc |u|^2 = (1 - z/R)^2 + 4 z/R sin^2(k (R - z) / 2): at k z = 1e8 as well as at 1e4.

    The path's difference R - z is r^2 / (R + z), where subtracting would leave 1e-8 of a wavelength.
    """
    turn = np.arange(5000) * 2 * np.pi / 5000
    unit = np.sqrt(turn[1] / np.sin(turn[1])) * np.stack([np.cos(turn), np.sin(turn)], axis=1)
    for radius, z in ((20.0, 1.6e3), (20.0, 1.6e7), (1e3, 1.6e7), (4e3, 1.6e7)):
        slant = np.hypot(radius, z)
        beyond = radius**2 / (slant + z)
        expected = np.hypot(beyond / slant, 2 * np.sqrt(z / slant) * np.sin(np.pi * beyond))
        assert abs(at([0, 0, z], radius * unit)) == pytest.approx(expected, rel=1e-12)  # measured 3e-14


def test_no_screen_and_a_closed_one():
    plane = Plane(center=[0, 0, 5.0], shape=(3, 4), pitch=1.0)
    assert np.array_equal(field_on_plane(None, TILTED, plane).values, TILTED.field(plane.points))
    assert not field_on_plane([[0, 0], [1, 1], [2, 2]], LIGHT, plane).values.any()


def test_planes():
    plane = Plane(center=[1, 2, 3], normal=[0, 0, 2], up=[0, 5, 1], shape=(3, 5), pitch=0.5)
    assert np.allclose(plane.axes, np.eye(3), atol=1e-15)
    assert np.allclose(plane.points[0, 0], [0, 1.5, 3], atol=1e-15)
    assert np.allclose(plane.points[2, 4], [2, 2.5, 3], atol=1e-15)
    tilted = Plane(normal=[1, 0, 0], up=[0, 0, 1], shape=(1, 1), pitch=1.0)
    assert np.allclose(tilted.axes, [[0, 1, 0], [0, 0, 1], [1, 0, 0]], atol=1e-15)
    assert plane == Plane.from_json(plane.canonical_json())


@pytest.mark.parametrize(
    ("call", "match"),
    [
        (lambda: at([0, 0, -1.0], box(1, 1)), "behind the screen"),
        (lambda: at([0, 0, 0.0], box(1, 1)), "behind the screen"),
        (lambda: at([0, 0, 1.0], box(1, 1), light=PointEmitter([0, 0, 0.5], 1.0)), "before the screen, at z < 0"),
        (lambda: at([0, 0, 1.0], box(1, 1), light=Given(LIGHT.field)), "a PointEmitter for method 'boundary'"),
        (lambda: at([0, 0, 1.0], box(1, 1), light=PointEmitter([0, 0, -5], 1.0), method="utd"), "for method 'utd'"),
        (lambda: at([0, 0, 1.0], box(1, 1), method="rays"), '"boundary", "spectrum"'),
        (lambda: at([0.5, 0, 0.1], box(1, 1), method="utd"), "away from every edge"),
        (lambda: at([0, 0, 1.0], box(1, 1), method="utd", polarisation="te"), 'must be one of "soft", "hard"'),
        (lambda: at([0, 0, 1.0], box(1e4, 1), method="spectrum"), "8192 waves"),
        (lambda: at([0, 0, 1.0], box(1, 1), method="spectrum", padding=0.5), "padding must be at least 1"),
        (lambda: Plane(normal=[0, 0, 0], shape=(1, 1), pitch=1.0), "longer than 0"),
        (lambda: Plane(up=[0, 0, 1], shape=(1, 1), pitch=1.0), "other than the normal's"),
        (lambda: Plane(shape=(0, 1), pitch=1.0), "at least 1"),
        (lambda: PlaneWave(wavelength=1.0, direction=[0, 0, -1]), r"towards \+z"),
        (lambda: PlaneField(np.array([[np.nan]]), 1.0, 1.0), "finite"),
        (lambda: PlaneField(np.ones((2, 2)), 0.0, 1.0), "greater than 0"),
    ],
)
def test_bad_input_is_refused(call, match):
    with pytest.raises(RuleError, match=match):
        call()


def test_tilted_planes_have_no_spectrum():
    plane = Plane(center=[0, 0, 9.0], normal=[0.1, 0, 1], shape=(2, 2), pitch=0.5)
    with pytest.raises(RuleError, match="parallel to the screen"):
        field_on_plane(box(1, 1), LIGHT, plane, "spectrum")
    assert field_on_plane(box(1, 1), LIGHT, plane).values.shape == (2, 2)
