"""Random numbers, trigonometry, phase functions, frames and the compiled-kernel cache."""

import numpy as np
import pytest
import torch
from numba import njit
from scipy.stats import chi2
from zscore import FALSE_ALARM, assert_mean

from specklegen.kernels import rng
from specklegen.kernels.arithmetic import exponential, fma, minus_log, minus_log1m, power_minus_three_quarters
from specklegen.kernels.frames import deflect
from specklegen.kernels.phase_functions import henyey_greenstein, sample_henyey_greenstein
from specklegen.kernels.trigonometry import sincos_turns
from specklegen.synthesis.gaussian_noise import torch_normals

ANISOTROPIES = [-0.99, -0.5, 0.0, 0.5, 0.9, 0.999, 0.99999]
DRAWS = 400_000


@njit
def _sincos(turns, out):
    for n in range(turns.size):
        out[n, 0], out[n, 1] = sincos_turns(turns[n])


@njit
def _lobe(g, u, out):
    for n in range(u.size):
        out[n] = sample_henyey_greenstein(g, u[n])


@njit
def _deflected(directions, one_minus_cos, azimuth, out):
    for n in range(len(directions)):
        sine, cosine = sincos_turns(azimuth[n])
        x, y, z = directions[n]
        out[n, 0], out[n, 1], out[n, 2] = deflect(x, y, z, one_minus_cos[n], cosine, sine)


@njit
def _logarithms(x, out):
    for n in range(x.size):
        out[n, 0], out[n, 1] = minus_log(x[n]), minus_log1m(x[n])


@njit
def _powers(x, out):
    for n in range(x.size):
        out[n, 0], out[n, 1] = exponential(-x[n]), power_minus_three_quarters(x[n])


@njit
def _square_error(x, out):
    for n in range(x.size):
        out[n] = fma(x[n], x[n], -(x[n] * x[n]))


def lobe(g: float, seed: int = 1) -> np.ndarray:
    """1 - cos of DRAWS scattering angles."""
    out = np.empty(DRAWS)
    _lobe(g, np.random.default_rng([seed, DRAWS]).random(DRAWS), out)
    return out


# ---- Philox --------------------------------------------------------------------------------------------
# counter, key, answer: "philox4x32 10" of the known-answer vectors published with Random123 (Salmon et al.).
KNOWN_ANSWERS = [
    ("00000000 00000000 00000000 00000000", "00000000 00000000", "6627e8d5 e169c58d bc57ac4c 9b00dbd8"),
    ("ffffffff ffffffff ffffffff ffffffff", "ffffffff ffffffff", "408f276d 41c83b0e a20bc7c6 6d5451fd"),
    ("243f6a88 85a308d3 13198a2e 03707344", "a4093822 299f31d0", "d16cfe09 94fdcceb 5001e420 24126ea1"),
]


def words(text: str) -> list[int]:
    return [int(word, 16) for word in text.split()]


@pytest.mark.parametrize(("counter", "key", "answer"), KNOWN_ANSWERS)
def test_philox_gives_the_published_answers(counter, key, answer):
    assert list(rng.philox(*map(np.uint64, words(key) + words(counter)))) == words(answer)


@pytest.mark.parametrize("count", [1, 2, 7, 4096])
def test_torch_draws_the_normals_of_the_kernel(count):
    key, sample = (0x9E3779B9, 0xFFFFFFFE), 3
    drawn = np.empty((count, 2))
    rng.fill_normals(*key, sample, drawn)
    same = torch_normals(key, sample, count, "cpu")
    assert same.dtype == torch.float64
    # sqrt(-2 log u) <= 6.8 and both sines are right to a few units in the last place.
    np.testing.assert_allclose(same.numpy(), drawn, rtol=0, atol=2e-14)


def test_normals_are_normal():
    drawn = np.empty((200_000, 2))
    rng.fill_normals(1, 2, 3, drawn)
    moments = np.stack([drawn, drawn**2, drawn**3, drawn**4], -1).reshape(-1, 8)
    assert_mean(np.concatenate([moments, drawn.prod(axis=1, keepdims=True)], 1), [0, 1, 0, 3, 0, 1, 0, 3, 0])


def test_normals_of_other_samples_are_others():
    first, second, again = (np.empty((100, 2)) for _ in range(3))
    rng.fill_normals(1, 2, 3, first)
    rng.fill_normals(1, 2, 4, second)
    rng.fill_normals(1, 2, 3, again)
    assert (first == again).all()
    assert not (first == second).any()


