"""The oracle is exact: spherical waves from a point on the object, through a thin layer, to a pixel."""

import math
import re

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from refusals import assert_refused

import specklegen as sg
from specklegen.instrument.lab import PHASE_LIMIT, LabSetup

EXAMPLE = {  # millimetres: the example of the published check
    "wavelength": 532e-6, "object_distance": 100.0, "camera_distance": 50.0, "object_extent": 0.4, "aperture": 2.0,
    "pixel_pitch": 0.005, "pixels": (128, 128),
}  # fmt: skip


def exact_phase(setup, x, y, source, pixel):
    """Phase of light from (source, 0) on the object through (x, y) on the layer to (pixel, 0), radians. A pixel behind
    a lens collects a plane wave at the angle atan(pixel / f)."""
    to_layer = np.sqrt(setup.object_distance**2 + (x - source) ** 2 + y**2)
    if setup.camera_distance is None:
        to_camera = -x * np.sin(np.arctan2(pixel, setup.focal_length))
    else:
        to_camera = np.sqrt(setup.camera_distance**2 + (x - pixel) ** 2 + y**2)
    return 2 * np.pi / setup.wavelength * (to_layer + to_camera)


def exact_correlation(setup, aperture, sources, pixels, points=160):
    """|C|**2 of the patterns of two points at two pixels behind a thin layer: midpoint rule over D x D."""
    line = ((np.arange(points) + 0.5) / points - 0.5) * aperture
    x, y = np.meshgrid(line, line)
    difference = exact_phase(setup, x, y, sources[1], pixels[1]) - exact_phase(setup, x, y, sources[0], pixels[0])
    return abs(np.exp(1j * (difference - difference.mean())).mean()) ** 2


def test_the_pattern_of_a_point_is_found_at_the_predicted_image():
    """Correlation 1 at the inverted image while the aperture is allowed, then falling; nothing elsewhere."""
    setup = LabSetup(**EXAMPLE)
    image = 0.2 * setup.magnification
    assert image == -0.1
    at_image = [exact_correlation(setup, aperture, (0, 0.2), (0, image)) for aperture in (2, 5, 10, 20)]
    np.testing.assert_allclose(at_image, [1.0000, 0.9990, 0.9366, 0.086], atol=5e-4)
    speckle = setup.speckle_size
    for wrong in (-image, 0.0, image * 1.1, image * 0.9):  # not inverted, not moved, magnified 10 % wrongly
        expected = np.sinc((wrong - image) / speckle) ** 2
        assert abs(exact_correlation(setup, 2, (0, 0.2), (0, wrong)) - expected) < 0.01
        assert expected < 0.5


def mapped_pairs(setup):
    """Pixels that the engine's regular sine grid identifies, for the centre and the edge of the object."""
    x = setup.object_extent / 2
    half = max(setup.pixels) * setup.pixel_pitch / 2
    shift = x * setup.magnification
    for pixel in (-half - shift, -half / 2, 0.0, -shift / 2, half / 2, half):
        if abs(pixel) <= half and abs(pixel + shift) <= half:
            yield (0.0, x), (pixel, pixel + shift)


def worst_correlation(setup, aperture, points=160):
    return min(exact_correlation(setup, aperture, *pair, points) for pair in mapped_pairs(setup))


LABORATORIES = {
    "coma": EXAMPLE,
    "defocus over a large camera": {**EXAMPLE, "pixels": (1200, 1200), "pixel_pitch": 0.01, "aperture": 0.5},
    "equal distances": {**EXAMPLE, "camera_distance": 100.0, "object_extent": 4.0, "pixels": (1024, 1024)},
    "steep sines": {**EXAMPLE, "object_distance": 30.0, "object_extent": 5, "pixels": (2048, 2048), "aperture": 0.09},
    "lens, coma": {**EXAMPLE, "camera_distance": None, "focal_length": 50.0},
    "lens, wide object": {**EXAMPLE, "camera_distance": None, "focal_length": 50.0, "object_extent": 8.0,
                          "aperture": 1.0, "pixels": (1024, 1024)},
    "far camera": {**EXAMPLE, "camera_distance": 300.0, "pixels": (256, 256)},
}  # fmt: skip


