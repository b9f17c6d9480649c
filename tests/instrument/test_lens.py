"""What a lens makes of the far field: judged by points on the plane in focus, closed forms, Rayleigh and Sommerfeld."""

import re
from dataclasses import replace

import numpy as np
import pytest
from references.rayleigh_sommerfeld import propagated_field
from scipy.special import erfc, j1

import specklegen as sg
from specklegen.core.statistics import jackknife
from specklegen.instrument.lens import Lens
from specklegen.paths.endpoint_factors import multiple_amplitudes, single_amplitudes
from specklegen.paths.layout import scene_layout
from specklegen.paths.lit_plane import lens_of, lit_plane
from specklegen.paths.tracer import slab_tracer, volume_tracer
from specklegen.samplers.path_sums.direct import direct_field
from tests.refusals import assert_refused
from tests.zscore import assert_mean, assert_z, refute_mean, refute_z

K = 2 * np.pi  # of the wavelength 1
FORWARD = sg.Slab(thickness=40.0, mean_free_path=20.0, scatterer=sg.HenyeyGreenstein(0.9))
ABERRATED = sg.Pupil(stop=0.4, zernike=[0.0, 0.1, 0.0, 0.2, 0.1])


def scene(medium=FORWARD, light=None, width=40.0, tilts=(0.0,), **camera):
    light = light or sg.CollimatedBeams.tilts(list(tilts), width=width)
    sensor = sg.Imaging(**{"shape": (24, 20), "pitch": 1.0, "aperture": 0.2} | camera)
    return sg.Scene(wavelength=1.0, medium=medium, illumination=light, sensor=sensor)


def lens(seen, views):
    return Lens(seen, seen.sensor, seen.sensor.pupil_grid(views))


def grid(side, step):
    return (np.arange(side) - (side - 1) / 2) * step


def rms(field):
    return np.sqrt(np.mean(np.square(np.abs(field))))


@pytest.mark.slow
@pytest.mark.parametrize("pupil", [pytest.param(sg.Pupil(), marks=pytest.mark.slow), ABERRATED])
def test_points_on_the_plane_in_focus_see_the_same_field_through_the_pupil(pupil):
    """The same connections at points of the near field, path by path, their field filtered by the pupil. Of isotropic
    particles without attenuation, whose spherical waves are sums of plane ones (Weyl) at any distance. The plane ends
    softly where waves come in at sines over .5, which the pupil takes no more: 1e-8 are left."""
    isotropic = sg.Slab(thickness=30.0, mean_free_path=15.0, scatterer=sg.Isotropic())
    seen = scene(isotropic, width=20.0, tilts=(0.0, 0.01), aperture=0.15, pitch=1.6, focus=60.0, pupil=pupil)
    through = lens_of(seen)
    bank = slab_tracer(through.pupil_scene, False).trace(1, 300)
    bank = bank.select(np.hypot(*bank.exit[:, :2].T) < 25)
    assert bank.orders.max() > 2
    clear = seen.replace(medium=isotropic.replace(mean_free_path=1e9))
    phases = np.exp(2j * np.pi * np.random.default_rng(0).random(len(bank)))

    def far(focus):
        camera = seen.sensor.replace(focus=focus)
        other = Lens(clear.replace(sensor=camera), camera, through.grid)
        field = direct_field(scene_layout(other.pupil_scene), bank, (phases, None))
        return other.image(field.reshape(2, *through.grid.shape))

    axis = grid(500, 0.85)
    points = np.stack([*np.meshgrid(axis, axis), np.full((500, 500), 90.0)], -1)
    # A connection's own phase, which directions leave out: that of the way along the axis.
    own = phases * np.exp(-1j * K * (90.0 - bank.exit[:, 2]))
    near = direct_field(scene_layout(clear.replace(sensor=sg.NearField(points))), bank, (own, None))
    near = near.reshape(2, 500, 500) * 0.5 * erfc((np.hypot(axis, axis[:, None]) - 130) / 22)

    def waves(places, sines):
        return np.exp(1j * K * np.outer(places, sines))

    (x, y), (columns, rows) = through.grid.sines, seen.sensor.positions
    plane_waves = 0.85**2 * waves(axis, y).conj().T @ near @ waves(axis, x).conj()
    filtered = plane_waves * through.pupil * through.grid.pitch**2
    expected = waves(rows, y) @ filtered @ waves(columns, x).T / 1j  # e^ikr / r is i / lambda times the sum of waves
    assert rms(far(60.0) - expected) < 1e-6 * rms(expected)
    assert rms(far(60.0 * 1.001) - expected) > 1e-3 * rms(expected)


