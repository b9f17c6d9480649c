"""Coherent objects: plane waves and their covariances against double sums, and against screens drawn by hand."""

import numpy as np
import pytest
import torch

from specklegen.memory_effects.correlation import MemoryEffectCorrelation
from specklegen.memory_effects.walks import Walks
from specklegen.oracles.screen_waves import ScreenWaves
from specklegen.samplers.screens.coherent import behind_screens
from specklegen.scene.coherent import CoherentObject
from specklegen.scene.screens import PhaseScreen, ScreenStack
from specklegen.scene.sensors import FarField
from specklegen.synthesis.coherent import ManyObjects, joint_objects, one_object, radial, wave_grid, wave_modes
from specklegen.synthesis.correlations import Tabulated
from specklegen.synthesis.gaussian_noise import complex_normals
from tests.zscore import assert_mean, assert_z, refute_mean, refute_z

K = 2 * np.pi  # of the wavelength 1
PITCH, SIDE = 40.0, 12  # an angular spectrum of 0.025 across
RADII = np.sort(np.random.default_rng(5).exponential(1.0, 64))


def correlation(extent):
    """K of exponential walks, whose C_I falls to one half within ``1 / extent`` of the spectrum of the pixels."""
    unit = MemoryEffectCorrelation(RADII, np.ones((1, 64)), 1, 0.0)
    scale = K / PITCH / extent / unit.half_range()
    return MemoryEffectCorrelation(RADII / scale, np.ones((1, 64)), 1, 0.0)


def letters():
    """Ten objects: an L, the same one pixel aside, with a phase, tilted, and others unlike it."""
    rng, x = np.random.default_rng(0), np.arange(SIDE)
    first = np.zeros((SIDE, SIDE), complex)
    first[2:10, 3] = first[9, 3:9] = 1.0
    bar = np.zeros((SIDE, SIDE))
    bar[5:7, 2:10] = 1.0
    noise = rng.standard_normal((2, SIDE, SIDE)) @ np.eye(SIDE)
    return np.stack([
        first, np.roll(first, 1, 1), np.roll(first, 2, 0), np.roll(first, (3, 1), (0, 1)), first.T,
        first * np.exp(0.2j * K * x / SIDE), first * np.exp(5j * K * x / SIDE), bar + 0j,
        np.exp(1j * noise[0]), noise[0] + 1j * noise[1],
    ])  # fmt: skip


def waves(objects, shape=(8, 8), per_grain=2.0, **changes):
    light = CoherentObject(objects, PITCH, **changes)
    return wave_grid(light, 1.0, FarField.grid(shape, 1 / light.side(1.0) / per_grain))


def double_sum(grid, one, two, k, lags):
    """Sum over pairs of plane waves of a_n a*_m K(s_n - s_m) W^(s_n - s_m - dv) W^2, at lags float64[n, 2] (y, x)."""
    y, x = (each.ravel() for each in np.meshgrid(grid.sines, grid.sines, indexing="ij"))
    between = k(K * np.hypot(y[:, None] - y, x[:, None] - x))
    pairs = one.ravel()[:, None] * two.ravel().conj() * between
    found = []
    for dy, dx in lags:
        window = np.sinc((y[:, None] - y - dy) * grid.side) * np.sinc((x[:, None] - x - dx) * grid.side)
        found.append((pairs * window).sum() * grid.side**2)
    return np.array(found)


def by_fields(grid, one, two, k, lags):
    """The integral of E_1 E_2* e^(-ik dv . x) over the window by quadrature, times K(dv): light walks on from there."""
    count = 128
    x = (np.arange(count) + 0.5) / count * grid.side - grid.side / 2
    wave = np.exp(1j * K * x[:, None] * grid.sines)
    both = (wave @ one @ wave.T) * (wave @ two @ wave.T).conj()
    turned = [(np.exp(-1j * K * dy * x), np.exp(-1j * K * dx * x)) for dy, dx in lags]
    return np.array([a @ both @ b for a, b in turned]) * (grid.side / count) ** 2 * k(K * np.hypot(*lags.T))


def covariance(grid, cells, lags):
    """Sum over cells complex[y, x] of e^(-ik dv . x), by matrix products: of what a sampler has there, exactly."""
    y, x = ((np.arange(n) - (axis.count - 1) / 2) * axis.size for n, axis in zip(cells.shape, grid.axes, strict=True))
    return np.array([np.exp(-1j * K * dy * y) @ cells @ np.exp(-1j * K * dx * x) for dy, dx in lags])


