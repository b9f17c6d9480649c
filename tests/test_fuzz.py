"""Random scenes and recipes, valid and not: no crash, no NaN, no warning, no nonsense; a refusal names the field.

FUZZ_SEED=3 pytest -m slow tests/test_fuzz.py     # 11 700 others with each seed
"""

import json
import os
import warnings
from contextlib import contextmanager

import numpy as np
import pytest
from hypothesis import HealthCheck, given, seed, settings
from hypothesis import strategies as st
from random_recipes import recipe_tables
from random_scenes import directions, faced_scenes, powers, scenes, screen_scenes, slabs, wavelengths
from zscore import limit

import specklegen as sg
from specklegen.coherence import (
    coherent_modes,
    gaussian_schell_model,
    intensity_from_modes,
    propagate_csd,
    speckle_contrast,
    spectral_degree_of_coherence,
    spectral_density,
)
from specklegen.core.errors import RuleError
from specklegen.datasets.recipes.registry import KINDS
from specklegen.wavetracing import aperture_transform, gaussian_mass

SEED = os.environ.get("FUZZ_SEED")


def examples(count: int):
    """Settings of a property: the same examples at every run, or those of a seed."""
    chosen = settings(max_examples=count, derandomize=SEED is None, deadline=None, database=None,
                      suppress_health_check=[HealthCheck.too_slow, HealthCheck.data_too_large])  # fmt: skip
    return chosen if SEED is None else lambda check: seed(int(SEED))(chosen(check))


def few_and_many(few: int, many: int):
    """Parametrise a test's number of examples: few by default, many under ``slow``."""
    return pytest.mark.parametrize("count", [few, pytest.param(many, marks=pytest.mark.slow)])


@contextmanager
def strict():
    """Every warning is an error, but that the mean free path may be below the wavelength."""
    with warnings.catch_warnings(), np.errstate(divide="raise", over="raise", invalid="raise"):
        warnings.simplefilter("error")
        warnings.simplefilter("ignore", sg.DoubtWarning)
        yield


ABSORBED = "enough that light crosses the absorbing"
GOT = ("; got ",)  # any reason in the house's words
DIM = "Scene intensity must be between"  # what float32 holds


def result_or_refusal(words: tuple[str, ...], call):
    """What a call returns, or None where it is refused for a reason that holds one of some words."""
    try:
        return call()
    except RuleError as refused:
        if not any(word in str(refused) for word in words):
            raise
        return None


def assert_sensible(scene: sg.Scene, found: sg.results.Covariance) -> None:
    t, v = len(scene.lights), len(scene.views)
    assert found.value.shape == found.standard_error.shape == (t, v, t, v)
    for array in (found.value, found.single, found.multiple, found.standard_error):
        assert np.isfinite(array).all()
    matrix = found.value.reshape(t * v, t * v)
    assert np.array_equal(matrix, matrix.conj().T)
    assert (matrix.diagonal().real >= 0).all()
    assert (found.standard_error >= 0).all()
    if matrix.size:
        # Rounding of a sum of outer products: far below the largest eigenvalue, at most the trace.
        assert np.linalg.eigvalsh(matrix).min() >= -1e-12 * max(matrix.trace().real, 1e-300)


# ---- Valid scenes --------------------------------------------------------------------------------------
@few_and_many(16, 1000)
def test_any_scene_has_a_covariance_a_plan_and_an_image(count):
    @examples(count)
    @given(scene=scenes(), seed=st.integers(0, 2**32), reverse=st.sampled_from([True, False, "auto"]))
    def check(scene, seed, reverse):
        with strict():
            found = result_or_refusal((ABSORBED,),
                                      lambda: sg.statistics.covariance(scene, paths=64, seed=seed, reverse=reverse))
            if found is not None:
                assert_sensible(scene, found)
            plan = result_or_refusal((ABSORBED, DIM), lambda: sg.plan(scene, paths=16, reverse=reverse))
            if plan is not None:
                assert np.isfinite([plan.seconds, plan.expected_error, plan.memory_bytes]).all()
                doubtful = scene.medium.mean_free_path < scene.wavelength
                assert ("below the wavelength" in plan.explain()) == doubtful
            stack = result_or_refusal((ABSORBED, DIM), lambda: sg.render(scene, paths=16, seed=seed, reverse=reverse))
        if stack is None:
            return
        assert plan is not None, "what a plan refuses is not rendered"
        assert stack.field.shape == (len(scene.lights), *scene.sensor.shape)
        assert np.isfinite(stack.field).all()
        assert (stack.intensity >= 0).all()

    check()