@pytest.mark.parametrize("side", ["transmission", "reflection"])
def test_before_a_box_the_lens_sums_its_directions_at_their_places(side):
    """The same connections, by rings of directions (Gauss and Legendre) and absolute phases at points of the plane.

    The box begins 25 before z = 0, so that neither of its faces is where phases start.
    """
    box = sg.media.Box(lower=[-15, -15, -25], upper=[15, 15, 10], mean_free_path=20.0, scatterer=sg.Isotropic())
    seen = scene(box, width=20.0, tilts=(0.0, 0.02), shape=(7, 6), pitch=1.5, aperture=0.15, focus=30.0, side=side)
    through = lens_of(seen)
    tracer = volume_tracer(through.pupil_scene, False)
    bank = tracer.trace(1, 200, threads=1)
    phases = np.exp(2j * np.pi * np.random.default_rng(0).random(len(bank)))
    found = through.image(direct_field(tracer.layout, bank, (phases, None)).reshape(2, *through.grid.shape))
    nodes, weights = np.polynomial.legendre.leggauss(40)
    sines, turns = 0.15 * np.sqrt((nodes + 1) / 2), 2 * np.pi * np.arange(80) / 80
    sign = 1.0 if side == "transmission" else -1.0
    cosines = np.sqrt(1 - np.square(sines))
    views = np.stack([np.outer(sines, np.cos(turns)), np.outer(sines, np.sin(turns)),
                      np.repeat(sign * cosines[:, None], 80, axis=1)], axis=-1).reshape(-1, 3)  # fmt: skip
    share = np.repeat(weights * np.pi * 0.15**2 / 2 / cosines, 80) / 80
    far = direct_field(tracer.layout.of_views(views), bank, (phases, None)) * share

    def at_plane(z):
        x, y = np.meshgrid(*seen.sensor.positions)
        points = np.stack([x.ravel(), y.ravel(), np.full(x.size, z)], axis=-1)
        return (far @ np.exp(1j * K * views @ points.T)).reshape(2, 7, 6) * np.exp(-1j * K * sign * z)

    expected = at_plane(40.0 if side == "transmission" else -55.0)
    assert np.abs(found - expected).max() < 0.01 * np.abs(expected).max()
    assert np.abs(found - at_plane(15.0 if side == "transmission" else -30.0)).max() > 0.05 * np.abs(expected).max()


def fields_of(through, count=1, seed=0):
    parts = np.random.default_rng(seed).standard_normal((2, count, *through.grid.shape))
    return parts[0] + 1j * parts[1]


@pytest.mark.parametrize("medium", [FORWARD, FORWARD.replace(faces=sg.Faces(inside=1.5))])
@pytest.mark.parametrize("side", ["transmission", "reflection"])
def test_the_power_on_the_plane_is_that_of_the_directions(medium, side):
    """Over one period sum |E|^2 dx^2 is the integral of |P u|^2 / (cos cos_out); to NA^2 / 4 that per steradian."""
    seen = scene(medium, shape=(84, 84), aperture=0.03, pitch=41 / 0.06 / 84, focus=-300.0, pupil=ABERRATED, side=side)
    through = lens(seen, 41)
    far = fields_of(through)
    x, y = through.grid.sines
    square, index = np.square(x) + np.square(y)[:, None], medium.faces.inside
    power = np.square(np.abs(far * through.pupil)).sum(0) * through.grid.pitch**2
    on_plane = np.square(np.abs(through.image(far))).sum() * seen.sensor.pitch**2
    both = np.sqrt((1 - square) * (1 - index**2 * square))
    assert on_plane == pytest.approx((power / both).sum(), rel=1e-10)
    assert on_plane == pytest.approx((power / np.sqrt(1 - square)).sum(), rel=1e-3)


