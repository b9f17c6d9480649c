"""The package as a user gets it: complete, quiet to build, light to import, its lists true."""

import ast
import os
import re
import runpy
import shutil
import subprocess
import sys
import tarfile
import tomllib
import zipfile
from pathlib import Path

import pytest
from scenes import ROOT

TREES = {"specklegen": "specklegen", "datasets": "specklegen.datasets", "models": "specklegen.models"}
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())
IMPORT_NAMES = {"pillow": "PIL", "universal-pathlib": "upath", "scikit-image": "skimage", "scikit-learn": "sklearn"}
"""Names that packages are imported by, where these are not their own with underscores."""
FEW_TYPES = """
import numpy as np
import specklegen as sg
from specklegen.datasets import SpeckleStream, load_recipe
from specklegen.models import load_pretrained

slab = sg.Slab(thickness=1.0, mean_free_path=0.1, scatterer=sg.HenyeyGreenstein(g=0.9))
curve: sg.MemoryEffect = sg.memory_effect(slab, wavelength=0.5, tilts=np.zeros(2))
wrong: int = load_pretrained()
also_wrong: str = SpeckleStream(load_recipe("through-slab"))
"""


def _modules(top: str) -> list[Path]:
    """Python files of a tree, without what its links show."""
    links = [ROOT / "specklegen" / name for name in ("datasets", "models")]
    return [file for file in (ROOT / top).rglob("*.py") if not any(file.is_relative_to(link) for link in links)]


def test_every_tracked_file_has_a_name_that_any_system_can_hold():
    """A colon would break a checkout on Windows; what tests leave behind by mistake may hold one."""
    if not (ROOT / ".git").exists():
        pytest.skip("no checkout of git")
    said = subprocess.run(["git", "ls-files", "-z"], cwd=ROOT, capture_output=True, text=True, check=True).stdout
    names = said.rstrip("\0").split("\0")
    assert len(names) > 500
    assert [name for name in names if not re.fullmatch(r"[A-Za-z0-9._/+-]+", name)] == []


def _folders() -> set[str]:
    """Every package in the tree, under the name that it is imported by."""
    found = set()
    for top, name in TREES.items():
        for init in (file for file in _modules(top) if file.name == "__init__.py"):
            found.add(".".join([name, *init.parent.relative_to(ROOT / top).parts]))
    return found


def _wanted() -> set[str]:
    """Every file of code and data, under the path that it has in a wheel."""
    found = {"specklegen/py.typed"}
    for top, name in TREES.items():
        for pattern in ("*.py", "*.pyi", "packaged/*.toml", "data/*.npz", "data/*.txt", "data/*.pt", "data/*.md"):
            for file in (ROOT / top).rglob(pattern):
                parts = file.relative_to(ROOT / top).parts
                if top != "specklegen" or parts[0] not in ("datasets", "models"):
                    found.add("/".join([name.replace(".", "/"), *parts]))
    return found


def test_every_package_is_listed():
    assert set(PROJECT["tool"]["setuptools"]["packages"]) == _folders()


def test_every_package_that_is_imported_is_declared():
    """Pillow and tifffile came by accident once, through a package that may drop them."""
    project = PROJECT["project"]
    extras = [line for name, lines in project["optional-dependencies"].items() if name != "dev" for line in lines]
    names = [re.split(r"[<>=\[; ]", line)[0].lower() for line in [*project["dependencies"], *extras]]
    declared = {IMPORT_NAMES.get(name, name.replace("-", "_")) for name in names} | {"specklegen", "dask"}
    imported: dict[str, Path] = {}
    for top in TREES:
        for file in _modules(top):
            for node in ast.walk(ast.parse(file.read_text())):
                if isinstance(node, ast.Import):
                    imported |= {alias.name.partition(".")[0]: file for alias in node.names}
                elif isinstance(node, ast.ImportFrom) and not node.level:
                    imported[str(node.module).partition(".")[0]] = file
    strangers = {name: file for name, file in imported.items() if name not in sys.stdlib_module_names}
    assert {name: str(file) for name, file in strangers.items() if name not in declared} == {}


