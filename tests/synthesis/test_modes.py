"""Modes from discrete orthonormal polynomials, against the dense matrix of K and its eigenvalues."""

import numpy as np
import pytest
import torch

from specklegen.core.errors import RuleError
from specklegen.memory_effects.correlation import MemoryEffectCorrelation, estimate_correlation
from specklegen.scene.media import Slab
from specklegen.scene.scatterers import HenyeyGreenstein
from specklegen.synthesis import modes
from specklegen.synthesis.correlations import Tabulated
from specklegen.synthesis.modes import Lattice

K = estimate_correlation(Slab(thickness=1000.0, mean_free_path=100.0, albedo=1.0, scatterer=HenyeyGreenstein(g=0.9)),
                         20_000, 1, threads=1)  # fmt: skip
AXIS = np.zeros((1, 2))
TILTS = np.array([[0.0, 0.0], [1.3e-3, -0.4e-3], [2.6e-3, -0.8e-3]])
RANGE = K.half_range()


def lattice(shape, step, base):
    """Of one medium."""
    return Lattice(shape, torch.tensor([step], dtype=torch.float64), torch.tensor(np.array(base))[None])


def karhunen_loeve(kernel, beams, tolerance):
    """Modes of one medium, and their values float64[beams, R]."""
    (((_, found),),) = [modes.karhunen_loeve(Tabulated([kernel]), beams, tolerance)]
    return found, found.values(int(found.rank[0]))[0].numpy()


def coefficients(kernel, beams, degree):
    return modes.coefficients(modes.memory(Tabulated([kernel]), beams), beams, degree)[0]


def kept_power(found):
    """Sum of the squares of the kept columns, and that of each."""
    power = np.square(found.columns[0].numpy()).sum(axis=0)
    return power.sum(), power[: int(found.rank[0])]


def dense(kernel, beams):
    """K between all beams of a lattice, in the order (tilt, row, column); rows and columns fall as sines do."""
    y, x = np.meshgrid(*(-float(beams.step[0]) * np.arange(n) for n in beams.shape), indexing="ij")
    points = (beams.base[0].numpy()[:, None] + np.stack([x.ravel(), y.ravel()], axis=-1)).reshape(-1, 2)
    gap = points[:, None] - points
    return kernel(np.hypot(gap[..., 0], gap[..., 1]))


@pytest.mark.parametrize("count", [1, 2, 7, 28, 64])
def test_polynomials_are_orthonormal_and_span_all_of_their_degree(count):
    found = modes.polynomials(count, count - 1)
    assert found.shape == (count, count)
    np.testing.assert_allclose(found.T @ found, np.eye(count), atol=1e-13)
    powers = np.linspace(-1, 1, count)[:, None] ** np.arange(min(count, 6))
    outside = powers - found[:, : powers.shape[1]] @ (found[:, : powers.shape[1]].T @ powers)
    np.testing.assert_allclose(outside, 0, atol=1e-13)


@pytest.mark.parametrize(("shape", "base"), [((7, 6), AXIS), ((1, 9), AXIS), ((5, 4), TILTS), ((1, 1), TILTS)])
def test_coefficients_are_those_of_the_dense_matrix(shape, base):
    beams = lattice(shape, 4e-4, base)
    for degree in (2, 6, 20):
        values = modes.basis(beams.full, degree).numpy()
        np.testing.assert_allclose(values.T @ values, np.eye(values.shape[1]), atol=1e-12)
        expected = values.T @ dense(K, beams) @ values
        np.testing.assert_allclose(coefficients(K, beams, degree), expected, atol=1e-12 * beams.size)


BACK_AND_FORTH = np.array([[0.0, 0.0], [1.1e-3, -0.3e-3], [0.2e-3, 0.7e-3], [1.1e-3, -0.3e-3], [0.1e-3, 0.0]])
EVEN = np.array([0.31e-3, -0.17e-3]) + np.arange(6)[:, None] * np.array([0.4e-3, 0.1e-3])


