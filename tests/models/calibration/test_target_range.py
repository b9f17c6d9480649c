"""The memory-effect range from photographs of a known target, drawn here as waves that its points share in part."""

from functools import cache

import numpy as np
import pytest
from scipy.optimize import least_squares
from scipy.stats import norm

import specklegen as sg
from specklegen.core.errors import RuleError
from specklegen.models.calibration.target_range import BOUNDS, GAUSSIAN, Fall, RangeProfile, decay

FALSE_ALARM = 1e-4
LETTER = np.kron([[1, 1, 1], [1, 0, 0], [1, 1, 0], [1, 0, 0], [1, 0, 0]], np.ones((3, 3)))
GRAIN, SIDE, RANGE = 240 / 79, 160, 8.0  # the iris is 79 of 240 samples wide


@cache
def photographs(reach, power, count=4):
    """Photographs of the letter behind new places of a medium of C_I = 2^-(d / reach)^power, square iris."""
    rng = np.random.default_rng([int(10 * min(reach, 1e3)), int(10 * power)])
    points = np.argwhere(LETTER > 0)
    apart = np.hypot(*(points[:, None] - points[None]).transpose(2, 0, 1))
    shares, modes = np.linalg.eigh(2.0 ** (-0.5 * (apart / reach) ** power))  # waves have the root of C_I in common
    modes = (modes * np.sqrt(shares.clip(0)))[:, shares > 1e-4 * shares.max()]
    side = SIDE + 80
    x = np.abs(np.fft.fftfreq(side)) * GRAIN * 2
    found = np.zeros((count, SIDE, SIDE))
    for image in found:
        white = rng.normal(size=(modes.shape[1], side, side, 2)) @ [1, 1j]
        waves = np.fft.ifft2((np.maximum(x[:, None], x) < 1) * white)
        for (row, column), own in zip(points, modes, strict=True):
            image += np.abs(np.tensordot(own, waves[:, 15 - row :, 15 - column :][:, :SIDE, :SIDE], 1)) ** 2
    return found


@cache
def fit(reach, power):
    light = photographs(reach, power)
    return sg.fit_setup(light, envelope=None, pixel_integration=False, profile="square", target=LETTER)


@pytest.mark.slow
@pytest.mark.parametrize("power", [1.0, pytest.param(2.0, marks=pytest.mark.slow)])
def test_the_range_is_found(power):
    found = fit(RANGE, power)
    low, high = found.interval(1 - FALSE_ALARM)["range"]
    assert low < RANGE < high
    low, high = found.interval(0.95)["range"]
    assert 0.5 * RANGE < low < found.range < high < 2 * RANGE
    assert abs(found.grain - GRAIN) < norm.isf(FALSE_ALARM / 2) * found.grain_error
    assert not found.doubts
    assert f"{low:.3g} to {high:.3g}" in found._facts()["range"]


def test_a_range_two_fifths_longer_is_excluded():
    """A mutation of the medium that fits."""
    assert fit(RANGE, 2.0).interval(0.95)["range"].high < 1.4 * RANGE


@pytest.mark.parametrize("fall", [GAUSSIAN, Fall(0.1, 0.6), Fall(1.7, 0.05), Fall(4.0, 2.0)])
def test_the_form_is_one_half_at_the_range_and_begins_as_a_gaussian_function(fall):
    assert decay(np.array([0.0, 1.0]), fall) == pytest.approx([1.0, 0.5], rel=1e-12)
    near = -np.log(decay(np.array([1e-3, 2e-3]), fall))
    assert near[1] / near[0] == pytest.approx(4, rel=1e-3)
    assert (np.diff(decay(np.linspace(0, 8, 100), fall)) < 0).all()


def test_the_form_has_its_limits():
    x = np.linspace(0, 3, 31)
    np.testing.assert_allclose(decay(x, GAUSSIAN), 2.0 ** -(x**2), rtol=1e-12)
    np.testing.assert_allclose(decay(x, Fall(1e-6, 1.3)), 2.0 ** -(x**1.3), rtol=1e-6)


def test_the_form_holds_a_thick_slab_which_no_power_does():
    """(q / sinh q)^2, what is left of diffuse light through a slab, up to twice its range."""
    q = np.linspace(0.02, 2, 50) * 1.4914  # (q / sinh q)^2 = 1 / 2 there
    slab, apart = np.square(q / np.sinh(q)), q / 1.4914
    assert np.interp(1, apart, slab) == pytest.approx(0.5, abs=1e-3)

    def off(at):
        return decay(apart * np.exp(at[2]), Fall(np.exp(at[0]), at[1])) - slab

    low, high = np.array([*BOUNDS, (-0.3, 0.3)]).T
    held = least_squares(off, [0.5, 1.0, 0.0], bounds=(low, high))
    assert np.abs(held.fun).max() < 1e-3
    assert abs(held.x[2]) < 2e-3
    plain = least_squares(lambda at: 2.0 ** -((apart * np.exp(at[1])) ** at[0]) - slab, [1.5, 0.0])
    assert np.abs(plain.fun).max() > 5e-3


