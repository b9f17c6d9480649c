"""Five tasks of new users, from words of the pages alone: each command and block stands on a page, word for word.

    pytest -m slow tests/test_five_tasks.py -s      # prints words to read and seconds to wait

What is shortened here is listed in `SMALLER`; libraries that are not installed are left out.
"""

import json
import os
import re
import shlex
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest
import tifffile
from PIL import Image, ImageDraw
from scenes import ROOT
from test_docs import shorter

from specklegen.datasets import SpeckleCache, load_recipe

pytestmark = pytest.mark.slow
PROGRAM = Path(sys.executable).with_name("specklegen")
SMALLER = {"--samples 100000": "--samples 32", "--samples 4096": "--samples 16", "/shared/train.zarr": "train.zarr"}
"""Numbers of the pages that are made small here, and the folder of a cluster."""


class Reader:
    """A new user in a folder, who types what pages say."""

    def __init__(self, folder: Path) -> None:
        self.folder, self.words, self.seconds = folder, 0, 0.0
        (folder / "docs").symlink_to(ROOT / "docs")

    def read(self, page: str, heading: str) -> str:
        """Return a section of a page, and count its words."""
        section = re.search(rf"^#+ {re.escape(heading)}\n(.*?)(?=^#+ |\Z)", (ROOT / page).read_text(), re.M | re.S)
        assert section, f"{page} has no section {heading}"
        self.words += len(section[1].split())
        return section[1]

    def types(self, section: str, start: str, status: int = 0, **environment: str) -> str:
        """Run the command of a section that begins so; return what it prints."""
        line = next(line for line in re.sub(r" *\\\n *", " ", section).splitlines() if line.startswith(start))
        line = re.sub(r"\s+#.*$", "", line)
        for long, short in SMALLER.items():
            line = line.replace(long, short)
        words = shlex.split(re.sub(r"\$(\w+)", lambda match: environment[match[1]], line))
        begin = time.perf_counter()
        done = subprocess.run([PROGRAM, *words[1:]], cwd=self.folder, capture_output=True, text=True, timeout=1800)
        self.seconds += time.perf_counter() - begin
        assert done.returncode == status, done.stderr[-3000:]
        return done.stdout

    def says(self, task: str) -> None:
        print(f"{task}: {self.words} words to read, {self.words / 200:.1f} min; {self.seconds:.0f} s to wait")
        assert self.words < 2000  # ten minutes at 200 words a minute


@pytest.fixture
def reader(tmp_path) -> Reader:
    return Reader(tmp_path)


@pytest.fixture
def setup(reader) -> str:
    """The page's setup with a folder of pictures; the section that describes it."""
    section = reader.read("docs/start.md", "Describe your setup")
    (reader.folder / "setup.toml").write_text(re.search(r"```toml\n(.*?)```", section, re.S)[1])
    (reader.folder / "my-images").mkdir()
    for n, letter in enumerate("ABCDEFGHKLMN"):
        image = Image.new("L", (40, 40))
        ImageDraw.Draw(image).text((8, 4), letter, fill=255, font_size=30)
        image.save(reader.folder / "my-images" / f"{n}.png")
    return section


def test_pictures_to_a_network_beside_katz(reader, setup):
    reader.types(setup, "specklegen preview setup.toml")
    train = reader.read("docs/start.md", "Train")
    reader.types(train, "specklegen train setup.toml")
    assert "| Katz |" in reader.types(train, "specklegen evaluate runs/setup/best.pt")
    reader.says("pictures to a network")


def test_tiff_to_an_object_with_confidence(reader, setup, monkeypatch):
    monkeypatch.chdir(reader.folder)
    tifffile.imwrite("shot-1.tiff", load_recipe("setup.toml").sample(0, "test", 0)["image"])
    page = (ROOT / "docs/networks.md").read_text()
    assert "specklegen reconstruct shot-*.tiff --setup setup.toml" in page
    said = reader.types("specklegen reconstruct shot-1.tiff --setup setup.toml", "specklegen reconstruct")
    assert "confidence" in said
    assert (reader.folder / "reconstruction" / "reconstructions.png").exists()
    reader.says("TIFF to an object")


