"""What differs from bench to bench: every effect against a literal form of it, on the same random numbers."""

import numpy as np
import pytest
import torch
from plain_forms import as_on_devices
from scipy.ndimage import gaussian_filter, map_coordinates

from specklegen.datasets import load_recipe, recipe_names
from specklegen.datasets.recipes.generator import SpeckleGenerator
from specklegen.datasets.recipes.recipe_files import recipe_table, table_names
from specklegen.models import recoverable
from tests.refusals import assert_refused
from tests.zscore import assert_z

SMALL = {"media": 4, "sampler": "stationary", "material": {"kernel_paths": 2000}, "camera": {"shape": [48, 40]},
         "objects": {"shape": [16, 16]}}  # fmt: skip


def sample(index=3, **changes):
    bench = changes.pop("bench", None)
    more = {**SMALL, **changes} | ({"bench": bench} if bench is not None else {})
    return load_recipe("through-slab", more).sample(0, "test", index)


@pytest.fixture(scope="module")
def plain():
    return sample()["image"].astype(np.float64)


def test_even_light_is_added(plain):
    found = sample(bench={"stray": 0.25})["image"]
    np.testing.assert_allclose(found, 0.75 * plain + 0.25, rtol=1e-5)


def test_a_gradient_falls_across_the_frame(plain):
    made = sample(bench={"gradient": 0.4})
    ratio = made["image"] / plain
    angle = made["parameters"]["bench_gradient_angle"]
    y, x = np.linspace(-1, 1, 48)[:, None], np.linspace(-1, 1, 40)
    slope = (np.cos(angle) * x + np.sin(angle) * y) / (abs(np.cos(angle)) + abs(np.sin(angle)))
    np.testing.assert_allclose(ratio, 1 + 0.4 * slope, rtol=1e-4)
    assert ratio.min() == pytest.approx(0.6, abs=1e-4)


def test_pixels_differ_by_what_is_said(plain):
    ratios = np.concatenate([
        (sample(n, bench={"unevenness": 0.05})["image"] / sample(n)["image"]).ravel() for n in range(4)
    ])  # fmt: skip
    assert_z(ratios.var() / 0.05**2, 1, np.sqrt(2 / len(ratios)))
    assert_z(ratios.mean(), 1, 0.05 / np.sqrt(len(ratios)))
    first, second = (sample(n, bench={"unevenness": 0.05})["image"] / sample(n)["image"] - 1 for n in (0, 1))
    assert_z((first * second).mean(), 0, 0.05**2 / np.sqrt(first.size))  # a pattern of its own


def test_blur_is_a_gaussian(plain):
    found = sample(bench={"blur": 1.5})["image"]
    np.testing.assert_allclose(found, gaussian_filter(plain, 1.5, mode="mirror", truncate=8), atol=2e-3)


def test_drift_is_the_mean_along_its_way(plain):
    made = sample(bench={"drift": 5.0})
    angle = made["parameters"]["bench_drift_angle"]
    rows, columns = np.mgrid[:48, :40].astype(float)
    way = (np.arange(200) + 0.5) / 200 * 5.0 - 2.5
    moved = [map_coordinates(plain, [rows + s * np.sin(angle), columns + s * np.cos(angle)], order=5, mode="mirror")
             for s in way]  # fmt: skip
    apart = np.abs(np.mean(moved, axis=0) - made["image"])
    assert apart.max() < 0.01 * plain.std() + 0.01
    assert np.abs(plain - made["image"]).max() > 0.1  # and it does something


@pytest.mark.parametrize("degree", [0.0, 0.4, 1.0])
def test_light_is_as_polarised_as_is_said(plain, degree):
    both = sample(light={"polarised": False})
    other = 2 * both["image"].astype(np.float64) - plain  # the second polarisation alone
    found = sample(bench={"polarisation": degree})
    np.testing.assert_allclose(found["image"], (1 + degree) / 2 * plain + (1 - degree) / 2 * other, atol=2e-5)
    whole = sample()["parameters"]["expected_contrast"]
    assert found["parameters"]["expected_contrast"] == pytest.approx(whole * np.sqrt((1 + degree**2) / 2))


