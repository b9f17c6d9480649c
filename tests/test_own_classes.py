"""What a user defines in a file of their own works from Python, from TOML and on the command line, workers included."""

import importlib
import json
import os
import pickle
import subprocess
import sys
import tomllib
from pathlib import Path

import numpy as np
import pytest
import torch
from refusals import assert_refused
from small_runs import DATA, HELD_OUT, SETTINGS, TINY
from typer.testing import CliRunner

import specklegen as sg
from specklegen.cli import commands
from specklegen.core.errors import RuleError
from specklegen.datasets import SpeckleCache, SpeckleStream, load_recipe
from specklegen.datasets.objects import Glyphs
from specklegen.datasets.recipes.generator import SpeckleGenerator
from specklegen.datasets.recipes.registry import recipe_schema
from specklegen.datasets.store.generate import generate
from specklegen.datasets.store.verify import verify
from specklegen.models import Reconstructor, Training, train

OWN = '''
import numpy as np
from torch import nn

import specklegen as sg
from specklegen.datasets.objects.family import DrawnFamily
from specklegen.datasets.recipes.tilt_stack import TiltStack
from specklegen.instrument.camera import Camera
from specklegen.models import Network


class Hoops(DrawnFamily):
    """Hoops of whole radii about the middle."""

    width: float = 1.0

    def propose(self, rng):
        return (int(rng.integers(2, min(self.shape) // 2)), int(rng.integers(1000)))

    def picture(self, source, rng):
        row, column = np.indices(self.shape) - np.array(self.shape)[:, None, None] / 2
        return np.abs(np.hypot(row, column) - source[0]) < self.width


class Shaded(Camera):
    """Detects less light towards the corners."""

    strength: float = 0.9

    def detected(self, image):
        light = super().detected(image)
        y, x = (np.linspace(-1, 1, n) for n in light.shape[-2:])
        return light * (1 - self.strength * (y[:, None] ** 2 + x**2) / 2)


class Inverted(TiltStack):
    """Stacks turned upside down."""

    white: float = 10.0

    def named(self, images, tilts, parameters):
        return super().named(self.white - images, tilts, parameters)


class Circle(sg.Sensor):
    """Views in a ring about the axis."""

    sine: float
    count: int = 16

    @property
    def directions(self):
        turn = 2 * np.pi * np.arange(self.count) / self.count
        x, y = self.sine * np.cos(turn), self.sine * np.sin(turn)
        return np.stack([x, y, np.full(self.count, np.sqrt(1 - self.sine**2))], -1)


class Peaked(sg.Scatterer):
    power: float

    def shape(self, cos, dimensions=3):
        return (1 + cos) ** self.power


class OneLayer(Network, name="own-layer"):
    """One layer."""

    def __init__(self, side, shape=(28, 28), width=16):
        super().__init__()
        self.shape, self.layer = shape, nn.Linear(2 * side**2, shape[0] * shape[1])

    def forward(self, pictures):
        return self.layer(pictures.flatten(1)).reshape(-1, *self.shape)
'''
HOOPS = """
inherits = "through-slab"
name = "hoops"
material = {kernel_paths = 1000}
camera = {shape = [32, 32]}
samples = {train = 24, validation = 8, test = 8}

[objects]
type = "specklegen_own:Hoops"
shape = [12, 12]
width = 1.5
"""
SMALL = {"material": {"kernel_paths": 1000}, "camera": {"shape": [32, 32]}}


@pytest.fixture(scope="session")  # a process that gets tests of this file in two parts imports one module, once
def folder(tmp_path_factory):
    """A folder with a module and a recipe that names it."""
    place = tmp_path_factory.mktemp("own")
    (place / "specklegen_own.py").write_text(OWN)
    (place / "hoops.toml").write_text(HOOPS)
    importlib.invalidate_caches()
    return place


@pytest.fixture(scope="module")
def recipe(folder):
    return load_recipe(folder / "hoops.toml", trusted=True)


@pytest.fixture(scope="module")
def own(recipe):
    return sys.modules["specklegen_own"]


