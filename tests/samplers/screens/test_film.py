"""Films of objects behind screens that move, against the closed form of every pair of beams and frames."""

import numpy as np
import pytest
from screen_objects import screen_objects
from zscore import assert_z, refute_z

import specklegen as sg
from specklegen.samplers.screens.film import film_error, film_of, frame_correlation
from specklegen.scene.window import Window
from specklegen.theory.phase_screens import lobes, tilt_ways

STRONG = sg.PhaseScreen(rms_phase=4.0, correlation_length=20.0)
PAIR = sg.ScreenStack(screens=(STRONG, STRONG), gaps=(800.0,))
THREE = sg.ScreenStack(screens=(STRONG,) * 3, gaps=(500.0, 300.0))
WINDOW = Window("square", 500.0)
PITCH = 4 / 1500  # of the object: four views of the camera
MOVED = np.array([[[0.0, 0.0], [0.0, 0.0]], [[1.5, 0.5], [0.0, 0.0]], [[3.0, 1.0], [0.0, 0.0]]])


@pytest.fixture(scope="module")
def images():
    """Images [R, pixel, F, H, W] of an object's three pixels in a row, in every frame of many media."""
    made = screen_objects(PAIR, wavelength=1.0, object_shape=(1, 3), object_pitch=PITCH,
                          grid=sg.FarField.grid((12, 12), 1 / 1500), base=np.zeros((3, 2)), width=500.0, moved=MOVED,
                          tolerance=1e-4)  # fmt: skip
    media = [made.medium(7, r) for r in range(200)]
    return np.array([[made.images(each, one[None]).numpy() for one in np.eye(3)] for each in media])


def covariances(images, sign):
    """Cov(I_j(v, frame 0), I_l(v', frame f)) over the product of means [R, pairs], v' moved as the light is."""
    # Pixel n sends its beam along minus its position: 4 views further down for the next one.
    mean = images.mean(axis=(0, 3, 4))
    found = []
    for j in range(3):
        for l in range(3):  # noqa: E741
            lag = 4 * (j - l)
            one = images[:, j, 0, :, max(-lag, 0) : 12 - max(lag, 0)] / mean[j, 0]
            for f in range(3):
                two = images[:, l, f, :, max(lag, 0) : 12 - max(-lag, 0)] / mean[l, f]
                found.append(((one - 1) * (two - 1)).mean((-2, -1)))
    return np.array(found).T, expected(sign)


def expected(sign):
    """|K|^2 of every pair; ``sign`` -1 lets the screens run backwards."""
    terms, found = lobes(PAIR, 1.0), []
    for j in range(3):
        for l in range(3):  # noqa: E741
            tilt = np.array([(l - j) * PITCH, 0.0])  # i_j - i_l
            found += [terms.decorrelation(tilt_ways(PAIR, tilt) - sign * moved) ** 2 for moved in MOVED]
    return np.array(found, float)


def test_every_pixel_in_every_frame_is_correlated_as_the_screens_say(images):
    found, exact = covariances(images, 1.0)
    kept = WINDOW.overlap(*(0.5 * MOVED[:, 0]).T) ** 2  # the pattern follows by half of the screen's way
    error = found.std(axis=0) / np.sqrt(len(found))
    # The envelope's slope between views, and 1e-4 of the modes left out.
    assert_z(found.mean(axis=0), exact * np.tile(kept, 9), error, degrees=len(found) - 1, slack=0.02)
    refute_z(found.mean(axis=0), expected(-1.0), error, degrees=len(found) - 1, slack=0.02)


def test_of_two_screens_frames_are_tilts():
    film = film_of(PAIR, 1.0, MOVED, WINDOW)
    np.testing.assert_allclose(film.tilts, MOVED[:, 0] / 800.0, rtol=1e-12)
    gone = 0.5 * (MOVED[:, None, 0] - MOVED[:, 0])
    np.testing.assert_allclose(film.kept, WINDOW.overlap(gone[..., 0], gone[..., 1]), rtol=1e-9)
    assert film_error(film, PAIR, 1.0, MOVED, WINDOW, 0.004) < 1e-4
    beam = frame_correlation(PAIR, 1.0, MOVED, WINDOW)
    np.testing.assert_allclose(beam, lobes(PAIR, 1.0).decorrelation(MOVED) * film.kept[0], rtol=1e-9)


def test_of_more_screens_what_rests_is_stated_and_refused_where_it_is_too_much():
    moved = np.stack([np.zeros((3, 2)), [[2.0, 0.0], [0.0, 2.0], [0.0, 0.0]]])
    film = film_of(THREE, 1.0, moved, WINDOW)
    assert film_error(film, THREE, 1.0, moved, WINDOW, 0.002) < 0.02
    assert film.kept[0, 1] < 0.99
    weak = sg.PhaseScreen(rms_phase=1.0, correlation_length=10.0)
    mixed = sg.ScreenStack(screens=(STRONG, weak, weak), gaps=(500.0, 300.0))
    moved = 4 * moved
    assert film_error(film_of(mixed, 1.0, moved, WINDOW), mixed, 1.0, moved, WINDOW, 0.01) > 0.02
    with pytest.raises(sg.RuleError, match="frames equal tilts within 0.02"):
        screen_objects(mixed, wavelength=1.0, object_shape=(1, 3), object_pitch=0.005,
                       grid=sg.FarField.grid((12, 12), 1 / 1500), base=np.zeros((2, 2)), width=500.0,
                       moved=moved)  # fmt: skip


def test_all_screens_together_and_a_single_one_leave_the_frames_to_the_window():
    together = np.stack([np.zeros((2, 2)), np.full((2, 2), 50.0)])
    for stack, moved in ((PAIR, together), (STRONG.stack, together[:, :1])):
        film = film_of(stack, 1.0, moved, WINDOW)
        np.testing.assert_allclose(film.tilts, 0.0, atol=1e-15)
        assert film.kept[0, 1] == pytest.approx(0.9**2, rel=1e-9)