def test_the_aperture_is_wider_than_is_said():
    width = load_recipe("through-slab").window.width
    found = sample(bench={"aperture": 1.25})
    wider = sample(window={"width": 1.25 * width}, camera={"shape": [48, 40], "pixels_per_grain": 3 / 1.25})
    np.testing.assert_allclose(found["image"], wider["image"], rtol=1e-4, atol=1e-5)
    assert found["parameters"]["width"] == width
    assert found["parameters"]["camera_pitch"] == pytest.approx(wider["parameters"]["camera_pitch"])


def test_the_object_is_shown_as_it_appears():
    before = sample()["object"]
    turned = sample(bench={"rotation": 90.0})
    np.testing.assert_allclose(turned["object"], np.rot90(before, -1), atol=1e-5)
    given = load_recipe("through-slab", SMALL).prepare(0, "test", 3)
    np.testing.assert_allclose(turned["image"], given.images(turned["object"])[0], rtol=1e-4, atol=1e-5)
    for size in (0.8, 1.25):
        rows, columns = (np.mgrid[:16, :16] - 7.5) / size + 7.5
        wanted = map_coordinates(before, [rows, columns], order=1, mode="grid-constant")
        found = sample(bench={"magnification": size})["object"]
        np.testing.assert_allclose(found, wanted, atol=1e-5)


def test_cameras_are_drawn_and_count():
    camera = {"photons": 1.0, "full_well": 8000.0, "gain": 4.0, "read_noise": 3.0, "bit_depth": 12, "offset": 20.0}
    full = 8000.0
    found = sample(bench={"cameras": [camera], "brightness": 0.1}, exposure={"photons": 50.0, "bit_depth": 8})
    same = sample(exposure={**camera, "photons": 0.1 * full})
    np.testing.assert_array_equal(found["image"], same["image"])
    several = load_recipe("through-slab", {
        **SMALL, "exposure": {"photons": 50.0}, "bench": {"cameras": [camera, {**camera, "offset": 3000.0}]},
    }).batch(0, "test", range(24))  # fmt: skip
    chosen = several["parameters"]["bench_camera"]
    assert set(chosen) == {0.0, 1.0}
    np.testing.assert_array_equal(several["image"].min((1, 2)) > 1000, chosen == 1)


@pytest.mark.parametrize("name", table_names())
def test_a_table_changes_a_recipe_beside_which_it_is_inherited(tmp_path, name):
    file = tmp_path / "mine.toml"
    file.write_text(
        f'inherits = ["through-slab", "{name}"]\nname = "mine"\nmedia = 4\nsampler = "stationary"\n'
        "[material]\nkernel_paths = 2000\n[camera]\nshape = [48, 40]\n"
        "[objects]\nshape = [16, 16]\n"
    )
    recipe = load_recipe(file)
    batch = recipe.batch(3, "train", range(6))
    alone = recipe.sample(3, "train", 5)
    np.testing.assert_array_equal(batch["image"][5], alone["image"])
    np.testing.assert_array_equal(batch["object"][5], alone["object"])
    names = [each for each in alone["parameters"] if each.startswith("bench_")]
    assert len(names) == 13
    for each in ("rotation", "blur", "stray", "aperture"):
        assert len(np.unique(batch["parameters"][f"bench_{each}"])) > 3
    assert len(recipe.bench.cameras) == 10
    assert name not in recipe_names()
    assert_refused(lambda: load_recipe(name), "recipe must be a recipe; got 'lab-.*inherits = ")


def test_later_parents_change_earlier_ones(tmp_path):
    parts = {"a": "media = 3\nname = 'a'", "b": "media = 5\n[material]\ng = 0.5", "c": "[material]\ng = 0.7"}
    for name, lines in parts.items():
        (tmp_path / f"{name}.toml").write_text(lines)
    (tmp_path / "heir.toml").write_text('inherits = ["through-slab", "a.toml", "b.toml", "c.toml"]\n')
    table = recipe_table(tmp_path / "heir.toml")
    assert (table["media"], table["material"]["g"], table["name"]) == (5, 0.7, "a")
    assert table["material"]["optical_depth"] == recipe_table("through-slab")["material"]["optical_depth"]
    (tmp_path / "one.toml").write_text('inherits = ["through-slab"]\n')
    assert recipe_table(tmp_path / "one.toml") == recipe_table("through-slab")
    (tmp_path / "round.toml").write_text('inherits = ["through-slab", "round.toml"]\n')
    assert_refused(lambda: recipe_table(tmp_path / "round.toml"), "free of circles")


