"""Coherent objects as light of a scene: the field on the face, single waves, sums over beams, plans and refusals."""

import warnings

import numpy as np
import pytest
from references.rayleigh_sommerfeld import propagated_field

import specklegen as sg
from specklegen.light import CoherentObject
from tests.refusals import assert_refused
from tests.zscore import assert_mean, assert_z, refute_mean, refute_z

# Few correlation lengths are lit here, which the planner says.
pytestmark = pytest.mark.filterwarnings("ignore:screens:specklegen.DoubtWarning")

K = 2 * np.pi  # of the wavelength 1
THICK = sg.Slab(thickness=200.0, mean_free_path=20.0, scatterer=sg.media.HenyeyGreenstein(0.8))
LETTER = np.zeros((6, 8), complex)
LETTER[1:5, 2] = LETTER[4, 2:6] = 1.0
LETTER[2, 5] = 1j


def scene(light, medium=THICK, shape=(12, 12), **camera):
    pitch = camera.pop("pitch", 0.4 / light.side(1.0))
    return sg.Scene(wavelength=1.0, medium=medium, illumination=light,
                    sensor=sg.sensors.FarField.grid(shape, pitch, **camera))  # fmt: skip


def face(light, places):
    """The field on the entrance face at places float64[P, 2], of the first object."""
    sines, cosines = light.modes(1.0).directions[:, :2], light.modes(1.0).directions[:, 2]
    return (light.amplitudes(1.0)[0] / np.sqrt(cosines)) @ np.exp(1j * K * sines @ places.T)


def centres(light):
    x, y = light._axes()
    return np.stack(np.broadcast_arrays(x, y), axis=-1).reshape(-1, 2)


def test_the_field_of_the_front_plane_is_that_of_the_pixels():
    """At their centres, exactly; dark beside them; under a beam times its profile and curvature, e^(+ikx)."""
    light = CoherentObject(LETTER, 10.0)
    places = centres(light)
    np.testing.assert_allclose(face(light, places), LETTER.ravel(), atol=1e-12)
    assert np.abs(face(light, places + [0.0, 50.0])[-8:]).max() < 1e-12  # below the last row
    lit = CoherentObject(LETTER, 10.0, waist=60.0, focus=900.0)
    radius = np.square(places).sum(axis=1)
    profile = np.exp(-radius / 60.0**2 - 0.5j * K * radius / 900.0)
    np.testing.assert_allclose(face(lit, places), LETTER.ravel() * profile, atol=1e-12)
    assert np.abs(face(lit, places) - LETTER.ravel() * profile.conj()).max() > 0.1


def test_distance_is_what_rayleigh_and_sommerfeld_say():
    light = CoherentObject(LETTER, 4.0, width=64.0)
    count, width = 100, 64.0
    axis = (np.arange(count) + 0.5) / count * width - width / 2
    x, y = np.meshgrid(axis, axis)
    front = face(light, np.stack([x.ravel(), y.ravel()], axis=-1)).reshape(x.shape)
    places = np.random.default_rng(0).uniform(-8, 8, (12, 2))
    far = propagated_field(front, axis, axis, np.column_stack([places, np.full(12, 40.0)])) * np.exp(-1j * K * 40.0)
    found = face(light.replace(distance=40.0), places)
    assert np.abs(found - far).max() < 0.02 * np.abs(front).max()
    assert np.abs(found - far.conj()).max() > 0.2 * np.abs(front).max()


def test_one_plane_wave_is_that_beam_exactly():
    """An even field that fills the window is the collimated beam, bit for bit."""
    light = CoherentObject(np.ones((6, 6)), 20.0, width=120.0)
    beam = sg.light.CollimatedBeams.tilts([0.0], width=120.0)
    np.testing.assert_array_equal(light.modes(1.0).directions, beam.directions)
    one, two = (sg.render(scene(light).replace(illumination=each), paths=300, sampler="paths", seed=2, threads=1)
                for each in (light, beam))  # fmt: skip
    np.testing.assert_allclose(one.field, two.field, rtol=1e-6)


