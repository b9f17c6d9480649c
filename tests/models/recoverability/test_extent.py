"""How large an object is, read off the lags of one photograph: known objects, and mistakes that would be seen."""

import numpy as np
import pytest
from zscore import assert_mean

from specklegen.models.recoverability import extent
from specklegen.models.recoverability.photograph import _lags

SIDE, GRAIN = 112, 3.0
NEAR = 0.15  # of ln diameter, the mean of known objects
_DOWN, _ACROSS = np.indices((2 * SIDE, 2 * SIDE))
OBJECTS = {(18, "disc"): np.hypot(_DOWN - 60, _ACROSS - 60) < 9, (18, "square"): (_DOWN < 13) & (_ACROSS < 13),
           (36, "square"): (_DOWN < 25.5) & (_ACROSS < 25.5),
           (36, "points"): np.isin(_DOWN * 1000 + _ACROSS, [0, 36, 18_022, 11_014])}  # fmt: skip


def photograph(seed, object, noise):
    """A frame float64[1, n, n] of mean 1 of an object behind a thin medium, with white noise."""
    rng = np.random.default_rng([31, seed])
    f = np.fft.fftfreq(2 * SIDE)
    iris = np.maximum(np.abs(f[:, None]), np.abs(f)) < 0.5 / GRAIN
    light = np.abs(np.fft.ifft2(iris * (rng.normal(size=iris.shape) + 1j * rng.normal(size=iris.shape)))) ** 2
    seen = np.fft.ifft2(np.fft.fft2(light) * np.fft.fft2(object)).real[None, :SIDE, :SIDE]
    return seen / seen.mean() + noise * rng.normal(size=seen.shape)


@pytest.fixture(scope="module")
def shown():
    """Frames and lags by diameter, pixels, and noise, six of each."""
    found = []
    for (diameter, _), object in OBJECTS.items():
        for noise in (0.0, 0.3):
            frames = [photograph(seed, object, noise) for seed in range(6)]
            found.append((diameter, noise, [(frame, _lags(frame, noise**2)) for frame in frames]))
    return found


def off(shown):
    """ln of diameters found over true ones, float64[objects, 6]."""
    found = []
    for diameter, noise, each in shown:
        read = [extent.find_extent(lags, frame, frame.var() - noise**2).whole for frame, lags in each]
        found.append(np.log(np.array(read) / diameter))
    return np.array(found)


def test_diameters_of_known_objects(shown):
    errors = off(shown)
    assert abs(errors.mean()) < NEAR
    assert np.abs(np.median(errors, 1)).max() < 2 * NEAR


@pytest.mark.parametrize("mistake", [0.5, 2.0], ids=["half of the background", "a periodogram squared as it is"])
def test_a_wrong_background_would_be_seen(shown, mistake, monkeypatch):
    right = extent.background
    monkeypatch.setattr(extent, "background", lambda frames: mistake * right(frames))
    assert abs(off(shown).mean()) > 2 * NEAR


def test_lags_beyond_an_object_scatter_as_foretold():
    """By a tenth at most: the mean of the frame is taken off, and light is not Gaussian."""
    steps = np.arange(-SIDE // 2, SIDE // 2)
    far = np.hypot(steps[:, None], steps) > 50
    pairs = np.outer(SIDE - np.abs(steps), SIDE - np.abs(steps)) / SIDE**2
    ratios = []
    for seed in range(20):
        frame = photograph(seed, OBJECTS[36, "points"], 0.3)
        lags = _lags(frame, 0.09)[np.ix_(steps, steps)]
        ratios.append((np.square(lags) * pairs)[far].mean() / extent.background(frame))
    assert_mean(ratios, 1.0, slack=0.1)
    with pytest.raises(AssertionError):
        assert_mean(2 * np.array(ratios), 1.0, slack=0.1)


def farthest(seed, excess, reach=40.0):
    """Of lags drawn as independent Gaussian numbers over their scatter, of more variance up to a reach; and Stein's."""
    steps = np.arange(-90, 91)
    away = np.sort(np.hypot(steps[:, None], steps).ravel())
    away = away[away < 90]
    squares = np.random.default_rng([33, seed]).chisquare(1, away.size) * (1 + excess * (away < reach))
    total = np.concatenate([[0.0], np.cumsum(squares)])
    stein = away[np.argmax(total[1:] - 2 * np.arange(1, len(total)))]
    return extent._farthest(away, total, 0.5, 10**9), stein


def test_what_is_too_faint_lag_by_lag_is_seen_in_its_annulus():
    """Signal of .4 of the scatter: no lag is worth keeping, but annuli that end up to 1.6 times as far away hold it."""
    found, alone = np.median([farthest(seed, 0.4) for seed in range(20)], 0)
    assert 40 < found <= 40 * extent._ANNULUS
    assert alone < 10


def test_scatter_alone_has_no_annulus_with_signal():
    """Of 50 draws at most 6: that one of about ten independent annuli is above 3.5 errors has 1 in 50; alarm 1e-4."""
    assert sum(farthest(seed, 0.0)[0] > 0 for seed in range(50)) <= 6


def test_cells_of_lags_are_counted_by_the_spectrum():
    """Of white noise each lag is one; of a band of a quarter of all frequencies each cell has four."""
    white = 1 + 0.1 * np.random.default_rng(34).normal(size=(12, SIDE, SIDE))
    f = np.fft.fftfreq(SIDE)
    inside = (np.abs(f[:, None]) < 0.25) & (np.abs(f) < 0.25)
    band = 1 + np.fft.ifft2(np.fft.fft2(white - 1) * inside).real
    assert extent._cell(white) == pytest.approx(1.0, rel=0.05)
    assert extent._cell(band) == pytest.approx(SIDE**2 / inside.sum(), rel=0.05)


def test_noise_alone_has_no_extent():
    """And one grain is not taken for more than three."""
    for seed in range(12):
        frame = photograph(seed, OBJECTS[36, "points"] * 0 + (_DOWN + _ACROSS == 0), 0.3)
        assert extent.find_extent(_lags(frame, 0.09), frame, frame.var() - 0.09).seen < 4 * GRAIN
        noise = 1 + 0.3 * np.random.default_rng([32, seed]).normal(size=frame.shape)
        assert extent.find_extent(_lags(noise, 0.09), noise, 1e-6).seen < 2 * GRAIN
