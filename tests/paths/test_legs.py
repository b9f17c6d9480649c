"""Paths through layers that refract, aimed at views: against slabs behind faces, a literal walk, and turned round."""

import numpy as np
import pytest
from references.layered_walk import BATCHES, walk_layers
from zscore import assert_z

import specklegen as sg
from specklegen.core.statistics import jackknife
from specklegen.kernels import legs as columns
from specklegen.memory_effects import curve
from specklegen.paths import legs
from specklegen.paths.endpoint_factors import contributions, multiple_amplitudes
from specklegen.paths.steps import optics, straight_light
from specklegen.paths.tracer import plane_tracer
from specklegen.scene.layers import merged

AXIS = np.array([0.0, 0.0, 1.0])
UPPER = sg.Layer(thickness=1.0, mean_free_path=0.5, scatterer=sg.HenyeyGreenstein(0.6), index=1.5)
LOWER = sg.Layer(thickness=1.0, mean_free_path=0.4, albedo=0.95, scatterer=sg.Isotropic(), index=1.2)
TWO = sg.Layers([UPPER, LOWER])
SLAB = sg.Slab(thickness=2.0, mean_free_path=0.5, albedo=0.95, scatterer=sg.HenyeyGreenstein(0.6),
               faces=sg.Faces(inside=1.5))  # fmt: skip
CLEAR = sg.Layer(thickness=1.0, mean_free_path=1e9, scatterer=sg.Isotropic(), index=1.0)
INSIDE = sg.Layer(thickness=2.0, mean_free_path=0.5, albedo=0.95, scatterer=SLAB.scatterer, index=1.5)
BETWEEN = sg.Layers([CLEAR, INSIDE, CLEAR])
"""The slab again: behind layers of air, whose faces are inner ones."""


def at(sine, side=1.0, azimuth=0.0):
    return np.array([sine * np.cos(azimuth), sine * np.sin(azimuth), side * np.sqrt(1 - sine**2)])


def intensity(medium, light, view, *, paths=6000, seed=1, reverse=False):
    """Per unit area and steradian in the index ``faces.inside``, of multiple and of all scattering, with errors."""
    tracer = plane_tracer(medium, 0.01, light[None], view[None], reverse)
    bank = tracer.trace(seed, paths, threads=1)
    power = contributions(tracer.layout, bank)
    each = np.stack([np.bincount(bank.paths, w * power, paths) for w in (bank.orders > 1, np.ones(len(bank)))])
    return each.mean(axis=1), each.std(axis=1) / np.sqrt(paths)


def assert_alike(one, other, factor=1.0):
    assert_z(factor * one[0], other[0], np.hypot(factor * one[1], other[1]))


def in_air(direction):
    """The direction outside of light that has this one in index 1.5."""
    x, y = 1.5 * direction[:2]
    return np.array([x, y, np.copysign(np.sqrt(1 - x * x - y * y), direction[2])])


@pytest.mark.parametrize(("side", "sines"), [(1.0, (0.0, 0.3)), (1.0, (0.4, 0.2)), (-1.0, (0.1, 0.5))])
def test_layers_of_air_around_a_slab_leave_it_as_it_is(side, sines):
    """Their steps are its faces. Outside, a solid angle is 1.5^2 cos / cos times as large."""
    light, view = at(sines[0]), at(sines[1], side, 1.0)
    out = in_air(light), in_air(view)
    found = intensity(BETWEEN, *out, seed=2)
    assert_alike(found, intensity(SLAB, light, view), 1.5**2 * view[2] / out[1][2])


def test_faces_that_reflect_nothing_are_caught(monkeypatch):
    light, view = at(0.4), at(0.2)
    slab = intensity(SLAB, light, view, paths=20_000)
    legs._legs_of.cache_clear()
    monkeypatch.setattr(legs._Optic, "back", lambda optic, face: np.zeros(optic.there.shape[1]))
    found = intensity(BETWEEN, in_air(light), in_air(view), paths=40_000, seed=2)
    legs._legs_of.cache_clear()
    with pytest.raises(AssertionError, match="z ="):
        assert_alike(found, slab, 1.5**2 * view[2] / in_air(view)[2])


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_light_that_goes_back_is_as_bright(side):
    """Lights and views exchanged, layers turned over where they are crossed: |u|^2 over the view's cosine stays."""
    light, view, mirror = at(0.5), at(0.8, side, 2.0), np.array([1.0, 1.0, -side])
    turned = sg.Layers(TWO.layers[:: -int(side)])
    forth = intensity(TWO, light, view, paths=12_000)
    back = intensity(turned, -view * mirror, -light * mirror, paths=12_000, seed=3)
    assert_alike(forth, back, light[2] / abs(view[2]))


