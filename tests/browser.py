"""A headless Chromium that a test drives through its debugging port: pages, keys, and what was asked of whom."""

import base64
import contextlib
import json
import shutil
import subprocess
import time
from pathlib import Path
from urllib.parse import urlsplit
from urllib.request import urlopen

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
QUIET = ["--headless", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run", "--disable-sync",
         "--disable-background-networking", "--disable-component-update"]  # fmt: skip
PIERCING = """
const all = (root, found = []) => {
  for (const each of root.querySelectorAll('*')) { found.push(each); if (each.shadowRoot) all(each.shadowRoot, found); }
  return found;
};
"""
"""JavaScript: every element of a page, those inside shadow roots too."""


class Tab:
    """One page of the browser."""

    def __init__(self, socket) -> None:
        self.socket, self.number = socket, 0
        self.hosts: set[str] = set()
        self.complaints: list[str] = []
        for domain in ("Page", "Runtime", "Network", "Log"):
            self.ask(f"{domain}.enable")

    def ask(self, method: str, timeout: float = 120, **words):
        """Call a method of the debugging protocol; events that come meanwhile are noted."""
        self.number += 1
        self.socket.send(json.dumps({"id": self.number, "method": method, "params": words}))
        while True:
            said = json.loads(self.socket.recv(timeout=timeout))
            if said.get("id") == self.number:
                assert "error" not in said, said
                return said["result"]
            self._note(said)

    def _note(self, event: dict) -> None:
        told = event.get("params", {})
        if event.get("method") in ("Network.requestWillBeSent", "Network.webSocketCreated"):
            address = urlsplit(told["url"] if "url" in told else told["request"]["url"])
            if address.scheme in ("http", "https", "ws", "wss"):
                self.hosts.add(address.hostname or "")
        if event.get("method") == "Runtime.exceptionThrown":
            self.complaints.append(str(told["exceptionDetails"]))
        if event.get("method") == "Log.entryAdded" and told["entry"]["level"] == "error":
            self.complaints.append(f"{told['entry']['text']} {told['entry'].get('url', '')}")

    def value(self, script: str):
        """Value of a JavaScript expression; ``all(document)`` is every element."""
        found = self.ask("Runtime.evaluate", expression=f"(() => {{ {PIERCING} return {script}; }})()",
                         returnByValue=True, awaitPromise=True)  # fmt: skip
        assert "exceptionDetails" not in found, found
        return found["result"].get("value")

    def wait(self, script: str, seconds: float = 240):
        """Wait until an expression is truthy, and return it."""
        end = time.monotonic() + seconds
        while not (found := self.value(script)):
            assert time.monotonic() < end, f"not in {seconds} s: {script}"
            time.sleep(0.25)
        return found

    def key(self, name: str) -> None:
        """Press and release a key."""
        for kind in ("keyDown", "keyUp"):
            self.ask("Input.dispatchKeyEvent", type=kind, key=name, code=name,
                     windowsVirtualKeyCode={"ArrowRight": 39, "ArrowLeft": 37}.get(name, 0))  # fmt: skip

    def size(self, width: int, height: int) -> None:
        """Show the page so many pixels wide and high."""
        self.ask("Emulation.setDeviceMetricsOverride", width=width, height=height, deviceScaleFactor=1, mobile=False)

    def picture(self, file: Path) -> None:
        """Save what is shown as PNG."""
        file.write_bytes(base64.b64decode(self.ask("Page.captureScreenshot", format="png")["data"]))


@contextlib.contextmanager
def tab(profile: Path):
    """Open a browser with an empty profile; it is closed at the end."""
    from websockets.sync.client import connect

    assert CHROMIUM is not None
    words = [CHROMIUM, *QUIET, f"--user-data-dir={profile}", "--remote-debugging-port=0", "about:blank"]
    with subprocess.Popen(words, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as process:
        try:
            file, end = profile / "DevToolsActivePort", time.monotonic() + 120
            while not file.is_file() or not file.read_text().strip():
                assert time.monotonic() < end, "the browser did not start"
                time.sleep(0.1)
            port = file.read_text().split()[0]
            pages = json.load(urlopen(f"http://127.0.0.1:{port}/json/list"))
            page = next(each for each in pages if each["type"] == "page")
            with connect(page["webSocketDebuggerUrl"], max_size=None) as socket:
                yield Tab(socket)
        finally:
            process.terminate()
