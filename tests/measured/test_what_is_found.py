"""Bits, saturation, hot pixels, region and envelope of synthetic frames, against what was put in."""

import numpy as np
import pytest
from scipy.stats import norm
from zscore import assert_z

from specklegen.core.errors import RuleError
from specklegen.instrument.hot_pixels import hot_among_neighbours, hot_in_dark
from specklegen.measured import read_measurement


def speckle(grain, seed, shape=(128, 128)):
    """Developed speckle of mean 1 behind a round iris whose grains are ``grain`` pixels, lambda z / D."""
    rng = np.random.default_rng(seed)
    field = rng.normal(size=shape) + 1j * rng.normal(size=shape)
    y, x = np.meshgrid(*map(np.fft.fftfreq, shape), indexing="ij")
    intensity = np.abs(np.fft.ifft2(np.fft.fft2(field) * (np.hypot(y, x) < 0.5 / grain))) ** 2
    return intensity / intensity.mean()


def beam(shape=(128, 128)):
    """A Gaussian beam off the middle, of mean 1; its logarithm is a polynomial of degree 2."""
    y, x = np.meshgrid(*(np.linspace(-1, 1, side) for side in shape), indexing="ij")
    light = np.exp(-np.square(x - 0.2) / 0.8 - np.square(y + 0.1) / 1.2)
    return light / light.mean()


LIGHT = speckle(3, 0)


@pytest.mark.parametrize(("counts", "bits", "saturation", "told"), [
    (np.minimum(60 * LIGHT, 255).astype(np.uint8), 8, 255, None),
    (np.minimum(20 * LIGHT, 250).astype(np.uint8), 8, None, "8 bits, from the type of the file"),
    (np.minimum(900 * LIGHT, 4095).astype(np.uint16), 12, 4095, None),
    (np.minimum(900 * LIGHT, 4095).astype(np.uint16) * 16, 12, 65520, "steps of 16: the lowest 4 bits are empty"),
    (np.minimum(900 * LIGHT, 4095).astype(np.uint16).astype(np.float64), 12, 4095, None),
    ((300 * LIGHT).astype(np.uint16), 12, None, "12 bits are the fewest"),
    (np.minimum(900 * LIGHT, 3800).astype(np.uint16), 12, 3800, "pile up at 3800"),
    (LIGHT, None, None, "no raw counts"),
    (np.minimum(LIGHT, 4.0), None, 4.0, "no raw counts"),
])  # fmt: skip
def test_bits_and_saturation(counts, bits, saturation, told):
    found = read_measurement(counts, hot_pixels=False)
    assert (found.bit_depth, found.saturation) == (bits, saturation)
    assert found.saturated == (0.0 if saturation is None else (counts == saturation).mean())
    assert found.at_zero == (counts == 0).mean()
    if told is not None:
        assert told in found.explain()


def test_a_clear_share_of_saturated_pixels_is_doubted():
    found = read_measurement(np.minimum(900 * LIGHT, 2**11 - 1).astype(np.uint16), bit_depth=11)
    assert found.saturated == pytest.approx(np.exp(-2048 / 900), rel=0.15)
    assert any("saturated: bright" in line for line in found.doubts)


def test_dark_frames_flat_field_and_region_are_taken_off_exactly():
    rng = np.random.default_rng(1)
    level, gain = rng.integers(90, 110, LIGHT.shape), 2.0 ** rng.integers(-1, 2, LIGHT.shape)
    signal = np.rint(500 * LIGHT)
    flat = 400 * gain + level
    found = read_measurement(signal * gain + level, dark=np.stack([level - 1, level + 1]), flat=flat,
                             region=[8, 16, 40, 50], hot_pixels=False)  # fmt: skip
    assert np.allclose(found.light[0], (signal * gain.mean())[8:48, 16:66], rtol=1e-12)
    assert found.region == (8, 16, 40, 50)
    assert found.images is found.light


def test_pixels_without_sensitivity_or_number_are_filled_and_named():
    counts, flat = np.full((16, 16), 50.0), np.full((16, 16), 10.0)
    counts[3, 4], flat[9, 9] = np.nan, 0.0
    counts[9, 9] = 900.0
    found = read_measurement(counts, flat=flat, hot_pixels=False)
    assert np.argwhere(~found.good).tolist() == [[3, 4], [9, 9]]
    assert np.allclose(found.light, 50)
    assert any("1 pixel not finite" in line for line in found.doubts)


def test_hot_pixels_by_dark_frames():
    rng = np.random.default_rng(2)
    dark = rng.normal(100, 3, (4, 128, 128))
    hot = rng.choice(128 * 128, 30, replace=False)
    dark.reshape(4, -1)[:, hot] += 40  # 27 spreads of the mean of four
    found = read_measurement(300 * LIGHT + 100, dark=dark)
    assert sorted(np.flatnonzero(~found.good)) == sorted(hot)
    assert found.hot == 30


def test_a_dark_pixel_is_hot_from_eight_standard_deviations():
    """Of normal quantiles, whose median deviation is 0.6745 standard deviations; 1 % less or more would be seen."""
    dark = norm.ppf((np.arange(10_001) + 0.5) / 10_001).reshape(1, 73, 137) * 5.0 + 100
    dark[0, 0, :4] = 100 + 5 * np.array([-8.06, -7.94, 7.94, 8.06])
    assert np.argwhere(hot_in_dark(dark)).tolist() == [[0, 0], [0, 3]]


GRAINS = {1.5: 0.90, 3: 0.98, 6: 0.98}


