"""Slabs of narrow lobes, whose light stays about the beam: an envelope that turns with the tilt.

Where deflections are small a slab's lobe is that of a phase screen of sigma^2 = OD and (k xi)^2 = 2 / (1 - g).
"""

from dataclasses import replace

import numpy as np
import pytest
from zscore import assert_z, refute_z

import specklegen as sg
from specklegen.error_time import Probes
from specklegen.error_time.estimates import paths_estimate
from specklegen.samplers.stationary.rule import scene_envelope, scene_object_maps, scene_stationary_error
from specklegen.synthesis.object_envelope import TOLERANCE
from specklegen.theory.phase_screens import lobes

HALF, CONCENTRATION, DEPTH = 60, 950.0, 5.0


@pytest.fixture(scope="module")
def scene():
    """A camera of half a degree behind lobes of two degrees, so that its corners are some per cent darker."""
    medium = sg.Slab(thickness=2000.0, mean_free_path=2000.0 / DEPTH, scatterer=sg.VonMisesFisher(CONCENTRATION))
    return sg.Scene(wavelength=1.0, medium=medium, illumination=sg.CollimatedBeams.tilts([0.0, 0.001], width=2000.0),
                    sensor=sg.FarField.grid((2 * HALF + 1, 2 * HALF + 1), 1 / 6000))  # fmt: skip


def darker(scene):
    """What the corner of a camera lacks of the middle's intensity, in closed form."""
    screen = sg.PhaseScreen(rms_phase=DEPTH**0.5, correlation_length=(2 * CONCENTRATION) ** 0.5 / (2 * np.pi))
    corner = np.hypot(*scene.sensor.corner_directions[0, :2])
    one, other = lobes(screen.stack, 1.0).density(np.array([corner, 0.0]))
    return 1 - one / other


def closed_form(scene, lights, views):
    """Mean intensity of lights float64[T, 2] at views float64[V, 2] over that straight ahead: float64[T, V]."""
    medium = scene.medium
    k, lobe = 2 * np.pi, (2 * medium.scatterer.concentration) ** 0.5
    terms = lobes(sg.PhaseScreen(rms_phase=medium.optical_depth**0.5, correlation_length=lobe / k).stack, 1.0)
    return np.array([terms.density(np.hypot(*(views - light).T)) for light in lights]) / terms.density(0.0)


def test_the_planner_states_how_much_the_intensities_vary_and_takes_an_envelope(scene):
    made = sg.plan(scene)
    assert (made.sampler, made.doubts) == ("stationary", ())
    (said,) = [each.reason for each in made.decisions if each.part == "stationary sampler"]
    plain, carried = (scene_stationary_error(scene, 0.02, "axial", enveloped) for enveloped in (False, True))
    assert f"intensity error {plain.intensity:.2g}" in said
    assert "on-axis approximation under an envelope" in said
    assert carried.accepts(0.02)
    assert carried.correlation == pytest.approx(plain.correlation, rel=0.05)
    # The figure is the largest over five views, of which one is the middle: it may exceed the corner's by its error.
    off, error = np.array([plain.intensity]), np.array([plain.intensity_error])
    assert_z(off, np.array([darker(scene)]), error, degrees=63, slack=0.005)
    refute_z(off, np.array([0.0]), error, degrees=63, slack=0.005)


@pytest.mark.parametrize(("tilt", "half"), [(0.001, 60), (0.02, 60), (0.03, 100)])
def test_the_envelope_is_that_of_a_screen_of_the_same_lobe(scene, tilt, half):
    def tilted(width):
        light = sg.CollimatedBeams.tilts([0.0, tilt], width=width)
        return scene.replace(illumination=light, sensor=sg.FarField.grid((2 * half + 1, 2 * half + 1), 1 / 6000))

    x = np.linspace(-half, half, 5) / 6000
    views, lights = np.stack(np.meshgrid(x, x), axis=-1).reshape(-1, 2), np.array([[0.0, 0.0], [tilt, 0.0]])
    exact = closed_form(tilted(2000.0), lights, views)
    # Windows that differ by a wavelength have pilots of their own, of 32 768 paths each.
    found = [scene_envelope(tilted(2000.0 + n), False).intensity(lights[:, None], views) / exact for n in range(4)]
    error = np.sqrt(np.var(found, axis=0, ddof=1).mean() / len(found))
    # Half a per cent for the angles beyond the paraxial ones, and for a surface of few terms.
    assert_z(np.mean(found, axis=0), np.ones_like(exact), np.full_like(exact, error), slack=0.005)
    still = np.tile(exact[:1], (2, 1))  # an envelope that stays where it is
    assert (np.abs(still / exact - 1).max() > 0.05) == (tilt > 0.01)
    assert np.ptp(exact) > 0.03


