"""Focused light: judged by closed forms, the integral of Rayleigh and Sommerfeld, power, and single scattering."""

import re

import numpy as np
import pytest
from references.rayleigh_sommerfeld import propagated_field
from scipy.special import j0, j1

import specklegen as sg
from specklegen.paths.endpoint_factors import contributions
from specklegen.paths.far_field import overlap
from specklegen.paths.focused_light import entrance_factors, focus_loss
from specklegen.paths.pilot import scene_pilot
from specklegen.paths.tracer import slab_tracer
from specklegen.theory.focused_light import gaussian_focus
from tests.refusals import assert_refused
from tests.zscore import assert_mean

# Tilts of an aperture are far apart beside the lobe of FORWARD, and few paths are enough for what is asked here.
pytestmark = pytest.mark.filterwarnings("ignore::specklegen.DoubtWarning")

K = 2 * np.pi  # of the wavelength 1
FORWARD = sg.Slab(thickness=40.0, mean_free_path=20.0, scatterer=sg.HenyeyGreenstein(0.9))
GRID = sg.FarField.grid((12, 12), 5e-3)
WAIST = 3.0
SHARP = (K * WAIST) ** 2 / 2


def scene(light=None, medium=FORWARD, sensor=GRID, **focus):
    light = light or sg.FocusedBeams(**{"points": [[0.0, 0.0, 20.0]], "aperture": 0.1} | focus)
    return sg.Scene(wavelength=1.0, medium=medium, illumination=light, sensor=sensor)


def rms(field):
    return np.sqrt(np.mean(np.square(np.abs(field))))


def some_places(count, focus, width, depths):
    rng = np.random.default_rng(0)
    return np.column_stack([focus[:2] + rng.uniform(-width, width, (count, 2)), rng.uniform(*depths, count)])


def quadrature(places, focus, sharpness=0.0, direction=(0.0, 0.0, 1.0)):
    """The integral over directions of e^(kappa (i_z - 1) + m (i . w - 1) + ik i . (x - p)), by nodes, times 1/2 pi."""
    t, weights = np.polynomial.legendre.leggauss(400)
    low = 1 - 40 / SHARP
    cosine = low + (t + 1) / 2 * (1 - low)
    turns = np.arange(160) * K / 160
    sine = np.sqrt(1 - np.square(cosine))[:, None]
    rays = np.stack([sine * np.cos(turns), sine * np.sin(turns), cosine[:, None] + 0 * turns], -1)
    power = np.exp(SHARP * (cosine - 1))[:, None] * np.exp(sharpness * (rays @ np.asarray(direction) - 1))
    power = power * (weights * (1 - low) / 2)[:, None] / 160
    return np.array([(power * np.exp(1j * K * rays @ (x - focus))).sum() for x in places])


@pytest.mark.parametrize("sharpness", [0.0, 90.0])
def test_the_closed_form_is_the_sum_of_plane_waves(sharpness):
    """Of a beam, and of what a lobe at each place makes of it; in units of the field in focus."""
    focus, direction = np.array([1.0, 2.0, 30.0]), np.array([0.28, 0.0, 0.96])
    places = some_places(12, focus, 4.0, (0.0, 60.0))
    told = {"direction": np.tile(direction, (12, 1)), "sharpness": sharpness} if sharpness else {}
    found = gaussian_focus(places, focus, WAIST, 1.0, **told) * np.exp(1j * K * (places[:, 2] - focus[2]))
    expected = quadrature(places, focus, sharpness, direction)
    peak = gaussian_focus(focus[None], focus, WAIST, 1.0)[0] / quadrature(focus[None], focus)[0]
    np.testing.assert_allclose(found / peak, expected, atol=1e-9 * np.abs(expected).max())


def test_gaussian_beams_are_the_closed_form():
    """Everywhere about the cone, to 1e-6 of the peak; another waist is told."""
    focus = np.array([1.5, -2.0, 30.0])
    light = sg.FocusedBeams([focus], waist=WAIST, aperture=0.45)  # three divergences leave e^-9 outside
    places = some_places(60, focus, 5.0, (0.0, 60.0))
    found = light.field(places, 1.0)[0]
    expected = gaussian_focus(places, focus, WAIST, 1.0)
    assert rms(found - expected) < 1e-6 * np.abs(expected).max()
    assert rms(found - gaussian_focus(places, focus, 1.001 * WAIST, 1.0)) > 1e-5 * np.abs(expected).max()


