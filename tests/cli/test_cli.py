"""The command line, run as a stranger would."""

import csv
import json
import shlex

import numpy as np
import pytest
import typer
from quick_recipes import few_paths, packaged
from scenes import DATA
from typer.testing import CliRunner
from zscore import assert_z

import specklegen as sg
from specklegen.cli import commands
from specklegen.cli.examples import EXAMPLES
from specklegen.core.errors import RuleError


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


def context_of(line: str):
    """What the parser makes of a line; it refuses an option that is none, or a wrong value."""
    command, words = typer.main.get_command(commands.app), shlex.split(line)
    while words and words[0] in getattr(command, "commands", {}):
        command, words = command.commands[words[0]], words[1:]
    return command.make_context("specklegen", words)


def listed_commands(group, path=""):
    """Yield commands and groups that help lists, by their words."""
    for name, command in group.commands.items():
        if not command.hidden:
            yield f"{path}{name}", command
            yield from listed_commands(command, f"{path}{name} ") if hasattr(command, "commands") else ()


def test_the_commands_of_newcomers_are_listed_first():
    listed = [line.split()[0] for line in succeed("--help").partition("Commands:\n")[2].splitlines() if line.strip()]
    first = "recipes plan preview generate train evaluate reconstruct retrieve memory-effect explore".split()
    assert listed[: len(first) + 4] == [*first, *commands.GROUPS]


def test_an_old_spelling_works_and_names_the_new_one():
    app = typer.main.get_command(commands.app)
    for old, new in commands.MOVED.items():
        group, name = new.split()
        assert app.commands[old].hidden
        shown = app.commands[group].commands[name]
        assert [each.opts for each in app.commands[old].params] == [each.opts for each in shown.params]
    for words in (["measured", "list"], ["reflectance", "--json"]):
        new = commands.MOVED[words[0]]
        old, now = run(*words), run(*new.split(), *words[1:])
        assert old.stderr == f"hint: `specklegen {words[0]}` is now `specklegen {new}`\n"
        assert old.stdout == now.stdout
    assert run("fit-setup").stderr.startswith("hint: `specklegen fit-setup` is now `specklegen fit setup`\n")


def test_every_command_has_examples_that_the_command_line_reads():
    listed = dict(listed_commands(typer.main.get_command(commands.app)))
    assert set(EXAMPLES) == listed.keys() - commands.GROUPS.keys()
    assert len(listed) > 25
    for name in EXAMPLES:
        assert f"  specklegen {EXAMPLES[name][0]}\n" in succeed(*name.split(), "--help")
    for line in (line for lines in EXAMPLES.values() for line in lines):
        assert context_of(line).params is not None
    with pytest.raises(Exception, match="No such option: --no-such"):
        context_of("plan through-slab --no-such")
    with pytest.raises(Exception, match="0 is not in the range|greater than or equal to 1"):  # older and newer parsers
        context_of("plan through-slab --samples 0")


def spelled_options(command, path="specklegen"):
    """Yield each argument and option of a command as `path spelling=default`, or with ! where it must be given."""
    for param in command.params:
        default = param.default() if callable(param.default) else param.default
        value = "!" if param.required else "" if default in (None, False, []) else f"={default}"
        yield f"{path} {'/'.join([*param.opts, *param.secondary_opts])}{value}"
    for name, inner in getattr(command, "commands", {}).items():
        yield from () if inner.hidden else spelled_options(inner, f"{path} {name}")


def test_options_keep_their_spelling_and_default():
    """Compare with the stored list; edit that list when an option is added or removed on purpose."""
    spelled = spelled_options(typer.main.get_command(commands.app))
    present = {line for line in spelled if not line.endswith("-completion")}  # those two are typer's
    assert present == set((DATA / "command_options.txt").read_text().splitlines())


def test_plan_says_what_it_does_and_costs():
    said = succeed("plan", "through-slab", "--samples", "10")
    for part in ("Sampler:     stationary", "Left out:    ", "Idealised:   faces", "10 samples", "MiB on disk"):
        assert part in said
    assert len(said.strip().splitlines()) == 9
    why = succeed("plan", "through-slab", "--samples", "10", "--verbose")
    assert "- faces: left out: idealised: no refractive-index mismatch" in why


def test_render_writes_stack_picture_and_scene(tmp_path):
    succeed("physics", "render", "--views", "32", "--paths", "3000", "--tilts", "3", "--out", tmp_path / "a")
    field = np.load(tmp_path / "a/stack.npz")["field"]
    assert field.shape == (3, 32, 32)
    assert field.dtype == np.complex64
    assert (tmp_path / "a/stack.png").stat().st_size > 1000
    # The scene that was written renders to the same bits.
    succeed("physics", "render", "--scene", tmp_path / "a/scene.toml", "--paths", "3000", "--out", tmp_path / "b")
    assert np.array_equal(field, np.load(tmp_path / "b/stack.npz")["field"])


