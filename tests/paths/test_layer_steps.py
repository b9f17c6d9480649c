"""Layers of different refractive indices: published figures, a literal walk, slabs behind faces, and what must hold."""

import numpy as np
import pytest
from references.layered_walk import BATCHES, walk_layers
from refusals import assert_refused
from zscore import assert_mean, assert_z, refute_z

import specklegen as sg
from specklegen.core.statistics import jackknife
from specklegen.kernels import analog_walk as kernels
from specklegen.kernels import refraction
from specklegen.kernels.fresnel import fresnel
from specklegen.memory_effects.oblique import estimate_oblique_correlation
from specklegen.paths import analog_walk
from specklegen.paths.analog_walk import axial_light
from specklegen.paths.steps import optics, unscattered
from specklegen.scene.layers import merged

AXIS = np.array([0.0, 0.0, 1.0])
UPPER = sg.Layer(thickness=1.0, mean_free_path=0.5, scatterer=sg.HenyeyGreenstein(0.6), index=1.5)
LOWER = sg.Layer(thickness=1.0, mean_free_path=0.4, albedo=0.95, scatterer=sg.Isotropic(), index=1.2)
TWO = sg.Layers([UPPER, LOWER])
SLAB = sg.Slab(thickness=2.0, mean_free_path=0.5, albedo=0.95, scatterer=sg.HenyeyGreenstein(0.6),
               faces=sg.Faces(inside=1.5))  # fmt: skip


def described(medium: sg.Layers) -> list[tuple[float, ...]]:
    """Layers as the literal walk reads them."""
    found = optics(medium).indices
    return [
        (layer.thickness, layer.mean_free_path, layer.albedo, layer.scatterer.mean_cosine(), index)
        for layer, index in zip(merged(medium.layers), found, strict=True)
    ]


def in_layers(slab: sg.Slab, parts: int, **other) -> list[sg.Layer]:
    """A slab in layers that differ by next to nothing, so that no two are made one."""
    return [
        sg.Layer(thickness=slab.thickness / parts, mean_free_path=slab.mean_free_path * (1 + 1e-9 * (n % 2)),
                 albedo=slab.albedo, scatterer=slab.scatterer, motion=slab.motion, **other)
        for n in range(parts)
    ]  # fmt: skip


def assert_same_light(one, other):
    """Reflectance, transmittance and absorptance of two media, from paths of different seeds."""
    for name in ("reflectance", "transmittance", "absorptance"):
        error = np.hypot(getattr(one, f"{name}_error"), getattr(other, f"{name}_error"))
        assert_z(getattr(one, name), getattr(other, name), error)


def test_two_layers_are_those_of_mcml():
    """Template of MCML, its first run, as the manual prints it: diffuse reflectance .1050; 1e8 cm stand for no end."""
    layers = [
        sg.Layer(thickness=d, mean_free_path=1 / (a + s), albedo=s / (a + s), scatterer=sg.HenyeyGreenstein(g), index=n)
        for d, a, s, g, n in ((0.01, 20, 200, 0.7, 1.3), (1e8, 10, 200, 0.9, 1.4))
    ]
    found = sg.reflectance_transmittance(sg.Layers(layers), paths=100_000, seed=1)
    entrance = (0.3 / 2.3) ** 2
    assert_z(found.reflectance - entrance, 0.1050, found.reflectance_error, slack=5e-5)
    other = sg.reflectance_transmittance(
        sg.Layers([layers[0].replace(index=1.5), layers[1]]), paths=200_000, seed=1
    )  # MCML's own index is told from one that is 0.2 off
    refute_z(other.reflectance - 0.04, 0.1050, other.reflectance_error, slack=5e-5)


@pytest.mark.parametrize("medium", [TWO, sg.Layers(TWO.layers[::-1]), sg.Layers([UPPER, LOWER, UPPER])])
def test_reflectance_and_transmittance_are_those_of_a_literal_walk(medium):
    found = sg.reflectance_transmittance(medium, paths=40_000, seed=2)
    literal = walk_layers(described(medium), paths=64 * 500, seed=3)
    reflected, transmitted = literal.specular + literal.reflected, literal.transmitted
    for name, batches in (("reflectance", reflected), ("transmittance", transmitted)):
        error = np.hypot(batches.std(ddof=1) / 8, getattr(found, f"{name}_error"))
        assert_z(getattr(found, name), batches.mean(), error, degrees=BATCHES - 1)


@pytest.mark.parametrize("parts", [2, 5])
def test_a_slab_in_equal_layers_is_the_slab(parts):
    slab = sg.reflectance_transmittance(SLAB, angle=0.5, paths=20_000, seed=4)
    found = sg.reflectance_transmittance(sg.Layers(in_layers(SLAB, parts, index=1.5)), angle=0.5, paths=20_000, seed=5)
    assert_same_light(found, slab)
    assert (found.specular, found.ballistic) == pytest.approx((slab.specular, slab.ballistic), rel=1e-7)


