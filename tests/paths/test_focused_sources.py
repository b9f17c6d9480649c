"""The script that measures what focused sources are worth: walks moved to the light estimate what even starts do."""

import numpy as np
import pytest
from scenes import script_at
from zscore import assert_z, refute_z


@pytest.fixture(scope="module")
def script():
    return script_at("scripts/focused_sources.py")


@pytest.fixture(scope="module")
def found(script):
    return script.measured(script.scene_of(40.0, 20.0, 20.0, 6.0), 20_000)


def means(way):
    return way.means.mean(), way.means.std(ddof=1) / np.sqrt(len(way.means))


def test_moved_walks_estimate_what_even_starts_do(found, script):
    (points, one), (moved, other) = means(found["points"]), means(found["moved"])
    assert_z(points, moved, np.hypot(one, other), degrees=script.BATCHES - 1)
    # Weighed as if even starts kept to the window, and not to where its tilted beams drift too, they would be:
    refute_z(points, 3 * moved, np.hypot(one, 3 * other), degrees=script.BATCHES - 1)


def test_the_closed_form_has_next_to_no_bias(found, script):
    """It attenuates along the axis, as slanting rays are not."""
    (focused, one), (moved, other) = means(found["focused"]), means(found["moved"])
    assert_z(focused, moved, np.hypot(one, other), degrees=script.BATCHES - 1, slack=0.01 * moved)
    refute_z(1.3 * focused, moved, np.hypot(1.3 * one, other), degrees=script.BATCHES - 1, slack=0.01 * moved)


def test_moved_walks_vary_less(found):
    assert found["points"].relative_variance > 10 * found["focused"].relative_variance