def test_curves_to_a_fit(reader):
    section = reader.read("docs/materialfit.md", "Fit your material")
    reader.read("docs/materialfit.md", "Observations")
    said = reader.types(section, "specklegen fit material")
    assert re.search(r"mean_free_path: \S+ \(95 %: ", said)
    reader.says("curves to a fit")


@pytest.fixture
def bucket(monkeypatch) -> str:
    """An empty bucket on a server of the S3 protocol, which programs find by their environment."""
    server = pytest.importorskip("moto.server").ThreadedMotoServer(port=0)
    s3 = pytest.importorskip("s3fs")
    server.start()
    host, port = server.get_host_and_port()
    monkeypatch.setenv("AWS_ENDPOINT_URL", f"http://{host}:{port}")
    for name in ("AWS_ACCESS_KEY_ID", "AWS_SECRET_ACCESS_KEY"):
        monkeypatch.setenv(name, "any")
    s3.S3FileSystem(skip_instance_cache=True).mkdir("bucket")
    yield "s3://bucket/train.zarr"
    server.stop()


@pytest.fixture
def folder() -> str:
    return "train.zarr"


@pytest.mark.parametrize("place", ["folder", "bucket"])
def test_a_data_set_by_eight_tasks(reader, place, request):
    """All tasks run at once, each with a part of its own."""
    place = request.getfixturevalue(place)
    section = reader.read("docs/datasets.md", "Several processes and machines")
    assert "`--out s3://bucket/train.zarr`" in section
    reader.read("docs/datasets.md", "Use an object store")
    section = section.replace("/shared/train.zarr", place)
    start, begin = "specklegen generate through-slab --samples 100000", time.perf_counter()
    with ThreadPoolExecutor(8) as tasks:
        said = [tasks.submit(reader.types, section, start, SLURM_ARRAY_TASK_ID=str(task), SLURM_ARRAY_TASK_COUNT="8")
                for task in range(8)]  # fmt: skip
    assert all(task.result() is not None for task in said)
    reader.seconds = time.perf_counter() - begin  # not the sum of all
    check = reader.read("docs/datasets.md", "Fill and check a store").replace("data/a.zarr", place)
    info = json.loads(reader.types(check, "specklegen store info"))
    assert info["done"] == info["total"] == 32
    reader.types(check, f"specklegen store verify {place}")
    if place.startswith("s3"):
        sample = load_recipe("through-slab").sample(0, "train", 31)
        assert np.array_equal(SpeckleCache(place)[31]["image"], sample["image"])
    reader.says("eight tasks")


@pytest.mark.parametrize(("library", "script"), [
    ("deepinv", "plot_27_deepinv.py"), ("lightning", "plot_25_lightning.py"),
    ("transformers", "plot_26_hugging_face.py"),
])  # fmt: skip
def test_inside_another_framework(reader, library, script):
    pytest.importorskip(library)
    text = (ROOT / "docs/gallery/train" / script).read_text()
    reader.words += len(text.split())
    file = reader.folder / script
    file.write_text(shorter(text))
    done = subprocess.run([sys.executable, file], cwd=reader.folder, env=os.environ | {"MPLBACKEND": "agg"},
                          capture_output=True, text=True, timeout=1800)  # fmt: skip
    assert done.returncode == 0, done.stderr[-3000:]
    reader.says(library)


def test_the_loop_of_a_framework_that_is_not_installed():
    """What all three ask of a loader: a length, an epoch to set, and batches of tensors."""
    stream = load_recipe("through-slab", {"samples": {"train": 32}}).stream(batch_size=16)
    loader = stream.loader(num_workers=0)
    assert len(loader) == 2
    loader.set_epoch(1)
    batches = [batch["image"].numpy() for batch in loader]
    assert all(batch.shape[0] == 16 and np.isfinite(batch).all() for batch in batches)
