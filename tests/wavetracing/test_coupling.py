"""Masked light in the engine: to the bit where the mask is open, and speckle that carries the mask's fringes."""

import warnings

import numpy as np
import pytest
from zscore import assert_mean, assert_z

import specklegen as sg
from specklegen.core.statistics import jackknife
from specklegen.wavetracing import (
    Plane,
    PlaneField,
    PlaneWave,
    aperture_transform,
    field_on_plane,
    illumination_of,
    window_losses,
)

WAVELENGTH, WIDTH, PIXELS = 0.5, 32.0, 64
FOG = sg.Slab(thickness=4.0, mean_free_path=2.0, scatterer=sg.HenyeyGreenstein(g=0.9))
EMPTY = sg.Slab(thickness=0.01, mean_free_path=1e9, scatterer=sg.Isotropic())
LIGHT = PlaneWave(wavelength=WAVELENGTH)
PITCH = WAVELENGTH / WIDTH / 2
REALIZATIONS = 48


def slit(centre, width=4.0, height=12.0):
    return np.array([[-width, -height], [width, -height], [width, height], [-width, height]]) / 2 + [centre, 0]


DOUBLE = [slit(-5.0), slit(5.0)]


def on_window(opening, z=20.0, pixels=PIXELS):
    plane = Plane(center=[0, 0, z], shape=(pixels, pixels), pitch=WIDTH / pixels)
    return field_on_plane(opening, LIGHT, plane, threads=1)


def scene(beams, medium=FOG, shape=(21, 21)):
    sensor = sg.FarField.grid(shape, PITCH)
    return sg.Scene(wavelength=WAVELENGTH, medium=medium, illumination=beams, sensor=sensor)


