"""The oblique kernel: oblique tilts and views and reflection against paths; the kernel of the axis is caught there."""

from functools import partial

import numpy as np
import pytest
from scenes import slab as slab_of_depth
from zscore import assert_mean, assert_z, refute_z

import specklegen as sg
from specklegen.core.statistics import jackknife
from specklegen.memory_effects.cached import medium_seed
from specklegen.memory_effects.correlation import estimate_correlation
from specklegen.memory_effects.film import FilmCorrelation
from specklegen.memory_effects.oblique import ObliqueCorrelation, estimate_oblique_correlation, face_to_face
from specklegen.paths.endpoints import AXIS
from specklegen.paths.proposal import beam_proposal
from specklegen.paths.slab_tracer import trace
from specklegen.planning.planning import STATIONARY_TOLERANCE, plan
from specklegen.samplers.stationary.stationarity import pilot_error
from specklegen.scene.illumination import directions_of_sines
from specklegen.synthesis.stacks import stack_sampler, tilt_roots

WAVELENGTH, THICKNESS = 0.5, 1000.0
K = 2 * np.pi / WAVELENGTH
WIDTH = 50 * THICKNESS
PITCH = 0.5 * WAVELENGTH / WIDTH
HALF = {0.9: 62, 0.0: 24}  # pixels of PITCH in a tilt of half a memory-effect range: q = 3.93 and 1.5


slab = partial(slab_of_depth, g=0.9, thickness=THICKNESS)


def test_matrices_are_the_sums_of_their_definition():
    """Over the connections, signs included: of lights, and of lights and instants together."""
    rng = np.random.default_rng(1)
    ways = ObliqueCorrelation(rng.normal(size=(5, 2)), rng.random(5), np.arange(5), 5, transfer=rng.random(5),
                              doppler=rng.normal(size=5))  # fmt: skip
    sines, times, law = 0.2 * rng.normal(size=(3, 2)), np.array([0.0, 0.3, 0.7]), sg.Brownian(diffusion=0.4 / K**2)
    apart, later = sines[:, None] - sines, times[:, None] - times
    tilted = np.exp(-1j * K * (apart @ ways.displacement.T))
    share = ways.weights / ways.weights.sum()
    np.testing.assert_allclose(ways.matrix(sines, K), tilted @ share, rtol=1e-12)
    faded = np.exp(1j * K * later[..., None] * ways.doppler - 2 * 0.4 * np.abs(later)[..., None] * ways.transfer)
    for axial in (False, True):  # with directions of flow R has one, too
        film = FilmCorrelation(ways, law, times, axial, ways.doppler)
        np.testing.assert_allclose(film.matrix(sines, K), (tilted * faded) @ share, rtol=1e-9)


def oblique(view: float, tilt: float = 0.0, *, g: float = 0.9, side="transmission", shape=(16, 96)) -> sg.Scene:
    """Two tilts half a range apart about ``tilt``, seen about ``view``; degrees from the axis, in the x-z plane."""
    shift = HALF[g] * PITCH
    sines = np.sin(np.deg2rad(tilt)) + np.array([-shift / 2, shift / 2])
    return sg.Scene(
        wavelength=WAVELENGTH, medium=slab(g=g),
        illumination=sg.CollimatedBeams(directions=directions_of_sines("tilt", np.stack([sines, 0 * sines], 1)),
                                        width=WIDTH),
        sensor=sg.FarField.grid(shape=shape, pitch=PITCH, center=(np.sin(np.deg2rad(view)), 0.0), side=side),
    )  # fmt: skip


def moments(stacks: np.ndarray, shift: int) -> np.ndarray:
    """What each pair of intensities [n, 2, H, W] adds to mean intensities, product after the shift, and count."""
    one, two = stacks[:, 0, :, : stacks.shape[3] - shift], stacks[:, 1, :, shift:]
    means = [part.mean(axis=(1, 2)) for part in (one, two, one * two)]
    return np.stack([*means, np.ones(len(stacks))], axis=1)


def correlation(total: np.ndarray) -> np.ndarray:
    """Mean intensities, and C_I of the two tilts at views that move along."""
    one, two, product, count = total
    return np.array([one / count, two / count, product * count / (one * two) - 1])


CASES = [pytest.param(10, 0, 0.9, "transmission", marks=pytest.mark.slow), (20, 0, 0.9, "transmission"),
         pytest.param(0, 20, 0.9, "transmission", marks=pytest.mark.slow),
         pytest.param(-20, 20, 0.9, "transmission", marks=pytest.mark.slow), (25, 0, 0.0, "reflection")]  # fmt: skip


@pytest.mark.parametrize(("view", "tilt", "g", "side"), CASES)
def test_oblique_stacks_are_those_of_paths(view, tilt, g, side):
    scene, paths, count = oblique(view, tilt, g=g, side=side), 2500, 250 if view == 10 else 100
    made = plan(scene, paths=200_000, realizations=count)
    assert (made.sampler, made.chosen.form) == ("stationary", "oblique"), made.explain()
    found = []
    for sampler, n in (("paths", paths), ("stationary", 200_000)):
        stack = sg.render(scene, paths=n, seed=1, realizations=count, sampler=sampler)
        found.append(jackknife(moments(stack.intensity.astype(float), HALF[g]), correlation))
    (by_paths, error), (stationary, other) = found
    # Views a grain apart share the entrances of a finite number of paths: up to twice the promised excess.
    allowed = np.full(3, 2 * plan(scene, paths=paths, sampler="paths").expected_error ** 2)
    allowed[:2] = 5 * made.expected_error * by_paths[:2]
    assert_z(stationary, by_paths, np.hypot(error, other), degrees=count - 1, slack=allowed)
    assert by_paths[2] < 0.95
    if side == "reflection":
        return
    # Power: so does the kernel of the axis not, neither in intensity nor in correlation.
    sampler = stack_sampler(scene, estimate_correlation(scene.slab, 200_000, 1))
    plain = np.stack([np.square(np.abs(sampler.sample(1, r).numpy())) for r in range(count)]).astype(float)
    wrong, _ = jackknife(moments(plain, HALF[g]), correlation)
    for part in (slice(0, 2), slice(2, 3)):
        refute_z(wrong[part], by_paths[part], error[part], degrees=count - 1, slack=allowed[part])


