"""The guard: which pages may ask. Served for true, with raw requests, in test_page.py."""

import asyncio

import pytest

from specklegen.explorer.guard import guarded, refusal

OWN = ("localhost", "127.0.0.1:2718", "[::1]:80", "LOCALHOST:8000")
FOREIGN = (
    "", "rebound.example", "rebound.example:2718", "127.0.0.1.rebound.example", "127.0.0.1@rebound.example",
    "127.0.0.2", "0.0.0.0:2718", "localhost:port", "localhost:2718/", "::1", "[::1", "localhost.", "localhost:٣",
)  # fmt: skip


def headers(*hosts, origins=()):
    """Headers as a server hands them on."""
    said = [("Host", host) for host in hosts] + [("Origin", origin) for origin in origins]
    return [(name.lower().encode(), value.encode()) for name, value in said]


def asked(scope):
    """What the guard and a program behind it answer: messages, and whether the program was reached."""
    reached, sent = [], []

    async def program(scope, receive, send):
        reached.append(scope["type"])

    async def send(message):
        sent.append(message)

    asyncio.run(guarded(program)(scope, None, send))  # pyright: ignore[reportArgumentType] - nothing is received
    return sent, bool(reached)


@pytest.mark.parametrize("host", OWN)
def test_own_names_and_own_pages_are_answered(host):
    for origins in ((), (f"http://{host}",), (f"https://{host.lower()}",)):
        assert refusal(headers(host, origins=origins)) is None


@pytest.mark.parametrize("host", FOREIGN)
def test_foreign_names_are_refused(host):
    assert refusal(headers(host)) == refusal(headers(host, origins=[f"http://{host}"])) == 421


def test_one_name_it_must_be():
    for hosts in ((), ("localhost", "localhost"), ("localhost", "rebound.example")):
        assert refusal(headers(*hosts)) == 421


@pytest.mark.parametrize("origin", ["http://elsewhere.example", "null", "", "http://localhost", "http://localhost:2719",
                                    "http://127.0.0.1:2718", "http://localhost:2718.elsewhere.example", "file://",
                                    "ws://localhost:2718"])  # fmt: skip
def test_foreign_pages_are_refused(origin):
    assert refusal(headers("localhost:2718", origins=[origin])) == 403
    assert refusal(headers("localhost:2718", origins=["http://localhost:2718", origin])) == 403


def test_what_is_refused_does_not_reach_the_page():
    for kind, host, status in (("http", "a.example", 421), ("websocket", "a.example", None)):
        (first, *rest), reached = asked({"type": kind, "headers": headers(host)})
        assert not reached
        assert first.get("status") == status
        assert [first["type"], *(each["type"] for each in rest)] == (
            ["http.response.start", "http.response.body"] if kind == "http" else ["websocket.close"]
        )
    for scope in ({"type": "lifespan"}, {"type": "http", "headers": headers("localhost")}):
        assert asked(scope) == ([], True)
