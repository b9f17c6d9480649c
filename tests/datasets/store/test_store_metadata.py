"""Metadata of a store: under a digest, checked on opening, written again by a repair."""

import json
import shutil
from pathlib import Path

import numpy as np
import pytest
from fake_recipe import FakeRecipe
from small_stores import assert_holds, contents, make
from typer.testing import CliRunner

from specklegen.cli import commands
from specklegen.core.errors import RuleError
from specklegen.datasets.store.info import info
from specklegen.datasets.store.store import Store
from specklegen.datasets.store.verify import verify


def replaced(old, new):
    def change(data):
        assert old in data
        return data.replace(old, new, 1)

    return change


CHANGES = {
    "type": ("image/zarr.json", replaced(b'"uint16"', b'"uint32"'), "image/zarr.json"),
    "no type": ("field/zarr.json", replaced(b'"float32"', b'"float39"'), "data_type.*float39"),
    "shorter": ("valid/zarr.json", replaced(b"22", b"12"), "length 12 instead of 22"),
    "longer": ("valid/zarr.json", replaced(b"22", b"32"), "length 32 instead of 22"),
    "shards": ("zarr.json", replaced(b'"shard_samples": 5', b'"shard_samples": 6'), "shard_samples"),
    "recipe": ("zarr.json", replaced(b"1000.0", b"1001.0"), "thickness"),
    "names": ("parameters/zarr.json", replaced(b'"level"', b'"g"'), "names"),
    "truncated": ("zarr.json", lambda data: data[: len(data) // 2], r"zarr\.json \(damaged\)"),
    "truncated array": ("image/zarr.json", lambda data: data[:100], r"image/zarr\.json \(damaged\)"),
    "no text": ("image/zarr.json", lambda data: b"\xff" + data, r"image/zarr\.json \(damaged\)"),
    "empty": ("zarr.json", lambda data: b"", r"zarr\.json \(damaged\)"),
    "gone": ("zarr.json", None, r"zarr\.json \(missing\)"),
    "array gone": ("seed/zarr.json", None, r"seed/zarr\.json \(missing\)"),
    "record": ("valid/record.json", replaced(b'"samples": 22', b'"samples": 12'), r"valid/record\.json"),
    "record truncated": ("valid/record.json", lambda data: data[:500], r"valid/record\.json"),
    "record gone": ("valid/record.json", None, r"valid/record\.json"),
}


def damage(folder, name, change):
    if change is None:
        (folder / name).unlink()
    else:
        (folder / name).write_bytes(change((folder / name).read_bytes()))


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    folder = tmp_path_factory.mktemp("whole") / "a.zarr"
    make(folder, notes="Seen by nobody.")
    return folder


@pytest.mark.parametrize("case", CHANGES)
def test_changed_metadata_are_named_on_opening_and_mended_from_the_recipe(tmp_path, whole, case):
    name, change, words = CHANGES[case]
    folder = shutil.copytree(whole, tmp_path / "a.zarr")
    good = contents(folder)
    damage(folder, name, change)
    with pytest.raises(RuleError, match=words) as error:
        info(folder)
    assert "verify --repair" in str(error.value)
    assert verify(folder, repair=FakeRecipe()).metadata
    assert contents(folder) == good
    assert verify(folder).sound


@pytest.mark.parametrize("change", [lambda data: data[:300], None], ids=["truncated", "gone"])
def test_every_command_names_damaged_metadata(tmp_path, whole, change):
    folder = shutil.copytree(whole, tmp_path / "a.zarr")
    damage(folder, "zarr.json", change)
    a, out = str(folder), str(tmp_path / "out")
    for words in (["store", "info", a], ["store", "verify", a], ["preview", a, "--out", f"{out}/a.png"],
                  ["store", "export", a, "--out", out],
                  ["generate", "through-slab", "--out", a], ["train", a, "--out", out, "--validation", a]):  # fmt: skip
        error = CliRunner().invoke(commands.app, words).exception
        assert isinstance(error, RuleError), words
        assert "verify --repair" in str(error), words


def test_repair_with_another_recipe_changes_nothing(tmp_path, whole):
    folder = shutil.copytree(whole, tmp_path / "a.zarr")
    damage(folder, *CHANGES["shorter"][:2])
    bad = contents(folder)
    with pytest.raises(RuleError, match="thickness"):
        verify(folder, repair=FakeRecipe(thickness=1.0))
    assert contents(folder) == bad


def test_where_nothing_tells_the_seed_the_remedy_is_another_folder(tmp_path, whole):
    folder = shutil.copytree(whole, tmp_path / "a.zarr")
    damage(folder, *CHANGES["truncated"][:2])
    damage(folder, *CHANGES["record gone"][:2])
    with pytest.raises(RuleError, match="in a new folder"):
        verify(folder, repair=FakeRecipe())


def test_a_lost_record_does_not_shorten_a_store(tmp_path, whole):
    """The ledger's shape is wrong and the record is gone: the other arrays tell the length."""
    folder = shutil.copytree(whole, tmp_path / "a.zarr")
    good = contents(folder)
    damage(folder, *CHANGES["shorter"][:2])
    damage(folder, *CHANGES["record gone"][:2])
    verify(folder, repair=FakeRecipe())
    assert contents(folder) == good


def test_a_store_of_an_older_version_is_refused_with_the_remedy(tmp_path, whole):
    folder = shutil.copytree(whole, tmp_path / "a.zarr")
    said = json.loads((folder / "zarr.json").read_text())
    said["attributes"]["format"] = "specklegen store, version 1"
    (folder / "zarr.json").write_text(json.dumps(said))
    (folder / "valid/record.json").unlink()
    for command in (info, verify, make, lambda folder: verify(folder, repair=FakeRecipe())):
        with pytest.raises(RuleError, match=r"version 2; got .*version 1.* Generate it again in a new folder"):
            command(folder)


def test_a_store_without_locks_goes_on_and_is_repaired(tmp_path):
    """A copying program may leave out an empty file."""
    make(tmp_path / "a.zarr", samples=12)
    (tmp_path / "a.zarr/valid/locks").unlink()
    make(tmp_path / "a.zarr")
    (tmp_path / "a.zarr/valid/locks").unlink()
    (tmp_path / "a.zarr/image/c/1/0/0").unlink()
    assert verify(tmp_path / "a.zarr", repair=FakeRecipe()).damaged == (1,)
    assert_holds(tmp_path / "a.zarr", FakeRecipe(), 22)


def test_no_changed_byte_of_metadata_goes_unseen(tmp_path, whole):
    """Any byte of any of these files: the store is refused, or the file says the same (a space became a line end)."""
    folder = shutil.copytree(whole, tmp_path / "a.zarr")
    random = np.random.default_rng(0)
    names = [name for name in contents(folder) if name.endswith(".json")]
    assert len(names) == 12
    refused = 0
    for name in names * 12:
        good = (folder / name).read_bytes()
        bad = bytearray(good)
        bad[random.integers(len(good))] ^= 1 << int(random.integers(8))
        (folder / name).write_bytes(bad)
        try:
            Store(folder)
            assert json.loads(bad) == json.loads(good), (name, bad)
        except RuleError:
            refused += 1
        (folder / name).write_bytes(good)
    assert refused > 100


@pytest.mark.skipif(not Path("/proc/self").is_dir(), reason="where the system has no /proc")
def test_a_place_where_no_folder_can_be_made_is_refused(monkeypatch):
    """It says "not found", as a folder does that another process swept; making it was tried again for ever."""
    made, before = [], Path.mkdir

    def counted(self, *arguments, **options):
        made.append(self)
        assert len(made) < 20, "it is tried again and again"
        return before(self, *arguments, **options)

    monkeypatch.setattr(Path, "mkdir", counted)
    with pytest.raises(RuleError, match="generate.folder must be a folder in which you can write"):
        make(Path("/proc/x.zarr"))
