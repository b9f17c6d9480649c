"""The memory-effect range from photographs of a known target, drawn here as waves that its points share in part."""

from functools import cache

import numpy as np
import pytest
from scipy.stats import norm

import specklegen as sg
from specklegen.core.errors import RuleError

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


@pytest.mark.parametrize("power", [1.0, 2.0])
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
    assert any("no speckle of this target" in doubt for doubt in found.doubts)


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


@pytest.mark.parametrize(
    ("wrong", "field"),
    [
        ({"target": np.ones((2, 2, 2))}, "target"), ({"target": np.ones((1, 129))}, "target"),
        ({"target": -LETTER}, "target"), ({"target": np.zeros((3, 3))}, "target"),
        ({"target": LETTER, "target_step": 0.0}, "target_step"),
    ],
)  # fmt: skip
def test_refusals(wrong, field):
    with pytest.raises(RuleError, match=f"^fit_setup {field} must be"):
        sg.fit_setup(photographs(np.inf, 2.0), envelope=None, **wrong)