@few_and_many(16, 500)
def test_the_mean_field_is_finite_or_refused(count):
    @examples(count)
    @given(scene=scenes())
    def check(scene):
        with strict():
            mean = result_or_refusal(("mean_field",), lambda: sg.statistics.mean_field(scene))
        if mean is None:
            return
        assert mean.shape == (len(scene.lights), *scene.sensor.shape)
        assert np.isfinite(mean).all()

    check()


@few_and_many(10, 300)
def test_any_unit_of_length_gives_the_same_light(count):
    """All lengths times a power of two: the same paths, to rounding; C is an area, a ratio, or one over an area."""

    @examples(count)
    @given(scene=scenes(), power=st.integers(-20, 20), seed=st.integers(0, 99))
    def check(scene, power, seed):
        s = 2.0**power
        medium = scene.medium
        if isinstance(medium, sg.Slab):
            scaled = medium.replace(thickness=s * medium.thickness, mean_free_path=s * medium.mean_free_path)
        else:
            scaled = medium.replace(lower=s * medium.lower, upper=s * medium.upper)
            if isinstance(medium, sg.media.Box):
                scaled = scaled.replace(mean_free_path=s * medium.mean_free_path)
            else:
                scaled = scaled.replace(extinction=medium.extinction / s)
        light, sensor, order = scene.illumination, scene.sensor, 0
        if isinstance(light, sg.light.PointSources):
            light, order = light.replace(points=s * light.points), -1
        elif isinstance(light, sg.light.CollimatedBeams):
            light = light.replace(width=s * light.width)
        if isinstance(sensor, sg.sensors.NearField):
            sensor = sensor.replace(points=s * sensor.points)
        else:
            order += 1
        other = sg.Scene(wavelength=s * scene.wavelength, medium=scaled, illumination=light, sensor=sensor)
        # Pilots are keyed by the scene in wavelengths: they find the same of both.
        with strict():
            one, two = (
                result_or_refusal(
                    (ABSORBED,),
                    lambda of=each: sg.statistics.covariance(of, paths=16, seed=seed, reverse=False,
                                                             orders="all").value,
                )
                for each in (scene, other)
            )
        assert (one is None) == (two is None)
        if one is None or two is None:
            return
        two = two / s ** (order * (scene.dimension - 1))
        # Phases of up to 1e9 turns (a beam of 1e4 wavelengths at 1e-3 of grazing in a slab of 1e7) carry 1e-7.
        # Of light as faint as 1e-300 floats lose digits.
        assert np.abs(two - one).max(initial=0.0) <= 1e-6 * np.abs(one).max(initial=0.0) + 1e-306

    check()


