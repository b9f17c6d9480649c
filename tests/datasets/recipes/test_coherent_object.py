"""Recipes of coherent objects: images are those of scenes, media of splits differ, phases are seen, refusals."""

import numpy as np
import pytest
import torch
from typer.testing import CliRunner

import specklegen as sg
from specklegen.cli.commands import app
from specklegen.datasets import load_recipe
from specklegen.datasets.recipes.generator import SpeckleGenerator
from specklegen.models import judge_photograph
from specklegen.models.learning.networks import build, parameter_count
from specklegen.models.learning.run import read_log
from tests.refusals import assert_refused
from tests.zscore import assert_mean, refute_mean

SMALL = {"camera": {"shape": [32, 32]}, "objects": {"shape": [10, 10]}, "window": {"width": 1080.0}}
GLASS = {"material": {"wavelength": 0.633, "screens": [{"type": "GroundGlass", "angle": 0.2}]}}  # no ballistic light


def recipe(name="coherent-digits", **changes):
    glass = {} if name == "coherent-slab" else GLASS
    return load_recipe(name, {**SMALL, **glass, **changes})


def batch(made, split="train", numbers=range(48)):
    return SpeckleGenerator(made, seed=0, split=split)(list(numbers))


@pytest.mark.parametrize("name", ["coherent-digits", "coherent-phase", "coherent-slab"])
def test_images_have_the_mean_and_the_contrast_of_one_speckle(name):
    """Over the scattered light: mean 1, mean square 2 with what few grains leave; a sum of two is told."""
    image = batch(recipe(name, media="new"))["image"].numpy().astype(float)
    assert_mean(image.mean(axis=(1, 2)), 1.0, slack=0.02)
    assert_mean(np.square(image).mean(axis=(1, 2)), 2.0, slack=0.05)
    two = (image + np.roll(image, 1, 0)) / 2
    refute_mean(np.square(two).mean(axis=(1, 2)), 2.0, slack=0.05)


def test_one_glass_shows_one_object_one_image_and_splits_have_glasses_of_their_own():
    """Sample n and n + media share the glass. The same object behind glasses of two splits has unrelated images."""
    made = recipe(media=2)
    one = batch(made, numbers=[0, 1, 2, 3])
    assert one["parameters"]["medium"].tolist() == [0, 1, 0, 1]
    generator, other = (SpeckleGenerator(made, seed=0, split=split) for split in ("train", "test"))
    lit = made.lit(generator.drawn, [0])
    seen = []
    for place in (generator, other):
        ready = place.media([0])
        imaging = ready.groups[0][1]
        for _ in range(2):  # drawn, and drawn again
            seen.append(imaging.media(ready.streams).superposed(lit.light, lit.step)[0, 0].numpy())
    np.testing.assert_array_equal(seen[0], seen[1])
    np.testing.assert_array_equal(seen[0], one["image"][0].numpy())
    assert abs(np.corrcoef(seen[0].ravel(), seen[2].ravel())[0, 1]) < 0.5


def test_fields_add_and_not_intensities():
    """A phase of pi on half of the pixels of an amplitude object is another image; a phase of all of them is none."""
    made = recipe(media=2)
    generator = SpeckleGenerator(made, seed=0, split="train")
    ready = generator.media([0])
    medium = ready.groups[0][1].media(ready.streams)
    picture = made.objects.image(0, "train", 0)
    turn = np.where(np.arange(10) < 5, -1.0, 1.0)
    waves = [made.object.light(field[None], made.geometry.width).spectrum(made.wavelength)[1]
             for field in (picture, picture * turn)]  # fmt: skip
    first, turned, whole = (
        medium.superposed(torch.from_numpy(each), 1.0)[0, 0].numpy() for each in (*waves, waves[0] * np.exp(0.7j))
    )
    np.testing.assert_allclose(whole, first, atol=1e-4)
    assert np.corrcoef(first.ravel(), turned.ravel())[0, 1] < 0.9


