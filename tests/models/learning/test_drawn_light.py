"""Images that the packaged solver learns from, under uneven light: their spectra against the likelihood's law."""

import sys

import numpy as np
import pytest
import torch
from scenes import ROOT, script_at
from zscore import assert_z, refute_z

from specklegen.models.likelihood.likelihood import Optics
from specklegen.models.likelihood.periodogram import Periodogram
from specklegen.models.likelihood.spectrum import autocorrelation_of
from specklegen.models.retrieval.edges import WIDTHS, tapered

COUNT = 24


@pytest.fixture(scope="module")
def training():
    """The script, whose neighbours it imports by their bare names."""
    folder = str(ROOT / "scripts" / "build")
    sys.path.insert(0, folder)
    try:
        return script_at("scripts/build/train_any_object.py")
    finally:
        sys.path.remove(folder)


def test_fields_have_the_spectrum_of_the_law(training):
    """Under every taper, of 24 fields of eight objects each, at FALSE_ALARM; 5 % more, or of the grain, are seen."""
    objects = torch.zeros(8, 20, 20)
    objects[:, 4:16, 5:14] = torch.rand(8, 12, 9, generator=torch.Generator().manual_seed(1))
    lags = autocorrelation_of(objects)
    dark = Periodogram(torch.ones(8, 128, 65), torch.zeros(8), 1.0, (128, 128))
    for grain, refuted in ((3.0, False), (3.15, True)):
        optics = Optics(torch.full((8,), 2.0), torch.full((8,), grain))
        law = training.Layout(dark, 20, Optics(torch.full((8,), 2.0), torch.full((8,), 3.0)))
        fields = training.Layout(dark, 20, optics).fields(lags, COUNT, np.random.default_rng(3))
        for likelihood, share in zip(law.tapers, WIDTHS, strict=True):
            power = torch.fft.rfft2(tapered(fields, share)).abs().square().mean(1) / 128**2
            rows = torch.arange(-(len(likelihood.down) // 2), len(likelihood.down) // 2 + 1)
            power = power[:, rows % 128][..., : len(likelihood.across)]
            ratio = torch.where(likelihood.used, power / likelihood.of_lags(lags), 0.0).double()
            mean = float(ratio.sum() / likelihood.used.sum())
            error = float((1 / likelihood.frequencies.sum() / COUNT) ** 0.5)
            (refute_z if refuted else assert_z)(mean, 1.0, error)
            refute_z(1.05 * mean, 1.0, error)
            if not refuted:
                edge, counted = float(ratio[..., 0].sum()), float(likelihood.used[..., 0].sum())  # a column by itself
                assert_z(edge / counted, 1.0, error * (float(likelihood.used.sum()) / counted) ** 0.5)

    shares = [*WIDTHS, *WIDTHS, *WIDTHS[1:]]
    found = law.under(torch.tensor(shares, dtype=torch.float64)).of_lags(lags)
    for n, share in enumerate(shares):
        torch.testing.assert_close(found[n], law.tapers[WIDTHS.index(share)].of_lags(lags)[n])


def test_envelopes_of_tiles_are_one_envelope(training):
    """Each is above 0 and of mean 1 over its tiles, and neighbouring tiles meet."""
    light = training.envelopes(np.random.default_rng(0), 4)
    assert light.shape == (training.BATCH, 4, training.CAMERA, training.CAMERA)
    assert light.min() > 0
    np.testing.assert_allclose(light.mean((1, 2, 3)), 1, atol=1e-5)
    left, right = light[:, 0, :, -1], light[:, 1, :, 0]
    np.testing.assert_allclose(left, right, rtol=0.1)