# ---- Arithmetic ----------------------------------------------------------------------------------------
def test_logarithms_are_right_to_rounding():
    random = np.random.default_rng(0).random((3, 50_000))
    edges = [2.0**-33, 1 - 2.0**-33, 0.5, np.sqrt(0.5), np.nextafter(np.sqrt(0.5), 0), 1e-300, 1e-17, 1 - 2.0**-53]
    x = np.concatenate([random[0], 2.0 ** (-50 * random[1]), 1 - 2.0 ** (-50 * random[2]), edges])
    out = np.empty((x.size, 2))
    _logarithms(x, out)
    exact = x.astype(np.longdouble)
    for found, expected in zip(out.T, (-np.log(exact), -np.log1p(-exact)), strict=True):
        # The second adds a quotient and a product to the rounding of the first.
        np.testing.assert_allclose(found, expected.astype(float), rtol=6e-16)


def test_exponential_and_power_are_right_to_rounding():
    x = np.exp(np.random.default_rng(0).uniform(np.log(1e-12), np.log(708), 200_000))
    out = np.empty((x.size, 2))
    _powers(x, out)
    exact = x.astype(np.longdouble)
    np.testing.assert_allclose(out[:, 0], np.exp(-exact).astype(float), rtol=4e-16)
    # The root's error, two roundings or so, is tripled by y y y.
    np.testing.assert_allclose(out[:, 1], (exact**-0.75).astype(float), rtol=2e-15)


def test_exponential_is_zero_far_out():
    out = np.empty((4, 2))
    _powers(np.array([708.0, 709.0, 1e9, np.inf]), out)
    assert (out[:, 0] == 0).all()
    _powers(np.zeros(4), out)
    assert (out[:, 0] == 1).all()


def test_the_fused_multiply_add_rounds_once():
    x = np.random.default_rng(0).random(1000)
    out = np.empty(1000)
    _square_error(x, out)
    error = np.square(x.astype(np.longdouble)) - np.square(x)  # 11 bits of it survive in long double
    assert (out != 0).mean() > 0.9
    np.testing.assert_allclose(out, error.astype(float), rtol=0, atol=2.0**-63)


# ---- Trigonometry --------------------------------------------------------------------------------------
@pytest.mark.parametrize("span", [0.5, 1.0, 1e4, 1e8])
def test_sincos_turns_is_exact_to_rounding(span):
    turns = np.random.default_rng(0).uniform(-span, span, 100_000)
    turns[:9] = [0.0, -0.0, 0.125, -0.125, 0.25, 0.5, 0.75, -0.25, span]
    out = np.empty((turns.size, 2))
    _sincos(turns, out)
    angle = (turns - np.rint(turns)).astype(np.longdouble) * (
        2 * np.longdouble("3.14159265358979323846264338327950288")
    )
    # The bound that the module states. Reduction to a period is exact, so it holds at any distance.
    assert np.abs(out[:, 0] - np.sin(angle)).max() < 2e-15
    assert np.abs(out[:, 1] - np.cos(angle)).max() < 2e-15


def quantiles(g: float, u: np.ndarray) -> np.ndarray:
    """1 - cos at the shares ``u`` of the lobe nearest to forward: integrated by hand, in long double."""
    u, g = u.astype(np.longdouble), np.longdouble(g)
    if g == 0:
        return (2 * u).astype(float)
    # P(1 - cos < x) = (1 - g^2)/(2g) [1/(1-g) - ((1-g)^2 + 2 g x)^(-1/2)]
    root = 1 / (1 / (1 - g) - 2 * g * u / (1 - g**2))
    return ((root**2 - (1 - g) ** 2) / (2 * g)).astype(float)


def assert_density(g: float, drawn_with: float) -> None:
    """Sampler against density: 200 bins of 1 - cos, their probabilities by quadrature of the kernel's density."""
    edges = quantiles(g, np.linspace(0, 1, 201))
    edges[0], edges[-1] = 0.0, 2.0
    # Quadrature in the logarithm of the distance from the lobe's pole, softened by its width: smooth at any g.
    pole = 0.0 if g >= 0 else 2.0
    width = (1 - abs(g)) ** 2 / (2 * abs(g)) if g else 1.0
    ends = np.log(np.abs(edges - pole) + width)
    nodes, weights = np.polynomial.legendre.leggauss(12)
    half = np.abs(np.diff(ends))[:, None] / 2
    far = np.exp((ends[:-1] + ends[1:])[:, None] / 2 + half * nodes)
    one_minus_cos = np.abs(pole - (far - width))
    density = np.vectorize(henyey_greenstein)(g, 1 - one_minus_cos)
    share = 2 * np.pi * (density * weights * half * far).sum(axis=1)
    # 1 - (1 - cos) rounds by 1e-16, which at g = 0.99999 is 1e-16 / (1 - g)^2 = 1e-6 of the density.
    assert abs(share.sum() - 1) < 2e-6
    found = np.histogram(lobe(drawn_with), edges)[0]
    assert found.sum() == DRAWS
    score = ((found - DRAWS * share) ** 2 / (DRAWS * share)).sum()
    assert score < chi2.isf(FALSE_ALARM, 199), f"chi-square {score:.0f} for 199 degrees of freedom"