def run(*words):
    return CliRunner().invoke(commands.app, [str(word) for word in words])


def succeed(*words):
    result = run(*words)
    assert result.exit_code == 0, result.output + repr(result.exception)
    return result.output


def in_another_process(folder, code):
    """Run code in a process that knows of the folder by what it is given alone; its output."""
    done = subprocess.run([sys.executable, "-c", code], cwd=folder.parent, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout.strip()


# Object families
def test_a_family_in_toml_and_in_python_is_one(recipe, own):
    assert type(recipe.objects) is own.Hoops
    same = load_recipe("through-slab", {**SMALL, "name": "hoops", "objects": own.Hoops(shape=(12, 12), width=1.5)})
    named = load_recipe("through-slab", {**SMALL, "objects": {"type": "Hoops", "shape": [12, 12], "width": 1.5}})
    assert recipe.fingerprint() == same.fingerprint() == named.fingerprint()
    picture = recipe.sample(0, "train", 0)["object"]
    assert set(np.unique(picture)) == {0.0, 1.0}
    np.testing.assert_array_equal(picture, recipe.objects.image(0, "train", 0))


def test_a_stream_with_workers_makes_the_same_samples(recipe):
    alone = list(SpeckleStream(recipe, batch_size=6).loader(0))
    several = list(SpeckleStream(recipe, batch_size=6).loader(2, timeout=120))
    assert len(alone) == len(several) == 4
    for one, other in zip(alone, several, strict=True):
        assert torch.equal(one["image"], other["image"])
        assert torch.equal(one["object"], other["object"])


def test_a_store_made_by_workers_is_verified(recipe, tmp_path):
    generate(recipe, samples=12, shard_samples=3, folder=tmp_path / "hoops.zarr", processes=2)
    cache = SpeckleCache(tmp_path / "hoops.zarr")
    for n in (0, 11):
        np.testing.assert_array_equal(cache.numpy(n)["image"], recipe.sample(0, "train", n)["image"])
    stated = cache.identity["recipe"]["objects"]
    assert stated["type"] == "Hoops"
    assert stated["content_sha256"] == recipe.objects.content_sha256
    assert not verify(tmp_path / "hoops.zarr", recipe).damaged


def test_the_command_line_generates_and_verifies(folder, tmp_path):
    store = tmp_path / "hoops.zarr"
    said = succeed("generate", folder / "hoops.toml", "--out", store, "--samples", 4)
    assert "4 of 4 samples" in said
    assert f"imports {folder}/specklegen_own:Hoops, which runs its code" in said
    assert "4 sound" in succeed("store", "verify", store)
    succeed("plan", folder / "hoops.toml", "--samples", 4)
    shown = tomllib.loads(succeed("recipes", "show", folder / "hoops.toml"))
    assert shown["objects"]["type"] == f"{folder}/specklegen_own:Hoops"


def test_files_from_outside_run_nothing_unless_trusted(tmp_path, monkeypatch):
    """A module that says when it is run: the recipe, the scene and the texts that name it are refused before."""
    outside, work, mark = tmp_path / "outside", tmp_path / "work", tmp_path / "ran"
    outside.mkdir()
    work.mkdir()
    source = f"from pathlib import Path\nPath({str(mark)!r}).touch()\nfrom specklegen.datasets.objects import Glyphs\n"
    for name in "abc":
        (outside / f"stranger_{name}.py").write_text(f"{source}class H{name}(Glyphs):\n    pass\n")
    written = scene(sg.FarField.grid((2, 2), 1e-3)).to_toml()
    (outside / "scene.toml").write_text(written.replace('type = "FarFieldGrid"', 'type = "stranger_b:Circle"'))
    for place in (outside, work):
        text = HOOPS.replace("specklegen_own:Hoops", f"{outside}/stranger_a:Ha").replace("width = 1.5", "")
        (place / "hoops.toml").write_text(text if place == work else text.replace(f"{outside}/", ""))
    monkeypatch.chdir(work)
    importlib.invalidate_caches()
    path = f"{outside}/stranger_a:Ha"
    table = {"type": path, "shape": [12, 12]}
    words = "not trusted.*stranger_.*trusted=True.*--trust"
    through = load_recipe("through-slab", SMALL)
    as_json = json.loads(through.canonical_json()) | {"objects": table}
    for act in (
        lambda: load_recipe(outside / "hoops.toml"),
        lambda: load_recipe("hoops.toml", trusted=False),
        lambda: type(through).from_json(json.dumps(as_json)),
        lambda: type(through).from_json(json.dumps(as_json | {"sampler": "stranger_a:S"})),
        lambda: sg.Scene.from_toml((outside / "scene.toml").read_text()),
    ):
        assert_refused(act, words)
    recipe, scene_file = outside / "hoops.toml", outside / "scene.toml"
    for command in (("generate", recipe, "--out", "a.zarr"), ("recipes", "show", recipe),
                    ("physics", "render", "--scene", scene_file), ("check", "compare", scene_file)):  # fmt: skip
        refused = run(*command)
        assert "not trusted" in str(refused.exception), command
        assert "runs its code" not in refused.output
    assert not mark.exists()
    assert "runs its code" in succeed("--trust", "plan", outside / "hoops.toml", "--samples", 4)
    assert mark.exists()
    mark.unlink()
    assert "SPECKLEGEN_TRUST" not in os.environ, "of that command alone"
    assert type(load_recipe(outside / "hoops.toml").objects).__name__ == "Ha", "its module is loaded now"
    monkeypatch.setenv("SPECKLEGEN_TRUST", "1")
    (outside / "b.toml").write_text(HOOPS.replace("specklegen_own:Hoops", "stranger_b:Hb").replace("width = 1.5", ""))
    load_recipe(outside / "b.toml")
    monkeypatch.delenv("SPECKLEGEN_TRUST")
    load_recipe("through-slab", SMALL | {"objects": table | {"type": f"{outside}/stranger_c:Hc"}})  # of the program
    assert mark.exists()


@pytest.mark.slow
def test_another_class_of_the_name_is_another_recipe(recipe, folder, tmp_path):
    """One number in the source: neither the fingerprint stays, nor does the store go on."""
    other = tmp_path / "changed"
    other.mkdir()
    (other / "specklegen_own.py").write_text(OWN.replace("source[0]) < self.width", "source[0]) <= self.width"))
    (other / "hoops.toml").write_text(HOOPS)
    code = "from specklegen.datasets import load_recipe; print(load_recipe({!r}).fingerprint())"
    found = [in_another_process(tmp_path, code.format(str(place / "hoops.toml"))) for place in (folder, other)]
    assert found[0] == recipe.fingerprint()
    assert found[1] != recipe.fingerprint()


def test_what_was_written_of_another_source_is_refused(own):
    written = json.loads(own.Hoops().canonical_json())
    assert own.Hoops(**written) == own.Hoops()
    assert_refused(lambda: own.Hoops(**written | {"content_sha256": "0" * 64}), r"Hoops content must be")


def test_a_class_that_workers_cannot_import_is_refused_with_advice(tmp_path):
    class Hidden(Glyphs):
        """Lies in a function."""

    here = load_recipe("through-slab", {**SMALL, "objects": Hidden(shape=(12, 12))})
    generate(here, samples=2, folder=tmp_path / "alone.zarr", processes=1)
    for start in (
        lambda: generate(here, samples=8, shard_samples=2, folder=tmp_path / "many.zarr", processes=2),
        lambda: SpeckleStream(here).loader(2),
    ):
        assert_refused(start, r"class Hidden must be defined at the top of a file")


def test_a_scatterer_by_its_path_reaches_workers_too(folder, own):
    scatterer = {"type": f"{folder}/specklegen_own:Peaked", "power": 40.0}
    made = load_recipe("through-slab", {"material": {"kernel_paths": 1000, "scatterer": scatterer}})
    assert made.material.scatterer["type"] == "Peaked"
    assert own.Peaked in made.material.scatterer.classes


# Networks
def test_a_network_is_trained_saved_and_read(own, tmp_path):
    model = train(SETTINGS.replace(network="own-layer", epochs=1), DATA, HELD_OUT, tmp_path)
    assert type(model.network) is own.OneLayer
    again = Reconstructor.load(tmp_path / "best.pt")
    assert torch.equal(again(HELD_OUT.inputs.float()), model(HELD_OUT.inputs.float()))
    stated = json.loads((tmp_path / "run.json").read_text())["training"]
    assert stated["network"] == "own-layer"
    assert len(stated["network_sha256"]) == 64


def test_what_a_network_does_not_see_or_tell_is_refused(own):
    with pytest.raises(RuleError, match=r"Training\.input must be one of .*periodogram, camera.*perceptron"):
        Training(network="own-layer", input="registered")
    with pytest.raises(RuleError, match=r"Training\.target must be one of object.*residual"):
        Training(network="own-layer", target="label")
    assert_refused(lambda: Training(network="one-lair"), r"Training\.network must be one of .*unet")


def test_a_model_imports_nothing(own, folder, tmp_path):
    """Where the class is not known the file is refused, whatever path it may hold; the command line is told one."""
    train(SETTINGS.replace(network="own-layer", epochs=1), DATA, HELD_OUT, tmp_path)
    code = (
        "from specklegen.models import Reconstructor\n"
        "try:\n    Reconstructor.load({!r})\nexcept ValueError as error:\n    print(error)"
    )
    said = in_another_process(tmp_path, code.format(str(tmp_path / "best.pt")))
    assert said.startswith("model network must be one of contrast, dense")


def test_the_command_line_trains_and_judges(own, folder, tmp_path):
    changes = [f"--set={name}={json.dumps(value)}" for name, value in (
        ("material.kernel_paths", 1000), ("camera.shape", [32, 32]), ("objects.shape", [12, 12]), ("samples.train", 8),
        ("samples.validation", 4),
    )]  # fmt: skip
    network = f"{folder}/specklegen_own:OneLayer"
    said = succeed("train", "through-slab", *changes, "--network", network, "--epochs", 1, "--validation-samples", 4,
                   "--batch-size", 4, "--out", tmp_path)  # fmt: skip
    assert "parameters" in said
    said = succeed("evaluate", tmp_path / "best.pt", "--network", network, "--recipe", "through-slab", *changes,
                   "--no-katz", "--samples", 4, "--out", tmp_path / "judged")  # fmt: skip
    assert "pearson" in said.lower()


# Sensors
def scene(sensor):
    slab = sg.Slab(thickness=100.0, mean_free_path=20.0, scatterer=sg.HenyeyGreenstein(0.5))
    light = sg.CollimatedBeams.tilts([0.0], width=2000.0)
    return sg.Scene(wavelength=0.5, medium=slab, illumination=light, sensor=sensor)


def test_a_sensor_renders_as_a_far_field_of_its_directions(own):
    """Its scene has another fingerprint, and so other paths; images agree in their mean (z below 5, one comparison)."""
    ring = own.Circle(sine=0.01)
    made, plain = scene(ring), scene(sg.FarField(ring.directions))
    np.testing.assert_array_equal(made.views, plain.views)
    assert made.sensor.shape == (16,)
    one, other = (
        np.square(np.abs([sg.render(each, paths=500, seed=seed).field[0] for seed in range(100)])).mean(1)
        for each in (made, plain)
    )
    spread = np.sqrt((one.var() + other.var()) / 100)
    assert abs(one.mean() - other.mean()) < 5 * spread
    assert abs(1.5 * one.mean() - other.mean()) > 5 * spread  # power


def test_a_sensor_in_toml_is_rendered_by_the_command_line(own, folder, tmp_path):
    table = scene(own.Circle(sine=0.01)).to_toml()
    assert sg.Scene.from_toml(table) == scene(own.Circle(sine=0.01))
    (folder / "ring.toml").write_text(table.replace('type = "Circle"', 'type = "specklegen_own:Circle"'))
    succeed("physics", "render", "--scene", folder / "ring.toml", "--paths", 500, "--out", tmp_path)
    assert np.load(tmp_path / "stack.npz")["field"].shape == (1, 16)


def test_a_sensor_of_points():
    class Line(sg.Sensor):
        """Points behind the slab."""

        distance: float

        @property
        def points(self):
            return np.array([[x, 0.0, 100.0 + self.distance] for x in (0.0, 1.0, 2.0)])

    line = Line(distance=20.0)
    assert line.near
    near = scene(line)
    assert sg.plan(near, paths=200, sampler="paths").sampler == "paths"
    np.testing.assert_array_equal(near.views, line.points)


def test_a_sensor_of_no_unit_vectors_is_refused():
    class Long(sg.Sensor):
        @property
        def directions(self):
            return np.ones((2, 3))

    assert_refused(lambda: scene(Long()), r"Long\.directions must be unit vectors")


def test_a_grid_that_is_none_is_refused():
    """Samplers know a grid by its pitch and its center; one with other directions would be rendered without them."""
    with pytest.raises(RuleError, match=r"Turned must be a regular grid, such as FarFieldGrid"):

        class Turned(sg.FarFieldGrid):
            @property
            def directions(self):
                return super().directions[::-1]

    assert "Turned" not in sg.Sensor.registry


# Kinds of recipe, cameras
def test_a_kind_of_recipe(own, folder, tmp_path):
    (folder / "negative.toml").write_text(
        'inherits = "tilt-stack"\nname = "negative"\nkind = "specklegen_own:Inverted"\ncamera = {shape = [32, 32]}\n'
    )
    recipe = load_recipe(folder / "negative.toml")
    assert type(recipe) is own.Inverted
    plain = load_recipe("tilt-stack", {"camera": {"shape": [32, 32]}})
    np.testing.assert_array_equal(recipe.sample(1, "train", 2)["stack"], 10 - plain.sample(1, "train", 2)["stack"])
    assert recipe.fingerprint() != recipe.replace(white=11.0).fingerprint() != plain.fingerprint()
    generate(recipe, samples=6, shard_samples=2, folder=tmp_path / "negative.zarr", processes=2)
    stack = SpeckleCache(tmp_path / "negative.zarr").numpy(5)["stack"]
    np.testing.assert_array_equal(stack, recipe.sample(0, "train", 5)["stack"])
    assert "white" in recipe_schema("Inverted")["properties"]


def test_a_camera_changes_stream_store_and_device_alike(own, folder, tmp_path):
    camera = {"type": f"{folder}/specklegen_own:Shaded", "photons": 500.0}
    recipe = load_recipe("tilt-stack", {"camera": {"shape": [32, 32]}, "exposure": camera})
    assert type(recipe.exposure) is own.Shaded
    first = recipe.sample(0, "train", 0)["stack"]
    stacks = np.stack([recipe.sample(0, "train", n)["stack"] for n in range(16)]).astype(float)
    corner, centre = stacks[..., :4, :4].mean(), stacks[..., 14:18, 14:18].mean()
    assert corner < 0.5 * centre
    generate(recipe, samples=1, folder=tmp_path / "dark.zarr", processes=1)
    np.testing.assert_array_equal(SpeckleCache(tmp_path / "dark.zarr").numpy(0)["stack"], first)
    np.testing.assert_array_equal(next(iter(SpeckleStream(recipe, batch_size=1)))["stack"][0].numpy(), first)
    assert SpeckleGenerator(recipe).report()["host"] == ["counts of a camera of a user's own"]
    stronger = recipe.replace(exposure=recipe.exposure.replace(strength=0.95))
    assert stronger != recipe
    assert stronger.fingerprint() != recipe.fingerprint()


def test_every_packaged_kind_is_shipped_without_classes(recipe):
    """What workers of packaged recipes read is as it was."""
    plain = load_recipe("through-slab", TINY)
    assert plain.own_classes() == []
    assert pickle.loads(pickle.dumps(plain)) == plain
    assert Path(sys.modules["specklegen_own"].__file__).name == "specklegen_own.py"
