"""The autocorrelation estimator against the closed form of speckle, and against a direct sum over pixel pairs."""

from functools import cache

import numpy as np
import pytest
import torch
from zscore import assert_mean, refute_mean

from specklegen.core.errors import RuleError
from specklegen.memory_effects.correlation import MemoryEffectCorrelation
from specklegen.models.retrieval.apodisation import diffraction_limited, transfer_function
from specklegen.models.retrieval.autocorrelation import autocorrelation, lags, memory_effect_at_lags, ring, taper

WINDOW, SIDE, GRAIN = 16, 60, 3
IMAGES = 1500
PHOTONS = 4.0
KEPT = tuple((y, x) for y in (0, 1, 2, 4, 7) for x in (0, 1, 3, -5))


def speckle(count=IMAGES, seed=0):
    """Intensities float64[count, SIDE, SIDE] of mean 1: a square window of cells, of a period with no copy in sight."""
    period = 40 * GRAIN
    cells = period // GRAIN
    rng = np.random.default_rng(seed)
    field = rng.standard_normal((count, cells, cells, 2)).view(np.complex128)[..., 0] / np.sqrt(2) / cells
    return np.square(np.abs(np.fft.fft2(field, (period, period))))[:, :SIDE, :SIDE]


@cache
def patterns():
    """Speckle of all tests."""
    return speckle()


def exact():
    """Covariance |sum_x e^(2 pi i x s / period)|^2 / cells^2 of that window at every lag, less that in the ring."""
    period = 40 * GRAIN
    cells = period // GRAIN

    def axis(s):
        s = np.asarray(s, np.float64)
        return np.square(np.abs(np.exp(2j * np.pi * s[..., None] * np.arange(cells) / period).mean(-1)))

    inner, outer = ring(WINDOW)
    far = np.arange(-outer, outer + 1)
    reach = np.maximum(np.abs(far)[:, None], np.abs(far))
    background = (axis(far)[:, None] * axis(far))[(reach >= inner) & (reach <= outer)].mean()
    return axis(lags(WINDOW))[:, None] * axis(lags(WINDOW)) - background


def at(values):
    return np.stack([np.asarray(values)[..., y, x] for y, x in KEPT], axis=-1)


def measured(images, **options):
    return at(autocorrelation(torch.from_numpy(images)[:, None], WINDOW, **options))


GRAINS = (SIDE / GRAIN) ** 2
# The image's own mean stands for the true one. Dividing by its square scales all by 1 + O(1/grains); what
# subtracting it takes from every lag goes with the ring, but for edges: a share GRAIN/SIDE of 1/grains.
SLACK = 3 / GRAINS * np.abs(at(exact())) + 2 / GRAINS * GRAIN / SIDE


def test_autocorrelation_is_unbiased():
    assert_mean(measured(patterns()), at(exact()), slack=SLACK)


def test_photon_noise_is_subtracted():
    counts = np.random.default_rng(1).poisson(PHOTONS * patterns()).astype(float)
    counts += np.random.default_rng(2).normal(0, 1.5, counts.shape)
    assert_mean(measured(counts / PHOTONS, electrons=PHOTONS, read_noise=1.5), at(exact()), slack=SLACK)
    refute_mean(measured(counts / PHOTONS), at(exact()), slack=SLACK)


def test_the_test_has_power():
    """A lag count left out (the pairs at a lag over all pixels) must be caught."""
    y, x = np.array(KEPT).T
    share = (1 - np.abs(y) / SIDE) * (1 - np.abs(x) / SIDE)
    refute_mean(measured(patterns()) * share, at(exact()), slack=SLACK)


def test_autocorrelation_is_the_sum_over_pixel_pairs():
    image = patterns()[0] / patterns()[0].mean() - 1
    found = autocorrelation(torch.from_numpy(patterns()[:1]), WINDOW).numpy()

    def direct(dy, dx):
        y, x = slice(max(0, -dy), SIDE - max(0, dy)), slice(max(0, -dx), SIDE - max(0, dx))
        moved = image[y.start + dy : y.stop + dy, x.start + dx : x.stop + dx]
        return (image[y, x] * moved).mean()

    inner, outer = ring(WINDOW)
    every = range(-outer, outer + 1)
    background = np.mean([direct(y, x) for y in every for x in every if max(abs(y), abs(x)) >= inner])
    for y, x in KEPT:
        assert found[y, x] == pytest.approx(direct(y, x) - background, abs=1e-13)  # rounding of transforms