@few_and_many(6, 200)
def test_no_more_light_leaves_than_enters(count):
    """Forward paths only: the integral of I over all directions is at most what meets the medium."""

    @examples(count)
    @given(depth=powers(-3, 1), albedo=st.floats(0, 1), g=st.floats(-0.5, 0.5), aspect=powers(-1, 1),
           light=directions(3, 1, forward=True), seed=st.integers(0, 99))  # fmt: skip
    def check(depth, albedo, g, aspect, light, seed):
        box = sg.media.Box(lower=[0, 0, 0], upper=[10 * depth * aspect, 10 * depth, 10 * depth], mean_free_path=10.0,
                     albedo=albedo, scatterer=sg.media.HenyeyGreenstein(g=g))  # fmt: skip
        # Even over the sphere: Fibonacci's spiral; its quadrature of so smooth a light is good to 1e-2.
        n = np.arange(64)
        z, turn = 1 - (2 * n + 1) / 64, np.pi * (1 + np.sqrt(5)) * n
        views = np.stack([np.sqrt(1 - z**2) * np.cos(turn), np.sqrt(1 - z**2) * np.sin(turn), z], 1)
        made = sg.Scene(wavelength=1.0, medium=box, illumination=sg.light.PlaneWaves(directions=light),
                        sensor=sg.sensors.FarField(directions=views))  # fmt: skip
        with strict():
            found = sg.statistics.covariance(made, paths=640, seed=seed, reverse=False)
        scattered = 4 * np.pi * found.intensity[0].mean()
        error = 4 * np.pi * np.einsum("tvtv->tv", found.standard_error)[0].mean()
        sides = box.upper - box.lower
        incident = np.abs(light[0]) @ (np.prod(sides) / sides)
        assert scattered <= 1.01 * incident + limit(degrees=63) * error

    check()


@few_and_many(12, 500)
def test_memory_effect_of_any_slab(count):
    @st.composite
    def cases(draw):
        wavelength = draw(wavelengths)
        return wavelength, draw(slabs(wavelength)), draw(st.lists(powers(-9, -0.3), max_size=3))

    @examples(count)
    @given(case=cases(), mode=st.sampled_from(["transmission", "reflection"]), paths=st.sampled_from([1, 2, 64, 640]))
    def check(case, mode, paths):
        wavelength, medium, tilts = case
        with strict():
            found = result_or_refusal(
                ("view + tilts", "memory_effect medium", ABSORBED),  # beyond grazing; nothing scattered
                lambda: sg.memory_effect(medium, wavelength=wavelength, tilts=[0.0, *tilts, *tilts[:1]], mode=mode,
                                         paths=paths),
            )  # fmt: skip
        if found is None:
            return
        dark = np.isnan(found.intensity)
        assert dark.all() or not dark.any()
        assert dark.any() or found.intensity[0] == pytest.approx(1, abs=1e-9)
        assert (dark == np.isnan(found.field)).all()
        # Free of bias, so noise may take it out of [0, 1]; the field itself is a correlation.
        assert dark.any() or np.abs(found.field).max() <= 1 + 1e-9
        if paths == 1:
            assert np.isnan(found.standard_error).all()

    check()


@few_and_many(4, 300)
def test_any_slab_between_indices(count):
    @examples(count)
    @given(scene=faced_scenes(), seed=st.integers(0, 99))
    def check(scene, seed):
        with strict():
            found = result_or_refusal((ABSORBED,),
                                      lambda: sg.statistics.covariance(scene, paths=64, seed=seed, reverse=False))
            if found is not None:
                assert_sensible(scene, found)
            assert np.isfinite(sg.statistics.mean_field(scene)).all()
            plan = result_or_refusal((ABSORBED, DIM), lambda: sg.plan(scene, paths=16))
            stack = result_or_refusal((ABSORBED, DIM), lambda: sg.render(scene, paths=16, seed=seed))
        assert (plan is None) == (stack is None)
        assert stack is None or np.isfinite(stack.field).all()

    check()


SCREENS = (  # why the screens sampler does not draw a scene
    "possible for screens within", "within a transform", "at most half the speckle size", DIM,
)  # fmt: skip