@pytest.mark.parametrize("name", LABORATORIES)
def test_the_largest_aperture_keeps_the_correlation_over_the_whole_camera(name):
    setup = LabSetup(**LABORATORIES[name])
    assert worst_correlation(setup, setup.largest_aperture) > 0.87


@pytest.mark.parametrize("name", LABORATORIES)
def test_the_largest_aperture_is_not_too_cautious(name):
    """Four times the aperture loses the correlation somewhere: the limit is where the mapping ends."""
    setup = LabSetup(**LABORATORIES[name])
    assert worst_correlation(setup, 4 * setup.largest_aperture) < 0.65


def test_phase_errors_are_those_of_the_expansion():
    """phi_3 of the example is 0.44 rad at D = 10 mm; phi_4 literally, where the image fills the camera."""
    setup = LabSetup(**EXAMPLE, bandwidth=0.0).replace(pixels=(40, 40))
    k, x, u, v = 2 * math.pi / 532e-6, 0.2, 100.0, 50.0
    scale = 10.0 / setup.aperture
    assert setup.phase_errors["phi_3"] * scale**3 == pytest.approx(0.443, abs=5e-4)
    filled = 0.75 * k * x**2 * (setup.aperture / 2) ** 2 * (1 / u**3 + 1 / (u**2 * v))
    assert setup.phase_errors["phi_4"] == pytest.approx(filled, rel=1e-12)
    s = 0.1  # mm, half the image of the object: of a camera that it fills, and of one twice as wide
    for pixels, shift in ((40, 0.75 * s**3), (80, 3 * 2 * s * s * (2 * s - s))):
        found = setup.replace(pixels=(pixels, pixels)).phase_errors["phi_1"]
        assert found == pytest.approx(k / 4 * shift / v**3 * setup.aperture, rel=1e-12)


def test_a_lens_takes_the_terms_of_the_camera_away():
    lens = LabSetup(**{**EXAMPLE, "camera_distance": None, "focal_length": 50.0})
    bare = LabSetup(**EXAMPLE)
    assert lens.speckle_size == bare.speckle_size
    assert lens.phase_errors["phi_3"] == pytest.approx(bare.phase_errors["phi_3"] / 3, rel=1e-12)  # |1 - 4| / 1
    assert lens.phase_errors["phi_4"] < bare.phase_errors["phi_4"]


def speckle_through_a_layer(setup, source, pixels, layer, spherical):
    """Intensity at pixels float[n] of one layer: exactly, or as the engine maps it. The layer is a set of points (x, y)
    with random phases. The engine's field is the far field at the lab's sines, of the same layer with the quadratic
    phases that all patterns share put into it."""
    x, y, phase = layer
    if spherical:
        paths = exact_phase(setup, x[:, None], y[:, None], source, pixels)
    else:
        k = 2 * np.pi / setup.medium_wavelength
        shared = exact_phase(setup, x, y, 0.0, 0.0)[:, None]
        sines = pixels / np.hypot(setup.view_distance, pixels) + source / np.hypot(setup.object_distance, source)
        paths = shared - k * x[:, None] * sines / setup.refractive_index
    return np.abs(np.exp(1j * (paths + phase[:, None])).sum(0)) ** 2 / len(x)


def random_layers(setup, count, points=400):
    rng = np.random.default_rng(5)
    for _ in range(count):
        x, y = rng.uniform(-0.5, 0.5, (2, points)) * setup.aperture
        yield x, y, rng.uniform(0, 2 * np.pi, points)


