"""What commands say: numbers as JSON, words that fit their number, the right exit status."""

import json
import os
import re
import signal
import subprocess
import sys
import time
import tomllib
from math import inf, nan
from pathlib import Path

import numpy as np
import pytest
from scenes import ROOT
from test_packaging import IMPORT_NAMES
from typer.testing import CliRunner

from specklegen import __version__
from specklegen.cli import commands
from specklegen.cli.failures import told
from specklegen.cli.output import json_text
from specklegen.datasets import recipe_names
from specklegen.datasets.store.shards import DamagedShard, MissingSample

SMALL = ("--set", "material.kernel_paths=2000")


def run(*words):
    return CliRunner().invoke(commands.app, [str(word) for word in words])


def answer(*words):
    """What a command answers with --json."""
    result = run(*words, "--json")
    assert result.exit_code == 0, result.output
    return json.loads(result.stdout)


def said_by_main(capsys, *words) -> tuple[int, str]:
    """Exit status and message of the whole program."""
    with pytest.raises(SystemExit) as end:
        commands.main([str(word) for word in words])
    return end.value.code, capsys.readouterr().err


@pytest.fixture(scope="module")
def store(tmp_path_factory):
    """A store of 4 samples in shards of one."""
    folder = tmp_path_factory.mktemp("stores") / "store.zarr"
    assert run("generate", "through-slab", "--out", folder, "--samples", 4, "--processes", 1, *SMALL).exit_code == 0
    return folder


def test_version():
    assert run("--version").output == f"specklegen {__version__}\n"


def test_numbers_as_json(tmp_path, store):
    assert [row["name"] for row in answer("recipes", "--all")] == list(recipe_names())
    assert [row["name"] for row in answer("recipes")] == list(recipe_names()[:6])
    assert answer("recipes", "show", "through-slab", "--set", "material.g=0.5")["material"]["g"] == 0.5
    planned = answer("plan", "through-slab", "--samples", 2, *SMALL)
    assert planned["cost"]["samples"] == 2
    assert planned["plans"][0]["sampler"] in ("paths", "stationary", "covariance")
    curves = answer("memory-effect", "--paths", 500, "--points", 3, "--g", 0, "--g", 0.9, "--out", tmp_path)
    assert [len(curve["intensity_correlation"]) for curve in curves] == [3, 3]
    checked = answer("store", "verify", store)
    assert checked["complete"]
    assert checked["shards"] == 4
    rows = answer("evaluate", "--recipe", "through-slab", "--samples", 2, "--no-katz", "--out", tmp_path / "judged",
                  *SMALL)  # fmt: skip
    assert {row["method"] for row in rows} == {"another object", "mean image", "packaged network"}
    assert answer("check", "compare", "through-slab", "--seconds", 0.01)["runs"]


def test_verify_tells_a_store_that_is_not_whole(store, tmp_path):
    assert "4 shards: 4 sound" in run("store", "verify", store).output
    begun = tmp_path / "begun.zarr"
    run("generate", "through-slab", "--out", begun, "--samples", 4, "--shard-range", "0/4", "--processes", 1, *SMALL)
    result = run("store", "verify", begun)
    assert result.exit_code == 1
    assert "4 shards: 1 sound, 3 unfinished (numbers 1, 2, 3)" in result.output
    assert "generate" in result.output


@pytest.mark.parametrize(("words", "says"), [
    (("plan", "through-slab", "--samples", "-3"), "--samples"),
    (("plan", "thruogh-slab"), "Did you mean through-slab?"),
    (("physics", "render", "--tilts", "0"), "--tilts"),
    (("physics", "render", "--thickness", "0"), "--thickness must be greater than 0"),
    (("physics", "render", "--sampler", "magic"), "stationary"),
    (("memory-effect", "--points", "0"), "--points"),
    (("memory-effect", "--points", "1"), "--points"),
    (("memory-effect", "--largest", "-1"), "--largest must be above 0"),
    (("train", "through-slab", "--out", "run", "--device", "gpu"), "--device must be a device that torch has"),
    (("train", "through-slab", "--out", "run", "--device", "meta"), "--device must be a device that torch has"),
    (("generate", "through-slab", "--out", "x.zarr", "--shard-range", "²/3"), "must be of the form I/N"),
    (("preview", "through-slab", "--out", "x.pdf"), "preview --out must be a file whose name ends in .png"),
    (("check", "compare", "through-slab", "--seconds", "nan"), "--seconds must be greater than 0"),
    (("evaluate", "text.toml"), "model must be a file written by Reconstructor.save"),
    (("plan", "folder/inside"),
     "recipe must be an existing file, or the name of a packaged recipe; got 'folder/inside'"),
    (("physics", "render", "--scene", "folder"), "--scene must be an existing file"),
    (("physics", "render", "--scene", "text.toml"), "wavelength must be given"),
    (("physics", "render", "--scene", "text.toml", "--g", "0.5", "--tilts", "3"),
     "render --g, --tilts must be left out"),
    (("store", "export", "folder", "--out", "x"), "store.folder must be a folder that holds a store"),
])  # fmt: skip
def test_what_stops_a_command_is_a_line(words, says, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "folder").mkdir()
    (tmp_path / "text.toml").write_text('description = "x"\n')
    status, message = said_by_main(capsys, *words)
    assert status == 2
    assert says in message
    assert "Traceback" not in message