def test_kept_slabs_show_what_new_ones_do():
    """By modes, where many objects see a slab, and by light that walks, where each has its own: one mean, one grain."""
    thick = {"thickness": 200.0, "optical_depth": 12.0, "g": 0.8, "kernel": "estimate", "kernel_paths": 4000}
    images = [batch(recipe("coherent-slab", media=media, material=thick), numbers=range(40))["image"].numpy()
              for media in ("new", 40)]  # fmt: skip
    away = [np.asarray(each, float) - 1 for each in images]
    found = [np.stack([(each[:, :, s:] * each[:, :, : 32 - s]).mean(axis=(1, 2)) for s in (0, 1, 2, 3)], -1)
             for each in away]  # fmt: skip
    error = [each.std(axis=0, ddof=1) / 40**0.5 for each in found]
    assert np.abs(found[0].mean(axis=0) - found[1].mean(axis=0)).max() < 5.5 * np.hypot(*error).max()


def test_ballistic_light_is_that_of_the_scene():
    """Behind a weak screen: with it the image is brighter by the mean field's square, in the mean."""
    weak = {"wavelength": 0.633, "screens": [{"type": "PhaseScreen", "rms_phase": 1.0, "correlation_length": 10.0}]}
    made = recipe(material=weak, media="new")
    picture = made.objects.image(0, "train", 0)
    scene = made._view(made.material.extremes()[0]).full
    light = made.object.light(picture[None], made.geometry.width)
    scene = scene.replace(illumination=light)
    mean = np.square(np.abs(sg.statistics.mean_field(scene)[0]))
    power = np.square(np.abs(light.spectrum(0.633)[1])).sum() * made.geometry.width**2
    scattered = sg.plan(scene, sampler="screens").chosen.intensity / made.geometry.width**2 * power
    generator = SpeckleGenerator(made, seed=0, split="train")
    waves = torch.from_numpy(light.spectrum(0.633)[1])
    ready = generator.media(list(range(64)))
    seen = np.array([
        ready.groups[group][1].media(ready.streams.at([n])).superposed(waves, 1.0)[0, 0].numpy()
        for n, (group, _) in enumerate(ready.at)
    ])  # fmt: skip
    brightest = np.unravel_index(mean.argmax(), mean.shape)
    assert mean.max() > 2 * scattered
    assert_mean(seen[:, *brightest], 1 + mean.max() / scattered, slack=0.1)
    blocked = recipe(material=weak, media="new", object={**made.object.model_dump(), "ballistic": False})
    assert batch(blocked)["image"].max() < 20


@pytest.mark.parametrize("ballistic", [True, False])
def test_few_correlation_lengths_have_drawn_phases(ballistic):
    """Mean and mean square about the axis are those of the scene, with and without what is not scattered."""
    few = {"wavelength": 0.633, "screens": [{"type": "PhaseScreen", "rms_phase": 1.0, "correlation_length": 300.0}]}
    made = recipe(material=few, media="new", object={"pitch": 72.0, "ballistic": ballistic})
    light = made.object.light(made.objects.image(0, "train", 0)[None], made.geometry.width)
    scene = made._view(made.material.extremes()[0]).full.replace(illumination=light)
    plan = sg.plan(scene)
    assert "phases drawn on" in plan.explain()
    waves, count = light.spectrum(0.633)[1], 300
    expected = sg.render(scene, realizations=count, seed=5, mean=ballistic).intensity[:, 0]
    scale = plan.chosen.intensity * np.square(np.abs(waves)).sum()
    ready = SpeckleGenerator(made, seed=0).media(list(range(count)))
    found = np.array([
        ready.groups[group][1].media(ready.streams.at([n])).superposed(torch.from_numpy(waves), 1.0)[0, 0].numpy()
        for n, (group, _) in enumerate(ready.at)
    ])  # fmt: skip
    n = made._divisions
    expected = expected.reshape(count, 32, n, 32, n).mean(axis=(2, 4)) / scale

    def moments(images):
        middle = images[:, 14:18, 14:18]
        return np.stack([middle.mean(axis=(1, 2)), np.square(middle).mean(axis=(1, 2)), images.mean(axis=(1, 2))], -1)

    one, two = moments(found), moments(expected)
    assert_mean(one - two, 0.0)
    refute_mean(one - two * [2.0, 4.0, 2.0], 0.0)


