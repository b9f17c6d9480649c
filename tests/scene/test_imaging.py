"""Cameras with a lens: pupils, and what a scene refuses of them, each with the number that would pass."""

import math
import re
import subprocess
import sys

import numpy as np
import pytest
from refusals import assert_refused

import specklegen as sg
from specklegen.scene.imaging import zernike

SLAB = sg.Slab(thickness=40.0, mean_free_path=20.0, scatterer=sg.HenyeyGreenstein(0.9))
BEAM = sg.CollimatedBeams.tilts([0.0], width=60.0)


def scene(medium=SLAB, light=BEAM, **camera):
    sensor = sg.Imaging(**{"shape": (16, 16), "pitch": 1.0, "aperture": 0.2} | camera)
    return sg.Scene(wavelength=1.0, medium=medium, illumination=light, sensor=sensor)


def number_of(error, pattern):
    """The number that an error says would pass."""
    found = re.search(pattern + r"\s*([0-9.]+[0-9])", str(error.value))
    assert found, str(error.value)
    return float(found[1])


def test_zernike_polynomials_are_those_of_noll_and_orthonormal():
    radius, angle = np.meshgrid(np.sqrt((np.arange(200) + 0.5) / 200), 2 * np.pi * np.arange(64) / 64)
    x, y = radius * np.cos(angle), radius * np.sin(angle)
    named = {1: 1, 2: 2 * x, 3: 2 * y, 4: math.sqrt(3) * (2 * radius**2 - 1), 6: math.sqrt(6) * (x**2 - y**2),
             7: math.sqrt(8) * (3 * radius**2 - 2) * y,
             11: math.sqrt(5) * (6 * radius**4 - 6 * radius**2 + 1)}  # fmt: skip
    for j, expected in named.items():
        np.testing.assert_allclose(zernike(j, radius, angle), expected + 0 * x, atol=1e-12)
    several = np.array([zernike(j, radius, angle).ravel() for j in range(1, 29)])
    np.testing.assert_allclose(several @ several.T / radius.size, np.eye(28), atol=2e-3)  # of the midpoint rule


def test_pupils_multiply_what_they_are_given():
    x, y = 0.3, -0.4  # at half the radius
    assert sg.Pupil().transmission(x, y) == 1
    assert sg.Pupil().transmission(0.8, 0.7) == 0
    assert sg.Pupil(stop=0.6).transmission(x, y) == 0
    assert sg.Pupil(waist=0.5).transmission(x, y) == pytest.approx(math.exp(-1))
    tilt = sg.Pupil(zernike=[0.0, 0.25])  # 2 x quarter waves: a sine of the image's shift
    assert tilt.transmission(x, y) == pytest.approx(np.exp(2j * np.pi * 0.25 * 2 * x))
    ramp = np.add.outer(np.arange(4.0), 1j * np.arange(5.0))  # cells 1/2 high and 2/5 wide
    expected = (y + 1) / 0.5 - 0.5 + 1j * ((x + 1) / 0.4 - 0.5)
    assert sg.Pupil(measured=ramp).transmission(x, y) == pytest.approx(expected)
    both = sg.Pupil(waist=0.5, measured=ramp)
    assert both.transmission(x, y) == pytest.approx(math.exp(-1) * expected)


@pytest.mark.parametrize("stop", [0.0, 0.45])
def test_cells_at_the_edge_count_by_their_share(stop):
    """The area is that of the disc or ring, within a tenth of the cells' own; whole cells would be worse."""
    cells = sg.Pupil(stop=stop).cells(31, 2 / 31)
    area = np.pi * (1 - stop**2)
    assert abs(cells.real.sum() * (2 / 31) ** 2 / area - 1) < 1e-3
    assert abs(np.round(cells.real).sum() * (2 / 31) ** 2 / area - 1) > 1e-3


