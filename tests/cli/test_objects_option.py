"""``--objects`` and ``--images``: other objects in front of the same slabs, in the same shape."""

import numpy as np
import pytest
from refusals import assert_refused

from specklegen.cli.recipe_options import load, load_hidden
from specklegen.datasets import load_recipe
from specklegen.datasets.objects import Folder, Points


def test_another_family_keeps_shape_and_slabs_and_no_field_of_the_old_one():
    found = load_hidden("one-angular-size", ["objects.shape=[20, 24]", "media_group=4"], objects="Points")
    assert found.objects == Points(shape=(20, 24))
    assert found.media_group == 4
    assert found.material == load_recipe("one-angular-size").material
    assert load("any-object", ["objects.count=7"],
                objects="Points").objects == Points(count=7)  # type: ignore[attr-defined]


def test_images_of_a_folder_take_the_place_of_any_family(tmp_path):
    for n in range(4):
        np.save(tmp_path / f"{n}.npy", np.full((4, 4), n + 1.0))
    for recipe in ("one-angular-size", "any-object"):
        found = load_hidden(recipe, None, images=tmp_path)
        assert isinstance(found.objects, Folder)
        assert found.objects.shape == (28, 28)
        assert found.objects.image(0, "train", 0).max() == 1


@pytest.mark.parametrize(("arguments", "message"), [
    (("one-angular-size", None, "folder", "Points"), "--objects must be left out where --images is given"),
    (("tilt-stack", None, None, "Points"), "recipe must be a recipe with hidden objects, for --images or --objects"),
    (("one-angular-size", ["objects=3"], None, "Points"), "--set objects must be a table where"),
    (("one-angular-size", None, None, "Ponits"), r"ObjectFamily\.type must be one of"),
])  # fmt: skip
def test_what_does_not_fit_is_refused(arguments, message):
    assert_refused(lambda: load(*arguments), message)
