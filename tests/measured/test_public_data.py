"""The list of public measurements, and a clone of a repository that stands in for GitHub."""

import hashlib
import json
import subprocess

import pytest
from refusals import assert_refused
from typer.testing import CliRunner

from specklegen.cli import commands
from specklegen.core.errors import RuleError
from specklegen.measured import public_data, public_data_names
from specklegen.measured.catalogue import PublicData

CONTENT = {"a/b c（1号）.txt": b"12\n", "second.bin": bytes(range(256)), "kept back.txt": b"other"}


def git(folder, *words):
    identity = ("-c", "user.name=a", "-c", "user.email=a@b.c", "-c", "commit.gpgsign=false")
    done = subprocess.run(["git", "-C", str(folder), *identity, *words], capture_output=True, text=True, check=True)
    return done.stdout.strip()


@pytest.fixture(scope="module")
def repository(tmp_path_factory):
    folder = tmp_path_factory.mktemp("repository")
    git(folder, "init", "--quiet")
    for name, content in CONTENT.items():
        (folder / name).parent.mkdir(exist_ok=True)
        (folder / name).write_bytes(content)
    git(folder, "add", ".")
    git(folder, "commit", "--quiet", "-m", "a")
    return folder


@pytest.fixture
def data(repository):
    named = {name: hashlib.sha256(content).hexdigest() for name, content in list(CONTENT.items())[:2]}
    return PublicData("here", "a/b", git(repository, "rev-parse", "HEAD"), "none", "numbers", named)


def test_only_the_named_files_are_cloned_and_checked(data, repository, tmp_path):
    folder = data.get(tmp_path / "deep" / "clone", str(repository))
    assert {path.name for path in folder.rglob("*.*") if ".git" not in path.parts} == {"b c（1号）.txt", "second.bin"}
    assert data.get(folder) == folder  # nothing is fetched again
    (folder / "second.bin").write_bytes(b"x")
    (folder / "a" / "b c（1号）.txt").unlink()
    assert list(data.broken(folder).values()) == ["is missing", "differs from the commit"]
    assert_refused(lambda: data.get(folder), "measured get here must be a folder of .* is missing, and 1 file more")


def test_what_git_cannot_is_said(data, tmp_path):
    with pytest.raises(RuleError, match="measured get must be a repository that git can clone"):
        data.get(tmp_path / "clone", str(tmp_path / "nothing"))
    (tmp_path / "file").write_text("")
    assert_refused(lambda: data.get(tmp_path / "file"), "measured get --out must be a folder")
    assert_refused(lambda: public_data("vesel"), "public_data name must be one of hidden-shapes")


def test_the_list_is_whole():
    result = CliRunner().invoke(commands.app, ["check", "measured", "list", "--json"])
    told = json.loads(result.output)
    assert [each["name"] for each in told] == list(public_data_names())
    for each in told:
        assert len(each["commit"]) == 40
        assert all(len(digest) == 64 for digest in each["files"].values())
        assert each["licence"] in ("none", "MIT", "Apache-2.0", "EUPL-1.2")
    assert "no licence" in CliRunner().invoke(commands.app, ["check", "measured", "list"]).output


def test_the_command_gets(data, repository, tmp_path, monkeypatch):
    monkeypatch.setattr("specklegen.measured.catalogue._catalogue", lambda: {"here": data})
    words = ["check", "measured", "get", "here", "--out", str(tmp_path / "c"), "--source", str(repository)]
    result = CliRunner().invoke(commands.app, words)
    assert result.exit_code == 0, result.output
    assert "2 files of a/b" in result.output
    assert "no licence" in result.output
