"""Fits of setups: grain, iris, contrast and noise of speckle summed here over an iris; what is told and refused."""

from functools import cache

import numpy as np
import pytest
import torch
from refusals import assert_refused
from scipy.stats import norm, t, ttest_1samp

import specklegen as sg
from specklegen.measured import read_measurement
from specklegen.models.calibration import setup_fit
from specklegen.models.calibration.grain_fit import fit_grain

FALSE_ALARM = 1e-6
SURE = norm.isf(FALSE_ALARM / 2)


def speckle(seed, count, side, grain, profile="disc", pixel=1, polarisations=(1.0,), noise=0.0, stretch=1.0, moved=0):
    """Frames [count, side, side] of waves through an iris, summed by a transform of its own, over twice the frame. The
    light of a point, or of two that lie ``moved`` pixels apart. The iris is an odd number of samples wide, and the
    grain what is nearest to the one asked for."""
    rng = np.random.default_rng(seed)
    points = 2 * side * pixel
    width = 2 * int(points / (grain * pixel) / 2) + 1
    x = np.arange(points) - points // 2
    r2 = np.add.outer((x / stretch) ** 2, x**2)
    iris = {"disc": r2 < (width / 2) ** 2, "gaussian": np.exp(-4 * r2 / width**2),
            "square": np.logical_and.outer(np.abs(x) < width / 2, np.abs(x) < width / 2)}[profile]  # fmt: skip

    def one():
        waves = rng.normal(size=(points, points)) + 1j * rng.normal(size=(points, points))
        seen = np.abs(np.fft.ifft2(iris * waves)) ** 2
        return seen / seen.mean()

    frames = []
    for _ in range(count):
        light = sum(share * one() for share in polarisations)
        light = light + np.roll(light, moved, 1) if moved else light
        cells = light.reshape(2 * side, pixel, 2 * side, pixel).mean((1, 3))[:side, :side]
        frames.append(cells / cells.mean() + noise * rng.normal(size=cells.shape) + 1e-9)
    return np.array(frames)


def grain_of(side, grain):
    """The grain of frames of ``speckle``."""
    return 2 * side / (2 * int(side / grain) + 1)


@cache
def fit(profile, grain=4.0, count=2):
    return sg.fit_setup(speckle(3, count, 192, grain, profile), envelope=None, pixel_integration=False)


@pytest.mark.parametrize("profile", ["disc", "square", "gaussian"])
def test_shape_grain_and_contrast_are_found(profile):
    found = fit(profile)
    assert found.profile == profile
    assert abs(found.grain - grain_of(192, 4)) < SURE * found.grain_error < 0.5
    assert abs(found.contrast - 1) < SURE * found.contrast_error < 0.3
    assert found.behind[profile] == 0
    assert min(far for name, far in found.behind.items() if name != profile) > 2
    assert not found.doubts


def test_another_scale_is_another_grain():
    """A mutation: grains 15 % off are many standard errors away."""
    found = fit("disc")
    assert abs(found.grain - 1.15 * grain_of(192, 4)) > SURE * found.grain_error


def test_area_of_pixels_polarisation_and_noise():
    light = speckle(5, 2, 160, 3.0, "square", 3, (0.5, 0.5), 0.1)
    found = sg.fit_setup(light, envelope=None)
    assert found.profile == "square"
    for value, error, truth in (
        (found.grain, found.grain_error, grain_of(160, 3.0)), (found.contrast, found.contrast_error, np.sqrt(0.5)),
        (found.noise, found.noise_error, 0.1),
    ):  # fmt: skip
        assert abs(value - truth) < SURE * error < truth
    points = sg.fit_setup(light, envelope=None, pixel_integration=False, profile="square")
    assert points.grain > found.grain + 3 * found.grain_error  # the pixels' area, taken for a grain's
    assert set(points.behind) == {"square"}


def test_two_points_and_a_long_iris_are_doubted():
    two = sg.fit_setup(speckle(7, 2, 192, 4.0, moved=12), envelope=None, pixel_integration=False)
    long = sg.fit_setup(speckle(8, 2, 192, 4.0, stretch=1.5), envelope=None, pixel_integration=False)
    assert all(any("speckle of one point behind" in doubt for doubt in each.doubts) for each in (two, long))


