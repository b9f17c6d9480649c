"""Phase screens and free space against the closed form of forward volumes, and against published curves of one slab."""

import numpy as np
import pytest
from refusals import assert_refused
from zscore import assert_mean, assert_z, refute_mean, refute_z

import specklegen as sg
from specklegen.core.errors import RuleError
from specklegen.oracles import multi_slice as slices
from specklegen.oracles.multi_slice import multi_slice

# A Gaussian lobe of correlation length 4 wavelengths: concentration (2 pi 4)^2 / 2, Lambda = L / l* = 0.0158.
LOBE = sg.VonMisesFisher(concentration=(2 * np.pi * 4) ** 2 / 2)
# An independent program of phase screens, for this slab: |K| over all views, and on the axis, at q = 13.1 and 26.2.
PUBLISHED = [0.649, 0.257], [0.935, 0.785]
ERROR = 0.004, 0.012  # of a field over all views and on the axis, from the two programs' realizations


def slab(optical_depth=5.0, scatterer=LOBE, thickness=400.0, albedo=1.0):
    return sg.Slab(thickness=thickness, mean_free_path=thickness / optical_depth, scatterer=scatterer, albedo=albedo)


def run(medium, realizations=2, **options):
    grid = {"wavelength": 1.0, "pitch": 0.5, "size": 384, "bins": [1, 2], "reach": 0.025} | options
    return multi_slice(medium, realizations=realizations, **grid)


def test_another_program_finds_the_same_over_all_views():
    found = run(slab())
    np.testing.assert_allclose(2 * np.pi * found.sines * 400, [13.1, 26.2], rtol=2e-3)
    assert_z(found.all_views.mean(axis=0), PUBLISHED[0], ERROR[0])
    # Power: a lobe 10 % narrower fails.
    other = run(slab(scatterer=sg.VonMisesFisher(concentration=1.21 * LOBE.concentration)), 1)
    refute_z(other.all_views.mean(axis=0), PUBLISHED[0], ERROR[0])


@pytest.mark.slow
def test_many_scatterings_by_a_gaussian_lobe_follow_the_closed_form():
    """|K| = e^(-q^2 Lambda / 6) over all views, where unscattered light is gone."""
    medium = slab(20.0)
    found = run(medium, realizations=4, pitch=0.4, size=480)
    q = 2 * np.pi * found.sines * medium.thickness
    expected = np.exp(-(q**2) * medium.thickness / medium.transport_length / 6)
    # Fourth moments of the angles: a Gaussian of 0.25 rad is 1 % off at half range.
    assert_z(found.all_views.mean(axis=0), expected, ERROR[0], slack=0.012)


def test_views_see_on_average_the_transform_of_the_coherence():
    """Of a window, in rings about the light's direction; two layers; the coherence of the first alone is told."""
    other = sg.VonMisesFisher(concentration=2 * LOBE.concentration)
    parts = [sg.Layer(thickness=t, mean_free_path=100.0, scatterer=s) for t, s in ((100.0, LOBE), (200.0, other))]
    medium, grid = sg.Layers(layers=parts), {"wavelength": 1.0, "pitch": 0.5, "size": 192}
    inside = np.zeros((192, 192))
    inside[40:150, 30:140] = 1
    sines = np.fft.fftfreq(192, 0.5)
    rings = np.digitize(np.hypot(sines, sines[:, None]), [0, 0.05, 0.1, 0.15, 0.2, 0.3]).ravel()

    def in_rings(power):
        return np.bincount(rings, power.ravel())[1:]

    found = []
    for (field,) in slices.slice_views(medium, **grid, bins=[(0, 0)], realizations=24, seed=3):
        field[0, 0] = 0  # light that was not scattered
        seen = np.fft.fft2(np.fft.ifft2(field) * inside)
        found.append(in_rings(np.square(np.abs(seen)) / np.square(0.5 * 0.5)))
    overlap = np.fft.ifft2(np.square(np.abs(np.fft.fft2(inside)))).real

    def expected(slab):
        return in_rings(np.fft.fft2(slices.slice_coherence(slab, **grid) * overlap).real)

    assert_mean(found, expected(medium))
    refute_mean(found, expected(sg.Layers(layers=parts[:1])))