LAGS = np.array([[0.0, 0.0], [0.0, 1.5], [0.0, 3.0], [2.0, 0.0], [-1.0, 2.5], [0.0, 5.0]]) / (SIDE * PITCH)


@pytest.mark.parametrize("extent", [0.3, 1.0, 3.0, 10.0])
def test_modes_and_walks_are_the_double_sum_of_amplitudes_and_memory_effect(extent):
    """Correlations of fields at lags of several grains, of ten pairs, within 0.01; a conjugate is told, and a K of
    1. The sampler is linear in its noise, so that its covariance is known without drawing any."""
    objects, k = letters(), correlation(extent)
    grid, amplitudes = waves(objects)
    power = np.square(np.abs(amplitudes)).sum(axis=(1, 2)) * grid.side**2
    drawn = ManyObjects(grid, wave_modes(Tabulated([k]), grid), np.sqrt(grid.area))
    light = drawn.light(amplitudes).numpy()
    walk = radial(k, grid.lateral)
    worst = {"modes": 0.0, "conjugate": 0.0, "complete": 0.0, "walk": 0.0}
    for n in range(len(objects)):
        norm = np.sqrt(power[0] * power[n])
        exact = by_fields(grid, amplitudes[0], amplitudes[n], k, LAGS) / norm
        if n == 1:
            assert np.abs(double_sum(grid, amplitudes[0], amplitudes[n], k, LAGS[:4]) / norm - exact[:4]).max() < 0.01
        found = covariance(grid, (light[0] * light[n].conj()).sum(axis=0), LAGS) * grid.area / norm
        worst["modes"] = max(worst["modes"], np.abs(found - exact).max())
        for name, two, other in (("conjugate", amplitudes[n].conj(), k), ("complete", amplitudes[n], np.ones_like)):
            wrong = by_fields(grid, amplitudes[0], two, other, LAGS) / norm
            worst[name] = max(worst[name], np.abs(found - wrong).max())
        light_alone = np.square(np.abs(grid.field(amplitudes[n])))
        walked = grid.walked(light_alone, walk) * grid.area
        exact = by_fields(grid, amplitudes[n], amplitudes[n], k, LAGS) / power[n]
        worst["walk"] = max(worst["walk"], np.abs(covariance(grid, walked, LAGS) / power[n] - exact).max())
        alone = one_object(grid, amplitudes[n], walk, 1.0)
        assert np.square(alone.root).sum() == pytest.approx(power[n], rel=5e-3)
    assert worst["modes"] < 0.01
    assert worst["walk"] < 0.01
    assert worst["conjugate"] > 0.1
    assert extent < 3 or worst["complete"] > 0.05


