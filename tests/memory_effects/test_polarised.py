"""Polarised light behind slabs: intensities and polarisation by adding and doubling, the memory effect by its table."""

import numpy as np
import pytest
from refusals import assert_refused
from scenes import slab as slab_of_depth
from scipy.integrate import trapezoid
from zscore import assert_z, refute_z

import specklegen as sg
from specklegen.core.statistics import BATCHES
from specklegen.memory_effects import mueller, polarised
from specklegen.memory_effects.polarised import axial_curve, bessel_even, pair_curve, polariser
from specklegen.oracles.vector_adding_doubling import projected, rayleigh, vector_adding_doubling
from specklegen.paths.endpoints import AXIS

THICKNESS, WAVELENGTH = 1000.0, 0.5
DEGREES = BATCHES - 1
AIR, TISSUE = sg.Rayleigh(), sg.HenyeyGreenstein(0.9)


def slab(depth, scatterer=AIR, polarisation="projector", **fields):
    return slab_of_depth(depth, thickness=THICKNESS).replace(scatterer=scatterer, polarisation=polarisation, **fields)


def tilts(q):
    """Tilts at which k L sin(tilt) = q."""
    return np.arcsin(np.asarray(q) * WAVELENGTH / (2 * np.pi * THICKNESS))


def henyey_greenstein(g):
    return lambda cosine: (1 - g * g) / (1 + g * g - 2 * g * cosine) ** 1.5


def sphere_matrix(sphere):
    """F11, F12, F33, F34 of a sphere's amplitudes: Bohren and Huffman, Eq. 4.77."""

    def matrix(cosine):
        one, two = np.sqrt(4 * np.pi) * sphere.amplitude_matrix(cosine)
        cross = two * one.conj()
        powers = np.abs(one) ** 2, np.abs(two) ** 2
        return np.array([(powers[0] + powers[1]) / 2, (powers[1] - powers[0]) / 2, cross.real, cross.imag])

    return matrix


# ---- Intensities and polarisation, by adding and doubling ------------------------------------------------

HANDS = np.diag([1.0, 1.0, -1.0, -1.0])
"""What the other sign of one axis does to a Stokes vector."""


def against_doubling(medium, matrix, seed=1, *, paths=20_000, view=None, nodes=16):
    """Mean Mueller matrix of paths, its errors, and what adding and doubling find."""
    options = {"mode": "transmission" if view is None or view[2] > 0 else "reflection", "reverse": False}
    found = sg.mueller_matrix(medium, wavelength=WAVELENGTH, paths=paths, seed=seed, view=view, **options)
    cosine = 1.0 if view is None else abs(view[2])
    light = vector_adding_doubling(medium.optical_depth, matrix, albedo=medium.albedo, views=[cosine], nodes=nodes)
    if view is None or view[2] > 0:
        return found, cosine * light.transmitted[0, 0] / np.pi  # per area of the face
    return found, HANDS @ (cosine * light.reflected[0, 0] / np.pi)  # theta is -x before the slab


def layers(parts, polarisation="projector"):
    """Layers of optical depths and particles, and of densities that have no part in it."""
    made = [
        sg.Layer(thickness=THICKNESS * (n + 1), mean_free_path=THICKNESS * (n + 1) / depth, scatterer=each)
        for n, (depth, each) in enumerate(parts)
    ]
    return sg.Layers(layers=made, polarisation=polarisation)


CASES = {
    "Rayleigh .5": (slab(0.5, polarisation="vector"), rayleigh, None),
    "Rayleigh 5, by the projector": (slab(5), rayleigh, None),
    "Rayleigh 10": (slab(10, polarisation="vector"), rayleigh, None),
    "aside": (slab(2, polarisation="vector"), rayleigh, [0.8, 0.0, 0.6]),
    "before": (slab(2, polarisation="vector"), rayleigh, [0.8, 0.0, -0.6]),
    "absorbing": (slab(4, sg.HenyeyGreenstein(0.5), albedo=0.8), projected(henyey_greenstein(0.5)), None),
}


