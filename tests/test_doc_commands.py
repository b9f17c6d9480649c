"""Every command that the pages print runs as it is printed, or says here why it does not.

pytest -m slow tests/test_doc_commands.py     # minutes each, in a folder of their own
"""

import os
import re
import shlex
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from doc_commands import PROGRAMS, Shell, commands, plain, shells
from PIL import Image
from scenes import ROOT
from test_docs import blocks
from typer.main import get_command
from typer.testing import CliRunner

from specklegen.cli.commands import app
from specklegen.datasets import load_recipe
from specklegen.datasets.store.generate import generate

QUICK = [shell for shell in shells() if str(shell).startswith("docs/recipes.md") and "recipes" in shell.lines[0]] + [
    shell for shell in shells() if shell.page == "docs/datasets.md" and shell.lines[0].startswith("specklegen plan")
]
"""Run by every `make test`; all others are slow."""

NOT_RUN = {
    "make (demo|test|quick)": "test_newcomer.py runs the first; the others are this suite",
    "make speed|python scripts/benchmark.py .*": "its answer is a time, on a quiet machine",
    "make docs": "test_site.py runs what it runs",
    "pip install .*": "asks a package index; packaging/check_install.py runs it in a clean environment",
    "pytest (?!-m gpu).*": "files of this suite",
    "python packaging/install_sizes.py .*": "installs gigabytes, and its answer depends on the day",
    "torchrun .*": "test_docs.py runs the program with as many processes",
    ".*SLURM_ARRAY_TASK_ID.*": "for a cluster; test_store.py runs all parts",
    "specklegen (train|store (info|verify)|preview|train characters-of-new-fonts)":
        "a name; its arguments stand elsewhere",
    "specklegen --install-completion": "writes into the user's shell",
    "specklegen explore": "serves until it is stopped; explorer/test_page.py looks at it",
    "specklegen plan explored.toml": "of a file that the explorer writes",
    "specklegen check benchmark( [^-].*)?": "of a function or a model of the reader's, or minutes; test_benchmark.py",
    "specklegen check benchmark --table results": "of the repository's folder; test_entries.py",
    "python scripts/build/make_wave_images.py": "ten minutes; test_waves.py makes one of its images",
    "specklegen evaluate runs/(unet/best.pt runs/dense|material)/best.pt": "models of runs of an hour",
    "python scripts/error_vs_time.py.*": "references take hours, and pages of the repository are written",
    "python scripts/(figures/tan13|reproduce_figures).py .*": "hours; test_reproduce_figures.py",
    "python scripts/plan_accuracy.py": "its answer is times, on a quiet machine",
    "python scripts/gpu_benchmark.py .*": "its answer is times, on a quiet machine",
    "python tests/stability_report.py --slow": "an hour; test_stability.py runs its rows",
    "python scripts/build/train_(any_object|through_slab).py.*": "an hour or more",
    "python scripts/build/fit_recoverability.py (simulate|recipes) .*": "minutes to hours",
}
"""Commands that are not run here, and why; those of scripts are checked for their options."""

SHORTENED = {"specklegen train .*": "--epochs 1 --validation-samples 8 --set samples.train=64 --batch-size 16",
             "specklegen evaluate.*": "--samples 4 --restarts 1",
             "specklegen generate (?!.*--samples (96|128|256)).*": "--samples 64"}  # fmt: skip
"""Commands that take many minutes as they are printed, and what is added to them here."""


def reason(command: str) -> str | None:
    return next((why for pattern, why in NOT_RUN.items() if re.fullmatch(pattern, command)), None)


def to_run(shell: Shell) -> list[str]:
    """Its lines but those that are not run, made shorter where need be."""
    kept = []
    for line in shell.lines:
        if not re.match(PROGRAMS, line):
            kept += [line] if "=" in line.split()[0] else []  # a variable; no line of "..."
        elif reason(plain(line)) is None:
            more = next((words for pattern, words in SHORTENED.items() if re.fullmatch(pattern, plain(line))), "")
            tail = re.search(r"&( wait)?$", line)
            kept.append(f"{plain(line)} {more} {tail[0] if tail else ''}".strip())
    return kept


_ENDED = "--- all lines have run ---"  # what servers say when they are stopped afterwards is not looked at
SLOW = [shell for shell in shells() if shell not in QUICK and any(re.match(PROGRAMS, line) for line in to_run(shell))]


