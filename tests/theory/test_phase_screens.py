"""Closed forms of thin screens against one another, against quadrature, and against waves."""

import numpy as np
import pytest
from refusals import assert_refused
from scipy.integrate import quad
from scipy.optimize import brentq
from scipy.special import j0
from zscore import assert_z, refute_z

import specklegen as sg
from specklegen.oracles.screen_waves import ScreenWaves
from specklegen.theory import phase_screens
from specklegen.theory.phase_screens import coherence, index_correlation, lobes, spread, tilt_ways

SCREEN = sg.PhaseScreen(rms_phase=4.0, correlation_length=20.0)
PAIR = sg.ScreenStack(screens=(SCREEN, SCREEN), gaps=(800.0,))
TILTS = np.array([0.00195, 0.00391, 0.00586, 0.00781])
K = 2 * np.pi


def over_all(stack, tilts, shift=0.0):
    """Field correlation over all views for tilts and a shift along x."""
    return np.array([coherence(stack, 1.0, np.array([shift, 0]), tilt_ways(stack, np.array([t, 0]))) for t in tilts])


def test_the_rms_angle_of_a_screen():
    assert SCREEN.rms_angle(1.0) == pytest.approx(0.04502, abs=1e-5)


def test_two_variances_of_a_stack_and_its_half_ranges():
    angle, gap = SCREEN.rms_angle(1.0), 800.0
    everywhere, fixed, pivot = spread(PAIR, 1.0)
    assert everywhere == pytest.approx((angle * gap) ** 2)
    assert fixed == pytest.approx((angle * gap) ** 2 / 2)
    assert pivot == pytest.approx(gap / 2)
    # C_I = 1/2 at .1325 lambda / (theta d), sqrt 2 further at a fixed view: Gaussian lobes, sigma = 30.
    strong = sg.PhaseScreen(rms_phase=30.0, correlation_length=150.0)
    stack = sg.ScreenStack(screens=(strong, strong), gaps=(gap,))
    half = 0.1325 / (strong.rms_angle(1.0) * gap)
    found = brentq(lambda d: over_all(stack, [d])[0] ** 2 - 0.5, 0.1 * half, 10 * half)
    assert found == pytest.approx(half, rel=2e-3)
    fixed_view = lambda d: abs(lobes(stack, 1.0).correlation(np.zeros(2), tilt_ways(stack, np.array([d, 0])))) ** 2  # noqa: E731
    assert brentq(lambda d: fixed_view(d) - 0.5, 0.1 * half, 10 * half) == pytest.approx(np.sqrt(2) * half, rel=5e-3)


@pytest.mark.parametrize("quick", [0, 2**14])
def test_ways_together_are_ways_one_by_one(quick, monkeypatch):
    """Many ways at once, equal ones among them, against the mixture of each alone; so are they cut into pieces."""
    monkeypatch.setattr(phase_screens, "_QUICK", quick)
    monkeypatch.setattr(phase_screens, "_TOGETHER", 7 * lobes(PAIR, 1.0).events.size)
    ways = np.random.default_rng(3).normal(0, 1.0, (4, 5, 2, 2))
    ways[1] = ways[2]
    found = lobes(PAIR, 1.0).decorrelation(ways)
    alone = [lobes(PAIR, 1.0).correlation(np.zeros(2), way).real for way in ways.reshape(-1, 2, 2)]
    np.testing.assert_allclose(found.ravel(), alone, rtol=1e-12)
    assert np.ptp(found) > 0.01


def test_the_tilt_range_that_the_index_leaves():
    """C_I = exp{-[k sigma_h ((n^2 - s^2)^(1/2) - (1 - s^2)^(1/2) - (n - 1))]^2}: .905 and .395 at k sigma_h = 20."""
    glass = sg.PhaseScreen(rms_height=20 / K, index=1.5, correlation_length=500.0).stack
    found = np.square(index_correlation(glass, 1.0, np.array([0.0, 0.3, 0.5])))[0]
    np.testing.assert_allclose(found, [1.0, 0.905, 0.395], atol=6e-4)
    s = np.array([0.3, 0.5])
    literal = np.exp(-np.square(20 * (np.sqrt(2.25 - s**2) - np.sqrt(1 - s**2) - 0.5)))
    np.testing.assert_allclose(found[1:], literal, rtol=1e-12)


@pytest.mark.parametrize("phase", [0.1, 1.0, 4.0])
def test_the_lobe_is_the_transform_of_the_coherence(phase):
    screen = sg.PhaseScreen(rms_phase=phase, correlation_length=5.0)
    terms, angle = lobes(screen.stack, 1.0), screen.rms_angle(1.0)
    for sine in (0.0, 1.5 * angle, 4 * angle):
        held = lambda r: (coherence(screen.stack, 1.0, np.array([r, 0.0])) - np.exp(-(phase**2))) * j0(K * sine * r) * r  # noqa: B023, E731
        literal = quad(held, 0, 60, limit=400)[0] * K
        assert terms.density(np.array([sine]))[0] == pytest.approx(literal, rel=1e-6)