@pytest.mark.parametrize("step", [(1, 0), (-2, 1)])
def test_one_sample_of_the_angular_spectrum_is_that_plane_wave(step):
    """A ramp of whole turns over the window is one tilted beam, and the field behind a slab is the beam's."""
    x, y = np.meshgrid(np.arange(6) - 2.5, np.arange(6) - 2.5)
    light = CoherentObject(np.exp(1j * K * (step[0] * x + step[1] * y) / 6), 20.0, width=120.0)
    sines = np.array(step) / 120.0
    np.testing.assert_allclose(light.modes(1.0).directions[:, :2], sines[None], atol=1e-15)
    cosine = np.sqrt(1 - sines @ sines)
    np.testing.assert_allclose(light.amplitudes(1.0), [[np.sqrt(cosine)]], rtol=1e-12)
    beam = sg.light.CollimatedBeams(directions=[[*sines, cosine]], width=120.0)
    one, two = (sg.render(scene(light).replace(illumination=each), paths=300, sampler="paths", seed=2, threads=1)
                for each in (light, beam))  # fmt: skip
    np.testing.assert_allclose(one.field, two.field * np.sqrt(cosine), rtol=1e-5)


@pytest.mark.parametrize("medium", [
    sg.GroundGlass(angle=0.05), sg.PhaseScreen(rms_phase=2.0, correlation_length=300.0)
])  # fmt: skip
def test_infinite_memory_is_a_convolution_of_fields(medium):
    """Behind one screen u(v) is the sum of amplitudes times the field of an even object at v - s; not of intensities.

    Of Gaussian fields, and of drawn phases.
    """
    letter = np.zeros((8, 8), complex)
    letter[1:7, 2] = letter[6, 2:6] = 1.0
    letter[2, 5] = 1j
    light = CoherentObject(np.stack([letter, np.ones((8, 8))]), 400.0, width=3200.0)
    seen = scene(light, medium, (48, 48), pitch=0.5 / 3200.0)
    assert ("phases drawn on" in sg.plan(seen).explain()) == (medium.stack.correlation_lengths[0] == 300)
    shown, even = sg.render(seen, seed=1, mean=True).field
    sines, amplitudes = light.spectrum(1.0)
    found = np.zeros((32, 32), complex)
    for row, down in enumerate(np.rint(sines * 3200).astype(int)):
        for column, along in enumerate(np.rint(sines * 3200).astype(int)):
            part = even[8 - 2 * down : 40 - 2 * down, 8 - 2 * along : 40 - 2 * along]
            found += amplitudes[0, row, column] * part
    expected = shown[8:40, 8:40]
    assert np.abs(found - expected).max() < 2e-3 * np.abs(expected).max()
    assert np.abs(found.conj() - expected).max() > 0.1 * np.abs(expected).max()


def test_one_pixel_is_its_diffraction_pattern():
    """Behind next to nothing: a square of sines as wide as the pixel's band, A / lambda in amplitude, in phase."""
    pixel = np.zeros((1, 1)) + 1.0
    light = CoherentObject(pixel, 10.0, width=150.0)
    clear = sg.Slab(thickness=1e-3, mean_free_path=1e9, scatterer=sg.media.Isotropic())
    seen = scene(light, clear, (15, 15), pitch=1 / 150.0)  # at its plane waves
    mean = sg.statistics.mean_field(seen)[0]
    obliquity = np.sqrt(seen.grid.directions[..., 2])
    np.testing.assert_allclose(mean, 100.0 * obliquity, rtol=2e-2)


def test_rendered_fields_are_sums_over_a_transmission_matrix():
    """By path sums: T a, of the same beams, paths and seed."""
    light = CoherentObject(np.stack([LETTER, LETTER[::-1]]), 20.0, distance=100.0, aperture=0.015, width=200.0)
    with pytest.warns(sg.DoubtWarning, match="does not resolve pixels"):
        seen = scene(light)
    field = sg.render(seen, sampler="paths", paths=300, seed=3, threads=1).field
    beams = seen.replace(illumination=seen.beams)
    matrix = sg.statistics.transmission_matrix(beams, light.amplitudes(1.0).T, paths=300, seed=3, threads=1).value
    expected = matrix.T.reshape(field.shape)
    assert np.abs(field - expected).max() < 1e-5 * np.abs(expected).max()
    wrong = matrix.conj().T.reshape(field.shape)
    assert np.abs(field - wrong).max() > 0.1 * np.abs(expected).max()


