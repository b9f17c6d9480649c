"""Presets: their Mie sums against single spheres, their formulas against other measurements, their records."""

import math
import sys
import warnings
from functools import partial

import numpy as np
import pytest
from refusals import assert_refused

import specklegen as sg
from specklegen.materials import indices
from specklegen.materials.lobes import LOBES, lobe_of
from specklegen.materials.registry import PRESETS
from specklegen.materials.suspensions import Sizes, exponential, lognormal, modified_gamma, suspension

TISSUES = {"skin", "brain", "bone", "muscle", "dermis"}
THETA = np.linspace(0.0, np.pi, 181)


@pytest.fixture(scope="module")
def made():
    return {name: sg.materials.get(name, 0.8 if name in TISSUES else 0.633) for name in sg.materials.list()}


@pytest.mark.parametrize("name", sorted(PRESETS))
def test_every_number_says_its_range_where_it_is_from_and_how_far_that_was_checked(name):
    preset = sg.materials.about(name)
    text = str(preset)
    assert preset.references
    for field, number in preset.numbers.items():
        if number.default is None:
            assert set(number.computed_from) < set(preset.numbers)
        else:
            assert number.low <= number.default <= number.high
            assert f"{field} = {number.default:g}" in text
        assert number.meaning
        assert number.source
        assert str(number.checked) in text


def test_slabs_of_every_bulk_can_be_planned(made):
    for material in made.values():
        if isinstance(material, sg.materials.BulkMaterial):
            slab = material.slab(5 * material.mean_free_path)
            assert slab.faces.inside == material.refractive_index
            assert material.slab(1.0, outside=None).faces.matched
            vacuum = 0.8 if material.name in TISSUES else 0.633
            assert material.wavelength == pytest.approx(vacuum / material.refractive_index, rel=1e-12)


def test_spheres_in_water_are_those_of_mie(made):
    """The mean free path by number density times cross-section, computed here anew."""
    sphere = sg.media.Mie(radius=0.5, wavelength=0.633 / indices.water(0.633),
                    refractive_index=indices.polystyrene(0.633) / indices.water(0.633))  # fmt: skip
    density = 0.01 / (4 / 3 * math.pi * 0.5**3)
    expected = 1 / (density * sphere.scattering_cross_section)
    assert made["polystyrene"].mean_free_path == pytest.approx(expected, rel=1e-12)
    assert made["polystyrene"].scatterer == sphere


def test_lengths_are_in_the_unit_that_is_asked_for():
    for name in ("polystyrene", "skin"):
        one, metres = sg.materials.get(name, 0.8), sg.materials.get(name, 0.8, unit=1.0)
        assert metres.mean_free_path == pytest.approx(1e-6 * one.mean_free_path, rel=1e-12)
        assert metres.wavelength == pytest.approx(1e-6 * one.wavelength, rel=1e-12)
        assert metres.scatterer.mean_cosine() == pytest.approx(one.scatterer.mean_cosine(), rel=1e-9)


@pytest.mark.parametrize("index", [1.19, 1.5 + 0.02j])
def test_a_suspension_of_one_size_is_that_sphere(index):
    sphere = sg.media.Mie(radius=0.5, wavelength=0.5, refractive_index=index)
    found = suspension(((Sizes(radii=[0.5], numbers=[1.0]), index),), 0.5)
    assert found.scattering == pytest.approx(sphere.scattering_cross_section, rel=1e-12)
    assert found.absorption == pytest.approx(sphere.extinction_cross_section - sphere.scattering_cross_section,
                                             rel=1e-9, abs=1e-15)  # fmt: skip
    power = np.abs(found.scatterer.amplitude(np.cos(THETA)))
    # Both tables are linear between nodes that leave 1e-4.
    np.testing.assert_allclose(power, np.abs(sphere.amplitude(np.cos(THETA))), rtol=1e-3, atol=1e-4 * power.max())