@pytest.mark.parametrize("refractive_index", [1.0, 1.5])
def test_the_far_field_scene_gives_the_pattern_of_spherical_waves_pixel_by_pixel(refractive_index):
    """Same layer, same pixels, three object points: fields agree to the phase errors, so do intensities."""
    setup = LabSetup(**EXAMPLE, refractive_index=refractive_index)
    pixels = np.linspace(-0.3, 0.3, 61)
    allowed = 4 * sum(setup.phase_errors.values())  # of the field, twice for the intensity, twice for two points
    for layer in random_layers(setup, 3):
        for source in (-0.2, 0.0, 0.15):
            exact = speckle_through_a_layer(setup, source, pixels, layer, spherical=True)
            engine = speckle_through_a_layer(setup, source, pixels, layer, spherical=False)
            assert np.sqrt(np.mean((exact - engine) ** 2)) < allowed
    wrong = setup.replace(camera_distance=50.5)  # a 1 % error in v must be seen
    engine = speckle_through_a_layer(wrong, 0.15, pixels, layer, spherical=False)
    exact = speckle_through_a_layer(setup, 0.15, pixels, layer, spherical=True)
    assert np.sqrt(np.mean((exact - engine) ** 2)) > allowed


def test_the_layer_has_the_faces_of_its_index():
    """A slab between indices reflects; between matched ones, or with faces of its own, it stays as it was."""
    slab = sg.Slab(thickness=0.1, mean_free_path=0.01, scatterer=sg.HenyeyGreenstein(g=0.9))
    brightness = np.ones((20, 20))

    def medium(**lab):
        return LabSetup(**EXAMPLE, **lab).scene(slab, brightness).medium

    assert medium() == slab
    assert medium(refractive_index=1.33).faces == sg.Faces(inside=1.33)
    assert medium(refractive_index=1.33, wall=1.52).faces == sg.Faces(inside=1.33, wall=1.52)
    assert medium(refractive_index=1.33, faces="matched") == slab
    own = slab.replace(faces=sg.Faces(inside=1.5, outside=1.33))
    assert LabSetup(**EXAMPLE, refractive_index=1.5).scene(own, brightness).medium == own
    box = sg.Box(lower=[0, 0, 0], upper=[1, 1, 0.1], mean_free_path=0.01, scatterer=sg.Isotropic())
    with pytest.warns(sg.DoubtWarning, match="but not reflection, for a Box"):
        LabSetup(**EXAMPLE, refractive_index=1.33).scene(box, brightness)


def test_engine_terms_of_the_example():
    """Literal figures: pitch p / (n v), width D, wavelength / n, cells of the object seen from the layer."""
    setup = LabSetup(**EXAMPLE, refractive_index=1.4)
    assert setup.medium_wavelength == pytest.approx(380e-6)
    assert setup.view_pitch == pytest.approx(0.005 / (1.4 * 50))
    assert setup.object_pitch((20, 10)) == pytest.approx(0.02 / (1.4 * 100))
    assert setup.magnification == -0.5
    assert setup.speckle_size == pytest.approx(0.0133)
    # speckle in pixels is the same in the laboratory and in the scene: lambda / (W pitch)
    scene = setup.medium_wavelength / (setup.aperture * setup.view_pitch)
    assert scene == pytest.approx(setup.speckle_size / setup.pixel_pitch)
    narrow = setup.replace(bandwidth=1e-6, wavelength=500e-6)
    assert narrow.wavenumber_bandwidth == pytest.approx(2 * np.pi * 1.4 * 1e-6 / 500e-6**2)


def largest(message):
    return float(re.search(r"at most ([0-9.e+-]+),", message)[1])


@pytest.mark.parametrize(("field", "value", "others", "says"), [
    ("pixel_pitch", 0.007, {}, r"half a speckle a view; got 0\.007\. Set oversampling to 2 or more, or the"),
    ("object_extent", 1.4, {}, r"whose image fills the camera; got 1\.4"),
    ("aperture", 12.0, {"pixel_pitch": 0.001, "pixels": (640, 640)}, r"mapping holds; got 12\.0\. .*phi_3 = 0\.7"),
    ("aperture", 3.0, {"object_extent": 8.0, "pixel_pitch": 0.004, "pixels": (2000, 2000)}, r"phi_4 = .*aperture D"),
    ("bandwidth", 2e-5, {}, r"which moves the pattern by one speckle; got 2e-05"),
])  # fmt: skip
def test_a_refusal_names_a_largest_value_that_passes_and_is_the_largest(field, value, others, says):
    with pytest.raises(ValueError, match=rf"LabSetup\.{field} must be at most .*{says}") as refusal:
        LabSetup(**{**EXAMPLE, **others, field: value})
    limit = largest(str(refusal.value))
    LabSetup(**{**EXAMPLE, **others, field: limit})
    with pytest.raises(ValueError, match=rf"LabSetup\.{field} must be at most"):
        LabSetup(**{**EXAMPLE, **others, field: 1.002 * limit})


