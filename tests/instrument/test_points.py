"""Points behind refracting faces, and far points by the stationary sampler: sums over directions."""

import re
import warnings

import numpy as np
import pytest
from scipy.optimize import brentq

import specklegen as sg
from specklegen.instrument.lens import Points
from specklegen.paths.lit_plane import lens_of
from specklegen.paths.tracer import slab_tracer, volume_tracer
from specklegen.samplers.path_sums.direct import direct_field
from tests.refusals import assert_refused
from tests.zscore import assert_z, refute_z

THIN = sg.Slab(thickness=20.0, mean_free_path=10.0, scatterer=sg.media.HenyeyGreenstein(0.7))
GLASS = THIN.replace(faces=sg.media.Faces(inside=1.4))
BEAM = sg.light.CollimatedBeams.tilts([0.0, 0.01], width=20.0)
POINTS = sg.sensors.NearField([[0.0, 0.0, 1e4], [400.0, -300.0, 1e4], [0.0, 600.0, 12000.3]])
MIDDLE = sg.sensors.NearField([[0.0, 0.0, 1e4], [60.0, -30.0, 1e4], [0.0, 60.0, 1.2e4]])


def scene(medium=GLASS, sensor=POINTS, light=BEAM):
    return sg.Scene(wavelength=1.0, medium=medium, illumination=light, sensor=sensor)


@pytest.mark.parametrize("index", [1.4, 1 / 1.2])
def test_every_connection_arrives_along_its_refracted_ray(index):
    """Field of each connection: of its Snell ray the power in a tube, its phase differences, and no other index's.

    |E|^2 cos_out dA = |u|^2 dOmega, over rays from the last particle; the phase is k times the optical path.
    """
    through = lens_of(scene(THIN.replace(faces=sg.media.Faces(inside=index))))
    tracer = slab_tracer(through.pupil_scene, False)
    bank = tracer.trace(1, 400, threads=1)
    bank = bank.select(np.flatnonzero((bank.bounces[:, 1] == 0) & (np.hypot(*bank.exit[:, :2].T) < 15))[:12])
    assert len(bank) == 12
    ones = np.ones(1, complex)

    def expected(refracting):
        out = np.empty((12, 3), complex)
        for n in range(12):
            place = bank.exit[n]
            for m, point in enumerate(POINTS.points):
                aside, gap, way = point[:2] - place[:2], 20.0 - place[2], point[2] - 20.0
                far = np.hypot(*aside)

                def reached(sine, gap=gap, way=way):
                    outside = refracting * sine
                    return gap * sine / np.sqrt(1 - sine**2) + way * outside / np.sqrt(1 - outside**2)

                sine = brentq(lambda s, far=far: reached(s) - far, 0, 0.999 * min(1, 1 / refracting), xtol=1e-15)
                inside, outside = np.sqrt(1 - sine**2), np.sqrt(1 - (refracting * sine) ** 2)
                slope = (reached(sine * (1 + 1e-5) + 1e-7) - far) / (sine * 1e-5 + 1e-7)
                stretch = far / sine if sine > 1e-9 else slope
                view = np.append(aside / max(far, 1e-12) * sine, inside)
                ray = sg.sensors.FarField(view[None])
                seen = through.scene.replace(sensor=ray)
                far_field = direct_field(slab_tracer(seen, False).layout, bank.select([n]), (ones, None))[0, 0]
                power = np.square(np.abs(far_field)) / (inside * outside * stretch * slope)
                length = gap / inside - 20 + way / outside / refracting
                out[n, m] = np.sqrt(power) * np.exp(2j * np.pi * length)
        return out

    found = np.stack([
        through.image(direct_field(tracer.layout, bank.select([n]), (ones, None)).reshape(2, *through.grid.shape))[0]
        for n in range(12)
    ])  # fmt: skip
    right, other = expected(index), expected(index * 1.03)
    np.testing.assert_allclose(np.abs(found), np.abs(right), rtol=0.02)
    turned, wrong = (found[:, 1:] * found[:, :1].conj() * (each[:, 1:] * each[:, :1].conj()).conj()
                     for each in (right, other))  # fmt: skip
    assert np.abs(np.angle(turned)).max() < 0.1
    assert np.abs(np.angle(wrong)).max() > 0.5


UPPER = sg.media.Layer(thickness=20.0, mean_free_path=10.0, scatterer=THIN.scatterer, index=1.5)
TWO = sg.Layers([UPPER, UPPER.replace(thickness=30.0, mean_free_path=30.0, index=1.2)])


