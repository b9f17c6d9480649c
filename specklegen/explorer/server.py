"""The server of the explorer: the page as marimo runs it, behind the guard, on this machine alone."""

import os
import socket
from pathlib import Path

from specklegen.core.errors import ToldError
from specklegen.explorer.guard import guarded

USUAL = 2718
"""The port where a link of yesterday finds the page today, unless somebody else has it."""


def listening(port: int | None = None) -> socket.socket:
    """Return a socket of 127.0.0.1 where browsers may begin to wait: at a port, or at the usual one or any free one."""
    try:
        return socket.create_server(("127.0.0.1", port or USUAL))
    except OSError as error:
        if port:
            raise ToldError(f"port must be free; got {port}: {error.strerror}. Leave the option out for "
                            "a free port.") from error
    return socket.create_server(("127.0.0.1", 0))


def serve(ear: socket.socket) -> None:
    """Serve the explorer at a listening socket until the process is interrupted."""
    # Nothing is asked of other machines, be it only whether there is a newer marimo.
    os.environ |= {"MARIMO_SKIP_UPDATE_CHECK": "1", "DO_NOT_TRACK": "1"}
    import marimo  # pyright: ignore[reportMissingImports] - of the extra explore
    import uvicorn  # pyright: ignore[reportMissingImports] - comes with marimo

    file = Path(__file__).with_name("app.py")
    program = marimo.create_asgi_app(quiet=True).with_app(path="/", root=str(file)).build()
    config = uvicorn.Config(guarded(program), log_level="error", ws_ping_interval=1, ws_ping_timeout=60,
                            timeout_keep_alive=300, timeout_graceful_shutdown=1)  # fmt: skip
    uvicorn.Server(config).run(sockets=[ear])