HG, CROSSED = sg.media.HenyeyGreenstein(0.7), sg.light.Polarisers.crossed()
FAR, BACK = (sg.sensors.FarField.grid((6, 6), 2e-3, side=side) for side in ("transmission", "reflection"))
NEAR = sg.sensors.NearField(np.array([[0.0, 3.0, 90.0], [9.0, 0.0, 90.0]]))
LENS = sg.sensors.Imaging(shape=(4, 4), pitch=4.0, aperture=0.05)
THIN = sg.Slab(thickness=60.0, mean_free_path=10.0, scatterer=HG)
BROWNIAN = THIN.replace(motion=sg.media.Brownian(diffusion=1.0))
BOX = sg.media.Box(lower=[-90, -90, 0], upper=[90, 90, 40], mean_free_path=20.0, scatterer=HG)
COMBINATIONS = {  # weekly: the first, all that the other films, lenses and projectors are, together
    "film, lens, projector": (BROWNIAN.replace(polarisation="projector"), LENS, CROSSED, [0.0, 1e-3]),
    "faces": (THIN.replace(faces=sg.media.Faces(inside=1.4)), FAR, None, None),
    "layers of two indices": (
        sg.Layers([sg.media.Layer(thickness=30.0, mean_free_path=10.0, scatterer=HG, index=1.3),
                   sg.media.Layer(thickness=30.0, mean_free_path=10.0, scatterer=HG)]), FAR, None, None),
    "faces, far points": (THIN.replace(faces=sg.media.Faces(inside=1.4)),
                          sg.sensors.NearField(np.array([[0.0, 3.0, 3e4], [90.0, 0.0, 3e4]])), None, None),
    "box": (BOX, FAR, None, None),
    "box, lens": (BOX, LENS.replace(focus=30.0), None, None),
    "box, lens, reflection": (BOX, LENS.replace(side="reflection"), None, None),
    "box, vector": (BOX.replace(scatterer=sg.media.Rayleigh(), polarisation="vector"), FAR, CROSSED, None),
    "box, projector, film": (
        BOX.replace(polarisation="projector", motion=sg.media.Brownian(diffusion=1.0)), FAR, CROSSED, [0.0, 1e-3]),
    "reflection": (THIN, BACK, None, None),
    "near field": (THIN, NEAR, None, None),
    "lens": (THIN, LENS, None, None),
    "lens, reflection": (THIN, LENS.replace(side="reflection"), None, None),
    "vector": (THIN.replace(polarisation="vector", scatterer=sg.media.Rayleigh()), FAR, CROSSED, None),
    "vector, reflection": (THIN.replace(polarisation="vector", scatterer=sg.media.Rayleigh()), BACK, CROSSED, None),
    "projector, layers": (
        sg.Layers([sg.media.Layer(thickness=30.0, mean_free_path=10.0, scatterer=HG)] * 2, polarisation="projector"),
        FAR, CROSSED, None),
    "film": (BROWNIAN, FAR, None, [0.0, 1e-3]),
    "film, lens": (BROWNIAN, LENS, None, [0.0, 1e-3]),
    "film, near field": (BROWNIAN, NEAR, None, [0.0, 1e-3]),
    "lens, projector": (THIN.replace(polarisation="projector"), LENS, CROSSED, None),
    "lens, vector": (THIN.replace(polarisation="vector", scatterer=sg.media.Rayleigh()), LENS, CROSSED, None),
    "film, projector": (BROWNIAN.replace(polarisation="projector"), FAR, CROSSED, [0.0, 1e-3]),
}  # fmt: skip


@pytest.mark.parametrize("name", [*COMBINATIONS][1:] + [pytest.param([*COMBINATIONS][0], marks=pytest.mark.slow)])
def test_every_combination_is_the_sum_of_its_plane_waves(name):
    """Of a converging beam through a lens: a sum of the beams' fields, amplitudes found by hand; conjugates are told.

    Frames of a film are under beams of their own.
    """
    medium, sensor, polarisers, times = COMBINATIONS[name]
    objects = LETTER[:, 1:7] if times else np.stack([LETTER[:, 1:7], LETTER[::-1, 1:7]])
    light = CoherentObject(objects, 20.0, distance=50.0, waist=90.0, focus=4000.0, aperture=0.02, times=times)
    with pytest.warns(sg.DoubtWarning, match="does not resolve pixels"):
        seen = sg.Scene(wavelength=1.0, medium=medium, illumination=light, sensor=sensor, polarisers=polarisers)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", sg.DoubtWarning)  # few paths
        field = sg.render(seen, sampler="paths", paths=100, seed=3, threads=1).field
        beams = sg.render(seen.replace(illumination=seen.beams), sampler="paths", paths=100, seed=3, threads=1).field
    frames = len(field)
    own = light.replace(times=None)
    amplitudes, directions = own.amplitudes(1.0), own.modes(1.0).directions
    np.testing.assert_array_equal(seen.beams.directions[: len(directions)], directions)
    if times:
        np.testing.assert_array_equal(
            seen.beams.times.reshape(frames, -1), np.repeat(times, len(directions)).reshape(frames, -1)
        )
        amplitudes, beams = np.tile(amplitudes, (frames, 1)), beams.reshape(frames, len(directions), *beams.shape[1:])
        expected = np.stack([np.tensordot(a, b, axes=1) for a, b in zip(amplitudes, beams, strict=True)])
        assert not np.allclose(expected[0], expected[1], rtol=1e-3)
        wrong = expected[::-1]
    else:
        expected, wrong = (np.tensordot(a, beams, axes=1) for a in (amplitudes, amplitudes.conj()))
    assert np.abs(expected).max() > 0
    assert np.abs(field - expected).max() < 1e-5 * np.abs(expected).max()
    assert np.abs(field - wrong).max() > 0.02 * np.abs(expected).max()


