"""The command fit-material: what it prints and writes, and what it refuses."""

from pathlib import Path

import pytest
from typer.testing import CliRunner

from specklegen.cli.commands import app
from specklegen.core.errors import RuleError
from specklegen.datasets import load_recipe

DATA = Path(__file__).parents[2] / "docs/data"
WORDS = ["fit", "material", "--wavelength", "0.5", "--tilt", str(DATA / "bench-a-tilts.csv"), "--known",
         "thickness=715"]


def invoke(*words):
    return CliRunner().invoke(app, [*WORDS, *words])


def test_a_recipe_is_written_and_intervals_are_printed(tmp_path):
    done = invoke("--transmittance", ".7921+-.0157", "--known", "g=0.7944", "--out", str(tmp_path / "my-bench.toml"))
    assert done.exit_code == 0, done.output
    assert "mean_free_path: 21" in done.output
    assert "(95 %: " in done.output
    assert str(tmp_path / "my-bench.toml") in done.output
    recipe = load_recipe(tmp_path / "my-bench.toml")
    assert recipe.name == "my-bench"
    assert recipe.material.thickness == pytest.approx(715.0)


@pytest.mark.parametrize(("words", "rule"), [
    (("--transmittance", "a third"), "fit material --transmittance must be a number"),
    (("--transmittance", "31"), "Transmittance value must be a share"),
    (("--known", "g"), "fit material --known must be a name and a number"),
    (("--out", "bench.txt"), "fit material --out must be a file whose name ends in .toml"),
    (("--free", "depth"), "fit_material free must be made of"),
    (("--tilt", "nowhere.csv"), "read_curve path must be an existing file; got 'nowhere.csv'."),
])  # fmt: skip
def test_what_cannot_be_is_refused(words, rule):
    done = invoke(*words)
    assert isinstance(done.exception, RuleError)
    assert str(done.exception).startswith(rule)
