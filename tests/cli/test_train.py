"""The command that trains: what it says first, and the table at its end."""

import json

import torch
from small_runs import CHANGES, checkpoint, flat
from small_stores import contents
from typer.testing import CliRunner

from specklegen.cli import commands, training
from specklegen.cli.training import rendered_before
from specklegen.datasets.store.info import info


def test_it_speaks_at_once_and_ends_with_a_table(tmp_path):
    command = ["train", "through-slab", *CHANGES, "--width", "4", "--epochs", "1", "--batch-size", "16",
               "--validation-samples", "4", "--seconds", "50", "--out", str(tmp_path / "run")]  # fmt: skip
    found = CliRunner().invoke(commands.app, command)
    assert found.exit_code == 0, found.output
    lines = found.output.splitlines()
    assert lines[0].startswith("Training on through-slab:")
    assert "--seconds 60" in lines[1]  # methods that take seconds are left out, and it says so
    table = (tmp_path / "run" / "summary.md").read_text()
    assert "| untrained network |" in table
    assert "| network |" in table
    assert table in found.output
    assert rendered_before(tmp_path / "run", 4) == 4
    assert rendered_before(tmp_path / "run", 5) is None
    assert rendered_before(tmp_path / "none", 4) is None


def test_it_starts_from_a_model(tmp_path):
    """The table names what it started from; options of another kind of network are refused before anything is drawn."""
    common = ["train", "through-slab", *CHANGES, "--epochs", "1", "--batch-size", "16", "--validation-samples", "4",
              "--seconds", "50"]  # fmt: skip
    first = tmp_path / "first"
    found = CliRunner().invoke(commands.app, [*common, "--width", "4", "--out", str(first)])
    assert found.exit_code == 0, found.output
    words = [*common, "--start", str(first / "best.pt"), "--out", str(tmp_path / "second")]
    found = CliRunner().invoke(commands.app, words)
    assert found.exit_code == 0, found.output
    assert "| network at the start |" in (tmp_path / "second" / "summary.md").read_text()
    assert json.loads((tmp_path / "second" / "run.json").read_text())["training"]["width"] == 4
    refused = CliRunner().invoke(commands.app, [*words, "--network", "residual"])
    assert "train --network must be left out, or that of the model to start from (unet)" in str(refused.exception)


def test_it_trains_on_samples_drawn_by_the_law(tmp_path):
    """The run says so in its record; another input is refused before anything is drawn."""
    common = ["train", "through-slab", *CHANGES, "--law", "--epochs", "1", "--batch-size", "16", "--width", "4",
              "--validation-samples", "4", "--seconds", "50", "--out", str(tmp_path / "run")]  # fmt: skip
    found = CliRunner().invoke(commands.app, [*common, "--input", "periodogram"])
    assert found.exit_code == 0, found.output
    assert json.loads((tmp_path / "run" / "run.json").read_text())["data"]["recipe"]["drawn_by"] == "law"
    assert "| network |" in (tmp_path / "run" / "summary.md").read_text()
    refused = CliRunner().invoke(commands.app, common)
    assert "train --input must be periodogram with --law" in str(refused.exception)


def test_a_second_run_reads_what_the_first_one_rendered(tmp_path, monkeypatch):
    """The weights of a run without a cache; a store of another seed is refused by the field that differs."""
    monkeypatch.setattr(training, "_methods", lambda *_: {})  # which take seconds
    common = ["train", "through-slab", *CHANGES, "--width", "4", "--epochs", "1", "--batch-size", "16",
              "--validation-samples", "4"]  # fmt: skip
    cache = tmp_path / "cache.zarr"
    for name, words in (("plain", ()), ("first", ("--cache", cache)), ("second", ("--cache", cache))):
        before = contents(cache) if name == "second" else {}
        found = CliRunner().invoke(commands.app, [*common, *map(str, words), "--out", str(tmp_path / name)])
        assert found.exit_code == 0, found.output
        assert before in ({}, contents(cache))
        assert all(
            torch.equal(a, b)
            for a, b in zip(flat(checkpoint(tmp_path / "plain")["network"]),
                            flat(checkpoint(tmp_path / name)["network"]), strict=True)
        )  # fmt: skip
    assert info(cache)["done"] == 24
    refused = CliRunner().invoke(commands.app, [*common, "--seed", "1", "--cache", str(cache), "--out", str(tmp_path)])
    assert "seed (0 there, 1 here)" in str(refused.exception)
    words = ["--law", "--input", "periodogram", "--cache", str(cache), "--out", str(tmp_path / "law")]
    refused = CliRunner().invoke(commands.app, [*common, *words])
    assert "train --cache must be left out with --law" in str(refused.exception)
