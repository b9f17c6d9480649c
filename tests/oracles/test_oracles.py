"""The engine against literal transcriptions of the papers, in absolute units; and the tests against small errors."""

from functools import cache

import numpy as np
import pytest
from references.electric_field import electric_field
from references.naive_covariance import naive_covariance
from references.naive_numba import naive_field
from volume_batches import by_batch, oracle_parts
from zscore import assert_z

import specklegen as sg
from specklegen.oracles import box_algorithms
from specklegen.paths.endpoint_factors import multiple_amplitudes, single_amplitudes
from specklegen.paths.tracer import slab_tracer
from specklegen.scene.illumination import directions_of_sines

BATCHES = 64
THICKNESS, WIDTH = 20.0, 120.0  # wavelength 1: speckle is 1/120 wide, a backscattering cone at OD 2 about 0.02
TILT = np.array([0.006, 0.001])  # of the second beam from the first
SHIFTS = np.array([(0.0, 0.0), (0.003, 0.001), TILT])  # of the views, so that C is neither 0 nor I
ENGINE_PATHS, TRANSCRIBED_PATHS = 8000, 2000  # a batch; either leaves 0.1 to 0.7 % in an intensity


def make_scene(side="transmission", *, g, optical_depth, albedo=0.9, base=0.0, offset=0.0):
    """Two tilts and three views: about the first tilt (transmission), or about its exact reverse (reflection)."""
    tilts = np.array([(base, 0.0), (base, 0.0) + TILT])
    sign = 1.0 if side == "transmission" else -1.0
    views = sign * (tilts[0] + SHIFTS) + (offset, 0.0)
    return sg.Scene(
        wavelength=1.0,
        medium=sg.Slab(thickness=THICKNESS, mean_free_path=THICKNESS / optical_depth, albedo=albedo,
                       scatterer=sg.HenyeyGreenstein(g=g)),
        illumination=sg.CollimatedBeams(directions=directions_of_sines("tilts", tilts), width=WIDTH),
        sensor=sg.FarField(directions=directions_of_sines("views", views, sign)),
    )  # fmt: skip


def transcribed(scene):
    """Every tilt with every view, tilt by tilt, of a box without sides."""
    return box_algorithms.slab_setup(scene.medium, wavelength=scene.wavelength, width=WIDTH, lights=scene.lights,
                                     views=scene.views)  # fmt: skip


@cache
def transcribed_parts(scene, reverse=False, paths=TRANSCRIBED_PATHS):
    """C by Algorithm 1, batch by batch, single and multiple scattering apart: complex128[64, 2, T * V, T * V]."""
    return oracle_parts(transcribed(scene), paths, reverse=reverse, seed=1)


def transcribed_covariances(scene, *, reverse=False, paths=TRANSCRIBED_PATHS, weight=1.0):
    """C by Algorithm 1, batch by batch, its multiple scattering times a weight: complex128[64, T * V, T * V]."""
    single, multiple = np.moveaxis(transcribed_parts(scene, reverse, paths), 1, 0)
    return single + weight * multiple


def engine_covariances(scene, *, reverse=False, paths=ENGINE_PATHS):
    """C that the engine's paths imply, batch by batch: complex128[64, T * V, T * V]."""
    tracer = slab_tracer(scene, reverse)
    layout, ways = tracer.layout, {"bidirectional": reverse, "reverse": reverse}
    found = []
    for first in range(0, BATCHES, 8):  # 64 MB at a time
        bank = tracer.trace(7, 8 * paths, first=first * paths, threads=1)
        once, more = bank.single, bank.multiple
        parts = ((once, single_amplitudes(layout, once)), (more, multiple_amplitudes(layout, more, **ways)))
        found.append(sum(by_batch(some.paths - first * paths, paths, a, count=8) for some, a in parts))
    return np.concatenate(found)


def field_covariances(fields):
    """u u^H averaged over equal batches of fields [n, P]: complex128[64, P, P]."""
    batches = fields.reshape(BATCHES, -1, fields.shape[-1])
    return np.einsum("bnp,bnq->bpq", batches, batches.conj(), optimize=True) / batches.shape[1]


def assert_same_covariance(first, second):
    """Every real and imaginary part, by Welch's z with the fewer degrees of freedom (the safe side)."""
    upper = np.triu_indices(first.shape[-1])
    means, variances = [], []
    for batches in (first, second):
        entries = batches[:, *upper]
        parts = np.concatenate([entries.real, entries.imag[:, upper[0] != upper[1]]], axis=1)
        means.append(parts.mean(axis=0))
        variances.append(parts.var(axis=0, ddof=1) / len(parts))
    assert_z(means[0], means[1], np.sqrt(variances[0] + variances[1]), degrees=BATCHES - 1)


FORWARD = [  # half of all combinations: every two values of two of side, g and optical depth meet
    ("transmission", 0.0, 2.0, 0.0, 0.0), ("transmission", 0.5, 0.5, 0.0, 0.0), ("reflection", 0.0, 0.5, 0.0, 0.3),
    ("reflection", 0.5, 2.0, 0.0, 0.3),
]  # fmt: skip
OBLIQUE = ("transmission", 0.5, 2.0, 0.5, 0.0)  # cosines of beam, footprint and depth count


@pytest.mark.parametrize(("side", "g", "optical_depth", "base", "offset"), [*FORWARD, OBLIQUE])
def test_engine_agrees_with_algorithm_1_forward(side, g, optical_depth, base, offset):
    scene = make_scene(side, g=g, optical_depth=optical_depth, base=base, offset=offset)
    assert_same_covariance(engine_covariances(scene), transcribed_covariances(scene))