def test_far_points_see_the_film_of_far_views():
    """Frames at points a million wavelengths away correlate as far views there; those of a fifth of the lag do not."""
    medium = sg.Slab(thickness=20.0, mean_free_path=10.0, scatterer=sg.media.HenyeyGreenstein(0.3),
                     motion=sg.media.Brownian(diffusion=1.0))  # fmt: skip
    turn = np.arange(8) * np.pi / 4
    views = np.stack([0.5 * np.cos(turn), 0.5 * np.sin(turn), np.full(8, np.sqrt(0.75))], axis=-1)

    def correlations(sensor, seed, times=(0.0, 0.01, 0.02)):
        light = sg.light.CollimatedBeams(directions=[[0, 0, 1.0]] * 3, width=100.0, times=times)
        seen = sg.Scene(wavelength=1.0, medium=medium, illumination=light, sensor=sensor)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", sg.DoubtWarning)  # few paths
            field = sg.render(seen, sampler="paths", paths=150, realizations=150, seed=seed, threads=1).field
        power = np.square(np.abs(field)).mean()
        return np.stack([(field[:, 0] * field[:, t].conj()).real.mean(axis=1) / power for t in (1, 2)], axis=-1)

    far, near = correlations(sg.sensors.FarField(views), 1), correlations(sg.sensors.NearField(1e6 * views), 2)
    soon = correlations(sg.sensors.NearField(1e6 * views), 3, (0.0, 0.002, 0.004))
    error = np.hypot(far.std(axis=0, ddof=1), near.std(axis=0, ddof=1)) / 150**0.5
    assert (far.mean(axis=0) > 0.05).all()
    assert_z(near.mean(axis=0), far.mean(axis=0), error, degrees=149)
    refute_z(soon.mean(axis=0), far.mean(axis=0), error, degrees=149)


@pytest.mark.slow
def test_the_stationary_sampler_is_path_sums_in_the_mean():
    """Mean intensities within 2 %, and the products of two objects' fields, at lags of views, of 24 media each."""
    light = CoherentObject(np.stack([LETTER, np.roll(LETTER, 1, 1) * np.exp(0.3j * np.arange(8))]), 40.0)
    seen = scene(light, shape=(16, 16))
    assert sg.plan(seen).sampler == "stationary"
    fast = sg.render(seen, realizations=200, seed=1).field
    slow = sg.render(seen, sampler="paths", paths=1500, realizations=24, seed=2).field

    def measured(fields):
        power = np.square(np.abs(fields)).mean(axis=(2, 3))
        shared = [(fields[:, 0, :, s:] * fields[:, 1, :, : 16 - s].conj()).mean(axis=(1, 2)) for s in (0, 1, 2)]
        return np.column_stack([power, *(each.real for each in shared), *(each.imag for each in shared)])

    expected, found = (measured(each) for each in (fast, slow))
    mean, error = expected.mean(axis=0), expected.std(axis=0) / 200**0.5
    assert (error < 0.05 * mean[0]).all()
    assert_mean(found, mean, slack=3 * error.max())
    refute_mean(found * np.repeat([2.0, 1.0], [2, 6]), mean, slack=3 * error.max())


