"""UTD: exact for the half plane, against the series for wedges, continuous everywhere, and a knife edge in dB."""

import math

import numpy as np
import pytest
from references.wedge_series import half_plane, transition_function, wedge_series
from scipy.special import fresnel

from specklegen.core.errors import RuleError
from specklegen.kernels import kernel
from specklegen.wavetracing import wedge_coefficients, wedge_field
from specklegen.wavetracing.kernels.wedges import transition
from specklegen.wavetracing.wedge import geometric_shares

K = 2 * np.pi
BOUNDARIES = ("soft", "hard")


@kernel
def fill_transitions(x, out):
    """Fill ``out`` complex128[m] with F(X) of ``x`` float64[m]."""
    for m in range(x.size):
        out[m] = transition(math.sqrt(x[m]))


def kernel_transition(x):
    out = np.empty(len(x), complex)
    fill_transitions(np.asarray(x, float), out)
    return out


def test_transition_function_in_the_kernel():
    """Relative to the Faddeeva function, whose own error is 1e-14 (tests/oracles/test_wedge_series.py: mpmath)."""
    x = np.concatenate([10.0 ** np.linspace(-12, 6, 2000), [1e8, 1e12]])
    assert np.abs(kernel_transition(x) / transition_function(x) - 1).max() < 5e-14  # measured 1e-14
    printed = [0.3681035678 - 0.2344529623j, 0.8095254817 - 0.2321993901j, 0.9930411270 - 0.0483514956j]
    assert np.abs(kernel_transition([0.1, 1, 10]) - printed).max() < 8e-11  # half of the last printed digit
    assert kernel_transition([0.0]) == 0


@pytest.mark.parametrize("beta", [np.pi / 2, 0.7, 2.2])
@pytest.mark.parametrize("boundary", BOUNDARIES)
def test_half_plane_is_exact(boundary, beta):
    """20 000 receivers; the only error is the rounding of phases of kr <= 6e4, 1e-15 kr."""
    rng = np.random.default_rng(2)
    phi, incidence = rng.uniform(0, 2 * np.pi, (2, 20_000))
    r = 10 ** rng.uniform(np.log10(0.3), 4, 20_000)
    found = wedge_field(2.0, phi, incidence, r, K, boundary, beta)
    exact = half_plane(phi, incidence, r, K, boundary, beta)
    assert np.abs(found - exact).max() < 1e-10  # measured 3e-11
    assert (np.abs(found - exact) / (1 + 1e-15 * K * r / 1e-14)).max() < 1e-13


def test_that_comparison_has_power():
    """One part in a million of beta is caught."""
    exact = half_plane(*np.array([1.0, 2.0, 5.0]), K, "soft", 0.7)
    assert abs(wedge_field(2.0, 1.0, 2.0, 5.0, K, "soft", 0.7 * (1 + 1e-6)) - exact) > 1e-6


@pytest.mark.parametrize(("n", "scale"), [(1.25, 1.3), (1.5, 1.0), (1.75, 0.75)])
def test_wedges_against_the_series(n, scale):
    """The error that the theory has, neither more nor less than 1.5 times; rms over angles, soft and hard."""
    phi, incidence = np.random.default_rng(3).uniform(0, n * np.pi, (2, 1500))
    for r, expected in ((1.0, 2.1e-3), (10.0, 1.4e-4), (100.0, 8.4e-6)):
        gaps = [wedge_field(n, phi, incidence, r, K, b) - wedge_series(n, phi, incidence, r, K, b) for b in BOUNDARIES]
        rms = np.sqrt(np.mean(np.square(np.abs(gaps))))
        assert scale * expected / 1.5 < rms < scale * expected * 1.5


@pytest.mark.parametrize("boundary", BOUNDARIES)
@pytest.mark.parametrize(("n", "incidence"), [(2.0, 0.8), (1.5, 0.8), (1.5, 3.9), (1.25, 2.0)])
def test_boundaries_are_crossed_without_a_step(n, incidence, boundary):
    """On, and one rounding or 1e-13 beside, every shadow and reflection boundary the field is the same to 1e-8.

    (du/dphi <= 2 kr, so that 2e-13 rad are 3e-9 at r = 1000.)
    """
    shadows = [incidence + np.pi, incidence - np.pi, np.pi - incidence, (2 * n - 1) * np.pi - incidence]
    inside = [s for s in shadows if 0 < s < n * np.pi]
    assert inside
    for angle in inside:
        near = [angle, np.nextafter(angle, 0), np.nextafter(angle, 9), angle - 1e-13, angle + 1e-13]
        for r in (1.0, 1e3):
            field = wedge_field(n, near, incidence, r, K, boundary)
            assert np.ptp(field.real) + np.ptp(field.imag) < 1e-8
            soft, hard = wedge_coefficients(n, [angle - 1e-13, angle + 1e-13], incidence, r, K)
            jump = np.ptp(soft.real) * np.sqrt(1 / r)  # while the diffracted wave alone jumps by half a wave or more
            assert jump > 0.1


