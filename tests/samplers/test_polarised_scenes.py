"""Scenes of polarised light: covariance and path sums against each other, mean intensities and memory effects."""

import numpy as np
import pytest
from refusals import assert_refused
from scenes import slab as slab_of_depth
from zscore import assert_z, refute_z

import specklegen as sg
from specklegen.paths.endpoint_factors import multiple_amplitudes, single_amplitudes
from specklegen.paths.jones import connection_matrices
from specklegen.paths.tracer import slab_tracer
from specklegen.samplers.path_sums.direct import direct_field, path_phases

WAVELENGTH, WIDTH, THICKNESS = 0.5, 40_000.0, 1000.0
PARALLEL, CROSSED = sg.Polarisers.parallel(), sg.Polarisers.crossed()


def slab(depth=2.0, polarisation="projector", scatterer=None):
    scatterer = scatterer or sg.Rayleigh()
    return slab_of_depth(depth, thickness=THICKNESS).replace(scatterer=scatterer, polarisation=polarisation)


def scene(polarisers=PARALLEL, medium=None, tilts=(0.0,), sensor=None):
    light = sg.CollimatedBeams.tilts(list(tilts), width=WIDTH)
    sensor = sensor or sg.FarField.grid((1, 1), 1e-6)
    return sg.Scene(wavelength=WAVELENGTH, medium=medium or slab(), illumination=light, sensor=sensor,
                    polarisers=polarisers)  # fmt: skip


def test_intensities_are_those_of_the_mueller_matrix():
    """Linear and circular light, through wave plates and analysers of any kind, on the axis."""
    medium = slab(polarisation="vector")
    light = sg.mueller_matrix(medium, wavelength=WAVELENGTH, paths=20_000, seed=1)
    plate = np.array([[1, 0], [0, 1j]])
    for polarisers in (PARALLEL, CROSSED, sg.Polarisers.circular(), sg.Polarisers.parallel(0.6).behind(plate)):
        found = sg.covariance(scene(polarisers, medium), paths=10_000, seed=2)
        expected = light.intensity(*polarisers.fields) * WIDTH**2
        error = np.hypot(found.standard_error[0, 0, 0, 0], light.standard_error[0, 0] * WIDTH**2)
        assert_z(found.intensity[0, 0], expected, error, degrees=63)
    refute_z(found.intensity[0, 0], light.intensity(*CROSSED.fields) * WIDTH**2, error, degrees=63)


