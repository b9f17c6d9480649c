"""What is planned is what runs: the plan of a recipe, and what its samples say of themselves and hold."""

import json
import re
import warnings

import numpy as np
import pytest
from quick_recipes import packaged, quick_recipe
from scipy.integrate import simpson
from zscore import assert_mean, refute_mean

import specklegen as sg
from specklegen.datasets import load_recipe
from specklegen.datasets.recipes.generator import SpeckleGenerator
from specklegen.datasets.recipes.media import MediumView
from specklegen.datasets.recipes.parts.sampler import NUMBERS
from specklegen.datasets.recipes.parts.viewing import Viewing
from specklegen.datasets.recipes.recipe import Recipe
from specklegen.datasets.split import Purpose, substream
from specklegen.samplers.coherent_media import CoherentImaging
from specklegen.samplers.path_sums.media import PathImaging, division_weights
from specklegen.samplers.path_sums.sampler import PathSums
from specklegen.samplers.screens.sampler import Screens
from specklegen.samplers.stationary.sampler import Stationary
from specklegen.scene.sensors import FarFieldGrid
from specklegen.scene.window import Window
from specklegen.synthesis.stacks import mean_intensity
from specklegen.synthesis.surface import SurfaceImaging

SMALL = {"material": {"kernel_paths": 2000}, "camera": {"shape": [16, 16]}, "objects": {"shape": [6, 6]}}
TILTED = {"material": {"kernel_paths": 2000}, "camera": {"shape": [16, 16]}}
NARROW = {"window": {"width": 4000.0}}


WIDE = {"material": {"g": 0.999, "optical_depth": 8.0, "kernel_paths": 1000}, "field": {"extent_over_range": 3.0},
        "camera": {"shape": [32, 32]}}  # fmt: skip


def changed(*tables):
    found = {}
    for table in tables:
        for key, value in table.items():
            found[key] = {**found.get(key, {}), **value} if isinstance(value, dict) else value
    return found


ALTERED = {
    "narrow window": ("through-slab", changed(SMALL, NARROW), "paths"),
    "narrow disc": ("through-slab", changed(SMALL, {"window": {"width": 3000.0, "profile": "disc"}}), "paths"),
    "narrow, two tilts": ("two-tilts", changed(SMALL, NARROW), "paths"),
    "narrow, tilts": ("tilt-stack", changed(TILTED, NARROW, {
        "material": {"thickness": 1000.0, "optical_depth": 10.0, "g": 0.9, "kernel": "estimate"}}), "paths"),
    "narrow, unpolarised": ("through-slab", changed(SMALL, NARROW, {"light": {"polarised": False}}), "paths"),
    "narrow, camera": ("through-slab", changed(SMALL, NARROW, {"exposure": {"photons": 1e3}}), "paths"),
    "wide, paths asked for": ("through-slab", changed(SMALL, {"sampler": "paths"}), "paths"),
    "thin": ("through-slab", changed(SMALL, {"material": {"optical_depth": 3.0}}), "stationary"),
    "fog": ("through-slab", changed(SMALL, {"material": {
        "scatterer": {"type": "VonMisesFisher", "concentration": 10.0}}}), "stationary"),
    "drawn fog": ("through-slab", changed(SMALL, {"media": "new", "material": {
        "scatterer": {"type": "VonMisesFisher", "concentration": {"uniform": [5.0, 20.0]}}}}), "stationary"),
}  # fmt: skip


def rendered(recipe):
    """What a sample says of its sampler, and what it was rendered with."""
    parameters, imaging = recipe.sample(0, "train", 0)["parameters"], recipe.prepare(0, "train", 0).imaging
    if isinstance(imaging, PathImaging | SurfaceImaging):
        return parameters, "paths"
    if isinstance(imaging, CoherentImaging):
        return parameters, "screens" if imaging.many is not None and imaging.many.spectrum is not None else "stationary"
    return parameters, "stationary" if imaging.polynomials is None else "screens"


@pytest.mark.parametrize("name", packaged())
def test_packaged_recipes_run_as_planned(name):
    recipe = quick_recipe(name, 2000)
    plans = recipe.plans()
    parameters, used = rendered(recipe)
    assert {used} == {made.sampler for made in plans}
    assert parameters["sampler"] == NUMBERS[used]
    assert parameters["expected_error"] == max(made.expected_error for made in plans)


