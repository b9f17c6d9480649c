"""The command twin: what it prints and writes, and what it refuses."""

import json

import numpy as np
import pytest
from typer.testing import CliRunner

from specklegen.cli.commands import app
from specklegen.core.errors import RuleError
from specklegen.models.calibration.point_speckle import PointSpeckle


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    place = tmp_path_factory.mktemp("run")
    for n, light in enumerate(PointSpeckle("disc", 3.4, 1.0, 0.0, False).draw((96, 96), 3, 1)):
        np.save(place / f"frame_{n}.npy", np.rint(2000 * light + 20).astype(np.uint16))
    return place


def test_it_prints_and_writes(folder, tmp_path):
    out, picture = tmp_path / "twin.toml", tmp_path / "twin.png"
    words = ["fit", "twin", str(folder), "--dark", "20", "--points", "--images", "8"]
    done = CliRunner().invoke(app, [*words, "--out", str(out), "--picture", str(picture)])
    assert done.exit_code == 0, done.output
    assert "verdict: indistinguishable in 3 images" in done.output
    assert "grain = " in out.read_text()
    assert picture.stat().st_size > 1000
    told = json.loads(CliRunner().invoke(app, [*words, "--json"]).output)
    assert {"contrast", "spectrum"} <= {each["name"] for each in told["compared"]}


def test_what_is_refused(folder):
    failed = CliRunner().invoke(app, ["fit", "twin", str(folder), "--images", "2"])
    assert isinstance(failed.exception, RuleError)
    assert "twin images must be" in str(failed.exception)