def test_an_evenly_lit_lens_makes_an_airy_disc_of_unit_power():
    light = sg.FocusedBeams([[3.0, -1.0, 0.0]], aperture=0.05, width=800.0)
    radius = np.linspace(0, 40, 41)
    places = np.column_stack([3.0 + radius * 0.6, -1.0 + radius * 0.8, 0 * radius])
    found = light.field(places, 1.0)[0]
    z = 2 * np.pi * 0.05 * np.maximum(radius, 1e-9)
    peak = np.sqrt(np.pi) * 0.05
    np.testing.assert_allclose(found, peak * 2 * j1(z) / z, atol=7e-3 * peak)  # cells for a disc


@pytest.mark.parametrize(("depth", "error"), [(0.0, 1e-10), (25.0, 2e-3)])
def test_the_power_through_any_plane_is_one(depth, error):
    """By a sum over all of the window, as the beams overlap at its middle; |E|^2 cos is the flux, cos >= .995."""
    light = sg.FocusedBeams([[0.0, 0.0, 25.0]], aperture=0.1, pupil=sg.Pupil(waist=0.4, zernike=[0.0, 0.0, 0.0, 0.1]))
    side, count = light.side(1.0), 96
    axis = (np.arange(count) - (count - 1) / 2) * side / count
    x, y = np.meshgrid(axis, axis)
    field = light.field(np.column_stack([x.ravel(), y.ravel(), np.full(count**2, depth)]), 1.0)
    _, cosines, amplitudes = light._modes(1.0)
    expected = (np.square(np.abs(amplitudes)) / cosines).sum() * side**2
    assert expected == pytest.approx(1.0, abs=1e-3)
    assert np.square(np.abs(field)).sum() * (side / count) ** 2 == pytest.approx(expected, rel=error)


def test_a_focus_at_depth_is_where_rayleigh_and_sommerfeld_put_it():
    """The field on the face, of an aberrated lens, carried into the medium by their integral."""
    light = sg.FocusedBeams([[1.0, -2.0, 20.0]], aperture=0.25, pupil=sg.Pupil(waist=0.3, zernike=[0, 0, 0, 0.1, 0.1]))
    side, count = light.side(1.0), 150
    axis = (np.arange(count) - (count - 1) / 2) * side / count
    x, y = np.meshgrid(axis, axis)
    face = light.field(np.column_stack([x.ravel(), y.ravel(), 0 * x.ravel()]), 1.0).reshape(x.shape)
    places = some_places(12, np.array([1.0, -2.0]), 4.0, (15.0, 60.0))
    expected = propagated_field(face, axis, axis, places) * np.exp(-1j * K * places[:, 2])
    found = light.field(places, 1.0)[0]
    np.testing.assert_allclose(found, expected, atol=1e-4 * np.abs(expected).max())
    deeper = light.replace(points=[[1.0, -2.0, 21.0]]).field(places, 1.0)[0]
    assert np.abs(deeper - expected).max() > 5e-3 * np.abs(expected).max()


def test_entrances_of_paths_see_the_closed_form_of_a_first_scattering():
    """Two routes on one bank: sums of collimated beams, and the closed form with the lobe's m w added to c; 1e-6."""
    concentration = 60.0
    medium = sg.Slab(thickness=40.0, mean_free_path=20.0, scatterer=sg.VonMisesFisher(concentration))
    focus = np.array([1.0, -1.0, 20.0])
    seen = scene(sg.FocusedBeams([focus], waist=WAIST, aperture=0.45), medium)
    lit = seen.replace(illumination=seen.beams)
    tracer = slab_tracer(lit, False)
    bank = tracer.trace(1, 4000).multiple
    bank = bank.select(np.hypot(*(bank.entry[:, :2] - focus[:2]).T) < 8)
    assert len(bank) > 30
    clear = tracer.layout.volume._replace(extinction=np.array([1e-12]))
    found = entrance_factors(type(tracer.layout)(**{**vars(tracer.layout), "volume": clear}), bank,
                             seen.illumination.amplitudes(1.0))[0]  # fmt: skip
    lobe = np.sqrt(concentration / (2 * np.pi * -np.expm1(-2 * concentration)))
    told = {"direction": bank.entry_direction, "sharpness": concentration / 2}
    expected = lobe * gaussian_focus(bank.entry, focus, WAIST, 1.0, **told)
    assert rms(found - expected) < 1e-6 * rms(expected)
    wrong = lobe * gaussian_focus(bank.entry, focus, WAIST, 1.0, **told | {"sharpness": 0.51 * concentration})
    assert rms(found - wrong) > 1e-4 * rms(expected)


