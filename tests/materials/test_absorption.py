"""Absorption of tissues: known points of the spectra, sums of shares, and what recipes draw of them."""

import numpy as np
import pytest
from refusals import assert_refused

import specklegen as sg
from specklegen.datasets import load_recipe
from specklegen.materials import absorption


def found(material):
    """Absorption of a bulk, 1 / mm."""
    return 1e3 * (1 - material.albedo) / material.mean_free_path


def test_blood_absorbs_as_others_print_it():
    """4.38 / cm at 806 nm (Jacques 2013); of a tissue that holds 3 %, 7.7 / mm at 420 nm and .9 at 540 with oxygen."""
    assert absorption.blood(0.806, 0.75) == pytest.approx(0.438, rel=0.01)
    assert 0.03 * absorption.blood(0.42, 1.0) == pytest.approx(7.7, rel=0.01)
    assert 0.03 * absorption.blood(0.54, 1.0) == pytest.approx(0.9, rel=0.06)
    # decadic molar extinction of oxygenated haemoglobin at 500 nm, 20932.8 / cm / (mol / l), computed here anew
    assert absorption.blood(0.5, 1.0) == pytest.approx(np.log(10) * 20932.8 * 150 / 64500 / 10, rel=1e-3)


def test_oxygen_makes_no_difference_where_the_curves_cross():
    """Isosbestic points of haemoglobin, about 422, 500, 530, 545, 570, 584 and 797 nm; between, the sign turns."""
    points = np.array([0.4, 0.422, 0.46, 0.5, 0.51, 0.53, 0.54, 0.5455, 0.555, 0.57, 0.577, 0.5845, 0.66, 0.797, 0.9])
    ratio = np.array([absorption.blood(w, 1.0) / absorption.blood(w, 0.0) for w in points])
    crossings, between = ratio[1::2], np.sign(np.log(ratio[::2]))
    np.testing.assert_allclose(crossings, 1.0, atol=0.06)
    assert (np.diff(between[1:]) != 0).all()
    mixed = absorption.blood(0.66, 0.6)
    assert mixed == pytest.approx(0.6 * absorption.blood(0.66, 1.0) + 0.4 * absorption.blood(0.66, 0.0), rel=1e-12)


def test_bands_of_water_and_fat_lie_where_they_are_known():
    """Water's overtones at 740 and 970 nm; fat's at 760 and 930 nm, 13.1 / m there (van Veen et al. 2004)."""
    grid = np.arange(0.9, 1.0, 0.002)
    assert grid[np.argmax([absorption.water(w) for w in grid])] == pytest.approx(0.975, abs=0.006)
    assert grid[np.argmax([absorption.fat(w) for w in grid])] == pytest.approx(0.93, abs=0.003)
    assert absorption.fat(0.93) == pytest.approx(13.10e-3, rel=1e-3)
    assert absorption.fat(0.76) > 3 * absorption.fat(0.8)
    assert absorption.melanosome(0.5) / absorption.melanosome(1.0) == pytest.approx(2**3.33, rel=1e-12)


def test_a_tissue_absorbs_by_the_shares_that_it_holds():
    shares = {"water": 0.7, "blood": 0.02, "oxygenation": 0.6}
    expected = 0.02 * absorption.blood(0.633, 0.6) + 0.7 * absorption.water(0.633)
    assert found(sg.materials.get("brain", 0.633, **shares)) == pytest.approx(expected, rel=1e-9)
    expected = 0.7 * absorption.fat(0.93) + 0.3 * absorption.water(0.93)
    assert found(sg.materials.get("fat", 0.93)) == pytest.approx(expected, rel=1e-9)
    with pytest.warns(sg.DoubtWarning, match="melanin"):
        clear = sg.materials.get("epidermis", 0.6, melanin=0.0)
    dark = sg.materials.get("epidermis", 0.6, melanin=0.4)
    assert found(dark) - found(clear) == pytest.approx(0.4 * absorption.melanosome(0.6), rel=1e-9)


def test_what_no_table_holds_is_refused():
    for call, words in (
        (lambda: absorption.blood(1.01, 0.5), "0.4 to 1 micrometres"), (lambda: absorption.water(0.39), "0.4 to 1"),
        (lambda: absorption.fat(0.42), "0.43 to 1"), (lambda: absorption.blood(0.5, 1.2), "from 0 to 1"),
        (lambda: sg.materials.get("fat", 0.42), "absorption must be given outside 0.43 to 1"),
        (lambda: sg.materials.get("skin", 0.6, blood=0.004, absorption=0.1), "left out if blood is given"),
        (lambda: sg.materials.get("skin", 0.6, oxygenation=1.5), "from 0 to 1"),
    ):  # fmt: skip
        assert_refused(call, words)


def test_draws_of_an_absorption_that_is_given_are_the_same_materials():
    """What is given moves no other draw, and leaves out what it stands for."""
    one, given = sg.materials.draw("skin", 0.633, seed=3), sg.materials.draw("skin", 0.633, seed=3, absorption=0.2)
    assert one.scatterer == given.scatterer
    assert one.refractive_index == given.refractive_index
    assert found(given) == pytest.approx(0.2, rel=1e-9)
    least, most = (absorption.blood(0.633, share) for share in (0.98, 0.4))
    drawn = [found(sg.materials.draw("skin", 0.633, seed=n, water=0.0)) for n in range(20)]
    assert 0.0005 * least <= min(drawn) < max(drawn) <= 0.0157 * most


def test_recipes_draw_the_blood():
    recipe = load_recipe("two-tilts", {"material": {
        "preset": {"name": "skin", "wavelength": 0.633, "blood": "range", "oxygenation": {"choice": [0.5, 0.9]}},
        "thickness": 500.0}})  # fmt: skip
    ends = [(blood, share) for blood in (0.0005, 0.0157) for share in (0.5, 0.9)]
    told = [found(sg.materials.get("skin", 0.633, blood=b, oxygenation=s)) for b, s in ends]
    slabs = recipe.material.extremes()
    assert sorted((1 - s.albedo) / s.mean_free_path * 1e3 for s in slabs) == pytest.approx(sorted(told), rel=1e-9)
