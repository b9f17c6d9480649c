"""Refuse a release whose papers are not filled in: authors, addresses, install lines, versions, pinned actions.

    python packaging/check_release.py [FOLDER]

What only the owners of the project can know stands as a placeholder until they fill it in; the release workflow runs
this first and stops on a line of it. Needs nothing but Python.
"""

import json
import re
import sys
import tomllib
from pathlib import Path

PLACEHOLDER = re.compile(r"example\.(org|com|net)|\bTODO\b|^$", re.IGNORECASE)
"""Addresses that nobody has (RFC 2606), words that wait, and nothing at all."""
URLS = ("Homepage", "Documentation", "Source", "Issues", "Changelog")
"""Addresses that a release shows."""
COLAB = re.compile(r"https://colab\.research\.google\.com/github/[\w.-]+/[\w.-]+/blob/gh-pages")
"""Where Colab finds the site, below which the gallery's notebooks lie: a branch at GitHub (:mod:`publish_site`)."""


def findings(root: Path) -> list[str]:
    """What keeps a tree from being released, a line each."""
    project = tomllib.loads((root / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    citation = (root / "CITATION.cff").read_text(encoding="utf-8")
    zenodo = json.loads((root / ".zenodo.json").read_text(encoding="utf-8"))
    found = []
    authors = [each.get("name", "") for each in project.get("authors", [])] or [""]
    creators = [each.get("name", "") for each in zenodo.get("creators", [])] or [""]
    cited = re.findall(r"^  - (?:name|family-names): (.*)$", citation.partition("references:")[0], re.MULTILINE) or [""]
    for file, names in (("pyproject.toml authors", authors), (".zenodo.json creators", creators),
                        ("CITATION.cff authors", cited)):  # fmt: skip
        found += [f"{file} must be people; got {name!r}" for name in names if PLACEHOLDER.search(name.strip())]
    urls = project.get("urls", {})
    for name in URLS:
        if PLACEHOLDER.search(urls.get(name, "")):
            found.append(f"pyproject.toml urls.{name} must be an address of the project; got {urls.get(name, '')!r}")
    if not COLAB.fullmatch(urls.get("Notebooks", "")):
        found.append(f"pyproject.toml urls.Notebooks must be {COLAB.pattern}; got {urls.get('Notebooks', '')!r}")
    for page in ("README.md", "docs/index.md"):
        if f"pip install {project['name']}" not in (root / page).read_text(encoding="utf-8"):
            found.append(f"{page} must install the release, by `pip install {project['name']}`; got a checkout's line")
    version = project["version"]
    for file, said in (("CITATION.cff", re.search(r"^version: (.*)$", citation, re.MULTILINE)),
                       ("CHANGELOG.md", re.search(r"^## (\S+)$", (root / "CHANGELOG.md").read_text(encoding="utf-8"),
                                                  re.MULTILINE))):  # fmt: skip
        if said is None or said[1] != version:
            found.append(f"{file} must be of version {version}, and released; got {said[1] if said else None!r}")
    for workflow in sorted((root / ".github/workflows").glob("*.yml")):
        for action in re.findall(r"uses: (\S+)", workflow.read_text(encoding="utf-8")):
            if not re.search(r"@[0-9a-f]{40}$", action):
                found.append(f"{workflow.name} uses must be pinned to a commit; got {action!r}")
    return found


if __name__ == "__main__":
    wrong = findings(Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).resolve().parents[1])
    print("\n".join(wrong) or "ready")
    raise SystemExit(bool(wrong))
