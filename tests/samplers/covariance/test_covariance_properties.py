"""What every covariance must be: Hermitian, positive, reciprocal, sampled truly, the same on any number of threads."""

import numpy as np
import pytest
from scenes import flat_box, views
from volume_batches import BATCHES, assert_same, engine_batches
from zscore import assert_z

import specklegen as sg
from specklegen.core.statistics import jackknife
from specklegen.paths.tracer import volume_tracer
from specklegen.samplers.path_sums.direct import direct_field, path_phases

SCENE = flat_box([0.0, 4.0, 4.0], views([0, 4, 4, 120, 180]), scatterer=sg.HenyeyGreenstein(g=0.4), albedo=0.9)


@pytest.fixture(scope="module")
def found():
    return sg.covariance(SCENE, paths=1000, seed=1, reverse=True, threads=1)


def matrix(covariance):
    n = covariance.value.shape[0] * covariance.value.shape[1]
    return covariance.value.reshape(n, n)


def field(tracer, bank, reverse, seed=1, sample=0, threads=1):
    phases = path_phases(tracer, bank, seed, sample, reverse, threads)
    return direct_field(tracer.layout, bank, phases, threads=threads)


def test_blocks_and_pairs_are_parts_of_the_whole(found):
    """Equal to the rounding of sums in another order."""
    scale = np.abs(found.value).max()
    rows = {}
    for part, block in sg.covariance_blocks(SCENE, rows=4, paths=1000, seed=1, reverse=True):
        rows.update(zip(range(part.start, part.stop), block.value, strict=True))
    blocks = np.array([rows[n] for n in range(15)]).reshape(found.value.shape)
    np.testing.assert_allclose(blocks, found.value, rtol=0, atol=1e-13 * scale)
    for pairs in ([[0, 0, 1, 1], [2, 4, 0, 3], [1, 2, 1, 2]], [[2, 3, 0, 1]]):
        some = sg.covariance(SCENE, paths=1000, seed=1, reverse=True, pairs=pairs)
        np.testing.assert_allclose(some.value, found.value[tuple(np.transpose(pairs))], rtol=0, atol=1e-13 * scale)
        np.testing.assert_allclose(some.single + some.multiple, some.value, rtol=0, atol=1e-13 * scale)


def test_eigenvectors_reproduce_the_covariance(found):
    """A19, duplicated lights and views included: same speckle there."""
    fields = found.sample(64 * 40, seed=2).reshape(64, 40, 15)
    np.testing.assert_allclose(fields[..., 6], fields[..., 11], atol=1e-6)  # lights 1 and 2, view 1
    drawn = np.einsum("brp,brq->bpq", fields, fields.conj()) / 40
    assert_same(drawn, np.broadcast_to(matrix(found), drawn.shape))
    with pytest.raises(AssertionError, match="z ="):
        assert_same(drawn, np.broadcast_to(1.1 * matrix(found), drawn.shape))


def test_a_realization_does_not_depend_on_how_many_are_drawn(found):
    np.testing.assert_array_equal(found.sample(5, seed=3)[:2], found.sample(2, seed=3))


@pytest.mark.parametrize("reverse", [False, True])
def test_fields_have_the_covariance(reverse):
    """A03, A17: Algorithm 4 against Algorithm 3, with two unlike kinds of particle, entry by entry and in norm."""
    mixture = sg.Mixture(types=(sg.HenyeyGreenstein(g=0.9), sg.HenyeyGreenstein(g=-0.5)), fractions=(0.3, 0.7))
    scene = flat_box([0.0, 4.0], views([0, 4, 150, 180]), scatterer=mixture, half=5.0)
    tracer = volume_tracer(scene, reverse)
    per_batch = 8
    fields = np.array(
        [
            field(tracer, tracer.trace(5, 30, sample=r, threads=1), reverse, 5, r).ravel()
            for r in range(BATCHES * per_batch)
        ]
    ).reshape(BATCHES, per_batch, -1)
    drawn = np.einsum("brp,brq->bpq", fields, fields.conj()) / per_batch
    expected = engine_batches(scene, 200, reverse=reverse, seed=6)
    assert_same(drawn, expected)
    wrong = drawn * np.where(np.eye(8, dtype=bool), 1.0, 0.0)  # one phase a pixel: A04's intensities, no correlation
    with pytest.raises(AssertionError, match="z ="):
        assert_same(wrong, expected)
    c = expected.mean(axis=0)
    gap = np.linalg.norm(drawn.mean(axis=0) - c) / np.trace(c).real
    # A finite number of paths a field adds to the 1 / sqrt(n) of Gaussian statistics.
    assert gap <= 1.1 / np.sqrt(BATCHES * per_batch) * 3