GLASS = sg.Faces(inside=1.5)
BETWEEN_FACES = {"behind": None, "aside": [0.4, 0.3, np.sqrt(0.75)], "before": [0.3, 0.0, -np.sqrt(0.91)]}


@pytest.mark.parametrize("name", BETWEEN_FACES)
def test_faces_reflect_either_polarisation(name):
    """By adding and doubling between Fresnel's faces, with phases beyond the critical angle; without faces it fails."""
    view = BETWEEN_FACES[name]
    medium = slab(2, polarisation="vector", faces=GLASS)
    mode = "reflection" if view is not None and view[2] < 0 else "transmission"
    found = sg.mueller_matrix(medium, wavelength=WAVELENGTH, paths=30_000, seed=1, view=view, mode=mode, reverse=False)
    cosine = 1.0 if view is None else abs(view[2])
    azimuth = [0.0 if view is None else np.arctan2(view[1], view[0])]
    light = vector_adding_doubling(2.0, rayleigh, views=[cosine], azimuths=azimuth, nodes=24, index=1.5)
    lit = (light.reflected if mode == "reflection" else light.transmitted)[0, 0]
    expected = cosine * in_axes(lit, azimuth[0], mode == "reflection") / np.pi
    assert_z(found.matrix, expected, found.standard_error, degrees=DEGREES)
    assert_z(found.circular, expected[3, 3] / expected[0, 0], found.circular_error, degrees=DEGREES)
    if view is None:  # one face, of no polarisation
        alone = vector_adding_doubling(2.0, rayleigh).transmitted[0, 0]
        refute_z(found.linear, alone[1, 1] / alone[0, 0], found.linear_error, degrees=DEGREES)


def in_axes(matrix, azimuth, before):
    """Matrix from and to the frame (theta, phi) at an azimuth as one between fields along x and y."""
    c, s = np.cos(2 * azimuth), np.sin(2 * azimuth)
    turn = np.array([[1, 0, 0, 0], [0, c, -s, 0], [0, s, c, 0], [0, 0, 0, 1]])
    return turn @ (HANDS @ matrix if before else matrix)


PROJECTED = projected(henyey_greenstein(0.5))
LAYERED = {
    "of one kind": (((1.5, AIR), (0.5, AIR)), (rayleigh, rayleigh), "vector"),
    "of two kinds": (((1.0, AIR), (2.0, sg.HenyeyGreenstein(0.5))), (rayleigh, PROJECTED), "projector"),
}


# One kind of particle has a walk of its own, which takes a minute to compile.
@pytest.mark.parametrize("name", [pytest.param("of one kind", marks=pytest.mark.slow), "of two kinds"])
def test_layers_are_those_of_adding_and_doubling(name):
    parts, matrices, model = LAYERED[name]
    found = sg.mueller_matrix(layers(parts, model), wavelength=WAVELENGTH, paths=15_000, seed=1)
    exact = vector_adding_doubling([depth for depth, _ in parts], matrices).transmitted[0, 0] / np.pi
    assert_z(found.matrix, exact, found.standard_error, degrees=DEGREES)
    assert_z(found.linear, exact[1, 1] / exact[0, 0], found.linear_error, degrees=DEGREES)
    assert_z(found.circular, exact[3, 3] / exact[0, 0], found.circular_error, degrees=DEGREES)
    if name == "of two kinds":
        turned = vector_adding_doubling([3.0], [PROJECTED]).transmitted[0, 0]
        refute_z(found.linear, turned[1, 1] / turned[0, 0], found.linear_error, degrees=DEGREES)


@pytest.mark.parametrize("name", CASES)
def test_light_is_that_of_adding_and_doubling(name):
    medium, matrix, view = CASES[name]
    found, expected = against_doubling(medium, matrix, view=view)
    assert_z(found.matrix, expected, found.standard_error, degrees=DEGREES)
    assert_z(found.linear, expected[1, 1] / expected[0, 0], found.linear_error, degrees=DEGREES)
    assert_z(found.circular, expected[3, 3] / expected[0, 0], found.circular_error, degrees=DEGREES)


