"""Packaged recipes with few paths a kernel, and those of them that stand for the others."""

import pytest

from specklegen.datasets import load_recipe, recipe_names

KIN = {"any-object": "unknown-slab", "characters-of-new-fonts": "unknown-slab", "one-angular-size": "unknown-slab",
       "unseen-material": "unknown-slab", "through-slab-lab": "through-slab", "brownian-slab": "dynamic-slab",
       "ground-glass-bench": "ground-glass", "tissue-bench": "unknown-slab", "coherent-phase": "coherent-digits",
       "registered-tilts": "material-regression", "star-behind-slab": "masked-light-slab",
       "tissue-microscope": "refocus-stack", "wide-field": "unknown-slab",
       "points-beyond-range": "unknown-slab", "screen-stack": "double-diffuser"}  # fmt: skip
"""Recipes that another one's program draws, from other numbers or objects: slow tests look at them too."""


def packaged(which=lambda name: True):
    """Names of the packaged recipes for which ``which`` holds, as a test's parameters."""
    names = filter(which, recipe_names())
    return [pytest.param(name, marks=pytest.mark.slow) if name in KIN else name for name in names]


SMALLER = {"flow-vessel": {"camera": {"shape": [32, 32]}, "exposures": {"durations": [2e-4, 1e-3]}},
           "ground-glass-bench": {"camera": {"shape": [96, 96]}},
           "tissue-bench": {"camera": {"shape": [200, 200]}}, "refocus-stack": {"lens": {"planes": 2}}}  # fmt: skip
"""Changes of recipes whose images take long: fewer pixels, exposures or planes."""


def few_paths(name, count=1000):
    """Changes after which a recipe's kernels take ``count`` paths; none for thin screens, which trace no paths."""
    traced = "kernel_paths" in type(load_recipe(name).material).model_fields
    return {"material": {"kernel_paths": count}} if traced else {}


def quick_recipe(name, count=1000, **changes):
    """A packaged recipe, changed; what is given takes the place of its changes."""
    return load_recipe(name, {**few_paths(name, count), **SMALLER.get(name, {}), **changes})