@pytest.fixture(scope="module")
def setup(tmp_path_factory) -> Path:
    """The folder that the pages speak of: pictures, a setup, and the scripts."""
    folder = tmp_path_factory.mktemp("commands")
    (folder / "my-images").mkdir()
    for n in range(10):
        Image.fromarray(np.full((20, 20 + n), 20 * n + 9, np.uint8)).save(folder / "my-images" / f"{n}.png")
    rng = np.random.default_rng(0)  # frames of a camera, for fit-camera
    for name, level, count in [(f"bright_{n}", 50 * 2**n, 2) for n in range(4)] + [("dark", 0, 2)]:
        for n in range(count):
            frame = (20 + rng.poisson(level, (64, 64)) + rng.normal(0, 2, (64, 64))).round().astype(np.uint16)
            Image.fromarray(frame).save(folder / f"{name}_{n}.tif")
    (folder / "setup.toml").write_text(next(b.text for b in blocks() if b.language == "toml" and "my-setup" in b.text))
    (folder / "scripts").symlink_to(ROOT / "scripts")
    (folder / "tests").symlink_to(ROOT / "tests")
    (folder / "docs").symlink_to(ROOT / "docs")
    return folder


@pytest.mark.parametrize("shell", QUICK, ids=str)
def test_a_quick_command_runs_as_printed(shell, setup, monkeypatch):
    monkeypatch.chdir(setup)
    for line in shell.lines:
        result = CliRunner().invoke(app, shlex.split(plain(line))[1:])
        assert result.exit_code == 0, f"{line}\n{result.output}"


@pytest.fixture(scope="module")
def store(setup) -> None:
    """The store that the page on data sets speaks of."""
    generate(load_recipe("through-slab"), samples=96, folder=setup / "data" / "a.zarr", processes=1)


@pytest.mark.slow
@pytest.mark.usefixtures("store")
@pytest.mark.parametrize("shell", SLOW, ids=str)
def test_a_slow_command_runs_as_printed(shell, setup):
    if "reconstruct" in shell.lines[0]:
        for n in range(2):
            frame = load_recipe(setup / "setup.toml").sample(0, "test", n)["image"]
            Image.fromarray(np.asarray(frame, np.uint16)).save(setup / f"shot-{n}.tiff")
    stop = f"echo {_ENDED} >&2; kill $(jobs -p) 2>/dev/null || true"
    script = f"set -e\ntrap '{stop}' EXIT\n" + "\n".join(to_run(shell))
    path = f"{Path(sys.executable).parent}:{os.environ['PATH']}"
    environment = os.environ | {"PATH": path, "PYTHONPATH": str(ROOT), "MPLBACKEND": "agg"}
    folder = ROOT if shell.lines[0].startswith("pytest") else setup
    done = subprocess.run(["bash", "-c", script], cwd=folder, env=environment, capture_output=True, text=True,
                          timeout=1800)  # fmt: skip
    assert done.returncode == 0, script + done.stdout[-2000:] + done.stderr[-2000:]
    assert "Traceback" not in done.stderr.partition(_ENDED)[0], done.stderr


def test_every_exception_still_stands_on_a_page():
    for pattern in [*NOT_RUN, *SHORTENED]:
        for part in pattern.split("|") if "(" not in pattern else [pattern]:
            assert any(re.fullmatch(part, command) for command in commands()), part


def test_every_command_is_found():
    """In blocks of any kind, and in sentences."""
    wanted = ["make demo", "specklegen evaluate runs/mine/best.pt", "pytest -m gpu", "pip install ."]
    assert set(wanted) <= set(commands())
    assert sum(len(shell.lines) for shell in shells() if shell.page == "docs/datasets.md") >= 20
    assert len(commands()) >= 90


RUN = {plain(line) for shell in QUICK for line in shell.lines}
PARSED = [
    command
    for command in commands()
    if re.match("specklegen [a-z]", command) and command not in RUN and not (reason(command) or "").startswith("a name")
]


@pytest.mark.parametrize("command", PARSED)
def test_a_command_on_a_page_is_one(command):
    """It and its options exist, and its values have the right type; nothing is run."""
    words, outer = shlex.split(command)[1:], get_command(app)
    with outer.make_context("specklegen", list(words), resilient_parsing=True) as context:
        name, inner, rest = outer.resolve_command(context, list(words))
        while inner is not None and hasattr(inner, "resolve_command"):  # a command of commands
            context = inner.make_context(name, list(rest), parent=context, resilient_parsing=True)
            rest = [*getattr(context, "_protected_args", []), *context.args]  # less the group's own options
            if inner.invoke_without_command and not rest:
                return
            name, inner, rest = inner.resolve_command(context, rest)
        assert inner is not None
        assert inner.make_context(name, rest, parent=context).args == []


@pytest.mark.slow
@pytest.mark.parametrize("command", [command for command in commands() if command.startswith("python ")])
def test_the_options_of_a_script_exist(command):
    """Its parser takes the command, choices and types included, and knows each option."""
    words = [sys.executable, *shlex.split(command)[1:]]
    done = subprocess.run([*words, "--help"], cwd=ROOT, env=os.environ | {"PYTHONPATH": str(ROOT)}, capture_output=True,
                          text=True, timeout=300)  # fmt: skip
    assert done.returncode == 0, done.stderr
    for word in words:
        assert not word.startswith("--") or word in done.stdout, word