@pytest.mark.parametrize("screens", [2, 3, 8])
def test_the_mixture_is_the_transform_of_the_sheared_coherences(screens):
    """K f from the two-dimensional transform of Eq. 1; of 8 screens the mixture is drawn, to 5e-4."""
    screen = sg.PhaseScreen(rms_phase=1.2, correlation_length=5.0)
    stack = sg.ScreenStack(screens=(screen,) * screens, gaps=(60.0,) * (screens - 1))
    terms, tilt, view = lobes(stack, 1.0), np.array([0.02, 0.01]), np.array([0.05, -0.02])
    ways = tilt_ways(stack, tilt)
    x = np.linspace(-40, 40, 401)
    points = np.stack(np.meshgrid(x, x), axis=-1)
    middle = ways.mean(axis=0)
    rest = np.exp(-stack.optical_depth(1.0))
    for way, found in ((0 * ways, 1.0), (ways, terms.correlation(view, ways))):
        held = coherence(stack, 1.0, points + (middle if way.any() else 0), way) - rest
        value = (held * np.exp(-1j * K * (points + (middle if way.any() else 0)) @ view)).sum() * (x[1] - x[0]) ** 2
        expected = terms.density(np.hypot(*view)) * found
        assert abs(value - expected) < (1e-6 if screens < 8 else 1.5e-3) * terms.density(0.0)


def forward_stack(depth, correlation_length, thickness, count=40):
    """A forward volume as screens: depth / count of sigma^2 each, half a gap at either end."""
    screen = sg.PhaseScreen(rms_phase=np.sqrt(depth / count), correlation_length=correlation_length)
    gap = thickness / count
    return sg.ScreenStack(screens=(screen,) * count, gaps=(gap,) * (count - 1), behind=gap / 2)


@pytest.mark.parametrize("sine", [0.0, 0.1, 0.5])
def test_views_far_outside_all_lobes(sine):
    """Densities of e^-5000 underflow; their ratios, here with the exponents of long doubles, do not."""
    weak = sg.PhaseScreen(rms_phase=0.1, correlation_length=100.0)
    smooth = sg.PhaseScreen(rms_phase=0.0, correlation_length=10.0)  # terms of no share, of the widest lobes
    pair = sg.ScreenStack(screens=(weak, smooth, weak), gaps=(800.0, 0.0))
    terms, ways, view = lobes(pair, 1.0), tilt_ways(pair, np.array([1e-3, 0])), np.array([sine, 0])
    variance, mean = terms.spreads(ways)
    variances = terms.variances.astype(np.longdouble)
    weight = terms.shares / variances * np.exp(-0.5 * sine**2 / variances)
    value = np.exp(-0.5 * K**2 * variance - 1j * K * mean[:, 0] * sine)
    assert terms.correlation(view, ways) == pytest.approx(complex(weight @ value / weight.sum()), rel=1e-11)


def test_a_forward_volume_and_its_two_memory_effects():
    """|K| = e^(-q^2 Lambda / 6) over all views, C_I = e^(-q^2 Lambda / 12) at a fixed one, Lambda = OD (1 - g)."""
    stack = forward_stack(400.0, 40.0, 4000.0)
    share = 400.0 * 2 / (K * 40.0) ** 2  # OD (1 - g), 1 - g = 2 / (k xi)^2
    q = np.array([0.5, 1.0, 2.0, 4.0])
    tilts = q / (K * 4000.0)
    # (1 - g) is the variance along one axis, and |K| over all views falls by k^2 delta^2 Var / 2 = q^2 Lambda / 6.
    np.testing.assert_allclose(over_all(stack, tilts), np.exp(-(q**2) * share / 6), atol=2e-3)
    fixed = [lobes(stack, 1.0).correlation(np.zeros(2), tilt_ways(stack, np.array([t, 0]))) for t in tilts]
    np.testing.assert_allclose(np.square(np.abs(fixed)), np.exp(-(q**2) * share / 12), atol=2e-3)


def test_the_generalised_memory_effect_of_a_forward_volume():
    """exp{-(k^2 L / 2 l*) [x^2 - L delta x + L^2 delta^2 / 3]}: best shift L delta / 2, best tilt 3 x / (2 L)."""
    thickness, share = 4000.0, 400.0 * 2 / (K * 40.0) ** 2
    stack = forward_stack(400.0, 40.0, thickness)
    delta = 2.0 / (K * thickness)
    for x in np.array([0.0, 0.25, 0.5, 0.75]) * thickness * delta:
        quadratic = x**2 - thickness * delta * x + (thickness * delta) ** 2 / 3
        assert over_all(stack, [delta], x)[0] == pytest.approx(np.exp(-(K**2) * share / 2 * quadratic), abs=2e-3)


