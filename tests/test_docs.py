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

from specklegen.datasets import load_recipe, recipe_names
from specklegen.datasets.store.generate import generate

PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]


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
    ('load_recipe("bench.toml")', 'load_recipe("bench.toml", {"samples": {"train": 64}})'),
    ("for epoch in range(10):", "for epoch in range(1):"),
    ("rel_error=0.02)", "rel_error=0.2)"),
    ("n_rays=100_000", "n_rays=2000"),
    ("monte_carlo_mean(layer, 4000, seed=0)", "monte_carlo_mean(layer, 8, seed=0)"),
    ("range(8)))", "range(2)))"),
    ("samples=128, folder", "samples=8, folder"),
]


def shorter(text: str) -> str:
    for long, short in SHORTER:
        text = text.replace(long, short)
    return text


def own_process(block: Block) -> bool:
    """Whether a block starts processes, which read it again as their main module."""
    return any(word in block.text for word in ("num_workers", "LocalCluster"))


@pytest.fixture(scope="module")
def bench(tmp_path_factory) -> Path:
    """The folder that the pages speak of: pictures of one's own, the README's bench beside them, and a store."""
    folder = tmp_path_factory.mktemp("bench")
    (folder / "my-images").mkdir()
    for n in range(10):
        Image.fromarray(np.full((20, 20 + n), 20 * n + 9, np.uint8)).save(folder / "my-images" / f"{n}.png")
    (folder / "bench.toml").write_text(next(b.text for b in blocks() if b.language == "toml" and "my-bench" in b.text))
    generate(load_recipe("through-slab"), samples=64, folder=folder / "data" / "a.zarr", processes=1)
    return folder


PYTHON = [block for block in blocks() if block.language == "python"]


@pytest.mark.parametrize("block", [block for block in PYTHON if not own_process(block)], ids=str)
def test_a_block_runs_on_its_own(block, bench, monkeypatch):
    for library in ("webdataset", "upath", "deepinv"):  # of extras, and of libraries that are no extra
        if f"import {library}" in block.text or (library == "upath" and "://a.zarr" in block.text):
            pytest.importorskip(library)
    monkeypatch.chdir(bench)
    exec(compile(shorter(block.text), str(block), "exec"), {"__name__": "__main__"})


@pytest.mark.slow
@pytest.mark.parametrize("block", [block for block in PYTHON if own_process(block)], ids=str)
def test_a_block_that_starts_processes_runs_on_its_own(block, bench):
    file = bench / "block.py"
    file.write_text(shorter(block.text))
    command = [sys.executable, str(file)]
    if "init_process_group" in block.text:
        command = [sys.executable, "-m", "torch.distributed.run", "--nproc-per-node", "2", str(file)]
    done = subprocess.run(command, cwd=bench, capture_output=True, text=True, timeout=600)
    assert done.returncode == 0, done.stderr[-2000:]


@pytest.mark.parametrize("block", [block for block in blocks() if block.language == "toml"], ids=str)
def test_a_recipe_on_a_page_is_one(block, bench):
    """Read from its own folder, wherever the command runs: its pictures lie beside it."""
    file = bench / "recipe-of-a-page.toml"
    file.write_text(block.text)
    assert quick_recipe(file).sample(0, "train", 0).keys() & {"image", "stack"}


def test_every_recipe_stands_on_its_page():
    page = (ROOT / "docs" / "recipes.md").read_text()
    assert set(re.findall(r"^\| `([a-z-]+)` \| [a-z-]+ \|", page, re.MULTILINE)) == set(recipe_names())


def test_every_page_stands_in_the_index():
    index = (ROOT / "docs" / "index.md").read_text()
    assert {f"docs/{name}" for name in re.findall(r"^\| \[[a-z]+\.md\]\(([a-z]+\.md)\)", index, re.MULTILINE)} == {
        str(page.relative_to(ROOT)) for page in PAGES if page.name not in ("README.md", "index.md")
    }


@pytest.mark.parametrize("page", [*PAGES, ROOT / "SECURITY.md"], ids=lambda page: page.name)
def test_every_link_leads_somewhere(page):
    for target in re.findall(r"\]\(([^)#\s]+)", page.read_text()):
        assert target.startswith("http") or (page.parent / target).exists(), target


def test_what_makes_blocks_shorter_still_stands_in_one():
    text = "".join(block.text for block in PYTHON)
    assert [long for long, _ in SHORTER if long not in text] == []