def test_a_suspension_of_two_kinds_is_their_sum():
    kinds = ((Sizes(radii=[0.1, 0.3], numbers=[5.0, 1.0]), 1.2), (Sizes(radii=[0.2], numbers=[2.0]), 1.1))
    spheres = [(sg.media.Mie(radius=r, wavelength=0.5, refractive_index=index), n)
               for sizes, index in kinds for r, n in zip(sizes.radii, sizes.numbers, strict=True)]  # fmt: skip
    found = suspension(kinds, 0.5)
    each = np.array([n * sphere.scattering_cross_section for sphere, n in spheres])
    assert found.scattering == pytest.approx(each.sum(), rel=1e-12)
    power = sum(c * np.abs(s.exact_amplitude(THETA)) ** 2 for c, (s, _) in zip(each, spheres, strict=True)) / each.sum()
    np.testing.assert_allclose(np.abs(found.scatterer.amplitude(np.cos(THETA))) ** 2, power, rtol=1e-3)
    cosines = [s.g for s, _ in spheres]
    assert found.scatterer.g == pytest.approx(float(each @ cosines / each.sum()), abs=2e-5)


def test_sizes_have_the_moments_that_they_are_named_by():
    """Midpoints of 4096 equal shares: moments right to a thousandth, mostly of the tails."""
    drops = modified_gamma(6.0, 3.0, 4096)
    mean = [float((drops.numbers * drops.radii**n).sum() / drops.numbers.sum()) for n in (1, 2, 3)]
    gamma = [math.gamma(7 + n) / math.gamma(7) / 3.0**n for n in (1, 2, 3)]
    np.testing.assert_allclose(mean, gamma, rtol=2e-3)
    globules = lognormal(0.5, 0.6, 4096)
    share = globules.numbers * globules.radii**3
    share /= share.sum()
    average = float(share @ globules.radii)
    assert average == pytest.approx(0.5, rel=2e-3)
    assert math.sqrt(float(share @ (globules.radii - average) ** 2)) == pytest.approx(0.3, rel=1e-2)
    assert globules.filling(0.04).volume == pytest.approx(0.04, rel=1e-12)
    droplets = exponential(0.11, 0.47, 4096)
    d = (np.arange(20_000) + 0.5) / 20_000 * 0.47  # by another quadrature: in steps of the diameter
    for power in (3, 4, 6):
        one = (droplets.numbers * (2 * droplets.radii) ** power).sum() / droplets.volume
        other = (d**power * np.exp(-d / 0.11)).sum() / (math.pi / 6 * d**3 * np.exp(-d / 0.11)).sum()
        assert one == pytest.approx(other, rel=1e-3)
    assert 2 * droplets.radii.max() < 0.47


@pytest.mark.parametrize(("wavelength", "reduced"), [(0.6328, 25.9), (0.751, 21.2), (0.833, 18.4)])
def test_intralipid_is_what_others_measured(wavelength, reduced):
    """Nine batches of Di Ninni et al. (2011), mu_s (1 - g) of the undiluted emulsion in 1 / mm: within 2 %."""
    material = sg.materials.get("intralipid", wavelength, dilution=0.01)
    assert 100 * 1000 / material.transport_length == pytest.approx(reduced, rel=0.02)


def test_intralipid_is_that_of_van_staveren_within_what_is_said():
    """Half a share of the 20 % emulsion holds the fat of the 10 % one."""
    found = sg.materials.get("intralipid", 0.633, dilution=0.05)
    scattering, g = 0.1 * 16 * 0.633**-2.4, 1.1 - 0.58 * 0.633
    assert 1000 / found.transport_length == pytest.approx(scattering * (1 - g), rel=0.01)
    assert scattering * found.mean_free_path / 1000 == pytest.approx(1.28, abs=0.02)


@pytest.mark.parametrize(("wavelength", "reduced", "by_mie"),
                         [(0.6328, 25.9, 0.03), (0.751, 21.2, 0.05), (0.833, 18.4, 0.04)])  # fmt: skip
