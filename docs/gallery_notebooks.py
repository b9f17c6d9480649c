"""Notebooks of the gallery's scripts, made when the site is built: each installs the release first, and runs in Colab.

Sphinx-Gallery turns a script into a notebook. Here it gets a first cell that installs what the script imports, a place
that does not change, and a line at the head of its page: a badge that opens it in Colab, where the project has an
address there (urls.Notebooks of pyproject.toml, without which there is no release), and the notebook itself. A script
whose packages are not there is shown and not run, and its page says so.
"""

import ast
import json
import re
import tomllib
from importlib.util import find_spec
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
FOLDER = "notebooks"
"""Folder of the site in which notebooks lie."""
EXTRAS = {
    "skimage": "photographs", "Photographs": "photographs", "Silhouettes": "photographs", "sklearn": "digits",
    "Digits": "digits", "miepython": "mie", "Mie": "mie", "pyarrow": "parquet", "lightning": "lightning",
    "deepinv": "deepinv", "trimesh": "mesh", "xarray": "xarray", "h5py": "hdf5",
}  # fmt: skip
"""What a script imports, or names of the package, to the extra that brings what it needs."""
OPTIONAL = ("lightning", "deepinv")
"""Packages without which a page is shown and not run: those that no other page or test needs."""


def imports(script: str) -> set[str]:
    """Packages that a script imports."""
    found = set()
    for node in ast.walk(ast.parse(script)):
        if isinstance(node, ast.Import):
            found |= {each.name.partition(".")[0] for each in node.names}
        elif isinstance(node, ast.ImportFrom):
            found.add(str(node.module).partition(".")[0])
    return found


def words(script: str) -> set[str]:
    """Packages that a script imports, names and texts in it."""
    found = imports(script)
    for node in ast.walk(ast.parse(script)):
        if isinstance(node, ast.Name | ast.Attribute):
            found.add(node.id if isinstance(node, ast.Name) else node.attr)
        elif isinstance(node, ast.Constant) and isinstance(node.value, str):
            found.add(node.value)
    return found


def extras(script: str) -> list[str]:
    """Extras that a script needs, in the order of the alphabet."""
    return sorted({"torch"} | {EXTRAS[word] for word in words(script) & EXTRAS.keys()})


def missing(script: str) -> list[str]:
    """Packages that a script needs and that are not here."""
    return [name for name in OPTIONAL if name in imports(script) and find_spec(name) is None]


def with_install(notebook: dict, script: str, version: str) -> dict:
    """A notebook whose first cell installs the release with what the script needs."""
    install = f'%pip install --quiet "specklegen-torch[{",".join(extras(script))}]=={version}"'
    cell = {"cell_type": "code", "execution_count": None, "metadata": {}, "outputs": [], "source": [install]}
    return notebook | {"cells": [cell, *notebook["cells"]]}


def colab() -> str | None:
    """Address at which Colab finds the site, by those of the package; None while it is nobody's."""
    urls = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]["urls"]
    return urls["Notebooks"] if urls["Notebooks"].startswith("https://colab.research.google.com/github/") else None


def head(name: str, script: str, address: str | None) -> str:
    """What stands below the title of a script's page, as reStructuredText."""
    opened = (
        f'<a class="sg-badge" href="{address}/{FOLDER}/{name}.ipynb">Open in Colab</a> · ' if address else ""
    )  # fmt: skip
    told = f'{opened}<a href="../../{FOLDER}/{name}.ipynb" download>Notebook</a>, which installs what it needs'
    lines = [".. raw:: html", "", f'   <p class="sg-notebook">{told}</p>', ""]
    lost = missing(script)
    if lost:
        lines += [
            ".. note::", "",
            f"   Not run when this site was built: {', '.join(lost)} was not there. "
            f"``pip install \"specklegen-torch[{','.join(extras(script))}]\"`` brings it.", "",
        ]  # fmt: skip
    return "\n".join(lines)


def scripts() -> dict[str, str]:
    """Scripts of the gallery by their names."""
    return {path.stem: path.read_text(encoding="utf-8") for path in sorted((ROOT / "docs/gallery").glob("*/plot_*.py"))}


def run_pattern() -> str:
    """Pattern of the scripts that are run here, for Sphinx-Gallery."""
    kept = "|".join(name for name, script in scripts().items() if not missing(script))
    return rf"(?:{kept})\.py$"


def insert_head(app, page: str, source: list[str]) -> None:
    """Put the head of a script's page below its title."""
    folder, _, name = page.rpartition("/")
    if folder.startswith("auto_gallery/") and name in scripts():
        source[0] = re.sub(
            r"(?m)^(=+)$", lambda rule: f"{rule[1]}\n\n{head(name, scripts()[name], colab())}", source[0], count=1
        )


def write_notebooks(app, error) -> None:
    """Put the notebooks into the site."""
    if error is not None or app.builder.name != "html":
        return
    folder = Path(app.outdir) / FOLDER
    folder.mkdir(exist_ok=True)
    for made in (Path(app.srcdir) / "auto_gallery").glob("*/plot_*.ipynb"):
        notebook = json.loads(made.read_text(encoding="utf-8"))
        whole = with_install(notebook, scripts()[made.stem], app.config.release)
        (folder / made.name).write_text(json.dumps(whole, indent=1), encoding="utf-8")


def narrow_figures(conf: dict, script: str) -> None:
    """Draw figures so narrow that their text is legible on a telephone; called before each script of the gallery."""
    from matplotlib import rcParams

    rcParams.update({"figure.figsize": (4.4, 3.4), "figure.dpi": 120, "axes.titlesize": 10, "legend.fontsize": 8.5})


def setup(app) -> None:
    """Connect the functions above."""
    app.connect("source-read", insert_head)
    app.connect("build-finished", write_notebooks)