FAST = {
    "lens": (THIN, sg.sensors.Imaging(shape=(24, 24), pitch=8.0, aperture=0.03, focus=40.0), None, None),
    "film": (BROWNIAN, sg.sensors.FarField.grid((24, 24), 6e-4), None, [0.0, 2e-3]),
    "film, lens": (BROWNIAN, sg.sensors.Imaging(shape=(24, 24), pitch=8.0, aperture=0.03), None, [0.0, 2e-3]),
    "projector": (THIN.replace(polarisation="projector"), sg.sensors.FarField.grid((24, 24), 6e-4),
                  sg.light.Polarisers.parallel(), None),
    "vector, crossed": (THIN.replace(polarisation="vector", scatterer=sg.media.Rayleigh()),
                        sg.sensors.FarField.grid((24, 24), 6e-4), CROSSED, None),
}  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize("name", FAST)
def test_fields_mixed_cell_by_cell_have_the_moments_of_path_sums(name):
    """Mean intensities of two objects or frames, |u|^4, and products of both at lags of pixels; conjugates are told.

    The sampler is asked for: before lenses of this aperture the planner leaves it out (0.026 for 0.02 allowed).
    """
    medium, sensor, polarisers, times = FAST[name]
    second = np.roll(LETTER[:, 1:7], 1, 1) * np.exp(0.3j * np.arange(6))
    light = CoherentObject(LETTER[:, 1:7] if times else np.stack([LETTER[:, 1:7], second]), 40.0, times=times)
    seen = sg.Scene(wavelength=1.0, medium=medium, illumination=light, sensor=sensor, polarisers=polarisers)

    def measured(**budget):
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", sg.DoubtWarning)  # few paths
            fields = sg.render(seen, **budget).field
        power = np.square(np.abs(fields)).mean(axis=(2, 3))
        shared = [(fields[:, 0, :, s:] * fields[:, 1, :, : 24 - s].conj()).mean(axis=(1, 2)) for s in (0, 1, 2)]
        values = np.column_stack([power, *(each.real for each in shared), *(each.imag for each in shared)])
        each = np.square(np.abs(fields))  # images of a lens are brighter in their middle
        fourth = np.square(each).mean(axis=0).sum(axis=(1, 2)) / np.square(each.mean(axis=0)).sum(axis=(1, 2))
        return values.mean(axis=0), values.std(axis=0, ddof=1) / len(fields) ** 0.5, fourth

    (fast, spread, fourth), (slow, error, _) = measured(sampler="stationary", realizations=900, seed=1), measured(
        sampler="paths", paths=600, realizations=480, seed=2)  # fmt: skip
    scale = fast[0]
    limit = 0.02 * np.repeat([1.0, 0.5], [2, 6])  # mean within 2 %, correlations within 0.01
    off = np.hypot(spread, error) / scale
    assert_z(slow / scale, fast / scale, off, degrees=479, slack=limit)
    np.testing.assert_allclose(fourth, 2.0, atol=0.1)
    swapped = fast * np.repeat([1.0, -1.0], [5, 3])  # a conjugate
    told = np.abs(fast[5:]).max() > 0.1 * scale
    if told:
        refute_z(slow / scale, swapped / scale, off, degrees=479, slack=limit)
    refute_z(slow / scale, fast * np.repeat([1.4, 1.0], [2, 6]) / scale, off, degrees=479, slack=limit)


@pytest.mark.parametrize("medium", [
    sg.GroundGlass(angle=0.1), sg.PhaseScreen(rms_phase=1.0, correlation_length=20.0),
    sg.media.ScreenStack(screens=(sg.GroundGlass(angle=0.05),) * 2, gaps=(2000.0,)),
])  # fmt: skip
def test_thin_media_are_planned_by_the_screens_sampler(medium):
    light = CoherentObject(LETTER, 60.0)
    seen = scene(light, medium)
    plan = sg.plan(seen)
    assert plan.sampler == "screens"
    text = plan.explain()
    assert "coherent objects: used" in text
    assert "at its brightest view it has" in text
    with np.errstate(all="raise"):
        with_mean = sg.render(seen, seed=1, mean=True)
    without = sg.render(seen, seed=1)
    np.testing.assert_allclose(with_mean.field - without.field, sg.statistics.mean_field(seen), rtol=1e-3, atol=1e-3)