def test_droplets_of_oil_are_the_intralipid_that_was_measured(wavelength, reduced, by_mie):
    """Sizes are fitted to the formulas of Michels et al.; what Di Ninni et al. measured is not."""
    droplets = sg.materials.get("intralipid-mie", wavelength, dilution=0.01)
    formula = sg.materials.get("intralipid", wavelength, dilution=0.01)
    assert 100 * 1000 / droplets.transport_length == pytest.approx(reduced, rel=by_mie)
    assert formula.mean_free_path / droplets.mean_free_path == pytest.approx(1, abs=0.04)
    assert droplets.scatterer.g == pytest.approx(formula.scatterer.g, abs=0.01)


def test_the_slope_as_it_is_printed_is_another_emulsion():
    """A mutation of the sizes: e^(-4.151 d) in place of twice that scatters over a tenth too much."""
    droplets = sg.materials.get("intralipid-mie", 0.6328, dilution=0.01)
    with pytest.warns(sg.DoubtWarning, match="length"):
        printed = sg.materials.get("intralipid-mie", 0.6328, dilution=0.01, length=1 / 4.151, largest=0.4739)
    assert droplets.mean_free_path / printed.mean_free_path > 1.15
    assert printed.scatterer.g > droplets.scatterer.g + 0.03


def test_droplets_need_the_extra_and_say_so(monkeypatch):
    monkeypatch.setitem(sys.modules, "miepython", None)
    with pytest.raises(ImportError, match=r'pip install "specklegen-torch\[mie\]"'):
        sg.materials.get("intralipid-mie", 0.6101, dilution=0.0201)
    assert sg.materials.get("intralipid", 0.6101).scatterer.type == "HenyeyGreenstein"


@pytest.mark.parametrize("g", [1e-6, 0.3, 0.9, 0.99999])
def test_families_of_lobes_have_the_same_mean_cosine(g):
    for family, name in zip(LOBES, ("HenyeyGreenstein", "VonMisesFisher"), strict=True):
        lobe = lobe_of(family, g)
        assert lobe.type == name
        assert lobe.mean_cosine() == pytest.approx(g, rel=1e-9)
    assert lobe_of(LOBES[1], 0.0) == sg.media.HenyeyGreenstein(0.0)


@pytest.mark.parametrize("name", [*sorted(TISSUES), "epidermis", "fat", "intralipid"])
def test_a_family_of_lobes_changes_nothing_else(name):
    one, other = (sg.materials.get(name, 0.8, lobe=lobe) for lobe in LOBES)
    assert sg.materials.get(name, 0.8) == one
    assert (one.mean_free_path, one.albedo, one.refractive_index) == (
        other.mean_free_path, other.albedo, other.refractive_index,
    )  # fmt: skip
    assert other.transport_length == pytest.approx(one.transport_length, rel=1e-9)
    assert one.scatterer.type != other.scatterer.type
    assert "lobe = henyey-greenstein (or von-mises-fisher)" in str(sg.materials.about(name))


def test_a_lobe_is_drawn_unless_it_is_given_and_moves_no_number():
    plain = [sg.materials.draw("skin", 0.8, seed=seed) for seed in range(12)]
    assert {one.scatterer.type for one in plain} == {"HenyeyGreenstein", "VonMisesFisher"}
    for seed, one in enumerate(plain):
        fixed = sg.materials.draw("skin", 0.8, seed=seed, lobe="von-mises-fisher")
        assert fixed.scatterer.type == "VonMisesFisher"
        assert (fixed.mean_free_path, fixed.albedo) == (one.mean_free_path, one.albedo)
    with pytest.raises(sg.RuleError, match='lobe must be one of "henyey-greenstein", "von-mises-fisher"'):
        sg.materials.get("skin", 0.8, lobe="gaussian")
    for name in ("polystyrene", "ground-glass"):
        with pytest.raises(sg.RuleError, match="lobe must be left out"):
            sg.materials.get(name, 0.633, lobe="von-mises-fisher")


