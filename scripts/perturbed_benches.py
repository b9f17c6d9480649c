"""Ten benches that are not what they are said to be, for networks and verdicts: recipes, and what their pictures hold.

Each is one thing wrong with the setup of ``unknown-slab`` with ten characters held out; its images are drawn by the
recipe, so that they are functions of a seed.
"""

from collections.abc import Mapping
from typing import Any, cast

from specklegen.datasets import load_recipe
from specklegen.datasets.recipes.hidden_object import HiddenObject
from specklegen.datasets.recipes.recipe_files import changed

HELD_OUT: dict[str, Any] = {
    "objects": {"disjoint": "character", "test": "569BFMTVWt", "validation": "2KPbq"},
    "field": {"extent_over_range": 0.5},
}
"""Characters of the benchmark's split."""
_SLAB = {"thickness": 1000.0, "optical_depth": 10.0, "kernel": "estimate", "kernel_paths": 100_000}
"""One slab: memory effects outside of the atlas are estimated once."""
BENCHES: dict[str, Mapping[str, Any]] = {
    "clean": {},
    "blur": {"bench": {"blur": 2.0}},
    "analyser left out": {"light": {"polarised": False}},
    "fixed pattern": {"bench": {"unevenness": 0.1}},
    "rotation": {"bench": {"rotation": {"uniform": [-15.0, 15.0]}}},
    "magnification": {"bench": {"magnification": {"uniform": [0.9, 1.1]}}},
    "background gradient": {"bench": {"gradient": 0.8, "stray": 0.2}},
    "index step": {"material": {**_SLAB, "g": 0.9, "faces": {"inside": 1.4, "outside": 1.0}}},
    "vMF lobe": {"material": {**_SLAB, "scatterer": {"type": "VonMisesFisher", "concentration": 10.0}}},
    "ground glass": {
        "material": {"wavelength": 0.5, "screens": [{"type": "GroundGlass", "angle": 0.1},
                                                     {"type": "GroundGlass", "angle": 0.15}],
                     "gaps": [{"log_uniform": [500.0, 2000.0]}]},
    },
    "motion": {"bench": {"drift": 6.0}},
}  # fmt: skip
"""The clean bench and ten that differ from it, as changes of the recipe."""


def bench(name: str, more: Mapping[str, Any] | None = None) -> HiddenObject:
    """Recipe of a bench, with ``more`` changed."""
    return cast(HiddenObject, load_recipe("unknown-slab", changed(changed(HELD_OUT, BENCHES[name]), more or {})))