HALF = sg.Layer(thickness=THICKNESS / 2, mean_free_path=THICKNESS / 2, scatterer=sg.Rayleigh())
MEDIA = {
    "faces": slab(polarisation="vector").replace(faces=sg.Faces(inside=1.5)),
    "layers": sg.Layers(layers=[HALF, HALF.replace(scatterer=sg.HenyeyGreenstein(0.5))], polarisation="projector"),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", MEDIA)
def test_scenes_of_faces_and_layers_have_their_intensities(name):
    """By covariances, 20 degrees aside of the axis too, and by pictures of the stationary sampler."""
    medium = MEDIA[name]
    aside = np.array([0.3, 0.15, np.sqrt(1 - 0.1125)])
    for view in (None, aside):
        light = sg.mueller_matrix(medium, wavelength=WAVELENGTH, view=view, paths=15_000, seed=1)
        sensor = None if view is None else sg.FarField(directions=[view])
        for polarisers in (sg.Polarisers.parallel(0.6), sg.Polarisers.circular()):
            found = sg.covariance(scene(polarisers, medium, sensor=sensor), paths=8000, seed=2)
            expected = light.intensity(*polarisers.fields) * WIDTH**2
            error = np.hypot(np.ravel(found.standard_error)[0], light.standard_error[0, 0] * WIDTH**2)
            assert_z(np.ravel(found.intensity)[0], expected, error, degrees=63)
        if view is None:
            refute_z(np.ravel(found.intensity)[0], light.intensity(*CROSSED.fields) * WIDTH**2, error, degrees=63)
            seen = scene(sg.Polarisers.circular(), medium, sensor=sg.FarField.grid((24, 24), 1e-6))
            drawn = sg.render(seen, sampler="stationary", realizations=40, paths=15_000, seed=3).intensity
            lit = drawn.astype(np.float64).mean(axis=(1, 2, 3))
            expected = light.intensity(*seen.polarisers.fields) * WIDTH**2
            error = np.hypot(lit.std(ddof=1) / np.sqrt(40), 1.5 * light.standard_error[0, 0] * WIDTH**2)
            assert_z(lit.mean(), expected, error, degrees=39)


def test_correlations_are_those_of_the_memory_effect():
    tilt = float(np.arcsin(1.5 * WAVELENGTH / (2 * np.pi * THICKNESS)))
    sensor = sg.FarField(directions=[[0.0, 0.0, 1.0], [np.sin(tilt), 0.0, np.cos(tilt)]])
    for turned in (0.0, np.pi / 2):
        for polarisers, channel in ((sg.Polarisers.parallel(turned), "co"), (sg.Polarisers.crossed(turned), "crossed")):
            seen = scene(polarisers, tilts=(0.0, tilt), sensor=sensor)
            found = sg.covariance(seen, paths=10_000, seed=3, pairs=[[0, 0, 1, 1], [0, 0, 0, 0], [1, 1, 1, 1]])
            value, error = found.value, found.standard_error
            curve = sg.memory_effect(slab(), wavelength=WAVELENGTH, tilts=[tilt], channel=channel, azimuth=turned,
                                     paths=20_000, seed=4)  # fmt: skip
            squared = abs(value[0]) ** 2 / abs(value[1] * value[2])
            relative = 2 * (error[0] / abs(value[0])) + error[1] / abs(value[1]) + error[2] / abs(value[2])
            assert_z(squared, curve.intensity, np.hypot(curve.standard_error, squared * relative), degrees=63)


@pytest.mark.parametrize("reverse", [False, True])
def test_the_sum_of_paths_is_that_of_their_amplitudes(reverse):
    """The field by products of matrices is the sum of what covariances are made of, to rounding."""
    views = [[0.0, 0.0, 1.0], [0.3, 0.4, np.sqrt(0.75)], [0.05, 0.1, -np.sqrt(0.9875)]]
    sensor = sg.FarField(directions=views)
    some = scene(sg.Polarisers.circular(), tilts=(0.0, 0.01), sensor=sensor, medium=slab(polarisation="vector"))
    tracer = slab_tracer(some, reverse)
    bank = tracer.trace(1, 60)
    phases = path_phases(tracer, bank, 1, 0, reverse)
    found = direct_field(tracer.layout, bank, phases)
    once = bank.orders == 1
    ones = single_amplitudes(tracer.layout, bank.single) @ phases[0][once]
    many = multiple_amplitudes(tracer.layout, bank.multiple, bidirectional=reverse, reverse=reverse) @ phases[0][~once]
    np.testing.assert_allclose(found.ravel(), (ones + many) / np.sqrt(60), atol=1e-11 * np.abs(found).max())
    # What a connection passes through the analyser is that of its matrix.
    polarised, often = tracer.layout.polarised, bank.multiple
    into, out = polarised.arriving(often, some.lights), polarised.passing(often, some.views)
    for t, light in enumerate(some.lights):
        for v, view in enumerate(some.views):
            matrices = connection_matrices(polarised.ends, often, light, view)
            passed = polarised.analyser.conj() @ (matrices @ polarised.light).T
            np.testing.assert_allclose((into[:, t] * out[:, v]).sum(axis=0), passed, atol=1e-12)


def test_rendered_light_is_that_of_the_covariance():
    grid = sg.FarField.grid((12, 12), WAVELENGTH / WIDTH / 2)
    for polarisers in (PARALLEL, CROSSED):
        asked = scene(polarisers, sensor=grid)
        plan = sg.plan(asked, sampler="paths")
        assert (plan.sampler, plan.summation) == ("paths", "direct")
        stack = sg.render(asked, paths=1500, realizations=12, seed=5, sampler="paths")
        lit = stack.intensity.mean(axis=(1, 2, 3))
        expected = sg.covariance(scene(polarisers), paths=10_000, seed=6)
        error = np.hypot(lit.std(ddof=1) / np.sqrt(12), expected.standard_error[0, 0, 0, 0])
        assert_z(lit.mean(), expected.intensity[0, 0], error, degrees=11)
        mean = sg.mean_field(asked)
        scalar = sg.mean_field(scene(None, slab(polarisation="scalar"), sensor=grid))
        np.testing.assert_allclose(mean, (polarisers is PARALLEL) * scalar, atol=1e-12 * np.abs(scalar).max())


def test_a_seed_is_one_medium_behind_any_analyser():
    """So fields are linear in light and analyser, realization by realization, to the rounding of single precision."""
    grid = sg.FarField.grid((4, 4), WAVELENGTH / WIDTH / 2)

    def field(light, analyser):
        polarisers = sg.Polarisers(light=light, analyser=analyser)
        return sg.render(scene(polarisers, sensor=grid), paths=400, realizations=2, seed=5, sampler="paths").field

    co, crossed, both = field([1, 0], [1, 0]), field([1, 0], [0, 1]), field([1, 0], [1, 1j])
    np.testing.assert_allclose(both, (co - 1j * crossed) / np.sqrt(2), atol=1e-5 * np.abs(co).max())
    turned = field([1, 1], [1, 0])
    np.testing.assert_allclose(turned, (co + field([0, 1], [1, 0])) / np.sqrt(2), atol=1e-5 * np.abs(co).max())


REFUSED = {
    "no analyser": (lambda: scene(None), "Scene.polarisers must be given"),
    "scalar light": (lambda: scene(medium=slab(polarisation="scalar")), "Scene.polarisers must be left out"),
    "a near sensor": (lambda: scene(sensor=sg.NearField(points=[[0.0, 0.0, 2000.0]])), "Scene.sensor must be a far"),
    "coherent modes": (lambda: sg.transmission_matrix(scene()), "transmission_matrix scene"),
    "a dark light": (lambda: sg.Polarisers(light=[0, 0]), "Polarisers.light must be two numbers"),
}  # fmt: skip


@pytest.mark.parametrize("name", REFUSED)
def test_what_is_not_known_is_refused(name):
    call, told = REFUSED[name]
    assert_refused(call, told)
