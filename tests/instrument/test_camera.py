import numpy as np
import pytest
from refusals import assert_refused
from scipy.stats import binom, chi2, geom, norm, poisson

from specklegen.instrument.camera import Camera, NoiseStreams, depolarised, expose, incoherent_sum, pixel_means

FALSE_ALARM = 1e-6  # chance that a right build fails, shared by `comparisons`
SHAPE = (512, 512)
FLAT = np.ones(SHAPE)
STREAMS = NoiseStreams.of(1)


def assert_z(z, what, comparisons=1):
    limit = norm.isf(FALSE_ALARM / (2 * comparisons))
    assert abs(z) < limit, f"{what}: z = {z:+.2f}, limit {limit:.2f}"


def assert_moments(samples, mean, variance, fourth_cumulant, *, comparisons=1):
    """Mean and variance of independent samples by z-score; their errors follow from the exact cumulants."""
    samples = np.asarray(samples, dtype=np.float64)
    n = samples.size
    assert_z((samples.mean() - mean) / np.sqrt(variance / n), "mean", 2 * comparisons)
    spread = np.sqrt((fourth_cumulant + 2 * variance**2) / n)
    assert_z((np.square(samples - mean).mean() - variance) / spread, "variance", 2 * comparisons)


def exact_cumulants(camera, level):
    """Mean, variance, fourth cumulant of the counts of a flat field below saturation."""
    charge = camera.photons * level + camera.background + camera.dark_current * camera.exposure
    rounding = (1 / 12, -1 / 120) if camera.bit_depth else (0, 0)
    return (charge / camera.gain + camera.offset, (charge + camera.read_noise**2) / camera.gain**2 + rounding[0],
            charge / camera.gain**4 + rounding[1])  # fmt: skip


LEVELS = [0.0, 0.03, 0.3, 1.0, 3.0]
CAMERAS = {
    "shot": Camera(photons=100, bit_depth=None), "read": Camera(photons=100, read_noise=3, bit_depth=None),
    "background": Camera(photons=100, background=20, bit_depth=None),
    "dark": Camera(photons=100, dark_current=2, exposure=4, bit_depth=None),
    "gain": Camera(photons=100, gain=0.4, offset=10, bit_depth=None),
    "all": Camera(photons=300, background=5, dark_current=3, exposure=0.5, read_noise=2, gain=1.7, offset=50,
                  bit_depth=12),
}  # fmt: skip


@pytest.mark.parametrize("name", CAMERAS)
def test_photon_transfer(name):
    """Mean and variance at every light level, against the cumulants of Poisson, normal and rounding."""
    camera = CAMERAS[name]
    levels = [level for level in LEVELS if exact_cumulants(camera, level)[1] > 0]
    for n, level in enumerate(levels):
        counts = expose(camera, level * FLAT, NoiseStreams.of((7, n)))
        assert_moments(counts, *exact_cumulants(camera, level), comparisons=len(levels))


def test_stated_noise_is_that_of_the_photon_transfer_curve():
    """Variance over squared mean of the counts of a flat field, whose cumulants the test above measures."""
    for camera in CAMERAS.values():
        mean, variance, _ = exact_cumulants(camera, 1.0)
        assert camera.noise(mean) == pytest.approx(variance / mean**2, rel=1e-12)


@pytest.mark.parametrize(
    "wrong", [{"gain": 1.7 * 1.01}, {"read_noise": 2.7}, {"background": 5.3}, {"dark_current": 3.5}, {"photons": 300.5}]
)
def test_the_photon_transfer_test_has_power(wrong):
    """A 1 % error in the gain, and small ones elsewhere, must be caught at one of the levels."""
    right = CAMERAS["all"]

    def all_levels():
        for n, level in enumerate(LEVELS):
            counts = expose(right, level * FLAT, NoiseStreams.of((7, n)))
            assert_moments(counts, *exact_cumulants(right.replace(**wrong), level), comparisons=len(LEVELS))

    with pytest.raises(AssertionError, match="z ="):
        all_levels()


