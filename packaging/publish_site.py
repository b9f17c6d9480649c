"""Put a built site onto the branch gh-pages of a repository, as its one commit: pages and notebooks are made, not kept.

    python packaging/publish_site.py build/site REMOTE

Needs Python and git alone.
"""

import subprocess
import sys
import tempfile
from pathlib import Path

BRANCH = "gh-pages"
NOBODY = ["-c", "user.name=release", "-c", "user.email=release@localhost"]


def publish(site: Path, remote: str) -> None:
    """Push every file of a site, in place of all that the branch had.

    Raises
    ------
    SystemExit
        If the folder is no site.
    """
    for needed in ("index.html", "notebooks"):
        if not (site / needed).exists():
            raise SystemExit(f"site must be a folder that `make docs` made; got {site}, without {needed}")
    (site / ".nojekyll").touch()  # else GitHub leaves out folders whose names begin with _
    with tempfile.TemporaryDirectory() as folder:
        git = ["git", f"--git-dir={folder}/.git", f"--work-tree={site}"]
        for words in (["init", "--quiet", f"--initial-branch={BRANCH}"], ["add", "--all", "--force", "."],
                      [*NOBODY, "commit", "--quiet", "--message", "Site"],
                      ["push", "--quiet", "--force", remote, BRANCH]):  # fmt: skip
            subprocess.run([*git, *words], check=True, cwd=site)


if __name__ == "__main__":
    publish(Path(sys.argv[1]).resolve(), sys.argv[2])