@pytest.mark.slow
@pytest.mark.parametrize(("g", "optical_depth", "base"), [(0.0, 0.5, 0.0), (0.5, 2.0, 0.0), (0.5, 2.0, 0.5)])
def test_engine_agrees_with_algorithm_1_at_backscattering(g, optical_depth, base):
    scene = make_scene("reflection", g=g, optical_depth=optical_depth, base=base)
    assert_same_covariance(engine_covariances(scene, reverse=True), transcribed_covariances(scene, reverse=True))


@pytest.fixture(scope="module")
def precise():
    """A scene with mostly multiple scattering and its covariances by the engine, intensities to 0.1 %."""
    scene = make_scene(g=0.0, optical_depth=2.0)
    return scene, engine_covariances(scene, paths=8 * ENGINE_PATHS)


@pytest.mark.slow
def test_engine_agrees_with_algorithm_1_precisely(precise):
    scene, engine = precise
    assert_same_covariance(engine, transcribed_covariances(scene, paths=10_000))


@pytest.mark.slow
@pytest.mark.parametrize("error", [1.03, 0.97, 1 / (4 * np.pi)])
def test_a_wrong_weight_of_multiple_scattering_is_caught(precise, error):
    """3 % either way, and the 4 pi that the printed algorithms lack."""
    scene, engine = precise
    with pytest.raises(AssertionError, match="z ="):
        assert_same_covariance(engine, transcribed_covariances(scene, paths=10_000, weight=error))


def test_leaving_out_reversed_paths_is_caught():
    scene = make_scene("reflection", g=0.0, optical_depth=2.0)
    with pytest.raises(AssertionError, match="z ="):
        assert_same_covariance(engine_covariances(scene, reverse=True), transcribed_covariances(scene))


@pytest.mark.parametrize("reverse", [False, True])
def test_fields_of_algorithm_2_have_the_covariance_of_algorithm_1(reverse):
    """Two paths a field, so that the root of their number counts."""
    scene = make_scene("reflection", g=0.5, optical_depth=2.0)
    fields = box_algorithms.fields(transcribed(scene), 2, 400 * BATCHES, np.random.default_rng(2), reverse=reverse)
    assert_same_covariance(field_covariances(fields), transcribed_covariances(scene, reverse=reverse))


@pytest.mark.slow
def test_electric_field_monte_carlo_has_intensities_and_no_correlation():
    scene = make_scene(g=0.5, optical_depth=2.0)
    expected = transcribed_covariances(scene)
    fields = electric_field(transcribed(scene), 2, 400 * BATCHES, np.random.default_rng(3))
    diagonal = np.eye(expected.shape[-1])
    assert_same_covariance(field_covariances(fields), expected * diagonal)
    with pytest.raises(AssertionError, match="z ="):
        assert_same_covariance(field_covariances(fields), expected)


@pytest.mark.slow
@pytest.mark.parametrize(("side", "g", "optical_depth", "base"), [
    ("transmission", 0.5, 2.0, 0.0), ("reflection", 0.0, 0.5, 0.5), ("transmission", 0.9, 2.0, 0.5),
])  # fmt: skip
def test_naive_numba_fields_have_the_covariance_of_the_engine(side, g, optical_depth, base):
    scene = make_scene(side, g=g, optical_depth=optical_depth, base=base, offset=0.3 if side == "reflection" else 0.0)
    found, expected = field_covariances(naive_fields(scene, 2, 400 * BATCHES)), engine_covariances(scene)
    assert_same_covariance(found, expected)
    with pytest.raises(AssertionError, match="z ="):
        assert_same_covariance(found, 1.05 * expected)


def test_naive_covariance_is_that_of_algorithm_1():
    """Oblique and forward, so that every factor of an end and of a turn counts."""
    scene = make_scene(g=0.5, optical_depth=2.0, base=0.5)
    lights = np.repeat(scene.lights, len(scene.views), axis=0)
    views = np.tile(scene.views, (len(scene.lights), 1))
    found = np.array(
        [
            naive_covariance(scene.medium, wavelength=scene.wavelength, width=WIDTH, lights=lights, views=views,
                             paths=4000, seed=seed)
            for seed in range(BATCHES)
        ]
    )  # fmt: skip
    expected = transcribed_covariances(scene)
    assert_same_covariance(found, expected)
    with pytest.raises(AssertionError, match="z ="):
        assert_same_covariance(found, 1.05 * expected)
    with pytest.raises(AssertionError, match="z ="):
        assert_same_covariance(found, expected.conj())


def test_both_forms_of_the_naive_program_are_one_field():
    scene = make_scene(g=0.9, optical_depth=2.0)
    hoisted, plain = (naive_fields(scene, 200, 1, hoisted=h)[0] for h in (True, False))
    np.testing.assert_allclose(hoisted, plain, rtol=1e-12)  # rounding of some 800 terms


def test_rendered_intensity_is_absolute():
    """The whole pipeline, 512 media: each intensity is exponential, so this sees factors, not per cents."""
    scene = make_scene(g=0.5, optical_depth=2.0)
    fields = sg.render(scene, paths=64, seed=5, realizations=8 * BATCHES, sampler="paths", threads=1).field
    flat = fields.reshape(len(fields), -1).astype(complex)
    assert_same_covariance(field_covariances(flat), transcribed_covariances(scene))


def naive_fields(scene, paths, count, *, hoisted=True):
    """Fields complex128[count, T * V] of the naive program, one seed each."""
    return np.array(
        [
            naive_field(scene.medium, wavelength=scene.wavelength, width=WIDTH, tilts=scene.beams.directions,
                        views=scene.sensor.directions, paths=paths, seed=seed, hoisted=hoisted).ravel()
            for seed in range(count)
        ]
    )  # fmt: skip
