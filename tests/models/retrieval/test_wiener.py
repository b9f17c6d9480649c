"""Wiener's weights against their definition and against simulated lags, and whether to divide."""

import numpy as np
import pytest
import torch
from zscore import assert_z

from specklegen.core.errors import RuleError
from specklegen.datasets import load_recipe
from specklegen.datasets.objects import Glyphs, Points
from specklegen.models.likelihood.likelihood import Optics, SpeckleLikelihood, memory_effect_between
from specklegen.models.likelihood.periodogram import Periodogram
from specklegen.models.retrieval import wiener
from specklegen.models.retrieval.autocorrelation import distances

SIDE, GRAIN = 28, 3
LAGS = 64


def test_dense_weights_are_the_formula():
    rng = np.random.default_rng(0)
    lags = rng.random((1, 16, 16))
    length = distances(16)
    c = np.exp(-0.1 * length)
    variance, side, grain = 0.03, 6.0, 1.5
    beside = (length >= grain) & (length <= 2.5 * grain)
    level = (lags[0] * c)[beside].sum() / (c**2)[beside].sum()
    power = (level * np.maximum(1 - length / (1.25 * side), 0) ** 2) ** 2
    exact = c * power / (c**2 * power + variance)
    found = wiener.weights(torch.from_numpy(lags), torch.from_numpy(c), torch.tensor([variance]), side=side,
                           grain=torch.tensor([grain]))  # fmt: skip
    assert np.allclose(found[0], exact / exact[0, 0], rtol=1e-12)


def test_no_other_weights_leave_less_error():
    """Of lags C R + n, with R^2 as the dense guess has it: the weights before their scale against 10 % more or less."""
    rng = np.random.default_rng(1)
    length = torch.from_numpy(distances(16))
    c, variance = torch.exp(-0.15 * length), 0.02
    lags = torch.zeros(1, 16, 16, dtype=torch.float64) + 0.5 * c
    power = wiener.dense_power(lags, c, 8.0, torch.tensor([1.5]))[0]
    best = (c * power / (c.square() * power + variance)).numpy()
    signs = rng.choice([-1.0, 1.0], (4000, 16, 16)) * power.sqrt().numpy()  # any R with that R^2
    seen = c.numpy() * signs + np.sqrt(variance) * rng.standard_normal(signs.shape)

    def error(weights):
        return np.square(weights * seen - signs).sum((1, 2))

    for other in (0.9, 1.1):
        worse = error(other * best) - error(best)
        assert worse.mean() > 6 * worse.std() / np.sqrt(len(worse))


def test_variance_of_lags_is_bartletts():
    """Against the spread over many images of speckle, at lags beyond the grain."""
    period, side, count = 40 * GRAIN, 60, 600
    cells = period // GRAIN
    field = np.random.default_rng(2).standard_normal((count, cells, cells, 2)).view(np.complex128)[..., 0]
    images = np.square(np.abs(np.fft.fft2(field, (period, period))))[:, :side, :side]
    flat = images / images.mean((1, 2), keepdims=True) - 1
    lags = np.fft.irfft2(np.abs(np.fft.rfft2(flat)) ** 2, s=(side, side)) / side**2
    bartlett = np.square(lags).sum((1, 2)) / 2 / side**2  # squares of sampled lags are twice those of the true ones
    np.testing.assert_allclose(wiener.lag_variance(torch.from_numpy(images)), bartlett, rtol=1e-9)
    far = lags[:, 12:49:6, 12:49:6].reshape(count, -1)
    ratio = far.var(0, ddof=1).mean() / wiener.lag_variance(torch.from_numpy(images)).mean().item()
    # The variance of a variance is 2 / count, for 49 lags that are nearly independent; the edges wrap, the mean is
    # the image's own: 1/400 of the grains.
    assert_z(ratio, 1.0, np.sqrt(2 / count / 49), slack=0.06)


def drawn(family, ranges, camera=128, step=1.0, count=6):
    """Lags of objects drawn from the law of the likelihood, their variance, and C_I."""
    kernel = load_recipe("through-slab").material_of(0, "train", 0)
    pitch = ranges * kernel.half_range / SIDE / (2 * np.pi)  # of wavelength 1
    brightness = torch.from_numpy(np.stack([family.image(5, "train", n) for n in range(count)])).double()
    flat = Periodogram(torch.ones(count, camera, camera // 2 + 1, dtype=torch.float64), torch.zeros(count), 1.0,
                       (camera, camera))  # fmt: skip
    likelihood = SpeckleLikelihood(flat, (SIDE, SIDE), Optics(step, GRAIN))
    spectrum = likelihood.object_spectrum(
        brightness, memory_effect_between(kernel.correlation, 1.0, pitch, (SIDE, SIDE))
    )
    likelihood.power = spectrum * torch.from_numpy(np.random.default_rng(3).exponential(1.0, spectrum.shape))
    lags = likelihood.lags(LAGS)
    peak = lags[:, :1, :1]
    c_i = torch.from_numpy(np.square(kernel.correlation(2 * np.pi * pitch * distances(LAGS))))
    return lags / peak, likelihood.lag_variance() / peak[:, 0, 0].square(), c_i


@pytest.mark.parametrize(("family", "ranges", "camera", "wanted"), [
    (Glyphs(), 0.5, 128, "none"), (Glyphs(), 2.0, 128, "dense"), (Glyphs(), 3.0, 128, "dense"),
    (Glyphs(), 2.0, 480, "dense"), (Points(), 0.5, 128, "none"), (Points(), 2.0, 128, "empirical"),
    (Points(), 3.0, 128, "empirical"), (Points(), 2.0, 480, "floor"), (Points(count=12), 2.0, 480, "floor"),
])  # fmt: skip
def test_whether_to_divide(family, ranges, camera, wanted):
    """The best of the measured table (docs/notes/imaging.md), in at least five of six images."""
    lags, variance, c_i = drawn(family, ranges, camera)
    chosen = wiener.choice(lags, c_i, variance, side=SIDE, grain=torch.full((len(lags),), float(GRAIN)))
    assert chosen.count(wanted) >= 5


def test_empirical_weights_keep_what_stands_out():
    lags, variance, c_i = drawn(Points(count=2), 1.0, 480)
    found = wiener.weights(lags, c_i, variance, side=SIDE, grain=torch.full((len(lags),), float(GRAIN)),
                           guess="empirical")  # fmt: skip
    length = torch.from_numpy(distances(LAGS))
    far = length > 1.5 * SIDE  # no pair of points is so far apart
    assert found[:, far].mean() < 0.5
    assert torch.allclose(found[:, 0, 0], torch.ones(len(found), dtype=found.dtype))


def test_unknown_guess_is_refused():
    with pytest.raises(RuleError, match="wiener guess must be one of none, floor, dense, empirical"):
        wiener.weights(torch.ones(1, 8, 8), torch.ones(8, 8), torch.ones(1), side=3, grain=torch.ones(1), guess="x")  # type: ignore[arg-type]
