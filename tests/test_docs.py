"""The pages do what they say: every block of code runs on its own, and no page is lost."""

import re
import subprocess
import sys
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
from PIL import Image
from quick_recipes import quick_recipe
from scenes import ROOT
from typer.main import get_command

import specklegen as sg
from specklegen.cli.commands import app
from specklegen.core.content import is_own
from specklegen.core.registry import Registry
from specklegen.datasets import load_recipe, recipe_names
from specklegen.datasets.objects import ObjectFamily
from specklegen.datasets.recipes.registry import KINDS
from specklegen.datasets.store.generate import generate
from specklegen.models.learning.inputs import FEATURES, INPUTS
from specklegen.models.learning.networks import NETWORKS
from specklegen.models.learning.targets import TARGETS
from specklegen.planning.planning import PACKAGED
from specklegen.samplers.sampler import SAMPLERS

PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]
NOTES = sorted((ROOT / "docs" / "notes").glob("*.md"))


class Block(NamedTuple):
    """A fenced block of a page."""

    page: str
    line: int
    language: str
    text: str

    def __str__(self) -> str:
        return f"{self.page}:{self.line}"


def blocks() -> list[Block]:
    found = []
    for page in PAGES:
        text = page.read_text()
        for match in re.finditer(r"^```(\w*)\n(.*?)^```", text, re.MULTILINE | re.DOTALL):
            line = text[: match.start()].count("\n") + 1
            found.append(Block(str(page.relative_to(ROOT)), line, match[1], match[2]))
    return found


SHORTER = [
    # What makes a block quick enough to be run here; each stands in some block, as the last test says.
    ('load_recipe("through-slab")', 'load_recipe("through-slab", {"samples": {"train": 64}})'),
    ('load_recipe("setup.toml")', 'load_recipe("setup.toml", {"samples": {"train": 64}})'),
    ("for epoch in range(10):", "for epoch in range(1):"), ("for epoch in range(8):", "for epoch in range(1):"),
    ('{"samples": {"train": 256}}', '{"samples": {"train": 32}}'),
    ("rel_error=0.02)", "rel_error=0.2)"),
    ("n_rays=100_000", "n_rays=2000"), ("monte_carlo_mean(layer, 4000, seed=0)", "monte_carlo_mean(layer, 8, seed=0)"),
    ("samples=128, folder", "samples=8, folder"),
    ('split="test", batch_size=16)', 'split="test", batch_size=4)'),
    ("paths=20_000).intensity", "paths=4_000).intensity"), ("paths=4_000)\nfit", "paths=500)\nfit"),
    ("paths=2000, seed=0, reverse=False)", "paths=50, seed=0, reverse=False)"),
    ("FocusedBeams(foci, waist=3.0)", "FocusedBeams(foci, waist=6.0)"), ("in (100.0, 200.0, 400.0)]", "in (100.0,)]"),
    ("posterior(*measured(batch, recipe), draws=8)", "posterior(*measured(batch, recipe), draws=2)"),
]  # fmt: skip


def shorter(text: str) -> str:
    for long, short in SHORTER:
        text = text.replace(long, short)
    return text


def own_process(block: Block) -> bool:
    """Whether a block starts processes, which read it again as their main module, or imports another `datasets`."""
    return any(word in block.text for word in ("num_workers", "LocalCluster", "transformers"))


def skip_without_libraries(block: Block) -> None:
    """Skip a block that needs an extra, or a library that is no extra, which is not installed."""
    needed = re.findall(r"^(?:import|from) (webdataset|deepinv|lightning|distributed|transformers)\b", block.text, re.M)
    for library in needed + ["upath"] * ("://a.zarr" in block.text):
        pytest.importorskip(library)


def module_of(block: Block) -> str | None:
    """Name of the module that a block is, which says so in its first line: other blocks may name it."""
    found = re.match(r"# (\w+)\.py\n", block.text)
    return found and found[1]


@pytest.fixture(scope="module")
def setup(tmp_path_factory) -> Path:
    """The folder that the pages speak of: pictures of one's own, the README's setup beside them, and a store."""
    folder = tmp_path_factory.mktemp("setup")
    (folder / "my-images").mkdir()
    for n in range(10):
        Image.fromarray(np.full((20, 20 + n), 20 * n + 9, np.uint8)).save(folder / "my-images" / f"{n}.png")
    Image.fromarray(np.full((8, 8), 200, np.uint8)).save(folder / "mask.png")
    for block in blocks():
        if module_of(block):
            (folder / f"{module_of(block)}.py").write_text(block.text)
    (folder / "setup.toml").write_text(next(b.text for b in blocks() if b.language == "toml" and "my-setup" in b.text))
    (folder / "docs").symlink_to(ROOT / "docs")
    generate(load_recipe("through-slab"), samples=64, folder=folder / "data" / "a.zarr", processes=1)
    return folder


PYTHON = [block for block in blocks() if block.language == "python"]