def test_a_depth_off_by_a_tenth_is_caught():
    found, expected = against_doubling(slab(5), rayleigh, paths=40_000)
    other = vector_adding_doubling(5.5, rayleigh).transmitted[0, 0] / np.pi
    refute_z(found.linear, other[1, 1] / other[0, 0], found.linear_error, degrees=DEGREES)
    refute_z(found.matrix, 1.2 * expected, found.standard_error, degrees=DEGREES)


@pytest.mark.slow
def test_spheres_depolarise_by_their_own_amplitudes():
    """Of Mie theory: also of spheres whose S1 and S2 are no projector, and of small ones, which are Rayleigh's."""
    pytest.importorskip("miepython")
    sphere = sg.Mie(radius=0.1, wavelength=WAVELENGTH, refractive_index=2.2)
    found, expected = against_doubling(slab(3, sphere, "vector"), sphere_matrix(sphere), nodes=32)
    assert_z(np.diag(found.matrix), np.diag(expected), np.diag(found.standard_error), degrees=DEGREES)
    assert_z(found.linear, expected[1, 1] / expected[0, 0], found.linear_error, degrees=DEGREES)
    assert_z(found.circular, expected[3, 3] / expected[0, 0], found.circular_error, degrees=DEGREES)
    by_projector = vector_adding_doubling(3, projected(lambda cosine: sphere_matrix(sphere)(cosine)[0]), nodes=32)
    other = by_projector.transmitted[0, 0]
    refute_z(found.circular, other[3, 3] / other[0, 0], found.circular_error, degrees=DEGREES)
    small = sg.Mie(radius=1e-3, wavelength=WAVELENGTH, refractive_index=1.4)
    cosine = np.linspace(-1, 1, 7)
    np.testing.assert_allclose(abs(small.amplitude_matrix(cosine)), abs(AIR.amplitude_matrix(cosine)), atol=1e-4)


def test_amplitudes_are_those_of_miepython():
    miepython = pytest.importorskip("miepython")
    sphere = sg.Mie(radius=0.4, wavelength=WAVELENGTH, refractive_index=1.3 + 0.01j)
    cosine = np.linspace(-0.99, 0.99, 9)
    one, two = miepython.S1_S2(1.3 - 0.01j, sphere.size_parameter, cosine, norm="4pi")
    found = sphere.amplitude_matrix(cosine)
    scale = np.abs(found[0] / one).mean()
    np.testing.assert_allclose(np.abs(found), scale * np.abs([one, two]), rtol=1e-6)
    np.testing.assert_allclose(np.abs(found[1] * found[0].conj() / np.abs(found[0] * found[1]) -
                                      np.conj(two * np.conj(one) / np.abs(one * two))), 0, atol=1e-6)  # fmt: skip
    power = np.square(np.abs(found)).mean(axis=0)
    np.testing.assert_allclose(power, np.square(np.abs(sphere.amplitude(cosine))), rtol=2e-3)  # of a table


# ---- The memory effect, by the table of an independent program -------------------------------------------

AZIMUTHS = [0.0, np.pi / 2, np.pi / 4]
TABLE = {  # medium, q: co along, across and at 45 degrees, crossed the same, their standard errors
    "Rayleigh 1, 1": (slab(1), 1.0, [0.898, 0.750, 0.821], [0.448, 0.448, 0.472], 0.005, 0.005),
    "Rayleigh 1, 2.742": (slab(1), 2.742, [0.676, 0.477, 0.555], [0.058, 0.054, 0.098], 0.005, 0.005),
    "Rayleigh 5, 1.491": (slab(5), 1.491, [0.607, 0.505, 0.554], [0.455, 0.446, 0.447], 0.005, 0.005),
    "Rayleigh 5, 2.742": (slab(5), 2.742, [0.300, 0.185, 0.239], [0.127, 0.120, 0.124], 0.005, 0.005),
    "forward 10, 1.491": (slab(10, TISSUE), 1.491, [0.870, 0.807, 0.834], [0.233, 0.261, 0.266], 0.005, 0.01),
    "forward 10, 2.742": (slab(10, TISSUE), 2.742, [0.729, 0.647, 0.684], [0.043, 0.046, 0.076], 0.005, 0.01),
}


