"""A newcomer's walk, from a fresh clone to a trained network; slow, since it installs everything anew.

    pytest -m slow tests/test_newcomer.py

`TORCH` and the configuration of pip are those of the shell, as for `make`.
"""

import os
import re
import shutil
import signal
import subprocess
import time
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from scenes import ROOT
from test_docs import blocks, shorter

pytestmark = pytest.mark.slow

README = [block for block in blocks() if block.page in ("README.md", "docs/start.md")]
TINY = ["--set", "material.kernel_paths=1000", "--set", "samples.train=64"]


def run(*words: str | Path, cwd: Path, status: int = 0, **options) -> str:
    """What a program prints, both streams together."""
    done = subprocess.run([str(word) for word in words], cwd=cwd, stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
                          text=True, timeout=3600, **options)  # fmt: skip
    assert done.returncode == status, done.stdout[-4000:]
    return done.stdout


@pytest.fixture(scope="module")
def fresh(tmp_path_factory) -> tuple[Path, str]:
    """A fresh clone in which `make demo` has run, and what that printed."""
    clone = tmp_path_factory.mktemp("newcomer") / "specklegen"
    run("git", "clone", "--quiet", ROOT, clone, cwd=clone.parent)
    environment = {name: value for name, value in os.environ.items() if name not in ("PYTHONPATH", "VIRTUAL_ENV")}
    return clone, run("make", "demo", cwd=clone, env=environment)


@pytest.fixture(scope="module")
def setup(tmp_path_factory) -> Path:
    """A folder of one's own: the README's setup, and odd pictures."""
    folder = tmp_path_factory.mktemp("setup")
    (folder / "setup.toml").write_text(next(b.text for b in README if b.language == "toml"))
    images = folder / "my-images"
    images.mkdir()
    rng = np.random.default_rng(0)
    for n in range(8):
        Image.fromarray(rng.integers(1, 255, (20, 20 + n), np.uint8)).save(images / f"grey-{n}.png")
    Image.fromarray(rng.integers(1, 255, (20, 20, 4), np.uint8)).save(images / "transparent.png")
    Image.fromarray(rng.integers(1, 65535, (20, 20)).astype(np.uint16)).save(images / "sixteen.png")
    np.save(images / "array.npy", rng.random((30, 20)))
    return folder


def command(fresh: tuple[Path, str]) -> Path:
    return fresh[0] / ".venv" / "bin" / "specklegen"


def test_the_demo_is_quiet_and_leaves_what_it_names(fresh):
    clone, said = fresh
    assert not re.search(r"!!|Traceback|[A-Z]\w*Warning", said), said
    named = re.findall(r"^  (demo/\S+\.png): \S", said, re.MULTILINE)
    assert len(named) == 6
    assert all((clone / name).stat().st_size > 10_000 for name in named)
    assert "Compiling, once" in said
    pictures = set(re.findall(r"docs/images/([\w-]+\.png)", (clone / "README.md").read_text()))
    figures = {"overview.png"}  # of scripts that take minutes
    assert pictures - figures <= {Path(name).name for name in named}


@pytest.mark.parametrize("block", [block for block in README if block.language == "python"], ids=str)
def test_a_block_of_the_readme_runs(fresh, setup, block):
    (setup / "block.py").write_text(shorter(block.text))
    said = run(fresh[0] / ".venv" / "bin" / "python", "block.py", cwd=setup)  # which asserts the exit status
    assert "Traceback" not in said


def test_a_corrupt_picture_is_named_and_others_serve(fresh, setup):
    torn = setup / "my-images" / "torn.png"
    torn.write_bytes((setup / "my-images" / "grey-0.png").read_bytes()[:50])
    assert "torn.png" in run(command(fresh), "plan", "setup.toml", "--samples", "8", *TINY, cwd=setup, status=2)
    torn.unlink()
    assert "8 samples: about" in run(command(fresh), "plan", "setup.toml", "--samples", "8", *TINY, cwd=setup)
    # From another folder the pictures are found all the same.
    run(command(fresh), "preview", setup / "setup.toml", "--out", "sheet.png", *TINY, cwd=setup.parent)


def test_a_training_goes_on_where_it_was_stopped(fresh, setup):
    words = [command(fresh), "train", "setup.toml", "--out", "run", "--epochs", "4", "--validation-samples", "8",
             "--width", "4", "--batch-size", "16", *TINY]  # fmt: skip
    first = subprocess.Popen([str(w) for w in words], cwd=setup, stdout=subprocess.PIPE, stderr=subprocess.STDOUT)
    for _ in range(3000):
        if (setup / "run" / "checkpoint.pt").exists() or first.poll() is not None:
            break
        time.sleep(0.1)
    first.send_signal(signal.SIGINT)
    assert b"Traceback" not in first.communicate(timeout=300)[0]
    said = run(*words, cwd=setup)
    assert "epoch 0:" not in said or first.returncode == 0
    assert (setup / "run" / "best.pt").exists()
    said = run(command(fresh), "evaluate", "run/best.pt", "--recipe", "setup.toml", "--samples", "8", "--no-katz",
               "--set", "material.kernel_paths=1000", "--set", "media=4", cwd=setup)  # fmt: skip
    assert "| run | sharp |" in said


@pytest.mark.parametrize("checker", ["pyright", "mypy"])
def test_type_checkers_know_the_code_of_the_readme(fresh, setup, checker):
    binaries = fresh[0] / ".venv" / "bin"
    if checker == "mypy":
        run(binaries / "pip", "install", "--quiet", "mypy", cwd=setup)
    (setup / "types").mkdir(exist_ok=True)
    asked = "\nreveal_type(load_recipe('x'))\nreveal_type(sg.memory_effect)\n"
    text = "import specklegen as sg\nfrom specklegen.datasets import load_recipe\n" + asked
    (setup / "types" / "user.py").write_text(text)
    options = ["--pythonpath", str(binaries / "python")] if checker == "pyright" else []
    said = run(binaries / checker, *options, "user.py", cwd=setup / "types")
    assert "Recipe" in said
    assert "MemoryEffect" in said
    assert "Unknown" not in said


def test_the_wheel_works_without_the_clone(fresh, tmp_path):
    clone = fresh[0]
    pip = clone / ".venv" / "bin" / "pip"
    run(pip, "wheel", "--quiet", "--no-deps", "--wheel-dir", tmp_path, clone, cwd=tmp_path)
    (wheel,) = tmp_path.glob("*.whl")
    run(pip, "install", "--quiet", "--no-deps", "--target", tmp_path / "site", wheel, cwd=tmp_path)
    program = (
        "import specklegen, specklegen.models as m; from specklegen.datasets import load_recipe\n"
        "load_recipe('unknown-slab'); m.load_pretrained(); print(specklegen.__file__)"
    )
    said = run(clone / ".venv" / "bin" / "python", "-c", program, cwd=tmp_path,
               env=os.environ | {"PYTHONPATH": str(tmp_path / "site")})  # fmt: skip
    assert said.strip() == str(tmp_path / "site" / "specklegen" / "__init__.py")
    shutil.rmtree(tmp_path / "site")
