"""Lengths of transforms: those of SciPy, as long as one may ask."""

import numpy as np
import pytest
import torch
from scipy.fft import next_fast_len

from specklegen.synthesis.sight import fast_length, lags_between


@pytest.mark.parametrize("real", [False, True])
def test_fast_lengths_are_those_of_scipy_at_any_size(real):
    """Lengths beyond 65 536 were cut to that, without a word: views of wide windows wrapped."""
    asked = np.unique(np.concatenate([
        np.arange(1, 300), [65_535, 65_536, 65_537, 10**6 + 3],
        np.exp(np.random.default_rng(0).uniform(np.log(300), np.log(2e9), 200)).astype(np.int64),
    ]))  # fmt: skip
    found = fast_length(torch.from_numpy(asked), real=real)
    assert found.tolist() == [next_fast_len(int(n), real) for n in asked]


def test_the_lags_of_a_long_row_of_cells_are_all_there():
    assert int(lags_between(torch.tensor(100_000))) >= 200_000
