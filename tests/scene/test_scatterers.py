"""Scatterers as values: normalised, of the mean cosine they say, refused when wrong, written without loss."""

import sys

import numpy as np
import pytest
from refusals import assert_refused
from scenes import DATA
from scipy.integrate import quad
from scipy.special import spherical_jn, spherical_yn

import specklegen as sg
from specklegen.core.errors import RuleError
from specklegen.scene.scatterers.tabulated import ACCURACY

PI, NAN = np.pi, np.nan
RIPPLES = sg.Tabulated(theta=[0.0, 0.3, 1.0, 2.0, PI], amplitude=[3.0, -1 + 2j, 0.0, 0.5j, 1.0])
PEAKED = sg.Tabulated(theta=[0.0, 1e-3, 2e-3, PI], amplitude=[1e3, 1e3j, 0.1, 0.1])

FLAT_TOO = {"isotropic": sg.Isotropic(), "henyey": sg.HenyeyGreenstein(g=0.9), "backward": sg.HenyeyGreenstein(g=-0.9),
            "nearly isotropic lobe": sg.VonMisesFisher(concentration=1e-9),
            "lobe": sg.VonMisesFisher(concentration=3.0), "narrow lobe": sg.VonMisesFisher(concentration=1e5),
            "ripples": RIPPLES, "peaked": PEAKED}  # fmt: skip
SPHERE = sg.Mie(radius=0.8, wavelength=0.5, refractive_index=1.2)
CASES = [(name, d) for name in FLAT_TOO for d in (2, 3)] + [("sphere", 3)]


def named(name: str):
    return SPHERE if name == "sphere" else FLAT_TOO[name]


def over_all_directions(scatterer, dimensions: int, weight=lambda cos: 1.0) -> float:
    """Integral of |s|^2 times a weight, by adaptive quadrature in theta between the nodes of a table."""

    def density(theta):
        around = 2 * PI * np.sin(theta) if dimensions == 3 else 2.0
        return abs(complex(scatterer.amplitude(np.cos(theta), dimensions))) ** 2 * around * weight(np.cos(theta))

    table = SPHERE.table if scatterer is SPHERE else scatterer
    ends = table.theta if isinstance(table, sg.Tabulated) else np.concatenate([[0], np.geomspace(1e-4, PI, 20)])
    if scatterer is SPHERE:  # a hundred nodes at a time: the integrand is smooth to ACCURACY
        x, w = np.polynomial.legendre.leggauss(6)
        theta = ends[:-1, None] + np.diff(ends)[:, None] * (x + 1) / 2
        return float((np.vectorize(density)(theta) * w * np.diff(ends)[:, None] / 2).sum())
    return sum(quad(density, *pair, epsrel=1e-11, epsabs=1e-13)[0] for pair in zip(ends, ends[1:], strict=False))


# A cosine rounds by 1e-16, so a lobe of width w by 1e-16 / w^2: 1e-11 for the narrow one; for a table by
# 1e-16 / theta, 1e-13 of its bin of 1e-3.
@pytest.mark.parametrize(("name", "dimensions"), CASES)
def test_scattered_power_is_one(name, dimensions):
    assert over_all_directions(named(name), dimensions) == pytest.approx(1, abs=1e-9)


@pytest.mark.parametrize(("name", "dimensions"), CASES)
def test_mean_cosine(name, dimensions):
    scatterer = named(name)
    slack = 1e-4 if name == "sphere" else 1e-9  # the sphere's is the series', its table is good to ACCURACY
    mean = over_all_directions(scatterer, dimensions, lambda cos: cos)
    assert scatterer.mean_cosine(dimensions) == pytest.approx(mean, abs=slack)
    if dimensions == 3:
        assert scatterer.g == scatterer.mean_cosine()


