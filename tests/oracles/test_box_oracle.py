"""The literal oracle of boxes against energy, mixtures, layers, its own field mode, and reference data."""

import numpy as np
import pytest
from zscore import assert_mean, assert_z, refute_mean

from specklegen.oracles.box_algorithms import Beams, Far, Near, Setup, contributions, covariance, fields, intensity
from specklegen.oracles.box_media import Medium, box, deflect, henyey_greenstein, particle_by_rejection

pytestmark = pytest.mark.slow  # the oracle's own checks

BATCHES = 64
ISOTROPIC = {dimension: henyey_greenstein(0.0, dimension) for dimension in (2, 3)}


def directions(degrees, dimension=2):
    angles = np.deg2rad(np.asarray(degrees, dtype=float))
    middle = [0 * angles] * (dimension - 2)
    return np.stack([np.sin(angles), *middle, np.cos(angles)], axis=-1)


def batches(function, setup, paths, seed=1, **options):
    """One result per batch, float64 or complex128[64, ...]."""
    seeds = np.random.SeedSequence(seed).spawn(BATCHES)
    return np.array([function(setup, paths, np.random.default_rng(s), **options) for s in seeds])


def assert_same(first, second):
    """Means over batches agree, by Welch's z; real and imaginary parts."""
    first, second = (np.stack([part.real, part.imag]) if np.iscomplexobj(part) else part for part in (first, second))
    axis = 1 if first.ndim > 2 else 0
    error = np.sqrt((first.var(axis, ddof=1) + second.var(axis, ddof=1)) / BATCHES)
    slack = 1e-12 * np.abs(first).max()  # imaginary parts of a diagonal: rounding alone
    assert_z(first.mean(axis), second.mean(axis), error, degrees=BATCHES - 1, slack=slack)


def plane_wave_box(lights=(0,), views=(0, 40, 180), *, half=5.0, extinction=0.2, particle=None, **options):
    medium = box((-half,) * 2, (half,) * 2, extinction=extinction, particles=(particle or ISOTROPIC[2],), **options)
    return Setup(medium, 1.0, Far(directions(lights)), Far(directions(views)))


@pytest.mark.slow
def test_the_box_of_the_reference_data_conserves_energy():
    """A02: 17.293, 17.386, 17.643, 18.549 over 2 pi for lights at 0, 1, 4 and 20 degrees."""
    setup = plane_wave_box((0, 1, 4, 20), np.arange(36) * 10, half=10.0, extinction=0.1)
    total = batches(intensity, setup, 2000).sum(axis=1).reshape(BATCHES, 4, 36).mean(axis=2) * 2 * np.pi
    assert_mean(total, np.array([17.293, 17.386, 17.643, 18.549]), slack=5e-4)


def test_energy_in_two_dimensions():
    """36 views integrate it: the intensity has kinks at the four sides only, an error well below the noise."""
    setup = plane_wave_box(views=np.arange(36) * 10 + 5.0, particle=henyey_greenstein(0.5, 2))
    total = batches(intensity, setup, 300).sum(axis=(1, 2)) / 36 * 2 * np.pi
    assert_mean(total, 10 * (1 - np.exp(-2)))
    refute_mean(total, 1.1 * 10 * (1 - np.exp(-2)))


def test_single_scattering_of_the_reference_cube():
    medium = box((-50,) * 3, (50,) * 3, extinction=0.05, particles=(ISOTROPIC[3],))
    setup = Setup(medium, 1.0, Far(directions([0], 3)), Far(directions([0, 180], 3)))
    assert_mean(batches(intensity, setup, 200)[:, 0], np.array([26.809, 397.87]), slack=0.005)


@pytest.mark.slow
@pytest.mark.parametrize("reverse", [False, True])
def test_fields_have_the_covariance(reverse):
    """Mixtures too: field mode draws particles, covariance mode adds them up (A17)."""
    medium = box((-5, -5), (5, 5), extinction=0.2, albedo=0.8,
                 particles=(henyey_greenstein(0.7, 2), particle_by_rejection(tilted_amplitude, 0.4, 2)),
                 shares=(0.3, 0.7))  # fmt: skip
    setup = Setup(medium, 1.0, Far(directions([0, 5])), Far(directions([0, 5, 180])))
    expected = batches(covariance, setup, 400, reverse=reverse)
    drawn = np.array(
        [
            fields(setup, 2, 500, np.random.default_rng(s), reverse=reverse)
            for s in np.random.SeedSequence(2).spawn(BATCHES)
        ]
    )
    found = np.einsum("bnp,bnq->bpq", drawn, drawn.conj()) / 500
    assert_same(found, expected)


def tilted_amplitude(cos):
    """Complex and asymmetric: |s|^2 = (1 + 0.8 cos)/(2 pi)."""
    return np.exp(2j * cos) * np.sqrt((1 + 0.8 * cos) / (2 * np.pi))


def test_a_kind_split_into_itself_is_itself():
    kind = henyey_greenstein(0.6, 2)
    one = plane_wave_box(particle=kind)
    medium = box((-5, -5), (5, 5), extinction=0.2, particles=(kind, kind), shares=(0.3, 0.7))
    split = Setup(medium, 1.0, one.lights, one.views)
    assert_same(batches(covariance, one, 200, reverse=True), batches(covariance, split, 200, seed=2, reverse=True))


