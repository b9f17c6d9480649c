"""Narrow lobes: where endpoint factors lose what light keeps, and what stands in for them, against wave optics."""

import numpy as np
import pytest
from zscore import assert_z, refute_z

import specklegen as sg
from specklegen.core.statistics import BATCHES
from specklegen.oracles.multi_slice import multi_slice
from specklegen.paths import far_field
from specklegen.paths.far_field import NEGLIGIBLE, far_field_decision, lobe_loss, lobe_width, overlap

WAVELENGTH = 0.8


def slab(g, mean_free_path, optical_depth, kind="HG"):
    lobe = sg.HenyeyGreenstein(g=g) if kind == "HG" else sg.VonMisesFisher(concentration=1 / (1 - g))
    return sg.Slab(thickness=optical_depth * mean_free_path, mean_free_path=mean_free_path, scatterer=lobe)


# ---- The overlap of two lobes ---------------------------------------------------------------------------
@pytest.mark.parametrize("concentration", [10.0, 333.0, 1e5])
def test_the_overlap_of_gaussian_lobes_is_closed(concentration):
    """int e^(kappa (a + b) . w / 2) dw = 4 pi sinh(kappa c) / (kappa c), c = cos(t / 2)."""
    lobe = sg.VonMisesFisher(concentration=concentration)
    tilts = np.array([0.1, 0.5, 1.0, 2.0]) / np.sqrt(concentration)
    c, drop = np.cos(tilts / 2), 2 * np.sin(tilts / 4) ** 2
    exact = np.exp(-concentration * drop) / c * np.expm1(-2 * concentration * c) / np.expm1(-2 * concentration)
    np.testing.assert_allclose([overlap(lobe, t) for t in tilts], exact, atol=1e-7)


def test_overlaps_have_their_limits():
    assert overlap(sg.Isotropic(), 1.3) == pytest.approx(1, abs=1e-9)
    assert lobe_width(sg.Isotropic()) == np.pi
    assert overlap(sg.HenyeyGreenstein(g=0.9), 0.0) == 1
    # Narrow lobes scale by 1 - g; of several types each has its share.
    widths = [lobe_width(sg.HenyeyGreenstein(g=1 - d)) / d for d in (1e-3, 1e-4)]
    assert widths[0] == pytest.approx(widths[1], rel=2e-3)
    both = sg.Mixture(types=[sg.Isotropic(), sg.HenyeyGreenstein(g=0.99)], fractions=[0.25, 0.75])
    assert overlap(both, 0.02) == pytest.approx(0.25 + 0.75 * overlap(sg.HenyeyGreenstein(g=0.99), 0.02), abs=1e-6)


# ---- The memory effect against wave optics --------------------------------------------------------------

# C_I on the axis by specklegen.oracles.multi_slice and its standard error, of 4 or 5 realizations (12 at g .99): pitch
# 0.4, size 1280 (g .997) or 1024, and the reach below; the slow test runs them anew.
SLICES = {("HG", 0.997, 20.0, 25): ([1, 2, 3], 512.0, [0.9919, 0.9690, 0.9341], [0.0003, 0.0006, 0.0012]),
          ("vMF", 0.997, 20.0, 25): ([1, 2, 3], 512.0, [0.7964, 0.4087, 0.1420], [0.0020, 0.0038, 0.0030]),
          ("HG", 0.98, 20.0, 5): ([2, 4, 8], 409.6, [0.9984, 0.9938, 0.9768], [0.0001, 0.0001, 0.0003]),
          ("vMF", 0.98, 20.0, 5): ([2, 4, 8], 409.6, [0.9549, 0.8348, 0.5272], [0.0012, 0.0054, 0.0164]),
          ("HG", 0.985, 50.0, 6): ([1, 2, 4], 409.6, [0.9969, 0.9880, 0.9564], [0.0003, 0.0010, 0.0031]),
          ("vMF", 0.985, 50.0, 6): ([1, 2, 4], 409.6, [0.8906, 0.6461, 0.2517], [0.0046, 0.0126, 0.0143]),
          ("HG", 0.99, 100.0, 8): ([1, 2, 3], 409.6, [0.9788, 0.9249, 0.8517], [0.0005, 0.0018, 0.0035]),
          ("vMF", 0.99, 100.0, 8): ([1, 2, 3], 409.6, [0.4780, 0.1044, 0.0423], [0.0121, 0.0127, 0.0045])}  # fmt: skip
AGREED = 0.015  # of C_I: what lost wide angles cost the slices at up to a fifth of a transport length


@pytest.mark.parametrize(("case", "row"), SLICES.items(), ids=str)
def test_the_memory_effect_of_narrow_lobes_is_that_of_waves(case, row):
    kind, g, mean_free_path, optical_depth = case
    bins, side, expected, error = row
    medium = slab(g, mean_free_path, optical_depth, kind)
    tilts = np.arcsin(np.array(bins) * WAVELENGTH / side)
    found = sg.memory_effect(medium, wavelength=WAVELENGTH, tilts=tilts, paths=40_000)
    total = np.hypot(found.standard_error, error)
    agreed = 0.01 if kind == "vMF" and g == 0.997 else AGREED
    assert_z(found.intensity, expected, total, degrees=BATCHES - 1, slack=agreed)
    # A hair beside the axis it comes from another estimator.
    aside = np.array([1e-9, 0, 1])
    other = sg.memory_effect(medium, wavelength=WAVELENGTH, tilts=tilts, paths=40_000, view=aside)
    assert_z(other.intensity, expected, np.hypot(other.standard_error, error), degrees=BATCHES - 1, slack=AGREED)


