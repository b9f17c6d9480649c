"""What closed forms, objects and fields say of a covariance, against other programs and other arithmetic."""

import numpy as np
import pytest
from zscore import assert_mean, assert_z, limit, refute_mean, refute_z

import specklegen as sg
from scripts.error_time.comparisons import drawn_screens, of_fields
from scripts.error_time.literal import literal_setup
from scripts.error_time.references import load
from scripts.error_time.scenes import SCENES
from specklegen.core.statistics import batch_sums
from specklegen.error_time import Probes
from specklegen.error_time.estimates import paths_estimate, screens_estimate, single_estimate, stationary_estimate
from specklegen.oracles import box_algorithms

BATCHES = 64


def literal_orders(scene: sg.Scene, probes: Probes, paths: int) -> np.ndarray:
    """Entries by Algorithm 3 from single scattering and from all else: complex128[64, 2, P], forward paths."""
    setup, (p, q) = literal_setup(scene, probes), probes.ends.T
    found = np.zeros((BATCHES, 2, len(p)), np.complex128)
    for batch, seed in zip(found, np.random.SeedSequence(1).spawn(BATCHES), strict=True):
        for part in box_algorithms.contributions(setup, paths, np.random.default_rng(seed), reverse=False):
            products = part.weight * part.amplitude[p] * part.amplitude[q].conj()
            batch[int(part.order > 1)] += products.sum(axis=1) / paths
    return found


def test_single_scattering_is_that_of_algorithm_3_and_its_error_what_it_leaves_out():
    scene = sg.Scene(
        wavelength=1.0,
        medium=sg.Box(lower=(-5.0, -5.0), upper=(5.0, 5.0), mean_free_path=10.0, scatterer=sg.HenyeyGreenstein(g=0.5)),
        illumination=sg.PlaneWaves.tilts(np.deg2rad([0.0, 2.0]), dimensions=2),
        sensor=sg.FarField.angles(np.deg2rad([20.0, 22.0, 80.0, 82.0])),
    )
    probes = Probes(np.array([(0, 0), (1, 1), (0, 2), (1, 3)]), np.array([(0, 1), (2, 3), (0, 3)]))
    found = single_estimate(scene, probes, 0, 0)
    single, rest = literal_orders(scene, probes, 500).swapaxes(0, 1)
    assert_mean(single.real, found.value.real)
    assert_mean(single.imag[:, 4:], found.value.imag[4:])
    refute_mean(single.real, 1.1 * found.value.real)  # a tenth more
    noise = limit(4, BATCHES - 1) * rest[:, :4].real.std(axis=0, ddof=1) / np.sqrt(BATCHES)
    left_out = rest[:, :4].real.mean(axis=0)
    assert (left_out - noise < found.standard_error[:4]).all()
    assert (found.standard_error[:4] < found.value[:4].real + left_out - noise).all(), "more than there is"


def test_objects_have_the_covariances_of_their_paths():
    """Between pixels of an object without symmetry, at views that have moved with them."""
    pitch = 1e-5
    brightness = np.array([[1.0, 0.0, 1.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]])
    scene = sg.Scene(wavelength=1.0, medium=sg.Slab(thickness=400.0, mean_free_path=40.0, scatterer=sg.Isotropic()),
                     illumination=sg.IncoherentObject(brightness=brightness, pitch=40 * pitch, width=4e4),
                     sensor=sg.FarField.grid((85, 85), pitch))  # fmt: skip
    moved = np.linalg.norm(scene.views[None, :, :2] - scene.lights[:, None, :2], axis=-1)
    probes = Probes.among([(light, moved[light].argmin()) for light in range(len(scene.lights))])
    model, exact = stationary_estimate(scene, probes, 20_000, 1), paths_estimate(scene, probes, 20_000, 2)
    error = np.hypot(model.standard_error, exact.standard_error)
    slack = 0.01 * probes.scale(exact.value)  # of the light, which the modes leave out
    assert_z(np.abs(model.value - exact.value), 0, error, degrees=BATCHES - 1, slack=slack)
    turned = stationary_estimate(scene, Probes(probes.points[::-1], probes.crossings), 20_000, 1)
    with pytest.raises(AssertionError, match="z ="):  # every pixel taken for another
        assert_z(np.abs(turned.value - exact.value), 0, error, degrees=BATCHES - 1, slack=slack)


def test_fields_have_the_covariance_that_they_are_drawn_from():
    """Gaussian fields: E|u_p u_q* - C_pq|^2 = C_pp C_qq, so the right standard error is known too."""
    rng, count, repeats = np.random.default_rng(3), 128, 1000
    mixing = rng.normal(size=(3, 3)) + 1j * rng.normal(size=(3, 3))
    probes = Probes.among([(0, 0), (0, 1), (1, 2)])
    p, q = probes.ends.T
    right = mixing @ mixing.conj().T
    white = (rng.normal(size=(repeats, count, 3)) + 1j * rng.normal(size=(repeats, count, 3))) / np.sqrt(2)
    found = [of_fields(probes, fields) for fields in white @ mixing.T]
    value = np.array([each.value for each in found])
    square = np.square([each.standard_error for each in found])
    power = right.diagonal().real
    assert_mean(value.real, right[p, q].real)
    assert_mean(value.imag[:, 3:], right[p, q].imag[3:])
    assert_mean(square, power[p] * power[q] / count)
    refute_mean(value.imag[:, 3:], right[q, p].imag[3:])
    refute_mean(square, 1.05 * power[p] * power[q] / count)  # a twentieth


@pytest.mark.parametrize(("count", "connections"), [(200, 500), (10, 500), (200, 0)])
def test_batches_share_the_paths_out_evenly(count, connections):
    rng = np.random.default_rng(4)
    paths = np.sort(rng.integers(0, count, connections))
    values = rng.normal(size=(2, 3, connections)) + 1j * rng.normal(size=(2, 3, connections))
    found = batch_sums(values, paths, count)
    assert len(found) == min(BATCHES, count)
    bounds = np.linspace(0, count, len(found) + 1)
    for sums, low, high in zip(found, bounds[:-1], bounds[1:], strict=True):
        np.testing.assert_allclose(sums, values[..., (paths >= low) & (paths < high)].sum(axis=-1), atol=1e-13)


def test_screens_are_those_of_the_transformed_coherences_and_of_the_fields_that_are_drawn():
    """The reference is a quadrature over the exit plane: 1e-3 holds its step, the table of lobes and gathered terms."""
    case, reference = SCENES["two-screens"](), load("two-screens")
    scale = case.probes.scale(reference.value)
    found = screens_estimate(case.scene, case.probes, 0, 0)
    np.testing.assert_allclose(found.value / scale, reference.value / scale, atol=1e-3)
    assert (found.standard_error / scale < 0.02).all()
    drawn = of_fields(case.probes, drawn_screens(case.scene, case.probes, 600, 3))
    apart, error = drawn.value - found.value, drawn.standard_error
    assert_z(np.abs(apart) / error, np.zeros(len(apart)), np.ones(len(apart)), degrees=BATCHES - 1)
    refute_z(np.abs(1.5 * drawn.value - found.value) / error, np.zeros(len(apart)), np.ones(len(apart)), degrees=63)