@pytest.mark.parametrize("side", ["transmission", "reflection"])
@pytest.mark.parametrize(("medium", "polarisers"), [
    (sg.GroundGlass(angle=0.1), None), (BROWNIAN, None),
    (BROWNIAN.replace(polarisation="projector"), sg.light.Polarisers.parallel()),
])  # fmt: skip
def test_the_mean_field_is_the_sum_of_that_of_the_plane_waves(medium, polarisers, side):
    """Of one screen exactly; behind a slab windows walk there with each wave, by rays."""
    if medium.stack is not None and side == "reflection":
        return
    light = CoherentObject(LETTER, 20.0, times=None if medium.stack is not None else [0.0, 1e-3])
    camera = sg.sensors.FarField.grid((12, 12), 0.4 / light.side(1.0), side=side)
    seen = sg.Scene(wavelength=1.0, medium=medium, illumination=light, sensor=camera, polarisers=polarisers)
    found, beams = sg.statistics.mean_field(seen), sg.statistics.mean_field(seen.replace(illumination=seen.beams))
    expected = np.tensordot(light.amplitudes(1.0), beams, axes=1)
    assert found.shape == expected.shape
    assert np.abs(found - expected).max() <= (1e-12 if medium.stack is not None else 0.02) * np.abs(expected).max()
    assert side == "reflection" or np.abs(found - expected.conj()).max() > 0.1 * np.abs(expected).max()


@pytest.mark.parametrize(("message", "change"), [
    (r"CoherentObject\.field must be .*finite", {"field": np.full((4, 4), np.nan)}),
    (r"CoherentObject\.field must be an array", {"field": np.ones(4)}),
    (r"CoherentObject\.width must be at least the side of the object", {"width": 50.0}),
    (r"CoherentObject\.waist must be large enough", {"field": np.ones((6, 8)), "waist": 20.0}),
    (r"CoherentObject\.pitch must be at least half a wavelength", {"pitch": 0.4}),
    (r"CoherentObject\.focus must be at least", {"focus": 100.0}),
    (r"CoherentObject\.focus must be other than 0", {"focus": 0.0}),
    (r"CoherentObject\.times must be 1 numbers", {"times": [[0.0, 1.0]]}),
    (r"CoherentObject\.times must be left out for a medium at rest", {"times": [0.0, 1.0]}),
])  # fmt: skip
def test_refused(message, change):
    assert_refused(lambda: scene(CoherentObject(**{"field": LETTER, "pitch": 20.0} | change)), message)


def test_screens_have_no_paths():
    seen = scene(CoherentObject(LETTER, 20.0), sg.GroundGlass(angle=0.1))
    assert_refused(lambda: sg.plan(seen, sampler="paths"), r"sampler must be .*screens.*have no paths")


def test_polarised_light_beside_the_axis_is_left_to_path_sums():
    """The reason names the camera, and is no other scene's."""
    camera = sg.sensors.FarField.grid((6, 6), 1e-3, center=(0.01, 0.0))
    seen = sg.Scene(wavelength=1.0, medium=THIN.replace(polarisation="projector"), sensor=camera, polarisers=CROSSED,
                    illumination=CoherentObject(LETTER, 20.0))  # fmt: skip
    assert_refused(lambda: sg.plan(seen, sampler="stationary"), "only before a camera centred on the axis")


def test_screens_refuse_for_reasons_of_physics():
    light, glass = CoherentObject(LETTER, 20.0), sg.GroundGlass(angle=0.1)
    back = sg.sensors.FarField.grid((6, 6), 1e-3, side="reflection")

    def seen(sensor, **parts):
        return sg.Scene(wavelength=1.0, medium=parts.pop("medium", glass), illumination=light, sensor=sensor, **parts)

    assert_refused(lambda: seen(back), "A thin screen reflects no light")
    assert_refused(lambda: seen(LENS.replace(side="reflection")), "A thin screen reflects no light")
    assert_refused(lambda: seen(LENS, polarisers=CROSSED), "leaves the polarisation as it is")
    pair = sg.media.ScreenStack(screens=(glass, glass), gaps=(300.0,))
    assert_refused(lambda: seen(sg.sensors.NearField([[0.0, 0.0, 200.0]]), medium=pair), "behind the last screen")
    near = sg.sensors.NearField([[0.0, 0.0, 200.0]])
    vector = THIN.replace(polarisation="projector")
    assert_refused(lambda: seen(near, medium=vector, polarisers=CROSSED), "An analyser passes one component")


def test_units_and_files():
    """Lengths as texts with units; a scene in a file is the same scene."""
    light = CoherentObject(LETTER, "20 um", "3 mm", waist="0.2 mm")
    assert (light.pitch, light.distance, light.waist) == (20.0, 3000.0, 200.0)
    seen = scene(CoherentObject(LETTER, 20.0, 30.0))
    assert sg.Scene.from_toml(seen.to_toml()) == seen
    assert sg.Scene.from_toml(seen.to_toml()).unitless_fingerprint() == seen.unitless_fingerprint()