@pytest.mark.parametrize("kappa", [1e-12, 1e-6, 1e-3, 0.999, 1.001, 30.0, 1e6, 1e10])
def test_mean_cosine_of_a_lobe_at_both_ends(kappa):
    """kappa/d (1 - kappa^2/(d (d + 2))) where it is wide, 1 - (d - 1)/(2 kappa) where it is narrow; increasing."""
    lobe = sg.VonMisesFisher(concentration=kappa)
    for d in (2, 3):
        if kappa <= 1e-3:
            assert lobe.mean_cosine(d) == pytest.approx(kappa / d * (1 - kappa**2 / d / (d + 2)), rel=1e-12)
        if kappa >= 1e6:
            assert 1 - lobe.mean_cosine(d) == pytest.approx((d - 1) / (2 * kappa), rel=2e-6)
        wider = sg.VonMisesFisher(concentration=kappa * 0.99)
        assert 0 < wider.mean_cosine(d) < lobe.mean_cosine(d) < 1


def test_a_mixture_is_the_mean_of_its_types():
    parts = [sg.HenyeyGreenstein(g=0.9), sg.Isotropic(), RIPPLES]
    mixture = sg.Mixture(types=parts, fractions=[0.5, 0.2, 0.3])
    for d in (2, 3):
        assert mixture.mean_cosine(d) == pytest.approx(0.45 + 0.3 * RIPPLES.mean_cosine(d), rel=1e-15)
    assert mixture.g == mixture.mean_cosine(3)
    assert_refused(lambda: mixture.amplitude(1.0), "one of its types")


def test_a_type_of_weight_zero_is_no_type():
    parts = [sg.Isotropic(), sg.HenyeyGreenstein(g=0.9), SPHERE]
    with_zero = sg.Mixture(types=parts, fractions=[0.3, 0.0, 0.7])
    without = sg.Mixture(types=[parts[0], parts[2]], fractions=[0.3, 0.7])
    assert with_zero == without
    assert with_zero.fingerprint() == without.fingerprint()


def test_a_mixture_of_one_type_is_that_type():
    for alone in (sg.HenyeyGreenstein(g=0.7), RIPPLES):
        mixed = sg.Mixture(types=[alone], fractions=[1])
        assert sg.Slab(thickness=1.0, mean_free_path=1.0, scatterer=mixed).scatterer == alone


# ---- Tables --------------------------------------------------------------------------------------------
def test_a_table_keeps_phase_and_shape():
    for d in (2, 3):
        s = RIPPLES.amplitude(np.cos(RIPPLES.theta), d)
        scale = s[0] / 3.0
        assert scale.real > 0
        assert scale.imag == 0
        # theta is read back from its cosine, which at pi rounds by root(1e-16): 1e-8 of a slope of 0.5.
        np.testing.assert_allclose(s, scale * RIPPLES.amplitudes, atol=1e-8)
        middle = RIPPLES.amplitude(np.cos(0.65), d)
        assert middle == pytest.approx(scale * (-0.5 + 1j), rel=1e-12)


def test_the_cylinder_of_the_wave_solver():
    """Its table is normalised in flatland already, to seven digits by the trapezium rule."""
    degrees, real, imag = np.loadtxt(DATA / "cylinder_amplitude.csv", delimiter=",", skiprows=1).T
    half = degrees <= 180
    cylinder = sg.Tabulated(theta=np.deg2rad(degrees[half]), amplitude=(real + 1j * imag)[half])
    s = cylinder.amplitude(np.cos(np.deg2rad(degrees)), 2)
    np.testing.assert_allclose(s, real + 1j * imag, rtol=1e-5)
    assert abs(cylinder.mean_cosine(2)) < 0.02  # "nearly isotropic"


# ---- Spheres -------------------------------------------------------------------------------------------

ANGLES = np.linspace(0, PI, 1001)
SPHERES = [(0.01, 1.5), (1.0, 1.5 + 0.1j), (10.0, 1.2), (30.0, 1.33)]


def sphere(x: float, index: complex) -> sg.Mie:
    return sg.Mie(radius=x * 0.7 / (2 * PI), wavelength=0.7, refractive_index=index)