@pytest.mark.parametrize("index", [1.0, 1.4])
def test_clear_light_shows_its_window_moved_by_its_slope(index):
    """A Gaussian window e^(-4 r^2 / W^2), e^(-OD/2) high, moved by L tan(inside) and f tan(outside)."""
    medium = FORWARD.replace(faces=sg.Faces(inside=index))
    light = sg.CollimatedBeams.tilts([0.0, 0.12], width=60.0, profile="gaussian")
    seen = scene(medium, light, shape=(1, 301), pitch=0.5, aperture=0.3, focus=30.0)
    for tilt, image in zip((0.0, 0.12), sg.mean_field(seen), strict=True):
        sine = np.sin(tilt)
        aside = 40 * np.tan(tilt) + 30 * np.tan(np.arcsin(index * sine))
        x, _ = seen.sensor.positions
        glass = 4 * index / (1 + index) ** 2 if not tilt else None
        power = np.square(np.abs(image[0]))
        assert (power @ x) / power.sum() == pytest.approx(aside, abs=0.1)
        # Diffraction spreads a waist of 30 by z / z_R = 70 / 2830: 3e-4 of the intensity.
        shape = np.exp(-4 * np.square(x - aside) / 60**2)
        np.testing.assert_allclose(np.sqrt(power / power.max()), shape, atol=3e-3)
        if glass:
            assert power.max() == pytest.approx(np.exp(-2.0) * glass**2, rel=2e-3)


@pytest.mark.parametrize("focus", [-25.0, 0.0, 40.0])
def test_the_grain_is_that_of_the_pupil_and_the_contrast_one(focus):
    """|C|^2 = [2 J1(z) / z]^2, z = k NA x, 0 at .61 lambda / NA, by fields that are equally bright over the pupil."""
    through = lens(scene(shape=(48, 48), pitch=0.61 / 0.2 / 4, focus=focus), 121)
    batches = []
    for n in range(16):
        image = through.image(fields_of(through, 4, n))
        power = np.square(np.abs(image))
        lags = [np.mean(image[..., s:] * image[..., : image.shape[-1] - s].conj()).real for s in range(7)]
        batches.append([*(np.array(lags[1:]) / power.mean()), power.mean() ** -2 * np.square(power).mean() - 1])
    z = K * 0.61 / 4 * np.arange(1, 7)
    assert abs(2 * j1(z[3]) / z[3]) < 2e-3
    expected = [*(2 * j1(z) / z), 1.0]
    assert_mean(np.array(batches), expected, slack=2e-3)  # of cells in the place of a disc
    smaller = 2 * j1(0.9 * z) / (0.9 * z)
    refute_mean(np.array(batches)[:, :6], smaller, slack=2e-3)


def test_a_point_at_depth_in_focus_and_five_rayleigh_lengths_off():
    """One scatterer 20 below the face: its image in focus, carried on by the integral of Rayleigh and Sommerfeld. A
    pupil of waist .06, of which 3.3 waists are seen, makes a spot whose Rayleigh length is 1 / (pi .06^2) = 88."""
    seen = scene(FORWARD.replace(mean_free_path=1e9), aperture=0.2, focus=-20.0, shape=(64, 64), pitch=1.2,
                 pupil=sg.Pupil(waist=0.3))  # fmt: skip
    through, off = lens(seen, 161), 5 / (np.pi * 0.06**2)
    x, y = through.grid.sines
    cosine = np.sqrt(1 - np.square(x) - np.square(y)[:, None])
    place = np.array([1.5, -2.0, 20.0])
    far = np.exp(-1j * K * (x * place[0] + y[:, None] * place[1] + (cosine - 1) * place[2]))
    spot = through.image(far[None])[0]
    columns, rows = seen.sensor.positions
    brightest = np.unravel_index(np.abs(spot).argmax(), spot.shape)
    assert (columns[brightest[1]], rows[brightest[0]]) == pytest.approx((1.5, -2.0), abs=0.6)
    beyond = seen.sensor.replace(focus=-20.0 + off, shape=(3, 4), pitch=1.0)
    image = replace(through, camera=beyond, scene=seen.replace(sensor=beyond)).image(far[None])[0]
    xs, ys = np.meshgrid(*beyond.positions)
    points = np.stack([xs.ravel(), ys.ravel(), np.full(xs.size, off)], -1)
    expected = propagated_field(spot, columns, rows, points).reshape(xs.shape) * np.exp(-1j * K * off)
    np.testing.assert_allclose(image, expected, atol=1e-3 * np.abs(expected).max())
    assert np.abs(spot).max() / np.abs(image).max() == pytest.approx(np.sqrt(1 + 5**2), rel=0.02)