@pytest.mark.slow
def test_grids_of_two_rms_angles_would_alias(monkeypatch):
    """.673 instead of .606: what refusing them is for."""
    monkeypatch.setattr(slices, "RMS_ANGLES", 1.9)
    found = run(slab(20.0), 4, pitch=1.0, size=384)
    assert_z(found.all_views.mean(axis=0)[0], 0.673, ERROR[0], slack=0.005)


def test_realizations_have_seeds_of_their_own():
    two, one = run(slab(), realizations=2, size=128), run(slab(), realizations=1, size=128)
    assert np.array_equal(two.all_views[:1], one.all_views)
    assert not np.array_equal(two.all_views[0], two.all_views[1])


def lobe_mean(x, concentration):
    """Mean of e^(-x sin^2 theta) over a von Mises-Fisher lobe."""
    cosine = np.linspace(1 - 40 / concentration, 1, 200_001)
    density = np.exp(concentration * (cosine - 1))
    return (density * np.exp(-x * (1 - cosine**2))).sum() / density.sum()


def test_screens_that_move():
    """Over all views g1 = exp{-OD (1 - <e^(-x sin^2)>)}; 1 at rest."""
    alone = run(slab(), realizations=1, size=96, bins=[0])
    np.testing.assert_allclose([alone.all_views, alone.on_axis], 1, rtol=1e-6)  # of single precision
    for x in (10.0, 30.0):
        found = run(slab(), realizations=32, size=96, bins=[0], motion=x).all_views[:, 0]
        law = np.exp(-5.0 * (1 - lobe_mean(x, LOBE.concentration)))
        assert_mean(found, law)
        refute_mean(found, law**1.2)  # a motion 20 % faster


def test_a_film_of_screens_is_correlated_by_the_same_law_between_all_its_instants():
    """At 0, 8 and 20, unevenly; a film of two instants is two lights one after the other."""
    grid, motions = {"wavelength": 1.0, "pitch": 0.5, "size": 96}, np.array([0.0, 8.0, 20.0])
    one, two = np.triu_indices(3, 1)

    def joined(seed, motions, one, two):
        film = slices.slice_film(slab(), **grid, motions=motions, seed=seed)
        power = np.square(np.abs(film)).sum((1, 2), dtype=np.float64)
        product = (film[one] * film[two].conj()).sum((1, 2), dtype=np.complex128)
        return np.abs(product) / np.sqrt(power[one] * power[two])

    of_lights = run(slab(), 1, size=96, bins=[0], motion=8.0).all_views[0]
    np.testing.assert_allclose(joined(0, motions[:2], [0], [1]), of_lights, rtol=1e-5)
    found = [joined(seed, motions, one, two) for seed in range(32)]
    law = [np.exp(-5.0 * (1 - lobe_mean(x, LOBE.concentration))) for x in motions[two] - motions[one]]
    assert_mean(found, np.array(law))
    for wrong in ([law[0], law[1], law[1]], [law[0], law[2], law[2]]):  # steps that do not add up
        refute_mean(found, np.array(wrong))
    with pytest.raises(RuleError, match="slice_film motions must be rising"):
        slices.slice_film(slab(), **grid, motions=[0.0, 2.0, 1.0])


def test_screens_that_have_moved_far_are_others():
    """What is left is the unscattered light, e^-OD over all views, and nothing about the axis."""
    found = run(slab(), realizations=4, size=128, bins=[0], motion=1e9, reach=0.15)
    # |K| of a finite number of grains, one over its root, adds to e^-5 in squares.
    assert np.exp(-5.0) < found.all_views.mean() < 0.05
    assert found.on_axis.mean() < 0.05  # 290 views


@pytest.mark.parametrize(("ask", "words"), [
    (lambda: run(slab(albedo=0.9)), "slab.albedo must be 1"),
    (lambda: run(slab(scatterer=sg.Isotropic())), "at most 0.2 transport lengths; got 5"),
    (lambda: run(slab(), motion=-1.0), "motion must be finite and at least 0"),
    (lambda: run(slab(), pitch=1.5), "pitch must be at most 0.99.*4 rms angles"),
])  # fmt: skip
def test_what_lies_outside_its_domain_is_refused(ask, words):
    assert_refused(ask, words)