@pytest.mark.parametrize("name", ALTERED)
def test_altered_recipes_run_as_planned(name):
    source, changes, sampler = ALTERED[name]
    recipe = load_recipe(source, changes)
    assert {made.sampler for made in recipe.plans()} == {sampler}
    parameters, used = rendered(recipe)
    assert used == sampler
    assert parameters["sampler"] == NUMBERS[sampler]
    assert sampler.split()[0][:4] in recipe.rendering_note


def test_the_narrow_window_of_the_classic():
    """A window 4000 wide: the stationary model is off by .044, and path sums take over."""
    recipe = load_recipe("through-slab", NARROW)
    (made,) = recipe.plans()
    assert made.sampler == "paths"
    left_out = r"stationary sampler: left out: on-axis approximation: correlation error "
    found = re.search(left_out + r"(\S+) ± (\S+),", made.explain())
    assert found is not None
    off, error = map(float, found.groups())
    assert abs(off - 0.044) < 4 * np.hypot(error, 0.005)  # false alarms 6e-5; .044 +- .005 by another pilot
    assert off > 4 * error
    assert "784 tilts" in made.explain()


def test_path_sums_are_those_of_the_engine():
    """Sum of O_j |u_j|^2 over the engine's fields of the very same medium; another medium differs."""
    recipe = load_recipe("through-slab", changed(SMALL, NARROW))
    ready = recipe.prepare(5, "test", 3)
    light = recipe.sample(5, "test", 3)["object"]
    scene, seed = ready.imaging.sampler.scene, substream(5, "test", Purpose.MEDIUM, 3)
    field = sg.render(scene, paths=2000, seed=seed, sampler="paths").field
    expected = np.tensordot(light.ravel(), np.square(np.abs(field)), axes=1)
    found = ready.images(light)[0] * light.sum(dtype=float) * ready.imaging.unit
    assert np.allclose(found, expected, rtol=5e-3, atol=5e-3 * expected.mean())
    other = sg.render(scene, paths=2000, seed=9, sampler="paths").field
    wrong = np.tensordot(light.ravel(), np.square(np.abs(other)), axes=1)
    assert not np.allclose(found, wrong, rtol=0.1)


@pytest.mark.parametrize("profile", ["square", "gaussian"])
def test_weighted_views_give_a_pixels_contrast(profile):
    """Against the integral over pixels .1 to 6 grains wide; equal weights would miss what is claimed."""
    window = Window(profile, 1000.0)
    worst = {"weighted": 0.0, "equal": 0.0}
    for pitch in np.linspace(0.05, 3, 60) / 1000:
        grid = FarFieldGrid(pitch=pitch, shape=(4, 4))
        n = Viewing(0.5, window.width, profile, grid, 0.0, True).divisions  # noqa: FBT003
        apart = np.linspace(0, pitch, 2001)
        power = window.coherence(apart / 0.5, np.zeros(2001)) ** 2
        exact = 2 * simpson((1 - apart / pitch) * power, x=apart) / pitch
        views = np.interp(np.abs(np.subtract.outer(np.arange(n), np.arange(n))) * pitch / n, apart, power)
        for rule, weights in {"weighted": division_weights(n), "equal": np.full(n, 1 / n)}.items():
            found = weights @ views @ weights  # along one axis: both give the square of the contrast
            worst[rule] = max(worst[rule], abs(found / exact - 1))
    assert worst["weighted"] < 0.002 < worst["equal"]


AREA = {"camera": {"shape": [64, 64], "pixels_per_grain": 2.0}, "window": {"width": 2000.0, "profile": "gaussian"},
        "exposure": {"photons": 2e3, "full_well": 1e6, "bit_depth": 16}}  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize("more", [{}, pytest.param(AREA, marks=pytest.mark.slow)], ids=["points", "pixels with area"])
def test_path_sums_of_a_narrow_window_have_the_contrast_that_is_told(more):
    """A grain and a quarter in a range: the window lies before the medium, and C_I does not enter at one view. By
    Student's t over 90 media, false alarms 1e-6; the law of a window behind the medium is told apart."""
    changes = {"media": "new", "material": {"kernel_paths": 5000}, "window": {"width": 2000.0},
               "camera": {"shape": [64, 64]}, "objects": {"shape": [8, 8]},
               "field": {"pitch": 8e-5, "extent_over_range": None}, **more}  # fmt: skip
    recipe, behind = (load_recipe("through-slab", {**changes, "sampler": name}) for name in ("paths", "stationary"))
    samples = [recipe.sample(3, "train", n) for n in range(90)]
    images = np.array([each["image"] for each in samples], float)
    found = np.square(images / images.mean() - 1).mean((1, 2))
    assert_mean(found - [each["parameters"]["expected_contrast"] ** 2 for each in samples], 0.0)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        others = [behind.sample(3, "train", n)["parameters"]["expected_contrast"] for n in range(90)]
    refute_mean(found - np.square(others), 0.0)


