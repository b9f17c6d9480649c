"""Kernels of particle types: amplitudes are the values', and samplers follow them, in 2D and 3D."""

import numpy as np
import pytest
from refusals import assert_refused
from scipy.integrate import quad
from scipy.stats import chi2
from zscore import FALSE_ALARM, assert_z

import specklegen as sg
from specklegen.core.errors import RuleError
from specklegen.kernels import kernel
from specklegen.kernels.phase_table import amplitude, choose_type, closed_amplitude, power, sample
from specklegen.paths.phase_tables import phase_table
from specklegen.scene.scatterers.tabulated import WIDEST_BIN

PI = np.pi
DRAWS = 200_000
TINY = np.array([2.0**-33, 1e-9, 1e-6, 1e-3])
SHARES = np.concatenate([TINY, np.linspace(0.01, 0.99, 99), 1 - TINY[::-1]])


@kernel
def _draw(table, t, u, v, out):
    for n in range(u.size):
        out[n] = sample(table, t, u[n], v[n])


@kernel
def _evaluate(table, t, cos, powers, amplitudes):
    for n in range(cos.size):
        powers[n] = power(table, t, cos[n])
        amplitudes[n] = amplitude(table, t, cos[n])


@kernel
def _evaluate_closed(kind, first, second, cos, amplitudes):
    for n in range(cos.size):
        amplitudes[n] = closed_amplitude(kind, first, second, cos[n])


@kernel
def _choose(table, material, u, types, cos, powers):
    for n in range(u.size):
        types[n] = choose_type(table, material, u[n])
        powers[n] = 0.0
        for t in range(table.material_starts[material], table.material_starts[material + 1]):
            powers[n] += table.shares[t] * power(table, t, cos[n])


def drawn(scatterer, dimensions: int, u=None, v=None, count: int = DRAWS) -> np.ndarray:
    """1 - cos of scattering angles, of random uniforms unless they are given."""
    generator = np.random.default_rng([7, dimensions])
    u = generator.random(count) if u is None else np.broadcast_to(u, np.broadcast(u, v).shape).astype(float)
    v = generator.random(count) if v is None else np.broadcast_to(v, u.shape).astype(float)
    out = np.empty(u.shape)
    _draw(phase_table((scatterer,), dimensions), 0, u, v, out)
    return out