def test_read_noise_of_each_pixel():
    """Pixels have the draws of a camera of one read noise, times their own; moments of each column by z-score."""
    noise = np.tile(np.linspace(0.0, 12.0, 16), (512, 1))
    camera = Camera(photons=100, read_noise=noise, bit_depth=None)
    counts = expose(camera, np.ones((512, 16)), NoiseStreams.of(8))
    for column in range(16):
        assert_moments(counts[:, column], *exact_cumulants(camera.replace(read_noise=noise[0, column]), 1.0),
                       comparisons=16)  # fmt: skip
    with pytest.raises(AssertionError, match="z ="):  # a map that is upside down
        assert_moments(counts[:, 0], *exact_cumulants(camera.replace(read_noise=12.0), 1.0), comparisons=16)
    assert camera.noise(100.0) == pytest.approx((100 + np.square(noise).mean()) / 100**2)
    counting = camera.replace(bit_depth=12)
    for written in (Camera.from_toml(counting.to_toml()), Camera.from_json(counting.canonical_json())):
        assert written == counting
    assert_refused(lambda: expose(camera, np.ones((16, 512)), STREAMS), r"read_noise must be .* frames, \(16, 512\)")
    for wrong in (-noise, noise[0], np.nan * noise):
        assert_refused(lambda wrong=wrong: camera.replace(read_noise=wrong), r"Camera\.read_noise must be")


def photon_transfer_slope(gain):
    """Slope of variance on mean with its standard error, least squares weighted by the variances' errors."""
    camera = Camera(photons=1000, read_noise=5, gain=gain, offset=100)
    levels = np.linspace(0.1, 2, 8)
    flats = [expose(camera, level * FLAT, NoiseStreams.of((3, n))).astype(float) for n, level in enumerate(levels)]
    means, variances = np.mean(flats, axis=(1, 2)), np.var(flats, axis=(1, 2))
    weights = FLAT.size / (2 * variances**2)
    centred = means - np.average(means, weights=weights)
    norm_ = (weights * centred**2).sum()
    return (weights * centred * variances).sum() / norm_, 1 / np.sqrt(norm_)


def test_the_slope_of_the_photon_transfer_curve_is_one_over_the_gain():
    slope, error = photon_transfer_slope(gain=2.5)
    assert_z((slope - 1 / 2.5) / error, "slope")
    with pytest.raises(AssertionError, match="z ="):
        assert_z((slope - 1.01 / 2.5) / error, "slope")


def assert_distribution(values, probabilities):
    """Chi squared of values 0, 1, 2, ... against their probabilities, the tail in one bin."""
    observed = np.bincount(np.minimum(values, len(probabilities)), minlength=len(probabilities) + 1)
    expected = values.size * np.append(probabilities, 1 - probabilities.sum())
    assert expected.min() > 20
    statistic = (np.square(observed - expected) / expected).sum()
    assert statistic < chi2.isf(FALSE_ALARM, len(probabilities)), f"chi2 = {statistic:.1f}"


def test_counted_photons_of_speckle_are_geometric():
    """Poisson counts of an exponential intensity follow Bose and Einstein: m**k / (1 + m)**(k + 1)."""
    speckle = np.random.default_rng(0).exponential(size=SHAPE)
    counts = expose(Camera(photons=4), speckle, STREAMS).ravel()
    law = geom(1 / 5, loc=-1).pmf(np.arange(30))
    assert_distribution(counts, law)
    with pytest.raises(AssertionError, match="chi2"):
        assert_distribution(counts, geom(1 / 5.1, loc=-1).pmf(np.arange(30)))
    with pytest.raises(AssertionError, match="chi2"):
        assert_distribution(counts, poisson(4).pmf(np.arange(12)))