def curves(medium, q, channel, paths=40_000):
    """C_I and its error at the three azimuths."""
    found = [
        sg.memory_effect(medium, wavelength=WAVELENGTH, tilts=tilts([q]), channel=channel, azimuth=azimuth, paths=paths,
                         seed=3)
        for azimuth in AZIMUTHS
    ]  # fmt: skip
    return np.array([each.intensity[0] for each in found]), np.array([each.standard_error[0] for each in found])


@pytest.mark.parametrize("name", TABLE)
def test_it_is_not_round(name):
    medium, q, co, crossed, co_error, crossed_error = TABLE[name]
    for channel, expected, error in (("co", co, co_error), ("crossed", crossed, crossed_error)):
        found, own = curves(medium, q, channel)
        assert_z(found, expected, np.hypot(own, error), degrees=DEGREES)


def test_a_round_kernel_is_caught(monkeypatch):
    medium, q, co, crossed, error, _ = TABLE["Rayleigh 1, 1"]
    exact = bessel_even
    monkeypatch.setattr(polarised, "bessel_even", lambda x: exact(x) * np.array([1.0, 0.0, 0.0])[:, None])
    found, own = curves(medium, q, "co")
    refute_z(found, co, np.hypot(own, error), degrees=DEGREES)


def test_circular_light_is_round_and_keeps_more():
    """And is neither of the linear channels: the helicity that is kept remembers as far as the other forgets."""
    medium = slab(5, TISSUE)
    kept, own = curves(medium, 1.491, "circular", paths=10_000)
    np.testing.assert_allclose(kept, kept[0], rtol=1e-12)  # whatever the azimuth
    flipped, error = curves(medium, 1.491, "flipped", paths=10_000)
    assert kept[0] - flipped[0] > 5 * np.hypot(own[0], error[0])


@pytest.mark.slow
def test_both_ways_to_a_curve_agree():
    """By ways turned about the axis, and by the fields of every connection at every pair of light and view."""
    medium, light = slab(3), np.array([[np.sin(t), 0.0, np.cos(t)] for t in tilts([0.7, 2.0])])
    lights = np.concatenate([AXIS[None], light])
    for channel in ("none", "co", "crossed", "circular", "flipped"):
        seen = polariser(channel, 0.6)
        one = axial_curve(medium, WAVELENGTH, light[:, 0], seen, 15_000, 5, None)
        other = pair_curve(medium, WAVELENGTH, lights, lights, seen, 15_000, 6, None, reverse=False, near=False)
        error = np.hypot(one.standard_error, other.standard_error)
        assert_z(one.intensity, other.intensity, error, degrees=DEGREES)
        assert_z(one.single_share, other.single_share, 0.005)


# ---- In time ---------------------------------------------------------------------------------------------

PASSED = {"co": ([1, 1, 0, 0], [1, 1, 0, 0]), "crossed": ([1, -1, 0, 0], [1, 1, 0, 0]),
          "circular": ([1, 0, 0, 1], [1, 0, 0, 1]), "flipped": ([1, 0, 0, -1], [1, 0, 0, 1])}  # fmt: skip
"""What an analyser passes of a Stokes vector, and that of the light."""


