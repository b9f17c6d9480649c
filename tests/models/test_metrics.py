"""Alignment by brute force, scores by scikit-image, intervals by their coverage."""

import numpy as np
import pytest
import torch
from refusals import assert_refused
from scipy.stats import binom, norm
from skimage.metrics import peak_signal_noise_ratio, structural_similarity

from specklegen.models import metrics

RNG = np.random.default_rng(5)


def pictures(count=4, shape=(13, 16)):
    return torch.from_numpy(RNG.random((count, *shape)))


def brute_force(image, target):
    """Largest Pearson correlation over every cyclic shift of the image and of its flip, one by one."""
    best = -1.0
    for turned in (image, image[::-1, ::-1]):
        for y in range(image.shape[0]):
            for x in range(image.shape[1]):
                moved = np.roll(turned, (y, x), (0, 1))
                best = max(best, np.corrcoef(moved.ravel(), target.ravel())[0, 1])
    return best


def test_alignment_finds_the_best_of_all_motions():
    image, target = pictures(), pictures()
    found = metrics.pearson(metrics.align(image, target), target)
    slow = [brute_force(a, b) for a, b in zip(image.numpy(), target.numpy(), strict=True)]
    np.testing.assert_allclose(found, slow, rtol=1e-12)  # double-precision sums over 208 pixels


@pytest.mark.parametrize("shape", [(12, 12), (13, 16), (9, 7)])
@pytest.mark.parametrize("flip", [False, True])
def test_alignment_undoes_a_motion_to_the_bit(shape, flip):
    target = pictures(3, shape).float()
    moved = torch.roll(target.flip((-2, -1)) if flip else target, (4, -3), (-2, -1))
    assert torch.equal(metrics.align(moved, target), target)
    assert metrics.alignment(moved, target).flipped.tolist() == [flip] * 3


def test_alignment_takes_any_leading_shape():
    image, target = pictures(6), pictures(6)
    together = metrics.align(image.reshape(2, 3, 13, 16), target.reshape(2, 3, 13, 16))
    assert torch.equal(together.reshape(6, 13, 16), metrics.align(image, target))
    assert torch.equal(metrics.align(image[0], target[0]), metrics.align(image, target)[0])


def test_pearson_is_numpys():
    image, target = pictures(), pictures()
    expected = [np.corrcoef(a.ravel(), b.ravel())[0, 1] for a, b in zip(image.numpy(), target.numpy(), strict=True)]
    np.testing.assert_allclose(metrics.pearson(image, target), expected, rtol=1e-12)


def test_a_constant_image_tells_nothing():
    target = pictures(1)
    flat = torch.ones_like(target)
    found = metrics.scores(flat, target)
    assert found["pearson"].item() == 0
    assert all(torch.isfinite(score).all() for score in found.values())
    assert metrics.pearson(target, flat).item() == 0


def test_scores_forget_brightness_shift_and_flip():
    target = pictures(3)
    moved = torch.roll(target, (2, 5), (-2, -1)).flip((-2, -1)) * 7 - 3
    found = metrics.scores(moved, target)
    for name in ("pearson", "ssim", "jaccard"):
        np.testing.assert_allclose(found[name], 1, rtol=1e-9)  # rounding of the fit
    assert (found["psnr"] > 200).all()


def test_affine_fit_is_least_squares():
    image, target = pictures(1)[0], pictures(1)[0]
    image = image + 0.5 * target  # a positive slope
    columns = np.stack([image.ravel(), np.ones(image.numel())], axis=1)
    solution = np.linalg.lstsq(columns, target.ravel().numpy(), rcond=None)[0]
    np.testing.assert_allclose(metrics.affine_fit(image, target).ravel(), columns @ solution, rtol=1e-10)


def test_an_inverted_image_is_no_reconstruction():
    target = pictures(1)
    assert torch.allclose(metrics.affine_fit(-target, target), target.mean().expand_as(target))


def test_psnr_and_ssim_are_those_of_scikit_image():
    target = pictures(3, (20, 24))
    image = target + 0.1 * torch.from_numpy(RNG.standard_normal(target.shape))
    fitted = metrics.affine_fit(image, target).numpy()
    for n, truth in enumerate(target.numpy()):
        expected = peak_signal_noise_ratio(truth, fitted[n], data_range=1.0)
        assert metrics.psnr(image, target)[n].item() == pytest.approx(expected, rel=1e-12)
        expected = structural_similarity(truth, fitted[n], data_range=1.0, gaussian_weights=True, sigma=1.5,
                                         use_sample_covariance=False)  # fmt: skip
        # variances are differences of smoothed squares, in another order of sums
        assert metrics.ssim(image, target)[n].item() == pytest.approx(expected, rel=1e-9)