@pytest.mark.parametrize("top", [6.6, 7.3, 8.1])
def test_the_likeliest_range_lies_between_those_tried(top):
    """Of a parabola in ln(range), whose places are not evenly apart, exactly its top."""
    ranges = np.array([3.0, 5.0, 6.0, 6.5, 7.2, 8.3, 9.0, 14.0, 40.0])
    likely = -0.5 * np.square(np.log(ranges / top) / 0.2)
    assert RangeProfile(ranges, (GAUSSIAN,) * len(ranges), likely, 40).best == pytest.approx(top, rel=1e-9)


def test_a_target_within_the_range_leaves_it_open_above():
    found = fit(np.inf, 2.0)
    low, high = found.interval(0.95)["range"]
    assert np.isinf(high)
    assert low > 15  # a letter of 15 pixels
    assert "above" in found._facts()["range"]


def test_the_memory_effect_is_one_half_at_the_range():
    found = fit(RANGE, 2.0)
    np.testing.assert_allclose(found.memory_effect(np.array([0.0, found.range, -found.range])), [1, 0.5, 0.5])


def test_another_target_is_doubted():
    """A mutation of the target: the letter lies on its side."""
    light = photographs(np.inf, 2.0, 16)
    found = sg.fit_setup(light, envelope=None, pixel_integration=False, profile="square", target=LETTER.T)
    assert any("speckle of this target behind" in doubt for doubt in found.doubts)


def limited(before, reach=4.0, grain=2.8, side=144, ways=12):
    """Photographs through a disc before or behind a medium whose ways aside are Gaussian: C_I is one half at ``reach``.
    A point sends b(x) e^(i p . x) to the places x, from where it goes to x + r; or to all, and b(x + r) is let
    through."""
    rng, count = np.random.default_rng(1), 2 * side
    x = np.arange(count) - side
    target = np.kron(LETTER[::3, ::3], np.ones((2, 2)))
    found = np.zeros((4, count, count))
    for image in found:
        aside = rng.normal(0, np.sqrt(np.log(2)) * count / (2 * np.pi * reach), (ways, 2))
        waves = rng.normal(size=(ways, count, count, 2)) @ [1, 1j]
        for (down, across), wave in zip(aside, waves, strict=True):
            wave *= np.hypot((x - before * down)[:, None], x - before * across) < count / grain / 2
        for at in np.argwhere(target > 0):
            along = [np.exp(-2j * np.pi / count * p * (x - aside[:, [axis]])) for axis, p in enumerate(at)]
            image += np.abs(np.fft.fft2(np.einsum("nyx,ny,nx->yx", waves, *along, optimize=True))) ** 2
    return found[:, :side, :side], target


@pytest.mark.slow
def test_light_that_is_limited_before_the_medium_is_doubted():
    """C_I stands at the camera's distances then, and speckle has too much contrast."""
    behind, before = (
        sg.fit_setup(light, envelope=None, pixel_integration=False, target=target)
        for light, target in map(limited, (0, 1))
    )
    low, high = behind.interval(1 - FALSE_ALARM)["range"]
    assert low < 4.0 < high
    assert not any("contrast" in doubt for doubt in behind.doubts)
    assert any("contrast" in doubt and "in front of the medium" in doubt for doubt in before.doubts)


def test_a_point_tells_no_range():
    rng = np.random.default_rng(3)
    x = np.abs(np.fft.fftfreq(240)) * GRAIN * 2
    waves = np.fft.ifft2((np.maximum(x[:, None], x) < 1) * (rng.normal(size=(2, 240, 240, 2)) @ [1, 1j]))
    light = np.abs(waves[:, :SIDE, :SIDE]) ** 2
    arguments = {"envelope": None, "pixel_integration": False, "profile": "square"}
    plain, shown = sg.fit_setup(light, **arguments), sg.fit_setup(light, target=np.ones((1, 1)), **arguments)
    assert plain.range is None
    assert "range" not in plain.interval()
    assert (shown.grain, shown.contrast) == (plain.grain, plain.contrast)
    assert shown.interval()["range"] == (0, np.inf)


@pytest.mark.parametrize(("wrong", "field"), [({"target": np.ones((2, 2, 2))}, "target"),
                                              ({"target": np.ones((1, 129))}, "target"),
                                              ({"target": -LETTER}, "target"), ({"target": np.zeros((3, 3))}, "target"),
                                              ({"target": LETTER, "target_step": 0.0}, "target_step")])  # fmt: skip
def test_refusals(wrong, field):
    with pytest.raises(RuleError, match=f"^fit_setup {field} must be"):
        sg.fit_setup(photographs(np.inf, 2.0), envelope=None, **wrong)
