"""Recipes of thin screens: planned, streamed and judged as all others, under an envelope that moves with each beam."""

import pickle
from dataclasses import replace

import numpy as np
import pytest
from refusals import assert_refused
from screen_objects import screen_objects

import specklegen as sg
from specklegen.datasets import load_recipe
from specklegen.samplers.screens.film import frame_correlation
from specklegen.scene.window import Window
from specklegen.synthesis.object_envelope import TOLERANCE

NAMES = ["ground-glass", "double-diffuser", "screen-stack"]
SMALL = {"camera": {"shape": [32, 32]}, "objects": {"shape": [9, 9]}}


def small(name, **changes):
    changes = SMALL | changes
    if name != "ground-glass":
        changes = {"field": {"pixels": 12.0}} | changes
    return load_recipe(name, changes)


@pytest.mark.parametrize("name", NAMES)
def test_samples_are_planned_pure_and_say_who_rendered_them(name):
    recipe = small(name)
    assert all(plan.sampler == "screens" for plan in recipe.plans())
    sample = recipe.sample(3, "train", 5)
    again = pickle.loads(pickle.dumps(recipe)).sample(3, "train", 5)
    np.testing.assert_array_equal(sample["image"], again["image"])
    assert sample["parameters"]["sampler"] == 3
    assert sample["parameters"]["estimator"] == 3
    assert "the screens sampler" in recipe.rendering_note
    stack = recipe.material.slab_of(sample["parameters"])
    assert stack.stack.rms_angle(0.532) == pytest.approx(sample["parameters"]["rms_angle"])


@pytest.mark.parametrize("name", NAMES)
def test_images_have_mean_one_and_the_contrast_that_is_expected(name):
    recipe = small(name, media="new")
    samples = [recipe.sample(0, "train", n) for n in range(60)]
    means = np.array([s["image"].mean() for s in samples])
    assert abs(means.mean() - 1) < 5.5 * means.std() / np.sqrt(60) + 0.01
    spread = np.array([s["image"].var() / s["parameters"]["expected_contrast"] ** 2 for s in samples])
    assert spread.mean() == pytest.approx(1, abs=5.5 * spread.std() / np.sqrt(60) + 0.05)


def test_images_are_those_that_beams_add_up_to():
    """One medium, all beams drawn one by one by their envelopes and modes, against the polynomials' images."""
    screens = (sg.PhaseScreen(rms_phase=3.0, correlation_length=20.0),) * 2
    stack, grid = sg.ScreenStack(screens=screens, gaps=(400.0,)), sg.FarField.grid((24, 24), 1 / 1500)
    shape, pitch = (5, 4), 0.004
    made = screen_objects(stack, wavelength=1.0, object_shape=shape, object_pitch=pitch, grid=grid,
                          base=np.zeros((1, 2)), width=500.0)  # fmt: skip
    medium, even = made.medium(1), replace(made, imaging=replace(made.imaging, gains=None, polynomials=None))
    light = sg.IncoherentObject(brightness=np.ones(shape), pitch=pitch, width=500.0)
    angle, rng = stack.rms_angle(1.0), np.random.default_rng(0)
    for n in rng.integers(0, 20, 4):
        one = np.zeros(shape)
        one.flat[n] = 1.0
        image = made.images(medium, one)[0].numpy()
        flat = even.images(medium, one)[0].numpy()
        apart = grid.directions[..., :2] - light.directions[n, :2]
        lobe = np.exp(-np.square(apart).sum(-1) / (2 * angle**2))
        # sigma = 3: the lobe is Gaussian within 3 %.
        bright = flat > 0.05 * flat.max()
        np.testing.assert_allclose((image / flat)[bright], lobe[bright], atol=0.03 + TOLERANCE)


def test_a_dark_pixel_takes_nothing_however_the_polynomials_are_signed():
    stack = sg.PhaseScreen(rms_phase=3.0, correlation_length=20.0).stack
    grid = sg.FarField.grid((24, 24), 1 / 1500)
    made = screen_objects(stack, wavelength=1.0, object_shape=(9, 9), object_pitch=0.004, grid=grid,
                          base=np.zeros((1, 2)), width=500.0)  # fmt: skip
    assert len(made.imaging.polynomials) > 1
    medium, images = made.medium(2), []
    for lit in ([0], [8], [0, 8]):
        brightness = np.zeros((9, 9))
        brightness[lit, 0] = 1.0
        images.append(made.images(medium, brightness)[0].numpy())
    assert min(each.min() for each in images) > -2e-3 * images[2].max()
    np.testing.assert_allclose(images[2], images[0] + images[1], atol=1e-4 * images[2].max())


def test_what_screens_have_no_model_of_is_refused():
    assert_refused(lambda: small("ground-glass", light={"bandwidth": 0.001}), "bandwidth")
    screen = {"type": "PhaseScreen", "rms_phase": 0.5, "correlation_length": 5.0}
    weak = small("ground-glass", material={"screens": [screen]})
    assert_refused(lambda: weak.sample(0, "train", 0), "mirror")
    assert_refused(lambda: small("ground-glass", sampler="paths").sample(0, "train", 0), "paths")
    assert_refused(lambda: load_recipe("ground-glass", {"field": {"extent_over_range": 0.5}}), "extent_over_range")
    assert_refused(lambda: small("double-diffuser", material={"gaps": []}), "1 numbers for 2 screens")


