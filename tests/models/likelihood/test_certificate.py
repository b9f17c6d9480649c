"""The certificate against the law that its data are drawn from."""

import numpy as np
import pytest
import torch

from specklegen.models.likelihood.certificate import Certificate


def data(count=20000, seed=0):
    rng = np.random.default_rng(seed)
    evidence = rng.normal((1.0, -2.0, 0.0), (2.0, 0.5, 1.0), (count, 3))
    probability = 1 / (1 + np.exp(-(1.5 * (evidence[:, 0] - 1) / 2 - 0.8 * (evidence[:, 1] + 2) / 0.5 + 0.3)))
    return evidence, rng.random(count) < probability, probability


def test_probabilities_are_those_of_the_law():
    evidence, success, exact = data()
    found = Certificate.fitted(evidence, success)(torch.from_numpy(evidence)).numpy()
    # Four numbers from 20 000 samples: the root mean square error of p is about sqrt(4 / 20 000) / 2.
    assert np.sqrt(np.square(found - exact).mean()) < 3 * np.sqrt(4 / 20000) / 2


def test_coverage():
    """Of fresh samples, as many succeed as was said, in every tenth of the certificate."""
    made = Certificate.fitted(*data()[:2])
    evidence, success, _ = data(seed=1)
    said = made(torch.from_numpy(evidence)).numpy()
    for part in np.array_split(np.argsort(said), 10):
        spread = np.sqrt(said[part].mean() * (1 - said[part].mean()) / len(part))
        assert abs(success[part].mean() - said[part].mean()) < 5 * spread + 0.005


def test_stored_numbers_come_back_and_others_are_refused():
    made = Certificate.fitted(*data(200)[:2])
    assert Certificate.of(made._asdict()) == made
    with pytest.raises(ValueError, match="one length"):
        Certificate.of(made._asdict() | {"weights": [1.0]})
