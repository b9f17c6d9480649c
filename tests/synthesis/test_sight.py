"""Lengths of transforms: those of SciPy, as long as one may ask."""

import numpy as np
import torch
from scipy.fft import next_fast_len

from specklegen.synthesis.sight import fast_length, lags_between


def test_fast_lengths_are_those_of_scipy_at_any_size():
    """Lengths beyond 65 536 were cut to that, without a word: views of wide windows wrapped."""
    asked = np.unique(np.concatenate([
        np.arange(1, 300), [65_535, 65_536, 65_537, 10**6 + 3],
        np.exp(np.random.default_rng(0).uniform(np.log(300), np.log(2e9), 200)).astype(np.int64),
    ]))  # fmt: skip
    found = fast_length(torch.from_numpy(asked))
    assert found.tolist() == [next_fast_len(int(n)) for n in asked]


def test_the_lags_of_any_row_of_cells_are_all_there():
    cells = torch.tensor([*range(1, 300), 100_000])
    found = lags_between(cells)
    assert (found >= 2 * cells).all()
    assert (found % 8 == 0).all()
    assert (found[:-1] <= 2.4 * cells[:-1] + 8).all()
    assert [int(lags_between(n)) for n in cells[:80]] == found[:80].tolist()
