"""Films of a surface: their contrast at each pixel, grains, and what two instants share."""

import numpy as np
import pytest
import torch
from scipy.special import j1
from zscore import assert_mean, refute_mean

from specklegen.datasets.recipes.exposure_stack import instant_lags, lag_weights
from specklegen.synthesis.surface import SurfaceFilm, padded

SHAPE, GRAIN, INSTANTS = (20, 24), 2.5, (1, 6)
RATE = np.array([0.0, 1.0, 40.0])  # of three kinds of place, two of which forget
CPU = torch.device("cpu")


@pytest.fixture(scope="module")
def film():
    """A stripe of places that forget at once between such that forget slowly and such that rest."""
    lags, between = instant_lags(INSTANTS, (0.001, 1.5))
    rows, columns, beside = padded(SHAPE, GRAIN)
    kind = np.digitize(np.arange(columns) - beside, [8, 16])[None].repeat(rows, 0)
    with np.errstate(invalid="ignore"):
        field = np.where(RATE[:, None] > 0, np.exp(-np.nan_to_num(RATE[:, None] * lags, posinf=np.inf)), 1.0)
    return SurfaceFilm(field, between, kind, SHAPE, GRAIN)


@pytest.fixture(scope="module")
def exposures(film):
    """Exposures float64[R, E, H, W] of 500 media."""
    drawn = torch.stack([film.images((7, n), CPU) for n in range(500)])
    return torch.stack([part.mean(1) for part in drawn.split(INSTANTS, 1)], 1).numpy().astype(np.float64)


def test_each_pixel_has_the_contrast_that_is_told(film, exposures):
    """Of 500 media, column by column; the map one grain aside, and that of a lag's half, are told."""
    assert_mean(exposures.mean(axis=(2, 3)), 1.0)
    told = film.contrast_squared(lag_weights(INSTANTS))
    np.testing.assert_allclose(told, told[:, :1].repeat(SHAPE[0], 1), atol=1e-12)
    found = np.square(exposures - 1).mean(axis=2)
    assert_mean(found, told[:, 0])
    assert told[1, 0].max() > 0.95
    assert told[1, 0].min() < 0.3
    for wrong in (np.roll(told[:, 0], 3, axis=-1), told[:, 0] ** 1.3):
        refute_mean(found, wrong)


def test_grains_are_those_of_a_round_pupil(exposures):
    """Covariance of pixels d apart [2 J1(z) / z]^2, z = pi d / grain, of places that rest; of a square pupil sinc^2."""
    still = exposures[:, 0, :, :6] - 1  # well away from the stripe
    apart = np.arange(1, 6)
    found = np.stack([(still[:, d:] * still[:, :-d]).mean(axis=(1, 2)) for d in apart], axis=-1)
    z = np.pi * apart / GRAIN
    assert_mean(found, np.square(2 * j1(z) / z), slack=0.01)  # a disc of few pixels of frequency
    refute_mean(found, np.square(np.sinc(apart / GRAIN)), slack=0.01)


def test_what_rests_is_alike_in_all_exposures(exposures):
    """Places that rest have the same image in both, others an independent one."""
    both = np.prod(exposures - 1, axis=1).mean(axis=1)
    assert_mean(both[:, 2], 1.0, slack=0.05)  # four grains from those that move
    assert_mean(both[:, [12, 22]], 0.0, slack=0.01)


def test_a_longer_film_keeps_its_frames(film):
    """Frames are of their own numbers, and roots are triangular."""
    short = SurfaceFilm(film.field, film.between[:4, :4], film.kind, SHAPE, GRAIN)
    one, other = (each.images((3,), CPU) for each in (short, film))
    torch.testing.assert_close(one, other[:4], rtol=1e-4, atol=1e-5)