def test_all_light_that_scatters_is_what_does_not_cross():
    """E[W |A|^2] over first collisions is 1 - e^-OD of the unit power, at every focus (cos > .995)."""
    seen = scene(points=[[0.0, 0.0, 5.0], [4.0, 2.0, 30.0]], aperture=0.1)
    lit = seen.replace(illumination=seen.beams)
    tracer, batches = slab_tracer(lit, False), []
    amplitudes = seen.illumination.amplitudes(1.0)
    for n in range(12):
        bank = tracer.trace(n, 1500).single
        power = np.square(np.abs(entrance_factors(tracer.layout, bank, amplitudes))) * bank.weight
        batches.append(power.sum(axis=1) / 1500)
    assert_mean(np.array(batches), 1 - np.exp(-2.0), slack=2e-3)


def test_rendered_fields_are_sums_of_the_beams_fields():
    seen = scene(points=[[0.0, 0.0, 20.0], [3.0, 0.0, 0.0]])
    found = sg.render(seen, paths=300, seed=3, threads=1)
    beams = sg.render(seen.replace(illumination=seen.beams), sampler="paths", paths=300, seed=3, threads=1).field
    expected = np.tensordot(seen.illumination.amplitudes(1.0), beams, axes=1)
    assert found.field.shape == (2, 12, 12)
    assert rms(found.field - expected) < 1e-5 * rms(expected)
    mean = [sg.render(seen, paths=300, seed=3, mean=mean, threads=1).field for mean in (True, False)]
    np.testing.assert_allclose(mean[0] - mean[1], sg.mean_field(seen), atol=1e-5 * np.abs(mean[0]).max())


def test_columns_of_a_transmission_matrix_are_focal_points_and_rows_pixels():
    camera = sg.Imaging(shape=(6, 5), pitch=1.0, aperture=0.2, focus=-10.0)
    seen = scene(sensor=camera, points=[[0.0, 0.0, 20.0], [3.0, 0.0, 20.0], [0.0, 3.0, 20.0]])
    from specklegen.coherence import transmission_matrix

    matrix = transmission_matrix(seen, paths=300, seed=1, threads=1)
    assert matrix.value.shape == (30, 3)
    fields = sg.render(seen, paths=300, seed=1, threads=1).field
    np.testing.assert_array_equal(matrix.value, fields.reshape(3, 30).T)
    both = transmission_matrix(seen, np.array([[1.0], [1j], [0.0]]), paths=300, seed=1, threads=1).value
    np.testing.assert_allclose(both[:, 0], fields[0].ravel() + 1j * fields[1].ravel(), rtol=1e-5)


def test_clear_light_through_a_lens_shows_the_focus():
    """The mean on the plane in focus, by its far field, is the field there: e^(-OD/2) of the closed form."""
    camera = sg.Imaging(shape=(9, 9), pitch=0.7, aperture=0.34, focus=-10.0)
    seen = scene(sg.FocusedBeams([[0.0, 0.0, 30.0]], waist=WAIST), sensor=camera)
    image = sg.mean_field(seen)[0]
    x, y = np.meshgrid(*camera.positions)
    places = np.column_stack([x.ravel(), y.ravel(), np.full(x.size, 30.0)])
    expected = np.exp(-1.0) * np.abs(gaussian_focus(places, np.array([0.0, 0.0, 30.0]), WAIST, 1.0)).reshape(x.shape)
    np.testing.assert_allclose(np.abs(image), expected, atol=0.02 * expected.max())