@pytest.mark.parametrize("name", ["zarr.json", "image/zarr.json", "parameters/zarr.json"])
def test_a_store_with_damaged_metadata_is_refused(store, tmp_path, capsys, name):
    folder = tmp_path / "copy.zarr"
    subprocess.run(["cp", "-r", store, folder], check=True)
    (folder / name).write_text("{")
    status, message = said_by_main(capsys, "store", "verify", folder)
    assert status == 2
    assert "store metadata must be as written" in message
    assert f"{name} (damaged)" in message


def test_errors_of_the_system_are_told_and_defects_are_not():
    assert told(PermissionError(13, "Permission denied", "/x/y")) == "Permission denied: /x/y"
    assert told(DamagedShard("shard 3 is damaged")) == "shard 3 is damaged"
    assert told(MissingSample("sample 3")) == "sample 3"
    assert "nested" in str(told(RecursionError()))
    assert "pip install 'specklegen-torch[dask]'" in str(told(ModuleNotFoundError("no", name="distributed")))
    assert told(TypeError("a defect")) is None


def test_a_package_of_an_extra_that_is_missing_is_named_with_its_extra():
    """Every one that the package imports, under the name that it is imported by."""
    extras = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["optional-dependencies"]
    for extra in extras.keys() - {"dev", "docs", "all"}:
        for line in extras[extra]:
            package = re.split(r"[<>=\[]", line)[0].lower()
            name = IMPORT_NAMES.get(package, package.replace("-", "_"))
            said = told(ModuleNotFoundError("no", name=f"{name}.inner"))
            assert said is not None
            assert said.startswith(f"this needs the package {name}: pip install 'specklegen-torch[{extra}]'")


@pytest.mark.slow
def test_two_calls_report_what_each_has_rendered(tmp_path):
    """Together the whole, and no more: what the other did is not counted."""
    words = ["generate", "through-slab", "--out", "both.zarr", "--samples", "32", "--processes", "1", *SMALL]
    calls = [
        subprocess.Popen([sys.executable, "-m", "specklegen", *words], cwd=tmp_path,
                         env=os.environ | {"PYTHONPATH": str(ROOT)}, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL,
                         text=True)
        for _ in range(2)
    ]  # fmt: skip
    said = [call.communicate(timeout=300)[0] for call in calls]
    rendered = [int(text.partition("rendered ")[2].partition(" ")[0]) for text in said]
    assert sum(rendered) == 32
    assert all(text.startswith("32 of 32 samples") for text in said)


def test_ctrl_c_says_that_the_store_goes_on(tmp_path):
    store = tmp_path / "long.zarr"
    words = ["generate", "through-slab", "--out", str(store), "--samples", "4000", "--processes", "1", *SMALL]
    call = subprocess.Popen([sys.executable, "-m", "specklegen", *words], cwd=tmp_path,
                            env=os.environ | {"PYTHONPATH": str(ROOT)}, stdout=subprocess.DEVNULL,
                            stderr=subprocess.PIPE, text=True)  # fmt: skip
    ledger = Path(store) / "valid" / "c"
    for _ in range(6000):
        if ledger.is_dir() and any(ledger.iterdir()):
            break
        time.sleep(0.1)
    call.send_signal(signal.SIGINT)
    told_last = call.communicate(timeout=600)[1]
    assert call.returncode == 130
    assert "Run the same command again to resume" in told_last
    assert "Traceback" not in told_last


@pytest.mark.parametrize(("lines", "seed"), [pytest.param(600, 1, marks=pytest.mark.slow)])
def test_random_lines_end_in_an_answer_or_a_message(lines, seed):
    done = subprocess.run([sys.executable, "tests/fuzz_command_line.py", "--lines", str(lines), "--seed", str(seed)],
                          cwd=ROOT, capture_output=True, text=True,
                          env=os.environ | {"PYTHONPATH": str(ROOT)})  # fmt: skip
    assert done.returncode == 0, done.stdout[-4000:] + done.stderr[-2000:]
    assert f" {0} traceback" in done.stdout


@pytest.mark.parametrize("words", [("evaluate", "model.pt", "--samples"),
                                   ("train", "through-slab", "--out", "run", "--validation-samples")])  # fmt: skip
def test_more_images_than_fit_are_refused_by_the_option(words, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    result = run(*words, 10**23)
    assert result.exit_code == 2
    assert f"Invalid value for '{words[-1]}'" in result.output
    assert not list(tmp_path.iterdir())


def test_json_is_json():
    """Numbers that are not finite have no word in it: null, and not Infinity, which readers of JSON refuse."""
    assert json.loads(json_text({"low": -inf, "each": (nan, np.float64(inf), 1.0)}), parse_constant=pytest.fail) == {
        "low": None, "each": [None, None, 1.0],
    }  # fmt: skip