def test_tilted_beams_are_as_bright_as_their_lobe(scene):
    """Of a tilt a third as large as the lobe's rms angle, seen straight ahead."""
    light = sg.CollimatedBeams.tilts([0.0, 0.02], width=2000.0)
    wide = scene.replace(illumination=light, sensor=scene.sensor.replace(shape=(17, 17)))
    made = sg.plan(wide)
    assert made.sampler == "stationary"
    fields = sg.render(wide, realizations=1000, paths=20_000, seed=3).field
    power = np.square(np.abs(fields)).mean((-2, -1))
    x = np.linspace(-8, 8, 5) / 6000
    views = np.stack(np.meshgrid(x, x), axis=-1).reshape(-1, 2)
    one, two = closed_form(wide, np.array([[0.0, 0.0], [0.02, 0.0]]), views).mean(axis=1)
    # Beams so far apart are independent, so the ratio of means has the errors of both.
    ratio = power[:, 1].mean() / power[:, 0].mean()
    error = ratio * np.hypot(*(power.std(axis=0, ddof=1) / power.mean(axis=0))) / np.sqrt(1000)
    assert_z(ratio, two / one, error, degrees=999, slack=0.01)
    refute_z(ratio, 1.0, error, degrees=999, slack=0.01)


def test_pieces_are_the_render_and_a_stack_without_an_envelope_is_as_before(scene):
    chosen = sg.plan(scene, paths=2000).chosen
    whole = next(chosen.prepare(1, 1).media(1)).image
    parts = np.concatenate([field for _, field in chosen.prepare(1, 1).fields(0)])
    np.testing.assert_allclose(parts, whole, rtol=0, atol=1e-4 * np.abs(whole).max())
    flat = next(replace(chosen, envelope=None).prepare(1, 1).media(1)).image
    gain = np.sqrt(chosen.envelope.intensity(scene.beams.directions[1, :2], np.array([0.01, 0.01])))
    assert whole[1, -1, -1] == pytest.approx(flat[1, -1, -1] * gain, rel=1e-5)
    assert abs(gain - 1) > 0.01
    plain = sg.plan(scene, paths=2000, sampler="stationary", envelope=False)
    assert plain.doubts
    assert plain.chosen.envelope is None


def test_path_sums_have_the_envelope(scene):
    side = 2 * HALF + 1
    probes = Probes.among([(0, 0), (0, HALF * side + HALF)])
    found = np.array([paths_estimate(scene, probes, 4000, seed).value[:2].real for seed in range(64)])
    lacking = (found[:, 1] - found[:, 0]) / found[:, 1].mean()
    mean, error = lacking.mean(keepdims=True), np.array([lacking.std(ddof=1) / 8])
    assert_z(mean, np.array([darker(scene)]), error, degrees=63, slack=0.003)
    refute_z(mean, np.array([0.0]), error, degrees=63, slack=0.003)


def hidden(scene, lit, pitch=1e-3):
    """Three pixels in a row before the same camera."""
    return scene.replace(illumination=sg.IncoherentObject(brightness=[lit], pitch=pitch, width=2000.0))


def test_an_object_is_seen_under_an_envelope_by_the_planners_choice(scene):
    near = hidden(scene, [1.0, 0.0, 1.0])
    made = sg.plan(near, rel_error=0.03)
    assert (made.sampler, made.doubts) == ("stationary", ())
    assert "on-axis approximation under an envelope" in made.explain()
    assert made.chosen.maps is not None
    plain = sg.plan(near, rel_error=0.03, sampler="stationary", envelope=False)
    assert plain.doubts
    assert plain.chosen.maps is None
    few = near.replace(sensor=sg.FarField.grid((33, 33), 1 / 6000))
    assert sg.plan(few).chosen.envelope is None
    views = near.sensor.shape[0] * near.sensor.shape[1]  # maps and images under them are held of every view
    assert made.memory_bytes - plain.memory_bytes >= 16 * made.chosen.maps.count * views