@pytest.mark.parametrize(("name", "numbers"), [("skin", (46.0, 1.421)), ("brain", (24.2, 1.611)),
                                               ("bone", (22.9, 0.716)), ("muscle", (13.0, 0.926))])  # fmt: skip
def test_tissues_follow_the_power_law_of_jacques(name, numbers):
    a, b = numbers
    for wavelength in (0.5, 0.8):
        found = sg.materials.get(name, wavelength, absorption=0.01)
        scattering = found.albedo / found.mean_free_path * (1 - found.scatterer.mean_cosine())
        assert 1e4 * scattering == pytest.approx(a * (wavelength / 0.5) ** -b, rel=1e-12)
        assert 0.99 < found.albedo < 1


def test_layers_of_skin_scatter_as_they_are_cited():
    """Reduced scattering at 633 nm, 1 / cm, computed here anew; and as layers of one medium."""
    x = 0.633 / 0.5
    cited = {"epidermis": 66.7 * (0.29 * x**-4 + 0.71 * x**-0.689), "dermis": 43.6 * (0.41 * x**-4 + 0.59 * x**-0.562),
             "fat": 1050.6 * 633**-0.68}  # fmt: skip
    layers = []
    for name, reduced in cited.items():
        found = sg.materials.get(name, 0.633, absorption=0.001)
        scattering = found.albedo / found.mean_free_path * (1 - found.scatterer.mean_cosine())
        assert 1e4 * scattering == pytest.approx(reduced, rel=1e-3)
        layers.append(found.layer(100.0))
    assert sg.Layers(layers).optical_depth == pytest.approx(sum(100.0 / layer.mean_free_path for layer in layers))


@pytest.mark.parametrize(("contrast", "depth"), [(0.02, 3.912), (0.05, 2.996)])
def test_fog_leaves_the_visibility_that_is_asked_for(contrast, depth):
    found = sg.materials.get("fog", 0.55, visibility=120.0, contrast=contrast)
    assert 120e6 / found.mean_free_path == pytest.approx(depth, abs=5e-4)


def test_drops_scatter_twice_their_section():
    """The extinction paradox, for the modified gamma law whose mean square radius is known."""
    drops = modified_gamma(6.0, 1.5, 32)
    section = math.pi * float((drops.numbers * drops.radii**2).sum())
    # 2 + 1.99 x^(-2/3) at x = 2 pi 6 / 0.55 = 69 (Nussenzveig and Wiscombe, 1980): 2.12
    assert suspension(((drops, 1.3334),), 0.55).scattering / section == pytest.approx(2.12, abs=0.04)


def test_draws_stay_in_the_ranges_and_are_functions_of_the_seed():
    numbers = sg.materials.about("skin").numbers
    reduced = []
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for seed in range(40):
            one = sg.materials.draw("skin", 0.5, absorption=0.01, seed=seed)
            assert one == sg.materials.draw("skin", 0.5, absorption=0.01, seed=seed)
            reduced.append(1e4 * one.albedo / one.mean_free_path * (1 - one.scatterer.mean_cosine()))
    assert numbers["a"].low <= min(reduced) < 40 < 52 < max(reduced) <= numbers["a"].high
    assert sg.materials.draw("skin", 0.5, absorption=0.01, seed=1, g=0.9).scatterer.g == 0.9
    assert {sg.materials.draw("ground-glass", 0.5, seed=s).grit for s in range(40)} == {120, 220, 400, 600, 1500}