@pytest.mark.parametrize("g", ANISOTROPIES)
def test_sampler_follows_its_density(g):
    assert_density(g, drawn_with=g)


def test_one_per_cent_in_g_is_caught():
    """The power of the test above."""
    with pytest.raises(AssertionError, match="chi-square"):
        assert_density(0.9, drawn_with=0.9 * 1.01)
    with pytest.raises(AssertionError, match="chi-square"):
        assert_density(0.999, drawn_with=1 - 0.001 * 1.1)


@pytest.mark.parametrize("g", ANISOTROPIES)
def test_sampler_keeps_relative_precision_at_the_ends(g):
    u = np.array([1e-9, 1e-6, 0.1, 0.5, 0.9, 1 - 1e-6, 1 - 1e-9])
    out = np.empty_like(u)
    _lobe(g, u, out)
    # For g < -0.9 the mirrored lobe is drawn: u counts from the backward side, and cos + 1 is the precise one.
    if g < -0.9:
        # ... up to the rounding of 2 - (1 + cos), which is all that a cosine near -1 can tell.
        np.testing.assert_allclose(2 - out, quantiles(-g, 1 - u), rtol=1e-7, atol=3e-16)
    else:
        # physics.md 6: 6e-12 at g = 0.99999; 1 - u itself is known to 1e-16 / 1e-9.
        np.testing.assert_allclose(out, quantiles(g, 1 - u), rtol=2e-7 if g > 0.99 else 1e-7)


# ---- Frames --------------------------------------------------------------------------------------------
def directions() -> np.ndarray:
    generator = np.random.default_rng(2)
    some = generator.normal(size=(20_000, 3))
    some[:1000, :2] *= 1e-8  # close to either pole
    some[1000:2000, 2] *= 1e-12  # across the axis
    some = some / np.linalg.norm(some, axis=1, keepdims=True)
    exact = [[0, 0, 1], [0, 0, -1], [1, 0, 0], [1, 0, -0.0], [0, 1, 0.0], [0, -1, -0.0], [-1, 0, 0.0]]
    return np.concatenate([np.array(exact), some])


def turned(start: np.ndarray, one_minus_cos, azimuth) -> np.ndarray:
    out = np.empty_like(start)
    _deflected(start, *(np.broadcast_to(a, len(start)).astype(float) for a in (one_minus_cos, azimuth)), out)
    return out


def test_deflect_keeps_unit_length_and_turns_by_the_angle():
    start, generator = directions(), np.random.default_rng(3)
    one_minus_cos, azimuth = 2 * generator.random(len(start)), generator.random(len(start))
    end = turned(start, one_minus_cos, azimuth)
    # Three products and sums of numbers below 1, on directions that are unit vectors to 2e-16 themselves.
    assert np.abs(np.linalg.norm(end, axis=1) - 1).max() < 2e-15
    assert np.abs((start * end).sum(axis=1) - (1 - one_minus_cos)).max() < 2e-15


def test_deflect_spans_a_right_handed_frame():
    start = directions()
    first, second = turned(start, 1.0, 0.0), turned(start, 1.0, 0.25)
    assert np.abs((first * second).sum(axis=1)).max() < 1e-15
    assert np.abs(np.cross(first, second) - start).max() < 1e-15


def test_deflect_keeps_tiny_angles():
    """1 - cos = 1e-20 is an angle of 1.4e-10, which 1 - (1 - 1e-20) would lose."""
    for pole in ([0.0, 0.0, 1.0], [0.0, 0.0, -1.0]):
        end = turned(np.array([pole]), 1e-20, 0.1)[0]
        assert np.hypot(end[0], end[1]) == pytest.approx(np.sqrt(2e-20), rel=1e-12)
