"""Stores as data sets of the Hugging Face hub: what other libraries read is what was rendered."""

import json
import os
import re
import runpy
import shutil
import subprocess
import sys
import types
from pathlib import Path

import numpy as np
import pytest
from scenes import ROOT
from small_stores import make

from specklegen.core.errors import RuleError
from specklegen.datasets import SpeckleCache
from specklegen.datasets.loading.export import export

pq = pytest.importorskip("pyarrow.parquet", reason="needs the extra parquet")


@pytest.fixture(scope="module")
def exported(tmp_path_factory):
    """A store of each of two splits, and both in one folder of Parquet."""
    folder = tmp_path_factory.mktemp("parquet")
    for split, samples in (("train", 22), ("test", 7)):
        make(folder / f"{split}.zarr", split=split, samples=samples)
        export(folder / f"{split}.zarr", folder / "out", "parquet")
    return folder


@pytest.mark.parametrize("split", ["train", "test"])
def test_every_number_is_in_the_file(exported, split):
    cache = SpeckleCache(exported / f"{split}.zarr")
    table = pq.read_table(exported / "out" / "data" / f"{split}.parquet")
    assert table.num_rows == len(cache)
    rows = table.to_pylist()
    for n in (0, len(cache) - 1):
        sample = cache.numpy(n)
        assert rows[n]["index"] == n
        assert rows[n]["seed"] == cache.identity["seed"]
        for key in cache.keys:
            stored = np.array(rows[n][key], sample[key].dtype)
            np.testing.assert_array_equal(stored, sample[key])
        assert {name: rows[n][f"parameter_{name}"] for name in sample["parameters"]} == sample["parameters"]


def test_the_front_matter_names_every_split(exported):
    yaml = pytest.importorskip("yaml")
    text = (exported / "out" / "README.md").read_text()
    front = yaml.safe_load(re.match(r"---\n(.*?)\n---\n", text, re.DOTALL)[1])
    files = {one["split"]: one["path"] for one in front["configs"][0]["data_files"]}
    assert files == {"train": "data/train.parquet", "test": "data/test.parquet"}
    assert "| train | 22 |" in text


def elsewhere(program: str, exported) -> str:
    """Run where the clone's folder `datasets` cannot be taken for the library of that name."""
    path = exported / "path"
    path.mkdir(exist_ok=True)
    if not (path / "specklegen").exists():
        (path / "specklegen").symlink_to(ROOT / "specklegen")
    environment = os.environ | {"PYTHONPATH": str(path), "HF_HUB_OFFLINE": "1", "HF_HOME": str(exported / "home")}
    done = subprocess.run(
        [sys.executable, "-c", program], cwd=exported, env=environment, capture_output=True, text=True, timeout=300
    )
    if "No module named" in done.stderr:
        pytest.skip(done.stderr.strip().splitlines()[-1])
    assert done.returncode == 0, done.stderr[-3000:]
    return done.stdout


@pytest.mark.slow
def test_the_datasets_library_reads_arrays_of_the_right_shape(exported):
    said = elsewhere(
        "import numpy as np, datasets\n"
        "from specklegen.datasets import SpeckleCache\n"
        "cache, made = SpeckleCache('test.zarr'), datasets.load_dataset('out', cache_dir='cache')['test']\n"
        "read = made.with_format('numpy')\n"  # which widens whole numbers; the features keep the type
        "for key in cache.keys:\n"
        "    feature = getattr(made.features[key], 'feature', made.features[key])\n"  # of a list, that of what is in it
        "    assert feature.dtype == str(cache.numpy(0)[key].dtype), key\n"
        "    assert cache.numpy(0)[key].ndim < 2 or feature.shape == cache.numpy(0)[key].shape, key\n"
        "    for n in (0, 6):\n"
        "        assert read[n][key].shape == cache.numpy(n)[key].shape, key\n"
        "        assert np.array_equal(read[n][key], cache.numpy(n)[key]), key\n"
        "print(len(made))",
        exported,
    )  # fmt: skip
    assert said.strip().endswith("7")


