"""Who may ask the explorer: pages of this machine, by one of its own names.

Any page that you look at may send requests to this machine too. Two headers tell which page asks, and no script can
write them: ``Host`` is the name under which the server was asked for (a foreign name that was made to point here, DNS
rebinding, stays in it), ``Origin`` the page that asks (websockets know no other fence). Sources: RFC 9110, section 7.2;
RFC 6454, section 7.
"""

import re
from collections.abc import Awaitable, Callable, Iterable, MutableMapping
from typing import Any

Scope = MutableMapping[str, Any]
Program = Callable[[Scope, Callable[[], Awaitable[Any]], Callable[[Any], Awaitable[None]]], Awaitable[None]]
"""An ASGI program."""

OWN_HOST = re.compile(r"(localhost|127\.0\.0\.1|\[::1\])(:\d+)?", re.ASCII)
"""This machine as it calls itself, and any port: a tunnel may lead here from another one."""


def guarded(program: Program) -> Program:
    """Return the program behind a guard: a request by a foreign name gets 421, a foreign page 403.

    A websocket is refused before it opens, with 403 by ASGI's rule.
    """

    async def guard(scope: Scope, receive: Callable[[], Awaitable[Any]], send: Callable[[Any], Awaitable[None]]):
        status = refusal(scope.get("headers", ()))
        if status is None or scope["type"] == "lifespan":
            await program(scope, receive, send)
        elif scope["type"] == "websocket":
            await send({"type": "websocket.close", "code": 1008})
        else:
            headers = [(b"content-type", b"text/plain; charset=utf-8"), (b"connection", b"close")]
            await send({"type": "http.response.start", "status": status, "headers": headers})
            await send({"type": "http.response.body", "body": b"The explorer answers pages of its own machine only.\n"})

    return guard


def refusal(headers: Iterable[tuple[bytes, bytes]]) -> int | None:
    """Return the HTTP status that refuses a request, or None: it comes from a page of this machine.

    ``Origin``, where there is one, must be the very host, its port included.

    Examples
    --------
    >>> from specklegen.explorer.guard import refusal
    >>> refusal([(b"host", b"localhost:2718"), (b"origin", b"http://localhost:2718")])
    >>> refusal([(b"host", b"rebound.example:2718")])
    421
    >>> refusal([(b"host", b"localhost:2718"), (b"origin", b"http://elsewhere.example")])
    403
    """
    decoded = [(name.lower(), value.decode("latin-1").strip().lower()) for name, value in headers]
    hosts, origins = ([value for name, value in decoded if name == each] for each in (b"host", b"origin"))
    if len(hosts) != 1 or OWN_HOST.fullmatch(hosts[0]) is None:
        return 421
    return None if all(origin in (f"http://{hosts[0]}", f"https://{hosts[0]}") for origin in origins) else 403