@pytest.mark.parametrize("medium", [TWO, sg.Layers([UPPER, LOWER, UPPER.replace(index=1.0)])])
def test_pairs_along_the_axis_are_those_of_a_literal_walk(medium):
    q, wavelength, paths = np.array([0.3, 0.8, 2.0]), 0.005, 12_800
    tilts = np.arcsin(q * wavelength / (2 * np.pi))
    light = np.stack([np.sin(tilts), 0 * tilts, np.cos(tilts)], -1)
    found, squared, _, error, *_ = curve._exact(medium, wavelength, light, AXIS, light, 1.0, paths, 4, False, 1)
    known = zip(merged(medium.layers), optics(medium).indices, strict=True)
    layers = [(each.thickness, each.mean_free_path, each.albedo, each.scatterer.mean_cosine(), n) for each, n in known]
    sums = walk_layers(layers, paths=64 * 1000, seed=5).sums(q)
    literal, spread = jackknife(sums, lambda total: total[1:] / total[0])
    assert_z(found.real, literal, np.hypot(spread, error / (2 * np.abs(found))), degrees=BATCHES - 1)
    bright, each = intensity(medium, AXIS, AXIS, paths=paths)
    batches = sums[:, 0] / 1000
    assert_z(bright[1], batches.mean(), np.hypot(each[1], batches.std(ddof=1) / 8), degrees=BATCHES - 1)


def test_legs_are_those_of_unscattered_light_and_of_its_echoes():
    """The brightest crosses all faces; of all together, what comes to a layer is the sum of the series."""
    found = legs._legs_of(TWO, False, 0.4)
    row = found.towards(at(-0.4, -1.0)[None], lights=True).rows[0]
    straight = straight_light(TWO, np.array([0.4]))
    known, slant = optics(TWO), np.sqrt(1 - (0.4 / 1.2) ** 2)
    direct = np.flatnonzero(found.layers == 1)[np.argmax(row[found.layers == 1, columns.AMOUNT])]
    thick = np.diff(known.edges)[1]
    through = (row[direct, columns.AMOUNT] * 1.2 * np.sqrt(slant)) ** 2 * np.exp(-known.depths[1] / slant)
    optic = legs._Optic(known, 1.0, np.array([0.4]))
    entered = (optic.through(0) * optic.through(1))[:, 0]  # of either polarisation
    assert through == pytest.approx(entered.mean() * np.exp(-straight.depth[0]), rel=1e-12)
    assert straight.let_through[0] == pytest.approx((entered * optic.through(2)[:, 0]).mean(), rel=1e-12)
    assert row[direct, columns.ASIDE] + thick * row[direct, columns.SLOPE] == pytest.approx(
        -0.4 * straight.slope[0], rel=1e-12
    )


def test_reversed_paths_double_the_light_that_goes_back():
    """Twice the multiple scattering in exact backscattering, in two layers that differ by next to nothing."""
    light = at(0.3)
    tracer = plane_tracer(TWO, 0.01, light[None], -light[None], True)
    bank = tracer.trace(6, 6000, threads=1).multiple
    both, either = (
        np.square(np.abs(multiple_amplitudes(tracer.layout, bank, bidirectional=True, reverse=reverse)))
        for reverse in (True, False)
    )
    assert both.sum() == pytest.approx(2 * either.sum(), rel=1e-9)
    alone = intensity(TWO, light, -light, seed=7)
    weights = np.bincount(bank.paths, either.reshape(2, len(bank)).sum(axis=0), 6000)
    assert_z(weights.mean(), alone[0][0], np.hypot(weights.std() / np.sqrt(6000), alone[1][0]))


def test_too_many_ways_are_refused():
    layers = [UPPER.replace(thickness=0.01, mean_free_path=10.0, index=1.0 + n % 2) for n in range(40)]
    with pytest.raises(sg.RuleError, match=r"Layers.layers must be of index steps that reflect light along at most"):
        len(legs._legs_of(sg.Layers(layers), False, 0.0))