def test_on_the_axis_it_is_the_kernel_of_the_axis():
    """E[w J0(q r)] and E[w e^(-iq.R)] from independent paths, by z over 32 runs; q along two directions."""
    sines = np.array([[0.0, 0.0], [3e-4, 0.0], [0.0, 2e-4]])
    turned = [estimate_oblique_correlation(slab(), AXIS, AXIS, 4000, (1, n)) for n in range(32)]
    plain = [estimate_correlation(slab(), 4000, (2, n)) for n in range(32)]
    turned, plain = (np.array([k.matrix(sines, K)[1:, 0] for k in found]) for found in (turned, plain))
    difference = turned - plain
    assert_mean(np.concatenate([difference.real, difference.imag], axis=1), 0.0)


def test_the_way_leads_from_face_to_face():
    """A path's phase at a light and a view, less that at others a little turned, is q . R to second order."""
    medium, light, view = slab(g=0.0), *directions_of_sines("way", [[0.2, -0.1], [-0.3, 0.25]])
    beams = sg.CollimatedBeams(directions=light[None], width=100.0)
    for side in (1.0, -1.0):
        seen = view * [1, 1, side]
        bank = trace(medium, beam_proposal(medium, beams, seen), 1, 200)
        turn = 1e-7 * np.array([1.0, -2.0])
        other_light = directions_of_sines("light", light[:2] + turn)
        other_view = directions_of_sines("view", seen[:2] + turn, side)
        face = np.array([0, 0, THICKNESS if side > 0 else 0.0])
        phase = bank.entry @ (other_light - light) - (bank.exit - face) @ (other_view - seen)
        way = face_to_face(bank, medium, light, seen)
        # Second order in the turn, times distances of a few thicknesses; the way itself is a thousand times longer.
        np.testing.assert_allclose(phase, -way @ turn, rtol=0, atol=1e-12 * THICKNESS)
        assert np.abs(way @ turn).max() > 1e-4


def test_it_is_hermitian_and_positive_for_any_tilts():
    kernel = estimate_oblique_correlation(slab(), AXIS, directions_of_sines("view", [0.3, 0.0]), 2000, 1)
    sines = np.random.default_rng(0).normal(size=(40, 2)) * 3 / (K * THICKNESS)
    sines[20:30] = sines[:10]
    matrix = kernel.matrix(sines, K)
    np.testing.assert_allclose(matrix, matrix.conj().T, atol=1e-14)
    np.testing.assert_allclose(np.diag(matrix), 1, rtol=1e-12)
    assert np.linalg.eigvalsh(matrix).min() > -1e-12 * len(sines)
    root = tilt_roots(matrix)
    np.testing.assert_allclose(root @ root.conj().T, matrix, atol=1e-10)
    assert np.abs(matrix.imag).max() > 0.05  # it is oblique


@pytest.mark.parametrize("g", [0.9, 0.0])
@pytest.mark.parametrize("side", ["transmission", "reflection"])
def test_the_criterion_accepts_it_to_forty_degrees(g, side):
    """At a quarter of what the planner allows; what is left at 200 thicknesses is the window's."""
    for view, tilt in ((40, 0), (0, 40), (-20, 20)):
        scene = oblique(view, tilt, g=g, side=side, shape=(3, 3))
        scene = scene.replace(illumination=scene.beams.replace(width=200 * THICKNESS),
                              sensor=scene.sensor.replace(pitch=PITCH / 4))  # fmt: skip
        error = pilot_error(scene, plan(scene, sampler="paths", reverse=False).chosen.tracer, 8192, oblique=True)
        assert error.accepts(STATIONARY_TOLERANCE / 4)


def test_the_kernel_of_the_axis_is_preferred_where_it_is_right():
    """And then its bits are what they were: the oblique one is not even estimated."""
    scene = oblique(0.5)
    made = plan(scene, realizations=100)
    assert (made.sampler, made.chosen.form) == ("stationary", "axial")
    rendered = sg.render(scene, paths=5000, seed=3, sampler="stationary").field
    kernel = estimate_correlation(scene.slab, 5000, medium_seed(scene.slab))
    np.testing.assert_array_equal(rendered, stack_sampler(scene, kernel).sample(3).numpy())


def test_hidden_objects_keep_to_the_axis():
    scene = oblique(10).replace(illumination=sg.IncoherentObject(brightness=np.ones((2, 2)), pitch=1e-5, width=WIDTH))
    made = plan(scene)
    assert made.sampler == "paths"
    back = scene.replace(sensor=scene.sensor.replace(side="reflection", center=(0.4, 0.0)))
    with pytest.raises(sg.RuleError, match="serves hidden objects in transmission only"):
        plan(back, sampler="stationary", reverse=False)