def test_the_lit_plane_grows_with_the_focus_and_wrapping_around_is_refused():
    near, far = (lit_plane(scene(focus=focus)) for focus in (0.0, 100.0))
    assert far.extent - near.extent == pytest.approx(2 * 100 * np.tan(np.arcsin(0.2)), rel=0.1)
    with pytest.raises(sg.RuleError, match=r"Imaging\.views") as error:
        sg.plan(scene(views=5), paths=100)
    least = int(re.search(r"at least (\d+)", str(error.value))[1])
    plan = sg.plan(scene(views=least), paths=100)
    assert plan.lens.grid.shape == (least, least) == sg.plan(scene(), paths=100).lens.grid.shape
    assert plan.lens.period >= near.extent


@pytest.mark.parametrize("focus", [-20.0, pytest.param(30.0, marks=pytest.mark.slow)])
def test_path_sums_show_speckle_of_contrast_one_at_any_focus(focus):
    """<I^2> / <I>^2 - 2, by the paths that a pixel is made of: as the plan says, within its noise and half of it."""
    seen = scene(width=40.0, shape=(12, 12), pitch=1.25, focus=focus)
    made = sg.plan(seen, paths=4000)
    power = sg.render(seen, paths=4000, realizations=48, seed=3, threads=1).intensity[:, 0]
    excess = np.square(power).mean(axis=(1, 2)) / power.mean() ** 2 - 2
    stated = made.gaussianity.kurtosis_excess
    assert 0 < stated < 0.3
    assert_mean(excess, stated, slack=0.6 * stated + 0.02)


def test_the_stationary_sampler_draws_the_middle_of_a_wide_window_alone():
    wide = sg.Slab(thickness=20.0, mean_free_path=4.0, scatterer=sg.Isotropic())
    seen = scene(wide, width=600.0, aperture=0.05, pitch=4.0, shape=(24, 24))
    made = sg.plan(seen, paths=2000, reverse=False, realizations=12)  # of one so few paths are summed as quickly
    assert made.sampler == "stationary"
    drawn, summed = (
        sg.render(seen, paths=2000, sampler=name, reverse=False, realizations=12, seed=5, threads=1).intensity
        for name in ("stationary", "paths")
    )
    drawn, summed = drawn.mean(axis=(1, 2, 3)), summed.mean(axis=(1, 2, 3))
    error = np.hypot(drawn.std(ddof=1), summed.std(ddof=1)) / np.sqrt(12)
    assert_z(drawn.mean(), summed.mean(), error, degrees=11, slack=made.expected_error * summed.mean())
    larger = seen.replace(sensor=seen.sensor.replace(shape=(24, 140)))
    assert sg.plan(larger, paths=2000, reverse=False).sampler == "paths"
    with pytest.raises(sg.RuleError, match="sampler") as error:
        sg.plan(larger, paths=2000, sampler="stationary", reverse=False)
    width = float(re.search(r"at least ([0-9.]+) wide", str(error.value))[1])
    light = larger.illumination.replace(width=1.01 * width)
    wider = larger.replace(illumination=light)
    assert sg.plan(wider, paths=2000, sampler="stationary", reverse=False).sampler == "stationary"


