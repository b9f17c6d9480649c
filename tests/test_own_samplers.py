"""A sampler of a user's own, as docs/extending.md writes it, serves scenes, recipes, stores and the command line."""

import importlib
import json
import re
import sys

import numpy as np
import pytest
import torch
from scenes import ROOT
from scipy.special import j0
from typer.testing import CliRunner
from zscore import assert_mean, refute_mean

import specklegen as sg
from specklegen.cli import commands
from specklegen.core.errors import RuleError
from specklegen.datasets import SpeckleCache, SpeckleStream, load_recipe
from specklegen.datasets.recipes.generator import SpeckleGenerator
from specklegen.datasets.recipes.parts.sampler import NUMBERS, OWN
from specklegen.datasets.store.generate import generate
from specklegen.datasets.store.verify import verify
from specklegen.samplers.sampler import SAMPLERS, Abilities, Sampler

PAGE = (ROOT / "docs" / "extending.md").read_text()
(WRITTEN,) = re.findall(r"```python\n(# one_distance\.py\n.*?)```", PAGE, re.DOTALL)
# Under names of its own: whatever runs the page's block in this process has defined those that stand there.
TEXT = WRITTEN.replace("one_distance", "tried_distance").replace("OneDistance", "TriedDistance")
TEXT = TEXT.replace("one-distance", "tried-distance")
RECIPE = """
inherits = "through-slab"
name = "tried-distance"
sampler = "tried_distance:TriedDistance"
material = {kernel_paths = 1000}
camera = {shape = [24, 24]}
objects = {shape = [8, 8]}
"""
TILT = 5e-4
SCENE = sg.Scene(
    wavelength=0.5, medium=sg.Slab(thickness=1000.0, mean_free_path=100.0, scatterer=sg.HenyeyGreenstein(0.9)),
    illumination=sg.CollimatedBeams.tilts([0.0, TILT], width=2000.0), sensor=sg.FarField.grid((8, 8), 1e-4),
)  # fmt: skip


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    place = tmp_path_factory.mktemp("samplers")
    (place / "tried_distance.py").write_text(TEXT)
    (place / "one.toml").write_text(RECIPE)
    importlib.invalidate_caches()
    return place


@pytest.fixture(scope="module")
def recipe(folder):
    return load_recipe(folder / "one.toml", trusted=True)


@pytest.fixture(scope="module")
def own(recipe):
    return sys.modules["tried_distance"]


def succeed(*words):
    found = CliRunner().invoke(commands.app, [str(word) for word in words])
    assert found.exit_code == 0, found.output
    return found.output


def test_scenes_are_rendered_by_class_name_and_path(own, folder):
    """Tilted beams are correlated as its closed form says, over 400 media; its pieces are its stack."""
    stacks = [
        sg.render(SCENE, sampler=asked, realizations=400, seed=1)
        for asked in (own.TriedDistance, "tried-distance", f"{folder}/tried_distance:TriedDistance")
    ]
    assert {stack.report.sampler for stack in stacks} == {"tried-distance"}
    assert all(np.array_equal(stack.field, stacks[0].field) for stack in stacks)
    made = sg.plan(SCENE, sampler=own.TriedDistance)
    assert (made.sampler, type(made.chosen)) == ("tried-distance", own.TriedDistance)
    assert "tried-distance" in made.explain()
    pieces = np.concatenate([field for _, field in sg.render_tiles(SCENE, sampler="tried-distance", seed=1)])
    np.testing.assert_allclose(pieces, stacks[0].field[0], rtol=0, atol=1e-5 * float(np.abs(pieces).max()))
    shifted = round(TILT / SCENE.sensor.pitch)  # speckle follows the beam
    one, other = stacks[0].field[:, 0, :, : 8 - shifted], stacks[0].field[:, 1, :, shifted:]
    area = SCENE.beams.window.area
    found = (one * other.conj()).mean((1, 2)).real / area
    assert_mean(found, float(j0(SCENE.wavenumber * TILT * own.DISTANCE)))
    refute_mean(found, float(j0(1.2 * SCENE.wavenumber * TILT * own.DISTANCE)))


def test_one_that_may_not_serve_says_why(own):
    fan = SCENE.replace(sensor=sg.FarField(SCENE.sensor.directions.reshape(-1, 3)))
    with pytest.raises(RuleError, match=r"sampler must be a sampler that supports the scene; .*regular far-field grid"):
        sg.plan(fan, sampler=own.TriedDistance)
    with pytest.raises(RuleError, match=r"sampler must be one of auto, .*tried-distance; got 'magic'"):
        sg.plan(SCENE, sampler="magic")


