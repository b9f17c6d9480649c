"""The command that trains: what it says first, and the table at its end."""

import json

from small_runs import TINY
from typer.testing import CliRunner

from specklegen.cli import commands
from specklegen.cli.learning import rendered_before

CHANGES = [
    word for part, fields in TINY.items() for name, value in fields.items()
    for word in ("--set", f"{part}.{name}={json.dumps(value)}")
]  # fmt: skip


def test_it_speaks_at_once_and_ends_with_a_table(tmp_path):
    command = ["train", "through-slab", *CHANGES, "--width", "4", "--epochs", "1", "--batch-size", "16",
               "--validation-samples", "4", "--seconds", "50", "--out", str(tmp_path / "run")]  # fmt: skip
    found = CliRunner().invoke(commands.app, command)
    assert found.exit_code == 0, found.output
    lines = found.output.splitlines()
    assert lines[0].startswith("train through-slab:")
    assert "--seconds 60" in lines[1]  # methods that take seconds are left out, and it says so
    table = (tmp_path / "run" / "summary.md").read_text()
    assert "| untrained network |" in table
    assert "| network |" in table
    assert table in found.output
    assert rendered_before(tmp_path / "run", 4) == 4
    assert rendered_before(tmp_path / "run", 5) is None
    assert rendered_before(tmp_path / "none", 4) is None
