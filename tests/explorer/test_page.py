"""The page itself: its cells run, and in a headless browser sliders move, buttons answer, nobody else is asked.

The browser is slow: ``pytest -m slow tests/explorer``. Without marimo or a Chromium the tests are skipped.
"""

import base64
import re
import socket
import subprocess
import sys
import time
from urllib.request import urlopen

import numpy as np
import pytest
from browser import CHROMIUM, tab

from specklegen.datasets import load_recipe
from specklegen.explorer import controls, drawing, recipe
from specklegen.explorer.controls import CONTROLS, State, address_of

pytest.importorskip("marimo", reason="needs the extra explore")


def test_the_cells_run_and_show_where_the_sliders_begin():
    from specklegen.explorer.app import app

    outputs, names = app.run()
    assert names["state"] == State()
    text = "".join(each.text for each in outputs if hasattr(each, "text"))
    for name in controls.shown(State()):
        assert CONTROLS[name].label in text
    assert "Speckle under tilt" in text


@pytest.fixture(scope="module")
def address():
    """Where the explorer is served, by its command."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    words = [sys.executable, "-m", "specklegen", "explore", "--no-browser", "--port", str(port)]
    with subprocess.Popen(words, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as process:
        end = time.monotonic() + 300
        while True:
            try:
                urlopen(f"http://127.0.0.1:{port}/").close()
                break
            except OSError:
                assert process.poll() is None
                assert time.monotonic() < end
                time.sleep(0.5)
        yield f"http://127.0.0.1:{port}/"
        process.terminate()
        process.wait(60)
        with pytest.raises(OSError):  # what was ended serves no longer
            urlopen(f"http://127.0.0.1:{port}/")


def answered(address, host, origin=None, websocket=False):
    """Status line that a raw request is answered with; a websocket's is its handshake."""
    _, _, port = address.strip("/").rpartition(":")
    lines = [f"GET {'/ws?session_id=s_guard1' if websocket else '/'} HTTP/1.1", f"Host: {host}"]
    lines += [f"Origin: {origin}"] if origin else []
    key = "Sec-WebSocket-Key: MDEyMzQ1Njc4OTAxMjM0NQ=="
    lines += ["Upgrade: websocket", "Connection: Upgrade", "Sec-WebSocket-Version: 13", key] if websocket else []
    with socket.create_connection(("127.0.0.1", int(port)), timeout=120) as line:
        line.sendall("\r\n".join([*lines, "", ""]).encode())
        return int(line.recv(64).split()[1])


def test_the_page_of_another_site_is_not_answered(address):
    """Neither by a foreign name that was made to point here, nor with a foreign page's origin, HTTP or websocket."""
    own = address.removeprefix("http://").strip("/")
    port = own.rpartition(":")[2]
    for host in (own, f"localhost:{port}", "[::1]"):
        assert answered(address, host) == 200
        assert answered(address, host, f"http://{host}") == 200
    assert answered(address, own, f"http://{own}", websocket=True) == 101
    for host in ("rebound.example", f"rebound.example:{port}", f"127.0.0.1.rebound.example:{port}"):
        assert answered(address, host) == answered(address, host, f"http://{host}") == 421
        assert answered(address, host, f"http://{host}", websocket=True) == 403
    for origin in ("http://elsewhere.example", "null", f"http://127.0.0.1:{int(port) + 1}"):
        assert answered(address, own, origin) == answered(address, own, origin, websocket=True) == 403


SHOWN = "all(document).filter(e => e.tagName == 'IMG' && e.alt == '{}').map(e => e.src)[0] || ''"
TEXT = "all(document).filter(e => e.tagName == 'PRE').map(e => e.textContent)[0] || ''"


def shown(page, name="camera image"):
    """Bytes of a picture of the page."""
    return base64.b64decode(page.value(SHOWN.format(name)).partition(",")[2])


def settle(page, state):
    """Wait until the page shows a state: its recipe stands there, and every panel is of it."""
    text = recipe.toml(state).strip()
    end = time.monotonic() + 300
    while page.value(TEXT).strip() != text:
        assert time.monotonic() < end, page.value(TEXT)
        time.sleep(0.5)


@pytest.mark.slow
@pytest.mark.skipif(CHROMIUM is None, reason="there is no Chromium here")
def test_sliders_move_and_what_is_taken_along_renders_what_is_shown(address, tmp_path):
    pytest.importorskip("websockets", reason="needs websockets, which come with marimo")
    begun = State(camera=64, thickness=700.0)
    with tab(tmp_path / "profile") as page:
        page.size(1280, 1000)
        page.ask("Page.navigate", url=f"{address}?" + "&".join(f"{k}={v}" for k, v in address_of(begun).items()))
        page.wait(f"({SHOWN.format('phase retrieval')}).length > 0", 300)
        settle(page, begun)  # the address holds the state
        assert shown(page) == drawing.png(_rendered(begun)["image"])

        numbers = [name for name in controls.shown(begun) if not isinstance(CONTROLS[name].steps[0], str)]
        for name, key in (("thickness", "ArrowRight"), ("extent", "ArrowLeft"), ("photons", "ArrowRight")):
            page.value(f"all(document).filter(e => e.getAttribute('role') == 'slider')[{numbers.index(name)}].focus()")
            page.key(key)
            steps = CONTROLS[name].steps
            step = steps[steps.index(getattr(begun, name)) + (1 if key == "ArrowRight" else -1)]
            begun = begun.replace(**{name: step})
            settle(page, begun)
        assert begun == State(camera=64, thickness=1000.0, extent=0.07, photons=3.0)
        assert dict(re.findall(r"(\w+)=([\w.]+)", page.value("location.search"))) == address_of(begun)

        # What the button hands out is a file that renders what stands on the page.
        link = page.wait("all(document).filter(e => e.download == 'explored.toml').map(e => e.href)[0] || ''")
        taken = page.value(f"fetch({link!r}).then(answer => answer.text())")
        (tmp_path / "explored.toml").write_text(taken)
        image = load_recipe(tmp_path / "explored.toml").sample(recipe.SEED, recipe.SPLIT, 0)["image"]
        page.wait(f"({SHOWN.format('camera image')}).length > 0")
        assert shown(page) == drawing.png(image)
        link = page.wait("all(document).filter(e => e.download == 'explored.py').map(e => e.href)[0] || ''")
        made = {}
        exec(page.value(f"fetch({link!r}).then(answer => answer.text())"), made)  # noqa: S102 - our own text
        np.testing.assert_array_equal(made["sample"]["image"], image)

        page.value("all(document).filter(e => e.tagName == 'BUTTON' && e.textContent == 'Sixteen samples')[0].click()")
        page.wait(f"({SHOWN.format('sixteen camera images')}).length > 0", 300)
        link = page.wait("all(document).filter(e => e.download == 'sixteen.npz').map(e => e.href)[0] || ''")
        begins = "a => btoa(String.fromCharCode(...new Uint8Array(a).slice(0, 4)))"
        script = f"fetch({link!r}).then(answer => answer.arrayBuffer()).then({begins})"
        assert base64.b64decode(page.value(script)) == b"PK\x03\x04"
        for width in (1280, 390):
            page.size(width, 900)
            assert page.value("document.documentElement.scrollWidth <= window.innerWidth")
        assert page.hosts == {"127.0.0.1"}
        assert page.complaints == []


def _rendered(state):
    return recipe.recipe_of(state).sample(recipe.SEED, recipe.SPLIT, state.sample)
