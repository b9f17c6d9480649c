"""What the picture of tilted stacks says under each image: the correlation along the moved pattern."""

import numpy as np
import pytest

from specklegen import pictures
from specklegen.pictures import moved_correlation, round_length


@pytest.mark.parametrize("move", [(5, 0), (-3, 2), (0, -7), (4, 4)])
def test_a_pattern_that_only_moves_is_the_same(move):
    wide = np.random.default_rng(0).exponential(size=(40, 50))
    x, y = move
    first, image = wide[8:32, 8:40], wide[8 - y : 32 - y, 8 - x : 40 - x]
    assert moved_correlation(first, image, np.array(move)) == pytest.approx(1)
    assert abs(moved_correlation(first, image, -np.array(move))) < 0.5  # the other way it is another pattern


def test_where_nothing_overlaps_there_is_no_number():
    first = np.random.default_rng(0).exponential(size=(20, 20))
    assert moved_correlation(first, first, np.array([13, 0])) is not None
    for move in ([17, 0], [0, -20], [25, 3]):
        assert moved_correlation(first, first, np.array(move)) is None


@pytest.mark.parametrize(("most", "length"), [(0.0042, 0.002), (0.005, 0.005), (0.0099, 0.005), (34.0, 20.0)])
def test_a_scale_is_a_round_length_that_fits(most, length):
    assert round_length(most) == length


def test_a_scale_is_as_long_as_its_degrees(monkeypatch, tmp_path):
    """The bar in pixels times the pitch is the angle that its label says."""
    drawn = []
    monkeypatch.setattr(pictures, "_save", lambda figure, out: drawn.append(figure) or out)
    parameters = {"optical_depth": 10.0, "g": 0.9, "camera_pitch": np.deg2rad(0.0001)}
    tilts = np.deg2rad([[0.0, 0.0], [0.001, 0.0]])
    stack = np.random.default_rng(0).exponential(size=(2, 64, 64))
    pictures.tilt_strip([{"stack": stack, "tilts": tilts, "parameters": parameters}], tmp_path / "strip.png")
    (bar,) = drawn[0].axes[0].lines
    assert np.ptp(bar.get_xdata()) * 0.0001 == pytest.approx(0.002)
    assert [text.get_text() for text in drawn[0].axes[0].texts] == ["0.002°"]
    assert not drawn[0].axes[1].lines
