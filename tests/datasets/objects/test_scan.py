"""A scan shows, a spot at a time, one page of pictures; its light is what a camera would measure of it."""

import numpy as np
import pytest
from refusals import assert_refused

from specklegen.core.errors import RuleError
from specklegen.datasets import load_recipe
from specklegen.datasets.objects import Glyphs, Points, Scan
from specklegen.datasets.objects.scan import spot_of
from specklegen.datasets.split import SPLITS

SCAN = Scan(shape=(10, 12), grid=(3, 5), step=4, of=Glyphs(shape=(9, 9)))
COUNT = 15


def test_a_page_is_pictures_edge_to_edge():
    page = SCAN.page(3, "test", 2)
    assert page.shape == SCAN.wide == (18, 28)
    assert page.dtype == np.float32
    each = [SCAN.of.image(3, "test", 2 * 8 + n) for n in range(8)]  # 2 rows of 4, of which the last is cut off
    np.testing.assert_array_equal(page[:9, :9], each[0])
    np.testing.assert_array_equal(page[9:, 18:27], each[6])
    np.testing.assert_array_equal(page[:9, 27:], each[3][:, :1])


@pytest.mark.parametrize("split", SPLITS)
def test_samples_times_their_light_are_the_page_under_the_spot(split):
    """Row by row, then the next page; what is told of a sample puts it where it belongs."""
    for index in range(2 * COUNT):
        told = SCAN.labels(SCAN.source(7, split, index))
        number, row, column = (int(told[name]) for name in ("page", "scan_row", "scan_column"))
        assert index == COUNT * number + 5 * row + column
        assert (SCAN.places[index % COUNT] == (4 * row, 4 * column)).all()
        page = SCAN.page(7, split, number)[4 * row : 4 * row + 10, 4 * column : 4 * column + 12]
        image = SCAN.image(7, split, index)
        expected = page * spot_of((10, 12))
        np.testing.assert_allclose(image * told["light"] / image.sum(dtype=float), expected, atol=1e-6)
        assert list(told) == list(SCAN.label_names)


def test_spots_of_half_a_side_add_up_to_even_light():
    light = np.zeros((20, 24))
    for row in range(0, 11, 5):
        for column in range(0, 13, 6):
            light[row : row + 10, column : column + 12] += spot_of((10, 12))
    np.testing.assert_allclose(light[5:15, 6:18], 1.0)


def test_what_a_sample_tells_of_its_place_is_that_of_its_image():
    recipe = load_recipe("wide-field", {"camera": {"shape": [64, 64]}, "objects": {"grid": [2, 3]}})
    batch = recipe.batch(0, "test", [0, 4])
    assert batch["parameters"]["scan_row"].tolist() == [0, 1]
    assert batch["parameters"]["scan_column"].tolist() == [0, 1]
    page = recipe.objects.page(0, "test", 0)[5:21, 5:21] * spot_of((16, 16))
    assert batch["parameters"]["light"][1] == pytest.approx(page.sum())
    np.testing.assert_allclose(batch["object"][1], page / page.max(), atol=1e-6)


@pytest.mark.parametrize(("change", "rule"), [
    ({"step": 11}, r"Scan\.step must be at most the side of the spot, 10"),
    ({"grid": (10**6, 10**6)}, r"Scan\.grid must be such that a page has at most"),
    ({"of": SCAN}, r"Scan\.of must be a family of pictures"),
])  # fmt: skip
def test_scans_that_see_nothing_whole_are_refused(change, rule):
    with pytest.raises(RuleError, match=rule):
        Scan(**{"shape": (10, 12), "grid": (3, 5), "step": 4, "of": Points(shape=(9, 9))} | change)


def test_a_spot_on_darkness_is_refused():
    lonely = Scan(shape=(4, 4), grid=(1, 20), step=4, of=Points(shape=(40, 40)))
    dark = next(n for n in range(20) if not lonely.lit(0, "train", n).any())
    assert_refused(lambda: lonely.image(0, "train", dark), "Scan picture must be brighter than 0 somewhere")
