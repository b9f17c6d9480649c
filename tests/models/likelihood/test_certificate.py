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
    told = np.isfinite(found)
    # Of three Gaussian numbers, fitted to within 3.49 deviations, one is further out in .15 % of the samples.
    assert abs((~told).mean() - 0.00145) < 5 * np.sqrt(0.00145 / 20000)
    # Four numbers from 20 000 samples: the root mean square error of p is about sqrt(4 / 20 000) / 2.
    assert np.sqrt(np.square(found - exact)[told].mean()) < 3 * np.sqrt(4 / 20000) / 2


def test_coverage():
    """Of fresh samples, as many succeed as was said, in every tenth of the certificate."""
    made = Certificate.fitted(*data()[:2])
    evidence, success, _ = data(seed=1)
    said = made(torch.from_numpy(evidence)).numpy()
    told = np.isfinite(said)
    said, success = said[told], success[told]
    for part in np.array_split(np.argsort(said), 10):
        spread = np.sqrt(said[part].mean() * (1 - said[part].mean()) / len(part))
        assert abs(success[part].mean() - said[part].mean()) < 5 * spread + 0.005


def test_unlike_all_that_it_was_fitted_to_it_is_silent():
    """Also where the number that is far out says success; a number that does not count may be anything."""
    evidence, success, _ = data(2000)
    made = Certificate.fitted(evidence, success, chosen=(0, 1))
    asked = torch.tensor([[1.0, -2.0, 0.0], [30.0, -2.0, 0.0], [1.0, -9.0, 0.0], [1.0, -2.0, 99.0]])
    assert made(asked).isnan().tolist() == [False, True, True, False]
    assert made.unlike(asked).tolist() == [[False] * 3, [True, False, False], [False, True, False], [False] * 3]
    assert not made._replace(low=(), high=())(asked).isnan().any()
    assert made(torch.full((1, 3), float("nan"))).isnan().all()


def test_of_chosen_numbers_alone():
    evidence, success, _ = data(2000)
    made, same = Certificate.fitted(evidence, success, (0, 2)), Certificate.fitted(evidence[:, [0, 2]], success)
    assert made.weights[1] == 0
    told = made(torch.from_numpy(evidence)), same(torch.from_numpy(evidence[:, [0, 2]]))
    assert torch.allclose(*told, rtol=1e-12, equal_nan=True)


def test_stored_numbers_come_back_and_others_are_refused():
    made = Certificate.fitted(*data(200)[:2])
    assert Certificate.of(made._asdict()) == made
    with pytest.raises(ValueError, match="one length"):
        Certificate.of(made._asdict() | {"weights": [1.0]})
    with pytest.raises(ValueError, match="one length"):
        Certificate.of(made._asdict() | {"low": []})
    assert not Certificate.of({k: v for k, v in made._asdict().items() if k not in ("low", "high")}).low
