"""The command fit-setup: what it prints and writes, and what it refuses."""

import numpy as np
import pytest
from typer.testing import CliRunner

from specklegen.cli.commands import app
from specklegen.core.errors import RuleError


@pytest.fixture(scope="module")
def photograph(tmp_path_factory):
    rng = np.random.default_rng(0)
    x = np.arange(256) - 128
    iris = np.add.outer(x**2, x**2) < 32**2  # 4 pixels a grain
    waves = iris * (rng.normal(size=(256, 256)) + 1j * rng.normal(size=(256, 256)))
    light = np.abs(np.fft.ifft2(waves)) ** 2
    file = tmp_path_factory.mktemp("frames") / "photograph.npy"
    np.save(file, (500 * light / light.mean() + 20).round().astype(np.uint16))
    return file


def test_it_prints_and_draws(photograph, tmp_path):
    done = CliRunner().invoke(
        app, ["fit", "setup", str(photograph), "--dark", "20", "--points", "--picture", str(tmp_path / "a.png")]
    )
    assert done.exit_code == 0, done.output
    assert "pupil: disc" in done.output
    assert "grain: " in done.output
    assert (tmp_path / "a.png").stat().st_size > 1000


def test_what_is_refused(photograph):
    failed = CliRunner().invoke(app, ["fit", "setup", str(photograph), "--profile", "round"])
    assert isinstance(failed.exception, RuleError)
    assert "fit_setup profile must be" in str(failed.exception)