def test_an_unfit_sampler_warns_and_a_strict_recipe_refuses_it():
    asked = {**NARROW, "sampler": "stationary"}
    recipe = load_recipe("through-slab", changed(SMALL, asked))
    with pytest.warns(sg.DoubtWarning, match=r"correlation error 0\.0\d+ .*Use sampler"):
        parameters, used = rendered(recipe)
    assert used == "stationary"
    assert parameters["sampler"] == NUMBERS["stationary"]
    strict = load_recipe("through-slab", changed(SMALL, asked, {"strict": True}))
    with pytest.raises(ValueError, match=r"Recipe.sampler must be accurate for all media, since strict = true"):
        strict.sample(0, "train", 0)
    assert strict.fingerprint() == recipe.fingerprint()
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        load_recipe("through-slab", changed(SMALL, {"strict": True})).sample(0, "train", 0)


def test_beams_far_to_one_side_are_not_judged_by_a_correlation_that_recipes_do_not_draw():
    """A scene may be drawn about the middle of its beams; media of recipes have the modes of the axis alone."""
    recipe = load_recipe("tilt-stack", {
        "tilts": {"step": 0.15, "count": 3}, "window": {"width": 2000.0}, "camera": {"shape": [16, 16]},
        "material": {"thickness": 20.0, "optical_depth": 4.0, "g": 0.8, "kernel_paths": 2000},
    })  # fmt: skip
    (view, *_) = recipe.extremes()
    of_scene = sg.plan(view.probe, paths=2000, sampler="stationary")
    assert of_scene.chosen.form == "oblique"  # else what follows would show nothing
    assert recipe.medium_plan(view).sampler == "paths"
    asked = recipe.replace(sampler="stationary").medium_plan(view)
    assert asked.chosen.form == "axial"
    assert any(decision.doubt for decision in asked.decisions)


def test_materials_on_either_side_of_the_rule_are_planned_one_by_one():
    """Thicknesses from thin, where the window is wide, to thick, where it is narrow."""
    recipe = load_recipe("through-slab", changed(SMALL, {"media": "new"}, {"window": {"width": 12000.0}}, {
        "material": {"thickness": {"log_uniform": [300.0, 6000.0]}}}))  # fmt: skip
    assert recipe.rendering is None
    assert {made.sampler for made in recipe.plans()} == {"paths", "stationary"}
    seen = set()
    for n in range(6):
        parameters = recipe.sample(0, "train", n)["parameters"]
        imaging = recipe.prepare(0, "train", n).imaging
        used = "paths" if isinstance(imaging, PathImaging) else "stationary"
        slab = recipe.material.slab_of(parameters)
        view = MediumView(slab, recipe.geometry, (6, 6), parameters["object_pitch"], np.zeros((1, 2)))
        made = recipe.medium_plan(view)
        assert made.sampler == used
        assert parameters["expected_error"] == made.expected_error
        seen.add(used)
    assert seen == {"paths", "stationary"}


@pytest.mark.parametrize(("name", "more", "words"), [
    ("through-slab", {"light": {"bandwidth": 1e-4}}, "without a bandwidth"), ("dynamic-slab", {}, "without dynamics"),
])  # fmt: skip
def test_what_path_sums_do_not_model_is_refused(name, more, words):
    with pytest.raises(ValueError, match=f"Recipe must be {words}, since media are rendered by path sums"):
        load_recipe(name, changed(SMALL, NARROW, more)).sample(0, "train", 0)