@pytest.mark.parametrize(("x", "index"), SPHERES)
def test_a_sphere_has_the_phase_function_of_miepython(x, index):
    miepython = pytest.importorskip("miepython")
    particle = sphere(x, index)
    power = np.abs(particle.amplitude(np.cos(ANGLES))) ** 2
    expected = miepython.i_unpolarized(index, x, np.cos(ANGLES), norm="one")
    # The table is straight to ACCURACY of s half-way between nodes, and its norm likewise: twice each in |s|^2.
    np.testing.assert_allclose(power, expected, rtol=4 * ACCURACY)
    # Backward the series is taken 1e-3 / x away: 1e-6 of |s|^2.
    np.testing.assert_allclose(np.abs(particle.exact_amplitude(ANGLES)) ** 2, expected, rtol=1e-5)
    extinction, scattering, _, g = miepython.efficiencies_mx(index, x)
    assert particle.g == pytest.approx(g, rel=1e-12)  # x itself is rounded
    assert particle.table.g == pytest.approx(g, abs=ACCURACY)
    assert particle.albedo == pytest.approx(scattering / extinction, rel=1e-12)
    assert particle.scattering_cross_section == pytest.approx(scattering * PI * particle.radius**2)
    assert particle.extinction_cross_section == pytest.approx(extinction * PI * particle.radius**2)


def series(x: float, index: complex, cos: float) -> complex:
    """i (S1 + S2) by Bohren and Huffman's Eqs. 4.56, 4.57, 4.74 for e^(-i omega t), on SciPy's Bessel functions."""
    n = np.arange(1, int(x + 4 * x ** (1 / 3) + 10))
    hankel = lambda z, d=False: spherical_jn(n, z, d) + 1j * spherical_yn(n, z, d)  # noqa: E731
    psi, dpsi = x * spherical_jn(n, x), spherical_jn(n, x) + x * spherical_jn(n, x, True)
    xi, dxi = x * hankel(x), hankel(x) + x * hankel(x, True)
    y = index * x
    inner, dinner = y * spherical_jn(n, y), spherical_jn(n, y) + y * spherical_jn(n, y, True)
    a = (index * inner * dpsi - psi * dinner) / (index * inner * dxi - xi * dinner)
    b = (inner * dpsi - index * psi * dinner) / (inner * dxi - index * xi * dinner)
    p = [np.polynomial.Legendre.basis(int(k)) for k in n]
    pi = np.array([q.deriv()(cos) for q in p])
    tau = np.array([cos * q.deriv()(cos) - (1 - cos**2) * q.deriv(2)(cos) for q in p])
    return complex(1j * ((2 * n + 1) / (n * (n + 1)) * (a + b) * (pi + tau)).sum())


@pytest.mark.parametrize(("x", "index"), [(1.0, 1.5 + 0.1j), (5.0, 1.2)])
def test_a_sphere_has_the_phase_of_its_series(x, index):
    particle = sphere(x, index)
    for cos in (1.0, 0.9, 0.2, -0.6):
        turn = particle.amplitude(cos) / series(x, index, cos)
        assert abs(np.angle(turn)) < 4 * ACCURACY


def test_a_small_sphere_scatters_as_rayleigh():
    particle = sphere(1e-3, 1.5)
    # The dipole is alone to x^2 = 1e-6; the table adds 2 ACCURACY.
    expected = 3 / (16 * PI) * (1 + np.cos(ANGLES) ** 2)
    np.testing.assert_allclose(np.abs(particle.amplitude(np.cos(ANGLES))) ** 2, expected, rtol=3 * ACCURACY)
    assert particle.efficiencies.scattering == pytest.approx(8 / 3 * 1e-12 * (1.25 / 4.25) ** 2, rel=1e-5)
    assert abs(particle.g) < 1e-6
    # In step with the light, but for what the sphere radiates: of order x^3, lost in rounding before miepython 3.3.
    assert np.angle(particle.amplitude(1.0)) == pytest.approx(2 / 3 * 1.25 / 4.25 * 1e-9, rel=1e-5)


def test_without_miepython_the_error_says_what_to_install(monkeypatch):
    monkeypatch.setitem(sys.modules, "miepython", None)
    with pytest.raises(ImportError, match=r'pip install "specklegen-torch\[mie\]"'):
        sphere(3.0, 1.4).amplitude(1.0)


# ---- Errors and round trips ----------------------------------------------------------------------------
def tabulated(theta=(0.0, 1.0, PI), amplitude=(1.0, 1.0, 1.0)):
    return sg.Tabulated(theta=theta, amplitude=amplitude)


def mixed(fractions, types=None):
    pair = [sg.Isotropic(), sg.HenyeyGreenstein(g=0.5)]
    return sg.Mixture(types=pair if types is None else types, fractions=fractions)