def test_nothing_says_to_install_another_project_by_the_name_of_this_one():
    """On the package index `specklegen` is somebody else's; ours is specklegen-torch, or a file, or a checkout."""
    files = subprocess.run(["git", "ls-files", "-z"], cwd=ROOT, capture_output=True, text=True, check=True).stdout
    wrong = re.compile(
        r"(?:pip|conda|uv|mamba)\W+(?:pip\W+)?(?:install|add)\b[^`\n]*?[\s'\"]specklegen(?![\w-])[\[\s`'\"=]"
    )
    assert wrong.search("pip install specklegen\n")  # it finds what it looks for
    assert wrong.search("pip install 'specklegen[mie]'")
    assert not wrong.search("pip install 'specklegen-torch[mie]'")
    texts = (".md", ".py", ".toml", ".yaml", ".yml", ".cff", "")
    found = {}
    for file in (ROOT / name for name in filter(None, files.split("\0"))):
        if file.is_file() and not file.is_symlink() and file.suffix in texts and file != Path(__file__):
            if match := wrong.search(file.read_text(errors="replace")):
                found[str(file)] = match[0]
    assert found == {}


def test_every_file_says_the_same_version():
    import specklegen

    assert PROJECT["project"]["name"] == "specklegen-torch"
    said = {"CITATION.cff": r"^version: (\S+)$", "packaging/conda/recipe.yaml": r"^  version: (\d\S+)$",
            "README.md": r"specklegen_torch-(\d[\d.]*\d)-py3-none-any\.whl"}  # fmt: skip
    versions = {name: re.findall(pattern, (ROOT / name).read_text(), re.MULTILINE) for name, pattern in said.items()}
    assert versions == {name: [specklegen.__version__] for name in said}
    assert PROJECT["project"]["version"] == specklegen.__version__


def test_the_conda_recipe_asks_for_what_the_package_needs():
    other_names = {"finufft": "python-finufft", "matplotlib": "matplotlib-base", "torch": "pytorch"}
    pip = {}
    for line in [*PROJECT["project"]["dependencies"], *PROJECT["project"]["optional-dependencies"]["torch"]]:
        name, range_ = re.fullmatch(r"([\w-]+)(.*)", line).groups()
        pip[other_names.get(name, name)] = range_
    run = (ROOT / "packaging/conda/recipe.yaml").read_text().partition("  run:\n")[2].partition("\n\n")[0]
    conda = dict(re.findall(r"^    - (\S+) (\S+)$", run, re.MULTILINE))
    assert conda.pop("python") == PROJECT["project"]["requires-python"]
    assert conda == pip


COLAB = "https://colab.research.google.com/github"
PAPERS = ("pyproject.toml", "CITATION.cff", ".zenodo.json", "CHANGELOG.md", "README.md", "docs/index.md")


@pytest.fixture(scope="module")
def filled(tmp_path_factory):
    """The papers of a release, filled in."""
    folder = tmp_path_factory.mktemp("release")
    shutil.copytree(ROOT / ".github", folder / ".github")
    for name in PAPERS:
        text = (ROOT / name).read_text(encoding="utf-8")
        text = text.replace("https://example.org/specklegen/notebooks", f"{COLAB}/ada/engine/blob/gh-pages")
        text = re.sub(r"TODO: [^\"]*", "Ada Lovelace", text).replace("example.org", "specklegen.dev")
        text = text.replace('pip install ".[torch]"', "pip install specklegen-torch[torch]")
        (folder / name).parent.mkdir(exist_ok=True)
        (folder / name).write_text(text.replace(" (unreleased)", ""), encoding="utf-8")
    return folder