def test_a_layer_between_two_of_the_index_outside_is_a_slab_behind_faces():
    """And two clear ones before it, of an index between: their faces are those of a thin plate, a wall."""
    clear = sg.Layer(thickness=1.0, mean_free_path=1e9, scatterer=sg.Isotropic(), index=1.0)
    (layer,) = in_layers(SLAB, 1, index=1.5)
    found = sg.reflectance_transmittance(sg.Layers([clear, layer, clear]), angle=0.5, paths=40_000, seed=6)
    assert_same_light(found, sg.reflectance_transmittance(SLAB, angle=0.5, paths=40_000, seed=7))
    wall = clear.replace(index=1.8)
    found = sg.reflectance_transmittance(sg.Layers([wall, layer, wall]), paths=40_000, seed=8)
    behind = SLAB.replace(faces=sg.Faces(inside=1.5, wall=1.8))
    assert_same_light(found, sg.reflectance_transmittance(behind, paths=40_000, seed=9))


def test_light_beyond_the_critical_angle_does_not_leave_a_layer():
    """Behind a black layer of index 1 light is as lost as outside; and it enters no layer thinner than its angle."""
    (layer,) = in_layers(SLAB, 1, index=1.5)
    black = sg.Layer(thickness=1.0, mean_free_path=1e-3, albedo=0.0, scatterer=sg.Isotropic(), index=1.0)
    found = sg.reflectance_transmittance(sg.Layers([layer, black]), paths=40_000, seed=10)
    slab = sg.reflectance_transmittance(SLAB, paths=40_000, seed=11)
    assert found.transmittance == 0.0
    assert_z(found.reflectance, slab.reflectance, np.hypot(found.reflectance_error, slab.reflectance_error))
    oil = sg.Faces(outside=1.5)
    beyond = sg.Layers([layer, layer.replace(index=1.2)], faces=oil)
    assert sg.reflectance_transmittance(beyond, angle=1.0, paths=64).ballistic == 0.0
    assert sg.reflectance_transmittance(beyond, angle=0.9, paths=64).ballistic > 0.0
    assert sg.reflectance_transmittance(sg.Layers([black], faces=oil), angle=1.0, paths=64).reflectance == 1.0


@pytest.mark.parametrize("angle", [0.0, 0.9])
def test_no_light_is_lost(angle):
    """All of it leaves where nothing absorbs; what goes straight through is the share of paths that a sum foretells."""
    bright = sg.Layers([UPPER, LOWER.replace(albedo=1.0), UPPER.replace(index=1.0)])
    found = sg.reflectance_transmittance(bright, angle=angle, paths=4000)
    assert found.reflectance + found.transmittance == pytest.approx(1.0, abs=1e-12)
    thin = sg.Layers([layer.replace(thickness=0.3) for layer in bright.layers])
    back, through = unscattered(optics(thin), np.sin(angle))
    sine, paths = np.sin(angle) / 1.5, 40_000
    exits = analog_walk.walk(thin, np.array([sine, 0.0, np.sqrt(1 - sine**2)]), paths, 12)
    outside = np.array([np.cos(angle), np.sqrt(1 - sine**2)])
    entrance = np.mean(fresnel(outside[1], 1.5, 1.0))
    shares = (1 - entrance) * np.array([exits.straight(face).mean() for face in (kernels.FAR, kernels.ENTRANCE)])
    exact = np.array([through, back - entrance])
    assert_z(shares, exact, np.sqrt(exact / paths))


def test_what_is_absorbed_is_the_work_of_the_albedo():
    """R + T + A = 1 with A added up by itself: of light that collides n times all but the albedo^n is absorbed."""
    medium = sg.Layers([UPPER.replace(albedo=0.9), LOWER.replace(albedo=0.9)])
    bright = sg.Layers([layer.replace(albedo=1.0) for layer in medium.layers])
    found = sg.reflectance_transmittance(medium, paths=40_000, seed=13)
    collisions = analog_walk.walk(bright, AXIS, 40_000, 14).collisions
    absorbed = (1 - 0.04) * (1 - 0.9**collisions)
    total = found.reflectance + found.transmittance + absorbed.mean()
    assert_z(total, 1.0, np.hypot(found.absorptance_error, absorbed.std() / 200))