def test_a_camera_is_a_value_that_is_written_and_read():
    pupil = sg.Pupil(stop=0.2, zernike=[0.0, 0.0, 0.0, 0.1], measured=[[1, 1j], [0.5, 1]])
    first = scene(focus=-3.0, magnification=20.0, pitch=20.0, pupil=pupil, side="reflection")
    assert sg.Scene.from_toml(first.to_toml()) == first
    assert first.side == -1
    x, y = first.sensor.positions
    assert (x[0], y[-1]) == (-7.5, 7.5)
    first.plot()


def test_files_with_a_camera_are_read_before_anybody_has_asked_for_one():
    read = "import sys; from specklegen.scene.scene import Scene; print(Scene.from_toml(sys.stdin.read()).sensor.type)"
    told = subprocess.run([sys.executable, "-c", read], input=scene().to_toml(), capture_output=True, text=True)
    assert told.stdout.strip() == "Imaging", told.stderr


@pytest.mark.parametrize(("field", "fields"), [
    ("Pupil.zernike", {"zernike": [0.0] * 232}), ("Pupil.measured", {"measured": np.ones(4)}),
    ("Pupil.measured", {"measured": np.zeros((3, 3))}), ("Pupil.stop", {"stop": 1.0}),
    ("Pupil.measured", {"measured": [[1, np.nan], [1, 1]]}), ("Pupil.waist", {"waist": 0.0}),
])  # fmt: skip
def test_bad_pupils_are_refused_by_name(field, fields):
    assert_refused(lambda: sg.Pupil(**fields), field)


def test_pixels_over_half_a_grain_are_refused_with_the_pitch_that_passes():
    with pytest.raises(sg.RuleError, match="Imaging.pitch") as error:
        scene(pitch=14.0, magnification=10.0)
    passing = number_of(error, "pitch <= ")
    assert passing == pytest.approx(10 / (4 * 0.2))
    scene(pitch=passing, magnification=10.0)
    scene(pitch=14.0, magnification=10.0, aperture=number_of(error, "aperture <= ") * 0.999)


@pytest.mark.parametrize("side", ["transmission", "reflection"])
def test_its_corners_are_those_of_the_square_around_the_aperture(side):
    corners = sg.Imaging(shape=(4, 4), pitch=1.0, aperture=0.2, side=side).corners
    np.testing.assert_allclose(np.abs(corners[:, :2]), 0.2)
    assert len(np.unique(corners[:, :2], axis=0)) == 4
    np.testing.assert_allclose(corners[:, 2], (1 if side == "transmission" else -1) * np.sqrt(1 - 2 * 0.2**2))


def test_apertures_that_no_light_fills_are_refused_with_the_one_that_passes():
    glass = SLAB.replace(faces=sg.Faces(inside=1.5))
    with pytest.raises(sg.RuleError, match="Imaging.aperture") as error:
        scene(glass, aperture=0.5, pitch=0.3)
    scene(glass, aperture=number_of(error, "use "), pitch=0.3)
    assert_refused(lambda: scene(aperture=0.8, pitch=0.3), "Imaging.aperture")


def test_other_media_lights_and_questions_are_refused_by_name():
    for medium, light in ((sg.PhaseScreen(rms_phase=3.0, correlation_length=20.0), BEAM),
                          (SLAB, sg.PointSources([[0.0, 0, -9]]))):  # fmt: skip
        with pytest.raises(sg.RuleError, match=r"Scene\.sensor"):
            scene(medium, light)
    seen = scene()
    for ask in (lambda: sg.covariance(seen, paths=100), lambda: next(sg.render_tiles(seen)), lambda: seen.views,
                lambda: sg.render_partially_coherent(seen, np.eye(1)), lambda: seen.grid,
                lambda: sg.plan(seen, sampler="covariance")):  # fmt: skip
        with pytest.raises((sg.RuleError, TypeError)) as error:
            ask()
        assert isinstance(error.value, sg.RuleError), error.value