def test_devices_see_what_the_cpu_sees_in_any_batch(monkeypatch):
    """Every effect but a camera's, which rounds to other counts; of two media, each of its own aperture and degree."""
    varied = {"rotation": [-20.0, 20.0], "magnification": [0.9, 1.2], "aperture": [0.9, 1.1],
              "polarisation": [0.2, 0.9], "blur": [0.2, 1.5], "drift": [0.0, 3.0], "gradient": [0.0, 0.5],
              "stray": [0.0, 0.3], "unevenness": [0.01, 0.1]}  # fmt: skip
    recipe = load_recipe("through-slab", {**SMALL, "bench": {name: {"uniform": each} for name, each in varied.items()}})
    expected = SpeckleGenerator(recipe, 4)(range(4))
    with as_on_devices(monkeypatch):
        generator = SpeckleGenerator(recipe, 4)
        whole = generator(range(4))
        for some in ([3, 1], [2]):
            for key in ("image", "object"):
                assert torch.equal(generator(some)[key], whole[key][some])
        assert "the sensitivity of pixels" in generator.report()["host"]
    for key, reach in (("image", 2e-6), ("object", 1e-6)):
        one, two = whole[key].double(), expected[key].double()
        assert (one - two).norm() < reach * two.norm()
        assert (one.roll(1, -1) - two).norm() > 1e-3 * two.norm()


@pytest.mark.parametrize(("name", "changes", "message"), [
    ("tilt-stack", {"bench": {"blur": 1.0}}, "bench must be left out of recipes of this kind"),
    ("polarised-tissue", {"bench": {"blur": 1.0}}, "bench must be left out of recipes of this kind"),
    ("through-slab", {"exposure": {"photons": 9.0, "bit_depth": None}, "bench": {
        "cameras": [{"photons": 1.0, "bit_depth": None}]}}, "cameras must be cameras that saturate"),
    ("through-slab", {"bench": {"blur": -1.0}}, "blur must be from 0 to 8"),
    ("through-slab", {"bench": {"magnification": {"uniform": [0.0, 1.0]}}}, "magnification must be from 0.5 to 2"),
    ("through-slab", {"bench": {"cameras": [{"photons": 1.0}]}}, "cameras must be left out if there is no"),
    ("through-slab", {"bench": {"polarisation": 0.5}, "light": {"polarised": False}}, "polarisation must be 1"),
    ("through-slab", {"bench": {"shadow": 0.5}}, "there is no such field"),
])  # fmt: skip
def test_what_is_not_modelled_is_refused(name, changes, message):
    assert_refused(lambda: load_recipe(name, changes), message)


def test_no_verdict_is_given_on_benches_that_differ():
    recipe = load_recipe("through-slab", SMALL | {"bench": {"blur": {"uniform": [0.0, 2.0]}}})
    assert_refused(lambda: recoverable(recipe), "recoverable recipe must be without the table `bench`")


@pytest.mark.parametrize("name", ["ground-glass-bench", "tissue-bench"])
def test_the_packaged_benches_are_as_they_are_said(name):
    """Contrast is that of counts over a smooth envelope, black level off."""
    recipe = load_recipe(name, {"media": 4})
    made = recipe.batch(0, "train", range(8))
    grains = recipe.camera.shape[0] / recipe.camera.pixels_per_grain
    assert made["image"].shape == (8, 512, 512)
    assert grains > 200
    camera = made["parameters"]["bench_camera"].astype(int)
    assert set(camera) == {0, 1}
    light = made["image"] - np.array([2.0, 50.0])[camera][:, None, None]
    assert made["image"][camera == 0].max() < 256 <= made["image"][camera == 1].max() < 4096
    envelope = np.stack([gaussian_filter(each, 45) for each in light])
    contrast = (light / envelope).std((1, 2))
    assert 0.04 < contrast.min() < 0.15
    assert 0.25 < contrast.max() < 0.5
    assert (envelope.max((1, 2)) / envelope.min((1, 2)) > 1.1).all()  # light that falls off