@pytest.mark.slow
@pytest.mark.parametrize("sine", [0.0, 0.8])
def test_it_forgets_in_time_as_correlations_are_transferred(sine):
    """Each scattering takes e^(-2x (1 - cos)) off the correlation of fields: a phase matrix of a transfer equation."""
    x, depth, cosine = np.array([0.02, 0.1, 0.4]), 3.0, np.sqrt(1 - sine**2)
    medium = slab(depth, motion=sg.Brownian(diffusion=(WAVELENGTH / (2 * np.pi)) ** 2))
    lit = {channel: [] for channel in PASSED}
    for each in (0.0, *x):
        light = vector_adding_doubling(depth, lambda c, each=each: rayleigh(c) * np.exp(-2 * each * (1 - c)),
                                       views=[cosine]).transmitted[0, 0]  # fmt: skip
        for channel, (passed, sent) in PASSED.items():
            lit[channel].append(passed @ light @ sent)
    powers = {channel: np.square(each) for channel, each in lit.items()}
    powers["none"] = powers["co"] + powers["crossed"]
    exact = {name: (each / each[0])[1:] for name, each in powers.items()}
    for channel, expected in exact.items():
        found = sg.temporal_correlation(medium, wavelength=WAVELENGTH, lags=x, channel=channel,
                                        view=[sine, 0.0, cosine], paths=20_000, seed=4)  # fmt: skip
        assert_z(found.intensity, expected, found.standard_error, degrees=DEGREES)
    refute_z(found.intensity, 0.8 * exact["none"], found.standard_error, degrees=DEGREES)


@pytest.mark.parametrize("channel", ["none", "co"])
def test_layers_of_unlike_particles_lose_correlation_each_by_itself(channel):
    """Of absorbing layers, which scatter once: e^(-2x (1 - cos)) of what one sends, which moves, and all of the other.
    Light polarised along x is seen along y: across the plane of scattering, where the projector leaves 2 / (1 + cos^2)
    of the phase function. Along the axis nothing decays, and light of two scatterings is left, the albedo's share."""
    sine, (first, second), albedo, x = 0.6, (1.0, 2.0), 1e-4, np.array([0.0, 1.0, 2.5])
    cosine = np.sqrt(1 - sine**2)
    moving = sg.Brownian(diffusion=(WAVELENGTH / (2 * np.pi)) ** 2)
    made = [sg.Layer(thickness=1.0, mean_free_path=1 / first, scatterer=sg.HenyeyGreenstein(0.6), motion=moving),
            sg.Layer(thickness=3.0, mean_free_path=3 / second, scatterer=AIR)]  # fmt: skip
    made = [each.replace(albedo=albedo) for each in made]
    found = sg.temporal_correlation(sg.Layers(layers=made, polarisation="projector"), wavelength=WAVELENGTH, lags=x,
                                    channel=channel, view=[0.0, sine, cosine], paths=500_000, seed=3)  # fmt: skip
    rate, whole = 1 / cosine - 1, first + second  # of e^(-depth - (whole - depth) / cosine), as the depth grows
    hazy = henyey_greenstein(0.6)(cosine) / (4 * np.pi) * 2 / (1 + cosine**2) * np.expm1(rate * first)
    clear = 3 / (8 * np.pi) * np.exp(rate * first) * np.expm1(rate * (whole - first))
    decay = np.exp(np.outer((-2, -2.05), x * (1 - cosine)))
    exact, fast = np.square((hazy * decay + clear) / (hazy + clear))
    assert_z(found.intensity[1:], exact[1:], found.standard_error[1:], degrees=DEGREES, slack=1e-4)
    refute_z(found.intensity[1:], fast[1:], found.standard_error[1:], degrees=DEGREES, slack=1e-4)


def test_layers_of_unlike_particles_are_polarised_along_the_axis_too():
    """Ways turned about the axis and the fields of each pair, asked for by a view beside it, have the same numbers."""
    moving = sg.Brownian(diffusion=(WAVELENGTH / (2 * np.pi)) ** 2)
    made = layers([(1.0, sg.HenyeyGreenstein(0.5)), (2.0, AIR)])
    made = made.replace(layers=[each.replace(motion=moving) for each in made.layers])
    ask = {"wavelength": WAVELENGTH, "lags": [0.1, 0.4], "paths": 20_000, "channel": "crossed"}
    along = sg.temporal_correlation(made, seed=1, **ask)
    beside = sg.temporal_correlation(made, seed=2, view=[1e-6, 0.0, 1.0], **ask)
    assert_z(along.intensity, beside.intensity, np.hypot(along.standard_error, beside.standard_error), degrees=DEGREES)