@pytest.mark.parametrize("terms", [1, 2, 3, 10])
def test_contrast_of_an_incoherent_sum_falls_as_one_over_root_n(terms):
    speckle = np.random.default_rng(terms).exponential(size=(terms, *SHAPE))
    assert_moments(incoherent_sum(speckle), 1, 1 / terms, 6 / terms**3)
    with pytest.raises(AssertionError, match="z ="):
        assert_moments(incoherent_sum(speckle), 1, 1.03 / terms, 6 / terms**3)


def test_contrast_of_a_weighted_sum():
    speckle = np.random.default_rng(0).exponential(size=(3, *SHAPE))
    shares = np.array([0.6, 0.3, 0.1])
    total = incoherent_sum(speckle, 7 * shares)
    assert_moments(total, 1, (shares**2).sum(), 6 * (shares**4).sum())


@pytest.mark.parametrize("degree", [0.0, 0.5, 1.0])
def test_contrast_of_depolarised_light(degree):
    one, other = np.random.default_rng(0).exponential(size=(2, *SHAPE))
    shares = np.array([1 + degree, 1 - degree]) / 2
    np.testing.assert_allclose(depolarised(one, other, degree), shares[0] * one + shares[1] * other, rtol=1e-12)
    assert_moments(depolarised(one, other, degree), 1, (1 + degree**2) / 2, 6 * (shares**4).sum())


def assert_share(hits, trials, probability):
    assert_z((hits - trials * probability) / binom(trials, probability).std(), "share")


def test_share_of_saturated_pixels():
    counts = expose(Camera(photons=240, bit_depth=8), FLAT, STREAMS)
    assert counts.max() == 255
    assert_share((counts == 255).sum(), counts.size, poisson(240).sf(254))
    with pytest.raises(AssertionError, match="z ="):
        assert_share((counts == 255).sum(), counts.size, poisson(240).sf(255))


def test_share_of_full_wells_and_read_noise_on_top_of_them():
    camera = Camera(photons=1000, full_well=1020, bit_depth=None)
    charge = expose(camera, FLAT, STREAMS)
    assert charge.max() == 1020
    assert_share((charge == 1020).sum(), charge.size, poisson(1000).sf(1019))
    full = expose(camera.replace(read_noise=4), 100 * FLAT, STREAMS)  # the readout stays noisy
    assert_moments(full, 1020, 16, 0)


def test_saturation_is_where_the_first_limit_is_met():
    assert Camera(photons=1, bit_depth=12, gain=2, offset=95).saturation == 8000
    assert Camera(photons=1, bit_depth=12, gain=2, full_well=5000).saturation == 5000
    assert Camera(photons=1, bit_depth=None).saturation == np.inf


def test_overexposed_and_dark_pixels_do_not_wrap_around():
    bright = expose(Camera(photons=1e9, bit_depth=16), FLAT[:4], STREAMS)
    assert (bright == 65535).all()
    dark = expose(Camera(photons=1, read_noise=3), 0 * FLAT, STREAMS)
    assert dark.max() < 30
    assert_share((dark == 0).sum(), dark.size, norm.cdf(0.5 / 3))


def test_each_noise_has_its_own_substream():
    """Adding one noise adds its own draws and moves no others."""
    bare = Camera(photons=50, bit_depth=None)
    image = np.random.default_rng(0).exponential(size=(64, 64))
    shot = expose(bare, image, STREAMS)
    dark = expose(bare.replace(dark_current=7), image, STREAMS) - shot
    background = expose(bare.replace(background=7), image, STREAMS) - shot
    read = expose(bare.replace(read_noise=2), image, STREAMS) - shot
    together = expose(bare.replace(dark_current=7, background=7, read_noise=2), image, STREAMS)
    np.testing.assert_allclose(together, shot + dark + background + read, atol=2e-4)  # float32
    np.testing.assert_allclose(  # another light level leaves the readout's draws as they were
        expose(bare.replace(photons=200, read_noise=2), image, STREAMS)
        - expose(bare.replace(photons=200), image, STREAMS),
        read,
        atol=2e-4,
    )
    noises = np.array([shot - 50 * image, dark - 7, background - 7, read]).reshape(4, -1)
    correlations = np.corrcoef(noises)[np.triu_indices(4, 1)]
    assert_z(np.arctanh(np.abs(correlations)).max() * np.sqrt(64 * 64 - 3), "correlation of two noises", 6)


