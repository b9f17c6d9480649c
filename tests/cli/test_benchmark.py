"""``specklegen check benchmark``: one's own function from a file, beside none or all of the baselines."""

import json

import pytest
from typer.testing import CliRunner

from specklegen.cli import commands
from specklegen.core.errors import RuleError
from specklegen.models.judging.tasks import GLASSES, TASKS

MINE = """
import torch


def even(batch):
    return torch.ones(len(batch["object"]), *batch["object"].shape[1:])


number = 3
"""


def run(*words):
    return CliRunner().invoke(commands.app, ["check", "benchmark", *map(str, words)])


@pytest.fixture
def mine(tmp_path):
    file = tmp_path / "mine.py"
    file.write_text(MINE)
    return file


def test_the_tasks_are_listed():
    assert all(each.name in run("--list").output for each in (*TASKS, *GLASSES))
    rows = json.loads(run("--list", "--json").output)
    assert [row["fingerprint"] for row in rows] == [each.fingerprint for each in (*TASKS, *GLASSES)]


def test_a_function_of_a_file_is_scored(mine, tmp_path):
    words = (f"{mine}:even", "--task", "thin", "--samples", 2, "--no-baselines", "--out", tmp_path / "out")
    result = run(*words)
    assert result.exit_code == 0, result.output
    assert "| thin | 0.000 [0.000, 0.000] |" in result.output
    assert (tmp_path / "out" / "answers.npz").is_file()
    rows = json.loads(run(*words, "--json").stdout)
    assert {row["task"] for row in rows} == {"thin"}


@pytest.mark.parametrize(("words", "said"), [
    (["mine"], "FILE.py:NAME"), (["{file}:odd"], "a function 'odd' of"), (["{file}:number"], "a function 'number' of"),
    (["nowhere.py:f"], "can be imported"), (["no_such_module_of_mine:f"], "can be imported"),
    (["--no-baselines"], "at least one function with --no-baselines"), (["--task", "thick"], "one of unseen media"),
])  # fmt: skip
def test_what_is_no_function_is_refused(words, said, mine, tmp_path):
    result = run(*(word.format(file=mine) for word in words), "--out", tmp_path / "out")
    assert isinstance(result.exception, RuleError)
    assert said in str(result.exception)