def test_moving_the_medium_turns_phases():
    """u_iv gains e^(ik(i - v).t): path by path, for the paths themselves move along."""
    shift = np.array([3.25, -1.5])
    moved = SCENE.replace(
        medium=SCENE.medium.replace(lower=SCENE.medium.lower + shift, upper=SCENE.medium.upper + shift)
    )
    here, there = (matrix(sg.covariance(s, paths=300, seed=1, reverse=True)) for s in (SCENE, moved))
    turn = np.exp(2j * np.pi * ((SCENE.lights[:, None] - SCENE.views) @ shift)).ravel()
    scale = np.abs(here).max()
    np.testing.assert_allclose(there, turn[:, None] * here * turn.conj(), rtol=0, atol=1e-9 * scale)


@pytest.mark.parametrize("near", [False, True])
def test_reciprocity(near):
    """A19: sources and sensors change places; points one inside and one outside."""
    medium = sg.Box(lower=[-5, -5, -5], upper=[5, 5, 4], mean_free_path=6, albedo=0.8,
                    scatterer=sg.HenyeyGreenstein(g=0.5))  # fmt: skip
    a, b = np.array([0.6, 0.0, 0.8]), np.array([0.0, -0.6, 0.8])
    p = np.array([[1.0, 2.0, -1.0], [1.0, 2.5, -9.0]])
    there = sg.Scene(wavelength=1.0, medium=medium, illumination=sg.PlaneWaves(directions=[a, b]),
                     sensor=sg.NearField(points=p) if near else sg.FarField(directions=[a, -b]))  # fmt: skip
    back = there.replace(illumination=sg.PointSources(points=p) if near else sg.PlaneWaves(directions=[-a, b]),
                         sensor=sg.FarField(directions=[-a, -b]))  # fmt: skip
    first = engine_batches(there, 200, reverse=False)
    second = engine_batches(back, 200, reverse=False, seed=8)
    order = [0, 2, 1, 3]  # (light, view) -> (view, light)
    assert_same(first, second[:, order][:, :, order])
    with pytest.raises(AssertionError, match="z ="):
        assert_same(first, second)


@pytest.mark.parametrize("dimension", [2, 3])
def test_auto_leaves_out_what_does_not_matter(dimension):
    """Both sides of the gate: with and without reversed paths the same within noise and the tolerance, or kept."""
    middle = [[0.0]] * (dimension - 2)

    def scene(angle):
        direction = np.concatenate([[np.sin(angle)], *middle, [np.cos(angle)]])
        forward = np.concatenate([[0.0], *middle, [1.0]])
        return sg.Scene(
            wavelength=0.05,
            medium=sg.Box(lower=[-5] * dimension, upper=[5] * dimension, mean_free_path=5.0, scatterer=sg.Isotropic()),
            illumination=sg.PlaneWaves(directions=forward[None]), sensor=sg.FarField(directions=direction[None]),
        )  # fmt: skip

    assert sg.covariance(scene(np.pi), paths=1).reverse
    away = scene(2.5)
    assert not sg.covariance(away, paths=1).reverse
    without, with_them = (engine_batches(away, 200, reverse=reverse) for reverse in (False, True))
    gap, error = jackknife(np.concatenate([without.real, with_them.real], axis=1)[:, :, 0], lambda s: s[1] / s[0] - 1)
    assert_z(gap, 0.0, error, degrees=63, slack=0.02)