def test_a_release_needs_its_papers(filled, tmp_path):
    findings = runpy.run_path(str(ROOT / "packaging/check_release.py"))["findings"]
    assert findings(filled) == []
    waiting = findings(ROOT)
    assert {line.split()[0] for line in waiting} == set(PAPERS)
    for name, old, new, said in (
        ("pyproject.toml", 'name = "Ada Lovelace"', 'name = " "', "pyproject.toml authors"),
        ("pyproject.toml", "Issues =", "Errata =", "urls.Issues"),
        ("pyproject.toml", f"{COLAB}/ada", "https://specklegen.dev/ada", "urls.Notebooks"),
        ("CITATION.cff", "Ada Lovelace", "TODO", "CITATION.cff authors"),
        ("README.md", "pip install specklegen-torch", "pip install ./specklegen", "README.md must install the release"),
        ("CITATION.cff", "version: ", "version: 9.", "CITATION.cff must be of version"),
        (".zenodo.json", "Ada Lovelace", "", ".zenodo.json creators"),
        (".github/workflows/release.yml", "@11bd71901bbe5b1630ceea73d27597364c9af683", "@v4", "pinned to a commit"),
    ):
        broken = tmp_path / said.replace(" ", "-")
        shutil.copytree(filled, broken)
        text = (broken / name).read_text(encoding="utf-8")
        assert old in text
        (broken / name).write_text(text.replace(old, new), encoding="utf-8")
        assert any(said in line for line in findings(broken)), said


def test_a_site_takes_the_place_of_the_one_before(tmp_path):
    publish = runpy.run_path(str(ROOT / "packaging/publish_site.py"))["publish"]
    remote, site = tmp_path / "remote.git", tmp_path / "site"
    subprocess.run(["git", "init", "--quiet", "--bare", str(remote)], check=True)
    (site / "notebooks").mkdir(parents=True)
    with pytest.raises(SystemExit, match="site must be a folder that `make docs` made"):
        publish(site, str(remote))
    for name in ("index.html", "_static/a.css", "notebooks/plot_01.ipynb"):
        (site / name).parent.mkdir(exist_ok=True)
        (site / name).write_text(name)
    (site / ".gitignore").write_text("*.ipynb")
    publish(site, str(remote))
    (site / "index.html").write_text("newer")
    publish(site, str(remote))

    def git(*words: str) -> str:
        return subprocess.run(["git", f"--git-dir={remote}", *words], capture_output=True, text=True, check=True).stdout

    assert git("ls-tree", "-r", "--name-only", "gh-pages").split() == [
        ".gitignore", ".nojekyll", "_static/a.css", "index.html", "notebooks/plot_01.ipynb"
    ]  # fmt: skip
    assert git("show", "gh-pages:index.html") == "newer"
    assert git("rev-list", "--count", "gh-pages").strip() == "1"


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["wheel", "sdist"])
@pytest.mark.parametrize("minor", [11, 12, 13])
def test_a_release_file_works_in_a_clean_environment(minor, kind, tmp_path):
    """`TORCH` and the configuration of pip are those of the shell; TORCH="" leaves out PyTorch, and what needs it."""
    python = shutil.which(f"python3.{minor}")
    if python is None or subprocess.run([python, "--version"], capture_output=True).returncode:  # a shim without one
        pytest.skip(f"there is no python3.{minor} here")
    file = _built(_checkout(tmp_path / "specklegen"), f"build_{kind}")
    command = [sys.executable, str(ROOT / "packaging" / "check_install.py"), "--python", python, str(file)]
    without = [] if os.environ.get("TORCH", "torch") else ["--without-torch"]
    done = subprocess.run([*command, *without], cwd=tmp_path, capture_output=True, text=True, timeout=1800)
    assert done.returncode == 0, done.stderr[-4000:]


# ---- Building ------------------------------------------------------------------------------------------
def _checkout(folder: Path, *, links: bool = True) -> Path:
    """A copy of what git tracks, in which building may write."""
    tracked = subprocess.run(["git", "ls-files", "-z"], cwd=ROOT, capture_output=True, text=True, check=True).stdout
    for name in filter(None, tracked.split("\0")):
        file = ROOT / name
        if name.startswith(("docs/", "tests/")) or not (file.exists() or file.is_symlink()):
            continue
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        if not file.is_symlink():
            shutil.copyfile(file, folder / name)
        elif links:
            (folder / name).symlink_to(os.readlink(file))
        else:  # as git writes a link where the file system has none
            (folder / name).write_text(os.readlink(file))
    return folder


