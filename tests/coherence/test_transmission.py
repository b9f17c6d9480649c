import numpy as np
import pytest
from refusals import assert_refused
from zscore import assert_z, refute_z

import specklegen as sg
from specklegen.coherence.cross_spectral_density import (
    gaussian_schell_model,
    intensity_from_modes,
    propagate_csd,
    separable_coherent_modes,
    spectral_density,
)
from specklegen.coherence.partially_coherent import (
    effective_source_modes,
    finite_path_excess,
    gaussian_schell_object,
    render_partially_coherent,
)
from specklegen.coherence.transmission import face_beams, face_modes, source_modes, transmission_matrix
from specklegen.core.statistics import jackknife

WAVELENGTH, WIDTH = 0.5, 800.0
FOG = sg.Slab(thickness=200.0, mean_free_path=50.0, scatterer=sg.HenyeyGreenstein(g=0.8))
REALIZATIONS = 64


def scene(light, pixels=16, medium=FOG):
    sensor = sg.FarField.grid((pixels, pixels), WAVELENGTH / WIDTH / 2)
    return sg.Scene(wavelength=WAVELENGTH, medium=medium, illumination=light, sensor=sensor)


def beams(sines):
    sines = np.asarray(sines, float)
    directions = np.column_stack([sines, np.sqrt(1 - np.square(sines).sum(1))])
    return sg.CollimatedBeams(directions=directions, width=WIDTH)


TILTS = beams([[0, 0], [4e-4, 0], [-6e-4, 1e-3]])


def test_columns_are_the_rendered_fields():
    lit = scene(TILTS)
    T = transmission_matrix(lit, paths=300, seed=3, threads=1)
    stack = sg.render(lit, paths=300, seed=3, sampler="paths", threads=1)
    assert T.value.shape == T.standard_error.shape == (256, 3)
    assert np.array_equal(T.value, stack.field.reshape(3, -1).T)
    assert np.array_equal(T.standard_error, 0.5 * stack.report.expected_error * np.abs(T.value))
    assert np.array_equal(transmission_matrix(lit, paths=300, seed=3, threads=2).value, T.value)


@pytest.mark.parametrize("medium", [sg.PhaseScreen(correlation_length=10.0, rms_phase=3.0), sg.GroundGlass(grit=220)])
def test_thin_media_have_a_matrix_by_default(medium):
    """The fields that render draws of it under the same seed."""
    lit = scene(TILTS, medium=medium)
    np.testing.assert_array_equal(transmission_matrix(lit, seed=3).value, sg.render(lit, seed=3).field.reshape(3, -1).T)


def test_a_superposition_is_a_linear_response():
    """Twice the same beam with amplitudes 1 and -1 is darkness; the columns of equal beams are equal."""
    twice = scene(beams([[1e-4, 0], [1e-4, 0]]))
    dark = transmission_matrix(twice, np.array([[1.0], [-1.0]]), paths=300, threads=1)
    assert not dark.value.any()
    assert not dark.standard_error.any()


@pytest.mark.parametrize("modes", [np.ones((2, 1)), np.ones(3)])
def test_modes_that_do_not_fit_are_refused(modes):
    with pytest.raises(sg.RuleError, match=r"transmission_matrix modes must be of shape \(3, K\)"):
        transmission_matrix(scene(TILTS), modes)


def test_objects_give_their_shining_beams_at_unit_irradiance():
    light = sg.IncoherentObject(brightness=np.array([[0, 5, 0, 2]]), pitch=1e-4, width=WIDTH)
    T = transmission_matrix(scene(light), paths=300, threads=1)
    same = transmission_matrix(scene(light.beams), paths=300, threads=1)
    assert T.value.shape == (256, 2)
    assert np.array_equal(T.value, same.value)


def test_columns_carry_the_memory_effect():
    """One medium: a column moved with its tilt is its neighbour, to the memory effect; other seeds are strangers."""
    step = 4 * WAVELENGTH / WIDTH / 2  # four pixels
    near = beams([[0, 0], [step, 0]])
    found, strange = [], []
    for seed in range(REALIZATIONS):
        T = transmission_matrix(scene(near), paths=400, seed=seed, threads=1).value.reshape(16, 16, 2)
        here, moved = T[:, :-4, 0], T[:, 4:, 1]
        other = transmission_matrix(scene(near), paths=400, seed=seed + 1000, threads=1).value.reshape(16, 16, 2)
        power = np.square(np.abs(here)).sum(), np.square(np.abs(moved)).sum()
        found.append([(here * moved.conj()).sum().real, *power])
        strange.append([(here * other[:, 4:, 1].conj()).sum().real, *power])
    curve = sg.memory_effect(FOG, wavelength=WAVELENGTH, tilts=[np.arcsin(step)], paths=20_000)
    correlation = lambda total: total[:1] / np.sqrt(total[1:2] * total[2:])  # noqa: E731
    for batches, expected in ((found, np.real(curve.field)), (strange, 0.0)):
        value, error = jackknife(np.array(batches), correlation)
        assert_z(value, expected, error, degrees=REALIZATIONS - 1, slack=3 * float(curve.standard_error[0]))
    refute_z(value, np.real(curve.field), error, degrees=REALIZATIONS - 1)