def test_memory_effect_of_presets_faces_and_scenes(tmp_path):
    few = ("--paths", "2000", "--points", "3", "--largest", "0.5", "--json")
    matched = json.loads(succeed("memory-effect", *few, "--out", tmp_path))
    faced = json.loads(succeed("memory-effect", *few, "--index", "1.4", "--out", tmp_path))
    assert faced[0]["intensity_correlation"][1] < matched[0]["intensity_correlation"][1]
    skin = ("--material", "skin", "--wavelength", "0.806", "--thickness", "300")
    assert json.loads(succeed("memory-effect", *skin, *few, "--out", tmp_path))[0]["curve"] == "skin"
    assert "memory-effect --g must be left out with --material" in refused("memory-effect", *skin, "--g", "0.5")
    layer = {"thickness": 5.0, "mean_free_path": 5.0, "scatterer": sg.Isotropic()}
    scene = sg.Scene(wavelength=0.5, medium=sg.Layers(layers=[sg.Layer(**layer), sg.Layer(**layer)]),
                     illumination=sg.CollimatedBeams.tilts([0.0], width=500.0),
                     sensor=sg.FarField.grid((4, 4), 1e-3))  # fmt: skip
    (tmp_path / "two.toml").write_text(scene.to_toml())
    said = json.loads(succeed("memory-effect", "--scene", tmp_path / "two.toml", *few, "--out", tmp_path))[0]
    medium = scene.medium
    curve = sg.memory_effect(medium, wavelength=0.5, tilts=np.deg2rad([0, 0.25, 0.5]), paths=2000)
    assert said["curve"] == "two"
    np.testing.assert_array_equal(said["intensity_correlation"], curve.intensity)
    assert "--wavelength must be left out with --scene" in refused(
        "memory-effect", "--scene", tmp_path / "two.toml", "--wavelength", "0.5"
    )


def test_memory_effect_writes_table_and_figure(tmp_path):
    succeed("memory-effect", "--g", "0", "--g", "0.9", "--paths", "5000", "--points", "5", "--out", tmp_path)
    rows = list(csv.DictReader(line for line in (tmp_path / "memory-effect.csv").open() if line[0] != "#"))
    assert len(rows) == 10
    assert float(rows[0]["intensity_correlation"]) == 1
    ends = [float(rows[n]["intensity_correlation"]) for n in (4, 9)]
    assert ends[0] < ends[1] < 0.15, "by default it goes on until a tenth of the slowest is left, and not much further"
    assert float(rows[7]["intensity_correlation"]) > 0.15
    assert (tmp_path / "memory-effect.png").stat().st_size > 1000


@pytest.mark.parametrize(("given", "unit"), [
    (("--wavelength", "532nm", "--thickness", "0.5 mm"), "micrometre"), (("--thickness", "0.5 mm"), "micrometre"),
    (("--wavelength", "0.532", "--thickness", "500"), "length of the scene"),
    (("--wavelength", "532nm", "--material", "skin"), "micrometre"),
])  # fmt: skip
def test_the_unit_in_a_table_is_that_of_its_numbers(tmp_path, given, unit):
    succeed("memory-effect", *given, "--paths", "500", "--points", "3", "--largest", "0.01", "--out", tmp_path)
    notes = [line for line in (tmp_path / "memory-effect.csv").open() if line[0] == "#"]
    said = dict(line.strip().partition(": ")[2].split(" = ", 1) for line in notes)
    assert said["wavelength_unit"] == unit
    assert 0.35 < float(said["wavelength"]) < 0.54
    assert 100 <= json.loads(said["medium"])["thickness"] <= 1000


def test_memory_effect_in_time(tmp_path):
    """A table of |g1|^2 in units of 1/(D k^2) or of a time, as temporal_correlation has it; bad lags are named."""
    few = ("--g", "0", "--paths", "5000", "--points", "5", "--out", tmp_path)
    succeed("memory-effect", "--lags", "0.02", *few)
    rows = list(csv.DictReader(line for line in (tmp_path / "memory-effect.csv").open() if line[0] != "#"))
    found = np.array([float(row["intensity_correlation"]) for row in rows])
    lags = np.linspace(0, 0.02, 5)
    np.testing.assert_allclose([float(row["x"]) for row in rows], lags, rtol=1e-5)
    slab = sg.Slab(thickness=100.0, mean_free_path=10.0, scatterer=sg.Isotropic(), motion=sg.Brownian(diffusion=1.0))
    law = sg.temporal_correlation(slab, wavelength=2 * np.pi, lags=lags, paths=5000, seed=3)
    assert_z(found[1:], law.intensity[1:], 2**0.5 * law.standard_error[1:])
    assert (tmp_path / "memory-effect.png").stat().st_size > 1000
    said = json.loads(succeed("memory-effect", "--lags", "1e-3", "--diffusion", "0.5", *few, "--json"))[0]
    assert said["lag"][-1] == pytest.approx(1e-3)
    assert said["x"][-1] == pytest.approx(0.5 * (2 * np.pi / 0.5) ** 2 * 1e-3, rel=1e-6)
    for words, says in (
        (("--lags", "-1"), "--lags must be above 0 and finite"),
        (("--lags", "nan"), "--lags must be above 0 and finite"),
        (("--diffusion", "1"), "--diffusion must be left out without --lags"),
        (("--lags", "1", "--material", "ground-glass", "--wavelength", "0.5"), "--lags must be left out for thin"),
    ):
        assert says in refused("memory-effect", *words), words