@pytest.mark.slow
def test_a_confocal_scan_sees_what_scatters_in_focus():
    """Power at the pixels that light is focused on, scattered once: sigma_s / 4 pi int |U|^2 |h|^2 e^(-2 sigma z). By
    the mean over phases of one bank, h the image of a point by the same lens; the integral by nodes of the closed form,
    which the lens' image of a point is too, times the root of the solid angle that it takes."""
    depth, thickness, sigma = 10.0, 20.0, 0.01
    medium = sg.Slab(thickness=thickness, mean_free_path=1 / sigma, scatterer=sg.Isotropic())
    camera = sg.Imaging(shape=(3, 3), pitch=0.7, aperture=0.35, focus=-depth, side="reflection",
                        pupil=sg.Pupil(waist=1 / (np.pi * WAIST) / 0.35))  # fmt: skip
    x, y = np.meshgrid(*camera.positions)
    foci = np.column_stack([x.ravel(), y.ravel(), np.full(9, depth)])
    seen = scene(sg.FocusedBeams(foci, waist=WAIST), medium, camera)
    made = sg.plan(seen, paths=100, reverse=False)
    tracer, batches = made.chosen.tracer, []
    sines = made.lens.grid.sines
    weights = made.lens.weights().ravel()
    grid = made.lens.grid.directions.reshape(-1, 3)
    waves = weights[:, None] * np.exp(1j * K * grid[:, :2] @ foci[:, :2].T)
    kept = np.abs(weights) > 1e-9 * np.abs(weights).max()
    for n in range(12):
        bank = tracer.trace(n, 600).single
        near = np.hypot(*bank.entry[:, :2].T) < 10
        bank = bank.select(near)
        light = entrance_factors(tracer.layout, bank, seen.illumination.amplitudes(1.0))
        views = grid[kept]
        far = np.exp(-1j * K * (views - [0, 0, -1]) @ bank.exit.T - sigma / 2 * bank.exit[:, 2] / np.abs(views[:, 2:]))
        images = waves[kept].T @ far
        batches.append((bank.weight * np.square(np.abs(light * images))).sum() / 9 / 600 / (4 * np.pi))
    assert len(sines[0]) == made.lens.grid.shape[0]
    places, cells = _nodes(depth, thickness)
    lit = np.square(np.abs(gaussian_focus(places, np.array([0.0, 0.0, depth]), WAIST, 1.0)))
    # h of a Gaussian pupil of amplitude 1 on its axis: (lambda / waist) / sqrt(2 pi) of the root of its solid angle
    taken = np.pi / 2 / (np.pi * WAIST) ** 2
    expected = sigma / (4 * np.pi) * (cells * lit**2 * np.exp(-2 * sigma * places[:, 2])).sum() * taken
    assert_mean(np.array(batches), expected, slack=0.02 * expected)


def _nodes(depth, thickness):
    """Places and volumes of cells about a beam along z."""
    radius = (np.arange(60) + 0.5) * 0.25
    z = (np.arange(100) + 0.5) * thickness / 100
    rings, depths = (each.ravel() for each in np.meshgrid(radius, z))
    return np.column_stack([rings, 0 * rings, depths]), 2 * np.pi * rings * 0.25 * thickness / 100


def test_the_speckle_of_a_focus_is_as_gaussian_as_the_plan_says():
    seen = scene(sensor=sg.FarField.grid((3, 3), 5e-3))
    made = sg.plan(seen, paths=1500)
    power = sg.render(seen, paths=1500, realizations=60, seed=3, threads=1).intensity[:, 0]
    excess = np.square(power).mean(axis=(1, 2)) / power.mean() ** 2 - 2
    stated = made.gaussianity.kurtosis_excess
    assert stated > 0
    assert_mean(excess, stated, slack=0.5 * stated)


