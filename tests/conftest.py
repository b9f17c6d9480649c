"""What every test process begins with."""

import gc
import os
import signal
import sys

import pytest

# A shell without job control starts background work with Ctrl-C ignored, and processes inherit that; the tests that
# press it want it as in a terminal.
signal.signal(signal.SIGINT, signal.default_int_handler)

# Tests change what results are made of, and look at how they are computed: compiled kernels alone are cached. Tests of
# the cache name a folder for all of it.
_CACHE = os.environ.get("SPECKLEGEN_CACHE", "")
if _CACHE != "off":
    os.environ["SPECKLEGEN_CACHE"] = "kernels:" + _CACHE.removeprefix("kernels:")

# Without bytecode, each of the many processes that tests start would compile all modules anew, and pytest all tests.
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
sys.dont_write_bytecode = False


@pytest.hookimpl(wrapper=True)
def pytest_collection():
    """Search for no garbage while tests are collected, and never again among the million objects that this makes."""
    gc.disable()
    try:
        return (yield)
    finally:
        gc.freeze()
        gc.enable()


def pytest_collection_modifyitems(items):
    """Give long validations half a day in the place of the ten minutes of all other tests; begin with wave tracing.

    Its kernels take longest to compile, and pages and examples use them. At the end of a run, where processes take over
    each other's tests, two of them would compile the same ones side by side.
    """
    items.sort(key=lambda item: "wavetracing" not in item.path.parts)
    for item in items:
        if item.get_closest_marker("slow"):
            item.add_marker(pytest.mark.timeout(12 * 3600))


@pytest.fixture(autouse=True)
def _plan_anew():
    """Forget plans before every test: many tests replace what plans are made of."""
    for name, function in (("specklegen.planning.planning", "_proposed"), ("specklegen.mean.rule", "mean_decision")):
        if name in sys.modules:
            getattr(sys.modules[name], function).cache_clear()