@pytest.mark.parametrize("extent", [0.3, 1.0, 3.0, 10.0])
def test_noise_mixed_cell_by_cell_is_the_double_sum_of_any_memory_effect(extent):
    """K that is neither round nor real, as in reflection, of ten pairs within 0.01; its conjugate is told.

    Connections walk more along x, to one side, and later frames keep e^(-2 x Y) of each.
    """
    rng, objects, kept = np.random.default_rng(2), letters(), 0.4
    grid, amplitudes = waves(objects)
    turn = rng.uniform(0, 2 * np.pi, 400)
    ways = np.column_stack([2.5 * np.cos(turn) + 1.0, np.sin(turn)]) * rng.exponential(1.0, 400)[:, None]
    ways *= 0.35 * extent * PITCH
    lags = np.round(LAGS * 1440.0) / 1440.0  # of the camera: only there light may walk farther than its period
    walks = Walks(ways, rng.uniform(0.5, 1.5, 400), rng.exponential(1.0, 400))
    power = np.square(np.abs(amplitudes)).sum(axis=(1, 2)) * grid.side**2
    size = grid.axes[0].size, grid.axes[1].size
    worst = {"pairs": 0.0, "conjugate": 0.0, "film": 0.0, "still": 0.0}
    for n in range(len(objects)):
        trio = amplitudes[[1, 0, n]]  # one before both, so that what they share of it counts
        for later, name in ((0.0, "pairs"), (kept, "film")):
            drawn = joint_objects(
                grid, trio, lambda t, o, x=later: walks.spectrum(grid.period, size, x * (t != o)), 1.0
            )
            weights = walks.weights * np.exp(-2 * later * walks.transfer) / walks.weights.sum()

            def k(q, weights=weights):
                return np.exp(-1j * K * np.multiply.outer(q[:, 1], ways[:, 0])
                              - 1j * K * np.multiply.outer(q[:, 0], ways[:, 1])) @ weights  # fmt: skip

            shared = (drawn.roots[1] * drawn.roots[2].conj()).sum(0).numpy()
            y, x = ((np.arange(size_) + first) for size_, first in zip(shared.shape, drawn.first, strict=True))
            y, x = (axis.positions[0] + at * axis.size for axis, at in zip(grid.axes, (y, x), strict=True))
            found = np.array([np.exp(-1j * K * dy * y) @ shared @ np.exp(-1j * K * dx * x) for dy, dx in lags])
            norm = np.sqrt(power[0] * power[n])
            found = found / norm
            alone = by_fields(grid, trio[1], trio[2], lambda q: np.ones_like(q), lags) / norm
            worst[name] = max(worst[name], np.abs(found - alone * k(lags)).max())
            worst["conjugate"] = max(worst["conjugate"], np.abs(found - alone * k(lags).conj()).max())
            if later:
                still = alone * k(lags, walks.weights / walks.weights.sum())
                worst["still"] = max(worst["still"], np.abs(found - still).max())
            for t in (0, 1, 2):
                lit = drawn.roots[t].abs().square().sum().item()
                assert lit == pytest.approx(power[(1, 0, n)[t]], rel=5e-3)
    assert worst["pairs"] < 0.01
    assert worst["film"] < 0.01
    assert worst["conjugate"] > 0.05
    assert worst["still"] > 0.05


def test_drawn_speckle_has_the_mean_and_the_contrast_of_its_light():
    """Of one object and of two, 40 media: mean intensity within 2 %, |u|^4 twice its square, independent of seeds."""
    objects, k = letters()[:2], correlation(3.0)
    grid, amplitudes = waves(objects, shape=(24, 24))
    power = np.square(np.abs(amplitudes)).sum(axis=(1, 2)) * grid.side**2
    alone = one_object(grid, amplitudes[0], radial(k, grid.lateral), 0.7)
    both = ManyObjects(grid, wave_modes(Tabulated([k]), grid), np.sqrt(0.7 * grid.area))
    light, seen = both.light(amplitudes), []
    for number in range(40):
        one = alone.speckle(complex_normals(1, number, alone.normals, torch.complex64))
        two = both.speckle(both.medium(complex_normals(2, number, both.normals, torch.complex64)), light)
        seen.append(torch.cat([one, two]).numpy())
    intensity = np.square(np.abs(np.array(seen))) / (0.7 * power[[0, 0, 1], None, None])
    assert_mean(intensity.mean(axis=(2, 3)), 1.0, slack=0.005)
    assert_mean(np.square(intensity).mean(axis=(2, 3)), 2.0, slack=0.01)
    refute_mean(np.square(intensity).mean(axis=(2, 3)), 1.0, slack=0.01)
    overlap = (amplitudes[0] * amplitudes[1].conj()).sum() / np.square(np.abs(amplitudes[0])).sum()
    shared = np.array(seen)[:, 1] * np.array(seen)[:, 2].conj() / (0.7 * power[0])
    assert_mean(shared.mean(axis=(1, 2)).real, overlap.real, slack=0.01)