def test_a_recipe_is_rendered_by_it_wherever_it_is_named(recipe, own):
    same, named = (recipe.replace(sampler=asked) for asked in (own.TriedDistance, "tried-distance"))
    assert recipe == same == named
    assert recipe.own_classes() == [own.TriedDistance]
    assert {type(made.chosen) for made in recipe.plans()} == {own.TriedDistance}
    sample, plain = (each.sample(0, "train", 3) for each in (recipe, recipe.replace(sampler="stationary")))
    assert (sample["parameters"]["sampler"], plain["parameters"]["sampler"]) == (OWN, NUMBERS["stationary"])
    assert np.array_equal(sample["object"], plain["object"])
    assert not np.array_equal(sample["image"], plain["image"])
    assert recipe.fingerprint() != recipe.replace(sampler="stationary").fingerprint()
    assert "Rendered by the tried-distance sampler" in recipe.rendering_note
    assert SpeckleGenerator(recipe).report()["sampler"] == "tried-distance"
    with pytest.raises(RuleError, match=r"sampler must be one of 'auto', .*'tried-distance'; got 'covariance'"):
        recipe.replace(sampler="covariance")


def test_stores_and_streams_of_workers_hold_it_with_its_content(recipe, tmp_path):
    generate(recipe, samples=6, shard_samples=2, folder=tmp_path / "one.zarr", processes=2)
    cache = SpeckleCache(tmp_path / "one.zarr")
    stated = cache.identity["recipe"]["sampler"]
    assert stated["type"] == "tried-distance"
    assert len(stated["content_sha256"]) == 64
    np.testing.assert_array_equal(cache.numpy(5)["image"], recipe.sample(0, "train", 5)["image"])
    assert not verify(tmp_path / "one.zarr", recipe).damaged
    alone, several = (next(iter(SpeckleStream(recipe, batch_size=4).loader(n, timeout=120))) for n in (0, 1))
    assert torch.equal(alone["image"], several["image"])


def test_another_class_of_the_name_is_another_recipe(recipe, own, monkeypatch):
    """One number that its code names; what was written of the other is refused."""
    written, before = json.loads(recipe.canonical_json()), recipe.fingerprint()
    monkeypatch.setattr(own, "DISTANCE", 300.0)
    assert load_recipe("through-slab", {"sampler": own.TriedDistance}) != recipe
    assert recipe.replace(sampler=own.TriedDistance).fingerprint() != before
    with pytest.raises(RuleError, match=r"Recipe\.sampler must be unchanged, with SHA-256"):
        recipe.replace(sampler=written["sampler"])


def test_the_command_line_takes_its_path(folder, tmp_path):
    place = f"{folder}/tried_distance:TriedDistance"
    said = succeed("physics", "render", "--sampler", place, "--views", 16, "--tilts", 2, "--out", tmp_path / "stack")
    assert "Sampler:     tried-distance" in said
    said = succeed("generate", folder / "one.toml", "--out", tmp_path / "one.zarr", "--samples", 2)
    assert f"imports {place}, which runs its code" in said


def test_one_without_media_renders_no_recipe():
    class Scenes(Sampler):
        """Serves scenes alone."""

        @classmethod
        def propose(cls, scene, request):
            return None, []

        def prepare(self, seed, threads):
            raise NotImplementedError

    try:
        with pytest.raises(RuleError, match=r"Recipe\.sampler must be a sampler with prepare_media; got 'Scenes'"):
            load_recipe("through-slab", {"sampler": Scenes})
    finally:
        SAMPLERS._members.pop("Scenes")


def test_one_says_what_it_cannot_draw():
    class Volumes(Sampler):
        """Knows nothing of thin screens, nor of scenes without a grid."""

        abilities = Abilities(media="volumes")

        @classmethod
        def obstacles(cls, scene):
            return super().obstacles(scene) or ["needs a grid"] * (scene.sensor.regular_grid is None)

        @classmethod
        def propose(cls, scene, request):
            raise NotImplementedError

        def prepare(self, seed, threads):
            raise NotImplementedError

    thin = SCENE.replace(medium=sg.PhaseScreen(rms_phase=1.0, correlation_length=10.0))
    fan = SCENE.replace(sensor=sg.FarField(SCENE.sensor.directions.reshape(-1, 3)))
    try:
        for scene, obstacle in ((thin, "draws volumes of scatterers only"), (fan, "needs a grid")):
            with pytest.raises(RuleError, match=f"sampler must be .* The Volumes sampler {obstacle}"):
                sg.plan(scene, sampler=Volumes)
    finally:
        SAMPLERS._members.pop("Volumes")


@pytest.mark.parametrize(("name", "value"), [("films", True), ("operations", lambda self: {})])
def test_one_written_for_an_earlier_version_is_refused_by_name(name, value):
    with pytest.raises(RuleError, match=rf"Former\.{name} must be given by (abilities|cost\(\)); got .*extending"):
        type("Former", (Sampler,), {name: value})
