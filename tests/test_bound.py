"""What scripts/figures/bound.py makes of directions, and that its errors are those of what scores see."""

import sys

import numpy as np
import pytest
import torch
from scenes import ROOT

FIGURES = ROOT / "scripts" / "figures"


@pytest.fixture(scope="module")
def bound():
    sys.path.insert(0, str(FIGURES))
    try:
        import bound
    finally:
        sys.path.remove(str(FIGURES))
    return bound


def blob():
    rows, columns = np.indices((36, 36)) - 17.5
    return torch.from_numpy(np.exp(-(rows**2 + 2 * columns**2 + rows * columns) / 60)).float()


def test_directions_are_told_apart_from_what_scores_forget(bound):
    """Brightness, offset and small shifts; the rest of the span stays, orthonormal."""
    picture = blob()
    given = torch.from_numpy(np.random.default_rng(0).normal(size=(5, 36, 36))).float()
    found = bound.told_apart(torch.cat([given, picture[None], given[:1] + picture]), picture)
    flat = found.flatten(1)
    assert len(flat) == 5
    torch.testing.assert_close(flat @ flat.T, torch.eye(5, dtype=torch.float64))
    down, across = torch.gradient(picture.double())
    for forgotten in (picture.double(), torch.ones(36, 36, dtype=torch.float64), down, across):
        assert float((flat @ forgotten.flatten()).abs().max()) < 1e-6 * float(forgotten.norm())


@pytest.mark.slow
def test_the_tangent_of_the_prior_is_few_smooth_directions(bound):
    """Not what a picture may not do: noise of single pixels keeps less of itself there than it has by chance."""
    picture = blob()
    tangent = bound.tangent_of(picture).flatten(1)
    assert 5 < len(tangent) < 200
    torch.testing.assert_close(tangent @ tangent.T, torch.eye(len(tangent)), atol=1e-3, rtol=0)
    noise = torch.from_numpy(np.random.default_rng(1).normal(size=(50, 36 * 36))).float()
    rough = noise - torch.nn.functional.avg_pool2d(noise.unflatten(1, (1, 36, 36)), 3, 1, 1).flatten(1)
    kept = (rough @ tangent.T).square().sum(1).mean() / rough.square().sum(1).mean()
    assert float(kept) < len(tangent) / 36**2


@pytest.mark.slow
def test_the_figure_is_drawn(bound, tmp_path, capsys):
    bound.main(tmp_path, quick=True)
    assert (tmp_path / "bound.png").stat().st_size > 10_000
    table = capsys.readouterr().out.splitlines()
    assert len(table) == 4
    cells = [each.strip() for each in table[2].strip("|").split("|")]
    assert 0 < float(cells[3]) <= float(cells[4]) <= 1
