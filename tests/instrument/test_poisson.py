import numpy as np
import pytest
from scipy.stats import chi2, poisson

from specklegen.core.random_streams import Stream, stream_key
from specklegen.instrument.camera import Camera, NoiseStreams, expose
from specklegen.instrument.poisson import LARGEST, add_poisson_field, table
from specklegen.kernels import quantiles

FALSE_ALARM = 1e-6  # chance that a right build fails, per test


def field(mean, count=200_000, words=(3,)):
    numbers = np.zeros(count)
    add_poisson_field(numbers, mean, stream_key(words, Stream.CAMERA))
    return numbers.astype(int)


@pytest.mark.parametrize("mean", [1e-3, 0.3, 5.0, 50.0, LARGEST])
def test_the_table_holds_the_exact_probabilities(mean):
    """And its guide starts each part at the first number that it can hold."""
    cumulative, guide = table(mean)
    exact = poisson.pmf(np.arange(1, len(cumulative) - 1), mean)
    np.testing.assert_allclose(np.diff(cumulative[:-1]), exact, atol=1e-14)
    assert poisson.sf(len(cumulative) - 2, mean) < 2.0**-53
    assert (np.diff(cumulative) >= 0).all()
    parts = np.arange(1, len(guide)) / len(guide)
    np.testing.assert_array_equal(guide, [0, *poisson.ppf(parts + 1e-12, mean)])


@pytest.mark.parametrize("mean", [1e-3, 0.3, 5.0, 50.0, LARGEST])
def test_a_table_gives_the_same_numbers_as_the_quantile(mean):
    """At the same uniform numbers; where the expansion is off, by its 1e-6, a few of 2e5."""
    numbers = np.zeros(200_000)
    quantiles.add_poisson(*stream_key((3,), Stream.CAMERA), np.full(200_000, mean), numbers)
    assert (numbers != field(mean)).sum() <= 3


def assert_poisson(numbers, mean):
    """Chi squared over the values that are expected at least 20 times, tails pooled."""
    low, high = int(poisson.ppf(1e-3, mean)), int(poisson.isf(1e-3, mean))
    # So that no more than some hundred bins are told apart, whatever the mean.
    edges = np.unique(np.linspace(low, high, min(high - low + 1, 128)).astype(int))
    counts = np.histogram(numbers, [*edges[:-1] - 0.5, edges[-1] - 0.5, np.inf])[0]
    counts[0] += (numbers < edges[0]).sum()
    above = poisson.sf(edges - 1, mean)
    above[0] = 1.0
    share = -np.diff(np.append(above, 0.0))
    statistic = (np.square(counts - numbers.size * share) / (numbers.size * share)).sum()
    assert statistic < chi2.isf(FALSE_ALARM, len(edges) - 1), f"chi2 = {statistic:.0f} of {len(edges) - 1}"


@pytest.mark.parametrize("mean", [0.3, 5.0, 50.0, 2 * LARGEST])
def test_numbers_are_poisson(mean):
    numbers = field(mean)
    assert_poisson(numbers, mean)
    with pytest.raises(AssertionError, match="chi2"):
        assert_poisson(numbers, 1.02 * mean + 0.005)


@pytest.mark.parametrize("decade", range(-1, 6))
def test_counted_photons_of_a_camera_are_poisson_over_six_decades(decade):
    """Mean 0.3 to 3e5, each on a flat field of 2e5 pixels; a mean 0.03 of the standard deviation off must be caught."""
    mean = 3.0 * 10.0**decade
    counts = expose(Camera(photons=mean, bit_depth=None), np.ones((400, 500)), NoiseStreams.of((9, decade + 1))).ravel()
    assert_poisson(counts.astype(np.float64), mean)
    with pytest.raises(AssertionError, match="chi2"):
        assert_poisson(counts, mean + 0.03 * np.sqrt(mean))


def test_a_longer_exposure_draws_the_same_numbers():
    """Pixel by pixel the count rises with the exposure, and the readout stays as it was."""
    image = np.random.default_rng(0).exponential(size=(64, 64))
    streams = NoiseStreams.of(4)
    camera = Camera(photons=3.0, background=2.0, dark_current=1.0, bit_depth=None)
    counts = [expose(camera.replace(photons=p, exposure=p / 3), image, streams) for p in (3.0, 3.01, 30.0, 300.0)]
    for fewer, more in zip(counts[:-1], counts[1:], strict=True):
        assert (more >= fewer).all()
    assert (counts[1] == counts[0]).mean() > 0.98, "0.3 % more light changes hardly a number"
    ranks = [np.argsort(np.argsort(c.ravel())) for c in (counts[2], counts[3])]
    assert np.corrcoef(ranks)[0, 1] > 0.9
    quiet = Camera(photons=1.0, bit_depth=None)
    for photons in (1.0, 500.0):
        noisy = expose(quiet.replace(photons=photons, read_noise=4.0), image, streams)
        np.testing.assert_allclose(
            noisy - expose(quiet.replace(photons=photons), image, streams),
            expose(quiet.replace(read_noise=4.0), image, streams) - expose(quiet, image, streams),
            atol=5e-4,  # float32 counts of some thousand
        )


def test_neighbours_are_independent():
    numbers = field(50.0, words=(4,)) - 50.0
    assert abs((numbers[1:] * numbers[:-1]).mean()) / 50 < 5 / np.sqrt(len(numbers))