def test_lengths_whose_powers_overflow_are_refused():
    with pytest.raises(ValueError, match=r"LabSetup\.object_distance must be between 1e-60 and 1e\+60; got 1e\+300"):
        LabSetup(**{**EXAMPLE, "object_distance": 1e300})


def test_the_remedies_for_undersampling_work():
    bad = {**EXAMPLE, "pixel_pitch": 0.03}
    with pytest.raises(ValueError, match="oversampling to 5 or more, or the aperture to at most") as refusal:
        LabSetup(**bad)
    assert LabSetup(**bad, oversampling=5).view_shape == (640, 640)
    assert_refused(lambda: LabSetup(**bad, oversampling=4), "oversampling to 5")
    LabSetup(**{**bad, "aperture": float(str(refusal.value).rsplit(" ", 1)[1].rstrip("."))})


def test_the_largest_bandwidth_moves_the_pattern_by_one_speckle():
    """Exact: the pattern at the farthest pixel, at the two ends of the band, has lost its correlation. Behind a thin
    layer whose phase does not change with wavelength; one speckle is the first zero of sinc."""
    setup = LabSetup(**EXAMPLE)
    half = 0.5 * max(setup.pixels) * setup.pixel_pitch
    line = ((np.arange(20000) + 0.5) / 20000 - 0.5) * setup.aperture

    def correlation(bandwidth):
        low, high = (setup.replace(wavelength=setup.wavelength + s * bandwidth / 2) for s in (-1, 1))
        change = exact_phase(low, line, 0, 0.2, half) - exact_phase(high, line, 0, 0.2, half)
        common = exact_phase(low, line, 0, 0.2, -0.1) - exact_phase(high, line, 0, 0.2, -0.1)
        return abs(np.exp(1j * (change - common)).mean()) ** 2

    assert setup.largest_bandwidth == pytest.approx(532e-6 * setup.speckle_size / 0.42)
    assert correlation(setup.largest_bandwidth) < 1e-3
    assert correlation(setup.largest_bandwidth / 2) == pytest.approx(np.sinc(0.5) ** 2, abs=1e-3)


def refusal(fields):
    """Message with which a laboratory is refused, or nothing."""
    try:
        LabSetup(**fields)
    except ValueError as error:
        return str(error)
    return ""


@given(log_u=st.floats(1, 4), log_v=st.floats(1, 4), log_aperture=st.floats(-2, 1.5), filling=st.floats(0.01, 1),
       pixels=st.integers(16, 4096))  # fmt: skip
@settings(max_examples=400, deadline=None, derandomize=True)
def test_every_laboratory_that_passes_keeps_its_correlation(log_u, log_v, log_aperture, filling, pixels):
    """Exact spherical phases over the whole camera, for any laboratory that is not refused."""
    u, v, aperture = 10**log_u, 10**log_v, 10**log_aperture
    pitch = 532e-6 * v / (2 * aperture)
    fields = {**EXAMPLE, "object_distance": u, "camera_distance": v, "aperture": aperture}
    fields |= {"pixel_pitch": pitch, "pixels": (pixels, pixels), "object_extent": filling * pixels * pitch * u / v}
    message = refusal(fields)
    if message:
        assert re.match(r"LabSetup\.aperture must be at most", message)
    else:
        setup = LabSetup(**fields)
        assert max(setup.phase_errors.values()) <= PHASE_LIMIT * (1 + 1e-9)
        assert worst_correlation(setup, aperture, points=40) > 0.87