def mie(**changes):
    return sg.Mie(**({"radius": 1.0, "wavelength": 0.5, "refractive_index": 1.2} | changes))


REFUSED = {
    "negative angle": (lambda: tabulated([-0.1, 1, PI]), ["Tabulated.theta", "at least 0", "-0.1"]),
    "unsorted": (lambda: tabulated([0, 2, 1, PI], [1] * 4), ["Tabulated.theta", "strictly rising", "2.", "Sort"]),
    "degrees": (lambda: tabulated([0, 90, 180]), ["Tabulated.theta", "from 0 to pi", "180.", "np.deg2rad"]),
    "one angle": (lambda: tabulated([0.0], [1.0]), ["Tabulated.theta", "two angles"]),
    "amplitude inf": (lambda: tabulated(amplitude=[1, 1j * np.inf, 1]), ["Tabulated.amplitude", "finite", "inf"]),
    "half an amplitude": (lambda: tabulated(amplitude={"real": [1]}), ["Tabulated.amplitude", "real and imag"]),
    "uneven parts": (lambda: tabulated(amplitude={"real": [1, 1, 1], "imag": [1]}),
                     ["Tabulated.amplitude", "as many imaginary parts"]),
    "dark": (lambda: tabulated(amplitude=[0, 0, 0]), ["Tabulated.amplitude", "other than 0"]),
    "lengths differ": (lambda: tabulated(amplitude=[1, 1]), ["Tabulated.amplitude", "(3,)", "(2,)"]),
    "negative density": (lambda: sg.Tabulated.from_power([0, 1, PI], [1, -1, 1]),
                         ["Tabulated.from_power power", "at least 0", "-1."]),
    "concentration beyond rounding": (lambda: sg.VonMisesFisher(concentration=1e11),
                                      ["VonMisesFisher.concentration", "at most 10000000000"]),
    "gain": (lambda: mie(refractive_index=1.2 - 0.1j), ["Mie.refractive_index", "absorption", "0.1j", "n + i kappa"]),
    "no step": (lambda: mie(refractive_index=1.0), ["Mie.refractive_index", "other than 1"]),
    "two indices": (lambda: mie(refractive_index=[1.2, 1.3]), ["Mie.refractive_index", "one number"]),
    "sphere in flatland": (lambda: mie().amplitude(1.0, 2), ["Mie dimensions", "3", "2", "Tabulated"]),
    "four dimensions": (lambda: sg.Isotropic().amplitude(1.0, 4), ["dimensions", "2 or 3", "4"]),  # type: ignore
    "fractions above 1": (lambda: mixed([0.5, 0.6]), ["Mixture.fractions", "sum to 1 within 1e-9", "0.6", "1.1"]),
    "fraction negative": (lambda: mixed([1.5, -0.5]), ["Mixture.fractions", "at least 0", "-0.5"]),
    "one fraction short": (lambda: mixed([1.0]), ["Mixture.fractions", "each of the 2 types", "1.0"]),
    "no types": (lambda: mixed([], []), ["Mixture.types", "at least 1 long"]),
    "nested": (lambda: mixed([1.0], [mixed([0.5, 0.5])]), ["Mixture.types", "types of particle", "Mixture"]),
}  # fmt: skip


@pytest.mark.parametrize("case", REFUSED)
def test_error_names_field_rule_and_value(case):
    build, parts = REFUSED[case]
    with pytest.raises(RuleError) as caught:
        build()
    for part in (*parts, " must be ", "; got "):
        assert part in str(caught.value), str(caught.value)


@pytest.mark.parametrize("name", [*FLAT_TOO, "sphere", "mixture"])
def test_json_and_toml_give_the_medium_back(name):
    scatterer = sg.Mixture(types=[RIPPLES, SPHERE], fractions=[0.25, 0.75]) if name == "mixture" else named(name)
    medium = sg.Slab(thickness=1.0, mean_free_path=1 / 3, scatterer=scatterer)
    for copy in (sg.Slab.from_json(medium.canonical_json()), sg.Slab.from_toml(medium.to_toml())):
        assert copy == medium
        assert copy.canonical_json() == medium.canonical_json()
        assert copy.scatterer.replace() == scatterer
