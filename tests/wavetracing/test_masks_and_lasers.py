"""Masks as arrays, lasers, screens at any tilt, and light that leaves a slab on its way to an aperture."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from scipy.special import erf
from scipy.stats import chi2
from wavetracing.screens import OUTLINE, screen, slit
from zscore import FALSE_ALARM, assert_z

import specklegen as sg
from specklegen.core.errors import RuleError
from specklegen.wavetracing import (
    GaussianBeam,
    GaussianLaser,
    Geometry,
    Mask,
    Plane,
    PlaneWave,
    PointEmitter,
    WaveSum,
    aperture_transform,
    field_on_plane,
    light_behind,
    perforated_screen,
    trace,
)

K = 2 * np.pi
AHEAD = np.array([0, 0, 1.0])
LIGHTS = [
    PlaneWave(wavelength=1.0, direction=[0.2, 0.1, np.sqrt(0.95)]),
    PointEmitter([1.0, -2, -30], 1.0),
    GaussianLaser([0.5, 0, -40], AHEAD, 6.0, 1.0, power=2.0),
]
WAVES = WaveSum(directions=[[0.6, 0, 0.8], [-0.28, 0, 0.96], AHEAD], amplitudes=[1.0, 0.5j, -2.0], wavelength=1.0)


def pixels(mask):
    """Loops of all pixels of a mask, and their values."""
    rows, columns = mask.values.shape
    x, y = (np.arange(n) - (n - 1) / 2 for n in (columns, rows))
    square = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) / 2
    for row in range(rows):
        for column in range(columns):
            yield mask.center + mask.pitch * (square + [x[column], y[row]]), mask.values[row, column]


def relative(found, exact):
    return np.linalg.norm(found - exact) / np.linalg.norm(exact)


class TestMask:
    rng = np.random.default_rng(1)
    MASK = Mask(values=rng.normal(size=(3, 2)) + 1j * rng.normal(size=(3, 2)), pitch=3.0, center=[1.0, -0.5])

    @pytest.mark.parametrize("light", LIGHTS[:2])
    def test_is_the_sum_of_its_pixels(self, light):
        """Each pixel an opening by its rim, exactly; a mask of other values is noticed."""
        plane = Plane(center=[0.3, 0.2, 20.0], shape=(24, 20), pitch=1.0, up=[0.6, 0.8, 0.0])
        exact = sum(value * field_on_plane(loop, light, plane).values for loop, value in pixels(self.MASK))
        found = field_on_plane(self.MASK, light, plane, "spectrum", padding=4.0).values
        assert relative(found, exact) < 1e-3
        grey = self.MASK.replace(values=np.abs(self.MASK.values))
        assert relative(field_on_plane(grey, light, plane, "spectrum", padding=4.0).values, exact) > 0.1

    def test_far_away(self):
        plane = Plane(center=[200.0, 0, 3e4], shape=(6, 8), pitch=900.0)
        exact = sum(
            value * field_on_plane(loop, LIGHTS[0], plane, "fraunhofer").values for loop, value in pixels(self.MASK)
        )
        phase = field_on_plane(self.MASK, LIGHTS[0], plane, "fraunhofer").values / exact
        # Distances are taken from the middle of the mask, and of each pixel: r^2 / 2z of phase.
        assert np.abs(phase - 1).max() < 0.01

    def test_refused(self):
        plane = Plane(center=[0, 0, 20.0], shape=(2, 2), pitch=1.0)
        with pytest.raises(RuleError, match="'spectrum' or 'fraunhofer'"):
            field_on_plane(self.MASK, LIGHTS[0], plane)
        for values, problem in ((np.zeros((2, 2)), "not 0 everywhere"), (np.ones(3), r"of shape \(h, w\)")):
            with pytest.raises(RuleError, match=problem):
                Mask(values=values, pitch=1.0)
        with pytest.raises(RuleError, match="resolved by"):
            field_on_plane(Mask(values=np.ones((99, 99)), pitch=9.0), LIGHTS[0], plane, "spectrum")


class TestTilt:
    HOLE = np.array([[-4, -3], [5, -3], [5, 4], [-2, 6.0]])

    @pytest.mark.parametrize("light", [*LIGHTS, WAVES])
    def test_a_scene_turned_as_a_whole_has_the_same_field(self, light):
        """Screen, light and plane turned and moved together; the screen alone is another one."""
        turn, shift = Rotation.from_euler("xyz", [0.4, 0.5, 1.0]).as_matrix(), np.array([2.0, -1.0, 3.0])
        plane = Plane(center=[1.0, 2.0, 25.0], shape=(5, 4), pitch=2.0)
        moved = plane.replace(center=turn @ plane.center + shift, normal=turn @ plane.normal, up=turn @ plane.up)
        method = "fraunhofer" if isinstance(light, GaussianLaser | WaveSum) else "boundary"
        if isinstance(light, PlaneWave):
            direction = turn @ light.direction
            amplitude = np.exp(-1j * K * (direction @ shift))
            other = light.replace(direction=direction, amplitude=complex(amplitude))
        elif isinstance(light, PointEmitter):
            other = light.replace(position=turn @ light.position + shift)
        elif isinstance(light, WaveSum):
            directions = light.directions @ turn.T
            amplitudes = light.amplitudes * np.exp(-1j * K * (directions @ shift))
            other = light.replace(directions=directions, amplitudes=amplitudes)
        else:
            other = light.replace(position=turn @ light.position + shift, direction=turn @ light.direction)
        exact = field_on_plane(self.HOLE, light, plane, method).values
        found = field_on_plane(self.HOLE, other, moved, method, shift=shift, rotation=turn).values
        assert relative(found, exact) < 1e-9
        straight = field_on_plane(self.HOLE, other, moved, method, shift=shift).values
        assert relative(straight, exact) > 0.05

    def test_refused(self):
        plane = Plane(center=[0, 0, 20.0], shape=(2, 2), pitch=1.0)
        with pytest.raises(RuleError, match="proper rotation"):
            field_on_plane(self.HOLE, LIGHTS[0], plane, rotation=2 * np.eye(3))
        with pytest.raises(RuleError, match="from behind"):
            field_on_plane(self.HOLE, LIGHTS[0], plane, rotation=np.diag([1.0, -1, -1]))
        with pytest.raises(RuleError, match="from behind"):
            field_on_plane(self.HOLE, LIGHTS[2], plane, "fraunhofer", rotation=np.diag([1.0, -1, -1]))
        with pytest.raises(RuleError, match="before the screen"):
            field_on_plane(self.HOLE, LIGHTS[1], plane, "fraunhofer", shift=[0, 0, -40.0])
        with pytest.raises(RuleError, match="parallel to the screen"):
            field_on_plane(self.HOLE, LIGHTS[0], plane, "spectrum", rotation=Rotation.from_euler("x", 0.1).as_matrix())


class TestLaser:
    def test_its_field_is_its_power(self):
        laser = GaussianLaser([0, 0, 0], AHEAD, 8.0, 1.0, power=3.0)
        plane = Plane(center=[0, 0, 50.0], shape=(80, 80), pitch=1.0)
        assert field_on_plane(None, laser, plane).power == pytest.approx(3, rel=1e-4)

    @pytest.mark.parametrize(("angle", "turn"), [(0.0, np.eye(3)), (0.8, Rotation.random(random_state=2).as_matrix())])
    def test_through_a_slit(self, angle, turn):
        """A waist of 8 before a slit of 10: power by the error function, pattern by the transform of its own field.

        Along the axis, and at 46 degrees to a screen aslant.
        """
        waist, width, beams = 8.0, 10.0, 40_000
        z, half = 1e6, 0.2
        local = np.array([np.sin(angle), 0, np.cos(angle)])
        light = turn @ local
        plane = Plane(center=z * light, normal=light, up=turn[:, 1], shape=(80, 80), pitch=2 * half * z / 80)
        laser = GaussianLaser(turn @ ([2.0, 0, 0] - 10 * local), light, waist, 1.0)
        hole = perforated_screen(OUTLINE, [slit(0, width, 400.0)]).placed(rotation=turn)
        found = trace(Geometry(hole), laser, plane, beams, 1)
        low, high = (np.sqrt(2) / waist * np.cos(angle) * (side - 2.0) for side in (-width / 2, width / 2))
        share = (erf(high) - erf(low)) / 2
        passed = found.statistics.open / beams
        assert_z(passed, share, np.sqrt(share * (1 - share) / beams))
        assert found.statistics.gaussian == found.statistics.open
        counts = found.irradiance[0].sum(axis=0) * plane.pitch**2 * beams
        x = (np.arange(400) + 0.5) / 400 * width - width / 2
        aside = np.arctan((np.arange(80 * 8) + 0.5) / (80 * 8) * 2 * half - half)
        sines = np.sin(angle + aside)
        per_pixel = np.cos(angle + aside) * np.cos(aside) ** 2  # wavevectors in it
        for assumed, seen in ((waist, False), (0.7 * waist, True)):
            field = np.exp(-((x - 2.0) ** 2) * np.cos(angle) ** 2 / assumed**2 + 1j * K * np.sin(angle) * x)
            power = np.abs(np.exp(-1j * K * np.outer(sines, x)) @ field) ** 2 * per_pixel
            expected = power.reshape(80, 8).sum(axis=1)
            expected *= counts.sum() / expected.sum()
            use = expected > 20
            value = ((counts - expected)[use] ** 2 / expected[use]).sum()
            assert (value > chi2.isf(FALSE_ALARM, use.sum() - 1)) == seen

    def test_rays_are_its_profile(self):
        found = trace(
            screen(slit(0, 10.0, 400.0)), GaussianLaser([2.0, 0, -10], AHEAD, 8.0, 1.0),
            Plane(center=[0, 0, 5.0], shape=(1, 1), pitch=10.0), 20_000, 1, mode="ray",
        )  # fmt: skip
        share = (erf(np.sqrt(2) / 8 * 3) + erf(np.sqrt(2) / 8 * 7)) / 2
        assert_z(1 - found.ledger.absorbed / 20_000, share, np.sqrt(share * (1 - share) / 20_000))

    def test_refused(self):
        laser, plane = GaussianLaser([0, 0, -10], AHEAD, 8.0, 1.0), Plane(center=[0, 0, 5.0], shape=(1, 1), pitch=1.0)
        with pytest.raises(RuleError, match="even light"):
            trace(screen(slit(0)), laser, plane, 10, 1, amplitude="uniform")
        with pytest.raises(RuleError, match="above 0.48"):
            GaussianLaser([0, 0, -10], AHEAD, 0.4, 1.0)


class TestBehind:
    def test_a_beam_comes_back_from_its_far_field(self):
        """f = (k / 2 pi i) cos(theta) Psi of a Gaussian: its field in the waist, and further on near the axis."""
        waist, views = 10.0, sg.FarField.grid((41, 41), 1 / 128)
        xi = K * views.directions[..., :2]
        psi = np.pi * waist**2 * np.exp(-np.square(xi).sum(axis=-1) * waist**2 / 4)
        light = light_behind(K / 2j / np.pi * views.directions[..., 2] * psi, views, 1.0)
        x = np.linspace(-20, 20, 9)
        assert np.abs(light.field(np.stack([x, 0 * x, 0 * x], axis=1)) - np.exp(-(x**2) / waist**2)).max() < 1e-6
        beam = GaussianBeam([0, 0, 0], AHEAD, waist**2 / 2 * np.eye(2), 1.0)
        points = np.stack([x, 0 * x + 3, 0 * x + 100], axis=1)
        exact = beam.field(points) / np.abs(beam.field([[0.0, 0, 0]]))
        assert relative(light.field(points), exact) < 0.01

    def test_an_aperture_between_slab_and_camera(self):
        """Speckle of the engine through a square on its way: sum_m a_m Psi(k s - k s_m), and another grain."""
        slab = sg.Slab(thickness=20.0, mean_free_path=10.0, scatterer=sg.HenyeyGreenstein(g=0.5))
        views = sg.FarField.grid((17, 17), 0.5 / 40)
        scene = sg.Scene(
            wavelength=0.5, medium=slab, illumination=sg.CollimatedBeams.tilts([0.0], width=20.0), sensor=views
        )
        speckle = sg.transmission_matrix(scene, paths=300, seed=1).value[:, 0]
        light, square = light_behind(speckle, views, 0.5), np.array([[-2, -3], [2, -3], [2, 3], [-2, 3.0]])
        camera = Plane(center=[0, 0, 2e4], shape=(3, 4), pitch=300.0)
        found = field_on_plane(square, light, camera, "fraunhofer").values.ravel()
        rays = camera.points.reshape(-1, 3)
        r = np.linalg.norm(rays, axis=1)
        k = K / 0.5
        xi = k * (rays[:, None, :2] / r[:, None, None] - light.directions[:, :2])
        psi = aperture_transform(square, xi) @ light.amplitudes
        exact = k / 2j / np.pi * np.exp(1j * k * r) / r * (rays[:, 2] / r) * psi
        assert relative(found, exact) < 1e-7

    def test_power(self):
        """What views hold flows through a window of the period's size."""
        views, rng = sg.FarField.grid((5, 5), 0.05), np.random.default_rng(2)
        values = rng.normal(size=25) + 1j * rng.normal(size=25)
        light = light_behind(values, views, 1.0)
        flux = (np.abs(light.amplitudes) ** 2 * light.directions[:, 2]).sum() * 20.0**2
        solid = 0.05**2 / light.directions[:, 2]
        assert flux == pytest.approx((np.abs(values) ** 2 * solid).sum())

    def test_refused(self):
        views = sg.FarField.grid((3, 3), 0.1)
        with pytest.raises(RuleError, match="one for each of 9 views"):
            light_behind(np.ones(8), views, 1.0)
        with pytest.raises(RuleError, match="towards"):
            light_behind(np.ones(9), sg.FarField.grid((3, 3), 0.1, side="reflection"), 1.0)
        with pytest.raises(RuleError, match="one for each of"):
            WaveSum(directions=views.directions.reshape(-1, 3), amplitudes=np.ones(8), wavelength=1.0)
        with pytest.raises(RuleError, match="one at least"):
            WaveSum(directions=np.empty((0, 3)), amplitudes=np.empty(0), wavelength=1.0)