@few_and_many(8, 500)
def test_any_screens(count):
    @examples(count)
    @given(scene=screen_scenes(), seed=st.integers(0, 99))
    def check(scene, seed):
        medium, wavelength = scene.medium, scene.wavelength
        with strict():
            plan = result_or_refusal(SCREENS, lambda: sg.plan(scene))
            stack = result_or_refusal(SCREENS, lambda: sg.render(scene, seed=seed))
            curve = sg.memory_effect(medium, wavelength=wavelength, tilts=[0.0, 1e-6, 1e-3, 0.1])
            joint = sg.statistics.joint_correlation(medium, wavelength=wavelength, tilts=[0.0, 1e-4],
                                                    shifts=[0.0, wavelength])
        assert (plan is None) == (stack is None)
        assert stack is None or np.isfinite(stack.field).all()
        assert curve.intensity[0] == pytest.approx(1, abs=1e-9)
        assert np.abs(curve.field).max() <= 1 + 1e-9
        assert joint.magnitude.max() <= 1 + 1e-9

    check()


@few_and_many(6, 400)
def test_any_recipe_gives_samples_or_says_why_not(count):
    """Finite, of the layout, the same again, and the same of the recipe as a store writes it down."""

    @examples(count)
    @given(table=recipe_tables(), seed=st.integers(0, 99), index=st.integers(0, 9))
    def check(table, seed, index):
        with strict():
            recipe = result_or_refusal(GOT, lambda: KINDS[table["kind"]](**table))
            plans = recipe and result_or_refusal(GOT, recipe.plans)
            if not plans or sum(plan.seconds for plan in plans) > 1:
                return
            sample = result_or_refusal(GOT, lambda: recipe.sample(seed, "train", index))
            if sample is None:
                return
            for name, spec in recipe.layout().items():
                if name != "parameters":
                    assert sample[name].dtype == np.dtype(spec.dtype)
                    assert spec.shape is None or sample[name].shape == tuple(spec.shape)
                    assert np.isfinite(sample[name].astype(np.float64)).all()
            written = recipe.model_dump(mode="json", by_alias=True, exclude_unset=True, exclude_none=True)
            again = type(recipe)(**json.loads(json.dumps(written)))
            assert again.fingerprint() == recipe.fingerprint()
            for name, value in again.sample(seed, "train", index).items():
                assert name == "parameters" or np.array_equal(value, sample[name])

    check()


@few_and_many(30, 3000)
def test_any_opening_passes_no_more_than_its_area(count):
    """Or is refused for its corners; its far field is strongest straight ahead, where it is the area."""

    @examples(count)
    @given(corners=st.lists(st.tuples(st.floats(-1, 1), st.floats(-1, 1)), min_size=3, max_size=9), size=powers(-9, 9),
           turns=st.lists(st.tuples(st.floats(-1, 1), st.floats(-1, 1)), min_size=1, max_size=4),
           reach=powers(-3, 5))  # fmt: skip
    def check(corners, size, turns, reach):
        loop, xi = size * np.array(corners), reach / size * np.array(turns)
        with strict():
            found = result_or_refusal(("opening",), lambda: aperture_transform(loop, np.append(xi, [[0, 0]], axis=0)))
            if found is None:
                return
            mass = gaussian_mass(loop, size**2 * np.eye(2), mean=loop[0])
        area = found[-1].real
        assert (np.abs(found) <= area + 1e-12 * size**2).all()
        assert -1e-12 <= mass <= min(1, area / (2 * np.pi * size**2)) + 1e-12

    check()


@few_and_many(30, 3000)
def test_any_source_has_modes_of_its_power(count):
    """A Gaussian Schell model of points anywhere; what passes through a random system is as coherent as can be."""

    @examples(count)
    @given(places=st.lists(st.floats(-1, 1), min_size=1, max_size=12), size=powers(-9, 9), length=powers(-12, 12),
           energy=st.floats(0.01, 1), seed=st.integers(0, 99))  # fmt: skip
    def check(places, size, length, energy, seed):
        with strict(), warnings.catch_warnings():
            warnings.simplefilter("ignore", UserWarning)  # points too few for their coherence length
            source = gaussian_schell_model(size * np.array(places), length)
            power, modes = coherent_modes(source, energy=energy)
            system = np.random.default_rng(seed).normal(size=(3, len(places), 2)) @ [1, 1j]
            seen = propagate_csd(system, source)
            degree = spectral_degree_of_coherence(seen)
        assert energy * len(places) * (1 - 1e-9) <= power.sum() <= len(places) * (1 + 1e-9)
        assert 0 < speckle_contrast(source) <= 1 + 1e-12
        assert np.abs(degree).max() <= 1 + 1e-12
        if energy == 1:
            np.testing.assert_allclose(intensity_from_modes(system, modes, power), spectral_density(seen), rtol=1e-6,
                                       atol=1e-9 * spectral_density(seen).max())  # fmt: skip

    check()


