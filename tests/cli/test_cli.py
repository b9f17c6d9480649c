"""The command line, run as a stranger would."""

import csv
import json

import numpy as np
import pytest
from quick_recipes import few_paths
from typer.testing import CliRunner

from specklegen.cli import commands
from specklegen.core.errors import RuleError
from specklegen.datasets import recipe_names

COMMANDS = [
    "recipes", "plan", "render", "memory-effect", "reflectance", "generate", "preview", "info", "verify", "export",
    "train", "evaluate", "recoverable", "reconstruct", "compare",
]  # fmt: skip


def run(*words: str):
    return CliRunner().invoke(commands.app, [str(word) for word in words])


def succeed(*words: str) -> str:
    result = run(*words)
    assert result.exit_code == 0, result.output
    return result.output


def refused(*words: str) -> str:
    """The message with which a command refuses, of its own or of the parser of options."""
    result = run(*words)
    assert result.exit_code != 0
    if isinstance(result.exception, SystemExit):
        return result.output
    assert isinstance(result.exception, RuleError), result.exception
    return str(result.exception)


@pytest.mark.parametrize("command", COMMANDS)
def test_help(command):
    assert "--help" in succeed(command, "--help")


def test_recipes_are_listed_and_shown():
    assert "through-slab" in succeed("recipes")


def test_plan_says_what_it_does_and_costs():
    said = succeed("plan", "through-slab", "--samples", "10")
    for part in ("Sampler: stationary", "left out", "10 samples", "MiB on disk"):
        assert part in said


def test_render_writes_stack_picture_and_scene(tmp_path):
    succeed("render", "--views", "32", "--paths", "3000", "--tilts", "3", "--out", tmp_path / "a")
    field = np.load(tmp_path / "a/stack.npz")["field"]
    assert field.shape == (3, 32, 32)
    assert field.dtype == np.complex64
    assert (tmp_path / "a/stack.png").stat().st_size > 1000
    # The scene that was written renders to the same bits.
    succeed("render", "--scene", tmp_path / "a/scene.toml", "--paths", "3000", "--out", tmp_path / "b")
    assert np.array_equal(field, np.load(tmp_path / "b/stack.npz")["field"])


def test_memory_effect_writes_table_and_figure(tmp_path):
    succeed("memory-effect", "--g", "0", "--g", "0.9", "--paths", "5000", "--points", "5", "--out", tmp_path)
    rows = list(csv.DictReader((tmp_path / "memory-effect.csv").open()))
    assert len(rows) == 10
    assert float(rows[0]["intensity_correlation"]) == 1
    assert float(rows[4]["intensity_correlation"]) < 0.1 < float(rows[9]["intensity_correlation"])
    assert (tmp_path / "memory-effect.png").stat().st_size > 1000


def test_reflectance_writes_totals_and_densities(tmp_path):
    slab = ("--optical-depth", "2", "--g", "0.75", "--albedo", "0.9", "--index", "1.4", "--paths", "3000")
    words = succeed("reflectance", *slab, "--out", tmp_path / "light.csv")
    assert "specular: 0.02826" in words
    rows = list(csv.reader((tmp_path / "light.csv").open()))
    assert len(rows) == 31
    told = json.loads(succeed("reflectance", *slab, "--json"))
    assert told["reflectance"] + told["transmittance"] + told["absorptance"] == pytest.approx(1, abs=1e-12)
    assert len(told["transmitted"]) == 30


def test_generate_resumes_and_previews(tmp_path):
    store = tmp_path / "store.zarr"
    arguments = ("through-slab", "--out", store, "--processes", "1", "--set", "material.kernel_paths=2000")
    assert "8 of 8 samples" in succeed("generate", *arguments, "--samples", "8")
    assert "rendered 0" in succeed("generate", *arguments, "--samples", "8")
    assert json.loads(succeed("info", store))["done"] == 8
    succeed("verify", store)
    succeed("preview", store, "--samples", "3", "--out", tmp_path / "sheet.png")
    assert (tmp_path / "sheet.png").stat().st_size > 1000
    succeed("export", store, "--out", tmp_path / "npy")
    assert np.load(tmp_path / "npy/image.npy").shape == (8, 128, 128)


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (("generate", "nope", "--out", "x"), ["recipe must be one of", "through-slab", "nope", "specklegen recipes"]),
        (("plan", "through-slab", "--images", "/no/such/folder"), ["Folder.path", "/no/such/folder"]),
        (("plan", "through-slab", "--set", "material.g=1.0"), ["Material.g", "1.0"]),
        (("plan", "through-slab", "--set", "material.gg=1.0"), ["Material.gg", "no such field"]),
        (("plan", "through-slab", "--set", "material"), ["KEY=VALUE", "material"]),
        (("render", "--g", "1"), ["HenyeyGreenstein.g", "1.0"]),
        (("render", "--thickness", "-5"), ["thickness", "-5"]),
        (("render", "--pitch", "1e-4"), ["pitch", "0.0001", "5e-06"]),
        (("render", "--sampler", "magic"), ["sampler", "magic"]),
        (("render", "--scene", "/no/such.toml"), ["--scene", "/no/such.toml"]),
        (("memory-effect", "--mode", "sideways"), ["mode", "sideways"]),
        (("generate", "through-slab", "--out", "x", "--shard-range", "1"), ["--shard-range", "I/N"]),
    ],
)
def test_bad_input_is_named(words, says, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    message = refused(*words)
    for part in says:
        assert part in message, message


def test_an_unwritable_folder_is_found_at_once(tmp_path):
    (tmp_path / "file").write_text("in the way")
    assert "--out must be a writable folder" in refused("render", "--out", tmp_path / "file" / "sub")


def test_a_folder_without_images_is_named(tmp_path):
    assert "Folder.path must be a folder with pictures" in refused("plan", "through-slab", "--images", tmp_path)


def test_main_prints_the_message_and_exits(monkeypatch, capsys):
    monkeypatch.setattr("sys.argv", ["specklegen", "render", "--g", "1"])
    with pytest.raises(SystemExit) as exit_status:
        commands.main()
    assert exit_status.value.code == 2
    assert "error: HenyeyGreenstein.g must be" in capsys.readouterr().err


def test_verify_fails_on_damage_and_succeeds_once_it_is_mended(tmp_path):
    store, changes = tmp_path / "store.zarr", ("--set", "material.kernel_paths=2000")
    succeed("generate", "through-slab", "--out", store, "--processes", "1", "--samples", "8", *changes)
    shard = next(path for path in sorted((store / "image/c").rglob("*")) if path.is_file())
    content = bytearray(shard.read_bytes())
    content[100] ^= 1
    shard.write_bytes(content)
    assert run("verify", store).exit_code == 1
    assert "1 shard rendered again" in succeed("verify", store, "--repair", "through-slab", *changes)
    succeed("verify", store)


@pytest.mark.parametrize("name", recipe_names())
def test_every_recipe_has_a_picture(name, tmp_path):
    fewer = ["material.kernel_paths=2000"] if few_paths(name) else []
    changes = [word for change in (*fewer, "samples.train=4") for word in ("--set", change)]
    succeed("preview", name, "--samples", "2", "--out", tmp_path / "sheet.png", *changes)
    assert (tmp_path / "sheet.png").stat().st_size > 5000