def test_what_is_outside_the_literature_warns_and_what_makes_no_sense_is_refused():
    with pytest.warns(sg.DoubtWarning, match="a = 90 lies outside 32.3 to 59.7.*Jacques"):
        sg.materials.get("skin", 0.8, a=90.0)
    assert_refused(lambda: sg.materials.get("skim", 0.5), 'name must be one of "bone", "brain"')
    assert_refused(lambda: sg.materials.get("skin", 633.0), "wavelength must be 0.4 to 1.3 micrometres")
    assert_refused(lambda: sg.materials.get("skin", 0.8, fat=3.0), "numbers of a, b, g")
    assert_refused(lambda: sg.materials.get("skin", 0.8, a=-1.0), "at least 0")
    with pytest.raises(sg.RuleError, match="numbers with which it scatters"), pytest.warns(sg.DoubtWarning):
        sg.materials.get("intralipid", 0.5, dilution=0.0)
    assert_refused(lambda: sg.materials.get("skin", 0.8, unit=0.0), "unit must be finite and above 0")


@pytest.mark.parametrize("name", sorted(TISSUES))
def test_an_absorption_is_not_taken_from_another_wavelength(name):
    for call in (partial(sg.materials.get), partial(sg.materials.draw, seed=0)):
        with pytest.raises(sg.RuleError, match="absorption must be given outside 0.4 to 1 micrometres.*1 / mm"):
            call(name, 1.2)
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            made = call(name, 1.2, absorption=7.7)
        assert 1e3 * (1 - made.albedo) / made.mean_free_path == pytest.approx(7.7, rel=1e-9)


@pytest.mark.parametrize("name", ["polystyrene", "silica", "intralipid", "intralipid-mie", "milk"])
def test_suspensions_end_where_their_water_absorbs(name):
    assert_refused(lambda: sg.materials.get(name, 0.97), r"wavelength must be 0\.\d+ to 0.9 micrometres")


@pytest.mark.slow
def test_the_memory_range_of_brain_is_known_to_a_factor_of_ten():
    asked = {"draws": 16, "paths": 4000, "lobe": "henyey-greenstein"}
    found = sg.materials.memory_range("brain", 0.806, 1000.0, **asked)
    low, high = found.each["a"]
    assert high < 1.2 * found.value < 0.2 * low
    assert found.interval[0] < 2 * found.value < 0.5 * found.interval[1]
    assert found.wide_interval[0] <= found.interval[0] < 0.3 * found.interval[1] <= 0.3 * found.wide_interval[1]
    assert found.outside[1.33] > 1.7 * found.outside[1.0] == 1.7 * found.value
    assert set(found.each) == {"a", "b", "g", "water", "blood", "oxygenation"}
    again = sg.materials.memory_range("brain", 0.806, 1000.0, **asked)
    assert again == found
    assert "95 %" in str(found)
    assert not found.lobes


def test_the_memory_range_names_the_lobes_and_draws_them():
    found = sg.materials.memory_range("brain", 0.806, 1000.0, draws=4, paths=4000)
    one, other = found.lobes["henyey-greenstein"], found.lobes["von-mises-fisher"]
    assert one == found.value
    assert abs(math.log(other / one)) > math.log(1.2)  # 4000 paths leave some 12 %
    assert f"von-mises-fisher lobes: {other:.2g}" in str(found)
    held = sg.materials.memory_range("brain", 0.806, 1000.0, draws=1, paths=4000, lobe="von-mises-fisher")
    assert held.value == other
    assert not held.lobes


def test_what_is_given_has_no_range():
    found = sg.materials.memory_range("skin", 0.6, 300.0, outside=[None], draws=2, paths=500, a=46.0, absorption=0.1)
    assert set(found.each) == {"b", "g", "water"}
    assert list(found.outside) == [None]
    for bad, words in (({"thickness": 0.0}, "thickness"), ({"outside": []}, "outside"), ({"draws": 0}, "draws")):
        arguments = {"name": "skin", "wavelength": 0.8, "thickness": 300.0} | bad
        with pytest.raises(sg.RuleError, match=f"memory_range {words}"):
            sg.materials.memory_range(**arguments)
    with pytest.raises(sg.RuleError, match="memory_range name must be a bulk"):
        sg.materials.memory_range("ground-glass", 0.6, 1.0, draws=1, paths=64)