def test_images_of_an_object_are_those_of_its_beams_added_up():
    brightness = np.array([[1.0, 0.0], [0.5, 2.0]])
    hidden = sg.IncoherentObject(brightness=brightness, pitch=2e-3, width=40.0)
    one = sg.render(scene(light=hidden), paths=500, seed=2, threads=1).intensity
    beams = sg.render(scene(light=hidden.beams), paths=500, seed=2, threads=1).intensity
    np.testing.assert_allclose(one, np.tensordot([1.0, 0.5, 2.0], beams, axes=1), rtol=1e-4)


@pytest.mark.parametrize(("field", "camera"), [
    ("Imaging.focus", {"focus": 1e70}), ("Imaging.views", {"focus": 1e12}), ("Imaging.views", {"views": 10**7}),
    ("Imaging.shape", {"shape": (10**9, 10**9)}), ("Imaging.pitch", {"magnification": 1e-250}),
])  # fmt: skip
def test_what_no_machine_holds_is_refused_by_name(field, camera):
    assert_refused(lambda: sg.plan(scene(**camera), paths=100), field)


JOINT = sg.Slab(thickness=100.0, mean_free_path=20.0, scatterer=sg.VonMisesFisher((K * 4.0) ** 2 / 2))
TILT = 13.1 / (K * 100.0)
SHIFTS = 100.0 * TILT * np.array([0.0, 0.25, 0.5, 0.75, 1.0])


def joint_parts(width, paths):
    """Sums over the pupil of images' overlaps, of a bank's every connection: float64[20, 2 + shifts], power first.
    Directions are a tilt apart, so that an image under the tilt, less the beam's own, is the other's next column. The
    random phases of connections are averaged exactly."""
    count = int(0.8 / np.sin(TILT))
    seen = scene(JOINT, width=width, tilts=(0.0, TILT), shape=(8, 8), pitch=0.5, aperture=count * np.sin(TILT) / 2)
    through = Lens(seen, seen.sensor, seen.sensor.pupil_grid(count))
    tracer, (x, _) = slab_tracer(through.pupil_scene, False), through.grid.sines
    weights, turns = through.weights()[..., None], np.exp(1j * K * np.outer(x[:-1], SHIFTS))
    batches = []
    for n in range(20):
        bank = tracer.trace(5, paths // 20, first=n * (paths // 20), threads=1)
        total = np.zeros(2 + len(SHIFTS), complex)
        for start in range(0, len(bank), 200):
            part = bank.select(np.arange(start, min(start + 200, len(bank))))
            often = multiple_amplitudes(tracer.layout, part.multiple, bidirectional=False, reverse=False)
            fields = np.concatenate([single_amplitudes(tracer.layout, part.single), often], axis=1)
            one, other = fields.reshape(2, count, count, -1) * weights
            total[:2] += np.square(np.abs(one)).sum(), np.square(np.abs(other)).sum()
            total[2:] += (one[:, :-1].conj() * other[:, 1:]).sum((0, 2)) @ turns
        batches.append(total)
    return np.array(batches)


def overlap(total):
    return np.abs(total[2:]) / np.sqrt((total[0] * total[1]).real)


def test_an_image_moves_with_the_tilt_as_the_joint_correlation_says():
    """|C| of images under a tilt delta = 13.1 / (k L), shifted by 0 to L delta: .65 .82 .89 .83 .66. Of a window so
    wide that both beams light the same particles: in one of 20 they would not, and lose .02."""
    found, error = jackknife(joint_parts(4000.0, 3000), overlap)
    expected = sg.joint_correlation(JOINT, wavelength=1.0, tilts=[TILT], shifts=SHIFTS, paths=100_000, seed=0)
    error = np.hypot(error, expected.standard_error[0])
    assert_z(found, expected.magnitude[0], error, degrees=19, slack=0.005)
    assert expected.magnitude[0] == pytest.approx([0.652, 0.820, 0.890, 0.831, 0.664], abs=0.005)
    refute_z(found, np.full(5, expected.magnitude[0, 0]), error, degrees=19, slack=0.005)  # an image that stands still
