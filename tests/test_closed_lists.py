"""Lists of names that no user adds to, and that stand in two places, are the same in both."""

from typing import get_args, get_type_hints

import pytest

from specklegen.cli import recipe_options, scenes, stores
from specklegen.datasets.loading.export import export
from specklegen.datasets.recipes.parts import material
from specklegen.datasets.split import SPLITS
from specklegen.datasets.split import Split as SplitName
from specklegen.memory_effects import curve
from specklegen.scene import sensors

SIDES = get_args(sensors.Side)


def names_of(function, argument):
    """Members of the literal that annotates an argument."""
    hint = get_type_hints(function)[argument]
    return get_args(get_args(hint)[0] if not isinstance(get_args(hint)[0], str) else hint)


@pytest.mark.parametrize(("one", "other"), [
    (get_args(SplitName), tuple(SPLITS)), (get_args(get_args(recipe_options.Split)[0]), tuple(SPLITS)),
    (get_args(curve.Mode), SIDES), (names_of(scenes.memory_effect_command, "mode"), SIDES),
    (names_of(stores.export, "format"), names_of(export, "format")),
    (get_args(material.SplitRanges.model_fields["parameter"].annotation), material._PARAMETERS),
])  # fmt: skip
def test_they_are_one_list(one, other):
    assert one
    assert one == other
