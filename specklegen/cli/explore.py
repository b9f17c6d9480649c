"""The command ``specklegen explore``: sliders for slab, object and camera in a browser."""

import os
import sys
from importlib.util import find_spec
from pathlib import Path
from typing import Annotated

import typer

from specklegen.core.errors import ToldError


def explore(
    port: Annotated[int | None, typer.Option(min=1, max=65535, help="Where to serve (default: a free port).")] = None,
    browser: Annotated[bool, typer.Option(help="Open it in the browser.")] = True,
) -> None:
    """Explore slabs, objects and cameras with sliders, in a browser on this machine; Ctrl-C ends it."""
    if find_spec("marimo") is None:
        raise ToldError("specklegen explore needs the package marimo: pip install 'specklegen-torch[explore]'")
    from specklegen import explorer

    (file,) = (Path(folder) / "app.py" for folder in explorer.__path__)
    words = [
        sys.executable, "-m", "marimo", "--yes", "run", str(file), "--host", "127.0.0.1", "--no-token", "--no-sandbox",
        *(["--port", str(port)] if port else []), *([] if browser else ["--headless"]),
    ]  # fmt: skip
    # Nothing is asked of other machines, be it only whether there is a newer marimo.
    quiet = os.environ | {"MARIMO_SKIP_UPDATE_CHECK": "1", "DO_NOT_TRACK": "1"}
    os.execve(sys.executable, words, quiet)  # in the place of this process: what ends it ends the server