def test_noise_is_taken_off_the_zero_lag_alone():
    """Its variance over the squared mean: m / electrons and the square of the readout's."""
    images = torch.from_numpy(patterns()[:1])
    noise = 1 / (50 * images.mean()) + (1.5 / 50 / images.mean()) ** 2
    less = autocorrelation(images, WINDOW) - autocorrelation(images, WINDOW, electrons=50.0, read_noise=1.5)
    assert less[0, 0].item() == pytest.approx(noise.item(), rel=1e-9)
    assert less.abs().sum().item() == pytest.approx(noise.item(), rel=1e-9)


def test_frames_are_averaged():
    frames = torch.from_numpy(patterns()[:6]).reshape(2, 3, SIDE, SIDE)
    alone = torch.stack([autocorrelation(frame[:, None], WINDOW) for frame in frames.transpose(0, 1)])
    torch.testing.assert_close(autocorrelation(frames, WINDOW), alone.mean(0), rtol=1e-12, atol=1e-14)


def test_an_envelope_is_removed():
    """A beam that falls to 1/e a third of the frame from its middle: kept, it swamps the speckle."""
    r2 = np.square(np.arange(SIDE) - SIDE / 2)
    seen = patterns() * np.exp(-(r2[:, None] + r2) / (SIDE / 3) ** 2)
    removed, kept = (np.abs(measured(seen, sigma=s).mean(0) - at(exact())).max() for s in (SIDE / 4, None))
    # Measured 0.079 and 0.84 of the speckle's peak. A mean over so few grains has speckle of its own, and flattens
    # the beam: a bias of one over the grains in 4 pi sigma^2, which large cameras do not have.
    assert removed < 0.09
    assert kept > 0.5


def test_memory_effect_at_lags():
    kernel = MemoryEffectCorrelation(np.array([2.0]), np.ones((1, 1)), 1, 0.0)
    found = memory_effect_at_lags(kernel, 0.5, 0.01, WINDOW)
    assert float(found[0, 0]) == pytest.approx(1, abs=1e-15)  # the last bits of J0 at 0
    assert float(found[3, -4]) == pytest.approx(float(kernel(2 * np.pi / 0.5 * 0.05)) ** 2, rel=1e-12)


def test_taper_keeps_short_lags_and_drops_long_ones():
    kept = taper(WINDOW, 4, 7)
    assert (kept[0, :5] == 1).all()
    assert kept[0, 7] == 0
    assert kept[5, 5] == 0
    assert 0 < kept[0, 6] < kept[0, 5] < 1


@pytest.mark.parametrize("profile", ["square", "disc", "gaussian"])
def test_transfer_function_is_the_autocorrelation_of_the_window(profile):
    """By counting cells of a fine window: off by the staircase of its edge."""
    n, per_grain, fine = 24, 3.0, 40
    side = int(fine * (2.5 if profile == "gaussian" else 1))
    x = (np.arange(side) - (side - 1) / 2) / fine
    r2 = x[:, None] ** 2 + x**2
    power = {"square": np.ones_like(r2), "disc": (r2 <= 0.25) * 1.0, "gaussian": np.exp(-8 * r2)}[profile]
    pairs = np.fft.ifft2(np.abs(np.fft.fft2(power, (4 * side, 4 * side))) ** 2).real
    shifts = np.rint(np.fft.fftfreq(n) * per_grain * fine).astype(int)
    literal = np.where(np.maximum(np.abs(shifts)[:, None], np.abs(shifts)) < side,
                       pairs[shifts[:, None], shifts] / pairs[0, 0], 0)  # fmt: skip
    found = transfer_function(n, per_grain, profile).numpy()
    np.testing.assert_allclose(found, literal, atol={"square": 1e-12, "disc": 0.01, "gaussian": 2e-4}[profile])


def test_a_diffraction_limited_point_is_nowhere_negative():
    point = torch.zeros(1, 5, 5, dtype=torch.float64)
    point[0, 2, 2] = 1
    image = diffraction_limited(point, transfer_function(32, 3.0))
    assert image.min() > -1e-15
    assert image.sum() == pytest.approx(1, rel=1e-12)
    assert image.argmax() == 2 * 32 + 2


@pytest.mark.parametrize(("images", "window"), [(torch.ones(1, 20, 20), 15), (torch.ones(1, 9, 20), 16),
                                                (torch.zeros(1, 20, 20), 16), (torch.ones(20, 20), 16)])  # fmt: skip
def test_bad_images_are_refused(images, window):
    with pytest.raises(RuleError):
        autocorrelation(images, window)
