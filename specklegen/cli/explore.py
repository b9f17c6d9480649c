"""The command ``specklegen explore``: sliders for slab, object and camera in a browser."""

import threading
import webbrowser
from importlib.util import find_spec

import typer

from specklegen.cli.settings import option
from specklegen.core.errors import ToldError


def explore(
    port: int | None = option(None, "Port of the local server (default: 2718, or a free port).", min=1, max=65535),
    browser: bool = option(True, "Open the explorer in the browser."),
) -> None:
    """Explore slabs, objects and cameras with sliders, in a browser on this machine; Ctrl-C ends it."""
    if find_spec("marimo") is None:
        raise ToldError("specklegen explore needs the package marimo: pip install 'specklegen-torch[explore]'")
    from specklegen.explorer import server

    with server.listening(port) as ear:
        address = f"http://127.0.0.1:{ear.getsockname()[1]}/"
        typer.echo(f"The explorer is at {address}; Ctrl-C ends it.")
        if browser:  # it waits at the open port until somebody answers
            threading.Thread(target=webbrowser.open, args=[address], daemon=True).start()
        server.serve(ear)