@pytest.mark.parametrize(("base", "gaps"), [(EVEN, 6), (BACK_AND_FORTH, 8), (EVEN[::-1], 6)])
def test_every_gap_of_tilts_is_asked_once(base, gaps, monkeypatch):
    """K between all beams is the literal one, and K is asked for one block of each gap at most, whichever way it is."""
    shape, step, asked = (3, 4), 4e-4, []
    call = Tabulated.__call__
    monkeypatch.setattr(Tabulated, "__call__", lambda self, q: asked.append(q.shape) or call(self, q))
    found = modes.memory(Tabulated([K]), lattice(shape, step, base))[0].numpy()
    (lags,) = asked
    assert lags[1] <= gaps * 5 * 7  # of len(base)^2 blocks
    down, across = (step * np.arange(1 - n, n) for n in shape)
    gap = base[:, None] - base
    apart = np.hypot((gap[..., 1, None] - down)[..., :, None], (gap[..., 0, None] - across)[..., None, :])
    np.testing.assert_allclose(found, K(apart), atol=1e-12)
    assert np.abs(found.swapaxes(0, 1) - K(apart)).max() > 1e-3  # gaps the wrong way round are seen


@pytest.mark.parametrize("base", [AXIS, TILTS])
@pytest.mark.parametrize(("scale", "tolerance"), [(2e-4, 0.01), (8e-4, 0.01), (2e-4, 1e-4)])
def test_modes_reproduce_the_kernel(scale, tolerance, base):
    """To the tolerance in the sum over beams, and for each pair to its root."""
    beams = lattice((12, 9), scale, base)
    exact = dense(K, beams)
    found, values = karhunen_loeve(K, beams, tolerance)
    np.testing.assert_allclose(np.square(values).sum(axis=1), 1, rtol=1e-12)
    assert np.abs(values @ values.T - exact).mean() < tolerance
    assert np.abs(values @ values.T - exact).max() < 2 * np.sqrt(tolerance)
    total, powers = kept_power(found)
    left = beams.size - total
    assert -1e-9 * beams.size < left <= tolerance * beams.size
    assert left + powers.min() > tolerance * beams.size, "one mode fewer would not do"


@pytest.mark.slow
@pytest.mark.parametrize("extent", [0.25, 0.5, 1.0])
def test_hardly_more_modes_than_the_exact_expansion_needs(extent):
    """One more at most up to half a range, where the polynomials' order is that of the power; then a tenth."""
    beams = lattice((28, 28), extent * RANGE / 28, AXIS)
    _, values = karhunen_loeve(K, beams, 0.01)
    power = np.linalg.eigvalsh(dense(K, beams))[::-1]
    needed = int((beams.size - power.cumsum() > 0.01 * beams.size).sum()) + 1
    assert needed <= values.shape[1] <= max(needed + 1, 1.25 * needed)


@pytest.mark.parametrize("base", [AXIS, TILTS])
def test_no_degree_needs_fewer_polynomials_than_the_bound(base):
    """From every lower degree; of independent beams nearly all are needed."""
    for step in (2e-5, 4e-4, 2e-3, 1e4 * RANGE):
        beams = lattice((9, 7), step, base)
        found = [coefficients(K, beams, degree) for degree in range(sum(beams.full) - len(beams.full) + 1)]
        squares = modes.sum_of_squares(Tabulated([K]), beams)
        assert squares >= (1 - 1e-9) * np.square(dense(K, beams)).sum()
        for wanted in (0.9 * beams.size, 0.99 * beams.size):
            needed = next(len(matrix) for matrix in found if matrix.trace() >= wanted)
            bounds = [modes.fewest(matrix, squares, wanted) for matrix in found if len(matrix) < needed]
            assert max(bounds, default=0) <= needed
            assert len(base) > 1 or step < RANGE or bounds[0] > 0.85 * needed