@pytest.mark.parametrize("name", NoiseStreams._fields)
def test_another_substream_redraws_its_own_noise(name):
    camera = Camera(photons=50, dark_current=7, background=7, read_noise=2, bit_depth=None)
    other = STREAMS._replace(**{name: (1, 2, 3)})
    assert not np.array_equal(expose(camera, FLAT, STREAMS), expose(camera, FLAT, other))


def test_an_exposure_is_a_pure_function_and_leaves_its_image_alone():
    camera = CAMERAS["all"]
    image = np.random.default_rng(0).exponential(size=(32, 48)).astype(np.float32)
    before = image.copy()
    counts = expose(camera, image, STREAMS)
    np.testing.assert_array_equal(counts, expose(camera, image, STREAMS))
    np.testing.assert_array_equal(image, before)
    assert counts.dtype == np.uint16
    assert expose(camera.replace(bit_depth=None), image, STREAMS).dtype == np.float32


def test_pixels_average_over_their_points():
    image = np.random.default_rng(0).exponential(size=(2, 12, 18))
    means = pixel_means(image, 3)

    def block(n, row, column):
        return image[n, row : row + 3, column : column + 3]

    literal = [[[block(n, 3 * r, 3 * c).sum() / 9 for c in range(6)] for r in range(4)] for n in (0, 1)]
    np.testing.assert_allclose(means, literal, rtol=1e-14)
    # Photon noise is 1e-6 / sqrt(mean), below 4e-6 here; five of that.
    camera = Camera(photons=1e12, oversampling=3, bit_depth=None)
    np.testing.assert_allclose(expose(camera, image, STREAMS) / 1e12, means, rtol=2e-5)


@pytest.mark.parametrize(("call", "message"), [
    (lambda: Camera(photons=0), r"Camera\.photons must be greater than 0"),
    (lambda: Camera(photons=1, bit_depth=17), r"Camera\.bit_depth must be at most 16"),
    (lambda: Camera(photons=1, bit_depth=8, offset=255), r"Camera\.offset must be below the largest count"),
    (lambda: Camera(photons=1, gain=2.04).require_light(1), r"Camera\.photons must be enough for a count"),
    (lambda: expose(Camera(photons=1), -FLAT, STREAMS), "expose image must be finite and at least 0"),
    (lambda: expose(Camera(photons=1), FLAT[0], STREAMS), "expose image must be of shape"),
    (lambda: expose(Camera(photons=1, oversampling=3), FLAT, STREAMS),
     r"a multiple of the oversampling 3 along both sides; got \(512, 512\)"),
    (lambda: incoherent_sum([FLAT], [-1.0]), "weights must be finite, at least 0"),
    (lambda: incoherent_sum([FLAT], [1.0, 1.0]), r"weights must be of shape \(1,\)"),
    (lambda: incoherent_sum(FLAT), "images must be of shape"),
    (lambda: depolarised(FLAT, FLAT, 1.5), "degree must be from 0 to 1; got 1.5"),
    (lambda: depolarised(FLAT, FLAT[:5]), "images must be of one shape"),
    (lambda: NoiseStreams.of((1, 2**32)), "seed must be a whole number"),
])  # fmt: skip
def test_bad_input_names_field_rule_and_value(call, message):
    assert_refused(call, message)


def test_half_a_count_is_enough():
    Camera(photons=1, gain=1.96).require_light(1)