def test_random_phases_average_to_the_incoherent_object():
    """64 objects of random pixel phases before one medium: their mean image is the sum of the pixels' images."""
    rng, k = np.random.default_rng(1), correlation(3.0)
    bright = np.zeros((SIDE, SIDE))
    bright[3:9, 5] = bright[8, 5:9] = 1.0
    pixels = np.zeros((10, SIDE, SIDE), complex)
    pixels[np.arange(len(np.argwhere(bright))), *np.argwhere(bright).T] = 1.0
    phases = bright * np.exp(1j * rng.uniform(0, K, (256, SIDE, SIDE)))
    grid, amplitudes = waves(np.concatenate([pixels[: int(bright.sum())], phases, bright[None] + 0j]), (24, 24))
    drawn = ManyObjects(grid, wave_modes(Tabulated([k]), grid), 1.0)
    medium = drawn.medium(complex_normals(1, 0, drawn.normals, torch.complex64))
    image = np.square(np.abs(drawn.speckle(medium, drawn.light(amplitudes)).numpy()))
    count = int(bright.sum())
    incoherent, mean = image[:count].sum(axis=0), image[count:-1].mean(axis=0)
    assert np.corrcoef(incoherent.ravel(), mean.ravel())[0, 1] > 0.9
    assert mean.mean() == pytest.approx(incoherent.mean(), rel=0.05)
    assert np.corrcoef(incoherent.ravel(), image[-1].ravel())[0, 1] < 0.7  # the coherent object


@pytest.mark.parametrize(("phases", "gaps"), [((2.0,), ()), ((0.7,), ()), ((3.0, 3.0), (1000.0,))])
def test_screens_are_those_drawn_by_hand(phases, gaps):
    """Mean intensities at views, and correlations of two objects at lags, of phases drawn and light carried on."""
    stack = ScreenStack(screens=[PhaseScreen(rms_phase=p, correlation_length=24.0) for p in phases], gaps=gaps)
    count, spacing, draws = 288, 2.0, 24
    oracle, rng = ScreenWaves(stack, 1.0, count, spacing), np.random.default_rng(3)
    one = np.zeros((8, 8), complex)
    one[1:7, 2] = one[6, 2:7] = 1.0
    two = np.roll(one, 1, 1) * np.exp(0.5j * np.arange(8))
    light = CoherentObject(np.stack([one, two]), 48.0, width=oracle.side)
    sines, amplitudes = light.spectrum(1.0)
    x = (np.arange(count) - (count - 1) / 2) * spacing
    wave = np.exp(1j * K * x[:, None] * sines)
    lit = wave @ amplitudes @ wave.T  # E on the first screen
    blocks = [(slice(r, r + 10), slice(c, c + 10)) for r, c in ((0, 0), (0, 10), (13, 13))]
    lags = [(0, 0), (0, 1), (1, 0), (0, 2)]

    def measured(spectra):
        """Mean intensities over blocks of views, and products of the fields at lags, of fields complex[2, 25, 25]."""
        power = [np.square(np.abs(spectra[0][block])).mean() for block in blocks]
        shared = [(spectra[0, r : 20 + r, c : 20 + c] * spectra[1, :20, :20].conj()).mean() for r, c in lags]
        return np.array([*power, *(each.real for each in shared), *(each.imag for each in shared)])

    step = np.arange(25)
    turned = np.exp(-1j * K * oracle.step * x[0] * np.add.outer(step, step))  # an FFT counts from the first point
    still, share = np.zeros((len(phases), count, count)), np.exp(-0.5 * np.square(phases).sum())
    ballistic = np.concatenate([oracle.fields(still, [(0, 0)], each) for each in lit]) * share
    seen, found = [], []
    for _ in range(draws):
        drawn = oracle.phases(rng)
        fields = np.concatenate([oracle.fields(drawn, [(0, 0)], each) for each in lit])
        seen.append(measured(oracle.spectra(fields - ballistic)[:, :25, :25] * turned))
    grid, own = wave_grid(light, 1.0, FarField.grid((25, 25), oracle.step, center=(12 * oracle.step, 12 * oracle.step)))
    sampler = behind_screens(stack, 1.0, grid)
    light_of = sampler.light(own)
    for number in range(3 * draws):
        white = complex_normals(7, number, sampler.normals, torch.complex64)
        found.append(measured(sampler.speckle(sampler.medium(white), light_of).numpy()))
    scale = np.array(found)[:, 0].mean()
    seen, found = np.array(seen) / scale, np.array(found) / scale
    error = np.hypot(seen.std(axis=0, ddof=1) / draws**0.5, found.std(axis=0, ddof=1) / (3 * draws) ** 0.5)
    assert_z(found.mean(axis=0), seen.mean(axis=0), error, degrees=draws - 1, slack=0.02)
    signs = np.repeat([1.0, -1.0], [7, 4])  # a conjugate
    refute_z(found.mean(axis=0) * signs, seen.mean(axis=0), error, degrees=draws - 1, slack=0.02)