@pytest.mark.parametrize(("changes", "message"), [
    ({"window": {"width": 300.0}}, r"CoherentObject\.width must be at least the side"),
    ({"window": {"profile": "disc"}}, "Fourier series"),
    ({"light": {"bandwidth": 0.001}}, "bandwidth must be"),
    ({"object": {"pitch": 0.2}}, "at least half a wavelength"),
    ({"object": {"modulation": "both"}}, "modulation"),
    ({"sampler": "paths"}, r"Recipe\.sampler must be .* minutes a sample"),
])  # fmt: skip
def test_refused(changes, message):
    assert_refused(lambda: recipe(**changes).sample(0, "train", 0), message)


def test_lengths_have_units():
    lengths = {"object": {"pitch": "0.072 mm", "distance": "23 cm"}, "window": {"width": "2.16 mm"}}
    made = load_recipe("coherent-digits", {**lengths, "material": {"wavelength": "0.633 um"}})
    assert (made.object.pitch, made.object.distance) == (72.0, 230000.0)
    assert made.fingerprint() == load_recipe("coherent-digits").fingerprint()


@pytest.mark.parametrize(("network", "kind"), [("unet", "camera"), ("residual", "autocorrelation")])
def test_networks_learn_by_the_command(network, kind, tmp_path):
    """A U-Net on the image and a network on the autocorrelation: the loss on what they see falls."""
    changes = ["camera.shape=[64,64]", "media=1", "samples.train=64"]
    told = CliRunner().invoke(app, [
        "train", "coherent-digits", *(word for each in changes for word in ("--set", each)), "--network", network,
        "--input", kind, "--loss", "pearson", "--width", "8", "--epochs", "4", "--batch-size", "16",
        "--validation-samples", "8", "--out", str(tmp_path),
    ])  # fmt: skip
    assert told.exit_code == 0, told.output
    losses = [row["train_loss"] for row in read_log(tmp_path)]
    assert losses[-1] < losses[0]


def test_networks_of_the_page_have_half_a_million_numbers_and_more():
    counts = [parameter_count(build(name, side, (28, 28), width, 0)) for name, side, width in
              (("unet", 128, 20), ("unet", 128, 32), ("residual", 64, 8))]  # fmt: skip
    assert all(400_000 <= count <= 2_000_000 for count in counts), counts


def test_reconstruction_from_the_autocorrelation_is_refused():
    for command in (["check", "recoverable", "coherent-digits"], ["reconstruct", "x.tif", "--setup", "coherent-slab"]):
        told = CliRunner().invoke(app, command)
        assert told.exit_code != 0
        assert "of coherent objects" in str(told.exception) + told.output


@pytest.mark.parametrize("frames", [2, pytest.param(5, marks=pytest.mark.slow)])
def test_frames_of_coherent_objects_are_recognised_and_others_are_not(frames):
    """Contrast near 1 is that of one field: most frames of three recipes, none of eight others and of two points."""
    for name, share in (("coherent-digits", 0.4), ("coherent-phase", 1.0), ("coherent-slab", 0.8)):
        batch = load_recipe(name).batch(1, "test", range(frames if frames > 2 or share < 0.5 else 1))["image"]
        found = [judge_photograph(image) for image in batch]
        coherent = [each for each in found if each.answer == "coherent object"]
        assert len(coherent) >= max(1, int(share * len(found))), (name, [each.evidence for each in found])
        assert all(each.probability == 0 for each in coherent)
        assert "specklegen train coherent-digits" in coherent[0].reasons[0].remedy
    two = {"objects": {"type": "Points", "count": 2, "faintest": 0.3, "shape": [28, 28]}, "media": 1}
    batch = load_recipe("through-slab", two).batch(1, "test", range(frames))["image"]
    points = [judge_photograph(image) for image in batch]
    assert all(each.answer != "coherent object" for each in points)
    assert any("no coherent object" in words for each in points for words in each.assumed)
    others = ("points-beyond-range", "ground-glass", "through-slab", "unknown-slab", "any-object",
              "beyond-memory-effect", "double-diffuser", "moving-diffuser")  # fmt: skip
    for name in others if frames > 2 else others[:1]:
        sample = load_recipe(name).sample(1, "test", 0)
        image = sample["image"] if "image" in sample else sample["frames"][0]
        assert judge_photograph(image).answer != "coherent object", name
