"""The map of tasks in CONTRIBUTING.md and the page of the house name what is there; changes made by the map serve."""

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path
from typing import NamedTuple

import pytest
from scenes import ROOT
from typer.main import get_command

from specklegen.cli.commands import app

FILE = re.compile(r"[\w./-]*(?:/|\.(?:py|pyi|md|toml))")
NAME = re.compile(r"[A-Za-z_]\w*")
DEFINED = r"^\s*(?:(?:def|class) {0}\b|{0}: |(?:\w+, )*{0}\b(?:, \w+)*(?::.*)? = )"


class Task(NamedTuple):
    """A row of the map: what is to be done, and the words in its code spans."""

    what: str
    words: list[str]

    @property
    def places(self) -> dict[str, Path]:
        """Files and folders by the words that name them: from the root, or from the folder of the one before."""
        found, folder = {}, ROOT
        for word in self.words:
            if FILE.fullmatch(word) and not re.search("NAME|NN_name", word):
                found[word] = ROOT / word if "/" in word or (ROOT / word).exists() else folder / word
                folder = found[word] if word.endswith("/") else found[word].parent
        return found

    @property
    def files(self) -> list[Path]:
        """All files that the row is about."""
        return [file for place in self.places.values() for file in (place.glob("*.py") if place.is_dir() else [place])]

    def lost_files(self) -> list[str]:
        """Words that name no file or folder."""
        return [word for word, place in self.places.items() if not place.exists()]

    def lost_names(self) -> list[str]:
        """Names that no file of the row defines, and commands that there are not."""
        text = "\n".join(file.read_text() for file in self.files if file.is_file())
        lost = []
        for word in self.words:
            program, _, command = word.partition(" ")
            if program == "make" and command:
                known = re.search(rf"^{command}:", (ROOT / "Makefile").read_text(), re.MULTILINE)
            elif program == "specklegen" and command:
                known = command in get_command(app).commands  # type: ignore[attr-defined]
            elif NAME.fullmatch(word):
                known = re.search(DEFINED.format(word), text, re.MULTILINE)
            else:
                continue
            if not known:
                lost.append(word)
        return lost


def tasks() -> list[Task]:
    table = (ROOT / "CONTRIBUTING.md").read_text().split("| to add or change | files |")[1]
    rows = re.findall(r"^\| ([^|]+) \| (.+) \|$", table, re.MULTILINE)
    return [Task(what, re.findall(r"`([^`]+)`", files)) for what, files in rows]


TASKS = {task.what: task for task in tasks()}


@pytest.mark.parametrize("task", TASKS.values(), ids=TASKS)
def test_what_a_task_names_is_there(task):
    assert task.lost_files() == []
    assert task.lost_names() == []


def test_what_is_not_there_is_found():
    wrong = Task("a rule", ["specklegen/paths/pilot.py", "pilots.py", "_pilot", "pilot_by_walk", "make dmo"])
    assert wrong.lost_files() == ["pilots.py"]
    right = Task("a rule", ["specklegen/paths/pilot.py", "_pilot", "pilot_by_walk", "make dmo", "specklegen trane"])
    assert right.lost_names() == ["_pilot", "make dmo", "specklegen trane"]


def test_the_page_of_the_house_shows_every_room_and_where_it_begins():
    page = (ROOT / "docs" / "architecture.md").read_text()
    rows = dict(re.findall(r"^\| (?:`(\w+)/`|\(root\)) \| .+ \| `([\w/.]+)` \|$", page, re.MULTILINE))
    rooms = {init.parent.name for init in (ROOT / "specklegen").glob("*/__init__.py")}
    assert set(rows) - {""} == rooms
    assert [file for file in rows.values() if not (ROOT / file).is_file()] == []


def test_the_way_of_a_sample_is_told_by_functions_that_exist():
    told = (ROOT / "docs" / "architecture.md").read_text().split("## One sample")[1]
    named = {word.rpartition(".")[2] for word in re.findall(r"`([\w.]+)`", told) if not word.endswith(".py")}
    source = "\n".join(file.read_text() for top in ("specklegen", "datasets") for file in (ROOT / top).rglob("*.py"))
    assert len(named) > 15
    assert [name for name in named if not re.search(rf"(?:def|class) {name}\b", source)] == []


# Tasks performed: in a copy of the packages, in the files that the map names and in no other.

COPIED = ("specklegen", "datasets", "models")