def test_every_connection_crosses_layers_along_its_refracted_ray():
    """Field of each connection that leaves without an echo: power in a tube of rays, and optical path.

    Neither that of layers of one index nor that of layers in the other order.
    """
    points = np.array([[0.0, 0.0, 350.0], [40.0, -25.0, 350.0], [0.0, 50.0, 380.3]])
    camera = sg.sensors.Imaging(shape=(1, 1), pitch=0.5, aperture=0.3)
    seen_by = scene(TWO, camera, BEAM.of(np.arange(1)))
    through = Points(seen_by, camera, camera.pupil_grid(200), sg.sensors.NearField(points))
    tracer = slab_tracer(through.pupil_scene, False)
    bank, axis = tracer.trace(1, 400, threads=1), np.array([0.0, 0.0, 1.0])
    ways, tops = tracer.layout.ways.views, np.array([0.0, 20.0])
    within = np.maximum(np.array([20.0, 50.0]) - np.maximum(bank.exit[:, 2:], tops), 0)  # of each layer, to the face
    straight = within @ (1 / np.array([1.5, 1.2]))
    direct = np.isclose(ways.lateral_ways(axis, bank.bounces[:, 1], bank.exit[:, 2]), straight)
    chosen = np.flatnonzero(direct & (np.hypot(*bank.exit[:, :2].T) < 15))[:5]
    bank, within = bank.select(chosen), within[chosen]
    assert (within[:, 0] > 0).sum() > 0
    ones = np.ones(1, complex)

    def expected(indices):
        out = np.empty((5, 3), complex)
        for n, place in enumerate(bank.exit):
            for m, point in enumerate(points):
                lengths, inverse = np.append(within[n], point[2] - 50.0), 1 / np.array([*indices, 1.0])
                far = np.hypot(*(point[:2] - place[:2]))

                def reached(sine, lengths=lengths, inverse=inverse):
                    return float((lengths * sine * inverse / np.sqrt(1 - (sine * inverse) ** 2)).sum())

                sine = brentq(lambda s, far=far: reached(s) - far, 0, 0.999, xtol=1e-15)
                slope = (reached(sine * (1 + 1e-5) + 1e-7) - far) / (sine * 1e-5 + 1e-7)
                view = np.append((point[:2] - place[:2]) / far * sine, np.sqrt(1 - sine**2))
                seen = tracer.layout.at(BEAM.directions[0], view[None])
                power = np.square(np.abs(direct_field(seen, bank.select([n]), (ones, None))[0, 0]))
                power /= (1 - sine**2) * far / sine * slope
                length = (lengths / inverse / np.sqrt(1 - (sine * inverse) ** 2)).sum()
                length -= (within[n] / inverse[:2]).sum()
                out[n, m] = np.sqrt(power) * np.exp(2j * np.pi * length)
        return out

    found = np.stack([
        through.image(direct_field(tracer.layout, bank.select([n]), (ones, None)).reshape(1, *through.grid.shape))[0]
        for n in range(5)
    ])  # fmt: skip
    right = expected((1.5, 1.2))
    np.testing.assert_allclose(np.abs(found), np.abs(right), rtol=0.03)
    turned = found[:, 1:] * found[:, :1].conj()
    off = [np.abs(np.angle(turned * (each[:, 1:] * each[:, :1].conj()).conj())).max()
           for each in (right, expected((1.0, 1.0)), expected((1.2, 1.5)))]  # fmt: skip
    assert off[0] < 0.1
    assert min(off[1:]) > 0.3


def test_unscattered_light_leaves_layers_where_its_ray_does():
    """Middle of the light of a tilted beam on the exit face, as a lens sees it."""
    sine = 0.2
    light = sg.light.CollimatedBeams(directions=[[sine, 0.0, np.sqrt(1 - sine**2)]], width=12.0)
    camera = sg.sensors.Imaging(shape=(24, 48), pitch=0.8, aperture=0.3)
    power = np.square(np.abs(sg.statistics.mean_field(scene(TWO, camera, light))[0]))
    x = (np.arange(48) - 23.5) * 0.8
    inside = sine / np.array([1.5, 1.2])
    expected = (np.array([20.0, 30.0]) * inside / np.sqrt(1 - inside**2)).sum()
    assert power.sum(axis=0) @ x / power.sum() == pytest.approx(expected, abs=0.3)
    assert abs(50.0 * sine / np.sqrt(1 - sine**2) - expected) > 1.5  # of layers without a step