@pytest.mark.parametrize("block", [block for block in PYTHON if not own_process(block)], ids=str)
def test_a_block_runs_on_its_own(block, setup, monkeypatch):
    skip_without_libraries(block)
    monkeypatch.chdir(setup)
    names = {"__name__": module_of(block) or "__main__"}
    before = set(names)
    exec(compile(shorter(block.text), str(block), "exec"), names)  # fails where the block raises
    assert set(names) - before - {"__builtins__"}, "a block that names nothing shows nothing"


@pytest.mark.slow
@pytest.mark.parametrize("block", [block for block in PYTHON if own_process(block)], ids=str)
def test_a_block_that_starts_processes_runs_on_its_own(block, setup):
    skip_without_libraries(block)
    file = setup / "block.py"
    file.write_text(shorter(block.text))
    command = [sys.executable, str(file)]
    if "init_process_group" in block.text:
        command = [sys.executable, "-m", "torch.distributed.run", "--nproc-per-node", "2", str(file)]
    done = subprocess.run(command, cwd=setup, capture_output=True, text=True, timeout=600)
    assert done.returncode == 0, done.stderr[-2000:]


@pytest.mark.parametrize("block", [block for block in blocks() if block.language == "toml"], ids=str)
def test_a_recipe_on_a_page_is_one(block, setup, monkeypatch):
    """Read from its own folder, wherever the command runs: its pictures and classes lie beside it."""
    monkeypatch.setenv("SPECKLEGEN_TRUST", "1")
    file = setup / "recipe-of-a-page.toml"
    file.write_text(block.text)
    assert quick_recipe(file).sample(0, "train", 0).keys() & {"image", "stack", "frames"}


def test_every_recipe_stands_on_its_page():
    page = (ROOT / "docs" / "packaged.md").read_text()
    assert set(re.findall(r"^\| `([a-z-]+)` \| [a-z-]+ \|", page, re.MULTILINE)) == set(recipe_names())


def test_every_sampler_stands_on_the_pages_that_list_them():
    engine = (ROOT / "docs" / "engine.md").read_text()
    packaged = [kind.name for kind in PACKAGED]
    assert sorted(re.findall(r"^\d\. \*\*(\w+)\*\*:", engine, re.MULTILINE)) == sorted(packaged)
    told = sg.Plan.sampler.__doc__
    for text in (told, sg.plan.__doc__, (ROOT / "docs" / "index.md").read_text()):
        assert [name for name in packaged if name not in text] == []
    for page in PAGES:
        assert "three samplers" not in re.sub(r"\s+", " ", page.read_text()), page


@pytest.mark.parametrize(("page", "registry", "users"), [
    ("recipes.md", ObjectFamily.registry, "objects.type"), ("extending.md", ObjectFamily.registry, "objects.type"),
    ("extending.md", KINDS, "kind"), ("extending.md", sg.Sensor.registry, "sensor.type"),
    ("extending.md", NETWORKS, "network"), ("extending.md", SAMPLERS, "sampler"),
])  # fmt: skip
def test_every_packaged_name_stands_on_its_page(page, registry, users):
    """Of a registry: those of this library, not those that other tests have defined."""
    text = (ROOT / "docs" / page).read_text()
    names = [name for name in registry if not is_own(registry[name])]
    assert names
    assert [name for name in names if f"`{name}`" not in text] == [], users


@pytest.mark.parametrize(("command", "option", "names"), [
    ("train", "network", NETWORKS), ("train", "input", [*INPUTS, *FEATURES]), ("train", "target", TARGETS),
    ("render", "sampler", ["auto", *(kind.name for kind in PACKAGED)]),
])  # fmt: skip
def test_the_help_of_an_option_lists_what_is_known(command, option, names):
    found = {each.name: each for each in get_command(app).commands[command].params}[option].help
    own = [name for name in names if isinstance(names, Registry) and is_own(names[name])]
    assert [name for name in names if name not in found and name not in own] == []


def test_every_page_stands_in_the_index():
    index = (ROOT / "docs" / "index.md").read_text()
    assert {f"docs/{name}" for name in re.findall(r"^\| \[[a-z]+\.md\]\(([a-z]+\.md)\)", index, re.MULTILINE)} == {
        str(page.relative_to(ROOT)) for page in PAGES if page.name not in ("README.md", "index.md")
    }


@pytest.mark.parametrize("page", [*PAGES, *NOTES, ROOT / "SECURITY.md"], ids=lambda page: page.name)
def test_every_link_leads_somewhere(page):
    for target in re.findall(r"\]\(([^)#\s]+)", page.read_text()):
        assert target.startswith("http") or (page.parent / target).exists(), target


def test_what_makes_blocks_shorter_still_stands_in_one():
    text = "".join(block.text for block in PYTHON)
    assert [long for long, _ in SHORTER if long not in text] == []


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_a_page_begins_with_an_example(page):
    """Its first block of code stands within its first words; lists of words and papers have none."""
    if page.stem not in ("README", "glossary", "bibliography"):
        before, mark, _ = page.read_text().partition("```")
        assert mark
        assert len(before.split()) < 150


def test_the_pages_together_are_short():
    assert sum(len(page.read_text().split()) for page in PAGES if page.stem != "README") <= 45_000