def test_exposures_of_a_channel():
    """K^2 of a short exposure is that of one instant, of a long one 0; as the curve says between."""
    medium = slab(3, motion=sg.Brownian(diffusion=(WAVELENGTH / (2 * np.pi)) ** 2))
    lags = np.linspace(0, 0.4, 81)
    found = sg.temporal_correlation(medium, wavelength=WAVELENGTH, lags=lags, channel="co", paths=4000)
    u = found.lags / 0.4
    by_curve = 2 * trapezoid((1 - u) * np.square(np.abs(found.field)), u)
    assert found.contrast([0.4]).squared[0] == pytest.approx(by_curve, rel=0.02)  # bias of a square, and of 81 points


def test_light_sent_back_has_the_signs_of_textbooks_in_a_travelling_frame():
    """Once scattered by Rayleigh's particles: Bohren and Huffman (1983), Eq. 5.4, Q along the plane of scattering."""
    thin = sg.Slab(thickness=1.0, mean_free_path=100.0, albedo=1e-4, scatterer=AIR, polarisation="vector")
    sine, cosine = 0.6, -0.8
    expected = np.diag([1 + cosine**2, 1 + cosine**2, 2 * cosine, 2 * cosine]) / (1 + cosine**2)
    expected[0, 1] = expected[1, 0] = (cosine**2 - 1) / (1 + cosine**2)
    ask = {"wavelength": WAVELENGTH, "mode": "reflection", "view": [sine, 0.0, cosine], "paths": 2000}
    travelling = sg.mueller_matrix(thin, frame="travelling", **ask)
    fixed = sg.mueller_matrix(thin, **ask)
    np.testing.assert_allclose(travelling.matrix / travelling.matrix[0, 0], expected, atol=2e-4)
    np.testing.assert_array_equal(travelling.matrix, HANDS @ fixed.matrix)
    assert (travelling.circular, fixed.frame) == (-fixed.circular, "laboratory")
    ahead = ask | {"mode": "transmission", "view": None}
    one, other = (sg.mueller_matrix(thin, frame=frame, **ahead) for frame in ("laboratory", "travelling"))
    np.testing.assert_array_equal(one.matrix, other.matrix)
    with pytest.raises(sg.RuleError, match='mueller_matrix frame must be one of "laboratory", "travelling"'):
        sg.mueller_matrix(thin, frame="fixed", **ask)


def test_of_what_changes_nothing_the_intensity_is_that_of_malus():
    """Of the matrix 1: |a^+ e|^2 of any field e behind an analyser that passes a, and |e|^2 without one."""
    nothing = sg.MuellerMatrix(np.eye(4), np.zeros((4, 4)), 1.0, 0.0, 1.0, 0.0, 1, False)  # noqa: FBT003
    for light, seen in ([1, 0], [0.6, 0.8]), ([1, 1j], [0.6, 0.8j]), ([0.3, 0.5j], [1, 1]):
        field, passed = np.array(light), np.array(seen)
        assert nothing.intensity(field) == pytest.approx(np.vdot(field, field).real)
        assert nothing.intensity(field, passed) == pytest.approx(abs(np.vdot(passed, field)) ** 2)


def test_a_while_later_each_connection_has_lost_by_its_momentum_transfer():
    """e^(-2 x Y), of three connections in three batches."""
    radius, transfer = np.array([0.0, 2.0, 5.0]), np.array([0.0, 0.3, 2.0])
    light = polarised.AxialLight(radius, np.ones((1, 1, 3, 3)), np.arange(3), 3, 0.0, transfer)
    for q in (0.0, 0.4):
        left = light.sums(q, 0.7) / light.sums(q)
        np.testing.assert_allclose(left.ravel(), np.exp(-2 * 0.7 * transfer), rtol=1e-12)


# ---- Coherent backscattering ----------------------------------------------------------------------------
# ---- What is refused ------------------------------------------------------------------------------------