@pytest.mark.slow
@pytest.mark.parametrize(("case", "row"), SLICES.items(), ids=str)
def test_the_slices_of_the_table(case, row):
    kind, g, mean_free_path, optical_depth = case
    bins, side, expected, error = row
    reach = {0.997: 0.02 if kind == "HG" else 0.05, 0.98: 0.02, 0.985: 0.015, 0.99: 0.012}[g]
    found = multi_slice(slab(g, mean_free_path, optical_depth, kind), wavelength=WAVELENGTH, pitch=0.4,
                        size=round(side / 0.4), bins=bins, realizations=4, seed=1, reach=reach)  # fmt: skip
    # Of few realizations each of some hundred grains: 3 of the table's errors, and 1 / grains of bias.
    assert_z(found.on_axis.mean(axis=0), expected, 3 * np.array(error), degrees=3, slack=0.01)


def test_endpoint_factors_would_lose_it(monkeypatch):
    """The power of the tests above: with lobes looked up along fixed directions the first row is 0.4 too low."""
    monkeypatch.setattr(far_field, "FAR", 0.0)
    bins, side, expected, error = SLICES["HG", 0.997, 20.0, 25]
    found = sg.memory_effect(slab(0.997, 20.0, 25), wavelength=WAVELENGTH,
                             tilts=np.arcsin(np.array(bins) * WAVELENGTH / side), paths=20_000)  # fmt: skip
    assert not found.near_field
    assert found.intensity[-1] < expected[-1] - 0.35
    refute_z(found.intensity, expected, np.hypot(found.standard_error, error), slack=AGREED)


def test_a_gaussian_lobe_follows_its_closed_form():
    """C_I = e^(-q^2 Lambda / 12) at a fixed view: within 0.05 at Lambda = 0.075."""
    medium = slab(0.997, 20.0, 25, "vMF")
    tilts = np.array([1.56e-3, 3.13e-3, 4.69e-3])
    found = sg.memory_effect(medium, wavelength=WAVELENGTH, tilts=tilts, paths=40_000)
    expected = np.exp(-(found.q**2) * medium.thickness / medium.transport_length / 12)
    assert_z(found.intensity, expected, found.standard_error, degrees=BATCHES - 1, slack=0.05)


# ---- Who is told ----------------------------------------------------------------------------------------
def scene(medium, tilt, width=20000.0):
    directions = [[0, 0, 1], [np.sin(tilt), 0, np.cos(tilt)]]
    return sg.Scene(wavelength=WAVELENGTH, medium=medium,
                    illumination=sg.CollimatedBeams(directions=directions, width=width),
                    sensor=sg.FarFieldGrid(shape=(16, 16), pitch=WAVELENGTH / width / 2.5))  # fmt: skip


def test_tilts_that_are_small_or_far_are_as_before():
    """Broad lobes, small tilts and long mean free paths take the exact amplitudes, bit for bit."""
    wide = slab(0.9, 50.0, 4)
    assert lobe_loss(wide, WAVELENGTH, 1e-3).loss < NEGLIGIBLE
    assert not sg.memory_effect(wide, wavelength=WAVELENGTH, tilts=[5e-3], paths=64).near_field
    assert not lobe_loss(slab(0.9, 1e5, 4), WAVELENGTH, 0.05).spurious
    assert not lobe_loss(sg.Slab(thickness=9, mean_free_path=1, scatterer=sg.Isotropic()), WAVELENGTH, 1).spurious


def test_the_planner_leaves_narrow_lobes_to_the_stationary_sampler():
    narrow = scene(slab(0.997, 20.0, 25), 3e-3)
    made = sg.plan(narrow, realizations=30)  # of one, path sums are quicker than the pilot that would allow for it
    assert made.sampler == "stationary"
    assert not made.doubts
    assert not sg.plan(narrow).doubts
    told = far_field_decision(narrow)
    assert not told.doubt
    assert "keeps its angle to the phase function" in told.reason
    assert far_field_decision(scene(slab(0.997, 20.0, 25), 1e-5)) is None
    assert far_field_decision(scene(slab(0.5, 20.0, 2), 3e-3)) is None


@pytest.mark.parametrize("center", [0.0, 0.6, -0.6])
def test_tilts_as_wide_as_the_half_space_have_a_plan(center):
    """Their differences reach beyond any direction of light or view: what is not there is not judged."""
    medium = sg.Slab(thickness=100.0, mean_free_path=20.0, scatterer=sg.HenyeyGreenstein(0.99))
    lights = sg.CollimatedBeams.tilts([-0.9, 0.0, 0.9], width=2000.0)
    sensor = sg.FarFieldGrid(shape=(8, 8), pitch=1e-4, center=(center, 0.0))
    made = sg.plan(sg.Scene(wavelength=WAVELENGTH, medium=medium, illumination=lights, sensor=sensor))
    assert made.sampler in ("paths", "stationary")  # by a pilot of few paths so wide of the lobe
    assert np.isfinite(made.expected_error)


def test_path_sums_that_the_planner_must_take_are_doubted_without_advice_to_ask_it():
    narrow = scene(slab(0.997, 20.0, 25), 0.22, width=600.0)
    narrow = narrow.replace(sensor=sg.FarField(directions=[[0, 0, 1], [0.1, 0, 0.99**0.5]]))
    with pytest.warns(sg.DoubtWarning, match="far field of the scatterers") as told:
        found = sg.render(narrow, paths=64)
    assert found.report.sampler == "paths"
    assert not any('Use sampler="auto"' in str(each.message) for each in told)


def test_large_tilts_beside_a_narrow_lobe_are_doubted():
    with pytest.warns(sg.DoubtWarning, match=r"tilts of 0\.2 rad are too large"):
        assert sg.memory_effect(slab(0.98, 20.0, 5), wavelength=WAVELENGTH, tilts=[0.2], paths=64).near_field
