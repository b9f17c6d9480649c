"""Images through an objective in recipes: those of the engine, over the power that the lens takes."""

import numpy as np
import pytest

import specklegen as sg
from specklegen.datasets.recipes.lens_stack import taken_power
from specklegen.datasets.recipes.registry import KINDS
from tests.refusals import assert_refused
from tests.zscore import assert_z

pytestmark = pytest.mark.filterwarnings("ignore::specklegen.DoubtWarning")

TABLE = {"name": "planes",
         "material": {"wavelength": 0.5, "thickness": 20.0, "optical_depth": 2.0, "g": 0.8, "kernel_paths": 400},
         "window": {"width": 12.0}, "camera": {"shape": [10, 8]},
         "lens": {"aperture": 0.12, "focus": {"uniform": [-15.0, 5.0]}, "planes": 3, "step": 8.0}}  # fmt: skip
LAYERS = {
    "wavelength": 0.5, "kernel_paths": 400,
    "layers": [{"thickness": 5.0, "mean_free_path": 10.0, "g": 0.8},
               {"thickness": {"uniform": [10.0, 15.0]}, "mean_free_path": 8.0, "g": 0.9}],
}  # fmt: skip


def recipe_of(**changes):
    return KINDS["lens-stack"](**(TABLE | changes))


@pytest.mark.parametrize("material", [TABLE["material"], LAYERS])
def test_samples_are_the_images_of_one_medium_on_every_plane(material):
    """Rendered again by the engine with as many directions, plane by plane."""
    recipe = recipe_of(material=material)
    sample = recipe.sample(4, "test", 1)
    assert sample["stack"].shape == (3, 10, 8)
    np.testing.assert_allclose(np.diff(sample["focus"]), 8.0)
    assert -15 <= sample["focus"][0] <= 5
    assert sample["parameters"]["focus"] == sample["focus"][0]
    ready = recipe.prepare(4, "test", 1)
    for image, lens in zip(sample["stack"], ready.imaging.planes, strict=True):
        views = lens.grid.shape[0]
        seen = lens.scene.replace(sensor=lens.camera.replace(views=views))
        told = {"paths": 400, "sampler": "paths", "threads": 1}
        fields = [sg.render(seen, seed=seed, **told).field[0] for seed in ready.seen.seeds]
        expected = np.mean([np.square(np.abs(field)) for field in fields], axis=0) / ready.imaging.unit
        np.testing.assert_allclose(image, expected, rtol=2e-3, atol=1e-3 * expected.max())
    again = recipe.batch(4, "test", [0, 1])
    np.testing.assert_array_equal(again["stack"][1], sample["stack"])


def test_images_are_over_the_power_that_the_lens_takes():
    """All over a period of the plane: the mean power of images is that of the window times their unit."""
    lens = recipe_of().lenses(recipe_of().material.extremes()[0], np.array([0.0]))[0]
    unit, error = taken_power(lens.pupil_scene, lens.camera.pupil, 4000)
    assert 0 < error < 0.1
    made = sg.plan(lens.pupil_scene, paths=2000, sampler="paths")
    power = []
    for each in made.chosen.prepare(3, 1).media(24):
        power.append(np.square(np.abs(each.image[0] * lens.pupil)).sum() * lens.grid.pitch**2)
    expected = unit * lens.scene.beams.window.area
    spread = np.std(power, ddof=1) / np.sqrt(len(power))
    assert_z(np.mean(power), expected, np.hypot(spread, error * expected), degrees=23)


@pytest.mark.parametrize(("changes", "message"), [
    ({"lens": TABLE["lens"] | {"step": 0.0}}, r"Objective\.step must be other than 0"),
    ({"lens": TABLE["lens"] | {"aperture": 0.9}}, r"Imaging\.aperture must be below 0\.7071"),
    ({"light": {"bandwidth": 1e-3}}, r"Recipe\.light\.bandwidth must be left out"),
    ({"sampler": "stationary"}, r"sampler must be"),
    ({"exposure": {"photons": 100.0}}, r"Recipe\.exposure must be left out"),
])  # fmt: skip
def test_what_the_kind_does_not_make_is_refused_by_name(changes, message):
    assert_refused(lambda: recipe_of(**changes), message)