def carried(scene, lit):
    """The stationary sampler of three pixels 8 mrad apart, under their envelope, whatever its rule says of them."""
    whole = hidden(scene, lit, 8e-3)
    plain = sg.plan(whole, paths=2000, sampler="stationary", envelope=False).chosen
    return replace(plain, envelope=scene_envelope(whole, False), maps=scene_object_maps(whole))


def test_maps_of_camera_and_object_make_up_the_envelope_of_each_pixel(scene):
    """In closed form, at every view."""
    made = carried(scene, [1.0, 0.5, 2.0])
    gains, polynomials = made.maps.arrays()
    x = np.linspace(-HALF, HALF, 2 * HALF + 1) / 6000
    views, lights = np.stack(np.meshgrid(x, x), axis=-1).reshape(-1, 2), made.scene.lights[:, :2]
    found = np.einsum("phw,pt->thw", gains[0], polynomials[:, 0]).reshape(3, -1)
    # One per cent of the pilot's light, as for beams, and what the polynomials leave.
    np.testing.assert_allclose(found, closed_form(scene, lights, views), rtol=0.012 + TOLERANCE)
    assert np.ptp(found, axis=0).max() > 0.05


def test_the_image_of_an_object_is_that_of_its_pixels_under_their_envelopes(scene):
    whole = carried(scene, [1.0, 0.5, 2.0])
    image = next(whole.prepare(1, 1).media(1)).image
    added, x = 0.0, np.linspace(-HALF, HALF, 2 * HALF + 1) / 6000
    views = np.stack(np.meshgrid(x, x), axis=-1)
    for lit, direction in zip(np.diag([1.0, 0.5, 2.0]), whole.scene.lights, strict=True):
        light = whole.scene.illumination.replace(brightness=[lit])
        one = replace(whole, scene=whole.scene.replace(illumination=light), envelope=None, maps=None)
        added += next(one.prepare(1, 1).media(1)).image * whole.envelope.intensity(direction[:2], views)
    np.testing.assert_allclose(image, added, rtol=0, atol=TOLERANCE * added.max())
    flat = next(replace(whole, envelope=None, maps=None).prepare(1, 1).media(1)).image
    assert np.abs(flat - added).max() > 5 * TOLERANCE * added.max()


def test_pixels_that_a_small_camera_sees_beside_their_lobe_are_judged(scene):
    """What no view of the middle pixel shows: those of outer pixels are a tenth darker everywhere."""
    small = scene.replace(sensor=scene.sensor.replace(shape=(9, 9)))
    exact = closed_form(small, np.array([[0.0, 0.0], [0.032, 0.0]]), np.zeros((1, 2)))[:, 0]
    found = scene_stationary_error(hidden(small, [1.0, 1.0, 1.0], 0.032), 0.02, "axial", glance=False)
    assert_z(found.intensity, 1 - exact[1], found.intensity_error, degrees=63, slack=0.01)
    refute_z(0.0, 1 - exact[1], found.intensity_error, degrees=63, slack=0.01)
    near = scene_stationary_error(hidden(small, [1.0, 1.0, 1.0], 1e-4), 0.02, "axial")
    assert near.intensity < 0.02
    assert sg.plan(hidden(small, [1.0, 1.0, 1.0], 1e-4)).chosen.envelope is None


def test_beams_far_from_the_lobe_of_others_are_not_as_bright():
    """What no view of one beam shows: tilted light that a small camera sees beside its lobe."""
    medium = sg.Slab(thickness=2000.0, mean_free_path=400.0, scatterer=sg.VonMisesFisher(CONCENTRATION))
    small = sg.Scene(wavelength=1.0, medium=medium, illumination=sg.CollimatedBeams.tilts([0.0, 0.05], width=2000.0),
                     sensor=sg.FarField.grid((9, 9), 1 / 6000))  # fmt: skip
    exact = closed_form(small, np.array([[0.0, 0.0], [0.025, 0.0], [0.05, 0.0]]), np.zeros((1, 2)))[:, 0]
    found = scene_stationary_error(small, 0.02, "oblique", glance=False)
    off = np.abs(exact[[0, 2]] / exact[1] - 1).max()  # over the middle of both beams
    assert_z(found.intensity, off, found.intensity_error, degrees=63, slack=0.01)
    refute_z(0.0, off, found.intensity_error, degrees=63, slack=0.01)