# ---- Values that are none ------------------------------------------------------------------------------

NUMBERS = st.sampled_from([float("nan"), float("inf"), -1.0, "", "x", "1 ell", None])
NO_VECTORS = st.one_of(st.just("up"), st.just([[0.0, 0.0, 2.0]]), st.just([[float("nan"), 0.0, 1.0]]), st.just([[1.0]]),
                       st.just([[]]), st.just([[[0.0, 1.0]], [[1.0]]]))  # fmt: skip
SLAB = {"thickness": 10.0, "mean_free_path": 1.0, "scatterer": sg.media.Isotropic()}
BOX = {"lower": [0, 0, 0], "upper": [1, 1, 1], "mean_free_path": 1.0, "scatterer": sg.media.Isotropic()}
BEAMS = {"directions": [[0.0, 0.0, 1.0]], "width": 1.0}
VOXELS = {"lower": [0, 0], "upper": [1, 1], "extinction": [[1.0]], "scatterers": (sg.media.Isotropic(),)}
BREAKS = [
    *[(sg.Slab, SLAB, field, NUMBERS) for field in ("thickness", "mean_free_path", "albedo")],
    *[(sg.media.Box, BOX, field, NUMBERS) for field in ("mean_free_path", "albedo", "scatterer", "lower", "upper")],
    *[(sg.media.VoxelGrid, VOXELS, field, NUMBERS) for field in ("extinction", "albedo", "material", "scatterers")],
    (sg.light.CollimatedBeams, BEAMS, "width", st.one_of(NUMBERS, st.just(0.0))),
    (sg.light.CollimatedBeams, BEAMS, "profile", NUMBERS),
    (sg.light.CollimatedBeams, BEAMS, "directions", NO_VECTORS),
    (sg.light.PlaneWaves, {}, "directions", NO_VECTORS),
    (sg.sensors.FarField, {}, "directions", NO_VECTORS),
    (sg.sensors.NearField, {}, "points", st.one_of(st.just("here"), st.just([[float("inf"), 0.0]]), st.just([[1.0]]))),
    (sg.light.PointSources, {}, "points", st.one_of(st.just("here"), st.just([[float("nan"), 0.0]]), st.just([1.0,
    2.0]))),
    (sg.media.HenyeyGreenstein, {}, "g", st.one_of(NUMBERS, st.sampled_from([1.0, 1.5]), st.floats(max_value=-1))),
    (sg.media.VonMisesFisher, {}, "concentration", NUMBERS),
    (sg.sensors.FarFieldGrid, {"shape": (3, 3), "pitch": 1e-3}, "pitch", st.one_of(NUMBERS, st.just(0.0),
    st.just(10.0))),
    (sg.sensors.FarFieldGrid, {"shape": (3, 3), "pitch": 1e-3}, "shape", st.sampled_from([(0, 1), (1,), (2.5, 1), "x",
    None])),
]


@few_and_many(80, 2000)
def test_a_broken_field_is_named(count):
    @examples(count)
    @given(data=st.data(), choice=st.sampled_from(BREAKS))
    def check(data, choice):
        owner, fields, name, bad = choice
        with strict(), pytest.raises(RuleError) as caught:
            owner(**(fields | {name: data.draw(bad)}))
        message = str(caught.value)
        assert f"{owner.__name__}.{name}" in message, message
        assert " must be " in message
        assert "; got " in message

    check()