@pytest.mark.slow
def test_croissant_accepts_its_metadata_and_reads_a_record(exported):
    said = elsewhere(
        "import mlcroissant as mlc\n"
        "made = mlc.Dataset(jsonld='out/croissant.json')\n"
        "told = made.metadata.ctx.issues\n"
        "assert not told.errors, told.report()\n"
        "record = next(iter(made.records(record_set='train')))\n"
        "print(record['train/index'], record['train/seed'])\n"
        "print('recommended:', *sorted(told.warnings))",
        exported,
    )
    assert said.splitlines()[-2] == "0 0"
    # What is left to whoever publishes the data, and nothing else.
    assert re.findall(r"recommended|org/\w+", said.splitlines()[-1]) == [
        "recommended", "org/datePublished", "recommended", "org/license", "recommended",
    ]  # fmt: skip


def test_the_checksums_are_those_of_the_files(exported):
    import hashlib

    told = json.loads((exported / "out" / "croissant.json").read_text())
    assert len(told["distribution"]) == 2
    for one in told["distribution"]:
        data = (exported / "out" / one["contentUrl"]).read_bytes()
        assert hashlib.sha256(data).hexdigest() == one["sha256"]


def test_without_pyarrow_it_says_what_to_install(exported, monkeypatch):
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    with pytest.raises(RuleError, match=r"specklegen-torch\[parquet\]"):
        export(exported / "train.zarr", exported / "none", "parquet")


# ---- Sending it to a hub --------------------------------------------------------------------------------


def upload(monkeypatch, capsys, *words: str) -> str:
    """Run the script that uploads; return what it printed."""
    monkeypatch.setattr(sys, "argv", ["upload_dataset.py", *words])
    runpy.run_path(str(ROOT / "scripts" / "upload_dataset.py"), run_name="__main__")
    return capsys.readouterr().out


class Hub(types.ModuleType):
    """Stands in for huggingface_hub: keeps what it is given."""

    def __init__(self):
        super().__init__("huggingface_hub")
        self.sent: dict[str, bytes] = {}

        class HfApi:
            def create_repo(api, repository, *, repo_type, exist_ok):
                assert (repository, repo_type, exist_ok) == ("me/speckle", "dataset", True)

            def create_commit(api, repository, operations, *, commit_message, repo_type):
                assert (repository, repo_type) == ("me/speckle", "dataset")
                self.sent |= dict(operations)

        def add(path_in_repo, path_or_fileobj):
            held = path_or_fileobj
            return path_in_repo, held if isinstance(held, bytes) else Path(held).read_bytes()

        self.HfApi, self.CommitOperationAdd = HfApi, add


def test_an_upload_is_said_first_and_holds_every_file_and_the_licence(exported, monkeypatch, capsys):
    hub = Hub()
    monkeypatch.setitem(sys.modules, "huggingface_hub", hub)
    words = [str(exported / "out"), "me/speckle", "--licence", "cc-by-4.0"]
    said = upload(monkeypatch, capsys, *words)
    assert "nothing was sent" in said
    assert hub.sent == {}
    upload(monkeypatch, capsys, *words, "--really")
    assert set(hub.sent) == {"README.md", "croissant.json", "data/train.parquet", "data/test.parquet"}
    assert all(name in said for name in hub.sent)
    assert hub.sent["README.md"].startswith(b'---\nlicense: "cc-by-4.0"\npretty_name: ')
    assert hub.sent["data/test.parquet"] == (exported / "out" / "data" / "test.parquet").read_bytes()


@pytest.mark.parametrize(("damage", "said"), [
    (lambda out: (out / "croissant.json").unlink(), "must hold croissant.json"),
    (lambda out: (out / "data" / "test.parquet").unlink(), "data/test.parquet must be there"),
    (lambda out: (out / "data" / "test.parquet").open("ab").write(b"x"), "SHA-256"),
    (lambda out: (out / "data" / "more.parquet").write_bytes(b"x"), "data/more.parquet must stand in croissant.json"),
])  # fmt: skip
def test_a_damaged_folder_is_not_sent(exported, monkeypatch, capsys, tmp_path, damage, said):
    shutil.copytree(exported / "out", tmp_path / "out")
    damage(tmp_path / "out")
    with pytest.raises(SystemExit):
        upload(monkeypatch, capsys, str(tmp_path / "out"), "me/speckle", "--licence", "mit", "--really")
    assert said in capsys.readouterr().err