@pytest.mark.parametrize("shares", [(0.0, 1.0), (1.0, 0.0)])
def test_a_kind_without_a_share_changes_no_bit(shares):
    kind = henyey_greenstein(0.6, 2)
    one = plane_wave_box(particle=kind)
    medium = box((-5, -5), (5, 5), extinction=0.2, particles=(kind, kind), shares=shares)
    both = Setup(medium, 1.0, one.lights, one.views)
    results = [covariance(setup, 200, np.random.default_rng(4), reverse=True) for setup in (one, both)]
    np.testing.assert_array_equal(*results)


LAYERS = Medium(np.array([[-5.0, -5], [-5, 0]]), np.array([[5.0, 0], [5, 5]]), np.array([0.1, 0.3]),
                np.array([1.0, 0.7]), (henyey_greenstein(0.3, 2),), np.ones((2, 1)))  # fmt: skip


def test_a_path_and_its_reverse_have_one_balance_weight():
    """A18: Omega V sigma_s1 sigma_s2 / (sigma_1 + sigma_2) at order two, which needs the ratio of extinctions. No mean
    could tell: any ratio r(x1, x_B) with r r' = 1 for the reverse, even 1, leaves the estimate unbiased."""
    setup = Setup(LAYERS, 1.0, Far(directions([0])), Far(directions([0])))
    parts = contributions(setup, 1000, np.random.default_rng(1), reverse=True)
    weights = next(part.weight for part in parts if part.order == 2)
    scattering, extinction = LAYERS.albedo * LAYERS.extinction, LAYERS.extinction
    expected = 2 * np.pi * 100 * np.outer(scattering, scattering) / np.add.outer(extinction, extinction)
    np.testing.assert_allclose(np.unique(weights.round(9)), np.unique(expected.round(9)), rtol=1e-9)


@pytest.mark.slow
def test_backscattering_is_s_plus_2m_over_s_plus_m():
    """And for a narrow beam, (S + M + M_in)/(S + M): with the region narrow or wide, the same."""
    setup = plane_wave_box(views=(180,))
    forward, both = (batches(intensity, setup, 300, reverse=reverse)[..., 0] for reverse in (False, True))
    assert_same(both[:, 0] + both[:, 1], forward[:, 0] + 2 * forward[:, 1])
    beam = Beams(directions([0]), width=4.0, face=-5.0)
    wide = Setup(setup.medium, 1.0, beam, setup.views)
    narrow = Setup(setup.medium, 1.0, beam, setup.views, region=(np.array([-2.0, -5]), np.array([2.0, 5])))
    found = [batches(intensity, s, 300, seed=n, reverse=True).sum(axis=1) for n, s in enumerate((wide, narrow))]
    assert_same(*found)
    assert found[1].mean() > 1.05 * batches(intensity, narrow, 300).sum(axis=1).mean()


@pytest.mark.parametrize("dimension", [2, 3])
def test_distant_points_are_plane_waves(dimension):
    """Near ends at 1e5 box sizes, times r^((d-1)/2) e^(-ikr): absolute, path by path, to the Fresnel phase k x^2/2r."""
    r = 1e6
    medium = box((-5,) * dimension, (5,) * dimension, extinction=0.2, particles=(ISOTROPIC[dimension],))
    light, view = directions([5, 8], dimension), directions([20, 170], dimension)
    far = covariance(Setup(medium, 1.0, Far(light), Far(view)), 100, np.random.default_rng(1), reverse=True)
    near = covariance(Setup(medium, 1.0, Near(-r * light), Near(r * view)), 100, np.random.default_rng(1), reverse=True)
    np.testing.assert_allclose(near * r ** (2 * (dimension - 1)), far, rtol=0, atol=1e-3 * far.real.max())


def test_points_inside_are_attenuated_inside_only():
    """A source and a sensor in the void between two dense walls see single scattering of both, and of nothing else."""
    medium = box((-5, 1), (5, 2), extinction=2.0, particles=(ISOTROPIC[2],))
    x, p = np.array([[0.3, 1.5]]), np.array([[0.3, 0.0]])
    depth = medium.optical_depth(x, np.array([[[0.0, -1.0]]]), np.array([[1.5]]))
    np.testing.assert_allclose(depth, 1.0, rtol=1e-14)  # 0.5 of the 1.5 lies in the box
    inside = medium.optical_depth(x, np.array([[[1.0, 0.0]]]), np.array([[0.25]]))
    np.testing.assert_allclose(inside, 0.5, rtol=1e-14)
    setup = Setup(medium, 1.0, Near(p), Near(p), region=(x[0] - 1e-6, x[0] + 1e-6))
    single = intensity(setup, 10, np.random.default_rng(1))[0, 0]
    # sigma_s V |s|^2 tau^4 / r^2, over a region of 2e-6 squared
    assert single == pytest.approx(2.0 * 4e-12 / (2 * np.pi) * np.exp(-2.0) / 1.5**2, rel=1e-5)


@pytest.mark.parametrize("dimension", [2, 3])
def test_particles_deflect_by_their_phase_function(dimension):
    """Mean cosine g, either side equally; any amplitude by rejection."""
    rng = np.random.default_rng(6)
    for g in (-0.6, 0.0, 0.8):
        assert_mean(henyey_greenstein(g, dimension).cosines(rng, 50_000), g)
    assert_mean(particle_by_rejection(tilted_amplitude, 0.4, 2).cosines(rng, 50_000), 0.4)
    w = directions(np.full(20_000, 30.0), dimension)
    turned = deflect(w, np.full(20_000, 0.4), rng)
    np.testing.assert_allclose((turned * w).sum(axis=1), 0.4, atol=1e-14)
    assert_mean(turned - 0.4 * w, np.zeros(dimension), slack=1e-14)