def chosen(table, material: int, u: np.ndarray, cos: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    types, powers = np.empty(u.size, np.int64), np.empty(u.size)
    _choose(table, material, u, types, cos, powers)
    return types, powers


# Nothing is scattered between 0.4 and 0.9, nor beyond 2.
GAPS = sg.Tabulated(theta=[0, 0.2, 0.4, 0.6, 0.9, 1.5, 2.0, 2.5, PI], amplitude=[1, 1j, 0, 0, 0, 2 - 1j, 0, 0, 0])
SPIKE = sg.Tabulated(theta=[0.0, 1.0, 1.00001, 1.00002, PI], amplitude=[0.3, 0.1, 300.0, 0.1j, 0.2])
COARSE = sg.Tabulated(theta=[0.0, PI], amplitude=[1.0, -0.5 + 1j])
SPHERE = sg.Mie(radius=0.8, wavelength=0.5, refractive_index=1.2)
TYPES = {"isotropic": sg.Isotropic(),
         **{f"g = {g}": sg.HenyeyGreenstein(g=g) for g in (-0.99, -0.5, 0.0, 0.9, 0.999, 0.99999)},
         **{f"kappa = {k:g}": sg.VonMisesFisher(concentration=k) for k in (1e-9, 0.5, 3.0, 40.0, 1e4, 1e8)},
         "gaps": GAPS, "spike": SPIKE, "coarse": COARSE, "sphere": SPHERE}  # fmt: skip
CASES = [(name, d) for name in TYPES for d in (2, 3) if (name, d) != ("sphere", 2)]


# ---- Evaluation ----------------------------------------------------------------------------------------
@pytest.mark.parametrize(("name", "dimensions"), CASES)
def test_kernel_and_value_have_one_amplitude(name, dimensions):
    scatterer = TYPES[name]
    theta = np.concatenate([np.geomspace(1e-7, PI, 500), np.linspace(0, PI, 500)])
    # A dot product of two unit vectors may round beyond 1.
    cos = np.concatenate([np.cos(theta), [np.nextafter(1, 2), -np.nextafter(1, 2)]])
    powers, amplitudes = np.empty(cos.size), np.empty(cos.size, np.complex128)
    _evaluate(phase_table((scatterer,), dimensions), 0, cos, powers, amplitudes)
    expected = scatterer.amplitude(cos, dimensions)
    # e^(-kappa (1 - cos)) rounds by its exponent: up to 700 units in the last place before it is nothing. A table
    # is interpolated in theta, whose rounding of 1e-16 is 1e-11 of a bin of 1e-5, of an s that changes by all.
    scale = np.abs(expected).max()
    np.testing.assert_allclose(amplitudes, expected, rtol=1e-12, atol=1e-10 * scale if name == "spike" else 1e-14)
    # The kernel's exponential is 0 where its value would no longer be a normal number.
    np.testing.assert_allclose(powers, np.abs(amplitudes) ** 2, rtol=1e-14, atol=np.finfo(float).tiny)
    assert (powers >= 0).all()


def test_a_table_lists_types_and_materials_in_order():
    mixture = sg.Mixture(types=[GAPS, sg.Isotropic(), COARSE], fractions=[0.2, 0.3, 0.5])
    table = phase_table((sg.HenyeyGreenstein(g=0.5), mixture, SPIKE), 2)
    assert table.material_starts.tolist() == [0, 1, 4, 5]
    assert table.shares.tolist() == [1, 0.2, 0.3, 0.5, 1]
    np.testing.assert_allclose(table.shares_cumulative, [1, 0.2, 0.5, 1, 1], rtol=1e-15)
    assert np.diff(table.offsets).tolist()[:3:2] == [0, 0]
    for first, after in zip(table.offsets, table.offsets[1:], strict=False):
        if after > first:
            assert table.nodes[first] == 0
            assert table.nodes[after - 1] == PI
            assert np.diff(table.nodes[first:after]).max() <= WIDEST_BIN * (1 + 1e-15)
            assert table.cumulative[first] == 0
            assert table.cumulative[after - 1] == 1
    assert phase_table((sg.HenyeyGreenstein(g=0.5), mixture, SPIKE), 2) is table  # remembered
    assert not any(array.flags.writeable for array in table)


def test_refused():
    with pytest.raises(RuleError, match=r"phase_table dimensions must be 2 or 3; got 4\."):
        phase_table((sg.Isotropic(),), 4)  # type: ignore[arg-type]
    assert_refused(lambda: phase_table((SPHERE,), 2), "no scattering in flatland")


# ---- Sampling ------------------------------------------------------------------------------------------
def shares_of_bins(scatterer, dimensions: int, bins: int) -> tuple[np.ndarray, np.ndarray]:
    """Edges in theta that split the light into about equal shares, and these, by quadrature of the value's |s|^2."""
    kinks = SPHERE.table.theta if scatterer is SPHERE else getattr(scatterer, "theta", np.array([0.0, PI]))
    # The sphere's table is fine already; between the few nodes of the others s may change by all.
    some = np.interp(np.arange(0, kinks.size - 1, 1 if scatterer is SPHERE else 1 / 40), np.arange(kinks.size), kinks)
    near = np.geomspace(1e-9, PI / 2, 1500)
    nodes = np.unique(np.concatenate([[0.0, PI], near, PI - near, kinks, some]))
    x, w = np.polynomial.legendre.leggauss(6)
    theta = (nodes[:-1] + nodes[1:])[:, None] / 2 + np.diff(nodes)[:, None] / 2 * x
    around = 2 * PI * np.sin(theta) if dimensions == 3 else 2.0
    density = np.abs(scatterer.amplitude(np.cos(theta), dimensions)) ** 2 * around
    below = np.concatenate([[0.0], np.cumsum((density * w).sum(axis=1) * np.diff(nodes) / 2)])
    # 1 - cos rounds by 1e-16, at g = 0.99999 by 1e-16 / (1 - g)^2 = 1e-6 of the density, at kappa = 1e8 by 1e-8.
    assert abs(below[-1] - 1) < 2e-6
    picked = np.unique(np.searchsorted(below, np.linspace(0, below[-1], bins + 1)[1:-1]))
    picked = np.concatenate([[0], picked, [nodes.size - 1]])
    picked = picked[np.concatenate([[True], np.diff(below[picked]) > 20 / DRAWS])]
    picked[-1] = nodes.size - 1
    return nodes[picked], np.diff(below[picked]) / below[-1]


def assert_follows(scatterer, dimensions: int, one_minus_cos: np.ndarray) -> None:
    """Chi-square of the draws against the value's phase function, at FALSE_ALARM."""
    edges, shares = shares_of_bins(scatterer, dimensions, 150)
    found = np.histogram(2 * np.arcsin(np.sqrt(one_minus_cos / 2)), edges)[0]
    assert found.sum() == one_minus_cos.size
    expected = one_minus_cos.size * shares
    score, freedom = ((found - expected) ** 2 / expected).sum(), shares.size - 1
    assert freedom > 20
    assert score < chi2.isf(FALSE_ALARM, freedom), f"chi-square {score:.0f} for {freedom} degrees of freedom"


@pytest.mark.parametrize(("name", "dimensions"), CASES)
def test_sampler_follows_the_phase_function(name, dimensions):
    one_minus_cos = drawn(TYPES[name], dimensions)
    assert ((one_minus_cos >= 0) & (one_minus_cos <= 2)).all()
    assert_follows(TYPES[name], dimensions, one_minus_cos)


@pytest.mark.parametrize("dimensions", [2, 3])
def test_one_per_cent_is_caught(dimensions):
    """The power of the tests above."""
    right, wrong = sg.HenyeyGreenstein(g=0.9), sg.HenyeyGreenstein(g=0.9 * 1.01)
    with pytest.raises(AssertionError, match="chi-square"):
        assert_follows(right, dimensions, drawn(wrong, dimensions))
    shifted = SPIKE.replace(amplitude=SPIKE.amplitudes * [1, 1, 1.05, 1, 1])
    with pytest.raises(AssertionError, match="chi-square"):
        assert_follows(SPIKE, dimensions, drawn(shifted, dimensions))


# ---- Precision: 1 - cos against inverses by hand, at u from 1e-10 to 1 - 1e-10 ------------------------------
@pytest.mark.parametrize("g", [-0.99, -0.5, 0.0, 0.9, 0.99999])
def test_flat_henyey_is_precise_at_every_angle(g):
    u, g_long = SHARES.astype(np.longdouble), np.longdouble(g)
    angle = 2 * np.arctan((1 - g_long) / (1 + g_long) * np.tan(np.longdouble(PI) / 2 * u))
    expected = (2 * np.sin(angle / 2) ** 2).astype(float)
    # cos(pi u / 2) near u = 1 knows 1 - u to 1e-16 / 1e-10.
    drawing = drawn(sg.HenyeyGreenstein(g=g), 2, SHARES, 0.5)
    np.testing.assert_allclose(drawing[:-4], expected[:-4], rtol=1e-12)
    np.testing.assert_allclose(drawing, expected, rtol=2e-6)


@pytest.mark.parametrize("kappa", [1e-12, 1e-3, 1.0, 1e3, 1e10])
def test_lobe_is_precise_at_every_angle(kappa):
    u, k = SHARES.astype(np.longdouble), np.longdouble(kappa)
    expected = (-np.log1p(u * np.expm1(-2 * k)) / k).astype(float)
    drawing = drawn(sg.VonMisesFisher(concentration=kappa), 3, SHARES, 0.5)
    # For u near 1 the argument of the logarithm is 1 - u, known to 1e-16 / 1e-10.
    np.testing.assert_allclose(drawing[:-4], expected[:-4], rtol=1e-13)
    np.testing.assert_allclose(drawing, expected, rtol=1e-6)


@pytest.mark.parametrize("kappa", [1e-9, 3.0, 1e6])
def test_flat_lobe_is_precise_at_every_angle(kappa):
    """The share below the angle drawn, by adaptive quadrature, is the uniform that drew it."""
    lobe = sg.VonMisesFisher(concentration=kappa)
    table = phase_table((lobe,), 2)
    for row in (0, 1, 40, 100):
        start, stop = table.nodes[row : row + 2]
        density = lambda x: np.exp(-2 * kappa * (np.sin(x / 2) ** 2 - np.sin(start / 2) ** 2))  # noqa: B023, E731
        whole = quad(density, start, stop, epsabs=0, epsrel=1e-13)[0]
        for v in (*TINY, 0.3, 0.99):
            inside = (table.cumulative[row] + table.cumulative[row + 1]) / 2
            if not table.cumulative[row] < inside < table.cumulative[row + 1]:
                continue  # so far out that its share is lost beside 1
            theta = 2 * np.arcsin(np.sqrt(drawn(lobe, 2, np.array([inside]), v)[0] / 2))
            share = quad(density, start, theta, epsabs=0, epsrel=1e-13)[0] / whole
            # theta itself rounds by 1e-15 of start, against the width of the bin times v.
            assert share == pytest.approx(v, rel=1e-11, abs=1e-15 * start / (stop - start) if row else 0)


@pytest.mark.parametrize("dimensions", [2, 3])
def test_the_place_in_a_wide_bin_is_exact(dimensions):
    """The share below the angle drawn, by adaptive quadrature of the line between the nodes, is the v that drew it."""
    table = phase_table((COARSE,), dimensions)
    for row in (0, 3, 8, 15):
        start, stop = table.nodes[row : row + 2]
        nodes, s = table.nodes[row : row + 2], table.amplitudes[row : row + 2]
        around = np.sin if dimensions == 3 else np.ones_like
        density = lambda x: abs(np.interp(x, nodes, s)) ** 2 * around(x)  # noqa: B023, E731
        whole = quad(density, start, stop, epsabs=0, epsrel=2e-14)[0]
        # The chance of the bin: half a turn of it on either side.
        assert np.diff(table.cumulative)[row] == pytest.approx(whole * 2 * (PI if dimensions == 3 else 1), rel=1e-13)
        inside = table.cumulative[row : row + 2].mean()
        for v in (*TINY, 0.3, 0.99):
            theta = 2 * np.arcsin(np.sqrt(drawn(COARSE, dimensions, np.array([inside]), v)[0] / 2))
            share = quad(density, start, theta, epsabs=0, epsrel=1e-13)[0] / whole
            # theta rounds by 1e-15, and comes back from 1 - cos as a root, worse near pi; the density, over its mean
            # in the bin, is at most 3.
            rounding = 3 * (1e-15 + 1e-15 / (PI - theta)) / (stop - start) if row else 0.0
            assert share == pytest.approx(v, rel=1e-13, abs=rounding)


def test_a_table_that_starts_dark_keeps_small_angles():
    """s = theta up to h: theta = h v^(1/3) in 2D; in 3D theta = h v^(1/4) where sin theta is theta."""
    h = 1e-6
    table = sg.Tabulated(theta=[0.0, h, 2 * h, PI], amplitude=[0, 1, 0, 0])
    np.testing.assert_allclose(drawn(table, 2, 0.1, SHARES), (h * np.cbrt(SHARES)) ** 2 / 2, rtol=1e-12)
    # In 3D the first bin, int x^3, has 3 of 4 + ... of the light; sin x = x to h^2/6 = 2e-13.
    np.testing.assert_allclose(drawn(table, 3, 0.1, SHARES), h**2 * np.sqrt(SHARES) / 2, rtol=2e-12)


# ---- Mixtures ------------------------------------------------------------------------------------------

PARTS = (sg.Isotropic(), sg.HenyeyGreenstein(g=0.9), COARSE)


@pytest.mark.parametrize("dimensions", [2, 3])
def test_types_are_chosen_by_their_shares(dimensions):
    fractions = np.array([0.3, 0.1, 0.6])
    table = phase_table((SPIKE, sg.Mixture(types=PARTS, fractions=fractions)), dimensions)
    generator = np.random.default_rng(3)
    cos = generator.uniform(-1, 1, DRAWS)
    types, powers = chosen(table, 1, generator.random(DRAWS), cos)
    counts = np.bincount(types, minlength=4)[1:]
    assert counts.sum() == DRAWS
    assert_z(counts / DRAWS, fractions, np.sqrt(fractions * (1 - fractions) / DRAWS))
    by_hand = sum(f * np.abs(p.amplitude(cos, dimensions)) ** 2 for f, p in zip(fractions, PARTS, strict=True))
    np.testing.assert_allclose(powers, by_hand, rtol=1e-12)
    alone, _ = chosen(table, 0, generator.random(1000), cos[:1000])
    assert (alone == 0).all()


CLOSED = [sg.Isotropic(), *(sg.HenyeyGreenstein(g=g) for g in (-0.9999, -0.5, 0.0, 0.3, 0.9999))]
CLOSED += [sg.VonMisesFisher(concentration=c) for c in (0.1, 5.0, 300.0)]


@pytest.mark.parametrize("dimensions", [2, 3])
@pytest.mark.parametrize("scatterer", CLOSED, ids=str)
def test_the_closed_amplitude_is_the_root_of_the_phase_function(scatterer, dimensions):
    table = phase_table((scatterer,), dimensions)
    cos = np.concatenate([1 - np.geomspace(1e-12, 2, 300), np.geomspace(1e-12, 2, 300) - 1])
    powers, expected, found = np.empty(cos.size), np.empty(cos.size, complex), np.empty(cos.size)
    _evaluate(table, 0, cos, powers, expected)
    _evaluate_closed(table.kinds[0], *table.parameters[0], cos, found)
    np.testing.assert_allclose(found, expected.real, rtol=1e-13, atol=1e-300)
    np.testing.assert_allclose(found**2, powers, rtol=1e-13, atol=1e-300)