@pytest.fixture(scope="module")
def by_waves():
    """Field correlations of the pair of screens, per draw: over all views [R, T], at views near the axis [R, T]."""
    waves = ScreenWaves(PAIR, 1.0, 264, 1.94)
    steps = np.rint(TILTS / waves.step).astype(int)
    assert (np.abs(steps * waves.step - TILTS) < 1e-5).all()
    rng = np.random.default_rng(5)
    y, x = np.meshgrid(*(np.rint(waves.sines / waves.step),) * 2, indexing="ij")
    near = np.hypot(x, y) * waves.step < 0.01
    products, powers = [], []
    for _ in range(48):
        spectra = waves.spectra(waves.fields(waves.phases(rng), [[0, 0], *((s, 0) for s in steps)]))
        both = [(spectra[0] * np.roll(each, -s, axis=1).conj()) for each, s in zip(spectra[1:], steps, strict=True)]
        products.append([[b.sum(), b[near].sum()] for b in both])
        powers.append([(np.abs(spectra[0]) ** 2).sum(), (np.abs(spectra[0][near]) ** 2).sum()])
    return np.abs(np.mean(products, 0).T) / np.mean(powers, 0)[:, None], np.array(products), np.array(powers), waves


def near_the_axis(stack, tilt, radius=0.01):
    """The mixture's K over the views within a radius of the beam, as waves add them up."""
    terms = lobes(stack, 1.0)
    grid = np.linspace(-radius, radius, 9)
    inside = [np.array([a, b]) for a in grid for b in grid if np.hypot(a, b) < radius]
    # Seen between the two tilts: p is the view less the mean of the beams, less half a tilt.
    weights = np.array([terms.density(np.hypot(*p)) for p in inside])
    values = [terms.correlation(p, tilt_ways(stack, np.array([tilt, 0]))) for p in inside]
    return abs(weights @ np.array(values)) / weights.sum()


@pytest.mark.slow
def test_two_screens_by_waves(by_waves):
    found, products, powers, waves = by_waves
    error = []
    for n in range(2):  # jackknife over draws
        product, power = products[..., n], powers[:, n]
        left = [np.abs((product.sum(0) - p) / (power.sum() - w)) for p, w in zip(product, power, strict=True)]
        error.append(np.sqrt(np.var(left, axis=0) * (len(left) - 1)))
    tilts = np.rint(TILTS / waves.step) * waves.step
    # Angles of .064 lengthen the walk by 3 angle^2 / 2 = .6 %, in K by at most 1.2 % of -ln K K: .004.
    assert_z(found[0], over_all(PAIR, tilts), np.array(error[0]), degrees=47, slack=0.0045)
    assert_z(found[1], [near_the_axis(PAIR, t) for t in tilts], np.array(error[1]), degrees=47, slack=0.0045)
    refute_z(found[0], over_all(PAIR, 1.1 * tilts), np.array(error[0]), degrees=47, slack=0.0045)


def test_two_screens_as_they_were_measured_elsewhere():
    """An independent FFT program (reference figures): over all views, and on the axis; errors of the last digit."""
    np.testing.assert_allclose(over_all(PAIR, TILTS), [0.907, 0.680, 0.427, 0.228], atol=0.003)
    found = [near_the_axis(PAIR, t) for t in TILTS]
    np.testing.assert_allclose(found, [0.954, 0.828, 0.656, 0.477], atol=0.01)


def test_memory_effect_of_screens_is_that_of_the_mixture_times_that_of_their_index():
    glass = sg.PhaseScreen(rms_height=20 / K, index=1.5, correlation_length=100.0)
    single = sg.memory_effect(glass, wavelength=1.0, tilts=np.arcsin([0.0, 0.3]))
    np.testing.assert_allclose(single.intensity, [1.0, 0.905], atol=6e-4)
    assert single.single_share == 1.0
    found = sg.memory_effect(PAIR, wavelength=1.0, tilts=np.arcsin(TILTS))
    expected = [abs(lobes(PAIR, 1.0).correlation(np.zeros(2), tilt_ways(PAIR, np.array([t, 0])))) for t in TILTS]
    np.testing.assert_allclose(np.abs(found.field), expected)
    assert_refused(lambda: sg.memory_effect(PAIR, wavelength=1.0, tilts=[0.0], mode="reflection"), "transmission")