def test_without_faces_they_are_spherical_waves_of_the_last_particles():
    """Each connection's fields at three points at two depths, under two tilts, but for one phase of its own."""
    through = lens_of(scene(THIN))
    far, near = slab_tracer(through.pupil_scene, False), volume_tracer(scene(THIN), False)
    bank = far.trace(1, 400, threads=1)
    bank = bank.select(np.flatnonzero(np.hypot(*bank.exit[:, :2].T) < 15)[:12])
    ratios = np.empty((12, 2, 3), complex)
    for n in range(12):
        one, phase = bank.select([n]), (np.ones(1, complex), None)
        pupil = direct_field(far.layout, one, phase).reshape(2, *through.grid.shape)
        ratios[n] = through.image(pupil) / direct_field(near.layout, one, phase).reshape(2, 3)
    np.testing.assert_allclose(ratios / ratios[:, :1, :1], 1, atol=0.01)
    np.testing.assert_allclose(np.abs(ratios), 1, atol=0.003)


def test_without_a_step_they_see_what_points_see():
    """Mean intensities and correlations of a slab whose index is next to that outside, beside sums at the points."""
    near_one = THIN.replace(faces=sg.media.Faces(inside=1 + 1e-9))

    def measured(medium, seed):
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", sg.DoubtWarning)  # few paths
            field = sg.render(scene(medium, MIDDLE), paths=200, realizations=150, seed=seed, threads=1).field
        power = np.square(np.abs(field)).reshape(150, -1)
        shared = field[:, 0] * field[:, 1].conj()
        return np.column_stack([power, shared.real, shared.imag])

    found, expected = measured(near_one, 1), measured(THIN, 2)
    error = np.hypot(found.std(axis=0, ddof=1), expected.std(axis=0, ddof=1)) / 150**0.5
    assert_z(found.mean(axis=0), expected.mean(axis=0), error, degrees=149)
    refute_z(2 * found.mean(axis=0), expected.mean(axis=0), error, degrees=149)


@pytest.mark.parametrize(("message", "make"), [
    (r"NearField\.points must be at least .* behind the face",
     lambda: sg.plan(scene(sensor=sg.sensors.NearField([[0.0, 0.0, 21.0]])), paths=100)),
    (r"NearField\.points must be all on one side", lambda: scene(sensor=sg.sensors.NearField([[0.0, 0.0, 10.0]]))),
    (r"Scene\.sensor must be in the far field for this function",
     lambda: sg.statistics.covariance(scene(), paths=64)),
])  # fmt: skip
def test_refused(message, make):
    assert_refused(make, message)


def test_the_distance_that_the_error_names_passes():
    """And is no more than twice too far."""

    def at(behind):
        return sg.plan(scene(sensor=sg.sensors.NearField([[0.0, 0.0, 20.0 + behind]])), paths=100)

    with pytest.raises(sg.RuleError) as refused:
        at(1.0)
    named = float(re.search(r"at least (\S+) behind", str(refused.value))[1])
    assert at(named).lens is not None
    assert_refused(lambda: at(named / 2), "behind the face")


LETTER = np.zeros((6, 6), complex)
LETTER[1:5, 2] = LETTER[4, 2:6] = 1.0
LETTER[2, 5] = 1j


@pytest.mark.slow
def test_the_stationary_sampler_draws_far_points_as_path_sums_do():
    """Mean intensities of two objects and products of both at lags, at points 40 000 wavelengths away in two planes."""
    second = np.roll(LETTER, 1, 1) * np.exp(0.3j * np.arange(6))
    light = sg.light.CoherentObject(np.stack([LETTER, second]), 40.0)
    x = np.arange(12) * 20.0 - 110.0
    points = np.stack([*np.meshgrid(x, x), np.full((12, 12), 4e4)], axis=-1)
    points[6:, :, 2] = 4.1e4
    seen = scene(THIN.replace(thickness=60.0), sg.sensors.NearField(points), light)

    def measured(**budget):
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", sg.DoubtWarning)  # few paths
            fields = sg.render(seen, reverse=False, **budget).field
        power = np.square(np.abs(fields)).mean(axis=(2, 3))
        shared = [(fields[:, 0, :, s:] * fields[:, 1, :, : 12 - s].conj()).mean(axis=(1, 2)) for s in (0, 1, 2)]
        values = np.column_stack([power, *(each.real for each in shared), *(each.imag for each in shared)])
        return values.mean(axis=0), values.std(axis=0, ddof=1) / len(fields) ** 0.5

    (fast, spread), (slow, error) = measured(sampler="stationary", realizations=900, seed=1), measured(
        sampler="paths", paths=300, realizations=400, seed=2)  # fmt: skip
    limit, off = 0.02 * np.repeat([1.0, 0.5], [2, 6]), np.hypot(spread, error) / fast[0]
    assert_z(slow / fast[0], fast / fast[0], off, degrees=399, slack=limit)
    swapped = fast * np.repeat([1.0, -1.0], [5, 3])  # a conjugate
    refute_z(slow / fast[0], swapped / fast[0], off, degrees=399, slack=limit)