def test_standard_error_is_that_of_the_scale():
    """Over banks of few paths the mean of |T|^2 moves by expected_error; 900 grains far apart leave 3 % of speckle."""
    paths, banks = 60, 300
    sines = (np.arange(30) - 14.5) * 10 * WAVELENGTH / WIDTH
    views = np.stack(np.meshgrid(sines, sines), -1).reshape(-1, 2)
    sensor = sg.FarField(directions=beams(views).directions)
    lit = scene(beams([[0, 0]])).replace(sensor=sensor)
    power, error = [], []
    for seed in range(banks):
        T = transmission_matrix(lit, paths=paths, seed=seed, threads=1)
        power.append(np.square(np.abs(T.value)).mean())
        error.append(2 * np.mean(T.standard_error * np.abs(T.value)))  # of |T|^2, by the chain rule
    power = np.array(power)
    stated = np.square(np.mean(error) / power.mean()) + 1 / views.shape[0]
    sums = np.stack([np.ones(banks), power, power**2], axis=1)
    value, spread = jackknife(sums, lambda total: (total[0] * total[2:] / total[1] ** 2 - 1) / stated)
    # The pilot's 6000 paths know the variance of heavy-tailed weights to some 10 %.
    assert_z(value, 1.0, spread, degrees=banks - 1, slack=0.1)
    refute_z(value, 4.0, spread, degrees=banks - 1, slack=0.1)  # an error twice as large


# Modes of a source of beams
@pytest.mark.parametrize("ratio", [2.0, 0.5])
def test_source_modes_have_the_power_of_the_modes_on_the_face(ratio):
    """Eigenvalues over overlapping beams are those of the Gaussian Schell model on the window."""
    x = (np.arange(64) - 31.5) / 64
    W0 = gaussian_schell_model(x, ratio)
    expected, _ = separable_coherent_modes(W0, W0, n_modes=12)
    found, modes = source_modes(gaussian_schell_object(WAVELENGTH, ratio * WIDTH, WIDTH), WAVELENGTH, n_modes=12)
    # 1e-3 for the lattice of beams and 64 pixels a side, of the strongest mode.
    assert np.abs(found - expected / 64**2).max() < 1e-3 * found[0]
    assert modes.shape[1] == 12


@pytest.mark.parametrize("profile", ["square", "disc", "gaussian"])
def test_source_modes_are_orthonormal_on_the_window_and_add_up(profile):
    source = gaussian_schell_object(WAVELENGTH, 0.5 * WIDTH, WIDTH, profile)
    eigenvalues, modes = source_modes(source, WAVELENGTH, energy=1)
    x, y = source.beams.directions[:, :2].T / WAVELENGTH
    overlap = source.window.coherence(x[:, None] - x, y[:, None] - y)
    strong = eigenvalues > 1e-6
    gram = (modes.T @ overlap @ modes)[strong][:, strong]
    assert np.abs(gram - np.eye(strong.sum())).max() < 1e-9  # rounding over the smallest power kept
    assert eigenvalues.sum() == pytest.approx(1, abs=1e-10)
    assert eigenvalues[0] > 0.1
    assert np.all(np.diff(eigenvalues) <= 0)
    effective = effective_source_modes(source.brightness, source.pitch, WAVELENGTH, WIDTH, profile)
    assert 1 / np.square(eigenvalues).sum() == pytest.approx(effective, rel=1e-9)