def test_reflectance_writes_totals_and_densities(tmp_path):
    slab = ("--optical-depth", "2", "--g", "0.75", "--albedo", "0.9", "--index", "1.4", "--paths", "3000")
    words = succeed("physics", "reflectance", *slab, "--out", tmp_path / "light.csv")
    assert "specular: 0.02826" in words
    rows = list(csv.reader((tmp_path / "light.csv").open()))
    assert len(rows) == 31
    told = json.loads(succeed("physics", "reflectance", *slab, "--json"))
    assert told["reflectance"] + told["transmittance"] + told["absorptance"] == pytest.approx(1, abs=1e-12)
    assert len(told["transmitted"]) == 30


def test_generate_resumes_and_previews(tmp_path):
    store = tmp_path / "store.zarr"
    arguments = ("through-slab", "--out", store, "--processes", "1", "--set", "material.kernel_paths=2000")
    assert "8 of 8 samples" in succeed("generate", *arguments, "--samples", "8")
    assert "rendered 0" in succeed("generate", *arguments, "--samples", "8")
    assert json.loads(succeed("store", "info", store))["done"] == 8
    succeed("store", "verify", store)
    succeed("preview", store, "--samples", "3", "--out", tmp_path / "sheet.png")
    assert (tmp_path / "sheet.png").stat().st_size > 1000
    succeed("store", "export", store, "--out", tmp_path / "npy")
    assert np.load(tmp_path / "npy/image.npy").shape == (8, 128, 128)


@pytest.mark.parametrize(("table", "says"), [
    ("[material]\ng = 2.0", "error: material.g must be between -1 and 1"),
    ("[material]\nscatterer = {type = 'HenyeyGreenstein', g = 2.0}", "error: material.scatterer.g must be between"),
    ("[material]\nscatterer = {type = 'Tabulated'}", "error: material.scatterer."),
    ("[objects]\nshap = [8, 8]", "error: objects.shap must be left out: there is no such field; got [8, 8]."),
    ("g = 0.5", "error: g must be left out: there is no such field; got 0.5. Did you mean material.g?"),
    ("[matrial]\ng = 0.5", "Did you mean material?"),
    ("[samples]\ntrain = 0", "error: samples.train must be at least 1"),
    ("kind = 'hiden-object'", "error: recipe.kind must be"),
    ("[objects]\ntype = 'Folder'\npath = 'nowhere'", "error: objects.path must be an existing folder"),
])  # fmt: skip
def test_errors_speak_of_the_tables_of_a_file(table, says, tmp_path, capsys):
    file = tmp_path / "mine.toml"
    top, _, rest = table.partition("[")
    file.write_text(f'inherits = "through-slab"\n{top}\n' + (f"[{rest}" if rest else ""))
    with pytest.raises(SystemExit) as end:
        commands.main(["plan", str(file)])
    assert end.value.code == 2
    assert says in capsys.readouterr().err


def test_a_recipe_of_no_kind_is_told_what_to_inherit(tmp_path, capsys):
    (tmp_path / "mine.toml").write_text("[material]\ng = 0.5\n")
    with pytest.raises(SystemExit):
        commands.main(["plan", str(tmp_path / "mine.toml")])
    assert 'recipe.kind must be given; got None. Write `inherits = "through-slab"`' in capsys.readouterr().err


def test_verify_fails_on_damage_and_succeeds_once_it_is_mended(tmp_path):
    store, changes = tmp_path / "store.zarr", ("--set", "material.kernel_paths=2000")
    succeed("generate", "through-slab", "--out", store, "--processes", "1", "--samples", "8", *changes)
    shard = next(path for path in sorted((store / "image/c").rglob("*")) if path.is_file())
    content = bytearray(shard.read_bytes())
    content[100] ^= 1
    shard.write_bytes(content)
    assert run("store", "verify", store).exit_code == 1
    assert "1 shard rendered again" in succeed("store", "verify", store, "--repair", "through-slab", *changes)
    succeed("store", "verify", store)


@pytest.mark.parametrize("name", packaged())
def test_every_recipe_has_a_picture(name, tmp_path):
    fewer = ["material.kernel_paths=2000"] if few_paths(name) else []
    smaller = {"flow-vessel": ["camera.shape=[48,48]"], "refocus-stack": ["lens.planes=2"]}.get(name, [])
    changes = [word for change in (*fewer, *smaller, "samples.train=4") for word in ("--set", change)]
    succeed("preview", name, "--samples", "2", "--out", tmp_path / "sheet.png", *changes)
    assert (tmp_path / "sheet.png").stat().st_size > 5000
