"""A layer of random index as a recipe's medium: the slab of equal coherent transmission."""

import numpy as np
import pytest
from refusals import assert_refused

from specklegen.datasets import load_recipe
from specklegen.datasets.recipes.parts.material import Material
from specklegen.fdtd import RandomLayer

LAYER = {"n_points": 14_000, "dx": 0.01, "rms_index": 0.1, "correlation_length": 0.05}
TABLE = {"wavelength": 0.5, "layer": LAYER, "g": 0.9}


def by_hand(rms=0.1):
    """Optical depth (k^2 / 4) [S(0) + S(2k)] L, S(q) = 2 L_c [a^2 / (1 + q^2 L_c^2) + b^2 / (1 + q^2 L_c^2 / 4)]."""
    k, lc, a, b = 2 * np.pi / 0.5, 0.05, 2 * rms / 1.45, (rms / 1.45) ** 2
    power = lambda q: 2 * lc * (a**2 / (1 + (q * lc) ** 2) + b**2 / (1 + (q * lc) ** 2 / 4))  # noqa: E731
    return k**2 / 4 * (power(0) + power(2 * k)) * 140.0


def test_a_layer_is_a_slab():
    """Thickness and optical depth by hand; written and read again; 3 % of the index are caught."""
    made = Material(**TABLE)
    assert made.thickness == pytest.approx(140.0)
    assert made.optical_depth == pytest.approx(by_hand(), rel=1e-12)
    assert made.optical_depth != pytest.approx(by_hand(1.03 * 0.1), rel=0.05)
    assert Material(**made.model_dump()) == made
    assert made.layer == RandomLayer(**LAYER)


def test_a_recipe_takes_it():
    """Samples tell the slab's numbers; light that is not scattered falls as the layer's coherent wave."""
    made = load_recipe("through-slab", {"material": {**TABLE, "kernel_paths": 500}, "camera": {"shape": [32, 32]}})
    told = made.sample(0, "train", 0)["parameters"]
    assert told["optical_depth"] == pytest.approx(by_hand())
    assert told["ballistic_fraction"] == pytest.approx(np.exp(-by_hand()), rel=1e-9)


def test_refused():
    assert_refused(lambda: Material(**TABLE | {"thickness": 9.0}), "left out, since it follows from layer")
    assert_refused(lambda: Material(layer=LAYER, g=0.9), "Material.wavelength")
    thin = {**LAYER, "correlation_length": 30.0}
    assert_refused(lambda: Material(**TABLE | {"layer": thin}), "that a slab describes")
