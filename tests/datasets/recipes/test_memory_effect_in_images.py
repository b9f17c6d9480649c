"""C_I between two points of an object, measured through rendered images: right within 1 % at `mode_tolerance` .001.

Each point alone is imaged through the same media; moved back by the angle between them, their speckles correlate by C_I
of the material, K squared. False-alarm rate 1e-6, shared by the comparisons.
"""

import numpy as np
import pytest
from scipy.stats import norm

from specklegen.datasets import load_recipe
from specklegen.datasets.recipes.hidden_object import HiddenObject

FALSE_ALARM = 1e-6
MEDIA = 80
ALLOWED = 0.01
MATERIALS = {  # objects 2.7 and 3.9 memory-effect ranges wide
    "three ranges": {"thickness": 3000.0, "optical_depth": 15.0, "g": 0.85},
    "four ranges": {"thickness": 4000.0, "optical_depth": 20.0, "g": 0.72},
}
APART = 4
"""Object pixels between the points: 6 camera pixels, where C_I is about 0.85 and seen to 1e-3."""
PLACES = ((3, 2), (13, 9), (24, 17))


def recipe_of(material, tolerance) -> HiddenObject:
    changes = {"mode_tolerance": tolerance, "material": MATERIALS[material]}
    recipe = load_recipe("one-angular-size", changes)
    assert isinstance(recipe, HiddenObject)
    return recipe


def correlations(recipe):
    """Correlation of the speckle of two points over that of the kernel, less 1: its mean and standard error over media.
    With x and y the fluctuations of unit speckle, <x y> - C (<x x> + <y y>) / 2 is 0 in the mean, and varies little."""
    known = recipe.material_of(0, "test", 0)
    pitch = recipe.field.pitch
    ideal = float(known.correlation(2 * np.pi / recipe.wavelength * APART * pitch)) ** 2
    shift = APART * pitch / recipe.geometry.grid.pitch
    assert shift == pytest.approx(round(shift), abs=1e-9)
    found = []
    for medium in range(MEDIA):
        ready = recipe.prepare(0, "test", medium)
        off = []
        for row, column in PLACES:
            seen = []
            for place in (column, column + APART):
                point = np.zeros(recipe.objects.shape)
                point[row, place] = 1
                seen.append(ready.images(point)[0].astype(np.float64) - 1)
            # The image appears turned by 180 degrees or not: of the two shifts one brings the speckles together.
            one, other = seen
            n = round(shift)
            pairs = [(one[:, n:], other[:, :-n]), (one[:, :-n], other[:, n:])]
            x, y = max(pairs, key=lambda pair: (pair[0] * pair[1]).mean())
            off.append((x * y).mean() - ideal * (x * x + y * y).mean() / 2)
        found.append(np.mean(off) / ideal)
    return np.mean(found), np.std(found, ddof=1) / np.sqrt(MEDIA)


def assert_right(off, error):
    limit = norm.isf(FALSE_ALARM / (2 * len(MATERIALS))) * error
    assert limit < ALLOWED / 2, f"the measurement must see 1 %: {limit:.4f}"
    assert abs(off) < ALLOWED - limit, f"C_I is off by {off:+.4f} +- {error:.4f}, allowed {ALLOWED}"


@pytest.mark.parametrize("material", MATERIALS)
def test_c_i_through_images_is_right_within_one_percent(material):
    assert_right(*correlations(recipe_of(material, load_recipe("one-angular-size").mode_tolerance)))


def test_a_tolerance_of_one_percent_is_found_wrong():
    """Power: the default of older recipes is 1.3 % off here."""
    with pytest.raises(AssertionError, match="C_I is off by"):
        assert_right(*correlations(recipe_of("four ranges", 0.01)))
