"""The site: it is built without a warning, every public name is in it, and a browser shows it without an error.

The build runs the gallery, which takes minutes: ``pytest -m slow tests/test_site.py``. SITE=build/site takes a site
that `make docs` has built.
"""

import functools
import http.server
import importlib
import inspect
import json
import os
import re
import shutil
import subprocess
import sys
import threading
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlsplit

import pytest
from scenes import ROOT

from specklegen import SUBJECTS

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
LONG = re.compile(r"(auto_gallery|generated|notes)/|project/reference|genindex|py-mod|search")
"""Pages that may be longer: reference, gallery and notes."""
QUIET = ["--headless", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run", "--disable-sync",
         "--disable-background-networking", "--disable-component-update"]  # fmt: skip
COMPLAINT = re.compile(r"CONSOLE[^\n]*(?:[Ee]rror|Uncaught|Failed|Refused)[^\n]*")
PAGES = {"index.html": "specklegen", "auto_gallery/physics/plot_02_tilt_and_memory.html": "Tilt, and the memory effect",
         "generated/specklegen.memory_effect.html": "specklegen.memory_effect"}  # fmt: skip


def test_every_page_is_in_the_navigation():
    """A page in no toctree is a warning, which stops the build."""
    index = (ROOT / "docs/index.md").read_text()
    listed = {line for block in re.findall(r":::\{toctree\}\n(.*?):::", index, re.DOTALL) for line in block.split("\n")}
    assert {page.stem for page in (ROOT / "docs").glob("*.md")} - listed == {"index"}


@pytest.fixture(scope="module")
def site(tmp_path_factory) -> Path:
    """The site, built with warnings as errors."""
    if "SITE" in os.environ:
        return Path(os.environ["SITE"]).resolve()
    for needed in ("sphinx", "myst_parser", "sphinx_gallery", "pydata_sphinx_theme", "sphinxcontrib.bibtex"):
        pytest.importorskip(needed, reason="needs the extra docs")
    out = tmp_path_factory.mktemp("site")
    command = [sys.executable, "-m", "sphinx", "-W", "--keep-going", "-q", "-b", "html", "docs", str(out)]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=3600)
    assert done.returncode == 0, done.stderr[-4000:]
    return out


@pytest.mark.slow
def test_every_public_name_has_a_page(site):
    rooms, seen = ("datasets", "fdtd", "instrument", "measured", "models", "wavetracing"), set()
    for package in ("specklegen", *(f"specklegen.{name}" for name in (*SUBJECTS, *rooms))):
        module = importlib.import_module(package)
        for name in module.__all__:
            thing = getattr(module, name)
            if (inspect.ismodule(thing) and name != "materials") or id(thing) in seen:
                continue  # what two packages hand out has one page
            seen.add(id(thing))
            assert (site / "generated" / f"{package}.{name}.html").is_file(), name


@pytest.mark.slow
def test_the_gallery_has_pictures(site):
    shown = {file.name for file in (site / "_images").glob("sphx_glr_plot_*.png")}
    for script in (ROOT / "docs/gallery").glob("*/plot_*.py"):
        assert any(script.stem in name for name in shown), script