@pytest.mark.parametrize("grain", GRAINS)
def test_hot_pixels_by_their_neighbours(grain):
    """30 pixels of ten means in each of ten frames. False alarms: at most 2 expected of 20 frames; 10 have 5e-5."""
    found = false = 0
    for seed in range(10):
        rng = np.random.default_rng(100 + seed)
        counts = rng.poisson(100 * speckle(grain, seed)).astype(float)
        false += hot_among_neighbours(counts).sum()
        at = rng.choice(counts.size, 30, replace=False)
        counts.flat[at] += 1000
        hot = hot_among_neighbours(counts)
        found += hot.flat[at].sum()
        false += hot.sum() - hot.flat[at].sum()
    assert false < 10
    assert found >= GRAINS[grain] * 300


def test_hot_pixels_are_not_looked_for_in_what_has_none():
    """Grains of one pixel have exponential intensities: what is 10 times as bright as the mean is nothing strange."""
    false = sum(hot_among_neighbours(np.random.default_rng(n).exponential(size=(128, 128))).sum() for n in range(20))
    assert false < 10  # at most 2 expected
    assert not hot_among_neighbours(np.ones((64, 64))).any()


def test_a_masked_hot_pixel_has_the_mean_of_its_neighbours():
    counts = np.random.default_rng(0).poisson(100.0, (4, 64, 64)).astype(float)
    counts[:, 20, 30] += 5000
    found = read_measurement(counts)
    assert np.argwhere(~found.good).tolist() == [[20, 30]]
    around = np.delete(counts[:, 19:22, 29:32].reshape(4, 9), 4, axis=1)
    assert np.allclose(found.light[:, 20, 30], around.mean(axis=1))


def test_the_lit_region_is_found():
    counts = np.random.default_rng(0).poisson(3.0, (120, 200)).astype(float)
    counts[31:91, 50:149] += np.random.default_rng(1).exponential(300, (60, 99))
    region = read_measurement(counts, region="find").region
    inner = (min(region.top + region.height, 91) - max(region.top, 31),
             min(region.left + region.width, 149) - max(region.left, 50))  # fmt: skip
    assert inner[0] * inner[1] > 0.8 * 60 * 99  # blocks are 4 pixels wide
    assert region.height * region.width - inner[0] * inner[1] < 0.05 * 60 * 99


@pytest.mark.parametrize("grain", [1, 2, 4])
def test_a_beam_is_recovered_within_its_stated_error(grain):
    """The squared error over the stated one is a mean of 5 squares about 1; its scatter over 20 frames gives the z."""
    truth, ratios, orders = beam(), [], []
    for seed in range(20):
        found = read_measurement(speckle(grain, seed) * truth, envelope="fit", hot_pixels=False)
        error = np.square(found.envelope / truth - 1).mean()
        ratios.append(error / found.envelope_error**2)
        orders.append(found.envelope_order)
    assert np.mean(np.array(orders) == 2) >= 0.9
    ratios = np.array(ratios)
    assert_z(ratios.mean(), 1.0, ratios.std(ddof=1) / np.sqrt(len(ratios)), degrees=19)


def test_an_error_stated_too_small_would_be_seen():
    """Blocks taken for independent where grains of 8 pixels are not: what the test above has to notice."""
    truth = beam()
    found = [read_measurement(speckle(8, seed) * truth, envelope="fit", hot_pixels=False) for seed in range(20)]
    error = np.sqrt(np.mean([np.square(each.envelope / truth - 1).mean() for each in found]))
    naive = np.sqrt(5 / (128 / 3) ** 2)  # five coefficients, contrast 1, blocks of 3 pixels
    stated = np.sqrt(np.mean([each.envelope_error**2 for each in found]))
    assert stated > 1.5 * naive
    assert 0.6 < error / stated < 1.6


@pytest.mark.parametrize("frames", [1, 6])
def test_even_light_is_found_to_be_even(frames):
    orders = []
    for seed in range(10):
        stack = np.stack([speckle(2, 1000 * seed + n) for n in range(frames)])
        found = read_measurement(stack, envelope="fit", hot_pixels=False)
        orders.append(found.envelope_order)
        # Its mean is 1 by definition: of k coefficients k - 1 may err.
        assert (found.envelope_error == 0) == (found.envelope_order == 0)
    assert orders.count(0) >= 9


def test_an_edge_asks_for_a_higher_order_and_frames_make_it_exact():
    y, x = np.mgrid[-1:1:128j, -1:1:128j]
    truth = np.exp(-(x**4) - 0.5 * y**3)
    stack = np.stack([speckle(2, n) * truth for n in range(30)])
    found = read_measurement(stack, envelope="fit", hot_pixels=False)
    assert found.envelope_order >= 4
    error = np.sqrt(np.square(found.envelope / truth * truth.mean() - 1).mean())
    assert error < 2 * found.envelope_error < 0.05
    assert np.allclose(found.images * found.envelope, found.light)


def test_a_given_envelope_is_divided_out():
    found = read_measurement(LIGHT * beam(), envelope=3 * beam(), region=(8, 8, 100, 90), hot_pixels=False)
    kept = beam()[8:108, 8:98]
    assert np.allclose(found.images[0], LIGHT[8:108, 8:98] * kept.mean())
    assert found.envelope.mean() == pytest.approx(1)
    assert "envelope: as given" in found.explain()


def test_a_black_level_far_below_all_counts_is_refused():
    """Light less -1e30 is even to the last bit."""
    frames = np.random.default_rng(0).exponential(size=(40, 40))
    assert read_measurement(frames, dark=-3.0, envelope=None).light.std() > 0.5
    with pytest.raises(RuleError, match=r"dark must be a level near the counts"):
        read_measurement(frames, dark=-(10.0**30), envelope=None)
