"""Entries of results/: what a run writes, what is refused, and those of the repository."""

import json
import re

import pytest
from refusals import assert_refused
from scenes import ROOT
from typer.testing import CliRunner

from specklegen.cli import commands
from specklegen.models import benchmark
from specklegen.models.judging.entries import UNNAMED, entry, read_entries, read_entry, table, write_entry
from specklegen.models.judging.tasks import TASKS, VERSION

RESULTS = ROOT / "results"
MARKS = re.compile(r"<!-- results -->\n\n(.*?)\n<!-- end -->", re.DOTALL)


@pytest.fixture(scope="module")
def run():
    return benchmark({"mine": lambda batch: batch["image"][:, 50:78, 50:78]}, tasks=["thin"], samples=3)


@pytest.fixture
def content(run, tmp_path):
    write_entry(tmp_path / "mine.json", entry(run, "mine", name="of the middle"))
    return json.loads((tmp_path / "mine.json").read_text())


def test_every_file_of_the_repository_is_an_entry():
    entries = read_entries(RESULTS)
    assert len(entries) == len(list(RESULTS.glob("*.json"))) > 0
    assert len({each.name for each in entries}) == len(entries)
    assert not any(UNNAMED in (each.by, each.about, each.trained_on) for each in entries)
    assert {file.suffix for file in RESULTS.iterdir()} == {".json", ".md"}


def cells(text: str) -> list[list[str]]:
    """Return the cells of the rows of a table, without its rule."""
    rows = [line.strip("| ").split(" | ") for line in text.splitlines() if line.startswith("| ")]
    return [[cell.strip() for cell in row] for row in rows]


def test_the_page_has_the_table_of_the_folder():
    """The note holds what ``specklegen check benchmark --table results`` prints; the page repeats a part of it."""
    shown = CliRunner().invoke(commands.app, ["check", "benchmark", "--table", str(RESULTS)])
    assert shown.exit_code == 0, shown.output
    (note,) = MARKS.findall((ROOT / "docs" / "notes" / "benchmark.md").read_text())
    assert note == shown.output
    page = (ROOT / "docs" / "benchmark.md").read_text().partition("## Results")[2]
    (names, *rows), whole = cells(page), {row[0].removesuffix(" *"): row for row in cells(note)}
    places = [whole["method"].index(name) for name in names]
    assert len(rows) >= 7
    assert rows == [[row[0], *(whole[row[0]][place] for place in places[1:])] for row in rows]
    assert shown.output == table(read_entries(RESULTS))


def test_an_entry_says_what_its_run_said(run, content, tmp_path):
    one = read_entry(tmp_path / "mine.json")
    assert (one.name, one.version, one.by, one.complete) == ("of the middle", VERSION, UNNAMED, False)
    scores = content["tasks"]["thin"]
    assert scores["images"] == 3
    assert scores["pearson"]["mean"] == pytest.approx(run.interval("mine", "thin").mean, abs=1e-6)
    assert scores["ssim"]["chance"] == pytest.approx(run.chance("mine", "thin", "ssim"), abs=1e-6)
    assert f"| {scores['pearson']['mean']:.3f} [3] |" in table([one])


def test_a_complete_entry_is_asked_all(content):
    content["tasks"] = {
        each.name: content["tasks"]["thin"] | {"digest": each.fingerprint, "images": each.samples} for each in TASKS
    }
    from specklegen.models.judging.entries import Entry

    assert Entry(**content).complete
    assert "not complete" not in table([Entry(**content)])
    content["tasks"]["thin"]["images"] -= 1
    assert not Entry(**content).complete
    del content["tasks"]["waves"]
    content["tasks"]["thin"]["images"] += 1
    assert not Entry(**content).complete


@pytest.mark.parametrize(("change", "said"), [
    (lambda c: c.pop("about"), r"Entry\.about"), (lambda c: c.update(score=1.0), r"Entry\.score"),
    (lambda c: c.update(version=VERSION + 1), r"Entry\.version must be at most"),
    (lambda c: c.update(commitment="0" * 64), r"Entry\.commitment"),  # other images than those of the tasks
    (lambda c: c.update(tasks={}), r"Entry\.tasks"),
    (lambda c: c["tasks"].update(thick=c["tasks"]["thin"]), "one of unseen media"),
    (lambda c: c["tasks"]["thin"].update(digest="0" * 64), r"digest must be 80f6612bc5ea"),
    (lambda c: c["tasks"]["thin"].update(images=65), "2 to 64"),
    (lambda c: c["tasks"]["thin"].update(images=2, unanswered=3), "2 to 64"),
    (lambda c: c["tasks"]["thin"]["pearson"].update(mean=2.0), "between low and high"),
    (lambda c: c["tasks"]["thin"]["psnr"].pop("chance"), "chance"),
])  # fmt: skip
def test_what_is_no_entry_is_refused(content, tmp_path, change, said):
    change(content)
    (tmp_path / "mine.json").write_text(json.dumps(content))
    assert_refused(lambda: read_entry(tmp_path / "mine.json"), said)


def test_an_entry_of_an_earlier_version_is_read(content, tmp_path):
    (tmp_path / "earlier.json").write_text(json.dumps(content | {"commitment": "", "answers": "mine.npz"}))
    assert read_entry(tmp_path / "earlier.json") == read_entry(tmp_path / "mine.json")


@pytest.mark.parametrize("text", ["{", "[1]"])
def test_what_is_no_table_is_refused(tmp_path, text):
    (tmp_path / "mine.json").write_text(text)
    assert_refused(lambda: read_entry(tmp_path / "mine.json"), r"entry mine\.json must be")


def test_entries_of_a_run_are_files(run, tmp_path):
    run.write(tmp_path)
    (one,) = read_entries(tmp_path / "entries")
    assert one.name == "mine"
