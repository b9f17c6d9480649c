"""No unit of length matters to recipes: estimates of kernels, pilots and means are keyed by numbers without one.

The second unit is 1024 of the first: a power of two, so that sines that follow from lengths keep their last bit, and
with it the pilots of their scenes. With a factor of 1000 those may differ, as any two pilots do.
"""

import numpy as np
import pytest

from specklegen.datasets.recipes.registry import KINDS

UNIT = 1024.0
MATERIAL = {"wavelength": 0.5, "thickness": 1000.0, "optical_depth": 8.0, "g": 0.9, "kernel_paths": 1500}
SLAB = {"material": MATERIAL, "window": {"width": 50000.0}, "camera": {"shape": [16, 16]}}
TILTS = {"tilts": {"count": 2, "step": 1e-4}}
OBJECT = {"objects": {"type": "Glyphs", "shape": [8, 8]}, "field": {"extent_over_range": 0.5}}
BOX = {
    "material": {**MATERIAL, "thickness": 10.0, "optical_depth": 2.0, "kernel_paths": 300},
    "outline": {"width": 10.0},
    "window": {"width": 8.0},
    "camera": {"shape": [6, 6], "distance": 20.0},
}
LENS = {name: BOX[name] for name in ("material", "window")} | {
    "camera": {"shape": [6, 6]}, "lens": {"aperture": 0.2, "focus": -3.0},
}  # fmt: skip
CASES = {
    "tilt-stack": ("tilt-stack", SLAB | TILTS),
    "in a band": ("tilt-stack", SLAB | TILTS | {"light": {"bandwidth": 0.002}}),
    "hidden-object": ("hidden-object", SLAB | OBJECT),
    "by path sums": ("hidden-object", SLAB | OBJECT | {"sampler": "paths", "camera": {"shape": [8, 8]}}),
    "partially-coherent": ("partially-coherent", SLAB | {"coherence_length": 9000.0}),
    "volume-stack": ("volume-stack", BOX | TILTS),
    "lens-stack": ("lens-stack", LENS),
}
LENGTHS = {"wavelength", "thickness", "width", "distance", "bandwidth", "coherence_length", "focus"}
ONE_LENGTH = {"wavelength", "thickness", "mean_free_path", "width", "outline_width", "coherence_length", "bandwidth",
              "focus"}  # fmt: skip


def times(table, unit):
    """A table of a recipe with every length times ``unit``."""
    return {
        name: times(value, unit) if isinstance(value, dict) else value * unit if name in LENGTHS else value
        for name, value in table.items()
    }


def sample(case, unit, **changes):
    kind, table = CASES[case]
    table = times({**table, **changes}, unit)
    return KINDS[kind](name="units", **table).sample(3, "test", 1)


@pytest.mark.parametrize("case", CASES)
def test_samples_in_another_unit(case):
    """Kernels, pilots and means are estimated from the same paths: images differ by rounding alone."""
    one, other = sample(case, 1.0), sample(case, UNIT)
    for name in one.keys() - {"parameters"}:
        unit = UNIT if name in ONE_LENGTH else 1.0
        np.testing.assert_allclose(other[name], unit * one[name], rtol=0, atol=1e-5)  # of single precision, means are 1
    for name, value in one["parameters"].items():
        unit = UNIT if name in ONE_LENGTH else 1.0
        np.testing.assert_allclose(other["parameters"][name], unit * value, rtol=1e-6, err_msg=name)


def test_another_thickness_is_another_estimate():
    """Power: of a slab one in a thousand thicker, with the same optical depth, the images are others."""
    thicker = {"material": {**MATERIAL, "thickness": 1001.0}}
    one, other = sample("hidden-object", 1.0)["image"], sample("hidden-object", 1.0, **thicker)["image"]
    assert np.abs(one - other).max() > 1e-3