MOVING = sg.Brownian(diffusion=1.0)
REFUSED = {
    "a lobe without S1, S2": (lambda: slab(1, TISSUE, "vector"), 'Slab.polarisation must be "scalar" or "projector"'),
    "walls": (lambda: slab(1, faces=sg.Faces(inside=1.33, wall=1.52)), "Slab.faces must be without a wall"),
    "faces of layers": (
        lambda: sg.Layers(faces=sg.Faces(inside=1.33), polarisation="projector", layers=[
            sg.Layer(thickness=1.0, mean_free_path=length, scatterer=AIR) for length in (1.0, 2.0)]),
        "Layers.faces must be of one index"),
    "steps between layers": (
        lambda: sg.Layers(polarisation="projector", layers=[
            sg.Layer(thickness=1.0, mean_free_path=1.0, scatterer=AIR, index=index) for index in (1.0, 1.33)]),
        "Layers.layers must be of one index"),
    "layers without S1, S2": (lambda: layers(((1.0, AIR), (1.0, TISSUE)), "vector"), "Layers.polarisation must be"),
    "flows": (lambda: slab(1, motion=sg.Drift(velocity=(1.0, 0.0, 0.0))), "Slab.motion must be random"),
    "S1 of a lobe": (lambda: TISSUE.amplitude_matrix(1.0), "HenyeyGreenstein.amplitude_matrix"),
    "an exposure without an analyser": (
        lambda: sg.temporal_correlation(slab(1, motion=MOVING), wavelength=0.5, lags=[0.0],
                                        paths=100).contrast([1.0]), "contrast channel"),
    "tilt and shift": (lambda: sg.joint_correlation(slab(1), wavelength=0.5, tilts=[0], shifts=[0]), "polarisation"),
    "shares": (lambda: sg.reflectance_transmittance(slab(1)), "polarisation"),
    "screens": (lambda: sg.stack_like(slab(1), wavelength=0.5, screens=3), "polarisation"),
    "advice": (lambda: sg.advise(slab(5, TISSUE), wavelength=0.5), "polarisation"),
    "a scene": (
        lambda: sg.Scene(wavelength=0.5, medium=slab(1), illumination=sg.CollimatedBeams.tilts([0.0], width=9e3),
                         sensor=sg.FarField.grid((4, 4), 1e-5)), "Scene.polarisers must be given"),
    "an analyser before scalar light": (
        lambda: sg.memory_effect(slab(1, polarisation="scalar"), wavelength=0.5, tilts=[0], channel="co"), "channel"),
    "an unknown analyser": (
        lambda: sg.memory_effect(slab(1), wavelength=0.5, tilts=[0], channel="elliptic"), "channel"),
    "the matrix of scalar light": (
        lambda: sg.mueller_matrix(slab(1, polarisation="scalar"), wavelength=0.5), "mueller_matrix medium"),
}  # fmt: skip


@pytest.mark.slow
def test_a_channel_is_enhanced_as_the_literature_has_it():
    """Rayleigh slab of depth 40, by an independent program (.001 each); light of kept helicity exactly twice."""
    channels = {"co": ([1, 0], [1, 0], 1.742), "crossed": ([1, 0], [0, 1], 1.129),
                "kept helicity": ([1, 1j], [1, -1j], 2.0), "flipped helicity": ([1, 1j], [1, 1j], 1.262)}  # fmt: skip
    fields = [np.array(each[:2]) / np.linalg.norm(each[:2], axis=1, keepdims=True) for each in channels.values()]
    medium, runs = slab(40), 10
    lit = np.array([
        [[found.intensity(*each) for each in fields]
         for found in (mueller._estimate(medium, WAVELENGTH, -AXIS, 1000, seed, None, way) for seed in range(runs))]
        for way in (True, False)
    ])  # fmt: skip
    mean, spread = lit.mean(axis=1), lit.std(axis=1, ddof=1) / np.sqrt(runs)
    expected = np.array([each[2] for each in channels.values()])
    error = expected * np.hypot(*(spread / mean))
    assert_z(mean[0] / mean[1], expected, np.hypot(error, 0.001), degrees=runs - 1)
    assert error.max() < 0.08


@pytest.mark.parametrize("name", REFUSED)
def test_what_is_not_known_is_refused(name):
    call, told = REFUSED[name]
    assert_refused(call, told)
