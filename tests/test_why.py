"""What scripts/figures/why.py trains networks on, by closed forms and by waves, and how it counts."""

from itertools import islice

import numpy as np
import pytest
from scenes import of_the_figures
from zscore import assert_mean, assert_z, refute_mean

from specklegen.theory.speckle_contrast import exponential_contrast_squared


@pytest.fixture(scope="module")
def why():
    return of_the_figures("why")


@pytest.fixture(scope="module")
def images():
    return of_the_figures("_why")


@pytest.fixture(scope="module")
def motion():
    return of_the_figures("_why_motion")


def covariance(patterns, along):
    """<I(x) I(x + along)> / <I>^2 - 1 of each pattern, about the mean of all, which is known to be even."""
    moved = patterns / patterns.mean()
    return (moved[:, :, : moved.shape[2] - along] * moved[:, :, along:]).mean((1, 2)) - 1


def test_patterns_have_the_grain_of_a_square_window(images):
    patterns = images.pattern(np.random.default_rng(1), 100)
    for along in (0, 1, 2, 3):
        assert_mean(covariance(patterns, along), np.sinc(along / 2) ** 2)
    refute_mean(covariance(patterns, 1), np.sinc(1 / 2.2) ** 2)


@pytest.mark.parametrize("kind", ["fresh", "one"])
def test_convolution_moves_a_pattern_with_every_point(images, monkeypatch, kind):
    points = np.zeros(images.FIELD, np.float32)
    points[[3, 20]] = 1.0, 0.5
    drawn = images.pattern(np.random.default_rng(3))
    monkeypatch.setattr(images, "pattern", lambda rng, number=1: drawn)
    monkeypatch.setattr(images, "row", lambda rng, diameter: points)
    image, _ = next(images.by_convolution(kind, 4))
    np.testing.assert_allclose(image, drawn[0, :, 3:67] + 0.5 * drawn[0, :, 20:84], rtol=1e-5)


def test_who_forgets_and_who_does_not(images, monkeypatch):
    """Two points twelve bins apart: C_I is 1 by convolution, and 0 of independent patterns; a peak of 1/2, and none."""
    points = np.zeros(images.FIELD, np.float32)
    points[[5, 17]] = 1.0
    monkeypatch.setattr(images, "row", lambda rng, diameter: points)
    for kind, peak in (("fresh", 0.5), ("independent", 0.0)):
        found = [images.lags(image)[11] for image, _ in islice(images.by_convolution(kind, 5), 60)]
        assert_mean(np.array(found), peak, slack=0.02)  # the smooth brightness is taken off


def test_stacks_by_a_curve_forget_by_it(images):
    stacks = list(islice(images.stacks_by_a_curve(6), 60))
    shown = np.array([images.registered(stack, 1)[1::3] for stack, _ in stacks])
    wide = 10 ** np.array([told[0] for _, told in stacks])
    asked = 2.0 ** -np.square(images.TILTS[1:] / wide[:, None])
    for errors in (shown - asked).T:
        assert_mean(errors, 0.0, slack=0.02)
    other = 2.0 ** -np.square(images.TILTS[1:] / (1.2 * wide[:, None]))
    refute_mean((shown - other)[:, 2], 0.0, slack=0.02)
    apart = np.array([images.registered(stack, -1)[1::3] for stack, _ in stacks])  # the other way nothing overlaps
    assert np.abs(apart.mean(0)).max() < 0.05


def test_exposures_by_a_law_have_its_contrast(motion):
    """K^2 of the closed form; of 1024 grains the smooth brightness takes a little, and squares are not linear."""
    stacks = list(islice(motion.exposures_by_a_law(1), 150))
    times = 10 ** np.array([told[0] for _, told in stacks])

    def off(times):
        expected = exponential_contrast_squared(motion.EXPOSURES, times[:, None])
        return [motion.contrasts(stack) for stack, _ in stacks] - np.log10(expected)

    assert_mean(off(times), 0.0, slack=0.01)
    refute_mean(off(1.2 * times), 0.0, slack=0.01)