@pytest.fixture(scope="module")
def double_slit():
    """Its strongest beams: 80 % of the power, some forty."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # 1.3 % of the power lies at the finest waves of 64 pixels
        return illumination_of(on_window(DOUBLE), 0.8)


def test_an_open_mask_is_the_engine_to_the_bit():
    """No screen, uniform light: one beam with the amplitude 1, so the same scene, medium and fields."""
    plain = sg.CollimatedBeams.tilts([0.0], WIDTH)
    field = on_window(None, z=0.0)
    beams, modes = illumination_of(field)
    assert beams == plain
    assert np.array_equal(modes, [[1.0]])
    T = sg.transmission_matrix(scene(beams), modes, paths=300, seed=3, threads=1)
    stack = sg.render(scene(plain), paths=300, seed=3, sampler="paths", threads=1)
    assert np.array_equal(T.value[:, 0], stack.field.ravel())
    assert np.abs(T.value).min() > 0
    losses = window_losses(field)
    assert losses.seam == losses.evanescent == losses.unresolved == 0
    assert losses.rim == 1 - 62**2 / 64**2


def test_beams_make_the_field_again():
    """On the pixels the series is the field, to the power that is left out."""
    field = on_window(DOUBLE)
    x = Plane(shape=(PIXELS, PIXELS), pitch=WIDTH / PIXELS).points.reshape(-1, 3)
    for power in (0.8, 0.99, 1.0):
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            beams, modes = illumination_of(field, power)
        made = np.exp(2j * np.pi / WAVELENGTH * x[:, :2] @ beams.directions[:, :2].T) @ modes[:, 0]
        left = np.square(np.abs(made - field.values.ravel())).sum() / np.square(np.abs(field.values)).sum()
        assert left <= 1 - power + 1e-12
        assert power == 1 or left > 0.5 * (1 - power)  # no more beams than needed


def test_an_empty_slab_sends_the_fourier_integral_of_the_field():
    """Through nothing: int u e^{-ik v.x} d^2x / lambda over the window, and so the transform of the mask itself.

    The engine carries sqrt(cos) of each beam, 4e-4 here; the mask's own transform lacks what left the window and lay
    above the finest waves, 2 to 3 % of the power.
    """
    field = on_window(DOUBLE)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        beams, modes = illumination_of(field, 0.99)
    sent = sg.transmission_matrix(scene(beams, EMPTY), modes, paths=10, mean=True, threads=1).value[:, 0]
    views = scene(beams).views[:, :2]
    k = 2 * np.pi / WAVELENGTH
    across = (beams.directions[:, :2] - views[:, None]) * WIDTH / WAVELENGTH
    series = np.prod(np.sinc(across), axis=-1) @ modes[:, 0] * WIDTH**2 / WAVELENGTH
    scale = np.vdot(series, sent) / np.vdot(series, series)
    assert abs(scale - 1) < 2e-3  # mean of sqrt(cos): 4e-4, measured
    assert np.linalg.norm(sent - scale * series) / np.linalg.norm(sent) < 2e-3
    axial = np.exp(1j * k * 20 * np.sqrt(1 - np.square(views).sum(axis=1)))
    mask = aperture_transform(DOUBLE, k * views) * axial / WAVELENGTH
    assert np.linalg.norm(sent - mask) / np.linalg.norm(mask) < 0.1
    shifted = mask * np.exp(-1j * k * views[:, 0] * 0.5)  # a mask one wavelength aside is seen
    assert np.linalg.norm(sent - shifted) / np.linalg.norm(mask) > 0.2


def coherence_of_speckle(modes, sums):
    """Sums over views of u(v) u*(v + shift), for all shifts along x, of realization after realization."""
    fields = (sums @ modes)[..., 0].reshape(len(sums), 21, 21)
    products = [(fields[..., : 21 - shift] * fields[..., shift:].conj()).mean(axis=(1, 2)) for shift in range(0, 16, 3)]
    return np.stack(products, axis=1)


def expected_coherence(beams, modes):
    """Van Cittert-Zernike: the Fourier transform of |u|^2 on the window, times the memory effect of the slab."""
    fine = (np.arange(256) + 0.5) / 256 * WIDTH - WIDTH / 2
    x, y = np.meshgrid(fine, fine)
    k = 2 * np.pi / WAVELENGTH
    sines = beams.directions
    u = np.zeros(x.shape, complex)
    for direction, amplitude in zip(sines, modes[:, 0], strict=True):
        u += amplitude * np.exp(1j * k * (direction[0] * x + direction[1] * y))
    power = np.square(np.abs(u)).sum(axis=0)
    shifts = np.arange(0, 16, 3) * PITCH
    pattern = np.exp(1j * k * shifts[:, None] * fine) @ power / power.sum()
    curve = sg.memory_effect(FOG, wavelength=WAVELENGTH, tilts=list(np.arcsin(shifts[1:])), paths=20_000)
    memory = np.append(1.0, np.real(curve.field))
    return pattern * memory, float(np.max(curve.standard_error))


@pytest.mark.slow
def test_speckle_behind_a_double_slit(double_slit):
    """Its autocorrelation shows the fringes of the mask: the covariance of the field over views and realizations.

    48 media. The mean intensity is the power of the modes times that of one beam, since beams of the lattice are
    orthogonal on the window.
    """
    beams, modes = double_slit
    matrices = np.array([
        sg.transmission_matrix(scene(beams), paths=150, seed=(5, r), threads=1).value for r in range(REALIZATIONS)
    ])  # fmt: skip
    expected, uncertain = expected_coherence(beams, modes)
    assert np.abs(expected[1:]).max() > 0.5
    assert expected.real.min() < -0.4  # fringes, not a lobe

    def measured(amplitudes):
        products = coherence_of_speckle(amplitudes, matrices)
        parts = np.concatenate([products.real, products.imag[:, 1:]], axis=1)
        return jackknife(parts, lambda total: total[1:] / total[0])

    wanted = np.concatenate([expected.real[1:], expected.imag[1:]])
    slack = 3 * uncertain  # of the memory effect's own Monte Carlo, .009
    value, error = measured(modes)
    assert_z(value, wanted, error, degrees=REALIZATIONS - 1, slack=slack)
    assert error.max() < 0.1
    wrong, spread = measured(np.abs(modes))  # without the phases another field stands on the window
    with pytest.raises(AssertionError, match="z ="):
        assert_z(wrong, wanted, spread, degrees=REALIZATIONS - 1, slack=slack)

    power = np.square(np.abs(modes[:, 0]))
    masked = np.square(np.abs(matrices @ modes[:, 0])).mean(axis=1)
    each = np.square(np.abs(matrices)).mean(axis=1) @ power
    assert_mean(masked / each.mean() - each / each.mean(), 0.0)
    with pytest.raises(AssertionError, match="z ="):
        assert_mean(masked / each.mean() - 0.5 * each / each.mean(), 0.0)


def test_two_fields_share_beams_and_medium(double_slit):
    """Slits that do not interfere: two columns of one call, whose sum of fields is the coherent double slit's."""
    parts = [on_window(slit(-5.0)), on_window(slit(5.0))]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        beams, modes = illumination_of(parts, 0.9)
    assert modes.shape == (len(beams.directions), 2)
    T = sg.transmission_matrix(scene(beams), modes, paths=100, seed=1, threads=1).value
    both = sg.transmission_matrix(scene(beams), modes.sum(axis=1, keepdims=True), paths=100, seed=1, threads=1).value
    assert np.abs(T.sum(axis=1) - both[:, 0]).max() < 1e-12 * np.abs(T).max()
    incoherent = np.square(np.abs(T)).sum(axis=1)
    assert np.abs(incoherent - np.square(np.abs(both[:, 0]))).max() > 0.3 * incoherent.mean()


