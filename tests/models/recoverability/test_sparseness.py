"""Sparseness of frequency bands: against the eigenvalues of speckle, false alarms at a stated rate, pictures caught."""

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter
from scipy.stats import binom

from specklegen.models import judge_photograph
from specklegen.models.recoverability.photograph import _EDGES, _REFUSED
from specklegen.models.recoverability.sparseness import CENTRES, band_excesses, sparseness

BOUND = np.sqrt(_REFUSED) / _EDGES
RATE = 0.01
"""Share of speckle that may be refused for edges alone."""
SIDE = 128


def speckle(rng, grain, points=1, side=SIDE, electrons=None):
    """Light float64[1, side, side] of mean 1 of points on a circular iris; counted if electrons are given."""
    f = np.fft.fftfreq(side + 48)
    inside = np.hypot(f[:, None], f) < 0.5 / grain
    waves = rng.normal(size=(2, *inside.shape))
    light = np.abs(np.fft.ifft2(inside * (waves[0] + 1j * waves[1]))) ** 2
    places = rng.integers(0, 40, (points, 2))
    seen = sum(light[y : y + side, x : x + side] for y, x in places)
    if electrons is not None:
        seen = rng.poisson(seen / seen.mean() * electrons)
    return (seen / seen.mean())[None]


def eigenvalue_excess(centre, grain, half=13):
    """6 tr (D G)^4 / (tr (D G)^2)^2: D the band's filter, G the waves' covariance, on (2 half + 1)^2 pixels."""
    f = np.fft.fftfreq(256)
    frequency = np.hypot(f[:, None], f)
    frequency[0, 0] = 1e-9
    at = np.arange(-half, half + 1)
    passed = np.fft.ifft2(np.exp(-(np.log(frequency / centre) ** 2) / (2 * 0.4**2))).real[np.ix_(at, at)]
    waves = np.fft.ifft2((np.hypot(f[:, None], f) < 0.5 / grain).astype(float)).real
    y, x = np.meshgrid(at, at, indexing="ij")
    away = [np.subtract.outer(each.ravel(), each.ravel()) for each in (y, x)]
    both = passed.ravel()[:, None] * waves[away[0], away[1]]
    square = both @ both
    return 6 * np.sum(square * square.T) / np.trace(square) ** 2


def discs(rng, side):
    """A drawn picture of forty discs, a little blurred, with noise."""
    y, x = np.mgrid[:side, :side]
    light = np.full((side, side), 60.0)
    for _ in range(40):
        r, at = rng.uniform(4, side / 3), rng.uniform(0, side, 2)
        light = np.where(np.hypot(x - at[0], y - at[1]) < r, rng.uniform(20, 230), light)
    return gaussian_filter(light, 1.0) + rng.normal(0, 2, light.shape)


def test_excess_of_one_points_speckle_is_that_of_its_eigenvalues():
    rng, grain = np.random.default_rng(1), 2.5
    found = []
    for _ in range(60):
        frame = speckle(rng, grain)
        found += [excess for centre, excess, _ in band_excesses(frame) if centre == CENTRES[1]]
    assert len(found) == 60
    expected = eigenvalue_excess(CENTRES[1], grain)
    error = np.std(found, ddof=1) / np.sqrt(len(found))
    assert abs(np.mean(found) - expected) < 4 * error  # 6e-5 of right programs fail
    assert abs(np.mean(found) - 1.2 * expected) > 4 * error  # a fifth more is told
    assert eigenvalue_excess(CENTRES[1], grain) < 6


def test_speckle_is_refused_for_edges_at_less_than_the_stated_rate():
    rng = np.random.default_rng(2)
    draws = [(rng.uniform(2.2, 6), int(np.exp(rng.uniform(0, 4))), np.exp(rng.uniform(3, 8))) for _ in range(120)]
    found = []
    for grain, points, electrons in draws:
        found.append(sparseness(speckle(rng, grain, points, electrons=electrons), grain, 1 / electrons))
    above = int(np.sum(np.array(found) >= BOUND))
    assert binom.sf(above - 1, len(draws), RATE) > 1e-3, above


def test_drawn_pictures_are_caught():
    rng = np.random.default_rng(3)
    pictures = [discs(rng, int(side)) for side in rng.uniform(96, 288, 20)]
    found = [sparseness((each / each.mean())[None], 3.0, 1e-4) for each in pictures]
    missed = int(np.sum(np.array(found) < BOUND))
    assert binom.sf(missed - 1, len(found), 0.05) > 1e-3, np.sort(found)
    few = judge_photograph(np.rint(pictures[0].clip(0)))
    assert few.answer == "no speckle"
    assert few.evidence["edges"] ** 2 > _REFUSED
    assert few.score > few.evidence["edges"] ** 2 - 1e-9


def test_light_that_is_added_changes_nothing():
    frame = speckle(np.random.default_rng(4), 3.0, 4)
    dim = 1 + 0.2 * (frame - 1)
    assert sparseness(dim, 3.0, 0.04e-6) == pytest.approx(sparseness(frame, 3.0, 1e-6), rel=1e-6)


def test_contrast_that_falls_across_a_frame_is_taken_off():
    """Of stray light: without the levelling its excess is more by half and more."""
    frame = speckle(np.random.default_rng(5), 2.5, 30, side=192) - 1
    slope = np.exp(np.linspace(0, 2.5, 192))
    even, slanted = (dict((c, e) for c, e, _ in band_excesses(1 + 0.05 * each)) for each in (frame, frame * slope))
    left = abs(slanted[CENTRES[1]] - even[CENTRES[1]])
    raw = (frame * slope).ravel()
    assert left < 0.35
    assert np.mean(raw**4) / np.mean(raw**2) ** 2 - np.mean(frame**4) / np.mean(frame**2) ** 2 > 1


def test_noise_that_was_blurred_is_as_gaussian_as_speckle_of_many_points():
    """It is not told, and cannot be by this: the excess is 0 within its scatter."""
    rng, found = np.random.default_rng(6), []
    for _ in range(40):
        texture = gaussian_filter(rng.normal(size=(SIDE + 40, SIDE + 40)), 1.2)[20:-20, 20:-20]
        found += [excess for centre, excess, _ in band_excesses(1 + texture[None]) if centre == CENTRES[2]]
    assert abs(np.mean(found)) < 4 * np.std(found, ddof=1) / np.sqrt(len(found))