@pytest.mark.parametrize(("field", "light", "passing"), [
    ("FocusedBeams.aperture must be given", {"aperture": None}, None),
    ("FocusedBeams.points", {"points": [[0.0, 0.0]]}, None),
    ("FocusedBeams.width", {"width": 1.0}, lambda at: {"width": float(at)}),
    ("FocusedBeams.waist", {"aperture": None, "waist": 0.5}, lambda at: {"aperture": None, "waist": 1.01 * float(at)}),
    ("FocusedBeams.points", {"points": [[0.0, 0.0, 1e9]]}, None),
])  # fmt: skip
def test_what_no_light_does_is_refused_with_what_would_pass(field, light, passing):
    with pytest.raises(sg.RuleError, match=re.escape(field)) as error:
        scene(**light)
    if passing:
        number = re.search(r"(?:at least|above) ([0-9.]+)", str(error.value))[1]
        scene(**light | passing(1.001 * float(number)))


@pytest.mark.parametrize(("g", "wide"), [(0.98, 0.2), (0.95, 0.1), (0.9, 0.45)])
def test_cones_too_wide_for_narrow_lobes_are_refused_with_one_that_passes(g, wide):
    """Beside g .98 beams up to .1 keep their angles; beside g .9 wider ones have their own, and lose little by it."""
    medium = FORWARD.replace(scatterer=sg.HenyeyGreenstein(g))
    with pytest.raises(sg.RuleError, match=r"FocusedBeams\.aperture must be at most") as error:
        sg.plan(scene(medium=medium, aperture=wide, sensor=sg.FarField.grid((3, 3), 5e-4)), paths=100)
    passing = float(re.search(r"at most ([0-9.]+)", str(error.value))[1])
    assert passing > 0.07
    made = sg.plan(scene(medium=medium, aperture=passing, sensor=sg.FarField.grid((3, 3), 5e-4)), paths=100)
    assert not any("lobe" in doubt for doubt in made.doubts)
    assert (made.chosen.tracer.layout.middle is not None) == (passing < 0.1)


def test_the_light_that_a_focus_loses_to_lobes_is_what_pairs_of_beams_lose():
    """By the beams themselves, two by two, in place of transforms; all light of it lost is lost to any cone."""
    seen = scene(aperture=0.06, sensor=sg.FarField.grid((1, 1), 5e-4))
    lit = seen.replace(illumination=seen.beams)
    pilot = scene_pilot(lit, False)
    bank, (view,) = pilot.bank, pilot.tracer.layout.views.vectors
    weights = contributions(pilot.tracer.layout.at(np.array([0.0, 0.0, 1.0]), view), bank)
    sines = lit.beams.directions[:, :2]
    own = np.abs(seen.illumination.amplitudes(1.0)[0])
    apart = np.hypot(*np.moveaxis(sines[:, None] - sines, -1, 0))
    ways, many = np.hypot(*(bank.exit - bank.entry)[:, :2].T), bank.orders > 1
    distances, which = np.unique(np.round(apart, 9), return_inverse=True)
    kept = np.array([weights[many] @ j0(K * t * ways[many]) for t in distances])
    lost = np.maximum(kept, 0) * [1 - overlap(FORWARD.scatterer, t) ** 2 for t in distances]
    pairs = np.bincount(which.ravel(), np.outer(own, own).ravel())
    expected = (pairs @ lost) / (pairs @ (kept + weights[~many].sum()))
    assert focus_loss(seen, False) == pytest.approx(expected, rel=0.03)  # lines between 33 distances
    assert focus_loss(seen, False, 0.5) < 0.7 * expected


def test_what_serves_no_focus_is_refused_by_name():
    seen = scene()
    for refused in (
        lambda: sg.plan(seen, sampler="stationary"), lambda: sg.covariance(seen, paths=100),
        lambda: sg.render(seen, sampler="covariance", paths=100), lambda: sg.render_tiles(seen, paths=100),
    ):  # fmt: skip
        assert_refused(refused, r"focus|Focus")
    glass = FORWARD.replace(faces=sg.Faces(inside=1.5))
    assert_refused(lambda: scene(medium=glass, aperture=0.7), r"FocusedBeams\.aperture must be below 0\.6667")
    screen = sg.PhaseScreen(correlation_length=10.0, rms_phase=3.0)
    assert_refused(lambda: scene(medium=screen), r"Scene\.illumination")