@pytest.mark.parametrize(("make", "message"), [
    (lambda: LabSetup(**{**EXAMPLE, "camera_distance": None}), r"must be the only one given of itself, focal_leng"),
    (lambda: LabSetup(**EXAMPLE, focal_length=50.0), r"focal_length and focus; got \(50\.0, 50\.0, None\)"),
    (lambda: LabSetup(**{**EXAMPLE, "wavelength": -1}), r"LabSetup\.wavelength must be greater than 0"),
    (lambda: LabSetup(**{**EXAMPLE, "aperture": np.nan}), r"LabSetup\.aperture must be finite"),
])  # fmt: skip
def test_bad_input_names_field_rule_and_value(make, message):
    assert_refused(make, message)


def test_a_setup_is_a_value():
    setup = LabSetup(**EXAMPLE)
    assert LabSetup.from_toml(setup.to_toml()) == setup
    assert LabSetup.from_json(setup.canonical_json()) == setup
    metres = {n: v / 1000 for n, v in EXAMPLE.items() if isinstance(v, float)}
    scaled = LabSetup(**{**EXAMPLE, **metres})
    assert scaled.phase_errors == pytest.approx(setup.phase_errors)
    assert scaled.view_pitch == pytest.approx(setup.view_pitch)


MICROSCOPE = {  # micrometres
    "wavelength": 0.532, "object_distance": 5e5, "object_extent": 1e4, "aperture": 40.0, "focus": -10.0,
    "magnification": 20.0, "numerical_aperture": 0.25, "pixel_pitch": 6.5, "pixels": (16, 24), "refractive_index": 1.4,
}  # fmt: skip


def test_an_objective_images_a_plane_by_its_magnification():
    """A scene's lens has the aperture inside the layer, the plane in the medium outside, and pixels of the camera."""
    setup = LabSetup(**MICROSCOPE)
    slab = sg.Slab(thickness=40.0, mean_free_path=20.0, scatterer=sg.HenyeyGreenstein(0.9))
    scene = setup.scene(slab, np.ones((2, 2)))
    camera = scene.sensor
    assert (camera.shape, camera.focus, camera.magnification) == ((16, 24), -10.0, 20.0)
    assert camera.aperture == pytest.approx(0.25 / 1.4)
    assert scene.wavelength / (2 * camera.aperture) * camera.magnification == pytest.approx(setup.speckle_size)
    assert setup.magnification == 20.0
    fine = LabSetup(**MICROSCOPE | {"oversampling": 2}).scene(slab, np.ones((2, 2))).sensor
    assert fine.shape == (32, 48)
    assert fine.positions[0][-1] == pytest.approx(camera.positions[0][-1] + 6.5 / 20 / 4)
    image = sg.render(scene, paths=200, seed=0, threads=1).intensity
    assert image.shape == (16, 24)
    assert np.isfinite(image).all()


@pytest.mark.parametrize(("field", "changes"), [
    ("LabSetup.camera_distance", {"camera_distance": 100.0}), ("LabSetup.magnification", {"magnification": None}),
    ("LabSetup.numerical_aperture", {"numerical_aperture": None}), ("LabSetup.bandwidth", {"bandwidth": 1e-3}),
    ("LabSetup.focus", {"focus": 1e70}),
])  # fmt: skip
def test_an_objective_is_given_whole_and_alone(field, changes):
    assert_refused(lambda: LabSetup(**MICROSCOPE | changes), re.escape(field))
    with pytest.raises(sg.RuleError, match=r"LabSetup\.magnification must be given if focus is given"):
        LabSetup(**EXAMPLE | {"magnification": 2.0})


@pytest.mark.parametrize("name", ["view_distance", "view_pitch", "phase_errors"])
def test_what_the_far_field_alone_has_is_refused_of_an_objective(name):
    setup = LabSetup(**MICROSCOPE)
    assert_refused(lambda: getattr(setup, name), r"LabSetup\.focus must be left out for the far field")
