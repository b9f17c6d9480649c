"""The tests that `make quick` chooses by what has changed since main."""

import runpy
from pathlib import Path

import grimp
import pytest

ROOT = Path(__file__).parents[1]
SCRIPT = runpy.run_path(str(ROOT / "scripts/changed_rooms.py"))
GRAPH = {"specklegen.kernels.lanes": ["specklegen.kernels.walk"],
         "specklegen.kernels.walk": ["specklegen.paths.tracer", "specklegen.kernels.lanes"],
         "specklegen.paths.tracer": ["specklegen.rendering"]}  # fmt: skip


def chosen(*files):
    return set(SCRIPT["selection"](files, lambda module: GRAPH.get(module, ()))) - set(SCRIPT["ALWAYS"])


@pytest.mark.parametrize(("file", "tests"), [
    ("specklegen/kernels/lanes.py", {"tests/kernels", "tests/paths"}),  # by way of another kernel, and no further
    ("specklegen/paths/tracer.py", {"tests/paths", "tests/test_rendering.py"}),
    ("datasets/store/store.py", {"tests/datasets/store"}), ("specklegen/tiles.py", {"tests/test_tiles.py"}),
    ("specklegen/models/metrics.py", {"tests/models"}),
    ("tests/kernels/test_bessel.py", {"tests/kernels/test_bessel.py"}), ("tests/kernels/test_that_is_gone.py", set()),
    ("tests/fuzz_stores.py", {"tests/datasets/store/test_store_kills.py",
                              "tests/datasets/store/test_store_without_locks.py"}),
    ("docs/motion.md", {"tests/test_docs.py", "tests/test_site.py"}),
    ("pyproject.toml", {"tests/test_packaging.py"}),
])  # fmt: skip
def test_a_changed_file_has_its_tests(file, tests):
    assert chosen(file) == tests


def test_every_selection_exists():
    """Of all modules of the library, and where nothing has changed."""
    modules = [name for name in grimp.build_graph("specklegen").modules if name.count(".")]
    paths = {SCRIPT["tests_of_module"](name) for name in modules} | set(SCRIPT["FIXED"])
    assert len(modules) > 500
    assert [path for path in paths if not (ROOT / path).exists()] == []