def test_modes_and_beams_make_the_same_image():
    """sum_k lambda_k |T phi_k|^2 = sum_j p_j |T_j|^2 = diag of T W0 T^H, entry by entry."""
    source = gaussian_schell_object(WAVELENGTH, 0.5 * WIDTH, WIDTH)
    T = transmission_matrix(scene(source), paths=300, threads=1)
    power = source.brightness[source.brightness > 0]
    direct = np.square(np.abs(T.value)) @ power
    assert spectral_density(propagate_csd(T.value, np.diag(power))) == pytest.approx(direct, rel=1e-12)
    eigenvalues, modes = source_modes(source, WAVELENGTH, energy=1)
    image = intensity_from_modes(T.value, modes, eigenvalues)
    # Modes without power on the window (below 1e-12) are left out.
    assert np.abs(image - direct).max() < 1e-6 * direct.mean()
    eigenvalues, modes = source_modes(source, WAVELENGTH, energy=0.99)
    assert len(eigenvalues) < len(power) / 4
    kept = intensity_from_modes(T.value, modes, eigenvalues)
    assert kept.sum() / direct.sum() == pytest.approx(eigenvalues.sum(), abs=0.01)


# The face as basis
def test_face_modes_are_their_amplitudes_at_the_pixels():
    count, rng = 6, np.random.default_rng(0)
    amplitudes = rng.normal(size=(36, 2)) + 1j * rng.normal(size=(36, 2))
    light = face_beams(WAVELENGTH, WIDTH, count)
    along = (np.arange(count) - (count - 1) / 2) * WIDTH / count
    x, y = np.meshgrid(along, along)
    k = 2 * np.pi / WAVELENGTH
    points = np.column_stack([x.ravel(), y.ravel()])
    made = np.exp(1j * k * points @ light.directions[:, :2].T) @ face_modes(amplitudes)
    assert np.abs(made - amplitudes).max() < 1e-12


def test_face_modes_of_another_shape_and_too_many_pixels_are_refused():
    assert_refused(lambda: face_modes(np.ones((35, 2))), "face_modes amplitudes")
    assert_refused(lambda: face_beams(WAVELENGTH, 5.0, 20), "face_beams count")


def test_positions_and_tilts_are_two_views_of_one_source():
    """Coherent modes of positions on the face, and tilted beams, in one medium: the same image. The trigonometric
    interpolation between pixels joins opposite edges of the window: like the series of a function with a step, its mean
    square error falls as 1 / count."""
    length = WIDTH / 2
    source = gaussian_schell_object(WAVELENGTH, length, WIDTH)
    power = source.brightness[source.brightness > 0]
    apart = []
    for count in (8, 24):
        positions = face_beams(WAVELENGTH, WIDTH, count)
        both = beams(np.concatenate([positions.directions[:, :2], source.beams.directions[:, :2]]))
        T = transmission_matrix(scene(both), paths=2000, threads=1).value
        by_tilts = np.square(np.abs(T[:, count**2 :])) @ power
        W0 = gaussian_schell_model((np.arange(count) + 0.5) * WIDTH / count, length)
        eigenvalues, modes = separable_coherent_modes(W0, W0, energy=1 - 1e-6)
        by_positions = intensity_from_modes(T[:, : count**2], face_modes(modes), eigenvalues)
        apart.append(np.sqrt(np.mean((by_tilts - by_positions) ** 2)) / by_tilts.std())
    assert apart[1] < 0.1
    assert apart[0] / apart[1] == pytest.approx(np.sqrt(24 / 8), rel=0.15)


@pytest.mark.slow
def test_the_matrix_and_the_samplers_agree_in_distribution():
    """Mean and contrast: modes through transmission matrices, and the incoherent object of the engine."""
    length = WIDTH / 2
    source = gaussian_schell_object(WAVELENGTH, length, WIDTH)
    eigenvalues, modes = source_modes(source, WAVELENGTH, energy=1 - 1e-6)
    many = REALIZATIONS
    matrices = [transmission_matrix(scene(source), modes, paths=500, seed=(8, r), threads=1) for r in range(many)]
    identity = np.eye(len(eigenvalues))
    reference = np.array([intensity_from_modes(T.value, identity, eigenvalues) for T in matrices])
    stack = render_partially_coherent(scene(sg.CollimatedBeams.tilts([0.0], width=WIDTH)), length, sampler="paths",
                                      paths=500, realizations=many, seed=9, threads=1)  # fmt: skip
    moments = []
    for images in (reference, stack.intensity.reshape(many, -1).astype(float)):
        sums = np.stack([np.ones(many), images.mean(1), np.square(images).mean(1)], axis=1)
        value, error = jackknife(sums, lambda t: np.array([t[1] / t[0], t[0] * t[2] / t[1] ** 2 - 1]))
        moments.append((value, error))
    (ours, error), (theirs, other) = moments
    assert_z(ours, theirs, np.hypot(error, other), degrees=many - 1)
    law = 1 / effective_source_modes(source.brightness, source.pitch, WAVELENGTH, WIDTH)
    assert_z(ours[1], law + finite_path_excess(scene(source), 500, threads=1), error[1], degrees=many - 1)