def _built(checkout: Path, hook: str) -> Path:
    """Build by a hook of the backend, as pip calls it, in silence."""
    out = checkout.parent / "out"
    out.mkdir(exist_ok=True)
    code = (
        "import sys, io, contextlib; sys.path.insert(0, 'build_backend'); import specklegen_build\n"
        "with contextlib.redirect_stdout(io.StringIO()):\n"
        f"    name = specklegen_build.{hook}(sys.argv[1])\n"
        "print(name)"
    )
    done = subprocess.run([sys.executable, "-c", code, str(out)], cwd=checkout, capture_output=True, text=True,
                          timeout=300)  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert not re.search(r"!!|[A-Z]\w*Warning", done.stderr), done.stderr  # newer versions of pip print it all
    return out / done.stdout.strip()


@pytest.fixture(scope="module")
def checkout(tmp_path_factory) -> Path:
    return _checkout(tmp_path_factory.mktemp("checkout") / "specklegen")


def test_wheel_holds_code_and_data(checkout):
    names = set(zipfile.ZipFile(_built(checkout, "build_wheel")).namelist())
    assert _wanted() - names == set()
    assert {name.partition("/")[0] for name in names if not name.startswith("specklegen_torch-")} == {"specklegen"}


def test_source_distribution_builds_the_same_wheel(checkout, tmp_path):
    """From its files alone: the backend, and no links."""
    with tarfile.open(_built(checkout, "build_sdist")) as archive:
        archive.extractall(tmp_path, filter="data")
    (folder,) = tmp_path.iterdir()
    there = {path.name for path in folder.iterdir()}
    assert {"README.md", "LICENSE", "SECURITY.md", "CHANGELOG.md", "pyproject.toml"} <= there
    names = set(zipfile.ZipFile(_built(folder, "build_wheel")).namelist())
    assert _wanted() - names == set()


def test_an_editable_install_is_a_path_that_every_tool_can_follow(checkout, tmp_path):
    wheel = zipfile.ZipFile(_built(checkout, "build_editable"))
    (entry,) = [name for name in wheel.namelist() if name.endswith(".pth")]
    path = Path(wheel.read(entry).decode().strip())
    assert [inner.name for inner in path.iterdir()] == ["specklegen"]  # and not datasets, models, tests
    assert not [name for name in wheel.namelist() if name.endswith(".py")]  # no import hook
    assert "specklegen = specklegen.cli.commands:main" in "".join(
        wheel.read(name).decode() for name in wheel.namelist() if name.endswith("entry_points.txt")
    )
    program = "import specklegen.datasets as d, specklegen.models.metrics; print(d.__file__)"
    done = subprocess.run([sys.executable, "-c", program], cwd=tmp_path, env=os.environ | {"PYTHONPATH": str(path)},
                          text=True, capture_output=True, check=True, timeout=120)  # fmt: skip
    assert done.stdout.strip() == str(path / "specklegen" / "datasets" / "__init__.py")


def test_a_checkout_without_links_installs_too(tmp_path):
    wheel = zipfile.ZipFile(_built(_checkout(tmp_path / "specklegen", links=False), "build_editable"))
    assert [name for name in wheel.namelist() if name.endswith("_finder.py")]


@pytest.mark.slow
def test_type_checkers_see_the_package_from_another_folder(checkout, tmp_path):
    """pyright follows the path entry, through both links: it sees two wrong types, and nothing unknown."""
    _built(checkout, "build_editable")
    (tmp_path / "user.py").write_text(FEW_TYPES)
    paths = f'{{"include": ["user.py"], "extraPaths": ["{checkout / ".editable"}"], "venvPath": "{sys.prefix}/..", '
    (tmp_path / "pyrightconfig.json").write_text(paths + f'"venv": "{Path(sys.prefix).name}"}}')
    done = subprocess.run([sys.executable, "-m", "pyright"], cwd=tmp_path, capture_output=True, text=True, timeout=300)
    assert '"Reconstructor" is not assignable to "int"' in done.stdout, done.stdout
    assert '"SpeckleStream" is not assignable to "str"' in done.stdout
    assert "2 errors" in done.stdout


# ---- Importing -----------------------------------------------------------------------------------------
def _loaded(program: str, names: tuple[str, ...]) -> list[str]:
    """Which of some modules a program has loaded at its end."""
    code = f"import sys\n{program}\nprint([m for m in {names!r} if m in sys.modules])"
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True,
                          timeout=120)  # fmt: skip
    return ast.literal_eval(done.stdout.strip().splitlines()[-1])