@pytest.mark.slow
def test_exposures_of_the_stream_have_the_contrast_that_they_tell(motion):
    stacks, told = zip(*motion.exposures_of_the_stream(3, 40), strict=True)
    seen, (light, particles) = np.array([motion.contrasts(x) for x in stacks]), np.array(told).T
    assert 1.2 < (light - particles).min() < (light - particles).max() < 3.0  # twenty to some hundred times slower
    slow = light > np.median(light)
    assert (seen[slow].mean(0) > seen[~slow].mean(0) + 0.02).all()


@pytest.mark.slow
def test_the_stream_has_the_contrast_of_waves(motion):
    """As many slabs as is quick, each beside the stream's mean at its own times, within a straight line of log10."""
    stacks, told = zip(*motion.exposures_of_the_stream(5, 300), strict=True)
    line = np.linalg.lstsq(basis(told), np.array([motion.contrasts(x) for x in stacks]), rcond=None)[0]
    waves = [motion.exposures_by_waves(seed) for seed in range(6)]
    off = np.array([motion.contrasts(x) for x, _ in waves]) - basis([told for _, told in waves]) @ line
    assert_mean(off[:, 1:], 0.0, slack=0.08)


def basis(told):
    time = np.array(told)[:, 0]
    return np.stack([time**n for n in range(5)], 1)


def test_networks_beside_each_other_learn_what_each_is_told(why, monkeypatch):
    monkeypatch.setattr(why, "WIDTH", 16)
    monkeypatch.setattr(why, "BATCH", 32)
    rng = np.random.default_rng(7)
    seen = rng.standard_normal((200, 3)).astype(np.float32)
    told = (seen[:, 0] > 0).astype(int)
    answers = why.trained([why.Images(seen, told), why.Images(seen, 1 - told)], 2, 300)(seen)
    assert (answers[0] == told).mean() > 0.9
    assert (answers[1] == 1 - told).mean() > 0.9
    numbers = np.stack([seen[:, 1], np.full(200, np.nan)], 1)
    guessed = why.trained([why.Images(seen, numbers)], 2, 300)(seen)[0]
    assert np.corrcoef(guessed[:, 0], numbers[:, 0])[0, 1] > 0.9
    assert np.isfinite(guessed).all()


def test_no_row_is_of_two_classes(images, tmp_path):
    """Draws of this seed are: a bead's end alone in the field."""
    images.keep_rows(tmp_path / "rows", 9, 300)
    rows = [{np.load(file).tobytes() for file in folder.glob("*.npy")} for folder in (tmp_path / "rows").iterdir()]
    assert len(rows) == 4
    assert len(set.union(*rows)) == sum(map(len, rows))
    rng, drawn = np.random.default_rng([9, 1]), []
    for diameter in images.DIAMETERS:
        drawn.append({images.row(rng, diameter).tobytes() for _ in range(300)})
    assert len(set.union(*drawn)) < sum(map(len, drawn))


@pytest.mark.slow
def test_the_stream_has_the_correlations_of_waves(images, tmp_path):
    """Sixteen media by waves and 400 images of the stream behind the thick slab; convolution is told from them. The
    slack is less than what the planner says of the sampler that is asked for: correlations off by .08."""
    images.keep_rows(tmp_path / "rows", 9, 300)
    stream = np.array([images.lags(x) for x, _ in images.of_the_stream(tmp_path / "rows", 240.0, 9, 400)])
    media = np.array([np.mean([images.lags(x) for x, _ in images.by_waves(240.0, n, 50)], 0) for n in range(16)])
    new = np.array([images.lags(x) for x, _ in islice(images.by_convolution("fresh", 9), 400)])

    def compare(found):
        error = np.hypot(found.std(0, ddof=1) / np.sqrt(len(found)), media.std(0, ddof=1) / np.sqrt(len(media)))
        assert_z(found.mean(0)[:24], media.mean(0)[:24], error[:24], degrees=15, slack=0.05)

    compare(stream)
    with pytest.raises(AssertionError, match="z ="):
        compare(new)