class Links(HTMLParser):
    """Anchors and links of a page."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.anchors: set[str] = set()
        self.links: set[str] = set()
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        found = dict(attrs)
        self.anchors |= {found[name] for name in ("id", "name") if found.get(name)}
        self.links |= {found[name] for name in ("href", "src") if found.get(name)}


@pytest.mark.slow
def test_every_link_inside_the_site_leads_somewhere(site):
    """To a file, and to an anchor where it names one; `make linkcheck` follows those to other sites."""
    ours = [page for page in site.rglob("*.html") if page.relative_to(site).parts[0] not in ("_static", "_modules")]
    pages = {page.resolve(): Links(page.read_text()) for page in ours}
    lost = []
    for page, held in pages.items():
        for link in held.links:
            address = urlsplit(link)
            if address.scheme or address.netloc:
                continue
            there = (page.parent / unquote(address.path)).resolve() if address.path else page
            there = there / "index.html" if there.is_dir() else there
            known = address.fragment == "" or there not in pages or unquote(address.fragment) in pages[there].anchors
            if not there.is_file() or not known:
                lost.append((page.name, link))
    assert sum(len(held.links) for held in pages.values()) > 1000
    assert lost == []


@pytest.fixture(scope="module")
def address(site):
    """Where the site is served to this machine alone."""
    handler = functools.partial(http.server.SimpleHTTPRequestHandler, directory=str(site))
    handler.log_message = lambda *words: None  # type: ignore[attr-defined]
    with http.server.ThreadingHTTPServer(("127.0.0.1", 0), handler) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        yield f"http://127.0.0.1:{server.server_port}"
        server.shutdown()


@pytest.mark.slow
@pytest.mark.skipif(CHROMIUM is None, reason="there is no Chromium here")
def test_every_page_fits_a_telephone_and_a_screen(site, tmp_path):
    """Each page, at 390 and at 1280 pixels: no error on the console, nothing reaches over its edge, and no page for
    users is above 9000 pixels high. A page of our own shows the others in a frame, one after another, and sends back
    what it saw."""
    pages = [str(page.relative_to(site)) for page in sorted(site.rglob("*.html"))
             if page.relative_to(site).parts[0] not in ("_static", "_modules", "_downloads")]  # fmt: skip
    pages = [page for page in pages if re.search(os.environ.get("PAGES", ""), page)]
    found, complaints = shown(site, tmp_path, pages, (390, 1280))
    assert complaints == []
    assert len(found) == 2 * len(pages)
    assert [(page, width, over) for page, width, over, _ in found if over] == []
    assert [(page, height) for page, _, _, height in found if height > 9000 and not LONG.match(page)] == []


@pytest.mark.slow
@pytest.mark.skipif(CHROMIUM is None, reason="there is no Chromium here")
def test_a_page_that_is_too_wide_or_has_an_error_is_told(tmp_path):
    """What the test of every page would miss, were it blind."""
    site = tmp_path / "site"
    site.mkdir()
    (site / "narrow.html").write_text("<p>narrow</p>")
    (site / "wide.html").write_text("<div id=long style='width: 700px; height: 9001px'>wide</div>")
    (site / "wrong.html").write_text("<script>nothing.at.all</script><img src=nowhere.png>")
    found, complaints = shown(site, tmp_path / "profile", ["narrow.html", "wide.html", "wrong.html"], (390, 1280))
    assert [(page, width) for page, width, over, _ in found if over] == [("wide.html", 390)]
    assert len(found) == 6
    assert [height > 9000 for page, _, _, height in found] == [page == "wide.html" for page, *_ in found]
    assert any("nothing is not defined" in each for each in complaints)
    assert "404 /nowhere.png" in complaints


DRIVER = """<!doctype html><meta charset=utf-8><body style="margin: 0"><script>
const over = (inside) => {
  const edge = inside.documentElement.clientWidth;
  if (inside.documentElement.scrollWidth <= edge + 1) return "";
  const wide = [...inside.body.querySelectorAll("*")].filter((each) => each.getBoundingClientRect().right > edge + 1);
  return `${inside.documentElement.scrollWidth}: ` + wide.slice(-3).map((each) => each.outerHTML.slice(0, 80)).join();
};
const show = (page, width) => new Promise((done) => {
  const frame = document.createElement("iframe");
  frame.style = `width: ${width}px; height: 800px; border: 0`;
  frame.onload = () => setTimeout(() => {
    done([page, width, over(frame.contentDocument), frame.contentDocument.documentElement.scrollHeight]);
    frame.remove();
  }, 50);
  frame.src = `/${page}`;
  document.body.append(frame);
});
(async () => {
  const [pages, widths] = await (await fetch("/asked")).json(), found = [];
  for (const width of widths) for (const page of pages) found.push(await show(page, width));
  await fetch("/told", {method: "POST", body: JSON.stringify(found)});
})();
</script>"""


def shown(site: Path, profile: Path, pages: list[str], widths: tuple[int, ...]) -> tuple[list, list[str]]:
    """What of each page reaches over the edge of a frame of each width, and what the browser complained of."""
    told: list = []
    lost: list[str] = []
    ended = threading.Event()

    class Handler(http.server.SimpleHTTPRequestHandler):
        def log_message(self, *words) -> None:
            pass

        def send_error(self, code, message=None, explain=None) -> None:  # of a file that is not there
            lost.append(f"{code} {self.path}")
            super().send_error(code, message, explain)

        def do_GET(self) -> None:
            text = {"/driver": DRIVER, "/asked": json.dumps([pages, widths]), "/favicon.ico": ""}.get(self.path)
            if text is None:
                super().do_GET()
                return
            self.send_response(200)
            self.send_header("Content-Type", "text/html")
            self.end_headers()
            self.wfile.write(text.encode())

        def do_POST(self) -> None:
            told.extend(json.loads(self.rfile.read(int(self.headers["Content-Length"]))))
            self.send_response(204)
            self.end_headers()
            ended.set()

    assert CHROMIUM is not None
    handler = functools.partial(Handler, directory=str(site))
    profile.mkdir(exist_ok=True)
    with http.server.ThreadingHTTPServer(("127.0.0.1", 0), handler) as server, (profile / "log").open("w") as log:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        words = [CHROMIUM, *QUIET, f"--user-data-dir={profile}", "--enable-logging=stderr", "--remote-debugging-port=0"]
        browser = subprocess.Popen([*words, f"http://127.0.0.1:{server.server_port}/driver"], stdout=subprocess.DEVNULL,
                                   stderr=log)  # fmt: skip
        try:
            assert ended.wait(60 + 10 * len(pages) * len(widths)), "the browser did not come to the end"
        finally:
            browser.terminate()
            browser.wait(60)
            server.shutdown()
    return told, lost + COMPLAINT.findall((profile / "log").read_text())


def seen(url: str, profile: Path) -> tuple[str, list[str]]:
    """The page as the browser has it once its scripts have run, and what they complained of."""
    words = [CHROMIUM, *QUIET, f"--user-data-dir={profile}", "--virtual-time-budget=15000", "--enable-logging=stderr"]
    done = subprocess.run([*words, "--dump-dom", url], capture_output=True, text=True, timeout=300)
    return done.stdout, COMPLAINT.findall(done.stderr)


@pytest.mark.slow
@pytest.mark.skipif(CHROMIUM is None, reason="there is no Chromium here")
@pytest.mark.parametrize("page", PAGES)
def test_a_page_is_shown_without_an_error(page, address, tmp_path):
    text, complaints = seen(f"{address}/{page}", tmp_path)
    assert PAGES[page] in re.sub(r"<[^>]+>", "", text)
    assert complaints == []