def test_the_misfit_of_one_number_is_student_s_test():
    """Of one column Hotelling's law is the square of Student's, of ten tiles with nine degrees of freedom."""
    left = np.random.default_rng(4).normal(0.6, 1.0, 10)
    edges = setup_fit._EDGES
    expected = 2 * t.sf(ttest_1samp(left, 0.0).statistic / edges, 9)
    assert setup_fit._hotelling(left[:, None]) == pytest.approx(expected, rel=1e-9)
    assert setup_fit._hotelling(left[:, None][:, :0]) == 1


def test_an_envelope_is_taken_off():
    beam = np.exp(-np.square(np.linspace(-1, 1, 192)))
    light = speckle(3, 2, 192, 4.0) * np.outer(beam, beam)
    found = sg.fit_setup(1000 * light, pixel_integration=False)
    assert found.profile == "disc"
    assert found.measured.envelope_order is not None
    assert found.measured.envelope_order >= 2
    assert abs(found.grain - grain_of(192, 4)) < SURE * found.grain_error
    assert abs(found.contrast - 1) < SURE * found.contrast_error


def test_frames_of_one_pattern_count_once():
    light = speckle(3, 1, 192, 4.0)
    noise = 0.1 * np.random.default_rng(0).normal(size=(4, 192, 192))
    found = sg.fit_setup(light + noise, envelope=None, pixel_integration=False)
    assert any("one pattern" in doubt for doubt in found.doubts)
    assert abs(found.noise - 0.05) < SURE * found.noise_error
    alone = sg.fit_setup(light, envelope=None, pixel_integration=False)
    assert found.tiles == alone.tiles


def test_it_is_seen_told_and_used():
    found = fit("disc")
    assert "grain=" in repr(found)
    assert found.plot().get_xlabel().startswith("frequency")
    assert "95 %" in found._facts()["grain"]
    near, far = found.interval(0.5)["grain"], found.interval(0.99)["grain"]
    assert far.low < near.low < found.grain < near.high < far.high
    optics = found.optics(2.0)
    assert (optics.step, optics.grain, optics.profile, optics.pixel_integration) == (2.0, found.grain, "disc", False)


@pytest.mark.parametrize(("changes", "rule"), [
    ({"photographs": np.ones((40, 40))}, "of speckle"), ({"photographs": speckle(0, 1, 64, 4.0)}, "9 tiles of"),
    ({"profile": "round"}, "fit_setup profile must be"),
    ({"pixel_integration": 1}, "fit_setup pixel_integration must be"),
])  # fmt: skip
def test_what_is_refused(changes, rule):
    assert_refused(lambda: sg.fit_setup(**{"photographs": speckle(0, 1, 128, 2.0), "envelope": None} | changes), rule)


EVEN = {"constant": np.full((96, 96), 500.0), "saturated": np.full((96, 96), 4095.0), "one bright pixel": np.pad(
    [[4000.0]], ((48, 47), (48, 47)), constant_values=100),
    "constant at two levels": np.stack([np.full((96, 96), level) for level in (200.0, 300.0)]),
    "one of two frames": np.stack([speckle(0, 1, 96, 4.0)[0], np.ones((96, 96))])}  # fmt: skip


@pytest.mark.parametrize("name", EVEN)
def test_frames_without_speckle_are_refused_in_a_sentence(name):
    """One bright pixel is hot. Fits of their envelope leave rounding."""
    seen = read_measurement(EVEN[name], envelope="fit")
    for verb in (
        lambda: sg.fit_setup(EVEN[name]), lambda: sg.twin(EVEN[name], images=8), lambda: sg.twin(seen, "tilt-stack"),
        lambda: fit_grain(torch.tensor(EVEN[name]).reshape(-1, 96, 96), 8),
        lambda: seen.require_speckle("reconstruct IMAGE"),
    ):  # fmt: skip
        assert_refused(verb, "must be (of )?speckle.*(even|contrast)")


@pytest.mark.slow
def test_intervals_hold_the_truth():
    """Of 60 sets of three irises: how often 95 % intervals hold grain and contrast, the rms error below 2 %."""
    held, errors, truth = [], [], grain_of(192, 3.5)
    for seed in range(20):
        for profile in ("disc", "square", "gaussian"):
            found = sg.fit_setup(speckle(100 + seed, 2, 192, 3.5, profile), envelope=None, pixel_integration=False,
                                 profile=profile)  # fmt: skip
            bounds = found.interval()
            held.append([truth in bounds["grain"], 1.0 in bounds["contrast"]])
            errors.append(found.grain / truth - 1)
    share = np.mean(held, axis=0)
    assert (share > 0.95 - SURE * np.sqrt(0.95 * 0.05 / len(held))).all()
    assert np.sqrt(np.mean(np.square(errors))) < 0.02