def test_losses_are_stated():
    """Rim, seam, evanescent and unresolved light of fields made to have them; each warns above 1 %."""
    n = 32
    along = (np.arange(n) + 0.5) / n
    ramp = np.broadcast_to(np.exp(1j * np.pi * along), (n, n))  # half a turn across: opposite sides differ
    losses = window_losses(PlaneField(ramp, 1.0, WAVELENGTH))
    assert losses.seam == pytest.approx((4 * np.sin(np.pi * 31 / 64) ** 2 - 4 * np.sin(np.pi / 64) ** 2) / n)
    with pytest.warns(sg.DoubtWarning, match="seam of the window"):
        illumination_of(PlaneField(ramp, 1.0, WAVELENGTH))
    # Two waves of equal power on a window of 8 wavelengths: sines of 4/8 and -12/8.
    steep = np.exp(2j * np.pi * 4 * along) + np.exp(-2j * np.pi * 12 * along)
    fine = PlaneField(np.broadcast_to(steep, (n, n)), 0.125, WAVELENGTH)
    assert window_losses(fine).evanescent == pytest.approx(0.5, abs=1e-12)
    with pytest.warns(sg.DoubtWarning, match="50.0% of the power is evanescent"):
        beams, modes = illumination_of(fine)
    assert len(modes) == 1
    assert np.abs(modes[0, 0]) == pytest.approx(1)
    assert beams.directions[0, 0] == pytest.approx(4 * WAVELENGTH / (n * 0.125))
    assert window_losses(fine).seam < 1e-12
    coarse = PlaneField(np.broadcast_to(1 + np.exp(2j * np.pi * 15 * along), (n, n)), 1.0, WAVELENGTH)
    assert window_losses(coarse).unresolved == pytest.approx(0.5, abs=1e-12)
    with pytest.warns(sg.DoubtWarning, match="finer pitch"):
        illumination_of(coarse)


def test_a_resolved_mask_loses_little():
    """The double slit on pixels of 3/4 wavelength: nothing evanescent; what is lost at the rim has left the window."""
    losses = window_losses(on_window(DOUBLE, pixels=86))
    assert losses.rim < 2e-3
    assert losses.seam < 1e-12  # by the symmetry of the mask
    assert losses.evanescent < 1e-9
    assert losses.unresolved < 0.01


@pytest.mark.parametrize(
    ("call", "match"),
    [
        (lambda: illumination_of(PlaneField(np.ones((2, 3)), 1.0, 0.5)), "on a square grid"),
        (lambda: illumination_of(PlaneField(np.zeros((2, 2)), 1.0, 0.5)), "not 0 everywhere"),
        (lambda: illumination_of(PlaneField(np.ones((2, 2)), 1.0, 0.5), 0.0), "power must be above 0"),
        (lambda: illumination_of([]), "a PlaneField, or a sequence of them"),
        (lambda: illumination_of([on_window(None), on_window(None, pixels=32)]), "on one grid"),
    ],
)
def test_bad_input_is_refused(call, match):
    with pytest.raises(sg.RuleError, match=match):
        call()