def test_import_stays_light():
    program = "import specklegen as sg\nsg.Scene, sg.plan, sg.render, sg.memory_effect"
    assert _loaded(program, ("torch", "matplotlib", "zarr", "skimage", "typer", "scipy.stats")) == []


def test_what_no_pytorch_is_needed_for_works_without_and_the_rest_names_the_extra(tmp_path):
    """In a process that finds no torch, as after a plain `pip install`."""
    program = """
import importlib.abc, sys
class NoTorch(importlib.abc.MetaPathFinder):
    def find_spec(self, name, path, target=None):
        if name.partition(".")[0] == "torch":
            raise ModuleNotFoundError("No module named 'torch'", name="torch")
sys.meta_path.insert(0, NoTorch())
import numpy as np, specklegen as sg
from specklegen.datasets import load_recipe
slab = sg.Slab(thickness=100.0, mean_free_path=50.0, scatterer=sg.HenyeyGreenstein(0.5))
scene = sg.Scene(wavelength=0.5, medium=slab, illumination=sg.CollimatedBeams.tilts([0.0, 1e-5], width=1000.0),
                 sensor=sg.FarField.grid((6, 5), 1e-4))
assert sg.plan(scene, paths=64).explain()
assert sg.render(scene, paths=64, sampler="paths").field.any()
assert sg.memory_effect(slab, wavelength=0.5, tilts=[0.0, 1e-3], paths=128).intensity[0] == 1
assert sg.covariance(scene.replace(sensor=sg.FarField(scene.views[:3])), paths=64).value.any()
def models():
    from specklegen.models import load_pretrained
def sample():
    load_recipe("tilt-stack").sample(0, "train", 0)
for ask in (lambda: sg.render(scene, sampler="stationary"), sample, models):
    try:
        ask()
    except ModuleNotFoundError as error:
        assert error.name == "torch" and "pip install 'specklegen-torch[torch]'" in str(error), error
    else:
        raise AssertionError(ask)
from specklegen.cli.commands import main
try:
    main(["generate", "tilt-stack", "--samples", "2", "--out", sys.argv[1]])
except SystemExit as end:
    assert end.code == 2
"""
    done = subprocess.run([sys.executable, "-c", program, f"{tmp_path}/x.zarr"], cwd=ROOT, capture_output=True,
                          text=True, timeout=300)  # fmt: skip
    assert done.returncode == 0, done.stderr[-3000:]
    assert "specklegen-torch[torch]" in done.stderr.strip().splitlines()[-1]


def test_recipes_are_read_without_torch():
    program = "from specklegen.datasets import load_recipe, recipe_names as names\n[load_recipe(n) for n in names()]"
    assert _loaded(program, ("torch", "zarr", "matplotlib", "skimage", "scipy.stats")) == []


@pytest.mark.parametrize("words", [["recipes"], ["recipes", "show", "through-slab"], ["--version"], ["plan", "--help"]])
def test_commands_about_recipes_load_no_engine(words):
    program = (
        "from specklegen.cli.commands import main\n"
        f"try:\n    main({words!r})\nexcept SystemExit as end:\n    assert not end.code"
    )
    assert _loaded(program, ("torch", "zarr", "numba", "scipy", "finufft", "matplotlib")) == []


@pytest.mark.parametrize("name", ["datasets", "models"])
def test_a_folder_of_the_clone_does_not_pass_for_another_package(name):
    """Hugging Face's `datasets`, say, imported where Python was started in the clone."""
    command = [sys.executable, "-c", f"import {name}"]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=60)
    assert done.returncode == 1
    last = done.stderr.strip().splitlines()[-1]
    assert last.startswith(f"ImportError: `import {name}` found the folder of specklegen's clone")
    assert f"`import specklegen.{name}`" in last


def test_every_public_name_loads_and_is_documented():
    import specklegen as sg
    from specklegen import datasets, models

    for package in (sg, datasets, models):
        assert set(package.__all__) <= set(dir(package))
        for name in package.__all__:
            assert getattr(package, name).__doc__, name
        with pytest.raises(AttributeError):
            package.no_such_name  # noqa: B018