def test_degrees_that_cannot_suffice_are_left_out_and_change_nothing(monkeypatch):
    """The same degree, to the bit the same modes, with less work."""
    beams = lattice((30, 30), 0.5 * RANGE, AXIS)
    tried = []
    made = modes.coefficients
    monkeypatch.setattr(modes, "coefficients", lambda *given: tried.append(given[2]) or made(*given))
    found, values = karhunen_loeve(K, beams, 0.01)
    quick, tried[:] = list(tried), []
    monkeypatch.setattr(modes, "fewest", lambda *given: 0.0)
    slow, others = karhunen_loeve(K, beams, 0.01)
    assert slow.degree == found.degree == tried[-1] == quick[-1]
    assert others.tobytes() == values.tobytes()
    assert len(quick) < len(tried)


def test_modes_beyond_memory_are_refused_before_they_are_made():
    """160 000 independent beams: a terabyte."""
    with pytest.raises(RuleError, match=r"held within .* GiB; got .* modes of 160000 beams.*smaller field of view"):
        karhunen_loeve(K, lattice((400, 400), 50 * RANGE, AXIS), 0.01)


def test_modes_do_not_depend_on_rounding():
    """Rows and columns of a square object have equal powers: an error of 1e-12 in K must not turn the modes."""
    rng = np.random.default_rng(0)

    class Rough(MemoryEffectCorrelation):
        def __call__(self, q):
            return super().__call__(q) * (1 + 1e-12 * rng.random(np.shape(q)))

    rough = Rough(K.radius, K.weights, K.paths, K.single_share)
    for tolerance in (0.3, 0.1, 0.03, 0.01, 1e-3):
        beams = lattice((11, 11), 2e-4, AXIS)
        (_, one), (_, two) = karhunen_loeve(K, beams, tolerance), karhunen_loeve(rough, beams, tolerance)
        np.testing.assert_allclose(one, two, atol=1e-6)


def test_columns_of_equal_power_stay_together():
    power = torch.tensor([5.0, 2.0, 2.0, 0.9], dtype=torch.float64)
    kept = [modes.kept(power, 10, tolerance).tolist() for tolerance in (0.6, 0.4, 0.2, 0.05)]
    assert kept == [[True, False, False, False], [True, True, True, False], [True, True, True, False], [True] * 4]
    batch = torch.stack([power, 0.01 * power])
    assert modes.kept(batch, 10, 0.4)[0].tolist() == [True, True, True, False]


def test_mixing_turns_the_modes_into_those_of_another_kernel():
    beams = lattice((8, 8), 2e-4, AXIS)
    found, values = karhunen_loeve(K, beams, 1e-4)
    wider = MemoryEffectCorrelation(0.7 * K.radius, K.weights, K.paths, K.single_share)
    root = values @ found.mixing(values.shape[1], Tabulated([wider]))[0].numpy()
    np.testing.assert_allclose(root @ root.T, dense(wider, beams), atol=0.02)


@pytest.mark.parametrize("base", [AXIS, TILTS])
def test_media_of_a_batch_have_the_modes_that_they_have_alone(base):
    """To the bit, whatever their companions: others of the first degree, and one that needs a higher one."""
    steps = [2e-4, 5e-2 * RANGE, 6.0 * RANGE, 1e-4]
    shape = (9, 8)
    together = Lattice(shape, torch.tensor(steps, dtype=torch.float64), torch.tensor(np.tile(base, (4, 1, 1))))
    found = modes.karhunen_loeve(Tabulated([K] * 4), together, 0.01)
    assert len({one.degree for _, one in found}) > 1
    for places, own in found:
        for n, place in enumerate(places):
            alone, _ = karhunen_loeve(K, lattice(shape, steps[place], base), 0.01)
            assert own.degree == alone.degree
            assert own.columns[n].numpy().tobytes() == alone.columns[0].numpy().tobytes()