def test_exactly_on_a_boundary_half_is_seen():
    """Angles that are exact in floating point: the wave at 0.5, the receiver pi further on, rounded."""
    shares = geometric_shares(2.0, np.pi, 0.0)
    assert np.array_equal(shares, [0.5, 0.5, 0])
    assert np.array_equal(geometric_shares(2.0, [1.0, 4.5], 1.0), [[1, 1, 0], [0, 0, 0]])
    assert np.array_equal(geometric_shares(1.5, 4.0, 3.5), [1, 0, 1])


def test_grazing_light():
    """To 1e-9 rad the soft total vanishes and the hard one is twice the light, continuously."""
    r, phi = 7.0, np.linspace(0.1, 4.5, 40)
    for grazing in (1e-3, 1e-6, 1e-9, 0.0):
        soft = wedge_field(1.5, phi, grazing, r, K, "soft")
        assert np.abs(soft).max() <= 90 * grazing  # |du/dphi'| <= 2 kr = 88
        assert grazing == 0 or np.abs(soft).max() > grazing
    near, at = wedge_field(1.5, phi, 1e-9, r, K, "hard"), wedge_field(1.5, phi, 0.0, r, K, "hard")
    assert np.abs(near - at).max() < 1e-7


@pytest.mark.parametrize("boundary", BOUNDARIES)
def test_reciprocity(boundary):
    a, b = np.random.default_rng(4).uniform(0, 1.5 * np.pi, (2, 100))
    there, back = (wedge_coefficients(1.5, x, y, 3.0, K)[boundary == "hard"] for x, y in ((a, b), (b, a)))
    assert np.abs(there - back).max() < 1e-12


LOSSES = [
    (1e9, -5.0, -0.57),
    (1e9, -1.0, 2.26),
    (1e9, 0.0, 6.02),
    (1e9, 1.0, 9.81),
    (1e9, 5.0, 20.01),
    (3e10, 5.0, 34.70),
]  # hertz, metres, dB


def knife_edge(frequency, height, before=100.0, behind=50.0):
    """Loss in dB of the mean *power* of soft and hard: a half plane below the edge, a point source, 1/r waves."""
    wavelength = 299_792_458 / frequency
    k, there, back = 2 * np.pi / wavelength, np.hypot(before, height), np.hypot(behind, height)
    incidence, phi = np.arctan2(before, height), 2 * np.pi - np.arctan2(behind, height)
    pair = wedge_coefficients(2.0, phi, incidence, there * back / (there + back), k)
    direct = geometric_shares(2.0, phi, incidence)[0] / (before + behind)
    detour = height**2 / (there + before) + height**2 / (back + behind)
    spread = np.sqrt(there / (back * (there + back))) / there
    waves = direct + np.array(pair) * spread * np.exp(1j * k * detour)
    return -10 * np.log10(np.mean(np.square(np.abs(waves))) * (before + behind) ** 2)


@pytest.mark.parametrize(("frequency", "height", "loss"), LOSSES)
def test_knife_edge(frequency, height, loss):
    found = knife_edge(frequency, height)
    assert abs(found - loss) < 0.006  # half of the last printed digit
    # The Fresnel integral takes small angles: 5 m in 50 m leaves .016 dB between them, measured.
    nu = height * np.sqrt(2 * 150.0 * frequency / (299_792_458 * 100.0 * 50.0))  # ITU-R P.526-15, 4.1
    sine, cosine = fresnel(nu)
    assert abs(found + 20 * np.log10(np.hypot(1 - cosine - sine, cosine - sine) / 2)) < 0.02


@pytest.mark.parametrize(
    ("arguments", "match"),
    [
        ((2.5, 1, 1, 1, K), "wedge n must be between 1"),
        ((1.5, 5, 1, 1, K), "wedge phi must be in the air"),
        ((1.5, 1, -1, 1, K), "wedge incidence must be in the air"),
        ((1.5, 1, np.nan, 1, K), "in the air"),
        ((1.5, 1, 1, -1, K), "distance must be finite"),
        ((1.5, 1, 1, 1, 0), "k must be finite"),
        ((1.5, 1, 1, 1, K, 0.0), "beta must be between"),
    ],
)
def test_bad_input_is_refused(arguments, match):
    with pytest.raises(RuleError, match=match):
        wedge_coefficients(*arguments)


def test_a_receiver_at_the_edge_is_refused():
    with pytest.raises(RuleError, match=r"distance must be at least 1/\(k sin"):
        wedge_field(2.0, 1.0, 1.0, 0.1, K, "soft")