class Workshop:
    """A copy of the packages."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        for top in COPIED:
            shutil.copytree(ROOT / top, folder / top, symlinks=True)

    def change(self, task: str, file: str, old: str, new: str) -> None:
        """Write a file, or replace a text that stands in it once; the row of the task must name it."""
        places = TASKS[task].places.values()
        assert any(ROOT / file == place or (ROOT / file).parent == place for place in places), f"{task}: {file}"
        target = self.folder / file
        before = target.read_text() if old else ""
        assert before.count(old) == 1 if old else not target.exists(), f"{file}: {old!r}"
        target.write_text(before.replace(old, new) if old else new)

    def run(self, code: str) -> str:
        """What a process that imports the copy prints."""
        done = subprocess.run([sys.executable, "-c", code], cwd=self.folder,
                              env={**os.environ, "PYTHONPATH": str(self.folder)}, capture_output=True, text=True,
                              check=False)  # fmt: skip
        assert done.returncode == 0, done.stderr[-2000:]
        return done.stdout


FAMILY = '''"""Crosses: one row and one column of light."""

from typing import Literal

import numpy as np

from specklegen.datasets.objects.family import DrawnFamily, Source


class Crosses(DrawnFamily):
    """A row and a column of brightness 1."""

    type: Literal["Crosses"] = "Crosses"

    def propose(self, rng: np.random.Generator) -> Source:
        """Row and column."""
        return int(rng.integers(self.shape[0])), int(rng.integers(self.shape[1]))

    def picture(self, source: Source, rng: np.random.Generator) -> np.ndarray:
        """Cross, float32[h, w]."""
        found = np.zeros(self.shape, np.float32)
        found[source[0]] = found[:, source[1]] = 1
        return found
'''
NETWORK = '''"""One layer."""

from torch import Tensor, nn

from specklegen.models.learning.networks.network import Network


class OneLayer(Network, name="mapped-layer"):
    """One layer from all pixels to all pixels."""

    def __init__(self, side: int, shape: tuple[int, int] = (28, 28), width: int = 16) -> None:
        super().__init__()
        self.shape, self.layer = shape, nn.Linear(2 * side**2, shape[0] * shape[1])

    def forward(self, pictures: Tensor) -> Tensor:
        """Return float[B, h, w] of pictures float[B, 2, H, W]."""
        return self.layer(pictures.flatten(1)).reshape(-1, *self.shape)
'''
RULE = """def _short_wave(scene: Scene) -> list[Decision]:
    return [Decision("colour", False, f"the wavelength is {scene.wavelength:g}")]


SCENE_RULES: tuple"""
PERFORMED = """
import numpy as np
import specklegen as sg
from specklegen.core.content import is_own
from specklegen.datasets import load_recipe
from specklegen.models.learning.networks import NETWORKS, build

assert sg.__file__.startswith({folder!r}), sg.__file__
small = {{"material": {{"kernel_paths": 1000}}, "camera": {{"shape": [32, 32]}}}}
hidden = load_recipe("through-slab", {{**small, "objects": {{"type": "Crosses", "shape": [12, 12]}}}})
assert hidden.sample(0, "train", 0)["object"].sum() == 23
assert not is_own(type(hidden.objects)) and not is_own(NETWORKS["mapped-layer"])
assert build("mapped-layer", 16, (12, 12), 4, 0).shape == (12, 12)
camera = {{"photons": 1e6, "bit_depth": None}}
plain, dim = (
    load_recipe("tilt-stack", {{"camera": {{"shape": [32, 32]}}, "exposure": camera | {{"filter": share}}}})
    for share in (1.0, 0.25)
)
means = [each.sample(0, "train", 0)["stack"].mean() for each in (plain, dim)]
np.testing.assert_allclose(means[1], means[0] / 4, rtol=1e-3)  # photon noise of 1e6 x 1024 photons is 3e-5
assert plain.fingerprint() != dim.fingerprint()
slab = sg.Slab(thickness=100.0, mean_free_path=20.0, scatterer=sg.HenyeyGreenstein(0.9))
light = sg.CollimatedBeams.tilts([0.0], width=5000.0)
scene = sg.Scene(wavelength=0.5, medium=slab, illumination=light, sensor=sg.FarField.grid((16, 16), 2e-5))
assert "the wavelength is 0.5" in sg.plan(scene).explain()
print("performed")
"""


def test_four_tasks_are_performed_by_the_map(tmp_path):
    """An object family, a network, a camera's field, a rule of the planner; in the files of their rows alone."""
    shop = Workshop(tmp_path)
    shop.change("a family of hidden objects", "datasets/objects/crosses.py", "", FAMILY)
    shop.change(
        "a family of hidden objects", "datasets/objects/__init__.py", "from specklegen.datasets.objects.digits",
        "from specklegen.datasets.objects.crosses import Crosses  # noqa: F401\n"
        "from specklegen.datasets.objects.digits",
    )  # fmt: skip
    shop.change("a network", "models/learning/networks/one_layer.py", "", NETWORK)
    shop.change(
        "a network", "models/learning/networks/__init__.py", "from specklegen.models.learning.networks.perceptron",
        "from specklegen.models.learning.networks.one_layer import OneLayer  # noqa: F401\n"
        "from specklegen.models.learning.networks.perceptron",
    )  # fmt: skip
    camera = "specklegen/instrument/camera.py"
    shop.change("what a camera does", camera, "    oversampling: PositiveInt = 1\n",
                "    oversampling: PositiveInt = 1\n    filter: Positive = 1.0\n")  # fmt: skip
    shop.change("what a camera does", camera, "return self.photons * pixel_means",
                "return self.filter * self.photons * pixel_means")  # fmt: skip
    exposure = "datasets/recipes/parts/exposure.py"
    shop.change("what a camera does", exposure, '    "photons", "overs', '    "photons", "filter", "overs')
    shop.change("what a camera does", exposure, "light = camera.photons *", "light = camera.filter * camera.photons *")
    planning = "specklegen/planning/planning.py"
    shop.change("a rule of the planner", planning, "SCENE_RULES: tuple", RULE)
    shop.change("a rule of the planner", planning, "_simple_terms, idealisations)",
                "_simple_terms, _short_wave, idealisations)")  # fmt: skip
    assert shop.run(PERFORMED.format(folder=str(tmp_path))).strip() == "performed"