def test_reflecting_nothing_between_layers_is_caught(monkeypatch):
    """The kernel's own source, without the reflections at interior faces."""
    medium = sg.Layers([UPPER.replace(index=1.0), LOWER.replace(index=2.0)])
    literal = walk_layers(described(medium), paths=64 * 500, seed=3)
    monkeypatch.setattr(analog_walk.analog_walk, "walk_analog", kernels.walk_analog.py_func)
    monkeypatch.setattr(kernels, "fly_layers", refraction.fly_layers.py_func)

    def compared():
        found = sg.reflectance_transmittance(medium, paths=1500, seed=15)
        expected = literal.specular + literal.reflected.mean()
        assert_z(found.reflectance, expected, found.reflectance_error)

    compared()
    monkeypatch.setattr(refraction, "fresnel", lambda mu, before, behind: (0.0, 0.0))
    with pytest.raises(AssertionError, match="z ="):
        compared()


def correlation(sums: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """K and its error from the literal walk's sums."""
    return jackknife(sums, lambda total: total[1:] / total[0])


@pytest.mark.parametrize("medium", [
    TWO, sg.Layers([UPPER, LOWER, UPPER.replace(index=1.0)]),
    sg.Layers([layer.replace(index=None) for layer in TWO.layers], faces=sg.Faces(inside=1.4)),
])  # fmt: skip
def test_the_memory_effect_is_that_of_a_literal_walk(medium):
    q = np.array([0.3, 0.8, 2.0])
    sums = walk_layers(described(medium), paths=64 * 1000, seed=16).sums(q)
    literal, spread = correlation(sums)
    wavelength = 0.005
    curve = sg.memory_effect(medium, wavelength=wavelength, tilts=np.arcsin(q * wavelength / (2 * np.pi)),
                             paths=64 * 1000, threads=1)  # fmt: skip
    error = np.hypot(spread, curve.standard_error / (2 * np.abs(curve.field)))
    assert_z(curve.field.real, literal, error, degrees=BATCHES - 1)
    light = axial_light(medium, 64 * 1000, 17)
    batches = light.weight.reshape(BATCHES, -1).mean(axis=1) - sums[:, 0] / 1000
    assert_mean(batches, 0.0)
    matched = sg.Layers([layer.replace(index=None) for layer in medium.layers])
    other = sg.memory_effect(matched, wavelength=wavelength, tilts=curve.tilts, paths=64 * 1000, threads=1)
    refute_z(other.field.real, literal, error, degrees=BATCHES - 1)  # no step at all


def test_light_along_the_axis_is_that_of_the_densities_and_the_same_either_way():
    light, back = (axial_light(sg.Layers(TWO.layers[::n]), 100_000, 18 + n).weight for n in (1, -1))
    errors = [each.std() / np.sqrt(100_000) for each in (light, back)]
    assert_z(light.mean(), back.mean(), np.hypot(*errors))  # reciprocity
    narrow = sg.reflectance_transmittance(TWO, angles=[0.0, 0.15, np.pi / 2], paths=200_000, seed=20)
    # Within 0.15 the density is that of the axis but for its square over 2.
    assert_z(narrow.transmitted[0], light.mean(), np.hypot(narrow.transmitted_error[0], errors[0]), slack=0.01)


def test_what_layers_that_refract_do_not_serve_is_refused():
    ask = {"wavelength": 0.01, "paths": 64}
    assert_refused(lambda: UPPER.replace(index=11.0), r"Layer.index must be a refractive index between 0.1 and 10")
    focused = sg.light.FocusedBeams([[0.0, 0.0, 10.0]], waist=4.0)
    with pytest.raises(sg.RuleError, match=r"Layers.layers must be of one index, for focused beams"):
        sg.Scene(wavelength=0.5, medium=TWO, illumination=focused, sensor=sg.FarField.grid((2, 2), 1e-3))
    with pytest.raises(sg.RuleError, match="light and view must be along the axis for layers that refract"):
        estimate_oblique_correlation(TWO, AXIS, np.array([0.6, 0.0, 0.8]), 64, 0)
    moving = [layer.replace(motion=sg.Brownian(diffusion=1.0)) for layer in TWO.layers]
    two, verb, ask = TWO.replace(layers=tuple(moving)), sg.temporal_correlation, ask | {"lags": [0.0]}
    with pytest.raises(sg.RuleError, match=r'temporal_correlation mode must be "transmission" for layers that refract'):
        verb(two, tilts=[0.0], mode="reflection", **ask)
    with pytest.raises(sg.RuleError, match=r"temporal_correlation view must be left out for layers that refract"):
        verb(two, tilts=[0.0], view=[0.1, 0.0, np.sqrt(0.99)], **ask)
    assert_refused(lambda: verb(two, tilts=[0.0], reverse=True, **ask), r"temporal_correlation reverse must be False")
    with pytest.raises(sg.RuleError, match=r"temporal_correlation tilts must be at most 0.0.* for layers that refract"):
        verb(two, tilts=[0.5], **(ask | {"wavelength": 0.0001}))
