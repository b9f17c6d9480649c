"""The package as a user gets it: complete, light to import, its lists true."""

import subprocess
import sys
import tomllib
import zipfile

import pytest
from scenes import ROOT

TREES = {"specklegen": "specklegen", "datasets": "specklegen.datasets", "models": "specklegen.models"}
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())


def _folders() -> set[str]:
    """Every package in the tree, under the name that it is imported by."""
    found = set()
    for top, name in TREES.items():
        for init in (ROOT / top).rglob("__init__.py"):
            parts = init.parent.relative_to(ROOT / top).parts
            if top == "specklegen" and parts[:1] in (("datasets",), ("models",)):
                continue  # the two links
            found.add(".".join([name, *parts]))
    return found


def test_every_package_is_listed():
    assert set(PROJECT["tool"]["setuptools"]["packages"]) == _folders()


@pytest.fixture(scope="module")
def wheel(tmp_path_factory) -> zipfile.ZipFile:
    out = tmp_path_factory.mktemp("wheel")
    options = ["--quiet", "--no-deps", "--no-build-isolation", "-w", str(out)]
    command = [sys.executable, "-m", "pip", "wheel", *options, str(ROOT)]
    subprocess.run(command, check=True, capture_output=True, timeout=300)
    return zipfile.ZipFile(next(out.glob("*.whl")))


def test_wheel_holds_code_and_data(wheel):
    names = set(wheel.namelist())
    wanted = {"specklegen/py.typed"}
    for top, name in TREES.items():
        for pattern in ("*.py", "recipes/*.toml", "data/*.npz", "data/*.pt", "data/*.md"):
            for file in (ROOT / top).rglob(pattern):
                parts = file.relative_to(ROOT / top).parts
                if top == "specklegen" and parts[0] in ("datasets", "models"):
                    continue
                wanted.add("/".join([name.replace(".", "/"), *parts]))
    assert wanted - names == set()
    assert not [n for n in names if n.startswith(("datasets/", "models/", "tests/"))]


def test_import_stays_light():
    code = (
        "import sys, specklegen as sg\n"
        "sg.Scene, sg.plan, sg.render, sg.memory_effect\n"
        "print([m for m in ('torch', 'matplotlib', 'zarr', 'skimage', 'typer') if m in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, timeout=120)
    assert done.stdout.strip() == "[]"


def test_every_public_name_loads_and_is_documented():
    import specklegen as sg

    for name in sg.__all__:
        assert getattr(sg, name).__doc__, name
    with pytest.raises(AttributeError):
        sg.no_such_name  # noqa: B018
