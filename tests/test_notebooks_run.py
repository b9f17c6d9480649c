"""Notebooks of the gallery run, as they are made for the site: every cell but the one that installs the release.

    pytest -m slow tests/test_notebooks_run.py

Cells are read off the notebook, so what its making loses of a script is an error here. All of them take some ten
processor minutes.
"""

import json
import os
import subprocess
import sys

import pytest
from scenes import ROOT

sys.path.append(str(ROOT / "docs"))
import gallery_notebooks as notebooks

SCRIPTS = notebooks.scripts()


def cells(name: str) -> list[dict]:
    """Cells of a script's notebook, the first of which installs the release."""
    pytest.importorskip("sphinx_gallery", reason="needs the extra docs")
    from sphinx_gallery.gen_gallery import DEFAULT_GALLERY_CONF
    from sphinx_gallery.notebook import jupyter_notebook
    from sphinx_gallery.py_source_parser import split_code_and_text_blocks

    _, blocks = split_code_and_text_blocks(str(next((ROOT / "docs/gallery").glob(f"*/{name}.py"))))
    made = jupyter_notebook(blocks, DEFAULT_GALLERY_CONF, str(ROOT / "docs/gallery"))
    return notebooks.with_install(json.loads(json.dumps(made)), SCRIPTS[name], "1.0")["cells"]


@pytest.mark.slow
@pytest.mark.parametrize("name", SCRIPTS)
def test_a_notebook_runs(name, tmp_path):
    first, *others = cells(name)
    assert first["source"][0].startswith("%pip install")
    code = ["".join(cell["source"]) for cell in others if cell["cell_type"] == "code"]
    assert code
    assert not any(line.startswith(("%", "!")) for each in code for line in each.splitlines())
    (tmp_path / "cells.py").write_text("\n\n".join(code), encoding="utf-8")
    done = subprocess.run([sys.executable, "cells.py"], cwd=tmp_path, env=os.environ | {"MPLBACKEND": "agg"},
                          capture_output=True, text=True, timeout=1800)  # fmt: skip
    assert done.returncode == 0, done.stderr[-4000:]
