"""Sphinx: the pages of this folder, the API from docstrings, and a gallery of scripts that run."""

import importlib
import inspect
import os
import re
import shutil
import sys
from pathlib import Path

DOCS = Path(__file__).resolve().parent
ROOT = DOCS.parent
sys.path[:0] = [str(ROOT), str(DOCS)]

import gallery_notebooks  # noqa: E402

import specklegen  # noqa: E402
from specklegen import SUBJECTS  # noqa: E402

project = "specklegen"
copyright = "the specklegen developers"  # noqa: A001
version = release = specklegen.__version__

extensions = [
    "myst_parser",
    "sphinx.ext.autodoc",
    "sphinx.ext.autosummary",
    "sphinx.ext.napoleon",
    "sphinx.ext.viewcode",
    "sphinx_copybutton",
    "sphinx_gallery.gen_gallery",
    "sphinxcontrib.bibtex",
    "gallery_notebooks",
]
root_doc = "index"
exclude_patterns = ["_build", "gallery/**"]
templates_path = ["_templates"]
html_static_path = ["_static"]
html_css_files = ["site.css"]

html_theme = "pydata_sphinx_theme"
html_title = f"specklegen {release}"
html_theme_options = {
    "logo": {"text": "specklegen"},
    "navigation_with_keys": False,
    "show_prev_next": False,
    "header_links_before_dropdown": 4,
    "navbar_end": ["theme-switcher"],
}
html_context = {"default_mode": "auto"}
html_favicon = "_static/icon.svg"
html_show_sourcelink = False
_ALONE = ("*", "project/readme", "project/security")
html_sidebars = {page: [] for page in _ALONE}  # a page without children has nothing to list beside it

myst_enable_extensions = ["colon_fence", "deflist"]
myst_heading_anchors = 3
suppress_warnings = [
    "misc.highlighting_failure",  # output of programs in blocks without a language
    "ref.python",  # types in docstrings are words, such as field, and several attributes may have that name
]

autosummary_generate = True
autodoc_default_options = {"members": True, "show-inheritance": False}
autodoc_typehints = "none"
napoleon_google_docstring = False
napoleon_use_ivar = True  # attributes that a docstring lists are not described once more as members

bibtex_bibfiles = ["references.bib"]
bibtex_default_style = "alpha"

sphinx_gallery_conf = {
    "examples_dirs": str(DOCS / "gallery"),
    "gallery_dirs": "auto_gallery",
    "filename_pattern": gallery_notebooks.run_pattern(),
    "subsection_order": ["gallery/train", "gallery/setup", "gallery/physics"],
    "within_subsection_order": "FileNameSortKey",
    "reset_modules": ("matplotlib", "gallery_notebooks.narrow_figures"),
    "download_all_examples": False,
    "remove_config_comments": True,
    "min_reported_time": 1e9,
    "show_memory": False,
    "write_computation_times": False,
    "abort_on_example_error": True,
    "copyfile_regex": "",
    "capture_repr": ("_repr_html_",),  # pictures and tables of results; the text of an Axes says nothing
}
linkcheck_timeout = 20

os.environ.setdefault("OMP_NUM_THREADS", "1")

_OUTSIDE = ("README.md", "CHANGELOG.md", "CONTRIBUTING.md", "SECURITY.md", "LICENSE")
"""Files of the repository's root that are pages of the site too, in the folder project/."""
_SECTIONS = {"CHANGELOG.md": "###", "CONTRIBUTING.md": "##"}
"""Long files, and the marks of the headings whose sections are pages of their own on the site."""


PACKAGES = ("", *(f".{name}" for name in SUBJECTS), ".datasets", ".models", ".instrument", ".measured",
            ".wavetracing", ".fdtd")
"""Packages whose names are public; all of ``specklegen.materials`` is on the page of that name."""


def write_pages(app, config) -> None:
    """Copy the pages of the root into the site, with links as they are from there, and list every public name."""
    folder = DOCS / "project"
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir()
    for name in _OUTSIDE[:-1]:
        text = (ROOT / name).read_text(encoding="utf-8").replace("](docs/", "](../")
        for page, content in pages_of(name, _among_pages(text, "")).items():
            (folder / page).write_text(content, encoding="utf-8")
    (folder / "reference.rst").write_text(reference(), encoding="utf-8")


def pages_of(name: str, text: str) -> dict[str, str]:
    """Return the pages of a file by their names: one, or a list of its sections and a page for each."""
    if name not in _SECTIONS:
        return {name.lower(): text}
    first, above, pages = "", "", {}
    for part in re.split(r"^(?=#+ )", text, flags=re.MULTILINE)[1:]:
        heading, _, body = part.partition("\n")
        mark, title = heading.split(" ", 1)
        if mark == _SECTIONS[name]:
            page = re.sub(r"\W+", "-", f"{above} {title}".lower())
            pages[f"{page}.md"] = f"# {above}: {title}\n{body}"
            first += f"- [{title}]({page}.md)\n"
        else:
            first, above = first + part, title.split()[0]
    names = "\n".join(page.removesuffix(".md") for page in pages)
    return {name.lower(): f"{first}\n:::{{toctree}}\n:hidden:\n{names}\n:::\n", **pages}


def reference() -> str:
    """Page of every public name, package by package."""
    text, told = "Every public name\n=================\n", set()
    for package in (f"specklegen{name}" for name in PACKAGES):
        module = importlib.import_module(package)
        own = [name for name in sorted(module.__all__)
               if (name, id(getattr(module, name))) not in told
               and (name == "materials" or not inspect.ismodule(getattr(module, name)))]
        told |= {(name, id(getattr(module, name))) for name in own}  # what two packages hand out has one page
        names = "\n".join(f"   {name}" for name in own)
        text += f"\n{package}\n{'-' * len(package)}\n\n.. currentmodule:: {package}\n"
        text += f".. autosummary::\n   :toctree: ../generated\n\n{names}\n"
    return text


def rewrite_links(app, page: str, source: list[str]) -> None:
    """A link to a page of the root leads to its copy; one named by a file is named by the title of that page."""
    text = _among_pages(source[0].replace("](../", "]("), "project/") if "/" not in page else source[0]
    source[0] = re.sub(r"\[(?:docs/)?[A-Za-z]+\.md\]\(", "[](", text)


def _among_pages(text: str, folder: str) -> str:
    names = "|".join(re.escape(name) for name in _OUTSIDE[:-1])
    return re.sub(rf"\]\(({names})\)", lambda match: f"]({folder}{match[1].lower()})", text)


_MARKUP = re.compile(r"(``[^`]*``|:[\w:]+:`[^`]*`|`[^`]*`_*)")


def escape_formulas(app, what, name, thing, options, lines: list[str]) -> None:
    """Docstrings are prose and formulas: |K|^2, u*, exit_ are no markup. Examples stay as they are."""
    example = False
    for n, line in enumerate(lines):
        example = line.lstrip().startswith(">>>") or (example and bool(line.strip()))
        if example:
            continue
        parts = _MARKUP.split(line)
        parts[::2] = [re.sub(r"([|*]|(?<=\w)_(?!\w))", r"\\\1", part) for part in parts[::2]]
        lines[n] = "".join(parts)


def setup(app) -> None:
    """Connect the functions above."""
    app.connect("config-inited", write_pages)  # before Sphinx looks for pages, among which autosummary looks for names
    app.connect("source-read", rewrite_links)
    app.connect("autodoc-process-docstring", escape_formulas, priority=100)