def test_jaccard_counts_pixels():
    target = torch.zeros(1, 4, 4)
    target[0, 0] = 1
    image = torch.zeros(1, 4, 4)
    image[0, 0, :2] = 1
    image[0, 1, :1] = 1
    # slope 1/2 of the fit leaves only pixels of the image's bright part above one half: 2 shared of 4 + 1
    fitted = metrics.affine_fit(image, target) > 0.5
    assert fitted.sum() == 3
    assert metrics.jaccard(image, target).item() == pytest.approx(2 / 5)
    assert metrics.jaccard(torch.zeros(1, 4, 4), torch.zeros(1, 4, 4)).item() == 1


def test_shapes_must_agree():
    assert_refused(lambda: metrics.align(torch.zeros(2, 4, 4), torch.zeros(2, 5, 5)), "of the target's shape")
    with pytest.raises(ValueError, match="at least 11 pixels"):
        metrics.structural_similarity(torch.zeros(1, 8, 8), torch.zeros(1, 8, 8))


def clustered(rng, media, images):
    """Scores of mean 0 whose spread is between the media, not within: as if there were one image a medium."""
    common = rng.standard_normal(media)
    which = np.repeat(np.arange(media), images)
    return common[which] + 0.1 * rng.standard_normal(which.size), which


def coverage(count, by_medium):
    rng = np.random.default_rng(11)
    inside = 0
    for trial in range(count):
        values, media = clustered(rng, 40, 8)
        units = media if by_medium else np.arange(values.size)
        found = metrics.bootstrap(values, units, confidence=0.9, resamples=400, seed=trial)
        inside += found.low <= 0 <= found.high
    return inside


def test_intervals_over_media_cover_the_truth():
    """Of 400 intervals at 90 %, within a two-sided binomial bound at 1e-6; 1.5 % is what a bootstrap of 40 lacks."""
    count = coverage(400, by_medium=True)
    assert binom.ppf(5e-7, 400, 0.9 - 0.015) <= count <= binom.ppf(1 - 5e-7, 400, 0.9)


def test_both_ends_leave_out_as_much():
    """Of values that lie evenly about 0: 5 % at either end, which 4.5 % would move by 2.7 %."""
    values = norm.ppf((np.arange(40) + 0.5) / 40)
    found = metrics.bootstrap(values, np.arange(40), confidence=0.9, resamples=100_000)
    reach = norm.isf(0.05) * values.std() / np.sqrt(40)
    np.testing.assert_allclose([-found.low, found.high], reach, rtol=0.02)


def test_intervals_over_images_do_not():
    """Power: to resample images as if they were independent must fail the bound above."""
    assert coverage(100, by_medium=False) < binom.ppf(5e-7, 100, 0.9 - 0.015)


def test_images_without_a_character_are_like_no_other():
    """Two labelled images among two hundred leave the interval of the media alone, to 15 % of its width. As one
    character together, the others would be drawn not at all, once or twice: the width would be a half more."""
    values, media = np.random.default_rng(4).normal(size=200), np.arange(200)
    few = np.full(200, -1)
    few[:2] = 0, 1
    alone, beside = (metrics.bootstrap(values, media, kinds) for kinds in (None, few))
    assert beside.high - beside.low == pytest.approx(alone.high - alone.low, rel=0.15)
    assert metrics.bootstrap(values, media, np.full(200, -1)) == alone


@pytest.mark.parametrize(("values", "media", "message"), [
    ([1.0, 2.0], [0, 0], "at least two"), ([1.0, np.nan], [0, 1], "finite"), ([1.0], [0, 1], "one for each"),
])  # fmt: skip
def test_bootstrap_refuses_what_it_cannot_judge(values, media, message):
    assert_refused(lambda: metrics.bootstrap(np.array(values), np.array(media)), message)


def test_intervals_over_characters_cover_where_those_over_media_do_not():
    """Ten characters, each a medium of its own to every image, with an effect of their own: 95 % intervals of the mean.
    300 tables. Resampling media alone covers the true mean in 62 %, both in 94 %. Bounds are five standard errors of a
    share (0.028, 0.014) away."""
    rng = np.random.default_rng(0)
    character = np.repeat(np.arange(10), 8)
    media = np.arange(80)
    covered = {"media": 0, "both": 0}
    for n in range(300):
        values = 0.8 + 0.05 * rng.standard_normal(10)[character] + 0.05 * rng.standard_normal(80)
        for name, kinds in (("media", None), ("both", character)):
            found = metrics.bootstrap(values, media, kinds, resamples=300, seed=n)
            covered[name] += found.low <= 0.8 <= found.high
    assert covered["both"] / 300 > 0.94 - 5 * 0.014
    assert covered["media"] / 300 < 0.62 + 5 * 0.028