def test_path_sums_need_no_room_for_the_stationary_sampler(monkeypatch):
    """Lobes so narrow that three ranges span thousands of grains; the mean and the contrast are told all the same."""
    with pytest.raises(sg.RuleError, match="within a transform"):
        load_recipe("through-slab", WIDE | {"sampler": "stationary"}).plans()
    assert np.isfinite(load_recipe("through-slab", WIDE).sample(0, "train", 0)["image"]).all()
    recipe = load_recipe("through-slab", changed(SMALL, NARROW, {"sampler": "paths"}))
    monkeypatch.setattr("specklegen.synthesis.imaging.karhunen_loeve", None)
    found = recipe.prepare(0, "train", 0)
    assert isinstance(found.imaging, PathImaging)
    area = Window(recipe.profile, recipe.geometry.width).area
    kernel = recipe.material_of(0, "train", 0).correlation
    assert found.imaging.unit == pytest.approx(mean_intensity(kernel, area), rel=1e-12)
    told = recipe.sample(0, "train", 0)["parameters"]
    apart = told["object_pitch"] * np.subtract.outer(np.arange(6), np.arange(6))
    along = np.sinc(told["width"] / told["wavelength"] * apart) ** 2  # what rows have in common, behind a square
    expected = along.mean()
    # The window is summed in cells; the memory effect would take off .04.
    assert found.expected_contrast(np.ones((6, 6))) == pytest.approx(expected, rel=0.002)


class Calls(list):
    """Which samplers made how many media ready, call by call."""

    def note(self, kind, monkeypatch):
        plain = kind.prepare_media

        def noted(own, request):
            self.append((own, len(request.sight)))
            return plain(own, request)

        monkeypatch.setattr(kind, "prepare_media", noted)


@pytest.fixture
def calls(monkeypatch):
    """Every call of a sampler's ``prepare_media``."""
    found = Calls()
    for kind in (Stationary, Screens, PathSums):
        found.note(kind, monkeypatch)
    return found


@pytest.mark.parametrize("name", packaged())
def test_the_planned_sampler_makes_every_medium_ready_once(name, calls, monkeypatch):
    """It is the object in a plan; media that come again, and those that are alike, are not made again."""
    recipe, planned, plans = quick_recipe(name, 2000), [], Recipe.plans
    monkeypatch.setattr(Recipe, "plans", lambda own: [planned.extend(found := plans(own)), found][1])
    chosen = recipe.rendering.chosen
    assert any(chosen is made.chosen for made in planned)
    generator = SpeckleGenerator(recipe, 0)
    generator(range(3))
    media = len({recipe.medium_number(n) for n in range(3)})
    assert calls
    assert all(own is chosen for own, _ in calls)
    assert sum(count for _, count in calls) == (1 if recipe.media_alike else media)
    before = len(calls)
    generator(range(3))
    kept = recipe.shares_media or recipe.media_alike
    assert (len(calls) == before) == kept


def test_path_sums_are_planned_and_made_ready_medium_by_medium(calls):
    drawn = {"media": 2, "material": {"g": {"uniform": [0.9, 0.91]}}}
    recipe = load_recipe("through-slab", changed(SMALL, NARROW, drawn))
    generator = SpeckleGenerator(recipe, 0)
    generator(range(4))
    assert [(type(own), count) for own, count in calls] == [(PathSums, 1)] * 2
    own = [own.scene.medium for own, _ in calls]
    assert own == [recipe.material_of(0, "train", n).slab for n in range(2)]
    generator(range(4))
    assert len(calls) == 2


def nudged(content):
    """JSON whose every number that is not whole is the next one in its last bit, as another processor may find it."""
    if isinstance(content, dict):
        return {key: nudged(value) for key, value in content.items()}
    if isinstance(content, list):
        return [nudged(value) for value in content]
    whole = not isinstance(content, float) or content == round(content, 6)  # was written, not computed
    return content if whole else float(np.nextafter(content, np.inf))


@pytest.mark.parametrize("name", ["through-slab", "unknown-slab", "two-tilts", "polarised-tissue", "brownian-slab"])
def test_the_last_bits_of_derived_numbers_decide_no_plan(name):
    """Another kind of processor derives another last bit of a pitch, and must draw the same pilots."""
    moved = 0
    for view in load_recipe(name).extremes():
        scene = view.probe
        written = scene.model_dump(mode="json")
        light = nudged(written["illumination"])
        moved += light != written["illumination"]
        other = sg.Scene.from_json(json.dumps(written | {"illumination": light}))
        assert other.unitless_fingerprint() == scene.unitless_fingerprint()
        key = "pitch" if "pitch" in light else "directions"
        more = 1 + (np.array([1e-7, 0, 0]) if key == "directions" else 1e-7)  # no last bit: another scene
        light[key] = (np.array(light[key]) * more).tolist()
        other = sg.Scene.from_json(json.dumps(written | {"illumination": light}))
        assert other.unitless_fingerprint() != scene.unitless_fingerprint()
    assert moved