def test_a_film_through_screens_that_move_is_pure_and_tells_how_fast_it_changes():
    recipe = small("moving-diffuser", dynamics={"frames": 4})
    assert all(plan.sampler == "screens" for plan in recipe.plans())
    sample = recipe.sample(3, "train", 5)
    again = pickle.loads(pickle.dumps(recipe)).sample(3, "train", 5)
    np.testing.assert_array_equal(sample["frames"], again["frames"])
    told = sample["parameters"]
    assert 0.2 <= told["velocity0_x"] <= 2
    assert told["velocity1_x"] == told["velocity0_y"] == 0
    # At a fixed view -ln|K| = (n / time)^2, nearly: lobes of sigma 12 are Gaussian.
    kept = recipe.frames_correlation(recipe.prepare(3, "train", 5))
    np.testing.assert_allclose(kept, np.exp(-np.square(np.arange(4) / told["correlation_time"])), atol=0.01)
    found = [np.corrcoef(recipe.sample(0, "train", n)["frames"].reshape(4, -1))[0, 1:] for n in range(24)]
    said = [recipe.frames_correlation(recipe.prepare(0, "train", n))[1:] ** 2 for n in range(24)]
    apart = np.array(found) - np.array(said)
    assert (np.abs(apart.mean(axis=0)) < 5.5 * apart.std(axis=0) / np.sqrt(24) + 0.03).all()


def test_screens_that_stand_still_or_are_redrawn_make_films_too():
    at_rest = {"frames": 3, "velocities": [[0.0, 0.0], [0.0, 0.0]]}
    rest = small("moving-diffuser", dynamics=at_rest).sample(0, "train", 0)
    np.testing.assert_allclose(rest["frames"], np.broadcast_to(rest["frames"][:1], rest["frames"].shape), atol=1e-5)
    assert rest["parameters"]["correlation_time"] == np.inf
    redrawn = {"frames": 3, "correlation_time": 1.0}
    film = small("double-diffuser", kind="dynamic-slab", dynamics=redrawn).sample(0, "train", 0)["frames"]
    assert film.shape == (3, 32, 32)
    assert np.corrcoef(film.reshape(3, -1))[0, 2] < 0.9


@pytest.mark.parametrize(("name", "dynamics", "says"), [
    ("moving-diffuser", {"velocities": [[1.0, 0.0]]}, "2 pairs"),
    ("moving-diffuser", {"correlation_time": 3.0}, "one of correlation_time and velocities"),
    ("dynamic-slab", {"correlation_time": None, "velocities": [[1.0, 0.0]]}, "left out if velocities"),
])  # fmt: skip
def test_velocities_are_given_to_every_screen_and_to_screens_alone(name, dynamics, says):
    assert_refused(lambda: load_recipe(name, {"dynamics": dynamics}), says)


def test_a_slab_recipe_still_names_its_fields_and_a_diffuser_its_own():
    with pytest.raises(sg.RuleError, match=r"^Material\.kernel_paths must be at least 64"):
        load_recipe("through-slab", {"material": {"kernel_paths": 3}})
    assert_refused(lambda: small("ground-glass", material={"thicknes": 3.0}), r"^Diffuser\.thicknes must be left out")


def test_a_laboratory_gives_the_wavelength():
    lab = load_recipe("through-slab-lab").lab
    table = small("ground-glass").model_dump(mode="json", exclude={"window", "camera", "field"}, exclude_none=True)
    table["material"].pop("wavelength")
    recipe = type(small("ground-glass"))(**table, lab=lab.replace(bandwidth=0.0))
    material = recipe.material.known(recipe.material.extremes()[0])
    assert material.correlation.wavelength == recipe.wavelength


def test_screens_may_be_asked_for_by_name():
    asked = small("ground-glass", sampler="screens")
    plain = small("ground-glass")
    np.testing.assert_array_equal(asked.sample(0, "train", 0)["image"], plain.sample(0, "train", 0)["image"])
    with pytest.raises(sg.RuleError, match=r"HiddenObject\.sampler must be one of 'auto', 'paths'.*'screens'"):
        small("ground-glass", sampler="screen")


@pytest.mark.parametrize("speed", [0.01, 1.0, 5.0])
def test_a_correlation_time_is_where_the_field_has_fallen_to_1_over_e(speed):
    """Of slow and fast screens that move along both axes."""
    motion = [[0.7 * speed, -0.4 * speed], [0.1 * speed, 0.2 * speed]]
    recipe = load_recipe("moving-diffuser", {"dynamics": {"velocities": motion}})
    drawn = {name: float(value) for name, value in recipe.sample(0, "test", 3)["parameters"].items()}
    stack = recipe.material.slab_of(drawn).stack.replace(velocities=motion)
    window, moved = Window(recipe.profile, drawn["width"]), stack.moved([drawn["correlation_time"]])
    assert frame_correlation(stack, drawn["wavelength"], moved, window) == pytest.approx([np.exp(-1)], rel=1e-8)
